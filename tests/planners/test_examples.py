"""The examples for planners, and the proof on simulated robots that planning on the calibrated model pays."""

import importlib
import runpy
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support import random_robot

import irbcal
from irbcal.io import robots, urdf
from irbcal.modeling import frames
from irbcal.planners.calibrated_model import CalibratedModel
from irbcal.units import DEG, MM

EXAMPLES = Path(__file__).parents[2] / "scripts" / "examples"
PLANNERS = ("inverse_kinematics_with_pink", "reach_a_pose_with_crocoddyl", "optimal_motion_with_casadi")
COLLISIONS = "check_collisions_with_coal"
OMPL = "plan_around_a_post_with_ompl"
NEEDS = {PLANNERS[0]: "pink", PLANNERS[1]: "crocoddyl", PLANNERS[2]: "casadi", COLLISIONS: "coal", OMPL: "ompl"}


@pytest.fixture(scope="module")
def examples():
    """Imports an example by name, as its neighbours do when it is run as a script."""
    sys.path.insert(0, str(EXAMPLES))

    def load(name):
        if name in NEEDS:
            pytest.importorskip(NEEDS[name], reason=f"the example {name} needs the package {NEEDS[name]}")
        return importlib.import_module(name)

    yield load
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def demo(examples, tmp_path_factory):
    """The calibration folder of the shipped simulated robot."""
    return examples("virtual_robot").make_demo(tmp_path_factory.mktemp("demo"))


@pytest.mark.parametrize("name", PLANNERS)
def test_planned_commands_are_as_good_as_the_calibration_on_the_simulated_robot(examples, demo, name, capsys):
    """The hidden truth of the demo moves the reflector; goals are in the tracker's frame."""
    misses = examples(name).main(demo)
    calibration = irbcal.load(demo)
    heldout, nominal = calibration.record.heldout.all, calibration.record.heldout_nominal.all
    assert misses["calibrated"].mean() < 2.0 * heldout.mean_mm
    assert misses["calibrated"].max() < heldout.max_mm
    assert misses["nominal"].mean() > 0.7 * nominal.mean_mm
    assert misses["nominal"].mean() > 8 * misses["calibrated"].mean()
    said = capsys.readouterr().out
    for side in ("nominal", "calibrated"):
        assert f"{misses[side].mean():.3f} mm on average, {misses[side].max():.3f} mm at most" in said


@pytest.mark.parametrize("name", PLANNERS)
def test_a_planner_reaches_the_pose_of_a_robot_that_is_known_exactly(examples, name):
    """Another simulated level-34 robot: with its true errors the pose is met, with the nominal URDF it is not."""
    found = urdf.read("irb1600")
    robot = random_robot(found.arm, "34", np.random.default_rng(11), size=0.6)
    tool = {"tcp": frames.transform(frames.rot_y(0.4), [0.02, -0.05, 0.16])}
    known = CalibratedModel(urdf.to_bytes(found, robot.arm), robot.arm, robot.joint_map, tool)
    nominal = CalibratedModel(robots.robot_file("irb1600").read_bytes(), found.arm, tip_frames=tool)
    home = np.array([0, -14, 14, 0, 30, 0])
    q = (home + np.random.default_rng(12).uniform(-25, 25, (3, 6))) * DEG
    goals = robot.poses(q) @ tool["tcp"]
    plan = examples(name).plan
    reached, missed = (robot.poses(plan(model, "tcp", goals)[:, 1]) @ tool["tcp"] for model in (known, nominal))

    def misses(T):
        return np.linalg.norm(T[:, :3, 3] - goals[:, :3, 3], axis=1)

    assert misses(reached).max() < 0.001 * MM
    assert frames.rotation_distance(reached[:, :3, :3], goals[:, :3, :3]).max() < 1e-6
    assert misses(missed).min() > 0.3 * MM


def test_the_motion_is_smooth_and_within_limits(examples, demo_calibration):
    """It starts and ends at rest, and each step follows from the one before by a bounded acceleration.

    With backlash the commands would jump where joints turn back, so the robot is one of level 34.
    """
    example = examples("reach_a_pose_with_crocoddyl")
    model = CalibratedModel.load(demo_calibration)
    goal = model.placement(np.radians([[20, 5, -10, 30, 40, -50]]), "target_smr1", "universe")[0]
    q = example.motion(model, "target_smr1", goal)
    assert q.shape == (example.NODES + 1, 6)
    speed = np.diff(q, axis=0) / example.STEP
    assert np.abs(speed[[0, -1]]).max() < 0.1 * np.abs(speed).max()
    assert np.abs(np.diff(speed, axis=0)).max() / example.STEP < 10.0
    assert not model.beyond_limits(q).any()
    T = model.placement(q[-1:], "target_smr1", "universe")[0]
    assert np.linalg.norm(T[:3, 3] - goal[:3, 3]) < 0.001 * MM


def test_optimal_motions_keep_to_limits_between_their_nodes(examples, demo):
    """Speeds and accelerations of the commands, as a controller interpolates them; at rest at both ends."""
    example = examples(PLANNERS[2])
    model = CalibratedModel.load(demo)
    q = np.radians([[20, 5, -10, 30, 40, -50], [-30, -25, 20, 0, 60, 20]])
    for motion in example.motions(model, "target_smr1", model.placement(q, "target_smr1", "universe")):
        dense = motion.dense(50)
        assert np.abs(dense.ddq).max() <= 1.02 * example.ACCELERATION + 1e-6
        assert (np.abs(dense.dq) <= model.speed_limits + 1e-9).all()
        assert not model.beyond_limits(dense.q).any()
        assert np.abs(motion.dq[[0, -1]]).max() < 1e-9
        assert np.abs(np.gradient(dense.q, dense.times, axis=0) - dense.dq)[1:-1].max() < 1e-3


def test_a_way_around_the_post_touches_nothing_and_ends_where_it_should(examples, demo, capsys):
    found, misses = examples(OMPL).main(demo, n=2)
    for q, distances in found:
        assert not distances.collisions()
        assert distances.closest_to("post")[0] > 0.0
        assert np.abs(np.diff(q, axis=0)).max() < 0.3
    calibration = irbcal.load(demo)
    assert misses["calibrated"].max() < calibration.record.heldout.all.max_mm
    assert misses["nominal"].mean() > 2 * misses["calibrated"].mean()
    assert "commands around the post" in capsys.readouterr().out


def test_collisions_and_clearance(examples, demo, capsys):
    """The straight way runs into the post, the other does not; distances hold against the solids' own corners."""
    example = examples(COLLISIONS)
    found = example.main(demo)
    said = capsys.readouterr().out
    assert "path 'straight': " in said
    hit = found["straight"].collisions()
    assert hit
    assert all("post" in pair for pair in hit)
    assert not found["drawn back"].collisions()

    model = CalibratedModel.load(demo)
    geometry = example.solids(model)
    for pair in geometry.collisionPairs:
        joints = sorted(geometry.geometryObjects[k].parentJoint for k in (pair.first, pair.second))
        assert joints[1] - joints[0] > 1
    box, T_universe_post = example.post_under(model)
    metres, step, (name, _) = found["drawn back"].closest_to("post")
    configuration = model.model_from_command(example.paths(model)["drawn back"])[step]
    data, placed = model.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model.model, data, geometry, placed, configuration)
    number = geometry.getGeometryId(name)
    corners = geometry.geometryObjects[number].geometry.points()
    T = frames.inverse(T_universe_post) @ placed.oMg[number].homogeneous
    outside = np.maximum(np.abs(corners @ T[:3, :3].T + T[:3, 3]) - np.ravel(box.halfSide), 0.0)
    nearest_corner = np.linalg.norm(outside, axis=1).min()
    assert 0.0 < metres <= nearest_corner + 1e-9
    assert nearest_corner < metres + 0.05


def test_an_example_runs_as_a_script(examples, demo, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [COLLISIONS, str(demo)])
    runpy.run_path(str(EXAMPLES / f"{COLLISIONS}.py"), run_name="__main__")
    assert "nearest to the post" in capsys.readouterr().out
