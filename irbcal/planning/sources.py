"""Where the poses of a plan come from: moves of one joint, the ISO cube, the whole range.

These are the three groups of Nubiola 2011, section 7.2. Random poses are drawn uniformly in the joints, so that the
configuration is not restrained, until enough of them meet the conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.modeling.home import METRES_PER_DEGREE, home_joints, rounded
from irbcal.planning.conditions import Setting, counted
from irbcal.units import DEG

AXIS_CONDITIONS = ("limits", "collision", "sight")
"""Conditions of moves of one joint: an operator turns the reflector there (Nubiola 2011, section 7.1), and they are not
random."""

FEW, MANY = 18, 158
"""Poses of the two sets of axis moves of a six-axis arm (Nubiola 2011, section 7.2)."""

BATCH = 5_000, 50_000
"""Random joints that are looked at together: at first, and when few are found."""
MOST_TRIED = 2_000_000
"""Random joints after which the search for poses is given up."""

Region: TypeAlias = "Callable[[FloatArray], BoolArray]"
"""From tips (n, 3) in the base link, metres, to a mask (n,) of those inside."""


@dataclass(frozen=True, eq=False)
class Tally(Locked):
    """How many candidates each condition removed, of those that the ones before it had left."""

    tried: int = 0
    removed: dict[str, int] = field(default_factory=dict)
    kept: int = 0

    def sentence(self) -> str:
        """What removed how many, in words."""
        reasons = [f"{name} removed {count:,}" for name, count in self.removed.items()]
        return f"of {self.tried:,} candidates " + (", ".join(reasons) if reasons else "none was removed")


@dataclass(frozen=True, eq=False)
class Poses(Locked):
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

    q: FloatArray
    seen: BoolArray
    groups: NameArray
    tally: Tally

    def take(self, rows: IntArray) -> Poses:
        """Some of the poses, in this order."""
        return Poses(self.q[rows], self.seen[rows], self.groups[rows], self.tally)


def joined(sources: Sequence[Poses]) -> Poses:
    """Poses of several sources one after the other."""
    q, visible, groups = (
        np.concatenate([getattr(poses, name) for poses in sources]) for name in ("q", "seen", "groups")
    )
    return Poses(q, visible, groups, Tally())


def in_cube(centre: ArrayLike, edge: float) -> Region:
    """A region: tip inside a cube with edges along the base link's axes."""
    middle = np.asarray(centre, dtype=float)
    return lambda tip: np.all(np.abs(tip - middle) <= edge / 2, axis=1)


def random_poses(
    setting: Setting,
    count: int,
    group: str,
    seed: int,
    region: Region | None = None,
    step: Callable[[int], None] | None = None,
) -> Poses:
    """Random poses that meet the conditions (Nubiola 2011, section 7.2).

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

    Raises
    ------
    MeasurementError
        If too few are found among `MOST_TRIED` random joints; the sentence counts what each condition removed.
    """
    tried, count_found = 0, 0
    removed: dict[str, int] = {}
    found_q, found_seen = [], []
    for number in np.random.SeedSequence(seed).generate_state(MOST_TRIED // BATCH[0]):
        if count_found >= count or tried >= MOST_TRIED:
            break
        size = int(np.clip(tried, BATCH[0], min(BATCH[1], max(MOST_TRIED - tried, BATCH[0]))))
        q = rounded(setting.arm, setting.arm.random_joints(size, int(number)))
        tried += len(q)
        outside = {}
        if region is not None:
            inside = region(setting.robot.poses(q)[:, :3, 3])
            outside = {"place": int((~inside).sum())}
            q = q[inside]
        keep, visible, dropped = counted(setting, q)
        for name, number_removed in (outside | dropped).items():
            removed[name] = removed.get(name, 0) + number_removed
        found_q.append(q[keep])
        found_seen.append(visible[keep])
        count_found += int(keep.sum())
        if step is not None:
            step(min(count_found, count))
    tally = Tally(tried, removed, count_found)
    if count_found < count:
        raise MeasurementError(
            f"only {count_found} of {count} {group} poses meet the conditions: {tally.sentence()}; "
            "ask for fewer, move the tracker or switch a condition off"
        )
    k = len(setting.targets.names)
    q = np.concatenate([np.zeros((0, setting.arm.lower.size)), *found_q])[:count]
    visible = np.concatenate([np.zeros((0, k), dtype=bool), *found_seen])[:count]
    return Poses(q, visible, np.full(count, group, dtype=object), tally)


def axis_moves(setting: Setting, wide: bool = False) -> Poses:
    """Moves of one joint at a time, the others at home (Nubiola 2011, sections 7.1 and 7.2).

    Three angles, -30, 0 and 30 degrees; or ``wide``: from -40 to 40 degrees and back by 10 degrees, the last joint from
    -180 to 180 degrees and back. That makes 18 and 158 poses for six joints. Where limits are too near, all angles of a
    joint are scaled down.

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
    q_moves: list[FloatArray] = []
    names: list[str] = []
    for joint in range(len(home)):
        angles = np.array([-30.0, 0.0, 30.0])
        if wide:
            last = 180.0 if joint == len(home) - 1 else 40.0
            grid = np.arange(-last, last + 1, 10.0)
            angles = np.concatenate([grid, grid[-2::-1]])
        moves = angles * (METRES_PER_DEGREE if arm.table.prismatic[joint] else DEG)
        room = min(upper[joint] - home[joint], home[joint] - lower[joint])
        moves = moves * min(1.0, room / np.abs(moves).max())
        q_joint = np.tile(home, (len(moves), 1))
        q_joint[:, joint] += moves
        q_moves.append(q_joint)
        names += [f"axis{joint + 1}"] * len(moves)
    q, groups = rounded(arm, np.concatenate(q_moves)), np.array(names, dtype=object)
    keep, visible, removed = counted(setting, q, AXIS_CONDITIONS)
    tally = Tally(len(q), removed, int(keep.sum()))
    if not keep.all():
        where = ", ".join(dict.fromkeys(groups[~keep]))
        raise MeasurementError(
            f"the axis moves do not meet the conditions (poses of {where}): {tally.sentence()}; "
            "move the tracker, leave the axis moves out or switch a condition off"
        )
    for group in dict.fromkeys(groups):
        rows = groups == group
        common = np.all(visible[rows], axis=0)
        if not common.any():
            raise MeasurementError(
                f"no reflector can be seen in all poses of {group}, as a circle fit needs: the arm hides each in some; "
                "move the tracker, leave the axis moves out or switch the condition sight off"
            )
        visible[rows] = common
    return Poses(q, visible, groups, tally)


def first_seen(visible: BoolArray, limit: int) -> BoolArray:
    """Of the reflectors seen in each pose the first ones, at most so many; (n, k) masks."""
    count: IntArray = np.cumsum(visible, axis=1)
    return visible & (count <= limit)
