r"""Optimal measuring plans: the poses that say most about the robot.

A pose with Jacobian ``J`` (rows: coordinates of the reflectors seen in it; columns: base, targets and error parameters,
each in its plausible size over the standard deviation of a coordinate) adds ``J^T J`` to the information ``M``. The
prior, one plausible size for each error parameter and a metre and a radian for base and targets, keeps directions that
no pose shows from spoiling the rest. Two criteria:

``D``         log det of the information about the error parameters, base and targets eliminated
``position``  mean squared error of the predicted positions of a reflector over sample poses of a volume, base and
              target included

No model describes a robot wholly. Plans for noise alone go to the corners of the workspace and are no better than
random ones where such errors are the larger part; so ``position`` also counts what a fit makes of imagined joint
errors: waves over the angle of each joint and tilts of its axis, of random size (variance and bias together, as Box
and Draper 1959 propose). With ``E`` what such errors do to the measured coordinates, the fit is off by
``M^-1 J^T E``.

Poses are exchanged one at a time for the candidate that serves best, until none does (Fedorov 1972; the cheaper form
of Cook and Nachtsheim 1980). All candidates are rated at once by low-rank updates of ``J M^-1 J^T``.
"""

from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.identification import observability
from irbcal.identification.observability import HELD, TIED
from irbcal.identification.residuals import Problem, State
from irbcal.measurement.points import PointSet
from irbcal.modeling.parameters import level_parameters, parameter
from irbcal.planning.conditions import METRES_PER_DEGREE, Targets
from irbcal.units import DEG, MM, UNIT_OUTSIDE

CRITERIA = ("position", "D")
NOISE = 0.1 * MM
"""Standard deviation of one measured coordinate where none is given, metres."""
PASSES = 20
ENOUGH = 1e-4
"""Relative gain of a pass below which no further one is made."""
ACTIVE = 300
"""Candidates that take part in one pass of exchanges: those rated best at its beginning."""
DRAWS = 8
"""Random plans of each size that chosen ones are compared with."""
WAVES = 6
"""Waves of imagined errors in a joint: periods a turn."""
IMAGINED_SIZE = 0.01 * DEG
"""Size of the imagined errors of each joint, root mean square, radians: uneven gears, backlash and the like."""


class Model:
    """What a measured pose says about an arm's unknowns, at its nominal values.

    Parameters
    ----------
    arm : Arm
    targets : Targets
    level : str
        See `irbcal.modeling.parameters`.
    noise : float
        Standard deviation of one coordinate, metres.
    """

    def __init__(self, arm, targets, level, noise=NOISE):
        self.arm, self.targets, self.level, self.noise = arm, targets, level, float(noise)
        self.parameters = level_parameters(level, arm)
        self.phases = (0.0, np.pi / 2)
        if any(p.kind == "stiffness" for p in self.parameters):
            self.phases = arm.stiffness_geometry()[0]
        self.outer = 6 + 3 * len(targets.names)
        self.scale = np.concatenate([np.ones(self.outer), [p.scale for p in self.parameters]])

    def problem(self, q, seen):
        """The identification from the reflectors seen in poses, and the state it is linearised at."""
        pose, target = np.nonzero(seen)
        n = len(q)
        points = PointSet(
            q, pose, target, np.zeros((len(pose), 3)), self.targets.names, np.arange(n), np.full(n, "", dtype=object)
        )
        problem = Problem(self.arm, points, self.parameters, self.phases)
        return problem, State(np.eye(4), self.targets.places, np.zeros(len(self.parameters)))

    def rows(self, q, seen):
        """Scaled Jacobians of poses.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        seen : ndarray of bool, shape (n, k)
            Reflectors measured in each pose.

        Returns
        -------
        ndarray, shape (n, r, unknowns)
            ``r`` is three times the largest number of reflectors in a pose; poses with fewer have rows of zeros.
        """
        problem, state = self.problem(q, seen)
        J = problem.jacobian(state).reshape(-1, 3, problem.unknowns) * (self.scale / self.noise)
        slot = (np.cumsum(seen, axis=1) - 1)[seen]
        out = np.zeros((len(q), int(seen.sum(axis=1).max(initial=0)), 3, problem.unknowns))
        out[np.nonzero(seen)[0], slot] = J
        return out.reshape(len(q), -1, problem.unknowns)

    def candidates(self, q, seen, imagined=0.0):
        """What candidate poses would show.

        Parameters
        ----------
        q : ndarray, shape (N, joints)
        seen : ndarray of bool, shape (N, k)
        imagined : float
            Size of the errors that the model does not describe, radians; 0 for none.

        Returns
        -------
        Candidates
        """
        return Candidates(self.rows(q, seen), self._errors(q, seen, imagined) if imagined else None)

    def _errors(self, q, seen, size):
        """Imagined errors as they move the reflectors, over the noise, shape (n, r, h).

        Each joint errs by waves with 1 to `WAVES` periods a turn, a cosine and a sine each, independent of one another;
        and its axis is tilted. Their squares add up to those of the expected error.
        """
        joints, slides = q.shape[1], self.arm.table.prismatic
        unit = np.where(slides, METRES_PER_DEGREE / DEG, 1.0)
        kinds = [parameter(f"delta_{'d' if slides[i] else 'theta'}{i + 1}") for i in range(joints)]
        kinds += [parameter(f"delta_beta{i + 1}") for i in range(1, joints)]
        problem = Problem(self.arm, self.problem(q, seen)[0].points, kinds)
        J = problem.jacobian(State(np.eye(4), self.targets.places, np.zeros(len(kinds))))[:, self.outer :]
        J = J.reshape(-1, 3, len(kinds)) * (size / self.noise)
        pose = np.nonzero(seen)[0]
        slot = (np.cumsum(seen, axis=1) - 1)[seen]
        turns = np.arange(1, WAVES + 1)[:, None] * (q / unit)[pose, None]
        waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=1) * unit / np.sqrt(WAVES)
        moved = (J[:, :, None, :joints] * waves[:, None]).reshape(len(pose), 3, -1)
        out = np.zeros((len(q), int(seen.sum(axis=1).max(initial=0)), 3, 2 * WAVES * joints + joints - 1))
        out[pose, slot] = np.concatenate([moved, J[:, :, joints:]], axis=2)
        return out.reshape(len(q), out.shape[1] * 3, -1)

    def aim(self, criterion, q=None, target=0, imagined=0.0):
        """What a plan is chosen for.

        Parameters
        ----------
        criterion : str
            See `CRITERIA`.
        q : ndarray, shape (n, joints)
            Sample poses of the volume, for ``position``.
        target : int
            Reflector whose predicted positions count.
        imagined : float
            As for `candidates`.

        Returns
        -------
        Aim

        Raises
        ------
        MeasurementError
            If there is no such criterion.
        """
        if criterion not in CRITERIA:
            raise MeasurementError(f"unknown criterion {criterion!r}: choose one of {', '.join(CRITERIA)}")
        if criterion == "D":
            return Aim(self.outer)
        there = self.candidates(q, self.one(len(q), target), imagined)
        J, E = (_flat(part) * self.noise for part in (there.rows, there.errors))
        n = len(q)
        return Aim(self.outer, J.T @ J / n, J.T @ E / n, float(np.sum(E**2)) / n)

    def one(self, n, target):
        """Mask (n, k) of one reflector."""
        return np.tile(np.arange(len(self.targets.names)) == target, (n, 1))

    def measuring(self, seen):
        """The model with only the reflectors that a mask (n, k) has anywhere, and the mask for it."""
        used = seen.any(axis=0)
        names = tuple(name for name, have in zip(self.targets.names, used, strict=True) if have)
        return Model(self.arm, Targets(names, self.targets.places[used]), self.level, self.noise), seen[:, used]


def _flat(blocks):
    """The rows of all poses one below the other, (n r, p) of (n, r, p)."""
    n, r, p = blocks.shape
    return blocks.reshape(n * r, p)


@dataclass(frozen=True, eq=False)
class Chosen:
    """Poses chosen out of candidates.

    Attributes
    ----------
    rows : ndarray of int, shape (count,)
        Ascending.
    value, start_value : float
        The criterion reached and that of the start: less is better (``position``: mean squared distance error, m^2;
        ``D``: minus log det).
    exchanges : int
    """

    rows: np.ndarray
    value: float
    start_value: float
    exchanges: int


@dataclass(frozen=True, eq=False)
class Candidates:
    """What candidates would show.

    Attributes
    ----------
    rows : ndarray, shape (N, r, p)
        See `Model.rows`.
    errors : ndarray, shape (N, r, h)
        Imagined errors that the model does not describe, over the noise; ``h`` may be 0.
    """

    rows: np.ndarray
    errors: np.ndarray = None

    def __post_init__(self):
        if self.errors is None:
            object.__setattr__(self, "errors", np.zeros((*self.rows.shape[:2], 0)))


@dataclass(frozen=True, eq=False)
class Aim:
    """What a plan is chosen for.

    Attributes
    ----------
    outer : int
        Number of base and target unknowns, the first ones.
    G : ndarray, shape (p, p), or None
        Mean of ``J^T J`` over the volume for criterion ``position`` (see `Model.aim`); None for ``D``.
    cross : ndarray, shape (p, h), or None
        Mean of ``J^T E`` with the imagined errors in the volume.
    constant : float
        Mean of their squares.
    given : tuple
        Information (p, p) and ``J^T E`` (p, h) that are there anyway; numbers where there is nothing.
    """

    outer: int
    G: np.ndarray | None = None
    cross: np.ndarray | None = None
    constant: float = 0.0
    given: tuple = (0.0, 0.0)

    def with_given(self, poses):
        """The same with what some poses (Candidates) show taken as there."""
        X, E = _flat(poses.rows), _flat(poses.errors)
        return replace(self, given=(self.given[0] + X.T @ X, self.given[1] + X.T @ E))

    def sums(self, rows, errors):
        """Information with prior (p, p) and ``J^T E`` (p, h) of poses."""
        X, E = _flat(rows), _flat(errors)
        return np.eye(X.shape[1]) + self.given[0] + X.T @ X, self.given[1] + X.T @ E

    def value(self, rows, errors):
        """The criterion; less is better."""
        M, N = self.sums(rows, errors)
        if self.G is None:
            return float(np.linalg.slogdet(M[: self.outer, : self.outer])[1] - np.linalg.slogdet(M)[1])
        value = float(np.sum(np.linalg.inv(M) * self.G))
        if N.shape[1]:
            A = np.linalg.solve(M, N)
            value += float(np.sum(A * (self.G @ A - 2 * self.cross))) + self.constant
        return value


def exchange(candidates, count, aim, start=None, step=None):
    """Choose poses by exchange.

    Parameters
    ----------
    candidates : Candidates
    count : int
    aim : Aim
    start : sequence of int, optional
        Candidates to start from; chosen one by one, each the best, unless given.
    step : callable, optional
        Called after each pass.

    Returns
    -------
    Chosen

    Raises
    ------
    MeasurementError
        If there are fewer candidates than poses wanted.
    """
    n = len(candidates.rows)
    if not 1 <= count <= n:
        raise MeasurementError(f"expected to choose between 1 and {n} poses of as many candidates, found {count}")

    def value():
        return aim.value(candidates.rows[chosen], candidates.errors[chosen])

    chosen = _one_by_one(candidates, count, aim) if start is None else np.array(start, dtype=int)
    start_value, exchanges = value(), 0
    for _ in range(PASSES):
        before = value()
        everyone = _Ratings(candidates, np.arange(n), aim)
        everyone.reset(chosen)
        # where the best poses for this plan are, the best for its neighbours are, too
        pool = np.union1d(np.argsort(-everyone.gains())[: max(ACTIVE, 4 * count)], chosen)
        places, swapped = _pass(_Ratings(candidates, pool, aim), np.searchsorted(pool, chosen))
        chosen = pool[places]
        exchanges += swapped
        if step is not None:
            step()
        if not swapped or before - value() < ENOUGH * abs(before):
            break
    return Chosen(np.sort(chosen), value(), start_value, exchanges)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Chosen poses beside random ones of the same candidates, by the criterion (less is better).

    Attributes
    ----------
    optimal : float
    random : dict of int to float
        Number of random poses -> mean over `DRAWS` draws.
    as_good_as : int or None
        How many random poses are as good as the chosen ones; None where more than were looked at.
    """

    optimal: float
    random: dict
    as_good_as: int | None


def compare(candidates, chosen, aim, seed=0):
    """How many random poses are as good as chosen ones.

    Parameters
    ----------
    candidates : Candidates
    chosen : Chosen
    aim : Aim
    seed : int

    Returns
    -------
    Comparison
    """
    rng = np.random.default_rng(seed)
    n, count = len(candidates.rows), len(chosen.rows)
    means = {}
    for size in sorted({min(n, round(count * factor)) for factor in (1, 1.25, 1.5, 2, 2.5, 3, 4, 6)}):
        draws = [rng.choice(n, size, replace=False) for _ in range(DRAWS)]
        means[size] = float(np.mean([aim.value(candidates.rows[d], candidates.errors[d]) for d in draws]))
    sizes, values = np.log(list(means)), np.minimum.accumulate(list(means.values()))
    within = values[-1] <= chosen.value <= values[0]
    same = round(float(np.exp(np.interp(-chosen.value, -values, sizes)))) if within else None
    return Comparison(chosen.value, means, same)


def _one_by_one(candidates, count, aim):
    """A start: each pose the best of a part of the candidates for those chosen before."""
    pool = np.arange(0, len(candidates.rows), max(1, len(candidates.rows) // max(ACTIVE, 4 * count)))
    ratings = _Ratings(candidates, pool, aim)
    free, chosen = np.ones(len(pool), dtype=bool), []
    for _ in range(count):
        k = int(np.argmax(np.where(free, ratings.gains(), -np.inf)))
        ratings.change(k, 1.0)
        free[k] = False
        chosen.append(k)
    return pool[chosen]


def _pass(ratings, chosen):
    """Exchange each chosen pose for the best candidate in its place; new choice and number of exchanges."""
    chosen = np.array(chosen)
    ratings.reset(chosen)
    free = np.ones(len(ratings.rows), dtype=bool)
    free[chosen] = False
    swapped = 0
    for slot, old in enumerate(chosen):
        saved = ratings.saved()
        ratings.change(old, -1.0)
        free[old] = True
        gains = np.where(free, ratings.gains(), -np.inf)
        new = int(np.argmax(gains))
        if gains[new] <= gains[old] + 1e-9 * abs(gains[old]):
            free[old] = False
            ratings.restore(saved)
            continue
        ratings.change(new, 1.0)
        free[new] = False
        swapped += 1
        chosen[slot] = new
    return chosen, swapped


class _Ratings:
    """What each candidate would add, kept up to date while poses come and go.

    Parameters
    ----------
    candidates : Candidates
    pool : ndarray of int
        Those that are rated.
    aim : Aim
    """

    def __init__(self, candidates, pool, aim):
        self.rows, self.aim = candidates.rows[pool], aim
        self.flat = self.rows.reshape(-1, self.rows.shape[2])
        self.errors = candidates.errors[pool]
        self.reset(np.zeros(0, dtype=int))

    def reset(self, chosen):
        """Begin anew with chosen poses of the pool; no rounding is carried on."""
        aim = self.aim
        self.M, self.N = aim.sums(self.rows[chosen], self.errors[chosen])
        C = np.linalg.inv(self.M)
        self.full = self._blocks(C, slice(None))
        if aim.G is None:
            part = slice(aim.outer)
            self.inner = self._blocks(np.linalg.inv(self.M[part, part]), part)
        else:
            self.B = self._blocks(C @ aim.G @ C, slice(None))

    def _blocks(self, C, part):
        """``J C J^T`` of each candidate, shape (N, r, r)."""
        n, r, _ = self.rows.shape
        return (self.flat[:, part] @ C).reshape(n, r, -1) @ self.rows[:, :, part].transpose(0, 2, 1)

    def gains(self):
        """How much better the criterion becomes with each candidate, shape (N,)."""
        r = self.rows.shape[1]
        if self.aim.G is None:
            return np.linalg.slogdet(np.eye(r) + self.full)[1] - np.linalg.slogdet(np.eye(r) + self.inner)[1]
        W = np.linalg.inv(np.eye(r) + self.full)
        gain = np.einsum("nij,nji->n", W, self.B)
        if self.errors.shape[2]:
            # the fit moves by C J' W e, with e what is left of the imagined errors in the candidate
            C = np.linalg.inv(self.M)
            A = C @ self.N
            e = self.errors - (self.flat @ A).reshape(self.errors.shape)
            We = W @ e
            Y = (self.flat @ (C @ (self.aim.G @ A - self.aim.cross))).reshape(self.errors.shape)
            gain -= np.einsum("nih,nih->n", We, 2 * Y + self.B @ We)
        return gain

    def saved(self):
        """All that `change` changes, for `restore`."""
        return self.M, self.N, self.full.copy(), (self.inner if self.aim.G is None else self.B).copy()

    def restore(self, saved):
        """Undo the changes since `saved`."""
        self.M, self.N, self.full, other = saved
        if self.aim.G is None:
            self.inner = other
        else:
            self.B = other

    def change(self, k, sign):
        """Take candidate k in (sign 1) or out (-1)."""
        X, G = self.rows[k], self.aim.G
        C = np.linalg.inv(self.M)
        V, W, U = self._turn(self.full, X, C, slice(None), sign)
        if G is None:
            part = slice(self.aim.outer)
            self._turn(self.inner, X, np.linalg.inv(self.M[part, part]), part, sign)
        else:
            # V W Z' + Z W V' - V (W U'GU W) V' = V T' + T V' with T = Z W - V (W U'GU W) / 2
            T = self._by(C @ (G @ U), slice(None)) @ W - V @ (0.5 * W @ (U.T @ G @ U) @ W)
            cross = self._outer(V, T)
            self.B -= cross
            self.B -= cross.transpose(0, 2, 1)
        self.M = self.M + sign * X.T @ X
        self.N = self.N + sign * X.T @ self.errors[k]

    def _turn(self, blocks, X, C, part, sign):
        """Update ``J C J^T`` in place by Woodbury's formula; C is that before the change."""
        X = X[:, part]
        U = C @ X.T
        W = np.linalg.inv(sign * np.eye(len(X)) + X @ U)
        V = self._by(U, part)
        blocks -= self._outer(V @ W, V)
        return V, W, U

    def _by(self, U, part):
        """``J U`` of all candidates, shape (N r, r)."""
        return self.flat[:, part] @ U

    def _outer(self, A, B):
        """``A B^T`` of each candidate for (N r, r) arrays, shape (N, r, r)."""
        n, r, _ = self.rows.shape
        return A.reshape(n, r, r) @ B.reshape(n, r, r).transpose(0, 2, 1)


@dataclass(frozen=True)
class Predicted:
    """Predicted standard deviation of one error parameter.

    Attributes
    ----------
    name, unit : str
    std : float or None
        In the unit of the surface; None where the poses do not show the parameter by itself.
    state : str
        ``identified``, ``tied`` or ``held``, as in a calibration.
    """

    name: str
    unit: str
    std: float | None
    state: str


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a plan promises, from the noise of the points alone: errors that no model describes are not in it.

    Attributes
    ----------
    model : Model
        With the reflectors that the plan measures.
    parameters : list of Predicted
    covariance : ndarray, shape (unknowns, unknowns)
        Of base, targets and error parameters, SI units; held combinations add nothing.
    """

    model: Model
    parameters: list
    covariance: np.ndarray

    def position_std(self, q, target):
        """Standard deviations of a reflector's predicted positions: root of the summed variances of x, y and z.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        target : str
            One that the plan measures.

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        index = self.model.targets.names.index(target)
        problem, state = self.model.problem(q, self.model.one(len(q), index))
        J = problem.jacobian(state)
        return np.sqrt(np.sum((J @ self.covariance) * J, axis=1).reshape(-1, 3).sum(axis=1))


def predict(model, q, seen):
    """Standard deviations that a plan promises.

    Parameters
    ----------
    model : Model
    q : ndarray, shape (n, joints)
    seen : ndarray of bool, shape (n, k)
        Reflectors measured in each pose; those that no pose has are left out.

    Returns
    -------
    Prediction

    Raises
    ------
    IdentificationError
        If the poses cannot determine base and targets, or are too few.
    """
    model, seen = model.measuring(seen)
    problem, state = model.problem(q, seen)
    H, _, _ = problem.normal_equations(state)
    found = observability.information(problem, H, model.noise**2)
    solid = found.eigenvalues > observability.ROUNDING * found.eigenvalues.max(initial=0.0)
    found = replace(found, sigma=model.noise, seen=solid & (found.eigenvalues > model.noise**2))
    covariance = found.covariance()
    std = np.sqrt(np.diag(covariance)[problem.outer :])
    out = []
    for item, value, share in zip(model.parameters, std, found.held_fraction(), strict=True):
        unit, factor = UNIT_OUTSIDE[item.unit]
        name = "held" if share > HELD else "tied" if share > TIED else "identified"
        out.append(Predicted(item.name, unit, float(value / factor) if name == "identified" else None, name))
    return Prediction(model, out, covariance)
