"""The example files: all are written, say what they say, and the lines that try them work."""

import inspect
import io
import json
import re
import shlex
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support import Posed
from typer.testing import CliRunner

import irbcal
from irbcal.cell.adjusted_cell import adjust
from irbcal.cell.touches import read_touches
from irbcal.cli.main import app
from irbcal.errors import CalibrationError
from irbcal.examples import measurements
from irbcal.examples import samples as makers
from irbcal.examples.measurements import (
    MOVED,
    READING_NOISE_MM,
    SCALE_BAR_MM,
    example_cell,
    measured_table,
    one_joint_moves,
    seen_from_elsewhere,
)
from irbcal.examples.samples import samples
from irbcal.io.calibration_folder import read
from irbcal.measurement.imports import column_map
from irbcal.modeling.robot import Robot
from irbcal.names import csv_bytes


@pytest.fixture(scope="module")
def written(example_files):
    return example_files


def test_there_is_a_line_for_every_command_and_every_preset(written):
    told = " ".join(written.tried.values())
    for name in (
        "calibrate",
        "evaluate",
        "fk",
        "ik",
        "filter",
        "view",
        "joints",
        "urdf",
        "iso9283",
        "tracker",
        "ballbar",
        "controller",
    ):
        assert f"irbcal {name} " in told
    for preset in column_map.presets():
        assert f"--as {preset} " in told
    assert set(written.about) == {
        p.relative_to(written.folder).as_posix() for p in written.folder.rglob("*") if p.is_file()
    } - {"README.txt"}
    text = (written.folder / "README.txt").read_text()
    assert "SIMULATED" in text
    assert all(line in text for line in written.tried.values())


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    mine = tmp_path / "measured.csv"
    mine.write_text("mine")
    with pytest.raises(CalibrationError, match="expected a new or empty folder"):
        samples(tmp_path)
    assert mine.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [mine]


def test_the_command(tmp_path, monkeypatch):
    for name in ("tracker_files", "foreign_files", "check_files", "rail_files", "fleet_files"):
        monkeypatch.setattr(measurements, name, list)
    monkeypatch.setattr(makers, "files", list)
    done = CliRunner().invoke(app, ["samples", str(tmp_path / "here"), "--json"], catch_exceptions=False)
    found = json.loads(done.output)
    assert found["simulated"] is True
    assert (tmp_path / "here" / found["files"][0]["file"]).exists()
    assert inspect.unwrap(irbcal.samples) is samples


def test_csv_has_line_feeds_and_no_formulas():
    table = pd.DataFrame({"name": ["=1+1", "smr1"], "x": [1.5, 2.0]})
    assert csv_bytes(table) == b"name,x\n'=1+1,1.5\nsmr1,2.0\n"
    assert csv_bytes(table[["x"]], sep=";", decimal=",") == b"x\n1,5\n2,0\n"


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
    commands = ("calibrate", "evaluate", "joints", "iso9283", "tracker", "ballbar", "controller")
    read_by = tuple(f"irbcal {command} " for command in commands)
    files = {name for name, line in written.tried.items() if line.startswith(read_by)}
    assert {
        "measured.csv",
        "approaches.csv",
        "bar.csv",
        "repeat.csv",
        "drift.csv",
        "circle.csv",
        "reported.csv",
    } < files
    for name in files - {"balls.csv"}:  # that is what is known, touched.csv what was measured
        assert set(pd.read_csv(written.folder / name)["simulated"]) == {"yes"}, name
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
    assert len(measured_table(example_cell(), one_joint_moves(6)))
    assert callable(inverse_kinematics)


def test_the_tracker_sees_the_program():
    from irbcal.examples.measurements import PROGRAM

    run = example_cell().without("lost").measure(np.radians(np.array(PROGRAM, dtype=float)))
    assert np.isfinite(run.xyz).all()


@pytest.fixture(scope="module")
def imported(written, tmp_path_factory):
    """Tables by the name of what they were imported from."""
    here, out = Path.cwd(), tmp_path_factory.mktemp("imported")
    tables = {}
    for name, line in written.tried.items():
        if not line.startswith("irbcal import"):
            continue
        words = shlex.split(line)[1:]
        source = [str(path) for word in words[1:] if "*" in word for path in sorted(written.folder.glob(word))]
        words = [words[0], *source, *(word for word in words[1:] if "*" not in word)]
        words = [str(written.folder / word) if (written.folder / word).is_file() else word for word in words]
        words[words.index("--out") + 1] = str(out / f"{Path(name).stem}.csv")
        done = CliRunner().invoke(app, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        tables[name] = pd.read_csv(out / f"{Path(name).stem}.csv")
    assert Path.cwd() == here
    return tables


def test_files_of_other_programs_stay_simulated(imported, written, tmp_path):
    for name, table in imported.items():
        assert set(table["simulated"]) == {"yes"}, name
    recognised = irbcal.import_measurements(written.folder / "wide.csv", robot="irb1600")
    assert set(recognised.table["simulated"]) == {"yes"}
    assert recognised.to_dict()["simulated"] is True
    assert "SIMULATED" in recognised.summary()
    (tmp_path / "real.csv").write_text((written.folder / "wide.csv").read_text().removeprefix("# SIMULATED\n"))
    real = irbcal.import_measurements(tmp_path / "real.csv", robot="irb1600")
    assert (real.simulated, "SIMULATED" in real.summary()) == (False, False)
    pd.testing.assert_frame_equal(real.table, recognised.table.drop(columns="simulated"))


def test_points_of_all_layouts_agree(imported):
    xyz = {}
    for name in ("robodk.csv", "wide.csv", "turned.csv", "points.txt", "smr1.csv"):
        table = imported[name]
        table = table[~table["target"].astype(str).str.startswith("ref")]
        xyz[name] = table[["x_mm", "y_mm", "z_mm"]].to_numpy()
        assert xyz[name].shape == (120, 3)
    for name, found in xyz.items():
        assert np.allclose(found, xyz["wide.csv"], atol=1e-6), name


def test_joints_agree_and_the_turned_sign_is_turned_back(imported):
    columns = [f"q{k}_deg" for k in range(1, 7)]
    for name in ("robodk.csv", "turned.csv", "points.txt"):
        joints = imported[name].drop_duplicates("pose")[columns].to_numpy()
        assert np.allclose(joints, imported["wide.csv"].drop_duplicates("pose")[columns].to_numpy(), atol=1e-6), name


@pytest.mark.parametrize(("name", "robot"), [("tmac.csv", "irb1600"), ("export.csv", "ur10")])
def test_full_poses_are_those_of_their_robot(imported, name, robot):
    """By the distances of its positions from one another, whatever the frame: some mm beside the nominal robot's."""
    table = imported[name]
    joints = irbcal.forward_kinematics(robot, table[[f"q{k}_deg" for k in range(1, 7)]]).T_base_tip[:, :3, 3]
    xyz = table[["x_mm", "y_mm", "z_mm"]].to_numpy() * 1e-3
    distances = [np.linalg.norm(points[1:] - points[:-1], axis=1) for points in (joints, xyz)]
    np.testing.assert_allclose(*distances, rtol=0, atol=0.02)


def test_the_scale_bar_has_its_length(written):
    found = irbcal.tracker(written.folder / "bar.csv", length=SCALE_BAR_MM * 1e-3).to_frame()
    errors = found.select_dtypes("number")
    assert len(found) == 20
    points = pd.read_csv(written.folder / "bar.csv")[["x_mm", "y_mm", "z_mm"]].to_numpy().reshape(-1, 2, 3)
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    assert np.abs(length - SCALE_BAR_MM).max() < 5 * READING_NOISE_MM
    assert len(errors.columns)


def test_a_program_corrected_by_a_simulated_calibration_says_so(written, demo_calibration):
    corrected = irbcal.correct(demo_calibration, written.folder / "job.csv")
    assert corrected.report()[0] == "Calibration from SIMULATED data"
    assert corrected.to_dict()["simulated"] is True
    record = read(demo_calibration).record
    real = irbcal.correct(record.model_copy(update={"simulated": False}), written.folder / "job.csv")
    assert (real.to_dict()["simulated"], "SIMULATED" in real.summary()) == (False, False)


def test_the_path_cuts_its_corner_by_two_millimetres(written):
    found = irbcal.iso9283(path=written.folder / "path.csv", commanded_path=written.folder / "commanded_path.csv")
    assert pytest.approx(2.0e-3, abs=5e-5) == found.path.errors.AT
    assert "SIMULATED" in found.summary()


def test_the_compliance_is_what_was_put_in(written):
    table = pd.read_csv(written.folder / "forces.csv")
    x = table[table["direction"] == "+x"]
    assert np.polyfit(x["force_n"], x["x_mm"], 1)[0] == pytest.approx(0.02, abs=1e-4)
    assert "0.020" in irbcal.iso9283(forces=written.folder / "forces.csv").summary()


def test_the_controller_has_a_longer_link(written):
    found = irbcal.controller(written.folder / "reported.csv", written.folder / "my_robot.urdf")
    told = found.summary()
    assert "0.300" in told
    assert "a3" in told or "a4" in told


def test_the_circle_is_about_the_ballbars_length(written):
    table = pd.read_csv(written.folder / "circle.csv")
    assert len(table) == 360
    assert table["radius_mm"].mean() == pytest.approx(150.0, abs=1e-3)
    assert 0.05 < np.ptp(table["radius_mm"]) < 2.0


def test_it_has_a_rail_and_six_joints(written):
    arm = irbcal.read_urdf(written.folder / "cell.urdf", "rail_base", "tool0").arm
    assert arm.table.prismatic.tolist() == [True] + [False] * 6
    table = pd.read_csv(written.folder / "rail.csv")
    assert table["q1_mm"].between(0, 2000).all()
    assert table["q1_mm"].nunique() > 50


def test_rows_and_balls_belong_together():
    rows, balls = (pd.read_csv(BytesIO(sample.content)) for sample in [*measurements.touched_files()][:2])
    assert len(rows) == measurements.TOUCHED_POSES
    assert (rows["simulated"] == "yes").all()
    assert set(rows["feature"]) == set(balls.loc[balls["kind"] == "point", "feature"])
    assert (balls["kind"] == "distance").sum() == 6


def test_touches_are_those_of_the_true_robot():
    cell = example_cell()
    rows, source = read_touches(measurements.touches(cell), cell.arm)
    T = cell.measure(np.array([one.q for one in rows])).T_base_tip
    robot = Posed(Robot(cell.arm), [touch.q for touch in rows], T)
    adjusted = adjust(rows, robot, np.full(len(rows), measurements.BY_EYE), source)
    tip, fixture = adjusted.frame("tool", "1")[:3, 3], adjusted.frame("work_object", "1")
    np.testing.assert_allclose(tip, measurements.TOUCHING_TIP, rtol=0, atol=6 * measurements.BY_EYE)
    np.testing.assert_allclose(fixture, measurements.T_BASE_FIXTURE, rtol=0, atol=12 * measurements.BY_EYE)
    spread = np.sqrt(np.sum(adjusted.residual**2) / adjusted.redundancy)
    assert 0.4 * measurements.BY_EYE < spread < 1.6 * measurements.BY_EYE


EULER = {"kuka": "ZYX", "fanuc": "xyz", "yaskawa": "xyz", "staubli": "XYZ", "kawasaki": "ZYZ"}


def pinocchio_pose(data, q):
    model = pin.buildModelFromXML(data.decode())
    q = np.array(q)
    state = model.createData()
    pin.forwardKinematics(model, state, q)
    pin.updateFramePlacements(model, state)
    base, tip = (state.oMf[model.getFrameId(name)] for name in ("base", "tool0"))
    return (base.inverse() * tip).homogeneous


@pytest.mark.parametrize(
    ("arm", "maker"), [pair for pair in makers.arms() if pair[0].joints], ids=lambda value: getattr(value, "folder", "")
)
def test_poses_are_where_the_joints_are(arm, maker):
    from irbcal.io import urdf

    data = makers.urdf_of(arm)
    found = makers.stops(arm, maker, data, urdf.from_bytes(data, arm.folder))

    def place(six):
        return np.block(
            [
                [
                    Rotation.from_euler(EULER[arm.folder], six[3:], degrees=True).as_matrix(),
                    np.array(six[:3], ndmin=2).T,
                ],
                [np.zeros((1, 3)), np.ones((1, 1))],
            ]
        )

    for program, numbers in zip(arm.stops, found["poses"], strict=True):
        q = np.radians(program)
        if arm.folder == "fanuc":
            q[2] += q[1]  # the pendant's joint 3 is measured against the ground
        flange = pinocchio_pose(data, q)
        flange[:3, 3] *= 1e3
        tool = place(arm.frame) @ place(numbers) @ np.linalg.inv(place(arm.tool))
        assert np.allclose(tool[:3, 3], flange[:3, 3], atol=1e-6)
        assert np.allclose(tool[:3, :3], flange[:3, :3], atol=1e-9)


def test_programs_are_marked_and_have_all_stops(written):
    programs = [name for name in written.about if re.search(r"\.(mod|src|ls|JBI|pgx|script|as)$", name)]
    assert len(programs) == 9
    for name in programs:
        if "CalibData" not in name:
            assert "SIMULATED" in (written.folder / name).read_text(), name


def test_the_lists_name_the_files_beside_them():
    found = {sample.path: sample.content for sample in measurements.fleet_files()}
    for month, day in measurements.MONTHS:
        rows = pd.read_csv(io.BytesIO(found[f"fleet/{month}.csv"]))
        assert list(rows["id"]) == ["cell-1", "cell-2"]
        assert set(rows["date"]) == {day}
        for path in rows["measurements"]:
            seen = pd.read_csv(io.BytesIO(found[f"fleet/{path}"]))
            assert set(seen["simulated"]) == {"yes"}
            assert seen["pose"].nunique() == measurements.FLEET_POSES
