"""What a calibration is worth beside the poses that it was made from: a doubt where they cover only a corner.

A model that is fitted in a corner of the workspace and used elsewhere can be worse than the nominal robot without any
sign of it in held-out poses, which lie in the same corner. Two things tell: how much of their limits the joints went
through, and how the expected error grows at poses anywhere within the limits.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.section import Section
from irbcal.units import MM

POSES, SEED = 300, 0
"""Random poses within the joint limits."""
NARROW = 0.5
"""Mean share (geometric) of their limits that joints went through, below which a calibration is that of a corner. Plans
for simulated robots have 0.94 to 0.98, an IRB 120 as it was measured in a real cell 0.81."""
GROWTH = 3.0
"""Factor by which the expected error may grow: it is 1.1 after a plan's poses, 2.0 on that IRB 120, 3.7 and 5.4 on a
UR10 that was measured in a third to two thirds of its range."""
DOUBT, DOUBTED_GROWTH = 0.35, 2.0
"""Expected error over the difference from the nominal robot above which the nominal one may be better there: 0.7 if the
model had no errors but those of its parameters; levels, on robots with other errors, expect half of what comes. And the
factor by which the expected error may grow then: a SIMULATED IRB 1600 at two sockets came out 1.4 times worse than
nominal with 2.7."""

COVERED = 0.6
"""Share of its limits that each joint of the proof must go through for that to be a proof anywhere."""
MOST_DIFFERENCES = 2.0
"""Differences from the nominal robot by which errors may grow at most: scatter of combinations that the poses hardly
show is far larger, but estimates that far off would lie as far from the nominal robot. Calibrations from corners of 6
SIMULATED robots erred by at most 1.1 differences."""


class WorkspaceCoverage(Section):
    """Expected errors where a robot was measured and anywhere within its joint limits."""

    shares: list[float]
    """Of its limits that each joint went through; of one turn where limits are wider or none."""
    here_mm: float
    there_mm: float
    """Expected root mean square error of the first target at the poses of the fit and at random poses."""
    difference_mm: float
    """Between the predictions of the calibrated and the nominal robot at random poses, root mean square."""

    @property
    def share(self) -> float:
        """Geometric mean of the joints' shares."""
        return float(np.prod(self.shares) ** (1.0 / len(self.shares)))

    @property
    def narrow(self) -> bool:
        """Whether the calibration must not be trusted everywhere."""
        growth = DOUBTED_GROWTH if self.nominal_may_be_better else GROWTH
        return self.share < NARROW or self.there_mm > growth * self.here_mm

    @property
    def nominal_may_be_better(self) -> bool:
        """Whether the nominal robot may be the better one within the limits."""
        return self.there_mm > DOUBT * self.difference_mm

    def in_words(self) -> str:
        """The doubt, with numbers; an empty text where there is none."""
        if not self.narrow:
            return ""
        shares = ", ".join(f"{share:.0%}" for share in self.shares)
        text = (
            f"Calibrated only where measured: the joints of the fitted poses went through {shares} of their limits "
            f"(joints 1 to {len(self.shares)}). Anywhere within the limits errors of {self.there_mm:.3f} mm (rms) or "
            f"more must be expected, {self.there_mm / self.here_mm:.1f} times those at poses like the fitted ones "
            f"({self.here_mm:.3f} mm)"
        )
        if self.nominal_may_be_better:
            text += (
                ". There it may be worse than the nominal robot, from whose predictions it differs by "
                f"{self.difference_mm:.3f} mm (rms)"
            )
        return f"{text}. Measure poses all over the workspace, or use it within these joint ranges only."


def even_width(q: FloatArray, within: FloatArray) -> FloatArray:
    """Width of an even distribution with the standard deviation of joints within limits, at most their range.

    A few poses far away do not count as a range.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
    within : ndarray, shape (2, joints)
        Joints beyond these limits count as at the limits.

    Returns
    -------
    ndarray, shape (joints,)
    """
    if len(q) < 2:
        return np.zeros(q.shape[1])
    q = np.clip(q, *within)
    return np.minimum(np.sqrt(12.0) * q.std(axis=0, ddof=1), np.ptp(q, axis=0))


def workspace_coverage(
    robot: Robot, nominal: Robot, q: FloatArray, proof: FloatArray | None = None
) -> WorkspaceCoverage | None:
    """What is to be expected of a calibrated robot within its joint limits.

    Parameters
    ----------
    robot : Robot
        Calibrated, with its certainty.
    nominal : Robot
        With base and targets from the same poses.
    q : ndarray, shape (n, joints)
        Poses of the fit, radians (metres).
    proof : ndarray, shape (m, joints), optional
        Poses of the proof.

    Returns
    -------
    WorkspaceCoverage or None
        None where nothing is known of the robot's certainty, or the poses of the proof are all over the limits: their
        errors were measured, and need not be expected.
    """
    certainty = robot.certainty
    target = next(
        (name for name in robot.targets if certainty is not None and certainty.left_out(name) is not None), None
    )
    if certainty is None or target is None:
        return None
    ranges = np.array(certainty.limits.ranges)
    lower, upper = _limits(robot.arm, ranges)
    if proof is not None and (even_width(proof, np.array([lower, upper])) >= COVERED * (upper - lower)).all():
        return None
    anywhere = np.random.default_rng(SEED).uniform(lower, upper, (POSES, len(lower)))
    went, span = np.minimum(ranges[1], upper) - np.maximum(ranges[0], lower), upper - lower
    moved = robot.points(anywhere, target) - nominal.points(anywhere, target)
    expected_here = _expected(robot, q[:: max(1, len(q) // POSES)], target)
    difference = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    return WorkspaceCoverage(
        shares=np.clip(np.divide(went, span, out=np.ones(len(span)), where=span > 0.0), 0.0, 1.0).tolist(),
        here_mm=expected_here / MM,
        there_mm=min(_expected(robot, anywhere, target), expected_here + MOST_DIFFERENCES * difference) / MM,
        difference_mm=difference / MM,
    )


def _expected(robot: Robot, q: FloatArray, target: str) -> float:
    """Root mean square of the expected errors of a target: scatter of the parameters and leave-one-out error."""
    assert robot.certainty is not None
    loo = robot.certainty.left_out(target)
    assert loo is not None
    covariance = robot.predict(q, target=target).covariance
    return float(np.sqrt(np.einsum("nii->n", covariance).mean() + loo**2))


def _limits(arm: Arm, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Joint limits; of joints that go farther than one turn (two metres), that much about the middle of their range."""
    half = np.where(arm.table.prismatic, 1.0, np.pi)
    wide = arm.upper - arm.lower > 2.0 * half
    first, last = np.where(wide, arm.lower + half, 0.0), np.where(wide, arm.upper - half, 0.0)
    middle = np.clip(ranges.mean(axis=0), first, last)
    return np.where(wide, middle - half, arm.lower), np.where(wide, middle + half, arm.upper)
