"""Frames and models of controllers."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
import yaml
from maker_cases import robot_of
from rapid_modules import parsed
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.correction import notation
from irbcal.correction.maker import configuration_of
from irbcal.errors import RobotError
from irbcal.io import robots, urdf
from irbcal.io.controller_model import controller_frames, unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.robot import Robot

URDF = b"""<robot name="r"><link name="base_link"/><link name="base"/><link name="l1"/><link name="flange"/><link name="tool0"/>
<joint name="b" type="fixed"><parent link="base_link"/><child link="base"/><origin rpy="0 0 3.141592653589793" xyz="0 0 0.5"/></joint>
<joint name="j" type="revolute"><parent link="base_link"/><child link="l1"/></joint>
<joint name="f" type="fixed"><parent link="l1"/><child link="flange"/><origin xyz="0.1 0 0"/></joint>
<joint name="t" type="fixed"><parent link="flange"/><child link="tool0"/><origin rpy="0 1.5707963267948966 0" xyz="0 0 0"/></joint>
</robot>"""


def test_fixed_links_are_found_up_and_down():
    found = controller_frames(URDF, "r", "base_link", "l1")
    assert found.base_known
    assert found.flange_known
    np.testing.assert_allclose(
        found.T_base_world[:3], [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0.5]], rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(
        found.T_tip_flange[:3], [[0, 0, 1, 0.1], [0, 1, 0, 0], [-1, 0, 0, 0]], rtol=0, atol=1e-15
    )
    at_tool = controller_frames(URDF, "r", "base_link", "tool0")
    np.testing.assert_allclose(at_tool.T_tip_flange, np.eye(4), rtol=0, atol=0)


def test_links_that_are_not_there():
    found = controller_frames(URDF.replace(b'"base"', b'"other"'), "r", "base_link", "l1")
    assert not found.base_known
    np.testing.assert_array_equal(found.T_base_world, np.eye(4))
    assert not unknown_frames().flange_known


@pytest.mark.parametrize(("name", "height"), [("m20ia", 0.525), ("gp8", 0.33), ("rx160", 0.55), ("kr120r2500pro", 0.0)])
def test_public_urdfs(name, height):
    at = robot_of(name)[2]
    assert at.base_known
    assert at.T_base_world[2, 3] == height


FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A calibrated robot whose controller knows the robot's factory calibration; its axis 1 has another zero, too."""
    folder = tmp_path_factory.mktemp("own")
    nominal = arm()
    factory = random_robot(nominal, "26", np.random.default_rng(5), size=0.5).arm
    table = factory.table
    theta, d = table.theta.copy(), table.d.copy()
    theta[0] += 2e-3
    d[0] += 0.5e-3
    factory = factory.with_table(dataclasses.replace(table, theta=theta, d=d))
    truth = random_robot(factory, "26", np.random.default_rng(6), size=0.1)
    theta, d = truth.table.theta.copy(), truth.table.d.copy()
    theta[5], d[5] = factory.table.theta[5], factory.table.d[5]  # what no measurement can tell from another tool
    truth = truth.replace(arm=factory.with_table(dataclasses.replace(truth.table, theta=theta, d=d)))
    q = nominal.random_joints(60, 2)
    rng = np.random.default_rng(3)
    data = write_measurements(folder / "m.csv", measured(truth, q, 2e-5, rng))
    found = irbcal.calibrate(data, "irb1600", "26")
    irbcal.save(found, folder / "cal")
    q = 0.6 * nominal.random_joints(400, 4)
    near = closed_form.branches(nominal, nominal.forward(q)).singular(wrist=0.1, shoulder=0.1, elbow=0.05)
    q = q[~(near["wrist"] | near["shoulder"] | near["elbow"]).any(axis=1)][:40]
    (folder / "job.mod").write_text(module(nominal, q, factory.forward(q)))
    poses = factory.forward(nominal.random_joints(200, 8))
    columns = {f"q{k}_deg": v for k, v in enumerate(np.degrees(nominal.random_joints(200, 8)).T, 1)}
    columns |= {f"{axis}_mm": 1e3 * poses[:, k, 3] for k, axis in enumerate("xyz")}
    quaternion = frames.quaternion_from_matrix(poses[:, :3, :3])
    columns |= {name: quaternion[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
    pd.DataFrame(columns).to_csv(folder / "poses.csv", index=False)
    return folder, factory, truth, q


def module(nominal, q, T):
    lines = ["MODULE M"]
    for k, numbers in enumerate(notation.numbers_from_poses(T)):
        conf = configuration_of(q[k], int(closed_form.configuration(nominal, q[k])))
        text = [notation.number_text(v, 9) for v in numbers]
        conf = ",".join(map(str, conf))
        lines.append(f"CONST robtarget p{k}:=[[{','.join(text[:3])}],[{','.join(text[3:])}],[{conf}],{FAR}];")
        joints = ",".join(f"{v:.9f}" for v in np.degrees(q[k]))
        lines.append(f"CONST jointtarget j{k}:=[[{joints}],{FAR}];")
    lines += ["PROC main()", *(f"MoveJ p{k},v100,fine,tool0;MoveAbsJ j{k},v100,fine,tool0;" for k in range(len(q)))]
    return "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])


def errors(cell, data):
    """How far the true robot ends from each wanted pose, metres: its controller turns fake poses into joints."""
    _, factory, truth, q = cell
    fake = parsed(data)
    poses = fake.tip_poses(fake.correctable("pose"))
    found = any_arm.solve(Robot(factory), factory, poses, seed=q, thorough=False)
    assert found.converged.all()
    joints = np.array([fake.targets[k].value for k in fake.correctable("joint")])
    wanted = factory.forward(q)
    return [np.linalg.norm((truth.poses(j) - wanted)[:, :3, 3], axis=1) for j in (found.joints, joints)]


def test_fake_targets_are_made_with_the_controllers_own_numbers(cell, tmp_path, program):
    """From the poses that the controller reports to the corrected program: as good as held-out poses."""
    folder = cell[0]
    calibration = irbcal.load(folder / "cal")
    heldout = calibration.record.heldout.all.mean_mm * 1e-3
    before = errors(cell, (folder / "job.mod").read_bytes())[0]
    program("controller", folder / "poses.csv", "--robot", "irb1600", "--out", tmp_path / "own.urdf")
    out = tmp_path / "with.mod"
    printed = program(
        "filter", folder / "cal", folder / "job.mod", "--out", out, "--controller-model", tmp_path / "own.urdf"
    )
    assert "the controller computes with own.urdf" in printed
    assert "it corrects its robot itself" in printed
    poses, joints = errors(cell, out.read_bytes())
    assert poses.mean() < 1.1 * heldout
    assert joints.mean() < 1.1 * heldout
    assert before.mean() > 5 * heldout
    # taken for the nominal robot it does not know its own zeros and lengths
    without = irbcal.correct(folder / "cal", folder / "job.mod")
    assert errors(cell, without.data)[0].mean() > 5 * heldout


def test_joint_origins_say_the_same_as_the_urdf(cell, tmp_path):
    folder, factory, _, _ = cell
    nominal = urdf.read("irb1600")
    origins = urdf.joint_origins(nominal, factory)
    entries = {}
    for link, joint in zip(nominal.child_links, nominal.arm.joint_names, strict=True):
        T = origins[joint]
        values = [*T[:3, 3], *frames.rpy_from_matrix(T[:3, :3])]
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        entries[link.removesuffix("_link")] = dict(zip(names, map(float, values), strict=True))
    (tmp_path / "own.yaml").write_text(yaml.safe_dump({"kinematics": {**entries, "hash": "calib_123"}}))
    (tmp_path / "own.urdf").write_bytes(urdf.to_bytes(nominal, factory))
    by_yaml, by_urdf = (
        irbcal.correct(folder / "cal", folder / "job.mod", controller_model=tmp_path / name)
        for name in ("own.yaml", "own.urdf")
    )
    assert np.abs(by_yaml.q - by_urdf.q).max() < 1e-9
    del entries["link_3"]
    (tmp_path / "own.yaml").write_text(yaml.safe_dump({"kinematics": entries}))
    with pytest.raises(RobotError, match="expected one origin of joint joint_3"):
        irbcal.correct(folder / "cal", folder / "job.mod", controller_model=tmp_path / "own.yaml")


def test_the_nominal_robot_as_the_controllers_model_changes_nothing(cell):
    folder = cell[0]
    plain = irbcal.correct(folder / "cal", folder / "job.mod")
    given = irbcal.correct(folder / "cal", folder / "job.mod", controller_model=robots.robot_file("irb1600"))
    assert np.abs(plain.q - given.q).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("cal/calibrated.urdf", "this is the calibrated robot itself"),
        ("cal/joint_origins.yaml", "this is the calibrated robot itself"),
        ("irb120", "another robot"),
        ("job.mod", "expected joint origins"),
        ("none.urdf", "none.urdf"),
    ],
)
def test_what_no_controller_computes_with_is_refused(cell, name, words):
    folder = cell[0]
    file = robots.robot_file(name) if name == "irb120" else folder / name
    with pytest.raises(RobotError, match=words):
        irbcal.correct(folder / "cal", folder / "job.mod", controller_model=file)
