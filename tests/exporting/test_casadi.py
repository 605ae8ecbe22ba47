"""CasADi Functions compute what irbcal computes, their derivatives are right, and so is the generated C."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from export_harness import situations
from support import assert_derivative

from irbcal.errors import OptionError
from irbcal.exporting import casadi as target

casadi = pytest.importorskip("casadi", reason="CasADi needs Python 3.11")


@pytest.fixture(scope="module")
def made(sources):
    """Functions by the names of robots, made once."""
    return {
        name: target.functions(sources[name].numbers, sources[name].vectors)
        for name in ("irb1600", "ur10", "panda", "level")
    }


def numbers(source, robot, n, seed):
    """Inputs of the Functions as columns, and irbcal's situation."""
    q, situation = situations(robot, n, seed)
    before, kg, place, torques = situation.values()
    known = np.isfinite(before[:, 0])
    columns = [q, np.where(known[:, None], before, q), known[:, None], kg[:, None], place, torques]
    if not source.numbers.torque.any():
        columns.pop()
    return q, situation, [np.asarray(column, dtype=float).T for column in columns]


@pytest.mark.parametrize(("name", "poses"), [("irb1600", 10_000), ("ur10", 1000), ("panda", 1000), ("level", 500)])
def test_functions_compute_what_irbcal_computes(sources, made, name, poses):
    source = sources[name]
    robot, made = source.robot, made[name]
    q, situation, columns = numbers(source, robot, poses, 31)
    theta = robot.joint_map.effective(q, **situation)
    assert np.abs(np.array(made["effective"](*columns)).T - theta).max() < 1e-12
    T = np.array(made["tip"].map(poses)(*columns)).reshape(4, poses, 4).transpose(1, 0, 2)
    assert np.abs(T - robot.forward(q, **situation)).max() < 1e-12
    few = [column[:, :200] for column in columns]
    back = np.array(made["commanded"].map(200)(theta[:200].T, *few[1:])).T
    assert np.abs(back - q[:200]).max() < 1e-12


def test_derivatives(sources, made):
    source = sources["irb1600"]
    robot, made = source.robot, made["irb1600"]
    q, _, columns = numbers(source, robot, 4, 5)
    for k in range(4):  # the first stop before is not known
        rest = [column[:, k] for column in columns[1:]]

        def place(x, rest=rest):
            return np.array(made["tip"](x, *rest))[:3, 3]

        def angles(x, rest=rest):
            return np.array(made["effective"](x, *rest))[:, 0]

        assert_derivative(place, q[k], np.array(made["tip_jacobian"](q[k], *rest))[:3], 1e-8, 1e-5)
        J = np.array(made["effective_jacobian"](q[k], *rest))
        assert_derivative(angles, q[k], J, 1e-8, 1e-5)
        commanded = made["commanded"]
        x = casadi.MX.sym("x", 6)
        by_theta = casadi.Function("d", [x], [casadi.jacobian(commanded(x, *rest), x)])
        assert np.abs(np.array(by_theta(angles(q[k]))) @ J - np.eye(6)).max() < 1e-9


def test_files_run_alone_and_the_c_code_is_the_same(sources, tmp_path):
    source = sources["level"]
    for name, content in target.files(source).files.items():
        (tmp_path / name).write_bytes(content)
    (module,) = tmp_path.glob("*_casadi.py")
    done = subprocess.run([sys.executable, "-I", module], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert source.numbers.version in module.read_text()
    if shutil.which("gcc") is None:
        pytest.skip("no C compiler")
    (code,) = tmp_path.glob("*.c")
    subprocess.run(["gcc", "-O1", "-fPIC", "-shared", code, "-o", tmp_path / "robot.so"], check=True)
    columns = numbers(source, source.robot, 3, 8)[2]
    for name in ("tip", "commanded", "tip_jacobian"):
        compiled = casadi.external(name, str(tmp_path / "robot.so"))
        saved = casadi.Function.load(str(tmp_path / f"{name}.casadi"))
        for k in range(3):
            given = [column[:, k] for column in columns]
            assert np.abs(np.array(compiled(*given)) - np.array(saved(*given))).max() < 1e-13


def test_without_casadi_it_says_what_is_needed(sources, monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(OptionError, match=r"pip install 'irbcal\[casadi\]'"):
        target.files(sources["level"])
