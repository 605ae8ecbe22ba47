"""Motions that are corrected as a whole: the calibrated robot's tip against the nominal one's, along the way."""

import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from history_cases import sided_robot
from support import arm, example_robot, random_robot
from thesis_formula import ThesisMap

import irbcal
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import ros
from irbcal.correction.languages import table as csv_program
from irbcal.errors import OptionError, ProgramError
from irbcal.io import urdf
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.trajectory import Trajectory

MIDDLE = np.array([0.0, 0.1, 0.2, 0.3, 0.7, 0.0, 0.4])
AMPLITUDES = np.array([0.5, 0.3, 0.4, 0.8, 0.3, 1.0, 0.3])
SPEEDS = np.array([1.0, 1.3, 0.7, 2.1, 1.7, 0.4, 0.9])


def motion(nominal, n=31, later=0.0, middle=None):
    """All joints swing about a place without singularity."""
    joints = len(nominal.joint_names)
    t = np.linspace(0.0, 2.0, n) + later
    phase = np.outer(t, SPEEDS[:joints]) + np.arange(joints)
    q, dq = (AMPLITUDES * np.sin(np.pad(phase, ((0, 0), (0, 7 - joints)))))[:, :joints], SPEEDS[:joints] * np.cos(phase)
    middle = MIDDLE[:joints] if middle is None else middle
    return Trajectory(t, q + middle, AMPLITUDES[:joints] * dq, -(SPEEDS[:joints] ** 2) * q, nominal.joint_names)


def filtered(robot, nominal, given, speeds=None):
    """Through the filter as YAML, and what was written."""
    program = ros.parse(nominal, ros.to_yaml(given).encode(), "a.yaml")
    found = filter_program(program, CorrectionModel(robot, nominal, "abc", speeds=speeds))
    return found, ros.parse(nominal, found.files["a.yaml"], "a.yaml").trajectory


def frame_robot():
    """With terms that move the frames, which neither URDF nor joint map can carry."""
    nominal = arm("irb120")
    terms = [t for f in ("bending", "wobble") for t in families()[f].terms(nominal)]
    terms = [t for t in terms if t.axis != "rz"]
    values = np.random.default_rng(2).standard_normal(len(terms)) * [t.size for t in terms]
    robot = random_robot(nominal, "34", np.random.default_rng(5), size=0.5)
    return replace(robot, frame_terms=TermMap(nominal, tuple(terms), values)), nominal


@pytest.mark.parametrize("case", ["thesis", "frames"])
def test_speeds_and_accelerations_are_those_of_the_corrected_positions(case):
    """Central differences of the filter's own positions, the file being a little later or earlier."""
    robot, nominal = frame_robot() if case == "frames" else (None, arm())
    robot = robot or random_robot(nominal, "34", np.random.default_rng(3), size=1.0)
    found, written = filtered(robot, nominal, motion(nominal))
    assert found.unchanged_targets == ()
    h = 2e-3
    far, behind, ahead, farther = (
        filtered(robot, nominal, replace(motion(nominal, later=k * h), times=motion(nominal).times))[1].q
        for k in (-2, -1, 1, 2)
    )
    speed = (8.0 * (ahead - behind) - (farther - far)) / (12.0 * h)
    bend = (16.0 * (ahead + behind) - (farther + far) - 30.0 * written.q) / (12.0 * h * h)
    assert np.abs(speed - written.dq).max() < 1e-6
    assert np.abs(bend - written.ddq).max() < 5e-4
    given = motion(nominal)
    assert np.abs(written.dq - given.dq).max() > 1e-3
    assert np.abs(written.ddq - given.ddq).max() > 1e-3
    assert written.times == pytest.approx(given.times, abs=1e-9)
    assert robot.forward(written.q)[:, :3, 3] == pytest.approx(nominal.forward(given.q)[:, :3, 3], abs=1e-9)


def test_an_arm_of_seven_joints_departs_from_its_own_by_little():
    """The Panda: the tip's velocity and acceleration are those wanted, by the joints' nearest."""
    path = example_robot("panda_description/urdf/panda.urdf")
    nominal = urdf.read(path, tip_link="panda_link8").arm
    rng = np.random.default_rng(4)
    table = replace(nominal.table, a=nominal.table.a + 5e-4 * rng.standard_normal(7))
    robot = Robot(nominal.with_table(table), ThesisMap(gain=1e-3 * rng.standard_normal(7)).joint_map(nominal))
    given = motion(nominal, middle=np.array([0, 0.2, 0, -1.8, 0.2, 1.9, 0.3]))
    found, written = filtered(robot, nominal, given)
    assert found.unchanged_targets == ()
    assert np.abs(written.q - given.q).max() < 0.01
    h = 1e-3

    def places(some, move, forward):
        return forward(some.q + move * h * some.dq + 0.5 * (move * h) ** 2 * some.ddq)[:, :3, 3]

    truth, reached = (
        [places(s, k, f) for k in (-1, 0, 1)] for s, f in ((given, nominal.forward), (written, robot.forward))
    )
    for wanted, got in zip(truth, reached, strict=True):
        assert np.abs(wanted - got).max() < 1e-9


def test_sides_are_taken_into_account():
    """Where the joints lean while they move: the tip follows with the lean of the motion, not without."""
    robot, nominal = sided_robot(others=("gain", "gravity")), arm("irb120")
    found, written = filtered(robot, nominal, motion(nominal, n=401))
    previous = written.q - written.dq / np.abs(written.dq).max(axis=1, keepdims=True) * 5 * np.pi / 180
    T = nominal.forward(motion(nominal, n=401).q)[:, :3, 3]
    off = [np.linalg.norm(robot.forward(written.q, p)[:, :3, 3] - T, axis=1) for p in (previous, None)]
    assert np.median(off[0]) < 0.35 * np.median(off[1])
    assert np.median(off[1]) > 5e-5
    assert found.last_moves is None


def test_limits_that_commands_pass_are_named():
    robot, nominal = random_robot(arm(), "34", np.random.default_rng(3), size=1.0), arm()
    _, written = filtered(robot, nominal, motion(nominal))
    speeds = np.abs(written.dense(50).dq).max(axis=0)
    assert filtered(robot, nominal, motion(nominal), speeds * 1.001)[0].unchanged_targets == ()
    tight = speeds * np.where(np.arange(6) == 3, 0.8, 1.001)
    (left,) = filtered(robot, nominal, motion(nominal), tight)[0].unchanged_targets
    assert "joint_4 passes its limit of speed at" in left.reason
    assert "and so does the file at" in left.reason
    factor = float(left.reason.split("; times ")[1].split()[0])
    assert factor == pytest.approx(1.25, abs=2e-3)
    again, _ = filtered(robot, nominal, motion(nominal).slowed(factor), tight)
    assert again.unchanged_targets == ()


def test_a_motion_is_corrected_as_a_whole_or_not_at_all():
    robot, nominal = random_robot(arm(), "34", np.random.default_rng(3), size=1.0), arm()
    given = motion(nominal)
    q = np.array(given.q)
    q[7] = nominal.upper
    found, written = filtered(robot, nominal, replace(given, q=q, dq=None, ddq=None))
    assert len(found.targets) == 0
    assert [one.target for one in found.unchanged_targets] == [f"point {k + 1}" for k in range(31)]
    assert "joint 4" in found.unchanged_targets[7].reason
    assert "half a motion would jump" in found.unchanged_targets[8].reason
    assert np.abs(written.q - q).max() < 1e-11


@pytest.mark.parametrize("name", ["a.csv", "a.yaml", "a.yml"])
@pytest.mark.parametrize("known", [1, 2, 3])
def test_what_is_written_is_read(tmp_path, name, known):
    nominal = urdf.read("irb1600").arm
    values = 0.3 * np.random.default_rng(1).standard_normal((3, 4, 6))
    given = Trajectory(np.array([0.0, 0.1, 0.25, 1.5]), *values[:known], names=nominal.joint_names)
    found = irbcal.read_trajectory(irbcal.write_trajectory(given, tmp_path / name), "irb1600")
    assert found.times == pytest.approx(given.times, abs=1e-12)
    for one, expected in zip((found.q, found.dq, found.ddq), (*values[:known], None, None), strict=False):
        if expected is None:
            assert one is None
        else:
            assert one == pytest.approx(expected, abs=1e-11)
    assert found.names == nominal.joint_names


def test_joints_speeds_and_accelerations_in_radians_are_the_same_motion_and_stay_radians(tmp_path):
    robot, nominal = frame_robot()
    names = nominal.joint_columns
    degrees = motion(nominal).to_frame()
    radians = degrees.rename(columns=lambda name: name.replace("_deg", "_rad"))
    radians[radians.columns[1:]] = np.radians(degrees[degrees.columns[1:]])
    written = []
    for table in (degrees, radians):
        path = tmp_path / "a.csv"
        table.to_csv(path, index=False, float_format="%.15g")
        assert irbcal.read_trajectory(path, "irb120").dq == pytest.approx(motion(nominal).dq, abs=1e-12)
        found = filter_program(
            csv_program.along_time(csv_program.read(path), nominal), CorrectionModel(robot, nominal, "abc")
        )
        written.append(pd.read_csv(io.BytesIO(found.files[str(path)])))
    assert list(written[1].columns[1:-1]) == [name.replace("_deg", "_rad") for name in written[0].columns[1:-1]]
    values = [table[table.columns[1:-1]].to_numpy() for table in written]
    accelerations = np.array([name.startswith("a") for name in written[0].columns[1:-1]])
    off = np.abs(np.degrees(values[1]) - values[0])
    assert off[:, ~accelerations].max() < 2e-6  # six decimals of degrees, eight of radians
    assert off[:, accelerations].max() < 1e-5  # central differences
    assert np.abs(written[0][names] - degrees[names]).max().max() > 1e-3


def test_other_files_are_refused(tmp_path):
    given = Trajectory([0.0], np.zeros((1, 6)))
    with pytest.raises(OptionError, match=r"ends with \.yaml or \.csv, found a\.txt"):
        irbcal.write_trajectory(given, tmp_path / "a.txt")
    given.to_frame().drop(columns="time_s").to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ProgramError, match="row 1: expected a column time_s beside the joints"):
        irbcal.read_trajectory(tmp_path / "a.csv", "irb1600")
