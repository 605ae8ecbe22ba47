"""Where the poses of a measuring plan come from, how they are chosen and put in order.

These are the three groups of Nubiola 2011, section 7.2. Random poses are drawn uniformly in the joints, so that the
configuration is not restrained, until enough of them meet the conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.modeling.commanded_joints import METRES_PER_DEGREE, home_joints, rounded
from irbcal.option_values import Progress
from irbcal.planning import route
from irbcal.planning.conditions import Setting, counted, touching_on
from irbcal.planning.optimal_design import (
    CRITERIA,
    Chosen,
    DesignComparison,
    Model,
    compare,
    exchange,
)
from irbcal.planning.plan_options import PlanOptions
from irbcal.planning.scene import Scene
from irbcal.simulation.instruments import turned_away
from irbcal.simulation.pose_list import InRegion
from irbcal.units import DEG, MM
from irbcal.wording import first_of

AXIS_CONDITIONS = ("limits", "collision", "sight")
"""Conditions of moves of one joint: an operator turns the reflector there (Nubiola 2011, section 7.1), and they are not
random."""

BATCH = 5_000, 50_000
"""Random joints that are looked at together: at first, and when few are found."""
MOST_TRIED = 2_000_000
"""Random joints after which the search for poses is given up."""


@dataclass(frozen=True, eq=False)
class Tally(Locked):
    """How many candidates each condition removed, of those that the ones before it had left."""

    tried: int = 0
    removed: dict[str, int] = field(default_factory=dict)
    accepted: int = 0

    def sentence(self) -> str:
        """What removed how many, in words."""
        reasons = [f"{name} removed {count:,}" for name, count in self.removed.items()]
        return f"of {self.tried:,} candidates " + (", ".join(reasons) if reasons else "none was removed")


@dataclass(frozen=True, eq=False)
class Poses(Locked):
    """Poses that meet the conditions."""

    q: FloatArray
    """Shape (n, joints). Commanded joints, radians (metres for prismatic joints)."""
    visible: BoolArray
    """Shape (n, k). Which reflectors the tracker sees."""
    groups: NameArray
    """Shape (n,)."""
    tally: Tally

    def take(self, rows: IntArray) -> Poses:
        """Some of the poses, in this order."""
        return Poses(self.q[rows], self.visible[rows], self.groups[rows], self.tally)


def joined(sources: Sequence[Poses]) -> Poses:
    """Poses of several sources one after the other."""
    q, visible, groups = (
        np.concatenate([getattr(poses, name) for poses in sources]) for name in ("q", "visible", "groups")
    )
    return Poses(q, visible, groups, Tally())


def in_cube(centre: ArrayLike, edge: float) -> InRegion:
    """A region: tip inside a cube with edges along the base link's axes."""
    middle = np.asarray(centre, dtype=float)
    return lambda tip: np.all(np.abs(tip - middle) <= edge / 2, axis=1)


def random_poses(
    setting: Setting,
    count: int,
    group: str,
    seed: int,
    region: InRegion | None = None,
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
        Called with the draw of poses found after each batch.

    Raises
    ------
    MeasurementError
        If too few are found among `MOST_TRIED` random joints; the sentence counts what each condition removed.
    """
    tried, count_found = 0, 0
    removed: dict[str, int] = {}
    found_q, found_seen = [], []
    for draw in np.random.SeedSequence(seed).generate_state(MOST_TRIED // BATCH[0]):
        if count_found >= count or tried >= MOST_TRIED:
            break
        size = int(np.clip(tried, BATCH[0], min(BATCH[1], max(MOST_TRIED - tried, BATCH[0]))))
        q = rounded(setting.arm, setting.arm.random_joints(size, int(draw)))
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


def ordered(setting: Setting, poses: Poses, start: FloatArray, speed: FloatArray) -> tuple[Poses, BoolArray, BoolArray]:
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
    q_route = np.concatenate([start[None], poses.q])
    home = np.broadcast_to(home_joints(setting.arm), (len(bad), len(start)))
    stuck = blocked_moves(setting, q_route[bad], home) | blocked_moves(setting, home, q_route[bad + 1])
    over_home, blocked = np.zeros((2, len(poses.q)), dtype=bool)
    over_home[bad[~stuck]], blocked[bad[stuck]] = True, True
    return poses, over_home, blocked


def blocked_moves(setting: Setting, q_from: FloatArray, q_to: FloatArray) -> BoolArray:
    """Moves, linear in the joints, on which the robot touches itself or goes below the heights; shape (m,)."""
    if not len(q_from):
        return np.zeros(0, dtype=bool)
    q, starts = route.between(q_from, q_to, setting.arm.table.prismatic)
    bad = np.zeros(len(q), dtype=bool)
    if "height" in setting.conditions:
        tip, points, _ = setting.tip_and_reflectors(q)
        both_high = setting.high(*setting.tip_and_reflectors(q_from)[:2]) & setting.high(
            *setting.tip_and_reflectors(q_to)[:2]
        )
        move = np.repeat(np.arange(len(starts)), np.diff([*starts, len(q)]))
        bad |= ~setting.high(tip, points) & both_high[move]  # ends that are low themselves are known to be
    bad = np.logical_or.reduceat(bad, starts)
    return bad | touching_on(setting, q, starts) if "collision" in setting.conditions else bad


MOST_REFLECTORS = 3
"""Reflectors measured in a pose; more tell little about the robot."""
VOLUME_SAMPLES = 400


def samples(scene: Scene, seeds: Sequence[int], step: Progress) -> dict[str, FloatArray]:
    """Poses of cube and range where predicted positions are looked at, whether the tracker sees them or not."""
    step("the workspace")
    wide = replace(scene.setting, conditions=tuple({*scene.setting.conditions} & {"limits", "height", "collision"}))
    regions: dict[str, InRegion | None] = {"cube": in_cube(*scene.cube), "range": None}
    return {
        name: random_poses(wide, VOLUME_SAMPLES, name, seed, region).q
        for (name, region), seed in zip(regions.items(), seeds, strict=True)
    }


def optimal(
    scene: Scene,
    options: PlanOptions,
    model: Model,
    fixed_poses: Sequence[Poses],
    samples_of: Mapping[str, FloatArray],
    seeds: Sequence[int],
    step: Progress,
) -> tuple[Poses, DesignComparison, dict[str, Tally]]:
    """The poses that serve best of many candidates, half in the cube, half in the whole range.

    Parameters
    ----------
    scene : Scene
    options : PlanOptions
    model : Model
    fixed_poses : sequence of Poses
        Those that are measured anyway.
    samples_of : mapping of str to ndarray
        Where predicted positions are looked at, see `samples`.
    seeds : sequence of int
        For the candidates of the cube and of the range.
    step : callable

    Returns
    -------
    poses : Poses
    comparison : DesignComparison
    tallies : dict of str to Tally
        Of the candidates.
    """
    half = options.candidates // 2
    pools: list[Poses] = []
    tallies: dict[str, Tally] = {}
    kinds: tuple[tuple[int, str, InRegion | None, int], ...] = (
        (half, "iso_cube", in_cube(*scene.cube), seeds[0]),
        (options.candidates - half, "all_range", None, seeds[1]),
    )
    for count, group, region, seed in kinds:
        step(f"{count} candidates, {group}")
        pools.append(random_poses(scene.setting, count, group, seed, region))
        tallies[f"candidates, {group}"] = pools[-1].tally
    pool = joined(pools)
    measured = first_seen(pool.visible, MOST_REFLECTORS)
    step(f"{options.optimal} poses of {len(pool.q)} candidates")
    unmodelled = options.unmodelled if CRITERIA[options.criterion].IN_METRES else 0.0
    cared_for = np.concatenate([samples_of[name] for name in samples_of if options.volume in ("both", name)])
    most_seen = int(np.argmax(measured.sum(axis=0)))
    aim = model.aim(options.criterion, cared_for, most_seen, unmodelled)
    for poses in fixed_poses:
        aim = aim.with_given(model.candidates(poses.q, first_seen(poses.visible, MOST_REFLECTORS), unmodelled))
    rated = model.candidates(pool.q, measured, unmodelled)
    exchanged = exchange(rated, options.optimal, aim)
    step("random plans to compare with")
    comparison = compare(rated, exchanged, aim, seeds[0])
    if unmodelled:
        comparison = replace(
            comparison,
            scatter=_by_scatter(model, pool, measured, fixed_poses, (cared_for, most_seen), exchanged, seeds),
        )
    chosen = pool.take(exchanged.rows)
    groups = np.array([f"optimal_{group}" for group in chosen.groups], dtype=object)
    return Poses(chosen.q, chosen.visible, groups, Tally()), comparison, tallies


def _by_scatter(
    model: Model,
    pool: Poses,
    measured: BoolArray,
    fixed_poses: Sequence[Poses],
    where: tuple[FloatArray, int],
    exchanged: Chosen,
    seeds: Sequence[int],
) -> DesignComparison:
    """The comparison of chosen with random poses as if the model described all but the scatter of the points."""
    aim = model.aim("position", *where)
    for poses in fixed_poses:
        aim = aim.with_given(model.candidates(poses.q, first_seen(poses.visible, MOST_REFLECTORS)))
    rated = model.candidates(pool.q, measured)
    value = aim.value(rated.rows[exchanged.rows], rated.errors[exchanged.rows])
    return compare(rated, replace(exchanged, value=value), aim, seeds[0])


def in_order(
    scene: Scene, axis: Sequence[Poses], movable: Sequence[Poses], start: FloatArray
) -> tuple[Poses, BoolArray, list[str]]:
    """Axis moves first, as they are; then all others on a short way.

    Returns
    -------
    poses : Poses
    over_home : ndarray of bool, shape (n,)
        Poses to which the robot goes over its home joints.
    notes : list of str
    """
    setting = scene.setting
    notes: list[str] = []
    finished = list(axis)
    if axis:
        notes += _axis_notes(setting, axis[0])
    over_home: BoolArray = np.zeros(sum(len(poses.q) for poses in axis), dtype=bool)
    if movable:
        path, over, blocked = ordered(setting, joined(movable), axis[0].q[-1] if axis else start, scene.joint_speed)
        finished.append(path)
        if over.any():
            notes.append(f"to {int(over.sum())} poses the robot goes over its home joints: the direct way is not free")
        if blocked.any():
            numbers = [str(len(over_home) + k + 1) for k in np.flatnonzero(blocked)]
            notes.append(f"the way to pose {first_of(numbers, 8)} is not free: put a pose between by hand")
        over_home = np.append(over_home, over)
    return joined(finished), over_home, notes


def _axis_notes(setting: Setting, axis: Poses) -> list[str]:
    notes: list[str] = []
    _, points, looks = setting.tip_and_reflectors(axis.q)
    if looks is not None:
        turned = turned_away(points, looks, setting.tracker_position, setting.acceptance)
        count = int(np.any(axis.visible & turned, axis=1).sum())
        if count:
            notes.append(f"in {count} of {len(axis.q)} axis moves a reflector must be turned to the tracker by hand")
    if setting.heights is not None:
        tip, points, _ = setting.tip_and_reflectors(axis.q)
        low = ~setting.high(tip, points)
        if low.any():
            notes.append(
                f"axis moves below the height limits, which hold for random poses only: {int(low.sum())}, down to z = "
                f"{points[low][..., 2].min() / MM:.0f} mm; see that nothing stands there"
            )
    return notes
