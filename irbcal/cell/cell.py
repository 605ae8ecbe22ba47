"""The virtual cell: a robot that errs, a tool with reflectors and a laser tracker, measured like the real ones.

The true robot has geometric errors of all links, a joint map (arm stiffness, joint-6 Fourier series) and effects that
no level of the models contains (`irbcal.cell.effects`), each of which can be switched off. A run takes
commanded joints in their order, for the order decides where each joint came from and what time it is, and gives the
points in the tracker's frame. Nothing here is read by the identification.

The setting for the IRB 1600 is tuned on Nubiola 2011, Table 7.1, by ``scripts/tune_cell``. Other arms get errors drawn
from a seed, in the same sizes.
"""

import zlib
from dataclasses import dataclass, replace

import numpy as np

from irbcal.cell import effects as effects_module
from irbcal.cell.effects import EFFECTS, Motion, Shot, check_names
from irbcal.cell.gravity import Bodies, torques_and_origins
from irbcal.cell.tool import PAYLOAD_KG, EndEffector, Tracker, thesis_tool
from irbcal.errors import MeasurementError, RobotError
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.joint_map import JointMap, stiffness_terms
from irbcal.modeling.parameters import FOURIER as FOURIER_NAMES
from irbcal.units import DEG, MM

ROBOT_SEED = 1600
"""Seed of the shipped robot's errors."""

TUNED_ARM = "irb1600_6_145"

LINK_ERRORS = {
    "alpha": ((0.0000, -0.0060, -0.0090, 0.0143, 0.0029, 0.0106), DEG),
    "a": ((0.0000, 0.0875, -0.1163, -0.0085, -0.0233, -0.1524), MM),
    "theta": ((0.0000, 0.0353, -0.0618, 0.0023, -0.0386, -0.0183), DEG),
    "d": ((0.0000, 0.0000, -0.0144, 0.2100, -0.0060, -0.2897), MM),
}
"""Errors of joints 1 to 6 of the shipped IRB 1600, degrees and millimetres; joint 1 is part of the base.

Made by ``scripts/tune_cell``: drawn in the sizes of `SIZES`, then moved until the nominal errors match Table 7.1.
"""

SIZES = {"alpha": 0.015 * DEG, "a": 0.15 * MM, "theta": 0.04 * DEG, "d": 0.15 * MM}
"""Standard deviations of the link errors of an arm as large as the IRB 1600: machining, and mastering for theta."""

FOURIER = (-0.000373, -0.000750, -0.000956, -0.000244)
"""a1, b1, a2, b2 of joint 6 (Nubiola 2011, Table 5.2), radians."""

SIZE = 2.0015
"""Sum of the IRB 1600's nominal lengths, metres: the measure of `size_of`."""

T_TRACKER_BASE = frames.from_xyz_angles([2.2400, 0.3671, -1.4795, -0.036 * DEG, -0.717 * DEG, 142.917 * DEG])
"""Where the thesis's robot stood in its tracker's frame: Table A III-1 fitted to the poses of Table A I-1 with target 1
(rms 0.7 mm)."""

REFERENCES = {
    "ref1": (750.0, 1000.0, 0.0),
    "ref2": (950.0, -850.0, 0.0),
    "ref3": (-750.0, 950.0, 0.0),
    "ref4": (-550.0, -900.0, 250.0),
}
"""Reflectors on the floor around the IRB 1600, in the base link, mm."""

SPEED = 60.0 * DEG
"""Speed of the slowest joint of a move, radians per second: about 500 mm/s at the tool."""
SLIDING_SPEED = 0.5
"""The same for prismatic joints, metres per second."""
SECONDS_PER_POINT = 2.5
"""Time that the tracker needs for a point: turning, finding, 0.5 s of readings."""
WAIT_S = 4.0
"""Seconds between stop and measurement (Nubiola 2011, section 7.1)."""


@dataclass(frozen=True, eq=False)
class Run:
    """One measuring run as the tracker saw it.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    T_base_tip : ndarray, shape (n, 4, 4)
        Where the tip really was: the truth.
    xyz : ndarray, shape (n, k, 3)
        Targets, then references, in the tracker's frame, metres; NaN where lost or not asked for.
    asked : ndarray of bool, shape (n, k)
    names : tuple of str, length k
    targets : int
        How many of the names are targets on the tool.
    time_s : ndarray, shape (n, k)
        When each point was measured, from the start of the run.
    unseen : dict of str to int
        How many of the points asked for were lost to each effect.
    payload_kg : float
    """

    q: np.ndarray
    T_base_tip: np.ndarray
    xyz: np.ndarray
    asked: np.ndarray
    names: tuple
    targets: int
    time_s: np.ndarray
    unseen: dict
    payload_kg: float

    def points(self, groups=None):
        """The targets that were seen, in the tracker's frame (references unused).

        Parameters
        ----------
        groups : sequence of str, length n, optional

        Returns
        -------
        PointSet
        """
        xyz = self.xyz[:, : self.targets]
        pose, target = np.nonzero(np.isfinite(xyz).all(axis=2))
        n = len(self.q)
        groups = np.full(n, "", dtype=object) if groups is None else np.asarray(groups, dtype=object)
        names = self.names[: self.targets]
        found = PointSet(self.q, pose, target, xyz[pose, target], names, np.arange(1, n + 1), groups)
        return found.without_empty_poses().with_seen_targets()


@dataclass(frozen=True, eq=False)
class Cell:
    """Robot, tool, tracker and effects.

    Parameters
    ----------
    arm : Arm
        The nominal arm: what the controller believes.
    table : DHMTable
        The true geometry, without what effects add to it.
    joint_map : JointMap
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
    joint_map: JointMap
    bodies: Bodies
    tool: EndEffector
    tracker: Tracker
    references: dict
    effects: tuple
    compliance: tuple
    seed: int = 0

    @property
    def on(self):
        """Names of the effects that are on."""
        return tuple(effect.name for effect in self.effects)

    def replace(self, **changes):
        """A copy with some fields changed."""
        return replace(self, **changes)

    def only(self, *names):
        """The cell with these of its effects alone; without names, with none."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name in names))

    def without(self, *names):
        """The cell without these effects."""
        check_names(names)
        return replace(self, effects=tuple(effect for effect in self.effects if effect.name not in names))

    def with_effect(self, effect):
        """The cell with one effect's parameters changed, or the effect switched on."""
        check_names([effect.name])
        others = {item.name: item for item in self.effects} | {effect.name: effect}
        return replace(self, effects=tuple(others[name] for name in effects_module.NAMES if name in others))

    def with_payload(self, kilograms):
        """The cell with another payload at the tool's centre of mass."""
        return replace(self, tool=replace(self.tool, payload_kg=float(kilograms)))

    def with_targets(self, names):
        """The cell measured at these targets of its tool.

        Raises
        ------
        MeasurementError
            If the tool has no such target.
        """
        unknown = [name for name in names if name not in self.tool.names]
        if unknown:
            raise MeasurementError(f"unknown target {unknown[0]!r}: targets are {', '.join(self.tool.names)}")
        return replace(self, tool=self.tool.only(names))

    def loaded(self):
        """Masses with the payload."""
        tool = self.tool
        return self.bodies.with_payload(tool.payload_kg, tool.payload_centre, self.arm.T_last_tip)

    def true_arm(self):
        """The arm with its true geometry, effects included."""
        table = self.table
        for effect in self.effects:
            table = effect.table(table)
        return self.arm.with_table(table)

    def true_joint_map(self):
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

    def measure(self, q, asked=None, wait_s=WAIT_S, start=None, run=0):
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
        q = self.arm.check_joints(q)
        n, tool = len(q), self.tool
        names = (*tool.names, *self.references)
        everything = np.ones((n, len(names)), dtype=bool)
        if asked is not None:
            everything[:, : len(tool.names)] = asked
        start = np.zeros(q.shape[1]) if start is None else np.asarray(start, dtype=float)
        wait_s = np.broadcast_to(np.asarray(wait_s, dtype=float), n)
        stopped, time_s = self._times(q, start, wait_s, everything)
        arm, joint_map = self.true_arm(), self.true_joint_map()
        torque, origins = torques_and_origins(arm, self.loaded(), q)
        theta = joint_map.effective(q)
        stiffness = theta - replace(joint_map, stiffness=(0.0, 0.0)).effective(q)
        motion = Motion(q, directions(q, start), stopped, wait_s, torque, stiffness, arm.table.prismatic)
        for effect in self.effects:
            change = effect.joints(motion, self._stream(effect, run))
            theta = theta if change is None else theta + change
        T = arm.forward(theta)
        for effect in self.effects:
            T = effect.tips(T, motion)
        shot = self._shot(T, origins, time_s)
        xyz = frames.apply(self.tracker.T_tracker_base, shot.xyz)
        lost, unseen = ~everything, {}
        for effect in self.effects:
            xyz = effect.points(xyz, shot, self._stream(effect, run))
            mask = effect.unseen(shot, self._stream(effect, run))
            if mask is not None:
                unseen[effect.name] = int((mask & ~lost).sum())
                lost = lost | mask
        xyz[lost] = np.nan
        return Run(q, T, xyz, everything, names, len(tool.names), time_s, unseen, tool.payload_kg)

    def visible(self, q):
        """Which targets the tracker sees with the effect ``visibility`` alone, as far as the nominal robot tells.

        Parameters
        ----------
        q : ndarray, shape (n, joints)

        Returns
        -------
        ndarray of bool, shape (n, targets)
            True everywhere where the effect is off.
        """
        effect = next((item for item in self.effects if item.name == "visibility"), None)
        k = len(self.tool.names)
        if effect is None:
            return np.ones((len(q), k), dtype=bool)
        _, origins = torques_and_origins(self.arm, self.bodies, q)
        shot = self._shot(self.arm.forward(q), origins, np.zeros((len(q), k + len(self.references))))
        return ~effect.unseen(shot, None)[:, :k]

    def _shot(self, T, origins, time_s):
        R, p = T[:, :3, :3], T[:, None, :3, 3]
        targets = self.tool.real @ np.swapaxes(R, 1, 2) + p
        fixed = np.array(list(self.references.values())).reshape(-1, 3)
        xyz = np.concatenate([targets, np.broadcast_to(fixed, (len(T), *fixed.shape))], axis=1)
        return Shot(xyz, self.tool.direction @ np.swapaxes(R, 1, 2), origins, time_s, self.tracker.place)

    def _times(self, q, start, wait_s, asked):
        """When the robot stopped at each pose (n,), and when each point was measured (n, k), seconds."""
        speed = np.where(self.arm.table.prismatic, SLIDING_SPEED, SPEED)
        move = (np.abs(np.diff(q, axis=0, prepend=start[None])) / speed).max(axis=1)
        points = SECONDS_PER_POINT * np.cumsum(asked, axis=1)
        end = np.cumsum(move + wait_s + points[:, -1])
        stopped = end - points[:, -1] - wait_s
        return stopped, (stopped + wait_s)[:, None] + points

    def _stream(self, effect, run):
        """Random numbers of an effect: they depend on its name, the seed and the run, on no other effect."""
        return np.random.default_rng(
            np.random.SeedSequence(self.seed, spawn_key=(zlib.crc32(effect.name.encode()), run))
        )

    def truth(self):
        """All that the cell hides, in millimetres and degrees, ready for JSON."""
        joint_map, tool = self.true_joint_map(), self.tool
        nominal, table = self.arm.table, self.true_arm().table
        parameters = dict(zip(_BASE, frames.to_xyz_angles(self.tracker.T_tracker_base) / _BASE_UNITS, strict=True))
        for name, place in zip(tool.names, tool.real, strict=True):
            parameters |= {f"target_{name}_{axis}": value / MM for axis, value in zip("xyz", place, strict=True)}
        for name, unit in _COLUMNS.items():
            error = (getattr(table, name) - getattr(nominal, name)) / unit
            parameters |= {f"delta_{name}{j + 1}": error[j] for j in np.flatnonzero(error)}
        parameters |= {f"gain{j + 1}": joint_map.gain[j] for j in np.flatnonzero(joint_map.gain)}
        parameters |= {f"stiffness_{name}": v / DEG for name, v in zip("AB", joint_map.stiffness, strict=True)}
        parameters |= {f"fourier_{name}": v / DEG for name, v in zip(FOURIER_NAMES, joint_map.fourier, strict=True)}
        return {
            "parameters": {name: _rounded(value) for name, value in parameters.items()},
            "dhm": {name: _rounded(getattr(table, name) / unit) for name, unit in _COLUMNS.items()},
            "targets_cad": dict(zip(tool.names, _rounded(tool.cad / MM), strict=True)),
            "targets_look_along": dict(zip(tool.names, _rounded(tool.direction), strict=True)),
            "references_in_base": {name: _rounded(place / MM) for name, place in self.references.items()},
            "payload_kg": tool.payload_kg,
            "payload_centre": _rounded(np.asarray(tool.payload_centre) / MM),
            "link_masses_kg": _rounded(self.bodies.mass),
            "link_centres_in_dhm_frames": _rounded(self.bodies.centre / MM),
            "effects": {effect.name: effect.parameters() for effect in self.effects},
            "seed": self.seed,
        }


_BASE = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
_BASE_UNITS = np.array([MM, MM, MM, DEG, DEG, DEG])
_COLUMNS = {"alpha": DEG, "a": MM, "theta": DEG, "d": MM, "beta": DEG, "b": MM}


def _rounded(values):
    """Numbers for JSON without the noise of unit conversions."""
    return np.round(np.asarray(values, dtype=float), 9).tolist()


def _phases(arm):
    """Phases of the stiffness model; None for arms that it does not describe."""
    try:
        return arm.stiffness_geometry()[0]
    except RobotError:
        return None


def directions(q, start):
    """Sign of each joint's last change, shape (n, joints); +1 for joints that have not moved yet."""
    change = np.sign(np.diff(q, axis=0, prepend=start[None]))
    change = np.vstack([np.ones(q.shape[1]), change])
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change))[:, None], 0), axis=0)
    return np.take_along_axis(change, last, axis=0)[1:]


def size_of(arm):
    """Sum of an arm's nominal lengths against that of the IRB 1600."""
    return float((np.abs(arm.table.a) + np.where(arm.table.prismatic, 0.0, np.abs(arm.table.d))).sum() / SIZE)


def shipped_cell(arm, bodies, seed=0, robot_seed=ROBOT_SEED):
    """The virtual cell with all effects on.

    Parameters
    ----------
    arm : Arm
        Nominal. The IRB 1600 gets the tuned errors, other arms and other seeds drawn ones.
    bodies : Bodies
        Link masses.
    seed : int
        Of the run.
    robot_seed : int
        Of the robot's own errors.

    Returns
    -------
    Cell
    """
    size = size_of(arm)
    tuned = arm.name == TUNED_ARM and robot_seed == ROBOT_SEED and arm.six_revolute
    errors = {k: np.array(v) * unit for k, (v, unit) in LINK_ERRORS.items()} if tuned else None
    table = with_errors(arm, drawn_errors(arm, robot_seed, size) if errors is None else errors)
    parts = tuple(effect().for_arm(arm.table.prismatic, size) for effect in EFFECTS)
    compliance = next(part for part in parts if part.name == "compliance").rad_per_Nm
    T = np.array(T_TRACKER_BASE)
    T[:3, 3] *= size
    tracker = Tracker(T)
    home = arm.forward(np.zeros((1, len(arm.joint_names))))[0]
    look = home[:3, :3].T @ (tracker.place - home[:3, 3])
    fourier = FOURIER if arm.six_revolute else np.zeros(4)
    return Cell(
        arm,
        table,
        JointMap(np.zeros(len(arm.joint_names)), fourier=fourier),
        bodies,
        thesis_tool(look, size, round(PAYLOAD_KG * size**3, 2)),
        tracker,
        {name: size * MM * np.array(place) for name, place in REFERENCES.items()},
        parts,
        compliance,
        seed,
    )


def drawn_errors(arm, seed, size=1.0):
    """Random link errors in the sizes of `SIZES`; link 1 has none, it is part of the base.

    Returns
    -------
    dict of str to ndarray, shape (joints,)
        Columns of the DHM table, radians and metres.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(b"geometry"),)))
    free = np.arange(len(arm.joint_names)) > 0
    scale = {name: value * (size if name in ("a", "d") else 1.0) for name, value in SIZES.items()}
    return {name: value * free * rng.standard_normal(len(free)) for name, value in scale.items()}


def with_errors(arm, errors):
    """The nominal table with errors added to its columns."""
    return replace(arm.table, **{name: getattr(arm.table, name) + value for name, value in errors.items()})
