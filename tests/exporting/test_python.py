"""The Python modules compute what irbcal computes, on numpy alone and on plain floats."""

import subprocess
import sys

import numpy as np
import pytest
from export_harness import situations

from irbcal.exporting import python


def modules(source):
    return (python.module(source.parts, source.vectors, name) for name in ("calibrated.py.j2", "plain.py.j2"))


@pytest.mark.parametrize(
    ("name", "poses"), [("irb1600", 10_000), ("ur10", 10_000), ("panda", 10_000), ("level", 500), ("rail", 500)]
)
def test_modules_compute_what_irbcal_computes(sources, name, poses):
    source = sources[name]
    robot = source.robot
    batch, plain = modules(source)
    q, situation = situations(robot, poses, 21)
    theta, T = robot.joint_map.effective(q, *situation), robot.forward(q, *situation)
    assert np.abs(batch.effective(q, *situation) - theta).max() < 1e-12
    assert np.abs(batch.forward(q, *situation) - T).max() < 1e-12
    some = slice(0, 1000)
    assert np.abs(batch.commanded(theta[some], *(part[some] for part in situation)) - q[some]).max() < 1e-12
    few = slice(0, 20)
    few_situation = [part[few] for part in situation]
    rows = [(x.tolist(), *(part.tolist() for part in rest)) for x, *rest in zip(q[few], *situation, strict=False)]
    assert np.abs(np.array([plain.effective(*row) for row in rows]) - theta[few]).max() < 1e-12
    assert np.abs(np.array([plain.forward(*row) for row in rows]) - T[few, :3]).max() < 1e-12
    assert (
        np.abs(np.array([plain.jacobian(*row) for row in rows]) - batch.jacobian(q[few], *few_situation)).max() < 1e-12
    )
    J = batch.tip_jacobian(q[few], *few_situation)
    assert np.abs(np.array([plain.tip_jacobian(*row) for row in rows]) - J).max() < 1e-12
    usual = q[few][~np.isnan(situation[0][few, 0])], situation[0][few][~np.isnan(situation[0][few, 0])]
    assert np.abs(batch.jacobian(*usual) - robot.joint_map.jacobian(*usual)).max() < 1e-12
    back, found = batch.inverse(T[few], q[few] + 0.02, *few_situation)
    assert found.mean() > 0.9
    assert np.abs(batch.forward(back, *few_situation) - T[few])[found].max() < 5e-12
    for row, wanted in zip(rows, T[few].tolist(), strict=True):
        joints = plain.inverse(wanted, [x + 0.02 for x in row[0]], *row[1:])
        if joints is not None:
            assert np.abs(np.array(plain.forward(joints, *row[1:])) - np.array(wanted)[:3]).max() < 5e-12


def test_they_run_without_irbcal(sources, tmp_path):
    for name, content in python.files(sources["irb1600"]).files.items():
        (tmp_path / name).write_bytes(content)
        call = [sys.executable, "-I", "-W", "error", "-X", "importtime", name]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert "irbcal" not in done.stderr
        assert ("numpy" in done.stderr) is ("plain" not in name)
        wrong = content.replace(b"GAIN = (", b"GAIN = (1e-9 + ", 1)
        (tmp_path / name).write_bytes(wrong)
        assert subprocess.run(call, cwd=tmp_path, capture_output=True).returncode == 1


def test_wrong_shapes_are_refused(sources):
    batch, plain = modules(sources["level"])
    with pytest.raises(ValueError, match="joints need shape"):
        batch.effective([[0.0] * 5])
    with pytest.raises(ValueError, match="expected 6 joints"):
        plain.effective([0.0] * 5)
