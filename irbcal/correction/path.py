"""Paths: straight lines and circles of tool poses, their subdivision, and where joints turn back (annex VI).

A controller with the nominal model moves its tool along the nominal line between two fake targets. The true tool
then leaves the wanted line in between, because the error changes on the way; more fake targets keep it closer.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.correction.fake_targets import Corrected, correct_joints
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form
from irbcal.units import DEG, MM

LARGEST_ARC = 240 * DEG
"""Of one circular move, radians."""


@dataclass(frozen=True)
class Line:
    """Straight move between two poses; orientation turns evenly about one axis.

    Parameters
    ----------
    T_start, T_end : ndarray, shape (4, 4)
        Poses in the base link, metres.
    """

    T_start: np.ndarray
    T_end: np.ndarray

    @property
    def length(self):
        """Length of the path of the origin, metres."""
        return float(np.linalg.norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    def poses(self, s):
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        s = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, s)
        T[:, :3, 3] = self.T_start[:3, 3] + s[:, None] * (self.T_end[:3, 3] - self.T_start[:3, 3])
        return T


@dataclass(frozen=True)
class Circle:
    """Move along a circular arc; orientation turns evenly about one axis.

    Parameters
    ----------
    T_start, T_end : ndarray, shape (4, 4)
        Poses in the base link, metres.
    center, normal : ndarray, shape (3,)
        Of the circle, in the base link; the move turns by ``angle`` about the normal.
    angle : float
        Radians.
    """

    T_start: np.ndarray
    T_end: np.ndarray
    center: np.ndarray
    normal: np.ndarray
    angle: float

    @staticmethod
    def through(T_start, p_via, T_end):
        """Arc from one pose to another through a point, as MoveC defines it.

        Raises
        ------
        RobotError
            If the three points lie on a line.
        """
        p_1, p_2, p_3 = T_start[:3, 3], np.asarray(p_via, dtype=float), T_end[:3, 3]
        a, b = p_2 - p_1, p_3 - p_1
        normal = np.cross(a, b)
        if np.linalg.norm(normal) <= 1e-9 * np.linalg.norm(a) * max(np.linalg.norm(b), 1e-12):
            raise RobotError("a circular move needs three points that do not lie on a line")
        center = p_1 + np.cross(b @ b * a - a @ a * b, normal) * -1.0 / (2 * normal @ normal)
        normal = normal / np.linalg.norm(normal)
        u, v = p_1 - center, p_3 - center
        angle = np.arctan2(normal @ np.cross(u, v), u @ v) % (2 * np.pi)
        return Circle(T_start, T_end, center, normal, float(angle))

    @staticmethod
    def full(T_start, center, normal):
        """A whole turn from a pose about a centre, with constant orientation."""
        normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        return Circle(T_start, T_start, np.asarray(center, dtype=float), normal, 2 * np.pi)

    @property
    def length(self):
        """Length of the arc, metres."""
        return float(abs(self.angle) * np.linalg.norm(self.T_start[:3, 3] - self.center))

    def poses(self, s):
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        s = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, s)
        u = self.T_start[:3, 3] - self.center
        v = np.cross(self.normal, u)
        angle = s[:, None] * self.angle
        T[:, :3, 3] = self.center + np.cos(angle) * u + np.sin(angle) * v
        return T


def _turned(T_start, T_end, s):
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(T_start[:3, :3].T @ T_end[:3, :3]).as_rotvec()
    T = np.zeros((len(s), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, :3] = T_start[:3, :3] @ Rotation.from_rotvec(s[:, None] * vector).as_matrix()
    return T


@dataclass(frozen=True)
class Reversal:
    """A joint that turns back on a path: where backlash is to be expected.

    Attributes
    ----------
    s : float
        Place on the path, fraction of the way.
    joint : int
        Counted from 1.
    angle : float
        Of the joint there, radians.
    kind : str
        ``min`` or ``max``.
    """

    s: float
    joint: int
    angle: float
    kind: str


def reversals(q, s, least=1e-4):
    """Local minima and maxima of each joint along a path (tables A VI-1 to A VI-3).

    Places are refined by the parabola through three neighbouring samples.

    Parameters
    ----------
    q : ndarray, shape (n, 6)
        Joint history, radians, without jumps by whole turns.
    s : ndarray, shape (n,)
        Evenly spaced places on the path.
    least : float
        Ignore joints that move by less than this over the whole path, radians.

    Returns
    -------
    list of Reversal
        In the order of the path.
    """
    found = []
    step = s[1] - s[0]
    for j in range(q.shape[1]):
        if np.ptp(q[:, j]) < least:
            continue
        change = np.diff(q[:, j])
        turns = np.flatnonzero(np.sign(change[1:]) * np.sign(change[:-1]) < 0) + 1
        for k in turns:
            a, b, c = q[k - 1 : k + 2, j]
            offset = 0.5 * (a - c) / (a - 2 * b + c)
            kind = "max" if b > a else "min"
            found.append(Reversal(float(s[k] + offset * step), j + 1, float(b - 0.25 * (a - c) * offset), kind))
    return sorted(found, key=lambda item: (item.s, item.joint))


def distance_to_path(path, points):
    """Distance of points from a path, metres, shape (n,).

    Straight lines are exact; circles are taken as they are, arcs at their ends included.
    """
    points = np.atleast_2d(points)
    if isinstance(path, Line):
        p, along = path.T_start[:3, 3], path.T_end[:3, 3] - path.T_start[:3, 3]
        t = np.clip((points - p) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        return np.linalg.norm(points - p - t[:, None] * along, axis=1)
    u = path.T_start[:3, 3] - path.center
    v = np.cross(path.normal, u)
    radius = np.linalg.norm(u)
    rel = points - path.center
    turned = np.arctan2(rel @ v, rel @ u) % (2 * np.pi)
    in_plane = np.hypot(rel @ u, rel @ v) / radius
    on_arc = np.hypot(in_plane - radius, rel @ path.normal)
    ends = np.minimum(
        np.linalg.norm(points - path.T_start[:3, 3], axis=1), np.linalg.norm(points - path.T_end[:3, 3], axis=1)
    )
    return np.where(turned <= path.angle, on_arc, ends)


def joint_history(path, nominal, seed, s, T_tip_tcp=None):
    """Joints of the nominal robot along a path, in the branch of the seed and without jumps by whole turns.

    Parameters
    ----------
    path : Line or Circle
        Of the tool centre point, in the base link.
    nominal : Arm
    seed : ndarray, shape (6,)
        Joints at (or near) the start, radians.
    s : ndarray, shape (n,)
        Places on the path.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.

    Returns
    -------
    ndarray, shape (n, 6)
        Radians.

    Raises
    ------
    RobotError
        If the robot does not reach every place in that branch.
    """
    return _joints_along(path.poses(s) @ _tip_of(T_tip_tcp), nominal, seed)


def _tip_of(T_tip_tcp):
    return np.eye(4) if T_tip_tcp is None else frames.inverse(T_tip_tcp)


def _joints_along(T_base_tip, nominal, seed):
    branch = closed_form.configuration(nominal, np.asarray(seed, dtype=float))
    branches = closed_form.branches(nominal, T_base_tip)
    q = branches.joints[:, int(branch)]
    if not np.isfinite(q).all():
        place = int(np.flatnonzero(~np.isfinite(q).all(axis=1))[0])
        raise RobotError(f"the robot does not reach point {place + 1} of {len(q)} of the path in its configuration")
    q = np.unwrap(np.vstack([seed, q]), axis=0)[1:]
    return q


@dataclass(frozen=True, eq=False)
class Subdivision:
    """A path cut into moves whose ends are fake targets.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Ends of the moves on the path, the first at 0; for circles every second one is the point that the arc
        goes through.
    corrected : Corrected
        The fake targets there.
    deviation : float
        Largest distance of the true tool centre point from the wanted path between them, metres.
    uncut : float
        The same for the path in the fewest moves there can be: one, for circles one for each 240 degrees begun.
    """

    s: np.ndarray
    corrected: Corrected
    deviation: float
    uncut: float


def subdivide(path, robot, nominal, seed, tolerance=None, length=None, T_tip_tcp=None, most=1024):
    """Cut a path into moves so that the true path keeps to the wanted one (annex VI).

    Between two fake targets the controller moves its tool along its own nominal line or arc; the calibrated
    robot tells where the tool truly goes.

    Parameters
    ----------
    path : Line or Circle
        Wanted path of the tool centre point, in the base link.
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    seed : ndarray, shape (6,)
        Joints at (or near) the start, radians.
    tolerance : float, optional
        Largest deviation allowed, metres: the fewest moves that keep it are taken.
    length : float, optional
        Largest length of a move, metres (the thesis took 30 mm).
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.
    most : int
        Refuse more moves than this.

    Returns
    -------
    Subdivision

    Raises
    ------
    RobotError
        If neither or both wishes are given, if a point cannot be corrected, or if the tolerance takes too many moves.
    """
    if (tolerance is None) == (length is None):
        raise RobotError("a path is cut by a tolerance or by a length: give one of them")

    def cut(moves):
        return _cut(path, robot, nominal, seed, moves, T_tip_tcp)

    # a single circular move can neither return to its start nor tell, near there, which way round it goes
    fewest = int(np.ceil(abs(path.angle) / LARGEST_ARC - 1e-9)) if isinstance(path, Circle) else 1
    _, _, uncut = cut(fewest)
    if length is not None:
        moves = max(fewest, int(np.ceil(path.length / length - 1e-9)))
    else:
        moves, fails = fewest, fewest - 1
        while cut(moves)[2] > tolerance:
            fails, moves = moves, 2 * moves
            if moves > most:
                raise RobotError(f"a deviation of {tolerance / MM:g} mm takes more than {most} moves")
        while moves - fails > 1:
            middle = (moves + fails) // 2
            fails, moves = (fails, middle) if cut(middle)[2] <= tolerance else (middle, moves)
    s, corrected, deviation = cut(moves)
    return Subdivision(s, corrected, deviation, uncut)


def _cut(path, robot, nominal, seed, moves, T_tip_tcp, samples=16):
    """Ends of the moves, fake targets there, and the deviation between them."""
    arcs = isinstance(path, Circle)
    s = np.linspace(0.0, 1.0, (2 if arcs else 1) * moves + 1)
    T_tcp_tip = _tip_of(T_tip_tcp)
    wanted = path.poses(s) @ T_tcp_tip
    corrected = correct_joints(robot, nominal, _joints_along(wanted, nominal, seed))
    if not corrected.ok.all():
        place = int(np.flatnonzero(~corrected.ok)[0])
        raise RobotError(f"point {place + 1} of {len(s)} of the path cannot be corrected: {corrected.reason[place]}")
    # the controller's own idea of the tool centre point between its targets
    fake = corrected.T_fake @ frames.inverse(T_tcp_tip)
    inside = np.linspace(0.0, 1.0, samples + 2)[1:-1]
    taken = []
    for k in range(moves):
        if arcs:
            move = Circle.through(fake[2 * k], fake[2 * k + 1, :3, 3], fake[2 * k + 2])
        else:
            move = Line(fake[k], fake[k + 1])
        taken.append(move.poses(inside))
    q = _joints_along(np.concatenate(taken) @ T_tcp_tip, nominal, corrected.q[0])
    reached = robot.poses(q) @ frames.inverse(T_tcp_tip)
    return s, corrected, float(distance_to_path(path, reached[:, :3, 3]).max())
