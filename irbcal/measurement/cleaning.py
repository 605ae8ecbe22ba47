"""Cleaning: from the table as measured to points that can be trusted, with a reason for every point left out."""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.measurement.points import PointSet
from irbcal.measurement.registration import Registration, register
from irbcal.units import MM

DISTANCE_FLOOR = 0.2 * MM
"""Smallest deviation of a distance between rigid points that is called wrong, metres."""

DISTANCE_FACTOR = 12.0
"""The same as a multiple of the distances' robust standard deviation."""

DISTANCE_CEILING = 1.0 * MM
"""Deviation that is always called wrong, however much the distances vary, metres."""

MOVED = 0.05
"""Share of the poses with a wrong reference above which the user is told that it seems to have moved."""


@dataclass(frozen=True)
class Exclusion:
    """A point that was left out.

    Attributes
    ----------
    pose : str
    target : str
    reason : str
    """

    pose: str
    target: str
    reason: str


@dataclass(frozen=True, eq=False)
class Cleaned:
    """Points fit for use.

    Attributes
    ----------
    points : PointSet
    excluded : list of Exclusion
    registration : Registration or None
    notes : list of str
        What the user should know, in sentences.
    """

    points: PointSet
    excluded: list
    registration: Registration | None
    notes: list


def clean(measurements, places=None, only_targets=None):
    """Leave out lost points, wrong references and distances that do not fit; register the rest.

    Parameters
    ----------
    measurements : MeasurementSet
    places : dict of str to ndarray, optional
        References of an earlier calibration to register to, metres.
    only_targets : sequence of str, optional
        Targets to use, in this order; other targets are left out with that reason. By default all, sorted.

    Returns
    -------
    Cleaned

    Raises
    ------
    MeasurementError
        If nothing is left.
    """
    table = measurements.table
    source = measurements.source
    pose = table["pose_index"].to_numpy()
    xyz = measurements.positions()
    rotation, u95 = measurements.rotations(), measurements.uncertainties()
    target = table["target"].to_numpy(dtype=object)
    reference = measurements.is_reference()
    reason = np.full(len(table), "", dtype=object)
    reason[np.isnan(xyz).any(axis=1)] = "lost: no position"
    notes = []

    reference_names = sorted(set(target[reference]))
    seen = by_pose(pose, target, xyz, reference & (reason == ""), reference_names)
    _mark_wrong_references(seen, reference_names, pose, target, reference, reason)
    registration = None
    notes += _moved_references(pose, target, reference, reason)
    if reference_names:
        good = reference & (reason == "")
        seen = by_pose(pose, target, xyz, good, reference_names)
        registration = register(seen, reference_names, source, places)
        if registration is None:
            notes.append(
                f"The references {', '.join(reference_names)} were not used: registration needs three in a pose"
                + (" that the calibration knows." if places is not None else ".")
            )
    elif places:
        notes.append("There are no reference points: the points are taken to be in the calibration's frame.")
    if registration is not None:
        T = registration.T_frame_pose[pose]
        xyz = np.einsum("nij,nj->ni", T[:, :3, :3], xyz) + T[:, :3, 3]
        rotation = None if rotation is None else T[:, :3, :3] @ rotation
        missing = int((~registration.own).sum())
        if missing:
            notes.append(
                f"{missing} of {len(registration.own)} poses saw fewer than three references: their registration is "
                "interpolated between the neighbouring poses."
            )

    target_names = sorted(set(target[~reference])) if only_targets is None else list(only_targets)
    strange = ~reference & ~np.isin(target, target_names) & (reason == "")
    reason[strange] = "target unknown to the calibration"
    _mark_wrong_distances(pose, target, xyz, ~reference, target_names, reason)

    keep = ~reference & (reason == "")
    excluded = [
        Exclusion(p, t, r)
        for p, t, r in zip(table["pose"][reason != ""], target[reason != ""], reason[reason != ""], strict=True)
    ]
    if not keep.any():
        if reference.all():
            raise MeasurementError(f"{source}: there are only reference points, no target on the tool")
        why = excluded[0].reason
        raise MeasurementError(f"{source}: no usable point is left of {int((~reference).sum())}: {why}")
    target_names = [name for name in target_names if (keep & (target == name)).any()]
    groups = table["group"].to_numpy(dtype=object) if "group" in table.columns else np.full(len(table), "", object)
    rows = np.flatnonzero(keep)
    rows = rows[np.argsort(pose[rows], kind="stable")]
    used, number = np.unique(pose[rows], return_inverse=True)
    first = np.unique(pose, return_index=True)[1]
    points = PointSet(
        measurements.joints()[used],
        number,
        np.array([target_names.index(name) for name in target[rows]]),
        xyz[rows],
        tuple(target_names),
        table["pose"].to_numpy(dtype=object)[first][used],
        groups[first][used],
        None if rotation is None else rotation[rows],
        None if u95 is None else u95[rows],
    )
    return Cleaned(points, excluded, registration, notes)


def by_pose(pose, target, xyz, use, names):
    """Positions as an array (poses, names, 3), NaN where absent; repeated points are averaged."""
    total = np.zeros((pose.max() + 1, len(names), 3))
    count = np.zeros((pose.max() + 1, len(names), 1))
    for k, name in enumerate(names):
        rows = np.flatnonzero(use & (target == name))
        np.add.at(total[:, k], pose[rows], xyz[rows])
        np.add.at(count[:, k], pose[rows], 1.0)
    with np.errstate(invalid="ignore"):
        return total / np.where(count > 0, count, np.nan)


def _wrong_points(seen):
    """Which points of each pose do not keep their distances to the others, and by how much.

    Parameters
    ----------
    seen : ndarray, shape (n, k, 3)

    Returns
    -------
    wrong : ndarray of bool, shape (n, k)
    deviation : ndarray, shape (n, k)
        Largest deviation of a wrong point's distances from their median, metres.
    """
    n, k, _ = seen.shape
    deviation = np.zeros((n, k, k))
    for i in range(k):
        for j in range(i):
            distance = np.linalg.norm(seen[:, i] - seen[:, j], axis=1)
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


def _mark_wrong_references(seen, names, pose, target, reference, reason):
    """A reference that contradicts the others puts its whole pose in doubt: all its points are left out."""
    if len(names) < 2:
        return
    wrong, deviation = _wrong_points(seen)
    for p in np.flatnonzero(wrong.any(axis=1)):
        bad = [names[k] for k in np.flatnonzero(wrong[p])]
        off = deviation[p].max() / MM
        mine = (pose == p) & (reason == "")
        for row in np.flatnonzero(mine):
            if reference[row] and target[row] in bad:
                reason[row] = f"wrong reference: its distance to another one is off by {off:.3g} mm"
            else:
                reason[row] = f"pose left out: its reference {' and '.join(bad)} is off by {off:.3g} mm"


def _moved_references(pose, target, reference, reason):
    """A note for every reference that is wrong in many poses: it was moved, not confused."""
    poses = len(np.unique(pose))
    wrong = np.array([text.startswith("wrong reference") for text in reason], dtype=bool)
    notes = []
    for name in sorted(set(target[reference])):
        count = len(np.unique(pose[wrong & (target == name)]))
        if count > MOVED * poses:
            notes.append(
                f"The reference {name} contradicts the others in {count} of {poses} poses, which are left out: it "
                "seems to have moved. Leave its rows out of the file if the others can do without it."
            )
    return notes


def _mark_wrong_distances(pose, target, xyz, use, names, reason):
    if len(names) < 2:
        return
    seen = by_pose(pose, target, xyz, use & (reason == ""), names)
    wrong, deviation = _wrong_points(seen)
    for p, k in zip(*np.nonzero(wrong), strict=True):
        rows = (pose == p) & (target == names[k]) & (reason == "")
        reason[rows] = f"wrong distance: off by {deviation[p, k] / MM:.3g} mm to another target on the rigid tool"
