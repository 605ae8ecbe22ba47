"""CSV trajectories: columns of times, speeds and accelerations."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.languages.table import reader, timed
from irbcal.errors import ProgramError
from irbcal.files import urdf
from irbcal.modeling.robot import Robot
from irbcal.modeling.trajectory import Trajectory

COUPLING = np.eye(6)
COUPLING[2, 1] = -1.0


def written(nominal, n=5, **changed):
    """A motion of all joints as CSV, with a column of its own."""
    t = 0.1 * np.arange(n)
    q = np.outer(t, 0.1 * np.arange(1, 7))
    motion = Trajectory(t, q, np.gradient(q, t, axis=0), 0 * q, nominal.joint_names)
    frame = motion.to_frame().assign(note="ü,x")
    return motion, frame.assign(**changed).to_csv(index=False).encode()


def test_speeds_and_accelerations_go_in_and_out_as_the_controller_counts():
    nominal = replace(urdf.read("irb1600").arm, coupling=COUPLING)
    motion, data = written(nominal)
    program = timed.along_time(reader.parse(data, "a.csv"), nominal)
    assert program.motion.dq == pytest.approx(motion.dq)
    assert program.trajectory.q[:, 2] == pytest.approx(motion.q[:, 2] - motion.q[:, 1])
    assert program.trajectory.dq == pytest.approx(nominal.from_controller(motion.dq))
    (goals,) = program.goals()
    q = nominal.from_controller(goals.values)
    fake = correct_joints(Robot(nominal), nominal, q)
    fake = replace(fake, q=nominal.to_controller(fake.q))
    (out,) = program.with_motion(program.trajectory.slowed(2.0)).with_fake_targets([(goals, fake)], "abc").values()
    again = timed.along_time(reader.parse(out, "a.csv"), nominal)
    assert again.fingerprint == "abc"
    assert again.motion.q == pytest.approx(motion.q, abs=1e-8)
    assert again.motion.dq == pytest.approx(motion.dq / 2, abs=1e-8)
    assert again.motion.times.tolist() == motion.times.tolist()
    assert b'"\xc3\xbc,x"' in out


def test_rows_without_times_and_poses_are_no_motion():
    nominal = urdf.read("irb1600").arm
    _, data = written(nominal)
    table = pd.read_csv(pd.io.common.BytesIO(data)).drop(columns="time_s")
    assert not timed.has_times(reader.parse(table.to_csv(index=False).encode()))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"time_s": [0, 0.1, 0.1, 0.3, 0.4]},
            "row 4, column time_s: times of a trajectory grow, found 0.1 s after 0.1",
        ),
        ({"time_s": [0, 0.1, "soon", 0.3, 0.4]}, "row 4, column time_s: expected a time in seconds, found 'soon'"),
        ({"v2_deg_s": [0, 0.1, np.nan, 0.3, 0.4]}, "row 4, column v2_deg_s: expected a number"),
        ({"v2_deg_s": [0, 0.1, "inf", 0.3, 0.4]}, "row 4, column v2_deg_s: expected a number"),
    ],
)
def test_refusals_name_the_row_and_the_column(changed, words):
    nominal = urdf.read("irb1600").arm
    with pytest.raises(ProgramError, match=f"a.csv: {words}"):
        timed.along_time(reader.parse(written(nominal, **changed)[1], "a.csv"), nominal)


def test_columns_that_are_not_whole_are_refused():
    nominal = urdf.read("irb1600").arm
    table = pd.read_csv(pd.io.common.BytesIO(written(nominal)[1]))
    with pytest.raises(ProgramError, match="v3_deg_s"):
        timed.along_time(reader.parse(table.drop(columns="v3_deg_s").to_csv(index=False).encode()), nominal)
    alone = table.drop(columns=[f"v{k}_deg_s" for k in range(1, 7)])
    with pytest.raises(ProgramError, match="accelerations needs speeds"):
        timed.along_time(reader.parse(alone.to_csv(index=False).encode()), nominal)
