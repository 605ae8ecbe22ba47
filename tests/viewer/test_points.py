"""Plans: which files are some, and what is drawn of them."""

import numpy as np
import pandas as pd
import pytest
from support import arm, random_robot

from irbcal.errors import RobotError
from irbcal.viewer import scene as points


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("q1_deg,q2_deg", True),
        ('\ufeff"q1_deg", "note"', True),
        ("pose,q1_deg,target", False),
        ("q1_deg,x_mm,y_mm,z_mm", False),
        ("a,b", False),
        ("", False),
        ("\n\nq1_deg,q2_deg", True),
    ],
)
def test_files_of_joints_only_are_plans(tmp_path, header, expected):
    (tmp_path / "p.csv").write_text(f"{header}\n1,2\n", encoding="utf-8")
    assert points.is_plan(tmp_path / "p.csv") is expected


def test_frames_may_be_plans():
    nominal = arm()
    q = nominal.random_joints(3, 1)
    frame = pd.DataFrame(np.degrees(q), columns=nominal.joint_columns)
    assert points.is_plan(frame)
    np.testing.assert_allclose(points.plan_joints(frame, nominal), q, rtol=0, atol=1e-12)
    assert not points.is_plan(frame.assign(target="smr1"))


def test_joints_of_a_plan_are_checked():
    nominal = arm()
    q = nominal.random_joints(3, 1)
    assert np.array_equal(points.plan_joints(q.tolist(), nominal), q)
    for wrong in (q[0], q[:0], q[:, :5], np.full((1, 6), np.nan)):
        with pytest.raises(RobotError):
            points.plan_joints(wrong, nominal)


def test_poses_beyond_the_limits_are_noted():
    nominal = arm()
    q = nominal.random_joints(3, 1)
    assert points.outside_limits(nominal, q, ["a", "b", "c"]) == []
    q[1:, 0] += 10
    (note,) = points.outside_limits(nominal, q, ["a", "b", "c"])
    assert "pose b and 1 more" in note


def test_planned_points_are_the_robots_predictions():
    nominal = arm()
    robot = random_robot(nominal, "26", np.random.default_rng(1))
    q = nominal.random_joints(3, 1)
    seen = points.planned_points(robot, None, q, np.eye(4))
    assert seen.measured is None
    assert seen.nominal is None
    for k, name in enumerate(robot.targets):
        np.testing.assert_allclose(seen.calibrated[seen.target == k], robot.points(q, name), rtol=0, atol=1e-12)
    way = points.path_of(robot, q, np.eye(4))
    np.testing.assert_allclose(way[[0, -1]], robot.points(q[[0, -1]], next(iter(robot.targets))), rtol=0, atol=1e-12)
    assert points.path_of(robot, q[:1], np.eye(4)) is None


def test_a_plan_with_a_row_for_each_target_shows_each_pose_once(tmp_path):
    nominal = arm()
    q = np.round(np.degrees(nominal.random_joints(3, 1)), 4)
    table = pd.DataFrame(q[[0, 0, 1, 2, 2]], columns=nominal.joint_columns)
    table.insert(0, "pose", [1, 1, 2, 3, 3])
    table["target"] = ["smr1", "smr2", "smr1", "smr1", "smr3"]
    table["expected_x_mm"] = 1.0
    table.to_csv(tmp_path / "plan.csv", index=False)
    for plan in (table, tmp_path / "plan.csv"):
        assert points.is_plan(plan)
        np.testing.assert_allclose(np.degrees(points.plan_joints(plan, nominal)), q, rtol=0, atol=1e-12)
