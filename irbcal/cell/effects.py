"""Effects of the virtual cell: everything that a robot and a tracker do beyond the 34-parameter model.

Each effect is a small class with a name, parameters whose names carry their units (mm and degrees: they go into the
truth's file as they are) and a reference to Nubiola 2011. An effect changes effective joints, the place of the tip, or
measured points, or tells which points have no position. Its random numbers come from a stream of its own, so that
switching one effect off leaves the others' numbers as they were.

Sizes of the shipped setting come from the thesis where it has them; where it has none they are chosen so that its
other statements hold, and the docstring says which.
"""

from dataclasses import asdict, dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.cell.tool import behind_arm, turned_away
from irbcal.errors import MeasurementError
from irbcal.units import DEG, MM

MINUTE, HOUR = 60.0, 3600.0


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
    """

    q: np.ndarray
    direction: np.ndarray
    time_s: np.ndarray
    wait_s: np.ndarray
    torque: np.ndarray
    stiffness: np.ndarray
    prismatic: np.ndarray

    @property
    def units(self):
        """SI value of one degree or, for prismatic joints, one millimetre, shape (joints,)."""
        return np.where(self.prismatic, MM, DEG)


@dataclass(frozen=True, eq=False)
class Shot:
    """What the tracker is pointed at.

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

    xyz: np.ndarray
    direction: np.ndarray
    origins: np.ndarray
    time_s: np.ndarray
    place: np.ndarray


class Effect:
    """One part of the cell that can be switched off."""

    name: ClassVar[str]
    summary: ClassVar[str]

    def table(self, table):
        """The true DHM table."""
        return table

    def joints(self, motion, rng):
        """What is added to the effective joints, shape (n, joints); None for nothing."""

    def tips(self, T, motion):
        """Tip poses in the base link, shape (n, 4, 4)."""
        return T

    def points(self, xyz, shot, rng):
        """Measured points in the tracker's frame, shape (n, k, 3), metres."""
        return xyz

    def unseen(self, shot, rng):
        """Mask (n, k) of the points without a position; None for none."""

    def for_arm(self, prismatic, size):
        """The same effect for another arm; see `fitted`."""
        return self

    def parameters(self):
        """Parameters by name, as they go into the truth's file."""
        return asdict(self)


def fitted(values, prismatic, sliding):
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


@dataclass(frozen=True)
class Tilt(Effect):
    """Axes that should be parallel are not (Nubiola 2011, section 3.1.3).

    Levels 26 and 34 have no parameter for it: theirs (``alpha``) tilts about the common normal only, Hayati's ``beta``
    across it. The size is that of the other angles between axes.

    Parameters
    ----------
    beta_deg : tuple of float
        Tilt of each axis about the y axis of its frame, degrees; joints 1 to n.
    """

    name: ClassVar[str] = "tilt"
    summary: ClassVar[str] = "axes that should be parallel are tilted across their common normal (section 3.1.3)"
    beta_deg: tuple = (0.0, 0.0, 0.014, 0.0, 0.0, 0.0)

    def table(self, table):
        """The table with the tilts."""
        return replace(table, beta=table.beta + np.array(self.beta_deg) * DEG)

    def for_arm(self, prismatic, size):
        """See `Effect.for_arm`."""
        return replace(self, beta_deg=fitted(self.beta_deg, prismatic, 0.0))


@dataclass(frozen=True)
class Compliance(Effect):
    """Every joint gives way under gravity: link masses of the URDF and payload (section 4.3).

    It takes the place of the joint map's two numbers: joints 2 and 3 have compliances of their own, the payload hangs
    at the end of the wrist, and joints 4 to 6 give way as well. Compliances of joints 2 and 3 follow from Table 4.3:
    3 kg on the stretched arm make 0.3 mm, and the arm's own weight then makes about 2 mm. Those of the wrist are
    guesses: below 0.1 mm at the tool.

    Parameters
    ----------
    rad_per_Nm : tuple of float
        Compliance of joints 1 to n (prismatic joints: metres per newton).
    """

    name: ClassVar[str] = "compliance"
    summary: ClassVar[str] = "every joint gives way under the links' and the payload's weight (section 4.3)"
    rad_per_Nm: tuple = (1.0e-6, 3.6e-6, 3.0e-6, 5.0e-5, 5.0e-5, 5.0e-5)

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        return -np.array(self.rad_per_Nm) * motion.torque - motion.stiffness

    def for_arm(self, prismatic, size):
        """See `Effect.for_arm`."""
        # torques grow as the fourth power of the size, deflections in degrees stay
        return replace(self, rad_per_Nm=fitted(np.array(self.rad_per_Nm) / size**4, prismatic, 1e-8))


@dataclass(frozen=True)
class Harmonics(Effect):
    """Gears that run unevenly: a joint's error repeats some times a turn (sections 4.1 and 4.2).

    The joint-6 series of the second order is in the 34-parameter model and not here. Joints 4 and 5 are driven
    through the forearm like joint 6, with one and two periods a turn; the others have shorter ones. Section 4.1 shows
    that joints 2 and 6 err most at the tool: the sizes here keep those of the other joints below 0.15 mm there.

    Parameters
    ----------
    waves : tuple of (int, float, float, float)
        Joint (from 1; from the last one as -1, -2, ...), periods per turn, amplitude and phase in degrees.
    """

    name: ClassVar[str] = "harmonics"
    summary: ClassVar[str] = "uneven gears on joints 1 to 5, short waves on joint 6 (sections 4.1 and 4.2)"
    waves: tuple = (
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

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        out = np.zeros_like(motion.q)
        turning = np.flatnonzero(~motion.prismatic)
        for joint, periods, amplitude, phase in self.waves:
            if abs(joint) <= len(turning):
                j = turning[joint - 1 if joint > 0 else joint]
                out[:, j] += amplitude * DEG * np.sin(periods * motion.q[:, j] + phase * DEG)
        return out


@dataclass(frozen=True)
class Backlash(Effect):
    """A joint stops short on the side it came from (section 4.2).

    0.05 degrees on joint 6 are measured there; the rest of the wrist is driven alike and gets less. Gravity loads the
    gears of joints 1 to 3, and Table A I-3 (poses reached from all sides) leaves room for a few hundredths of a
    millimetre only.

    Parameters
    ----------
    peak_to_peak_deg : tuple of float
        Joints 1 to n, degrees (millimetres for prismatic joints): reached from above minus reached from below.
    """

    name: ClassVar[str] = "backlash"
    summary: ClassVar[str] = "a joint stops short on the side it came from (section 4.2)"
    peak_to_peak_deg: tuple = (0.004, 0.002, 0.003, 0.030, 0.020, 0.050)

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        return -motion.direction * np.array(self.peak_to_peak_deg) / 2 * motion.units

    def for_arm(self, prismatic, size):
        """See `Effect.for_arm`."""
        return replace(self, peak_to_peak_deg=fitted(self.peak_to_peak_deg, prismatic, 0.02))


@dataclass(frozen=True)
class Repeatability(Effect):
    """Every move ends a little elsewhere (annex I: 0.009 to 0.015 mm on average, poses reached from one side).

    Parameters
    ----------
    sigma_deg : tuple of float
        Standard deviation of joints 1 to n, degrees (millimetres for prismatic joints).
    """

    name: ClassVar[str] = "repeatability"
    summary: ClassVar[str] = "every move ends a little elsewhere (annex I)"
    sigma_deg: tuple = (0.00035, 0.00035, 0.00035, 0.0007, 0.0007, 0.0007)

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        return rng.standard_normal(motion.q.shape) * np.array(self.sigma_deg) * motion.units

    def for_arm(self, prismatic, size):
        """See `Effect.for_arm`."""
        return replace(self, sigma_deg=fitted(self.sigma_deg, prismatic, 0.005))


@dataclass(frozen=True)
class Settling(Effect):
    """The arm swings after a move and comes to rest (annex V: at rest after two seconds).

    Joints 1 to 3 overshoot in the direction of the move: ``amplitude exp(-t/tau) cos(2 pi f t)``, t since the stop.

    Parameters
    ----------
    amplitude_deg : float
        At the moment of the stop: about 0.2 mm at arm's length.
    tau_s : float
    frequency_Hz : float
    """

    name: ClassVar[str] = "settling"
    summary: ClassVar[str] = "the arm swings after a move; nothing is left after two seconds (annex V)"
    amplitude_deg: float = 0.012
    tau_s: float = 0.4
    frequency_Hz: float = 8.0

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        t = motion.wait_s
        swing = self.amplitude_deg * DEG * np.exp(-t / self.tau_s) * np.cos(2 * np.pi * self.frequency_Hz * t)
        out = np.zeros_like(motion.q)
        arm_joints = np.flatnonzero(~motion.prismatic)[:3]
        out[:, arm_joints] = swing[:, None] * motion.direction[:, arm_joints]
        return out


@dataclass(frozen=True)
class WarmUp(Effect):
    """The robot grows and bends while it warms up (section 7.1: one hour before measuring).

    Against the warm robot, with ``w = exp(-(t + before)/tau)``: all lengths are shorter by ``growth w``, joints 2 and 3
    are off by ``joint_deg w``. The size is a guess: 10 K of cast iron, 0.15 mm at arm's length from a cold start.

    Parameters
    ----------
    before_min : float
        How long the robot had been moving before the run, minutes.
    tau_min : float
    growth : float
        Relative growth of all lengths from cold to warm.
    joint_deg : tuple of float
        Of joints 2 and 3, degrees.
    """

    name: ClassVar[str] = "warm_up"
    summary: ClassVar[str] = "the robot grows and bends as it warms up, one hour into it (section 7.1)"
    before_min: float = 60.0
    tau_min: float = 40.0
    growth: float = 1.0e-4
    joint_deg: tuple = (0.004, -0.006)

    def cold(self, time_s):
        """Share of the warm-up that is still to come, shape (n,)."""
        return np.exp(-(time_s / MINUTE + self.before_min) / self.tau_min)

    def joints(self, motion, rng):
        """See `Effect.joints`."""
        out = np.zeros_like(motion.q)
        bending = np.flatnonzero(~motion.prismatic)[1:3]
        out[:, bending] = self.cold(motion.time_s)[:, None] * np.array(self.joint_deg)[: len(bending)] * DEG
        return out

    def tips(self, T, motion):
        """See `Effect.tips`."""
        T = T.copy()
        T[:, :3, 3] *= 1.0 - self.growth * self.cold(motion.time_s)[:, None]
        return T


@dataclass(frozen=True)
class Noise(Effect):
    """Scatter of the tracker in range and angle.

    Standard deviations ``a + b r`` along the beam and in each direction across it, independent of one another. Annex
    III finds 1 to 2 um for one reflector that stands still, chapter 4 a largest error of 22 um on a bar of 1 m: the
    setting lies between.

    Parameters
    ----------
    range_um, range_um_per_m : float
    across_um, across_um_per_m : float
    """

    name: ClassVar[str] = "noise"
    summary: ClassVar[str] = "scatter of the tracker in range and angle (annex III)"
    range_um: float = 1.0
    range_um_per_m: float = 0.3
    across_um: float = 2.0
    across_um_per_m: float = 1.5

    def points(self, xyz, shot, rng):
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
class Drift(Effect):
    """The tracker shifts and turns slowly over hours (annex IV: 0.012 mm on average over a day).

    Each of three shifts and three turns is a sine of a period and phase of its own. References on the floor take it
    out.

    Parameters
    ----------
    shift_um : float
        Amplitude along each axis.
    turn_urad : float
        Amplitude about each axis.
    period_h : tuple of float
        Shortest and longest period.
    """

    name: ClassVar[str] = "drift"
    summary: ClassVar[str] = "the tracker shifts and turns slowly over hours (annex IV)"
    shift_um: float = 8.0
    turn_urad: float = 4.0
    period_h: tuple = (3.0, 12.0)

    def points(self, xyz, shot, rng):
        """See `Effect.points`."""
        period = rng.uniform(*self.period_h, 6) * HOUR
        phase = rng.uniform(0.0, 2 * np.pi, 6)
        waves = 1e-6 * np.sin(2 * np.pi * shot.time_s[..., None] / period + phase)
        return xyz + self.shift_um * waves[..., :3] + np.cross(self.turn_urad * waves[..., 3:], xyz)


@dataclass(frozen=True)
class Visibility(Effect):
    """A target that looks away from the tracker, or that the arm hides, is a lost point (section 7.1).

    References on the floor are always seen.

    Parameters
    ----------
    acceptance_deg : float
        Largest angle between a reflector's direction and the beam.
    link_radius_mm : float
        Of the arm's links between its joints, as seen by the beam.
    """

    name: ClassVar[str] = "visibility"
    summary: ClassVar[str] = "targets that look away or are hidden by the arm are lost (section 7.1)"
    acceptance_deg: float = 30.0
    link_radius_mm: float = 90.0

    def unseen(self, shot, rng):
        """See `Effect.unseen`."""
        out = np.zeros(shot.xyz.shape[:2], dtype=bool)
        k = shot.direction.shape[1]
        targets = shot.xyz[:, :k]
        out[:, :k] = turned_away(targets, shot.direction, shot.place, self.acceptance_deg * DEG)
        seen = np.flatnonzero(~out[:, :k].all(axis=1))  # only these poses can still lose something
        radius = self.link_radius_mm * MM
        out[seen, :k] |= behind_arm(targets[seen], shot.origins[seen], shot.place, radius)
        return out

    def for_arm(self, prismatic, size):
        """See `Effect.for_arm`."""
        return replace(self, link_radius_mm=self.link_radius_mm * size)


@dataclass(frozen=True)
class Lost(Effect):
    """The tracker does not find a reflector (section 7.7: 0.6 to 3.6 % of the points).

    Parameters
    ----------
    share : float
        Of all points, targets and references.
    """

    name: ClassVar[str] = "lost"
    summary: ClassVar[str] = "now and then the tracker does not find a reflector (section 7.7)"
    share: float = 0.006

    def unseen(self, shot, rng):
        """See `Effect.unseen`."""
        return rng.random(shot.xyz.shape[:2]) < self.share


EFFECTS = (
    Tilt,
    Compliance,
    Harmonics,
    Backlash,
    Repeatability,
    Settling,
    WarmUp,
    Noise,
    Drift,
    Visibility,
    Lost,
)
"""All effects in the order in which they act."""

NAMES = tuple(effect.name for effect in EFFECTS)


def check_names(names):
    """Refuse names of effects that do not exist.

    Raises
    ------
    MeasurementError
        The sentence lists the names.
    """
    for name in names:
        if name not in NAMES:
            raise MeasurementError(f"unknown effect {name!r}: effects are {', '.join(NAMES)}")
