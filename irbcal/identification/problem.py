r"""Residuals of measured points and their analytic Jacobian, summed over blocks of poses into normal equations.

Residuals are taken in the robot's base link, where the distance is the same as in the measuring frame and
the base correction takes its simplest form::

    r = T_world_base^-1 y - p(q)

Partial derivatives of a point ``p`` of the tool, all in the base link (frames as in `irbcal.modeling.dhm`):

=================  ==========================================
parameter          derivative of ``p``
=================  ==========================================
``alpha_i``        ``x_{i-1} x (p - o_{i-1})``
``a_i``            ``x_{i-1}``
``theta_i``        ``z_i x (p - o_i)``
``d_i``            ``z_i``
``beta_i``         ``y_i x (p - o_i^tilt)``
``b_i``            ``y_i``
term               that of the motion of the joint's frame along the term's axis, times the term's function
target             axes of the tip link
base               rotation ``e x p``, translation ``e``
=================  ==========================================
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock, row_arithmetic
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.frames import LEVER
from irbcal.modeling.parameters import Parameter, term_of
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap, TermModel

BLOCK, TERMS_IN_BLOCK = 2048, 1 << 17
"""Poses whose Jacobian is in memory at a time; fewer where there are so many terms times poses."""
MOST_VALUES = 1 << 22
"""Values of terms' functions that are kept from one evaluation to the next."""


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Some points with the frames at which they are, and the numbers of their rows; not locked.

    Points are arranged in t rows of f. Where poses have t points each, and none an orientation, the frames of a pose
    are needed once, for the points below one another; else once for every point, and there is one row.
    """

    poses: IntArray | slice
    """Shape (n,). Numbers of its poses."""
    q: FloatArray
    """Shape (n, joints). Of poses, radians."""
    frames: IntArray | slice
    """Shape (f,). Rows of ``q`` at which frames are needed."""
    target: IntArray
    """Shape (t, f). Target of each point."""
    xyz: FloatArray
    """Shape (3, t f). Measured points in their order here, metres."""
    turned: IntArray
    """Shape (o,). Points with a measured orientation, of the one row."""
    rotation: FloatArray
    """Shape (o, 3, 3)."""
    rows: IntArray
    """Shape (t f + o,). Of the whole problem: the points', then the orientations'."""
    session: IntArray
    """Shape (t f + o,). Of each row."""


def cut(points: PointSet, oriented: BoolArray, session: IntArray, length: int = BLOCK) -> list[PoseBlock]:
    """Points in blocks of poses, those with as many points as most others by themselves.

    Parameters
    ----------
    points : PointSet
    oriented : ndarray of bool, shape (m,)
        Which points have an orientation.
    session : ndarray of int, shape (m,)
        Of each point.
    length : int
        Poses in a block at most.

    Returns
    -------
    list of PoseBlock
        Poses without points are in none.
    """
    orientation_row = np.cumsum(oriented) - 1 + len(points)

    def block(poses: IntArray | slice, frames: IntArray | slice, at: IntArray) -> PoseBlock:
        """The points ``at`` (t, f) of ``points``, at these frames of the poses."""
        flat = at.ravel()
        turned = np.flatnonzero(oriented[flat])
        return PoseBlock(
            poses=poses,
            q=points.q[poses],
            frames=frames,
            target=points.target[at],
            xyz=np.ascontiguousarray(points.xyz[flat].T),
            turned=turned,
            rotation=np.zeros((0, 3, 3)) if points.rotation is None else points.rotation[flat[turned]],
            rows=np.concatenate([flat, orientation_row[flat[turned]]]),
            session=np.concatenate([session[flat], session[flat[turned]]]),
        )

    edges = np.searchsorted(points.pose, [*range(0, points.poses, length), points.poses])
    blocks = []
    for start, first, end in zip(range(0, points.poses, length), edges[:-1], edges[1:], strict=True):
        poses = slice(start, min(start + length, points.poses))
        pose, at = points.pose[first:end] - start, np.arange(first, end)
        counts = np.bincount(pose, minlength=poses.stop - start)
        usual = 1 + int(np.argmax(np.bincount(counts)[1:])) if len(at) else 0
        shared = counts == (0 if oriented[first:end].any() else usual)
        alike = shared[pose]
        if 2 * np.count_nonzero(alike) < len(at):
            alike[:] = False
        if usual and alike.any():
            alike_poses = poses if shared.all() else start + np.flatnonzero(shared)
            blocks.append(block(alike_poses, slice(None), at[alike].reshape(-1, usual).T))
        if not alike.all():
            blocks.append(block(poses, pose[~alike], at[~alike][None]))
    return blocks


@dataclass(frozen=True, eq=False)
class State:
    """One candidate: base, targets and coefficients of the terms."""

    T_world_base: FloatArray
    """Shape (4, 4)."""
    targets: FloatArray
    """Shape (T, 3). In the tip link, metres."""
    errors: FloatArray
    """Shape (terms,). Coefficients of the terms, SI units."""
    rotations: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """Shape (T, 3, 3). Target frames in the tip link; identity for targets without measured orientation."""
    earlier_bases: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Shape (sessions - 1, 4, 4). Bases in the measuring frames of the sessions before the last one."""

    def __post_init__(self) -> None:
        if not len(self.rotations):
            object.__setattr__(self, "rotations", np.tile(np.eye(3), (len(self.targets), 1, 1)))
        lock(self)

    @property
    def bases(self) -> FloatArray:
        """Bases of all sessions, the last one's last, shape (sessions, 4, 4)."""
        return np.concatenate([self.earlier_bases, self.T_world_base[None]])


S = TypeVar("S")
"""A candidate: values of all unknowns."""


class VectorProblem(ABC, Generic[S]):
    """Measured vectors against a model with unknowns: what every solver takes."""

    nuisance: int
    """Number of unknowns without a nominal value; they stand before the error parameters."""
    rows: int
    """Number of vectors."""
    poses: int
    equations: int
    """Number of measured coordinates."""
    weights: FloatArray
    """Shape (rows,)."""
    scales: FloatArray
    """Shape (error parameters,). Plausible sizes of the error parameters in units of a step."""

    @property
    @abstractmethod
    def refusal(self) -> str:
        """Why measurements cannot serve where they leave nuisance unknowns open; empty where these may stay open."""

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.nuisance + len(self.scales)

    @abstractmethod
    def moved(self, state: S, step: FloatArray) -> S:
        """The state after a step (unknowns,)."""

    @abstractmethod
    def residuals(self, state: S) -> FloatArray:
        """Measured minus predicted, shape (rows, 3), metres; not weighted."""

    @abstractmethod
    def jacobian_blocks(self, state: S) -> Iterator[tuple[IntArray, FloatArray]]:
        """Parts of the `jacobian`: rows (r,) and their derivatives (r, 3, unknowns)."""

    def jacobian(self, state: S) -> FloatArray:
        """Derivative of all predictions, shape (3 rows, unknowns), x, y, z of a row side by side; not weighted."""
        out = np.empty((self.rows, 3, self.unknowns))
        for rows, J in self.jacobian_blocks(state):
            out[rows] = J
        return out.reshape(-1, self.unknowns)

    def rss(self, state: S) -> float:
        """Weighted sum of squared residuals, m^2."""
        return float(np.sum((self.weights[:, None] * self.residuals(state)) ** 2))

    def normal_equations(self, state: S, weights: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float]:
        """Sums of ``J^T J``, ``J^T r`` and ``r^T r`` with factors (rows,) on the rows, ``weights`` unless given."""
        factor = np.repeat(self.weights if weights is None else weights, 3)
        J, r = self.jacobian(state) * factor[:, None], self.residuals(state).ravel() * factor
        return J.T @ J, J.T @ r, float(r @ r)


class Problem(VectorProblem[State]):
    """Measured points and orientations against an arm with terms of the error model (Nubiola 2011, section 3.5).

    The prediction is that of eqs. 3.32, 3.33 and 3.34 with the sum of the terms, from the base in the measuring frame
    to the target on the tool. Levels are terms without prior, named by error parameters; evidence takes the same
    problem with more terms (`with_terms`).

    A measured orientation is one more row of three residuals: the rotation vector from the predicted to the
    measured target frame, times `LEVER`. Rows are ordered: all positions, then all orientations.

    The unknowns are ordered: base (rotation vector, translation, in the base link), positions of the targets
    that are not known, orientations of the targets that were measured with one, bases of the sessions before the last
    one, coefficients of the terms. All but the last kind have no nominal value and are called *nuisance*.

    Points of different sessions (`PointSet.session`) are in different measuring frames, which share nothing: each
    has a base. That of the last pose's session is *the* base.

    Parameters
    ----------
    arm : Arm
        The nominal arm.
    points : PointSet
    error_parameters : sequence of Parameter
    known_targets : dict of str to array_like, shape (3,), optional
        Positions in the tip link that are not identified, metres.
    sessions : sequence of str, optional
        Names of all sessions, the last one last, where the points are only some of a larger set; by default those of
        the points in the order in which they are first seen, that of the last pose last.

    Attributes
    ----------
    terms : tuple of Term
        Of the error parameters, or those of `with_terms`.
    motion : Motion
        What the terms are functions of, at the points' poses.
    sessions : tuple of str
        One without a name where the points have none.
    rows : int
        Number of measured vectors, positions and orientations.
    nuisance : int
        Number of nuisance unknowns.
    weights : ndarray, shape (rows,)
        Factor on each row: median uncertainty over the row's; 1 where no uncertainty is given.
    """

    def __init__(
        self,
        arm: Arm,
        points: PointSet,
        error_parameters: Sequence[Parameter],
        known_targets: Mapping[str, ArrayLike] | None = None,
        sessions: Sequence[str] | None = None,
    ) -> None:
        self.arm = arm
        self.points = points
        self.parameters = tuple(error_parameters)
        self.known_targets = {
            k: np.asarray(v, float) for k, v in (known_targets or {}).items() if k in points.target_names
        }
        self.sessions = session_names(points) if sessions is None else tuple(sessions)
        names = points.target_names
        oriented = points.oriented()
        self.fitted_targets = np.array([k for k, name in enumerate(names) if name not in self.known_targets], dtype=int)
        self.oriented_targets = np.unique(points.target[oriented])
        self.earlier_bases_start = 6 + 3 * len(self.fitted_targets) + 3 * len(self.oriented_targets)
        self.nuisance = self.earlier_bases_start + 6 * (len(self.sessions) - 1)
        self.scales = np.array([parameter.scale for parameter in self.parameters])
        self.weights = _weights(points, oriented)
        self._take([term_of(parameter, arm) for parameter in self.parameters], Motion(points.q))

    def _take(self, terms: Sequence[Term], motion: Motion) -> None:
        """Take terms, functions of a motion of the points' poses."""
        self.terms, self.motion, self.term_model = tuple(terms), motion, TermModel(self.arm, terms)
        oriented, length = self.points.oriented(), min(BLOCK, TERMS_IN_BLOCK // (1 + len(terms)))
        self.poses, self.rows = self.points.poses, len(self.points) + int(oriented.sum())
        self.equations = 3 * self.rows
        self._blocks = cut(self.points, oriented, self.session_of_points(), length)
        self._values: dict[int, FloatArray] = {}

    def with_terms(self, terms: Sequence[Term], motion: Motion) -> Problem:
        """The same points with other terms, as functions of a motion of their poses."""
        out = copy(self)
        out._take(terms, motion)
        return out

    def cut_like(self, other: Problem) -> bool:
        """Whether its blocks hold the same rows as those of the same problem with other terms."""
        pairs = zip(self._blocks, other._blocks, strict=False)
        return self.block_count == other.block_count and all(np.array_equal(a.rows, b.rows) for a, b in pairs)

    def of_poses(self, keep: BoolArray) -> Problem:
        """The same unknowns and weights with some of the poses, shape (n,)."""
        subset = copy(self)
        points_kept = keep[self.points.pose]
        subset.points = self.points.select(keep)
        subset.weights = self.weights[np.concatenate([points_kept, points_kept[self.points.oriented()]])]
        subset._take(self.terms, self.motion.select(keep))
        return subset

    @property
    def unknowns(self) -> int:
        """Number of unknowns: base, targets and coefficients."""
        return self.nuisance + len(self.terms)

    @property
    def turns(self) -> BoolArray:
        """Which nuisance unknowns are turns, shape (nuisance,); the others are shifts."""
        base, places = [True] * 3 + [False] * 3, [False] * (3 * len(self.fitted_targets))
        return np.array(base + places + [True] * (3 * len(self.oriented_targets)) + base * (len(self.sessions) - 1))

    @property
    def refusal(self) -> str:
        """Why the points cannot serve where they leave base or tool open; arms of parallel axes always do."""
        return (
            ""
            if self.arm.planar
            else f"the {self.poses} poses do not determine base and tool: they are too alike; "
            "measure poses that turn the tool about at least two directions"
        )

    def moved(self, state: State, step: FloatArray) -> State:
        """The state after a step in the order of the unknowns.

        The base moves by a rotation vector and a translation given in the base link, a target frame by a
        rotation vector given in the tip link.
        """
        shift = frames.transform(frames.rotation_from_one(step[:3]), step[3:6])
        targets, rotations = state.targets.copy(), state.rotations.copy()
        k = 6 + 3 * len(self.fitted_targets)
        targets[self.fitted_targets] += step[6:k].reshape(-1, 3)
        for j, turn in zip(self.oriented_targets, step[k : self.earlier_bases_start].reshape(-1, 3), strict=True):
            rotations[j] = frames.rotation_from_one(turn) @ rotations[j]
        steps = step[self.earlier_bases_start : self.nuisance].reshape(-1, 6)
        bases = [
            T @ frames.transform(frames.rotation_from_one(s[:3]), s[3:])
            for T, s in zip(state.earlier_bases, steps, strict=True)
        ]
        return State(
            state.T_world_base @ shift,
            targets,
            state.errors + step[self.nuisance :],
            rotations,
            np.array(bases).reshape(-1, 4, 4),
        )

    def session_of_points(self) -> IntArray:
        """Number of each point's session in ``sessions``, shape (m,)."""
        if len(self.sessions) < 2:
            return np.zeros(len(self.points), dtype=int)
        number = {name: k for k, name in enumerate(self.sessions)}
        session = np.full(self.points.poses, self.sessions[-1]) if self.points.session is None else self.points.session
        return np.array([number[str(name)] for name in session], dtype=int)[self.points.pose]

    def arm_at(self, state: State) -> Arm:
        """The arm with the state's constants of the geometry in its table."""
        return self.term_model.arm_at(state.errors)

    def model(self, state: State) -> tuple[Arm, TermMap]:
        """Arm with the state's constants of the geometry, and its other terms."""
        moving = self.term_model.moving
        return self.arm_at(state), TermMap(self.arm, tuple(self.terms[k] for k in moving), state.errors[moving])

    def residuals(self, state: State) -> FloatArray:
        """Residuals of all rows in the base link, shape (rows, 3), metres; not weighted."""
        arm = self.arm_at(state)
        out = np.empty((self.rows, 3))
        for k, block in enumerate(self._blocks):
            out[block.rows] = self._residuals_of_block(k, arm, state).T
        return out

    def jacobian_blocks(self, state: State) -> Iterator[tuple[IntArray, FloatArray]]:
        """A block of poses at a time, see `VectorProblem.jacobian_blocks`."""
        arm = self.arm_at(state)
        for k, block in enumerate(self._blocks):
            yield block.rows, self.block(k, arm, state)[1].transpose(2, 1, 0)

    def normal_equations(
        self, state: State, weights: FloatArray | None = None, slopes: list[FloatArray] | None = None
    ) -> tuple[FloatArray, FloatArray, float]:
        """Weighted sums over all rows, a block of poses at a time.

        Parameters
        ----------
        state : State
        weights : ndarray, shape (rows,), optional
            Factors on residuals and derivatives, `self.weights` unless given.
        slopes : list, optional
            Takes the weighted derivatives of each block for `gradient_near`, where they are not too many to keep.

        Returns
        -------
        H : ndarray, shape (unknowns, unknowns)
            Sum of ``J^T J``.
        g : ndarray, shape (unknowns,)
            Sum of ``J^T r``.
        rss : float
            Sum of squared residuals, m^2.
        """
        weights = self.weights if weights is None else weights
        uniform = np.all(weights == 1.0)
        arm = self.arm_at(state)
        H, g, rss = np.zeros((self.unknowns, self.unknowns)), np.zeros(self.unknowns), 0.0
        for k, block in enumerate(self._blocks):
            r, J = self.block(k, arm, state)
            if not uniform:
                w = weights[block.rows]
                r *= w
                J *= w
            flat = J.reshape(self.unknowns, -1)
            H = H + flat @ flat.T
            g = g + flat @ r.ravel()
            rss += float(np.vdot(r, r))
            if slopes is not None and self.points.poses <= BLOCK:
                slopes.append(flat)
        return H, g, rss

    def gradient_near(self, state: State, slopes: Sequence[FloatArray]) -> tuple[FloatArray, float]:
        """``g`` and ``rss`` of `normal_equations` with the derivatives of a state close by, (unknowns, 3 rows) each."""
        arm = self.arm_at(state)
        g, rss = np.zeros(self.unknowns), 0.0
        for k, (block, flat) in enumerate(zip(self._blocks, slopes, strict=True)):
            r = self.weights[block.rows] * self._residuals_of_block(k, arm, state)
            g, rss = g + flat @ r.ravel(), rss + float(np.vdot(r, r))
        return g, rss

    def _residuals(self, block: PoseBlock, tip: FloatArray, state: State) -> tuple[FloatArray, FloatArray]:
        """Residuals (3, rows) of one block and its predicted points (3, t, f), from tip frames (4, 3, f)."""
        m = block.target.size
        local = state.targets.T[:, block.target]
        x, y, z, o = tip[:, :, None]
        p = np.multiply(x, local[0])
        for axis, along in ((y, local[1]), (z, local[2])):
            p += axis * along
        p += o
        r = np.empty((3, m + len(block.turned)))
        R: FloatArray = state.T_world_base[:3, :3].T
        if not len(state.earlier_bases):
            at_points = np.matmul(R, block.xyz, out=r[:, :m] if r.shape[1] == m else None)
            at_points -= (R @ state.T_world_base[:3, 3])[:, None]
            np.subtract(at_points, p.reshape(3, m), out=r[:, :m])
        else:
            each = frames.inverse(state.bases)[block.session]
            r[:, :m] = np.einsum("mij,jm->im", each[:m, :3, :3], block.xyz) + each[:m, :3, 3].T - p.reshape(3, m)
            R = each[m:, :3, :3]
        if len(block.turned):
            predicted = tip[:3, :, block.turned].transpose(2, 1, 0) @ state.rotations[block.target[0, block.turned]]
            measured = R @ block.rotation
            r[:, m:] = LEVER * frames.vector_from_rotation(measured @ predicted.transpose(0, 2, 1)).T
        return r, p

    @property
    def block_count(self) -> int:
        """Number of blocks of poses."""
        return len(self._blocks)

    def rows_of(self, k: int) -> IntArray:
        """Numbers of the rows of block number ``k``."""
        return self._blocks[k].rows

    def values(self, k: int) -> FloatArray:
        """Functions of the terms that are no constants at the poses of block number ``k``, shape (terms, n)."""
        if k in self._values:
            return self._values[k]
        poses = self._blocks[k].poses
        all_poses = isinstance(poses, slice) and poses.stop - poses.start == len(self.motion)
        out = self.term_model.values(self.motion if all_poses else self.motion.select(poses))
        if len(out) * len(self.motion) <= MOST_VALUES:
            self._values[k] = out
        return out

    def _joints(self, k: int, state: State) -> tuple[FloatArray, FloatArray | None]:
        """Effective joints (joints, n) of a block's poses, and small motions of the frames (n, joints, 6), if any."""
        return self.term_model.joints(self._blocks[k].q, state.errors, partial(self.values, k))

    def _residuals_of_block(self, k: int, arm: Arm, state: State) -> FloatArray:
        """Residuals (3, rows) of one block."""
        block, (theta, xi) = self._blocks[k], self._joints(k, state)
        if xi is None:
            tip = dhm.tip_columns(arm.table, theta + arm.table.offsets[:, None], arm.T_base_0, arm.T_last_tip)
        else:
            tip = chain.walk(arm, theta.T, xi).tip
        return self._residuals(block, tip[..., block.frames], state)[0]

    def block(
        self, k: int, arm: Arm, state: State, chosen: Sequence[int] | IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals and derivatives of the rows of block number ``k``; not weighted.

        Parameters
        ----------
        k : int
        arm : Arm
            `arm_at` the state.
        state : State
        chosen : sequence of int, optional
            Numbers of the terms wanted; all unless given.

        Returns
        -------
        r : ndarray, shape (3, rows)
            Metres.
        J : ndarray, shape (nuisance + terms, 3, rows)
        """
        block, (theta, xi) = self._blocks[k], self._joints(k, state)
        path = self.term_model.path(arm, theta[:, block.frames], None if xi is None else xi[block.frames], chosen)
        r, p = self._residuals(block, path.tip, state)
        m = block.target.size
        J = np.zeros((self.nuisance + (len(self.terms) if chosen is None else len(chosen)), 3, r.shape[1]))
        at_points = J[:, :, :m].reshape(*J.shape[:2], *block.target.shape)  # a view
        for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            np.multiply(p[j], -1.0, out=at_points[axis, i])
            at_points[axis, j], at_points[3 + axis, axis] = p[i], 1.0

        def values() -> FloatArray:
            return self.values(k)[:, block.frames]

        with row_arithmetic():
            for slot, target in enumerate(self.fitted_targets):
                at_target = (block.target == target).astype(float)
                np.multiply(path.tip[:3, :, None], at_target, out=at_points[6 + 3 * slot : 9 + 3 * slot])
            self.term_model.columns(path, values, p, chosen, at_points[self.nuisance :])
        if len(block.turned):
            turned = block.turned
            J[range(3), range(3), m:] = LEVER
            start = 6 + 3 * len(self.fitted_targets)
            for slot, target in enumerate(self.oriented_targets):
                of_target = np.flatnonzero(block.target[0, turned] == target)
                columns = LEVER * path.tip[:3, :, turned[of_target]]
                J[start + 3 * slot : start + 3 * slot + 3, :, m + of_target] = columns
            J[self.nuisance :, :, m:] = LEVER * self.term_model.columns(path, values, None, chosen)[..., turned]
        self.share_out(J, block.session)
        return r, J

    def share_out(self, J: FloatArray, session: IntArray) -> None:
        """Give derivatives by the base, (unknowns, 3, rows), to the base of each row's session (rows,), in place."""
        for k in range(len(self.sessions) - 1):
            rows = np.flatnonzero(session == k)
            J[self.earlier_bases_start + 6 * k : self.earlier_bases_start + 6 * k + 6, :, rows] = J[:6, :, rows]
            J[:6, :, rows] = 0.0


def session_names(points: PointSet) -> tuple[str, ...]:
    """Sessions in the order in which they are first seen, that of the last pose last; one without a name for none."""
    if points.session is None or not points.poses:
        return ("",)
    names = list(dict.fromkeys(str(name) for name in points.session))
    names.remove(last := str(points.session[-1]))
    return (*names, last)


def _weights(points: PointSet, oriented: BoolArray) -> FloatArray:
    """Row weights from the points' uncertainties: the median over the row's own, at most a hundred times either way."""
    if points.u95 is None or not np.isfinite(points.u95).any():
        return np.ones(len(points) + int(oriented.sum()))
    typical = np.nanmedian(points.u95)
    weights = np.clip(typical / np.where(np.isfinite(points.u95), points.u95, typical), 0.01, 100.0)
    return np.concatenate([weights, weights[oriented]])
