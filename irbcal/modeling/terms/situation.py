"""What terms are functions of: the motion of the joints, and the attitude of the links there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.errors import RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin
from irbcal.option_values import excerpt

GRAVITY = (0.0, 0.0, -1.0)
"""Direction of gravity in the base link unless told otherwise."""


def at_rows(inputs: Mapping[str, FloatArray], rows: BoolArray | IntArray | slice) -> dict[str, FloatArray]:
    """Inputs of terms, by name, at some rows of theirs."""
    return {name: values[rows] for name, values in inputs.items()}


@dataclass(frozen=True, eq=False)
class Motion:
    """Stops of an arm and what came before each."""

    q: FloatArray
    """Shape (n, joints). Commanded joints, radians (metres for prismatic joints)."""
    move: FloatArray | None = None
    """Shape (n, joints). Commanded joints minus those of the stop before; zero where unknown, and by default."""
    elapsed: FloatArray | None = None
    """Shape (n,). Time since the start, in poses or minutes. Without it the arm is warm: the warm-up terms are zero."""
    inputs: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (n,) or (n, values). What else terms are functions of, by name (`irbcal.modeling.terms.inputs`),
    SI units; absent where not told.
    """
    readings: bool = False
    """Whether ``q`` and ``move`` are the controller's readings, because the programmed joints are not known."""

    def __post_init__(self) -> None:
        q = np.atleast_2d(np.asarray(self.q, dtype=float))
        object.__setattr__(self, "q", q)
        given = {"move": self.move, "elapsed": self.elapsed} | dict(self.inputs)
        arrays = {name: np.asarray(value, dtype=float) for name, value in given.items() if value is not None}
        for name, value in arrays.items():
            shape = q.shape if name == "move" else q.shape[:1] + (name != "elapsed") * value.shape[1:]
            if value.shape != shape or not np.isfinite(value).all():
                raise RobotError(f"motion: {name} needs finite numbers of shape {shape}, found shape {value.shape}")
        for name in ("move", "elapsed"):
            object.__setattr__(self, name, arrays.pop(name, None))
        object.__setattr__(self, "inputs", arrays)
        lock(self)

    @staticmethod
    def in_order(
        q: FloatArray,
        elapsed: FloatArray | None = None,
        groups: np.ndarray | None = None,
        readings: bool = False,
    ) -> Motion:
        """Stops in the order in which the arm visited them; the first move of each group is unknown, so zero.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        elapsed : ndarray, shape (n,), optional
            The number of the pose unless given.
        groups : ndarray of str, shape (n,), optional
        readings : bool
        """
        q = np.atleast_2d(np.asarray(q, dtype=float))
        move = np.diff(q, axis=0, prepend=q[:1])
        if groups is not None:
            move[1:][groups[1:] != groups[:-1]] = 0.0
        elapsed = np.arange(len(q), dtype=float) if elapsed is None else elapsed
        return Motion(q, move, elapsed, readings=readings)

    @staticmethod
    def from_stops(q: FloatArray, previous: ArrayLike | None = None) -> Motion:
        """Stops of a warm arm with the stop before each (n, joints) or (joints,); rows with NaN are not known."""
        if previous is None:
            return Motion(q)
        move = q - spread(previous, q.shape, "previous")
        return Motion(q, np.where(np.isfinite(move).all(axis=1, keepdims=True), move, 0.0))

    def __len__(self) -> int:
        return len(self.q)

    @property
    def moves(self) -> FloatArray:
        """``move``, zeros where none was given, shape (n, joints)."""
        return np.zeros(self.q.shape) if self.move is None else self.move

    def select(self, keep: BoolArray | IntArray | slice) -> Motion:
        """The stops that a mask, slice or list of rows keeps."""
        move, elapsed = (None if value is None else value[keep] for value in (self.move, self.elapsed))
        return Motion(self.q[keep], move, elapsed, at_rows(self.inputs, keep), self.readings)


def spread(values: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    """Numbers of one pose or of all as an array of a shape, which must not be written to.

    Raises
    ------
    RobotError
        If they are no numbers, or of another shape; ``name`` says what they are.
    """
    given: FloatArray | None = None
    try:
        given = np.asarray(values, dtype=float)
        return np.broadcast_to(given, shape)
    except (TypeError, ValueError):
        found = excerpt(values) if given is None else f"shape {given.shape}"
        raise RobotError(f"{name}: expected numbers of shape {shape}, found {found}", parameter=name) from None


class Situation:
    """A motion of an arm, with the attitude of its links computed when first asked for.

    Attitudes are those of the nominal arm at the commanded joints: terms are the same functions whatever is identified.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    motion : Motion
    gravity : sequence of three float
        Direction in the base link.
    """

    def __init__(self, arm: Arm, motion: Motion, gravity: tuple[float, ...] = GRAVITY) -> None:
        self.arm, self.motion = arm, motion
        self.gravity: FloatArray = np.asarray(gravity, dtype=float)

    def shifted(self, dq: FloatArray) -> Situation:
        """The situation with the joints (n, joints) moved on by a little, the stop before held."""
        m = self.motion
        motion = replace(m, q=m.q + dq, move=m.moves + dq)
        return Situation(self.arm, motion, (self.gravity[0], self.gravity[1], self.gravity[2]))

    @cached_property
    def _chain(self) -> dhm.ChainFrames:
        table = self.arm.table
        return dhm.chain_frames(table, self.motion.q.T + table.offsets[:, None], self.arm.T_base_0, self.arm.T_last_tip)

    @cached_property
    def axes_before_joint(self) -> FloatArray:
        """Axes of each joint's frame before it turns, in the base link, shape (joints, axis, 3, n)."""
        y, z = self._chain.y_tilt, self._chain.z
        return np.stack([np.cross(y, z, axis=1), y, z], axis=1)

    @cached_property
    def axes_after_joint(self) -> FloatArray:
        """Axes of each link, the joint's frame turned by its offset and its angle, shape (joints, axis, 3, n)."""
        table = self.arm.table
        turned = np.where(table.prismatic, 0.0, 1.0)[:, None] * self.motion.q.T + table.theta[:, None]
        c, s = (value[:, None] for value in cos_sin(turned))
        x, y, z = self.axes_before_joint[:, 0], self.axes_before_joint[:, 1], self.axes_before_joint[:, 2]
        return np.stack([c * x + s * y, c * y - s * x, z], axis=1)

    @property
    def origins(self) -> FloatArray:
        """Origin of each joint's axis in the base link, shape (joints, 3, n), metres."""
        return self._chain.o

    @property
    def tip(self) -> FloatArray:
        """The tip's x, y, z axes and origin in the base link, shape (4, 3, n)."""
        return self._chain.tip

    @cached_property
    def turning(self) -> FloatArray:
        """Axes z of revolute joints, zero for prismatic ones, shape (joints, 3, n)."""
        return np.where(self.arm.table.prismatic[:, None, None], 0.0, self._chain.z)

    def spin(self, dq: FloatArray) -> FloatArray:
        """Angular velocity of each joint's frame before it turns at joint speeds (n, joints), last row: of the tip.

        Returns
        -------
        ndarray, shape (joints + 1, 3, n)
            Radians per second, in the base link.
        """
        spins = self.turning * dq.T[:, None]
        return np.concatenate([np.zeros((1, *spins.shape[1:])), np.cumsum(spins, axis=0)])
