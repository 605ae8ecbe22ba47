"""The robot that rows at features tell, with the names that a saved calibration needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification.averaged import AveragedFit
from irbcal.identification.constraint_fit import FeatureFit
from irbcal.identification.constraint_problem import BASE, TOOL
from irbcal.identification.constraints import KINDS, cross
from irbcal.identification.result import ParameterReport
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term_map import basis_values, term_columns

BASE_REASON = "nothing ties the features to a measuring frame: places are those of the base link"

TOO_LARGE = 2e-3
"""Share by which a robot may come out larger than nominal before what gave the scale is doubted."""

JOINTS = 200
"""Random joints on which it is asked what the rows leave open."""


@dataclass(frozen=True, eq=False, repr=False)
class FeaturedFit(AveragedFit):
    """An average of error models from rows at features.

    Attributes
    ----------
    found : FeatureFit or None
        Always there; last because of what it derives from.
    """

    found: FeatureFit | None = None

    @staticmethod
    def of(found: FeatureFit) -> FeaturedFit:
        """With the names of a fit to points."""
        points = as_points(found.problem.seen)
        load, place = points.payload_kg, points.payload_place
        motion = Motion(points.q, payload_kg=load, payload_place=place)
        return FeaturedFit(found.evidence, points, motion, found=found)

    @property
    def at_features(self) -> FeatureFit:
        """What was found, features and all."""
        assert self.found is not None
        return self.found

    @property
    def rms(self) -> float:
        """Root mean square of what the rows miss, metres."""
        return float(np.sqrt(np.mean(self.at_features.problem.residuals(self.at_features.state) ** 2)))

    @property
    def nominal_robot(self) -> Robot:
        """The nominal robot with base and tool from the same rows."""
        found = self.at_features
        own = found.nominal.own
        rotations = {name: own["axes", name] for name in self.evidence.target_rotations}
        targets = {name: own[TOOL, name] for name in self.evidence.targets}
        return Robot(
            found.problem.arm, T_world_base=found.nominal.T_world_base, targets=targets, target_rotations=rotations
        )

    @property
    def rank(self) -> int:
        """Number of coefficients that the data determine, base and targets included where they are unknown."""
        return super().rank - (0 if BASE in self.at_features.problem.layout else 6)

    @property
    def parameter_count(self) -> int:
        """Number of parameters of the robot; those of the features are not among them."""
        return super().parameter_count - (0 if BASE in self.at_features.problem.layout else 6)

    def _outer(self) -> list[ParameterReport]:
        """Base and targets; a base that nothing ties to a measuring frame is held."""
        rows = super()._outer()
        if BASE in self.at_features.problem.layout:
            return rows
        return [
            ParameterReport(r.name, r.value, r.unit, None, "held", BASE_REASON) if r.name.startswith("base_") else r
            for r in rows
        ]

    @property
    def scale_measured(self) -> bool:
        """Whether some row or feature tells a length of the size of the arm."""
        problem = self.at_features.problem
        known = [group for group in problem.groups if group.feature.centre is not None or group.measured]
        return bool(problem.seen.lengths or known or any(group.kind.metric for group in problem.groups))

    @property
    def scale_from(self) -> str:
        """What gives the robot its scale where nothing but parts of features does, in words."""
        problem = self.at_features.problem
        metric = [group for group in problem.groups if group.kind.metric]
        words = list(dict.fromkeys(group.kind.scale_of(group.feature) for group in metric))
        others = [group for group in problem.groups if group.feature.centre is not None or group.measured]
        return "" if problem.seen.lengths or others or "" in words else " and ".join(words)

    def doubts(self) -> list[str]:
        """What speaks against what was known beforehand of features: their own doubts, and fitted numbers far away."""
        problem, state = self.at_features.problem, self.at_features.state
        found = [one.group.kind.doubt(one.seen, one.found) for one in problem.misses(state)]
        for (name, of), known in problem.expected.items():
            value = float(state.own[name, of][0])
            if abs(value - known.value[0]) > 2.0 * known.u95:
                found.append(
                    f"{name} of {of} comes out at {value:.6g}, {known.value[0]:.6g} was said: images and poses that "
                    "do not belong together, or a lens that is another."
                )
        larger = self._larger()
        if self.scale_from and abs(larger) > TOO_LARGE:
            found.append(
                f"The robot comes out {abs(larger):.2%} {'larger' if larger > 0 else 'smaller'} than nominal, and its "
                f"scale rests on {self.scale_from}: measure these."
            )
        return [text for text in dict.fromkeys(found) if text]

    def _larger(self) -> float:
        """Share by which the calibrated arm is larger than the nominal one."""
        nominal, own = self.at_features.problem.arm, self.evidence.arm
        q = nominal.random_joints(JOINTS, 0)
        a, b = (arm.forward(q)[:, :3, 3] for arm in (nominal, own))
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        return float(np.linalg.svd(a.T @ b, compute_uv=False).sum() / (a**2).sum()) - 1.0

    def left_open(self) -> tuple[float, float]:
        """What is not known of where the tool's point is, before and after: root mean square lengths, metres.

        At joints between those of the rows: from the variances that the data gave the terms, and from what is left of
        them. How the arm as a whole stands does not count, nor before the rows where the point is on the tool.
        """
        found = self.evidence
        q, rng = self.at_features.problem.seen.q, np.random.default_rng(0)
        one, other = (q[rng.integers(len(q), size=JOINTS)] for _ in range(2))
        motion = found.motion(one + rng.uniform(size=(JOINTS, 1)) * (other - one))
        path = chain.walk(found.nominal, motion.q)
        pose = np.arange(JOINTS)
        sizes = {group.name: group.size for group in found.groups}
        flat = len(found.covariance) - len(found.terms)
        constant = np.array([t.family == "geometry" for t in found.terms], dtype=bool)
        values = basis_values(found.terms, Situation(found.nominal, motion))
        prior = np.array([(sizes.get(t.group, 0.0) * t.size) ** 2 for t in found.terms])
        worst = 0.0, 0.0
        for k, name in enumerate(found.free_targets or ("",)):
            tool = found.targets.get(name, np.zeros(3))
            p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], tool)
            J = np.zeros((3 + len(found.terms), 3, JOINTS))
            J[:3] = path.tip[:3] if found.free_targets else 0.0
            for part in (True, False):
                rows = np.flatnonzero(constant == part)
                terms = [found.terms[j] for j in rows]
                J[3 + rows] = term_columns(terms, chain.point_columns(path, p, pose, part), values[rows], pose)
            B = np.concatenate([-cross(p.T), np.broadcast_to(np.eye(3), (JOINTS, 3, 3))], axis=2).reshape(-1, 6)
            across = J.transpose(0, 2, 1).reshape(len(J), -1)
            across = across - (across @ B) @ np.linalg.pinv(B)
            G = across @ across.T / JOINTS
            columns = np.r_[6 + 3 * k : 9 + 3 * k, flat : len(found.covariance)]
            left = float(np.sqrt(np.sum(G * found.covariance[np.ix_(columns, columns)])))
            if left >= worst[1]:
                worst = float(np.sqrt(prior @ np.diagonal(G)[3:])), left
        return worst


def as_points(seen: FeatureSet) -> PointSet:
    """Rows as points without measured places (zeros stand for them), one pose a row group."""
    _, first, pose = np.unique(seen.pose_index, return_index=True, return_inverse=True)
    order = np.argsort(pose, kind="stable")
    names = tuple(sorted(set(seen.target.astype(str))))
    target = np.array([names.index(str(name)) for name in seen.target], dtype=int)
    groups = seen.places("place") if "place" in seen.cells.columns else seen.places()
    return PointSet(
        seen.q[first],
        pose[order],
        target[order],
        np.zeros((len(seen), 3)),
        names,
        seen.pose[first],
        groups[first],
        payload_kg=None if seen.payload_kg is None else seen.payload_kg[first],
        payload_place=None if seen.payload_place is None else seen.payload_place[first],
    )


def shape_only(seen: FeatureSet) -> bool:
    """Whether (nearly) all rows say no more than that points lie in planes or on lines of unknown place."""
    others = sum(count for name, count in seen.kinds().items() if name in KINDS and not KINDS[name].shape_only)
    return others < 10 and not seen.lengths


def frames_of(value: FloatArray) -> FloatArray:
    """Angles about x, y and z of a rotation (3, 3), radians."""
    return frames.to_xyz_angles(frames.transform(value))[3:]
