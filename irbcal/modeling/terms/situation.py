"""What terms are functions of: the motion of the joints, and the attitude of the links there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin

GRAVITY = (0.0, 0.0, -1.0)
"""Direction of gravity in the base link unless told otherwise."""
LOAD = ("payload_kg", "payload_place", "torques")
"""What a motion and measured points say of the load."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Stops of an arm and what came before each.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    move : ndarray, shape (n, joints), optional
        Commanded joints minus those of the stop before; zero where unknown, and by default.
    elapsed : ndarray, shape (n,), optional
        Time since the start, in poses or minutes. Without it the arm is warm: the warm-up terms are zero.
    payload_kg : ndarray, shape (n,), optional
        Mass carried; none by default.
    readings : bool
        Whether ``q`` and ``move`` are the controller's readings, because the programmed joints are not known.
    payload_place : ndarray, shape (n, 3), optional
        Centre of that mass in the tip link, metres; where the payload's terms say unless given.
    torques : ndarray, shape (n, joints), optional
        Torques of the joints as the robot reports them, N m (N); zero by default.
    """

    q: FloatArray
    move: FloatArray | None = None
    elapsed: FloatArray | None = None
    payload_kg: FloatArray | None = None
    readings: bool = False
    payload_place: FloatArray | None = None
    torques: FloatArray | None = None

    def __post_init__(self) -> None:
        q = np.atleast_2d(np.asarray(self.q, dtype=float))
        object.__setattr__(self, "q", q)
        shapes = {"move": q.shape, "elapsed": q.shape[:1], "payload_kg": q.shape[:1], "torques": q.shape}
        for name, shape in (*shapes.items(), ("payload_place", (len(q), 3))):
            value = getattr(self, name)
            if value is None:
                continue
            value = np.asarray(value, dtype=float)
            if value.shape != shape or not np.isfinite(value).all():
                raise RobotError(f"motion: {name} needs finite numbers of shape {shape}, found shape {value.shape}")
            object.__setattr__(self, name, value)
        lock(self)

    @staticmethod
    def in_order(
        q: FloatArray,
        elapsed: FloatArray | None = None,
        groups: np.ndarray | None = None,
        readings: bool = False,
        payload_kg: FloatArray | None = None,
    ) -> Motion:
        """Stops in the order in which the arm visited them; the first move of each group is unknown, so zero.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        elapsed : ndarray, shape (n,), optional
            The number of the pose unless given.
        groups : ndarray of str, shape (n,), optional
        readings : bool
        payload_kg : ndarray, shape (n,), optional
        """
        q = np.atleast_2d(np.asarray(q, dtype=float))
        move = np.diff(q, axis=0, prepend=q[:1])
        if groups is not None:
            move[1:][groups[1:] != groups[:-1]] = 0.0
        elapsed = np.arange(len(q), dtype=float) if elapsed is None else elapsed
        return Motion(q, move, elapsed, payload_kg, readings)

    @staticmethod
    def after(q: FloatArray, previous: ArrayLike | None = None) -> Motion:
        """Stops of a warm arm with the stop before each (n, joints) or (joints,); rows with NaN are not known."""
        if previous is None:
            return Motion(q)
        move = q - np.asarray(previous, dtype=float)
        return Motion(q, np.where(np.isfinite(move).all(axis=1, keepdims=True), move, 0.0))

    def __len__(self) -> int:
        return len(self.q)

    @property
    def moves(self) -> FloatArray:
        """``move``, zeros where none was given, shape (n, joints)."""
        return np.zeros(self.q.shape) if self.move is None else self.move

    def select(self, keep: BoolArray | slice | np.ndarray) -> Motion:
        """The stops that a mask, slice or list of rows keeps."""

        def selected(value: FloatArray | None) -> FloatArray | None:
            return None if value is None else value[keep]

        fields = {name: selected(getattr(self, name)) for name in ("move", "elapsed", *LOAD)}
        return Motion(self.q[keep], **fields, readings=self.readings)


def motion_at_use(
    q: ArrayLike,
    previous: ArrayLike | None = None,
    payload_kg: ArrayLike | None = None,
    payload_place: ArrayLike | None = None,
    torques: ArrayLike | None = None,
    usual_kg: float | None = None,
    usual_place: ArrayLike = (0.0, 0.0, 0.0),
) -> Motion:
    """The motion of a warm arm, with what is assumed where nothing is known.

    Parameters
    ----------
    q : array_like, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    previous : array_like, shape (n, joints) or (joints,), optional
        The stop before each; rows with NaN are not known: no move.
    payload_kg : array_like, shape (n,) or (), optional
        Mass carried; ``usual_kg`` unless given, and where NaN.
    payload_place : array_like, shape (n, 3) or (3,), optional
        Its centre in the tip link, metres; ``usual_place`` where NaN.
    torques : array_like, shape (n, joints), optional
        N m; zero where NaN.
    usual_kg : float, optional
        Zero unless given.
    usual_place : array_like, shape (3,)
    """
    q = np.asarray(q, dtype=float)
    centre = None
    usual = 0.0 if usual_kg is None else usual_kg
    load: FloatArray = np.full(len(q), usual if payload_kg is None else payload_kg, dtype=float)
    load = np.where(np.isfinite(load), load, usual)
    if payload_place is not None:
        centre = np.broadcast_to(np.asarray(payload_place, dtype=float), (len(q), 3))
        centre = np.where(np.isfinite(centre).all(axis=1, keepdims=True), centre, usual_place)
    felt = None if torques is None else np.nan_to_num(np.asarray(torques, dtype=float))
    return replace(Motion.after(q, previous), payload_kg=load, payload_place=centre, torques=felt)


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
    def before(self) -> FloatArray:
        """Axes of each joint's frame before it turns, in the base link, shape (joints, axis, 3, n)."""
        y, z = self._chain.y_tilt, self._chain.z
        return np.stack([np.cross(y, z, axis=1), y, z], axis=1)

    @cached_property
    def after(self) -> FloatArray:
        """Axes of each link, the joint's frame turned by its offset and its angle, shape (joints, axis, 3, n)."""
        table = self.arm.table
        turned = np.where(table.prismatic, 0.0, 1.0)[:, None] * self.motion.q.T + table.theta[:, None]
        c, s = (value[:, None] for value in cos_sin(turned))
        x, y, z = self.before[:, 0], self.before[:, 1], self.before[:, 2]
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
