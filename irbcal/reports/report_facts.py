"""What the report of a calibration shows of its poses, and what limits the calibration now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, group_means
from irbcal.error_statistics import Statistics
from irbcal.errors import IrbcalError
from irbcal.io.schema import Record
from irbcal.joint_analysis.residuals import ResidualAnalysis, analyse_residuals
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling import frames
from irbcal.modeling.commanded_joints import line_at_home
from irbcal.plotting.pose_sets import FROM_FEATURE, POSITION, ModelErrors, PoseErrors
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.accuracy import coverage
from irbcal.validation.comparing import Pair
from irbcal.validation.verdict import verdict_of
from irbcal.wording import inflected

MOST_POSES = 3000
"""Poses of a set that are drawn, and that backlash is looked for in; of more, ones drawn at random and the worst."""
WORST = 20


@dataclass(frozen=True, eq=False)
class PoseSet(PoseErrors):
    """One set of poses of a calibration, held out or fitted, with what the report says of it."""

    comparison: Pair | None
    """Nominal against calibrated, pose by pose."""
    nearer: float
    """Share of the poses that are nearer to the calibrated robot than to the nominal one."""
    covers: float
    """See `irbcal.validation.accuracy.largest_covers`."""
    points: PointSet | None
    """None for calibrations that were saved without the measured places."""
    direction: FloatArray | None
    """Shape (n, joints)."""
    set_size: int = 0
    """How many poses the set has, of which these are drawn."""


@dataclass(frozen=True, eq=False)
class ReportFacts(Locked):
    """What a calibration's poses say."""

    sets: tuple[PoseSet, ...]
    """Held-out poses, if any, and fitted ones."""
    joints: ResidualAnalysis | None
    """Which terms each joint needs, from all poses; None where it cannot be had."""
    joints_note: str
    """Why there is none."""
    coverage: Mapping[str, Any] | None = None
    """Whether intervals hold on the held-out poses, see `irbcal.validation.accuracy.coverage`; None where none are held
    out, or nothing is known of intervals.
    """


def gather(calibration: Record, covered: Mapping[str, Any] | None = None) -> ReportFacts:
    """Compute everything that the report shows of a calibration's poses.

    Parameters
    ----------
    calibration : Record
    covered : dict, optional
        Whether intervals hold on all held-out poses, where that is known: `irbcal.validation.accuracy.coverage`.
    """
    c = calibration
    sets = []
    for name, heldout, nominal, calibrated in (
        ("held-out", True, c.heldout_nominal, c.heldout),
        ("fitted", False, c.fit_nominal, c.fit),
    ):
        if calibrated is not None and nominal is not None and heldout in c.points.heldout:
            statistics = {"nominal": nominal.all, "calibrated": calibrated.all}
            sets.append(_pose_set(c, name, heldout, statistics))
    return ReportFacts(tuple(sets), *_joints(c), _coverage(c, sets, covered))


def _coverage(c: Record, sets: list[PoseSet], covered: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    proof = next((poses.points for poses in sets if poses.proves), None)
    if proof is None or c.model == "nominal":
        return None
    return covered if covered and proof.poses == c.poses_heldout else coverage(c.robot_calibrated(), proof)


T = TypeVar("T")


def _pose_set(c: Record, name: str, heldout: bool, statistics: Mapping[str, Statistics]) -> PoseSet:
    table = c.points
    rows = np.flatnonzero(np.array(table.heldout, dtype=bool) == heldout)

    def column_of(column: list[T]) -> list[T]:
        return [column[k] for k in rows.tolist()]

    points, direction = c.used_points(heldout) or (None, None)
    target = column_of(table.target)
    if points is not None:
        pose, pose_names, groups = points.pose, points.pose_ids.tolist(), points.groups.tolist()
    else:
        pose, pose_names, groups = _runs(column_of(table.pose), column_of(table.group))
    spot = np.arange(len(pose_names)) if points is None else repeat_groups(points)
    errors = {model: np.array(getattr(table, f"{model}_mm"))[rows] * MM for model in statistics}
    per_pose = {model: group_means(error, pose) for model, error in errors.items()}
    gain = per_pose["nominal"] - per_pose["calibrated"]
    nearer = float(np.mean(gain > 0.0))
    robots_named = ("the calibrated robot", "the nominal robot")
    better, worse = robots_named if gain.mean() >= 0.0 else robots_named[::-1]
    compared: Pair | None = Pair.from_errors(better, worse, gain if gain.mean() >= 0.0 else -gain, spot)
    intervals = {model: accuracy.intervals(errors[model], spot[pose]) for model in statistics if name == "held-out"}
    covers, count = accuracy.largest_covers(len(np.unique(spot))), len(pose_names)
    if points is not None and direction is not None and count > MOST_POSES:
        sampled = _drawn(errors["calibrated"], pose, count)
        shown, keep = sampled[pose], np.flatnonzero(sampled)
        target = [target[k] for k in np.flatnonzero(shown)]
        pose_names, groups = ([column[k] for k in keep] for column in (pose_names, groups))
        errors = {model: values[shown] for model, values in errors.items()}
        per_pose = {model: values[keep] for model, values in per_pose.items()}
        points, direction = points.select(sampled), direction[keep]
        pose = points.pose
    robots = {"nominal": c.robot_nominal(), "calibrated": c.robot_calibrated()}
    if c.model == "nominal":
        del robots["calibrated"]
        compared = None
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    models = {
        model: ModelErrors(
            statistics[model],
            errors[model],
            per_pose[model],
            intervals.get(model),
            None if points is None else accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            None if points is None else accuracy.turns(robot, points),
        )
        for model, robot in robots.items()
    }
    seen_at = None if points is None else frames.apply(T_base_world, points.xyz)
    return PoseSet(
        name,
        pose,
        tuple(pose_names),
        tuple(groups),
        tuple(target),
        models,
        seen_at,
        compared,
        nearer,
        covers,
        points,
        direction,
        count,
        error_name=POSITION if c.features is None else FROM_FEATURE,
        arm=line_at_home(robots["nominal"].arm),
    )


def _drawn(error: FloatArray, pose: IntArray, n: int) -> BoolArray:
    """Which of n poses are drawn."""
    sampled = np.isin(np.arange(n), np.random.default_rng(0).permutation(n)[:MOST_POSES])
    sampled[pose[np.argsort(-error, kind="stable")[:WORST]]] = True
    return sampled


def _runs(names: list[str], groups: list[str]) -> tuple[IntArray, list[str], list[str]]:
    """Poses of points in order: a new one begins where the name changes."""
    first = [k for k, name in enumerate(names) if k == 0 or name != names[k - 1]]
    pose = np.zeros(len(names), dtype=int)
    pose[first[1:]] = 1
    return np.cumsum(pose), [names[k] for k in first], [groups[k] for k in first]


def _joints(c: Record) -> tuple[ResidualAnalysis | None, str]:
    """Which terms each joint needs, and why nothing is known of it."""
    used = c.used_points(None)
    if used is None:
        return None, "this calibration was saved without the measured places"
    points, came_from = used
    if points.previous is None or not came_from.any():
        return None, "the order in which these poses were run is not known"
    try:
        return analyse_residuals(c.arm(calibrated=False), points, points.q - points.previous, cleaned=True), ""
    except IrbcalError as error:
        return None, str(error)


SHARE = 0.15
"""Share of the mean square error from which something is named."""
FEW_POSES = 0.05
"""Share of the poses that is called a few."""
NOISE_MM = 0.1
"""Residuals of the fit (rms) that a laser tracker and a robot's repeatability may leave."""
HALF = 0.5
"""Share of the mean square error that a few poses hold where they are named."""
ADDED = "(irbcal plan), and add them: irbcal calibrate NEW.csv --with DIR --out NEW_DIR."
FEATURE_ADVICE = "at more places (irbcal plan --device), and calibrate from all rows together."


@dataclass(frozen=True)
class Limit:
    """Something that keeps a calibration from being better."""

    sentence: str
    """A sentence with figures."""
    next: str
    """What to do about it."""
    share: float
    """Of the mean square error; above 1 what comes before all accuracy."""


def limits(record: Record, facts: ReportFacts) -> list[Limit]:
    """What limits a calibration, the largest first; empty where nothing stands out."""
    first = facts.sets[0]
    model = first.models.get("calibrated", first.models["nominal"])
    rms = float(np.sqrt(np.mean(model.distance**2)) / MM)
    found_limits = [*_before_all(record, first), *_corner(record)]
    if rms > 0.0:
        found_limits += [
            *_few_poses(record, rms, first),
            *_small_model(record, rms),
            *_lag(record),
            *_reversal(record, facts, rms),
        ]
        found_limits += [*_untried(record, rms), *_outliers(first)]
    found_limits = [limit for limit in found_limits if limit.share >= SHARE]
    return sorted(found_limits, key=lambda limit: -limit.share)


def _before_all(record: Record, first: PoseSet) -> list[Limit]:
    """What must be cleared up before accuracy is spoken of."""
    verdict, out = verdict_of(record), []
    if record.doubts:
        out.append(
            Limit(
                "Something speaks against these data, see above.",
                "Clear up the doubts above first, then calibrate again.",
                4.0,
            )
        )
    if not first.proves:
        out.append(Limit("No pose was held out: the accuracy is not known.", "Calibrate with --holdout.", 3.0))
    elif verdict.outcome == "worse":
        out.append(Limit("The model is worse than the nominal robot.", "Calibrate with --model auto.", 3.0))
    return out


def _how(record: Record) -> str:
    """What to do with more poses."""
    return FEATURE_ADVICE if record.features else ADDED


def _corner(record: Record) -> list[Limit]:
    """Joints that went through a part of their limits only."""
    section = record.certainty.workspace_coverage
    if section is None or not section.narrow:
        return []
    worst = int(np.argmin(section.shares))
    return [
        Limit(
            f"The poses cover a corner of the workspace: joint {worst + 1} went through {section.shares[worst]:.0%} of "
            f"its limits; {section.there_mm:.3f} mm (rms) must be expected elsewhere, {section.here_mm:.3f} mm here.",
            f"Measure poses all over the workspace {_how(record)}",
            2.0,
        )
    ]


def _few_poses(record: Record, rms: float, first: PoseSet) -> list[Limit]:
    """Errors of poses that took no part in the fit above those of the fit."""
    fitted = record.fit.all.rms_mm
    if not first.proves or rms <= fitted or record.model == "nominal":
        return []
    return [
        Limit(
            f"Few poses: those that the fit never saw have {rms:.3f} mm (rms), the {record.poses_fit} fitted ones "
            f"{fitted:.3f} mm.",
            f"Measure {record.poses_fit} more poses {_how(record)}",
            1.0 - (fitted / rms) ** 2,
        )
    ]


def _small_model(record: Record, rms: float) -> list[Limit]:
    """A level that misses its own poses by more than a tracker does."""
    fitted = record.fit.all.rms_mm
    if record.evidence is not None or record.model == "nominal" or fitted < NOISE_MM:
        return []
    return [
        Limit(
            f"The model: level {record.model} leaves {fitted:.3f} mm (rms) on the very poses that it was fitted to.",
            "Calibrate with --model auto, which also tries gears, gravity in all joints, warm-up and the last move.",
            min(1.0, (fitted / rms) ** 2),
        )
    ]


def _lag(record: Record) -> list[Limit]:
    """Joint readings that lag behind the arm."""
    if record.evidence is None or not record.evidence.readings_lag:
        return []
    return [
        Limit(
            "The joint readings lag: taken before the arm stood still, or shown late by the controller.",
            "Give the programmed joints (columns c1_deg …), or read joints and tracker after a longer stop.",
            0.9,
        )
    ]


def _reversal(record: Record, facts: ReportFacts, rms: float) -> list[Limit]:
    """Backlash and friction that the model has not taken."""
    history = record.robot_calibrated().joint_map.history
    found = () if facts.joints is None or history.terms else facts.joints.needed
    terms = [term for term in found if term.kind in ("backlash", "move")]
    if not terms:
        return []
    joints = ", ".join(dict.fromkeys(str(term.joint) for term in terms))
    n = len({term.joint for term in terms})
    return [
        Limit(
            f"Gears: {inflected(n, f'joint {joints} stops', f'joints {joints} stop')} elsewhere when reached from "
            f"the other side or after a longer move (joint {terms[0].joint} alone: {terms[0].moves / MM:.3f} mm).",
            "Reach targets that matter from one side always, or calibrate with --model auto: it learns the last move.",
            min(sum((term.moves / MM / rms) ** 2 for term in terms), 1.0),
        )
    ]


def _untried(record: Record, rms: float) -> list[Limit]:
    """Families of terms that were tried and not taken, or could not be tried."""
    if record.evidence is None:
        return []
    carried = [stage for stage in record.evidence.explained if stage.carried]
    tried = [stage for stage in record.evidence.explained if not stage.carried]
    if not carried or not tried:
        return []
    best = min(tried, key=lambda stage: stage.leave_one_out_mm)
    now = carried[-1].leave_one_out_mm
    if best.leave_one_out_mm >= now:
        return []
    return [
        Limit(
            f"Bending and wobble that a URDF cannot hold: with {best.added}, poses left out of the fit fall from "
            f"{now:.3f} to {best.leave_one_out_mm:.3f} mm (rms).",
            "Calibrate with --terms all, where irbcal itself corrects the programs.",
            1.0 - (best.leave_one_out_mm / now) ** 2,
        )
    ]


def _outliers(first: PoseSet) -> list[Limit]:
    """A few poses that hold most of the error."""
    square = np.sort(np.array(list(first.models.values())[-1].per_pose) ** 2)[::-1]
    count = max(1, int(FEW_POSES * len(square)))
    share = float(square[:count].sum() / max(square.sum(), 1e-300))
    if len(square) < 20 or share < HALF:
        return []
    return [
        Limit(
            f"A few poses: {count} of {len(square)} hold {share:.0%} of the mean square error.",
            "Look at the worst poses below: was a reflector hit, a joint at its end, the tool touched?",
            share,
        )
    ]
