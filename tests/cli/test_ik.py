"""``irbcal ik`` prints what `irbcal.kinematics.inverse_kinematics` finds."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app
from irbcal.kinematics import forward_kinematics, inverse_kinematics

NEAR = "10,20,30,40,50,60"


@pytest.fixture
def poses(demo_calibration, tmp_path):
    """Two poses that are reached and one that is not."""
    q = np.radians([[10, 20, 30, 40, 50, 60], [-50, -10, 5, -20, 40, 130], [0, 0, 0, 0, 30, 0]])
    table = forward_kinematics(demo_calibration, q).to_frame()
    table.loc[2, "x_mm"] += 9000
    table.to_csv(tmp_path / "p.csv", index=False)
    return tmp_path / "p.csv"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, []),
        ({"near": np.radians([10, 20, 30, 40, 50, 60])}, ["--near", NEAR]),
        ({"nominal": True}, ["--nominal"]),
        ({"all_branches": True}, ["--all-branches"]),
    ],
)
def test_the_command_is_the_function(demo_calibration, poses, options, words):
    found = inverse_kinematics(demo_calibration, poses, **options)
    expected = found.to_frame()
    done = CliRunner().invoke(app, ["ik", str(demo_calibration), "--poses", str(poses), *words])
    assert done.exit_code == 0
    printed = done.stdout.splitlines()
    assert printed[0].split(",") == list(expected.columns)
    assert len(printed) == 1 + len(found)
    in_json = CliRunner().invoke(app, ["ik", str(demo_calibration), "--poses", str(poses), *words, "--json"])
    rows = [json.loads(line) for line in in_json.stdout.splitlines()]
    assert rows == expected.astype(object).where(expected.notna(), None).to_dict(orient="records")
    if "all_branches" in options:
        assert done.stderr == ""
    else:
        assert "1 of 3 poses have no joints, see the column note" in done.stderr
        assert rows[2]["q1_deg"] is None
        assert ",,,,,,,the target is out of the robot's reach" in printed[3]


@pytest.mark.parametrize("near", ["1,2", "1,2,3,4,5,x", "1,2,3,4,5,nan", ""])
def test_a_wrong_near_is_a_wrong_call(poses, near):
    done = CliRunner().invoke(app, ["ik", "irb1600", "--poses", str(poses), "--near", near])
    assert done.exit_code == 2
    said = " ".join(done.stderr.replace("│", " ").split())
    assert "--near: expected 6 numbers (q1_deg, q2_deg, q3_deg, q4_deg, q5_deg, q6_deg), found" in said
