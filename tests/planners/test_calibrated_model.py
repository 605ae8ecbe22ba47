"""The model for planners: against Pinocchio, central differences and torques of gravity."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from support import arm, assert_same_poses, central_differences, example_robot, outcome_of, random_robot

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.files import robots, urdf
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap, Stiffness
from irbcal.planners.calibrated_model import CalibratedModel
from irbcal.units import DEG

REFERENCES = (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED)
FRAMES = ("tool0", "target_smr1", "link_4", "joint_3", "base_link")
T_TIP_SMR1 = frames.transform(frames.rot_x(0.3) @ frames.rot_z(-1.1), [-0.087, 0.087, 0.11])


@pytest.fixture(scope="module")
def cell():
    """A simulated IRB 1600 with large errors, in a URDF whose root is a measuring frame far from the base."""
    found = urdf.read("irb1600")
    robot = random_robot(found.arm, "34", np.random.default_rng(3), size=1.0)
    robot = robot.replace(joint_map=replace(robot.joint_map, gain=1e-3 * np.arange(-2, 4)))
    content = urdf.to_bytes(found, robot.arm, robot.T_world_base)
    return robot, CalibratedModel(content, robot.arm, robot.joint_map, {"target_smr1": T_TIP_SMR1})


@pytest.fixture(scope="module")
def kinova():
    """A real URDF with three continuous joints, with simulated gains and joint-6 series."""
    path = example_robot("kinova_description/robots/kinova.urdf")
    found = urdf.read(path, tip="j2s6s200_end_effector")
    joint_map = JointMap(gain=1e-3 * np.arange(1, 7), fourier=[1e-3, -2e-3, 5e-4, 1e-3])
    return CalibratedModel(path.read_bytes(), found.arm, joint_map)


def motions(robot, n, seed=5):
    """Commands inside the limits and speeds, (n, 6) each."""
    q = robot.arm.random_joints(n, seed)
    return q, np.random.default_rng(seed).normal(size=q.shape)


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


def numeric_jacobian(model, q, frame, reference):
    """By central differences of placements in the universe, one pose; columns as Pinocchio defines its frames."""
    T = model.placement(q[None], frame, "universe")[0]
    R, p = T[:3, :3], T[:3, 3]
    rates = central_differences(lambda x: model.placement(x[None], frame, "universe")[0].ravel(), q, 1e-3)
    columns = []
    for dT in rates.T.reshape(6, 4, 4):
        spin = dT[:3, :3] @ R.T
        v, w = dT[:3, 3], np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        if reference == pin.WORLD:
            v = v - np.cross(w, p)
        if reference == pin.LOCAL:
            v, w = R.T @ v, R.T @ w
        columns.append(np.concatenate([v, w]))
    return np.array(columns).T


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
@pytest.mark.parametrize("frame", FRAMES)
def test_jacobian_agrees_with_central_differences_and_pinocchio(cell, frame, reference):
    robot, model = cell
    q, _ = motions(robot, 4)
    found = model.jacobian(q, frame, reference)
    assert np.array_equal(found, model.jacobian(q, frame, str(reference)))
    data, number = model.model.createData(), model.model.getFrameId(frame)
    M = robot.joint_map.jacobian(q)
    for k, configuration in enumerate(model.model_from_command(q)):
        assert np.abs(found[k] - numeric_jacobian(model, q[k], frame, reference)).max() < 1e-10
        J = pin.computeFrameJacobian(model.model, data, configuration, number, reference)
        assert np.abs(found[k] - J @ M[k]).max() < 1e-13


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
@pytest.mark.parametrize("frame", FRAMES)
def test_jacobian_derivative_agrees_with_central_differences(cell, frame, reference):
    robot, model = cell
    q, dq = motions(robot, 4)
    found = model.jacobian_derivative(q, dq, frame, reference)
    for k in range(len(q)):

        def along(t, k=k):
            return model.jacobian((q[k] + t[0] * dq[k])[None], frame, reference)[0].ravel()

        numeric = central_differences(along, [0.0], 1e-3)[:, 0].reshape(6, 6)
        assert np.abs(found[k] - numeric).max() < 1e-9


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
        numeric = central_differences(
            lambda t, k=k: model.command_from_model(configurations[k] + t[0] * v[k])[0], [0.0], 1e-3
        )
        assert np.abs(found[k] - numeric[:, 0]).max() < 1e-11


def test_model_limits_keep_commands_within_the_controllers(cell):
    """Random and extreme configurations within the model's limits; the limits lose less than half a degree."""
    robot, model = cell
    lower, upper = model.model.lowerPositionLimit, model.model.upperPositionLimit
    share = np.clip(np.random.default_rng(6).uniform(-0.5, 1.5, (5000, 6)), 0, 1)
    q = model.command_from_model(lower + share * (upper - lower))
    assert not model.beyond_limits(q)[np.abs(model.beyond_limits(q)) > 1e-9].any()
    ends = robot.joint_map.effective(np.array([robot.arm.lower, robot.arm.upper]))
    assert np.abs(ends - [lower, upper]).max() < 2 * abs(robot.joint_map.stiffness[1]) + 1e-12


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
    found = urdf.read(path, tip="panda_hand")
    gain = 1e-3 * np.arange(1, 8)
    model = CalibratedModel(path.read_bytes(), found.arm, JointMap(gain=gain))
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
    model = CalibratedModel(content, found.arm, JointMap(gain=1e-3 * np.arange(1, 7)))
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


def gravity(model, configurations):
    """Moments of gravity about joints 2 and 3 by Pinocchio, (n, 2): what the joints give way to."""
    data = model.createData()
    return -np.array([pin.computeGeneralizedGravity(model, data, configuration) for configuration in configurations])[
        :, 1:3
    ]


def test_stiffness_terms_are_gravity_on_two_links():
    """A chain of two point masses at the thesis's levers, the forearm horizontal at zero (figure 5.3)."""
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
        change = JointMap(stiffness=now.coefficients).effective(q) - q
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
    bare = CalibratedModel(content, nominal, JointMap(phases=nominal.stiffness_geometry()[0]))
    theta = np.zeros((60, 6))
    theta[:, 1:3] = np.random.default_rng(9).uniform(-3, 3, (60, 2))
    theta[:, 3:] = 0.0 if wrist is None else wrist
    torque = gravity(bare.model, theta)
    angles = theta[:, 1], theta[:, 1] + theta[:, 2] + bare.joint_map.phases[1]
    waves = np.array([np.sin(angles[0]), np.cos(angles[0]), np.sin(angles[1]), np.cos(angles[1])]).T
    A, _, B, _ = compliance * np.linalg.lstsq(waves, torque[:, 0], rcond=None)[0]
    model = replace(bare, joint_map=replace(bare.joint_map, stiffness=[A, B]))
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
    assert np.isfinite(lighter.joint_map.stiffness).all()


def test_payload_needs_masses_and_stiffness():
    nominal = arm()
    content = robots.robot_file("irb1600").read_bytes()
    with pytest.raises(RobotError, match="A > 0"):
        CalibratedModel(content, nominal).with_payload(1.0)
    weightless = content.replace(b"<inertial>", b"<nothing>").replace(b"</inertial>", b"</nothing>")
    model = CalibratedModel(weightless, nominal, JointMap(stiffness=[8e-4, 2e-4]))
    with pytest.raises(RobotError, match="gives no masses"):
        model.with_payload(1.0)
    A, B = model.with_payload(2.0, masses=(25.0, 30.0)).joint_map.stiffness
    # by hand: k g = A / (25 0.35 + 30 0.7), the tool's origin 0.665 m along the forearm
    k_g = 8e-4 / (25 * 0.35 + 30 * 0.7)
    assert abs(A - (8e-4 + k_g * 2 * 0.7)) < 1e-15
    assert abs(B - (2e-4 + k_g * 2 * 0.665)) < 1e-15


def test_model_of_a_calibration_folder(tmp_path):
    outcome = outcome_of(robots.demo_file("demo_identification.csv"), "irb1600", "34")
    irbcal.save(outcome, tmp_path)
    model = CalibratedModel.load(tmp_path)
    robot = outcome.fit.robot
    q, _ = motions(robot, 50)
    T = robot.T_world_base @ model.placement(q, "target_smr2")
    assert np.abs(T[:, :3, 3] - robot.points(q, "smr2")).max() < 1e-12
    loaded = model.with_payload(3.0)
    assert (loaded.joint_map.stiffness > model.joint_map.stiffness).all()
    moved = loaded.placement(q)[:, :3, 3] - model.placement(q)[:, :3, 3]
    assert 0.1e-3 < np.linalg.norm(moved, axis=1).max() < 0.6e-3
