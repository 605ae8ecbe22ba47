"""Fake targets in the order of a program, for a robot that stops elsewhere when it comes from the other side."""

import numpy as np
import pandas as pd
import pytest
from history_cases import sided_robot
from rapid_modules import EXT, parsed
from support import arm, random_robot

from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import table
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.term_map import TermMap


@pytest.fixture(scope="module")
def robot():
    return sided_robot(others=("gain", "gravity"))


def joints(n, seed=2):
    nominal = arm("irb120")
    q = 0.5 * nominal.random_joints(n, seed)
    q[:, 4] = 0.4 + 0.5 * np.abs(q[:, 4])  # away from the wrist singularity
    return q


def csv(path, q):
    frame = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    frame.to_csv(path, index=False)
    return table.read(path)


def in_order(robot, q):
    """Poses that the robot reaches when it goes to joints one after the other."""
    return robot.forward(q, np.vstack([np.full((1, 6), np.nan), q[:-1]]))


def missed(T, wanted):
    return np.linalg.norm((T - wanted)[:, :3, 3], axis=1)


def test_rows_of_a_table_are_reached_in_their_order(robot, tmp_path):
    nominal, q = arm("irb120"), joints(40)
    found = filter_program(csv(tmp_path / "job.csv", q), CorrectionModel(robot, nominal, "abc"))
    assert len(found.targets) == 40
    assert missed(in_order(robot, found.q), nominal.forward(q)).max() < 1e-9
    assert missed(robot.forward(found.q), nominal.forward(q)).mean() > 3e-5  # the last moves matter
    assert found.last_moves == (39, 40)
    assert np.argmax(found.last_move_error) == 0
    assert found.last_move_error[1:].max() < 1e-9


def test_the_first_stop_adds_the_size_of_what_is_not_known(robot, tmp_path):
    nominal, q = arm("irb120"), joints(1)
    found = filter_program(csv(tmp_path / "job.csv", q), CorrectionModel(robot, nominal, "abc"))
    size = robot.joint_map.history_std
    rng = np.random.default_rng(0)
    local = np.array(list(robot.targets.values()))
    theta = robot.joint_map.effective(found.q) + size * rng.standard_normal((20_000, 6))
    T, wanted = robot.arm.forward(theta), nominal.forward(q)
    off = np.einsum("nij,kj->nki", T[:, :3, :3] - wanted[:, :3, :3], local) + (T - wanted)[:, None, :3, 3]
    assert found.last_move_error[0] == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=2))), rel=0.03)


def test_behind_a_target_that_stays_the_last_move_is_known(robot, tmp_path):
    nominal, q = arm("irb120"), joints(6)
    q[2, 4] = 1e-6  # the wrist singularity: not corrected
    found = filter_program(csv(tmp_path / "job.csv", q), CorrectionModel(robot, nominal, "abc"))
    assert [item.line for item in found.unchanged_targets] == [4]
    assert found.last_moves == (4, 5)
    commands = np.insert(found.q, 2, q[2], axis=0)
    off = missed(in_order(robot, commands), nominal.forward(q))
    assert np.delete(off, [0, 2]).max() < 1e-9
    assert off[2] > 1e-4


def test_without_terms_of_the_last_move_nothing_changes(tmp_path):
    nominal, q = arm("irb120"), joints(5)
    thesis = random_robot(nominal, "34", np.random.default_rng(1), size=0.1)
    found = filter_program(csv(tmp_path / "job.csv", q), CorrectionModel(thesis, nominal, "abc"))
    assert found.last_moves is None
    assert found.last_move_error is None
    assert "expected_mm" not in found.to_frame()


def module(q, moves):
    """A RAPID module of joint targets j0 … and pose targets p0 … and moves by their names."""
    nominal = arm("irb120")
    text = ["MODULE m"]
    for k, row in enumerate(q):
        numbers = ",".join(f"{v:.9f}" for v in np.degrees(row))
        text.append(f"CONST jointtarget j{k}:=[[{numbers}],{EXT}];")
        T = nominal.forward(row[None])[0]
        xyz = ",".join(f"{v:.9f}" for v in 1e3 * T[:3, 3])
        quaternion = ",".join(f"{v:.12f}" for v in frames.quaternion_from_matrix(T[:3, :3]))
        text.append(f"CONST robtarget p{k}:=[[{xyz}],[{quaternion}],[{conf(row)}],{EXT}];")
    text += ["PROC main()"]
    text += [f"Move{'AbsJ' if name.startswith('j') else 'J'} {name},v100,fine,tool0;" for name in moves]
    return parsed("\n".join([*text, "ENDPROC", "ENDMODULE", ""]).encode(), nominal=arm("irb120"))


def conf(q):
    from irbcal.correction.maker import configuration_of
    from irbcal.modeling.inverse import closed_form

    branch = int(closed_form.configuration(arm("irb120"), q[None])[0])
    return ",".join(str(v) for v in configuration_of(q, branch))


def test_joint_and_pose_targets_follow_one_another(robot):
    nominal, q = arm("irb120"), joints(6)
    names = ["j0", "p1", "j2", "p3", "p4", "j5"]
    found = filter_program(module(q, names), CorrectionModel(robot, nominal, "abc"))
    commands = dict(zip(found.targets, found.q, strict=True))
    reached = in_order(robot, np.array([commands[name] for name in names]))
    assert missed(reached, nominal.forward(q)).max() < 1e-8
    assert found.last_moves == (5, 6)


def test_a_target_reached_from_two_sides_is_reported_and_gets_the_middle(robot):
    nominal, q = arm("irb120"), joints(3)
    found = filter_program(module(q, ["j0", "j1", "j2", "j1", "j0"]), CorrectionModel(robot, nominal, "abc"))
    commands = dict(zip(found.targets, found.q, strict=True))
    path = np.array([commands[name] for name in ("j0", "j1", "j2", "j1")])
    off = missed(in_order(robot, path), nominal.forward(q[[0, 1, 2, 1]]))
    (note,) = [note for note in found.notes if note.text.startswith("j1 ")]
    assert "from different sides" in note.text
    assert "two targets would do better" in note.text
    theta = robot.joint_map.effective(path, np.vstack([np.full((1, 6), np.nan), path[:-1]]))
    assert np.abs(theta[1] + theta[3] - 2 * robot.joint_map.effective(joint_alone(robot, q[1]))).max() < 1e-9
    assert off[1] > 5e-6
    assert off[2] < 1e-9


def test_of_many_targets_reached_from_two_sides_the_worst_are_named(robot):
    q = joints(14)
    names = [f"j{k}" for k in range(14)]
    found = filter_program(module(q, [*names, *names[::-1]]), CorrectionModel(robot, arm("irb120"), "abc"))
    notes = [note.text for note in found.notes]
    assert len(notes) == 11
    apart = [float(text.split("up to ")[1].split(" mm")[0]) for text in notes]
    assert apart == sorted(apart, reverse=True)
    assert notes[-1].startswith("so are 2 more targets")  # all but the first and the last


def test_a_last_move_never_flips_the_wrist(robot):
    nominal = arm("irb120")
    only_fifth = [t for t in families()["direction"].terms(nominal) if t.joint == 4]
    terms = TermMap(nominal, tuple(only_fifth), np.full(len(only_fifth), -2e-4))
    leaning = Robot(nominal, JointMap(terms))
    q = joints(8)
    q[:, 4] = np.tile([5e-5, 0.3], 4)  # joint 5 comes down to nearly zero, where the last move asks for less
    found = filter_program(module(q, [f"p{k}" for k in range(8)]), CorrectionModel(leaning, nominal, "abc"))
    flipped = [f"p{k}" for k in range(2, 8, 2)]
    assert [left.target for left in found.unchanged_targets] == flipped
    assert all("another configuration" in left.reason for left in found.unchanged_targets)
    assert (found.q[:, 4] > 0).all()


def joint_alone(robot, q):
    from irbcal.correction.fake_targets import correct_joints

    return correct_joints(robot, arm("irb120"), q[None]).q


def test_expected_errors_hold_what_is_not_known(robot, tmp_path):
    from dataclasses import replace

    found = filter_program(csv(tmp_path / "job.csv", joints(4)), CorrectionModel(robot, arm("irb120"), "abc"))
    found = replace(found, expected_error=5e-5)
    assert found.expected_errors[0] == pytest.approx(np.hypot(5e-5, found.last_move_error[0]))
    assert found.to_dict()["max_last_move_mm"] == pytest.approx(1e3 * found.last_move_error.max())
    assert found.expected_errors[1:] == pytest.approx([5e-5] * 3)
    table = found.to_frame()
    for column, metres in (("last_move_mm", found.last_move_error), ("expected_mm", found.expected_errors)):
        np.testing.assert_allclose(table[column] * 1e-3, metres, rtol=1e-12, atol=0)
    assert "before 3 of 4 stops" in found.summary()
    assert "is added" in found.summary()
