"""Sampled paths from files."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.validation import iso9283_check
from irbcal.validation.iso9283_check import cornering, path_accuracy, path_velocity, way_along


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
    assert (told["way_mm"], told["turn_deg"]) == (pytest.approx(100), pytest.approx(90))
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
    assert (corner.way, corner.turn) == (pytest.approx(0.1), pytest.approx(np.pi / 2))


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
    assert second.way == pytest.approx(0.2)
    # distance of (100, 100) mm from the line through (100, 60) and (110, 90), or from that to (150, 100)
    assert pytest.approx(min(0.04 / np.sqrt(10), np.hypot(0.01, 0.01)), abs=0.003) == second.CR


def test_a_circle_told_by_points_has_no_corner():
    turn = np.linspace(0, 2 * np.pi, 13)
    assert cornering([LEGS], np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])) == ()
