"""Measuring plans: from a robot and wishes to poses in their order; what ``irbcal plan`` does."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal import safe_files
from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.correction import languages
from irbcal.correction.language import Language
from irbcal.correction.moves import JointMove, Moves
from irbcal.declared_options import takes_fields_of
from irbcal.errors import MeasurementError, OptionError, ProgramError
from irbcal.measurement.column_names import joint_columns
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import DECIMALS, home_joints
from irbcal.modeling.parameters import default_level
from irbcal.names import csv_bytes
from irbcal.option_values import Progress
from irbcal.planning import choosing, route
from irbcal.planning.choosing import (
    MOST_REFLECTORS,
    Poses,
    Tally,
    axis_moves,
    first_seen,
    in_cube,
    random_poses,
)
from irbcal.planning.conditions import CONDITIONS
from irbcal.planning.lost_zeros_plan import enough_poses, model_of_zeros, zeros_of_plan_in_words
from irbcal.planning.optimal_design import CRITERIA, DesignComparison, Model
from irbcal.planning.plan_options import MANY, READINGS_S, PlanOptions
from irbcal.planning.prediction import PlanPrediction, predict
from irbcal.planning.scene import Scene, open_scene
from irbcal.simulation.instruments import FRONT
from irbcal.simulation.pose_list import InRegion
from irbcal.summary import Paragraph, Result, Table, remarks, values
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd


def _measured(poses: Poses) -> tuple[FloatArray, BoolArray]:
    """Joints of poses and the reflectors that are measured in them."""
    return poses.q, first_seen(poses.visible, MOST_REFLECTORS)


def stops(
    scene: Scene, options: PlanOptions, q: FloatArray, measured: BoolArray, start: FloatArray, over_home: BoolArray
) -> FloatArray:
    """When the robot stands still in each pose, seconds from the start, shape (n,).

    Moves are as quick as the slowest joint, or as the tip (Nubiola 2011, section 7.1: 500 mm/s, four seconds of rest).
    """
    q_before = np.concatenate([start[None], q[:-1]])
    home = np.broadcast_to(start, q.shape)
    direct = move_times(scene, options, q_before, q)
    around = move_times(scene, options, q_before, home) + move_times(scene, options, home, q)
    hold = options.hold_s(measured)
    times: FloatArray = np.cumsum(np.where(over_home, around, direct) + np.concatenate([[0.0], hold[:-1]]))
    return times


def move_times(scene: Scene, options: PlanOptions, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Seconds of each move, shape (m,)."""
    q_between, starts = route.between(q_from, q_to, scene.setting.arm.table.prismatic)
    tip = scene.setting.tip_and_reflectors(q_between)[0]
    pieces = np.append(np.linalg.norm(np.diff(tip, axis=0), axis=1), 0.0)
    pieces[starts[1:] - 1] = 0.0
    by_joint = route.move_times(q_from, q_to, scene.joint_speed)
    return np.maximum(by_joint, np.add.reduceat(pieces, starts) / options.speed)


QUICKEST = 0.5
"""Largest share of the joints' speeds: the arm carries reflectors."""
FIRST = 0.1
"""Share of the first move, which begins wherever the arm stands."""


def language_of(arm: Arm, options: PlanOptions) -> tuple[str, str]:
    """The language of the plan's program by its short name, and why there is none.

    Returns
    -------
    name, note : str
        One of them is empty, or both where tables were asked for.

    Raises
    ------
    OptionError
        If the options names a language that is not known, or that cannot serve the arm.
    """
    known_languages = languages.by_name()
    if options.language is not None:
        if options.language not in known_languages:
            raise OptionError.unknown("language", options.language, tuple(known_languages))
        fault = _fault(arm, known_languages[options.language], options)
        if fault:
            raise OptionError(f"language: {fault}", parameter="language")
        return ("" if options.language == "csv" else options.language), ""
    language_of_robot = languages.of_robot(arm.name)
    if language_of_robot is None:
        reason = "the name of the robot does not tell its maker" if arm.six_revolute else "it is not a six-axis arm"
        return "", f"no robot program was written, because {reason}: the joints are in poses.csv" + (
            "; --language names a language" if arm.six_revolute else ""
        )
    fault = _fault(arm, language_of_robot, options)
    name = next(name for name, language in known_languages.items() if language is language_of_robot)
    return ("", f"no robot program was written: {fault}") if fault else (name, "")


def _fault(arm: Arm, language: Language, options: PlanOptions) -> str:
    """Why a language cannot serve an arm; empty where it can."""
    if language.name == "CSV":
        return ""
    if language.write_moves is None:
        return f"{language.name} has no moves to write"
    if not arm.six_revolute:
        return f"{language.name} programs are of six revolute joints, {arm.name} has {arm.joints_listed}"
    if language.maker is not None and language.maker.pulses and not options.pulses:
        return f"{language.name} holds pulses: give the pulses per degree of the six joints (--pulses)"
    try:
        if language.maker is not None:
            language.maker.check(arm, arm.name)
    except ProgramError as error:
        return str(error)
    return ""


def program_files(planned: Plan) -> dict[str, bytes]:
    """The files of a plan's program: joint moves, and a rest in each pose for the wait and the readings.

    Returns
    -------
    dict of str to bytes
        Empty where the arm has no program.

    Raises
    ------
    ProgramError
        If what was written does not hold the plan's joints.
    """
    name, _ = language_of(planned.scene.setting.arm, planned.options)
    return languages.write(languages.by_name()[name], moves(planned)) if name else {}


def moves(planned: Plan) -> Moves:
    """The moves of a plan: from home through all poses, over home where the direct way is not free, and back."""
    arm, options = planned.scene.setting.arm, planned.options
    home = home_joints(arm)
    stops = [([home] if over else []) + [q] for q, over in zip(planned.q, planned.over_home, strict=True)]
    q = np.array([home, *chain.from_iterable(stops), home])
    names = np.array(planned.scene.setting.targets.names, dtype=object)
    comments, waits = [""], [0.0]
    rows = zip(planned.groups, planned.measured, planned.hold_s, stops, strict=True)
    for row_number, (group, measured, hold, through) in enumerate(rows, start=1):
        comments += [f"pose {row_number}, {group}: {' '.join(names[measured])}", *[""] * (len(through) - 1)]
        waits += [*[0.0] * (len(through) - 1), float(hold)]
    share, speed = _speeds(planned, q)
    return Moves(
        arm=arm,
        q=q,
        moves=tuple(
            JointMove(text, wait, float(fraction), float(rate))
            for text, wait, fraction, rate in zip([*comments, ""], [*waits, 0.0], share, speed, strict=True)
        ),
        head=(
            f"Measuring plan for {arm.name}: {len(planned.q)} poses, about {planned.duration_s / 60:.0f} minutes.",
            f"In each pose: {options.wait_s:g} s of rest, then {READINGS_S:g} s for each reflector, "
            f"{options.references} references among them.",
            "Do not filter this program: it commands the joints of plan.csv.",
        ),
        tip_speed=options.speed,
        pulses=tuple(options.pulses or ()),
    )


def _speeds(planned: Plan, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the joints' largest speeds and speed of the joint that turns most, rad/s, of the move to each row."""
    rates = planned.scene.joint_speed
    fastest = route.move_times(q[:-1], q[1:], rates)
    seconds = np.maximum(move_times(planned.scene, planned.options, q[:-1], q[1:]), 1e-3)
    share = np.concatenate([[FIRST], np.clip(fastest / seconds, 0.01, QUICKEST)])
    rates_of_move = np.abs(np.diff(q, axis=0)).max(axis=1) / np.maximum(seconds, fastest / QUICKEST)
    return share, np.concatenate([[FIRST * float(rates.min())], np.maximum(rates_of_move, 0.01)])


def files(planned: Plan, page: str | None = None) -> dict[str, bytes]:
    """The files of a plan.

    Parameters
    ----------
    planned : Plan
    page : str, optional
        The scene to look at, HTML.

    Returns
    -------
    dict of str to bytes
        ``plan.csv`` (what the tracker is asked for), ``poses.csv`` (what the robot does), ``plan.json``; the program
        of `irbcal.planning.measuring_plan`; ``plan.html`` with a page.
    """
    out = {
        "plan.csv": _csv(plan_table(planned)),
        "poses.csv": _csv(planned.to_frame()),
        "plan.json": (json.dumps({"irbcal": "plan", **planned.to_dict()}, indent=1, allow_nan=False) + "\n").encode(),
    }
    out |= program_files(planned)
    if page is not None:
        out["plan.html"] = page.encode("utf-8")
    return out


def _csv(table: pd.DataFrame) -> bytes:
    """A table as it is written: joints with `DECIMALS` places, positions with three, times with one."""
    decimals = dict.fromkeys(joint_columns(table.columns), DECIMALS)
    decimals |= {f"expected_{axis}_mm": 3 for axis in "xyz"} | {"time_s": 1}
    text = table.copy()
    for name in decimals.keys() & set(table.columns):
        text[name] = [f"{value:.{decimals[name]}f}" for value in table[name]]
    return csv_bytes(text)


def plan_table(planned: Plan) -> pd.DataFrame:
    """A row for each reflector to measure: joints, reflector, where the tracker should expect it, when."""
    import pandas as pd

    pose, target, xyz, time = planned.expected()
    setting = planned.scene.setting
    joints = setting.arm.joint_table(planned.q[pose], DECIMALS)
    table = pd.DataFrame({"pose": pose + 1, "group": planned.groups[pose], **joints})
    table["target"] = np.array(setting.targets.names, dtype=object)[target]
    for k, axis in enumerate("xyz"):
        table[f"expected_{axis}_mm"] = xyz[:, k] / MM
    table["time_s"] = time
    if planned.options.payload is not None:
        table["payload_kg"] = planned.options.payload
    return table


def _compared(comparison: DesignComparison, options: PlanOptions) -> dict[str, Any]:
    """Chosen poses beside random ones; of a criterion in metres also as predicted errors, rms in mm."""

    def values(value: float) -> dict[str, float]:
        in_metres = CRITERIA[options.criterion].IN_METRES
        return {"value": value} | ({"error_mm": float(np.sqrt(value) / MM)} if in_metres else {})

    return {
        "criterion": options.criterion,
        "optimal": {"poses": options.optimal, **values(comparison.optimal)},
        "random": [{"poses": n, **values(value)} for n, value in comparison.random.items()],
        "as_good_as_random_poses": comparison.as_good_as,
        "scatter_alone": None if comparison.scatter is None else _compared(comparison.scatter, options),
    }


_SHOWN = {"axis": "axis moves", "iso_cube": "ISO cube", "all_range": "all range"}
_WHERE = {"cube": "in the cube", "range": "in the whole range"}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """Poses to measure, in their order, and what they promise."""

    scene: Scene
    options: PlanOptions
    q: FloatArray
    """Shape (n, joints). Commanded joints in the order of the run, radians (metres for prismatic joints)."""
    measured: BoolArray
    """Shape (n, k). Reflectors measured in each pose."""
    groups: NameArray
    """Shape (n,)."""
    over_home: BoolArray
    """Shape (n,). Poses to which the robot goes over its home joints, for the direct way is not free."""
    tallies: dict[str, Tally]
    """Of each source of poses."""
    prediction: PlanPrediction
    position_std: dict[str, FloatArray]
    """Standard deviations of the first measured reflector's predicted position in ``cube`` and ``range``, metres."""
    stops: FloatArray
    """Shape (n,). When the robot stands still in each pose, seconds from the start."""
    comparison: DesignComparison | None
    """Of optimal poses with random ones."""
    notes: tuple[str, ...]

    @property
    def hold_s(self) -> FloatArray:
        """Seconds of standing still in each pose: the wait and the readings, shape (n,)."""
        return self.options.hold_s(self.measured)

    @property
    def duration_s(self) -> float:
        """Of the whole run, an estimate."""
        return float(self.stops[-1] + self.hold_s[-1])

    def expected(self) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Pose and reflector of each measurement, its place in the frame of the expected coordinates, and its time.

        Returns
        -------
        pose, target : ndarray of int, shape (m,)
        xyz : ndarray, shape (m, 3)
            Metres.
        time_s : ndarray, shape (m,)
        """
        pose, target = np.nonzero(self.measured)
        _, points, _ = self.scene.setting.tip_and_reflectors(self.q)
        number = (np.cumsum(self.measured, axis=1) - 1)[pose, target]
        time = self.stops[pose] + self.options.wait_s + READINGS_S * number
        return pose, target, frames.apply(self.scene.T_world_base, points[pose, target]), time

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        lines: list[Paragraph] = [
            f"{self.scene.setting.arm.name}: {len(self.q)} poses, {self.measured.sum()} points, about "
            f"{self.duration_s / 60:.0f} minutes",
            self._counts(),
        ]
        if off := self._conditions_off():
            lines.append(f"Conditions that are off: {', '.join(off)}")
        model, parameters = self.prediction.model, self.prediction.parameters
        single = sum(parameter.state == "identified" for parameter in parameters)
        lines.append(
            f"Model {model.level}, scatter of {self.options.noise / MM:g} mm a coordinate: {single} of "
            f"{len(parameters)} parameters identified by themselves;"
        )
        lines += [
            f"  positions of {model.targets.names[0]} {_WHERE[name]} predicted to {std['rms']:.3f} mm "
            f"(at worst {std['max']:.3f} mm)"
            for name, std in self._std_mm().items()
        ]
        lines.append(
            "  These are standard deviations from scatter alone; what the model does not describe is not in them."
        )
        if compared := self._compared():
            lines += _compare_with_random(compared)
        return lines + remarks("Note", self.notes)

    def _counts(self) -> Table:
        tallies = self.tallies.values()
        rows: list[tuple[str | int | None, ...]] = [("looked at", *(tally.tried for tally in tallies))]
        for name in ("place", *self.scene.setting.conditions):
            label = "outside the cube" if name == "place" else f"removed by {name}"
            rows.append((label, *(tally.removed.get(name) for tally in tallies)))
        rows.append(("left", *(tally.accepted for tally in tallies)))
        columns = ("candidates", *(_words(source) for source in self.tallies))
        return Table("What each condition removed", columns, tuple(rows), bold=frozenset([len(rows) - 1]))

    def to_frame(self) -> pd.DataFrame:
        """The poses, as ``irbcal.simulate`` and the file ``poses.csv`` take them.

        Returns
        -------
        DataFrame
            A row for each pose: ``pose``, ``group``, joints in degrees (mm for prismatic joints), ``targets`` (names
            with spaces between them), ``wait_s``.
        """
        import pandas as pd

        setting = self.scene.setting
        names = np.array(setting.targets.names, dtype=object)
        return pd.DataFrame(
            {
                "pose": np.arange(1, len(self.q) + 1),
                "group": self.groups,
                **setting.arm.joint_table(self.q, DECIMALS),
                "targets": [" ".join(names[row]) for row in self.measured],
                "wait_s": self.options.wait_s,
            }
        )

    CONTENT = (
        "robot=scene.setting.arm.name source=_source language=_language poses=q.__len__ points=measured.sum duration_s "
        "groups=_by_group conditions=scene.setting.conditions conditions_off=_conditions_off counts=tallies "
        "predicted=_predicted compared_with_random=_compared settings=_settings notes"
    )

    def _source(self) -> str:
        return str(robot) if isinstance(robot := self.options.robot, (str, Path)) else self.scene.nominal.name

    def _language(self) -> str | None:
        return language_of(self.scene.setting.arm, self.options)[0] or None

    def _by_group(self) -> dict[str, int]:
        return dict(Counter(self.groups.tolist()))

    def _conditions_off(self) -> list[str]:
        return [name for name in CONDITIONS if name not in self.scene.setting.conditions]

    def _predicted(self) -> dict[str, Any]:
        names = "noise_mm=options.noise model=prediction.model.level position_std_mm=_std_mm"
        return values(self, f"{names} parameters=prediction.parameters") | {
            "position_target": self.prediction.model.targets.names[0],
            "note": "from the scatter of the points alone: what the model does not describe is not in it",
        }

    def _std_mm(self) -> dict[str, dict[str, float]]:
        return {
            name: {"rms": float(np.sqrt(np.mean(std**2)) / MM), "max": float(std.max() / MM)}
            for name, std in self.position_std.items()
        }

    def _compared(self) -> dict[str, Any] | None:
        return None if self.comparison is None else _compared(self.comparison, self.options)

    def _settings(self) -> dict[str, Any]:
        setting, options = self.scene.setting, self.options
        targets, looks = setting.targets, setting.targets.directions
        return {
            **values(options, "seed *counts optimal criterion volume wait_s speed_mm_s=speed payload_kg=payload"),
            **values(setting, "min_height_mm=heights tracker_mm=tracker_position"),
            "margin_deg": round(setting.margin / DEG, 9),
            "acceptance_deg": round(setting.acceptance / DEG, 9),
            "candidates": options.candidates if options.optimal else 0,
            "unmodelled_joint_errors_deg": options.unmodelled / DEG if CRITERIA[options.criterion].IN_METRES else 0.0,
            "front_begins_at_x_mm": FRONT / MM,
            "cube_centre_mm": np.asarray(self.scene.cube[0]) / MM,
            "cube_edge_mm": self.scene.cube[1] / MM,
            "T_tracker_base": self.scene.T_world_base,
            "targets_mm": dict(zip(targets.names, targets.positions / MM, strict=True)),
            "targets_look_along": None if looks is None else dict(zip(targets.names, looks, strict=True)),
            "readings_s": READINGS_S,
        }

    def save(self, folder: str | Path, page: str | None = None) -> tuple[Path, ...]:
        """Write the files that carry the plan out; see `irbcal.planning.measuring_plan.files`.

        Parameters
        ----------
        folder : str or Path
        page : str, optional
            The plan to look at, HTML; see `irbcal.viewer.building.plan_page`.

        Returns
        -------
        tuple of Path
            The files written.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        contents = files(self, page)
        safe_files.write_together(folder, contents)
        return tuple(Path(folder) / name for name in contents)


def _compare_with_random(compared: dict[str, Any]) -> list[str]:
    """What the choice promises beside as many random poses: with errors that no model describes, and without."""
    criterion, scatter = CRITERIA[compared["criterion"]], compared["scatter_alone"]
    comparisons = {criterion.WORDS: compared}
    if criterion.IN_METRES:
        comparisons = {"scatter alone": compared} if scatter is None else comparisons | {"scatter alone": scatter}
    out = []
    for basis, comparison in comparisons.items():
        chosen, random = (
            comparison["optimal"],
            {row["poses"]: row for row in comparison["random"]}[comparison["optimal"]["poses"]],
        )
        if "error_mm" in chosen:
            figures = (
                f"{chosen['error_mm']:.3f} mm with the {chosen['poses']} chosen poses, {random['error_mm']:.3f} mm with"
            )
        else:
            figures = f"{chosen['value']:.1f} with the {chosen['poses']} chosen poses, {random['value']:.1f} with"
        as_good, largest = comparison["as_good_as_random_poses"], comparison["random"][-1]["poses"]
        subject = "Predicted error of positions (rms)" if "error_mm" in chosen else "By"
        out.append(
            f"{subject}{' from' if 'error_mm' in chosen else ''} {basis}: {figures} as many random ones of the same "
            f"candidates (by this, {'about' if as_good else 'more than'} {as_good or largest} would do as well)."
        )
    return out


def _words(source: str) -> str:
    for name, text in _SHOWN.items():
        source = source.replace(name, text)
    return source


@takes_fields_of(PlanOptions)
def plan(options: PlanOptions) -> Plan:
    """Plan measurements: poses that the robot reaches and the tracker sees, and what they promise.

    Unless other kinds or numbers are asked for, these are the 120 poses of Nubiola 2011, section 7.2. All lengths are
    metres, all angles radians.

    Raises
    ------
    OptionError
        If an option has an unknown value or options need one another.
    IrbcalError
        If an input is refused or the poses cannot be found; the sentence counts what each condition removed.

    Examples
    --------
    >>> plan("irb1600", optimal=60).save("plan")  # doctest: +SKIP
    """
    step: Progress = options.progress or (lambda text: None)
    options, counts = replace(options, progress=None), options.counts
    scene = open_scene(options)
    setting = scene.setting
    _, no_program = language_of(setting.arm, options)
    model = Model(scene.nominal, setting.targets, str(options.level or default_level(scene.nominal)), options.noise)
    if options.refit_zeros:
        model = model_of_zeros(scene, options.refit_zeros)
        options = replace(options, noise=model.noise)
    seeds = [int(k) for k in np.random.SeedSequence(options.seed).generate_state(6)]
    axis: list[Poses] = []
    movable: list[Poses] = []
    tallies: dict[str, Tally] = {}
    missing: list[str] = []
    if counts["axis"]:
        step("axis moves")
        try:
            axis.append(axis_moves(setting, counts["axis"] == MANY))
            tallies["axis"] = axis[0].tally
        except MeasurementError as error:
            if options.axis is not None:
                raise
            missing.append(f"the plan is without axis moves, which only the method circles needs: {error}")
    kinds: tuple[tuple[int, str, InRegion | None, int], ...] = (
        (counts["cube"], "iso_cube", in_cube(*scene.cube), seeds[0]),
        (counts["all_range"], "all_range", None, seeds[1]),
    )
    for count, group, region, seed in kinds:
        if count:
            step(f"{count} poses, {group}")
            movable.append(random_poses(setting, count, group, seed, region))
            tallies[group] = movable[-1].tally
    samples, comparison = choosing.samples(scene, seeds[4:], step), None
    fixed_poses = [*axis, *movable]

    def chosen(options: PlanOptions) -> tuple[Poses, DesignComparison, dict[str, Tally]]:
        return choosing.optimal(scene, options, model, fixed_poses, samples, seeds[2:4], step)

    if options.refit_zeros and not (options.optimal or fixed_poses):
        options = enough_poses(options, lambda options: predict(model, *_measured(chosen(options)[0])))
    if options.optimal:
        poses_chosen, comparison, more = chosen(options)
        movable.append(poses_chosen)
        tallies |= more
    step("order")
    start = home_joints(setting.arm)
    poses, over_home, notes = choosing.in_order(scene, axis, movable, start)
    measured = _measured(poses)[1]
    step("prediction")
    prediction = predict(model, poses.q, measured)
    if options.refit_zeros:
        notes += zeros_of_plan_in_words(options, prediction, len(poses.q))
    first = prediction.model.targets.names[0]
    std = {name: prediction.position_std(q_samples, first) for name, q_samples in samples.items()}
    times = stops(scene, options, poses.q, measured, start, over_home)
    outside = "" if scene.certainty is None else scene.certainty.outside_in_words(poses.q, "planned poses")
    notes = [*scene.tracker_notes, *scene.notes, *missing, *notes, *(text for text in (outside, no_program) if text)]
    return Plan(
        scene,
        options,
        poses.q,
        measured,
        poses.groups,
        over_home,
        tallies,
        prediction,
        std,
        times,
        comparison,
        tuple(notes),
    )
