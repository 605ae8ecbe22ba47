"""Two robots whose tips touch each other: SIMULATED contacts give back where the other stands, with its interval."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import assert_same_poses
from touching import SOCKET, TIP, reach

from irbcal.correction.cell_frames import cell_frames
from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.units import MM

T_OTHER = frames.from_xyz_angles([1.65, 0.1, 0.02, 0.01, -0.02, np.pi - 0.1])
JOINTS = [f"q{k}_deg" for k in range(1, 7)]
OTHER = [f"other_{name}" for name in JOINTS]


def touches_of(robot, noise=0.0, contacts=12, seed=1):
    """Six touches of a socket by the robot, then contacts of its tip with that of the other; noise in metres."""
    rng = np.random.default_rng(seed)
    rows = []

    def near(place):
        return reach(robot, place + rng.normal(scale=noise, size=3) * (noise > 0), rng)

    for _ in range(6):
        rows.append(["tool", "grip", "socket", "grip", "", "", *np.degrees(near(SOCKET)), *[""] * 6])
    for k in range(contacts):
        place = np.array([0.8, 0.05, 0.55]) + rng.uniform(-0.15, 0.15, 3)
        there = frames.apply(frames.inverse(T_OTHER), place[None])[0]
        q, other = near(place), reach(robot, there, rng)
        rows.append(["work_object", "left", f"c{k}", "grip", "contact", "probe", *np.degrees(q), *np.degrees(other)])
    table = pd.DataFrame(rows, columns=["frame", "name", "point", "tool", "kind", "other_tool", *JOINTS, *OTHER])
    return table.assign(u95_mm=0.1)


@pytest.fixture(scope="module")
def other_cell(record, robot):
    rng = np.random.default_rng(7)
    q = np.degrees([reach(robot, SOCKET + rng.normal(scale=2e-5, size=3), rng) for _ in range(8)])
    head = {"frame": "tool", "name": "probe", "point": "socket", "tool": "probe", "u95_mm": 0.04}
    return cell_frames(record, pd.DataFrame(dict(zip(JOINTS, q.T, strict=True))).assign(**head))


def apart(robot, cell, other_cell):
    """Mean distance that both cells say of the tips where they truly meet, at new joints, metres."""
    meeting = touches_of(robot, contacts=20, seed=99).iloc[6:]
    q, other = (np.radians(meeting[names].to_numpy(dtype=float)) for names in (JOINTS, OTHER))
    tip, probe = (named.T_true[:, 3] for named in (cell.tools["grip"], other_cell.tools["probe"]))
    other_tips = cell.work_objects["left"].T_true @ (robot.poses(other) @ probe)[..., None]
    return np.linalg.norm((robot.poses(q) @ tip)[:, :3] - other_tips[:, :3, 0], axis=1).mean()


@pytest.mark.parametrize("simulated", [True, False])
def test_a_simulated_robot_on_the_other_side_is_named(record, robot, other_cell, simulated):
    measured, other = (record.model_copy(update={"simulated": answer}) for answer in (False, simulated))
    cell = cell_frames(measured, touches_of(robot), other=other, other_cell=replace(other_cell, simulated=False))
    assert cell.simulated == simulated


def test_contacts_give_the_other_base(record, robot, other_cell):
    """Without noise the other base comes back; with 0.05 mm in each of 12 contacts tips meet within 0.05 mm."""
    exact = replace(other_cell, tools={"probe": replace(other_cell.tools["probe"], T_true=frames.transform(None, TIP))})
    cell = cell_frames(record, touches_of(robot), other=record, other_cell=exact)
    assert_same_poses(cell.work_objects["left"].T_true, T_OTHER, 1e-8, 1e-8)
    errors = []
    for seed in range(3):
        cell = cell_frames(record, touches_of(robot, 5e-5, seed=seed), other=record, other_cell=other_cell)
        errors.append(apart(robot, cell, other_cell))
    assert np.mean(errors) < 5e-5, errors
    nominal = replace(cell.work_objects["left"], T_true=cell.work_objects["left"].T_nominal)
    assert apart(robot, replace(cell, work_objects={"left": nominal}), other_cell) > 1e-4


def test_errors_of_the_other_robot_go_on(record, robot, other_cell):
    """The tip of the other tool moved by each coordinate, and all adjusted anew: that is what its covariance adds."""
    table = touches_of(robot)
    T = other_cell.tools["probe"].T_true
    motions = []
    for k in range(3):
        ends = []
        for sign in (-1e-4, 1e-4):
            moved = {
                "probe": replace(other_cell.tools["probe"], T_true=T @ frames.transform(None, sign * np.eye(3)[k]))
            }
            cell = cell_frames(record, table, other=record, other_cell=replace(other_cell, tools=moved))
            ends.append(cell.work_objects["left"].T_true)
        step = frames.inverse(ends[0]) @ ends[1]
        motions.append(np.r_[frames.vector_from_rotation(step[:3, :3]), step[:3, 3]] / 2e-4)
    M = np.array(motions).T
    whole, certain = (
        cell_frames(record, table, other=record, other_cell=one)
        for one in (other_cell, replace(other_cell, touch_covariance=0.0 * other_cell.touch_covariance))
    )
    rows = whole.rows("work_object", "left")
    added = (whole.touch_covariance - certain.touch_covariance)[rows, rows]
    expected = M @ other_cell.touch_covariance[3:6, 3:6] @ M.T
    np.testing.assert_allclose(added, expected, rtol=0, atol=0.02 * np.abs(expected).max())
    assert whole.u95("work_object", "left", whole.covariance)[0] > 0.01 * MM


def test_contacts_that_are_none_are_refused(record, robot, other_cell):
    table = touches_of(robot, contacts=5)
    wrong = table.assign(other_tool=table["other_tool"].replace("probe", "hook"))
    with pytest.raises(MeasurementError, match="expected a tool of the other cell, found 'hook'"):
        cell_frames(record, wrong, other=record, other_cell=other_cell)
    with pytest.raises(OptionError, match="the calibration of the other robot and its cell"):
        cell_frames(record, table, other=record)
    with pytest.raises(MeasurementError, match="other_q6_deg"):
        cell_frames(record, table.drop(columns="other_q6_deg"), other=record, other_cell=other_cell)
