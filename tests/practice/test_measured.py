"""Measurements of the practice robot: what another tracker's place and other mountings change, and what they do not."""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from irbcal.practice.measured import MOVED, measurements, one_joint_moves, practice_cell, seen_from_elsewhere


def places(table):
    return table[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=float)


def test_a_moved_tracker_sees_the_same_distances(written):
    table = pd.read_csv(written.folder / "measured.csv").dropna(subset=["x_mm"]).head(60)
    moved = seen_from_elsewhere(table)

    def between(p):
        return np.linalg.norm(p[:, None] - p[None], axis=-1)

    assert np.allclose(between(places(moved)), between(places(table)), atol=5e-4)
    back = Rotation.from_matrix(MOVED[:3, :3]).apply(places(moved)) + MOVED[:3, 3] * 1e3
    assert np.allclose(back, places(table), atol=5e-4)


def test_all_measurements_are_marked(written):
    files = [written.folder / name for name in ("measured.csv", "new.csv", "moves.csv", "two_loads.csv", "rail.csv")]
    assert all((pd.read_csv(path)["simulated"] == "yes").all() for path in files)
    loads = pd.read_csv(written.folder / "two_loads.csv").groupby("payload_kg")["pose"].nunique()
    assert loads.to_dict() == {1.0: 40, 5.0: 40}


def test_moves_of_one_joint_move_one_joint():
    q = one_joint_moves(6).q.reshape(6, -1, 6)
    assert [np.flatnonzero(np.ptp(part, axis=0)).tolist() for part in q] == [[k] for k in range(6)]


def test_the_lists_are_one_program(written):
    from irbcal import inverse_kinematics, read_urdf

    q = np.radians(pd.read_csv(written.folder / "joints.csv").to_numpy())
    arm = read_urdf(written.folder / "my_robot.urdf").arm
    poses = pd.read_csv(written.folder / "poses.csv").to_numpy()
    assert np.allclose(arm.forward(q)[:, :3, 3] * 1e3, poses[:, :3], atol=1e-5)
    wxyz = Rotation.from_matrix(arm.forward(q)[:, :3, :3]).as_quat(scalar_first=True)
    assert np.abs(np.abs(np.sum(wxyz * poses[:, 3:], axis=1)) - 1).max() < 1e-9
    assert len(measurements(practice_cell(), one_joint_moves(6)))
    assert callable(inverse_kinematics)


def test_the_tracker_sees_the_program():
    from irbcal.practice.measured import PROGRAM

    run = practice_cell().without("lost").measure(np.radians(np.array(PROGRAM, dtype=float)))
    assert np.isfinite(run.xyz).all()
