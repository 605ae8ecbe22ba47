"""The effects of the virtual cell: each is a small class that can be switched off.

What the error model knows (`irbcal.modeling.terms`), an effect gives as terms with coefficients; the cell sums them.
Beside them stand the effects that no model knows: repeatability, settling, backlash that remembers its side, readings
that lag, and the tracker's own. Parameters carry their units in their names (mm and degrees: they go into the truth's
file as they are). Sizes of the shipped setting come from Nubiola 2011 where it has them; where it has none they are
chosen so that its other statements hold, and the docstring says which.

Random numbers of an effect come from a stream of its own, so that switching one effect off leaves the others' as they
were.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.errors import MeasurementError
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms import families
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.term import AXES, Term
from irbcal.simulation.instruments import behind_arm, turned_away
from irbcal.simulation.weights import Amounts, Bodies, frame_rotations, weight_terms
from irbcal.units import DEG, HOUR, MM, joint_unit

SIZE = 2.0015
"""Sum of the IRB 1600's nominal lengths, metres: the measure of `size_of`."""

GAMMA_2_MEDIAN = 1.6783
"""Median of the gamma distribution of shape 2 and scale 1."""


@dataclass(frozen=True, eq=False)
class Stops(Locked):
    """The stops of a run, a row a pose, in the order of the run."""

    q: FloatArray
    move: FloatArray
    """Shape (n, joints). Commanded joints, radians (metres for prismatic joints), and those minus the joints of the
    stop before.
    """
    direction: FloatArray
    """Shape (n, joints). Sign of each joint's last change: +1 reached from below, -1 from above."""
    time_s: FloatArray
    wait_s: FloatArray
    """Shape (n,). When the robot stopped, from the start of the run, and how long it stood before it was measured."""
    prismatic: BoolArray
    """Shape (joints,)."""

    @property
    def units(self) -> FloatArray:
        """SI value of one degree or, for prismatic joints, one millimetre, shape (joints,)."""
        return np.array([joint_unit(slides)[1] for slides in self.prismatic])


@dataclass(frozen=True, eq=False)
class Shot:
    """What the tracker is pointed at.

    Its arrays are not locked: the search for poses in sight makes one for every block of candidates.
    """

    xyz: FloatArray
    """Shape (n, k, 3). True places of targets, then references, in the base link, metres."""
    direction: FloatArray
    """Shape (n, targets, 3). Where the targets look, unit vectors in the base link."""
    origins: FloatArray
    """Shape (n, joints + 1, 3). Of the base link and the joints, in the base link, metres."""
    time_s: FloatArray
    """Shape (n, k)."""
    tracker_position: FloatArray
    """Shape (3,). The tracker in the base link, metres."""


@dataclass(frozen=True)
class Effect:
    """One part of the cell that can be switched off."""

    name: ClassVar[str]
    summary: ClassVar[str]
    of_joints: ClassVar[Mapping[str, float]] = {}
    """Names of what has values of joints 1 to n, and the value of prismatic joints."""

    def table(self, table: DHMTable) -> DHMTable:
        """The true DHM table."""
        return table

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """What the effect is in the terms of the error model, which the cell sums; time in minutes.

        Parameters
        ----------
        arm : Arm
            With its true geometry.
        bodies : Bodies
            With the payload.
        """
        return []

    def joints(self, stops: Stops, rng: np.random.Generator) -> FloatArray | None:
        """What is added to the effective joints, shape (n, joints); None for nothing."""
        return None

    def readings(self, stops: Stops, rng: np.random.Generator) -> FloatArray | None:
        """What is added to the commanded joints in the controller's readings, shape (n, joints); None for nothing."""
        return None

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """Measured points in the tracker's frame, shape (n, k, 3), metres."""
        return xyz

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray | None:
        """Mask (n, k) of the points without a position; None for none."""
        return None

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """The same effect for another arm; see `fitted`."""
        # torques grow as the fourth power of the size, deflections in degrees stay
        weights = {name: size**4 if name.endswith("per_Nm") else 1.0 for name in self.of_joints}
        values = {name: (np.array(getattr(self, name)) / weight).tolist() for name, weight in weights.items()}
        return replace(self, **{name: fitted(values[name], prismatic, at) for name, at in self.of_joints.items()})

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
    """
    turning = int((~prismatic).sum())
    head = [values[min(k, 2)] for k in range(max(turning - 3, 0))]
    turning_values = iter([*head, *values[6 - (turning - len(head)) :]])
    return tuple(sliding if slides else next(turning_values) for slides in prismatic)


def size_of(arm: Arm) -> float:
    """Sum of an arm's nominal lengths against that of the IRB 1600."""
    return float((np.abs(arm.table.a) + np.where(arm.table.prismatic, 0.0, np.abs(arm.table.d))).sum() / SIZE)


def _unit(axis: str) -> str:
    return "rad" if axis[0] == "r" else "m"


def _waves(arm: Arm, waves: Iterable[Sequence[Any]], family: str) -> Amounts:
    """Sines of joints' angles as cosine and sine terms.

    Parameters
    ----------
    arm : Arm
    waves : iterable of (int, str, int, float, float)
        Joint (from 1; from the last one as -1, -2, ...), axis, periods a turn, amplitude in degrees (millimetres for
        shifts) and phase in degrees. Waves of joints that the arm has not are left out.
    family : str
    """
    turning = np.flatnonzero(~arm.table.prismatic)
    out: Amounts = []
    for joint, axis, periods, size, phase in waves:
        if abs(joint) <= len(turning):
            j = int(turning[joint - 1 if joint > 0 else joint])
            cos, sin = pair(j, periods, axis, 1.0, family, family, _unit(axis))
            amplitude = size * (DEG if axis[0] == "r" else MM)
            out += [(cos, float(amplitude * np.sin(phase * DEG))), (sin, float(amplitude * np.cos(phase * DEG)))]
    return out


def _decays(turns: FloatArray, shifts: FloatArray, tau_min: float) -> Amounts:
    """Drifts of the joints' frames at the start, shape (joints, 3) each, radians and metres."""
    start = np.concatenate([turns, shifts], axis=1)
    return [
        (
            Term(int(j), AXES[k], "decay", 1.0, "warm_up", "warm_up", _unit(AXES[k]), {"tau": tau_min}),
            float(start[j, k]),
        )
        for j, k in zip(*np.nonzero(start), strict=True)
    ]


_DRIFTS = ("x_deg", "y_deg", "z_deg", "x_mm", "y_mm", "z_mm")


@dataclass(frozen=True)
class TiltEffect(Effect):
    """Axes that should be parallel are not (Nubiola 2011, section 3.1.3).

    Levels 26 and 34 have no parameter for it: theirs (``alpha``) tilts about the common normal only, Hayati's ``beta``
    across it. The size is that of the other angles between axes.
    """

    name: ClassVar[str] = "tilt"
    summary: ClassVar[str] = "axes that should be parallel are tilted across their common normal (section 3.1.3)"
    of_joints: ClassVar[Mapping[str, float]] = {"beta_deg": 0.0}
    beta_deg: tuple[float, ...] = (0.0, 0.0, 0.014, 0.0, 0.0, 0.0)
    """Tilt of each axis about the y axis of its frame, degrees; joints 1 to n."""

    def table(self, table: DHMTable) -> DHMTable:
        """The table with the tilts."""
        return replace(table, beta=table.beta + np.array(self.beta_deg) * DEG)


@dataclass(frozen=True)
class ComplianceEffect(Effect):
    """Every joint gives way under gravity: link masses of the URDF and payload (Nubiola 2011, section 4.3.1).

    It takes the place of the joint map's two numbers: joints 2 and 3 have compliances of their own, the payload hangs
    at the end of the wrist, and joints 4 to 6 give way as well. Compliances of joints 2 and 3 follow from Nubiola
    2011, Table 4.3:
    3 kg on the stretched arm make 0.3 mm, and the arm's own weight then makes about 2 mm. Those of the wrist are
    guesses: below 0.1 mm at the tool.
    """

    name: ClassVar[str] = "compliance"
    summary: ClassVar[str] = "every joint gives way under the links' and the payload's weight (section 4.3)"
    of_joints: ClassVar[Mapping[str, float]] = {"rad_per_Nm": 0.0}
    rad_per_Nm: tuple[float, ...] = (1.0e-6, 3.6e-6, 3.0e-6, 5.0e-5, 5.0e-5, 5.0e-5)
    """Compliance of joints 1 to n; prismatic joints have none."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return weight_terms(arm, bodies, {"rz": self.rad_per_Nm})


@dataclass(frozen=True)
class HarmonicsEffect(Effect):
    """Gears that run unevenly: a joint's error repeats some times a turn (Nubiola 2011, sections 4.1 and 4.2).

    The joint-6 series of the second order is in the 34-parameter model and not here. Joints 4 and 5 are driven
    through the forearm like joint 6, with one and two periods a turn; the others have shorter ones. Section 4.1 shows
    that joints 2 and 6 err most at the tool: the sizes here keep those of the other joints below 0.15 mm there.
    """

    name: ClassVar[str] = "harmonics"
    summary: ClassVar[str] = "uneven gears on joints 1 to 5, short waves on joint 6 (sections 4.1 and 4.2)"
    waves: tuple[tuple[int, int, float, float], ...] = (
        (1, 3, 0.0040, 35.0),
        (1, 7, 0.0030, 110.0),
        (2, 6, 0.0040, 250.0),
        (3, 5, 0.0050, 70.0),
        (-3, 1, 0.0350, 20.0),
        (-3, 2, 0.0250, 160.0),
        (-2, 2, 0.0250, 300.0),
        (-2, 5, 0.0150, 45.0),
        (-1, 4, 0.0100, 200.0),
    )
    """Joint (from 1; from the last one as -1, -2, ...), periods per turn, amplitude and phase in degrees."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return _waves(arm, ((joint, "rz", *wave) for joint, *wave in self.waves), self.name)


@dataclass(frozen=True)
class BacklashEffect(Effect):
    """A joint stops short on the side it came from (Nubiola 2011, section 4.2).

    0.05 degrees on joint 6 are measured there; the rest of the wrist is driven alike and gets less. Gravity loads the
    gears of joints 1 to 3, and Nubiola 2011, Table A I-3 (poses reached from all sides) leaves room for a few
    hundredths of a millimetre only.
    """

    name: ClassVar[str] = "backlash"
    summary: ClassVar[str] = "a joint stops short on the side it came from (section 4.2)"
    of_joints: ClassVar[Mapping[str, float]] = {"peak_to_peak_deg": 0.02}
    peak_to_peak_deg: tuple[float, ...] = (0.004, 0.002, 0.003, 0.030, 0.020, 0.050)
    """Joints 1 to n, degrees (millimetres for prismatic joints): reached from above minus reached from below."""

    def joints(self, stops: Stops, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return -stops.direction * np.array(self.peak_to_peak_deg) / 2 * stops.units


@dataclass(frozen=True)
class RepeatabilityEffect(Effect):
    """Every move ends a little elsewhere (Nubiola 2011, annex I).

    Nubiola 2011, Table A I-2 has 0.009 to 0.015 mm on average for poses reached from one side.
    """

    name: ClassVar[str] = "repeatability"
    summary: ClassVar[str] = "every move ends a little elsewhere (annex I)"
    of_joints: ClassVar[Mapping[str, float]] = {"sigma_deg": 0.005}
    sigma_deg: tuple[float, ...] = (0.00035, 0.00035, 0.00035, 0.0007, 0.0007, 0.0007)
    """Standard deviation of joints 1 to n, degrees (millimetres for prismatic joints)."""

    def joints(self, stops: Stops, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return rng.standard_normal(stops.q.shape) * np.array(self.sigma_deg) * stops.units


@dataclass(frozen=True)
class SettlingEffect(Effect):
    """The arm swings after a move and comes to rest (Nubiola 2011, annex V: after two seconds).

    Joints 1 to 3 overshoot in the direction of the move: ``amplitude exp(-t/tau) cos(2 pi f t)``, t since the stop.
    """

    name: ClassVar[str] = "settling"
    summary: ClassVar[str] = "the arm swings after a move; nothing is left after two seconds (annex V)"
    amplitude_deg: float = 0.012
    """At the moment of the stop: about 0.2 mm at arm's length."""
    tau_s: float = 0.4
    frequency_Hz: float = 8.0

    def joints(self, stops: Stops, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        t = stops.wait_s
        swing = self.amplitude_deg * DEG * np.exp(-t / self.tau_s) * np.cos(2 * np.pi * self.frequency_Hz * t)
        out = np.zeros_like(stops.q)
        first = np.flatnonzero(~stops.prismatic)[:3]
        out[:, first] = swing[:, None] * stops.direction[:, first]
        return out


@dataclass(frozen=True)
class WarmUpEffect(Effect):
    """The robot grows and bends while it warms up (Nubiola 2011, section 7.1: one hour before measuring).

    Against the warm robot, with ``w = exp(-(t + before)/tau)``: all lengths are shorter by ``growth w``, joints 2 and 3
    are off by ``joint_deg w``. What stands beside the last axis, and the travel of prismatic joints, does not grow. The
    size is a guess: 10 K of cast iron, 0.15 mm at arm's length from a cold start.
    """

    name: ClassVar[str] = "warm_up"
    summary: ClassVar[str] = "the robot grows and bends as it warms up, one hour into it (section 7.1)"
    before_min: float = 60.0
    """How long the robot had been moving before the run, minutes."""
    tau_min: float = 40.0
    growth: float = 1.0e-4
    """Relative growth of all lengths from cold to warm."""
    joint_deg: tuple[float, float] = (0.004, -0.006)
    """Of joints 2 and 3, degrees."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        table, T = arm.table, arm.T_base_0
        lengths = np.stack([table.a * np.cos(table.beta), table.b, table.d + table.a * np.sin(table.beta)], axis=1)
        lengths[0] += frame_rotations(arm)[0].T @ T[:3, :3].T @ T[:3, 3]
        lengths[-1, 2] += arm.T_last_tip[2, 3]
        turns = np.zeros_like(lengths)
        bending = np.flatnonzero(~table.prismatic)[1:3]
        turns[bending, 2] = np.array(self.joint_deg)[: len(bending)] * DEG
        start = float(np.exp(-self.before_min / self.tau_min))
        return _decays(start * turns, -start * self.growth * lengths, self.tau_min)


@dataclass(frozen=True)
class NoiseEffect(Effect):
    """Scatter of the tracker in range and angle.

    Standard deviations ``a + b r`` along the beam and in each direction across it, independent of one another.
    Nubiola 2011, Table A III-2 has 1 to 2 um for one reflector that stands still, chapter 4 a largest error of 22 um on
    a bar of 1 m: the setting lies between.
    """

    name: ClassVar[str] = "noise"
    summary: ClassVar[str] = "scatter of the tracker in range and angle (annex III)"
    range_um: float = 1.0
    range_um_per_m: float = 0.3
    across_um: float = 2.0
    across_um_per_m: float = 1.5

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """See `Effect.points`."""
        distance = np.linalg.norm(xyz, axis=-1, keepdims=True)
        beam = xyz / distance
        # a vector of three normal numbers, stretched along the beam
        scatter = rng.standard_normal(xyz.shape)
        along = np.sum(scatter * beam, axis=-1, keepdims=True) * beam
        sigma_along = 1e-6 * (self.range_um + self.range_um_per_m * distance)
        sigma_across = 1e-6 * (self.across_um + self.across_um_per_m * distance)
        return xyz + sigma_along * along + sigma_across * (scatter - along)


@dataclass(frozen=True)
class DriftEffect(Effect):
    """The tracker shifts and turns slowly over hours (Nubiola 2011, annex IV: 0.012 mm on average).

    Each of three shifts and three turns is a sine of a period and phase of its own. References on the floor take it
    out.
    """

    name: ClassVar[str] = "drift"
    summary: ClassVar[str] = "the tracker shifts and turns slowly over hours (annex IV)"
    shift_um: float = 8.0
    """Amplitude along each axis."""
    turn_urad: float = 4.0
    """Amplitude about each axis."""
    period_h: tuple[float, float] = (3.0, 12.0)
    """Shortest and longest period."""

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """See `Effect.points`."""
        period = rng.uniform(*self.period_h, 6) * HOUR
        phase = rng.uniform(0.0, 2 * np.pi, 6)
        waves = 1e-6 * np.sin(2 * np.pi * shot.time_s[..., None] / period + phase)
        return xyz + self.shift_um * waves[..., :3] + np.cross(self.turn_urad * waves[..., 3:], xyz)


@dataclass(frozen=True)
class VisibilityEffect(Effect):
    """A target that looks away from the tracker, or that the arm hides, is a lost point (Nubiola 2011, section 7.1).

    References on the floor are always seen.
    """

    name: ClassVar[str] = "visibility"
    summary: ClassVar[str] = "targets that look away or are hidden by the arm are lost (section 7.1)"
    acceptance_deg: float = 30.0
    """Largest angle between a reflector's direction and the beam."""
    link_radius_mm: float = 90.0
    """Of the arm's links between its joints, as seen by the beam."""

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray:
        """See `Effect.unseen`."""
        out = np.zeros(shot.xyz.shape[:2], dtype=bool)
        k = shot.direction.shape[1]
        targets = shot.xyz[:, :k]
        out[:, :k] = turned_away(targets, shot.direction, shot.tracker_position, self.acceptance_deg * DEG)
        visible = np.flatnonzero(~out[:, :k].all(axis=1))  # only these poses can still lose something
        radius = self.link_radius_mm * MM
        out[visible, :k] |= behind_arm(targets[visible], shot.origins[visible], shot.tracker_position, radius)
        return out

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, link_radius_mm=self.link_radius_mm * size)


@dataclass(frozen=True)
class LostEffect(Effect):
    """The tracker does not find a reflector (Nubiola 2011, section 7.7: 0.6 to 3.6 % of the points)."""

    name: ClassVar[str] = "lost"
    summary: ClassVar[str] = "now and then the tracker does not find a reflector (section 7.7)"
    share: float = 0.006
    """Of all points, targets and references."""

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray:
        """See `Effect.unseen`."""
        return rng.random(shot.xyz.shape[:2]) < self.share


@dataclass(frozen=True)
class ReadingLagEffect(Effect):
    """The controller reads its joints before the arm stands still (Nubiola 2011, annex V, waits for that).

    All joints' readings lag behind by the same share of the last move, another one for each pose; the arm itself ends
    where it would. Sizes are those of a measured IRB 120, which is not in the thesis: on the joint that moved most the
    lag is 0.041 degrees in the median, 0.02 to 0.07 in half of the poses (a gamma distribution of shape 2), with a
    scatter that the last move does not explain. Off in the shipped cells.
    """

    name: ClassVar[str] = "reading_lag"
    summary: ClassVar[str] = (
        "joint readings lag behind by a share of the last move (annex V waits); off if not asked for"
    )
    median_deg: float = 0.041
    """Lag of the joint that moved most, degrees (millimetres of a prismatic joint); never more than the whole move."""
    scatter_deg: float = 0.005
    """Standard deviation of each reading beside the lag, degrees (millimetres)."""

    def readings(self, stops: Stops, rng: np.random.Generator) -> FloatArray:
        """See `Effect.readings`."""
        move = stops.move / stops.units
        largest = np.abs(move).max(axis=1)
        lag = rng.gamma(2.0, self.median_deg / GAMMA_2_MEDIAN, len(move))
        share = np.minimum(lag / np.where(largest > 0.0, largest, np.inf), 1.0)
        scatter = self.scatter_deg * rng.standard_normal(move.shape)
        return (scatter - share[:, None] * move) * stops.units


@dataclass(frozen=True)
class BendingEffect(Effect):
    """Links and bearings bend: a joint's frame tilts about the two axes that the joint does not turn about.

    Beyond Nubiola 2011, whose section 4.3 lets joints give way about their own axes only. Sizes: up to 0.1 mrad on an
    arm of the IRB 1600's weight, as evidence shows it on a measured IRB 120. Off in the shipped cells.
    """

    name: ClassVar[str] = "bending"
    summary: ClassVar[str] = "frames tilt under weight, beside the joints of section 4.3; off if not asked for"
    of_joints: ClassVar[Mapping[str, float]] = {"x_rad_per_Nm": 0.0, "y_rad_per_Nm": 0.0}
    x_rad_per_Nm: tuple[float, ...] = (1.0e-7, 2.0e-7, 4.0e-7, 6.0e-6, 6.0e-6, 6.0e-6)
    y_rad_per_Nm: tuple[float, ...] = (2.0e-7, 1.0e-7, 3.0e-7, 8.0e-6, 4.0e-6, 6.0e-6)
    """Compliance of joints 1 to n about x and y of their frames (before they turn); prismatic joints have none."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return weight_terms(arm, bodies, {"rx": self.x_rad_per_Nm, "ry": self.y_rad_per_Nm})


@dataclass(frozen=True)
class GearEffect(Effect):
    """Harmonic drives swing a joint twice with every turn of their input.

    Not in Nubiola 2011, whose section 4.1 stops at a few periods a turn. On a measured IRB 120, waves of 100, 200, 240
    and 242 periods a turn were found (ratios of 50, 100, 120 and 121), of about 0.003 degrees. Off in shipped cells.
    """

    name: ClassVar[str] = "gear"
    summary: ClassVar[str] = (
        "harmonic drives swing a joint twice with every input turn, beyond section 4.1; off if not asked for"
    )
    waves: tuple[tuple[int, int, float, float], ...] = ((-3, 121, 0.0031, 40.0), (-2, 100, 0.0028, 200.0))
    """Joint (from 1; from the last one as -1, -2, ...), gear ratio, amplitude and phase in degrees."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        waves = ((joint, "rz", 2 * ratio, *wave) for joint, ratio, *wave in self.waves)
        return _waves(arm, waves, self.name)


@dataclass(frozen=True)
class WobbleEffect(Effect):
    """A joint's axis tilts and shifts as it turns: its bearing runs out, once and twice a turn.

    Not in Nubiola 2011, whose section 3.1.1 finds each axis from circles that it takes for perfect. Sizes are those
    that evidence shows on a measured IRB 120: about 0.05 mrad and 0.02 mm. Off in the shipped cells.
    """

    name: ClassVar[str] = "wobble"
    summary: ClassVar[str] = (
        "bearings run out: axes tilt and shift as they turn, no perfect circles as in section 3.1; off if not asked for"
    )
    waves: tuple[tuple[int, str, int, float, float], ...] = (
        (1, "rx", 1, 0.0030, 30.0),
        (1, "ty", 2, 0.0150, 80.0),
        (2, "rx", 1, 0.0020, 200.0),
        (3, "tz", 1, 0.0200, 10.0),
        (-3, "rx", 1, 0.0040, 130.0),
        (-3, "ry", 2, 0.0030, 250.0),
        (-2, "tx", 1, 0.0200, 300.0),
        (-1, "ry", 1, 0.0040, 60.0),
    )
    """Joint (from 1; from the last one as -1, -2, ...), axis of its frame before it turns (``rx``, ``ry``, ``tx``,
    ``ty``, ``tz``), periods per turn, amplitude in degrees (millimetres for shifts) and phase in degrees.
    """

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return _waves(arm, self.waves, self.name)


@dataclass(frozen=True)
class DirectionEffect(Effect):
    """A joint stops elsewhere when it comes from the other side, and small moves take up a part of that only.

    Beside `BacklashEffect` (Nubiola 2011, section 4.2), which knows sides only: ``size tanh(D / 0.5 degrees)`` with
    ``D`` the joint's last move. Sizes are those that evidence shows on a measured IRB 120. Off in the shipped cells.
    """

    name: ClassVar[str] = "direction"
    summary: ClassVar[str] = "as the backlash of section 4.2, less after small moves; off if not asked for"
    of_joints: ClassVar[Mapping[str, float]] = {"size_deg": 0.02}
    size_deg: tuple[float, ...] = (-0.004, -0.003, 0.004, -0.006, -0.005, -0.008)
    """Joints 1 to n, degrees (millimetres for prismatic joints): what a long move from below adds."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        size = np.array(self.size_deg) * arm.joint_units
        return list(zip(families()["direction"].terms(arm), size.tolist(), strict=True))


@dataclass(frozen=True)
class MoveEffect(Effect):
    """Where a joint stops depends on how far it came: a share of its move, and its share of the largest move.

    Not in Nubiola 2011, which waits two seconds (annex V) and finds nothing left of the way. Sizes are those that
    evidence shows on a measured IRB 120. Off in the shipped cells.
    """

    name: ClassVar[str] = "move"
    summary: ClassVar[str] = "joints stop short in proportion to the move, whatever annex V waits; off if not asked for"
    of_joints: ClassVar[Mapping[str, float]] = {"size_deg": 0.02, "share": 5e-5}
    size_deg: tuple[float, ...] = (0.004, -0.003, 0.003, 0.005, -0.004, 0.004)
    """Joints 1 to n, degrees (millimetres): what is added to the joint that moved most, less to those that moved less.
    """
    share: tuple[float, ...] = (-6e-5, 4e-5, -5e-5, 6e-5, 5e-5, -4e-5)
    """Joints 1 to n: of the move, added."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        sizes = np.column_stack([np.array(self.size_deg) * arm.joint_units, self.share])
        return list(zip(families()["move"].terms(arm), sizes.ravel().tolist(), strict=True))


@dataclass(frozen=True)
class ThawEffect(Effect):
    """All six motions of all joints' frames drift to nothing as ``exp(-t/tau)`` from the start of the run.

    Where `WarmUpEffect` (Nubiola 2011, section 7.1) grows all lengths alike and turns two joints, every joint has
    drifts of its own here: what the error model's warm-up can describe at most. Sizes are those that evidence shows on
    a measured IRB 120, 0.1 mrad and 0.03 mm. Off in the shipped cells.
    """

    name: ClassVar[str] = "thaw"
    summary: ClassVar[str] = "each joint's frame drifts as the robot warms up, beyond section 7.1; off if not asked for"
    of_joints: ClassVar[Mapping[str, float]] = dict.fromkeys(_DRIFTS, 0.0)
    tau_min: float = 12.0
    x_deg: tuple[float, ...] = (0.002, -0.004, 0.003, 0.005, -0.004, 0.003)
    y_deg: tuple[float, ...] = (-0.003, 0.002, -0.005, 0.003, 0.004, -0.002)
    z_deg: tuple[float, ...] = (0.004, 0.006, -0.005, -0.006, 0.005, 0.006)
    x_mm: tuple[float, ...] = (0.02, 0.03, -0.02, 0.01, -0.02, 0.01)
    y_mm: tuple[float, ...] = (-0.01, 0.02, 0.01, -0.02, 0.01, 0.02)
    z_mm: tuple[float, ...] = (0.03, -0.02, 0.02, 0.03, -0.01, -0.02)
    """Turns and shifts of the frames of joints 1 to n at the start."""

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        drifts = np.array([getattr(self, name) for name in _DRIFTS]).T
        return _decays(drifts[:, :3] * DEG, drifts[:, 3:] * MM, self.tau_min)


EFFECTS: tuple[type[Effect], ...] = (
    TiltEffect,
    ComplianceEffect,
    HarmonicsEffect,
    BacklashEffect,
    RepeatabilityEffect,
    SettlingEffect,
    WarmUpEffect,
    NoiseEffect,
    DriftEffect,
    VisibilityEffect,
    LostEffect,
)
"""The effects of the shipped cells in the order in which they act."""

MORE: tuple[type[Effect], ...] = (
    ReadingLagEffect,
    BendingEffect,
    GearEffect,
    WobbleEffect,
    DirectionEffect,
    MoveEffect,
    ThawEffect,
)
"""Effects that the shipped cells leave off: `irbcal.simulation.virtual_cell.VirtualCell.also` switches them on."""

ALL = EFFECTS + MORE

EFFECT_NAMES = tuple(effect.name for effect in EFFECTS)
"""Names of the effects of the shipped cells."""


def check_names(names: Iterable[str]) -> None:
    """Refuse names of effects that do not exist.

    Raises
    ------
    MeasurementError
        The sentence lists the names.
    """
    for name in names:
        effects = [effect.name for effect in ALL]
        if name not in effects:
            raise MeasurementError(f"unknown effect {name!r}: effects are {', '.join(effects)}", parameter="effect")
