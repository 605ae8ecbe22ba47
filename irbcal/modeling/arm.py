"""The nominal arm: a DHM chain between a base link and a tip link, with names and limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling import coupling as counting
from irbcal.modeling import dhm, frames
from irbcal.modeling.stiffness import Stiffness
from irbcal.option_values import excerpt
from irbcal.units import DEG, joint_unit

LARGEST_TRAVEL = 50.0
"""Metres that no prismatic joint goes, if the URDF gives no limit."""

NEARLY = 0.01
"""Radians within which axes count as horizontal and parallel: those of a calibrated URDF are not so exactly."""


@dataclass(frozen=True, eq=False, repr=False)
class Arm:
    """A serial arm; most have six revolute joints."""

    name: str
    table: dhm.DHMTable
    T_base_0: FloatArray
    """Shape (4, 4). DHM frame 0 in the base link (identity for arms whose first axis is the base's z)."""
    T_last_tip: FloatArray
    """Shape (4, 4). Tip link in the last DHM frame (identity where the tip's z lies on the last axis)."""
    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    """Shape (n,). Joint limits, radians (metres for prismatic joints); infinite for continuous joints."""
    base_link: str = "base_link"
    tip_link: str = "tool0"
    coupling: FloatArray | None = None
    """Shape (n, n). Joints of the arm from those that its controller counts, ``q = coupling @ p``, where these differ:
    see `irbcal.modeling.coupling`. All joints but those in files are the arm's own.
    """
    joints_up: int = 0
    """How many joints come first that lead from the base link up a tree to the link that base and tip hang on (a
    camera's neck): gravity has no fixed direction in such a base link.
    """

    def __post_init__(self) -> None:
        for key in ("T_base_0", "T_last_tip", "lower", "upper"):
            object.__setattr__(self, key, np.asarray(getattr(self, key), dtype=float))
        lock(self)

    def __repr__(self) -> str:
        return f"<Arm {self.name}: {self.joints_in_words}, {self.base_link} to {self.tip_link}>"

    @property
    def joints_in_words(self) -> str:
        """How many joints of which kind, for people."""
        slides = int(self.table.prismatic.sum())
        turns = f"{len(self.joint_names) - slides} revolute"
        return f"{turns} and {slides} prismatic joints" if slides else f"{turns} joints"

    @property
    def six_revolute(self) -> bool:
        """Whether the arm has six revolute joints: what the thesis's error models and closed forms are made for."""
        return len(self.joint_names) == 6 and not self.table.prismatic.any()

    @cached_property
    def planar(self) -> bool:
        """Whether all turning axes are parallel (SCARA): such an arm cannot tell its base from its tool in all ways."""
        values = self.random_joints(3, 0).T + self.table.offsets[:, None]
        turning = dhm.chain_frames(self.table, values, self.T_base_0).z[~self.table.prismatic]
        return bool(np.abs(np.cross(turning, turning[:1, :, :1], axis=1)).max(initial=0.0) < np.sin(1.0 * DEG))

    @property
    def joint_columns(self) -> list[str]:
        """Columns of joint values in files: ``q1_deg`` and so on, ``q1_mm`` for a prismatic joint."""
        return [f"q{i}_{unit}" for i, unit in enumerate(self.joint_unit_names, start=1)]

    @property
    def joints_listed(self) -> str:
        """How many joints there are, their names and which of them slide, for messages."""
        slides = self.table.prismatic.tolist()
        names = (f"{name} slides" if k else name for name, k in zip(self.joint_names, slides, strict=True))
        return f"{len(slides)} ({', '.join(names)})"

    @property
    def joint_units(self) -> FloatArray:
        """SI value of one unit of each column of `joint_columns`, shape (n,)."""
        return np.array([joint_unit(slides)[1] for slides in self.table.prismatic])

    @property
    def joint_unit_names(self) -> tuple[str, ...]:
        """``deg`` or ``mm`` of each joint."""
        return tuple(joint_unit(slides)[0] for slides in self.table.prismatic)

    def from_controller(self, p: FloatArray) -> FloatArray:
        """The arm's joints (n, joints) from those that the controller counts, SI units."""
        return counting.from_controller(p, self.coupling)

    def to_controller(self, q: FloatArray) -> FloatArray:
        """Joints (n, joints) as the controller counts them, from the arm's, SI units."""
        return counting.to_controller(q, self.coupling)

    def joint_table(self, q: FloatArray, decimals: int | None = None) -> dict[str, FloatArray]:
        """Joints (n, joints) as columns of files by `joint_columns`, as the controller counts them, perhaps rounded."""
        values = self.to_controller(q) / self.joint_units
        values = values if decimals is None else np.round(values, decimals) + 0.0  # no minus before zero
        return dict(zip(self.joint_columns, values.T, strict=True))

    def with_table(self, table: dhm.DHMTable) -> Arm:
        """The same arm with another DHM table."""
        return replace(self, table=table)

    def forward(self, theta: ArrayLike) -> FloatArray:
        """Tip poses in the base link, see `irbcal.modeling.dhm.forward`.

        Parameters
        ----------
        theta : array_like, shape (n, joints) or (joints,)
            Effective joints, radians and metres.

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_base_tip``; n is 1 for one pose.

        Raises
        ------
        RobotError
            If the joints have another shape.
        """
        return dhm.forward(self.table, theta, self.T_base_0, self.T_last_tip)

    @property
    def finite_limits(self) -> tuple[FloatArray, FloatArray]:
        """Joint limits, half a turn or 1 m either way where there are none, shape (joints,) each."""
        free = np.where(self.table.prismatic, 1.0, np.pi)
        lower, upper = np.isfinite(self.lower), np.isfinite(self.upper)
        return np.where(lower, self.lower, -free), np.where(upper, self.upper, free)

    def random_joints(self, n: int, seed: int) -> FloatArray:
        """Uniform random joints inside `finite_limits`, (n, joints)."""
        lower, upper = self.finite_limits
        return np.random.default_rng(seed).uniform(lower, upper, (n, len(lower)))

    def spread_joints(self, n: int) -> FloatArray:
        """Joints (n, joints) spread over `finite_limits` by multiples of roots, without loading random generators."""
        lower, upper = self.finite_limits
        steps = np.sqrt(np.arange(2.0, len(lower) + 2.0)) + np.pi
        return lower + (upper - lower) * (np.arange(1, n + 1)[:, None] * steps % 1.0)

    def random_stops(
        self, n: int, payload_kg: float = 0.0, several_loads: bool = False
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What test vectors are computed at: joints and the stops before (n, joints), and loads (n,).

        The load is the usual one or, where there are several, up to 4 kg more.
        """
        load = np.full(n, float(payload_kg)) + (np.arange(n) % 5.0 if several_loads else 0.0)
        return self.random_joints(n, 1), self.random_joints(n, 2), load

    @property
    def bends_like_the_thesis(self) -> bool:
        """Whether the arm-stiffness model describes it, see `stiffness_geometry`."""
        try:
            self.stiffness_geometry()
        except RobotError:
            return False
        return True

    def stiffness_geometry(self) -> tuple[FloatArray, Stiffness]:
        """What the arm-stiffness model needs to know of the arm (Nubiola 2011, Figure 5.3).

        Returns
        -------
        phases : ndarray, shape (2,)
            Angles of upper arm and forearm from the vertical at zero joints, about axes 2 and 3, radians.
        stiffness : Stiffness
            `Stiffness.guess` for this arm's lengths.

        Raises
        ------
        RobotError
            If the arm has not six revolute joints, or axes 2 and 3 are not horizontal and parallel: gravity then acts
            otherwise than the model says.
        """
        return self._bending

    @cached_property
    def _bending(self) -> tuple[FloatArray, Stiffness]:
        if not self.six_revolute:
            raise RobotError(
                f"the arm-stiffness model is for six revolute joints, {self.name} has {self.joints_listed}"
            )
        chain = dhm.chain_frames(self.table, self.table.offsets[:, None], self.T_base_0)
        z, o = chain.z[:, :, 0], chain.o[:, :, 0]
        axis = z[1]
        if self.joints_up:
            raise RobotError(f"the arm-stiffness model needs a base that stands, {self.base_link} moves with joints")
        if abs(axis[2]) > NEARLY or float(np.linalg.norm(axis - z[2])) > NEARLY:
            raise RobotError(
                f"the arm-stiffness model needs axes 2 and 3 horizontal and pointing the same way, but those of "
                f"{self.name} point along {np.round(z[1], 3) + 0.0} and {np.round(z[2], 3) + 0.0} in {self.base_link}: "
                "use model placement"
            )
        upper = o[2] - o[1] - axis * (axis @ (o[2] - o[1]))
        # the forearm runs along axis 4 where that lies in the arm's plane (spherical wrist), else to axis 4
        fore = z[3] * self.table.d[3] if abs(axis @ z[3]) < 0.5 else o[3] - o[2]
        fore = fore - axis * (axis @ fore)
        up = np.array([0.0, 0.0, 1.0])
        phases = np.array([np.arctan2(axis @ frames.cross(up, v), up @ v) for v in (upper, fore)])
        phases.setflags(write=False)
        return phases, Stiffness.guess(float(np.linalg.norm(upper)), float(np.linalg.norm(fore)))

    @cached_property
    def farthest(self) -> FloatArray:
        """Joint values, shape (n,), that only another unit explains: twice the limit, or two turns where that is more.

        A continuous joint may go on turning for ever: it is judged, at eight turns, only where no other joint could
        tell. A prismatic joint is judged at ten times its limit.
        """
        slides = self.table.prismatic
        limit = np.maximum(np.abs(self.lower), np.abs(self.upper))
        endless = ~np.isfinite(limit)
        turning = np.where(endless, np.inf, 2.0 * np.maximum(limit, 2.0 * np.pi))
        if endless[~slides].all():
            turning = np.full(len(slides), 16.0 * np.pi)
        return np.where(slides, np.where(endless, LARGEST_TRAVEL, 10.0 * np.maximum(limit, 1.0)), turning)

    def check_joints(self, q: ArrayLike) -> FloatArray:
        """Refuse joint arrays that are not (n, joints), or not in radians and metres.

        Parameters
        ----------
        q : array_like, shape (n, joints) or (joints,)
            Radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints)

        Raises
        ------
        RobotError
            If the shape is another, or a number so large that it must be meant in degrees (millimetres).
        """
        q = self.check_shape(q)
        far = np.abs(q) > self.farthest
        if np.count_nonzero(far):
            row, joint = np.argwhere(far)[0]
            slides = self.table.prismatic[joint]
            unit, unit_expected = ("millimetres", "metres") if slides else ("degrees", "radians")
            raise RobotError(
                f"joints of {self.name} are expected in {unit_expected}, found {q[row, joint]:.6g} for "
                f"{self.joint_names[joint]}: these look like {unit}",
                parameter="q",
            )
        return q

    def check_shape(self, q: ArrayLike) -> FloatArray:
        """Refuse arrays, of joints or their speeds, that are not (n, joints) or (joints,); returns (n, joints)."""
        joints = len(self.joint_names)
        if type(q) is np.ndarray and q.dtype == float and q.ndim == 2 and q.shape[1] == joints:
            return q
        if hasattr(q, "columns"):
            raise RobotError(
                f"joints of {self.name} are expected as an array in radians (metres), found a table: its columns may "
                "be in degrees, irbcal.forward_kinematics takes tables",
                parameter="q",
            )
        try:
            q = np.atleast_2d(np.asarray(q, dtype=float))
        except (TypeError, ValueError):
            raise RobotError(
                f"joints of {self.name} are expected as an array of numbers, found {excerpt(q)}", parameter="q"
            ) from None
        if q.ndim != 2 or q.shape[1] != joints:
            raise RobotError(f"joints of {self.name} need shape (n, {joints}), found {q.shape}", parameter="q")
        return q


def relative_difference(T_1: FloatArray, T_2: FloatArray) -> tuple[float, float]:
    """Largest distance of origins (m) and largest relative rotation (rad) of two batches of poses (..., 4, 4)."""
    position = np.linalg.norm(T_1[..., :3, 3] - T_2[..., :3, 3], axis=-1).max()
    return float(position), float(frames.rotation_distance(T_1[..., :3, :3], T_2[..., :3, :3]).max())
