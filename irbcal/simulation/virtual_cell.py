"""The virtual cell: a robot that errs, a tool with reflectors and a laser tracker, measured like the real ones.

The true robot has geometric errors of all links, a joint map as of the thesis's level 34 (gains, arm stiffness, joint-6
Fourier series) and effects (`irbcal.simulation.effects`), each of which can be switched off. A run takes commanded
joints in their order, for the order decides where each joint came from and what time it is, and gives the points in
the tracker's frame. Nothing here is read by the identification. `irbcal.simulation.shipped_cells` has the cells that
come with irbcal.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked, NameArray
from irbcal.errors import MeasurementError, RobotError
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import name_of
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap, basis_values
from irbcal.modeling.terms.thesis import stiffness_of
from irbcal.modeling.thesis_map import with_stiffness
from irbcal.simulation.effects import ALL, MORE, Effect, Shot, Stops, VisibilityEffect, check_names, size_of
from irbcal.simulation.instruments import EndEffector, Tracker
from irbcal.simulation.weights import Bodies, torques
from irbcal.units import DEG, MM, UNIT_OUTSIDE

SPEED = 60.0 * DEG
"""Speed of the slowest joint of a move, radians per second: about 500 mm/s at the tool."""
SLIDING_SPEED = 0.5
"""The same for prismatic joints, metres per second."""
SECONDS_PER_POINT = 2.5
"""Time that the tracker needs for a point: turning, finding, 0.5 s of readings."""
WAIT_S = 4.0
"""Seconds between stop and measurement (Nubiola 2011, section 7.1)."""
MINUTE = 60.0
_BASE = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
_BASE_UNITS = np.array([MM, MM, MM, DEG, DEG, DEG])
_COLUMNS = {"alpha": DEG, "a": MM, "theta": DEG, "d": MM, "beta": DEG, "b": MM}


@dataclass(frozen=True, eq=False, repr=False)
class Run(Locked):
    """One measuring run as the tracker saw it."""

    q: FloatArray
    """Shape (n, joints). Commanded joints, radians (metres for prismatic joints)."""
    T_base_tip: FloatArray
    """Shape (n, 4, 4). Where the tip really was: the truth."""
    xyz: FloatArray
    """Shape (n, k, 3). Targets, then references, in the tracker's frame, metres; NaN where lost or not asked for."""
    measured: BoolArray
    """Shape (n, k)."""
    names: tuple[str, ...]
    """Length k."""
    targets: int
    """How many of the names are targets on the tool."""
    time_s: FloatArray
    """Shape (n, k). When each point was measured, from the start of the run."""
    unseen: dict[str, int]
    """How many of the points asked for were lost to each effect."""
    payload_kg: float
    readings: FloatArray | None = None
    """Shape (n, joints). Joints as the controller read them, where these are not the commanded ones."""
    payload_centre: FloatArray | None = None
    """Shape (3,). Centre of the payload in the tip link, metres, where the measurements shall tell it."""

    def __repr__(self) -> str:
        return f"<Run: SIMULATED, {len(self.q)} poses, {int(self.measured.sum())} points of {', '.join(self.names)}>"

    def points(self, groups: Sequence[str] | NameArray | None = None) -> PointSet:
        """The targets that were seen, in the tracker's frame (references unused).

        Parameters
        ----------
        groups : sequence of str, length n, optional
        """
        xyz = self.xyz[:, : self.targets]
        pose, target = np.nonzero(np.isfinite(xyz).all(axis=2))
        n = len(self.q)
        labels = np.full(n, "", dtype=object) if groups is None else np.asarray(groups, dtype=object)
        names = self.names[: self.targets]
        found = PointSet(self.q, pose, target, xyz[pose, target], names, np.arange(1, n + 1), labels)
        return found.without_empty_poses().with_seen_targets()


@dataclass(frozen=True, eq=False)
class VirtualCell(Locked):
    """Robot, tool, tracker and effects."""

    arm: Arm
    """The nominal arm: what the controller believes."""
    table: DHMTable
    """The true geometry, without what effects add to it."""
    joint_map: JointMap
    """Gains, Fourier series; the stiffness follows from the payload, see `true_joint_map`."""
    bodies: Bodies
    """Link masses without payload."""
    tool: EndEffector
    tracker: Tracker
    references: dict[str, FloatArray]
    """Values of shape (3,). Places in the base link, metres."""
    effects: tuple[Effect, ...]
    """Those that are on."""
    compliance: tuple[float, ...]
    """rad/Nm of joints 1 to n: what the joint map's stiffness is derived from, whether the effect is on or off."""
    seed: int = 0
    """Of the run: noise, repeatability, lost points. The robot's own errors do not depend on it."""

    @property
    def on(self) -> tuple[str, ...]:
        """Names of the effects that are on."""
        return tuple(effect.name for effect in self.effects)

    def replace(self, **changes: Any) -> VirtualCell:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def only(self, *names: str) -> VirtualCell:
        """The cell with these of its effects alone; without names, with none."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name in names))

    def without(self, *names: str) -> VirtualCell:
        """The cell without these effects."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name not in names))

    def with_effect(self, effect: Effect) -> VirtualCell:
        """The cell with one effect's parameters changed, or the effect switched on."""
        check_names([effect.name])
        by_name = {effect.name: effect for effect in self.effects} | {effect.name: effect}
        return replace(
            self, effects=tuple(by_name[name] for name in (effect.name for effect in ALL) if name in by_name)
        )

    def also(self, *names: str) -> VirtualCell:
        """The cell with these of the effects switched on that shipped cells leave off."""
        check_names(names)
        cell = self
        for effect in MORE:
            if effect.name in names and effect.name not in cell.on:
                cell = cell.with_effect(effect().for_arm(self.arm.table.prismatic, size_of(self.arm)))
        return cell

    def with_payload(self, kilograms: float) -> VirtualCell:
        """The cell with another payload at the tool's centre of mass."""
        return replace(self, tool=replace(self.tool, payload_kg=float(kilograms)))

    def with_targets(self, names: Sequence[str]) -> VirtualCell:
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

    def bodies_with_payload(self) -> Bodies:
        """Masses with the payload."""
        tool = self.tool
        return self.bodies.with_payload(tool.payload_kg, tool.payload_centre, self.arm.T_last_tip)

    def true_arm(self) -> Arm:
        """The arm with its true geometry, effects included."""
        table = self.table
        for effect in self.effects:
            table = effect.table(table)
        return self.arm.with_table(table)

    def true_joint_map(self) -> JointMap:
        """The joint map with the two stiffness numbers that describe the arm's compliance best for this payload.

        They are fitted to what weight does to joints 2 and 3 in 500 random poses. Arms that the stiffness model does
        not describe (`Arm.stiffness_geometry`) have none: there only the effect ``compliance`` bends the arm.
        """
        try:
            phases = self.arm.stiffness_geometry()[0]
        except RobotError:
            return self.joint_map
        q = self.arm.random_joints(500, seed=0)
        bent = -torques(self.arm.with_table(self.table), self.bodies_with_payload(), q) * self.compliance
        upper, fore = basis_values(stiffness_of(self.arm, phases), Situation(self.arm, Motion(q)))
        M = np.concatenate([np.column_stack([upper, fore]), np.column_stack([0.0 * fore, fore])])
        stiffness = np.linalg.lstsq(M, np.concatenate([bent[:, 1], bent[:, 2]]), rcond=None)[0]
        return with_stiffness(self.joint_map, stiffness, phases)

    def _level_map(self) -> JointMap:
        """The joint map that acts: the two stiffness numbers stand in for the effect ``compliance`` where it is off."""
        return self.joint_map if "compliance" in self.on else self.true_joint_map()

    def measure(
        self,
        q: ArrayLike,
        measured: ArrayLike | None = None,
        wait_s: ArrayLike = WAIT_S,
        start: ArrayLike | None = None,
        run: int = 0,
    ) -> Run:
        """Move through poses and measure them.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded joints in the order of the run, radians (metres for prismatic joints).
        measured : ndarray of bool, shape (n, targets), optional
            Which targets are measured in each pose; all unless given. References are always measured.
        wait_s : float or ndarray, shape (n,)
            Seconds between stop and measurement.
        start : ndarray, shape (joints,), optional
            Where the robot comes from; zero joints unless given.
        run : int
            Runs of the same cell with other numbers have other random numbers.
        """
        joints: FloatArray = self.arm.check_joints(q)
        n, tool = len(joints), self.tool
        names = (*tool.names, *self.references)
        everything = np.ones((n, len(names)), dtype=bool)
        if measured is not None:
            everything[:, : len(tool.names)] = measured
        begin = np.zeros(joints.shape[1]) if start is None else np.asarray(start, dtype=float)
        waits = np.broadcast_to(np.asarray(wait_s, dtype=float), (n,))
        stopped, time_s = self._times(joints, begin, waits, everything)
        stops = Stops(
            joints,
            np.diff(joints, axis=0, prepend=begin[None]),
            directions(joints, begin),
            stopped,
            waits,
            self.arm.table.prismatic,
        )
        T = self._tips(stops, run)
        origins = _origins(self.true_arm(), joints)
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
        readings = self._readings(stops, run)
        return Run(joints, T, xyz, everything, names, len(tool.names), time_s, unseen, tool.payload_kg, readings)

    def _readings(self, stops: Stops, run: int) -> FloatArray | None:
        """The joints as the controller reads them; None where no effect changes them."""
        changes = [effect.readings(stops, self._stream(effect, run)) for effect in self.effects]
        lags = [change for change in changes if change is not None]
        return stops.q + sum(lags) if lags else None

    def _tips(self, stops: Stops, run: int) -> FloatArray:
        """Where the tip really stands, shape (n, 4, 4): the sum of the effects' terms, and what no model knows."""
        arm, q = self.true_arm(), stops.q
        amounts = [amount for effect in self.effects for amount in effect.terms(arm, self.bodies_with_payload())]
        terms = TermMap(arm, tuple(term for term, _ in amounts), np.array([value for _, value in amounts]))
        effective, xi = terms.split(Motion(q, stops.move, stops.time_s / MINUTE))
        theta = self._level_map().effective(q) + (effective - q)
        for effect in self.effects:
            change = effect.joints(stops, self._stream(effect, run))
            theta = theta if change is None else theta + change
        return chain.poses(chain.walk(arm, theta, xi)) if terms.has_frame_terms else arm.forward(theta)

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
        effect = next((effect for effect in self.effects if isinstance(effect, VisibilityEffect)), None)
        k = len(self.tool.names)
        if effect is None:
            return np.ones((len(q), k), dtype=bool)
        shot = self._shot(self.arm.forward(q), _origins(self.arm, q), np.zeros((len(q), k + len(self.references))))
        return ~effect.unseen(shot, self._stream(effect, 0))[:, :k]

    def _shot(self, T: FloatArray, origins: FloatArray, time_s: FloatArray) -> Shot:
        R, p = T[:, :3, :3], T[:, None, :3, 3]
        targets = self.tool.real @ np.swapaxes(R, 1, 2) + p
        fixed = np.array(list(self.references.values())).reshape(-1, 3)
        xyz = np.concatenate([targets, np.broadcast_to(fixed, (len(T), *fixed.shape))], axis=1)
        return Shot(xyz, self.tool.direction @ np.swapaxes(R, 1, 2), origins, time_s, self.tracker.position)

    def _times(
        self, q: FloatArray, start: FloatArray, wait_s: FloatArray, measured: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """When the robot stopped at each pose (n,), and when each point was measured (n, k), seconds."""
        speed = np.where(self.arm.table.prismatic, SLIDING_SPEED, SPEED)
        move = (np.abs(np.diff(q, axis=0, prepend=start[None])) / speed).max(axis=1)
        points = SECONDS_PER_POINT * np.cumsum(measured, axis=1)
        end = np.cumsum(move + wait_s + points[:, -1])
        stopped = end - points[:, -1] - wait_s
        return stopped, (stopped + wait_s)[:, None] + points

    def _stream(self, effect: Effect, run: int) -> np.random.Generator:
        """Random numbers of an effect: they depend on its name, the seed and the run, on no other effect."""
        return np.random.default_rng(
            np.random.SeedSequence(self.seed, spawn_key=(zlib.crc32(effect.name.encode()), run))
        )

    def terms(self) -> dict[str, tuple[Term, float]]:
        """What the robot does, in the terms of the error model: name -> term and coefficient, constants among them.

        Time is in minutes. The cell sums these very terms, those of effects with the attitudes of the true arm. What no
        model knows is not in it: repeatability, settling, backlash that remembers its side.
        """
        nominal, arm, level = self.arm.table, self.true_arm(), self._level_map().terms
        errors = {axis: getattr(arm.table, name) - getattr(nominal, name) for axis, name in DHM_COLUMNS.items()}
        amounts = [
            (Term(int(j), axis, "constant", 1.0, "geometry", "geometry", "rad" if axis[0] == "r" else "m"), value[j])
            for axis, value in errors.items()
            for j in np.flatnonzero(value)
        ]
        amounts += zip(level.terms, level.coefficients, strict=True)
        bodies = self.bodies_with_payload()
        return merged([*amounts, *(amount for effect in self.effects for amount in effect.terms(arm, bodies))])

    def truth(self) -> dict[str, Any]:
        """All that the cell hides, in millimetres and degrees (terms in SI units and minutes), ready for JSON."""
        nominal, table, joint_map = self.arm.table, self.true_arm().table, self.true_joint_map().terms
        tool, bodies = self.tool, self.bodies
        parameters = dict(zip(_BASE, frames.to_xyz_angles(self.tracker.T_tracker_base) / _BASE_UNITS, strict=True))
        for name, xyz in zip(tool.names, tool.real, strict=True):
            parameters |= {f"target_{name}_{axis}": value / MM for axis, value in zip("xyz", xyz, strict=True)}
        for name, unit in _COLUMNS.items():
            error = (getattr(table, name) - getattr(nominal, name)) / unit
            parameters |= {f"delta_{name}{j + 1}": error[j] for j in np.flatnonzero(error)}
        for term, value in zip(joint_map.terms, joint_map.coefficients, strict=True):
            parameters |= {name_of(term): value / UNIT_OUTSIDE[term.unit][1]} if value else {}
        return {
            "parameters": {name: _rounded(value) for name, value in parameters.items()},
            "dhm": {name: _rounded(getattr(table, name) / unit) for name, unit in _COLUMNS.items()},
            "targets_cad": dict(zip(tool.names, _rounded(tool.cad / MM), strict=True)),
            "targets_look_along": dict(zip(tool.names, _rounded(tool.direction), strict=True)),
            "references_in_base": {name: _rounded(xyz / MM) for name, xyz in self.references.items()},
            "payload_kg": tool.payload_kg,
            "payload_centre": _rounded(np.asarray(tool.payload_centre) / MM),
            "link_masses_kg": _rounded(bodies.mass),
            "link_centres_in_dhm_frames": _rounded(bodies.centre / MM),
            "effects": {effect.name: effect.parameters() for effect in self.effects},
            "terms": {name: float(f"{value:.9g}") for name, (_, value) in self.terms().items() if value},
            "seed": self.seed,
        }


def merged(amounts: Iterable[tuple[Term, float]]) -> dict[str, tuple[Term, float]]:
    """Terms with coefficients by the terms' names, those of one name added up."""
    out: dict[str, tuple[Term, float]] = {}
    for term, value in amounts:
        out[term.name] = (term, float(value) + (out[term.name][1] if term.name in out else 0.0))
    return out


def _origins(arm: Arm, q: FloatArray) -> FloatArray:
    """Origins of the base link and of the DHM frames in the base link, shape (n, joints + 1, 3), metres."""
    out = np.zeros((len(q), q.shape[1] + 1, 3))
    for start in range(0, len(q), dhm.BLOCK):
        block = slice(start, start + dhm.BLOCK)
        angles = np.ascontiguousarray(q[block].T) + arm.table.offsets[:, None]
        out[block, 1:] = dhm.chain_frames(arm.table, angles, arm.T_base_0).o.transpose(2, 0, 1)
    return out


def _rounded(values: ArrayLike) -> Any:
    """Numbers for JSON without the noise of unit conversions."""
    return np.round(np.asarray(values, dtype=float), 9).tolist()


def directions(q: FloatArray, start: FloatArray) -> FloatArray:
    """Sign of each joint's last change, shape (n, joints); +1 for joints that have not moved yet."""
    change = np.sign(np.diff(q, axis=0, prepend=start[None]))
    change = np.vstack([np.ones(q.shape[1]), change])
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change))[:, None], 0), axis=0)
    return np.take_along_axis(change, last, axis=0)[1:]
