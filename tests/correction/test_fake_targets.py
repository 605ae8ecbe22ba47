"""Fake targets: what is commanded takes the calibrated, and the simulated true, robot to the wanted place."""

import numpy as np
import pytest
from demonstration import demonstration_cell
from maker_cases import given, pose_numbers, robot_of, well_inside
from rapid_modules import parsed
from support import arm, assert_same_poses, random_robot, validated_of
from thesis_formula import ThesisMap, apply

from irbcal.correction.corrected_targets import commanded
from irbcal.correction.fake_targets import correct_joints, correct_meant, correct_poses
from irbcal.correction.languages import krl, table
from irbcal.errors import ProgramError
from irbcal.io import robots, urdf
from irbcal.measurement.points import distances
from irbcal.modeling import frames, parameters
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_fake_joints_take_the_calibrated_robot_to_the_nominal_pose(name):
    nominal = arm(name)
    robot = random_robot(nominal, "34", np.random.default_rng(1), size=0.1)
    q = 0.9 * nominal.random_joints(2000, 1)
    found = correct_joints(robot, nominal, q)
    assert found.ok.mean() > 0.93, "what is lost lies next to a singularity or beyond the calibrated arm's reach"
    ok = found.ok
    assert_same_poses(robot.poses(found.q[ok]), nominal.forward(q[ok]), 1e-9, 1e-9)
    assert_same_poses(nominal.forward(found.q[ok]), found.T_fake[ok], 1e-12, 1e-12)
    assert (closed_form.configuration(nominal, found.q[ok]) == closed_form.configuration(nominal, q[ok])).all()
    assert np.isnan(found.q[~ok]).all()
    assert all(found.reason[~ok])
    assert not any(found.reason[ok])


def test_fake_poses_keep_the_configuration_that_is_meant():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(2), size=0.1)
    q = 0.7 * nominal.random_joints(300, 2)
    T = nominal.forward(q)
    branch = closed_form.configuration(nominal, q)
    found = correct_meant(robot, nominal, T, q)
    assert found.ok.mean() > 0.95
    assert_same_poses(robot.poses(found.q[found.ok]), T[found.ok], 1e-9, 1e-9)
    assert (closed_form.configuration(nominal, found.q[found.ok]) == branch[found.ok]).all()


def test_no_correction_flips_the_wrist():
    """Joint 5 is 2e-3 rad off: poses nearer to its zero would need it on the other side, with small joint changes."""
    nominal = arm()
    offset = [p for p in parameters.level_parameters("34", nominal) if p.name == "delta_theta5"]
    table, joint_map = apply(offset, np.array([2e-3]), nominal.table, ThesisMap(np.zeros(6)))
    q = np.tile([0.2, 0.3, -0.1, 0.4, 0.0, 0.5], (40, 1))
    q[:, 4] = np.linspace(-3.95e-3, 3.95e-3, 40)
    robot = Robot(nominal.with_table(table), joint_map.joint_map(nominal))
    found = correct_meant(robot, nominal, nominal.forward(q), q)
    crosses = (q[:, 4] > 0) & (q[:, 4] < 2e-3)
    assert (found.ok == ~crosses).all()
    assert all("another configuration" in reason for reason in found.reason[crosses])


def test_targets_out_of_reach_are_left_with_a_reason():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(3), size=0.1)
    T = nominal.forward(np.tile([0, 0, 0, 0, 0.5, 0], (2, 1)))
    T[1, :3, 3] = [5.0, 0.0, 1.0]
    found = correct_poses(robot, nominal, T)
    assert found.ok.tolist() == [True, False]
    assert "does not reach" in found.reason[1]
    assert 0 < found.shift[0] < 0.02
    assert np.isnan(found.shift[1])
    assert found.report()[0].startswith("1 of 2 targets corrected")
    assert "1 not corrected: the nominal robot does not reach it" in found.summary()
    assert found.to_frame()["ok"].tolist() == [True, False]
    home = correct_joints(robot, nominal, np.zeros((1, 6)))
    assert not home.ok[0]
    assert "next to a singularity" in home.reason[0], "of the wrist at zero joints: no small correction exists"
    stretched = np.tile([0.3, 0.4, -np.pi / 2, 0.2, 0.9, 0.1], (200, 1))
    stretched[:, 2] += np.linspace(-0.2, 0.2, 200)  # near the elbow that is straight, with the wrist bent
    found = correct_joints(robot, nominal, stretched)
    lost = set(found.reason[~found.ok])
    edge = "no small correction reaches it: it lies at the edge of the arm's reach, where joint 3 turns far"
    assert any(reason.startswith(edge) for reason in lost)
    assert not any("singularity" in reason and "reaches" in reason for reason in lost)


def test_the_simulated_true_robot_reaches_what_was_wanted_as_well_as_the_calibration_promised():
    """End to end on the demonstration's hidden robot, backlash and all: wanted against reached reflector positions."""
    cell = demonstration_cell().without("noise", "drift", "lost")
    validated = validated_of(
        robots.demo_file("demo_identification.csv"), "irb1600", "34", verify=robots.demo_file("demo_verification.csv")
    )
    promised = distances(validated.fit.robot, validated.heldout_points).mean()
    nominal, robot = validated.urdf.arm, validated.fit.robot
    q = validated.heldout_points.q
    found = correct_joints(robot, nominal, q)
    assert found.ok.mean() > 0.95
    q = q[found.ok]
    T_world_tip = robot.T_world_base @ found.T_wanted[found.ok]
    wanted = np.stack([frames_apply(T_world_tip, robot.targets[name]) for name in ("smr1", "smr2", "smr3")], axis=1)
    # references in the tracker's frame at rest take the simulated points into the calibration's measuring frame
    places = np.array([validated.references[name] for name in ("ref1", "ref2", "ref3")])
    rest = np.array([cell.references[name] for name in ("ref1", "ref2", "ref3")])
    T = frames.rigid_fit(frames.apply(cell.tracker.T_tracker_base, rest), places)

    def reached(commands):
        return frames.apply(T, cell.measure(commands, run=5).xyz[:, :3])

    after = np.linalg.norm(reached(found.q[found.ok]) - wanted, axis=2).mean()
    before = np.linalg.norm(reached(q) - wanted, axis=2).mean()
    assert after == pytest.approx(promised, rel=0.05)
    assert before > 3 * after


def frames_apply(T, point):
    return np.einsum("nij,j->ni", T[:, :3, :3], point) + T[:, :3, 3]


def src(*lines):
    return [("job.src", "\n".join(["DEF job()", *lines, "END", ""]).encode())]


def test_stops_come_in_order_as_often_as_the_robot_goes_there():
    nominal, _, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 3)
    axes = ["{" + ", ".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(row), 1)) + "}" for row in q]
    pose = pose_numbers(nominal.forward(q), "ZYX")
    angles = [", ".join(f"{key} {v:.6f}" for key, v in zip("XYZABC", row, strict=True)) for row in pose]
    lines = ["$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", f"PTP {axes[0]}", f"LIN {{{angles[0]}}}", f"PTP {axes[2]}"]
    program = krl.parse(nominal, src(*lines, f"PTP {axes[0]}"), given(at))
    found = commanded(program, nominal)
    np.testing.assert_allclose(found, q[[0, 0, 2, 0]], rtol=0, atol=1e-6)


def test_configurations_of_rapid_name_the_joints():
    nominal = urdf.read("irb120").arm
    q = np.radians([[10.0, 20.0, -30.0, 100.0, 40.0, -120.0]])
    T = nominal.forward(q)[0]
    from irbcal.modeling import frames

    quaternion = frames.quaternion_from_matrix(T[:3, :3])
    numbers = [",".join(f"{v:.9f}" for v in part) for part in (T[:3, 3] * 1000, quaternion)]
    target = f"[[{numbers[0]}],[{numbers[1]}],[0,1,-2,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    module = f"MODULE M\n PROC main()\n  MoveJ {target},v100,fine,tool0;\n ENDPROC\nENDMODULE\n".encode()
    np.testing.assert_allclose(commanded(parsed(module, nominal=nominal), nominal), q, rtol=0, atol=1e-6)


def test_rows_of_a_table_are_stops():
    nominal = urdf.read("irb120").arm
    header = ",".join(nominal.joint_columns)
    program = table.parse(f"{header}\n1,2,3,4,5,6\n0,0,0,0,0,9\n".encode(), "a.csv", nominal)
    expected = np.radians([[1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 9]])
    np.testing.assert_allclose(commanded(program, nominal), expected, rtol=0, atol=1e-12)


def test_moves_whose_joints_are_not_known_are_refused_with_their_line():
    nominal, _, at = robot_of("kr120r2500pro")
    for line, reason in (("PTP XHOME", "line 2: the joints of this move are not known"), ("LIN_REL {X 5}", "relative")):
        with pytest.raises(ProgramError, match=reason):
            commanded(krl.parse(nominal, src(line), given(at)), nominal)
