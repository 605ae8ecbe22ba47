"""Which poses to measure: candidates, the conditions that they must meet, and their order.

The sources of poses are those of Nubiola 2011, section 7.2: moves of one joint, the ISO cube, the whole range. Random
poses are drawn uniformly in the joints, so that the configuration is not restrained, and every condition says how
many candidates it removed. Conditions are checked from cheap to dear, each on those that the earlier ones left.
"""

from dataclasses import dataclass, field

import numpy as np

from irbcal.cell.tool import ACCEPTANCE, turned_away
from irbcal.errors import MeasurementError
from irbcal.planning import route
from irbcal.thesis_setup import FRONT, IRB1600_CUBE, IRB1600_P1
from irbcal.units import DEG, MM

CONDITIONS = {
    "limits": "joint limits with margin",
    "height": "height above the obstacles",
    "acceptance": "a reflector turned to the tracker",
    "collision": "no self-collision",
    "sight": "a line of sight that the arm leaves free",
    "way": "a straight way in the joints from home without self-collision",
}
"""Names of the conditions in the order in which they are checked."""

SOLID = {"collision", "sight", "way"}
"""Conditions that need the robot's collision geometry."""

AXIS_CONDITIONS = ("limits", "collision", "sight")
"""Conditions of moves of one joint: an operator turns the reflector there (section 7.1), and they are not random."""

LARGEST_CORRECTION = 10 * MM
"""Farther from that no calibration takes the tip."""

FEW, MANY = 18, 158
"""Poses of the two sets of axis moves of a six-axis arm."""
METRES_PER_DEGREE = 10 * MM
"""Travel of a prismatic joint in axis moves for each degree of a revolute one."""

BATCH = 5_000, 50_000
"""Random joints that are looked at together: at first, and when few are found."""
MOST_TRIED = 2_000_000
"""Random joints after which the search for poses is given up."""
WAY_STEP = 2.5
"""Steps on the way from home against those of moves between poses (`irbcal.planning.route.STEP`)."""

DECIMALS = 4
"""Of commanded joints in degrees and millimetres; what is checked is what is commanded."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Reflectors on the tool.

    Parameters
    ----------
    names : tuple of str
    places : ndarray, shape (k, 3)
        In the tip link, metres.
    directions : ndarray, shape (k, 3), or None
        Where they look, in the tip link (made unit vectors); None where not known.
    """

    names: tuple
    places: np.ndarray
    directions: np.ndarray | None = None

    def __post_init__(self):
        object.__setattr__(self, "places", np.array(self.places, dtype=float).reshape(-1, 3))
        if self.directions is not None:
            looks = np.array(self.directions, dtype=float).reshape(-1, 3)
            object.__setattr__(self, "directions", looks / np.linalg.norm(looks, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Setting:
    """Robot, reflectors, tracker and what poses must keep to.

    Parameters
    ----------
    robot : Robot
        Predicts where the tip is.
    targets : Targets
    place : ndarray, shape (3,)
        The tracker in the base link, metres.
    conditions : tuple of str
        Those that hold, of `CONDITIONS`.
    margin : float
        From the joint limits, radians; prismatic joints keep `METRES_PER_DEGREE` for each degree.
    acceptance : float
        Largest angle between a reflector's direction and the beam, radians.
    heights : tuple of float, or None
        Lowest z of tip and reflectors in the base link, in front (x from `FRONT` on) and at the back, metres.
    solids : CollisionModel, or None
        Has ``touching(theta)`` and ``blocked(theta, points, place, asked)``; needed for ``collision`` and ``sight``.
    """

    robot: object
    targets: Targets
    place: np.ndarray
    conditions: tuple = tuple(CONDITIONS)
    margin: float = 2 * DEG
    acceptance: float = ACCEPTANCE
    heights: tuple | None = None
    solids: object = None

    def __post_init__(self):
        unknown = [name for name in self.conditions if name not in CONDITIONS]
        if unknown:
            raise MeasurementError(f"unknown condition {unknown[0]!r}: conditions are {', '.join(CONDITIONS)}")
        on = [name for name in CONDITIONS if name in self.conditions]
        if self.targets.directions is None and "acceptance" in on:
            on.remove("acceptance")
        if self.heights is None and "height" in on:
            on.remove("height")
        if self.solids is None and SOLID & set(on):
            raise MeasurementError("the conditions collision, sight and way need the robot's collision geometry")
        object.__setattr__(self, "conditions", tuple(on))

    @property
    def arm(self):
        """The robot's arm; its limits hold for commanded joints."""
        return self.robot.arm

    @property
    def bounds(self):
        """Joint limits with the margin, two arrays (joints,)."""
        margin = self.margin * np.where(self.arm.table.prismatic, METRES_PER_DEGREE / DEG, 1.0)
        return self.arm.lower + margin, self.arm.upper - margin

    def places(self, q):
        """Tip (n, 3) and reflectors (n, k, 3) in the base link, and where these look (None if not known), metres."""
        T = self.robot.poses(q)
        turn = np.swapaxes(T[:, :3, :3], 1, 2)
        points = self.targets.places @ turn + T[:, None, :3, 3]
        looks = None if self.targets.directions is None else self.targets.directions @ turn
        return T[:, :3, 3], points, looks

    def high(self, tip, points):
        """Whether tip (n, 3) and reflectors (n, k, 3) are above the height limits, shape (n,)."""
        p = np.concatenate([tip[:, None], points], axis=1)
        return (p[..., 2] >= np.where(p[..., 0] >= FRONT, *self.heights)).all(axis=1)

    def effective(self, q):
        """Effective joints, where the robot's links really stand."""
        return self.robot.joint_map.effective(q)


@dataclass(eq=False)
class Tally:
    """How many candidates each condition removed, of those that the ones before it had left."""

    tried: int = 0
    removed: dict = field(default_factory=dict)
    kept: int = 0

    def add(self, name, count):
        """Count candidates that a condition removed."""
        self.removed[name] = self.removed.get(name, 0) + int(count)

    def sentence(self):
        """What removed how many, in words."""
        words = [f"{name} removed {count:,}" for name, count in self.removed.items()]
        return f"of {self.tried:,} candidates " + (", ".join(words) if words else "none was removed")


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses that meet the conditions.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    seen : ndarray of bool, shape (n, k)
        Which reflectors the tracker sees.
    groups : ndarray of str, shape (n,)
    tally : Tally
    """

    q: np.ndarray
    seen: np.ndarray
    groups: np.ndarray
    tally: Tally

    def take(self, rows):
        """Some of the poses, in this order."""
        return Poses(self.q[rows], self.seen[rows], self.groups[rows], self.tally)


def check(setting, q, conditions=None, tally=None):
    """Which poses meet the conditions.

    Parameters
    ----------
    setting : Setting
    q : ndarray, shape (n, joints)
    conditions : sequence of str, optional
        Of the setting's, those that hold here; all unless given.
    tally : Tally, optional
        Counts are added to it.

    Returns
    -------
    keep : ndarray of bool, shape (n,)
    seen : ndarray of bool, shape (n, k)
        Reflectors that the tracker sees; none where the pose is not kept.
    """
    tally = Tally() if tally is None else tally
    on = [name for name in setting.conditions if conditions is None or name in conditions]
    keep = np.ones(len(q), dtype=bool)
    tip, points, looks = setting.places(q)
    seen = np.ones(points.shape[:2], dtype=bool)

    def drop(name, good):
        tally.add(name, (keep & ~good).sum())
        keep[:] &= good

    if "limits" in on:
        lower, upper = setting.bounds
        drop("limits", ((q >= lower) & (q <= upper)).all(axis=1))
    if "height" in on:
        drop("height", setting.high(tip, points))
    if "acceptance" in on:
        seen &= ~turned_away(points, looks, setting.place, setting.acceptance)
        drop("acceptance", seen.any(axis=1))
    if "collision" in on:
        good, rows = np.ones(len(q), dtype=bool), np.flatnonzero(keep)
        good[rows] = ~setting.solids.touching(setting.effective(q[rows]))
        drop("collision", good)
    if "sight" in on:
        rows = np.flatnonzero(keep)
        theta = setting.effective(q[rows])
        seen[rows] &= ~setting.solids.blocked(theta, points[rows], setting.place, seen[rows])
        drop("sight", ~keep | seen.any(axis=1))
    if "way" in on:
        good, rows = np.ones(len(q), dtype=bool), np.flatnonzero(keep)
        home = np.broadcast_to(home_joints(setting.arm), (len(rows), q.shape[1]))
        good[rows] = ~_touching_on(setting, *route.between(home, q[rows], setting.arm.table.prismatic, WAY_STEP))
        drop("way", good)
    seen[~keep] = False
    return keep, seen


def rounded(arm, q):
    """Joints as they are commanded, with `DECIMALS` places in degrees and millimetres."""
    return np.round(q / arm.joint_units, DECIMALS) * arm.joint_units


def in_cube(centre, edge):
    """A region: tip inside a cube with edges along the base link's axes."""
    return lambda tip: (np.abs(tip - centre) <= edge / 2).all(axis=1)


def random_poses(setting, count, group, seed, region=None, step=None):
    """Random poses that meet the conditions.

    Parameters
    ----------
    setting : Setting
    count : int
    group : str
        Name of the group.
    seed : int
    region : callable, optional
        From tips (n, 3) in the base link to a mask of those inside.
    step : callable, optional
        Called with the number of poses found after each batch.

    Returns
    -------
    Poses

    Raises
    ------
    MeasurementError
        If too few are found among `MOST_TRIED` random joints; the sentence counts what each condition removed.
    """
    tally = Tally()
    found_q, found_seen, found = [], [], 0
    for number in np.random.SeedSequence(seed).generate_state(MOST_TRIED // BATCH[0]):
        if found >= count or tally.tried >= MOST_TRIED:
            break
        size = int(np.clip(tally.tried, BATCH[0], min(BATCH[1], max(MOST_TRIED - tally.tried, BATCH[0]))))
        q = rounded(setting.arm, setting.arm.random_joints(size, int(number)))
        tally.tried += len(q)
        if region is not None:
            inside = region(setting.robot.poses(q)[:, :3, 3])
            tally.add("place", (~inside).sum())
            q = q[inside]
        keep, seen = check(setting, q, tally=tally)
        found_q.append(q[keep])
        found_seen.append(seen[keep])
        found += int(keep.sum())
        if step is not None:
            step(min(found, count))
    tally.kept = found
    if found < count:
        raise MeasurementError(
            f"only {found} of {count} {group} poses meet the conditions: {tally.sentence()}; "
            "ask for fewer, move the tracker or switch a condition off"
        )
    k = len(setting.targets.names)
    q = np.concatenate([np.zeros((0, setting.arm.lower.size)), *found_q])[:count]
    seen = np.concatenate([np.zeros((0, k), dtype=bool), *found_seen])[:count]
    return Poses(q, seen, np.full(count, group, dtype=object), tally)


def home_joints(arm):
    """Zero joints; the middle of the limits for a joint that has no room about zero, shape (joints,)."""
    room = np.where(arm.table.prismatic, 10 * METRES_PER_DEGREE, 10 * DEG)
    with np.errstate(invalid="ignore"):
        middle = np.where(np.isfinite(arm.upper - arm.lower), (arm.lower + arm.upper) / 2, 0.0)
        room = np.minimum(room, (arm.upper - arm.lower) / 4)
    return np.where((arm.lower + room <= 0) & (arm.upper - room >= 0), 0.0, middle)


def axis_moves(setting, many=False):
    """Moves of one joint at a time, the others at home (Nubiola 2011, section 7.2).

    Three angles, -30, 0 and 30 degrees; or ``many``: from -40 to 40 degrees and back by 10 degrees, the last joint from
    -180 to 180 degrees and back. That makes 18 and 158 poses for six joints. Where limits are too near, all angles of a
    joint are scaled down.

    Parameters
    ----------
    setting : Setting
    many : bool

    Returns
    -------
    Poses
        In their own order; groups ``axis1`` and so on. In each group the same reflectors are seen in all poses.

    Raises
    ------
    MeasurementError
        If a pose does not meet a condition of `AXIS_CONDITIONS`; the sentence counts which removed how many.
    """
    arm, home = setting.arm, home_joints(setting.arm)
    lower, upper = setting.bounds if "limits" in setting.conditions else (arm.lower, arm.upper)
    parts, groups = [], []
    for joint in range(len(home)):
        angles = np.array([-30.0, 0.0, 30.0])
        if many:
            last = 180.0 if joint == len(home) - 1 else 40.0
            there = np.arange(-last, last + 1, 10.0)
            angles = np.concatenate([there, there[-2::-1]])
        moves = angles * (METRES_PER_DEGREE if arm.table.prismatic[joint] else DEG)
        room = min(upper[joint] - home[joint], home[joint] - lower[joint])
        moves = moves * min(1.0, room / np.abs(moves).max())
        part = np.tile(home, (len(moves), 1))
        part[:, joint] += moves
        parts.append(part)
        groups += [f"axis{joint + 1}"] * len(moves)
    q, groups = rounded(arm, np.concatenate(parts)), np.array(groups, dtype=object)
    tally = Tally(tried=len(q))
    keep, seen = check(setting, q, AXIS_CONDITIONS, tally)
    tally.kept = int(keep.sum())
    if not keep.all():
        where = ", ".join(dict.fromkeys(groups[~keep]))
        raise MeasurementError(
            f"the axis moves do not meet the conditions (poses of {where}): {tally.sentence()}; "
            "move the tracker, leave the axis moves out or switch a condition off"
        )
    for group in dict.fromkeys(groups):
        rows = groups == group
        both = seen[rows].all(axis=0)
        if not both.any():
            raise MeasurementError(
                f"no reflector can be seen in all poses of {group}, as a circle fit needs: the arm hides each in some; "
                "move the tracker, leave the axis moves out or switch the condition sight off"
            )
        seen[rows] = both
    return Poses(q, seen, groups, tally)


def largest_cube(arm, keep=None, samples=1_000_000, seed=0):
    """The largest cube in front of an arm that its tip reaches everywhere, in any orientation.

    Random joints fill cells of a grid, a sixtieth of the workspace wide; the cube is the largest one of filled cells
    with x above zero in all of it, and of equal ones the one nearest to y = 0. It is then made a cell smaller on each
    side. ISO 9283 asks for the largest cube with the tool's orientation given, which is smaller: for the IRB 1600 this
    finds 1.06 m where the thesis has 0.65 m.

    Parameters
    ----------
    arm : Arm
    keep : callable, optional
        From joints (n, joints) to a mask of those that may be used.
    samples, seed : int

    Returns
    -------
    centre : ndarray, shape (3,)
        In the base link, metres.
    edge : float
        Metres.

    Raises
    ------
    MeasurementError
        If there is none.
    """
    from scipy.ndimage import binary_closing, distance_transform_cdt

    tips = []
    for number in np.random.SeedSequence(seed).generate_state(max(1, samples // BATCH[1])):
        q = arm.random_joints(min(samples, BATCH[1]), int(number))
        tip = arm.forward(q if keep is None else q[keep(q)])[:, :3, 3]
        tips.append(tip[tip[:, 0] > 0])
    tip = np.concatenate(tips)
    if not len(tip):
        raise MeasurementError(f"{arm.name} reaches nothing in front of it: give the cube's centre and edge")
    cell = (tip.max(axis=0) - tip.min(axis=0)).max() / 60
    low = np.array([0.0, np.floor(tip[:, 1].min() / cell) * cell - cell / 2, tip[:, 2].min()])
    index = np.floor((tip - low) / cell).astype(int)
    filled = np.zeros(index.max(axis=0) + 1, dtype=bool)
    filled[tuple(index.T)] = True
    filled = binary_closing(np.pad(filled, 2), np.ones((2, 2, 2)))[2:-2, 2:-2, 2:-2]  # cells that no sample fell into
    depth = distance_transform_cdt(np.pad(filled, 1), metric="chessboard")[1:-1, 1:-1, 1:-1]
    centres = low + (np.argwhere(depth == depth.max()) + 0.5) * cell
    edge = (2 * depth.max() - 3) * cell
    if edge <= 0:
        raise MeasurementError(f"{arm.name} has no cube in front of it: give the cube's centre and edge")
    return centres[np.argmin(np.abs(centres[:, 1]))], float(edge)


def has_thesis_cube(arm):
    """Whether an arm is the thesis's IRB 1600, calibrated or not: pose P1 brings its tip to the cube's centre."""
    return arm.six_revolute and bool(
        np.linalg.norm(arm.forward(IRB1600_P1)[0, :3, 3] - IRB1600_CUBE[0]) < LARGEST_CORRECTION
    )


def iso_cube(arm, keep=None):
    """The ISO cube of an arm: that of the thesis for the IRB 1600, `largest_cube` for others; centre and edge."""
    return IRB1600_CUBE if has_thesis_cube(arm) else largest_cube(arm, keep)


def ordered(setting, poses, start, speed):
    """Random poses in an order that keeps motion short, with no move through the arm itself or below the heights.

    Parameters
    ----------
    setting : Setting
    poses : Poses
    start : ndarray, shape (joints,)
        Where the robot comes from.
    speed : ndarray, shape (joints,)

    Returns
    -------
    Poses
    over_home : ndarray of bool, shape (n,)
        Poses to which the direct way is not free, but that over `home_joints` is.
    blocked : ndarray of bool, shape (n,)
        Poses to which neither is free.
    """
    rows, bad = route.shortest_order(poses.q, start, speed, lambda a, b: blocked_moves(setting, a, b))
    poses = poses.take(rows)
    places = np.concatenate([start[None], poses.q])
    home = np.broadcast_to(home_joints(setting.arm), (len(bad), len(start)))
    stuck = blocked_moves(setting, places[bad], home) | blocked_moves(setting, home, places[bad + 1])
    over_home, blocked = np.zeros((2, len(poses.q)), dtype=bool)
    over_home[bad[~stuck]], blocked[bad[stuck]] = True, True
    return poses, over_home, blocked


def blocked_moves(setting, q_from, q_to):
    """Moves, linear in the joints, on which the robot touches itself or goes below the heights; shape (m,)."""
    if not len(q_from):
        return np.zeros(0, dtype=bool)
    q, starts = route.between(q_from, q_to, setting.arm.table.prismatic)
    bad = np.zeros(len(q), dtype=bool)
    if "height" in setting.conditions:
        tip, points, _ = setting.places(q)
        own = setting.high(*setting.places(q_from)[:2]) & setting.high(*setting.places(q_to)[:2])
        move = np.repeat(np.arange(len(starts)), np.diff([*starts, len(q)]))
        bad |= ~setting.high(tip, points) & own[move]  # ends that are low themselves are known to be
    bad = np.logical_or.reduceat(bad, starts)
    return bad | _touching_on(setting, q, starts) if "collision" in setting.conditions else bad


def _touching_on(setting, q, starts):
    """Moves on which the robot touches itself, (m,), for joints along them that begin at the rows ``starts``."""
    if not len(q):
        return np.zeros(0, dtype=bool)
    return np.logical_or.reduceat(setting.solids.touching(setting.effective(q)), starts)


def first_seen(seen, most):
    """Of the reflectors seen in each pose the first ones, at most so many; (n, k) masks."""
    return seen & (np.cumsum(seen, axis=1) <= most)
