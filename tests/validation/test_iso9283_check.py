"""The door to ISO 9283: parts together, limit band, figures and plan."""

import pickle

import numpy as np
import pandas as pd
import pytest
from iso9283_files import cycles, write
from support import arm
from written import written

from irbcal.errors import IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.measurement import table
from irbcal.modeling import frames
from irbcal.validation import iso9283_check
from irbcal.validation.iso9283_check import (
    cornering,
    iso9283,
    iso9283_plan,
    path_accuracy,
    path_velocity,
    static_compliance,
    way_along,
)
from irbcal.validation.pose_check import ISO_POSES


def straight(folder, cycles=(1, 2, 3), turn=None):
    """A path along x, and cycles of it 0.1 mm apart in y; with a turn in degrees about z, as many times the cycle."""
    q = "" if turn is None else ",1,0,0,0"
    names = "" if turn is None else ",qw,qx,qy,qz"
    commanded = "".join(f"{v},10,5{q}\n" for v in np.linspace(0, 100, 11))
    rows = []
    for c in cycles:
        half = np.radians(0.5 * c * (turn or 0.0))
        mine = "" if turn is None else f",{np.cos(half):.15g},0,0,{np.sin(half):.15g}"
        rows += [f"{c},{v},{10 + 0.1 * c},5{mine}\n" for v in np.linspace(-3, 95, 30)]
    return (
        written(folder / "p.csv", f"cycle,x_mm,y_mm,z_mm{names}\n" + "".join(rows)),
        written(folder / "c.csv", f"x_mm,y_mm,z_mm{names}\n" + commanded),
    )


def test_places(tmp_path):
    found = path_accuracy(*straight(tmp_path))
    assert len(found.errors.planes) == 10, "the last plane is not reached"
    assert found.along == pytest.approx(np.arange(10) * 1e-2)
    data = found.to_dict()
    assert data["AT_mm"] == pytest.approx(0.2)
    away = np.array([0.1, 0.0, 0.1])
    assert data["RT_mm"] == pytest.approx(away.mean() + 3 * away.std(ddof=1))
    assert [data[key] for key in ("planes", "planes_of", "cycles")] == [10, 11, 3]
    assert data["mean_error_mm"] == pytest.approx([0.2] * 10)
    assert "AT_a_deg" not in data
    assert found.headline() == f"Path: AT 0.200 mm, RT {data['RT_mm']:.3f} mm (3 cycles, 10 of 11 planes)"
    assert found.to_frame()["along_mm"].tolist() == pytest.approx(list(range(0, 100, 10)))


def test_orientations(tmp_path):
    found = path_accuracy(*straight(tmp_path, (1, 3), turn=0.1))
    data = found.to_dict()
    assert [data[f"AT_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 0.2], abs=1e-9)
    assert [data[f"RT_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 3 * 0.2 / np.sqrt(2)], abs=1e-9)
    assert "AT_c 0.2000, RT_c 0.4243" in found.summary()


def test_velocities_and_corners_are_told(tmp_path):
    corner = "x_mm,y_mm,z_mm\n" + "".join(f"{x},{y},5\n" for x, y in ((1, 0), (51, 0), (101, 0), (101, 50), (101, 100)))
    rows = ["cycle,time_s,x_mm,y_mm,z_mm,simulated"]
    for c, v in ((1, 100.0), (2, 104.0)):
        for s in np.arange(0, 200.5, 0.5):
            x, y = min(s, 100.0), max(s - 100.0, 0.0)
            rows.append(f"{c},{s / v:.9f},{x + 1},{y},5,yes")
    path = written(tmp_path / "p.csv", "\n".join(rows))
    found = path_accuracy(path, written(tmp_path / "c.csv", corner), velocity=0.1)
    data = found.to_dict()
    assert data["velocity"]["AV_percent"] == pytest.approx(2.0, abs=1e-6)
    assert data["velocity"]["RV_percent"] == pytest.approx(3 * np.sqrt(8.0), abs=1e-6)
    assert data["velocity"]["FV_mm_s"] == pytest.approx(0.0, abs=1e-4)
    (told,) = data["corners"]
    assert (told["CR_mm"], told["CO_mm"]) == (pytest.approx(0, abs=1e-9), pytest.approx(0, abs=1e-9))
    assert (told["distance_mm"], told["turn_deg"]) == (pytest.approx(100), pytest.approx(90))
    text = found.summary()
    for part in ("SIMULATED data: Path: AT", "AV +2.00 %, RV ±8.49 %, FV 0.00 mm/s, mean 102.00 mm/s", "CR mm"):
        assert part in text
    assert found.plot().mark == "SIMULATED data. "


def test_a_target_on_the_tool_follows_the_commanded_path_of_the_tip(record, tmp_path):
    robot = record.robot_calibrated()
    q = np.radians([20.0, 10, -5, 30, 40, 10]) + np.linspace(0, 0.4, 21)[:, None] * [1, 0.2, 0, 0.3, 0, 0]
    T = robot.poses(q)
    quaternion = frames.quaternion_from_matrix(T[:, :3, :3])
    wanted = ["x_mm,y_mm,z_mm,qw,qx,qy,qz"]
    wanted += [",".join(f"{v:.15g}" for v in [*(1e3 * p), *r]) for p, r in zip(T[:, :3, 3], quaternion, strict=True)]
    seen = 1e3 * robot.points(q, "smr2")
    rows = ["cycle,x_mm,y_mm,z_mm", *(f"{c},{x:.9f},{y:.9f},{z:.9f}" for c in (1, 2) for x, y, z in seen)]
    path = written(tmp_path / "p.csv", "\n".join(rows))
    commanded = written(tmp_path / "c.csv", "\n".join(wanted))
    assert path_accuracy(path, commanded, robot=robot, target="smr2").errors.AT < 1e-9
    assert path_accuracy(path, commanded, robot=robot).errors.AT > 0.01
    with pytest.raises(OptionError, match="target: there is no target smr9: the calibration knows smr1"):
        path_accuracy(path, commanded, robot=robot, target="smr9")
    bare = written(tmp_path / "b.csv", "\n".join(",".join(line.split(",")[:3]) for line in wanted))
    with pytest.raises(MeasurementError, match=r"b.csv: row 1: missing columns qw, qx, qy, qz"):
        path_accuracy(path, bare, robot=robot, target="smr2")


def test_refusals(tmp_path):
    path, commanded = straight(tmp_path)
    few = written(tmp_path / "few.csv", "x_mm,y_mm,z_mm\n0,10,5\n1,10,5\n")
    with pytest.raises(MeasurementError, match=r"few.csv: a commanded path needs three points or more, found 2"):
        path_accuracy(path, few)
    lonely = written(tmp_path / "lonely.csv", path.read_text() + "9,1,2,3\n")
    with pytest.raises(MeasurementError, match=r"lonely.csv: row 92: a path needs two samples"):
        path_accuracy(lonely, commanded)
    one = written(tmp_path / "one.csv", "\n".join(path.read_text().splitlines()[:31]))
    with pytest.raises(MeasurementError, match=r"one.csv: path accuracy and repeatability need two cycles"):
        path_accuracy(one, commanded)
    still = written(tmp_path / "still.csv", "x_mm,y_mm,z_mm\n0,10,5\n0,10,5\n0,10,5\n")
    with pytest.raises(MeasurementError, match="points that do not move on"):
        path_accuracy(path, still)


def test_path_errors_by_hand():
    """Straight path along x; three cycles beside it, sampled elsewhere and beyond the ends."""
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.13, 1.2, 37)
    paths = [np.column_stack([x, np.full(37, y), np.full(37, 0.004)]) for y in (0.002, 0.003, 0.004)]
    found = iso9283_check.path_errors(paths, commanded)
    assert len(found.planes) == 11
    assert pytest.approx(0.005, abs=1e-12) == found.AT
    away = np.array([0.001, 0.0, 0.001])
    assert pytest.approx(away.mean() + 3 * away.std(ddof=1), abs=1e-12) == found.RT
    with pytest.raises(MeasurementError, match="two cycles"):
        iso9283_check.path_errors(paths[:1], commanded)
    with pytest.raises(MeasurementError, match="crossed by every cycle"):
        iso9283_check.path_errors([paths[0], paths[1] + [5, 0, 0]], commanded)


def test_path_errors_of_a_circle_with_orientation():
    """Each plane cuts a circle twice: the near cut counts. Radius and one angle are off by known amounts."""
    turn = np.linspace(0, 1.9 * np.pi, 200)
    commanded = 0.3 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    fine = np.linspace(-0.05, 1.95 * np.pi, 3001)
    R = np.tile(np.eye(3), (200, 1, 1))
    paths, rotations = [], []
    for radius, angle in ((0.301, 0.01), (0.303, 0.02)):
        paths.append(radius * np.column_stack([np.cos(fine), np.sin(fine), 0 * fine]))
        rotations.append(np.tile(frames.rot_z(angle), (3001, 1, 1)))
    found = iso9283_check.path_errors(paths, commanded, rotations, R)
    assert pytest.approx(0.002, abs=1e-5) == found.AT, "chords of the commanded path tilt its end planes a little"
    assert pytest.approx(0.001, abs=1e-6) == found.RT
    assert np.abs(found.mean_angles - [0, 0, 0.015]).max() < 1e-12
    assert np.abs(found.angle_repeatability[:, 2] - 3 * 0.01 / np.sqrt(2)).max() < 1e-12


def test_accuracy_is_that_of_the_worst_plane():
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.1, 1.1, 121)
    bump = 0.01 * np.exp(-(((x - 0.5) / 0.05) ** 2))
    paths = [np.column_stack([x, bump, 0 * x]), np.column_stack([x, 3 * bump, 0 * x])]
    found = iso9283_check.path_errors(paths, commanded)
    assert pytest.approx(0.02, abs=1e-12) == found.AT
    assert pytest.approx(0.01, abs=1e-12) == found.RT
    assert np.linalg.norm(found.mean, axis=1).min() < 1e-9


def test_only_planes_that_all_cycles_cross_count():
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    paths = [np.array([[-0.1, 0, 0], [0.75, 0, 0]]), np.array([[0.25, 0, 0], [1.1, 0, 0]])]
    R = np.tile(np.eye(3), (11, 1, 1))
    found = iso9283_check.path_errors(paths, commanded, [R[:2], R[:2]], R)
    assert found.planes.tolist() == [3, 4, 5, 6, 7]
    assert found.mean_angles.shape == (5, 3)
    assert np.abs(found.mean_angles).max() == 0.0


def test_a_commanded_path_moves_on_everywhere():
    still = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]])
    with pytest.raises(MeasurementError, match="do not move on"):
        iso9283_check.path_errors([still, still], still)
    with pytest.raises(ValueError, match="read-only"):
        iso9283_check.path_errors([still, still], still[[0, 1, 4]]).mean[0] = 0.0


def test_blocks_of_planes_change_nothing(monkeypatch):
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.1, 1.1, 37)
    paths = [np.column_stack([x, y + 0.01 * np.sin(9 * x), 0 * x]) for y in (0.0, 0.002, 0.003)]
    whole = iso9283_check.path_errors(paths, commanded)
    monkeypatch.setattr(iso9283_check, "BLOCK", 100)
    parts = iso9283_check.path_errors(paths, commanded)
    assert np.array_equal(parts.mean, whole.mean)
    assert np.array_equal(parts.repeatability, whole.repeatability)


def test_of_two_cuts_the_near_one_counts():
    """Out and back in few, long segments: the way out passes the commanded points at 1 mm, the way back at 8 mm."""
    commanded = np.array([[0.2, 0, 0], [0.5, 0, 0], [0.7, 0, 0]])
    out_and_back = np.array([[0.0, 1e-3, 0], [1.0, 1e-3, 0], [1.0, 8e-3, 0], [0.0, 8e-3, 0]])
    for path in (out_and_back, out_and_back[::-1]):
        found = iso9283_check.path_errors([path, path], commanded)
        assert np.abs(found.mean - [0, 1e-3, 0]).max() < 1e-15
    # a slanted segment: where it cuts the plane tells which is nearer, not where it begins
    slanted = np.array([[0.0, -0.04, 0], [1.0, 0.06, 0], [1.0, 0.015, 0], [0.0, 0.015, 0]])
    found = iso9283_check.path_errors([slanted, slanted], commanded)
    assert found.mean[:, 1] == pytest.approx([0.015, 0.01, 0.015])


def test_samples_on_the_planes_cut_them():
    commanded = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    up = np.array([0, 2.0, 0])
    path = commanded + up
    found = iso9283_check.path_errors([path, path + up], commanded)
    assert found.planes.tolist() == [0, 1, 2, 3, 4]
    assert np.abs(found.mean - [0, 3.0, 0]).max() < 1e-15


LINE = np.column_stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)])


def run(speed, step=0.01):
    """A cycle along the line at a constant speed, sampled over one metre."""
    t = np.arange(0, 1 / speed, step)
    return t, np.column_stack([speed * t, np.zeros_like(t), np.zeros_like(t)])


def test_three_constant_velocities_by_hand():
    times, paths = zip(*(run(v) for v in (0.24, 0.25, 0.27)), strict=True)
    found = path_velocity(times, paths, LINE, 0.25)
    assert found.mean == pytest.approx([0.24, 0.25, 0.27])
    mean = (0.24 + 0.25 + 0.27) / 3
    spread = np.sqrt(sum((v - mean) ** 2 for v in (0.24, 0.25, 0.27)) / 2)
    assert pytest.approx((mean - 0.25) / 0.25) == found.AV
    assert pytest.approx(3 * spread / 0.25) == found.RV
    assert pytest.approx(0.0, abs=1e-12) == found.FV
    assert path_velocity(times, paths, LINE).AV is None


def test_only_the_middle_half_counts_and_fluctuation_is_the_worst_cycle():
    # s = 0.25 t + a sin(t), so v = 0.25 + a cos(t), between 0.25 +- a over the middle half, t from 1 to 3
    t = np.arange(0, 4, 1e-3)
    ramp = np.clip(t / 0.5, 0, 1)  # starts from rest, in the first quarter
    paths = [np.column_stack([np.cumsum(ramp * (0.25 + a * np.cos(t))) * 1e-3, 0 * t, 0 * t]) for a in (0.01, 0.02)]
    found = path_velocity([t, t], paths, LINE, 0.25)
    for k, a in enumerate((0.01, 0.02)):
        middle = (paths[k][:, 0] > 0.25) & (paths[k][:, 0] < 0.75)
        v = 0.25 + a * np.cos(t[middle])
        assert found.highest[k] == pytest.approx(v.max(), abs=5e-5)
        assert found.lowest[k] == pytest.approx(v.min(), abs=5e-5)
    assert pytest.approx((found.highest - found.lowest)[1]) == found.FV


def test_a_window_takes_the_noise_of_the_tracker():
    rng = np.random.default_rng(0)
    t, path = run(0.25, 1e-3)
    noisy = [path + 2e-5 * rng.standard_normal(path.shape) for _ in range(2)]
    rough, smooth = (path_velocity([t, t], noisy, LINE, 0.25, window) for window in (0.0, 0.05))
    assert rough.FV > 0.1
    # slope of 51 samples of 20 um, 1 ms apart: 20 um sqrt(12 / 51^3) / 1 ms = 0.19 mm/s, some seven times that
    assert 0.8e-3 < smooth.FV < 2e-3
    assert abs(smooth.AV) < 1e-4


def test_way_along_a_path_with_a_corner():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    seen = np.array([[0.5, 0.01, 0], [1.02, -0.01, 0], [1.3, 0.5, 0], [1, 1.2, 0]])
    assert way_along(seen, corner) == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_too_little():
    t, path = run(0.25)
    with pytest.raises(MeasurementError, match="two cycles or more"):
        path_velocity([t], [path], LINE)
    with pytest.raises(MeasurementError, match="cycle 2 has fewer than two velocities on the middle half"):
        path_velocity([t, t[:20]], [path, path[:20]], LINE)


LEGS = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.1, 0, 0], [0.1, 0.05, 0], [0.1, 0.1, 0]])
"""Along x, then along y, metres."""


def test_an_arc_of_known_radius_cuts_the_corner():
    r = 0.01
    turn = np.linspace(-np.pi / 2, 0, 2001)
    arc = np.column_stack([0.09 + r * np.cos(turn), r + r * np.sin(turn), 0 * turn])
    path = np.vstack([[[0.0, 0, 0]], arc, [[0.1, 0.1, 0]]])
    (corner,) = cornering([path], LEGS)
    assert pytest.approx(r * (np.sqrt(2) - 1), abs=1e-8) == corner.CR
    assert pytest.approx(0.0, abs=1e-12) == corner.CO
    assert (corner.distance, corner.turn) == (pytest.approx(0.1), pytest.approx(np.pi / 2))


def test_running_past_the_corner_is_overshoot_and_the_worst_cycle_counts():
    def past(by, aside=0.0):
        return np.array([[0.0, 0, 0], [0.1, 0, aside], [0.1 + by, 0.002, aside], [0.1, 0.02, 0], [0.1, 0.1, 0]])

    (corner,) = cornering([past(3e-4), past(4e-4, 3e-4)], LEGS)
    assert corner.overshoot == pytest.approx([3e-4, 5e-4])
    assert pytest.approx(5e-4) == corner.CO
    assert corner.round_off[0] == pytest.approx(0.0, abs=1e-12)


def test_the_far_half_of_the_second_leg_belongs_to_the_next_corner():
    zigzag = np.vstack([LEGS, [[0.15, 0.1, 0]]])
    late = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.06, 0], [0.11, 0.09, 0], [0.15, 0.1, 0]])
    first, second = cornering([late], zigzag)
    assert pytest.approx(0.0, abs=1e-12) == first.CO, "what cuts the second corner is no overshoot of the first"
    assert second.distance == pytest.approx(0.2)
    # distance of (100, 100) mm from the line through (100, 60) and (110, 90), or from that to (150, 100)
    assert pytest.approx(min(0.04 / np.sqrt(10), np.hypot(0.01, 0.01)), abs=0.003) == second.CR


def test_a_circle_told_by_points_has_no_corner():
    turn = np.linspace(0, 2 * np.pi, 13)
    assert cornering([LEGS], np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])) == ()


@pytest.fixture(scope="module")
def folder(record, tmp_path_factory):
    """Cycles, approaches and a path as files."""
    folder = tmp_path_factory.mktemp("iso9283")
    robot = record.robot_calibrated()
    q, T, _, _ = cycles(robot)
    write(folder / "iso.csv", robot, q, T)
    write(folder / "directions.csv", robot, q, T, extra=[[(1 + c % 3,) for c in range(12)]] * 5, columns=["direction"])
    time = np.arange(0, 12, 0.04)
    rows = ["time_s,x_mm,y_mm,z_mm", *(f"{t:.2f},{100 + 2 * np.exp(-3 * t):.9f},50,7" for t in time)]
    (folder / "approaches.csv").write_text("\n".join(rows))
    x = np.linspace(0, 100, 21)
    (folder / "commanded.csv").write_text("x_mm,y_mm,z_mm\n" + "".join(f"{v},10,5\n" for v in x))
    lines = ["cycle,time_s,x_mm,y_mm,z_mm"]
    in_base = ["cycle,x_mm,y_mm,z_mm"]
    T = robot.T_world_base
    for c in (1, 2):
        for t, v in zip(np.linspace(0, 1, 30), np.linspace(-3, 103, 30), strict=True):
            lines.append(f"{c},{t:.9f},{v},{10 + 0.1 * c},5")
            place = T[:3, :3] @ np.array([v, 10 + 0.1 * c, 5]) + 1e3 * T[:3, 3]
            in_base.append(f"{c},{','.join(f'{x:.9f}' for x in place)}")
    (folder / "path.csv").write_text("\n".join(lines))
    (folder / "path_of_base.csv").write_text("\n".join(in_base))
    moves = [f"a,{t:.2f},{100 * np.clip(t - 1, 0, 1):.6f},1,1" for t in np.arange(0, 3, 0.01)]
    (folder / "moves.csv").write_text("\n".join(["move,time_s,x_mm,y_mm,z_mm", *moves]))
    pushed = [
        ",".join([way, str(f), *(f"{v:.9f}" for v in 1e3 * T[:3, 3] + T[:3, :3] @ (axis * 0.004 * f))])
        for way, axis in zip(("+x", "+y", "+z"), np.eye(3), strict=True)
        for f in (0, 30, 60)
    ]
    (folder / "forces.csv").write_text("\n".join(["direction,force_n,x_mm,y_mm,z_mm", *pushed]))
    return folder


def test_all_parts_together(record, folder, tmp_path):
    found = iso9283(
        folder / "iso.csv",
        calibration=record,
        approaches=folder / "approaches.csv",
        path=folder / "path_of_base.csv",
        commanded_path=folder / "commanded.csv",
        moves=folder / "moves.csv",
        forces=folder / "forces.csv",
    )
    assert found.poses.subject == "flange"
    rp = found.poses.models["nominal"].poses["P1"]["RP_mm"]
    assert found.stabilisation.band == pytest.approx(rp * 1e-3, rel=1e-12), "RP of P1 unless another band is given"
    assert pytest.approx(1.5e-4, abs=1e-9) == found.path.errors.AT
    assert found.path.velocity is None
    assert [c.along for c in found.compliance.directions.values()] == pytest.approx([4e-6] * 3, rel=1e-6)
    assert found.posing.band == found.stabilisation.band
    assert 0.99 < found.posing.moves["a"].times[0] < 1.0
    data = found.to_dict()
    assert list(data) == ["poses", "stabilisation", "path", "posing", "compliance"]
    assert "check" not in data["stabilisation"]
    text = found.summary()
    for part in (
        "ISO 9283, flange, calibrated, mm",
        "Position stabilisation, limit band",
        "SIMULATED data: Path: AT 0.150 mm",
        "Posing time from rest to rest",
        "SIMULATED data: Static compliance, axes of the base link",
    ):
        assert part in text
    assert len(repr(found)) < 2000
    assert "SIMULATED" in repr(found)
    assert pickle.loads(pickle.dumps(found)).to_dict() == data
    assert list(found.plots()) == ["poses", "stabilisation", "path", "posing", "compliance"]
    assert [bool(drawn.mark) for drawn in found.plots().values()] == [True, False, True, False, True]
    written = found.save_plots(tmp_path / "iso.SVG")
    names = ["iso.svg", "iso-stabilisation.svg", "iso-path.svg", "iso-posing.svg", "iso-compliance.svg"]
    assert [path.name for path in written] == names
    assert all(b"<svg" in path.read_bytes() for path in written)


def test_loaded_measurements_serve(folder):
    found = iso9283(table.read(folder / "iso.csv"), target="smr2")
    frames_of = iso9283(pd.read_csv(folder / "iso.csv"), target="smr2", commanded=iso9283_plan("irb1600").to_frame())
    assert frames_of.poses.models["measured"].poses["P1"]["AP_mm"] > 1.0
    assert (
        frames_of.poses.models["measured"].poses["P1"]["RP_mm"] == found.poses.models["measured"].poses["P1"]["RP_mm"]
    )
    assert found.poses.subject == "target smr2"
    assert found.to_frame()["pose"].tolist() == list(ISO_POSES)
    assert (found.stabilisation, found.path) == (None, None)
    assert found.to_dict()["path"] is None


def test_the_first_pose_gives_the_band_where_there_is_no_p1(folder, tmp_path):
    text = (folder / "iso.csv").read_text().replace("\nP1,", "\nhome,")
    (tmp_path / "named.csv").write_text(text)
    found = iso9283(tmp_path / "named.csv", approaches=folder / "approaches.csv")
    assert next(iter(found.poses.models["measured"].poses)) == "home"
    assert found.stabilisation.band * 1e3 == pytest.approx(found.poses.models["measured"].poses["home"]["RP_mm"])
    assert iso9283(approaches=folder / "approaches.csv", band=1e-3, rest=2.0).stabilisation.at_rest_after == 2.0


@pytest.mark.parametrize(
    ("options", "parameter", "says"),
    [
        ({}, "measurements", "give measurements, approaches, a path, moves or forces"),
        ({"path": "path.csv"}, "path", "a path needs its commanded points"),
        ({"commanded_path": "commanded.csv"}, "path", "a path needs its commanded points"),
        ({"approaches": "approaches.csv"}, "band", "give a limit band"),
        ({"moves": "moves.csv"}, "band", "give a limit band"),
        ({"forces": "forces.csv", "velocity": 0.25}, "path", "a velocity is that of a path"),
        ({"path": "path.csv", "commanded_path": "commanded.csv", "velocity": 0.0}, "velocity", "above zero, found 0"),
        ({"path": "path.csv", "commanded_path": "commanded.csv", "window": -1}, "window", "at least 0"),
        (
            {"path": "path_of_base.csv", "commanded_path": "commanded.csv", "velocity": 0.25},
            "velocity",
            "takes the column time_s",
        ),
        ({"measurements": "directions.csv", "approaches": "approaches.csv"}, "band", "give a limit band"),
        ({"measurements": "iso.csv", "set_size": 1}, "set_size", "two cycles or more, found 1"),
    ],
)
def test_wrong_options(options, parameter, says, folder):
    options = {name: folder / value if isinstance(value, str) else value for name, value in options.items()}
    with pytest.raises(OptionError, match=says) as refused:
        iso9283(**options)
    assert refused.value.parameter == parameter


def test_directions_alone_have_no_figure(folder):
    found = iso9283(folder / "directions.csv")
    with pytest.raises(MeasurementError, match="only directions of approach"):
        found.plot()
    with pytest.raises(IrbcalError, match="a name that ends in"):
        found.save_plots(folder / "x.docx")
    assert "Variation over 3 directions, P5: vAP" in found.summary()


def test_plan_of_a_robot():
    found = iso9283_plan("irb1600", inset=0.1)
    assert np.abs(np.degrees(found.q[0]) - [0, -14, 14, 0, 0, 0]).max() < 1e-5
    nominal = arm("irb120")
    near = np.radians([0.0, 0, 0, 0, 30, 0])
    found = iso9283_plan(nominal, center=[0.35, 0, 0.4], edge=0.2, near=near)
    R = nominal.forward(near[None])[0, :3, :3]
    assert np.abs(frames.rotation_distance(found.T_base_tip[:, :3, :3], R)).max() < 1e-7
    table = found.to_frame()
    assert table[["x_mm", "y_mm", "z_mm"]].to_numpy() == pytest.approx(found.T_base_tip[:, :3, 3] * 1e3, abs=1e-6)
    assert "irb120_3_058" in repr(found)
    assert "Joints and tip in the base link" in found.summary()
    with pytest.raises(OptionError, match="plane: expected x=z, x=-z, y=z or y=-z, found 'z=0'"):
        iso9283_plan("irb1600", plane="z=0")
    with pytest.raises(RobotError):
        iso9283_plan("irb1600", inset=0.5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"center": (0, 0)}, r"center: .* found \(0, 0\)"),
        ({"center": (1000, 0, 900)}, "center: metres expected"),
        ({"edge": 400}, "edge: metres expected"),
        ({"edge": "x"}, "edge: expected a number, found 'x'"),
        ({"inset": -0.1}, "inset: expected a number of at least 0"),
    ],
)
def test_the_cube_is_given_in_metres(options, words):
    with pytest.raises(OptionError, match=words) as refused:
        iso9283_plan("irb1600", **options)
    assert refused.value.parameter == next(iter(options))


SPRING = 1e-6 * np.array([[3.0, 0.5, 0.0], [0.5, 4.0, 0.2], [0.0, 0.2, 5.0]])
"""Displacement per force in the base link, m/N."""

WAYS = ("+x", "-x", "+y", "-y", "+z", "-z")


def loaded(path, R=None, cycles=3, noise=0.0, extra=""):
    """Places under 0 to 60 N along the axes of the base link, seen in a frame turned by R, mm."""
    rng = np.random.default_rng(0)
    lines = [f"direction,force_n,cycle,x_mm,y_mm,z_mm{extra and ',simulated'}"]
    for way in WAYS:
        axis = np.eye(3)["xyz".index(way[1])] * (1 if way[0] == "+" else -1)
        for c in range(1, cycles + 1):
            for force in range(0, 61, 6):
                p = np.array([0.8, 0.1, 1.0]) + c * 1e-5 + SPRING @ axis * force + noise * rng.standard_normal(3)
                p = p if R is None else R @ p
                lines.append(f"{way},{force},{c},{','.join(f'{v * 1e3:.9f}' for v in p)}{extra}")
    return written(path, "\n".join(lines))


def test_a_spring_is_found_along_and_across(tmp_path):
    R = frames.rot_z(0.7) @ frames.rot_x(-1.1)
    found = static_compliance(loaded(tmp_path / "f.csv", R), R.T)
    assert found.frame == "base link"
    for name, c in found.directions.items():
        k = "xyz".index(name[1])
        assert c.along == pytest.approx(SPRING[k, k], rel=1e-6)
        assert c.across == pytest.approx(np.linalg.norm(np.delete(SPRING[k], k)), rel=1e-6)
        assert (c.largest_force, c.displacement_at_largest) == (60.0, pytest.approx(60 * SPRING[k, k], rel=1e-6))
        assert c.spread < 1e-11
    frame = found.to_frame()
    assert frame["direction"].tolist() == list(WAYS)
    assert frame["along_mm_per_n"].tolist() == pytest.approx([0.003, 0.003, 0.004, 0.004, 0.005, 0.005], rel=1e-6)
    assert "Static compliance, axes of the base link" in found.summary()
    # seen along the axes of another frame it is another matrix
    other = static_compliance(loaded(tmp_path / "g.csv")).directions["+z"]
    assert other.along == pytest.approx(5e-6, rel=1e-6)


def test_noise_is_told_by_the_cycles(tmp_path):
    found = static_compliance(loaded(tmp_path / "f.csv", noise=2e-5, extra=",yes"))
    # slope of 11 forces 6 N apart: 20 um / (6 N sqrt(110)) = 0.32 um/N
    spread = np.mean([c.spread for c in found.directions.values()])
    assert 1e-7 < spread < 6e-7
    assert "SIMULATED data: static compliance up to" in repr(found)
    assert "SIMULATED data" in found.plot().svg()


def test_iso9283_check_refusals(tmp_path):
    text = loaded(tmp_path / "f.csv").read_text()
    with pytest.raises(MeasurementError, match=r"row 2, column direction: expected \+x, -x, .*, found 'up'"):
        static_compliance(written(tmp_path / "a.csv", text.replace("+x,0,1", "up,0,1")))
    with pytest.raises(MeasurementError, match=r"column force_n: expected a force that is not negative.*, found '-6'"):
        static_compliance(written(tmp_path / "b.csv", text.replace("+x,6,1", "+x,-6,1")))
    one = "\n".join(line for line in text.splitlines() if ",0,1," not in line or line.startswith("dir"))
    lines = [text.splitlines()[0], *[line for line in one.splitlines() if line.startswith("+x,6,1,")]]
    with pytest.raises(MeasurementError, match=r"direction \+x of cycle 1 has one force only"):
        static_compliance(written(tmp_path / "c.csv", "\n".join(lines)))
