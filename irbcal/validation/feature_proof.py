"""Proof without a tracker: whole places are left out of the fit, and judged by how their rows agree with themselves.

Never single rows: the other rows at a feature would tell its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, Locked, NameArray
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification.choices import LEAST_SQUARES, Goal
from irbcal.identification.feature_fit import held_out, identify_features
from irbcal.identification.feature_sections import PlaceRow
from irbcal.identification.observations import KINDS
from irbcal.measurement.features import FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import Parameter
from irbcal.option_values import Progress

PLACE = "place"
"""The column that names places unless another is named."""

NONE = "none"
"""Leave nothing out."""

MOST_PARTS = 12
"""Places that are left out one at a time; more are left out in as many parts."""

TRACKER, PARTS = "tracker", 4
"""Poses that only a tracker saw are left out in so many parts."""

BY_POSES = "part of the poses"
"""What is left out where there is one feature, whose rows tell more than its place."""


@dataclass(frozen=True, eq=False)
class FeatureProof(Locked):
    """All places, each held out in turn."""

    by: str
    """What was left out: the column's name, or ``features``."""
    places: tuple[PlaceRow, ...]
    missed: FloatArray
    """Shape (2, rows). What each row of the whole set missed about features fitted again while its place was left out,
    with the nominal and the calibrated robot, metres; NaN where it never was.
    """
    relations: Mapping[str, tuple[float, float]]
    """Known minus fitted lengths and angles at places left out, nominal and calibrated, metres or radians."""


def labels(rows: FeatureSet, leave_out: str | None, seed: int = 0) -> tuple[str, NameArray]:
    """What is left out together, for each row, and what it is called.

    Raises
    ------
    MeasurementError
        If the column is not there, or divides rows that tell one feature's place.
    OptionError
        If it is the pose, which is no place.
    """
    spread = all(KINDS[kind].spread for kind in set(rows.kind) if kind in KINDS)
    if leave_out == "row" or (leave_out == "pose" and not spread):
        raise OptionError(
            "leave_out: rows at one feature prove nothing about each other: name a column of whole places",
            parameter="leave_out",
        )
    column = leave_out or (PLACE if PLACE in rows.cells.columns else None)
    out = rows.left_out_together(column).astype(object)
    if column is None:
        tracked = np.flatnonzero(out == TRACKER)
        poses = np.unique(rows.pose_index[tracked])
        group = np.random.default_rng(seed).permutation(len(poses)) * PARTS // max(len(poses), 1)
        number = dict(zip(poses.tolist(), group.tolist(), strict=True))
        for k in tracked:
            out[k] = f"{TRACKER} {number[int(rows.pose_index[k])] + 1}"
        if spread and len(set(out)) == 1 and rows.corners is not None:
            return BY_POSES, _parts(rows)
        return "features", out
    for name in rows.features:
        mask = rows.feature == name
        unsplit = [kind for kind in set(rows.kind[mask]) if kind in KINDS and not KINDS[kind].spread]
        if unsplit and len(set(out[mask])) > 1:
            at = int(np.flatnonzero(mask & (out != out[mask][0]))[0])
            raise MeasurementError(
                f"feature {name} is at {out[mask][0]} and at {out[at]}: whole features are left out, never some of "
                "their rows",
                file=rows.source,
                row=int(rows.row[at]),
                column=column,
            )
    return column, out


def _parts(rows: FeatureSet) -> NameArray:
    """Poses in `PARTS` parts, by turns: where all rows are at one feature, it stays where the others put it."""
    number = np.unique(rows.pose_index, return_inverse=True)[1] % PARTS
    return np.array([f"part {k + 1} of {PARTS}" for k in number], dtype=object)


def prove(
    arm: Arm,
    rows: FeatureSet,
    leave_out: str | None = None,
    terms: str | Sequence[Parameter] = "joint-map",
    seed: int = 0,
    progress: Progress | None = None,
    goal: Goal = LEAST_SQUARES,
) -> FeatureProof | None:
    """Leave each place out in turn: fit the rest, place its features again, see how well its rows agree.

    Parameters
    ----------
    arm : Arm
        Nominal.
    rows : FeatureSet
    leave_out : str, optional
        Column that names places; ``place`` where there is one, else features that lengths or poses tie together.
        ``none`` for no proof.
    terms, seed
        As `irbcal.identification.feature_fit.identify_features`; which poses of a tracker go together.
    progress : callable, optional
    goal : Goal
        As of the fit.

    Returns
    -------
    FeatureProof or None
        None where there is but one place.

    Raises
    ------
    MeasurementError
        If a column cannot serve.
    IdentificationError
        If the rest does not do without a place.
    """
    if leave_out == NONE:
        return None
    by, label = labels(rows, leave_out, seed)
    names = list(dict.fromkeys(label))
    if len(names) < 2:
        return None
    groups = [names[k::MOST_PARTS] for k in range(min(MOST_PARTS, len(names)))]
    places, missed, relations = [], np.full((2, len(rows)), np.nan), dict[str, tuple[float, float]]()
    for group in groups:
        in_group = np.isin(label.astype(str), group)
        title = ", ".join(str(name) for name in group)
        if progress:
            progress(f"leaving out {title}")
        try:
            fit = identify_features(arm, rows.select(~in_group), terms, bare=True, goal=goal)
            nominal, calibrated = (
                held_out(fit, rows.select(in_group), which, rows.relations) for which in (False, True)
            )
        except IdentificationError as error:
            raise IdentificationError(
                f"without {by} {title} the rest does not do ({error}): measure at more places, or --leave-out none for "
                "a calibration without proof"
            ) from None
        missed[:, in_group] = nominal[0], calibrated[0]
        places.append(PlaceRow.from_misses(title, nominal[0], calibrated[0]))
        for name, wrong_by in calibrated[1].items():
            # of a length between two places each is left out once: the larger error counts
            if name not in relations or abs(wrong_by) > abs(relations[name][1]):
                relations[name] = nominal[1][name], wrong_by
    return FeatureProof(by, tuple(places), missed, relations)
