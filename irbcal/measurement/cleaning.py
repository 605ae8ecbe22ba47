"""Cleaning: from the table as measured to points that can be trusted, with a reason for every point left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement.motions import previous_stops
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.registration import Registration, register, without_noise
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import inputs
from irbcal.section import Name, Section, Sentence
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM
from irbcal.wording import counted, first_of

SAME_SHAPE = 0.5 * MM
"""Deviation of all distances of a rigid tool below which two poses show the same shape, metres."""
OTHER_SHAPE = 1.0 * MM
"""Deviation above which they do not."""
CANDIDATES = 60
"""Poses that are tried as the one that most others look like."""
MOST_TARGETS = 6
"""Beyond, permutations are too many to be tried."""
EXCHANGE_FROM = 5 * MM
"""Largest distance of a pose's points from the robot below which no exchange is looked for, metres."""
CLOSER = 0.2
"""Share of that distance to which an exchange must bring it."""


def by_shape(measured: FloatArray) -> list[tuple[int, IntArray]]:
    """Poses whose targets have the distances of most other poses once their names are exchanged.

    Parameters
    ----------
    measured : ndarray, shape (n, k, 3)
        Targets on a rigid tool as measured in each pose, metres; NaN where not seen.

    Returns
    -------
    list of (pose, order)
        ``order[k]`` is the target that is called ``k`` in this pose.
    """
    n, k, _ = measured.shape
    if not 3 <= k <= MOST_TARGETS or n < 3:
        return []
    i, j = np.triu_indices(k, 1)
    D = np.stack([np.linalg.norm(measured[:, a] - measured[:, b], axis=1) for a, b in zip(i, j, strict=True)])
    full = np.flatnonzero(np.isfinite(D).all(axis=0))
    if len(full) < 3:
        return []
    D = D[:, full]

    def off_from(shape: FloatArray) -> FloatArray:
        return np.abs(D - shape[:, None]).max(axis=0)

    tried = np.unique(np.linspace(0, len(full) - 1, CANDIDATES).astype(int))
    alike = np.array([np.count_nonzero(off_from(D[:, c]) < SAME_SHAPE) for c in tried])
    shape = np.median(D[:, off_from(D[:, tried[np.argmax(alike)]]) < SAME_SHAPE], axis=1)
    distances = np.zeros((k, k))
    distances[i, j] = distances[j, i] = shape
    out = []
    for row in np.flatnonzero(off_from(shape) > OTHER_SHAPE):
        p = full[row]
        orders = [np.array(order) for order in permutations(range(k))]
        off = [np.abs(D[:, row] - distances[np.ix_(order, order)][i, j]).max() for order in orders]
        if min(off) < SAME_SHAPE:
            out.append((int(p), orders[int(np.argmin(off))]))
    return out


def by_robot(robot: Robot, points: PointSet) -> list[tuple[int, IntArray]]:
    """Poses whose points a robot meets once their names are exchanged; as `by_shape`, of all the points' targets."""
    k = len(points.target_names)
    if not 2 <= k <= MOST_TARGETS:
        return []
    distance = distances(robot, points)
    worst = np.zeros(points.poses)
    np.maximum.at(worst, points.pose, distance)
    far = np.flatnonzero(worst > EXCHANGE_FROM)
    if not len(far):
        return []
    far_points = points.select(np.isin(np.arange(points.poses), far))
    # where each pose's points would be expected, were they any of the targets: (poses, targets, 3)
    n = far_points.poses
    every = PointSet(
        far_points.q,
        np.repeat(np.arange(n), k),
        np.tile(np.arange(k), n),
        np.zeros((n * k, 3)),
        far_points.target_names,
        far_points.pose_ids,
        far_points.groups,
        previous=far_points.previous,
    )
    expected = every.predicted(robot).reshape(n, k, 3)
    measured = np.full((n, k, 3), np.nan)
    measured[far_points.pose, far_points.target] = far_points.xyz
    best = worst[far] * CLOSER
    best_order = np.full((n, k), -1)
    for permutation in permutations(range(k)):
        off = np.linalg.norm(measured - expected[:, permutation], axis=2)
        largest: FloatArray = np.where(np.isfinite(off), off, 0.0).max(axis=1)
        improved = largest < best
        best[improved] = largest[improved]
        best_order[improved] = permutation
    return [(int(far[row]), best_order[row]) for row in np.flatnonzero(best_order[:, 0] >= 0)]


def in_words(swaps: Sequence[tuple[object, IntArray]], names: Sequence[str]) -> list[str]:
    """Sentences on exchanged names.

    Parameters
    ----------
    swaps : sequence of (pose, order)
        Names of the poses, and as `by_shape`.
    names : sequence of str
        Of the targets.

    Returns
    -------
    list of str
        One for each exchange.
    """
    by_order: dict[tuple[int, ...], list[str]] = {}
    for pose, order in swaps:
        by_order.setdefault(tuple(order.tolist()), []).append(str(pose))
    out = []
    for change, poses in by_order.items():
        moved = [k for k, target in enumerate(change) if target != k]
        if len(moved) == 2:
            mixed = f"{names[moved[0]]} and {names[moved[1]]} are swapped"
        else:
            mixed = f"{', '.join(names[k] for k in moved)} are in truth {', '.join(names[change[k]] for k in moved)}"
        first = f"pose {poses[0]}" if len(poses) == 1 else f"{len(poses)} poses ({poses[0]} to {poses[-1]})"
        out.append(f"{mixed} in {first}: correct their names in the file.")
    return out


DISTANCE_FLOOR = 0.2 * MM
"""Smallest deviation of a distance between rigid points that is called wrong, metres."""

DISTANCE_FACTOR = 12.0
"""The same as a multiple of the distances' robust standard deviation."""

DISTANCE_CEILING = 1.0 * MM
"""Deviation that is always called wrong, however much the distances vary, metres."""

MOVED = 0.05
"""Share of the poses with a wrong reference above which the user is told that it seems to have moved."""


LOST, UNKNOWN_TARGET, WRONG_REFERENCE = "lost", "target unknown to the calibration", "wrong reference"
"""Kinds of reasons of points that were not there to be used."""


class Exclusion(Section):
    """A point that was left out."""

    pose: Name
    target: Name
    reason: Sentence
    """Its kind, and optionally a colon and more."""

    @property
    def kind(self) -> str:
        """Of the reason."""
        return kind_of(self.reason)


def kind_of(reason: str) -> str:
    """The kind of a reason for which a point is left out."""
    return reason.partition(":")[0]


def _by_reason(excluded: Sequence[Exclusion]) -> dict[str, list[str]]:
    """The points that were left out, by the kind of their reason."""
    points: dict[str, list[str]] = {}
    for point in excluded:
        points.setdefault(point.kind, []).append(f"{point.pose}/{point.target}")
    return points


def left_out(excluded: Sequence[Exclusion], limit: int | None = 8, more: str = "") -> list[str]:
    """Lines that count the points left out, then by reason, and name the first of each; none without such points.

    Parameters
    ----------
    excluded : sequence of Exclusion
    limit : int or None
        Points that are named for each reason; None for all.
    more : str
        What follows their number.
    """
    lines = [
        f"  {len(names)} × {reason} (pose/target {first_of(names, limit)})"
        for reason, names in _by_reason(excluded).items()
    ]
    return [f"Left out: {counted(len(excluded), 'point')}{more}", *lines] if excluded else []


@dataclass(frozen=True, eq=False, repr=False)
class Cleaned(Result):
    """Points fit for use."""

    points: PointSet
    number: IntArray
    """Shape (n,). Number of each pose in the file (``pose_index``), which tells poses of one name apart."""
    excluded: tuple[Exclusion, ...]
    registration: Registration | None
    notes: tuple[str, ...]
    """What the user should know, in sentences."""

    ROWS, COLUMNS = "excluded", "pose target reason"

    def report(self) -> Sequence[Paragraph]:
        """Counts and notes; a table of the reasons for which points were left out."""
        lines: list[Paragraph] = [
            f"{len(self.points)} points of {self.points.poses} poses can be used, {len(self.excluded)} are left out",
            *self.notes,
        ]
        if self.excluded:
            rows = tuple((reason, len(names), names[0]) for reason, names in _by_reason(self.excluded).items())
            lines.append(Table("Left out", ("reason", "points", "first (pose/target)"), rows))
        return lines


@dataclass(eq=False)
class _CheckedRows:
    """The rows of a table while reasons to leave them out are found; changed in place."""

    pose: IntArray
    target: NameArray
    reference: BoolArray
    xyz: FloatArray
    rotation: FloatArray | None
    reason: NameArray
    """Empty as long as a row is good."""

    @classmethod
    def from_measurements(cls, measurements: MeasurementSet) -> _CheckedRows:
        """All rows; those without a position are lost."""
        xyz = measurements.positions()
        reason = np.full(len(xyz), "", dtype=object)
        reason[np.isnan(xyz).any(axis=1)] = f"{LOST}: no position"
        return cls(
            measurements.cells["pose_index"],
            measurements.cells["target"],
            measurements.is_reference(),
            xyz,
            measurements.rotations(),
            reason,
        )

    @property
    def good(self) -> BoolArray:
        """Rows that nothing speaks against."""
        return self.reason == ""

    @property
    def tool(self) -> BoolArray:
        """Rows of targets on the tool."""
        return ~self.reference


def clean(
    measurements: MeasurementSet,
    references: Mapping[str, FloatArray] | None = None,
    only_targets: Sequence[str] | Mapping[str, FloatArray] | None = None,
) -> Cleaned:
    """Leave out lost points, wrong references and distances that do not fit; register the rest.

    Parameters
    ----------
    measurements : MeasurementSet
    references : dict of str to ndarray, optional
        References of an earlier calibration to register to, metres.
    only_targets : sequence of str, optional
        Targets to use, in this order; other targets are left out with that reason. By default all, sorted. Names that
        differ from these, or from those of the references, in upper and lower case only are the same.

    Raises
    ------
    MeasurementError
        If nothing is left.
    """
    rows = _CheckedRows.from_measurements(measurements)
    rows.target = _as_known(rows.target, [*(only_targets or ()), *(references or ())])
    registration, notes = _registered(rows, references, measurements.source)
    names = sorted(set(rows.target[rows.tool])) if only_targets is None else list(only_targets)
    rows.reason[rows.tool & ~np.isin(rows.target, names) & rows.good] = UNKNOWN_TARGET
    swaps = _mark_swapped(rows, names, measurements)
    _mark_wrong_distances(rows, names)
    pose = measurements.cells["pose"]
    excluded = tuple(
        Exclusion(pose=p, target=t, reason=r)
        for p, t, r in zip(pose[~rows.good], rows.target[~rows.good], rows.reason[~rows.good], strict=True)
    )
    keep = rows.tool & rows.good
    if not keep.any():
        if rows.reference.all():
            raise MeasurementError(
                "there are only reference points, no reflector on the tool", file=measurements.source
            )
        raise MeasurementError(
            f"no usable point is left of {int(rows.tool.sum())}: {excluded[0].reason}", file=measurements.source
        )
    notes = [*measurements.notes, *swaps, *measurements.joint_notes(), *notes]
    return Cleaned(*_point_set(measurements, rows, keep, names), excluded, registration, tuple(notes))


def _as_known(target: NameArray, known: Sequence[str]) -> NameArray:
    """Targets by the names that are known, of which they may differ in upper and lower case."""
    by_lower = {name.lower(): name for name in known}
    present = set(target)
    spelt = {name: by_lower.get(name.lower(), name) for name in present - {*known}}
    if len({name.lower() for name in present}) < len(present):  # the file tells them apart
        return target
    return np.array([spelt.get(name, name) for name in target], dtype=object)


def _registered(
    rows: _CheckedRows, references: Mapping[str, FloatArray] | None, source: str
) -> tuple[Registration | None, list[str]]:
    """Register the rows in place by their references; what the user should know of it."""
    names = sorted(set(rows.target[rows.reference]))
    measured = by_pose(rows.pose, rows.target, rows.xyz, rows.reference & rows.good, names)
    _mark_wrong_references(measured, names, rows)
    notes, registration = _moved_references(rows), None
    if names:
        measured = by_pose(rows.pose, rows.target, rows.xyz, rows.reference & rows.good, names)
        registration = register(measured, names, source, references)
        if registration is None:
            notes.append(
                f"The references {', '.join(names)} were not used: registration needs three in a pose"
                + (" that the calibration knows." if references is not None else ".")
            )
    elif references:
        notes.append("There are no reference points: the points are taken to be in the calibration's frame.")
    if registration is not None:
        registration = without_noise(registration, measured, names)
        T = registration.T_frame_pose[rows.pose]
        rows.xyz = np.einsum("nij,nj->ni", T[:, :3, :3], rows.xyz) + T[:, :3, 3]
        rows.rotation = None if rows.rotation is None else T[:, :3, :3] @ rows.rotation
        missing = int((~registration.with_references).sum())
        if missing:
            notes.append(
                f"{missing} of {len(registration.with_references)} poses saw fewer than three references: their "
                "registration is interpolated between the neighbouring poses."
            )
    return registration, notes


def _point_set(
    measurements: MeasurementSet, rows: _CheckedRows, keep: BoolArray, names: Sequence[str]
) -> tuple[PointSet, IntArray]:
    """The rows to keep as points sorted by pose, of the targets that they hold, and the numbers of the poses."""
    table, u95 = measurements.cells, measurements.uncertainties()
    names = [name for name in names if (keep & (rows.target == name)).any()]
    groups = table["group"] if "group" in table.columns else np.full(len(table), "", object)
    rows_kept = np.flatnonzero(keep)
    rows_kept = rows_kept[np.argsort(rows.pose[rows_kept], kind="stable")]
    poses_used, number = np.unique(rows.pose[rows_kept], return_inverse=True)
    first = np.unique(rows.pose, return_index=True)[1]
    told = {name: measurements.input(name) for name in inputs()}
    points = PointSet(
        measurements.joints()[poses_used],
        number,
        _numbers(rows.target[rows_kept], names),
        rows.xyz[rows_kept],
        tuple(names),
        table["pose"][first][poses_used],
        groups[first][poses_used],
        None if rows.rotation is None else rows.rotation[rows_kept],
        None if u95 is None else u95[rows_kept],
        previous_stops(measurements.joints(), rows.pose, groups)[poses_used],
        inputs={name: values[poses_used] for name, values in told.items() if values is not None},
    )
    return points, poses_used


def _numbers(target: NameArray, names: Sequence[str]) -> IntArray:
    """Place of each target among the names."""
    out = np.zeros(len(target), dtype=int)
    for k, name in enumerate(names):
        out[target == name] = k
    return out


def by_pose(pose: IntArray, target: NameArray, xyz: FloatArray, use: BoolArray, names: Sequence[str]) -> FloatArray:
    """Positions as an array (poses, names, 3), NaN where absent; repeated points are averaged."""
    n = pose.max() + 1
    total, count = np.zeros((n, len(names), 3)), np.zeros((n, len(names), 1))
    for k, name in enumerate(names):
        rows = np.flatnonzero(use & (target == name))
        for axis in range(3):
            total[:, k, axis] = np.bincount(pose[rows], xyz[rows, axis], n)
        count[:, k, 0] = np.bincount(pose[rows], minlength=n)
    with np.errstate(invalid="ignore"):
        return total / np.where(count > 0, count, np.nan)


def _wrong_points(measured: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Which points of each pose do not keep their distances to the others, and by how much.

    Parameters
    ----------
    measured : ndarray, shape (n, k, 3)

    Returns
    -------
    wrong : ndarray of bool, shape (n, k)
    deviation : ndarray, shape (n, k)
        Largest deviation of a wrong point's distances from their median, metres.
    """
    n, k, _ = measured.shape
    deviation = np.zeros((n, k, k))
    for i in range(k):
        for j in range(i):
            distance = np.linalg.norm(measured[:, i] - measured[:, j], axis=1)
            have = np.isfinite(distance)
            if have.sum() < 3:
                continue
            off = np.abs(distance - np.median(distance[have]))
            limit = max(DISTANCE_FLOOR, min(DISTANCE_CEILING, DISTANCE_FACTOR * 1.4826 * np.median(off[have])))
            deviation[:, i, j] = deviation[:, j, i] = np.where(have & (off > limit), off, 0.0)
    wrong = np.zeros((n, k), dtype=bool)
    worst = deviation.max(axis=2)
    while (deviation > 0).any():
        # the point with most bad distances is the wrong one; of two with one bad distance, neither is known good
        bad = (deviation > 0).sum(axis=2)
        rows = bad.max(axis=1) > 0
        now = rows[:, None] & (bad == bad.max(axis=1, keepdims=True))
        wrong |= now
        deviation[now] = 0.0
        deviation.transpose(0, 2, 1)[now] = 0.0
    return wrong, np.where(wrong, worst, 0.0)


def _mark_wrong_references(measured: FloatArray, names: Sequence[str], rows: _CheckedRows) -> None:
    """A reference that contradicts the others puts its whole pose in doubt: all its points are left out."""
    if len(names) < 2:
        return
    wrong, deviation = _wrong_points(measured)
    for p in np.flatnonzero(wrong.any(axis=1)):
        bad = [names[k] for k in np.flatnonzero(wrong[p]).tolist()]
        off = deviation[p].max() / MM
        for row in np.flatnonzero((rows.pose == p) & rows.good):
            if rows.reference[row] and rows.target[row] in bad:
                rows.reason[row] = f"{WRONG_REFERENCE}: its distance to another one is off by {off:.3g} mm"
            else:
                rows.reason[row] = f"pose left out: its reference {' and '.join(bad)} is off by {off:.3g} mm"


def _moved_references(rows: _CheckedRows) -> list[str]:
    """A note for every reference that is wrong in many poses: it was moved, not confused."""
    poses = len(np.unique(rows.pose))
    wrong = np.array([kind_of(reason) == WRONG_REFERENCE for reason in rows.reason], dtype=bool)
    notes = []
    for name in sorted(set(rows.target[rows.reference])):
        count = len(np.unique(rows.pose[wrong & (rows.target == name)]))
        if count > MOVED * poses:
            notes.append(
                f"The reference {name} contradicts the others in {count} of {poses} poses, which are left out: it "
                "seems to have moved. Leave its rows out of the file if the others can do without it."
            )
    return notes


def _mark_swapped(rows: _CheckedRows, names: Sequence[str], measurements: MeasurementSet) -> list[str]:
    """Targets that have the tool's shape by other names are left out; what is swapped, in sentences."""
    measured = by_pose(rows.pose, rows.target, rows.xyz, rows.tool & rows.good, names)
    swaps = by_shape(measured)
    for p, order in swaps:
        for k in np.flatnonzero(order != np.arange(len(names))).tolist():
            mask = (rows.pose == p) & (rows.target == names[k]) & rows.good
            rows.reason[mask] = f"swapped: this is {names[order[k]]}, by its distances to the others"
    pose_names = measurements.per_pose("pose")
    return in_words([(pose_names[p], order) for p, order in swaps], names)


def _mark_wrong_distances(rows: _CheckedRows, names: Sequence[str]) -> None:
    """A target that does not keep its distances to the others on the rigid tool is left out."""
    if len(names) < 2:
        return
    measured = by_pose(rows.pose, rows.target, rows.xyz, rows.tool & rows.good, names)
    wrong, deviation = _wrong_points(measured)
    for p, k in np.argwhere(wrong).tolist():
        mask = (rows.pose == p) & (rows.target == names[k]) & rows.good
        rows.reason[mask] = (
            f"wrong distance: off by {deviation[p, k] / MM:.3g} mm to another reflector on the rigid tool"
        )
