"""Fake targets of one program: each target by itself, then in its order, then as its file can hold it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.correction.corrected_program import CorrectedProgram
from irbcal.correction.corrected_targets import (
    UNCHANGED,
    Carried,
    CorrectionModel,
    TargetBatch,
    as_written,
    corrected,
    refused,
    writable,
)
from irbcal.correction.fake_targets import FakeTargets
from irbcal.correction.languages.table import TableProgram
from irbcal.correction.last_moves import MOST_NAMED, LastMoves, with_last_moves
from irbcal.correction.paths import CutPath, Cuttable, Ends, cut_move
from irbcal.correction.program import Note, Program, Unchanged, WantedTargets, refuse_filtered
from irbcal.correction.shifted_targets import with_shifts
from irbcal.correction.text_program import TextProgram
from irbcal.correction.trajectories import Timed, follow
from irbcal.correction.true_frames import TargetFrames
from irbcal.measurement.input_table import check_one_payload
from irbcal.modeling.robot import Robot
from irbcal.units import MM
from irbcal.wording import and_more


def filter_program(program: Program, model: CorrectionModel) -> CorrectedProgram:
    """Correct the targets of a program as read.

    Parameters
    ----------
    program : Program
        See `irbcal.correction.languages`.
    model : CorrectionModel

    Raises
    ------
    ProgramError
        If the program was filtered before.
    RobotError
        As `irbcal.correction.fake_targets.correct_joints` and `irbcal.correction.fake_targets.correct_poses`.
    """
    refuse_filtered(program)
    batches = [_each_by_itself(model, program, wanted) for wanted in program.wanted_targets()]
    batches, program, unchanged_targets, last_moves = _in_order(model, program, batches)
    batches = [
        replace(batch, fake=writable(program, model.nominal, batch.programmed, as_written(model, batch)))
        for batch in batches
    ]
    robots = _loaded_robots(model.robot, batches)
    shift_notes: Sequence[Note] = ()
    if isinstance(program, TextProgram) and program.shifts:
        batches, shift_notes = with_shifts(model, robots, program, batches)
    way = _way(program, batches)
    paths: tuple[CutPath, ...] | None = None
    if model.path_tolerance is not None:
        paths = ()
        if isinstance(program, Cuttable):
            paths = _paths(model, model.path_tolerance, robots, program, batches)
            program = program.with_cuts(paths)
    unlike = [(b, k) for b in batches for k in np.flatnonzero(~b.fake.ok) if b.fake.reason[k] not in UNCHANGED]
    unchanged_targets += [
        Unchanged(b.programmed.names[k], int(b.programmed.lines[k]), b.fake.reason[k]) for b, k in unlike
    ]
    unchanged_targets += [
        Unchanged(f"the path of {path.move.name}", path.move.line, path.reason) for path in paths or () if path.reason
    ]
    mark = None if model.true_frames.points.re_express else model.fingerprint
    joints = len(model.nominal.joint_names)

    def joined(arrays: Sequence[FloatArray], *columns: int) -> FloatArray:
        """Rows of the corrected targets, from arrays of all targets of each batch."""
        rows = [of_batch[batch.fake.ok] for of_batch, batch in zip(arrays, batches, strict=True)]
        return np.concatenate([np.zeros((0, *columns)), *rows])

    return CorrectedProgram(
        source=program.source,
        files=program.with_fake_targets([(batch.programmed, batch.fake) for batch in batches], mark),
        targets=np.array([b.programmed.names[k] for b in batches for k in np.flatnonzero(b.fake.ok)], dtype=object),
        lines=np.concatenate([np.zeros(0), *(b.programmed.lines[b.fake.ok] for b in batches)]).astype(int),
        q_before=joined([b.fake.q_nominal for b in batches], joints),
        q=joined([b.fake.q for b in batches], joints),
        shift=joined([b.fake.shift for b in batches]),
        turn=joined([b.fake.turn for b in batches]),
        residual=joined([b.fake.residual for b in batches]),
        unchanged_targets=tuple(sorted(unchanged_targets, key=lambda target: target.line)),
        notes=(
            *program.notes,
            *(program.axes_notes() if isinstance(program, TextProgram) else ()),
            *shift_notes,
            *(last_moves.notes if last_moves else ()),
            *_load_notes(model.robot, program, batches),
        ),
        arm=model.nominal,
        fingerprint=model.fingerprint,
        last_move_error=None if last_moves is None else joined(last_moves.errors),
        last_moves=None if last_moves is None else (last_moves.known_moves, last_moves.stops),
        paths=paths,
        frames=TargetFrames.joined(
            [
                b.frames.of_corrected(model.robot, model.computing, model.true_frames, b.programmed, b.fake)
                for b in batches
            ]
        ),
        unchanged=sum(int((~b.fake.ok).sum()) for b in batches) - len(unlike),
        positions=np.concatenate([np.zeros((0, 3, 3)), *(_places_of_tool(model.robot, b) for b in batches)]),
        visited=way,
    )


def _each_by_itself(model: CorrectionModel, program: Program, programmed: WantedTargets) -> TargetBatch:
    """Fake targets of goals, each for what the robot carries there and with an unknown last move."""
    check_one_payload(not model.follow_loads, isinstance(program, TableProgram) and bool(programmed.loads))
    at = model.true_frames.frames_of(program, programmed, model.computing)
    if not (model.follow_loads and model.robot.joint_map.knows_loads and programmed.loads):
        return TargetBatch(programmed, at, None, corrected(model, programmed, at))
    load = Carried.at(model.robot, programmed)
    fake = load.computed_for_each(
        model.robot,
        lambda robot: corrected(replace(model, robot=robot), programmed, at),
        [field.name for field in fields(FakeTargets)],
    )
    why = [f"{reason}: say with --payload what the robot carries" if reason else "" for reason in load.reasons]
    return TargetBatch(programmed, at, load, refused(fake, why))


def _in_order(
    model: CorrectionModel, program: Program, batches: list[TargetBatch]
) -> tuple[list[TargetBatch], Program, list[Unchanged], LastMoves | None]:
    """Corrections that know what comes before: in a motion as it goes, in other programs the stop before."""
    if model.true_frames.points.re_express:
        model = replace(model, robot=Robot(model.computing))
    if not isinstance(program, Timed):
        batches, last_moves = with_last_moves(model.robot, model.computing, batches, program.stops())
        return batches, program, [*program.unchanged_targets()], last_moves
    (batch,) = batches
    batch, commands, passed = follow(model, program, batch)
    return (
        [batch],
        program if commands is None else program.with_motion(commands),
        [*program.unchanged_targets(), *passed],
        None,
    )


def _loaded_robots(robot: Robot, batches: Sequence[TargetBatch]) -> dict[int, Robot]:
    """The robot with what the program says that it carries, by the numbers of the targets; others are not named."""
    robots: dict[int, Robot] = {}
    for batch in batches:
        if batch.load is not None:
            loads, which = batch.load.groups()
            carrying = [robot.carrying(*load) for load in loads]
            robots |= {number: carrying[k] for number, k in zip(batch.programmed.numbers.tolist(), which, strict=True)}
    return robots


def _paths(
    model: CorrectionModel,
    tolerance: float,
    robots: Mapping[int, Robot],
    program: Cuttable,
    batches: Sequence[TargetBatch],
) -> tuple[CutPath, ...]:
    """The straight and circular moves with the points that keep them within the tolerance."""
    ends = {
        number: Ends(fake.T_wanted[k], fake.q_nominal[k], fake.q[k], fake.T_fake[k])
        for numbers, fake in ((batch.programmed.numbers.tolist(), batch.fake) for batch in batches)
        for k, number in enumerate(numbers)
        if fake.ok[k]
    }
    return tuple(
        cut_move(
            move,
            ends,
            model.robot if move.to is None else robots.get(move.to, model.robot),
            model.nominal,
            tolerance,
            model.controller,
        )
        for move in program.path_moves()
    )


def _way(program: Program, batches: Sequence[TargetBatch]) -> IntArray:
    """Rows of the corrected targets in the order in which the program stops at them."""
    numbers = [number for batch in batches for number in batch.programmed.numbers[batch.fake.ok].tolist()]
    row = {number: k for k, number in enumerate(numbers)}
    return np.array([row[stop.target] for stop in program.stops() if stop.target in row], dtype=int)


def _places_of_tool(robot: Robot, batch: TargetBatch) -> FloatArray:
    """Tool centre points of corrected targets, (n, 3, 3): wanted, before and after the correction; in the base link."""
    fake, ok = batch.fake, batch.fake.ok
    load = {} if batch.load is None else {"payload_kg": batch.load.mass[ok], "payload_centre": batch.load.centre[ok]}
    before, after = (robot.forward(q[ok], **load) for q in (fake.q_nominal, fake.q))
    tip = np.stack([fake.T_wanted[ok], before, after], axis=1)
    T_tool = batch.frames.T_tool[ok]
    on_tip = np.einsum("nij,nj->ni", T_tool[:, :3, :3], batch.frames.contact[ok]) + T_tool[:, :3, 3]
    return np.asarray(np.einsum("nkij,nj->nki", tip[..., :3, :3], on_tip) + tip[..., :3, 3])


def _load_notes(robot: Robot, program: Program, batches: Sequence[TargetBatch]) -> list[Note]:
    """Notes where a program says what the robot carries, and the calibration knows what loads do."""
    if not robot.joint_map.knows_loads or not isinstance(program, TextProgram) or not program.loads.names_any:
        return []
    at = program.names_loads[0] if program.names_loads else 0
    said = f"{program.listing.quote_line(at)}{and_more(len(program.names_loads) - 1)}: " if program.names_loads else ""
    number = program.listing.line(at)
    carried = [(batch, batch.load) for batch in batches if batch.load is not None]
    if not carried:
        usual = f"{robot.joint_map.payload_kg:g} kg"
        return [Note(number, f"{said}the program says what the robot carries; all targets are corrected for {usual}")]
    masses = np.concatenate([load.mass[batch.fake.ok] for batch, load in carried])
    counts = [f"{mass:g} kg ({count})" for mass, count in zip(*np.unique(masses, return_counts=True), strict=True)]
    words = "targets are corrected for what the program says that the robot carries, tool and part"
    out = [Note(number, f"{said}{words}: {', '.join(counts) or 'none'}; --payload says another mass for all")]
    deviations = [
        (off, batch.programmed.names[k], int(batch.programmed.lines[k]), load.several[k])
        for batch, load in carried
        for k, off in load.apart(robot, batch.fake)
    ]
    deviations.sort(key=lambda entry: -entry[0])
    for off, name, number, several in deviations[:MOST_NAMED]:
        loads = " and ".join(f"{mass:g}" for mass, _ in several)
        text = f"{name} is reached with {loads} kg: it is corrected for the mean, off by up to {off / MM:.3f} mm"
        out.append(Note(number, f"{text}; two targets would do better"))
    if len(deviations) > MOST_NAMED:
        text = (
            f"so are {len(deviations) - MOST_NAMED} more targets, off by up to {deviations[MOST_NAMED][0] / MM:.3f} mm"
        )
        out.append(Note(deviations[MOST_NAMED][2], text))
    return out
