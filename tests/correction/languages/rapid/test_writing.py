"""New numbers in a module; more stands in tests/correction/test_text_program.py."""

import numpy as np
from rapid_modules import CELL, named

from irbcal.correction.languages import rapid
from irbcal.correction.languages.rapid.writing import edits


def test_only_numbers_that_change_are_written():
    seen = rapid.parse(CELL.encode())
    k = named(seen, "jHome")
    value = np.radians([0, 10, -20, 30.25, 41.5, -90])
    ((start, end, text),) = edits(seen, {k: value}, {})
    assert (CELL[start:end], text) == ("40", "41.5")
