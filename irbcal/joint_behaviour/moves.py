"""Errors of one-joint moves from their circles alone (Nubiola 2011, sections 4.1, 4.2 and 5.2)."""

import re
from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import circles
from irbcal.joint_behaviour.terms import (
    HIGHEST_FREQUENCY,
    Term,
    best_frequency,
    fourier_columns,
    fourier_names,
    frequencies,
    judged,
    quantile,
)
from irbcal.measurement.last_moves import STILL
from irbcal.measurement.points import PointSet
from irbcal.units import DEG, MM

GROUP = re.compile(r"axis([1-9]\d?)(?!\d).*")
"""Names of groups of one-joint moves."""


KINDS = ("backlash", "gain", "fourier", "gravity")
GRAVITY = (2, 3)
"""Joints that lift the arm."""

SPARE = 3
"""Angles more than unknowns that a test needs."""

OFF_CIRCLE, OFF_CIRCLE_FACTOR = 0.2 * MM, 12.0
"""A point farther from its circle than both this and this many robust standard deviations is left out."""


@dataclass(frozen=True, eq=False)
class Series:
    """One joint moved from one home pose.

    Attributes
    ----------
    name : str
        Of the group.
    joint : int
        Counted from 1.
    q : ndarray, shape (n, joints)
        Joints of its poses in the order of the file, radians.
    direction : ndarray, shape (n,)
        +1 where the joint came from below, -1 from above, 0 where it is not known.
    fit : AxisFit
    points : PointSet
        Points on the circles.
    radial, tangential, axial : ndarray, shape (m,)
        Errors of each point, metres: outwards, in the joint's positive sense, along the axis. The tangential error is
        zero where ``zero`` says.
    radius : ndarray, shape (m,)
        Of each point's circle, metres.
    angle : ndarray, shape (n,)
        Angular error of each pose (measured minus commanded turn), radians.
    zero : float
        Joint angle at which the angular error is set to zero (mean of both directions): the one nearest to 0, radians.
    follow : ndarray, shape (n, 4)
        Change of ``angle`` with the axis' tilts and shifts, in the order of ``fit.covariance``.
    excluded : tuple of tuple
        (pose, target, distance in metres) of points far from their circles.
    """

    name: str
    joint: int
    q: np.ndarray
    direction: np.ndarray
    fit: circles.AxisFit
    points: PointSet
    radial: np.ndarray
    tangential: np.ndarray
    axial: np.ndarray
    radius: np.ndarray
    angle: np.ndarray
    zero: float
    follow: np.ndarray
    excluded: tuple

    @property
    def turn(self):
        """The moving joint's angle at each pose, radians."""
        return self.q[:, self.joint - 1]

    @property
    def lever(self):
        """Root mean square radius, metres."""
        return float(np.sqrt(np.mean(self.radius**2)))


@dataclass(frozen=True, eq=False)
class JointMoves:
    """All series of one joint and what they show together.

    Attributes
    ----------
    joint : int
        Counted from 1.
    series : tuple of Series
    backlash, gain, fourier : Term
    gravity : Term or None
        For joints 2 and 3: one period a turn, cosine and sine, for each home pose its own, as the bending of an arm
        gives (section 5.3).
    """

    joint: int
    series: tuple
    backlash: Term
    gain: Term
    fourier: Term
    gravity: Term | None

    @property
    def play(self):
        """Backlash that the other terms were freed of, radians."""
        return sure_backlash(self.backlash)

    @property
    def terms(self):
        """All terms."""
        return tuple(getattr(self, kind) for kind in KINDS if getattr(self, kind) is not None)


# --- from where a joint came -----------------------------------------------------------------------------


def has_moves(points):
    """Whether there are groups of one-joint moves."""
    return any(GROUP.fullmatch(str(group)) for group in points.groups)


def analyse_moves(points, step, joint=None, order=2, frequency=1.0):
    """Errors of one-joint moves, backlash, gain and Fourier series per joint (Nubiola 2011, sections 4.1, 4.2, 5.2).

    Poses of one group that differ in joints other than the moving one are separate series, such as the tests of
    Tables 4.2 and 4.4; each has its own circles, all series of a joint share backlash and Fourier series.

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

    Returns
    -------
    list of JointMoves

    Raises
    ------
    IdentificationError
        If there are no one-joint moves, if other joints move within a group, or if a group does not give an axis.
    """
    seen = points.without_empty_poses()
    step = step[np.isin(np.arange(points.poses), points.pose)]
    names = [str(group) for group in seen.groups]
    found = {}
    for name in dict.fromkeys(names):
        match = GROUP.fullmatch(name)
        if match and joint in (None, int(match[1])):
            found.setdefault(int(match[1]), []).append(name)
    if not found:
        which = "axis1, axis2, …" if joint is None else f"axis{joint}"
        others = ", ".join(sorted({name for name in names if name})) or "no groups"
        raise IdentificationError(f"there are no one-joint moves in a group {which}; found {others}")
    out = []
    for number in sorted(found):
        if number > seen.q.shape[1]:
            raise IdentificationError(f"group {found[number][0]}: there are only {seen.q.shape[1]} joints")
        series = [
            one_series(seen.select(part), step[part, number - 1], number, name)
            for name in found[number]
            for part in _homes(seen.q, np.array(names) == name, number, name)
        ]
        out.append(_joint_moves(number, series, order, frequency))
    return _judged_moves(out)


def _homes(q, mine, joint, name):
    """Masks of the poses of a group that share the other joints."""
    rows = np.flatnonzero(mine)
    rest = np.delete(q[rows], joint - 1, axis=1)
    homes, which = [], np.empty(len(rows), dtype=int)
    for k, pose in enumerate(rest):
        off = [np.abs(_wrapped(pose - home)).max() for home in homes]
        if off and min(off) <= STILL:
            which[k] = int(np.argmin(off))
        else:
            which[k] = len(homes)
            homes.append(pose)
    if np.bincount(which).min() < 3:
        spread = np.ptp(_wrapped(rest - rest[0]), axis=0)
        moving = int(np.argmax(spread))
        number = moving + 1 if moving + 1 < joint else moving + 2
        if spread[moving] > STILL:
            raise IdentificationError(
                f"group {name}: joint {number} moves by {spread[moving] / DEG:.3g} degrees, but only joint {joint} may "
                "move there (each other home pose needs three poses or more)"
            )
    masks = []
    for k in range(len(homes)):
        mask = np.zeros(len(q), dtype=bool)
        mask[rows[which == k]] = True
        masks.append(mask)
    return masks


def one_series(points, step, joint, name):
    """Circles of one joint from one home pose, and the errors along them (Nubiola 2011, section 4.1).

    Parameters
    ----------
    points : PointSet
        Poses in which only this joint moves.
    step : ndarray, shape (n,)
        Its last move before each pose, radians; NaN where unknown.
    joint : int
        Counted from 1.
    name : str

    Returns
    -------
    Series

    Raises
    ------
    IdentificationError
        As `irbcal.identification.circles.fit_axis`.
    """
    points, fit, excluded = _fit_without_outliers(points, joint, name)
    used = np.zeros(points.poses, dtype=bool)
    used[points.pose] = True
    points, step = points.select(used), step[used]
    turn, pose = points.q[:, joint - 1], points.pose
    slot = np.searchsorted(fit.targets, points.target)
    arms = points.xyz - fit.point
    height, plane = arms @ fit.direction, arms @ fit.basis.T
    radius = fit.radii[slot]
    phi = np.arctan2(plane[:, 1], plane[:, 0])
    error = phi - turn[pose]
    for k in range(len(fit.targets)):  # each target stands at an angle of its own on the tool
        mine = slot == k
        start = np.angle(np.sum(np.exp(1j * error[mine])))
        error[mine] = _wrapped(error[mine] - start)
    angle, error = _common_angle(error, pose, slot, radius**2)
    zero = turn[np.argmin(np.abs(turn))]
    at_zero = angle[np.abs(turn - zero) < circles.SAME_ANGLE].mean()
    tangent = np.column_stack([-np.sin(phi), np.cos(phi)])
    follow = -np.column_stack([height[:, None] * tangent, tangent]) / radius[:, None]
    follow = np.column_stack([_pose_mean(column, pose, radius**2) for column in follow.T])
    direction = np.sign(np.nan_to_num(step))
    return Series(
        name,
        joint,
        points.q,
        direction,
        fit,
        points,
        fit.radial,
        radius * (error - at_zero),
        fit.axial,
        radius,
        angle - at_zero,
        float(zero),
        follow,
        excluded,
    )


def _fit_without_outliers(points, joint, name):
    """Points on circles and their axis; the farthest point goes first, as long as it is far."""
    excluded = []
    while True:
        fit = circles.fit_axis(points.xyz, points.target, points.joints()[:, joint - 1], name)
        points = points.take(fit.used)
        off = np.hypot(fit.radial, fit.axial)
        limit = max(OFF_CIRCLE, OFF_CIRCLE_FACTOR * 1.4826 * np.median(off))
        worst = int(np.argmax(off))
        if off[worst] <= limit or len(points) < 8:
            return points, fit, tuple(excluded)
        excluded.append((str(points.pose_ids[points.pose[worst]]), points.names()[worst], float(off[worst])))
        points = points.take(np.arange(len(points)) != worst)


def _pose_mean(values, pose, weight):
    return np.bincount(pose, weight * values) / np.bincount(pose, weight)


def _common_angle(error, pose, slot, weight):
    """Angle of each pose that all targets share, and the points' errors about the targets' own zero angles."""
    offset = np.zeros(slot.max() + 1)
    for _ in range(100):  # exact at once where every target is seen in every pose
        angle = _pose_mean(error - offset[slot], pose, weight)
        change = np.bincount(slot, weight * (error - offset[slot] - angle[pose])) / np.bincount(slot, weight)
        offset += change
        if np.abs(change).max() < 1e-15:
            break
    return angle, error - offset[slot]


def _joint_moves(joint, series, order, frequency):
    levels = [_levels(s) for s in series]
    lever = float(np.sqrt(np.mean([s.lever**2 for s in series])))
    backlash = _backlash_of_moves(joint, series, levels, lever)
    data = _Levels(series, levels, sure_backlash(backlash))
    return JointMoves(
        joint,
        tuple(series),
        backlash,
        _gain_of_moves(joint, data, lever),
        _fourier_of_moves(joint, data, lever, order, frequency),
        _gravity_of_moves(joint, data, lever) if joint in GRAVITY else None,
    )


def sure_backlash(term):
    """Backlash in radians where its interval does not hold zero, else 0."""
    if not term.values or term.low[0] <= 0.0 <= term.high[0]:
        return 0.0
    return term.values[0]


def _levels(series):
    """Number of the joint angle at which each pose stands; whole turns count."""
    order = np.argsort(series.turn, kind="stable")
    number = np.cumsum(np.r_[0, np.diff(series.turn[order]) > circles.SAME_ANGLE])
    out = np.empty(len(order), dtype=int)
    out[order] = number
    return out


def _backlash_of_moves(joint, series, levels, lever):
    """From angles that were reached from both sides: their differences do not depend on how the error runs."""
    from scipy.stats import t as student

    difference = []
    for s, number in zip(series, levels, strict=True):
        above, below = s.direction < 0, s.direction > 0
        for level in np.intersect1d(number[above], number[below]):
            here = number == level
            difference.append(s.angle[here & above].mean() - s.angle[here & below].mean())
    n, name = len(difference), ("backlash",)
    if n < SPARE:
        note = f"{n or 'no'} joint angle{'s were' if n > 1 else ' was'} reached from both sides, {SPARE} are needed"
        return Term("backlash", joint, name, note=note)
    difference = np.array(difference)
    mean, std = difference.mean(), max(difference.std(ddof=1) / np.sqrt(n), 1e-12)
    half = quantile(n - 1) * std
    others = (n * mean - difference) / (n - 1)
    return Term(
        "backlash",
        joint,
        name,
        (float(mean),),
        (float(mean - half),),
        (float(mean + half),),
        float(2 * student.sf(abs(mean) / std, n - 1)),
        float(lever * np.sqrt(np.mean(difference**2)) / 2),
        float(lever * np.sqrt(np.mean((difference - others) ** 2)) / 2),
        float(lever * abs(mean) / 2),
    )


class _Levels:
    """Angular errors of all series of a joint, a row for each joint angle, both directions in the middle.

    Where there is backlash, poses that were reached from nobody knows where are left out.

    Attributes
    ----------
    x, y : ndarray, shape (r,)
        Joint angle and mean angular error, radians.
    root : ndarray, shape (r,)
        Square root of the number of poses.
    own : ndarray, shape (r, series)
        Which series a row belongs to: each has a zero of its own.
    covariance : ndarray, shape (r, r)
        Of ``y`` by the uncertainty of the circles.
    step : float
        Typical distance between neighbouring angles, radians.
    """

    def __init__(self, series, levels, play):
        x, y, root, own, follow = [], [], [], [], []
        for k, (s, number) in enumerate(zip(series, levels, strict=True)):
            used = (s.direction != 0) | (play == 0.0)
            _, number = np.unique(number[used], return_inverse=True)
            count = np.bincount(number)
            x.append(np.bincount(number, s.turn[used]) / count)
            y.append(np.bincount(number, (s.angle + 0.5 * play * s.direction)[used]) / count)
            root.append(np.sqrt(count))
            own.append(np.full(len(count), k))
            D = np.column_stack([np.bincount(number, column) / count for column in s.follow[used].T])
            follow.append(D @ np.nan_to_num(s.fit.covariance) @ D.T)
        self.x, self.y, self.root = (np.concatenate(parts) for parts in (x, y, root))
        self.own = (np.concatenate(own)[:, None] == np.arange(len(series))).astype(float)
        self.covariance = np.zeros((len(self.x), len(self.x)))
        start = 0
        for block in follow:
            end = start + len(block)
            self.covariance[start:end, start:end] = block
            start = end
        self.step = float(np.median(np.concatenate([np.diff(part) for part in x])))
        self.range = float(max(np.ptp(part) for part in x))

    def fit(self, X, extra=0):
        """Weighted least squares of terms beside the series' zeros; ``extra`` unknowns are spent elsewhere.

        Returns
        -------
        beta, covariance : ndarray
        p : float
        rms_without, rms_with : float
            Of angles left out, radians.
        """
        from scipy.stats import f as fisher

        w = self.root[:, None]
        N, X, y = w * self.own, w * X, self.root * self.y
        N = N / np.linalg.norm(N, axis=0)
        rest_X, rest = X - N @ (N.T @ X), y - N @ (N.T @ y)
        P = np.linalg.pinv(rest_X)
        beta = P @ rest
        left = rest - rest_X @ beta
        freedom = len(y) - N.shape[1] - X.shape[1] - extra
        sigma2 = max(left @ left / freedom, 1e-24)
        S = P * self.root
        C = sigma2 * P @ P.T + S @ self.covariance @ S.T
        p = float(fisher.sf(beta @ np.linalg.solve(C, beta) / len(beta), len(beta), freedom))
        H_0 = np.sum(N**2, axis=1)
        H_1 = H_0 + np.einsum("rk,kr->r", rest_X, P)
        return beta, C, freedom, p, self._left_out(rest, H_0), self._left_out(left, H_1)

    def _left_out(self, left, leverage):
        """Root mean square of what is left of angles that were left out, radians; a pose counts once."""
        return float(np.sqrt(np.sum((left / np.maximum(1 - leverage, 1e-9)) ** 2) / np.sum(self.root**2)))


def _term_of_levels(kind, joint, names, X, data, lever, beta, C, freedom, p, before, after, **more):
    half = quantile(freedom) * np.sqrt(np.diag(C))[: len(names)]
    effect = X[:, : len(names)] @ beta[: len(names)]
    effect = effect - data.own @ ((data.own.T @ effect) / data.own.sum(axis=0))
    return Term(
        kind,
        joint,
        names,
        tuple(map(float, beta[: len(names)])),
        tuple(map(float, beta[: len(names)] - half)),
        tuple(map(float, beta[: len(names)] + half)),
        p,
        lever * before,
        lever * after,
        float(lever * np.sqrt(np.mean(effect**2))),
        **more,
    )


def _gain_of_moves(joint, data, lever):
    missing = 1 + data.own.shape[1] + SPARE - len(data.x)
    if missing > 0:
        return Term("gain", joint, ("gain",), note=f"{len(data.x)} joint angles are too few")
    X = data.x[:, None]
    return _term_of_levels("gain", joint, ("gain",), X, data, lever, *data.fit(X))


def _gravity_of_moves(joint, data, lever):
    count = data.own.shape[1]
    names = tuple(f"{letter}_{k}" for k in range(1, count + 1) for letter in "ab")
    if len(data.x) < 3 * count + SPARE:
        note = f"{len(data.x)} joint angles are too few: {3 * count + SPARE} are needed"
        return Term("gravity", joint, names, note=note)
    wave = fourier_columns(data.x, 1, 1.0)
    X = (data.own[:, :, None] * wave[:, None, :]).reshape(len(wave), -1)
    return _term_of_levels("gravity", joint, names, X, data, lever, *data.fit(X))


def _fourier_of_moves(joint, data, lever, order, frequency):
    names, free = fourier_names(order), frequency is None
    needed = data.own.shape[1] + 2 * order + free + SPARE
    # of places a turn apart, a series with one period a turn sees one
    places = len(data.x) if free or frequency != 1.0 else len(circles.distinct_angles(data.x))
    if len(data.x) < needed or places < 2 * order + 2:
        short = f"{len(data.x)} joint angles" if len(data.x) < needed else f"{places} places in the turn"
        least = needed if len(data.x) < needed else 2 * order + 2
        return Term("fourier", joint, names, note=f"{short} are too few for order {order}: {least} are needed")
    highest = np.pi / data.step / order
    if not free:
        if frequency > highest * (1 + 1e-9):
            note = f"steps of {data.step / DEG:.3g} degrees are too wide for order {order} at frequency {frequency:g}"
            return Term("fourier", joint, names, note=note)
        X = fourier_columns(data.x, order, frequency)
        more = {"frequency": (float(frequency),)}
        return _term_of_levels("fourier", joint, names, X, data, lever, *data.fit(X), **more)
    tried = frequencies(data.range, min(highest, HIGHEST_FREQUENCY))
    found = best_frequency(lambda f: data.fit(fourier_columns(data.x, order, f), extra=1)[5], tried)
    X = fourier_columns(data.x, order, found)
    beta = data.fit(X, extra=1)[0]
    # one column more for the frequency itself: d/df of the series
    turned = np.column_stack([[-k, k] * data.x[:, None] for k in range(1, order + 1)])
    swapped = X.reshape(len(X), order, 2)[:, :, ::-1].reshape(len(X), -1)
    along = (turned * swapped) @ beta
    _, C, freedom, *_ = data.fit(np.column_stack([X, along]))
    half = quantile(freedom) * np.sqrt(C[-1, -1])
    _, _, _, p, before, after = data.fit(X, extra=1)
    more = {"frequency": (found, found - half, found + half)}
    p = min(1.0, p * len(tried))
    return _term_of_levels("fourier", joint, names, X, data, lever, beta, C, freedom, p, before, after, **more)


def _judged_moves(joints):
    """The same with p values corrected for the number of joints and with verdicts."""
    for kind in KINDS:
        have = [k for k, item in enumerate(joints) if getattr(item, kind) is not None]
        for k, term in zip(have, judged([getattr(joints[k], kind) for k in have]), strict=True):
            joints[k] = replace(joints[k], **{kind: term})
    return joints


def _wrapped(angle):
    """Angle in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)
