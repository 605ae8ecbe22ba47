"""What poses at a device's features say of an arm, and what they would leave of its position error.

The error model comes with its natural sizes as prior: the geometry alone, or also what model ``auto`` fits beside it
(gain, gravity, harmonics). Tool and features have next to none. In the terms of `irbcal.planning.information`, so that
`irbcal.planning.exchange` chooses among poses at features as it does among poses that a tracker sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.identification import term_sets
from irbcal.identification.feature_problem import TOOL, FeatureProblem, FeatureState, Key
from irbcal.identification.observation_kind import cross
from irbcal.measurement import features
from irbcal.measurement.features import FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import basis_values, term_columns
from irbcal.planning.information import WAVES, Aim, Candidates
from irbcal.simulation.devices import BALL, Placed, rows_table, values
from irbcal.units import MM

SAMPLES = 300
"""Random poses on which the error that is left counts."""

FREE = 1e3
"""Tool and features: so many millimetres and milliradians, one standard deviation of what is known before."""

BESIDE = ("gain", "gravity", "harmonics")
"""Families beside the geometry in the wider model."""


@dataclass(frozen=True, eq=False)
class Rated(Locked):
    """Poses as `irbcal.planning.exchange` takes them.

    Attributes
    ----------
    poses : Candidates
    aim : Aim
        Mean squared error of positions over the whole range, m^2; known lengths are given.
    """

    poses: Candidates
    aim: Aim

    def left(self, rows: IntArray | None = None) -> float:
        """Root mean square error of positions that some poses (all unless given) leave, metres."""
        those = slice(None) if rows is None else rows
        return float(np.sqrt(self.aim.value(self.poses.rows[those], self.poses.errors[those])))


class DeviceModel:
    """An arm with what is not known of it, and positions on which errors count.

    Parameters
    ----------
    arm : Arm
    seed : int
        Of random poses.
    wide : bool
        With gain, gravity and harmonics up to `irbcal.planning.information.WAVES` beside the geometry.
    prior : float, optional
        Root mean square position error from the geometry before anything is measured, metres; as its natural sizes
        make it unless given.

    Attributes
    ----------
    geometry, before : float
        Root mean square position errors before anything is measured, from the geometry and from all, metres; how the
        arm stands does not count.
    """

    def __init__(self, arm: Arm, seed: int = 0, wide: bool = False, prior: float | None = None) -> None:
        self.arm, self.seed = arm, seed
        self.terms = _wide(arm) if wide else GEOMETRY.terms(arm)
        constant = np.array([term.family == "geometry" for term in self.terms], dtype=bool)
        self.sizes: FloatArray = np.array([term.size for term in self.terms])
        natural = self._spread()
        share = np.diagonal(natural)[3:]
        self.geometry = float(np.sqrt(share[constant].sum()))
        factor = np.where(constant, 1.0 if prior is None else prior / self.geometry, 1.0)
        self.sizes = self.sizes * factor
        self.G = natural * np.outer(np.r_[np.ones(3), factor], np.r_[np.ones(3), factor])
        self.geometry *= float(factor[constant][0])
        self.before = float(np.sqrt(np.trace(self.G[3:, 3:])))

    def _spread(self) -> FloatArray:
        """Mean products of what the tool's place and the terms, each in its size, do to positions, m^2."""
        q = self.arm.random_joints(SAMPLES, self.seed + 7)
        path = chain.walk(self.arm, q)
        p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], np.array(BALL))
        J = np.zeros((3 + len(self.terms), 3, SAMPLES))
        J[:3] = path.tip[:3] * FREE * MM
        values = basis_values(self.terms, Situation(self.arm, Motion(q)))
        J[3:] = term_columns(self.terms, path, values, p) * self.sizes[:, None, None]
        B = np.concatenate([-cross(p.T), np.broadcast_to(np.eye(3), (SAMPLES, 3, 3))], axis=2).reshape(-1, 6)
        across = J.transpose(0, 2, 1).reshape(len(J), -1)
        across = across - (across @ B) @ np.linalg.pinv(B)
        return np.asarray(across @ across.T / SAMPLES)

    def tracked(self, count: int, noise: float) -> Rated:
        """Random poses that a tracker sees, its frame being the base link's."""
        q = self.arm.random_joints(count, self.seed)
        T = self.arm.forward(q)
        xyz = (T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)) / MM
        table = pd.DataFrame(self.arm.to_controller(q) / self.arm.joint_units, columns=self.arm.joint_columns)
        table = table.assign(pose=np.arange(count), x_mm=xyz[:, 0], y_mm=xyz[:, 1], z_mm=xyz[:, 2], feature="")
        return self._rated(features.read(table, None, self.arm), {}, noise)

    def at(self, found: Placed, q: FloatArray, which: IntArray, noise: float) -> Rated:
        """Poses (n, joints) at a device's features (n,)."""
        table = rows_table(self.arm, found, q, which, values(self.arm, found, q, which))
        return self._rated(features.read(table, found.table(), self.arm), found.unknowns(), noise)

    def _rated(self, seen: FeatureSet, unknowns: Mapping[Key, FloatArray], noise: float) -> Rated:
        seen = replace(seen, u95=np.full(len(seen), 1.96 * noise))
        problem = FeatureProblem(self.arm, seen, self.terms)
        target = str(seen.target[0])
        state = FeatureState({**unknowns, (TOOL, target): np.array(BALL)}, np.zeros(len(self.terms)))
        blocks = list(problem.dense(state))
        J = np.concatenate([block.J for block in blocks], axis=1)
        row = np.concatenate([block.row for block in blocks])
        natural = problem.sizes[problem.flat :]
        J = J * (np.r_[np.full(problem.flat, FREE), self.sizes / natural] * MM / noise)[:, None]
        size = max(group.kind.size for group in problem.groups)
        order_of = np.argsort(row[row >= 0], kind="stable")
        rows = J[:, row >= 0][:, order_of].reshape(len(J), len(seen), size).transpose(1, 2, 0)
        G = np.zeros((len(J), len(J)))
        at = problem.layout[TOOL, target][1]
        columns = np.r_[at : at + 3, problem.flat : len(J)]
        G[np.ix_(columns, columns)] = self.G
        nuisance = J[:, row < 0]
        aim = Aim(problem.flat, G, np.zeros((len(J), 0)), 0.0, (nuisance @ nuisance.T, 0.0))
        return Rated(Candidates.without_errors(rows), aim)


def _wide(arm: Arm) -> list[Term]:
    """Geometry and what model ``auto`` fits beside it, harmonics as high as they are imagined for tracker plans."""
    terms = term_sets.superset(arm, term_sets.JOINT_MAP, False, None, [])
    terms = [term for term in terms if term.family == "geometry" or term.family in BESIDE]
    return [term for term in terms if term.family != "harmonics" or order(term) <= WAVES]
