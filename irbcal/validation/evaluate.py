"""Evaluate a calibration and its nominal robot on other measurements (Nubiola 2011, section 7.6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal, TypeVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import table
from irbcal.measurement.last_moves import with_last_moves
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.repeats import repeat_groups
from irbcal.measurement.statistics import rotation_statistics, statistics
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.options import checked, number, place
from irbcal.options import seed as check_seed
from irbcal.parallel import on_workers
from irbcal.plotting.pose_errors import ModelErrors, PoseErrors
from irbcal.units import MM
from irbcal.validation import accuracy, bootstrap, comparison
from irbcal.validation.conformity import check_options, conformity
from irbcal.validation.coverage import coverage
from irbcal.validation.evaluation import ByModel, Evaluation, Statistics
from irbcal.validation.length_scale import length_scale, scale_in_words
from irbcal.validation.origin import checked_info, origin
from irbcal.validation.prepared import CleanedPoints, prepare
from irbcal.validation.refit import Refit
from irbcal.validation.region import region
from irbcal.validation.suspicion import doubts_of, lost_row, refuse_far_points
from irbcal.validation.unseen import without_fitted
from irbcal.validation.upper_bound import Rule, expanded_uncertainty
from irbcal.validation.verdict import counted
from irbcal.validation.verdict import verdict as judged

RELATIVE = ("virtual", "three-points")

NOTHING = Refit()
"""Base and tool stay where the calibration has them."""

T = TypeVar("T")


@on_workers
def evaluate(
    calibration: CalibrationLike,
    measurements: table.MeasurementsLike,
    *,
    refit_base: bool = False,
    refit_tool: bool = False,
    refit_from: int | None = None,
    refit_zeros: Sequence[int] = (),
    intervals: bool = False,
    include_fitted: bool = False,
    relative: Literal["virtual", "three-points"] | None = None,
    frame_points: Sequence[tuple[str, str]] | None = None,
    sphere: Sequence[float] | None = None,
    flange: bool = False,
    compare: CalibrationLike | None = None,
    verified: table.MeasurementsLike | None = None,
    seed: int = 0,
    payload: float | None = None,
    same_tool: bool = False,
    tolerance: float | None = None,
    rule: Rule | None = None,
    tracker_u95: float | None = None,
    region_only: bool = False,
    info: Mapping[str, str] | None = None,
    jobs: int | None = None,
) -> Evaluation:
    """Errors of a calibration and of its nominal robot on other measurements.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    measurements : str, Path, DataFrame or MeasurementSet
        Registered to the calibration's reference points where both have them.
    refit_base : bool
        Place the base anew for each model (for measurements from another tracker station without references).
    refit_tool : bool
        Place the targets anew for each model, because reflectors were mounted anew; their names may be others.
    refit_from : int, optional
        Poses from which base and tool are placed anew; they are not judged. By default half of them with
        ``refit_tool``; with ``refit_base`` alone all poses, which are judged, too.
    refit_zeros : sequence of int
        Joints, from 1, whose zeros were lost (a crash, another motor): they are found with what is placed anew, all
        else of the robot stays, and a note tells them with their intervals.
    intervals : bool
        Add bootstrap intervals, see `irbcal.validation.bootstrap`, and by target how many measured coordinates lie
        within the predicted 95 % intervals, see `irbcal.modeling.robot.Robot.predict`.
    include_fitted : bool
        Keep poses that the calibration was fitted to; they are counted out otherwise.
    relative : {"virtual", "three-points"}, optional
        Add relative errors, see `irbcal.validation.accuracy`.
    frame_points : sequence of three (pose, target), optional
        The points of the frame for ``three-points``.
    sphere : sequence of four float, optional
        Centre in the base link and diameter, metres: regard only points measured inside.
    flange : bool
        Add position and orientation errors of the tip from three targets or measured orientations.
    compare : str, Path or a loaded calibration, optional
        Another one, to compare with pose by pose on the same data.
    verified : str, Path, DataFrame or MeasurementSet, optional
        Measurements of the same poses (by name) run with this calibration's fake targets.
    seed : int
        Of the bootstrap and of the poses for ``refit_from``.
    payload : float, optional
        Mass carried, kg, where the measurements do not tell it (column ``payload_kg``).
    same_tool : bool
        With a load that the calibration does not know the reflectors are where they were with its usual load.
    tolerance : float, optional
        Metres: judge the calibrated robot by it, see `irbcal.validation.conformity`.
    rule : {"mean3sigma", "max", "percentile"}, optional
        What must be within the tolerance; mean + 3 sigma unless given; ``percentile`` is the 95th.
    tracker_u95 : float, optional
        Expanded uncertainty (95 %) of a measured position, metres, which is added to the upper bound of that figure; by
        default the largest ``u95_mm`` of the measurements, else `irbcal.validation.upper_bound.ASSUMED_U95`.
    region_only : bool
        Judge the tolerance for the region of these poses only, which the certificate states; else they must cover the
        calibrated ranges, see `irbcal.validation.region`.
    info : dict of str to str, optional
        What a certificate tells besides: ``serial_number``, ``operator`` and others of
        `irbcal.validation.origin.FIELDS`, or any name. Columns of the measurements with these names are taken, too.
    jobs : int, optional
        Threads for large problems; as many as there are cores unless given. The result does not depend on it.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    record = open_calibration(calibration)
    check_seed(seed)
    if sphere is not None:
        place("sphere", sphere, "x, y, z of the centre and the diameter in metres", (4,))
    if relative is not None:
        checked("relative", relative, RELATIVE)
    if frame_points is not None and relative != "three-points":
        raise OptionError("frame_points: only relative='three-points' takes them", parameter="frame_points")
    judged_by, stated = check_options(tolerance, rule, tracker_u95, region_only), checked_info(info)
    measurements = carrying(table.read(measurements), payload)
    refit = Refit(
        refit_base, refit_tool, refit_from, seed, _joints(refit_zeros, len(record.arm(calibrated=False).joint_names))
    )
    cleaned, robots = in_frame_of_calibration(record, measurements, refit, same_tool)
    cleaned = without_fitted(cleaned.without_copies(), record, include_fitted)
    against = doubts_of(cleaned.points, robots["calibrated"], record)
    cleaned = _inside(cleaned, robots["calibrated"], sphere)
    measured, points = cleaned.measurements, cleaned.points
    errors = {name: distances(robot, points) for name, robot in robots.items()}
    turns = {name: rotation_statistics(rotation_distances(robot, points)) for name, robot in robots.items()}
    labels_of = _parts(cleaned)

    def by_model(mask: BoolArray) -> ByModel:
        return {name: _known(statistics(error[mask])) for name, error in errors.items()}

    of_parts = {kind: _by_label(labels, by_model) for kind, labels in labels_of.items()}
    fit = record.used_points(heldout=False)
    covered = region(robots["calibrated"], points, None if fit is None else fit[0])
    scale = scale_in_words(
        length_scale(record.arm(calibrated=False), record.arm()), points.xyz, stated.get("scale_bar", "")
    )
    overall = by_model(np.ones(len(points), dtype=bool))
    percentiles = {name: _known(accuracy.percentiles(error)) for name, error in errors.items()}
    covers, simulated = (
        accuracy.largest_covers(len(np.unique(repeat_groups(points)))),
        measured.simulated or record.simulated,
    )
    outcome = judged(
        errors["nominal"] / MM,
        errors["calibrated"] / MM,
        cleaned.number[points.pose],
        counted(cleaned.excluded),
        cleaned.proven,
        against,
        basis=cleaned.basis,
    )
    return Evaluation(
        nominal=overall["nominal"],
        calibrated=overall["calibrated"],
        per_target=of_parts["per_target"],
        per_group=of_parts["per_group"],
        per_payload=of_parts["per_payload"],
        per_group_payload=of_parts["per_group_payload"],
        percentiles=percentiles,
        largest_covers=covers,
        orientation={name: _known(turn) for name, turn in turns.items()} if turns["nominal"] else None,
        intervals=_intervals(errors, points, labels_of, seed) if intervals else None,
        coverage=None if refit_base else coverage(robots["calibrated"], points),
        relative=_relative(robots, points, relative, frame_points, measured.source) if relative else None,
        flange=_flange(robots, points, measured.source) if flange else None,
        comparison=None
        if compare is None
        else _comparison(open_calibration(compare), cleaned, refit, robots["calibrated"], seed),
        verified=None if verified is None else _verified(record, robots["calibrated"], points, verified),
        excluded=tuple(cleaned.excluded),
        verdict=outcome,
        notes=(*against, *_notes(cleaned, record)),
        simulated=simulated,
        model=record.model,
        refit_base=refit_base,
        refit_tool=refit_tool,
        errors=_pose_errors(robots, points, errors),
        origin=origin(calibration, record, cleaned, stated, (*_scope(refit, sphere, cleaned), scale)),
        region=covered,
        conformity=None
        if tolerance is None
        else conformity(
            {**overall["calibrated"], **percentiles["calibrated"]},
            errors["calibrated"],
            repeat_groups(points)[points.pose],
            outcome,
            tolerance,
            judged_by,
            poses=points.poses,
            tracker=expanded_uncertainty(points.u95, tracker_u95),
            region=covered,
            region_only=region_only,
            simulated=simulated,
            seed=seed,
        ),
    )


def _joints(joints: Sequence[int], count: int) -> tuple[int, ...]:
    """Joints from the caller."""
    for joint in joints:
        number("refit_zeros", joint, 1, count, whole=True)
    if len(set(joints)) < len(joints):
        raise OptionError("refit_zeros: a joint is named twice", parameter="refit_zeros")
    return tuple(joints)


def in_frame_of_calibration(
    calibration: CalibrationLike, measurements: table.MeasurementsLike, refit: Refit = NOTHING, same_tool: bool = False
) -> tuple[CleanedPoints, dict[str, Robot]]:
    """Clean measurements in the frame of a calibration, and its robots.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    measurements : str, Path, DataFrame or MeasurementSet
    refit : Refit
        What to place anew; the poses that do it are not in the result, except where they are judged, too.
    same_tool : bool
        As `evaluate`.

    Returns
    -------
    ready : CleanedPoints
    robots : dict of str to Robot
        ``nominal`` and ``calibrated``.

    Raises
    ------
    IrbcalError
        If the measurements are refused, or are nowhere near what the calibrated robot predicts.
    """
    record = open_calibration(calibration)
    measured = table.read(measurements)
    measured = measured.of_arm(record.arm())
    cleaned = prepare(measured, record, any_target=refit.tool, same_tool=same_tool)
    robots = {"nominal": record.robot_nominal(), "calibrated": record.robot_calibrated()}

    def placed(points: PointSet) -> dict[str, Robot]:
        if not refit:
            return robots
        return {name: refit.placed(robot, points, measured.source) for name, robot in robots.items()}

    chosen, judged = (
        refit.chosen(cleaned.points, measured.source) if refit else (np.ones(cleaned.points.poses, bool),) * 2
    )
    placing = cleaned.points.select(chosen)
    robots, cleaned = placed(placing), cleaned.select(judged)
    points, notes = with_last_moves(robots["calibrated"], cleaned.points)
    cleaned = replace(cleaned, points=points, notes=(*cleaned.notes, *notes))
    if points.previous is None:
        placing = replace(placing, previous=None)
        robots = placed(placing)
    zeros = refit.zeros_in_words(record.robot_calibrated(), robots["calibrated"], placing)
    cleaned = replace(cleaned, notes=(*zeros, *cleaned.notes))
    if not judged[chosen].any():
        cleaned = replace(cleaned, notes=(*cleaned.notes, _placed_in_words(refit, placing.poses, points.poses)))
    error = distances(robots["calibrated"], cleaned.points)
    refuse_far_points(robots["calibrated"], cleaned.points, error, measured, bool(refit))
    lost = lost_row(robots["calibrated"], cleaned.points, error, measured)
    return replace(cleaned, notes=(*cleaned.notes, *lost)), robots


def _placed_in_words(refit: Refit, placing: int, judged: int) -> str:
    return (
        f"The {refit.what} {'were' if refit.base and refit.tool else 'was'} placed anew on {placing} poses of these "
        f"measurements, for each model; errors are those of the other {judged} poses."
    )


def _scope(refit: Refit, sphere: Sequence[float] | None, cleaned: CleanedPoints) -> tuple[str, ...]:
    """What an evaluation is limited to, in sentences."""
    out = []
    if refit.base and not any("placed anew on" in note for note in cleaned.notes):
        out.append("The base was placed anew on the judged poses themselves: these are relative errors.")
    if sphere is not None:
        x, y, z, diameter = (value / MM for value in sphere)
        out.append(
            f"Only points inside the sphere of {diameter:g} mm about ({x:g}, {y:g}, {z:g}) mm in the base link are "
            "judged."
        )
    return tuple(out)


def _inside(cleaned: CleanedPoints, robot: Robot, sphere: Sequence[float] | None) -> CleanedPoints:
    if sphere is None:
        return cleaned
    inside = accuracy.within_sphere(robot, cleaned.points, sphere[:3], sphere[3])
    if not inside.any():
        raise MeasurementError("no point was measured inside the sphere", file=cleaned.measurements.source)
    return cleaned.keep(inside)


def _notes(cleaned: CleanedPoints, record: Record) -> tuple[str, ...]:
    measured = cleaned.measurements
    notes = (*cleaned.notes, *mixed_use(record.programmed, measured.programmed, measured.source))
    return (*notes, *_other_loads(cleaned.points, record), *_outside_ranges(cleaned.points, record))


def carrying(measurements: table.MeasurementSet, payload: float | None) -> table.MeasurementSet:
    """Measurements with a load where they do not tell it."""
    if payload is None:
        return measurements
    if measurements.payloads() is not None:
        raise OptionError(
            "payload: the measurements tell it themselves (payload_kg): leave it out", parameter="payload"
        )
    load = number("payload", payload, 0.0)
    return replace(measurements, table=measurements.table.assign(payload_kg=load))


def _other_loads(points: PointSet, record: Record) -> list[str]:
    """That a joint map of one load is judged at others."""
    usual, loads = record.usual_load, points.payload_kg
    joint_map = record.robot_calibrated().joint_map
    if usual is None or loads is None or joint_map.knows_loads:
        return []
    others = np.unique(loads[np.isfinite(loads) & (loads != usual)])
    if not len(others):
        return []
    return [
        f"Poses with {', '.join(f'{load:g}' for load in others)} kg are judged by a calibration that was measured with "
        f"{usual:g} kg only: what the joints give way under another load is in their errors."
    ]


def _outside_ranges(points: PointSet, record: Record) -> list[str]:
    """How many poses lie beyond the joint ranges of the calibration's fit, joint by joint."""
    certainty = record.robot_calibrated().certainty
    return [text] if certainty is not None and (text := certainty.outside_in_words(points.q)) else []


def _known(values: Statistics | None) -> Statistics:
    """Statistics of points that are there."""
    assert values is not None
    return values


def _pose_errors(robots: Mapping[str, Robot], points: PointSet, errors: Mapping[str, FloatArray]) -> PoseErrors:
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    count = np.bincount(points.pose, minlength=points.poses)
    models = {
        name: ModelErrors(
            SimpleNamespace(**_known(statistics(errors[name]))),
            errors[name],
            np.bincount(points.pose, errors[name], points.poses) / count,
            None,
            accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            accuracy.turns(robot, points),
        )
        for name, robot in robots.items()
    }
    return PoseErrors(
        "measured",
        points.pose,
        tuple(str(name) for name in points.pose_ids),
        tuple(str(name) for name in points.groups),
        tuple(str(name) for name in points.names()),
        models,
        frames.apply(T_base_world, points.xyz),
    )


def _parts(cleaned: CleanedPoints) -> dict[str, NameArray]:
    """Label of each point in each way of dividing the points; an empty label belongs to no part."""
    points = cleaned.points
    loads = cleaned.labels("payload_kg")
    payload = np.array([f"{load} kg" if load else "" for load in loads], dtype=object)
    combined = np.array(
        [f"{g}, {p}" if g and p else "" for g, p in zip(points.groups, payload, strict=True)], dtype=object
    )
    return {
        "per_target": points.names(),
        "per_group": points.groups[points.pose],
        "per_payload": payload[points.pose],
        "per_group_payload": combined[points.pose],
    }


def _by_label(labels: NameArray, compute: Callable[[BoolArray], T]) -> dict[str, T]:
    """``of(mask)`` for each label but the empty one."""
    return {str(label): compute(labels == label) for label in sorted(set(labels)) if label}


def _intervals(
    errors: Mapping[str, FloatArray], points: PointSet, labelled: Mapping[str, NameArray], seed: int
) -> dict[str, Any]:
    position = repeat_groups(points)[points.pose]  # repeats of one place are drawn together

    def compute(mask: BoolArray) -> dict[str, Any]:
        return {name: bootstrap.intervals(e[mask], position[mask], seed=seed) for name, e in errors.items()}

    return {
        "level": bootstrap.LEVEL,
        "resamples": bootstrap.RESAMPLES,
        "seed": seed,
        **compute(np.ones(len(points), dtype=bool)),
        **{kind: _by_label(labels, compute) for kind, labels in labelled.items()},
    }


def _relative(
    robots: Mapping[str, Robot],
    points: PointSet,
    kind: str,
    frame_points: Sequence[tuple[str, str]] | None,
    source: str,
) -> dict[str, Any]:
    if kind == "virtual":
        shifted = {name: accuracy.relative_to_virtual_frame(robot, points) for name, robot in robots.items()}
        shift = {name: (shift / MM).tolist() for name, (_, shift) in shifted.items()}
        return {"kind": kind, "shift_mm": shift, **{name: statistics(d) for name, (d, _) in shifted.items()}}
    names = [(str(points.pose_ids[k]), str(t)) for k, t in zip(points.pose, points.names(), strict=True)]
    rows = None
    if frame_points is not None:
        missing = [(pose, target) for pose, target in frame_points if (pose, target) not in names]
        if missing:
            raise MeasurementError(f"pose {missing[0][0]} has no usable point of target {missing[0][1]}", file=source)
        rows = [names.index((pose, target)) for pose, target in frame_points]
    errors = {name: accuracy.relative_to_three_points(robot, points, rows) for name, robot in robots.items()}
    return {
        "kind": kind,
        "points": ["/".join(names[k]) for k in errors["nominal"][1]],
        **{name: statistics(d) for name, (d, _) in errors.items()},
    }


def _flange(robots: Mapping[str, Robot], points: PointSet, source: str) -> dict[str, Any]:
    out = {}
    for name, robot in robots.items():
        errors = accuracy.tip_errors(robot, points, source)
        turned = dict(_known(rotation_statistics(errors.rotation)))
        turned["mean_plus_3sigma_deg"] = turned["mean_deg"] + 3 * turned["sigma_deg"]
        out[name] = {"position": statistics(errors.position), "orientation": turned}
    return out


def _comparison(other: Record, cleaned: CleanedPoints, refit: Refit, robot: Robot, seed: int) -> dict[str, Any]:
    """Two calibrations, pose by pose on the points that both know."""
    theirs, robots = in_frame_of_calibration(other, cleaned.measurements, refit)
    sets = [replace(cleaned_points.points, pose_ids=cleaned_points.number) for cleaned_points in (cleaned, theirs)]
    rows = comparison.common_points(*sets)
    first = distances(robot, cleaned.points)[rows[0]]
    second = distances(robots["calibrated"], theirs.points)[rows[1]]
    result = comparison.compare(
        first, second, cleaned.points.pose[rows[0]], cleaned.points.pose_ids, seed, repeat_groups(cleaned.points)
    )
    return {
        "other_model": other.model,
        "this": statistics(first),
        "other": statistics(second),
        "poses": len(result.pose),
        "other_minus_this_mm": result.difference / MM,
        "interval_mm": None if result.interval is None else [value / MM for value in result.interval],
        "other_better_share": result.second_is_better,
        "verdict": result.verdict("this calibration", "the other"),
        "per_pose": {
            "pose": [str(name) for name in result.pose],
            "this_mm": (result.first / MM).tolist(),
            "other_mm": (result.second / MM).tolist(),
        },
    }


def _verified(
    calibration: Record, robot: Robot, points: PointSet, verified: table.MeasurementsLike
) -> Mapping[str, Any]:
    measured = table.read(verified)
    measured = measured.of_arm(calibration.arm())
    points_verified = prepare(measured, calibration).points
    refuse_far_points(robot, points_verified, distances(robot, points_verified), measured, False)
    return comparison.expected_and_verified(robot, calibration.arm(calibrated=False), points, points_verified)
