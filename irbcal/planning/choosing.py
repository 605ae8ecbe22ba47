"""How the poses of a plan are chosen and put in order, from what is wished and from the scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.home import home_joints
from irbcal.planning import route
from irbcal.planning.conditions import Setting, touching_on
from irbcal.planning.exchange import Chosen, DesignComparison, compare, exchange
from irbcal.planning.information import Model
from irbcal.planning.scene import Scene
from irbcal.planning.sources import Poses, Region, Tally, first_seen, in_cube, joined, random_poses
from irbcal.planning.wish import Wish
from irbcal.simulation.tracker import turned_away
from irbcal.units import MM


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
        tip, points, _ = setting.places(q)
        both_high = setting.high(*setting.places(q_from)[:2]) & setting.high(*setting.places(q_to)[:2])
        move = np.repeat(np.arange(len(starts)), np.diff([*starts, len(q)]))
        bad |= ~setting.high(tip, points) & both_high[move]  # ends that are low themselves are known to be
    bad = np.logical_or.reduceat(bad, starts)
    return bad | touching_on(setting, q, starts) if "collision" in setting.conditions else bad


MOST_REFLECTORS = 3
"""Reflectors measured in a pose; more tell little about the robot."""
VOLUME_SAMPLES = 400

Step: TypeAlias = "Callable[[str], object]"
"""Called with a text at the beginning of each step."""


def samples(scene: Scene, seeds: Sequence[int], step: Step) -> dict[str, FloatArray]:
    """Poses of cube and range where predicted positions are looked at, whether the tracker sees them or not."""
    step("the workspace")
    wide = replace(scene.setting, conditions=tuple({*scene.setting.conditions} & {"limits", "height", "collision"}))
    regions: dict[str, Region | None] = {"cube": in_cube(*scene.cube), "range": None}
    return {
        name: random_poses(wide, VOLUME_SAMPLES, name, seed, region).q
        for (name, region), seed in zip(regions.items(), seeds, strict=True)
    }


def optimal(
    scene: Scene,
    wish: Wish,
    model: Model,
    fixed_poses: Sequence[Poses],
    samples_of: Mapping[str, FloatArray],
    seeds: Sequence[int],
    step: Step,
) -> tuple[Poses, DesignComparison, dict[str, Tally]]:
    """The poses that serve best of many candidates, half in the cube, half in the whole range.

    Parameters
    ----------
    scene : Scene
    wish : Wish
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
    half = wish.candidates // 2
    pools: list[Poses] = []
    tallies: dict[str, Tally] = {}
    kinds: tuple[tuple[int, str, Region | None, int], ...] = (
        (half, "iso_cube", in_cube(*scene.cube), seeds[0]),
        (wish.candidates - half, "all_range", None, seeds[1]),
    )
    for count, group, region, seed in kinds:
        step(f"{count} candidates, {group}")
        pools.append(random_poses(scene.setting, count, group, seed, region))
        tallies[f"candidates, {group}"] = pools[-1].tally
    pool = joined(pools)
    measured = first_seen(pool.seen, MOST_REFLECTORS)
    step(f"{wish.optimal} poses of {len(pool.q)} candidates")
    imagined = wish.imagined if wish.criterion == "position" else 0.0
    cared_for = np.concatenate([samples_of[name] for name in samples_of if wish.volume in ("both", name)])
    most_seen = int(np.argmax(measured.sum(axis=0)))
    aim = model.aim(wish.criterion, cared_for, most_seen, imagined)
    for poses in fixed_poses:
        aim = aim.with_given(model.candidates(poses.q, first_seen(poses.seen, MOST_REFLECTORS), imagined))
    rated = model.candidates(pool.q, measured, imagined)
    exchanged = exchange(rated, wish.optimal, aim)
    step("random plans to compare with")
    comparison = compare(rated, exchanged, aim, seeds[0])
    if imagined:
        comparison = replace(
            comparison,
            scatter=_by_scatter(model, pool, measured, fixed_poses, (cared_for, most_seen), exchanged, seeds),
        )
    chosen = pool.take(exchanged.rows)
    groups = np.array([f"optimal_{group}" for group in chosen.groups], dtype=object)
    return Poses(chosen.q, chosen.seen, groups, Tally()), comparison, tallies


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
        aim = aim.with_given(model.candidates(poses.q, first_seen(poses.seen, MOST_REFLECTORS)))
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
    done = list(axis)
    if axis:
        notes += _axis_notes(setting, axis[0])
    over_home: BoolArray = np.zeros(sum(len(poses.q) for poses in axis), dtype=bool)
    if movable:
        path, over, blocked = ordered(setting, joined(movable), axis[0].q[-1] if axis else start, scene.joint_speed)
        done.append(path)
        if over.any():
            notes.append(f"to {int(over.sum())} poses the robot goes over its home joints: the direct way is not free")
        if blocked.any():
            numbers = [str(len(over_home) + k + 1) for k in np.flatnonzero(blocked)]
            more = " …" if len(numbers) > 8 else ""
            notes.append(f"the way to pose {', '.join(numbers[:8])}{more} is not free: put a pose between by hand")
        over_home = np.append(over_home, over)
    return joined(done), over_home, notes


def _axis_notes(setting: Setting, axis: Poses) -> list[str]:
    notes: list[str] = []
    _, points, looks = setting.places(axis.q)
    if looks is not None:
        turned = turned_away(points, looks, setting.place, setting.acceptance)
        count = int(np.any(axis.seen & turned, axis=1).sum())
        if count:
            notes.append(f"in {count} of {len(axis.q)} axis moves a reflector must be turned to the tracker by hand")
    if setting.heights is not None:
        tip, points, _ = setting.places(axis.q)
        low = ~setting.high(tip, points)
        if low.any():
            notes.append(
                f"axis moves below the height limits, which hold for random poses only: {int(low.sum())}, down to z = "
                f"{points[low][..., 2].min() / MM:.0f} mm; see that nothing stands there"
            )
    return notes
