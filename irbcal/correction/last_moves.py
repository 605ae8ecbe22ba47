"""Fake targets of a program in its order: where a joint stops depends on the side it comes from.

The order of the stops tells the last move; the command of each stop is found from the corrected command of the one
before. Where the order is not known, what the last move does is not known either: its size joins the expected error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.correction.corrected_targets import Carried, TargetBatch
from irbcal.correction.program import Note, Stop
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse.closed_form import LIMIT_TOLERANCE
from irbcal.modeling.inverse.stop_sequence import commanded_in_order, stops_before
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import at_rows
from irbcal.units import MM

WORTH_SAYING = 1e-3 * MM
"""Distance between the places where a target is reached from different sides that is told."""
MOST_NAMED = 10
"""Targets that are named for that, those with the largest distances; the others are counted."""


@dataclass(frozen=True, eq=False)
class LastMoves(Locked):
    """What is known of the last moves of a program whose robot depends on them."""

    errors: tuple[FloatArray, ...]
    """Each of shape (n,). For each kind of goals and each of its targets what the last move leaves, metres, root mean
    square over its stops: the effect of a move that is not known, or of sides that differ. NaN where not corrected.
    """
    stops: int
    known_moves: int
    """Stops at corrected targets, and those of them whose last move is known."""
    notes: tuple[Note, ...]
    """Targets that are reached from different sides, with the distance."""


def with_last_moves(
    robot: Robot, nominal: Arm, batches: list[TargetBatch], stops: Sequence[Stop]
) -> tuple[list[TargetBatch], LastMoves | None]:
    """Corrections that take account of the last moves of a program.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    batches : list of TargetBatch
        Corrected with unknown last moves.
    stops : sequence of Stop
        In the order of the program; targets without any are taken as stops with an unknown last move.

    Returns
    -------
    batches : list of TargetBatch
        With the last moves where they are known. A target that is reached from different sides gets the command in
        the middle.
    last_moves : LastMoves or None
        None for robots that do not depend on last moves: their corrections are returned as they are.

    Raises
    ------
    RobotError
        If the joint map cannot be inverted in order.
    """
    if not robot.joint_map.has_history:
        return batches, None
    if not any(batch.fake.ok.any() for batch in batches):
        return batches, LastMoves(tuple(np.full(len(batch.fake.ok), np.nan) for batch in batches), 0, 0, ())
    fakes = [batch.fake for batch in batches]
    numbers = np.concatenate([batch.programmed.numbers for batch in batches])
    names = [name for batch in batches for name in batch.programmed.names]
    lines = np.concatenate([batch.programmed.lines for batch in batches])
    ok = np.concatenate([fake.ok for fake in fakes])
    T_wanted = np.concatenate([fake.T_wanted for fake in fakes])
    # what is not corrected stays as it is, which tells the last move of the stop behind it
    commands = np.concatenate([np.where(fake.ok[:, None], fake.q, fake.q_nominal) for fake in fakes])
    theta = commands.copy()
    load = _loads(robot, batches)
    theta[ok] = robot.joint_map.effective_unchecked(commands[ok], None, **at_rows(load, ok))
    rows = np.flatnonzero(np.isfinite(commands).all(axis=1))
    target, previous, at = _uses(commands, numbers, lines, rows, stops, nominal)
    q = commands.copy()
    row_of_pose = np.zeros(len(q), dtype=int)
    row_of_pose[rows] = np.arange(len(rows))
    sweep = row_of_pose[target], np.where(previous >= 0, row_of_pose[previous], -1)
    q[rows] = commanded_in_order(robot.joint_map, theta[rows], *sweep, ~ok[rows], at_rows(load, rows))
    beyond = ok & ((q < nominal.lower - LIMIT_TOLERANCE) | (q > nominal.upper + LIMIT_TOLERANCE)).any(axis=1)
    q[beyond] = commands[beyond]

    in_use = ok[target]
    target, previous, at = target[in_use], previous[in_use], at[in_use]
    reached = robot.forward(q[target], _rows(q, previous), **at_rows(load, target))
    off = _places(robot, reached) - _places(robot, T_wanted[target])
    squares = np.mean(np.sum(off**2, axis=2), axis=1)
    unknown = previous < 0
    squares[unknown] += _unknown_effect(robot, q[target[unknown]]) ** 2
    count = np.bincount(target, minlength=len(q))
    error = np.sqrt(np.bincount(target, squares, len(q)) / np.where(count, count, np.nan))

    new, errors, first = [], [], 0
    for batch, fake in zip(batches, fakes, strict=True):
        rows_of_batch = slice(first, first + len(fake.ok))
        T_fake = fake.T_fake.copy()
        if fake.ok.any():
            T_fake[fake.ok] = nominal.forward(q[rows_of_batch][fake.ok])
        in_order = replace(fake, q=np.where(fake.ok[:, None], q[rows_of_batch], np.nan), T_fake=T_fake)
        new.append(replace(batch, fake=in_order))
        errors.append(error[rows_of_batch])
        first = rows_of_batch.stop
    notes = _sides(names, lines, target, previous, at, off)
    return new, LastMoves(tuple(errors), len(target), int((~unknown).sum()), notes)


def _loads(robot: Robot, batches: Sequence[TargetBatch]) -> dict[str, FloatArray]:
    """Masses (n,) and centres (n, 3) at all targets; empty where the robot carries the same everywhere."""
    if not any(batch.load for batch in batches):
        return {}
    rows = [batch.load or Carried.at(robot, replace(batch.programmed, loads=())) for batch in batches]
    return {
        "payload_kg": np.concatenate([load.mass for load in rows]),
        "payload_centre": np.concatenate([load.centre for load in rows]),
    }


def _uses(
    q: FloatArray, numbers: IntArray, lines: IntArray, rows: IntArray, stops: Sequence[Stop], nominal: Arm
) -> tuple[IntArray, IntArray, IntArray]:
    """Rows of target and target before of each stop, -1 where not known, and lines; all ``rows`` have a stop."""
    row = {int(numbers[k]): int(k) for k in rows}
    target = np.array([-1 if s.target is None else row.get(s.target, -1) for s in stops], dtype=int)
    follows = np.zeros(len(stops), dtype=bool)
    for k in range(1, len(stops)):
        follows[k] = stops[k].previous is not None and stops[k].previous == stops[k - 1].target
    previous = stops_before(q, target, follows, nominal.table.prismatic)
    at = np.array([s.line for s in stops], dtype=int)
    used = target >= 0
    idle = np.setdiff1d(rows, target)
    pieces = (target[used], idle), (previous[used], np.full(len(idle), -1)), (at[used], lines[idle])
    together = [np.concatenate(arrays) for arrays in pieces]
    return together[0], together[1], together[2]


def _rows(q: FloatArray, previous: IntArray) -> FloatArray:
    """Joints of the stops before, NaN where they are not known."""
    return np.where(previous[:, None] >= 0, q[previous], np.nan)


def _places(robot: Robot, T: FloatArray) -> FloatArray:
    """Places (n, k, 3) in the base link of the robot's targets, of the tip's origin where it has none."""
    local = np.array(list(robot.targets.values())).reshape(-1, 3) if robot.targets else np.zeros((1, 3))
    return np.einsum("nij,kj->nki", T[:, :3, :3], local) + T[:, None, :3, 3]


def _unknown_effect(robot: Robot, q: FloatArray) -> FloatArray:
    """By how much an unknown last move shifts the robot's targets, root mean square, (n,), metres."""
    theta = robot.joint_map.effective_unchecked(q)
    still = _places(robot, robot.arm.forward(theta))
    squares = np.zeros(len(q))
    for joint, size in enumerate(robot.joint_map.history_std):
        if size:
            turned = theta.copy()
            turned[:, joint] += size
            squares += np.mean(np.sum((_places(robot, robot.arm.forward(turned)) - still) ** 2, axis=2), axis=1)
    return np.sqrt(squares)


def _sides(
    names: Sequence[str], lines: IntArray, target: IntArray, previous: IntArray, at: IntArray, off: FloatArray
) -> tuple[Note, ...]:
    """Targets that are reached from different sides, the largest distances first."""
    has_previous: BoolArray = previous >= 0
    several = np.flatnonzero(np.bincount(target[has_previous], minlength=len(names)) > 1)
    noted: list[tuple[float, Note]] = []
    for k in several.tolist():
        visits = np.flatnonzero(has_previous & (target == k))
        distance = np.sqrt(np.mean(np.sum((off[visits][:, None] - off[visits][None]) ** 2, axis=3), axis=2))
        if distance.max() > WORTH_SAYING:
            i, j = visits[[*np.unravel_index(int(np.argmax(distance)), distance.shape)]]
            text = (
                f"{names[k]} is reached from different sides (lines {at[i]} and {at[j]}): the robot stops "
                f"up to {distance.max() / MM:.3f} mm apart; its command is the middle, two targets would do better"
            )
            noted.append((float(distance.max()), Note(int(lines[k]), text)))
    noted.sort(key=lambda entry: -entry[0])
    notes = [note for _, note in noted[:MOST_NAMED]]
    if len(noted) > MOST_NAMED:
        text = f"so are {len(noted) - MOST_NAMED} more targets, up to {noted[MOST_NAMED][0] / MM:.3f} mm apart"
        notes.append(Note(noted[MOST_NAMED][1].line, text))
    return tuple(notes)
