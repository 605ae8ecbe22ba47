"""The numbers behind a view, against the robots' own predictions and against what `evaluate` reports."""

import numpy as np
import pandas as pd
import pytest
from evidence_cases import Truth
from support import arm, assert_same_poses, write_measurements
from viewer_urdf import link_poses, looks, mesh, write_stl

import irbcal
from irbcal.errors import CalibrationError, IrbcalError, MeasurementError, RobotError
from irbcal.io.opening import open_calibration
from irbcal.modeling import frames
from irbcal.modeling.terms.situation import Motion
from irbcal.units import MM
from irbcal.viewer import building, shapes
from irbcal.viewer import scene as points


@pytest.fixture(scope="module")
def shown(cell):
    return building.view(cell / "cal", cell / "poses.csv").scene


def tips(drawn, values):
    return np.array([link_poses(drawn.links, q, drawn.T_scene_root)[drawn.tip] for q in values])


def test_links_end_where_the_robots_say(cell, shown):
    saved = irbcal.load(cell / "cal")
    calibrated, nominal = saved.robot_calibrated(), saved.robot_nominal()
    assert not calibrated.joint_map.is_identity
    assert_same_poses(tips(shown.drawn, shown.effective), calibrated.poses(shown.q), 1e-12, 1e-12)
    # the nominal robot stands where its own base was found
    expected = frames.inverse(calibrated.T_world_base) @ nominal.T_world_base @ nominal.poses(shown.q)
    assert_same_poses(tips(shown.ghost, shown.q), expected, 1e-12, 1e-12)


def test_errors_are_those_that_evaluate_reports(cell, shown):
    reported = irbcal.evaluate(irbcal.load(cell / "cal"), cell / "poses.csv")
    for model in ("nominal", "calibrated"):
        size = np.linalg.norm(shown.points.error(model), axis=1) / MM
        assert len(size) == getattr(reported, model)["n"] == 120
        assert abs(size.mean() - getattr(reported, model)["mean_mm"]) < 1e-9
        assert abs(size.max() - getattr(reported, model)["max_mm"]) < 1e-9
    for group, values in reported.per_group.items():
        mine = size[shown.groups[shown.points.pose] == group]
        assert abs(mine.max() - values["calibrated"]["max_mm"]) < 1e-9


def test_orientation_errors_are_those_that_evaluate_reports(cell, tmp_path):
    irbcal.save(irbcal.calibrate(cell / "fit.csv", "irb1600", "26", holdout=10, as_poses=True), tmp_path)
    saved = irbcal.load(tmp_path)
    reported = irbcal.evaluate(saved, cell / "poses.csv").orientation
    points = building.view(saved, cell / "poses.csv").scene.points
    for name in ("nominal", "calibrated"):
        turns = np.degrees(getattr(points, f"turn_{name}"))
        assert len(turns) == reported[name]["n"] == 40
        assert abs(turns.mean() - reported[name]["mean_deg"]) < 1e-9
        assert abs(turns.max() - reported[name]["max_deg"]) < 1e-9


def test_measured_points_are_those_of_the_file(cell, shown):
    table = pd.read_csv(cell / "poses.csv")
    world = frames.apply(frames.inverse(shown.T_scene_world), shown.points.measured)
    np.testing.assert_allclose(world, table[["x_mm", "y_mm", "z_mm"]].to_numpy() * MM, rtol=0, atol=1e-12)
    assert [shown.pose_ids[k] for k in shown.points.pose] == table["pose"].astype(str).tolist()
    names = list(shown.targets)
    assert [names[k] for k in shown.points.target] == table["target"].tolist()
    assert not shown.simulated


def test_tracker_stands_where_it_was(shown):
    # the cell's tracker: 2.5, 0.5, -0.6 is the base in its frame
    R = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    assert shown.tracker
    assert np.linalg.norm(shown.T_scene_world[:3, 3] + R.T @ [2.5, 0.5, -0.6]) < 0.01
    assert np.linalg.norm(shown.T_scene_world[:3, :3] - R.T) < 0.01


def test_no_tracker_where_the_frame_is_made_of_references(shown):
    origin = shown.T_scene_world[:3, 3]
    assert building.tracker_at_origin(shown.T_scene_world, {"ref1": np.add(origin, [1, 0, 0])}, None)
    assert not building.tracker_at_origin(shown.T_scene_world, {"ref1": origin}, None)


def test_without_measurements_there_are_sliders(cell):
    alone = building.view(cell / "cal").scene
    assert (alone.mode, alone.points, len(alone.q)) == ("sliders", None, 0)
    assert set(alone.targets) == {"smr1", "smr2", "smr3"}
    bare = building.view("irb120").scene
    assert bare.ghost is None
    assert set(bare.targets) == {"tool0"}


def test_joints_alone_are_a_plan(cell, tmp_path):
    q = arm().random_joints(4, 8)
    path = tmp_path / "plan.csv"
    pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv(path, index=False)
    planned = building.view(cell / "cal", path).scene
    calibrated = irbcal.load(cell / "cal").robot_calibrated()
    assert planned.mode == "plan"
    assert planned.points.measured is None
    for k, name in enumerate(planned.targets):
        world = frames.apply(
            frames.inverse(planned.T_scene_world), planned.points.calibrated[planned.points.target == k]
        )
        np.testing.assert_allclose(world, calibrated.points(q, name), rtol=0, atol=1e-9)
    steps = (len(planned.path) - 1) // 3
    halfway = calibrated.points((q[1:2] + q[2:3]) / 2, "smr1")
    found = frames.apply(frames.inverse(planned.T_scene_world), planned.path[[steps + steps // 2]])
    np.testing.assert_allclose(found, halfway, rtol=0, atol=1e-9)
    assert building.view("irb1600", plan=q).scene.notes == ()
    q[2:, 1] += 10
    assert "pose 3 and 1 more" in building.view("irb1600", plan=q).scene.notes[0]
    assert points.is_plan(path)
    assert not points.is_plan(cell / "poses.csv")
    assert not points.is_plan(tmp_path / "absent.csv")


def test_cube_of_the_irb1600_and_of_no_other():
    centre, edge = building.view("irb1600").scene.cube
    # erratum: P2 to P5 lie 271.93 mm along each axis from P1, 91.9 mm from the corners along the diagonal
    assert abs(np.sqrt(3) * (edge / 2 - 0.27193) - 0.0919) < 1e-4
    assert np.allclose(centre, [0.6456547, 0.0, 1.165707], rtol=0, atol=1e-12)
    assert building.view("irb120").scene.cube is None
    assert building.view("irb120", cube=([0.3, 0, 0.4], 0.2)).scene.cube[1] == 0.2


@pytest.mark.parametrize("cube", [([0, 0], 0.5), ([0, 0, 0], 0.0), ([0, 0, np.nan], 0.5)])
def test_wrong_cubes_are_refused(cube):
    with pytest.raises(RobotError, match="cube"):
        building.view("irb120", cube=cube)


def test_refusals(cell, tmp_path):
    q = np.zeros((2, 6))
    with pytest.raises(MeasurementError, match="calibration folder only"):
        building.view("irb1600", cell / "poses.csv")
    with pytest.raises(MeasurementError, match="not both"):
        building.view(cell / "cal", cell / "poses.csv", plan=q)
    with pytest.raises(RobotError, match="shape"):
        building.view("irb1600", plan=np.zeros((2, 5)))
    with pytest.raises(IrbcalError, match="magnification"):
        building.view(cell / "cal", cell / "poses.csv", magnify=-3)
    with pytest.raises(MeasurementError, match="no such file"):
        building.view(cell / "cal", tmp_path / "absent.csv")
    with pytest.raises(RobotError, match="does not exist"):
        building.view("no-such-robot")
    table = pd.read_csv(cell / "poses.csv")
    table[["x_mm", "y_mm", "z_mm"]] += 3000
    table.to_csv(tmp_path / "elsewhere.csv", index=False)
    with pytest.raises(MeasurementError, match="refit-base"):
        building.view(cell / "cal", tmp_path / "elsewhere.csv")
    moved = building.view(cell / "cal", tmp_path / "elsewhere.csv", refit_base=True).scene
    assert np.linalg.norm(moved.points.error(), axis=1).max() < 2 * MM


def test_a_calibration_of_a_shipped_robot_needs_no_folder(cell, shown):
    again = building.view(irbcal.load(cell / "cal"), cell / "poses.csv").scene
    assert_same_poses(tips(again.drawn, again.effective), tips(shown.drawn, shown.effective), 1e-12, 1e-12)
    assert_same_poses(tips(again.ghost, again.q), tips(shown.ghost, shown.q), 1e-12, 1e-12)


def test_a_record_of_another_robot_has_no_looks(cell):
    record = open_calibration(irbcal.load(cell / "cal"))
    other = record.model_copy(update={"robot": record.robot.model_copy(update={"urdf_sha256": "0" * 64})})
    with pytest.raises(CalibrationError, match="does not hold the robot's looks: give its folder"):
        building.view(other)


def test_links_are_chosen_for_a_urdf_only(cell):
    assert building.view("irb120", tip_link="link_5").scene.robot.arm.tip_link == "link_5"
    with pytest.raises(RobotError, match="a calibration has its own tip_link"):
        building.view(cell / "cal", tip_link="link_5")


@pytest.fixture(scope="module")
def remembering(tmp_path_factory):
    """A robot with backlash and gravity at all joints, calibrated by model auto with all terms, and its file."""
    folder = tmp_path_factory.mktemp("auto")
    truth = Truth(["gravity", "direction", "bending"])
    motion = Motion.in_order(truth.nominal.random_joints(130, 1))
    file = write_measurements(folder / "m.csv", truth.measured(motion, 2e-5))
    irbcal.save(irbcal.calibrate(file, "irb120", terms="all"), folder / "cal")
    return folder


def test_last_moves_and_frame_terms_count_as_in_report_and_evaluate(remembering):
    """Of the same points the report shows the same errors, evaluate too, and the robot stands where it was moved to."""
    saved = irbcal.load(remembering / "cal")
    scene = building.view(remembering / "cal", remembering / "m.csv").scene
    table = saved.record.points
    reported = dict(zip(zip(table.pose, table.target, strict=True), table.calibrated_mm, strict=True))
    names = list(scene.targets)
    size = np.linalg.norm(scene.points.error(), axis=1) / MM
    assert len(size) == len(reported) == 390
    for k, row in enumerate(scene.points.pose):
        key = (str(scene.pose_ids[row]), names[scene.points.target[k]])
        assert size[k] == pytest.approx(reported[key], abs=1e-5), key
    evaluated = irbcal.evaluate(saved, remembering / "m.csv", include_fitted=True).calibrated
    assert size.mean() == pytest.approx(evaluated["mean_mm"], abs=1e-9)
    moved = scene.effective - saved.robot_calibrated().joint_map.effective(scene.q)
    assert np.degrees(np.abs(moved)).max() > 0.002
    assert scene.notes[-1].startswith("The robot is drawn from its URDF") or any(
        "frame terms" in n for n in scene.notes
    )


def test_intervals_of_the_shown_points_are_those_of_predict(remembering):
    saved = irbcal.load(remembering / "cal")
    robot = saved.robot_calibrated()
    scene = building.view(remembering / "cal", remembering / "m.csv").scene
    mine = scene.points.target == 1
    rows = scene.points.pose[mine]
    before = np.concatenate([[np.full(6, np.nan)], scene.q[:-1]])
    expected = robot.predict(scene.q[rows], before[rows], list(scene.targets)[1]).interval.max(axis=1)
    np.testing.assert_allclose(scene.points.u95[mine], expected, rtol=0, atol=1e-7)
    size = np.abs(scene.points.error()).max(axis=1)
    assert 0.8 < np.mean(size < scene.points.u95) <= 1.0
    planned = building.view(remembering / "cal", plan=scene.q[:5]).scene.points
    expected = robot.predict(scene.q[:5], None, list(scene.targets)[1]).interval.max(axis=1)
    np.testing.assert_allclose(planned.u95[planned.target == 1], expected, rtol=0, atol=1e-12)
    assert building.view("irb120", plan=scene.q[:5]).scene.points.u95 is None


def test_meshes_stand_where_the_urdf_puts_them(packages):
    visual = (
        '<visual><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry>'
        '<mesh filename="package://my_robot/meshes/part.stl" scale="0.2 0.4 0.6"/></geometry>'
        '<material name="red"><color rgba="1 0 0 1"/></material></visual>'
    )
    found, notes = looks(visual, packages, [packages])
    assert notes == []
    assert list(found) == [0]
    np.testing.assert_allclose(found[0].vertices.min(axis=0), [1 - 0.2, 2 - 0.1, 3 - 0.3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[0].vertices.max(axis=0), [1 + 0.2, 2 + 0.1, 3 + 0.3], rtol=0, atol=1e-6)
    assert (found[0].colours == [255, 0, 0]).all()


@pytest.mark.parametrize(
    "visual",
    [
        "<visual/>",
        "<visual><geometry/></visual>",
        '<visual><geometry><box size="1 2"/></geometry></visual>',
        '<visual><geometry><cylinder radius="1"/></geometry></visual>',
        '<visual><geometry><sphere radius="nan"/></geometry></visual>',
        "<visual><geometry><teapot/></geometry></visual>",
        '<visual><origin xyz="a b c"/><geometry><sphere radius="1"/></geometry></visual>',
    ],
)
def test_visuals_that_make_no_sense_are_noted(visual, tmp_path):
    found, notes = looks(visual, tmp_path)
    assert len(notes) == 1
    assert 0 in found


def test_a_robot_without_looks_is_drawn_as_rods(tmp_path):
    found, notes = looks("", tmp_path)
    assert notes == []
    assert set(found) == set(range(7))


def test_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "MAX_TRIANGLES", 10)
    write_stl(tmp_path / "part.stl", shapes.box([1, 1, 1]))
    assert "more than 10 triangles" in looks(mesh("part.stl"), tmp_path)[1][0]
