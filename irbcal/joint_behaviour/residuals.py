"""Effects of single joints in the residuals of a robot model, from any poses.

Everything is linearised about the robot at hand. Beside the effect that is looked at, base, targets, link geometry and
the terms of the robot's joint map are refitted, so that what they can explain is not taken for something else. Where
the direction or the size of the last moves counts, gains, series and stiffness are tested beside these, too.

The covariance of the estimates is the jackknife's: every pose is left out once. Residuals of one pose may depend on one
another, and errors that no term describes count as scatter. "Left out" errors are those of each pose by the fit to all
other poses; both follow from the hat matrix without fitting again.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import circles, outliers
from irbcal.identification.residuals import Problem, State
from irbcal.joint_behaviour.terms import (
    HIGHEST_FREQUENCY,
    SIGNIFICANT,
    WORTH,
    Term,
    best_frequency,
    fourier_columns,
    fourier_names,
    frequencies,
    judged,
    quantile,
)
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.registration import base_on
from irbcal.modeling import parameters
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM

FARTHEST = 10 * MM
"""Median miss of the robot above which its residuals say nothing about single joints."""

FEWEST_POSES = 12
SMALLEST_LEVER = 0.3
"""Poses whose targets lie nearer to a joint's axis than this share of the typical distance do not show that joint."""

UNSEEN = 1e-6
"""Share of a column that must be left beside all others for its coefficient to be seen."""

ROUNDING = 1e-8
"""Share of the largest singular value of the normalised columns below which there is only rounding."""

TRIES = 3
"""Candidates that are looked at closely before the selection of terms ends."""


@dataclass(frozen=True)
class Step:
    """One term in the order in which the robot needs them.

    Attributes
    ----------
    kind : str
    joint : int or None
        Counted from 1.
    p : float
        Corrected for the number of terms that were to choose from.
    rms : float
        Of poses left out of the fit, with this term and those before it, metres.
    """

    kind: str
    joint: int | None
    p: float
    rms: float


@dataclass(frozen=True, eq=False)
class ResidualAnalysis:
    """Effects of each joint in the residuals of a robot model.

    Attributes
    ----------
    robot : Robot
        With its base where these points say.
    points : PointSet
    step : ndarray, shape (n, joints)
        Last move of each joint before each pose, radians; NaN where it is not known.
    terms : tuple of Term
    needed : tuple of Step
        Terms chosen one after the other from geometry alone, each the one that explains most of what is left.
    rms_geometry : float
        Of poses left out of a fit of base, targets and link geometry alone, metres.
    approach : dict of str to float
        The same with the robot's joint map and ``neither``, ``direction`` or ``size`` of the last moves of all joints,
        or ``both``, metres.
    halves : ndarray, shape (joints, 2)
        Backlash from the first and from the second half of the poses, radians.
    halves_p : ndarray, shape (joints,)
        Probability of so large a difference between the halves if the backlash is the same in both.
    angle : ndarray, shape (n, joints)
        Angular residual of each pose about each joint with the estimated backlash left in, radians; NaN where the
        targets lie too near to the axis or the direction is not known.
    rms : float
        Root mean square distance of the points after the (linearised) refit, metres.
    excluded : tuple of tuple
        (pose, target, distance in metres) of points far from the robot.
    """

    robot: Robot
    points: PointSet
    step: np.ndarray
    terms: tuple
    needed: tuple
    rms_geometry: float
    approach: dict
    halves: np.ndarray
    halves_p: np.ndarray
    angle: np.ndarray
    rms: float
    excluded: tuple = ()

    def of(self, kind):
        """Terms of one kind, by joint."""
        return {term.joint: term for term in self.terms if term.kind == kind}


def analyse_residuals(robot, points, step, joint=None, order=2, frequency=1.0):
    """Effects of each joint in the residuals of a robot model, from any poses.

    Parameters
    ----------
    robot : Robot
        Calibrated, or nominal with base and targets. Its base is placed anew. When a term that its joint map has is
        tested, the robot without it is the comparison.
    points : PointSet
        Every target must be one of the robot's.
    step : ndarray, shape (n, joints)
        Of `irbcal.joint_behaviour.moves.last_moves`, for the poses of ``points``.
    joint : int, optional
        Only this joint, counted from 1 (backlash is estimated for all joints together all the same).
    order : int
        Of the Fourier series.
    frequency : float or None
        Periods per turn; None: free.

    Returns
    -------
    ResidualAnalysis

    Raises
    ------
    IdentificationError
        If there are too few poses or the robot is not that of the points.
    """
    joints = len(robot.arm.joint_names)
    if joint is not None and joint > joints:
        raise IdentificationError(f"there is no joint {joint}: {robot.arm.name} has {joints}")
    step = step[np.isin(np.arange(points.poses), points.pose)]
    robot, points, step, excluded = placed(robot, points.without_empty_poses(), step)
    model = Linearised(robot, points, step)
    chosen = range(joints) if joint is None else [joint - 1]
    turning = [j for j in chosen if not robot.arm.table.prismatic[j]]
    rms, approach = model.rms(), _approach(model)
    backlash, halves, halves_p, angle = backlash_terms(model)
    backlash, moves = judged(backlash), judged([_per_move(model, j) for j in range(joints)])
    # directions go with places, more or less: what depends on the one is not to be taken for the other
    for found, columns in ((backlash, _play(model)), (moves, model.per_joint(model.step))):
        if any(term.verdict in ("worth it", "small") for term in found):
            model.refit_beside(columns)
    terms = [
        *backlash,
        *moves,
        *judged([_term(model, "gain", j, *_gain(model, j)) for j in chosen]),
        *judged([_fourier(model, j, order, frequency) for j in turning]),
        *judged(_stiffness_terms(model)),
    ]
    terms = tuple(term for term in terms if joint is None or term.joint in (None, joint))
    needed, rms_geometry = _selection(model, terms)
    return ResidualAnalysis(
        robot,
        points,
        step,
        terms,
        needed,
        rms_geometry,
        approach,
        halves,
        halves_p,
        angle,
        rms,
        excluded,
    )


def placed(robot, points, step):
    """The robot with its base where the points say; points that no joint could explain are left out."""
    excluded = ()
    while True:
        robot = base_on(robot, points)
        off = distances(robot, points)
        median = np.median(off)
        far = off > max(outliers.FLOOR, outliers.FACTOR * median)
        if not far.any() or median > FARTHEST:
            break
        names = points.names()
        excluded += tuple((str(points.pose_ids[points.pose[k]]), names[k], float(off[k])) for k in np.flatnonzero(far))
        used = np.zeros(points.poses, dtype=bool)
        used[points.pose[~far]] = True
        points, step = points.take(~far).select(used).with_seen_targets(), step[used]
    if median > FARTHEST:
        raise IdentificationError(
            f"{robot.arm.name} misses the points by {median / MM:.4g} mm (median) even with its base placed anew: they "
            "were not measured on this robot with this tool"
        )
    if points.poses < FEWEST_POSES:
        raise IdentificationError(
            f"{points.poses} poses are too few to look for effects of single joints: at least {FEWEST_POSES} are needed"
        )
    return robot, points, step, excluded


class Linearised:
    """A robot's residuals and their derivatives by geometry, joint map and joint angles, all at one place.

    Rows are those of `irbcal.identification.residuals.Problem`, three numbers each; columns are flat, (3 rows, ...).

    Attributes
    ----------
    turn : ndarray, shape (3 rows, joints)
        Derivatives by the effective joints.
    maps : dict of str to ndarray, shape (3 rows,)
        Derivatives by the joint map's parameters.
    value : dict of str to float
        Those parameters as the robot has them.
    active : list of str
        Joint map parameters that the robot has: refitted with the geometry.
    beside : ndarray, shape (3 rows, k)
        Columns of what else is refitted.
    """

    def __init__(self, robot, points, step):
        arm, joints = robot.arm, len(robot.arm.joint_names)
        geometry = [*parameters.THESIS_LEVELS["26"], "delta_beta3"]
        if not arm.six_revolute:
            geometry = [item.name for item in parameters.level_parameters("placement", arm)]
        turns = [f"delta_{'d' if slides else 'theta'}{j}" for j, slides in enumerate(arm.table.prismatic, start=1)]
        maps = [name for name in parameters.all_names(arm) if not name.startswith("delta_")]
        names = list(dict.fromkeys([*geometry, *turns, *maps]))
        chosen = tuple(parameters.parameter(name) for name in names)
        held = [getattr(robot.joint_map, p.kind)[p.index] if p.name in maps else 0.0 for p in chosen]
        problem = Problem(arm, points, chosen, robot.joint_map.phases)
        targets = np.array([robot.targets[name] for name in points.target_names])
        rotations = np.array([robot.target_rotations.get(name, np.eye(3)) for name in points.target_names])
        state = State(robot.T_world_base, targets, np.array(held), rotations)
        self.weight = np.repeat(problem.weights, 3)
        J = problem.jacobian(state) * self.weight[:, None]
        self.r = problem.residuals(state).reshape(-1) * self.weight
        self.robot, self.q, self.step = robot, points.q, step
        self.poses, self.joints = points.poses, joints
        self.pose = np.concatenate([points.pose, points.pose[points.oriented()]])
        self.flat_pose = np.repeat(self.pose, 3)
        self.positions = 3 * len(points)
        column = {name: J[:, problem.outer + k] for k, name in enumerate(names)}
        self.turn = np.stack([column[name] for name in turns], axis=1)
        self.maps = {name: column[name] for name in maps}
        self.value = {p.name: value for p, value in zip(chosen, held, strict=True) if p.name in maps}
        self.geometry = np.column_stack([J[:, : problem.outer], *(column[name] for name in geometry)])
        active = {p.kind for p in chosen if p.name in maps and getattr(robot.joint_map, p.kind).any()}
        self.active = [p.name for p in chosen if p.name in maps and p.kind in active]
        self.beside = np.zeros((len(self.r), 0))
        self._bases, self._last = {}, (None, None, None)
        # where the rows of each pose stand, -1 for none
        order = np.argsort(self.flat_pose, kind="stable")
        count = np.bincount(self.flat_pose, minlength=self.poses)
        place = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
        self.rows = np.full((self.poses, count.max()), -1)
        self.rows[self.flat_pose[order], place] = order

    def basis(self, without=(), beside=True):
        """Orthonormal basis of what is refitted: geometry, the robot's joint map without some terms, `beside`."""
        key = (*(name for name in without if name in self.active), beside)
        if key not in self._bases:
            if None not in self._bases:
                self._bases[None] = _basis(self.geometry)
            names = [name for name in self.active if name not in without]
            columns = np.array([self.maps[name] for name in names]).reshape(len(names), len(self.r)).T
            if beside:
                columns = np.hstack([columns, self.beside])
            self._bases[key] = _extended(self._bases[None], columns)
        return self._bases[key]

    def refit_beside(self, columns):
        """Refit more columns, (3 rows, k), in all tests to come."""
        self.beside = np.hstack([self.beside, columns])
        self._bases = {None: self._bases[None]}

    def explained(self, without=()):
        """Residuals of the robot without some of its joint map's terms, (3 rows,)."""
        return self.r + sum(self.maps[name] * self.value[name] for name in without)

    def size(self, r):
        """Root mean square distance of rows (3 rows,), metres; orientations do not count."""
        off = (r / self.weight)[: self.positions].reshape(-1, 3)
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    def rms(self):
        """Root mean square distance of the points after the linearised refit, metres."""
        Q = self.basis()
        return self.size(self.r - Q @ (Q.T @ self.r))

    def per_joint(self, size):
        """Derivatives by one coefficient per joint of its own angle times a number of each pose, (3 rows, joints)."""
        return self.turn * np.nan_to_num(size)[self.flat_pose]

    def left_out(self, left, Q):
        """What is left of each pose by the fit to all others: (I - H_pp)^-1 r_p, with the hat matrix H = Q Q^T."""
        there = self.rows >= 0
        padded = np.where(there, self.rows, 0)
        q = Q[padded] * there[..., None]
        r = left[padded] * there
        value, vector = np.linalg.eigh(np.eye(self.rows.shape[1]) - q @ q.transpose(0, 2, 1))
        # what one pose alone decides leaves no residual and cannot be left out
        inverse = np.where(value > 1e-8, 1.0 / np.maximum(value, 1e-8), 0.0)
        r = np.einsum("nij,nj->ni", vector, inverse * np.einsum("nji,nj->ni", vector, r))
        out = np.empty_like(left)
        out[self.rows[there]] = r[there]
        return out

    def test(self, X, without=(), Q=None):
        """Terms beside what is refitted.

        Parameters
        ----------
        X : ndarray, shape (3 rows, k)
            Derivatives by the terms' coefficients.
        without : sequence of str
            Joint map parameters that the terms take the place of.
        Q : ndarray, optional
            Basis of what is refitted, `basis` unless given.

        Returns
        -------
        _Found or None
            None where no coefficient can be seen.
        """
        from scipy.stats import f as fisher

        Q = self.basis(without) if Q is None else Q
        y = self.explained(without)
        y = y - Q @ (Q.T @ y)
        own = X - Q @ (Q.T @ X)
        kept, U = _independent(X, own)
        if not len(kept) or len(y) - Q.shape[1] - 2 * len(kept) < 1:
            return None
        own = own[:, kept]
        P = np.linalg.solve(U.T @ own, U.T)
        beta = P @ y
        left = y - own @ beta
        after = self.left_out(left, np.hstack([Q, U]))
        change = np.stack([np.bincount(self.flat_pose, row * after, minlength=self.poses) for row in P])
        C = (self.poses - 1) / self.poses * change @ change.T
        p = float(fisher.sf(beta @ np.linalg.pinv(C) @ beta / len(kept), len(kept), self.poses - 1))
        return _Found(kept, beta, C, p, left, self._before(y, Q), self.size(after), self.size(own @ beta))

    def _before(self, y, Q):
        """Root mean square of poses left out without a term, metres; many terms share one basis."""
        if self._last[0] is not Q or not np.array_equal(self._last[1], y):
            self._last = (Q, y, self.size(self.left_out(y, Q)))
        return self._last[2]


@dataclass(frozen=True, eq=False)
class _Found:
    """Outcome of `Linearised.test`: which coefficients were seen, their values, covariance and test."""

    kept: np.ndarray
    beta: np.ndarray
    C: np.ndarray
    p: float
    left: np.ndarray
    before: float
    after: float
    at_tool: float


def _independent(X, own):
    """Columns of which something is left beside the others, and an orthonormal basis of what is left (Gram-Schmidt)."""
    kept, Q = [], np.empty(X.shape, order="F")
    for k in range(X.shape[1]):
        before = Q[:, : len(kept)]
        rest = own[:, k] - before @ (before.T @ own[:, k])
        rest -= before @ (before.T @ rest)
        size, whole = np.linalg.norm(rest), np.linalg.norm(X[:, k])
        if size > UNSEEN * whole:
            Q[:, len(kept)] = rest / size
            kept.append(k)
    return np.array(kept, dtype=int), Q[:, : len(kept)]


def _basis(N):
    """Orthonormal basis of the columns' space; columns that others can make do not count."""
    size = np.linalg.norm(N, axis=0)
    Q, R = np.linalg.qr(N[:, size > 0] / size[size > 0])
    U, value, _ = np.linalg.svd(R)
    return Q @ U[:, value > ROUNDING * value[0]]


def _extended(Q, X):
    """A basis with more columns."""
    own = X - Q @ (Q.T @ X)
    own = own - Q @ (Q.T @ own)
    return np.hstack([Q, _independent(X, own)[1]])


def _term(model, kind, j, names, X, without=(), beside=None, frequency=None, tried=1):
    """One term with its test; ``j`` is the joint, counted from 0."""
    Q = None
    if beside is not None:
        Q = _extended(model.basis(without), beside)
    found = model.test(X, without, Q)
    number = None if j is None else j + 1
    if found is None:
        return Term(kind, number, names, note="these poses do not show it", frequency=frequency)
    half = quantile(model.poses - 1) * np.sqrt(np.diag(found.C))
    return Term(
        kind,
        number,
        tuple(names[k] for k in found.kept),
        tuple(map(float, found.beta)),
        tuple(map(float, found.beta - half)),
        tuple(map(float, found.beta + half)),
        min(1.0, found.p * tried),
        found.before,
        found.after,
        found.at_tool,
        frequency=frequency,
    )


def _play(model):
    """Derivatives by the backlash of each joint: reached from below, half of it is missing."""
    return -0.5 * model.per_joint(np.sign(model.step))


def backlash_terms(model):
    """Backlash of all joints together, its two halves and what is left about each joint."""
    X, joints = _play(model), range(model.joints)
    signs = np.sign(np.nan_to_num(model.step))
    moving = [j for j in joints if {-1.0, 1.0} <= set(signs[:, j])]
    halves, halves_p = np.full((model.joints, 2), np.nan), np.full(model.joints, np.nan)
    angle = np.full((model.poses, model.joints), np.nan)
    terms = []
    for j in joints:
        if j in moving:
            others = X[:, [k for k in moving if k != j]]
            terms.append(_term(model, "backlash", j, ("backlash",), X[:, j : j + 1], beside=others))
        else:
            note = "the direction of approach is not known" if not signs[:, j].any() else "reached from one side only"
            terms.append(Term("backlash", j + 1, ("backlash",), note=note))
    if not moving:
        return terms, halves, halves_p, angle
    _fill_halves(model, X, moving, halves, halves_p)
    found = model.test(X[:, moving])
    if found is not None and len(found.kept) == len(moving):
        for slot, j in enumerate(moving):
            angle[:, j] = _about_joint(model, j, found.left + X[:, j] * found.beta[slot])
            angle[signs[:, j] == 0, j] = np.nan
    return terms, halves, halves_p, angle


def _fill_halves(model, X, moving, halves, p):
    """Backlash of the first and of the second half of the poses, and whether they differ."""
    from scipy.stats import t as student

    first = (model.flat_pose < model.poses / 2)[:, None]
    found = model.test(np.hstack([X[:, moving] * first, X[:, moving] * ~first]))
    k = len(moving)
    if found is None or len(found.kept) < 2 * k:
        return
    halves[moving] = found.beta.reshape(2, k).T
    for slot, j in enumerate(moving):
        variance = found.C[slot, slot] + found.C[k + slot, k + slot] - 2 * found.C[slot, k + slot]
        t = (halves[j, 0] - halves[j, 1]) / np.sqrt(max(variance, 1e-300))
        p[j] = 2 * student.sf(abs(t), model.poses - 1)


def _about_joint(model, j, r):
    """The turn of joint ``j`` that explains most of what is left at each pose, radians."""
    J = model.turn[:, j]
    square = np.bincount(model.flat_pose, J * J, minlength=model.poses)
    along = np.bincount(model.flat_pose, J * r, minlength=model.poses)
    near = square < SMALLEST_LEVER**2 * np.median(square)
    return np.where(near, np.nan, along / np.where(near, 1.0, square))


def _per_move(model, j):
    """Does the error grow with the last move, beside its direction? Play does not, a lag does."""
    sizes = np.abs(model.step[np.isfinite(model.step[:, j]), j])
    if not len(sizes) or sizes.std() < 0.1 * sizes.mean():
        return Term("move", j + 1, ("per_move",), note="all moves of the joint are of one size")
    return _term(model, "move", j, ("per_move",), model.per_joint(model.step)[:, j : j + 1], beside=_play(model))


def _approach(model):
    """Errors of poses left out, with direction and size of the last moves of all joints, metres."""
    sign, size = _play(model), model.per_joint(model.step)
    out = {}
    for name, X in (("direction", sign), ("size", size), ("both", np.hstack([sign, size]))):
        found = model.test(X)
        out["neither"] = np.nan if found is None else found.before
        out[name] = np.nan if found is None else found.after
    return out


def _gain(model, j):
    name = f"gain{j + 1}"
    return ("gain",), model.maps[name][:, None], (name,)


def _series(model, j, order, frequency):
    """Derivatives by the coefficients of a series of joint ``j``, and what of the joint map it takes the place of."""
    own = j == 5 and model.robot.arm.six_revolute
    X = model.turn[:, j : j + 1] * fourier_columns(model.q[:, j], order, frequency)[model.flat_pose]
    return X, tuple(f"fourier_{name}" for name in parameters.FOURIER) if own else ()


def _fourier(model, j, order, frequency):
    tried = [frequency]
    if frequency is None:
        q = model.q[:, j]
        extent, highest = float(np.ptp(q)), min(HIGHEST_FREQUENCY, len(circles.distinct_angles(q)) / 2 / order)
        if extent < 10 * DEG:
            return Term("fourier", j + 1, fourier_names(order), note="the joint hardly moves")
        tried = frequencies(extent, highest)
        frequency = best_frequency(lambda f: _misfit(model, *_series(model, j, order, f)), tried)
    X, without = _series(model, j, order, frequency)
    return _term(model, "fourier", j, fourier_names(order), X, without, frequency=(frequency,), tried=len(tried))


def _misfit(model, X, without):
    """Sum of squares that terms leave."""
    Q, y = model.basis(without), model.explained(without)
    y, own = y - Q @ (Q.T @ y), X - Q @ (Q.T @ X)
    left = y - own @ np.linalg.lstsq(own, y, rcond=1e-9)[0]
    return float(left @ left)


def _stiffness(model):
    names = ("stiffness_A", "stiffness_B")
    return ("A", "B"), np.stack([model.maps[name] for name in names], axis=1), names


def _stiffness_terms(model):
    if "stiffness_A" not in model.maps:
        return []
    return [_term(model, "stiffness", None, *_stiffness(model))]


def _selection(model, terms):
    """Terms one after the other from geometry alone, until none is significant and worth it.

    Returns
    -------
    needed : tuple of Step
    rms : float
        Of poses left out, with geometry alone, metres.
    """
    play, moves = _play(model), model.per_joint(model.step)
    candidates = {}
    for term in terms:
        j = None if term.joint is None else term.joint - 1
        if term.note:
            continue
        if term.kind == "backlash":
            candidates[term.kind, term.joint] = play[:, j : j + 1]
        elif term.kind == "move":
            candidates[term.kind, term.joint] = moves[:, j : j + 1]
        elif term.kind == "gain":
            candidates[term.kind, term.joint] = _gain(model, j)[1]
        elif term.kind == "stiffness":
            candidates[term.kind, None] = _stiffness(model)[1]
        else:
            order = max(int(name[1:]) for name in term.names)
            candidates[term.kind, term.joint] = _series(model, j, order, term.frequency[0])[0]
    bare = tuple(model.active)
    Q, y = model.basis(bare, beside=False), model.explained(bare)
    rms = before = model.size(model.left_out(y - Q @ (Q.T @ y), Q))
    needed = []
    while candidates:
        rest = y - Q @ (Q.T @ y)
        gains = {key: _explains(X - Q @ (Q.T @ X), rest) for key, X in candidates.items()}
        for key in sorted(gains, key=gains.get, reverse=True)[:TRIES]:
            found = model.test(candidates[key], bare, Q)
            if found is None:
                continue
            p = min(1.0, found.p * len(candidates))
            if p < SIGNIFICANT and found.after < (1 - WORTH) * before:
                break
        else:
            break
        needed.append(Step(*key, p, found.after))
        before = found.after
        Q = _extended(Q, candidates.pop(key))
    return tuple(needed), rms


def _explains(own, rest):
    """Sum of squares that columns explain."""
    solution = np.linalg.lstsq(own, rest, rcond=1e-6)[0]
    return float(rest @ (own @ solution))
