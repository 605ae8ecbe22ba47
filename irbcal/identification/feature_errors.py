"""Errors in rows at features, found by hypothesis: joints read otherwise, and features that moved between two rows.

Joints: where the calibrated robot misses the rows by far, each other reading of the joints
(`irbcal.identification.data_entry_errors.hypotheses`) is tried on the nominal robot, and the best are fitted with the
geometry. Moved features: the residuals of a place's rows have another mean before some row than behind it; the place is
fitted as two, and named where that explains the rows clearly better. Nothing is changed here.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError
from irbcal.identification import data_entry_errors, feature_problem
from irbcal.identification.data_entry_errors import AS_GOOD, FACTOR
from irbcal.identification.feature_fit import FeatureFit, identify_features
from irbcal.identification.feature_problem import NO_TERMS, TOOL, FeatureProblem, relation_residuals
from irbcal.identification.linear_model import Rows
from irbcal.identification.observation_kind import DIMENSIONS
from irbcal.identification.relations import RELATION_KINDS
from irbcal.measurement.features import FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.units import MM

SUSPECT = 1.0 * MM
"""Root mean square distance from their features below which rows fit: calibrated arms leave some tenths, metres."""

STATED, GIVES = 5.0, 0.4 * MM
"""How many times the stated uncertainty (95 %) rows may be missed, and what calibrated arms leave, metres."""

NEAR = 0.5 * MM
"""Distance from another feature at which a row is, metres."""

RANKED, ROUGH = 48, 15
"""Rows by which readings of other kinds are ranked, of images a quarter of it, and steps of least squares there."""

JUDGED = 6
"""Readings that are fitted with the geometry."""

PLACED = ("point", "pose", "sphere")
"""Kinds whose rows are near one place, by which readings are ranked."""

FEWEST_ROWS = 4
"""Rows of a place before and behind its move."""

NATS, SCREEN = 50.0, 30.0
"""Log likelihood by which two places must explain the rows better than the one, and the statistic from which that is
tried. Real contacts of places that stood still reach 22 and 21; half a place turned by 3 mrad gives 90 to 150."""

ON_TOOL = 0.8
"""Share that the misfit must fall to for a target to have moved: places measured one after the other differ, too, which
two places of the tool explain in part (real contacts fall to 0.95, SIMULATED arms that warm up to 0.9)."""

REFITTED, SPLITS = 3, 200
"""Moves and lengths that are tried by fits, and rows before which a move is looked for."""

LENGTH_DEVIATIONS, AWAY = 6.0, 0.5
"""Standard deviations by which a known length may miss what a fit without it says, and the part of its uncertainty
(95 %) that it misses in the fit with it from which that is tried."""


@dataclass(frozen=True)
class Reading:
    """Another reading of the joints: its words, how far-fetched it is, and what rows miss so, metres."""

    description: str
    cost: float
    rms: float


def doubts(fit: FeatureFit) -> list[str]:
    """Sentences on rows that look wrong, each with what would explain them.

    Parameters
    ----------
    fit : FeatureFit
        Of the rows as they are, outliers left out.
    """
    rows, arm = fit.problem.rows, fit.nominal
    if rows.flange is not None:
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
            f"{sentence}; they look like {reading.description}: read so, by {reading.rms / MM:.3g} mm. Nothing was "
            "changed."
        ]
    u95 = fit.problem.u95
    stated = float(np.nanmedian(u95)) if rows.corners is None and np.isfinite(u95).any() else np.inf
    overstated = [
        f"The rows are missed by {fit.rms / MM:.3g} mm (root mean square), and {stated / MM:.3g} mm was stated as "
        "their uncertainty (95 %): touch one twice and state what it repeats to, or look for features that give way."
    ]
    cause = moved_part(fit) or wrong_relation(fit)
    return [cause] if cause else overstated if fit.rms > max(STATED * stated, GIVES) else []


def wrong_relation(fit: FeatureFit) -> str:
    """A sentence on the known length or angle that a fit without it contradicts most clearly; empty where none does."""
    problem, rows, arm = fit.problem, fit.problem.rows, fit.nominal
    u95 = np.array([each.u95 or RELATION_KINDS[each.kind].u95 for each in problem.relations])
    residuals = relation_residuals(problem.relations, fit.state.values)
    deviations = np.abs([residuals[each.name] for each in problem.relations]) / u95
    best, sentence = LENGTH_DEVIATIONS, ""
    for k in [k for k in np.argsort(-deviations)[:REFITTED] if deviations[k] > AWAY]:
        relation = problem.relations[k]
        other_rows = replace(rows, relations=tuple(each for each in rows.relations if each is not relation))
        try:
            without = identify_features(arm, other_rows, choices=[()], bare=True)
        except IdentificationError:
            continue
        J = problem.known_rows(without.state, len(without.step_covariance)).J[:, k] / without.problem.sizes
        J *= np.sqrt(2.0) / np.linalg.norm(J)  # by either place a unit vector
        residual = relation_residuals([relation], without.state.values)[relation.name]
        deviation = float(np.hypot(np.sqrt(J @ without.step_covariance @ J), u95[k] / NORMAL_95))
        if abs(residual) > best * deviation:
            best = abs(residual) / deviation
            noun, unit, factor = relation.quantity
            known, fitted = (value / factor for value in (relation.value, relation.value - residual))
            sentence = (
                f"The known {noun} {relation.name} is {known:.3f} {unit}, and everything else says {fitted:.3f} {unit} "
                f"({best:.0f} standard deviations): measure it again."
            )
    return sentence


def at_another_feature(fit: FeatureFit, rows: FeatureSet, left_out: Collection[int]) -> dict[int, str]:
    """The feature that rows which were left out are at, of all features of their kind: by the row in the file.

    Parameters
    ----------
    fit : FeatureFit
        Of the other rows.
    rows : FeatureSet
        All of them.
    left_out : collection of int
        Rows of the file.
    """
    left_out_rows = rows.select(np.isin(rows.row, list(left_out)))
    values, near = fit.state.values, max(3.0 * fit.rms, NEAR)
    out: dict[int, str] = {}
    for name, feature in fit.problem.rows.features.items():
        is_candidate = (
            (left_out_rows.kind == feature.kind)
            & (left_out_rows.target == feature.target)
            & (left_out_rows.feature != name)
        )
        if not is_candidate.any():
            continue
        of_kind = left_out_rows.select(is_candidate)
        moved = replace(
            of_kind, feature=np.full(len(of_kind), name, dtype=object), features={name: feature}, relations=()
        )
        distance = FeatureProblem(fit.problem.arm, moved, fit.problem.terms, values).distances(fit.state)
        out |= {int(number): name for number, d in zip(moved.row, distance, strict=True) if d < near}
    return out


def other_reading(arm: Arm, rows: FeatureSet) -> Reading | None:
    """The simplest reading of the joints by which the rows fit clearly better; None where there is none."""
    placed = np.isin(rows.kind.astype(str), PLACED) & (rows.feature != "")
    closed = np.count_nonzero(placed) >= 0.5 * len(rows)
    part = np.random.default_rng(0).permutation(len(rows)) < (RANKED if rows.corners is None else RANKED // 4)
    some, rank = rows.select(placed if closed else part), _nominal_misfit if closed else _placed_misfit
    readings = [each for each in data_entry_errors.hypotheses(arm) if not each.late]
    ranked = sorted(readings, key=lambda each: rank(arm, some, each.joints(some.q)))
    fitted: list[Reading] = []
    for each in ranked[:JUDGED]:
        if each.descriptions:
            misfit = _fitted_misfit(arm, replace(rows, q=each.joints(rows.q)))
            fitted.append(Reading(" and ".join(each.descriptions), each.cost, misfit))
    best = min((each.rms for each in fitted), default=np.inf)
    if not np.isfinite(best) or best > _fitted_misfit(arm, rows) / FACTOR:
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


def _placed_misfit(arm: Arm, rows: FeatureSet, q: FloatArray) -> float:
    """The same of rows of any kind, tool and features by least squares."""
    problem = FeatureProblem(arm, replace(rows, q=q), ())
    try:
        distance = problem.distances(feature_problem.start(problem, steps=ROUGH))
    except (IdentificationError, np.linalg.LinAlgError):
        return np.inf
    ways = max(float(np.sqrt(np.var(arm.forward(q)[:, :3, 3], axis=0).sum())), 1e-9)
    return float(np.median(distance)) / ways


def _fitted_misfit(arm: Arm, rows: FeatureSet) -> float:
    """Root mean square distance of rows from their features with the geometry fitted, metres."""
    try:
        return identify_features(arm, rows, choices=[()], bare=True).rms
    except (IdentificationError, np.linalg.LinAlgError):
        return np.inf


@dataclass(frozen=True, eq=False)
class StepOfFeature:
    """A feature's place, or a target on the tool, that may have moved before some row."""

    name: str
    """Of the place or the target."""
    on_tool: bool
    first: int
    """Row from which on it is elsewhere."""
    later: BoolArray
    """Shape (rows,). The rows behind its move."""
    statistic: float
    """By how much rows fit better where what moved has a step of its own before and behind, in variances."""


def moved_part(fit: FeatureFit) -> str:
    """A sentence on the feature, or the tool, that moved most clearly between two rows; empty where none did."""
    rows, arm = fit.problem.rows, fit.nominal
    moves = sorted(possible_moves(fit), key=lambda move: -move.statistic)[:REFITTED]
    best: tuple[float, StepOfFeature, FeatureFit] | None = None
    # what no geometry describes hides small moves of the tool; of features it would take warm-up for a move
    as_one = {
        on_tool: identify_features(arm, rows, choices=None if on_tool else [()], bare=True)
        for on_tool in {move.on_tool for move in moves}
    }
    for move in moves:
        single_fit = as_one[move.on_tool]
        try:
            two = identify_features(arm, divided(rows, move), choices=None if move.on_tool else [()], bare=True)
        except IdentificationError:
            continue
        nats = fit.problem.scalars * float(np.log(single_fit.rms / two.rms))
        if (
            nats > NATS
            and (not move.on_tool or two.rms < ON_TOOL * single_fit.rms)
            and (best is None or nats > best[0])
        ):
            best = nats, move, two
    if best is None:
        return ""
    _, move, two = best
    single_fit = as_one[move.on_tool]
    later, values = rows.feature[move.later], two.state.values
    parts = (
        [(TOOL, move.name)] if move.on_tool else [(k, n) for n in dict.fromkeys(later) for k in ("centre", "offset")]
    )
    shifts = [
        float(np.linalg.norm(values[kind, f"{name}{LATER}"] - values[kind, name]))
        for kind, name in parts
        if (kind, name) in values and (kind, f"{name}{LATER}") in values
    ]
    size = f" by {max(shifts) / MM:.2f} mm" if shifts else ""
    length = "" if shifts else " (or a known length between its features is wrong)"
    subject = f"The target {move.name} moved on the tool" if move.on_tool else f"{move.name} moved"
    rename = "its target" if move.on_tool else "its features"
    return (
        f"{subject}{size}{length} from row {rows.row[move.first]} on: taken as two places the rows are met within "
        f"{two.rms / MM:.3f} mm (root mean square{'' if move.on_tool else ', geometry fitted'}), as one within "
        f"{single_fit.rms / MM:.3f} mm. "
        f"Nothing was changed: name {rename} otherwise from that row on, or leave these rows out."
    )


def possible_moves(fit: FeatureFit) -> list[StepOfFeature]:
    """What rows may show to have moved, by a score test of each place and each target with the robot held."""
    problem, rows = fit.problem, fit.problem.rows
    of_rows = Rows.joined([block for block in problem.dense(fit.state, NO_TERMS) if block.row.min() >= 0])
    J, e, row = of_rows.J, of_rows.y, of_rows.row
    variance = float(np.mean(e**2))
    place = rows.left_out_together("place") if "place" in rows.cells.columns else rows.left_out_together()
    candidates: list[tuple[str, bool, BoolArray, list[int]]] = []
    for on_tool, labels in ((False, place), (True, rows.target)):
        for label in dict.fromkeys(labels.astype(str).tolist()):
            of_label = labels.astype(str) == label
            names = {label} if on_tool else set(rows.feature[of_label].astype(str))
            keys = {
                key
                for group in problem.groups
                if of_label[group.rows].any() and (group.point[0] == TOOL) >= on_tool
                for key in (
                    [group.point]
                    if on_tool
                    else [k for n, k in group.keys().items() if group.kind.unknowns[n].owner == "feature"]
                )
                if key in problem.layout and key[1] in names
            }
            columns = [
                at + k for shape, at in (problem.layout[key] for key in sorted(keys)) for k in range(DIMENSIONS[shape])
            ]
            if columns:
                candidates.append((label, on_tool, of_label, columns))
    moves = []
    for label, on_tool, of_label, columns in candidates:
        at = np.flatnonzero(of_label[row])
        at = at[np.argsort(row[at], kind="stable")]
        statistic, split = _change(J[columns][:, at], e[at], row[at])
        if statistic / variance > SCREEN + 3.0 * max(len(columns) - 3, 0):
            later = of_label & (np.arange(len(rows)) >= split)
            moves.append(StepOfFeature(label, on_tool, split, later, statistic / variance))
    return moves


def _change(J: FloatArray, e: FloatArray, row: IntArray) -> tuple[float, int]:
    """How much the best two steps, before and behind a row, take from the squares of residuals more than one step.

    Parameters
    ----------
    J : ndarray, shape (columns, equations)
    e : ndarray, shape (equations,)
    row : ndarray of int, shape (equations,)
        Ascending.

    Returns
    -------
    fall : float
    first : int
        The first row behind.
    """
    numbers, start = np.unique(row, return_index=True)
    fewest = max(FEWEST_ROWS, int(np.ceil(2.0 * len(J) * len(numbers) / len(e))))
    if len(numbers) < 2 * fewest:
        return 0.0, 0
    H = np.cumsum(np.add.reduceat(np.einsum("ae,be->eab", J, J), start, axis=0), axis=0)
    g = np.cumsum(np.add.reduceat((J * e).T, start, axis=0), axis=0)
    k = np.unique(np.linspace(fewest, len(numbers) - fewest, SPLITS).round().astype(int))

    def fall(H: FloatArray, g: FloatArray) -> FloatArray:
        scale = np.sqrt(np.maximum(np.einsum("...aa->...a", H), 1e-30))
        inverse = np.linalg.pinv(H / scale[..., :, None] / scale[..., None, :], rcond=1e-6, hermitian=True)
        return np.asarray(np.einsum("...a,...ab,...b->...", g / scale, inverse, g / scale))

    both = fall(H[k - 1], g[k - 1]) + fall(H[-1] - H[k - 1], g[-1] - g[k - 1]) - fall(H[-1], g[-1])
    best = int(both.argmax())
    return float(both[best]), int(numbers[k[best]])


LATER = " later"
"""What the names of features end with behind a move."""


def divided(rows: FeatureSet, move: StepOfFeature) -> FeatureSet:
    """The rows, those behind a move at features, or with a target, of their own."""
    later = move.later
    if move.on_tool:
        return replace(rows, target=np.where(later, f"{move.name}{LATER}", rows.target).astype(object))
    names = {name: f"{name}{LATER}" for name in dict.fromkeys(rows.feature[later].tolist())}
    feature = np.array(
        [names[name] if at else name for name, at in zip(rows.feature, later, strict=True)], dtype=object
    )
    features = dict(rows.features) | {new: replace(rows.features[name], name=new) for name, new in names.items()}
    relations = [
        replace(each, name=f"{each.name}{LATER}", first=names[each.first], second=names[each.second])
        for each in rows.relations
        if each.first in names and each.second in names
    ]
    present = set(feature)
    return replace(
        rows,
        feature=feature,
        features={name: item for name, item in features.items() if name in present},
        relations=tuple(each for each in (*rows.relations, *relations) if {each.first, each.second} <= present),
    )
