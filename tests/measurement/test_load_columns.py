"""Columns of the load: what is read, and what is refused."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import cleaning, table


def rows(n=3, **extra):
    q = np.random.default_rng(0).uniform(-90.0, 90.0, (n, 6))
    frame = pd.DataFrame(q, columns=[f"q{k}_deg" for k in range(1, 7)])
    frame.insert(0, "pose", [f"p{k}" for k in range(n)])
    frame = frame.assign(target="smr1", x_mm=100.0 + np.arange(n), y_mm=200.0, z_mm=300.0)
    return frame.assign(**extra)


PLACE = {"payload_x_mm": 10.0, "payload_y_mm": -20.0, "payload_z_mm": 80.0}


def torques(n=3):
    return {f"tau{k}_nm": np.arange(n) + 10.0 * k for k in range(1, 7)}


def test_mass_place_and_torques_come_with_the_points():
    seen = table.read(rows(payload_kg=[0.0, 2.5, np.nan], **PLACE, **torques()))
    points = cleaning.clean(seen).points
    assert np.array_equal(points.inputs["payload_kg"], [0.0, 2.5, np.nan], equal_nan=True)
    assert np.abs(points.inputs["payload_centre"] - [0.010, -0.020, 0.080]).max() < 1e-15
    assert np.array_equal(points.inputs["torques"], np.arange(3)[:, None] + 10.0 * np.arange(1, 7))
    some = points.select(np.array([False, True, True]))
    assert np.array_equal(some.inputs["payload_kg"], [2.5, np.nan], equal_nan=True)
    assert some.inputs["payload_centre"].shape == (2, 3)
    assert some.inputs["torques"].shape == (2, 6)
    assert points.to_frame()["payload_kg"].iloc[1] == 2.5


def test_without_columns_or_in_empty_columns_nothing_is_told():
    for frame in (rows(), rows(payload_kg="")):
        points = cleaning.clean(table.read(frame)).points
        assert points.inputs == {}
        assert points.select(np.ones(3, dtype=bool)).inputs == {}


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ({"payload_kg": -1.0}, "row 1, column payload_kg: expected a mass from 0 to 5000 kg or nothing, found -1"),
        ({"payload_kg": 2.0, "payload_x_mm": 1.0}, "missing column payload_y_mm"),
        (PLACE, "missing column payload_kg: the payload's centre needs payload_kg, payload_x_mm, "),
        (PLACE | {"payload_kg": 1.0, "payload_z_mm": 8e4}, "column payload_z_mm: expected a place in the tip link"),
        (
            {"tau1_nm": 1.0, "tau2_nm": 1.0},
            r"missing column tau3_nm, .*: torques are for all joints \(tau1_nm … tau6_nm\)",
        ),
        (torques() | {"tau7_nm": 1.0}, "there is a column tau7_nm: torques"),
        (torques() | {"tau2_nm": ["1", "", "3"]}, "row 2, column tau2_nm: expected a torque in N m, found nothing"),
    ],
)
def test_what_is_no_load_is_refused(extra, words):
    with pytest.raises(MeasurementError, match=words):
        table.read(rows(**extra))


def test_a_pose_carries_one_load():
    frame = pd.concat([rows(payload_kg=1.0), rows(payload_kg=[1.0, 2.0, 1.0]).assign(target="smr2")])
    with pytest.raises(MeasurementError, match="row 5, column payload_kg: expected the payload of pose p1 as in row 2"):
        table.read(frame)
