"""MuJoCo reads the exported model without a warning and computes irbcal's poses to the last digits."""

import importlib.util

import numpy as np
import pytest
from export_harness import situations
from support import assert_same_poses

from irbcal.errors import RobotError
from irbcal.exporting import mujoco as target
from irbcal.exporting.source import Source

mujoco = pytest.importorskip("mujoco", reason="MuJoCo needs Python 3.11")


def write(source, folder):
    for name, content in target.files(source).files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return str(folder / f"{source.numbers.identifier}.xml")


def placed(data, name):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
    return T


@pytest.mark.parametrize("name", ["irb1600", "panda"])
def test_the_same_poses_and_ranges_without_a_warning(described, tmp_path, name, capfd, monkeypatch):
    source = described[name]
    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its log
    model = mujoco.MjModel.from_xml_path(write(source, tmp_path / "model"))
    data = mujoco.MjData(model)
    assert_ranges(model, source.numbers)
    file = tmp_path / "model" / f"{source.numbers.identifier}_calibrated.py"
    spec = importlib.util.spec_from_file_location("exported_map", file)
    joint_map = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(joint_map)
    q, situation = situations(source.robot, 1000, 3)
    theta = joint_map.effective(q, **situation)
    places = [model.joint(joint).qposadr[0] for joint in source.numbers.joint_names]
    found = []
    for row in theta:
        data.qpos[places] = row
        mujoco.mj_kinematics(model, data)
        found.append(np.linalg.inv(placed(data, source.numbers.base_link)) @ placed(data, source.numbers.tip_link))
    assert_same_poses(found, source.robot.forward(q, **situation), 1e-12, 1e-12)
    mujoco.mj_step(model, data)
    assert not any(data.warning.number)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert "arning" not in "".join(capfd.readouterr())
    assert model.nmesh > 6


def assert_ranges(model, numbers):
    """Ranges are the URDF's, and no link is too light to be simulated."""
    for joint, lower, upper in zip(numbers.joint_names, numbers.lower, numbers.upper, strict=True):
        found = model.joint(joint)
        if np.isfinite(upper):
            assert (found.range == [lower, upper]).all()
    assert (model.body_mass[1:] >= 0.9 * target.LEAST_MASS).all()


def test_reflectors_are_sites_and_the_calibration_is_named(folder, tmp_path):
    source = Source.from_calibration(folder)
    file = write(source, tmp_path)
    model = mujoco.MjModel.from_xml_path(file)
    data = mujoco.MjData(model)
    q = source.robot.arm.random_joints(1, 2)
    data.qpos[:] = source.robot.joint_map.effective(q)[0]
    mujoco.mj_kinematics(model, data)
    T = source.robot.poses(q)[0]
    frame = np.linalg.inv(placed(data, source.numbers.base_link))
    for name, place in source.robot.targets.items():
        by_name = [k for k in ("site", "body") if _has(model, k, f"target_{name}")]
        point = getattr(data, by_name[0])(f"target_{name}").xpos
        assert np.abs(frame[:3, :3] @ point + frame[:3, 3] - (T[:3, :3] @ place + T[:3, 3])).max() < 1e-12
    assert source.numbers.fingerprint in (tmp_path / f"{source.numbers.identifier}.xml").read_text()


def _has(model, kind, name):
    return mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name) >= 0


def test_other_joints_are_refused(described):
    source = described["irb1600"]
    data = source.urdf.replace(b'type="revolute"', b'type="floating"', 1)
    with pytest.raises(RobotError, match="is floating"):
        target.files(Source(source.robot, source.numbers, source.vectors, 0.0, None, data, source.folder))
