"""Paths and criteria through `irbcal.inverse_kinematics` and ``irbcal ik``."""

import numpy as np
import pytest
from support import example_robot
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import OptionError

START = np.radians([0, 20, -10, 0, 20, 0])


@pytest.fixture(scope="module")
def swing():
    """Poses that pass next to the wrist's singularity of the IRB 120."""
    q = np.linspace(START, START - np.radians([0, 0, 0, 0, 40, 0]), 9)
    T = irbcal.forward_kinematics("irb120", q).T_base_tip.copy()
    T[:, :3, :3] = T[:, :3, :3] @ np.array([[1, -1e-4, 0], [1e-4, 1, 0], [0, 0, 1.0]])
    u, _, v = np.linalg.svd(T[:, :3, :3])
    T[:, :3, :3] = u @ v
    T[4:, :3, :3] = np.array([[1, -2e-4, 0], [2e-4, 1, 0], [0, 0, 1]]) @ T[4:, :3, :3]
    u, _, v = np.linalg.svd(T[:, :3, :3])
    T[:, :3, :3] = u @ v
    return T


def test_a_path_and_what_stands_in_its_way(swing, tmp_path):
    found = irbcal.inverse_kinematics("irb120", swing, near=START, path=True)
    (place,) = found.singular
    assert "singularity" in found.summary()
    assert place.in_words() in found.summary()
    irbcal.kinematics.poses_to_frame(swing).to_csv(tmp_path / "p.csv", index=False)
    words = ["ik", "irb120", "--poses", str(tmp_path / "p.csv"), "--path", "--near", "0,20,-10,0,20,0"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    assert f"irbcal: {place.in_words()}"[:60] in done.stderr
    assert done.stdout.splitlines()[0].endswith("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,note")


def test_a_criterion_for_seven_joints():
    path = example_robot("panda_description/urdf/panda.urdf")
    q = np.array([[0, 0.2, 0, -1.8, 0.2, 1.9, 0.3], [0.3, 0.4, 0.2, -1.5, 0.2, 1.7, 0.3]])
    T = irbcal.forward_kinematics(path, q, tip_link="panda_link8").T_base_tip
    found = irbcal.inverse_kinematics(path, T, tip_link="panda_link8", redundancy="near", near=q[0])
    assert found.joints[0] == pytest.approx(q[0], abs=1e-6)
    assert found.found.all()
    again = irbcal.forward_kinematics(path, found.joints, tip_link="panda_link8").T_base_tip
    assert np.abs(again - T).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"redundancy": "limits"}, "irb120_3_058 has 6 joints, none to spare"),
        ({"redundancy": "elbow"}, "redundancy: expected limits or near, found 'elbow'"),
        ({"all_branches": True, "path": True}, "all_branches: goes neither with a path nor with a criterion"),
    ],
)
def test_wrong_options_are_refused(swing, options, words):
    with pytest.raises(OptionError, match=words):
        irbcal.inverse_kinematics("irb120", swing, **options)
