r"""Gravity: the joints give way under the weight of the links, without a mass being known.

The torque about an axis ``a`` of joint ``j`` of a mass on link ``k`` is linear in three vectors fixed to that link::

    phi = a_j . (R_k e_b x g^),    k >= j,  b = x, y, z

with ``g^`` the direction of gravity: whatever masses and compliances are, the joint's deflection is a sum of these.
Kept are those that are linearly independent of one another and of a constant on 400 random poses; the constant is the
joint's offset (for frame terms: part of its geometry).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import AXES, Basis, Family, Term, weighed
from irbcal.modeling.terms.waves import Expansion, Turns, expanded_lever

SIZE = 3e-4
VECTORS = ("x", "y", "z")
POSES, SEED = 400, 0
"""Random poses on which linear independence is judged."""
INDEPENDENT = 1e-3
"""Part of a function's size that the others must leave for it to be kept."""


class Gravity(Basis):
    """``a_j . (R_k v x g^)`` with ``v`` an axis (``x``, ``y``, ``z``) or any vector of link k."""

    name = "gravity"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The lever of a unit vector of the link about the axis, shape (terms, n)."""
        axes, vectors = _axes(terms, situation), _vectors(terms, situation)
        return np.einsum("kcn,kcn->kn", axes, cross_columns(vectors, situation.gravity[:, None]))

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the joints, shape (terms, n, joints)."""
        axes, vectors = _axes(terms, situation), _vectors(terms, situation)
        g = situation.gravity[:, None]
        torque = cross_columns(vectors, g)
        out = np.zeros((len(terms), *situation.motion.q.shape))
        for i, z in enumerate(situation.turning):
            moves_axis, moves_vector = _carried(terms, i)
            # a' . (v x g) + a . (v' x g) with a' = z x a, v' = z x v; the second is v' . (g x a)
            out[:, :, i] = moves_axis * np.einsum("kcn,kcn->kn", cross_columns(z, axes), torque)
            out[:, :, i] += moves_vector * np.einsum("kcn,kcn->kn", cross_columns(z, vectors), cross_columns(g, axes))
        return out

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of the slopes along joint speeds (n, joints), shape (terms, n, joints)."""
        axes, vectors = _axes(terms, situation), _vectors(terms, situation)
        spin = situation.spin(np.asarray(dq, dtype=float))
        g = situation.gravity[:, None]
        axes_dot = cross_columns(spin[[t.joint for t in terms]], axes)
        vectors_dot = cross_columns(spin[[_link(t) + 1 for t in terms]], vectors)
        out = np.zeros((len(terms), *situation.motion.q.shape))
        for i, z in enumerate(situation.turning):
            moves_axis, moves_vector = _carried(terms, i)
            z_dot = cross_columns(spin[i], z)
            turned = cross_columns(z_dot, axes) + cross_columns(z, axes_dot)
            rate = _dot(turned, cross_columns(vectors, g)) + _dot(cross_columns(z, axes), cross_columns(vectors_dot, g))
            out[:, :, i] = moves_axis * rate
            turned = cross_columns(z_dot, vectors) + cross_columns(z, vectors_dot)
            rate = _dot(turned, cross_columns(g, axes)) + _dot(cross_columns(z, vectors), cross_columns(g, axes_dot))
            out[:, :, i] += moves_vector * rate
        return out

    def quick_values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """As `values`; levers about the joints' own axes by their waves, found once for all arms that turn alike."""
        levers = tuple((t.joint, _link(t), vector_of(t)) for t in terms)
        waves = (
            _waves(_Turning.from_arm(situation.arm), levers, tuple(situation.gravity.tolist()))
            if all(t.axis == "rz" for t in terms)
            else None
        )
        if waves is None:
            return self.values(terms, situation)
        turns, weights = waves
        return np.asarray(weights @ np.concatenate(cos_sin(turns @ situation.motion.q.T)))

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """Waves of the joints that carry the axis or the link."""
        return expanded_lever(arm, term.joint, _link(term), vector_of(term), gravity)


LeverKey: TypeAlias = tuple[int, int, tuple[float, ...]]
"""Joint, link (from 0) and the link's vector."""


@dataclass(frozen=True)
class _Turning:
    """An arm that equals each other one whose links turn alike: all that levers depend on."""

    arm: Arm = field(compare=False)
    attitudes: bytes

    @staticmethod
    def from_arm(arm: Arm) -> _Turning:
        """The key of an arm."""
        table = arm.table
        parts = (table.alpha, table.beta, table.theta, table.prismatic, arm.T_base_0[:3, :3])
        return _Turning(arm, b"".join(np.asarray(part).tobytes() for part in parts))


@lru_cache(maxsize=32)
def _waves(
    turning: _Turning, levers: tuple[LeverKey, ...], gravity: tuple[float, ...]
) -> tuple[FloatArray, FloatArray] | None:
    """Levers of an arm as waves: turns (waves, joints), weights of cosines and sines (levers, 2 waves).

    None where a lever has too many.
    """
    column: dict[Turns, int] = {}
    entries = []
    for row, lever in enumerate(levers):
        expansion = expanded_lever(turning.arm, *lever, gravity)
        if expansion is None:
            return None
        entries += [(row, column.setdefault(turns, len(column)), weight) for turns, weight in expansion.items()]
    weights = np.zeros((2, len(levers), len(column)))
    for row, wave, weight in entries:
        weights[:, row, wave] = weight.real, -weight.imag
    return np.array([*column]).reshape(-1, len(turning.arm.joint_names)), np.hstack([*weights])


def vector_of(term: Term) -> tuple[float, ...]:
    """The vector of a term in the frame of its link, three numbers."""
    vector = term.parameters["vector"]
    if isinstance(vector, tuple):
        return vector
    return tuple(np.eye(3)[VECTORS.index(str(vector))].tolist())


def _link(term: Term) -> int:
    return int(str(term.parameters["link"])) - 1


def _axes(terms: Sequence[Term], situation: Situation) -> FloatArray:
    """Axis of each term's joint, shape (terms, 3, n)."""
    return situation.axes_before_joint[[t.joint for t in terms], [AXES.index(t.axis) % 3 for t in terms]]


def _vectors(terms: Sequence[Term], situation: Situation) -> FloatArray:
    """The vector of each term's link, shape (terms, 3, n)."""
    out = np.empty((len(terms), 3, len(situation.motion)))
    for k, term in enumerate(terms):
        vector, link = term.parameters["vector"], situation.axes_after_joint[_link(term)]
        out[k] = link[VECTORS.index(vector)] if isinstance(vector, str) else np.einsum("a,acn->cn", vector, link)
    return out


def _carried(terms: Sequence[Term], joint: int) -> tuple[FloatArray, FloatArray]:
    """Whether a joint carries the axis, and the vector, of each term: one or zero, shape (terms, 1)."""
    axis = np.array([[float(joint < t.joint)] for t in terms])
    return axis, np.array([[float(joint <= _link(t))] for t in terms])


def cross_columns(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product along the last but one axis."""
    return np.cross(a, np.broadcast_to(b, np.broadcast_shapes(a.shape, b.shape)), axis=-2)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("kcn,kcn->kn", a, b)


def independent_levers(arm: Arm, axis: str) -> list[tuple[int, int, str]]:
    """Which levers about an axis of the joints' frames are linearly independent.

    Parameters
    ----------
    arm : Arm
    axis : str
        ``rx``, ``ry`` or ``rz``.

    Returns
    -------
    list of (int, int, str)
        Joint and link (from 0) and the link's vector, link by link.
    """
    situation = Situation(arm, Motion(arm.random_joints(POSES, SEED)))
    chosen = []
    for j in weighed(arm):
        candidates = [(j, k, vector) for k in range(j, len(arm.joint_names)) for vector in VECTORS]
        values = Gravity().values([_term(axis, *c, SIZE, "", "") for c in candidates], situation)
        spanned = np.full((1, POSES), POSES**-0.5)
        for candidate, value in zip(candidates, values, strict=True):
            size = np.linalg.norm(value)
            if size < 1e-9 * POSES**0.5:
                continue
            residual = value / size
            for _ in range(2):  # twice is enough for orthogonality to rounding
                residual = residual - spanned.T @ (spanned @ residual)
            if (norm := np.linalg.norm(residual)) > INDEPENDENT:
                spanned = np.vstack([spanned, residual / norm])
                chosen.append(candidate)
    return chosen


def _term(axis: str, joint: int, link: int, vector: str, size: float, group: str, family: str) -> Term:
    return Term(joint, axis, "gravity", size, group, family, "rad", {"link": link + 1, "vector": vector})


def lever_terms(arm: Arm, axes: Sequence[str], size: float, family: str) -> list[Term]:
    """Terms of all independent levers about some axes, one group a joint."""
    levers = [(axis, *lever) for axis in axes for lever in independent_levers(arm, axis)]
    levers.sort(key=lambda lever: lever[1])
    return [_term(axis, j, k, vector, size, f"{family}_{j + 1}", family) for axis, j, k, vector in levers]


class GravityFamily(Family):
    """What gravity does about the joints' own axes."""

    name, of_type = "gravity", True
    bases = (Gravity(),)

    def terms(self, arm: Arm) -> list[Term]:
        """All independent levers about the joints' axes, a variance for each joint."""
        return lever_terms(arm, ("rz",), SIZE, self.name)


FAMILY = GravityFamily()
