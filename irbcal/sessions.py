"""Sessions: one file may hold several, an earlier calibration holds some; each has its own base and its own tool.

A robot is never frozen: a calibration keeps the points that it was made from, and new poses are fitted together with
them, each session with its own base and tool. On a UR10, 30 to 60 new poses with 600 old ones did what 200 do alone.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.errors import CalibrationError, IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.identification import data_entry_errors, outliers
from irbcal.identification.axes import GROUPS
from irbcal.identification.outlier_rule import RULE, OutlierRule
from irbcal.io import robots
from irbcal.io.calibration_folder import folder_of
from irbcal.io.opening import SAME_ROBOT, CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import cleaning
from irbcal.measurement.cleaning import Cleaned, Exclusion
from irbcal.measurement.motions import inputs_of, motion_of
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.poses import as_poses, in_frame_of
from irbcal.measurement.repeats import near_pairs
from irbcal.measurement.session_blocks import COLUMN, MARK, block_of, joined, sessions_of
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import inputs
from irbcal.modeling.terms.situation import Motion, at_rows
from irbcal.units import MM
from irbcal.wording import counted, inflected

NONE = "none"
"""Given in place of a column: all poses are of one session, whatever the file says."""

IN_EARLIER = (
    "the measurements of this file are in the earlier calibration already, they would count twice: give new "
    "measurements, or the nominal robot without the calibration"
)
SAME_DIGITS, SAME_POSITION = 1e-8, 1e-6
"""Joints (radians, metres) and distances, and positions, that differ by no more were measured once: digits of files,
and what registration by references does to positions where more poses are registered."""
GROUP = "group"
NOTICED_FROM = 10
"""Poses of each group from which it is looked at whether groups have bases and tools of their own."""
APART, RATIO = 1.0 * MM, 3.0
"""Median distance of a group from the nominal robot with one base and tool for all groups that tells of several, metres
and as a multiple of that with its own. Bases and tools that stayed where they were give little more than one."""
SURELY_APART = 5.0 * MM
"""The same that no error of a robot explains: groups are sessions then, without being asked."""


@dataclass(frozen=True, eq=False)
class SessionPoints:
    """Cleaned points of one session, or of several, each in its own measuring frame."""

    points: PointSet
    motion: Motion
    """Of the points' poses."""
    references: Mapping[str, FloatArray]
    """Positions of the reference points of the last session, metres."""
    tool_shape: Mapping[str, FloatArray]
    """Of the last session, where reflectors were turned into poses, metres."""
    target_names: tuple[str, ...]
    """All targets measured in the last session."""
    excluded: tuple[Exclusion, ...] = field(default=())
    notes: tuple[str, ...] = ()
    earlier: tuple[tuple[str, PointSet, Motion], ...] = ()
    """Sessions of the earlier calibration, without poses that stand in the new measurements again."""


def clean_sessions(
    measurements: MeasurementSet,
    arm: Arm,
    earlier: Sequence[tuple[str, PointSet, Motion]] = (),
    session_by: str | None = None,
    frame: Sequence[str] | None = None,
    poses: bool = False,
    several_allowed: bool = True,
    rule: OutlierRule = RULE,
) -> SessionPoints:
    """Clean measurements session by session and join them, behind those of an earlier calibration.

    Parameters
    ----------
    measurements : MeasurementSet
    arm : Arm
        Nominal.
    earlier : sequence of (name, PointSet, Motion)
        Sessions of an earlier calibration.
    session_by, frame, poses
        As `irbcal.calibrate` has ``session_by``, ``frame`` and ``as_poses``.
    several_allowed : bool
        Whether the method takes several sessions.
    rule : OutlierRule

    Raises
    ------
    IrbcalError
        If measurements are refused.
    """
    sessions, notes = _divided(measurements, arm, session_by)
    if earlier:
        names_used = {name for name, _, _ in earlier}
        sessions = [(_free_name(name or measurements.stem, names_used), data) for name, data in sessions]
    sets = [(name, _clean_session(data, arm, frame, poses, rule)) for name, data in sessions]
    earlier, counted_once = _without_copies(earlier, [session.points for _, session in sets], measurements.source)
    notes += counted_once
    several = len(sessions) + len(earlier) > 1
    if several and not several_allowed:
        raise OptionError("method: circles takes one session at a time", parameter="method")
    for name, session in sets:
        notes += [f"Session {name}: {note}" for note in session.notes] if several else session.notes
    last = sets[-1][1]
    excluded = tuple(exclusion for _, session in sets for exclusion in session.excluded)
    if not several:
        return replace(last, excluded=excluded, notes=tuple(notes), earlier=tuple(earlier))
    blocks = [*earlier, *((name, session.points, session.motion) for name, session in sets)]
    motion = joined_motions([motion for _, _, motion in blocks])
    for name in sorted({name for _, _, moves in blocks for name in moves.inputs} - motion.inputs.keys()):
        columns = ", ".join(inputs()[name].columns).replace("{}", "*")
        missing = ", ".join(session for session, _, moves in blocks if name not in moves.inputs)
        notes.append(f"The fit does not use {columns}: missing in {missing}.")
    listed = ", ".join(f"{name} ({points.poses} poses)" for name, points, _ in blocks)
    notes.append(
        f"Sessions {listed} share one robot, each has its own base and tool. The result is in the measuring frame of "
        f"the last one, {blocks[-1][0]}; targets of the others are called like {last.target_names[0]}@{blocks[0][0]}."
    )
    return replace(
        last,
        points=joined([(name, points) for name, points, _ in blocks]),
        motion=motion,
        excluded=excluded,
        notes=tuple(notes),
        earlier=tuple(earlier),
    )


def _without_copies(
    earlier: Sequence[tuple[str, PointSet, Motion]], new: Sequence[PointSet], source: str
) -> tuple[list[tuple[str, PointSet, Motion]], list[str]]:
    """Sessions of an earlier calibration without the poses that new measurements hold again, and sentences on them.

    A session of which the new file has most poses is an earlier state of the file: all of it goes.

    Raises
    ------
    MeasurementError
        If no pose is new.
    """
    kept, notes = [], []
    again = [np.zeros(points.poses, dtype=bool) for points in new]
    for name, points, motion in earlier:
        copied = np.zeros(points.poses, dtype=bool)
        for of_new, new_points in zip(again, new, strict=True):
            in_old, in_new = _copied_poses(points, new_points)
            copied |= in_old
            of_new |= in_new
        count, file = int(copied.sum()), Path(source).name
        if not count:
            kept.append((name, points, motion))
            continue
        note = f"{count} of {counted(points.poses, 'pose')} of the earlier calibration's session {name} "
        note += f"{inflected(count, 'stands', 'stand')} in {file} again: each counts once, as {file} has it."
        if 2 * count >= points.poses:
            gone = points.poses - count
            if gone:
                note += f" The other {gone}, which {file} no longer has, {inflected(gone, 'is', 'are')} left out."
        else:
            kept.append((name, points.select(~copied).with_seen_targets(), motion.select(~copied)))
        notes.append(note)
    if all(mask.all() for mask in again):
        raise MeasurementError(IN_EARLIER, file=source)
    return kept, notes


def _copied_poses(points: PointSet, other: PointSet) -> tuple[BoolArray, BoolArray]:
    """Which poses are the same measurement in both sets, whatever moved their frames since.

    Joints are equal, and so are the positions of the targets, or their distances to one another: a measurement that
    was taken again differs by its noise.

    Returns
    -------
    ndarray of bool, shapes (n,) and (m,)
        Of the poses of either set.
    """
    masks = np.zeros(points.poses, dtype=bool), np.zeros(other.poses, dtype=bool)
    names = sorted({*points.target_names} & {*other.target_names})
    if points.q.shape[1] != other.q.shape[1] or not names:
        return masks
    equal = np.sort(near_pairs(np.concatenate([points.q, other.q]), SAME_DIGITS), axis=1)
    pairs = equal[(equal[:, 0] < points.poses) & (equal[:, 1] >= points.poses)] - [0, points.poses]
    first, second = (
        cleaning.by_pose(p.pose, p.names(), p.xyz, np.ones(len(p), dtype=bool), names)[pairs[:, k]]
        for k, p in enumerate((points, other))
    )
    common = np.isfinite(first - second).all(axis=2).sum(axis=1)
    moved = np.linalg.norm(first - second, axis=2)
    lengths = [np.linalg.norm(xyz[:, :, None] - xyz[:, None], axis=3) for xyz in (first, second)]
    unmoved = (common > 0) & ~(moved > SAME_POSITION).any(axis=1)
    rigid = (common > 1) & ~(np.abs(lengths[0] - lengths[1]) > SAME_DIGITS).any(axis=(1, 2))
    for mask, pose in zip(masks, pairs[unmoved | rigid].T, strict=True):
        mask[pose] = True
    return masks


def _divided(
    measurements: MeasurementSet, arm: Arm, by: str | None
) -> tuple[list[tuple[str, MeasurementSet]], list[str]]:
    """Measurements by session, and what the user should know of it."""
    if by == NONE:
        return [("", measurements)], []
    sessions = sessions_of(measurements, by)
    columns = measurements.cells.columns
    if by is not None or len(sessions) > 1 or GROUP not in columns or COLUMN in columns:
        return sessions, []
    difference = differing_groups(measurements, arm)
    if difference is None:
        return sessions, []
    name, together, separate = difference
    text = (
        f"With one base and one tool for all groups, the nominal robot misses the points of group {name} by "
        f"{together / MM:.3g} mm (median), with its own by {separate / MM:.3g} mm: "
    )
    if together < SURELY_APART:
        return sessions, [f"{text}if base or tool were moved between the groups, add --session-by {GROUP}."]
    return sessions_of(measurements, GROUP), [
        f"{text}the groups were taken as sessions, as --session-by {GROUP} says (--session-by {NONE} forbids it)."
    ]


def differing_groups(measurements: MeasurementSet, arm: Arm) -> tuple[str, float, float] | None:
    """Whether the groups of a file have bases and tools of their own, by the nominal robot.

    Parameters
    ----------
    measurements : MeasurementSet
        With a column ``group``.
    arm : Arm

    Returns
    -------
    (name, together, apart) or None
        The group that differs most and its median distance with one base and tool for all groups, and with its own,
        metres; None if none differs by more than `APART` and `RATIO`, or if some group is too small or cannot tell.
    """
    label, pose = measurements.cells[GROUP], measurements.cells["pose_index"]
    names = set(label)
    poses = [len(np.unique(pose[label == name])) for name in names]
    if len(names) < 2 or "" in names or names & set(GROUPS) or min(poses) < NOTICED_FROM:
        return None
    try:
        groups = sessions_of(measurements, GROUP)
        if measurements.is_reference().any():  # bases are compared in the frame of the references
            points = cleaning.clean(measurements).points
            sets = [points.select(points.groups == name).with_seen_targets() for name, _ in groups]
        else:  # distances are those of a group's own tool
            sets = [cleaning.clean(group).points for _, group in groups]
        separate = [float(np.median(distances(outliers.least_trimmed_squares(arm, group), group))) for group in sets]
        pooled = replace(joined([("", group) for group in sets]), session=None)
        distance = distances(outliers.least_trimmed_squares(arm, pooled), pooled)
    except IrbcalError:
        return None
    ends = np.cumsum([len(group) for group in sets])[:-1]
    together = [float(np.median(errors)) for errors in np.split(distance, ends)]
    worst = int(np.argmax(np.array(together) / np.array(separate)))
    if together[worst] < max(APART, RATIO * separate[worst]):
        return None
    return groups[worst][0], together[worst], separate[worst]


def _clean_session(
    measurements: MeasurementSet, arm: Arm, frame: Sequence[str] | None, poses: bool, rule: OutlierRule
) -> SessionPoints:
    """Points of one session."""
    cleaned = cleaning.clean(measurements)
    points, excluded, mixed_up = without_outliers(arm, cleaned, measurements, rule)
    references: Mapping[str, FloatArray] = cleaned.registration.references if cleaned.registration else {}
    if frame is not None:
        points, references = in_frame_of(points, references, frame, measurements.source)
    shape: Mapping[str, FloatArray] = {}
    names = cleaned.points.target_names
    if poses:
        points, shape = as_poses(points, measurements.source)
        names = points.target_names
    notes = (*mixed_up, *cleaned.notes)
    return SessionPoints(points, motion_of(measurements, points), references, shape, names, tuple(excluded), notes)


def without_outliers(
    arm: Arm, cleaned: Cleaned, measurements: MeasurementSet, rule: OutlierRule = RULE
) -> tuple[PointSet, list[Exclusion], list[str]]:
    """Points that a robot of this kind can have reached, all that were left out so far, and names or rows mixed up."""
    points = cleaned.points
    screened = outliers.find_outliers(arm, points, measurements.source, measurements, rule)
    wrong = np.zeros(points.poses, dtype=bool)
    wrong[points.pose[~screened.keep]] = True
    swaps = [(p, order) for p, order in cleaning.by_robot(screened.robot, points) if wrong[p]]
    truth = {(p, k): points.target_names[slot] for p, order in swaps for k, slot in enumerate(order) if slot != k}
    excluded = []
    for k in np.flatnonzero(~screened.keep):
        other = truth.get((int(points.pose[k]), int(points.target[k])))
        reason = (
            f"outlier: {screened.distance[k] / MM:.4g} mm from the robot that fits most points (model {screened.level})"
        )
        if other is not None:
            reason = f"swapped: this is {other}, from where the robot expects both"
        target = points.target_names[points.target[k]]
        excluded.append(Exclusion(pose=str(points.pose_ids[points.pose[k]]), target=target, reason=reason))
    sentences = cleaning.in_words([(points.pose_ids[p], order) for p, order in swaps], points.target_names)
    if np.count_nonzero(wrong) >= data_entry_errors.FEWEST_ROWS and not sentences:
        lost = data_entry_errors.find_lost_row(arm, points)
        if lost is not None and wrong.mean() > 1.0 - outliers.TRIMMED_TO:
            raise MeasurementError(lost.in_words(measurements), file=measurements.source)
        sentences = [] if lost is None else [lost.sentence(measurements)]
    return points.take(screened.keep).without_empty_poses(), [*cleaned.excluded, *excluded], sentences


def _free_name(name: str, used: set[str]) -> str:
    """A session's name that no other has."""
    name = name.replace("@", "-")
    number, free = 2, name
    while free in used:
        free, number = f"{name}-{number}", number + 1
    used.add(free)
    return free


def joined_motions(motions: Sequence[Motion]) -> Motion:
    """Motions of several sessions as one; what only some of them know is zero in the others."""
    elapsed = [np.zeros(len(motion)) if motion.elapsed is None else motion.elapsed for motion in motions]
    moved, timed = (any(getattr(motion, name) is not None for motion in motions) for name in ("move", "elapsed"))
    return Motion(
        np.concatenate([motion.q for motion in motions]),
        np.concatenate([motion.moves for motion in motions]) if moved else None,
        np.concatenate(elapsed) if timed else None,
        {
            name: np.concatenate([motion.inputs[name] for motion in motions])
            for name in motions[0].inputs
            if all(name in motion.inputs for motion in motions)  # what some sessions lack serves no fit
        },
        any(motion.readings for motion in motions),
    )


@dataclass(frozen=True, eq=False)
class Earlier(Locked):
    """What an earlier calibration gives to a new one."""

    record: Record
    sessions: tuple[tuple[str, PointSet, Motion], ...]
    """Name, points and motion. All its points, fitted and held out, by session, with the targets' plain names."""
    folder: Path | None = None
    """Where it lies."""

    @property
    def poses(self) -> int:
        """Number of its poses."""
        return sum(points.poses for _, points, _ in self.sessions)

    def robot(self) -> Path:
        """Its nominal robot: a file of the same name here, or known by name; else the folder, which holds it, too.

        Files are taken by their content: another file of that name is not.

        Raises
        ------
        OptionError
            If there is none.
        """
        section = self.record.robot
        candidates = [Path(section.urdf)]
        for known in robots.entries_of_file(section.urdf):
            try:
                candidates.append(known.path())
            except RobotError:
                continue
        for path in candidates:
            if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == section.urdf_sha256:
                return path
        if self.folder is not None:
            return self.folder
        raise OptionError(
            f"robot: the earlier calibration was made from {section.urdf}, which is neither here nor known by name: "
            "name its file",
            parameter="robot",
        )

    def check(self, arm: Arm) -> None:
        """Refuse another nominal robot.

        Raises
        ------
        OptionError
            If its constants or joints are not those of the earlier calibration's.
        """
        nominal = self.record.arm(calibrated=False)
        names = ("alpha", "a", "theta", "d", "beta", "b")
        pairs = [(getattr(nominal.table, name), getattr(arm.table, name)) for name in names]
        pairs += [(nominal.T_base_0, arm.T_base_0), (nominal.T_last_tip, arm.T_last_tip)]
        if nominal.joint_names != arm.joint_names or not all(
            a.shape == b.shape and np.abs(a - b).max() < SAME_ROBOT for a, b in pairs
        ):
            raise OptionError(
                f"robot: {arm.name} is not the nominal robot of the earlier calibration, which is {nominal.name} from "
                f"{self.record.robot.urdf}",
                parameter="robot",
            )


def earlier_of(calibration: CalibrationLike) -> Earlier:
    """Open an earlier calibration to add measurements to it.

    Raises
    ------
    CalibrationError
        If it cannot be read or does not hold its measured points.
    """
    record = open_calibration(calibration)
    name, folder = "earlier", None
    if isinstance(calibration, (str, os.PathLike)):
        folder = folder_of(calibration)
        name = folder.resolve().name.replace(MARK, "-") or name
    used = [used_points[0] for heldout in (False, True) if (used_points := record.used_points(heldout)) is not None]
    if not used:
        problem = (
            "is from rows at features, which are calibrated together" if record.features else "has no measured points"
        )
        raise CalibrationError(f"this calibration {problem}: nothing can be added to it", parameter="with")
    names = tuple(session.name for session in record.sessions) or (name,)
    numbers = np.array(record.poses.number or np.arange(len(record.poses.pose)), dtype=float)
    heldout = np.array(record.poses.heldout, dtype=bool)
    sets = [(points, numbers[heldout == bool(k)]) for k, points in enumerate(used) if points.poses]
    sessions = []
    for session in names:
        point_sets, order = [], []
        for points, number in sets:
            blocks = [block_of(target, names, names[-1]) for target in points.target_names]
            of_session = np.array([block == session for _, block in blocks], dtype=bool)
            poses = np.zeros(points.poses, dtype=bool)
            poses[points.pose[of_session[points.target]]] = True
            if poses.any():
                points_part = points.select(poses).with_seen_targets()
                plain = tuple(block_of(target, names, names[-1])[0] for target in points_part.target_names)
                point_sets.append(("fit", replace(points_part, target_names=plain)))
                order.append(number[poses])
        all_points = joined(point_sets) if len(point_sets) > 1 else point_sets[0][1]
        elapsed = np.concatenate(order)
        by_time = np.argsort(elapsed, kind="stable")
        all_points = _ordered(replace(all_points, session=None), by_time)
        known = inputs_of(all_points, "the earlier calibration")
        motion = Motion(all_points.q, all_points.moves(), elapsed[by_time], known, not record.programmed)
        sessions.append((session, all_points, motion))
    return Earlier(record, tuple(sessions), folder)


def _ordered(points: PointSet, order: IntArray) -> PointSet:
    """The same points with the poses in another order."""
    rank = np.argsort(order)
    of_point = np.argsort(rank[points.pose], kind="stable")
    changed = replace(points.take(of_point), pose=rank[points.pose][of_point])
    return replace(
        changed,
        q=points.q[order],
        pose_ids=points.pose_ids[order],
        groups=points.groups[order],
        previous=None if points.previous is None else points.previous[order],
        inputs=at_rows(points.inputs, order),
    )
