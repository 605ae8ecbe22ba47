"""One term of the error model: which joint's frame moves along which axis, by what function of the motion.

Before joint ``i`` turns, its frame makes a small motion ``xi_i``: a sum of terms, each a coefficient times a function
of the motion along one of six axes (`AXES`) of that frame. Terms about the joint's own axis are the joint map; the
others are frame terms, which URDF cannot carry.

A *basis* is such a function with its derivatives; a *family* is a list of terms that belong together, made for an arm.
Each module of this package but the machinery holds one family, see `irbcal.modeling.terms.families`.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation, spread
from irbcal.modeling.terms.waves import Expansion
from irbcal.units import ColumnKind

AXES = ("rx", "ry", "rz", "tx", "ty", "tz")
"""Rotations about and translations along the axes of a joint's frame, before the joint turns."""

RATE_STEP = 1e-4
"""Seconds: step of the differences that stand in for second derivatives."""

TermValue: TypeAlias = int | float | str | tuple[float, ...]
"""A parameter of a basis: the frequency of a harmonic, the link of a gravity term, …"""

TWINS = ("thesis", "gear")
"""Families whose terms may be the same functions as those of another family."""

COEFFICIENT_KEYS = {"rad": "coefficient_rad", "m": "coefficient_m", "1": "coefficient"}
"""Unit -> key of the coefficient in JSON; other units stand in the key ``unit`` beside ``coefficient``."""


@dataclass(frozen=True)
class Term:
    """One term of the error model."""

    joint: int
    """Whose frame moves, from 0."""
    axis: str
    """One of `AXES`."""
    basis: str
    """Name of the function."""
    size: float
    """Natural size of the coefficient: what is plausible on an industrial arm, in ``unit``."""
    group: str
    """Terms of one group share one variance."""
    family: str
    """Name of the family that made it."""
    unit: str = "rad"
    """Of the coefficient: ``rad``, ``m``, ``1`` or ``rad/(N m)``."""
    parameters: Mapping[str, TermValue] = field(default_factory=dict)
    """What the basis needs to know beside joint and axis."""
    also: tuple[int, ...] = ()
    """Other joints that move by the same amount (the thesis's B acts on joints 2 and 3 alike)."""

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise RobotError(f"a term's axis is one of {', '.join(AXES)}, not {self.axis!r}")
        lock(self)

    @property
    def name(self) -> str:
        """Short name, unique within a model: ``rz4 cos 3`` (joints counted from 1).

        Terms of the families `TWINS` end with their family: a harmonic may be the same function.
        """
        values = [_short(x) for x in self.parameters.values()]
        joints = "+".join(str(j + 1) for j in (self.joint, *self.also))
        family = [self.family] if self.family in TWINS else []
        return " ".join([f"{self.axis}{joints}", self.basis, *values, *family])

    def to_json(self, coefficient: float, std: float) -> dict[str, Any]:
        """The term with its coefficient and standard deviation (both in ``unit``) as a JSON object."""
        out: dict[str, Any] = {"joint": self.joint + 1, "axis": self.axis, "basis": self.basis}
        if self.also:
            out["also"] = [j + 1 for j in self.also]
        out |= {key: list(value) if isinstance(value, tuple) else value for key, value in self.parameters.items()}
        if self.unit not in COEFFICIENT_KEYS:
            out["unit"] = self.unit
        out[COEFFICIENT_KEYS.get(self.unit, "coefficient")] = float(coefficient)
        uncertainty = {} if np.isnan(std) else {"std": float(std)}
        return out | uncertainty | {"family": self.family, "group": self.group, "size": self.size}

    @staticmethod
    def from_json(entry: Mapping[str, Any]) -> tuple[Term, float, float]:
        """A term, its coefficient and standard deviation from what `to_json` gave.

        ``family``, ``group`` and ``size`` may be absent: they matter for identification only.

        Raises
        ------
        RobotError
            If the entry is not a term.
        """
        fields = dict(entry)
        try:
            joint, axis, basis = int(fields.pop("joint")) - 1, str(fields.pop("axis")), str(fields.pop("basis"))
            unit = "1"
            for name, key in COEFFICIENT_KEYS.items():
                if key in fields:
                    unit, coefficient = name, float(fields.pop(key))
                    break
            else:
                raise KeyError("coefficient")
            unit = str(fields.pop("unit", unit))
            std, size = float(fields.pop("std", np.nan)), float(fields.pop("size", 1.0))
            also = tuple(int(j) - 1 for j in fields.pop("also", ()))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RobotError(f"this is not a term of a joint map ({error}): {dict(entry)}") from None
        family, group = str(fields.pop("family", basis)), str(fields.pop("group", basis))
        parameters = {key: tuple(value) if isinstance(value, list) else value for key, value in fields.items()}
        return Term(joint, axis, basis, size, group, family, unit, parameters, also), coefficient, std


def _short(value: TermValue) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{v:.3g}" for v in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Input:
    """What terms are functions of beside the joints: measurements tell it in columns, predictions take it by its name.

    Everything that the package knows of an input stands here; bases name theirs.
    """

    name: str
    """Its key in `Motion.inputs`, and the keyword of ``forward``, ``predict``, …."""
    columns: tuple[str, ...]
    """Of a measurement file; a name with ``{}`` stands for one of each joint."""
    kind: ColumnKind
    """What such a column holds."""
    noun: str
    """For messages."""
    note: str
    """What the user of a calibration with such terms should know of predictions without it; may be empty."""
    per_pose: bool = False
    """A pose has one value, or none, and poses with different values are different stops. Else it is read: all rows
    have a value, and the mean of a stop's counts."""
    with_columns: tuple[str, ...] = ()
    """Columns without which its own have no meaning."""
    on_request: bool = False
    """Its terms take part only where the option of a calibration that has its name says so."""
    usual: float = 0.0
    """What counts where nothing is told, SI units: there its terms are zero (of the payload, a robot has its own)."""

    @cached_property
    def of_joints(self) -> bool:
        """Whether each joint has a value."""
        return "{}" in self.columns[0]

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Names of its columns."""
        return re.compile("|".join(re.escape(name).replace(r"\{\}", r"[1-9]\d?") for name in self.columns))

    def names(self, joints: int) -> tuple[str, ...]:
        """Its columns for an arm with so many joints."""
        return tuple(self.columns[0].format(k) for k in range(1, joints + 1)) if self.of_joints else self.columns

    def shape(self, joints: tuple[int, ...]) -> tuple[int, ...]:
        """Shape of the values, by that of the joints of their poses, (n, joints)."""
        if len(joints) != 2:
            raise RobotError(f"expected joints of shape (n, joints), found shape {joints}", parameter="q")
        width = len(self.names(joints[1]))
        return (joints[0], width) if self.of_joints or width > 1 else joints[:1]

    def from_columns(self, columns: Sequence[Sequence[float | None] | FloatArray] | FloatArray) -> FloatArray:
        """Values in SI units, (n,) or (n, columns), from columns as a measurement file has them."""
        values = np.array(columns, dtype=float).T * self.kind.unit
        return values if self.of_joints or len(self.columns) > 1 else values[:, 0]

    def to_columns(self, values: FloatArray) -> dict[str, FloatArray]:
        """Values as columns by their names: what `from_columns` takes."""
        columns = values.reshape(len(values), -1).T / self.kind.unit
        return dict(zip(self.names(len(columns)), columns, strict=True))

    def filled(self, values: ArrayLike, joints: tuple[int, ...], usual: ArrayLike | None = None) -> FloatArray:
        """Values of `shape` where those of one pose or of all are given, the usual ones where they are not finite."""
        out = spread(values, shape := self.shape(joints), self.name)
        finite = np.isfinite(out)
        if len(shape) > 1 and not self.of_joints:
            finite = np.asarray(finite.all(axis=1, keepdims=True))
        return np.where(finite, out, self.usual if usual is None else usual)

    def above(self, values: ArrayLike, joints: tuple[int, ...]) -> FloatArray:
        """By how much values are above the usual at each joint, shape (n, joints)."""
        above = self.filled(values, joints) - self.usual
        return np.asarray(np.broadcast_to(above if self.of_joints else above[:, None], joints))


class Basis(ABC):
    """A function of the motion with its derivatives, evaluated for many terms and poses at a time."""

    name: str
    bounded_history: bool = False
    """Whether it is between -1 and 1, and unknown without the stop before."""
    inputs: tuple[Input, ...] = ()
    """What it is a function of beside the joints, the last move and time; zero where a motion does not have it."""

    @abstractmethod
    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The function for each term and pose, shape (terms, n)."""

    def quick_values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """As `values`, where there is a faster way."""
        return self.values(terms, situation)

    @abstractmethod
    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the commanded joints, the stop before held, shape (terms, n, joints)."""

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """The function of a joint map's term as waves, see `irbcal.modeling.terms.waves`; None where it is no such sum.

        Joint maps are evaluated by expansions where there are some: much faster than by `values`.
        """
        return None

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of `slopes` along joint speeds ``dq`` (n, joints), shape (terms, n, joints).

        By central differences where a basis has no better; exact for slopes that are constant.
        """
        ahead, behind = (self.slopes(terms, situation.shifted(sign * RATE_STEP * dq)) for sign in (1.0, -1.0))
        return (ahead - behind) / (2.0 * RATE_STEP)


def by_own_joint(terms: Sequence[Term], situation: Situation, slopes: ArrayLike) -> FloatArray:
    """Slopes by each term's own joint, (terms, n) or a number, among those by all joints, shape (terms, n, joints)."""
    out = np.zeros((len(terms), *situation.motion.q.shape))
    out[np.arange(len(terms)), :, [term.joint for term in terms]] = slopes
    return out


class OfNoJoint(Basis):
    """What joints do not change."""

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Zeros, shape (terms, n, joints)."""
        return np.zeros((len(terms), *situation.motion.q.shape))


class Proportional(OfNoJoint):
    """What is read beside the joints, its one input, above the usual: of the pose or, if all have one, of the joint.

    What would be read with other joints is not known. The compiled kernel and exports compute it as well.
    """

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Of the terms' joints, shape (terms, n)."""
        (quantity,), motion = self.inputs, situation.motion
        return quantity.above(motion.inputs.get(quantity.name, np.nan), motion.q.shape).T[
            [term.joint for term in terms]
        ]


class Family(ABC):
    """Terms that belong together: they enter a set of terms together or not at all."""

    name: str
    bases: tuple[Basis, ...] = ()
    title: str = ""
    """What people read where the name does not say it."""
    moves_frames: bool = False
    """Whether terms are about other axes than the joints' own, also in use: URDF and a joint map cannot carry them."""
    of_moves: bool = False
    """Whether terms are functions of the last move: the family takes part where last moves are known."""
    like_lag: bool = False
    """Whether readings that lag look the same, as joints lag by somewhat different shares of their moves: where
    readings lag its terms are fitted, but count as part of the lag, and are none of the robot's."""
    of_type: bool = False
    """Whether robots of a type are compared by it."""
    special_case_of: tuple[str, ...] = ()
    """Families whose terms can be all that its terms are."""

    @abstractmethod
    def terms(self, arm: Arm) -> list[Term]:
        """All terms that the family has for an arm; empty where it has none."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """What its bases are functions of beside the joints: it takes part where measurements tell all of it."""
        return tuple(dict.fromkeys(quantity for basis in self.bases for quantity in basis.inputs))


def own_axis(arm: Arm, joint: int) -> str:
    """The axis of the joint map: ``rz`` of a revolute joint, ``tz`` of a prismatic one."""
    return "tz" if arm.table.prismatic[joint] else "rz"


def own_unit(arm: Arm, joint: int) -> str:
    """Unit of a joint's value: ``rad`` or ``m``."""
    return "m" if arm.table.prismatic[joint] else "rad"


def revolute(arm: Arm) -> list[int]:
    """Joints that turn, from 0."""
    return [j for j in range(len(arm.joint_names)) if not arm.table.prismatic[j]]


def weighed(arm: Arm) -> list[int]:
    """Joints that turn, from 0, in whose base link gravity has one direction: none where that link moves."""
    return [] if arm.joints_up else revolute(arm)
