"""Joint moves written in the languages of robots, and read again."""

import numpy as np
from maker_cases import robot_of

from irbcal.correction import languages
from irbcal.correction.moves import JointMove, Moves
from irbcal.io import urdf
from irbcal.units import DEG

Q = np.array([[0.0] * 6, [10.0, -60.0, 95.5, 20.0, 30.125, -40.0], [-15.25, -70.5, 80.0, -12.3456, 45.0, 77.7]]) * DEG
PULSES = (1341.4, 1341.4, -1341.4, 1000.0, 1000.0, 622.0)


def arm_of(robot):
    return urdf.read(robot).arm if robot in ("ur10", "irb120") else robot_of(robot)[0]


def moves(robot, text="pose 1", pulses=PULSES):
    rests = (("", 0.0), (text, 4.5), (text, 0.0))
    return Moves(
        arm_of(robot), Q, tuple(JointMove(said, rest, 0.25, 0.5) for said, rest in rests), (text,), 0.1, pulses
    )


def written(language, robot, **more):
    """Texts of the files; `languages.write` has read their joints again."""
    files = languages.write(languages.by_name()[language], moves(robot, **more))
    return {name: data.decode("ascii") for name, data in files.items()}
