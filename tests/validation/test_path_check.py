"""Sampled paths from files."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.validation.path_check import path_accuracy


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
