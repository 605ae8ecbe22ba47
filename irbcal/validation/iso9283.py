"""Performance criteria of ISO 9283:1998: accuracy and repeatability of poses, distances and paths.

The formulas are those of public descriptions of the standard (such as Nubiola 2011, annex I and section 7.7.3.4); the
standard itself was not at hand. Every S is a standard deviation with n - 1. The standard's angles a, b, c about x, y
and z are taken of the small rotation from commanded to attained orientation (its rotation vector in the measuring
frame): they then have no singular attitude, and to first order are the differences of the angles.

Lengths are in metres, angles in radians, times in seconds.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import MeasurementError, RobotError
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form
from irbcal.thesis_setup import IRB1600_CUBE
from irbcal.units import MM

POSES = ("P1", "P2", "P3", "P4", "P5")
CYCLES = 30
"""Cycles of the pose tests unless said."""

# --- the test cube ----------------------------------------------------------------------------------------

FRACTION = 0.1 * np.sqrt(2.0 / 3.0)
"""Distance of P2 to P5 from the corners as a share of the cube's diagonal, as the thesis has it: 8.2 %.

ISO 9283 asks for (10 +- 2) %; the thesis's 91.9 mm are 10 % of the diagonal of a face.
"""

PLANES = {
    "x=z": ((1, 1, 1), (1, -1, 1), (-1, -1, -1), (-1, 1, -1)),
    "x=-z": ((1, 1, -1), (1, -1, -1), (-1, -1, 1), (-1, 1, 1)),
    "y=z": ((1, 1, 1), (-1, 1, 1), (-1, -1, -1), (1, -1, -1)),
    "y=-z": ((1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1)),
}
"""Inclined planes of the cube, and the directions of P2 to P5 from its centre; the thesis took ``x=z``."""

CUBES = {
    "irb1600_6_145": IRB1600_CUBE,
    "irb120_3_058": ((0.374, 0.0, 0.40), 0.25),
}
"""Centre in the base link and edge of the test cube of the shipped robots, metres; IRB 1600 as in annex I."""


@dataclass(frozen=True, eq=False)
class FivePoses:
    """The five test poses.

    Attributes
    ----------
    T_base_tip : ndarray, shape (5, 4, 4)
    q : ndarray, shape (5, joints)
        Radians.
    """

    T_base_tip: np.ndarray
    q: np.ndarray


def cube_poses(center, edge, rotation, plane="x=z", fraction=FRACTION):
    """P1 in the centre of a cube parallel to the base, P2 to P5 on the diagonals of an inclined plane.

    Parameters
    ----------
    center : array_like, shape (3,)
        Metres, in the base link.
    edge : float
        Metres.
    rotation : ndarray, shape (3, 3)
        Orientation of the tip, the same in all poses.
    plane : str
        One of `PLANES`.
    fraction : float
        Distance from the corners as a share of the cube's diagonal.

    Returns
    -------
    ndarray, shape (5, 4, 4)

    Raises
    ------
    RobotError
        If the plane is none or the sizes make no cube.
    """
    if plane not in PLANES:
        raise RobotError(f"the inclined planes of the cube are {', '.join(PLANES)}, not {plane!r}")
    if not (edge > 0 and 0 <= fraction < 0.5):
        raise RobotError(
            f"a test cube needs an edge above zero and points between centre and corners, found {edge:g} m"
        )
    T = np.tile(frames.transform(rotation, center), (5, 1, 1))
    T[1:, :3, 3] += np.array(PLANES[plane]) * edge * (0.5 - fraction)
    return T


def five_poses(arm, center=None, edge=None, near=None, plane="x=z", fraction=FRACTION):
    """The five test poses and the joints that reach them; the tip keeps the orientation it has at ``near``.

    Parameters
    ----------
    arm : Arm
        Nominal.
    center, edge : optional
        See `cube_poses`; shipped robots have their own (`CUBES`).
    near : array_like, shape (joints,), optional
        Joints that set the tip's orientation, and which the solutions are to be near; zero (or the nearest to it
        within the limits) unless given.
    plane, fraction
        See `cube_poses`.

    Returns
    -------
    FivePoses

    Raises
    ------
    RobotError
        If there is no cube for this arm or a pose is out of reach.
    """
    if (center is None or edge is None) and arm.name not in CUBES:
        raise RobotError(f"no test cube is known for {arm.name}: give its centre and its edge")
    center = CUBES[arm.name][0] if center is None else center
    edge = CUBES[arm.name][1] if edge is None else edge
    home = np.clip(np.zeros(len(arm.lower)), arm.lower, arm.upper)
    near = home if near is None else arm.check_joints(near)[0]
    T = cube_poses(center, edge, arm.forward(near[None])[0, :3, :3], plane, fraction)
    if closed_form.has_closed_form(arm):
        q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), near)
        reached = branch >= 0
    else:
        from irbcal.modeling.inverse import any_arm
        from irbcal.modeling.robot import Robot

        found = any_arm.solve(Robot(arm), arm, T, near)
        q, reached = found.joints, found.converged & found.inside
    if not reached.all():
        k = int(np.flatnonzero(~reached)[0])
        x, y, z = T[k, :3, 3] / MM
        raise RobotError(
            f"{arm.name} does not reach {POSES[k]} at {x:.1f}, {y:.1f}, {z:.1f} mm within its joint limits: choose a "
            "smaller cube, another centre or another orientation"
        )
    return FivePoses(T, q + 0.0)


# --- pose accuracy and repeatability ----------------------------------------------------------------------


def pose_accuracy(xyz, commanded):
    """Position accuracy AP: distance of the barycentre of the attained positions from the commanded one.

    ``AP = |mean(x_j) - x_c|``, and ``AP_x = mean(x_j) - x_cx`` along each axis.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Attained, metres.
    commanded : ndarray, shape (3,)

    Returns
    -------
    AP : float
    AP_axes : ndarray, shape (3,)
    """
    axes = xyz.mean(axis=0) - commanded
    return float(np.linalg.norm(axes)), axes


def position_repeatability(xyz):
    """Position repeatability RP: radius of the sphere about the barycentre (ISO 9283, 7.2.2).

    ``l_j = |x_j - mean(x)|``, ``RP = mean(l) + 3 S_l``.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Attained, metres; n at least 2.

    Returns
    -------
    RP : float
    l : ndarray, shape (n,)
        Distances from the barycentre.
    """
    distance = np.linalg.norm(xyz - xyz.mean(axis=0), axis=1)
    return float(distance.mean() + 3 * distance.std(ddof=1)), distance


def angle_accuracy(angles, commanded=0.0):
    """Orientation accuracy AP_a, AP_b, AP_c: mean angle minus commanded angle, wrapped.

    Parameters
    ----------
    angles : ndarray, shape (n, ...)
        Attained, radians.
    commanded : array_like, shape (...)

    Returns
    -------
    ndarray, shape (...)
        Radians, within half a turn of zero.
    """
    return wrapped(wrapped(angles - np.asarray(commanded)).mean(axis=0)) if len(angles) else None


def angle_repeatability(angles):
    """Orientation repeatability RP_a, RP_b, RP_c: ``3 S`` of each angle (annex I, eq. I.1), shape (...), radians.

    Parameters
    ----------
    angles : ndarray, shape (n, ...)
        Radians; n at least 2. They are unwrapped about the first one.
    """
    return 3 * wrapped(angles - angles[0]).std(axis=0, ddof=1)


def wrapped(angle):
    """Angles within half a turn of zero, radians."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def small_angles(R, R_commanded):
    """Angles a, b, c about x, y, z of the rotation from commanded to attained orientation.

    Parameters
    ----------
    R : ndarray, shape (n, 3, 3)
    R_commanded : ndarray, shape (3, 3) or (n, 3, 3)

    Returns
    -------
    ndarray, shape (n, 3)
        Radians.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R @ np.swapaxes(R_commanded, -1, -2)).as_rotvec()


def mean_rotation(R):
    """Mean orientation in the sense of the chord, shape (3, 3), of rotations (n, 3, 3)."""
    return frames.nearest_rotation(R.mean(axis=0))


def multidirectional_variation(means):
    """Multi-directional pose accuracy variation vAP: largest distance between the means of the directions of approach.

    Parameters
    ----------
    means : ndarray, shape (directions, 3)
        Barycentres, metres (or mean angles, radians: then take each column by itself).

    Returns
    -------
    float
    """
    return float(np.linalg.norm(means[:, None] - means, axis=2).max())


def distance_accuracy(xyz_1, xyz_2, commanded_1=None, commanded_2=None):
    """Distance accuracy AD and repeatability RD between two poses.

    ``D_j = |x_1j - x_2j|``, ``AD = mean(D) - D_c``, ``RD = 3 S_D``.

    Parameters
    ----------
    xyz_1, xyz_2 : ndarray, shape (n, 3)
        Attained in the same cycles, metres.
    commanded_1, commanded_2 : ndarray, shape (3,), optional

    Returns
    -------
    AD : float or None
        None without commanded positions.
    RD : float
    """
    distance = np.linalg.norm(xyz_1 - xyz_2, axis=1)
    accuracy = None
    if commanded_1 is not None:
        accuracy = float(distance.mean() - np.linalg.norm(np.asarray(commanded_1) - commanded_2))
    return accuracy, float(3 * distance.std(ddof=1))


# --- time: stabilisation and drift ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """How one approach came to rest.

    Attributes
    ----------
    first_entry, settled : float
        When the limit band was entered first, and when it was entered and not left again, seconds; NaN if never.
    overshoot : float
        Largest distance after the first entry if that is beyond the band, else zero, metres.
    largest : float
        Largest distance after the first entry, metres.
    distance : ndarray, shape (n,)
        From the final position, metres.
    """

    first_entry: float
    settled: float
    overshoot: float
    largest: float
    distance: np.ndarray

    @property
    def time(self):
        """Stabilisation time PSt, seconds."""
        return self.settled - self.first_entry


def final_position(time, xyz, after, count=100):
    """Where a robot came to rest: mean of the first ``count`` readings from a time on (annex V: 100 after 10 s).

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds.
    xyz : ndarray, shape (n, 3)
        Metres.
    after : float
    count : int

    Returns
    -------
    ndarray, shape (3,)

    Raises
    ------
    MeasurementError
        If no reading is that late.
    """
    late = np.flatnonzero(time >= after)
    if not len(late):
        raise MeasurementError(
            f"the readings end at {time.max():g} s: the final position is the mean of those after {after:g} s"
        )
    return xyz[late[:count]].mean(axis=0)


def stabilisation(time, xyz, final, band):
    """Position stabilisation time PSt and overshoot of one approach.

    From the instant of the first entry into the limit band about the final position until the instant from which it is
    not left again; entries lie between two readings, on the straight line of the distance. A series that begins inside
    the band has entered it with its first reading.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, ascending.
    xyz : ndarray, shape (n, 3)
        Metres.
    final : ndarray, shape (3,)
    band : float
        Radius of the limit band, metres.

    Returns
    -------
    Stabilisation
    """
    distance = np.linalg.norm(xyz - final, axis=1)
    inside = distance <= band
    if not inside.any():
        return Stabilisation(np.nan, np.nan, np.nan, np.nan, distance)

    def entry(k):
        if k == 0:
            return float(time[0])
        share = (distance[k - 1] - band) / (distance[k - 1] - distance[k])
        return float(time[k - 1] + share * (time[k] - time[k - 1]))

    first = int(np.argmax(inside))
    outside = np.flatnonzero(~inside)
    last = int(outside[-1]) + 1 if len(outside) else 0
    largest = float(distance[first:].max())
    settled = entry(last) if last < len(time) else np.nan
    return Stabilisation(entry(first), settled, largest if largest > band else 0.0, largest, distance)


def drift(sets, commanded=None):
    """Drift of pose accuracy dAP and repeatability dRP over sets of cycles.

    ``dAP`` and ``dRP`` are the differences of the last set's and the first set's AP and RP; as these say nothing about
    the direction, the way of the barycentre is given, too.

    Parameters
    ----------
    sets : sequence of ndarray, shape (n, 3)
        Attained positions of each set, in order of time, metres.
    commanded : ndarray, shape (3,), optional

    Returns
    -------
    dict
        ``RP`` and ``shift`` (distance of the barycentre from that of the first set), arrays over the sets; ``dRP``;
        with commanded positions also ``AP`` and ``dAP``. Metres.
    """
    means = np.array([xyz.mean(axis=0) for xyz in sets])
    out = {
        "RP": np.array([position_repeatability(xyz)[0] for xyz in sets]),
        "shift": np.linalg.norm(means - means[0], axis=1),
    }
    out["dRP"] = float(out["RP"][-1] - out["RP"][0])
    if commanded is not None:
        out["AP"] = np.linalg.norm(means - commanded, axis=1)
        out["dAP"] = float(out["AP"][-1] - out["AP"][0])
    return out


# --- paths ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PathErrors:
    """Errors of a path on planes normal to the commanded one.

    Attributes
    ----------
    mean : ndarray, shape (m, 3)
        Barycentre of the cycles on each plane minus the commanded point, metres.
    repeatability : ndarray, shape (m,)
        ``mean(l) + 3 S_l`` on each plane, metres.
    mean_angles, angle_repeatability : ndarray, shape (m, 3), or None
        Mean angles and 3 S of the angles, radians.
    planes : ndarray of int, shape (m,)
        Commanded points whose planes all cycles cross.
    """

    mean: np.ndarray
    repeatability: np.ndarray
    mean_angles: np.ndarray | None
    angle_repeatability: np.ndarray | None
    planes: np.ndarray

    @property
    def AT(self):
        """Path accuracy: largest distance of the mean path from the commanded one, metres."""
        return float(np.linalg.norm(self.mean, axis=1).max())

    @property
    def RT(self):
        """Path repeatability: largest over the planes, metres."""
        return float(self.repeatability.max())


def path_errors(paths, commanded, rotations=None, commanded_rotations=None):
    """Path accuracy AT and repeatability RT from sampled paths.

    Each cycle's path is taken as straight between its samples and cut by the planes normal to the commanded path; of
    several cuts the one nearest to the commanded point counts. Planes that not every cycle crosses (at the ends) are
    left out.

    Parameters
    ----------
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, in order, metres.
    rotations : sequence of ndarray, shape (k, 3, 3), optional
    commanded_rotations : ndarray, shape (m, 3, 3), optional

    Returns
    -------
    PathErrors

    Raises
    ------
    MeasurementError
        If there are fewer than two cycles, or no plane is crossed by all.
    """
    if len(paths) < 2:
        raise MeasurementError("path accuracy and repeatability need two cycles or more")
    commanded = np.asarray(commanded, dtype=float)
    along = np.gradient(commanded, axis=0)
    length = np.linalg.norm(along, axis=1)
    if (length == 0).any():
        raise MeasurementError("the commanded path has points that do not move on")
    along = along / length[:, None]
    turned = rotations is not None and commanded_rotations is not None
    cuts, angles = [], []
    for k, path in enumerate(paths):
        at, share = _cuts(np.asarray(path, dtype=float), commanded, along)
        cuts.append(_between(path, at, share))
        if turned:
            # the samples' angles from the commanded orientation of the plane, on the line between two samples
            ends = [small_angles(rotations[k][np.maximum(at, 0) + i], commanded_rotations) for i in (0, 1)]
            angle = ends[0] + share[:, None] * (ends[1] - ends[0])
            angles.append(np.where(at[:, None] >= 0, angle, np.nan))
    cuts = np.array(cuts)
    planes = np.flatnonzero(np.isfinite(cuts).all(axis=(0, 2)))
    if not len(planes):
        raise MeasurementError("no plane normal to the commanded path is crossed by every cycle")
    cuts = cuts[:, planes]
    mean = cuts.mean(axis=0)
    distance = np.linalg.norm(cuts - mean, axis=2)
    angles = np.array(angles)[:, planes] if turned else None
    return PathErrors(
        mean - commanded[planes],
        distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1),
        angles.mean(axis=0) if turned else None,
        3 * angles.std(axis=0, ddof=1) if turned else None,
        planes,
    )


def _cuts(path, commanded, along):
    """Segment of a path that cuts each plane (-1 for none), and where on it."""
    at, share = np.full(len(commanded), -1), np.full(len(commanded), np.nan)
    step = max(1, 2_000_000 // len(path))
    for start in range(0, len(commanded), step):
        part = slice(start, start + step)
        # height (planes, samples) above each plane
        height = along[part] @ path.T - np.sum(along[part] * commanded[part], axis=1)[:, None]
        low, high = height[:, :-1], height[:, 1:]
        crossed = (low * high <= 0) & (low != high)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(crossed, low / (low - high), 0.0)
        place = path[:-1] + t[..., None] * (path[1:] - path[:-1])
        far = np.where(crossed, np.linalg.norm(place - commanded[part][:, None], axis=2), np.inf)
        best = np.argmin(far, axis=1)
        rows = np.arange(len(best))
        found = np.isfinite(far[rows, best])
        at[part] = np.where(found, best, -1)
        share[part] = np.where(found, t[rows, best], np.nan)
    return at, share


def _between(path, at, share):
    path = np.asarray(path, dtype=float)
    start = np.maximum(at, 0)
    place = path[start] + share[:, None] * (path[np.minimum(start + 1, len(path) - 1)] - path[start])
    return np.where(at[:, None] >= 0, place, np.nan)
