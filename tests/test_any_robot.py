"""Arms of all kinds from their URDF: read, perturbed, measured (simulated), calibrated, written back, seen by Pinocchio."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from support import (
    SCARA,
    assert_same_poses,
    central_differences,
    example_robot,
    measured,
    on_a_rail,
    random_robot,
    random_rotation,
    started,
    validated_of,
    write_measurements,
)

import irbcal
from irbcal.correction.fake_targets import correct_joints
from irbcal.errors import IdentificationError, IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.identification.fit import identify
from irbcal.identification.problem import Problem, State
from irbcal.io import urdf, urdf_check
from irbcal.measurement.points import distances
from irbcal.modeling import frames, parameters
from irbcal.modeling.robot import Robot

ROBOTS = {  # file, base, tip, revolute and prismatic joints
    "ur3": ("ur_description/urdf/ur3_robot.urdf", None, None, 6, 0),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", None, None, 6, 0),
    "panda": ("panda_description/urdf/panda.urdf", None, "panda_link8", 7, 0),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", None, "link7", 7, 0),
    "kinova": ("kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector", 6, 0),
    "z1": ("z1_description/urdf/z1.urdf", None, "link06", 6, 0),
    "rail": (None, "rail_base", "tool0", 6, 1),
}


@pytest.fixture(scope="module")
def rail(tmp_path_factory):
    """File of an IRB 120 on a linear axis."""
    return on_a_rail(tmp_path_factory.mktemp("rail") / "rail.urdf")


@pytest.fixture(params=list(ROBOTS))
def found(request, rail):
    """Each robot as read, with its number of revolute and prismatic joints."""
    file, base, tip, turning, sliding = ROBOTS[request.param]
    return urdf.read(example_robot(file) if file else rail, base, tip), turning, sliding


def by_pinocchio(urdf_bytes, arm, q):
    """Tip poses from Pinocchio at model joints q."""
    return urdf_check.poses(urdf_bytes, arm, q)


def test_written_urdf_agrees_with_pinocchio_and_no_link_flies_away(found):
    urdf_arm, _, _ = found
    arm = urdf_arm.arm
    assert_same_poses(
        by_pinocchio(urdf.to_bytes(urdf_arm, arm), arm, q := arm.random_joints(300, 0)), arm.forward(q), 1e-12, 1e-12
    )
    robot = random_robot(arm, "placement", np.random.default_rng(1), size=0.5)
    written = urdf.to_bytes(urdf_arm, robot.arm)
    assert_same_poses(by_pinocchio(written, arm, q), robot.arm.forward(q), 1e-12, 1e-12)
    again = urdf.from_bytes(written, "written", arm.base_link, arm.tip_link)
    assert_same_poses(again.arm.forward(q), robot.arm.forward(q), 1e-12, 1e-12)
    # 2.5 mm and 0.25 degrees a joint at most, the latter at arm's length
    lever = np.abs(arm.forward(q)[:, :3, 3]).max() + 0.1
    most = (len(arm.joint_names) - 1) * np.sqrt(3) * (2.5e-3 + np.radians(0.25) * lever)
    assert urdf.largest_link_shift(urdf_arm, robot.arm) < most


def test_six_numbers_a_joint_span_what_pinocchio_says_a_joint_placement_can_do(found):
    """Derivatives by the six numbers of each joint are a constant 6 x 6 matrix times Pinocchio's kinematic regressor."""
    import pinocchio as pin

    urdf_arm, _, _ = found
    arm = urdf_arm.arm
    model = pin.buildModelFromXML(urdf.to_bytes(urdf_arm, arm).decode())
    data = model.createData()
    ours = {item.name: item for item in parameters.level_parameters("placement", arm)}
    q = arm.random_joints(6, 3)
    joints = [model.getJointId(name) for name in arm.joint_names]
    base, tip = model.getFrameId(arm.base_link), model.getFrameId(arm.tip_link)
    chain = urdf_check.ArmInModel(model, arm)
    regressors = []
    for configuration in chain.configurations(q, pin.neutral(model)):
        pin.framesForwardKinematics(model, data, configuration)
        R_base = data.oMf[base].rotation.T
        whole = pin.computeFrameKinematicRegressor(model, data, tip, pin.LOCAL_WORLD_ALIGNED)
        regressors.append(np.kron(np.eye(2), R_base) @ whole)
    points = measured(Robot(arm, targets={"t": np.zeros(3)}), q)
    problem = Problem(arm, points, ours.values(), known_targets={"t": np.zeros(3)})
    J = problem.jacobian(State(np.eye(4), np.zeros((1, 3)), np.zeros(len(ours))))[:, problem.nuisance :].reshape(
        len(q), 3, -1
    )
    for i in range(1, len(joints)):
        columns = [k for k, item in enumerate(ours.values()) if item.index == i]
        mine = J[:, :, columns].reshape(-1, 6)
        theirs = np.concatenate([r[:3, 6 * (joints[i] - 1) : 6 * joints[i]] for r in regressors])
        constant, *_ = np.linalg.lstsq(theirs, mine, rcond=1e-10)
        assert np.abs(theirs @ constant - mine).max() < 1e-12
        back, *_ = np.linalg.lstsq(mine, theirs, rcond=1e-10)
        assert np.abs(mine @ back - theirs).max() < 1e-12


def test_calibration_finds_all_that_can_be_seen(found):
    """Without noise: other poses to a nanometre, and 4 numbers a revolute, 2 a prismatic joint, 6 for the base."""
    urdf_arm, turning, sliding = found
    arm = urdf_arm.arm
    robot = random_robot(arm, "placement", np.random.default_rng(2), size=0.2)
    fit = identify(arm, measured(robot, arm.random_joints(150, 4)), "placement")
    assert distances(fit.robot, measured(robot, arm.random_joints(200, 5))).max() < 1e-9
    assert fit.rank == 4 * turning + 2 * sliding + 6 + 3  # three targets: a tool's place and three distances
    assert max(np.abs(fit.solution.state.errors) / [p.scale for p in fit.problem.parameters]) < 1.0


def test_jacobian_with_a_prismatic_joint(rail):
    arm = urdf.read(rail, "rail_base").arm
    chosen = [parameters.parameter(name) for name in parameters.all_names(arm)]
    robot = random_robot(arm, "placement", np.random.default_rng(6))
    points = measured(robot, arm.random_joints(4, 7))
    problem = Problem(arm, points, chosen)
    rng = np.random.default_rng(8)
    errors = 0.2 * rng.uniform(-1, 1, len(chosen)) * [p.scale for p in chosen]
    state = State(robot.T_world_base, np.array(list(robot.targets.values())), errors)

    def residuals(step):
        return problem.residuals(problem.moved(state, step)).ravel()

    J = central_differences(residuals, np.zeros(problem.unknowns))
    # the base moves the measured points here, the predicted ones in the Jacobian: equal to first order only
    assert np.abs(J + problem.jacobian(state))[:, 6:].max() < 1e-9


def run(*arguments):
    """The command's standard output as text; exit code 0."""
    done = started(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_same_commands_for_other_arms(rail, tmp_path):
    arm = urdf.read(rail, "rail_base", "tool0").arm
    rng = np.random.default_rng(9)
    truth = random_robot(arm, "placement", rng, size=0.2)
    columns = arm.joint_columns
    data = write_measurements(
        tmp_path / "m.csv", measured(truth, arm.random_joints(120, 10), 3e-5, rng), columns=columns
    )
    ends = ["--tip-link", "tool0", "--base-link", "rail_base"]
    result = json.loads(run("calibrate", data, "--robot", rail, "--out", tmp_path / "cal", *ends, "--json"))
    assert result["model"] == "auto"
    assert result["nominal_heldout"]["mean_mm"] > 1.0
    assert result["heldout"]["mean_mm"] < 0.15  # noise of 0.03 mm an axis
    assert max(result["urdf_witnesses"]["position_m"], result["urdf_witnesses"]["rotation_rad"]) < 1e-12
    # what the tip really does, from commands in a file
    saved = irbcal.load(tmp_path / "cal")
    q = arm.random_joints(20, 11)
    with open(tmp_path / "q.csv", "w") as stream:
        stream.write(",".join(columns) + "\n")
        np.savetxt(stream, q / arm.joint_units, delimiter=",", fmt="%.12f")
    poses = run("fk", tmp_path / "cal", "--joints", tmp_path / "q.csv")
    (tmp_path / "poses.csv").write_text(poses)
    T_true = truth.poses(q)
    xyz = np.array([line.split(",")[-7:-4] for line in poses.splitlines()[1:]], dtype=float) / 1e3
    assert np.abs(xyz - saved.robot_calibrated().poses(q)[:, :3, 3]).max() < 1e-10
    assert np.linalg.norm(xyz - T_true[:, :3, 3], axis=1).max() < 5e-3  # frames of base and tip are a convention
    # and back: other joints perhaps, the same poses
    lines = run("ik", tmp_path / "cal", "--poses", tmp_path / "poses.csv").splitlines()
    assert lines[0].endswith(",".join(["", *columns, "note"]))
    found = (
        np.array(
            [line.split(",")[-1 - len(arm.joint_units) : -1] for line in lines[1:] if line.endswith(",")], dtype=float
        )
        * arm.joint_units
    )
    rows = [k for k, line in enumerate(lines[1:]) if line.endswith(",")]
    assert len(rows) >= 18
    assert_same_poses(saved.robot_calibrated().poses(found), saved.robot_calibrated().poses(q[rows]), 1e-8, 1e-8)
    assert ((found >= arm.lower - 1e-9) & (found <= arm.upper + 1e-9)).all()
    # a program of joints
    run("filter", tmp_path / "cal", tmp_path / "q.csv", "--out", tmp_path / "fake.csv", "--allow-partial")
    fake = (
        np.genfromtxt(tmp_path / "fake.csv", delimiter=",", skip_header=1, usecols=range(len(columns)))
        * arm.joint_units
    )
    changed = np.abs(fake - q).max(axis=1) > 1e-9
    assert changed.sum() >= 15
    wanted = saved.arm(calibrated=False).forward(q[changed])
    before = np.vstack([np.full((1, fake.shape[1]), np.nan), fake[:-1]])  # in the order of the program
    reached = saved.robot_calibrated().forward(fake, before)[changed]
    assert_same_poses(reached, wanted, 1e-6, 1e-6)
    # others can tell the URDF
    assert "is this calibration" in run("verify", tmp_path / "cal", "--urdf", tmp_path / "cal/calibrated.urdf")


def test_a_scara_is_calibrated_although_its_base_and_tool_cannot_be_told_apart(tmp_path):
    """Axes all parallel: height of base and tool are one number, and still every other pose is predicted."""
    (tmp_path / "scara.urdf").write_text(SCARA)
    arm = urdf.read(tmp_path / "scara.urdf").arm
    assert arm.planar
    assert not urdf.read("irb120").arm.planar
    robot = random_robot(arm, "placement", np.random.default_rng(3), size=0.1)
    data = write_measurements(tmp_path / "m.csv", measured(robot, arm.random_joints(50, 4)), columns=arm.joint_columns)
    calibration = irbcal.calibrate(data, tmp_path / "scara.urdf", holdout=0.0)
    validated = calibration.validated
    assert validated.fit.level == "placement"
    assert any("Model placement was taken, not the default" in note for note in validated.notes)
    other = measured(robot, arm.random_joints(200, 5))
    error = distances(validated.fit.robot, other)
    nominal = distances(validated.nominal_robot, other)
    assert nominal.mean() > 3e-4
    assert error.max() < 1e-8
    # the axes of the real arm are not quite parallel, so that height is seen a little; those of the nominal one are
    rows = {row.name: row for row in validated.nominal_fit.parameters()}
    assert rows["target_smr1_z"].state == "tied"
    assert rows["target_smr1_z"].std is None
    assert "all axes of this arm are parallel" in rows["target_smr1_z"].reason
    assert rows["target_smr1_x"].state == "identified"
    calibration.save(tmp_path / "cal")
    assert irbcal.load(tmp_path / "cal").record.rank == validated.fit.rank


def test_model_auto_is_refused_to_a_scara(tmp_path):
    (tmp_path / "scara.urdf").write_text(SCARA)
    arm = urdf.read(tmp_path / "scara.urdf").arm
    points = measured(random_robot(arm, "placement", np.random.default_rng(3), size=0.1), arm.random_joints(12, 4))
    data = write_measurements(tmp_path / "m.csv", points, columns=arm.joint_columns)
    with pytest.raises(IdentificationError, match="base and tool cannot be separated"):
        irbcal.calibrate(data, tmp_path / "scara.urdf", "auto", holdout=0)


def test_arms_with_few_joints(tmp_path):
    """What fk prints, ik finds again; fake targets are refused with the reason."""
    (tmp_path / "scara.urdf").write_text(SCARA)
    arm = urdf.read(tmp_path / "scara.urdf").arm
    q = arm.random_joints(15, 6)
    with open(tmp_path / "q.csv", "w") as stream:
        stream.write(",".join(arm.joint_columns) + "\n")
        np.savetxt(stream, q / arm.joint_units, delimiter=",", fmt="%.9f")
    (tmp_path / "p.csv").write_text(run("fk", tmp_path / "scara.urdf", "--joints", tmp_path / "q.csv"))
    lines = run("ik", tmp_path / "scara.urdf", "--poses", tmp_path / "p.csv").splitlines()[1:]
    assert sum(line.endswith(",") for line in lines) >= 14
    with pytest.raises(RobotError, match="scara has 4 joints: with fewer than six there are no fake targets"):
        correct_joints(Robot(arm), arm, q)


def test_fk_and_ik_take_the_links_of_a_urdf(rail, tmp_path):
    (tmp_path / "q.csv").write_text("q1_mm,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,q7_deg\n500,10,20,30,40,50,60\n")
    printed = run("fk", rail, "--base-link", "rail_base", "--tip-link", "tool0", "--joints", tmp_path / "q.csv")
    xyz = np.array(printed.splitlines()[1].split(",")[-7:-4], dtype=float) / 1e3
    arm = urdf.read(rail, "rail_base", "tool0").arm
    q = np.array([[0.5, *np.radians([10, 20, 30, 40, 50, 60])]])
    assert np.abs(xyz - by_pinocchio(rail.read_bytes(), arm, q)[0, :3, 3]).max() < 1e-9


@pytest.mark.parametrize("name", ["ur3", "kinova"])
def test_arms_not_built_like_the_thesis_get_the_general_model(name, tmp_path):
    """Where an option belongs to a level, and by cross-validation where level 34 does not even apply."""
    file, base, tip, _, _ = ROBOTS[name]
    arm = urdf.read(example_robot(file), base, tip).arm
    rng = np.random.default_rng(5)
    robot = random_robot(arm, "placement", rng, size=0.1)
    data = write_measurements(tmp_path / "m.csv", measured(robot, arm.random_joints(100, 4), 1e-5, rng))
    for options in ({"hold": ["gain1"]}, {"model": "best-level"}):
        validated = validated_of(data, example_robot(file), base_link=base, tip_link=tip, **options)
        assert validated.fit.level == "placement"
        assert distances(validated.fit.robot, validated.heldout_points).mean() < 4e-5


def test_refusals_name_what_the_arm_has(rail, tmp_path):
    arm = urdf.read(rail, "rail_base").arm
    points = measured(random_robot(arm, "placement", np.random.default_rng(1)), arm.random_joints(40, 1))
    data = write_measurements(tmp_path / "m.csv", points, columns=arm.joint_columns)
    with pytest.raises(MeasurementError, match=r"m\.csv: row 1: missing column q1_deg: irb120_3_058 has 6 joints"):
        validated_of(data, "irb120")
    with pytest.raises(
        IdentificationError,
        match="model 34 is for arms with six revolute joints, irb120_3_058 has 7 \\(rail slides, ",
    ):
        validated_of(data, rail, "34", base_link="rail_base")
    with pytest.raises(IdentificationError, match="no error parameter is called 'stiffness_A'"):
        validated_of(data, rail, base_link="rail_base", free=["stiffness_A"])
    with pytest.raises(
        OptionError, match="method circles is for arms with six revolute joints, irb120_3_058 has 7 \\(rail slides, "
    ):
        validated_of(data, rail, base_link="rail_base", method="circles")
    with pytest.raises(RobotError, match="the arm-stiffness model is for six revolute joints"):
        arm.stiffness_geometry()
    degrees = [name.replace("mm", "deg") for name in arm.joint_columns]
    wrong = write_measurements(tmp_path / "deg.csv", points, columns=degrees)
    with pytest.raises(MeasurementError, match="missing column q1_mm: irb120_3_058 has 7 joints"):
        validated_of(wrong, rail, base_link="rail_base")
    text = data.read_text().replace("q3_deg", "angle3")
    (tmp_path / "gap.csv").write_text(text)
    with pytest.raises(MeasurementError, match="missing column q3_deg"):
        irbcal.read_measurements(tmp_path / "gap.csv")


def full_poses(path, robot, q, rng):
    """A file of full poses of a probe, with noise of 0.03 mm and 0.02 mrad."""
    T_tip_probe = frames.transform(random_rotation(rng), np.array([0.05, 0.03, 0.12]))
    T = robot.T_world_base @ robot.poses(q) @ T_tip_probe
    xyz = T[:, :3, 3] * 1e3 + 0.03 * rng.standard_normal((len(q), 3))
    turned = Rotation.from_matrix(T[:, :3, :3]) * Rotation.from_rotvec(2e-5 * rng.standard_normal((len(q), 3)))
    columns = robot.arm.joint_columns
    rows = np.column_stack([np.arange(len(q)), np.degrees(q), xyz, turned.as_quat(scalar_first=True)])
    table = pd.DataFrame(rows, columns=["pose", *columns, "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"])
    table.insert(1, "target", "probe")
    table["pose"] = table["pose"].astype(int)
    table.to_csv(path, index=False)
    return path


def test_full_poses_on_a_grid_over_two_of_seven_joints_are_enough(tmp_path):
    """The default, end to end; what the other joints do nobody knows, and it is said."""
    arm = urdf.read(example_robot(ROBOTS["panda"][0]), None, "panda_link8").arm
    rng = np.random.default_rng(3)
    robot = random_robot(arm, "placement", rng, size=0.2)
    grid = np.array(np.meshgrid(*[np.linspace(-0.6, 0.6, 9)] * 2)).reshape(2, -1).T
    q = np.tile((arm.lower + arm.upper) / 2 + 0.1, (len(grid), 1))
    q[:, :2] += grid
    data = full_poses(tmp_path / "m.csv", robot, q, rng)
    made = irbcal.calibrate(data, example_robot(ROBOTS["panda"][0]), tip_link="panda_link8")
    assert made.record.heldout.all.mean_mm < 0.1  # noise of 0.03 mm an axis
    assert any("only where measured" in doubt for doubt in made.record.doubts)


@pytest.mark.parametrize(("name", "moving"), [("rs007n", (0, 1)), ("rx160", (5,))])
def test_points_with_few_joints_moving_end_in_a_result_or_a_sentence(name, moving, shared_data, tmp_path):
    """Of which base and tool are not told no data-entry error is named, as nearly any would fit."""
    file = shared_data / "other_arms" / f"{name}.urdf"
    arm = urdf.read(file).arm
    rng = np.random.default_rng(4)
    robot = random_robot(arm, "placement", rng, size=0.2)
    q = np.tile((arm.lower + arm.upper) / 2 + 0.2, (40, 1))
    q[:, moving] += rng.uniform(-0.8, 0.8, (40, len(moving)))
    points = write_measurements(tmp_path / "points.csv", measured(robot, q, 3e-5, rng))
    for data in (points, full_poses(tmp_path / "full.csv", robot, q, rng)):
        try:
            assert irbcal.calibrate(data, file).record.heldout.all.mean_mm < 0.3
        except IrbcalError as error:
            assert "look like" not in str(error)
            assert "base and tool" in str(error)


def test_two_joints_from_plan_to_calibration(tmp_path):
    """A pan-tilt head, SIMULATED: its tip reaches a surface alone, and backlash is not taken for a second robot."""
    limits = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    (tmp_path / "head.urdf").write_text(
        '<robot name="pan_tilt"><link name="base_link"/><link name="a"/><link name="b"/><link name="tool0"/>'
        '<joint name="pan" type="revolute"><origin xyz="0 0 0.4"/><parent link="base_link"/><child link="a"/>'
        f'<axis xyz="0 0 1"/>{limits}</joint>'
        '<joint name="tilt" type="revolute"><origin xyz="0.1 0 0.2"/><parent link="a"/><child link="b"/>'
        f'<axis xyz="0 1 0"/>{limits}</joint>'
        '<joint name="end" type="fixed"><origin xyz="0.5 0.1 0"/><parent link="b"/><child link="tool0"/></joint></robot>'
    )
    robot = str(tmp_path / "head.urdf")
    plan = irbcal.plan(robot, axis=0, cube=5, all_range=40)
    groups = plan.to_frame().drop_duplicates("pose")["group"].value_counts()
    assert groups.to_dict() == {"all_range": 40, "iso_cube": 5}
    rows = irbcal.simulate(robot, random=60, seed=1, robot_seed=4)
    rows.save(tmp_path / "rows.csv")
    own = irbcal.import_measurements(tmp_path / "rows.csv", as_="irbcal").table
    table = pd.read_csv(tmp_path / "rows.csv")
    assert [name for name in own if name.startswith("q")] == ["q1_deg", "q2_deg"]
    other = table[["q1_deg", "q2_deg", "x_mm", "y_mm", "z_mm"]].set_axis(["J1", "J2", "X", "Y", "Z"], axis=1)
    other.insert(0, "Name", table["pose"].astype(str) + "_" + table["target"])
    other.to_csv(tmp_path / "other.csv", sep=";", index=False)
    done = irbcal.calibrate(tmp_path / "other.csv", robot)
    assert not any("two robots" in doubt for doubt in done.record.doubts)
    with pytest.raises(
        OptionError, match=r"method circles is for arms with six revolute joints, pan_tilt has 2 \(pan, tilt\)"
    ):
        irbcal.calibrate(tmp_path / "rows.csv", robot, method="circles")
