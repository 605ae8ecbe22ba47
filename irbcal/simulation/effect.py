"""What an effect of the virtual cell is: what it may know of a run, and what it may change.

An effect changes effective joints, the place of the tip, or measured points, or tells which points have no position.
Its random numbers come from a stream of its own, so that switching one effect off leaves the others' numbers as they
were. The effects themselves are in `irbcal.simulation.effects`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms.term import Term
from irbcal.simulation.masses import Bodies
from irbcal.units import DEG, MM

Amounts: TypeAlias = list[tuple[Term, float]]
"""Terms of the error model and their coefficients, in the terms' units."""

SIZE = 2.0015
"""Sum of the IRB 1600's nominal lengths, metres: the measure of `size_of`."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What a run asks of the robot, a row a pose, in the order of the run.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    direction : ndarray, shape (n, joints)
        Sign of each joint's last change: +1 reached from below, -1 from above.
    time_s, wait_s : ndarray, shape (n,)
        When the robot stopped, from the start of the run, and how long it stood before it was measured.
    torque : ndarray, shape (n, joints)
        Gravity torques, newton metres.
    stiffness : ndarray, shape (n, joints)
        What the joint map's two numbers say that gravity does, radians.
    prismatic : ndarray of bool, shape (joints,)
    move : ndarray, shape (n, joints)
        Commanded joints minus those of the stop before.
    tilting : ndarray, shape (n, joints, 2)
        Gravity torques about x and y of each joint's frame before it turns, newton metres.
    """

    q: FloatArray
    direction: FloatArray
    time_s: FloatArray
    wait_s: FloatArray
    torque: FloatArray
    stiffness: FloatArray
    prismatic: BoolArray
    move: FloatArray
    tilting: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def units(self) -> FloatArray:
        """SI value of one degree or, for prismatic joints, one millimetre, shape (joints,)."""
        return np.where(self.prismatic, MM, DEG)


@dataclass(frozen=True, eq=False)
class Shot:
    """What the tracker is pointed at.

    Its arrays are not locked: the search for poses in sight makes one for every block of candidates.

    Attributes
    ----------
    xyz : ndarray, shape (n, k, 3)
        True places of targets, then references, in the base link, metres.
    direction : ndarray, shape (n, targets, 3)
        Where the targets look, unit vectors in the base link.
    origins : ndarray, shape (n, joints + 1, 3)
        Of the base link and the joints, in the base link, metres.
    time_s : ndarray, shape (n, k)
    place : ndarray, shape (3,)
        The tracker in the base link, metres.
    """

    xyz: FloatArray
    direction: FloatArray
    origins: FloatArray
    time_s: FloatArray
    place: FloatArray


@dataclass(frozen=True)
class Effect:
    """One part of the cell that can be switched off."""

    name: ClassVar[str]
    summary: ClassVar[str]

    def table(self, table: DHMTable) -> DHMTable:
        """The true DHM table."""
        return table

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray | None:
        """What is added to the effective joints, shape (n, joints); None for nothing."""
        return None

    def frames(self, motion: Motion, rng: np.random.Generator) -> FloatArray | None:
        """Small motions of each joint's frame before it turns, shape (n, joints, 6); None for nothing.

        Shifts along its axes, then a turn: `irbcal.modeling.terms.chain`, in the order of
        `irbcal.modeling.terms.term.AXES`.
        """
        return None

    def readings(self, motion: Motion, rng: np.random.Generator) -> FloatArray | None:
        """What is added to the commanded joints in the controller's readings, shape (n, joints); None for nothing."""
        return None

    def tips(self, T: FloatArray, motion: Motion) -> FloatArray:
        """Tip poses in the base link, shape (n, 4, 4)."""
        return T

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """Measured points in the tracker's frame, shape (n, k, 3), metres."""
        return xyz

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray | None:
        """Mask (n, k) of the points without a position; None for none."""
        return None

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """The same effect for another arm; see `fitted`."""
        return self

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """What the effect is in the terms of the error model; empty for what that does not know.

        Parameters
        ----------
        arm : Arm
            Nominal.
        bodies : Bodies
            With the payload.
        """
        return []

    def parameters(self) -> dict[str, Any]:
        """Parameters by name, as they go into the truth's file."""
        return asdict(self)


def fitted(values: Sequence[float] | FloatArray, prismatic: BoolArray, sliding: float) -> tuple[float, ...]:
    """Values for the joints of any arm from those of six: first ones from the base, the last three from the wrist.

    Parameters
    ----------
    values : sequence of float, length 6
    prismatic : ndarray of bool, shape (joints,)
    sliding : float
        The value of prismatic joints.

    Returns
    -------
    tuple of float, length joints
    """
    turning = int((~prismatic).sum())
    head = [values[min(k, 2)] for k in range(max(turning - 3, 0))]
    rest = iter([*head, *values[6 - (turning - len(head)) :]])
    return tuple(sliding if slides else next(rest) for slides in prismatic)


def size_of(arm: Arm) -> float:
    """Sum of an arm's nominal lengths against that of the IRB 1600."""
    return float((np.abs(arm.table.a) + np.where(arm.table.prismatic, 0.0, np.abs(arm.table.d))).sum() / SIZE)
