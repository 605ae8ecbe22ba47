"""What was reached and what was commanded, by one target, by three and by measured frames."""

import numpy as np
import pandas as pd
import pytest
from iso9283_files import CYCLES, cycles, write
from support import arm, assert_same_poses, random_robot
from written import written

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.columns import InputTable
from irbcal.modeling import frames
from irbcal.validation.cleaned_points import prepare
from irbcal.validation.pose_check import attained, commanded_poses, measured_whole

PLACES = "pose,x_mm,y_mm,z_mm,qw,qx,qy,qz\n" + "".join(f"P{k},{100 * k},0,5,0,0,1,0\n" for k in range(1, 6))


@pytest.fixture(scope="module")
def robot():
    return random_robot(arm(), "34", np.random.default_rng(2), T_world_base=np.eye(4))


@pytest.fixture(scope="module")
def poses(robot):
    return cycles(robot)


@pytest.fixture(scope="module")
def ready(robot, poses, tmp_path_factory):
    q, T, *_ = poses
    return prepare(table.read(write(tmp_path_factory.mktemp("attained") / "iso.csv", robot, q, T)))


def test_tips_of_three_targets(robot, poses, ready):
    found = attained(ready, robot, True)
    T = np.tile(np.eye(4), (len(found.pose), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = found.rotation, found.xyz
    expected = poses[1].transpose(1, 0, 2, 3).reshape(-1, 4, 4)
    assert_same_poses(T, expected, 1e-8, 1e-6)
    assert found.pose.tolist() == [f"P{k}" for k in range(1, 6)] * CYCLES
    assert found.cycle.tolist() == [str(c + 1) for c in range(CYCLES) for _ in range(5)]
    assert found.order.tolist() == [c for c in range(CYCLES) for _ in range(5)]
    assert set(found.direction) == {""}


def test_commands_of_the_robot_and_of_a_table(robot, poses, ready, tmp_path):
    q = poses[0]
    tip = attained(ready, robot, True).commanded_by(robot, None)
    assert np.abs(tip.wanted[:5] - robot.poses(q)[:, :3, 3]).max() < 1e-9
    one = attained(ready.keep(ready.points.names() == "smr2"), robot, False)
    assert one.target == "smr2"
    assert np.abs(one.commanded_by(robot, None).wanted[:5] - robot.points(q, "smr2")).max() < 1e-9
    assert one.commanded_by(None, None) is one
    wanted = commanded_poses(written(tmp_path / "c.csv", PLACES))
    moved = robot.replace(T_world_base=frames.transform(None, [1.0, 2.0, 3.0]))
    by_table = one.commanded_by(moved, wanted)
    # turned by half a turn about y, and then in the measuring frame
    x, y, z = robot.targets["smr2"]
    assert by_table.wanted[0] == pytest.approx([0.1 - x + 1.0, y + 2.0, 0.005 - z + 3.0])
    assert by_table.wanted_rotation is None
    assert tip.commanded_by(None, wanted).wanted[1] == pytest.approx([0.2, 0.0, 0.005])


def test_commanded_files_are_checked(robot, ready, tmp_path):
    one = attained(ready.keep(ready.points.names() == "smr2"), robot, False)
    short = commanded_poses(written(tmp_path / "short.csv", "pose,x_mm,y_mm,z_mm\nP1,1,2,3\n"))
    with pytest.raises(MeasurementError, match=r"short.csv: there is no commanded pose P2"):
        one.commanded_by(None, short)
    plain = commanded_poses(
        written(tmp_path / "plain.csv", "\n".join(line.rsplit(",", 4)[0] for line in PLACES.split()))
    )
    with pytest.raises(MeasurementError, match=r"plain.csv: row 1: missing columns qw, qx, qy, qz") as refused:
        one.commanded_by(robot, plain)
    assert refused.value.row == 1
    with pytest.raises(MeasurementError, match=r"row 7, column pose: 'P5' stands there more than once"):
        commanded_poses(written(tmp_path / "twice.csv", PLACES + "P5,1,2,3,1,0,0,0\n"))


def test_seen_from_the_base(robot, ready):
    found = attained(ready, robot, True).commanded_by(robot, None)
    T = frames.transform(frames.rot_z(0.3), [1.0, 2.0, 3.0])
    turned = found.seen_from(T)
    assert np.abs(frames.apply(T, turned.xyz) - found.xyz).max() < 1e-12
    assert np.abs(T[:3, :3] @ turned.wanted_rotation - found.wanted_rotation).max() < 1e-12
    assert (
        np.abs(
            np.linalg.norm(turned.xyz - turned.wanted, axis=1) - np.linalg.norm(found.xyz - found.wanted, axis=1)
        ).max()
        < 1e-12
    )
    with pytest.raises(ValueError, match="read-only"):
        found.xyz[0] = 0.0


def test_rows_are_chosen_in_all_columns(robot, ready):
    found = attained(ready, robot, True)
    third = found.select(found.pose == "P3")
    assert len(third.q) == len(third.xyz) == len(third.time) == CYCLES
    assert (third.source, third.wanted) == (found.source, None)


def test_poses_are_whole_with_three_targets_or_orientations(robot, ready):
    no_robot = {"measured": None}
    with_places = InputTable.read(pd.DataFrame({"pose": ["P1"]}))
    assert measured_whole(ready.points, no_robot, None)
    assert not measured_whole(ready.points, no_robot, with_places), "places without orientations are of one target"
    two = ready.keep(ready.points.target < 2)
    assert not measured_whole(two.points, no_robot, None)
    assert not measured_whole(two.points, {"nominal": robot}, None)
    assert measured_whole(ready.points, {"nominal": robot}, None)
