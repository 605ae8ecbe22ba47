"""What moves of one joint show, from their circles alone (Nubiola 2011, sections 4.1, 4.2, 4.3 and 5.2)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, IntArray, group_means
from irbcal.errors import IdentificationError
from irbcal.identification import axes
from irbcal.identification.evidence_maximisation import (
    VARIANCE_CAP,
    NormalEquations,
    evidence_of_each,
    maximise_evidence,
)
from irbcal.joint_analysis.series import Series, home_poses, one_series
from irbcal.joint_analysis.terms import (
    HIGHEST_FREQUENCY,
    EffectKind,
    JointTerm,
    best_frequency,
    evidence_in_words,
    fourier_columns,
    fourier_names,
    frequencies,
    interval,
    name_of,
    not_tested,
    of_joints,
    play_in_words,
    quantile,
    terms_table,
)
from irbcal.measurement.column_names import JOINTS
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import direction, gain, gravity, harmonics
from irbcal.summary import Paragraph, Result, Table, TableValue
from irbcal.units import DEG, MM
from irbcal.wording import inflected, joined

GROUP = re.compile(r"axis([1-9]\d?)(?!\d).*")
"""Names of groups of one-joint moves."""

TERM_KINDS = ("backlash", "gain", "fourier", "gravity")
SIZES = {"backlash": 2 * direction.SIZES["rad"], "gain": gain.SIZE, "fourier": harmonics.SIZE, "gravity": gravity.SIZE}
"""Natural sizes of the coefficients, radians."""

SPARE = 3
"""Angles more than unknowns that a test needs."""

MANY = 8
"""Angles of which the first one, reached from nobody knows where, can be spared."""


@dataclass(frozen=True, eq=False, repr=False)
class JointMoves(Result):
    """All series of one joint and what they show together."""

    joint: int
    """Counted from 1."""
    series: tuple[Series, ...]
    backlash: JointTerm
    gain: JointTerm
    fourier: JointTerm
    gravity: JointTerm | None
    """For joints that lift the arm: one period a turn, cosine and sine, for each home pose its own, as the bending of
    an arm gives (Nubiola 2011, sections 4.3.2 and 5.3).
    """

    CONTENT = "joint series terms"

    @property
    def play(self) -> float:
        """Backlash that the other terms were freed of, radians."""
        return sure_backlash(self.backlash)

    @property
    def terms(self) -> tuple[JointTerm, ...]:
        """All terms."""
        return tuple(getattr(self, kind) for kind in TERM_KINDS if getattr(self, kind) is not None)

    def report(self) -> Sequence[Paragraph]:
        """The joint and what it needs, errors and terms as tables, and what they mean."""
        needed = ", ".join(term.kind for term in self.terms if term.needed) or "nothing"
        headline = f"joint {self.joint} moved alone in {len(self.series)} series: needs {needed}"
        return [headline, errors_table([self]), terms_table(self.terms), *of_moves([self])]


def has_moves(points: PointSet) -> bool:
    """Whether there are groups of one-joint moves."""
    return any(GROUP.fullmatch(str(group)) for group in points.groups)


def analyse_moves(
    points: PointSet,
    step: FloatArray,
    joint: int | None = None,
    order: int = 2,
    frequency: float | None = 1.0,
    columns: Sequence[str] = (),
    arm: Arm | None = None,
) -> list[JointMoves]:
    """Errors of one-joint moves, backlash, gain and Fourier series per joint.

    Nubiola 2011, sections 4.1 (all joints, moved as Table 4.1 says), 4.2 (joint 6), 4.3 (joint 2) and 5.2 (the series);
    section 7.7 takes its first guess of the series from the same analysis of 158 axis points. Poses of one group that
    differ in joints other than the moving one are separate series, such as the tests of Table 4.2 and of Table 4.4;
    each has its own circles, all series of a joint share backlash and Fourier series.

    Parameters
    ----------
    points : PointSet
    step : ndarray, shape (n, joints)
        Of `last_moves`, for the poses of ``points``.
    joint : int, optional
        Only this joint, counted from 1.
    order : int
        Of the Fourier series.
    frequency : float or None
        Periods per turn (the thesis sets 1); None: free.
    columns : sequence of str
        Of the joints in files: ``q1_deg`` and so on unless given.
    arm : Arm, optional
        Nominal: which joints weight bends follows from it, see `bent_by_weight`.

    Raises
    ------
    IdentificationError
        If there are no one-joint moves, if other joints move within a group, or if a group does not give an axis.
    """
    with_poses = points.without_empty_poses()
    step = step[np.isin(np.arange(points.poses), points.pose)]
    names = [str(group) for group in with_poses.groups]
    groups_of: dict[int, list[str]] = {}
    for name in dict.fromkeys(names):
        match = GROUP.fullmatch(name)
        if match and joint in (None, int(match[1])):
            groups_of.setdefault(int(match[1]), []).append(name)
    if not groups_of:
        which = "axis1, axis2, …" if joint is None else f"axis{joint}"
        listed = ", ".join(sorted({name for name in names if name})) or "no groups"
        raise IdentificationError(f"there are no one-joint moves in a group {which}; found {listed}")
    columns = columns or [f"q{j}_deg" for j in range(1, with_poses.q.shape[1] + 1)]
    out: list[JointMoves] = []
    for number in sorted(groups_of):
        if number > with_poses.q.shape[1]:
            raise IdentificationError(f"group {groups_of[number][0]}: there are only {with_poses.q.shape[1]} joints")
        series = [
            one_series(with_poses.select(mask), step[mask, number - 1], number, name, columns)
            for name in groups_of[number]
            for mask in home_poses(
                with_poses.q, np.array(names) == name, number, name, columns, with_poses.inputs.get("payload_kg")
            )
        ]
        out.append(_joint_moves(number, series, order, frequency, number in bent_by_weight(arm, columns)))
    return out


def bent_by_weight(arm: Arm | None, columns: Sequence[str]) -> frozenset[int]:
    """Joints, counted from 1, that lift the arm: 2 and 3 as in Nubiola 2011, section 4.3, or those of the arm's levers.

    Of an arm that is not known these are joints 2 and 3 of six that turn, and none of any other.
    """
    if arm is None:
        return frozenset((2, 3) if tuple(columns) == tuple(JOINTS) else ())
    levers = frozenset(term.joint + 1 for term in gravity.FAMILY.terms(arm) if not arm.table.prismatic[term.joint])
    return frozenset((2, 3)) if arm.bends_like_the_thesis and 1 not in levers else levers


def _joint_moves(joint: int, series: Sequence[Series], order: int, frequency: float | None, bends: bool) -> JointMoves:
    levels = [_levels(s) for s in series]
    lever = float(np.sqrt(np.mean([s.lever**2 for s in series])))
    backlash = _backlash_of_moves(joint, series, levels, lever)
    data = _Levels(series, levels, backlash)
    return JointMoves(
        joint,
        tuple(series),
        backlash,
        _gain_of_moves(joint, data, lever),
        _fourier_of_moves(joint, data, lever, order, frequency),
        _gravity_of_moves(joint, data, lever) if bends else None,
    )


def sure_backlash(term: JointTerm) -> float:
    """Backlash in radians where its interval does not hold zero, else 0."""
    if not term.values or term.low[0] <= 0.0 <= term.high[0]:
        return 0.0
    return term.values[0]


def _levels(series: Series) -> IntArray:
    """Number of the joint angle at which each pose stands; whole turns count."""
    order = np.argsort(series.turn, kind="stable")
    number = np.cumsum(np.r_[0, np.diff(series.turn[order]) > axes.SAME_ANGLE])
    out = np.empty(len(order), dtype=int)
    out[order] = number
    return out


def _backlash_of_moves(joint: int, series: Sequence[Series], levels: Sequence[IntArray], lever: float) -> JointTerm:
    """Backlash of Nubiola 2011, section 4.2: about 0.05 degrees of joint 6 there.

    From angles that were reached from both sides: their differences do not depend on how the error runs.
    """
    differences, angles, sides = list[float](), list[float](), list[float]()
    for s, number in zip(series, levels, strict=True):
        above, below = s.direction < 0, s.direction > 0
        for level in np.intersect1d(number[above], number[below]):
            here = number == level
            side_means = [float(s.angle[here & side].mean()) for side in (above, below)]
            differences.append(side_means[0] - side_means[1])
            angles += side_means
            sides += [0.5, -0.5]
    n, name = len(differences), ("backlash",)
    if n < SPARE:
        were = inflected(max(n, 1), "angle was", "angles were")
        note = f"{n or 'no'} joint {were} reached from both sides, {SPARE} are needed"
        return JointTerm("backlash", joint, name, note=note)
    difference = np.array(differences)
    mean, std = difference.mean(), max(difference.std(ddof=1) / np.sqrt(n), 1e-12)
    half = quantile(n - 1) * std
    at_level = np.repeat(np.eye(n), 2, axis=0)  # each angle has a mean of its own
    evidence = _log_evidence(at_level, np.array(sides)[:, None], np.array(angles), "backlash", lever)
    return JointTerm(
        "backlash",
        joint,
        name,
        (float(mean),),
        (float(mean - half),),
        (float(mean + half),),
        evidence,
        float(lever * abs(mean) / 2),
    )


def _log_evidence(beside: FloatArray, X: FloatArray, y: FloatArray, kind: EffectKind, lever: float) -> float:
    """Log evidence of a term beside what has no prior, of angles in radians with one weight."""
    mm = lever / MM
    J = np.concatenate([beside.T, X.T * SIZES[kind]]) * mm
    sums = NormalEquations(J @ J.T, J @ (y * mm), float(y @ y) * mm**2, len(y))
    nuisance, group, caps = beside.shape[1], np.zeros(X.shape[1], dtype=int), np.array([VARIANCE_CAP])
    found = maximise_evidence(sums, nuisance, group, caps, 1.0)
    return evidence_of_each(sums, found, nuisance, [kind] * len(group), group, caps)[kind].evidence


class _LevelFit(NamedTuple):
    """Outcome of `_Levels.fit`; covariance with that of the circles, ``variance`` that of one pose's angle, rad^2."""

    beta: FloatArray
    covariance: FloatArray
    freedom: int
    variance: float


class _Levels:
    """Angular errors of all series of a joint, a row for each joint angle, both directions in the middle.

    Where there is backlash, or may be and the other angles are `MANY`, poses that were reached from nobody knows where
    are left out. Where too few angles were reached from both sides to tell it, the direction is fitted beside every
    term.
    """

    def __init__(self, series: Sequence[Series], levels: Sequence[IntArray], backlash: JointTerm) -> None:
        play, unknown = sure_backlash(backlash), backlash.note != ""
        side: list[FloatArray] = []
        x: list[FloatArray] = []
        y: list[FloatArray] = []
        root: list[FloatArray] = []
        number_of: list[IntArray] = []
        follow: list[FloatArray] = []
        for k, (s, number) in enumerate(zip(series, levels, strict=True)):
            keep = s.direction != 0
            if play == 0.0 and not (unknown and len(np.unique(number[keep])) >= MANY):
                keep = np.ones_like(keep)
            _, number = np.unique(number[keep], return_inverse=True)
            count = np.bincount(number)
            x.append(group_means(s.turn[keep], number))
            y.append(group_means((s.angle + 0.5 * play * s.direction)[keep], number))
            root.append(np.sqrt(count))
            side.append(group_means(s.direction[keep], number))
            number_of.append(np.full(len(count), k))
            D = group_means(s.follow[keep], number)
            follow.append(D @ np.nan_to_num(s.fit.covariance) @ D.T)
        self.x, self.y, self.root = (np.concatenate(arrays) for arrays in (x, y, root))
        """``x``, ``y``: shape (r,). Joint angle and mean angular error, radians. ``root``: shape (r,). Square root of
        the number of poses.
        """
        self.series_columns = (np.concatenate(number_of)[:, None] == np.arange(len(series))).astype(float)
        """Shape (r, series). Which series a row belongs to: each has a zero of its own."""
        directions = np.concatenate(side)
        varies = any(sides.min() < 0 < sides.max() for sides in side) and len(directions) >= MANY
        self.beside = np.column_stack([self.series_columns, directions]) if unknown and varies else self.series_columns
        """Shape (r, k). ``own`` and, where backlash is not known, the direction."""
        self.covariance = np.zeros((len(self.x), len(self.x)))
        """Shape (r, r). Of ``y`` by the uncertainty of the circles."""
        start = 0
        for block in follow:
            end = start + len(block)
            self.covariance[start:end, start:end] = block
            start = end
        self.step = float(np.median(np.concatenate([np.diff(x_of_series) for x_of_series in x])))
        """Typical distance between neighbouring angles, radians."""
        self.range = float(max(np.ptp(x_of_series) for x_of_series in x))

    def fit(self, X: FloatArray, extra: int = 0) -> _LevelFit:
        """Weighted least squares of terms beside the series' zeros; ``extra`` unknowns are spent elsewhere."""
        w = self.root[:, None]
        N, X, y = np.linalg.qr(w * self.beside)[0], w * X, self.root * self.y
        rest_X, projected = X - N @ (N.T @ X), y - N @ (N.T @ y)
        P = np.linalg.pinv(rest_X)
        beta = P @ projected
        residual = projected - rest_X @ beta
        freedom = len(y) - N.shape[1] - X.shape[1] - extra
        sigma2 = max(residual @ residual / freedom, 1e-24)
        S = P * self.root
        C = sigma2 * P @ P.T + S @ self.covariance @ S.T
        return _LevelFit(beta, C, freedom, sigma2)

    def evidence(self, kind: EffectKind, X: FloatArray, lever: float) -> float:
        """Log evidence of a term beside the series' zeros, nats."""
        variance = self.fit(X).variance
        size = np.sqrt(variance)
        white = size * np.linalg.inv(np.linalg.cholesky(self.covariance + np.diag(variance / self.root**2)))
        return _log_evidence(white @ self.beside, white @ X, white @ self.y, kind, lever)


def _term_of_levels(
    kind: EffectKind,
    joint: int,
    names: tuple[str, ...],
    X: FloatArray,
    data: _Levels,
    lever: float,
    fit: _LevelFit,
    frequency: tuple[float, ...] | None = None,
    tried: int = 1,
) -> JointTerm:
    beta = fit.beta[: len(names)]
    half = quantile(fit.freedom) * np.sqrt(np.diag(fit.covariance))[: len(names)]
    effect = X[:, : len(names)] @ beta
    effect = effect - data.series_columns @ ((data.series_columns.T @ effect) / data.series_columns.sum(axis=0))
    return JointTerm(
        kind,
        joint,
        names,
        tuple(map(float, beta)),
        tuple(map(float, beta - half)),
        tuple(map(float, beta + half)),
        data.evidence(kind, X, lever) - float(np.log(tried)),
        float(lever * np.sqrt(np.mean(effect**2))),
        frequency,
    )


def _gain_of_moves(joint: int, data: _Levels, lever: float) -> JointTerm:
    """A gain of the encoder, as Nubiola 2011, eq. 3.31, has it."""
    missing = 1 + data.beside.shape[1] + SPARE - len(data.x)
    if missing > 0:
        return JointTerm("gain", joint, ("gain",), note=f"{len(data.x)} joint angles are too few")
    X = data.x[:, None]
    return _term_of_levels("gain", joint, ("gain",), X, data, lever, data.fit(X))


def _gravity_of_moves(joint: int, data: _Levels, lever: float) -> JointTerm:
    """One period a turn for each home pose: what the elbow's angle does to the curves of Nubiola 2011, Figure 4.10."""
    count = data.series_columns.shape[1]
    names = tuple(f"{letter}_{k}" for k in range(1, count + 1) for letter in "ab")
    if len(data.x) < 3 * count + SPARE:
        note = f"{len(data.x)} joint angles are too few: {3 * count + SPARE} are needed"
        return JointTerm("gravity", joint, names, note=note)
    wave = fourier_columns(data.x, 1, 1.0)
    X = (data.series_columns[:, :, None] * wave[:, None, :]).reshape(len(wave), -1)
    return _term_of_levels("gravity", joint, names, X, data, lever, data.fit(X))


def _fourier_of_moves(joint: int, data: _Levels, lever: float, order: int, frequency: float | None) -> JointTerm:
    """The Fourier series fitted to both directions (Nubiola 2011, section 5.2, Figure 5.2, Table 5.2).

    Its constant is the series' zero; omega is given, as the thesis's is in the end, or free, then with the interval of
    `irbcal.joint_analysis.terms`.
    """
    names, free = fourier_names(order), frequency is None
    needed = data.beside.shape[1] + 2 * order + free + SPARE
    # of places a turn apart, a series with one period a turn sees one
    angles = len(data.x) if free or frequency != 1.0 else len(axes.distinct_angles(data.x))
    if len(data.x) < needed or angles < 2 * order + 2:
        short = f"{len(data.x)} joint angles" if len(data.x) < needed else f"{angles} places in the turn"
        fewest = needed if len(data.x) < needed else 2 * order + 2
        return JointTerm("fourier", joint, names, note=f"{short} are too few for order {order}: {fewest} are needed")
    highest = np.pi / data.step / order
    if frequency is not None:
        if frequency > highest * (1 + 1e-9):
            note = f"steps of {data.step / DEG:.3g} degrees are too wide for order {order} at frequency {frequency:g}"
            return JointTerm("fourier", joint, names, note=note)
        X = fourier_columns(data.x, order, frequency)
        return _term_of_levels("fourier", joint, names, X, data, lever, data.fit(X), (float(frequency),))
    tried = frequencies(data.range, min(highest, HIGHEST_FREQUENCY))
    found = best_frequency(lambda f: data.fit(fourier_columns(data.x, order, f), extra=1).variance, tried)
    X = fourier_columns(data.x, order, found)
    fit = data.fit(X, extra=1)
    # one column more for the frequency itself: d/df of the series
    turned = np.column_stack([[-k, k] * data.x[:, None] for k in range(1, order + 1)])
    swapped = X.reshape(len(X), order, 2)[:, :, ::-1].reshape(len(X), -1)
    along = (turned * swapped) @ fit.beta
    free_too = data.fit(np.column_stack([X, along]))
    fit = fit._replace(covariance=free_too.covariance, freedom=free_too.freedom)
    spread = data.covariance + np.diag(free_too.variance / data.root**2)
    sure = interval(data.x, data.y, spread, data.beside, order, tried, found, free_too.freedom)
    return _term_of_levels("fourier", joint, names, X, data, lever, fit, sure, len(tried))


MOSTLY = 0.8
"""Share of the squares of a Fourier series from which on gravity, which explains so much, takes its place."""


def of_moves(moves: Sequence[JointMoves], only_moves: bool = True) -> list[str]:
    """What one-joint moves say; ``only_moves``: nothing else is said, so the last sentence is what the robot needs."""
    source = "" if only_moves else "by one-joint moves, "
    out = [
        f"{source}{_of_moves(joint, term)}"
        for joint in moves
        for term in joint.terms
        if term.needed or (term.tested and term.kind != "gain")
    ]
    out += beyond_reading([joint.backlash for joint in moves])
    out += not_tested([term for joint in moves for term in joint.terms], "one-joint moves")
    if moves and only_moves:
        out += _period_of_weight(moves)
        out.append(_needed_by_moves(moves))
    return out


def _of_moves(joint: JointMoves, term: JointTerm) -> str:
    if term.kind == "backlash":
        return f"{play_in_words(term)}: {evidence_in_words(term)}"
    said = f"joint {joint.joint}: {name_of(term)}: {evidence_in_words(term)}"
    arc = max(np.ptp(series.turn) for series in joint.series)
    if term.kind == "fourier" and term.needed and arc < np.pi:
        said += f"; on an arc of {arc / DEG:.0f} degrees its coefficients hold there only"
    if term.kind == "gravity" and term.needed:
        said += "; model auto has it, and model 34 of arms that joints 2 and 3 lift; joints with --robot estimates it"
    return said


def beyond_reading(terms: Sequence[JointTerm]) -> list[str]:
    """Joints that do the contrary of what play does."""
    joints = [term.joint for term in terms if term.needed and term.values[0] < 0]
    if not joints:
        return []
    return [
        f"negative backlash{of_joints(joints)}: the joint stands BEYOND its reading in the direction it came from; "
        "play would hold it back"
    ]


def best_of(joint: JointMoves) -> list[JointTerm]:
    """Backlash, and of gain, series and gravity, which explain much of the same, the one with most evidence.

    A series has gravity's one period a turn, too: gravity is taken where it explains most of what the series does.
    """
    needed = [term for term in joint.terms if term.needed]
    runs = sorted((term for term in needed if term.kind != "backlash"), key=lambda term: -term.evidence)
    weight = [term for term in runs if term.kind == "gravity"]
    if weight and runs[0].kind == "fourier" and weight[0].moves ** 2 > MOSTLY * runs[0].moves ** 2:
        runs = weight
    return [term for term in needed if term.kind == "backlash"] + runs[:1]


def _period_of_weight(moves: Sequence[JointMoves]) -> list[str]:
    """Joints whose needed gain or series may be weight, which has one period a turn: one home pose cannot tell."""
    joints = [
        joint.joint
        for joint in moves
        for term in best_of(joint)
        if len(joint.series) == 1 and (term.kind == "gain" or (term.kind == "fourier" and term.frequency == (1.0,)))
    ]
    if not joints:
        return []
    return [
        f"what gain error or Fourier series{of_joints(joints)} explain may be bending under weight, which has one "
        "period a turn: moves from one home pose cannot tell these apart; poses all over the workspace can (--robot)"
    ]


def _best_in_words(joint: JointMoves) -> list[str]:
    """The terms of `best_of`, the last with those needed ones that it stands for."""
    best = best_of(joint)
    others = [name_of(term) for term in joint.terms if term.needed and term not in best]
    names = [f"{name_of(term)} of joint {joint.joint}" for term in best]
    if others:
        names[-1] += f" (stands for {joined(others)}, too: each explains much of the same)"
    return names


def _needed_by_moves(moves: Sequence[JointMoves]) -> str:
    terms = [term for joint in moves for term in joint.terms]
    names = [name for joint in moves for name in _best_in_words(joint)]
    if names:
        return f"This robot needs: {', '.join(names)}."
    if not any(term.tested for term in terms if term.kind != "gain"):
        return "What this robot needs is not known: these moves test neither backlash nor Fourier series."
    return "This robot needs none of the terms that could be tested."


def errors_table(moves: Sequence[JointMoves], title: str = "Errors of one-joint moves") -> Table:
    """Radial, tangential and axial errors of each series, as Nubiola 2011, Figure 4.3, draws them."""
    columns = ("group", "n", "range, deg", "radial", "tangential", "largest", "axial", "p-p, deg")
    rows: list[tuple[TableValue, ...]] = []
    for s in (s for joint in moves for s in joint.series):
        low, high = s.turn.min() / DEG, s.turn.max() / DEG
        radial, along, axial = s.sizes().values()
        sizes = (radial["rms_mm"], along["rms_mm"], along["max_mm"], axial["rms_mm"])
        rows.append((s.name, len(s.q), f"{low:.0f}…{high:.0f}", *sizes, f"{s.peak_to_peak / DEG:.4f}"))
    return Table(f"{title}: rms (tangential: largest, too), mm", columns, tuple(rows))
