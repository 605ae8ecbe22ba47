"""Lists of joints, poses and known targets, from files and from DataFrames."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import lists


def write(tmp_path, *lines, name="m.csv"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_joint_files(tmp_path):
    path = write(tmp_path, "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg", "a,0,0,0,0,0,180")
    assert np.abs(lists.read_joints(path) - [[0, 0, 0, 0, 0, np.pi]]).max() < 1e-15
    with pytest.raises(MeasurementError, match="missing column q6_deg"):
        lists.read_joints(write(tmp_path, "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg", "1,2,3,4,5", name="f.csv"))


def test_joints_of_a_rail_and_a_data_frame():
    frame = pd.DataFrame({"q2_deg": [90.0, 0.0], "q1_mm": [250, -1]}, index=[7, 7])
    q = lists.read_joints(frame, ["q1_mm", "q2_deg"])
    assert np.abs(q - [[0.25, np.pi / 2], [-0.001, 0]]).max() < 1e-15
    with pytest.raises(MeasurementError) as caught:
        lists.read_joints(frame.assign(q1_mm=["1", "x"]), ["q1_mm", "q2_deg"])
    assert str(caught.value) == "<DataFrame>: row 2, column q1_mm: expected a joint's travel in mm, found 'x'"


def test_poses(tmp_path):
    half = np.sqrt(0.5)
    path = write(tmp_path, "x_mm,y_mm,z_mm,qw,qx,qy,qz", f"1,2,3,{half:.17g},0,0,{half:.17g}")
    T = lists.read_poses(path)[0]
    assert np.abs(T - [[0, -1, 0, 0.001], [1, 0, 0, 0.002], [0, 0, 1, 0.003], [0, 0, 0, 1]]).max() < 1e-15
    with pytest.raises(MeasurementError, match="row 2, columns qw, qx, qy, qz: expected a unit quaternion"):
        lists.read_poses(write(tmp_path, "x_mm,y_mm,z_mm,qw,qx,qy,qz", "1,2,3,1,1,0,0"))


def test_known_targets(tmp_path):
    path = write(tmp_path, "target,x_mm,y_mm,z_mm", "smr1,10,20,30", " smr2 ,-1,0,0.5")
    found = lists.read_targets(path)
    assert list(found) == ["smr1", "smr2"]
    assert np.abs(np.array(list(found.values())) - [[0.01, 0.02, 0.03], [-0.001, 0, 0.0005]]).max() < 1e-18
    with pytest.raises(MeasurementError) as caught:
        lists.read_targets(write(tmp_path, "target,x_mm,y_mm,z_mm", "a,1,2,3", "a,1,2,3"))
    assert (caught.value.row, caught.value.column) == (3, "target")
    assert str(caught.value).endswith("m.csv: row 3, column target: 'a' stands there more than once")


def test_absurd_joints_of_a_file_are_refused_with_their_place(tmp_path):
    path = tmp_path / "q.csv"
    path.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n1,2,3,4,5,6\n1,2,3,4,1e300,6\n")
    with pytest.raises(MeasurementError, match=r"row 3, column q5_deg: .* found 1e\+300") as refused:
        lists.read_joints(path)
    assert (refused.value.row, refused.value.column) == (3, "q5_deg")


def test_absurd_positions_of_poses_and_reflectors_are_refused_with_their_place():
    pose = pd.DataFrame(
        [["1", "2", "-1e308", "1", "0", "0", "0"]], columns=["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    )
    target = pose.assign(target="smr1")
    for read in (lambda: lists.read_poses(pose), lambda: lists.read_targets(target)):
        with pytest.raises(
            MeasurementError, match=r"column z_mm: expected a position within 1 km in mm, found -1e\+308"
        ):
            read()


def test_rows_of_one_pose_have_the_same_joints():
    frame = pd.DataFrame({"pose": ["a", "b", " a"], "target": ["s", "s", "t"], "q1_deg": ["1", "2", "1"]})
    assert np.abs(np.degrees(lists.read_joints(frame, ["q1_deg"], once=True)) - [[1], [2]]).max() < 1e-12
    assert len(lists.read_joints(frame, ["q1_deg"])) == 3
    assert len(lists.read_joints(frame.assign(cycle=["1", "1", "2"]), ["q1_deg"], once=True)) == 3
    frame.loc[2, "q1_deg"] = "1.5"
    with pytest.raises(MeasurementError) as caught:
        lists.read_joints(frame, ["q1_deg"], once=True)
    assert str(caught.value) == (
        "<DataFrame>: row 3, column q1_deg: expected the joints of the pose's first row (1), found '1.5'"
    )
