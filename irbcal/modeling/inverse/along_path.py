"""Joints along a path of poses: without jumps from one solution to another, and what stands in the way.

From pose to pose the tip goes straight, its turn about one axis at an even rate. That way is cut into pieces so short
that Newton's steps find the solution next to the one before; where joints still move by more than `JUMP` in the
shortest, the path passes a singularity too closely, and it ends there. Exactly through a singularity the joints may go
on evenly, as those of a wrist do whose fifth joint changes its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm, closed_form, newton, redundancy
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.inverse.redundancy import CriterionAt
from irbcal.modeling.robot import Robot
from irbcal.units import MM

JUMP = 0.15
"""Radians (or metres) that a joint may move in one piece."""
PIECE = 0.05
"""Length of a piece, of the reach, or radians."""
BEND = 0.25
"""How far the joints at a piece's middle may be from the mean of its ends, of the way between these."""
DEPTH = 10
"""How often a piece is halved."""
CLOSE = 0.02
"""Singular value (of the Jacobian with lengths over the reach) below which a singularity is told."""
STARTS = 12
"""Random starts at the first pose of arms without a closed form."""


class SingularPlace(NamedTuple):
    """Where a path comes near to a singularity."""

    row: int
    """The pose before, from 0."""
    share: float
    """How far from it to the next, 0 to 1."""
    point: tuple[float, float, float]
    """Place of the tip in the base link, metres."""
    value: float
    """Smallest singular value of the Jacobian, lengths over the reach."""
    joints: tuple[int, ...]
    """Joints, from 0, that move there without the tip, those with the largest shares."""
    ends: bool
    """Whether the path cannot go on there without a jump."""

    def in_words(self) -> str:
        """The place for people."""
        x, y, z = (value / MM for value in self.point)
        joints = " and ".join(str(j + 1) for j in self.joints)
        between = f"pose {self.row + 1}" if self.share == 0.0 else f"between poses {self.row + 1} and {self.row + 2}"
        does = "the path ends at" if self.ends else "the path passes close to"
        return f"{does} a singularity {between} ({x:.1f}, {y:.1f}, {z:.1f} mm), of joint {joints}"


@dataclass(frozen=True, eq=False)
class Followed(Locked):
    """Joints along a path."""

    joints: FloatArray
    """Shape (n, joints). Radians (metres for prismatic joints); NaN behind the end of what can be followed."""
    note: NameArray
    """Shape (n,)."""
    singular: tuple[SingularPlace, ...]


class _Way:
    """Several solutions that are followed at a time."""

    def __init__(self, robot: Robot, nominal: Arm, criterion: CriterionAt | None, tolerance: float) -> None:
        self.chain, self.tolerance = newton.CalibratedChain(robot, any_arm.reach(nominal)), (tolerance, tolerance)
        self.criterion = criterion

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerance."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def at(self, H: FloatArray, q: FloatArray) -> tuple[FloatArray, BoolArray]:
        """The solutions (k, joints) next to ``q`` at one pose (4, 3, 1), and which are near."""
        targets = np.repeat(H, len(q), axis=2)
        new, *errors, _ = newton.solve(self.chain, targets, q.T.copy(), self.tolerance)
        if self.criterion is not None:
            _, slope, curvature = self.criterion(new.T)
            step = redundancy.null_step(self.chain.linearised(targets, new)[0], slope, curvature)
            step *= np.minimum(1.0, 0.3 * JUMP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
            again, *errors_again, _ = newton.solve(self.chain, targets, new + step.T, self.tolerance)
            take = self.good(*errors_again)
            new, errors = (
                np.where(take, again, new),
                [np.where(take, a, b) for a, b in zip(errors_again, errors, strict=True)],
            )
        q_new = np.ascontiguousarray(new.T)
        return q_new, self.good(*errors) & (np.abs(q_new - q).max(axis=1) <= JUMP)

    def smooth(self, H: FloatArray, q: FloatArray, to: FloatArray) -> BoolArray:
        """Whether the joints at a piece's middle (4, 3, 1) lie between those at its ends (k, joints): one solution."""
        mean = 0.5 * (q + to)
        middle, *errors, _ = newton.solve(self.chain, np.repeat(H, len(q), axis=2), mean.T.copy(), self.tolerance)
        bend = np.abs(middle.T - mean).max(axis=1)
        return self.good(*errors) & (bend <= BEND * np.abs(to - q).max(axis=1) + 1e-9)

    def between(self, H: FloatArray, turn: FloatArray, shift: FloatArray, share: float) -> FloatArray:
        """Columns (4, 3, 1) of the pose a share of the way from one pose to the next."""
        return newton.moved(H, share * turn, share * shift)

    def leg(
        self, H: FloatArray, to: FloatArray, q: FloatArray
    ) -> tuple[FloatArray, BoolArray, FloatArray, list[tuple[float, FloatArray]]]:
        """From one pose to the next: joints, which came there, how far the others came, and the best's places."""
        turn, shift = newton.rotation_vector(H, to), to[3] - H[3]
        size = max(float(np.linalg.norm(turn)), float(np.linalg.norm(shift)) / self.chain.reach)
        pieces = max(1, int(np.ceil(size / PIECE)))
        q, ok, far = np.array(q), np.ones(len(q), dtype=bool), np.ones(len(q))
        passed = list[tuple[float, FloatArray]]()
        for piece in range(pieces):
            self._cut((H, turn, shift), piece / pieces, (piece + 1) / pieces, q, ok, far, 0)
            if ok.any():
                passed.append(((piece + 1) / pieces, q.copy()))
        return q, ok, far, passed

    def _cut(
        self,
        ends: tuple[FloatArray, FloatArray, FloatArray],
        start: float,
        end: float,
        q: FloatArray,
        ok: BoolArray,
        far: FloatArray,
        depth: int,
    ) -> None:
        """Go on from ``start`` to ``end``, in halves where that is too far at once; changes q, ok and far."""
        rows = np.flatnonzero(ok)
        if not len(rows):
            return
        new, near = self.at(self.between(*ends, end), q[rows])
        if near.any():
            near[near] = self.smooth(self.between(*ends, 0.5 * (start + end)), q[rows[near]], new[near])
        q[rows[near]] = new[near]
        unreached = rows[~near]
        if not len(unreached):
            return
        if depth == DEPTH:
            ok[unreached], far[unreached] = False, start
            return
        reached = np.zeros(len(ok), dtype=bool)
        reached[unreached] = True
        for a, b in ((start, 0.5 * (start + end)), (0.5 * (start + end), end)):
            self._cut(ends, a, b, q, reached, far, depth + 1)
        ok[unreached] = reached[unreached]

    def values(self, H: FloatArray, q: FloatArray) -> tuple[float, tuple[int, ...]]:
        """Smallest singular value at joints (joints,), and the joints that move there without the tip."""
        _, sizes, axes = np.linalg.svd(self.chain.linearised(H, q[:, None])[0][0])
        share = np.abs(axes[len(sizes) - 1])
        chosen = np.flatnonzero(share > 0.4 * share.max())
        return float(sizes[-1]), tuple(int(j) for j in chosen[:3])


def follow(
    robot: Robot,
    nominal: Arm,
    T_base_tip: FloatArray,
    near: FloatArray,
    criterion_name: str | None = None,
    tolerance: float = 1e-10,
) -> Followed:
    """Commanded joints along a path of poses, without jumps.

    Of the solutions at the first pose the one that can be followed farthest within the joint limits is taken, and of
    those that can be followed equally far the one that is nearest (or best by the criterion).

    Parameters
    ----------
    robot : Robot
    nominal : Arm
        Whose limits hold.
    T_base_tip : ndarray, shape (n, 4, 4)
    near : ndarray, shape (joints,)
        Radians (metres for prismatic joints).
    criterion_name : str, optional
        One of `redundancy.CRITERIA`, for arms with more than six joints.
    tolerance : float
        Metres and radians.
    """
    value = None if criterion_name is None or len(near) < 7 else redundancy.criterion(criterion_name, nominal, near)
    path = _Way(robot, nominal, value, tolerance)
    H = pose_columns(T_base_tip)
    start, far = _starts(path, robot, nominal, T_base_tip[:1], near)
    n, joints = len(T_base_tip), len(near)
    if not len(start):
        note = np.full(n, "no joints were found for the first pose", dtype=object)
        return Followed(np.full((n, joints), np.nan), note, ())
    q = np.full((n, len(start), joints), np.nan)
    q[0] = q_now = start
    alive, ends = np.arange(len(start)), np.full(len(start), n - 1.0)
    on_the_way: list[list[tuple[float, FloatArray]]] = []
    for k in range(1, n):
        q_now, ok, share, passed = path.leg(H[..., k - 1 : k], H[..., k : k + 1], q_now)
        wide = [(s, _spread(q_part, alive, len(start))) for s, q_part in passed]
        on_the_way.append(wide)
        ends[alive[~ok]] = k - 1 + share[~ok]
        alive, q_now = alive[ok], q_now[ok]
        q[k, alive] = q_now
        if not len(alive):
            break
    best = _best(nominal, q, ends, far)
    singular = _places(path, H, q[:, best], ends[best], [[(s, p[best]) for s, p in leg] for leg in on_the_way])
    return Followed(q[:, best], _notes(nominal, q[:, best], singular), singular)


def _spread(q_part: FloatArray, alive: IntArray, count: int) -> FloatArray:
    out = np.full((count, q_part.shape[1]), np.nan)
    out[alive] = q_part
    return out


def _starts(path: _Way, robot: Robot, nominal: Arm, T: FloatArray, near: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solutions at the first pose (k, joints), and how far each is from what is wanted (k,)."""
    seeds = [near[None]]
    if closed_form.has_closed_form(nominal):
        branches = closed_form.branches(nominal, T).joints[0]
        seeds.append(closed_form.into_limits(nominal, branches, np.tile(near, (len(branches), 1)))[0])
    else:
        seeds.append(nominal.random_joints(STARTS, 0))
    q = np.concatenate(seeds)
    q = q[np.isfinite(q).all(axis=1)]
    H = np.repeat(pose_columns(T), len(q), axis=2)
    columns, *errors, _ = newton.solve(path.chain, H, q.T.copy(), path.tolerance)
    q = np.ascontiguousarray(columns.T)[path.good(*errors)]
    q = closed_form.into_limits(nominal, q, np.tile(near, (len(q), 1)))[0] if len(q) else q
    if len(q):
        H = H[..., : len(q)]
        columns, *errors, _ = newton.solve(path.chain, H, q.T.copy(), path.tolerance)
        q = np.ascontiguousarray(columns.T)[path.good(*errors)]
    if path.criterion is not None and len(q):
        q = redundancy.settled(path.chain, H[..., : len(q)], q, path.criterion, path.tolerance)
    _, first = np.unique(np.round(q, 5), axis=0, return_index=True)
    q = q[np.sort(first)]
    inside = ((q >= nominal.lower - 1e-9) & (q <= nominal.upper + 1e-9)).all(axis=1)
    q = q[inside] if inside.any() else q
    far = np.linalg.norm(q - near, axis=1) if path.criterion is None else path.criterion(q)[0]
    return q, far


def _best(nominal: Arm, q: FloatArray, ends: FloatArray, far: FloatArray) -> int:
    """The solution that is followed farthest within the limits, then the nearest."""
    outside = (q < nominal.lower - 1e-9) | (q > nominal.upper + 1e-9)
    rows = np.where(outside.any(axis=2).any(axis=0), outside.any(axis=2).argmax(axis=0), np.inf)
    return int(np.lexsort((far, -np.minimum(ends, rows)))[0])


def _places(
    path: _Way, H: FloatArray, q: FloatArray, end: float, legs: list[list[tuple[float, FloatArray]]]
) -> tuple[SingularPlace, ...]:
    """Where the path comes near to singularities: the closest place of each passage."""
    rows = [(0, 0.0, q[0])]
    for k, leg in enumerate(legs):
        rows += [(k + (share == 1.0), share % 1.0, sample) for share, sample in leg if np.isfinite(sample).all()]
    rows = [row for row in rows if row[0] + row[1] <= end + 1e-12]
    candidates = []
    for row, share, joints in rows:
        tip = path.chain.tip(joints[:, None])
        value, moved = path.values(tip, joints)
        x, y, z = (float(v) for v in tip[3, :, 0])
        candidates.append(SingularPlace(row, share, (x, y, z), value, moved, False))
    values = np.array([candidate.value for candidate in candidates])
    singular = []
    for place_number in np.flatnonzero(values < CLOSE).tolist():
        around = values[max(0, place_number - 1) : place_number + 2]
        if values[place_number] == around.min():
            singular.append(candidates[place_number])
    if end < H.shape[2] - 1:
        behind = int(end)
        at = _between(path, H, behind, end - behind)
        last = candidates[-1]
        value, moved = path.values(at, rows[-1][2])
        x, y, z = (float(v) for v in at[3, :, 0])
        singular = [passage for passage in singular if (passage.row, passage.share) != (last.row, last.share)]
        singular.append(SingularPlace(behind, float(end - behind), (x, y, z), min(value, last.value), moved, True))
    return tuple(singular)


def _between(path: _Way, H: FloatArray, row: int, share: float) -> FloatArray:
    first, second = H[..., row : row + 1], H[..., row + 1 : row + 2]
    return path.between(first, newton.rotation_vector(first, second), second[3] - first[3], share)


def _notes(nominal: Arm, q: FloatArray, singular: tuple[SingularPlace, ...]) -> NameArray:
    note = np.full(len(q), "", dtype=object)
    outside = ((q < nominal.lower - 1e-9) | (q > nominal.upper + 1e-9)).any(axis=1)
    note[outside] = "outside the joint limits"
    for singularity in singular:
        if not singularity.ends:
            note[singularity.row] = singularity.in_words()
    missing = ~np.isfinite(q).all(axis=1)
    note[missing] = singular[-1].in_words() if singular else "the path cannot be followed to here"
    return note
