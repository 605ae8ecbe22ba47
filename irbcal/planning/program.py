"""A measuring plan as a program in the language of the robot's maker."""

from __future__ import annotations

from itertools import chain

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import languages
from irbcal.correction.moves import JointMove, Moves
from irbcal.errors import OptionError, ProgramError
from irbcal.modeling.arm import Arm
from irbcal.modeling.home import home_joints
from irbcal.planning import planned_poses, route
from irbcal.planning.planned_poses import PlannedPoses
from irbcal.planning.wish import READINGS_S, Wish

QUICKEST = 0.5
"""Largest share of the joints' speeds: the arm carries reflectors."""
FIRST = 0.1
"""Share of the first move, which begins wherever the arm stands."""


def language_of(arm: Arm, wish: Wish) -> tuple[str, str]:
    """The language of the plan's program by its short name, and why there is none.

    Returns
    -------
    name, note : str
        One of them is empty, or both where tables were asked for.

    Raises
    ------
    OptionError
        If the wish names a language that is not known, or that cannot serve the arm.
    """
    known_languages = languages.by_name()
    if wish.language is not None:
        if wish.language not in known_languages:
            raise OptionError.unknown("language", wish.language, tuple(known_languages))
        fault = _fault(arm, known_languages[wish.language], wish)
        if fault:
            raise OptionError(f"language: {fault}", parameter="language")
        return ("" if wish.language == "csv" else wish.language), ""
    found = languages.of_robot(arm.name)
    if found is None:
        reason = "the name of the robot does not tell its maker" if arm.six_revolute else "it is not a six-axis arm"
        return "", f"no robot program was written, because {reason}: the joints are in poses.csv" + (
            "; --language names a language" if arm.six_revolute else ""
        )
    fault = _fault(arm, found, wish)
    name = next(name for name, language in known_languages.items() if language is found)
    return ("", f"no robot program was written: {fault}") if fault else (name, "")


def _fault(arm: Arm, language: languages.Language, wish: Wish) -> str:
    """Why a language cannot serve an arm; empty where it can."""
    if language.NAME == "CSV":
        return ""
    if language.write_moves is None:
        return f"{language.NAME} has no moves to write"
    if not arm.six_revolute:
        return f"{language.NAME} programs are of six revolute joints, {arm.name} has others"
    if language.MAKER is not None and language.MAKER.pulses and not wish.pulses:
        return f"{language.NAME} holds pulses: give the pulses per degree of the six joints (--pulses)"
    try:
        if language.MAKER is not None:
            language.MAKER.check(arm, arm.name)
    except ProgramError as error:
        return str(error)
    return ""


def files(planned: PlannedPoses) -> dict[str, bytes]:
    """The files of a plan's program: joint moves, and a rest in each pose for the wait and the readings.

    Returns
    -------
    dict of str to bytes
        None where the arm has no program.

    Raises
    ------
    ProgramError
        If what was written does not hold the plan's joints.
    """
    name, _ = language_of(planned.scene.setting.arm, planned.wish)
    return languages.write(languages.by_name()[name], moves(planned)) if name else {}


def moves(planned: PlannedPoses) -> Moves:
    """The moves of a plan: from home through all poses, over home where the direct way is not free, and back."""
    arm, wish = planned.scene.setting.arm, planned.wish
    home = home_joints(arm)
    stops = [([home] if over else []) + [q] for q, over in zip(planned.q, planned.over_home, strict=True)]
    q = np.array([home, *chain.from_iterable(stops), home])
    names = np.array(planned.scene.setting.targets.names, dtype=object)
    comments, waits = [""], [0.0]
    rows = zip(planned.groups, planned.asked, planned.hold_s, stops, strict=True)
    for number, (group, measured, hold, through) in enumerate(rows, start=1):
        comments += [f"pose {number}, {group}: {' '.join(names[measured])}", *[""] * (len(through) - 1)]
        waits += [*[0.0] * (len(through) - 1), float(hold)]
    share, speed = _speeds(planned, q)
    return Moves(
        arm=arm,
        q=q,
        moves=tuple(
            JointMove(text, wait, float(fraction), float(rate))
            for text, wait, fraction, rate in zip([*comments, ""], [*waits, 0.0], share, speed, strict=True)
        ),
        head=(
            f"Measuring plan for {arm.name}: {len(planned.q)} poses, about {planned.duration_s / 60:.0f} minutes.",
            f"In each pose: {wish.wait_s:g} s of rest, then {READINGS_S:g} s for each reflector, {wish.references} "
            "references among them.",
            "Do not filter this program: it commands the joints of plan.csv.",
        ),
        tip_speed=wish.speed,
        pulses=wish.pulses,
    )


def _speeds(made: PlannedPoses, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the joints' largest speeds and speed of the joint that turns most, rad/s, of the move to each row."""
    rates = made.scene.joint_speed
    fastest = route.move_times(q[:-1], q[1:], rates)
    planned = np.maximum(planned_poses.move_times(made.scene, made.wish, q[:-1], q[1:]), 1e-3)
    share = np.concatenate([[FIRST], np.clip(fastest / planned, 0.01, QUICKEST)])
    rates_of_move = np.abs(np.diff(q, axis=0)).max(axis=1) / np.maximum(planned, fastest / QUICKEST)
    return share, np.concatenate([[FIRST * float(rates.min())], np.maximum(rates_of_move, 0.01)])
