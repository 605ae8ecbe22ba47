"""URDFs from Denavit-Hartenberg tables, against products of matrices written out here."""

import json

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.io.dh_table import urdf_from_dh

ROWS = pd.DataFrame(
    {
        "alpha_deg": [0.0, -90.0, 0.0, -90.0, 90.0, -90.0],
        "a_mm": [0.0, 150.0, 700.0, 110.0, 0.0, 0.0],
        "theta_deg": [0.0, -90.0, 0.0, 0.0, 0.0, 180.0],
        "d_mm": [486.5, 0.0, 0.0, 600.0, 0.0, 65.0],
        "lower_deg": [-180.0, -90.0, -245.0, -200.0, -115.0, -400.0],
        "upper_deg": [180.0, 150.0, 65.0, 200.0, 115.0, 400.0],
    }
)


def rot(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    k = [(1, 2), (0, 2), (0, 1)]["xyz".index(axis)]
    T[np.ix_(k, k)] = [[c, -s], [s, c]]
    return T


def move(axis, length):
    T = np.eye(4)
    T["xyz".index(axis), 3] = length
    return T


def by_hand(rows, convention, q):
    out = []
    for values in q:
        T, joint = np.eye(4), 0
        for row in rows.to_dict("records"):
            alpha, a = np.radians(row["alpha_deg"]), row["a_mm"] / 1e3
            theta, d = np.radians(row["theta_deg"]), row["d_mm"] / 1e3
            kind = row.get("type", "revolute")
            if kind != "fixed":
                value = values[joint] * float(row.get("sign", 1))
                theta, d = (theta + value, d) if kind == "revolute" else (theta, d + value)
                joint += 1
            steps = [rot("x", alpha), move("x", a), rot("z", theta), move("z", d)]
            if convention == "standard":
                steps = [rot("z", theta), move("z", d), move("x", a), rot("x", alpha)]
            for step in steps:
                T = T @ step
        out.append(T)
    return np.array(out)


@pytest.mark.parametrize("convention", ["modified", "standard"])
def test_kinematics(convention, tmp_path):
    rows = ROWS.assign(sign=["1", "-1", "1", "1", "-1", "1"])
    made = urdf_from_dh(rows.astype(str), convention, name="mine")
    arm = made.urdf.arm
    q = arm.random_joints(50, 1)
    np.testing.assert_allclose(arm.forward(q), by_hand(rows, convention, q), atol=1e-9)
    np.testing.assert_allclose(np.degrees(arm.lower), ROWS["lower_deg"], rtol=0, atol=1e-9)
    again = irbcal.read_urdf(made.save(tmp_path / "mine.urdf")).arm
    np.testing.assert_allclose(again.forward(q), arm.forward(q), atol=1e-12)
    assert "mine: 6 revolute joints" in made.summary()
    assert json.loads(json.dumps(made.to_dict()))["joints"] == made.to_frame().to_dict("records")
    assert made.to_frame()["upper"].tolist() == pytest.approx(ROWS["upper_deg"].astype(float).tolist())


@pytest.mark.parametrize("convention", ["modified", "standard"])
def test_rails_flanges_and_other_units(convention):
    rows = pd.DataFrame(
        {
            "joint": ["rail", "turn", "x", "flange"],
            "type": ["prismatic", "revolute", "revolute", "fixed"],
            "alpha_deg": [90.0, -90.0, 30.0, 15.0],
            "a_mm": [0.0, 200.0, 400.0, 10.0],
            "theta_deg": [0.0, 10.0, 0.0, 45.0],
            "d_mm": [100.0, 300.0, 0.0, 80.0],
            "lower_mm": ["0", "", "", ""],
            "upper_mm": ["2000", "", "", ""],
        }
    )
    arm = urdf_from_dh(rows.astype(str), convention).urdf.arm
    assert arm.joint_names == ("rail", "turn", "x")
    assert arm.table.prismatic.tolist() == [True, False, False]
    q = arm.random_joints(20, 0)
    np.testing.assert_allclose(arm.forward(q), by_hand(rows, convention, q), atol=1e-9)
    metres = rows.assign(a_m=rows["a_mm"] / 1e3, alpha_rad=np.radians(rows["alpha_deg"]))
    metres = metres.drop(columns=["a_mm", "alpha_deg"]).astype(str)
    np.testing.assert_allclose(urdf_from_dh(metres, convention).urdf.arm.forward(q), arm.forward(q), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"a_m": "1"}, "found both a_mm and a_m"),
        ({"theta_deg": "ten"}, "column theta_deg: expected a number"),
        ({"type": "ball"}, "expected revolute, prismatic, fixed"),
        ({"type": "prismatic"}, "expected a lower and an upper limit"),
        ({"sign": "2"}, "column sign"),
        ({"lower_deg": "170"}, "expected a lower and an upper limit"),
        ({"joint": "same"}, "is used 6 times"),
        ({"type": "fixed"}, "expected 2 to 20"),
    ],
)
def test_what_is_refused(change, words):
    with pytest.raises(IrbcalError, match=words):
        urdf_from_dh(ROWS.assign(**change).astype(str), "modified")


def test_missing_columns_and_conventions():
    with pytest.raises(MeasurementError, match="expected a column d_mm or d_m"):
        urdf_from_dh(ROWS.drop(columns="d_mm").astype(str), "standard")
    with pytest.raises(OptionError, match="convention"):
        urdf_from_dh(ROWS.astype(str), "craig")
    with pytest.raises(RobotError):
        urdf_from_dh(ROWS.astype(str), "standard", name="a\nb")
