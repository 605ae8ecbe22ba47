"""Trajectories to files and back."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import OptionError, ProgramError
from irbcal.io import urdf
from irbcal.modeling.trajectory import Trajectory


@pytest.mark.parametrize("name", ["a.csv", "a.yaml", "a.yml"])
@pytest.mark.parametrize("known", [1, 2, 3])
def test_what_is_written_is_read(tmp_path, name, known):
    nominal = urdf.read("irb1600").arm
    values = 0.3 * np.random.default_rng(1).standard_normal((3, 4, 6))
    given = Trajectory(np.array([0.0, 0.1, 0.25, 1.5]), *values[:known], names=nominal.joint_names)
    found = irbcal.read_trajectory(irbcal.write_trajectory(given, tmp_path / name), "irb1600")
    assert found.times == pytest.approx(given.times, abs=1e-12)
    for one, expected in zip((found.q, found.dq, found.ddq), (*values[:known], None, None), strict=False):
        if expected is None:
            assert one is None
        else:
            assert one == pytest.approx(expected, abs=1e-11)
    assert found.names == nominal.joint_names


def test_other_files_are_refused(tmp_path):
    given = Trajectory([0.0], np.zeros((1, 6)))
    with pytest.raises(OptionError, match=r"ends with \.yaml or \.csv, found a\.txt"):
        irbcal.write_trajectory(given, tmp_path / "a.txt")
    given.to_frame().drop(columns="time_s").to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ProgramError, match="row 1: expected a column time_s beside the joints"):
        irbcal.read_trajectory(tmp_path / "a.csv", "irb1600")
