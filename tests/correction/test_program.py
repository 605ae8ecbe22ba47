"""What all programs have in common: bytes to read, and a mark that is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from irbcal.correction.program import Goals, read_bytes, refuse_filtered
from irbcal.errors import ProgramError


def test_files_that_cannot_be_programs(tmp_path):
    (tmp_path / "empty.mod").write_text(" \n")
    for name, expected in (("none.mod", "there is no such file"), ("", "found a folder"), ("empty.mod", "is empty")):
        with pytest.raises(ProgramError, match=expected) as caught:
            read_bytes(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)


@pytest.mark.parametrize(("mark", "which"), [("abc", " for calibration abc"), ("", "")])
def test_marked_programs_are_refused(mark, which):
    with pytest.raises(ProgramError) as caught:
        refuse_filtered(SimpleNamespace(source="job.mod", fingerprint=mark))
    assert str(caught.value) == f"job.mod: these are fake targets already{which}: filter the original program"
    refuse_filtered(SimpleNamespace(source="job.mod", fingerprint=None))


def test_goals_are_locked():
    goals = Goals("joint", np.arange(2), ("a", "b"), np.arange(2), np.zeros((2, 6)))
    with pytest.raises(ValueError, match="read-only"):
        goals.values[0, 0] = 1.0
