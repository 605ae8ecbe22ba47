"""The model for planners: against Pinocchio and central differences."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from history_cases import sided_robot
from support import arm, assert_derivative, assert_same_poses, example_robot, motions
from thesis_formula import ThesisMap

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.io import robots, urdf
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.planners.calibrated_model import CalibratedModel, previous_on_path
from irbcal.units import DEG

FRAMES = ("tool0", "target_smr1", "link_4", "joint_3", "base_link")


def test_tip_is_where_irbcal_says(cell):
    robot, model = cell
    q, _ = motions(robot, 200)
    assert_same_poses(model.placement(q), robot.poses(q), 1e-12, 1e-12)
    assert_same_poses(model.placement(q, relative_to="universe"), robot.T_world_base @ robot.poses(q), 1e-12, 1e-12)
    assert_same_poses(model.T_universe_base, robot.T_world_base, 1e-12, 1e-12)


@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_is_where_pinocchio_says(cell, frame):
    robot, model = cell
    q, _ = motions(robot, 20)
    data = model.model.createData()
    number, base = model.model.getFrameId(frame), model.model.getFrameId("base_link")
    expected = []
    for configuration in model.model_from_command(q):
        pin.framesForwardKinematics(model.model, data, configuration)
        expected.append((data.oMf[base].inverse() * data.oMf[number]).homogeneous)
    assert_same_poses(model.placement(q, frame), expected, 1e-12, 1e-12)
    assert_same_poses(frames.inverse(model.placement(q, "base_link", frame)), expected, 1e-12, 1e-12)


def test_configurations_hold_effective_joints(cell):
    robot, model = cell
    q, _ = motions(robot, 5)
    columns = [model.model.joints[model.model.getJointId(name)].idx_q for name in robot.arm.joint_names]
    assert np.array_equal(model.model_from_command(q)[:, columns], robot.joint_map.effective(q))


@pytest.mark.parametrize("frame", ["tool0", "link_4"])
def test_batch_is_its_poses_one_by_one(cell, frame):
    robot, model = cell
    q, dq = motions(robot, 7)
    configurations = model.model_from_command(q)
    batch = (
        model.placement(q, frame),
        model.jacobian(q, frame),
        model.jacobian_derivative(q, dq, frame),
        model.velocity_command(configurations, dq),
        model.command_from_model(configurations),
    )
    for k in range(len(q)):
        one, speed, configuration = q[k : k + 1], dq[k : k + 1], configurations[k : k + 1]
        single = (
            model.placement(one, frame),
            model.jacobian(one, frame),
            model.jacobian_derivative(one, speed, frame),
            model.velocity_command(configuration, speed),
            model.command_from_model(configuration),
        )
        for a, b in zip(batch, single, strict=True):
            assert np.abs(a[k] - b[0]).max() < 1e-13
    assert model.jacobian(np.zeros((0, 6)), frame).shape == (0, 6, 6)
    assert model.placement(np.zeros((0, 6)), frame).shape == (0, 4, 4)


def test_commands_come_back_from_configurations(cell):
    robot, model = cell
    q, _ = motions(robot, 500)
    assert np.abs(model.command_from_model(model.model_from_command(q)) - q).max() < 1e-13


def test_speed_commands_are_the_rate_of_the_commands(cell):
    robot, model = cell
    q, v = motions(robot, 10)
    configurations = model.model_from_command(0.9 * q)
    found = model.velocity_command(configurations, v)
    for k in range(len(q)):

        def along(t, k=k):
            return model.command_from_model(configurations[k] + t[0] * v[k])[0]

        assert_derivative(along, [0.0], found[k], 1e-11)


def test_model_limits_keep_commands_within_the_controllers(cell):
    """Random and extreme configurations within the model's limits; the limits lose less than half a degree."""
    robot, model = cell
    lower, upper = model.model.lowerPositionLimit, model.model.upperPositionLimit
    share = np.clip(np.random.default_rng(6).uniform(-0.5, 1.5, (5000, 6)), 0, 1)
    q = model.command_from_model(lower + share * (upper - lower))
    assert not model.beyond_limits(q)[np.abs(model.beyond_limits(q)) > 1e-9].any()
    ends = robot.joint_map.effective(np.array([robot.arm.lower, robot.arm.upper]))
    assert np.abs(ends - [lower, upper]).max() < 2 * abs(ThesisMap.from_joint_map(robot.joint_map).stiffness[1]) + 1e-12


def test_commands_beyond_a_limit_are_refused_by_name(cell):
    model = cell[1]
    q = np.zeros((3, 6))
    q[1:, 4] = [116 * DEG, -117.5 * DEG]
    configurations = model.model_from_command(q)
    with pytest.raises(CalibrationError, match=r"row 2 commands joint_5 to 116 degrees.*-115 to 115.*2 of 3 rows"):
        model.command_from_model(configurations)
    free = model.command_from_model(configurations, check_limits=False)
    beyond = model.beyond_limits(free)
    assert np.abs(beyond[:, 4] - [0, 1 * DEG, -2.5 * DEG]).max() < 1e-12
    assert np.count_nonzero(beyond) == 2


def assert_agrees_with_pinocchio(model, q, dq, rest):
    """Placements, Jacobians and their derivatives of the tip for commands (n, joints), extra joints at rest."""
    data, tip = model.model.createData(), model.model.getFrameId(model.arm.tip_link)
    columns = [model.model.joints[model.model.getJointId(name)].idx_v for name in model.arm.joint_names]
    J, dJ = model.jacobian(q), model.jacobian_derivative(q, dq)
    T = model.placement(q, relative_to="universe")
    M, dM = model.joint_map.jacobian(q), model.joint_map.jacobian_derivative(q, dq)
    for k, configuration in enumerate(model.model_from_command(q, rest)):
        v = np.zeros(model.model.nv)
        v[columns] = M[k] @ dq[k]
        pin.computeJointJacobiansTimeVariation(model.model, data, configuration, v)
        pin.updateFramePlacements(model.model, data)
        assert_same_poses(data.oMf[tip].homogeneous, T[k], 1e-12, 1e-12)
        expected, rate = (
            function(model.model, data, tip, pin.LOCAL_WORLD_ALIGNED)[:, columns]
            for function in (pin.getFrameJacobian, pin.getFrameJacobianTimeVariation)
        )
        assert np.abs(J[k] - expected @ M[k]).max() < 1e-12
        assert np.abs(dJ[k] - (rate @ M[k] + expected @ dM[k])).max() < 1e-11


def test_continuous_joints(kinova):
    assert kinova.model.nq == 6 + 3
    q, dq = motions(kinova, 50)
    assert_agrees_with_pinocchio(kinova, q, dq, kinova.rest)
    assert (
        np.abs(kinova.command_from_model(kinova.model_from_command(0.99 * q), check_limits=False) - 0.99 * q).max()
        < 1e-13
    )


def test_a_path_of_continuous_joints_goes_on_turning(kinova):
    way = np.array([3.0, 0.5, 0.2, -8.0, 0.5, 20.0])
    q = np.array([0, 2.0, 3.0, 0, 1.0, 0]) + np.linspace(0, 1, 200)[:, None] * way
    configurations = kinova.model_from_command(q)
    assert np.abs(kinova.command_from_model(configurations, path=True) - q).max() < 1e-12
    assert np.abs(kinova.command_from_model(configurations)[:, [0, 3, 5]]).max() < 1.01 * np.pi


def test_seven_joints_and_a_gripper():
    """Fingers stay where they are told; the joint map of such an arm has gains alone."""
    path = example_robot("panda_description/urdf/panda.urdf")
    found = urdf.read(path, tip_link="panda_hand")
    gain = 1e-3 * np.arange(1, 8)
    model = CalibratedModel(path.read_bytes(), found.arm, ThesisMap(gain=gain).joint_map(found.arm))
    q, dq = motions(model, 20)
    rest = np.array(model.rest)
    rest[-2:] = 0.01, 0.03
    configurations = model.model_from_command(q, rest)
    assert np.abs(configurations[:, :7] - q * (1 + gain)).max() < 1e-15
    assert np.array_equal(configurations[:, 7:], np.tile([0.01, 0.03], (20, 1)))
    assert np.abs(model.command_from_model(configurations, check_limits=False) - q).max() < 1e-13
    assert_agrees_with_pinocchio(model, q, dq, rest)
    opened = replace(model, rest=rest).placement(q, "panda_leftfinger", "panda_hand")
    closed = model.placement(q, "panda_leftfinger", "panda_hand")
    assert np.abs(np.linalg.norm((opened - closed)[:, :3, 3], axis=1) - 0.01).max() < 1e-12
    with pytest.raises(RobotError, match="six revolute"):
        model.with_payload(1.0)


def test_a_joint_that_slides():
    """The IRB 1600 with its first joint turned into a slide along z."""
    content = robots.robot_file("irb1600").read_bytes()
    content = content.replace(b'name="joint_1" type="revolute"', b'name="joint_1" type="prismatic"')
    found = urdf.from_bytes(content, "slide.urdf")
    model = CalibratedModel(content, found.arm, ThesisMap(gain=1e-3 * np.arange(1, 7)).joint_map(found.arm))
    q, dq = motions(model, 20)
    assert_agrees_with_pinocchio(model, q, dq, model.rest)
    q[3, 0] = 3.5
    with pytest.raises(CalibrationError, match=r"row 4 commands joint_1 to 3500 mm, outside its limits -3141\.59 to"):
        model.check_commands(q)


def test_wrong_input_is_refused_in_one_sentence(cell):
    robot, model = cell
    other = urdf.to_bytes(urdf.read("irb1600"), arm())
    q = np.zeros((1, 6))
    for call, words in (
        (lambda: CalibratedModel(other, robot.arm, robot.joint_map), "not that of the calibrated irb1600"),
        (lambda: CalibratedModel(b"<robot/>", robot.arm), "Pinocchio cannot read"),
        (lambda: CalibratedModel(other, arm("irb120")), "not that of the calibrated irb120"),
        (lambda: CalibratedModel(other, replace(arm(), joint_names=tuple("abcdef"))), "no joint 'a'"),
        (lambda: CalibratedModel(other, arm(), rest=[0.0]), r"needs shape \(6,\), found \(1,\)"),
        (lambda: model.placement(q, "gripper"), "no frame 'gripper'; frames are universe"),
        (lambda: model.jacobian(q, reference="BODY"), "unknown reference frame 'BODY'"),
        (lambda: model.command_from_model(np.zeros((2, 5))), r"configurations .* shape \(n, 6\), found \(2, 5\)"),
        (lambda: model.velocity_command(q, np.zeros((1, 3))), "velocities"),
    ):
        with pytest.raises(CalibrationError, match=words):
            call()


def test_model_of_a_calibration_folder(tmp_path):
    calibration = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", "34")
    calibration.save(tmp_path)
    model = CalibratedModel.load(tmp_path)
    robot = calibration.validated.fit.robot
    q, _ = motions(robot, 50)
    T = robot.T_world_base @ model.placement(q, "target_smr2")
    assert np.abs(T[:, :3, 3] - robot.points(q, "smr2")).max() < 1e-12
    loaded = model.with_payload(3.0)
    assert (
        ThesisMap.from_joint_map(loaded.joint_map).stiffness > ThesisMap.from_joint_map(model.joint_map).stiffness
    ).all()
    moved = loaded.placement(q)[:, :3, 3] - model.placement(q)[:, :3, 3]
    assert 0.1e-3 < np.linalg.norm(moved, axis=1).max() < 0.6e-3
    assert_same_model(CalibratedModel.load(irbcal.load(tmp_path)), model, q)  # the IRB 1600's URDF can be made again
    foreign = irbcal.load(tmp_path).record
    foreign = foreign.model_copy(update={"robot": foreign.robot.model_copy(update={"urdf_sha256": "0" * 64})})
    with pytest.raises(CalibrationError, match="does not hold the robot's URDF: give its folder"):
        CalibratedModel.load(foreign)
    with pytest.raises(CalibrationError, match="not a calibration folder"):
        CalibratedModel.load(tmp_path / "nothing")


def assert_same_model(found, expected, q):
    assert_same_poses(found.placement(q), expected.placement(q), 1e-12, 1e-12)
    assert found.model.nq == expected.model.nq
    assert list(found.tip_frames) == list(expected.tip_frames)
    name = next(iter(expected.tip_frames), expected.arm.tip_link)
    assert_same_poses(found.placement(q, name), expected.placement(q, name), 1e-12, 1e-12)


@pytest.mark.parametrize("name", ["cell", "kinova"])
def test_models_can_be_pickled(name, request):
    model = request.getfixturevalue(name)
    model = model[1] if name == "cell" else model
    again = pickle.loads(pickle.dumps(model))
    q, _ = motions(model, 10)
    assert_same_model(again, model, q)
    np.testing.assert_allclose(again.rest, model.rest, rtol=0, atol=0)


def test_models_cannot_be_changed(cell):
    model = cell[1]
    for array in (model.rest, model.T_universe_base, model.tip_frames["target_smr1"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError, match="cannot be changed"):
        model.tip_frames["other"] = np.eye(4)


def test_what_a_model_says_of_itself(cell, kinova):
    said = cell[1].summary()
    for words in ("tool0 in base_link", "12 terms (gain, thesis)", "frames on the tool: target_smr1", "joint_6", "deg"):
        assert words in said
    assert "–" in kinova.summary(), "continuous joints have no limits"
    for model in (cell[1], kinova):
        assert repr(model).startswith(f"<CalibratedModel: {model.arm.name}, 6 revolute joints")
        assert len(repr(model)) < 500
        assert "<table>" in model._repr_html_()
        limits = json.loads(json.dumps(model.to_dict()))["limits"]
        known = np.isfinite(model.arm.lower)
        assert [value is not None for value in limits["lower"]] == known.tolist()
        np.testing.assert_allclose(model.to_frame()["lower"][known], np.degrees(model.arm.lower[known]), atol=1e-9)


def test_a_damaged_urdf_is_refused_in_one_sentence(cell, capfd):
    """The C++ reader of URDF prints lines besides."""
    damaged = urdf.to_bytes(urdf.read("irb1600"), arm()).replace(b'rpy="0', b'rpy="zero')
    with pytest.raises(CalibrationError, match="Pinocchio cannot read"):
        CalibratedModel(damaged, arm())
    assert capfd.readouterr().err == ""


def test_degrees_are_refused(cell):
    model = cell[1]
    q = np.array([[0, -14, 14, 0, 30, 0.0]])
    for call in (model.placement, model.jacobian, model.model_from_command, model.check_commands, model.beyond_limits):
        with pytest.raises(RobotError, match="these look like degrees"):
            call(q)
    with pytest.raises(RobotError, match="these look like degrees"):
        model.jacobian_derivative(q, np.zeros((1, 6)))
    assert np.isfinite(model.jacobian_derivative(0.01 * q, np.full((1, 6), 200.0))).all(), "speeds may be any"


TURNS = np.zeros(6, dtype=bool)


@pytest.fixture(scope="module")
def sided():
    """A robot whose joints lean to the side that they come from, and its model."""
    robot = sided_robot(others=("gain", "gravity"))
    return robot, CalibratedModel(urdf.to_bytes(urdf.read("irb120"), robot.arm), robot.arm, robot.joint_map)


def there_and_back():
    """Joints 1 and 2 there and back in steps of half a degree, joint 3 there only; the others stand."""
    theta = np.zeros((81, 6))
    theta[:, 0] = np.r_[np.arange(41), np.arange(39, -1, -1)] * 0.5 * DEG
    theta[:, 1] = 0.5 * theta[:, 0]
    theta[:, 2] = np.arange(81) * 0.25 * DEG
    theta[:, 4] = 0.5
    return theta


def test_moves_have_the_signs_of_joint_speeds_whatever_the_steps():
    theta = there_and_back()
    fine = np.repeat(theta, 3, axis=0)  # the arm waits at each point
    for path, every in ((theta, 1), (fine, 3)):
        move = path - previous_on_path(path, TURNS)
        assert np.isnan(move[:every]).all()
        for part, sign in ((move[every : 41 * every], 1.0), (move[41 * every :], -1.0)):
            assert part[:, 0] == pytest.approx(sign * 5 * DEG)
            assert part[:, 1] == pytest.approx(sign * 2.5 * DEG)
            assert part[:, 2] == pytest.approx(2.5 * DEG)
            assert not part[:, 3:].any()


def test_long_steps_are_moves_as_they_are_and_prismatic_joints_count_in_metres():
    theta = np.array([[0.0, 0.0], [1.0, 0.2], [1.0, 0.21]])
    move = theta - previous_on_path(theta, np.array([False, True]))
    assert move[1] == pytest.approx([1.0, 0.2])
    assert move[2] == pytest.approx([0.0, 0.05])


def test_commands_of_a_path_know_the_sides(sided):
    robot, model = sided
    theta = there_and_back()
    q = model.command_from_model(theta, path=True)
    previous = previous_on_path(theta, TURNS)
    assert_same_poses(model.placement(q, previous=previous), robot.arm.forward(theta), 1e-12, 1e-12)
    single = model.command_from_model(theta)
    assert np.abs(q[0] - single[0]).max() < 1e-13
    assert np.abs(model.placement(single, previous=previous) - robot.arm.forward(theta))[1:, :3, 3].max() > 3e-5
    side = robot.joint_map.history_std[0]
    assert np.abs(q[20] - q[60])[0] > 0.2 * side  # joint 1 comes from the other side


def test_jacobians_know_the_side(sided):
    robot, model = sided
    q, previous = (robot.arm.random_joints(1, seed) for seed in (1, 2))
    J = model.jacobian(q, previous=previous)[0, :3]
    place = lambda x: model.placement(x[None], previous=previous)[0, :3, 3]  # noqa: E731
    assert_derivative(place, q[0], J, 1e-9, step=1e-4)
    near = q - DEG * np.array([0.1, -0.2, 0.3, 0.15, 0.25, -0.05])  # where the side just changes, its slope matters
    J = model.jacobian(q, previous=near)[0, :3]
    place = lambda x: model.placement(x[None], previous=near)[0, :3, 3]  # noqa: E731
    assert_derivative(place, q[0], J, 1e-6, step=1e-5)
    assert np.abs(J - model.jacobian(q)[0, :3]).max() > 1e-4


def test_commands_within_the_models_limits_respect_those_of_the_robot(sided):
    robot, model = sided
    rng = np.random.default_rng(4)
    lower, upper = model.model.lowerPositionLimit, model.model.upperPositionLimit
    corners = np.where(rng.random((200, 6)) < 0.5, lower, upper)
    q = robot.joint_map.commanded(corners, rng.permutation(corners))
    assert not model.beyond_limits(q).any()
    assert not model.beyond_limits(model.command_from_model(corners)).any()


def gravity(model, configurations):
    """Moments of gravity about joints 2 and 3 by Pinocchio, (n, 2): what the joints give way to."""
    data = model.createData()
    return -np.array([pin.computeGeneralizedGravity(model, data, configuration) for configuration in configurations])[
        :, 1:3
    ]


def test_stiffness_terms_are_gravity_on_two_links():
    """A chain of two point masses at the thesis's levers, the forearm horizontal at zero (Figure 5.3)."""
    upper_kg, fore_kg, payload_kg = 20.0, 26.0, 3.0
    L_1, L_G1, L_G2, L_P, compliance = 0.7, 0.31, 0.42, 0.74, 3e-6
    model = pin.Model()
    shoulder = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "shoulder")
    elbow = model.addJoint(shoulder, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0, 0, L_1])), "elbow")

    def mass(kg, place):
        return pin.Inertia(kg, np.array(place, dtype=float), np.zeros((3, 3)))

    model.appendBodyToJoint(shoulder, mass(upper_kg, [0, 0, L_G1]), pin.SE3.Identity())
    model.appendBodyToJoint(elbow, mass(fore_kg, [L_G2, 0, 0]), pin.SE3.Identity())
    loaded_model = model.copy()
    loaded_model.appendBodyToJoint(elbow, mass(payload_kg, [L_P, 0, 0]), pin.SE3.Identity())
    k = compliance * 9.81
    stiffness = Stiffness(1.0, L_G1, 0.1, fore_kg / upper_kg, L_1, 0.6).with_coefficients(
        k * (upper_kg * L_G1 + fore_kg * L_1), k * fore_kg * L_G2
    )
    q = np.zeros((40, 6))
    q[:, 1:3] = np.random.default_rng(8).uniform(-3, 3, (40, 2))
    for pinocchio, now in ((model, stiffness), (loaded_model, stiffness.with_payload(payload_kg, L_P, upper_kg))):
        data = pinocchio.createData()
        torque = -np.array([pin.computeGeneralizedGravity(pinocchio, data, row) for row in q[:, 1:3]])
        change = ThesisMap(stiffness=now.coefficients).effective(q) - q
        assert np.abs(change[:, 1:3] - compliance * torque).max() < 1e-15


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
@pytest.mark.parametrize(
    ("place", "wrist"), [(None, None), ((0.0, 0.0, 0.06), (0, 0, 0)), ((0.05, -0.02, 0.1), (0.4, 1.2, -0.7))]
)
def test_payload_moves_the_joints_as_gravity_on_the_urdfs_masses_does(name, place, wrist):
    """Pinocchio weighs the URDF's bodies with and without the payload; the joints give way in proportion."""
    nominal = arm(name)
    content = robots.robot_file(name).read_bytes()
    compliance = 2e-6
    bare = CalibratedModel(content, nominal)
    phases = nominal.stiffness_geometry()[0]
    theta = np.zeros((60, 6))
    theta[:, 1:3] = np.random.default_rng(9).uniform(-3, 3, (60, 2))
    theta[:, 3:] = 0.0 if wrist is None else wrist
    torque = gravity(bare.model, theta)
    angles = theta[:, 1], theta[:, 1] + theta[:, 2] + phases[1]
    waves = np.array([np.sin(angles[0]), np.cos(angles[0]), np.sin(angles[1]), np.cos(angles[1])]).T
    A, _, B, _ = compliance * np.linalg.lstsq(waves, torque[:, 0], rcond=None)[0]
    model = replace(bare, joint_map=ThesisMap(stiffness=[A, B], phases=phases).joint_map(nominal))
    heavier = model.model.copy()
    tip = heavier.frames[heavier.getFrameId("tool0")]
    point = tip.placement * np.array([0.0, 0, 0] if place is None else place)
    heavier.appendBodyToJoint(tip.parentJoint, pin.Inertia(3.0, point, np.zeros((3, 3))), pin.SE3.Identity())
    expected = compliance * (gravity(heavier, theta) - torque)
    loaded = model.with_payload(3.0, place, wrist)
    change = loaded.joint_map.effective(theta) - model.joint_map.effective(theta)
    assert np.abs(change[:, 1:3] - expected).max() < 1e-4 * np.abs(expected).max()
    assert not change[:, [0, 3, 4, 5]].any()
    lighter = loaded.with_payload(-3.0, place, wrist)
    assert loaded.model.nq == 6
    assert np.isfinite(ThesisMap.from_joint_map(lighter.joint_map).stiffness).all()


def test_payload_needs_masses_and_stiffness():
    nominal = arm()
    content = robots.robot_file("irb1600").read_bytes()
    with pytest.raises(RobotError, match="A > 0"):
        CalibratedModel(content, nominal).with_payload(1.0)
    weightless = content.replace(b"<inertial>", b"<nothing>").replace(b"</inertial>", b"</nothing>")
    model = CalibratedModel(weightless, nominal, ThesisMap(stiffness=[8e-4, 2e-4]).joint_map(nominal))
    with pytest.raises(RobotError, match="gives no masses"):
        model.with_payload(1.0)
    A, B = ThesisMap.from_joint_map(model.with_payload(2.0, masses=(25.0, 30.0)).joint_map).stiffness
    # by hand: k g = A / (25 0.35 + 30 0.7), the tool's origin 0.665 m along the forearm
    k_g = 8e-4 / (25 * 0.35 + 30 * 0.7)
    assert abs(A - (8e-4 + k_g * 2 * 0.7)) < 1e-15
    assert abs(B - (2e-4 + k_g * 2 * 0.665)) < 1e-15


def test_a_sum_of_terms_changes_its_load():
    nominal = arm()
    place = np.array([0.0, 0.05, 0.1])
    terms = Payload(place).terms(nominal)
    joint_map = JointMap(TermMap(nominal, tuple(terms), np.linspace(1e-6, 6e-6, 6)), None, 2.0)
    model = CalibratedModel(robots.robot_file("irb1600").read_bytes(), nominal, joint_map)
    q, more = nominal.random_joints(30, 1), np.array([0.2, 0.0, -0.1])
    added = TermMap(nominal, tuple(Payload(more).terms(nominal)), np.linspace(1e-6, 6e-6, 6))
    whole = joint_map.effective(q) + added.effective(Motion(q, inputs={"payload_kg": np.full(30, 3.0)})) - q
    loaded = model.with_payload(3.0, more)
    assert np.abs(loaded.joint_map.effective(q) - whole).max() < 1e-14
    assert np.abs(loaded.command_from_model(loaded.model_from_command(q)) - q).max() < 1e-12
    back = loaded.with_payload(-3.0, more).joint_map
    assert np.abs(back.effective(q) - joint_map.effective(q)).max() < 1e-14
    same_place = model.with_payload(3.0).joint_map
    assert np.array_equal(same_place.effective(q), joint_map.carrying(5.0).effective(q))
    assert not (model.with_payload(-2.0).joint_map.effective(q) - q).any()
    with pytest.raises(RobotError, match="measured with 2 kg"):
        model.with_payload(-2.5)
