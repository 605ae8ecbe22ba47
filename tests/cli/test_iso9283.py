"""ISO 9283 from simulated measurement files, against the shifts and scatter that were put in."""

import csv

import numpy as np
import pytest
from iso9283_files import CYCLES, cycles, write
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError
from irbcal.validation import pose_check


@pytest.fixture(scope="module")
def robot(demo_calibration):
    return irbcal.load(demo_calibration).robot_calibrated()


def test_flange_from_three_targets(program, demo_calibration, robot, tmp_path):
    q, T, away, turned = cycles(robot)
    file = write(tmp_path / "iso.csv", robot, q, T)
    found = program("iso9283", file, "--calibration", demo_calibration, "--json", "--plot", tmp_path / "iso.png")[
        "poses"
    ]
    assert found["subject"] == "flange"
    model = found["models"]["calibrated"]
    assert list(model["poses"]) == list(pose_check.ISO_POSES)
    R_base = robot.T_world_base[:3, :3].T
    for p, values in enumerate(model["poses"].values()):
        mean = R_base @ (np.array([0.1, 0, 0]) + away[p].mean(axis=0) * 1e3)
        assert values["n"] == CYCLES
        assert [values[f"AP_{a}_mm"] for a in "xyz"] == pytest.approx(mean, abs=2e-6)
        assert values["AP_mm"] == pytest.approx(np.linalg.norm(mean), abs=2e-6)
        far = np.linalg.norm(away[p] - away[p].mean(axis=0), axis=1) * 1e3
        assert values["RP_mm"] == pytest.approx(far.mean() + 3 * far.std(ddof=1), abs=2e-6)
        angles = np.degrees(turned[p]) @ R_base.T
        assert [values[f"AP_{a}_deg"] for a in "abc"] == pytest.approx(angles.mean(axis=0), abs=1e-5)
        assert [values[f"RP_{a}_deg"] for a in "abc"] == pytest.approx(3 * angles.std(axis=0, ddof=1), abs=1e-5)
    ends = T[[1, 3], :, :3, 3]
    distance = np.linalg.norm(ends[0] - ends[1], axis=1) * 1e3
    commanded = (robot.poses(q)[1] - robot.poses(q)[3])[:3, 3]
    assert model["distance"]["AD_mm"] == pytest.approx(distance.mean() - np.linalg.norm(commanded) * 1e3, abs=2e-6)
    assert model["distance"]["RD_mm"] == pytest.approx(3 * distance.std(ddof=1), abs=2e-6)
    assert found["models"]["nominal"]["overall"]["position"]["mean_mm"] > model["overall"]["position"]["mean_mm"]
    assert model["overall"]["position"]["n"] == 5 * CYCLES
    assert (tmp_path / "iso.png").read_bytes().startswith(b"\x89PNG")
    text = program("iso9283", file, "--calibration", demo_calibration)
    assert "SIMULATED data: ISO 9283, flange, calibrated, mm" in text
    assert "Errors from the command, all poses and cycles" in text


def test_repeatability_alone_needs_no_calibration(program, robot, tmp_path):
    """Annex I: one target; its lever makes position of the turns."""
    q, T, _, _ = cycles(robot)
    file = write(tmp_path / "one.csv", robot, q, T, ("smr2",))
    found = program("iso9283", file, "--json")["poses"]
    assert found["subject"] == "target smr2"
    places = np.einsum("pcij,j->pci", T[..., :3, :3], robot.targets["smr2"]) + T[..., :3, 3]
    for values, place in zip(found["models"]["measured"]["poses"].values(), places, strict=True):
        far = np.linalg.norm(place - place.mean(axis=0), axis=1) * 1e3
        assert values["RP_mm"] == pytest.approx(far.mean() + 3 * far.std(ddof=1), abs=2e-6)
        assert (values["l_mean_mm"], values["l_max_mm"]) == (
            pytest.approx(far.mean(), abs=2e-6),
            pytest.approx(far.max(), abs=2e-6),
        )
        assert values["AP_mm"] is None
    assert "from the mean" in program("iso9283", file)
    three = program("iso9283", write(tmp_path / "three.csv", robot, q, T), "--json")["poses"]
    assert three["subject"] == "all targets"
    assert three["models"]["measured"]["overall"]["orientation"]["max_deg"] < 0.05


def test_commanded_poses_from_a_file(program, demo_calibration, robot, tmp_path):
    """The plan's own output serves: flange poses in the base link."""
    q, T, _, _ = cycles(robot)
    file = write(tmp_path / "iso.csv", robot, q, T)
    plan = tmp_path / "plan.csv"
    plan.write_text(program("iso9283", "--plan", "irb1600"))
    found = program("iso9283", file, "--calibration", demo_calibration, "--commanded", plan, "--json")["poses"]
    nominal = irbcal.read_urdf("irb1600").arm.forward(q)
    wanted = (robot.T_world_base @ nominal)[:, :3, 3]
    for p, values in enumerate(found["models"]["calibrated"]["poses"].values()):
        assert values["AP_mm"] == pytest.approx(np.linalg.norm(T[p, :, :3, 3].mean(axis=0) - wanted[p]) * 1e3, abs=1e-5)
    # the place of one target in the measuring frame, without any calibration
    place = T[0, 0, :3, :3] @ robot.targets["smr1"] + T[0, 0, :3, 3]
    plan.write_text(
        "pose,x_mm,y_mm,z_mm\n" + "".join(f"P{k},{','.join(f'{v:.7f}' for v in place * 1e3)}\n" for k in range(1, 6))
    )
    found = program("iso9283", file, "--commanded", plan, "--target", "smr1", "--json")["poses"]
    mean = T[0, :, :3, :3] @ robot.targets["smr1"] + T[0, :, :3, 3]
    values = found["models"]["measured"]["poses"]["P1"]
    assert values["AP_mm"] == pytest.approx(np.linalg.norm(mean.mean(axis=0) - place) * 1e3, abs=2e-6)


def test_measured_orientations(program, robot, tmp_path):
    """A six-degree-of-freedom target; what was commanded comes from a file with and without orientation."""
    q, T, _, turned = cycles(robot)
    quaternion = Rotation.from_matrix(T[..., :3, :3].reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]].reshape(5, CYCLES, 4)
    here = robot.replace(targets={"tmac": np.zeros(3)})
    file = write(tmp_path / "six.csv", here, q, T, ("tmac",), extra=quaternion, columns=["qw", "qx", "qy", "qz"])
    found = program("iso9283", file, "--json")["poses"]
    assert found["subject"] == "measured frame"
    for p, values in enumerate(found["models"]["measured"]["poses"].values()):
        spread = 3 * np.degrees(turned[p]).std(axis=0, ddof=1)
        assert [values[f"RP_{a}_deg"] for a in "abc"] == pytest.approx(spread, rel=1e-3)
        assert "AP_a_deg" not in values
    wanted = robot.T_world_base @ robot.poses(q)
    with open(tmp_path / "wanted.csv", "w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["pose", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"])
        for p in range(5):
            out.writerow([f"P{p + 1}", *wanted[p, :3, 3] * 1e3, *Rotation.from_matrix(wanted[p, :3, :3]).as_quat()])
    found = program("iso9283", file, "--commanded", tmp_path / "wanted.csv", "--json")["poses"]
    for p, values in enumerate(found["models"]["measured"]["poses"].values()):
        mean = np.degrees(turned[p]).mean(axis=0)
        assert [values[f"AP_{a}_deg"] for a in "abc"] == pytest.approx(mean, abs=1e-6)
        away = (T[p, :, :3, 3].mean(axis=0) - wanted[p, :3, 3]) * 1e3
        assert [values[f"AP_{a}_mm"] for a in "xyz"] == pytest.approx(away, abs=1e-6)


def test_directions_and_drift(program, demo_calibration, robot, tmp_path):
    q, T, _, _ = cycles(robot, seed=1)
    T = np.repeat(T[:, :1], 12, axis=1)  # no scatter
    directions = [[(1 + c % 3,) for c in range(12)] for _ in range(5)]
    for c in range(12):
        T[:, c, :3, 3] += [3e-5 * (c % 3), 0, 0]
    found = program(
        "iso9283", write(tmp_path / "d.csv", robot, q, T, extra=directions, columns=["direction"]), "--json"
    )
    assert found["poses"]["models"]["measured"]["directions"]["P4"]["vAP_mm"] == pytest.approx(0.06, abs=1e-6)
    creep = np.repeat(T[:1, :1], 12, axis=1)
    for c in range(12):
        creep[:, c, 1, 3] += 1e-5 * c
    times = [[(300 * c,) for c in range(12)]]
    file = write(tmp_path / "t.csv", robot, q[:1], creep, group="iso9283_drift", extra=times, columns=["time_s"])
    found = program(
        "iso9283", file, "--set-size", 4, "--calibration", demo_calibration, "--json", "--plot", tmp_path / "d.svg"
    )
    drift = found["poses"]["models"]["calibrated"]["drift"]
    assert drift["shift_mm"] == pytest.approx([0, 0.04, 0.08], abs=1e-6)
    assert drift["dRP_mm"] == pytest.approx(0, abs=1e-6)
    assert drift["time_s"] == [450, 1650, 2850]
    assert "Drift of P1 over 3 sets of 4, nominal" in program(
        "iso9283", file, "--set-size", 4, "--calibration", demo_calibration
    )


def test_stabilisation_and_path_files(program, tmp_path):
    time = np.arange(0, 12, 0.04)
    rows = ["run,time_s,x_mm,y_mm,z_mm"]
    for run in (1, 2, 3):
        away = 2.0 * run * np.exp(-3 * time)
        rows += [f"{run},{t:.3f},{100 + a:.9f},50,7" for t, a in zip(time, away, strict=True)]
    (tmp_path / "s.csv").write_text("\n".join(rows))
    found = program("iso9283", "--approaches", tmp_path / "s.csv", "--band", 1.0, "--json")["stabilisation"]
    # without a way back out of the band, stabilisation takes no time
    assert (found["PSt_s"], found["overshoot_mm"]) == (0.0, 0.0)
    entries = [run["settled_s"] for run in found["runs"].values()]
    assert entries == pytest.approx([np.log(2.0 * run) / 3 for run in (1, 2, 3)], abs=1e-3)
    x = np.linspace(0, 100, 51)
    (tmp_path / "c.csv").write_text("x_mm,y_mm,z_mm\n" + "".join(f"{v},10,5\n" for v in x))
    (tmp_path / "p.csv").write_text(
        "cycle,x_mm,y_mm,z_mm\n"
        + "".join(f"{c},{v},{10 + 0.1 * c},5\n" for c in (1, 2) for v in np.linspace(-3, 103, 30))
    )
    found = program(
        "iso9283",
        "--path",
        tmp_path / "p.csv",
        "--commanded-path",
        tmp_path / "c.csv",
        "--json",
        "--plot",
        tmp_path / "p.pdf",
    )["path"]
    assert (found["AT_mm"], found["RT_mm"]) == (pytest.approx(0.15), pytest.approx(0.05))
    assert (tmp_path / "p.pdf").read_bytes().startswith(b"%PDF")


def test_refusals(program, robot, tmp_path):
    q, T, _, _ = cycles(robot)
    file = write(tmp_path / "iso.csv", robot, q, T)
    (tmp_path / "bad.csv").write_text(file.read_text().replace(",cycle,", ",round,"))
    with pytest.raises(MeasurementError, match="missing column cycle"):
        program("iso9283", tmp_path / "bad.csv")
    for wrong in (["--path", file], ["--approaches", file], []):
        assert CliRunner().invoke(app, ["iso9283", *map(str, wrong)]).exit_code == 2


def test_the_plan_is_a_table(program):
    """Table A I-1, with the tip in the base link."""
    lines = program("iso9283", "--plan", "irb1600").splitlines()
    assert lines[0] == "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    assert [line.split(",")[0] for line in lines[1:]] == list(pose_check.ISO_POSES)
    assert "-0.000000" not in lines[1].split(",")[1:2], "no minus before zero"
    values = [float(value) for value in lines[2].split(",")[1:]]
    assert values[:6] == pytest.approx([17.690, 18.084, -46.521, -33.814, 33.095, 29.298], abs=0.0015)
    assert values[6:9] == pytest.approx([917.582, 271.928, 1437.635], abs=0.001)
    assert np.linalg.norm(values[9:]) == pytest.approx(1.0, abs=2e-6)
    other = program(
        "iso9283", "--plan", "irb120", "--center", "350,0,400", "--edge", 200, "--inset", 10, "--plane", "y=z"
    )
    p = np.array([[float(value) for value in line.split(",")[7:10]] for line in other.splitlines()[1:]])
    assert p[0] == pytest.approx([350, 0, 400], abs=1e-6)
    assert np.abs(p[1:] - p[0]) == pytest.approx(np.full((4, 3), 80.0), abs=1e-5)
    assert p[1:, 1] == pytest.approx(p[1:, 2] - 400, abs=1e-5)
