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
joint map          ``sum_i dp/dtheta_i dtheta_i/dparameter``
target             axes of the tip link
base               rotation ``e x p``, translation ``e``
=================  ==========================================
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock, row_arithmetic
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames, parameters
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import Parameter
from irbcal.modeling.thesis_map import ThesisMap, fourier_terms, stiffness_terms

BLOCK = 2048
"""Poses whose Jacobian is in memory at a time."""


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Some points with the frames at which they are, and where their rows stand; made once for a problem: not locked.

    Points are arranged in t rows of f. Where poses have t points each, and none an orientation, the frames of a pose
    are needed once, for the points below one another; else once for every point, and there is one row.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Of poses, radians.
    frames : ndarray of int, shape (f,), or slice
        Rows of ``q`` at which frames are needed.
    target : ndarray of int, shape (t, f)
        Target of each point.
    xyz : ndarray, shape (3, t f)
        Measured points in their order here, metres.
    turned : ndarray of int, shape (o,)
        Points with a measured orientation, of the one row.
    rotation : ndarray, shape (o, 3, 3)
    rows : ndarray of int, shape (t f + o,)
        Of the whole problem: the points', then the orientations'.
    session : ndarray of int, shape (t f + o,)
        Of each row.
    stiffness : ndarray, shape (2, f)
        Terms of A and B at each frame; empty where no parameter needs them.
    fourier : ndarray, shape (4, f)
        Terms of joint 6; likewise.
    """

    q: FloatArray
    frames: IntArray | slice
    target: IntArray
    xyz: FloatArray
    turned: IntArray
    rotation: FloatArray
    rows: IntArray
    session: IntArray
    stiffness: FloatArray
    fourier: FloatArray


def cut(
    points: PointSet, oriented: BoolArray, session: IntArray, phases: FloatArray, kinds: Container[str]
) -> list[PoseBlock]:
    """Points in blocks of at most `BLOCK` poses, those with as many points as most others by themselves.

    Parameters
    ----------
    points : PointSet
    oriented : ndarray of bool, shape (m,)
        Which points have an orientation.
    session : ndarray of int, shape (m,)
        Of each point.
    phases : ndarray, shape (2,)
        Of the stiffness terms, radians.
    kinds : container of str
        Kinds of error parameters: those that need terms of the joint map.

    Returns
    -------
    list of PoseBlock
        Poses without points are in none.
    """
    before = np.cumsum(oriented) - 1 + len(points)
    none = np.zeros((0, 0))

    def block(q: FloatArray, frames: IntArray | slice, at: IntArray) -> PoseBlock:
        """The points ``at`` (t, f) of ``points``, at these frames of ``q``."""
        flat = at.ravel()
        turned = np.flatnonzero(oriented[flat])
        return PoseBlock(
            q=q,
            frames=frames,
            target=points.target[at],
            xyz=np.ascontiguousarray(points.xyz[flat].T),
            turned=turned,
            rotation=np.zeros((0, 3, 3)) if points.rotation is None else points.rotation[flat[turned]],
            rows=np.concatenate([flat, before[flat[turned]]]),
            session=np.concatenate([session[flat], session[flat[turned]]]),
            stiffness=np.asarray(stiffness_terms(q, phases))[:, frames] if "stiffness" in kinds else none,
            fourier=fourier_terms(q)[:, frames] if "fourier" in kinds else none,
        )

    edges = np.searchsorted(points.pose, [*range(0, points.poses, BLOCK), points.poses])
    blocks = []
    for start, first, end in zip(range(0, points.poses, BLOCK), edges[:-1], edges[1:], strict=True):
        q = points.q[start : start + BLOCK]
        pose, at = points.pose[first:end] - start, np.arange(first, end)
        counts = np.bincount(pose, minlength=len(q))
        usual = 1 + int(np.argmax(np.bincount(counts)[1:])) if len(at) else 0
        shared = counts == (0 if oriented[first:end].any() else usual)
        own = shared[pose]
        if 2 * np.count_nonzero(own) < len(at):
            own[:] = False
        if usual and own.any():
            blocks.append(block(q if shared.all() else q[shared], slice(None), at[own].reshape(-1, usual).T))
        if not own.all():
            blocks.append(block(q, pose[~own], at[~own][None]))
    return blocks


ORIENTATION_LENGTH = 0.3
"""Metres per radian: a rotation of the target frame counts as the motion of a point this far away."""


@dataclass(frozen=True, eq=False)
class State:
    """One candidate: base, targets and error parameters.

    Attributes
    ----------
    T_world_base : ndarray, shape (4, 4)
    targets : ndarray, shape (T, 3)
        In the tip link, metres.
    errors : ndarray, shape (k,)
        Error parameters, SI units.
    rotations : ndarray, shape (T, 3, 3)
        Target frames in the tip link; identity for targets without measured orientation.
    others : ndarray, shape (sessions - 1, 4, 4)
        Bases in the measuring frames of the sessions before the last one.
    """

    T_world_base: FloatArray
    targets: FloatArray
    errors: FloatArray
    rotations: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    others: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))

    def __post_init__(self) -> None:
        if not len(self.rotations):
            object.__setattr__(self, "rotations", np.tile(np.eye(3), (len(self.targets), 1, 1)))
        lock(self)

    @property
    def bases(self) -> FloatArray:
        """Bases of all sessions, the last one's last, shape (sessions, 4, 4)."""
        return np.concatenate([self.others, self.T_world_base[None]])


class Problem:
    """Measured points and orientations against an arm with given error parameters (Nubiola 2011, section 3.5).

    The prediction is that of eqs. 3.32, 3.33 and 3.34 with the joint map of `irbcal.modeling.thesis_map`, from the base
    in the measuring frame to the target on the tool.

    A measured orientation is one more row of three residuals: the rotation vector from the predicted to the
    measured target frame, times `ORIENTATION_LENGTH`. Rows are ordered: all positions, then all orientations.

    The unknowns are ordered: base (rotation vector, translation, in the base link), positions of the targets
    that are not known, orientations of the targets that were measured with one, bases of the sessions before the last
    one, error parameters. All but the last kind have no nominal value and are called *outer*.

    Points of different sessions (`PointSet.session`) are in measuring frames of their own, which share nothing: each
    has its own base. That of the last pose's session is *the* base.

    Parameters
    ----------
    arm : Arm
        The nominal arm.
    points : PointSet
    error_parameters : sequence of Parameter
    phases : array_like, shape (2,)
        Of the stiffness terms, see `irbcal.modeling.thesis_map`.
    known_targets : dict of str to array_like, shape (3,), optional
        Positions in the tip link that are not identified, metres.
    orientation_length : float
        Metres per radian.
    sessions : sequence of str, optional
        Names of all sessions, the last one last, where the points are only some of a larger set; by default those of
        the points in the order in which they are first seen, that of the last pose last.

    Attributes
    ----------
    sessions : tuple of str
        One without a name where the points have none.
    rows : int
        Number of measured vectors, positions and orientations.
    outer : int
        Number of outer unknowns.
    weights : ndarray, shape (rows,)
        Factor on each row: median uncertainty over the row's own; 1 where no uncertainty is given.
    kinds : dict
        Places of the error parameters of each kind, and their joints (or numbers): arrays of int.
    """

    def __init__(
        self,
        arm: Arm,
        points: PointSet,
        error_parameters: Sequence[Parameter],
        phases: ArrayLike = (0.0, np.pi / 2),
        known_targets: Mapping[str, ArrayLike] | None = None,
        orientation_length: float = ORIENTATION_LENGTH,
        sessions: Sequence[str] | None = None,
    ) -> None:
        self.arm = arm
        self.points = points
        self.parameters = tuple(error_parameters)
        self.joint_map = ThesisMap(np.zeros(len(arm.joint_names)), phases=np.asarray(phases, dtype=float))
        self.known = {k: np.asarray(v, float) for k, v in (known_targets or {}).items() if k in points.target_names}
        self.orientation_length = orientation_length
        self.sessions = session_names(points) if sessions is None else tuple(sessions)
        names = points.target_names
        oriented = points.oriented()
        self.free = np.array([k for k, name in enumerate(names) if name not in self.known], dtype=int)
        self.framed = np.unique(points.target[oriented])
        self.others = 6 + 3 * len(self.free) + 3 * len(self.framed)
        self.outer = self.others + 6 * (len(self.sessions) - 1)
        self.rows = len(points) + int(oriented.sum())
        self.weights = _weights(points, oriented)
        self.kinds = _places(self.parameters)
        self._blocks = self._cut(points, oriented)

    def _cut(self, points: PointSet, oriented: BoolArray) -> list[PoseBlock]:
        return cut(points, oriented, self.session_of_points(), self.joint_map.phases, self.kinds)

    def of_poses(self, keep: BoolArray) -> Problem:
        """The same unknowns and weights with some of the poses, shape (n,)."""
        part = copy(self)
        own = keep[self.points.pose]
        part.points = self.points.select(keep)
        oriented = part.points.oriented()
        part.rows = len(part.points) + int(oriented.sum())
        part.weights = self.weights[np.concatenate([own, own[self.points.oriented()]])]
        part._blocks = part._cut(part.points, oriented)
        return part

    @property
    def unknowns(self) -> int:
        """Number of unknowns: base, targets and error parameters."""
        return self.outer + len(self.parameters)

    def moved(self, state: State, step: FloatArray) -> State:
        """The state after a step in the order of the unknowns.

        The base moves by a rotation vector and a translation given in the base link, a target frame by a
        rotation vector given in the tip link.
        """
        shift = frames.transform(frames.rotation_from_one(step[:3]), step[3:6])
        targets, rotations = state.targets.copy(), state.rotations.copy()
        k = 6 + 3 * len(self.free)
        targets[self.free] += step[6:k].reshape(-1, 3)
        for j, turn in zip(self.framed, step[k : self.others].reshape(-1, 3), strict=True):
            rotations[j] = frames.rotation_from_one(turn) @ rotations[j]
        steps = step[self.others : self.outer].reshape(-1, 6)
        others = [
            T @ frames.transform(frames.rotation_from_one(s[:3]), s[3:])
            for T, s in zip(state.others, steps, strict=True)
        ]
        return State(
            state.T_world_base @ shift,
            targets,
            state.errors + step[self.outer :],
            rotations,
            np.array(others).reshape(-1, 4, 4),
        )

    def session_of_points(self) -> IntArray:
        """Number of each point's session in ``sessions``, shape (m,)."""
        if len(self.sessions) < 2:
            return np.zeros(len(self.points), dtype=int)
        number = {name: k for k, name in enumerate(self.sessions)}
        own = np.full(self.points.poses, self.sessions[-1]) if self.points.session is None else self.points.session
        return np.array([number[str(name)] for name in own], dtype=int)[self.points.pose]

    def in_base_link(self, state: State) -> FloatArray:
        """Measured points in the base link, shape (m, 3), metres."""
        T = frames.inverse(state.bases)
        T = T[self.session_of_points()]
        return np.einsum("mij,mj->mi", T[:, :3, :3], self.points.xyz) + T[:, :3, 3]

    def model(self, state: State) -> tuple[Arm, ThesisMap]:
        """Arm and joint map with the state's error parameters added."""
        if not state.errors.any():
            return self.arm, self.joint_map
        table, joint_map = parameters.apply(self.parameters, state.errors, self.arm.table, self.joint_map)
        return self.arm.with_table(table), joint_map

    def residuals(self, state: State) -> FloatArray:
        """Residuals of all rows in the base link, shape (rows, 3), metres; not weighted."""
        arm, joint_map = self.model(state)
        out = np.empty((self.rows, 3))
        for block in self._blocks:
            out[block.rows] = self._misses(block, arm, joint_map, state).T
        return out

    def jacobian(self, state: State) -> FloatArray:
        """Derivative of all predictions, shape (3 rows, unknowns), x, y, z of a row side by side; not weighted.

        For small problems; least squares uses `normal_equations`.
        """
        out = np.empty((self.rows, 3, self.unknowns))
        for rows, J in self.jacobian_blocks(state):
            out[rows] = J
        return out.reshape(-1, self.unknowns)

    def jacobian_blocks(self, state: State) -> Iterator[tuple[IntArray, FloatArray]]:
        """Parts of the `jacobian`: rows (r,) and their derivatives (r, 3, unknowns), a block of poses at a time."""
        arm, joint_map = self.model(state)
        for block in self._blocks:
            yield block.rows, self._derivatives(block, arm, joint_map, state)[1].transpose(2, 1, 0)

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
        arm, joint_map = self.model(state)
        H, g, rss = np.zeros((self.unknowns, self.unknowns)), np.zeros(self.unknowns), 0.0
        for block in self._blocks:
            r, J = self._derivatives(block, arm, joint_map, state)
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
        model = self.model(state)
        g, rss = np.zeros(self.unknowns), 0.0
        for block, flat in zip(self._blocks, slopes, strict=True):
            r = self.weights[block.rows] * self._misses(block, *model, state)
            g, rss = g + flat @ r.ravel(), rss + float(np.vdot(r, r))
        return g, rss

    def rss(self, state: State, weights: FloatArray | None = None) -> float:
        """Weighted sum of squared residuals, m^2."""
        weights = self.weights if weights is None else weights
        return float(np.sum((weights[:, None] * self.residuals(state)) ** 2))

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
        if not len(state.others):
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
            r[:, m:] = self.orientation_length * _rotation_vectors(measured @ predicted.transpose(0, 2, 1)).T
        return r, p

    def _misses(self, block: PoseBlock, arm: Arm, joint_map: ThesisMap, state: State) -> FloatArray:
        """Residuals (3, rows) of one block."""
        theta = joint_map.effective(block.q).T + arm.table.offsets[:, None]
        tip = dhm.tip_columns(arm.table, theta, arm.T_base_0, arm.T_last_tip)
        return self._residuals(block, tip[..., block.frames], state)[0]

    def _derivatives(
        self, block: PoseBlock, arm: Arm, joint_map: ThesisMap, state: State
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals (3, rows) and derivatives (unknowns, 3, rows) of one block."""
        theta = joint_map.effective(block.q)[block.frames].T + arm.table.offsets[:, None]
        chain = dhm.chain_frames(arm.table, theta, arm.T_base_0, arm.T_last_tip)
        tip = chain.tip
        r, p = self._residuals(block, tip, state)
        m = block.target.size
        J = np.zeros((self.unknowns, 3, r.shape[1]))
        at_points = J[:, :, :m].reshape(*J.shape[:2], *block.target.shape)  # a view
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            np.multiply(p[j], -1.0, out=at_points[k, i])
            at_points[k, j], at_points[3 + k, k] = p[i], 1.0
        own = [(block.target == k).astype(float) for k in self.free]
        with row_arithmetic():
            for slot, mine in enumerate(own):
                np.multiply(tip[:3, :, None], mine, out=at_points[6 + 3 * slot : 9 + 3 * slot])
            self._robot_columns(at_points[self.outer :], chain, p, block)
        if len(block.turned):
            self._orientation_columns(J[:, :, m:], chain, tip, block)
        self.share_out(J, block.session)
        return r, J

    def share_out(self, J: FloatArray, session: IntArray) -> None:
        """Give derivatives by the base, (unknowns, 3, rows), to the base of each row's session (rows,), in place."""
        for k in range(len(self.sessions) - 1):
            mine = np.flatnonzero(session == k)
            J[self.others + 6 * k : self.others + 6 * k + 6, :, mine] = J[:6, :, mine]
            J[:6, :, mine] = 0.0

    def _orientation_columns(self, J: FloatArray, chain: dhm.ChainFrames, tip: FloatArray, block: PoseBlock) -> None:
        """Fill derivatives of the predicted rotation vectors, (unknowns, 3, o)."""
        turned = block.turned
        target = block.target[0, turned]
        length = self.orientation_length
        for k in range(3):
            J[k, k] = length
        start = 6 + 3 * len(self.free)
        for slot, k in enumerate(self.framed):
            mine = np.flatnonzero(target == k)
            J[start + 3 * slot : start + 3 * slot + 3, :, mine] = length * tip[:3, :, turned[mine]]
        axes = {"theta": chain.z, "alpha": chain.x_before, "beta": chain.y_tilt}
        self._fill(J[self.outer :], {kind: length * axis[..., turned] for kind, axis in axes.items()}, block, turned)

    def _robot_columns(self, J: FloatArray, chain: dhm.ChainFrames, p: FloatArray, block: PoseBlock) -> None:
        """Fill derivatives by the robot's error parameters, (k, 3, t, f)."""
        kinds = set(self.kinds)
        axes = {"a": chain.x_before, "d": chain.z, "b": chain.y_tilt}
        columns = {kind: axis[:, :, None] for kind, axis in axes.items()}
        if "alpha" in kinds:
            columns["alpha"] = _turned(chain.x_before, chain.o_before, p)
        if kinds & {"theta", "stiffness", "fourier", "gain"}:
            columns["theta"] = _turned(chain.z, chain.o, p)
        if "beta" in kinds:
            columns["beta"] = _turned(chain.y_tilt, chain.o_tilt, p)
        self._fill(J, columns, block, slice(None))

    def _fill(self, J: FloatArray, columns: Mapping[str, FloatArray], block: PoseBlock, some: IntArray | slice) -> None:
        """Derivatives at some frames of a block by every error parameter, from those by the DHM columns at them.

        Absent columns have no effect.
        """
        theta = columns.get("theta")
        for kind, (slots, indices) in self.kinds.items():
            if kind in columns:
                J[slots] = columns[kind][indices]
            elif kind == "gain":
                for slot, index in zip(slots, indices, strict=True):
                    along = columns.get("d" if self.arm.table.prismatic[index] else "theta")
                    if along is not None:
                        J[slot] = along[index] * block.q[block.frames, index][some]
            elif theta is not None and kind == "fourier":
                for slot, index in zip(slots, indices, strict=True):
                    np.multiply(theta[5], block.fourier[index, some], out=J[slot])
            elif theta is not None and kind == "stiffness":  # A turns joint 2, B joints 2 and 3
                for slot, index in zip(slots, indices, strict=True):
                    np.multiply(theta[1] + theta[2] if index else theta[1], block.stiffness[index, some], out=J[slot])


def _places(error_parameters: Sequence[Parameter]) -> dict[str, tuple[IntArray, IntArray]]:
    """Places of the parameters of each kind, and their joints (or numbers)."""
    found: dict[str, tuple[list[int], list[int]]] = {}
    for slot, parameter in enumerate(error_parameters):
        slots, indices = found.setdefault(parameter.kind, ([], []))
        slots.append(slot)
        indices.append(parameter.index)
    return {kind: (np.array(slots), np.array(indices)) for kind, (slots, indices) in found.items()}


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


def _rotation_vectors(R: FloatArray) -> FloatArray:
    """Rotation vectors (n, 3) of rotations (n, 3, 3)."""
    return frames.vector_from_rotation(R)


def _turned(axis: FloatArray, origin: FloatArray, p: FloatArray) -> FloatArray:
    """Velocity ``axis x (p - origin)`` for axes and origins (joints, 3, f) and points (3, t, f)."""
    arm = p - origin[:, :, None]
    out = np.empty_like(arm)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(axis[:, i, None], arm[:, j], out=out[:, k])
        out[:, k] -= axis[:, j, None] * arm[:, i]
    return out
