"""Python: one module on numpy alone for batches, and the same on plain floats, for machines without irbcal.

What they compute stands in `irbcal.exporting.formulas`, with `irbcal.exporting.batch` or `irbcal.exporting.plain` for
numbers of a kind: an export is that very text with the constants of a calibration behind it. irbcal itself gives the
constants to these classes, and never runs what it wrote.
"""

from __future__ import annotations

import inspect
import re
from types import ModuleType
from typing import TYPE_CHECKING

from markupsafe import Markup

from irbcal.exporting import batch, formulas, plain
from irbcal.exporting.robot_numbers import ExportFiles, RobotNumbers, Vectors, constants, render

if TYPE_CHECKING:
    from irbcal.exporting.source import Source

DESCRIPTION = "Python: a module on numpy alone, and the same on plain floats"
NEXT_STEP = "python {folder}/{word}_calibrated.py     # are its numbers right here, too?"


def files(source: Source) -> ExportFiles:
    """Two modules."""
    numbers, vectors, word = source.numbers, source.vectors, source.numbers.identifier
    return ExportFiles(
        {
            f"{word}_calibrated.py": text(numbers, vectors),
            f"{word}_calibrated_plain.py": text(numbers, vectors, plain),
        }
    )


def _one_text(code: ModuleType) -> str:
    """The text of the formulas, then that of a module without its import of them."""
    text_of_module = inspect.getsource(code).partition("from __future__ import annotations\n")[2]
    return inspect.getsource(formulas) + re.sub(r"(?m)^from irbcal\..*\n", "", text_of_module)


def text(numbers: RobotNumbers, vectors: Vectors, code: ModuleType = batch) -> bytes:
    """A module: `batch` or `plain` with the constants of a calibration."""
    values = {
        "code": Markup(_one_text(code)),
        "needs": {batch: "numpy alone", plain: "nothing but Python itself"}[code],
        "robot": {batch: "Batch", plain: "Plain"}[code],
        "constants": constants(numbers, vectors),
    }
    return render("python.py.j2", numbers, vectors, **values)
