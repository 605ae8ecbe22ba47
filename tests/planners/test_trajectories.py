"""A planner's trajectories: there and back, derivatives, limits along the way, torques against Pinocchio's energy."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from history_cases import sided_robot
from scipy.interpolate import CubicSpline
from support import arm, central_differences, random_robot

from irbcal.errors import CalibrationError, RobotError
from irbcal.io import robots, urdf
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.trajectory import Trajectory
from irbcal.planners.calibrated_model import CalibratedModel

SPEEDS = np.array([1.0, 1.3, 0.7, 2.1, 1.7, 0.4])


def model_of(name, joint_map):
    found = urdf.read(name)
    return CalibratedModel(robots.robot_file(name).read_bytes(), found.arm, joint_map)


def loaded_map(name="irb1600"):
    """Gains, gears, gravity and a payload of 4 kg with natural sizes."""
    nominal = arm(name)
    terms = [t for f in ("gain", "gravity", "payload") for t in families()[f].terms(nominal)]
    terms += pair(3, 242, "rz", 5e-5, "gear", "gear")
    values = np.random.default_rng(4).standard_normal(len(terms)) * [t.size for t in terms]
    return JointMap(TermMap(nominal, tuple(terms), values), payload_kg=4.0)


@pytest.fixture(scope="module")
def models(kinova):
    """Of each kind of joint map one model: the thesis's, terms with a payload, last moves, continuous joints."""
    sided = sided_robot(others=("gain", "harmonics", "gravity"))
    content = urdf.to_bytes(urdf.read("irb120"), sided.arm)
    return {
        "thesis": model_of("irb1600", random_robot(arm(), "34", np.random.default_rng(3), size=1.0).joint_map),
        "payload": model_of("irb1600", loaded_map()),
        "sides": CalibratedModel(content, sided.arm, sided.joint_map),
        "continuous": kinova,
    }


def swinging(model, n=1001, seconds=2.0, share=0.4, later=0.0):
    """A motion about the middle of the joints' ranges, of a share of the ranges, as it is a little later."""
    limited = model.arm
    lower, upper = (np.where(np.isfinite(v), v, s * 4.0) for v, s in ((limited.lower, -1), (limited.upper, 1)))
    t = np.linspace(0.0, seconds, n) + later
    phase, size = np.outer(t, SPEEDS) + np.arange(6), share * 0.5 * (upper - lower)
    q, dq = 0.5 * (lower + upper) + size * np.sin(phase), size * SPEEDS * np.cos(phase)
    return Trajectory(t, q, dq, -(SPEEDS**2) * size * np.sin(phase), limited.joint_names)


@pytest.mark.parametrize("name", ["thesis", "payload", "sides", "continuous"])
def test_there_and_back_is_the_same(models, name):
    """Commands to Pinocchio's configurations, velocities and accelerations, and from those to commands."""
    model = models[name]
    commands = swinging(model)
    effective = model.model_trajectory(commands)
    back = model.command_trajectory(effective).trajectory
    planned = model.trajectory(commands.times, *model.configurations(effective))
    again = model.command_trajectory(replace(planned, lean=effective.lean)).trajectory
    turns = 2 * np.pi * np.round((again.q[0] - commands.q[0]) / (2 * np.pi))
    assert not turns[np.isfinite(model.arm.lower)].any()
    for one in ("q", "dq", "ddq"):
        assert np.abs(getattr(back, one) - getattr(commands, one)).max() < 1e-10
        if not turns.any():
            assert np.abs(getattr(again, one) - getattr(commands, one)).max() < 1e-10


@pytest.mark.parametrize("name", ["thesis", "payload", "continuous"])
def test_speeds_and_accelerations_are_central_differences_of_the_mapped_positions(models, name):
    """Of the map and of its inverse."""
    model, h = models[name], 5e-5
    for mapped, positions in (
        (model.model_trajectory, model.joint_map.effective),
        (lambda x: model.command_trajectory(x).trajectory, model.joint_map.commanded),
    ):
        given = swinging(model, n=101)
        found = mapped(given)
        far, behind, ahead, farther = (positions(swinging(model, n=101, later=k * h).q) for k in (-2, -1, 1, 2))
        speed = (8.0 * (ahead - behind) - (farther - far)) / (12.0 * h)
        bend = (16.0 * (ahead + behind) - (farther + far) - 30.0 * positions(given.q)) / (12.0 * h * h)
        assert np.abs(speed - found.dq).max() < 1e-8
        assert np.abs(bend - found.ddq).max() < 1e-4
        assert np.abs(found.ddq - given.ddq).max() > 1e-3


def test_where_joints_lean_speeds_and_accelerations_are_those_of_a_spline(models):
    model = models["sides"]
    commands = swinging(model, n=8001)
    for some in (model.model_trajectory(commands), model.command_trajectory(commands).trajectory):
        spline, inner = CubicSpline(some.times, some.q), slice(50, -50)
        off = [np.abs(spline(some.times, k) - v)[inner].max(axis=1) for k, v in ((1, some.dq), (2, some.ddq))]
        assert off[0].max() < 2e-4  # accelerations jump a little where a joint turns back
        assert np.percentile(off[0], 95) < 1e-5
        assert np.percentile(off[1], 95) < 5e-2
        assert np.abs(some.dq - commands.dq).max() > 1e-3


def test_sides_are_worked_out_by_both_directions_alike(models):
    """Commands of a planner's trajectory, followed with sides of the commands' own: the same motion."""
    model = models["sides"]
    effective = swinging(model)
    commands = model.command_trajectory(effective).trajectory
    fresh = replace(commands, lean=None)
    assert np.abs(model.model_trajectory(fresh).q - effective.q).max() < 2e-5
    assert np.abs(commands.q - model.joint_map.commanded(effective.q)).max() > 3e-4


def test_the_limits_of_commands_are_kept_or_named(models):
    """Commands at limits that just hold, then a little less: dense samples of the controller's own interpolation."""
    model = models["thesis"]
    effective = swinging(model, n=60)
    found = model.command_trajectory(effective)
    dense = found.trajectory.dense(100)
    fastest, hardest = np.abs(dense.dq).max(axis=0), np.abs(dense.ddq).max(axis=0)
    assert model.command_trajectory(effective, None, fastest * 1.001, hardest * 1.001).within
    assert model.speed_limits[0] == pytest.approx(np.radians(150), rel=1e-6) or np.isfinite(model.speed_limits).all()

    tight = fastest * 1.001
    tight[2] *= 0.9
    refused = model.command_trajectory(effective, None, tight, hardest * 1.001)
    (one,) = refused.exceeded
    k = np.abs(dense.dq[:, 2]).argmax()
    assert one[:2] == (model.arm.joint_names[2], "speed")
    assert one.time == pytest.approx(dense.times[k], abs=0.05)
    assert abs(one.value) == pytest.approx(fastest[2], rel=1e-3)
    slower = refused.in_time().dense(100)
    assert (np.abs(slower.dq) <= tight * (1 + 1e-6)).all()
    assert (slower.q >= model.arm.lower).all()
    assert (slower.q <= model.arm.upper).all()

    far = swinging(model, share=1.0005)
    beyond = model.command_trajectory(far, None, np.inf).exceeded
    assert {x.kind for x in beyond} == {"position"}
    assert all(abs(x.value) > abs(x.limit) for x in beyond)


def test_joints_are_found_by_name_and_others_left_out(models):
    model = models["thesis"]
    commands = swinging(model, n=30)
    names = [*reversed(model.arm.joint_names), "gripper"]
    wide = Trajectory(commands.times, np.column_stack([commands.q[:, ::-1], np.ones(30)]), names=tuple(names))
    assert np.array_equal(model.model_trajectory(wide).q, model.model_trajectory(commands).q)
    with pytest.raises(RobotError, match="the trajectory has no joint joint_1"):
        model.model_trajectory(Trajectory([0.0], np.zeros((1, 6)), names=tuple("abcdef")))
    with pytest.raises(CalibrationError, match=r"velocities of .* need shape"):
        model.trajectory([0.0], np.zeros((1, 6)), np.zeros((1, 5)))


def test_gravity_torques_are_the_slope_of_pinocchios_energy():
    """At effective joints, with a mass on the tool as a body of its own."""
    joint_map = random_robot(arm(), "34", np.random.default_rng(3), size=1.0).joint_map
    model = model_of("irb1600", joint_map)
    place, kg = np.array([0.05, -0.02, 0.2]), 6.0
    heavy = model.model.copy()
    tip = heavy.frames[heavy.getFrameId("tool0")]
    body = tip.placement.act(pin.Inertia(kg, place, np.zeros((3, 3))))
    heavy.appendBodyToJoint(tip.parentJoint, body, pin.SE3.Identity())
    q = model.arm.random_joints(5, 1)
    for row in q:
        theta = joint_map.effective(row[None])
        for some, mass, atol in ((model.model, 0.0, 1e-6), (heavy, kg, 0.02)):  # 9.81 here, 9.81 there
            data = some.createData()
            energy = lambda x: np.array([pin.computePotentialEnergy(some, data, x)])  # noqa: B023, E731
            slope = central_differences(energy, theta[0], 1e-4)[0]
            found = model.gravity_torques(row[None], payload_kg=mass, payload_centre=place)[0]
            assert found == pytest.approx(slope, abs=atol)
    assert (
        np.abs(
            model.gravity_torques(q) - replace(model, joint_map=JointMap.identity(model.arm)).gravity_torques(q)
        ).max()
        > 0.05
    )


def test_torques_without_inertials_are_refused():
    text = robots.robot_file("irb1600").read_text()
    bare = "".join(part.split("</inertial>")[-1] for part in text.split("<inertial>"))
    model = CalibratedModel(bare.encode(), arm())
    with pytest.raises(CalibrationError, match="no inertials for the links"):
        model.gravity_torques(np.zeros((1, 6)))
