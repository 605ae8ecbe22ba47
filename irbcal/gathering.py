"""What a calibration is made from: cleaned points of all sessions, with the motion that led to each pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IrbcalError, MeasurementError, OptionError
from irbcal.identification import data_entry_errors, outliers
from irbcal.identification.axes import GROUPS
from irbcal.identification.choices import method_of
from irbcal.identification.fit import Fit
from irbcal.io.earlier import Earlier
from irbcal.measurement import cleaning, swapped
from irbcal.measurement.cleaning import Cleaned, Exclusion
from irbcal.measurement.motions import motion_of
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.poses import as_poses, in_frame_of
from irbcal.measurement.sessions import COLUMN, into_one_frame, joined, sessions_of
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling import coupling
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import LOAD, Motion
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.calibrating import Options

NONE = "none"
"""Given in place of a column: all poses are of one session, whatever the file says."""

GROUP = "group"
NOTICED_FROM = 10
"""Poses of each group from which it is looked at whether groups have bases and tools of their own."""
APART, RATIO = 1.0 * MM, 3.0
"""Median distance of a group from the nominal robot with one base and tool for all groups that tells of several, metres
and as a multiple of that with its own. Bases and tools that stayed where they were give little more than one."""
GROSS = 5.0 * MM
"""The same that no error of a robot explains: groups are sessions then, without being asked."""
LARGEST_TURN = 3 * DEG
"""Median angle from the nominal robot above which measured orientations are refused, radians."""


@dataclass
class Gathered:
    """Points of all sessions, and what was found on the way.

    Attributes
    ----------
    points : PointSet
        Several sessions: each in its own measuring frame.
    motion : Motion
        Of the points' poses.
    references : dict of str to ndarray
        Places of the reference points of the last session, metres.
    tool_shape : dict of str to ndarray
        Of the last session, where reflectors were turned into poses, metres.
    target_names : tuple of str
        All targets measured in the last session.
    excluded : list of Exclusion
    notes : list of str
    """

    points: PointSet
    motion: Motion
    references: Mapping[str, FloatArray]
    tool_shape: Mapping[str, FloatArray]
    target_names: tuple[str, ...]
    excluded: list[Exclusion] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def gathered(
    seen: MeasurementSet, arm: Arm, options: Options, earlier: Sequence[tuple[str, PointSet, Motion]] = ()
) -> Gathered:
    """Clean measurements session by session and join them, behind those of an earlier calibration.

    Parameters
    ----------
    seen : MeasurementSet
    arm : Arm
        Nominal.
    options : Options
    earlier : sequence of (name, PointSet, Motion)
        Sessions of an earlier calibration.

    Returns
    -------
    Gathered

    Raises
    ------
    IrbcalError
        If measurements are refused.
    """
    parts, notes = _divided(seen, arm, options.session_by)
    if earlier:
        taken = {name for name, _, _ in earlier}
        parts = [(_free_name(name or seen.stem, taken), part) for name, part in parts]
    several = len(parts) + len(earlier) > 1
    if several and method_of(options.method) == "circles":
        raise OptionError("method: circles takes one session at a time", parameter="method")
    sets = [(name, _one(part, arm, options)) for name, part in parts]
    last = sets[-1][1]
    last.excluded = [item for _, one in sets for item in one.excluded]
    for name, one in sets:
        notes += [f"Session {name}: {note}" for note in one.notes] if several else one.notes
    last.notes = notes
    if not several:
        return last
    whole = [*earlier, *((name, one.points, one.motion) for name, one in sets)]
    last.points = joined([(name, points) for name, points, _ in whole])
    last.motion = one_behind_the_other([motion for _, _, motion in whole])
    last.notes.append(in_words([(name, points.poses) for name, points, _ in whole], last.target_names[0]))
    return last


def of_earlier(robot: str | Path | None, options: Options, earlier: Earlier | None) -> tuple[str | Path, Options]:
    """The robot and options of a calibration that may add to an earlier one: what is not given is as it was there.

    Raises
    ------
    OptionError
        If no robot is known.
    """
    if earlier is None:
        if robot is None:
            raise OptionError("robot: expected a URDF or the name of a robot, see irbcal robots", parameter="robot")
        return robot, options
    record = earlier.record
    changes: dict[str, Any] = {
        "base_link": record.robot.base_link,
        "tip_link": record.robot.tip_link,
        "model": record.model,
    }
    changes = {name: value for name, value in changes.items() if getattr(options, name) is None}
    if record.tool_shape_mm:
        changes["as_poses"] = True
    own = record.robot.coupling
    if options.coupling is None and own is not None and (np.diag(own) == 1.0).all():
        changes["coupling"] = coupling.in_words(np.array(own))
    if record.frame_terms is not None and changes.get("model", options.model) == "auto":
        changes["terms"] = "all"
    return earlier.robot() if robot is None else robot, replace(options, **changes)


def in_words(counts: Sequence[tuple[str, int]], target: str) -> str:
    """What sessions mean for the result, in a sentence; ``counts`` are poses by session, ``target`` one of the last."""
    (first, _), (last, _) = counts[0], counts[-1]
    listed = ", ".join(f"{name} ({count} poses)" for name, count in counts)
    return (
        f"Sessions {listed} share one robot, each has its own base and tool. The result is in the measuring frame of "
        f"the last one, {last}; targets of the others are called like {target}@{first}."
    )


def _divided(seen: MeasurementSet, arm: Arm, by: str | None) -> tuple[list[tuple[str, MeasurementSet]], list[str]]:
    """Measurements by session, and what the user should know of it."""
    if by == NONE:
        return [("", seen)], []
    parts = sessions_of(seen, by)
    if by is not None or len(parts) > 1 or GROUP not in seen.table.columns or COLUMN in seen.table.columns:
        return parts, []
    found = differ(seen, arm)
    if found is None:
        return parts, []
    name, together, apart = found
    text = (
        f"With one base and one tool for all groups, the nominal robot misses the points of group {name} by "
        f"{together / MM:.3g} mm (median), with its own by {apart / MM:.3g} mm: "
    )
    if together < GROSS:
        return parts, [f"{text}if base or tool were moved between the groups, add --session-by {GROUP}."]
    return sessions_of(seen, GROUP), [
        f"{text}the groups were taken as sessions, as --session-by {GROUP} says (--session-by {NONE} forbids it)."
    ]


def differ(seen: MeasurementSet, arm: Arm) -> tuple[str, float, float] | None:
    """Whether the groups of a file have bases and tools of their own, seen against the nominal robot.

    Parameters
    ----------
    seen : MeasurementSet
        With a column ``group``.
    arm : Arm

    Returns
    -------
    (name, together, apart) or None
        The group that differs most and its median distance with one base and tool for all groups, and with its own,
        metres; None if none differs by more than `APART` and `RATIO`, or if some group is too small or cannot tell.
    """
    label = seen.table[GROUP].astype(str)
    names = set(label)
    poses = seen.table["pose_index"].groupby(label).nunique()
    if len(names) < 2 or "" in names or names & set(GROUPS) or poses.min() < NOTICED_FROM:
        return None
    try:
        groups = sessions_of(seen, GROUP)
        # with references, bases are compared in their frame; without, distances are those of a group's own tool
        points = cleaning.clean(seen).points if seen.is_reference().any() else None
        if points is None:
            sets = [cleaning.clean(part).points for _, part in groups]
        else:
            sets = [points.select(points.groups == name).with_seen_targets() for name, _ in groups]
        apart = [float(np.median(distances(outliers.trimmed(arm, one), one))) for one in sets]
        whole = replace(joined([("", one) for one in sets]), session=None)
        distance = distances(outliers.trimmed(arm, whole), whole)
    except IrbcalError:
        return None
    of_group = np.repeat(np.arange(len(sets)), [len(one) for one in sets])
    together = [float(np.median(distance[of_group == k])) for k in range(len(sets))]
    most = int(np.argmax(np.array(together) / np.array(apart)))
    if together[most] < max(APART, RATIO * apart[most]):
        return None
    return groups[most][0], together[most], apart[most]


def _one(part: MeasurementSet, arm: Arm, options: Options) -> Gathered:
    """Points of one session."""
    cleaned = cleaning.clean(part)
    points, excluded, swaps = without_gross_errors(arm, cleaned, part)
    references: Mapping[str, FloatArray] = cleaned.registration.references if cleaned.registration else {}
    if options.frame is not None:
        points, references = in_frame_of(points, references, options.frame, part.source)
    shape: Mapping[str, FloatArray] = {}
    names = cleaned.points.target_names
    if options.as_poses:
        points, shape = as_poses(points, part.source)
        names = points.target_names
    return Gathered(points, motion_of(part, points), references, shape, names, excluded, [*swaps, *cleaned.notes])


def without_gross_errors(
    arm: Arm, cleaned: Cleaned, measurements: MeasurementSet
) -> tuple[PointSet, list[Exclusion], list[str]]:
    """Points that a robot of this kind can have reached, all that were left out so far, and names or rows mixed up."""
    points = cleaned.points
    found = outliers.find_gross_errors(arm, points, measurements.source, measurements)
    wrong = np.zeros(points.poses, dtype=bool)
    wrong[points.pose[~found.keep]] = True
    swaps = [(p, order) for p, order in swapped.by_robot(found.robot, points) if wrong[p]]
    truth = {(p, k): points.target_names[other] for p, order in swaps for k, other in enumerate(order) if other != k}
    from_what = f"from the robot that fits most points (model {found.level})"
    excluded = []
    for k in np.flatnonzero(~found.keep):
        target = points.target_names[points.target[k]]
        reason = f"gross error: {found.distance[k] / MM:.4g} mm {from_what}"
        other = truth.get((int(points.pose[k]), int(points.target[k])))
        if other is not None:
            reason = f"swapped: this is {other}, from where the robot expects both"
        excluded.append(cleaning.Exclusion(str(points.pose_ids[points.pose[k]]), target, reason))
    words = swapped.in_words([(points.pose_ids[p], order) for p, order in swaps], points.target_names)
    if np.count_nonzero(wrong) >= data_entry_errors.FEWEST_ROWS and not words:
        lost = data_entry_errors.find_lost_row(arm, points)
        if lost is not None and wrong.mean() > 1.0 - outliers.CORE:
            raise MeasurementError(lost.in_words(measurements), file=measurements.source)
        words = [] if lost is None else [lost.sentence(measurements)]
    return points.take(found.keep).without_empty_poses(), [*cleaned.excluded, *excluded], words


def refuse_orientations(nominal: Fit, points: PointSet, source: str) -> None:
    """Measured orientations that have nothing to do with the robot, such as a constant default in an export."""
    points = into_one_frame(points, nominal.robot.T_world_base, nominal.other_bases)
    angles = rotation_distances(nominal.robot, points)
    if len(angles) and np.median(angles) > LARGEST_TURN:
        raise MeasurementError(
            f"the orientations contradict the robot by {np.median(angles) / DEG:.3g} degrees (median): leave these "
            "columns out if they were not measured",
            file=source,
            column=("qw", "qx", "qy", "qz"),
        )


def _free_name(name: str, taken: set[str]) -> str:
    """A session's name that no other has."""
    name = name.replace("@", "-")
    number, free = 2, name
    while free in taken:
        free, number = f"{name}-{number}", number + 1
    taken.add(free)
    return free


def one_behind_the_other(motions: Sequence[Motion]) -> Motion:
    """Motions of several sessions as one; what only some of them know is zero in the others."""
    values: dict[str, Any] = {}
    for item in fields(Motion):
        own = [getattr(motion, item.name) for motion in motions]
        known = [value for value in own if value is not None]
        if item.name in LOAD and len(known) < len(own):  # a load that is told for some sessions only serves nobody
            values[item.name] = None
            continue
        if not known or isinstance(known[0], bool):
            values[item.name] = any(known) if known else None
            continue
        tail = known[0].shape[1:]
        pairs = zip(own, motions, strict=True)
        values[item.name] = np.concatenate([np.zeros((len(m), *tail)) if v is None else v for v, m in pairs])
    return Motion(**values)
