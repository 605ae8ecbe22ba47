"""The virtual cell: a robot that errs, a tool with reflectors and a laser tracker, measured like the real ones.

The true robot has geometric errors of all links, a joint map (arm stiffness, joint-6 Fourier series) and effects that
no level of the models contains (`irbcal.simulation.effects`), each of which can be switched off. A run takes commanded
joints in their order, for the order decides where each joint came from and what time it is, and gives the points in
the tracker's frame. Nothing here is read by the identification. `irbcal.simulation.shipped` has the cells that come
with irbcal.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import MeasurementError, RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.term import Term
from irbcal.modeling.thesis_map import ThesisMap, stiffness_terms
from irbcal.simulation.effect import Effect, Motion, Shot, size_of
from irbcal.simulation.effects import ALL, MORE, check_names
from irbcal.simulation.gravity import frame_torques, torques_and_origins
from irbcal.simulation.in_terms import constants, joint_map_amounts, merged, payload_amounts
from irbcal.simulation.masses import Bodies
from irbcal.simulation.run import Run
from irbcal.simulation.tool import EndEffector
from irbcal.simulation.tracker import Tracker
from irbcal.simulation.tracker_effects import Visibility
from irbcal.simulation.truth import truth
from irbcal.simulation.weight_effects import Compliance
from irbcal.units import DEG

SPEED = 60.0 * DEG
"""Speed of the slowest joint of a move, radians per second: about 500 mm/s at the tool."""
SLIDING_SPEED = 0.5
"""The same for prismatic joints, metres per second."""
SECONDS_PER_POINT = 2.5
"""Time that the tracker needs for a point: turning, finding, 0.5 s of readings."""
WAIT_S = 4.0
"""Seconds between stop and measurement (Nubiola 2011, section 7.1)."""


@dataclass(frozen=True, eq=False)
class Cell:
    """Robot, tool, tracker and effects.

    Parameters
    ----------
    arm : Arm
        The nominal arm: what the controller believes.
    table : DHMTable
        The true geometry, without what effects add to it.
    joint_map : ThesisMap
        Gains, Fourier series; the stiffness follows from the payload, see `stiffness`.
    bodies : Bodies
        Link masses without payload.
    tool : EndEffector
    tracker : Tracker
    references : dict of str to ndarray, shape (3,)
        Places in the base link, metres.
    effects : tuple of Effect
        Those that are on.
    compliance : tuple of float
        rad/Nm of joints 1 to n: what the joint map's stiffness is derived from, whether the effect is on or off.
    seed : int
        Of the run: noise, repeatability, lost points. The robot's own errors do not depend on it.
    """

    arm: Arm
    table: DHMTable
    joint_map: ThesisMap
    bodies: Bodies
    tool: EndEffector
    tracker: Tracker
    references: dict[str, FloatArray]
    effects: tuple[Effect, ...]
    compliance: tuple[float, ...]
    seed: int = 0

    def __post_init__(self) -> None:
        lock(self)

    @property
    def on(self) -> tuple[str, ...]:
        """Names of the effects that are on."""
        return tuple(effect.name for effect in self.effects)

    def replace(self, **changes: Any) -> Cell:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def only(self, *names: str) -> Cell:
        """The cell with these of its effects alone; without names, with none."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name in names))

    def without(self, *names: str) -> Cell:
        """The cell without these effects."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name not in names))

    def with_effect(self, effect: Effect) -> Cell:
        """The cell with one effect's parameters changed, or the effect switched on."""
        check_names([effect.name])
        others = {item.name: item for item in self.effects} | {effect.name: effect}
        return replace(self, effects=tuple(others[name] for name in (item.name for item in ALL) if name in others))

    def also(self, *names: str) -> Cell:
        """The cell with these of the effects switched on that shipped cells leave off."""
        check_names(names)
        cell = self
        for effect in MORE:
            if effect.name in names and effect.name not in cell.on:
                cell = cell.with_effect(effect().for_arm(self.arm.table.prismatic, size_of(self.arm)))
        return cell

    def with_payload(self, kilograms: float) -> Cell:
        """The cell with another payload at the tool's centre of mass."""
        return replace(self, tool=replace(self.tool, payload_kg=float(kilograms)))

    def with_targets(self, names: Sequence[str]) -> Cell:
        """The cell measured at these targets of its tool.

        Raises
        ------
        MeasurementError
            If the tool has no such target.
        """
        unknown = [name for name in names if name not in self.tool.names]
        if unknown:
            raise MeasurementError(
                f"unknown target {unknown[0]!r}: targets are {', '.join(self.tool.names)}", parameter="targets"
            )
        return replace(self, tool=self.tool.only(names))

    def loaded(self) -> Bodies:
        """Masses with the payload."""
        tool = self.tool
        return self.bodies.with_payload(tool.payload_kg, tool.payload_centre, self.arm.T_last_tip)

    def true_arm(self) -> Arm:
        """The arm with its true geometry, effects included."""
        table = self.table
        for effect in self.effects:
            table = effect.table(table)
        return self.arm.with_table(table)

    def true_joint_map(self) -> ThesisMap:
        """The joint map with the two stiffness numbers that describe the arm's compliance best for this payload.

        They are fitted to compliance times gravity torque of joints 2 and 3 over 500 random poses. Arms that the
        stiffness model does not describe (`Arm.stiffness_geometry`) have none: there only the effect
        ``compliance`` bends the arm.
        """
        phases = _phases(self.arm)
        if phases is None:
            return self.joint_map
        q = self.arm.random_joints(500, seed=0)
        torque, _ = torques_and_origins(self.arm.with_table(self.table), self.loaded(), q)
        upper, fore = stiffness_terms(q, phases)
        M = np.concatenate([np.column_stack([upper, fore]), np.column_stack([0.0 * fore, fore])])
        bent = -np.concatenate([self.compliance[k] * torque[:, k] for k in (1, 2)])
        return replace(self.joint_map, stiffness=np.linalg.lstsq(M, bent, rcond=None)[0], phases=phases)

    def measure(
        self,
        q: ArrayLike,
        asked: ArrayLike | None = None,
        wait_s: ArrayLike = WAIT_S,
        start: ArrayLike | None = None,
        run: int = 0,
    ) -> Run:
        """Move through poses and measure them.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded joints in the order of the run, radians (metres for prismatic joints).
        asked : ndarray of bool, shape (n, targets), optional
            Which targets are measured in each pose; all unless given. References are always measured.
        wait_s : float or ndarray, shape (n,)
            Seconds between stop and measurement.
        start : ndarray, shape (joints,), optional
            Where the robot comes from; zero joints unless given.
        run : int
            Runs of the same cell with other numbers have other random numbers.

        Returns
        -------
        Run
        """
        joints: FloatArray = self.arm.check_joints(q)
        n, tool = len(joints), self.tool
        names = (*tool.names, *self.references)
        everything = np.ones((n, len(names)), dtype=bool)
        if asked is not None:
            everything[:, : len(tool.names)] = asked
        begin = np.zeros(joints.shape[1]) if start is None else np.asarray(start, dtype=float)
        waits = np.broadcast_to(np.asarray(wait_s, dtype=float), (n,))
        stopped, time_s = self._times(joints, begin, waits, everything)
        T, origins, motion = self._tips(joints, begin, stopped, waits, run)
        shot = self._shot(T, origins, time_s)
        xyz = frames.apply(self.tracker.T_tracker_base, shot.xyz)
        lost = ~everything
        unseen: dict[str, int] = {}
        for effect in self.effects:
            xyz = effect.points(xyz, shot, self._stream(effect, run))
            mask = effect.unseen(shot, self._stream(effect, run))
            if mask is not None:
                unseen[effect.name] = int((mask & ~lost).sum())
                lost = lost | mask
        xyz[lost] = np.nan
        readings = self._readings(motion, run)
        return Run(joints, T, xyz, everything, names, len(tool.names), time_s, unseen, tool.payload_kg, readings)

    def _readings(self, motion: Motion, run: int) -> FloatArray | None:
        """The joints as the controller reads them; None where no effect changes them."""
        changes = [effect.readings(motion, self._stream(effect, run)) for effect in self.effects]
        found = [change for change in changes if change is not None]
        return motion.q + sum(found) if found else None

    def _tips(
        self, q: FloatArray, start: FloatArray, stopped: FloatArray, waits: FloatArray, run: int
    ) -> tuple[FloatArray, FloatArray, Motion]:
        """Where the tip really stands (n, 4, 4), the joints' origins (n, joints + 1, 3), and the motion there."""
        arm, joint_map = self.true_arm(), self.true_joint_map()
        torque, origins = torques_and_origins(arm, self.loaded(), q)
        theta = joint_map.effective(q)
        stiffness = theta - replace(joint_map, stiffness=np.zeros(2)).effective(q)
        move = np.diff(q, axis=0, prepend=start[None])
        bent = "bending" in self.on
        tilting = frame_torques(arm, self.loaded(), q) if bent else np.zeros((*q.shape, 2))
        motion = Motion(q, directions(q, start), stopped, waits, torque, stiffness, arm.table.prismatic, move, tilting)
        xi = []
        for effect in self.effects:
            change = effect.joints(motion, self._stream(effect, run))
            theta = theta if change is None else theta + change
            frame = effect.frames(motion, self._stream(effect, run))
            xi += [] if frame is None else [frame]
        T = arm.forward(theta) if not xi else chain.poses(chain.walk(arm, theta, np.sum(xi, axis=0)))
        for effect in self.effects:
            T = effect.tips(T, motion)
        return T, origins, motion

    def visible(self, q: FloatArray) -> BoolArray:
        """Which targets the tracker sees with the effect ``visibility`` alone, as far as the nominal robot tells.

        Parameters
        ----------
        q : ndarray, shape (n, joints)

        Returns
        -------
        ndarray of bool, shape (n, targets)
            True everywhere where the effect is off.
        """
        effect = next((item for item in self.effects if isinstance(item, Visibility)), None)
        k = len(self.tool.names)
        if effect is None:
            return np.ones((len(q), k), dtype=bool)
        _, origins = torques_and_origins(self.arm, self.bodies, q)
        shot = self._shot(self.arm.forward(q), origins, np.zeros((len(q), k + len(self.references))))
        return ~effect.unseen(shot, self._stream(effect, 0))[:, :k]

    def _shot(self, T: FloatArray, origins: FloatArray, time_s: FloatArray) -> Shot:
        R, p = T[:, :3, :3], T[:, None, :3, 3]
        targets = self.tool.real @ np.swapaxes(R, 1, 2) + p
        fixed = np.array(list(self.references.values())).reshape(-1, 3)
        xyz = np.concatenate([targets, np.broadcast_to(fixed, (len(T), *fixed.shape))], axis=1)
        return Shot(xyz, self.tool.direction @ np.swapaxes(R, 1, 2), origins, time_s, self.tracker.place)

    def _times(
        self, q: FloatArray, start: FloatArray, wait_s: FloatArray, asked: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """When the robot stopped at each pose (n,), and when each point was measured (n, k), seconds."""
        speed = np.where(self.arm.table.prismatic, SLIDING_SPEED, SPEED)
        move = (np.abs(np.diff(q, axis=0, prepend=start[None])) / speed).max(axis=1)
        points = SECONDS_PER_POINT * np.cumsum(asked, axis=1)
        end = np.cumsum(move + wait_s + points[:, -1])
        stopped = end - points[:, -1] - wait_s
        return stopped, (stopped + wait_s)[:, None] + points

    def _stream(self, effect: Effect, run: int) -> np.random.Generator:
        """Random numbers of an effect: they depend on its name, the seed and the run, on no other effect."""
        return np.random.default_rng(
            np.random.SeedSequence(self.seed, spawn_key=(zlib.crc32(effect.name.encode()), run))
        )

    def terms(self, payload: bool = False) -> dict[str, tuple[Term, float]]:
        """What the robot does, in the terms of the error model: name -> term and coefficient, constants among them.

        Time is in minutes. What the error model does not know is not in it: repeatability, settling. Backlash counts
        as ``direction``, which is the same after long moves.

        Parameters
        ----------
        payload : bool
            Tell what the payload does to the joints as terms of their own (``payload``, for any mass at its place); as
            a part of ``gravity`` unless told otherwise.
        """
        amounts = constants(self.arm.table, self.true_arm().table)
        amounts += joint_map_amounts(self.arm, self.true_joint_map(), stiffness="compliance" not in self.on)
        for effect in self.effects:
            if payload and isinstance(effect, Compliance):
                amounts += effect.terms(self.arm, self.bodies)
                amounts += payload_amounts(self.arm, effect.rad_per_Nm, self.tool.payload_centre)
            else:
                amounts += effect.terms(self.arm, self.loaded())
        return merged(amounts)

    def truth(self) -> dict[str, Any]:
        """All that the cell hides, in millimetres and degrees, ready for JSON; see `irbcal.simulation.truth`."""
        return truth(
            self.arm.table,
            self.true_arm().table,
            self.true_joint_map(),
            self.tool,
            self.tracker,
            self.references,
            self.bodies,
            self.effects,
            self.seed,
            self.terms(),
        )


def _phases(arm: Arm) -> FloatArray | None:
    """Phases of the stiffness model; None for arms that it does not describe."""
    try:
        return arm.stiffness_geometry()[0]
    except RobotError:
        return None


def directions(q: FloatArray, start: FloatArray) -> FloatArray:
    """Sign of each joint's last change, shape (n, joints); +1 for joints that have not moved yet."""
    change = np.sign(np.diff(q, axis=0, prepend=start[None]))
    change = np.vstack([np.ones(q.shape[1]), change])
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change))[:, None], 0), axis=0)
    return np.take_along_axis(change, last, axis=0)[1:]
