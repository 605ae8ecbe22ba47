"""Fake targets: commands with which a robot that errs reaches the pose that was meant (Nubiola 2011, section 6.2).

The calibrated inverse (`irbcal.modeling.inverse`) gives the joints whose true pose is the wanted one; the pose that
the controller's nominal model makes of them, ``H_fake`` of section 6.2, is what the program then asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.correction.maker import NO_REACH
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm, calibrated_arm, closed_form, nearly_closed_form
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM
from irbcal.wording import inflected

SINGULAR_GAIN = 10.0
"""Degrees that joints turn for one degree of the tool (or of a point at the arm's reach), next to a singularity."""
LARGEST_CHANGE = 10 * DEG
"""Largest turn of a joint that counts as a correction, radians; more is needed next to a singularity only."""


@dataclass(frozen=True, eq=False, repr=False)
class FakeTargets(Result):
    """Fake targets for a batch of n wanted poses."""

    T_wanted: FloatArray
    """Shape (n, 4, 4). Tip poses that the robot shall reach, in the base link."""
    q_nominal: FloatArray
    """Shape (n, joints). Joints with which the nominal robot would reach them, radians; NaN where it does not."""
    q: FloatArray
    """Shape (n, joints). Joints to command instead; NaN where no correction was found."""
    T_fake: FloatArray
    """Shape (n, 4, 4). Pose that the nominal controller takes those joints for."""
    ok: BoolArray
    """Shape (n,). Whether the target is corrected: reached to the tolerance, within the joint limits, in the same
    branch, with no joint turned by more than `LARGEST_CHANGE`.
    """
    reason: NameArray
    """Shape (n,). Why not, in words; empty where it is."""
    residual: FloatArray
    """Shape (n,). Distance that the calibrated model still misses by, metres."""

    @property
    def shift(self) -> FloatArray:
        """Distance from wanted to fake pose, shape (n,), metres; NaN where not corrected."""
        return np.linalg.norm(self.T_fake[:, :3, 3] - self.T_wanted[:, :3, 3], axis=1)

    @property
    def turn(self) -> FloatArray:
        """Angle from wanted to fake pose, shape (n,), radians; NaN where not corrected."""
        return frames.rotation_distance(self.T_fake[:, :3, :3], self.T_wanted[:, :3, :3])

    def report(self) -> list[Paragraph]:
        """How many are corrected and by how much, and why the others are not."""
        sentences: list[Paragraph] = [corrected_in_words(self.shift[self.ok], len(self.ok))]
        reasons, counts = np.unique(self.reason[~self.ok].astype(str), return_counts=True)
        sentences += [f"  {count} not corrected: {reason}" for reason, count in zip(reasons, counts, strict=True)]
        return sentences

    COLUMNS = "*by_joint shift_mm=shift turn_deg=turn residual_mm=residual ok reason"

    def by_joint(self) -> dict[str, FloatArray]:
        """Commanded joints ``q1`` …, then those of the nominal robot, ``q1_nominal`` …, radians (metres)."""
        joints = {"": self.q, "_nominal": self.q_nominal}
        return {f"q{k}{name}": column for name, q in joints.items() for k, column in enumerate(q.T, 1)}


def corrected_in_words(shift: FloatArray, wanted_count: int | None = None, verb: str = "corrected") -> str:
    """One line on how many targets are corrected and by how much.

    Parameters
    ----------
    shift : ndarray, shape (n,)
        Of the corrected targets, metres.
    wanted_count : int, optional
        How many there were; without it nothing is said of them.
    verb : str
        What is said of them: of a program that is not written they "can be corrected".
    """
    if not len(shift):
        return f"no target {verb}" if wanted_count is None else f"none of {wanted_count} targets {verb}"
    of_wanted = "" if wanted_count is None else f" of {wanted_count}"
    targets = inflected(len(shift) if wanted_count is None else wanted_count, "target")
    mean, largest = shift.mean() / MM, shift.max() / MM
    return f"{len(shift)}{of_wanted} {targets} {verb}, by {mean:.3f} mm on average and at most {largest:.3f} mm"


def correct_joints(robot: Robot, nominal: Arm, q: ArrayLike, controller: Arm | None = None) -> FakeTargets:
    """Fake targets for joint targets: the nominal pose of ``q`` is what is wanted (Nubiola 2011, section 6.2).

    Nubiola 2011, eq. 7.3: ``q_B = T_R6^-1[T_6(q_A)]``, with ``q`` for ``q_A`` and `FakeTargets.q` for ``q_B``.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    controller : Arm, optional
        What the controller computes with where that is not the nominal arm: only a little another one.

    Raises
    ------
    RobotError
        If the arm has fewer than six joints.
    """
    joints = nominal.check_joints(q)
    if joints.shape[1] < 6:
        raise RobotError(
            f"{nominal.name} has {joints.shape[1]} joints: with fewer than six there are no fake targets, because "
            "position and orientation cannot both be corrected"
        )
    computing = nominal if controller is None else controller
    return _correct(robot, nominal, computing.forward(joints), joints, computing)


def correct_poses(
    robot: Robot,
    nominal: Arm,
    T_base_tip: ArrayLike,
    controller: Arm | None = None,
) -> FakeTargets:
    """Fake targets for poses of the tip in the base link, next to zero joints (Nubiola 2011, section 6.2).

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    T_base_tip : ndarray, shape (n, 4, 4)
    controller : Arm, optional
        As for `correct_joints`.

    Raises
    ------
    RobotError
        If the arm has no closed-form inverse, and so no branches to tell the meant joints by.
    """
    if not closed_form.has_closed_form(nominal):
        raise RobotError(
            f"{nominal.name} has no closed-form inverse, so a pose does not tell which joints are meant: correct a "
            "program of joints"
        )
    branches = nearly_closed_form.branches(nominal, np.asarray(T_base_tip, dtype=float), controller)
    q, _ = closed_form.nearest(nominal, branches, np.zeros(6))
    return correct_meant(robot, nominal, T_base_tip, q, controller)


def correct_meant(
    robot: Robot, nominal: Arm, T_base_tip: ArrayLike, q_nominal: FloatArray, controller: Arm | None = None
) -> FakeTargets:
    """Fake targets for poses (n, 4, 4) of which the joints that the controller takes are known: (n, joints)."""
    computing = nominal if controller is None else controller
    return _correct(robot, nominal, np.asarray(T_base_tip, dtype=float), q_nominal, computing)


def next_to_singularities(arm: Arm, q: FloatArray, reach: float) -> dict[int, tuple[int, float]]:
    """Number of the joints, of (n, joints) in radians, that are next to a singularity -> what turns there, and how far.

    The joint that turns most, from 0, and its degrees for one of the tool; translations count by ``reach``, metres.
    """
    if not len(q):
        return {}
    walk = chain.walk(arm, q)
    slides = arm.table.prismatic[:, None, None]
    linear = np.where(slides, walk.z, np.cross(walk.z, walk.tip[3] - walk.o, axis=1)) / reach
    _, size, V = np.linalg.svd(np.concatenate([linear, np.where(slides, 0.0, walk.z)], axis=1).transpose(2, 1, 0))
    gain = 1.0 / np.maximum(size[:, -1], 1e-9)
    joint = np.abs(V[:, size.shape[1] - 1]).argmax(axis=1)
    return {int(k): (int(joint[k]), float(gain[k])) for k in np.flatnonzero(gain > SINGULAR_GAIN)}


def _correct(robot: Robot, nominal: Arm, T_wanted: FloatArray, q_nominal: FloatArray, controller: Arm) -> FakeTargets:
    reachable = np.isfinite(q_nominal).all(axis=1)
    n = len(q_nominal)
    q = np.full(q_nominal.shape, np.nan)
    residual = np.full(n, np.nan)
    reason = np.full(n, "", dtype=object)
    reason[~reachable] = NO_REACH
    if reachable.any():
        rows = np.flatnonzero(reachable)
        solve = calibrated_arm.solve if closed_form.has_closed_form(nominal) else any_arm.solve
        solution = solve(robot, nominal, T_wanted[rows], seed=q_nominal[rows], thorough=False)
        change = np.abs(solution.joints - q_nominal[rows])
        near = change.max(axis=1) <= LARGEST_CHANGE
        good = solution.converged & solution.inside & solution.branch_kept & near
        q[rows[good]] = solution.joints[good]
        residual[rows] = solution.position_residual
        for k in np.flatnonzero(solution.converged & ~near):
            joint = int(np.argmax(change[k]))
            reason[rows[k]] = (
                f"it would turn joint {joint + 1} by {change[k, joint] / DEG:.0f} degrees: next to a singularity, or "
                "with a tool or frame far from the program's"
            )
        reason[rows[solution.converged & ~solution.branch_kept]] = "it would need another configuration of the arm"
        reason[rows[solution.converged & ~solution.inside]] = "its correction is outside the joint limits"
        for code in calibrated_arm.Reason:
            if code != calibrated_arm.Reason.CONVERGED:
                reason[rows[~solution.converged & (solution.reason == code)]] = code.in_words
        lost = rows[~solution.converged & (solution.reason == calibrated_arm.Reason.NOT_FOUND)]
        reason[lost] = "no small correction reaches it"
        reach = float(np.linalg.norm(T_wanted[rows, :3, 3], axis=1).max())
        for row, (joint, _) in next_to_singularities(nominal, q_nominal[lost], reach).items():
            edge = "at the edge of the arm's reach" if joint in (1, 2) else "next to a singularity"
            reason[lost[row]] += f": it lies {edge}, where joint {joint + 1} turns far for small moves"
    ok = np.isfinite(q).all(axis=1)
    T_fake = np.full((n, 4, 4), np.nan)
    if ok.any():
        T_fake[ok] = controller.forward(q[ok])
    return FakeTargets(T_wanted, q_nominal, q, T_fake, ok, reason, residual)
