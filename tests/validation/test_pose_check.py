"""Pose tests from measurements: subjects, tables, figures and refusals."""

import io
import json

import numpy as np
import pandas as pd
import pytest
from chart_data import given
from iso9283_files import CYCLES, cycles, write
from support import arm, assert_same_poses, random_robot
from written import written

from irbcal.errors import MeasurementError, RobotError
from irbcal.measurement import table
from irbcal.measurement.input_table import InputTable
from irbcal.modeling import frames
from irbcal.validation import pose_check
from irbcal.validation.cleaned_points import prepare
from irbcal.validation.pose_check import Attained, attained, check_poses, commanded_poses, criteria, measured_whole

THESIS = np.array(
    [
        [0, -14, 14, 0, 0, 0],
        [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
        [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
        [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
        [41.374, -24.789, 47.145, 66.643, -46.052, -58.108],
    ]
)
"""Table A I-1 with its columns and signs restored, degrees."""


def test_five_poses_of_the_thesis():
    found = pose_check.five_poses(arm())
    assert np.abs(np.degrees(found.q) - THESIS).max() < 0.0015, "printed to 0.001 degrees"
    offset = (found.T_base_tip[:, :3, 3] - found.T_base_tip[0, :3, 3]) * 1e3
    signs = np.array([[0, 0, 0], [1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]])
    assert np.abs(offset - 271.93 * signs).max() < 0.005


def test_five_poses_of_other_cubes_and_robots():
    irb120 = arm("irb120")
    found = pose_check.five_poses(irb120)
    assert np.abs(irb120.forward(found.q) - found.T_base_tip).max() < 1e-9
    assert ((found.q >= irb120.lower) & (found.q <= irb120.upper)).all()
    for plane, (i, j, sign) in {"x=z": (0, 2, 1), "x=-z": (0, 2, -1), "y=z": (1, 2, 1), "y=-z": (1, 2, -1)}.items():
        p = pose_check.five_poses(irb120, [0.35, 0, 0.4], 0.2, plane=plane, fraction=0.1).T_base_tip[:, :3, 3]
        p = p - [0.35, 0, 0.4]
        assert np.abs(p[:, i] - sign * p[:, j]).max() < 1e-15, "all five lie on the plane"
        assert np.abs(p[1:3] + p[3:]).max() < 1e-15, "P2 and P4, P3 and P5 on the same diagonals"
        assert np.abs(np.linalg.norm(p[1:], axis=1) - 0.4 * 0.2 * np.sqrt(3)).max() < 1e-15
    with pytest.raises(RobotError, match="does not reach P2"):
        pose_check.five_poses(irb120, [0.6, 0, 0.3], 0.6)
    with pytest.raises(RobotError, match="inclined planes"):
        pose_check.five_poses(irb120, plane="z=0")


def test_five_poses_of_an_arm_whose_cube_nobody_chose():
    """The UR 10 reaches 1.3 m: a cube in front of it has at least a third of that as its edge."""
    ur10 = arm("ur10")
    found = pose_check.five_poses(ur10)
    assert np.abs(ur10.forward(found.q) - found.T_base_tip).max() < 1e-6
    assert ((found.q >= ur10.lower) & (found.q <= ur10.upper)).all()
    p = found.T_base_tip[:, :3, 3]
    assert (p[:, 0] > 0).all()
    assert (p[:, 2] > 0).all(), "most arms stand on a floor"
    assert np.abs(p[1] - p[3]).min() > 0.43 * (1 - 2 * pose_check.FRACTION)


def test_the_poses_become_a_dict_for_json():
    found = json.loads(json.dumps(pose_check.five_poses(arm()).to_dict()))
    assert found["robot"] == arm().name
    assert [row["pose"] for row in found["poses"]] == list(pose_check.ISO_POSES)


__all__ = ["given"]


@pytest.fixture(scope="module")
def file(record, tmp_path_factory):
    robot = record.robot_calibrated()
    q, T, *_ = cycles(robot)
    return write(tmp_path_factory.mktemp("poses") / "iso.csv", robot, q, T)


def test_subjects(record, file):
    seen = table.read(file)
    assert check_poses(seen, record).subject == "flange"
    assert check_poses(seen).subject == "all targets"
    assert check_poses(seen, target="smr3").subject == "target smr3"
    with pytest.raises(MeasurementError, match="no usable point of target smr9") as refused:
        check_poses(seen, target="smr9")
    assert refused.value.parameter == "target"


def test_tables(record, file):
    found = check_poses(table.read(file), record)
    frame = found.to_frame()
    assert frame["model"].tolist() == ["nominal"] * 5 + ["calibrated"] * 5
    assert frame["RP_mm"].tolist()[:5] == pytest.approx(
        [values["RP_mm"] for values in found.models["nominal"].poses.values()]
    )
    every = found.cycles_to_frame()
    assert len(every) == 2 * 5 * CYCLES
    mean = every[every["model"] == "calibrated"]["position_mm"].mean()
    assert mean == pytest.approx(found.models["calibrated"].overall["position"]["mean_mm"])
    assert found.default_band() == found.models["nominal"].poses["P1"]["RP_mm"] * 1e-3
    assert found.simulated
    data = found.to_dict()
    assert data["models"]["nominal"]["history"]["pose"] == [f"P{k}" for k in range(1, 6)] * CYCLES
    assert isinstance(data["models"]["nominal"]["history"]["pose"], list)


def test_left_out_points_are_told(record, file, tmp_path):
    lines = file.read_text().splitlines()
    lost = [line.rsplit(",", 3)[0] + ",0,0,0" for line in lines[1:12]]
    (tmp_path / "lost.csv").write_text("\n".join([lines[0], *lost, *lines[12:]]))
    found = check_poses(table.read(tmp_path / "lost.csv"), record, target="smr1")
    assert len(found.to_dict()["excluded"]) == 11
    text = found.summary()
    assert "Left out: 11 points" in text
    assert (
        "11 × lost (pose/target P1/smr1, P1/smr2, P1/smr3, P2/smr1, P2/smr2, P2/smr3, P3/smr1, P3/smr2 … and 3 more)"
        in text
    )


def test_figures(record, file, given):
    found = check_poses(table.read(file), record)
    assert (found.has_cycles, found.has_drift) == (True, False)
    assert [d.label for d in found.plot().drawings] == ["position error (mm)", "orientation error (°)"]
    models = [given[name] for name in found.models if given[name]]
    heights = np.concatenate([rows[0][2] for rows in models])
    assert np.sort(heights) == pytest.approx(np.sort(found.cycles_to_frame()["position_mm"]))
    with pytest.raises(MeasurementError, match="no drift was measured"):
        found.plot_drift()


def test_cycles_are_numbered_through(file, tmp_path):
    lines = file.read_text().splitlines()
    (tmp_path / "twice.csv").write_text("\n".join([*lines[:2], lines[1], *lines[2:]]))
    with pytest.raises(MeasurementError, match="pose P1 with target smr1 stands there twice in cycle 1") as refused:
        check_poses(table.read(tmp_path / "twice.csv"))
    assert (refused.value.row, refused.value.column) == (3, "cycle")


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
    assert np.abs(tip.commanded[:5] - robot.poses(q)[:, :3, 3]).max() < 1e-9
    one = attained(ready.keep(ready.points.names() == "smr2"), robot, False)
    assert one.target == "smr2"
    assert np.abs(one.commanded_by(robot, None).commanded[:5] - robot.points(q, "smr2")).max() < 1e-9
    assert one.commanded_by(None, None) is one
    wanted = commanded_poses(written(tmp_path / "c.csv", PLACES))
    moved = robot.replace(T_world_base=frames.transform(None, [1.0, 2.0, 3.0]))
    by_table = one.commanded_by(moved, wanted)
    # turned by half a turn about y, and then in the measuring frame
    x, y, z = robot.targets["smr2"]
    assert by_table.commanded[0] == pytest.approx([0.1 - x + 1.0, y + 2.0, 0.005 - z + 3.0])
    assert by_table.commanded_rotation is None
    assert tip.commanded_by(None, wanted).commanded[1] == pytest.approx([0.2, 0.0, 0.005])


@pytest.mark.parametrize("simulated", ["yes", "no"])
def test_simulated_commanded_poses_are_named(file, simulated):
    measured = table.parse(file.read_bytes().replace(b",yes", b",no"), "measured.csv")
    assert not measured.simulated
    commanded = pd.read_csv(io.StringIO(PLACES)).assign(simulated=simulated)
    assert check_poses(measured, commanded=commanded, target="smr2").simulated == (simulated == "yes")


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
    assert np.abs(T[:3, :3] @ turned.commanded_rotation - found.commanded_rotation).max() < 1e-12
    assert (
        np.abs(
            np.linalg.norm(turned.xyz - turned.commanded, axis=1) - np.linalg.norm(found.xyz - found.commanded, axis=1)
        ).max()
        < 1e-12
    )
    with pytest.raises(ValueError, match="read-only"):
        found.xyz[0] = 0.0


def test_rows_are_chosen_in_all_columns(robot, ready):
    found = attained(ready, robot, True)
    third = found.select(found.pose == "P3")
    assert len(third.q) == len(third.xyz) == len(third.time) == CYCLES
    assert (third.source, third.commanded) == (found.source, None)


def test_poses_are_whole_with_three_targets_or_orientations(robot, ready):
    no_robot = {"measured": None}
    with_places = InputTable.read(pd.DataFrame({"pose": ["P1"]}))
    assert measured_whole(ready.points, no_robot, None)
    assert not measured_whole(ready.points, no_robot, with_places), "places without orientations are of one target"
    two = ready.keep(ready.points.target < 2)
    assert not measured_whole(two.points, no_robot, None)
    assert not measured_whole(two.points, {"nominal": robot}, None)
    assert measured_whole(ready.points, {"nominal": robot}, None)


def poses_of_model_criteria(rows, **more):
    """Attained positions from rows of (pose, cycle, x, y, z) in mm."""
    n = len(rows)
    text = {name: np.array(more.pop(name, [""] * n)) for name in ("group", "session", "direction", "time")}
    columns = {
        "q": np.zeros((n, 6)),
        "pose": np.array([row[0] for row in rows]),
        "cycle": np.array([str(row[1]) for row in rows]),
        "order": np.array([row[1] - 1 for row in rows]),
        "xyz": np.array([row[2:] for row in rows], dtype=float) * 1e-3,
        **text,
        "time": text["time"].astype(object),
    }
    return Attained("poses.csv", "smr1", **columns, **more)


ROWS = [("P4", 1, 100, 0, 1), ("P4", 2, 100, 0, -1), ("P2", 1, 0, 3, 0), ("P2", 2, 0, 5, 0)]


def test_poses_distance_and_errors_from_the_mean():
    found = criteria(poses_of_model_criteria(ROWS), 10)
    assert list(found.poses) == ["P2", "P4"]
    p2 = found.poses["P2"]
    assert (p2["n"], p2["AP_mm"]) == (2, None)
    assert [p2[f"l_{what}_mm"] for what in ("mean", "sigma", "max")] == pytest.approx([1, 0, 1])
    assert p2["RP_mm"] == pytest.approx(1.0)
    assert "AP_x_mm" not in p2
    assert found.overall["from"] == "mean"
    assert found.overall["position"]["n"] == 4
    assert found.history["pose"] == ("P4", "P4", "P2", "P2")
    assert found.history["orientation_deg"] is None
    lengths = np.array([np.sqrt(100**2 + 3**2 + 1), np.sqrt(100**2 + 5**2 + 1)])
    assert found.distance["RD_mm"] == pytest.approx(3 * lengths.std(ddof=1))
    assert (found.distance["AD_mm"], found.distance["n"]) == (None, 2)
    assert (found.directions, found.drift) == (None, None)
    with pytest.raises(TypeError, match="cannot be changed"):
        found.poses["P2"]["n"] = 3


def test_errors_from_the_command():
    wanted = np.array([[0.1, 0, 0], [0.1, 0, 0], [0, 0, 0], [0, 0, 0]])
    found = criteria(poses_of_model_criteria(ROWS, commanded=wanted), 10)
    assert found.poses["P2"]["AP_mm"] == pytest.approx(4.0)
    assert [found.poses["P2"][f"AP_{a}_mm"] for a in "xyz"] == pytest.approx([0, 4, 0])
    assert found.overall["position"]["mean_mm"] == pytest.approx((1 + 1 + 3 + 5) / 4)
    assert found.history["position_mm"] == pytest.approx((1, 1, 3, 5))
    lengths = np.array([np.sqrt(100**2 + 3**2 + 1), np.sqrt(100**2 + 5**2 + 1)])
    assert found.distance["AD_mm"] == pytest.approx(lengths.mean() - 100)


def test_distance_pairs_the_cycles_that_both_have():
    rows = [("P2", 1, 0, 0, 0), ("P2", 2, 0, 0, 0), ("P2", 3, 0, 0, 0), ("P4", 3, 30, 0, 0), ("P4", 2, 10, 0, 0)]
    found = criteria(poses_of_model_criteria(rows), 10).distance
    assert found["n"] == 2
    assert found["RD_mm"] == pytest.approx(3 * np.std([10, 30], ddof=1))
    assert criteria(poses_of_model_criteria([*ROWS[:2], ("P2", 1, 0, 0, 0), ("P2", 9, 0, 0, 0)]), 10).distance is None


@pytest.mark.parametrize("session", [["a"] * 3 + ["b"] * 4, [""] * 7], ids=["sessions", "without sessions"])
def test_cycles_whose_numbers_begin_again_are_paired_with_their_own(session):
    p2 = [("P2", 1, 0, 0, 0), ("P2", 2, 1, 0, 0), ("P2", 1, 5, 0, 0), ("P2", 2, 7, 0, 0)]
    p4 = [("P4", 1, 10, 0, 0), ("P4", 1, 35, 0, 0), ("P4", 2, 47, 0, 0)]
    cycles = poses_of_model_criteria([*p2[:2], p4[0], *p2[2:], *p4[1:]], session=session)
    lengths = [10, 30, 40] if session[0] else [10, 46, 30]  # without them the first cycle 2 is the first cycle 2
    found = criteria(cycles, 10).distance
    assert found["n"] == 3
    assert found["RD_mm"] == pytest.approx(3 * np.std(lengths, ddof=1))


def test_distance_by_axis_and_angle():
    rows = [("P2", 1, 0, 0, 0), ("P2", 2, 0, 0, 0), ("P4", 1, 101, -1, 2), ("P4", 2, 103, -1, 1)]
    commanded = np.array([[0, 0, 0], [0, 0, 0], [100, 0, 1], [100, 0, 1]]) * 1e-3
    turns = np.radians([0.0, 0.0, 30.2, 30.4])
    rotation = np.array([frames.rot_z(turn) for turn in turns])
    meant = np.array([frames.rot_z(turn) for turn in np.radians([0.0, 0.0, 30.0, 30.0])])
    found = criteria(
        poses_of_model_criteria(rows, rotation=rotation, commanded=commanded, commanded_rotation=meant), 10
    ).distance
    assert [found[f"AD_{a}_mm"] for a in "xyz"] == pytest.approx([2, 1, 0.5])
    assert [found[f"RD_{a}_mm"] for a in "xyz"] == pytest.approx([3 * np.sqrt(2), 0, 3 * np.sqrt(0.5)], abs=1e-9)
    assert [found[f"AD_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 0.3], abs=1e-9)
    assert [found[f"RD_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 3 * np.sqrt(0.02)], abs=1e-9)
    assert criteria(poses_of_model_criteria(rows), 10).distance["AD_x_mm"] is None


def test_orientations():
    turns = np.radians([0.1, 0.3, 0.0, 0.2])
    rotation = np.array([frames.rot_z(turn) for turn in turns])
    found = criteria(poses_of_model_criteria(ROWS, rotation=rotation), 10)
    assert found.poses["P4"]["RP_c_deg"] == pytest.approx(3 * np.std([0.1, 0.3], ddof=1))
    assert "AP_c_deg" not in found.poses["P4"]
    assert found.overall["orientation"]["max_deg"] == pytest.approx(0.1, abs=1e-9)
    wanted = {"commanded": np.zeros((4, 3)), "commanded_rotation": np.tile(np.eye(3), (4, 1, 1))}
    found = criteria(poses_of_model_criteria(ROWS, rotation=rotation, **wanted), 10)
    assert found.poses["P4"]["AP_c_deg"] == pytest.approx(0.2)
    assert found.overall["orientation"]["max_deg"] == pytest.approx(0.3, abs=1e-9)
    assert found.history["orientation_deg"] == pytest.approx((0.1, 0.3, 0.0, 0.2), abs=1e-9)


def test_directions():
    ways = ["x", "y", "x", "y"]
    found = criteria(poses_of_model_criteria(ROWS, direction=ways), 10)
    assert (found.poses, found.overall) == ({}, None)
    along = [found.directions["P4"][f"vAP_{axis}_mm"] for axis in "xyz"]
    assert (found.directions["P4"]["directions"], found.directions["P4"]["vAP_mm"]) == (2, pytest.approx(2.0))
    assert np.linalg.norm(along) == pytest.approx(2.0)
    assert along == pytest.approx([0, 0, 2])
    with pytest.raises(MeasurementError, match=r"poses.csv: column direction: pose P2 was approached from x only"):
        criteria(poses_of_model_criteria(ROWS, direction=["x", "y", "x", "x"]), 10)


def test_drift_sets_with_lost_cycles_and_times():
    cycles = [1, 2, 3, 5, 6, 7, 8, 9]  # the fourth is lost, the last set of four unfinished
    rows = [("P1", c, 0.01 * c, 0, 0) for c in cycles]
    found = criteria(
        poses_of_model_criteria(rows, group=["iso9283_drift"] * 8, time=[str(60 * c) for c in cycles]), 4
    ).drift
    assert found["n"] == (3, 4)
    assert found["time_s"] == pytest.approx((120, 390))
    assert found["shift_mm"] == pytest.approx((0, 0.045))
    assert found["dRP_mm"] == pytest.approx(found["RP_mm"][1] - found["RP_mm"][0])
    assert "AP_mm" not in found
    with pytest.raises(MeasurementError, match="has 8 cycles of P1: drift needs two sets of 10"):
        criteria(poses_of_model_criteria(rows, group=["iso9283_drift"] * 8), 10)


def test_groups_keep_other_rows_out():
    rows = [*ROWS, ("P2", 3, 0, 99, 0)]
    found = criteria(poses_of_model_criteria(rows, group=["iso9283"] * 4 + ["other"]), 10)
    assert found.poses["P2"]["n"] == 2
    with pytest.raises(MeasurementError, match="no usable row of the groups iso9283 and iso9283_drift"):
        criteria(poses_of_model_criteria([("P1", 1, 0, 0, 0)], group=["iso9283"]).select(np.array([False])), 10)
    with pytest.raises(MeasurementError, match="pose P1 was measured in one cycle only"):
        criteria(poses_of_model_criteria([("P1", 1, 0, 0, 0)]), 10)
