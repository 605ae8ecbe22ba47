"""Poses to measure: the same from a file, a table, a plan and an array."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError, RobotError
from irbcal.simulation import pose_list
from irbcal.units import DEG

TEXT = "pose,group,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,targets,wait_s\nA,g,1,2,3,4,5,6,smr2;smr1,7\nB,g,0,0,0,0,0,9,,\n"


def test_file_table_and_result_give_the_same_poses(cell, tmp_path):
    (tmp_path / "plan.csv").write_text(TEXT)
    table = pd.read_csv(tmp_path / "plan.csv")

    class Result:
        def to_frame(self):
            return table

    found = [pose_list.taken(source, cell.arm) for source in (tmp_path / "plan.csv", table, Result())]
    for poses in found:
        np.testing.assert_allclose(poses.q / DEG, [[1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 9]], rtol=0, atol=1e-12)
        assert poses.pose.tolist() == ["A", "B"]
        assert poses.wait_s.tolist() == [7.0, 4.0]
        assert poses.asked(cell).tolist() == [[True, True, False], [True, True, True]]
        assert poses.extra["group"].tolist() == ["g", "g"]
    assert found[0].source == str(tmp_path / "plan.csv")


def test_joints_as_an_array_are_measured_at_all_targets(cell):
    poses = pose_list.taken(np.zeros((3, 6)), cell.arm, 1.5)
    assert poses.pose.tolist() == ["1", "2", "3"]
    assert poses.asked(cell) is None
    assert poses.wait_s.tolist() == [1.5] * 3
    with pytest.raises(RobotError, match=r"need shape \(n, 6\)"):
        pose_list.taken(np.zeros((3, 5)), cell.arm)


def test_refusals_carry_file_row_and_column(cell, tmp_path):
    (tmp_path / "plan.csv").write_text(TEXT.replace("smr2;smr1", "smr7"))
    with pytest.raises(MeasurementError) as refusal:
        pose_list.read(tmp_path / "plan.csv", cell.arm).asked(cell)
    assert (refusal.value.file, refusal.value.row, refusal.value.column) == (str(tmp_path / "plan.csv"), 2, "targets")
    assert str(refusal.value).endswith("column targets: expected targets of the tool (smr1, smr2, smr3), found 'smr7'")


def test_drawn_poses_are_numbered_and_seen(cell):
    poses = pose_list.drawn(cell, 5, seed=2, wait_s=1.0)
    assert poses.pose.tolist() == list("12345")
    assert cell.visible(poses.q).all()


def test_a_plan_with_a_row_for_each_target_is_one_with_a_row_for_each_pose(cell):
    row = dict(zip(cell.arm.joint_columns, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], strict=True))
    table = pd.DataFrame(
        [
            {"pose": "A", "group": "g", **row, "target": "smr1", "expected_x_mm": 1.0},
            {"pose": "A", "group": "g", **row, "target": "smr3", "expected_x_mm": 2.0},
            {"pose": "B", "group": "h", **row, "q6_deg": 9.0, "target": "smr2", "expected_x_mm": 3.0},
        ]
    )
    poses = pose_list.taken(table, cell.arm)
    np.testing.assert_allclose(poses.q / DEG, [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 9]], rtol=0, atol=1e-12)
    assert poses.pose.tolist() == ["A", "B"]
    assert poses.extra["group"].tolist() == ["g", "h"]
    assert poses.asked(cell).tolist() == [[True, False, True], [False, True, False]]
