"""Compiles the kernel into the package, for wheels and for installations that point here, if there is a compiler.

``python hatch_build.py`` does the same in place.
"""

import hashlib
import os
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

FOLDER = Path(__file__).parent / "irbcal" / "kernel"
SOURCES = ("kernel.hpp", "motion.hpp", "binding.cpp")
STABLE = sys.version_info >= (3, 11)  # buffers are part of Python's stable interface since then
OPTIONS = (
    "-std=c++17",
    "-O3",
    "-DNDEBUG",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-fopenmp-simd",
    "-fno-math-errno",
    "-Wno-psabi",  # vectors are not handed across objects
)
EXACT = ("-fno-trapping-math", "-ffp-contract=off")  # the same numbers on every processor, for one pose and for many


def compile_kernel():
    """Compile the kernel beside its sources.

    Returns
    -------
    str or None
        Why it could not be; None where it was.
    """
    digest = hashlib.sha256(b"".join((FOLDER / name).read_bytes() for name in SOURCES)).hexdigest()
    target = FOLDER / ("compiled.abi3.so" if STABLE else f"compiled{sysconfig.get_config_var('EXT_SUFFIX')}")
    draft = target.with_name(f"draft-{os.getpid()}.so")
    if target.is_file() and digest.encode() in target.read_bytes() and _loads(target):
        return None
    compiler = shlex.split(os.environ.get("CXX", "")) or ["c++"]
    options = [*OPTIONS, *EXACT, f'-DIRBCAL_SOURCES="{digest}"', f"-I{sysconfig.get_path('include')}"]
    options += ["-DPy_LIMITED_API=0x030B0000"] if STABLE else []
    options += ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else []
    try:
        options += shlex.split(os.environ.get("CXXFLAGS", ""))
        command = [*compiler, *options, str(FOLDER / "binding.cpp"), "-o", str(draft)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
        if done.returncode != 0:
            errors = [line for line in done.stderr.splitlines() if "error" in line]
            return f"{compiler[0]} failed: {(errors or ['no reason given'])[0]}"
        if not _loads(draft):
            return f"what {compiler[0]} made cannot be loaded"
        draft.replace(target)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{compiler[0]}: {error}"
    finally:
        draft.unlink(missing_ok=True)
    return None


def _loads(path):
    """Whether a module can be imported; tried in a process of its own."""
    check = "import importlib.util as u, sys; s = u.spec_from_file_location('compiled', sys.argv[1]); "
    check += "s.loader.exec_module(u.module_from_spec(s))"
    return (
        subprocess.run([sys.executable, "-I", "-c", check, str(path)], capture_output=True, timeout=60).returncode == 0
    )


if __name__ == "__main__":
    sys.exit(compile_kernel())

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # as a program
    pass
else:

    class KernelHook(BuildHookInterface):
        """Adds the compiled kernel to a wheel."""

        PLUGIN_NAME = "custom"

        def initialize(self, version, build_data):
            """Compile, and name the wheel by what is in it."""
            reason = compile_kernel()
            if reason is not None:
                self.app.display_warning(f"irbcal's kernel is not compiled ({reason}): numpy serves in its place")
                return
            build_data["artifacts"].append("irbcal/kernel/compiled.*")
            build_data["pure_python"] = False
            if STABLE:
                platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
                build_data["tag"] = f"cp311-abi3-{platform}"
            else:
                build_data["infer_tag"] = True
