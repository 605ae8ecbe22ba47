"""The compiled kernel: forward kinematics, its derivative and inverses, for one pose and for many.

``kernel.hpp`` and ``motion.hpp`` are C++17 without dependencies, ``binding.cpp`` makes them a module of Python.
``hatch_build.py`` compiles them where irbcal is installed, if there is a compiler; where there is none, the plain
functions of numpy serve, and `STATE` says why. Both give the same numbers to rounding. The environment variable
``IRBCAL_KERNEL=numpy`` leaves the kernel aside.
"""

from __future__ import annotations

import hashlib
import os
from importlib import import_module
from pathlib import Path
from typing import Any

MOST_JOINTS = 12
"""Longer chains are computed by numpy."""

SOURCES = ("kernel.hpp", "motion.hpp", "binding.cpp")


def _loaded() -> tuple[Any, str]:
    """The compiled module, or None, and what is to be said of it."""
    if os.environ.get("IRBCAL_KERNEL") == "numpy":
        return None, "numpy, as IRBCAL_KERNEL asks for"
    try:
        compiled = import_module("irbcal.kernel.compiled")
    except ImportError:
        return None, "numpy: no C++17 compiler was found when irbcal was installed, all is computed more slowly"
    here = Path(__file__).parent
    digest = hashlib.sha256(b"".join((here / name).read_bytes() for name in SOURCES)).hexdigest()
    if compiled.sources != digest:
        return None, "numpy: the compiled kernel is of another version; install irbcal again"
    return compiled, "compiled"


_compiled, STATE = _loaded()
Kernel, Motion = getattr(_compiled, "Kernel", None), getattr(_compiled, "Motion", None)
cos_sin: Any = getattr(_compiled, "cos_sin", None)


def of_robot(numbers: dict[str, Any]) -> Any:
    """The kernel of a robot from its numbers (`irbcal.modeling.term_sums.compiled`); None where there is no kernel."""
    return None if Kernel is None else Kernel(numbers)
