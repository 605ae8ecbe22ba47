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
from irbcal.validation.iso9283_check import iso9283, iso9283_plan, static_compliance
from irbcal.validation.pose_check import POSES


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
    assert [bool(drawn.mark) for drawn in found.plots().values()] == [
        True,
        False,
        True,
        False,
        True,
    ]
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
    assert found.to_frame()["pose"].tolist() == list(POSES)
    assert (found.stabilisation, found.path) == (None, None)
    assert found.to_dict()["path"] is None


def test_the_first_pose_gives_the_band_where_there_is_no_p1(folder, tmp_path):
    text = (folder / "iso.csv").read_text().replace("\nP1,", "\nhome,")
    (tmp_path / "named.csv").write_text(text)
    found = iso9283(tmp_path / "named.csv", approaches=folder / "approaches.csv")
    assert next(iter(found.poses.models["measured"].poses)) == "home"
    assert found.stabilisation.band * 1e3 == pytest.approx(found.poses.models["measured"].poses["home"]["RP_mm"])
    assert iso9283(approaches=folder / "approaches.csv", band=1e-3, rest=2.0).stabilisation.rest == 2.0


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
        ({"center": (0, 0)}, r"center: expected x, y, z in metres, found \(0, 0\)"),
        ({"center": (1000, 0, 900)}, "center: metres expected, .* looks like millimetres"),
        ({"edge": 400}, "edge: metres expected, .* looks like millimetres"),
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


def test_refusals(tmp_path):
    text = loaded(tmp_path / "f.csv").read_text()
    with pytest.raises(MeasurementError, match=r"row 2, column direction: expected \+x, -x, .*, found 'up'"):
        static_compliance(written(tmp_path / "a.csv", text.replace("+x,0,1", "up,0,1")))
    with pytest.raises(MeasurementError, match=r"column force_n: expected a force that is not negative.*, found '-6'"):
        static_compliance(written(tmp_path / "b.csv", text.replace("+x,6,1", "+x,-6,1")))
    one = "\n".join(line for line in text.splitlines() if ",0,1," not in line or line.startswith("dir"))
    lines = [text.splitlines()[0], *[line for line in one.splitlines() if line.startswith("+x,6,1,")]]
    with pytest.raises(MeasurementError, match=r"direction \+x of cycle 1 has one force only"):
        static_compliance(written(tmp_path / "c.csv", "\n".join(lines)))
