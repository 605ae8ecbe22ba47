"""Errors in rows at features, found by hypothesis: joints read otherwise, and features that moved between two rows.

Joints: where the calibrated robot misses the rows by far, each other reading of the joints
(`irbcal.identification.data_entry_errors.hypotheses`) is tried on the nominal robot, and the best are fitted with the
geometry. Moved features: the residuals of a place's rows have another mean before some row than behind it; the place is
fitted as two, and named where that explains the rows clearly better. Nothing is changed here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import FloatArray, NameArray
from irbcal.errors import IdentificationError
from irbcal.identification import data_entry_errors
from irbcal.identification.feature_fit import FeatureFit, identify_features
from irbcal.measurement.features import FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.units import MM

SUSPECT = 1.0 * MM
"""Root mean square distance from their features below which rows fit: calibrated arms leave some tenths, metres."""

FACTOR, AS_GOOD = 5.0, 1.5
"""How many times nearer rows must be for another reading to be named; readings within the second of the best are as
good, and the simplest is named."""

JUDGED = 6
"""Readings that are fitted with the geometry."""

PLACED = ("point", "pose", "sphere")
"""Kinds whose rows are near one place, by which readings are ranked."""

FEWEST = 4
"""Rows of a place before and behind its move."""

NATS, SCREEN = 50.0, 30.0
"""Log likelihood by which two places must explain the rows better than the one, and the statistic from which that is
tried. Real contacts of places that stood still reach 22 and 21; half a place turned by 3 mrad gives 90 to 150."""

MOVABLE = ("point", "pose")
"""Kinds whose residuals show where a feature moved to."""


@dataclass(frozen=True)
class Reading:
    """Another reading of the joints: its words, how far-fetched it is, and what rows miss so, metres."""

    words: str
    cost: float
    rms: float


def doubts(fit: FeatureFit) -> list[str]:
    """Sentences on rows that look wrong, each with what would explain them.

    Parameters
    ----------
    fit : FeatureFit
        Of the rows as they are, gross errors left out.
    """
    rows, arm = fit.problem.rows, fit.nominal
    if rows.corners is not None or rows.flange is not None:
        return []
    if fit.rms > SUSPECT:
        reading = other_reading(arm, rows)
        sentence = f"The calibrated robot misses these rows by {fit.rms / MM:.3g} mm (root mean square)"
        if reading is None:
            return [
                f"{sentence}, which no calibrated arm does: look for joints in another order, unit or sign, another "
                "robot's URDF, rows at another feature than they say, and features that moved."
            ]
        return [
            f"{sentence}; they look like {reading.words}: read so, by {reading.rms / MM:.3g} mm. Nothing was changed."
        ]
    moved = moved_place(fit)
    return [moved] if moved else []


def other_reading(arm: Arm, rows: FeatureSet) -> Reading | None:
    """The simplest reading of the joints by which the rows fit clearly better; None where there is none."""
    placed = np.isin(rows.kind.astype(str), PLACED) & (rows.feature != "")
    if np.count_nonzero(placed) < 0.5 * len(rows):
        return None
    some = rows.select(placed)
    readings = [each for each in data_entry_errors.hypotheses(arm) if not each.late]
    ranked = sorted(readings, key=lambda each: _nominal_misfit(arm, some, each.joints(some.q)))
    fitted: list[Reading] = []
    for each in ranked[:JUDGED]:
        if each.words:
            misfit = _fitted_misfit(arm, replace(rows, q=each.joints(rows.q)))
            fitted.append(Reading(" and ".join(each.words), each.cost, misfit))
    best = min((each.rms for each in fitted), default=np.inf)
    if best > _fitted_misfit(arm, rows) / FACTOR:
        return None
    return min((each for each in fitted if each.rms <= AS_GOOD * best), key=lambda each: each.cost)


def _nominal_misfit(arm: Arm, rows: FeatureSet, q: FloatArray) -> float:
    """Median distance of the tool's points from their places, both in closed form, as a share of the flange's ways.

    For joints (n, k) on the nominal arm. Of joints that hardly move any tool fits.
    """
    T = arm.forward(q)
    targets, target = np.unique(rows.target.astype(str), return_inverse=True)
    features, feature = np.unique(rows.feature.astype(str), return_inverse=True)
    A = np.zeros((len(q), 3, 3 * (len(targets) + len(features))))
    n, each = np.arange(len(q))[:, None], np.arange(3)
    A[n, :, 3 * target.ravel()[:, None] + each] = T[:, :3, :3].transpose(0, 2, 1)
    A[n, each, 3 * len(targets) + 3 * feature.ravel()[:, None] + each] = -1.0
    flat, right = A.reshape(-1, A.shape[2]), -T[:, :3, 3].ravel()
    residual = right - flat @ (np.linalg.pinv(flat.T @ flat, rcond=1e-10, hermitian=True) @ (flat.T @ right))
    ways = max(float(np.sqrt(np.var(T[:, :3, 3], axis=0).sum())), 1e-9)
    return float(np.median(np.linalg.norm(residual.reshape(-1, 3), axis=1))) / ways


def _fitted_misfit(arm: Arm, rows: FeatureSet) -> float:
    """Root mean square distance of rows from their features with the geometry fitted, metres."""
    try:
        return identify_features(arm, rows, choices=[()], bare=True).rms
    except (IdentificationError, np.linalg.LinAlgError):
        return np.inf


def moved_place(fit: FeatureFit) -> str:
    """A sentence on the place that moved most clearly between two of its rows; empty where none did."""
    rows, arm = fit.problem.rows, fit.nominal
    place = rows.places("place") if "place" in rows.cells.columns else rows.places()
    residuals = np.full((len(rows), 3), np.nan)
    for group in fit.problem.group_residuals(fit.state):
        if group.group.kind.name in MOVABLE and group.group.feature.centre is None and not group.group.measured:
            residuals[group.group.rows] = group.residuals.r[:, :3]
    best, name, first = SCREEN, None, 0
    for label in dict.fromkeys(place.tolist()):
        of_place = np.flatnonzero((place == label) & np.isfinite(residuals).all(axis=1))
        statistic, split = _change(residuals[of_place], float(np.nanmean(residuals**2)))
        if statistic > best:
            best, name, first = statistic, label, int(of_place[split])
    if name is None:
        return ""
    later = (place == name) & (np.arange(len(rows)) >= first)
    one = identify_features(arm, rows, choices=[()], bare=True)
    try:
        two = identify_features(arm, _divided(rows, later), choices=[()], bare=True)
    except IdentificationError:
        return ""
    if 3.0 * len(rows) * np.log(one.rms / two.rms) < NATS:
        return ""
    shifts = [
        float(np.linalg.norm(two.state.values["centre", f"{feature}{LATER}"] - two.state.values["centre", feature]))
        for feature in dict.fromkeys(rows.feature[later].tolist())
        if ("centre", feature) in two.state.values
    ]
    size = f" by {max(shifts) / MM:.2f} mm" if shifts else ""
    length = "" if shifts else " (or a known length between its features is wrong)"
    return (
        f"{name} moved{size}{length} from row {rows.row[first]} on: taken as two places the rows are met within "
        f"{two.rms / MM:.3f} mm (root mean square, geometry fitted), as one within {one.rms / MM:.3f} mm. Nothing was "
        "changed: name its features otherwise from that row on, or leave these rows out."
    )


LATER = " later"
"""What the names of features end with behind a move."""


def _change(residuals: FloatArray, variance: float) -> tuple[float, int]:
    """How clearly the mean of residuals (n, 3) changes at the best place, in variances, and the first row behind."""
    n = len(residuals)
    if n < 2 * FEWEST:
        return 0.0, 0
    k = np.arange(FEWEST, n - FEWEST + 1)
    sums = np.cumsum(residuals, axis=0)[k - 1]
    difference = sums / k[:, None] - (residuals.sum(axis=0) - sums) / (n - k)[:, None]
    statistic = k * (n - k) / n * np.sum(difference**2, axis=1) / variance
    return float(statistic.max()), int(k[statistic.argmax()])


def _divided(rows: FeatureSet, later: NameArray) -> FeatureSet:
    """The rows, some of them at features of their own."""
    names = {name: f"{name}{LATER}" for name in dict.fromkeys(rows.feature[later].tolist())}
    feature = np.array(
        [names[name] if at else name for name, at in zip(rows.feature, later, strict=True)], dtype=object
    )
    features = dict(rows.features) | {new: replace(rows.features[name], name=new) for name, new in names.items()}
    lengths = [
        replace(each, name=f"{each.name}{LATER}", first=names[each.first], second=names[each.second])
        for each in rows.lengths
        if each.first in names and each.second in names
    ]
    present = set(feature)
    return replace(
        rows,
        feature=feature,
        features={name: item for name, item in features.items() if name in present},
        lengths=tuple(each for each in (*rows.lengths, *lengths) if {each.first, each.second} <= present),
    )
