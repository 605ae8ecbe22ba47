"""The main job from measurements to a proven calibration, as plain functions."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.files import urdf as urdf_module
from irbcal.identification import outliers
from irbcal.identification.axes import GROUPS
from irbcal.identification.fit import Fit, identify
from irbcal.identification.methods import identify_by
from irbcal.identification.selection import Choice, choose_level
from irbcal.measurement import cleaning, lists, table
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.poses import as_poses, in_frame_of
from irbcal.measurement.registration import base_on
from irbcal.measurement.statistics import rotation_statistics, statistics
from irbcal.modeling.parameters import default_level, selected_parameters
from irbcal.units import DEG, MM
from irbcal.validation import accuracy, bootstrap, comparison
from irbcal.validation.prepared import prepare

LARGEST_TURN = 3 * DEG
"""Median angle from the nominal robot above which measured orientations are refused, radians."""

FEW_EQUATIONS = 3
"""Equations for each identified combination below which the user is warned."""

LARGE_NOMINAL = 10 * MM
"""Fitted rms of the nominal robot above which the user is warned, metres."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Everything that came out of a calibration, ready to be saved.

    Attributes
    ----------
    urdf : UrdfArm
        The nominal robot as read.
    robot_file : Path
    fit, nominal : Fit
        The level asked for, and base and tool alone, both on the poses of the fit.
    fit_points, heldout_points : PointSet
        ``heldout_points`` may be empty.
    measurements : MeasurementSet
    verification : MeasurementSet or None
        Where the held-out poses come from a file of their own.
    poses_asked : int
    excluded : list of Exclusion
    references : dict of str to ndarray
        Places of the reference points, metres; empty without references.
    tool_shape : dict of str to ndarray
        Places of the reflectors on the tool where they were turned into poses, metres; else empty.
    choice : Choice or None
        The comparison of levels, where the level was chosen by it.
    notes : list of str
    seconds : float
    """

    urdf: urdf_module.UrdfArm
    robot_file: Path
    fit: Fit
    nominal: Fit
    fit_points: PointSet
    heldout_points: PointSet
    measurements: table.MeasurementSet
    verification: table.MeasurementSet | None
    poses_asked: int
    excluded: list
    references: dict
    tool_shape: dict
    choice: Choice | None
    notes: list
    seconds: float


def split(points, holdout, order="random", seed=0):
    """Which poses are held out.

    Parameters
    ----------
    points : PointSet
    holdout : float or int
        A fraction below 1, or a number of poses.
    order : str
        ``random``: drawn with the seed; ``last``: the last poses of the file.
    seed : int

    Returns
    -------
    ndarray of bool, shape (n,)
        True for held-out poses.

    Raises
    ------
    MeasurementError
        If the wish cannot be met.
    """
    n = points.poses
    count = round(holdout * n) if holdout < 1 else int(holdout)
    if holdout < 0 or count >= n:
        raise MeasurementError(f"cannot hold out {count} of {n} usable poses: some must be left for the fit")
    mask = np.zeros(n, dtype=bool)
    if order == "last":
        mask[n - count :] = True
    else:
        mask[np.random.default_rng(seed).permutation(n)[:count]] = True
    return mask


def calibrate(
    measurements,
    robot="irb1600",
    model=None,
    holdout=0.25,
    order="random",
    seed=0,
    verify=None,
    base=None,
    tip=None,
    method="least-squares",
    objective="rms",
    power=8.0,
    loss="linear",
    free=(),
    hold=(),
    known_targets=None,
    frame=None,
    poses=False,
    progress=None,
):
    """Identify a robot from measurements and keep poses aside to prove it.

    Parameters
    ----------
    measurements : str, Path or MeasurementSet
    robot : str or Path
        URDF file or a shipped robot's name.
    model : str, optional
        Level: ``nominal``, ``11``, ``16``, ``26``, ``34``, ``34b`` (six revolute joints), ``offsets``, ``placement``
        (any serial arm); or ``auto``: chosen by cross-validation over the poses of the fit. By default ``34``, and
        ``placement`` for arms that have not six revolute joints.
    holdout : float or int
        Fraction or number of poses that the fit does not see (not used with ``verify``).
    order, seed
        See `split`.
    verify : str, Path or MeasurementSet, optional
        A file of its own for the held-out poses, measured with the same tool; it is registered to the
        reference points of the first.
    base, tip : str, optional
        Link names, see `irbcal.files.urdf.read`.
    method, objective, power, loss
        See `irbcal.identification.methods.identify_by`. With method ``axes`` the fit sees the one-joint moves (groups
        ``axis1`` ... ``axis6``) only, and all other poses are held out.
    free, hold : sequence of str
        Error parameters added to the level and taken from it, by name or pattern.
    known_targets : str, Path or dict, optional
        Targets measured on the tool itself: a file with columns target, x_mm, y_mm, z_mm, or places in metres.
    frame : sequence of three str, optional
        Reference points that define the measuring frame, see `irbcal.measurement.poses.in_frame_of`.
    poses : bool
        Turn the points of each pose into one full pose first, see `irbcal.measurement.poses.as_poses`.
    progress : callable, optional
        Called with a short text at each step.

    Returns
    -------
    Outcome

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    started = time.perf_counter()
    say = progress or (lambda text: None)
    robot_urdf = urdf_module.read(robot, base, tip)
    arm = robot_urdf.arm
    known = lists.read_targets(known_targets) if isinstance(known_targets, (str, Path)) else known_targets
    say("reading and cleaning the measurements")
    seen = _read(measurements, arm)
    model = default_level(arm) if model is None else model
    cleaned = cleaning.clean(seen)
    points, excluded = _without_gross_errors(arm, cleaned, seen.source)
    notes, poses_asked = list(cleaned.notes), seen.poses
    references = cleaned.registration.references if cleaned.registration else {}
    if frame is not None:
        points, references = in_frame_of(points, references, frame, seen.source)
    shape = {}
    if poses:
        points, shape = as_poses(points, seen.source)
    check = None
    moves = np.isin(points.groups.astype(str), GROUPS)
    by_axes = method == "axes" and moves.any()
    if verify is None:
        aside = ~moves if by_axes else split(points, holdout, order, seed)
        fit_points, heldout = points.select(~aside), points.select(aside)
    else:
        check = _read(verify, arm)
        other = cleaning.clean(check, references or None, cleaned.points.target_names)
        fit_points = points.select(moves) if by_axes else points
        heldout, left_out = _without_gross_errors(arm, other, check.source)
        if poses:
            heldout, _ = as_poses(heldout, check.source, shape)
        excluded, poses_asked = excluded + left_out, poses_asked + check.poses
        notes += [f"{check.source}: {note}" for note in other.notes]
    say(f"identifying base and tool from {fit_points.poses} poses")
    _check_known_targets(known, fit_points, seen.source)
    nominal = identify(arm, fit_points, "nominal", known_targets=known)
    _refuse_orientations(nominal, fit_points, seen.source)
    choice = None
    if model == "auto":
        choice = choose_level(arm, fit_points, seed, progress=say, known_targets=known)
        model = choice.level
    say(f"identifying model {model}")
    fit = identify_by(
        arm,
        fit_points,
        model,
        method,
        objective,
        power,
        loss,
        known_targets=known,
        parameters=selected_parameters(model, free, hold, arm),
        watched=_groups(heldout),
    )
    notes += _doubts(nominal, fit, fit_points, heldout)
    unseen = [name for name in heldout.target_names if name not in fit.robot.targets]
    if unseen:
        raise MeasurementError(f"target {unseen[0]} is measured in held-out poses only: hold out fewer poses")
    return Outcome(
        robot_urdf,
        urdf_module.robots.robot_file(robot),
        fit,
        nominal,
        fit_points,
        heldout,
        seen,
        check,
        poses_asked,
        excluded,
        references,
        shape,
        choice,
        notes,
        time.perf_counter() - started,
    )


def evaluate(
    calibration,
    measurements,
    refit_base=False,
    intervals=False,
    relative=None,
    frame_points=None,
    sphere=None,
    flange=False,
    compare=None,
    verified=None,
    seed=0,
):
    """Errors of a saved calibration and of its nominal robot on other measurements.

    Parameters
    ----------
    calibration : Record
        As `irbcal.load` gives it.
    measurements : str, Path or MeasurementSet
        Registered to the calibration's reference points where both have them.
    refit_base : bool
        Place the base anew for each model (for measurements from another tracker station without references).
    intervals : bool
        Add bootstrap intervals, see `irbcal.validation.bootstrap`.
    relative : str, optional
        ``virtual`` or ``three-points``: add relative errors, see `irbcal.validation.accuracy`.
    frame_points : sequence of three (pose, target), optional
        The points of the frame for ``three-points``.
    sphere : sequence of four float, optional
        Centre in the base link and diameter, metres: regard only points measured inside.
    flange : bool
        Add position and orientation errors of the tip from three targets or measured orientations.
    compare : Record, optional
        Another one, to compare with pose by pose on the same data.
    verified : str, Path or MeasurementSet, optional
        Measurements of the same poses (by name) run with this calibration's fake targets.
    seed : int
        Of the bootstrap.

    Returns
    -------
    dict
        ``nominal``, ``calibrated``, ``per_target``, ``per_group``, ``per_payload``, ``per_group_payload``,
        ``percentiles``, ``largest_covers``, ``orientation`` (None where none was measured), ``excluded``, ``notes``,
        ``simulated``; ``intervals``, ``relative``, ``flange``, ``comparison``, ``verified`` where asked for, else None.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    ready, robots = in_frame_of_calibration(calibration, measurements, refit_base)
    seen = ready.measurements
    if sphere is not None:
        inside = accuracy.within_sphere(robots["calibrated"], ready.points, sphere[:3], sphere[3])
        if not inside.any():
            raise MeasurementError(f"{seen.source}: no point was measured inside the sphere")
        ready = ready.keep(inside)
    points = ready.points
    errors = {name: distances(robot, points) for name, robot in robots.items()}
    turns = {name: rotation_statistics(rotation_distances(robot, points)) for name, robot in robots.items()}
    notes = list(ready.notes)
    if seen.sha256 in {item.sha256 for item in calibration.data}:
        notes.append("This file was used for the calibration: fitted poses among these are no proof of accuracy.")
    parts = _parts(ready)

    def of(mask):
        return {name: statistics(error[mask]) for name, error in errors.items()}

    return {
        **{name: statistics(error) for name, error in errors.items()},
        **{part: _by_label(labels, of) for part, labels in parts.items()},
        "percentiles": {name: accuracy.percentiles(error) for name, error in errors.items()},
        "largest_covers": accuracy.largest_covers(points.poses),
        "orientation": turns if turns["nominal"] else None,
        "intervals": _intervals(errors, points, parts, seed) if intervals else None,
        "relative": _relative(robots, points, relative, frame_points, seen.source) if relative else None,
        "flange": _flange(robots, points, seen.source) if flange else None,
        "comparison": _comparison(compare, seen, refit_base, robots["calibrated"], ready, seed) if compare else None,
        "verified": _verified(calibration, robots["calibrated"], points, verified) if verified is not None else None,
        "excluded": [vars(item) for item in ready.excluded],
        "notes": notes,
        "simulated": seen.simulated or calibration.simulated,
    }


def in_frame_of_calibration(calibration, measurements, refit_base=False):
    """Clean measurements in the frame of a calibration, and its robots.

    Parameters
    ----------
    calibration : Record
    measurements : str, Path or MeasurementSet
    refit_base : bool
        As `evaluate`.

    Returns
    -------
    ready : Prepared
    robots : dict of str to Robot
        ``nominal`` and ``calibrated``.

    Raises
    ------
    IrbcalError
        If the measurements are refused, or are nowhere near what the calibrated robot predicts.
    """
    seen = _read(measurements, calibration.arm())
    ready = prepare(seen, calibration)
    robots = {"nominal": calibration.robot_nominal(), "calibrated": calibration.robot_calibrated()}
    if refit_base:
        robots = {name: base_on(robot, ready.points) for name, robot in robots.items()}
    error = distances(robots["calibrated"], ready.points)
    _refuse_far_points(robots["calibrated"], ready.points, error, seen.source, refit_base)
    return ready, robots


def _parts(ready):
    """Label of each point in each way of dividing the points; an empty label belongs to no part."""
    points = ready.points
    loads = ready.labels("payload_kg")
    payload = np.array([f"{load} kg" if load else "" for load in loads], dtype=object)
    both = np.array([f"{g}, {p}" if g and p else "" for g, p in zip(points.groups, payload, strict=True)], dtype=object)
    return {
        "per_target": points.names(),
        "per_group": points.groups[points.pose],
        "per_payload": payload[points.pose],
        "per_group_payload": both[points.pose],
    }


def _by_label(labels, of):
    """``of(mask)`` for each label but the empty one."""
    return {str(label): of(labels == label) for label in sorted(set(labels)) if label}


def _intervals(errors, points, parts, seed):
    def of(mask):
        return {name: bootstrap.intervals(e[mask], points.pose[mask], seed=seed) for name, e in errors.items()}

    return {
        "level": bootstrap.LEVEL,
        "resamples": bootstrap.RESAMPLES,
        "seed": seed,
        **of(np.ones(len(points), dtype=bool)),
        **{part: _by_label(labels, of) for part, labels in parts.items()},
    }


def _relative(robots, points, kind, frame_points, source):
    if kind == "virtual":
        found = {name: accuracy.relative_to_virtual_frame(robot, points) for name, robot in robots.items()}
        shift = {name: (shift / MM).tolist() for name, (_, shift) in found.items()}
        return {"kind": kind, "shift_mm": shift, **{name: statistics(d) for name, (d, _) in found.items()}}
    if kind != "three-points":
        raise MeasurementError(f"relative errors are those from a virtual frame or from three-points, not {kind!r}")
    names = [(str(points.pose_ids[k]), str(t)) for k, t in zip(points.pose, points.names(), strict=True)]
    rows = None
    if frame_points is not None:
        missing = [item for item in frame_points if tuple(item) not in names]
        if missing:
            raise MeasurementError(f"{source}: pose {missing[0][0]} has no usable point of target {missing[0][1]}")
        rows = [names.index(tuple(item)) for item in frame_points]
    found = {name: accuracy.relative_to_three_points(robot, points, rows) for name, robot in robots.items()}
    rows = found["nominal"][1]
    return {
        "kind": kind,
        "points": ["/".join(names[k]) for k in rows],
        **{name: statistics(d) for name, (d, _) in found.items()},
    }


def _flange(robots, points, source):
    out = {}
    for name, robot in robots.items():
        found = accuracy.tip_errors(robot, points, source)
        turned = rotation_statistics(found.rotation)
        turned["mean_plus_3sigma_deg"] = turned["mean_deg"] + 3 * turned["sigma_deg"]
        out[name] = {"position": statistics(found.position), "orientation": turned}
    return out


def _comparison(other, seen, refit_base, robot, ready, seed):
    """Two calibrations, pose by pose on the points that both know."""
    theirs, robots = in_frame_of_calibration(other, seen, refit_base)
    mine = [replace(item.points, pose_ids=item.number) for item in (ready, theirs)]
    rows = comparison.common_points(*mine)
    first = distances(robot, ready.points)[rows[0]]
    second = distances(robots["calibrated"], theirs.points)[rows[1]]
    found = comparison.compare(first, second, ready.points.pose[rows[0]], ready.points.pose_ids, seed)
    return {
        "other_model": other.model,
        "this": statistics(first),
        "other": statistics(second),
        "poses": len(found.pose),
        "other_minus_this_mm": found.difference / MM,
        "interval_mm": None if found.interval is None else [value / MM for value in found.interval],
        "other_better_share": found.second_is_better,
        "verdict": found.verdict("this calibration", "the other"),
        "per_pose": {
            "pose": [str(name) for name in found.pose],
            "this_mm": (found.first / MM).tolist(),
            "other_mm": (found.second / MM).tolist(),
        },
    }


def _verified(calibration, robot, points, verified):
    seen = _read(verified, calibration.arm())
    other = prepare(seen, calibration).points
    _refuse_far_points(robot, other, distances(robot, other), seen.source, False)
    return comparison.expected_and_verified(robot, calibration.arm(calibrated=False), points, other)


def _read(measurements, arm):
    seen = measurements if isinstance(measurements, table.MeasurementSet) else table.read(measurements)
    seen.check_joints(arm)
    return seen


def _without_gross_errors(arm, cleaned, source):
    points = cleaned.points
    keep, distance = outliers.find_gross_errors(arm, points, source)
    names = points.names()
    found = [
        cleaning.Exclusion(
            str(points.pose_ids[points.pose[k]]),
            str(names[k]),
            f"gross error: {distance[k] / MM:.4g} mm from the nominal robot",
        )
        for k in np.flatnonzero(~keep)
    ]
    return points.take(keep).without_empty_poses(), [*cleaned.excluded, *found]


def _groups(points):
    """Points by group, for the history of a fit; all together where there are no groups."""
    names = sorted({str(name) for name in points.groups if name})
    if len(names) < 2:
        return {"held-out": points} if points.poses else {}
    return {name: points.select(points.groups == name).without_empty_poses() for name in names}


def _check_known_targets(known, points, source):
    """Known targets that were never measured are a slip of the pen."""
    strange = [name for name in known or {} if name not in points.target_names]
    if strange:
        raise MeasurementError(
            f"{source}: the known target {strange[0]} was not measured; targets are {', '.join(points.target_names)}"
        )


def _refuse_orientations(nominal, points, source):
    """Measured orientations that have nothing to do with the robot, such as a constant default in an export."""
    angles = rotation_distances(nominal.robot, points)
    if len(angles) and np.median(angles) > LARGEST_TURN:
        raise MeasurementError(
            f"{source}: columns qw, qx, qy, qz: the orientations contradict the robot by {np.median(angles) / DEG:.3g} "
            "degrees (median): leave these columns out if they were not measured"
        )


def _doubts(nominal, fit, fit_points, heldout):
    """What should make the user doubt the result, in sentences."""
    doubts = []
    equations = 3 * fit.problem.rows
    if fit.level != "nominal" and equations < FEW_EQUATIONS * fit.rank:
        doubts.append(
            f"Only {equations} equations for {fit.rank} identified combinations: measure more poses or choose a "
            "smaller model."
        )
    if nominal.rms > LARGE_NOMINAL:
        doubts.append(
            f"The nominal robot misses the fitted points by {nominal.rms / MM:.3g} mm (rms), far more than industrial "
            "robots do: something other than the robot is wrong (references, joints, robot file)."
        )
    if fit is not nominal and fit.level != "nominal" and heldout.poses:
        before, after = (distances(item.robot, heldout).mean() for item in (nominal, fit))
        if after >= before:
            doubts.append(
                f"On held-out poses the calibrated robot is NOT better than the nominal one ({after / MM:.3f} against "
                f"{before / MM:.3f} mm mean): do not use this calibration."
            )
    return doubts


def _refuse_far_points(robot, points, error, source, refit_base):
    """Points that are nowhere near their predictions: another unit, another place, another robot."""
    spread = outliers.spread(robot.arm, points)
    median = np.median(error)
    if points.poses < 3 or median <= outliers.TOO_FAR * max(spread, 0.1):
        return
    for reading, factors in outliers.READINGS.items():
        if np.median(distances(robot, outliers.scaled(points, *factors))) < 0.1 * median:
            raise MeasurementError(f"{source}: these look like {reading}")
    hint = "" if refit_base else "; if the tracker or the base was moved, evaluate with --refit-base"
    raise MeasurementError(
        f"{source}: the calibrated robot misses these points by {median / MM:.4g} mm (median): not measured in its "
        f"frame, with its tool or on this robot{hint}"
    )
