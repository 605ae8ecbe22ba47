"""The main job from measurements to a proven calibration, as plain functions."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.export import urdf as urdf_module
from irbcal.identification import outliers
from irbcal.identification.axes import GROUPS
from irbcal.identification.fit import Fit, identify
from irbcal.identification.methods import identify_by
from irbcal.identification.selection import Choice, choose_level
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import PointSet
from irbcal.measurement.poses import as_poses, in_frame_of
from irbcal.modeling import frames
from irbcal.modeling.parameters import default_level, selected_parameters
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM
from irbcal.validation.accuracy import (
    distances,
    rotation_distances,
    rotation_statistics,
    statistics,
    statistics_by,
)

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
        Link names, see `irbcal.export.urdf.read`.
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
    known = table.read_targets(known_targets) if isinstance(known_targets, (str, Path)) else known_targets
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
        urdf_module.shipped.robot_file(robot),
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


def evaluate(calibration, measurements, refit_base=False):
    """Errors of a saved calibration and of its nominal robot on other measurements.

    Parameters
    ----------
    calibration : Calibration
        As `irbcal.load` gives it.
    measurements : str, Path or MeasurementSet
        Registered to the calibration's reference points where both have them.
    refit_base : bool
        Place the base anew for each model (for measurements from another tracker station without references).

    Returns
    -------
    dict
        ``nominal``, ``calibrated``, ``per_target``, ``per_group``, ``orientation`` (None where none was measured),
        ``excluded``, ``notes``, ``simulated``.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    seen = _read(measurements, calibration.arm())
    robots = {"nominal": calibration.robot_nominal(), "calibrated": calibration.robot_calibrated()}
    shape = calibration.tool_shape()
    cleaned = cleaning.clean(seen, calibration.reference_places() or None, shape or robots["calibrated"].targets)
    points = as_poses(cleaned.points, seen.source, shape)[0] if shape else cleaned.points
    if refit_base:
        robots = {name: _with_base_on(robot, points) for name, robot in robots.items()}
    errors = {name: distances(robot, points) for name, robot in robots.items()}
    turns = {name: rotation_statistics(rotation_distances(robot, points)) for name, robot in robots.items()}
    _refuse_far_points(robots["calibrated"], points, errors["calibrated"], seen.source, refit_base)
    notes = list(cleaned.notes)
    if seen.sha256 in {item.sha256 for item in calibration.data}:
        notes.append("This file was used for the calibration: fitted poses among these are no proof of accuracy.")
    names, groups = points.names(), points.groups[points.pose]
    by_target = {name: statistics_by(error, names) for name, error in errors.items()}
    by_group = {name: statistics_by(error, groups) for name, error in errors.items()}
    return {
        **{name: statistics(error) for name, error in errors.items()},
        "per_target": {t: {name: by_target[name][t] for name in errors} for t in by_target["nominal"]},
        "per_group": {g: {name: by_group[name][g] for name in errors} for g in by_group["nominal"] if g},
        "orientation": turns if turns["nominal"] else None,
        "excluded": [vars(item) for item in cleaned.excluded],
        "notes": notes,
        "simulated": seen.simulated or calibration.simulated,
    }


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
    return points.take(keep).without_empty_poses(), cleaned.excluded + found


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


def _with_base_on(robot: Robot, points):
    """The robot with its base where the points say (closed form, least squares)."""
    predicted = np.empty_like(points.xyz)
    at_origin = robot.replace(T_world_base=np.eye(4))
    for k, name in enumerate(points.target_names):
        mine = points.target == k
        predicted[mine] = at_origin.points(points.q[points.pose[mine]], name)
    return robot.replace(T_world_base=frames.rigid_fit(predicted, points.xyz))


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
