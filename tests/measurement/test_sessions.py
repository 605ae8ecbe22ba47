"""Sessions: dividing, joining, and own bases and targets for one robot."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from sessions_cases import NOISE, parts, together, truth
from support import arm, measured, write_measurements

from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification import minimax
from irbcal.identification.choices import Goal
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit import choose_level, identify, identify_by
from irbcal.measurement import table
from irbcal.measurement.points import distances
from irbcal.measurement.session_blocks import into_one_frame, joined, sessions_of
from irbcal.modeling.terms.situation import Motion

COUNTS = {"mon": 60, "tue": 25, "wed": 30}


def assert_one_robot(found, points, robots, tolerance):
    """The robot and all bases against the truth, by points that no fit saw, of all sessions."""
    for k, (name, robot) in enumerate(robots.items()):
        q = arm().random_joints(50, 900 + k)
        other = replace(measured(robot, q), session=np.full(50, name, dtype=object))
        plain = name == "wed"
        other = replace(other, target_names=tuple(t if plain else f"{t}@{name}" for t in other.target_names))
        moved = into_one_frame(other, found.robot.T_world_base, found.other_bases)
        assert moved.session is None
        assert distances(found.robot, moved).max() < tolerance


def test_one_robot_with_a_base_and_a_tool_for_each_session():
    points, robots = together(COUNTS)
    found = identify(arm(), points, "34")
    assert found.problem.sessions == ("mon", "tue", "wed")
    assert found.robot.targets.keys() == {f"{t}{s}" for t in ("smr1", "smr2", "smr3") for s in ("", "@mon", "@tue")}
    assert_one_robot(found, points, robots, 10 * NOISE)
    rows = {row.name: row for row in found.parameters()}
    assert len(found.parameters()) == found.problem.unknowns + 4  # the stiffness is told physically, too
    T = robots["tue"].T_world_base
    assert abs(1e-3 * rows["base@tue_x"].value - T[0, 3]) < 5e-3 * rows["base@tue_x"].std + 1e-3
    np.testing.assert_allclose(found.rms, NOISE * np.sqrt(3), rtol=0.15)


def test_the_average_of_models_has_them_too():
    points, robots = together({"mon": 60, "wed": 30})
    del robots["tue"]
    found = identify_evidence(arm(), points, Motion(points.q))
    assert_one_robot(found, points, robots, 20 * NOISE)
    assert len(found.parameters()) == len(found.certainty.covariance)
    assert [row.name for row in found.parameters()][6 + 18 : 6 + 24] == [
        f"base@mon_{a}" for a in ("x", "y", "z", "rx", "ry", "rz")
    ]


def test_few_poses_of_a_new_session_do_what_they_cannot_alone():
    points, robots = together({"mon": 120, "wed": 7})
    robot = robots["wed"]
    other = measured(robot, arm().random_joints(200, 77))
    alone = identify(arm(), replace(points.select(points.session == "wed"), session=None).with_seen_targets(), "34")
    shared = identify(arm(), points, "34")
    assert distances(shared.robot, other).mean() < 0.5 * distances(alone.robot, other).mean()


def test_the_search_without_derivatives_moves_all_bases(monkeypatch):
    monkeypatch.setattr(minimax, "nelder_mead", partial(minimax.nelder_mead, iterations=200))
    points, _ = together({"mon": 40, "wed": 20}, level="26")
    found = identify_by(arm(), points, "26", method="nelder-mead")
    assert found.value < found.solution.history[0]
    moved = into_one_frame(points, found.robot.T_world_base, found.other_bases)
    assert distances(found.robot, moved).max() == pytest.approx(found.value, abs=1e-12)


@pytest.mark.parametrize("objective", ["max", "pnorm"])
def test_other_objectives(objective):
    points, robots = together({"mon": 40, "wed": 20}, level="26")
    del robots["tue"]
    assert_one_robot(identify_by(arm(), points, "26", goal=Goal(objective)), points, robots, 20 * NOISE)


def test_cross_validation_over_sessions():
    points, _ = together({"mon": 60, "wed": 30}, level="16")
    assert choose_level(arm(), points, levels=["nominal", "16"]).table[1].mean_mm < 3e3 * NOISE


def test_orientations_of_each_session():
    sets, robots = parts({"mon": 30, "wed": 20}, level="16")
    turned = []
    for name, points in sets:
        robot = robots[name].replace(target_rotations={t: np.eye(3) for t in points.target_names})
        turned.append((name, replace(points, rotation=points.predicted_rotations(robot))))
    found = identify(arm(), joined(turned), "16")
    assert found.rms < 2 * NOISE
    moved = into_one_frame(joined(turned), found.robot.T_world_base, found.other_bases)
    off = np.linalg.norm(moved.rotation - moved.predicted_rotations(found.robot), axis=(1, 2))
    assert off.max() < 1e-4


def test_a_session_too_small_is_named():
    points, _ = together({"mon": 40, "wed": 2})
    with pytest.raises(IdentificationError, match="2 poses of session wed"):
        identify(arm(), points, "11")


def file_of(tmp_path, column="session"):
    sets, _ = parts({"mon": 4, "wed": 3})
    frames = []
    for name, points in sets:
        frames.append(pd.read_csv(write_measurements(tmp_path / f"{name}.csv", points)).assign(**{column: name}))
    return pd.concat(frames)


def test_a_column_divides_the_file(tmp_path):
    seen = table.read(file_of(tmp_path))  # poses of both sessions are numbered from 0
    found = sessions_of(seen)
    assert [name for name, _ in found] == ["mon", "wed"]
    assert [part.poses for _, part in found] == [4, 3]
    assert found[1][1].table["pose_index"].tolist() == [0] * 3 + [1] * 3 + [2] * 3
    np.testing.assert_array_equal(np.concatenate([part.joints() for _, part in found]), seen.joints())


def test_any_column_can_be_named(tmp_path):
    frame = file_of(tmp_path, "day")
    frame["pose"] = frame["day"] + frame["pose"].astype(str)
    seen = table.read(frame)
    assert [name for name, _ in sessions_of(seen)] == [""]
    assert [name for name, _ in sessions_of(seen, "day")] == ["mon", "wed"]
    with pytest.raises(OptionError, match="has no column shift; found"):
        sessions_of(seen, "shift")
    frame.loc[frame["pose"] == "mon1", "day"] = ["mon", "wed", "mon"]
    with pytest.raises(MeasurementError, match="pose mon1 is in two sessions"):
        sessions_of(table.read(frame), "day")
    frame.loc[frame["pose"] == "mon1", "day"] = ""
    with pytest.raises(MeasurementError, match="found nothing"):
        sessions_of(table.read(frame), "day")


def test_robots_of_the_cases_differ_in_base_and_tool_only():
    robots = truth()
    q = arm().random_joints(5, 1)
    np.testing.assert_allclose(robots["mon"].poses(q), robots["wed"].poses(q), rtol=0, atol=1e-15)
