"""Accuracy: statistics of measured against predicted points and poses, absolute and relative (Nubiola 2011, 7.7).

Every figure of accuracy that the program shows is computed here.

Whole poses are drawn again with replacement, because the points of one pose share its error. Intervals of mean,
sigma, mean + 3 sigma and rms are bias-corrected and accelerated (BCa; Efron 1987), with the acceleration from leaving
out one pose at a time; those of percentiles are plain percentile intervals, since leaving out one pose says nothing
about a percentile. There is none for the maximum: no resample can exceed it, see
`irbcal.validation.accuracy.largest_covers`.

Of more than `MOST_DRAWN` poses as many are drawn at random; intervals of n of N poses are narrowed by the root of n / N
(Bickel, Goetze, van Zwet 1997, "Resampling fewer than n observations").
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, consecutive, locked
from irbcal.distributions import normal_cdf, normal_quantile
from irbcal.error_statistics import statistics
from irbcal.errors import MeasurementError
from irbcal.measurement.cleaning import by_pose
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.registration import register
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import at_rows
from irbcal.units import MM

SAME_COMMAND = 0.1 * MM
"""Distance within which a command counts as the calibration's fake target, metres."""

PERCENTILES = (50, 90, 95, 99)
"""Percentiles that are reported."""


def percentiles(distance: ArrayLike) -> dict[str, float] | None:
    """`PERCENTILES` of distances in metres, interpolated linearly: ``p50_mm`` and so on; None for no distances."""
    d = np.asarray(distance)
    if not len(d):
        return None
    values = np.percentile(d if d.dtype == np.float32 else d / MM, PERCENTILES)
    in_mm = values.astype(float) / MM if d.dtype == np.float32 else values
    return {f"p{p}_mm": float(value) for p, value in zip(PERCENTILES, in_mm, strict=True)}


def figures(distance: ArrayLike) -> dict[str, float]:
    """`statistics` and `percentiles` of distances in metres, mm; empty for no distances."""
    return {**(statistics(distance) or {}), **(percentiles(distance) or {})}


def largest_covers(poses: int, confidence: float = 0.95) -> float:
    """Share of all poses whose error stays below the largest one seen, without any assumption on the distribution.

    The largest of n independent errors exceeds the share p of all errors with probability 1 - p^n (Wilks 1941).
    This stands in for an interval of the maximum, which resampling cannot give.

    Parameters
    ----------
    poses : int
        Poses drawn independently from those that are meant.
    confidence : float
    """
    return float((1.0 - confidence) ** (1.0 / poses))


# --- position and orientation of the tip ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class TipErrors(Locked):
    """Errors of whole poses, reduced to the tip link (Nubiola 2011, section 7.7.3.5, Table 7.9)."""

    pose: IntArray
    """Shape (k,). Rows of the point set's poses that were measured as poses."""
    T_world_tip: FloatArray
    """Shape (k, 4, 4). Measured."""
    T_predicted: FloatArray
    """Shape (k, 4, 4)."""

    @property
    def position(self) -> FloatArray:
        """Distance of measured from predicted origin, shape (k,), metres (Figure 7.10)."""
        return np.linalg.norm(self.T_world_tip[:, :3, 3] - self.T_predicted[:, :3, 3], axis=1)

    @property
    def rotation(self) -> FloatArray:
        """Angle between measured and predicted orientation, shape (k,), radians (Figure 7.11)."""
        return frames.rotation_distance(self.T_world_tip[:, :3, :3], self.T_predicted[:, :3, :3])


def tip_errors(robot: Robot, points: PointSet, source: str = "the measurements") -> TipErrors:
    """Poses of the tip as measured by three or more targets, or by targets with an orientation, and as predicted.

    So the thesis measures poses by targets 1, 2 and 3 (sections 7.7.3.4 and 7.7.3.5, Figures 7.8, 7.9, 7.10 and 7.11).
    The places of the targets in the tip link are the robot's own. Three points of a pose give its tip by the best
    rigid fit; so the errors of the reflectors' places appear as errors of the tip, but the lever from tip to
    reflector does not enlarge the position error.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In the robot's measuring frame; every target must be one of the robot's.
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        If no pose was measured as a whole, or the targets lie on a line.
    """
    rows = np.flatnonzero(points.oriented(robot))
    if len(rows):
        pose, T = _tips_of_frames(robot, points, rows)
    else:
        pose, T = _tips_of_three(robot, points, source)
    return TipErrors(pose, T, robot.T_world_base @ points.tips(robot)[pose])


def _tips_of_frames(robot: Robot, points: PointSet, rows: IntArray) -> tuple[IntArray, FloatArray]:
    """Tips from measured target frames; the first of a pose counts."""
    assert points.rotation is not None
    pose, first = np.unique(points.pose[rows], return_index=True)
    rows = rows[first]
    names = points.names()[rows]
    T_tip_target = np.array([frames.transform(robot.target_rotations[n], robot.targets[n]) for n in names])
    T_world_target = np.tile(np.eye(4), (len(rows), 1, 1))
    T_world_target[:, :3, :3], T_world_target[:, :3, 3] = points.rotation[rows], points.xyz[rows]
    return pose, T_world_target @ frames.inverse(T_tip_target)


def _tips_of_three(robot: Robot, points: PointSet, source: str) -> tuple[IntArray, FloatArray]:
    every = np.ones(len(points), dtype=bool)
    measured = by_pose(points.pose, points.names(), points.xyz, every, points.target_names)
    poses = None
    if len(points.target_names) >= 3:
        poses = register(measured, points.target_names, source, robot.targets, plural="targets")
    if poses is None:
        raise MeasurementError(
            "position and orientation of the flange need three targets in a pose, or measured orientations; targets "
            f"are {', '.join(points.target_names)}",
            file=source,
        )
    return np.flatnonzero(poses.with_references), frames.inverse(poses.T_frame_pose[poses.with_references])


# --- relative accuracy ------------------------------------------------------------------------------------


def error_vectors(robot: Robot, points: PointSet) -> FloatArray:
    """Measured minus predicted places, shape (m, 3), metres, in the measuring frame."""
    return points.xyz - points.predicted(robot)


def turns(robot: Robot, points: PointSet) -> FloatArray | None:
    """Orientation error of each point, NaN where there is none; None where no point has one."""
    oriented = points.oriented(robot)
    if not oriented.any():
        return None
    out = np.full(len(points), np.nan)
    out[oriented] = rotation_distances(robot, points)
    return out


def within_sphere(robot: Robot, points: PointSet, center: ArrayLike, diameter: float) -> BoolArray:
    """Which points were measured inside a sphere given in the base link, shape (m,) (Figure 7.12).

    Parameters
    ----------
    robot : Robot
    points : PointSet
    center : array_like, shape (3,)
        Metres, in the base link.
    diameter : float
        Metres.
    """
    at_base = frames.apply(frames.inverse(robot.T_world_base), points.xyz)
    return np.linalg.norm(at_base - np.asarray(center, dtype=float), axis=1) <= diameter / 2


def relative_to_virtual_frame(robot: Robot, points: PointSet) -> tuple[FloatArray, FloatArray]:
    """Errors that are left when the measured places may be shifted as a whole (Nubiola 2011, section 7.7.3.6).

    The thesis has them in Table 7.10 and Figure 7.13.

    Returns
    -------
    distance : ndarray, shape (m,)
        Of the error vectors from their mean, metres.
    shift : ndarray, shape (3,)
        The mean error vector along the axes of the base link, metres.
    """
    error = error_vectors(robot, points)
    mean = error.mean(axis=0)
    return np.linalg.norm(error - mean, axis=1), robot.T_world_base[:3, :3].T @ mean


def relative_to_three_points(
    robot: Robot, points: PointSet, rows: Sequence[int] | IntArray | None = None
) -> tuple[FloatArray, IntArray]:
    """Errors in a frame of three measured points, as a user teaches one (Nubiola 2011, section 7.7.3.7).

    The frame is made (eqs. 3.13, 3.14, 3.15, 3.16, 3.17, 3.18 and 3.19) of the three points as measured and as
    predicted; all others are compared in these frames. Errors of the three points enter all others. The thesis has them
    in Table 7.11 and Figure 7.14.

    Parameters
    ----------
    robot : Robot
    points : PointSet
    rows : sequence of three int, optional
        The points: two on the x axis, one on the side of y; by default `widest_triangle`.

    Returns
    -------
    distance : ndarray, shape (m - 3,)
        Of all points but the three, metres.
    rows : ndarray of int, shape (3,)

    Raises
    ------
    MeasurementError
        If there are fewer than four points or the three lie on a line.
    """
    if len(points) < 4:
        raise MeasurementError(f"a frame of three points leaves nothing to compare of {len(points)} points")
    three = widest_triangle(points.xyz) if rows is None else np.asarray(rows, dtype=int)
    predicted = points.predicted(robot)
    try:
        measured = frames.apply(frames.inverse(frames.from_three_points(*points.xyz[three])), points.xyz)
        predicted = frames.apply(frames.inverse(frames.from_three_points(*predicted[three])), predicted)
    except ValueError as error:
        raise MeasurementError(f"the frame of relative errors: {error}") from None
    judged = np.setdiff1d(np.arange(len(points)), three)
    return np.linalg.norm(measured[judged] - predicted[judged], axis=1), three


def widest_triangle(xyz: FloatArray) -> IntArray:
    """Three points far apart, found without looking at any error.

    The farthest from the middle, the farthest from that one, and the farthest from the line through both.

    Parameters
    ----------
    xyz : ndarray, shape (m, 3)

    Returns
    -------
    ndarray of int, shape (3,)
    """
    first = int(np.argmax(np.linalg.norm(xyz - xyz.mean(axis=0), axis=1)))
    second = int(np.argmax(np.linalg.norm(xyz - xyz[first], axis=1)))
    third = int(np.argmax(np.linalg.norm(frames.cross(xyz - xyz[first], xyz[second] - xyz[first]), axis=1)))
    return np.array([first, second, third])


EXPECTED_SHARE = 0.95
"""Share of a coordinate's errors that an interval is made to hold."""

MOST_POSES = 5000
"""Poses whose intervals are counted; of more, ones drawn at random."""


def predictions(robot: Robot, points: PointSet) -> tuple[FloatArray, FloatArray] | None:
    """Where a calibrated robot expects measured points, and how well it knows that.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In its measuring frame; their last moves and loads count.

    Returns
    -------
    position, interval : ndarray, shape (m, 3)
        Metres; the second is the half-width that holds 95 % of a coordinate's errors.

    ``None`` in place of both where too little is known of the robot's certainty.
    """
    certainty = robot.certainty
    if (
        certainty is None
        or not len(points)
        or any(certainty.left_out(points.target_names[k]) is None for k in set(points.target))
    ):
        return None
    position, width = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    for k in np.unique(points.target):
        rows_of_target = points.target == k
        rows = points.pose[rows_of_target]
        previous = None if points.previous is None else points.previous[rows]
        known: dict[str, Any] = at_rows(points.inputs, rows)
        predicted = robot.predict(points.q[rows], previous, points.target_names[k], **known)
        position[rows_of_target], width[rows_of_target] = predicted.position, predicted.interval
    return position, width


def coverage(robot: Robot, points: PointSet, moves: bool = False) -> dict[str, Any] | None:
    """How many measured coordinates lie within the predicted intervals.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In its measuring frame; not those of its fit.
    moves : bool
        Count lengths of the ways of each target from pose to pose in place of coordinates: where the base was placed
        on these points.

    Returns
    -------
    dict or None
        ``expected`` share, ``of`` what; ``parts``: for ``all`` and for poses ``within`` and ``outside`` the joint
        ranges of the fit the number ``n`` of them, the share ``inside`` and the median half-width ``u95_mm``; and
        ``targets``: the same for each target. None where nothing is known of the robot's certainty.
    """
    if points.poses > MOST_POSES:
        sample = np.random.default_rng(0).permutation(points.poses)[:MOST_POSES]
        points = points.select(np.isin(np.arange(points.poses), sample))
    predicted = predictions(robot, points)
    if predicted is None or robot.certainty is None:
        return None
    position, width = predicted
    inside = np.abs(points.xyz - position) < width
    outside, target = robot.certainty.outside(points.q)[points.pose], points.target
    if moves:
        order = np.lexsort((points.pose, target))
        ways = [rows for rows in np.split(order, np.flatnonzero(np.diff(target[order])) + 1) if len(rows) > 1]
        if not ways:
            return None
        inside, width = (
            np.concatenate(each)[:, None]
            for each in zip(*(_moves_within_intervals(robot, points, w) for w in ways), strict=True)
        )
        outside = np.concatenate([outside[rows[1:]] | outside[rows[:-1]] for rows in ways])
        target = np.concatenate([target[rows[1:]] for rows in ways])
    masks: dict[str, BoolArray] = {"all": np.ones(len(inside), dtype=bool), "within": ~outside, "outside": outside}

    def shares(masks: Mapping[str, BoolArray]) -> dict[str, dict[str, float]]:
        return {
            name: {
                "n": inside[mask].size,
                "inside": float(inside[mask].mean()),
                "u95_mm": float(np.median(width[mask])) / MM,
            }
            for name, mask in masks.items()
            if mask.any()
        }

    return {
        "expected": EXPECTED_SHARE,
        "of": "lengths of moves" if moves else "coordinates",
        "parts": shares(masks),
        "targets": shares({name: target == k for k, name in enumerate(points.target_names)}),
    }


def _moves_within_intervals(robot: Robot, points: PointSet, rows: IntArray) -> tuple[BoolArray, FloatArray]:
    """Whether measured lengths of a target's ways from row to row lie within their intervals, and half-widths, m."""
    pose = points.pose[rows]
    known = at_rows(points.inputs, pose)
    previous = None if points.previous is None else points.previous[pose]
    length, width = robot.predict_moves(points.q[pose], previous, points.target_names[points.target[rows[0]]], **known)
    return np.abs(np.linalg.norm(np.diff(points.xyz[rows], axis=0), axis=1) - length) < width, width


def coverage_in_words(coverage: Mapping[str, Any]) -> str:
    """One sentence on what `coverage` found."""
    ranges = coverage["parts"]
    total = ranges["all"]
    text = (
        f"{total['inside']:.1%} of {total['n']} measured {coverage['of']} lie within their predicted 95 % intervals "
        f"(median half-width {total['u95_mm']:.3f} mm)"
    )
    if "outside" in ranges:
        inner = f"{ranges['within']['inside']:.1%} within the joint ranges of the fit, " if "within" in ranges else ""
        text += f": {inner}{ranges['outside']['inside']:.1%} outside"
    return text + "."


# --- expected against verified errors -----------------------------------------------------------------------


def expected_and_verified(robot: Robot, nominal: Arm, expected: PointSet, verified: PointSet) -> dict[str, Any]:
    """Errors as expected from uncorrected poses, and as found once the same poses were corrected (section 7.6).

    The expected error is the distance of a measured point from the calibrated model ``T_R6(q_A)`` (Nubiola 2011, Figure
    7.3); fake targets ``q_B`` bring the robot to where the nominal model ``T_6(q_A)`` means to be, and the verified
    error is what they miss that by (section 7.4).

    The verification commanded fake targets; what was meant is where the nominal arm would have been with the joints
    that the pose of the same name has in the first measurements, on the calibration's base and with its tool.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
    expected : PointSet
        Measured at uncorrected joints.
    verified : PointSet
        Measured at corrected joints.

    Returns
    -------
    dict
        Statistics of errors under ``uncorrected`` (distance from what was meant, without correction), ``expected``
        (distance from the calibrated model's prediction) and ``verified`` (distance from what was meant, with
        correction); the same ``per_group``; ``command_mm``: largest distance by which the commands miss the
        calibration's own fake targets; ``poses``: their numbers, and the names of those set aside because their
        commands are no fake targets of this calibration, such as targets that could not be corrected.

    Raises
    ------
    MeasurementError
        If no pose of the verification has its name in the first measurements.
    """
    meant = replace_geometry(robot, nominal)
    row_of = {name: k for k, name in enumerate(expected.pose_ids)}
    shared = np.array([name in row_of for name in verified.pose_ids], dtype=bool)
    if not shared.any():
        raise MeasurementError(
            "the verification has no pose of the same name as the measurements: what was meant is unknown"
        )
    verified = verified.select(shared)
    expected_points = replace(verified, q=expected.q[[row_of[name] for name in verified.pose_ids]], previous=None)
    reached = robot.forward(verified.q, verified.previous)
    apart = np.linalg.norm(reached[:, :3, 3] - meant.poses(expected_points.q)[:, :3, 3], axis=1)
    ours = apart <= SAME_COMMAND
    unlike: list[str] = []
    if ours.mean() > 0.5:  # else the whole run was made with other fake targets
        unlike = [str(name) for name in verified.pose_ids[~ours]]
        verified, expected_points, apart = verified.select(ours), expected_points.select(ours), apart[ours]
    expected = expected.select(np.isin(expected.pose_ids, verified.pose_ids))  # the same poses before and after
    errors = {
        "uncorrected": (distances(meant, expected), expected),
        "expected": (distances(robot, expected), expected),
        "verified": (distances(meant, expected_points), verified),
    }
    groups = sorted({str(g) for g in [*expected.groups, *verified.groups] if g})
    return {
        **{name: statistics(d) for name, (d, _) in errors.items()},
        "per_group": {
            g: {name: statistics(d[points.groups[points.pose] == g]) for name, (d, points) in errors.items()}
            for g in groups
        },
        "command_mm": float(apart.max() / MM),
        "poses": {"expected": expected.poses, "verified": verified.poses, "set_aside": unlike},
    }


def replace_geometry(robot: Robot, nominal: Arm) -> Robot:
    """The robot that would have the nominal arm on the same base with the same tool."""
    return robot.replace(arm=nominal, joint_map=JointMap.identity(nominal))


RESAMPLES = 2000
LEVEL = 0.95
FEWEST_POSES_FOR_INTERVALS = 10
"""Poses below which intervals would be far too narrow: none are given then."""

MOMENTS = ("mean_mm", "sigma_mm", "mean_plus_3sigma_mm", "rms_mm")
MOST_DRAWN = 2000
"""Poses that resamples are made of at most."""
BLOCK = 4_000_000
"""Numbers that are worked on at a time, in each thread."""
NUMBER_S = 1e-8
"""Seconds that a point takes in a resample."""


def draws(poses: int, resamples: int = RESAMPLES, seed: int = 0) -> Iterator[NDArray[np.int32]]:
    """How often each pose is in each resample.

    Returns
    -------
    iterator of ndarray of int, shape (block, poses)
        Blocks of resamples; the same for the same seed whatever their size.
    """
    rng = np.random.default_rng(seed)
    step = max(1, BLOCK // poses)
    for start in range(0, resamples, step):
        k = min(step, resamples - start)
        picked = rng.integers(poses, size=(k, poses))
        picked += poses * np.arange(k)[:, None]
        yield np.bincount(picked.ravel(), minlength=k * poses).reshape(k, poses).astype(np.int32)


@lru_cache(maxsize=1)
def _kept_draws(poses: int, resamples: int, seed: int) -> tuple[NDArray[np.int32], ...]:
    """`draws`, which several targets and models of the same poses share."""
    return locked([*draws(poses, resamples, seed)])


def intervals(
    distance: ArrayLike, pose: ArrayLike, resamples: int = RESAMPLES, seed: int = 0, level: float = LEVEL
) -> dict[str, list[float]] | None:
    """Bootstrap intervals of the statistics of distances.

    Parameters
    ----------
    distance : ndarray, shape (m,)
        Metres.
    pose : ndarray, shape (m,)
        Pose of each distance.
    resamples, seed : int
    level : float

    Returns
    -------
    dict of str to [float, float], or None
        Low and high ends in mm for the keys of `MOMENTS` and ``p50_mm`` and so on; None for fewer poses than
        `FEWEST_POSES_FOR_INTERVALS`.
    """
    row = consecutive(pose)
    n = int(row.max(initial=-1)) + 1
    if n < FEWEST_POSES_FOR_INTERVALS:
        return None
    if n > MOST_DRAWN:
        sample = _drawn_poses(n, seed)[row]
        part, part_row = np.asarray(distance, dtype=float)[sample], row[sample]
        del row, sample  # of millions of poses
        ends_of = intervals(part, part_row, resamples, seed, level)
        assert ends_of is not None
        near, whole = figures(part), figures(distance)
        return {name: _narrowed(ends, near[name], whole[name], n) for name, ends in ends_of.items()}
    d = np.asarray(distance, dtype=float) / MM
    sums = _Sums(d, row, n)
    order = np.argsort(d, kind="stable")
    step = max(1, BLOCK // len(d))

    def of_block(count: NDArray[np.int32]) -> tuple[FloatArray, FloatArray]:
        blocks = [_percentiles(d[order], count[k : k + step], row[order]) for k in range(0, len(count), step)]
        return sums.moments(*(count @ s for s in sums.by_pose)), np.concatenate(blocks, axis=1)

    counts = _kept_draws(n, resamples, seed) if n * resamples <= BLOCK else draws(n, resamples, seed)
    blocks = list(parallel.threads(of_block, counts, NUMBER_S * resamples * len(d)))
    moments, quantiles = (np.concatenate(arrays, axis=1) for arrays in zip(*blocks, strict=True))
    total = [s.sum() for s in sums.by_pose]
    estimate = sums.moments(*total)
    left_out = sums.moments(*(t - s for t, s in zip(total, sums.by_pose, strict=True)))
    out = {
        name: bca(replicates, value, jackknife, level)
        for name, replicates, value, jackknife in zip(MOMENTS, moments, estimate, left_out, strict=True)
    }
    ends = 100 * np.array([0.5 - level / 2, 0.5 + level / 2])
    for p, replicates in zip(PERCENTILES, quantiles, strict=True):
        out[f"p{p}_mm"] = np.percentile(replicates, ends).tolist()
    return out


def difference(
    values: ArrayLike, resamples: int = RESAMPLES, seed: int = 0, level: float = LEVEL
) -> list[float] | None:
    """BCa interval of the mean of one value for each pose; None for fewer than `FEWEST_POSES_FOR_INTERVALS`.

    Parameters
    ----------
    values : ndarray, shape (n,)
    resamples, seed : int
    level : float

    Returns
    -------
    [float, float] or None
        In the unit of the values.
    """
    v = np.asarray(values, dtype=float)
    n = len(v)
    if n < FEWEST_POSES_FOR_INTERVALS:
        return None
    if n > MOST_DRAWN:
        sample = v[_drawn_poses(n, seed)]
        ends = difference(sample, resamples, seed, level)
        return None if ends is None else _narrowed(ends, float(sample.mean()), float(v.mean()), n)
    counts = _kept_draws(n, resamples, seed) if n * resamples <= BLOCK else draws(n, resamples, seed)
    replicates = np.concatenate([count @ v / n for count in counts])
    return bca(replicates, v.mean(), (v.sum() - v) / (n - 1), level)


def bca(replicates: FloatArray, estimate: float, jackknife: FloatArray, level: float = LEVEL) -> list[float]:
    """Bias-corrected and accelerated interval (Efron 1987).

    Parameters
    ----------
    replicates : ndarray, shape (resamples,)
        The statistic of each resample.
    estimate : float
        That of the data.
    jackknife : ndarray, shape (n,)
        That of the data without one pose each.
    level : float
    """
    count = len(replicates)
    share = (np.sum(replicates < estimate) + 0.5 * np.sum(replicates == estimate)) / count
    bias = normal_quantile(np.clip(share, 0.5 / count, 1 - 0.5 / count))
    u = jackknife.mean() - jackknife
    spread = np.sum(u**2)
    acceleration = np.sum(u**3) / (6 * spread**1.5) if spread > 0 else 0.0
    z = bias + normal_quantile([0.5 - level / 2, 0.5 + level / 2])
    ends = normal_cdf(bias + z / (1 - acceleration * z))
    return np.percentile(replicates, 100 * ends).tolist()


def _drawn_poses(n: int, seed: int) -> BoolArray:
    """Which of n poses stand for all."""
    return np.isin(np.arange(n), np.random.default_rng(seed).permutation(n)[:MOST_DRAWN])


def _narrowed(ends: list[float], near: float, total: float, n: int) -> list[float]:
    """The interval of n poses from that of `MOST_DRAWN` of them, with the statistic of the part and of all."""
    return [total + (end - near) * float(np.sqrt(MOST_DRAWN / n)) for end in ends]


class _Sums:
    """Sums over each of n poses of distances (m,), from which moments of any resample follow."""

    def __init__(self, d: FloatArray, pose: IntArray, n: int) -> None:
        self.shift = float(d.mean())  # keeps the digits of sigma
        offset = d - self.shift
        self.by_pose = [np.bincount(pose, w, n).astype(float) for w in (np.ones_like(d), offset, offset**2)]

    def moments(self, s0: FloatArray, s1: FloatArray, s2: FloatArray) -> FloatArray:
        """`MOMENTS` from count, sum and sum of squares of the shifted distances, shape (4, ...)."""
        mean = s1 / s0
        variance = np.maximum(s2 - s1 * mean, 0.0)
        sigma = np.sqrt(variance / np.maximum(s0 - 1, 1))
        mean = mean + self.shift
        return np.array([mean, sigma, mean + 3 * sigma, np.sqrt(variance / s0 + mean**2)])


def _percentiles(d: FloatArray, count: NDArray[np.int32], pose: IntArray) -> FloatArray:
    """Linear percentiles of resamples, shape (percentiles, k).

    Parameters
    ----------
    d : ndarray, shape (m,)
        Sorted values.
    count : ndarray of int, shape (k, poses)
        How often each pose is in each resample.
    pose : ndarray of int, shape (m,)
        Pose of each value.
    """
    m, width = len(d), max(1, int(np.sqrt(len(d))))
    chunks = -(-m // width)
    poses = count.shape[1]  # values of each pose in stretches of sorted ones
    in_part = np.bincount(pose * chunks + np.arange(m) // width, minlength=poses * chunks).reshape(poses, chunks)
    until = np.cumsum(np.rint(count.astype(np.float32) @ in_part.astype(np.float32)).astype(np.int32), axis=1)
    last = until[:, -1:] - 1
    rank = last * (np.array(PERCENTILES) / 100)
    low = np.floor(rank)
    ranks = np.hstack([low, np.minimum(low + 1, last)]).astype(np.int32)
    row = np.arange(len(count))[:, None]
    chunk = (until[:, None, :] <= ranks[:, :, None]).sum(axis=2)
    count_below = np.where(chunk > 0, until[row, chunk - 1], 0)
    within = chunk[:, :, None] * width + np.arange(width)
    inside = within < m
    counts = count[row[:, :, None], pose[np.minimum(within, m - 1)]] * inside
    ends = d[chunk * width + (count_below[:, :, None] + np.cumsum(counts, axis=2) <= ranks[:, :, None]).sum(axis=2)]
    first, second = np.hsplit(ends, 2)
    return (first + (rank - low) * (second - first)).T
