"""``irbcal fk`` prints what `irbcal.kinematics.forward_kinematics` finds."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app
from irbcal.kinematics import forward_kinematics

Q = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0\n10,20,30,40,50,60\n"


@pytest.fixture
def joints(tmp_path):
    """Two rows of joints."""
    (tmp_path / "q.csv").write_text(Q)
    return tmp_path / "q.csv"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, []),
        ({"nominal": True}, ["--nominal"]),
        ({"target": "smr1"}, ["--target", "smr1"]),
        ({"target": "smr1", "uncertainty": True}, ["--target", "smr1", "--uncertainty"]),
        ({"uncertainty": True}, ["--uncertainty"]),
        ({"intervals": True, "target": "smr2"}, ["--intervals", "--target", "smr2"]),
        ({"intervals": True}, ["--intervals"]),
    ],
)
def test_the_command_is_the_function(demo_calibration, joints, program, options, words):
    expected = forward_kinematics(demo_calibration, joints, **options).to_frame()
    printed = program("fk", demo_calibration, "--joints", joints, *words).splitlines()
    assert printed[0].split(",") == list(expected.columns)
    cells = [line.replace("False", "0").replace("True", "1").split(",") for line in printed[1:]]
    np.testing.assert_allclose(np.array(cells, dtype=float), expected.astype(float), rtol=0, atol=5.1e-10)
    done = CliRunner().invoke(app, ["fk", str(demo_calibration), "--joints", str(joints), *words, "--json"])
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert rows == expected.to_dict(orient="records")
    assert ("held-out errors of this calibration: mean" in done.stderr) == ("uncertainty" in options)


def test_links_of_a_urdf(joints, program):
    joints.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n0,0,0,0,0\n")
    printed = program("fk", "irb1600", "--base-link", "link_1", "--tip-link", "flange", "--joints", joints)
    expected = forward_kinematics("irb1600", joints, base_link="link_1", tip_link="flange").to_frame()
    np.testing.assert_allclose(np.array(printed.splitlines()[1].split(","), float), expected.iloc[0], atol=5.1e-10)
