"""The plan's program: whose language, and what it holds."""

from dataclasses import replace

import numpy as np
import pytest
from maker_cases import path_of, robot_of

import irbcal
from irbcal.correction.languages import rapid
from irbcal.errors import OptionError
from irbcal.planning import measuring_plan
from irbcal.planning.choosing import Wish
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import make
from irbcal.planning.scene import open_scene
from irbcal.simulation import pose_list
from irbcal.units import DEG

PULSES = (1341.4, 1341.4, -1341.4, 1000.0, 1000.0, 622.0)
SMALL = {"axis": 0, "cube": 0, "all_range": 4, "level": "nominal"}


@pytest.fixture(scope="module")
def made():
    return make(open_scene("irb1600", without=SOLID), Wish(**SMALL))


def test_ways_over_home_stand_in_the_program(made):
    def joints(plan):
        return [target.value for target in rapid.parse(measuring_plan.program_files(plan)["plan.mod"]).targets]

    direct = joints(made)
    over = joints(replace(made, over_home=np.array([False, True, False, True])))
    assert len(direct) == 6
    assert len(over) == 8
    assert [not q.any() for q in over] == [True, False, True, False, False, True, False, True]
    np.testing.assert_allclose(direct[1:-1], made.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "language"),
    [
        ("gp8", "inform"),
        ("irb2400", "rapid"),
        ("kr120r2500pro", "krl"),
        ("m20ia", "fanuc"),
        ("rx160", "val3"),
        ("rs007n", "kawasaki"),
    ],
)
def test_the_language_is_the_makers(robot, language):
    arm = robot_of(robot)[0]
    assert measuring_plan.language_of(arm, Wish(pulses=PULSES)) == (language, "")
    assert measuring_plan.language_of(arm, Wish(language="csv")) == ("", "")
    for name in ("", "noname_xy7"):
        found, note = measuring_plan.language_of(replace(arm, name=name), Wish())
        assert found == ""
        assert "the name of the robot does not tell its maker" in note


def test_what_cannot_be_written_is_said():
    arm = robot_of("gp8")[0]
    assert "give the pulses per degree" in measuring_plan.language_of(arm, Wish())[1]
    for language, expected in (("krl", "axes point along"), ("inform", "pulses"), ("basic", "basic")):
        with pytest.raises(OptionError, match=expected):
            measuring_plan.language_of(arm, Wish(language=language))


def test_the_run_takes_as_long_as_the_plan_says(made):
    """Moves with the joint speeds of the program, and its rests: the hours of the plan."""
    run = measuring_plan.moves(made)
    way = np.abs(np.diff(run.q, axis=0)).max(axis=1)
    seconds = sum(move.wait_s for move in run.moves) + sum(
        part / move.joint_speed for part, move in zip(way, run.moves[1:], strict=True)
    )
    assert seconds - way[-1] / run.moves[-1].joint_speed == pytest.approx(made.duration_s, rel=0.05)
    assert all(0.01 <= move.share <= 0.5 for move in run.moves)


@pytest.mark.parametrize("robot", ["gp8", "kr120r2500pro", "m20ia", "rs007n", "rx160"])
def test_the_virtual_robot_runs_it(robot, tmp_path):
    """The program of a plan commands, through the reader of its language, what the plan's table does."""
    nominal = robot_of(robot)[0]
    path = path_of(robot)
    plan = irbcal.plan(path, **SMALL, pulses=PULSES)
    plan.save(tmp_path)
    file = next(file for file in tmp_path.iterdir() if pose_list.is_program(file))
    q, _ = pose_list.read_program(file, nominal, pose_list.given_for(path, nominal, pulses=PULSES))
    assert np.abs(q[1:-1] - plan.q).max() < (0.9e-3 * DEG if robot == "gp8" else 2e-4 * DEG)
