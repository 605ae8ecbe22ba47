"""What several tests need: comparators with metre and radian tolerances, central differences, simulation."""

import atexit
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thesis_formula import ThesisMap, apply

from irbcal.io import robots, urdf
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames, parameters
from irbcal.modeling.arm import relative_difference
from irbcal.modeling.robot import Robot

TARGETS = {
    "smr1": [-0.08737, 0.087202, 0.11002],
    "smr2": [0.084419, 0.08426, 0.109928],
    "smr3": [0.08599, -0.085788, 0.109959],
}
"""Targets 1 to 3 of Nubiola 2011, Table 3.1 (real), metres."""


def arm(name="irb1600"):
    """A shipped nominal arm."""
    return urdf.read(name).arm


def assert_same_poses(T_1, T_2, metres, radians):
    """Poses agree within separate tolerances for position and rotation."""
    position, rotation = relative_difference(np.asarray(T_1), np.asarray(T_2))
    assert position <= metres, f"positions differ by {position:.3g} m"
    assert rotation <= radians, f"rotations differ by {rotation:.3g} rad"


def central_differences(function, x, step=1e-5):
    """Derivative of a vector function by fourth-order central differences, shape (outputs, inputs)."""
    x = np.asarray(x, dtype=float)
    columns = []
    for k in range(len(x)):
        e = np.zeros(len(x))
        e[k] = step
        columns.append(
            (8 * (function(x + e) - function(x - e)) - (function(x + 2 * e) - function(x - 2 * e))) / (12 * step)
        )
    return np.array(columns).T


def assert_derivative(function, x, derivative, atol, step=1e-3):
    """A derivative (outputs, inputs), or anything with as many numbers in that order, against central differences.

    ``function`` takes inputs (k,) and gives an array; ``atol`` is in its units over those of the inputs.
    """
    numeric = central_differences(lambda y: np.ravel(function(y)), x, step)
    off = np.abs(numeric - np.reshape(derivative, numeric.shape)).max()
    assert off <= atol, f"the derivative differs from central differences by {off:.3g}"


def motions(robot, n, seed=5):
    """Commands inside the limits and speeds, (n, joints) each."""
    q = robot.arm.random_joints(n, seed)
    return q, np.random.default_rng(seed).normal(size=q.shape)


def on_a_rail(path, tilt=0):
    """Write the IRB 120 on a linear axis to a URDF, tilted by radians; its base link is ``rail_base``."""
    path.write_text(robots.robot_file("irb120").read_text().replace("</robot>", _RAIL.format(tilt=tilt)))
    return path


_RAIL = """<joint name="rail" type="prismatic">
    <parent link="rail_base"/><child link="base_link"/>
    <origin xyz="0 0.1 0.05" rpy="0 {tilt} 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <link name="rail_base"/>
</robot>"""


def random_robot(nominal, level, rng, size=0.3, targets=None, T_world_base=None):
    """A robot with random errors of a level (``size`` times the plausible sizes), base and targets anywhere."""
    chosen = parameters.level_parameters(level, nominal)
    errors = size * np.array([p.scale for p in chosen]) * rng.uniform(-1, 1, len(chosen))
    phases = nominal.stiffness_geometry()[0] if level in ("34", "34b") else (0.0, np.pi / 2)
    joint_map = ThesisMap(np.zeros(len(nominal.joint_names)), phases=phases)
    table, joint_map = apply(chosen, errors, nominal.table, joint_map)
    if T_world_base is None:
        T_world_base = frames.transform(random_rotation(rng), rng.uniform(-4, 4, 3))
    return Robot(
        nominal.with_table(table), joint_map.joint_map(nominal), T_world_base, TARGETS if targets is None else targets
    )


def with_thesis(joint_map, **numbers):
    """A joint map of the thesis with some of its numbers changed."""
    return replace(ThesisMap.from_joint_map(joint_map), **numbers).joint_map(joint_map.terms.arm)


def random_rotation(rng):
    """Uniform random rotation matrix."""
    w, x, y, z = (q := rng.standard_normal(4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def measured(robot, q, noise=0.0, rng=None, groups=None):
    """Simulated points of all the robot's targets at joints (n, 6), with Gaussian noise in metres."""
    names = tuple(robot.targets)
    n, k = len(q), len(names)
    xyz = np.stack([robot.points(q, name) for name in names], axis=1).reshape(-1, 3)
    if noise:
        xyz = xyz + noise * rng.standard_normal(xyz.shape)
    groups = np.full(n, "", dtype=object) if groups is None else np.asarray(groups, dtype=object)
    return PointSet(q, np.repeat(np.arange(n), k), np.tile(np.arange(k), n), xyz, names, np.arange(n), groups)


def write_measurements(path, points, extra=None, columns=None, groups=False):
    """Write a point set as a measurement file; ``extra`` are lines to append, ``columns`` those of the joints."""
    columns = columns or [f"q{i}_deg" for i in range(1, 7)]
    rows = [f"pose,{'group,' * groups}{','.join(columns)},target,x_mm,y_mm,z_mm"]
    units = [1e3 if name.endswith("_mm") else np.degrees(1.0) for name in columns]
    q, xyz = points.joints() * units, points.xyz * 1e3
    for k in range(len(points)):
        joints = ",".join(f"{v:.12g}" for v in q[k])
        position = ",".join(f"{v:.12g}" for v in xyz[k])
        pose = points.pose[k]
        group = f"{points.groups[pose]}," if groups else ""
        rows.append(f"{points.pose_ids[pose]},{group}{joints},{points.target_names[points.target[k]]},{position}")
    path.write_text("\n".join([*rows, *(extra or [])]) + "\n")
    return path


def example_robot(name):
    """A file of the package example-robot-data, found under the prefix of the installed package."""
    import pinocchio

    path = Path(pinocchio.__file__).parents[4] / "share/example-robot-data/robots" / name
    if not path.is_file():
        pytest.skip(f"example-robot-data does not hold {name}")
    return path


def started(*words, cwd=None, **environment):
    """The program in a fork of this process, which has its modules loaded: exit code and both streams.

    At most two minutes; its streams are files, and as wide as 100 columns.
    """
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = os.fork()
        if child == 0:
            try:
                os._exit(_started(words, cwd, environment, out, err))
            finally:
                os._exit(70)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(words, code, out.read(), err.read())


def _started(words, cwd, environment, out, err):
    """The exit code of the program in a process that ends with it."""
    from irbcal.__main__ import start

    atexit._clear()
    signal.alarm(120)
    os.dup2(out.fileno(), 1)
    os.dup2(err.fileno(), 2)
    os.environ.update({"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb", **environment})
    os.chdir(cwd or ".")
    sys.argv = ["irbcal", *map(str, words)]
    with open(1, "w", closefd=False) as sys.stdout, open(2, "w", closefd=False) as sys.stderr:
        try:
            start()
        except SystemExit as end:
            return end.code or 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
    return 70


def validated_of(*arguments, **options):
    """What came out of all steps: fits, points and measurements; arguments of `irbcal.calibrate`."""
    import irbcal

    return irbcal.calibrate(*arguments, **options).validated


class Posed:
    """A robot whose tip link is at given poses (n, 4, 4) where it has given joints (n, joints)."""

    def __init__(self, robot, q, T):
        self.robot, self.poses_of = robot, {np.asarray(row).tobytes(): pose for row, pose in zip(q, T, strict=True)}

    def __getattr__(self, name):
        return getattr(self.robot, name)

    def walk(self, motion):
        path = self.robot.walk(motion)
        T = np.array([self.poses_of[row.tobytes()] for row in motion.q])
        return replace(path, tip=T[:, :3].transpose(2, 1, 0))


SCARA = """<robot name="scara"><link name="base_link"/><link name="a"/><link name="b"/><link name="c"/><link name="tool0"/>
<joint name="j1" type="revolute"><parent link="base_link"/><child link="a"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="j3" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.3 0 0"/><axis xyz="0 0 -1"/><limit lower="0" upper="0.2" effort="1" velocity="1"/></joint>
<joint name="j4" type="revolute"><parent link="c"/><child link="tool0"/><axis xyz="0 0 -1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
"""An arm whose axes all stand upright."""
