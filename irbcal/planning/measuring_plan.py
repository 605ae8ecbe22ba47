"""Measuring plans: from a robot and wishes to poses in their order; what ``irbcal plan`` does."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal import safe_files
from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.correction import languages
from irbcal.correction.language import Language
from irbcal.correction.moves import JointMove, Moves
from irbcal.errors import MeasurementError, OptionError, ProgramError
from irbcal.io.opening import RobotLike
from irbcal.measurement.columns import joint_columns
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.home import DECIMALS, home_joints
from irbcal.modeling.parameters import default_level
from irbcal.names import csv_bytes
from irbcal.options import number, pulses_per_degree
from irbcal.planning import choosing, route
from irbcal.planning.choosing import (
    FEW,
    MANY,
    MOST_REFLECTORS,
    READINGS_S,
    PlanRequest,
    Poses,
    Region,
    Step,
    Tally,
    axis_moves,
    first_seen,
    in_cube,
    random_poses,
)
from irbcal.planning.conditions import CONDITIONS, TargetsLike
from irbcal.planning.lost_zeros_plan import enough_poses, model_of_zeros, zeros_of_plan_in_words
from irbcal.planning.optimal_design import CRITERIA, IMAGINED_SIZE, NOISE, DesignComparison, Model
from irbcal.planning.prediction import PlanPrediction, predict
from irbcal.planning.scene import Scene, open_scene
from irbcal.simulation.instruments import ACCEPTANCE, FRONT
from irbcal.simulation.virtual_cell import WAIT_S
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd


def _measured(poses: Poses) -> tuple[FloatArray, BoolArray]:
    """Joints of poses and the reflectors that are measured in them."""
    return poses.q, first_seen(poses.seen, MOST_REFLECTORS)


def stops(
    scene: Scene, request: PlanRequest, q: FloatArray, measured: BoolArray, start: FloatArray, over_home: BoolArray
) -> FloatArray:
    """When the robot stands still in each pose, seconds from the start, shape (n,).

    Moves are as quick as the slowest joint, or as the tip (Nubiola 2011, section 7.1: 500 mm/s, four seconds of rest).
    """
    q_before = np.concatenate([start[None], q[:-1]])
    home = np.broadcast_to(start, q.shape)
    direct = move_times(scene, request, q_before, q)
    around = move_times(scene, request, q_before, home) + move_times(scene, request, home, q)
    hold = request.hold_s(measured)
    times: FloatArray = np.cumsum(np.where(over_home, around, direct) + np.concatenate([[0.0], hold[:-1]]))
    return times


def move_times(scene: Scene, request: PlanRequest, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Seconds of each move, shape (m,)."""
    q_between, starts = route.between(q_from, q_to, scene.setting.arm.table.prismatic)
    tip = scene.setting.places(q_between)[0]
    pieces = np.append(np.linalg.norm(np.diff(tip, axis=0), axis=1), 0.0)
    pieces[starts[1:] - 1] = 0.0
    by_joint = route.move_times(q_from, q_to, scene.joint_speed)
    return np.maximum(by_joint, np.add.reduceat(pieces, starts) / request.speed)


QUICKEST = 0.5
"""Largest share of the joints' speeds: the arm carries reflectors."""
FIRST = 0.1
"""Share of the first move, which begins wherever the arm stands."""


def language_of(arm: Arm, request: PlanRequest) -> tuple[str, str]:
    """The language of the plan's program by its short name, and why there is none.

    Returns
    -------
    name, note : str
        One of them is empty, or both where tables were asked for.

    Raises
    ------
    OptionError
        If the request names a language that is not known, or that cannot serve the arm.
    """
    known_languages = languages.by_name()
    if request.language is not None:
        if request.language not in known_languages:
            raise OptionError.unknown("language", request.language, tuple(known_languages))
        fault = _fault(arm, known_languages[request.language], request)
        if fault:
            raise OptionError(f"language: {fault}", parameter="language")
        return ("" if request.language == "csv" else request.language), ""
    found = languages.of_robot(arm.name)
    if found is None:
        reason = "the name of the robot does not tell its maker" if arm.six_revolute else "it is not a six-axis arm"
        return "", f"no robot program was written, because {reason}: the joints are in poses.csv" + (
            "; --language names a language" if arm.six_revolute else ""
        )
    fault = _fault(arm, found, request)
    name = next(name for name, language in known_languages.items() if language is found)
    return ("", f"no robot program was written: {fault}") if fault else (name, "")


def _fault(arm: Arm, language: Language, request: PlanRequest) -> str:
    """Why a language cannot serve an arm; empty where it can."""
    if language.name == "CSV":
        return ""
    if language.write_moves is None:
        return f"{language.name} has no moves to write"
    if not arm.six_revolute:
        return f"{language.name} programs are of six revolute joints, {arm.name} has {arm.joints_listed}"
    if language.maker is not None and language.maker.pulses and not request.pulses:
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
        None where the arm has no program.

    Raises
    ------
    ProgramError
        If what was written does not hold the plan's joints.
    """
    name, _ = language_of(planned.scene.setting.arm, planned.request)
    return languages.write(languages.by_name()[name], moves(planned)) if name else {}


def moves(planned: Plan) -> Moves:
    """The moves of a plan: from home through all poses, over home where the direct way is not free, and back."""
    arm, request = planned.scene.setting.arm, planned.request
    home = home_joints(arm)
    stops = [([home] if over else []) + [q] for q, over in zip(planned.q, planned.over_home, strict=True)]
    q = np.array([home, *chain.from_iterable(stops), home])
    names = np.array(planned.scene.setting.targets.names, dtype=object)
    comments, waits = [""], [0.0]
    rows = zip(planned.groups, planned.asked, planned.hold_s, stops, strict=True)
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
            f"In each pose: {request.wait_s:g} s of rest, then {READINGS_S:g} s for each reflector, "
            f"{request.references} references among them.",
            "Do not filter this program: it commands the joints of plan.csv.",
        ),
        tip_speed=request.speed,
        pulses=request.pulses,
    )


def _speeds(made: Plan, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the joints' largest speeds and speed of the joint that turns most, rad/s, of the move to each row."""
    rates = made.scene.joint_speed
    fastest = route.move_times(q[:-1], q[1:], rates)
    planned = np.maximum(move_times(made.scene, made.request, q[:-1], q[1:]), 1e-3)
    share = np.concatenate([[FIRST], np.clip(fastest / planned, 0.01, QUICKEST)])
    rates_of_move = np.abs(np.diff(q, axis=0)).max(axis=1) / np.maximum(planned, fastest / QUICKEST)
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
        "plan.json": (json.dumps(planned.to_dict(), indent=1, allow_nan=False) + "\n").encode(),
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


def _joints(planned: Plan) -> FloatArray:
    """Joints as they are commanded and as the controller counts them, degrees and millimetres, shape (n, joints)."""
    arm = planned.scene.setting.arm
    return np.round(arm.to_controller(planned.q) / arm.joint_units, DECIMALS) + 0.0


def plan_table(planned: Plan) -> pd.DataFrame:
    """A row for each reflector to measure: joints, reflector, where the tracker should expect it, when."""
    import pandas as pd

    pose, target, xyz, time = planned.expected()
    table = pd.DataFrame(_joints(planned)[pose], columns=planned.scene.setting.arm.joint_columns)
    table.insert(0, "pose", pose + 1)
    table.insert(1, "group", planned.groups[pose])
    table["target"] = np.array(planned.scene.setting.targets.names, dtype=object)[target]
    for k, axis in enumerate("xyz"):
        table[f"expected_{axis}_mm"] = xyz[:, k] / MM
    table["time_s"] = time
    if planned.request.payload_kg is not None:
        table["payload_kg"] = planned.request.payload_kg
    return table


def _compared(comparison: DesignComparison, request: PlanRequest) -> dict[str, Any]:
    """Chosen poses beside random ones; of a criterion in metres also as predicted errors, rms in mm."""

    def values(value: float) -> dict[str, float]:
        in_metres = CRITERIA[request.criterion].IN_METRES
        return {"value": value} | ({"error_mm": float(np.sqrt(value) / MM)} if in_metres else {})

    return {
        "criterion": request.criterion,
        "optimal": {"poses": request.optimal, **values(comparison.optimal)},
        "random": [{"poses": n, **values(value)} for n, value in comparison.random.items()],
        "as_good_as_random_poses": comparison.as_good_as,
        "scatter_alone": None if comparison.scatter is None else _compared(comparison.scatter, request),
    }


def _settings(planned: Plan) -> dict[str, Any]:
    scene, request, setting = planned.scene, planned.request, planned.scene.setting
    return {
        "seed": request.seed,
        "axis": request.axis,
        "cube": request.cube,
        "all_range": request.all_range,
        "optimal": request.optimal,
        "candidates": request.candidates if request.optimal else 0,
        "criterion": request.criterion,
        "volume": request.volume,
        "imagined_joint_errors_deg": request.imagined / DEG if CRITERIA[request.criterion].IN_METRES else 0.0,
        "margin_deg": round(setting.margin / DEG, 9),
        "acceptance_deg": round(setting.acceptance / DEG, 9),
        "min_height_mm": None if setting.heights is None else [value / MM for value in setting.heights],
        "front_begins_at_x_mm": FRONT / MM,
        "cube_centre_mm": (np.asarray(scene.cube[0]) / MM).tolist(),
        "cube_edge_mm": scene.cube[1] / MM,
        "tracker_mm": (setting.place / MM).tolist(),
        "T_tracker_base": scene.T_world_base.tolist(),
        "targets_mm": dict(zip(setting.targets.names, (setting.targets.places / MM).tolist(), strict=True)),
        "targets_look_along": None
        if setting.targets.directions is None
        else dict(zip(setting.targets.names, setting.targets.directions.tolist(), strict=True)),
        "wait_s": request.wait_s,
        "readings_s": READINGS_S,
        "speed_mm_s": request.speed / MM,
        "payload_kg": request.payload_kg,
    }


_SHOWN = {"axis": "axis moves", "iso_cube": "ISO cube", "all_range": "all range"}
_WHERE = {"cube": "in the cube", "range": "in the whole range"}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """Poses to measure, in their order, and what they promise."""

    scene: Scene
    request: PlanRequest
    q: FloatArray
    """Shape (n, joints). Commanded joints in the order of the run, radians (metres for prismatic joints)."""
    asked: BoolArray
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
        return self.request.hold_s(self.asked)

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
        pose, target = np.nonzero(self.asked)
        _, points, _ = self.scene.setting.places(self.q)
        number = (np.cumsum(self.asked, axis=1) - 1)[pose, target]
        time = self.stops[pose] + self.request.wait_s + READINGS_S * number
        return pose, target, frames.apply(self.scene.T_world_base, points[pose, target]), time

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        facts = self.to_dict()
        predicted, compared = facts["predicted"], facts["compared_with_random"]
        lines: list[Paragraph] = [
            f"{facts['robot']}: {facts['poses']} poses, {facts['points']} points, about "
            f"{facts['duration_s'] / 60:.0f} minutes",
            self._counts(),
        ]
        if facts["conditions_off"]:
            lines.append(f"Conditions that are off: {', '.join(facts['conditions_off'])}")
        single = sum(parameter["state"] == "identified" for parameter in predicted["parameters"])
        lines.append(
            f"Model {predicted['model']}, scatter of {predicted['noise_mm']:g} mm a coordinate: {single} of "
            f"{len(predicted['parameters'])} parameters identified by themselves;"
        )
        lines += [
            f"  positions of {predicted['position_target']} {_WHERE[name]} predicted to {std['rms']:.3f} mm "
            f"(at worst {std['max']:.3f} mm)"
            for name, std in predicted["position_std_mm"].items()
        ]
        lines.append(
            "  These are standard deviations from scatter alone; what the model does not describe is not in them."
        )
        if compared:
            lines += _compare_with_random(compared)
        return lines + [f"Note: {note}" for note in self.notes]

    def _counts(self) -> Table:
        tallies = self.tallies.values()
        rows: list[tuple[str | int | None, ...]] = [("looked at", *(tally.tried for tally in tallies))]
        for name in ("place", *self.scene.setting.conditions):
            label = "outside the cube" if name == "place" else f"removed by {name}"
            rows.append((label, *(tally.removed.get(name) for tally in tallies)))
        rows.append(("left", *(tally.kept for tally in tallies)))
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

        table = pd.DataFrame(_joints(self), columns=self.scene.setting.arm.joint_columns)
        table.insert(0, "pose", np.arange(1, len(table) + 1))
        table.insert(1, "group", self.groups)
        names = np.array(self.scene.setting.targets.names, dtype=object)
        table["targets"] = [" ".join(names[row]) for row in self.asked]
        table["wait_s"] = self.request.wait_s
        return table

    def to_dict(self) -> dict[str, Any]:
        """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
        scene, request, setting = self.scene, self.request, self.scene.setting
        return {
            "robot": setting.arm.name,
            "source": scene.name,
            "language": language_of(setting.arm, request)[0] or None,
            "poses": len(self.q),
            "points": int(self.asked.sum()),
            "duration_s": self.duration_s,
            "groups": dict(Counter(self.groups.tolist())),
            "conditions": list(setting.conditions),
            "conditions_off": [name for name in CONDITIONS if name not in setting.conditions],
            "counts": {
                name: {"tried": tally.tried, "kept": tally.kept, "removed": dict(tally.removed)}
                for name, tally in self.tallies.items()
            },
            "predicted": {
                "noise_mm": request.noise / MM,
                "note": "from the scatter of the points alone: what the model does not describe is not in it",
                "model": self.prediction.model.level,
                "position_target": self.prediction.model.targets.names[0],
                "position_std_mm": {
                    name: {"rms": float(np.sqrt(np.mean(std**2)) / MM), "max": float(std.max() / MM)}
                    for name, std in self.position_std.items()
                },
                "parameters": [
                    {"name": parameter.name, "unit": parameter.unit, "std": parameter.std, "state": parameter.state}
                    for parameter in self.prediction.parameters
                ],
            },
            "compared_with_random": None if self.comparison is None else _compared(self.comparison, request),
            "settings": _settings(self),
            "notes": list(self.notes),
        }

    def save(self, folder: str | Path, page: str | None = None) -> tuple[Path, ...]:
        """Write the files that carry the plan out; see `irbcal.planning.measuring_plan.files`.

        Parameters
        ----------
        folder : str or Path
        page : str, optional
            The plan to look at, HTML; see `irbcal.viewer.view.plan_page`.

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


def plan(
    robot: RobotLike,
    *,
    axis: int | None = None,
    cube: int | None = None,
    all_range: int | None = None,
    optimal: int = 0,
    candidates: int = 2000,
    criterion: str = "position",
    volume: str = "both",
    level: str | int | None = None,
    targets: TargetsLike | None = None,
    tracker: ArrayLike | None = None,
    cube_centre: ArrayLike | None = None,
    cube_edge: float | None = None,
    margin: float = 2 * DEG,
    acceptance: float = ACCEPTANCE,
    min_height: tuple[float, float] | None = None,
    without: Sequence[str] = (),
    payload: float | None = None,
    wait_s: float = WAIT_S,
    references: int = 3,
    speed: float = 0.5,
    noise: float = NOISE,
    imagined: float = IMAGINED_SIZE,
    seed: int = 0,
    language: str | None = None,
    pulses: Sequence[float] | None = None,
    refit_zeros: Sequence[int] = (),
    package_dirs: Sequence[str | Path] = (),
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    progress: Step | None = None,
) -> Plan:
    """Plan measurements: poses that the robot reaches and the tracker sees, and what they promise.

    Unless other kinds or numbers are asked for, these are the 120 poses of Nubiola 2011, section 7.2. All lengths are
    metres, all angles radians.

    Parameters
    ----------
    robot : str, Path or calibration
        URDF, a robot's name (irbcal robots) or calibration folder.
    axis : int, optional
        Moves of one joint: three poses a joint (18), many (158) or none (0); 18 unless given, with ``optimal`` none.
    cube : int, optional
        Random poses in the ISO cube; 52 unless given, with ``optimal`` none.
    all_range : int, optional
        Random poses in the whole range; 50 unless given, with ``optimal`` none.
    optimal : int
        Poses chosen out of many candidates; other kinds then only where asked for.
    candidates : int
        Poses that ``optimal`` chooses from.
    criterion : {"position", "D"}
        What is best: predicted positions, or all parameters together (D).
    volume : {"both", "cube", "range"}
        Where predicted positions count.
    level : str, optional
        Error model to plan for: ``34`` unless given, ``placement`` for arms that it does not fit.
    targets : str, Path, int, sequence of str or Targets, optional
        Reflectors: a CSV (target, x_mm, y_mm, z_mm in the tip link and, at will, nx, ny, nz: where they look); how many
        of the thesis tool's nine, or their names with commas. 3 unless given, or the calibration's.
    tracker : array_like, shape (3,) or (4,), optional
        Place in the base link, metres, and, at will, the turn of its axes about z, radians; as in the thesis's cell, or
        as for the calibration, unless given.
    cube_centre, cube_edge : array_like of shape (3,) and float, optional
        ISO cube in the base link, metres, both or none: the largest cube in front unless given.
    margin : float
        From the joint limits, radians; on rails 10 mm a degree.
    acceptance : float
        Largest angle between reflector and beam, radians.
    min_height : tuple of float, optional
        Lowest z of tool and reflectors, in front (x from 150 mm) and at the back, metres: those of Nubiola 2011,
        section 7.2, for the IRB 1600 unless given, none for others.
    without : sequence of str
        Conditions to switch off, of limits, height, acceptance, collision, sight and way.
    payload : float, optional
        Kilograms; goes into the plan's table.
    wait_s : float
        Rest before a measurement, seconds.
    references : int
        References on the floor to measure in each pose, too: they take time.
    speed : float
        Of the tool, metres a second.
    noise : float
        Standard deviation of a measured coordinate, metres.
    imagined : float
        Size of joint errors that no model describes, against which the criterion ``position`` guards, radians.
    seed : int
        Of the random poses.
    language : str, optional
        Of the robot program, ``csv`` for none: that of the robot's maker unless given, as far as its name tells it.
    pulses : sequence of float, optional
        Pulses per degree of the six joints, for Yaskawa jobs.
    refit_zeros : sequence of int
        Joints, from 1, whose zeros were lost: as many poses of a calibrated robot as find them within 0.01 degrees, or
        ``optimal``, chosen for these zeros whatever the ``criterion``, and no others unless asked for.
    package_dirs : sequence of str or Path
        See `irbcal.read_urdf`.
    base_link, tip_link, coupling : str, optional
        See `irbcal.read_urdf`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    OptionError
        If an option has an unknown value or options need one another.
    IrbcalError
        If an input is refused or the request cannot be met; the sentence counts what each condition removed.

    Examples
    --------
    >>> plan("irb1600", optimal=60).save("plan")  # doctest: +SKIP
    """
    if (cube_centre is None) != (cube_edge is None):
        raise OptionError("cube_centre and cube_edge go together", parameter="cube_centre")
    if acceptance > 90 * DEG:
        raise OptionError(
            f"a reflector cannot be seen from behind: expected 90 degrees or less, found {acceptance / DEG:g}",
            parameter="acceptance",
        )
    if refit_zeros and level is not None:
        raise OptionError("level: a plan for lost zeros has no other parameters, leave it out", parameter="level")
    number("optimal", optimal, 0, whole=True)
    usual = {"axis": FEW, "cube": 52, "all_range": 50} if not (optimal or refit_zeros) else {}
    counts_given = {"axis": axis, "cube": cube, "all_range": all_range}
    counts = {name: usual.get(name, 0) if value is None else value for name, value in counts_given.items()}
    request = PlanRequest(
        **counts,
        optimal=optimal,
        candidates=candidates,
        criterion="D" if refit_zeros else criterion,
        volume=volume,
        level=None if level is None else str(level),
        noise=noise,
        imagined=imagined,
        wait_s=wait_s,
        references=references,
        speed=speed,
        payload_kg=payload,
        seed=seed,
        must=axis is not None,
        language=language,
        pulses=pulses_per_degree(pulses),
        zeros=tuple(refit_zeros),
    )
    scene = open_scene(
        robot,
        targets=targets,
        tracker=tracker,
        without=without,
        margin=margin,
        acceptance=acceptance,
        min_height=min_height,
        cube=None if cube_centre is None or cube_edge is None else (cube_centre, cube_edge),
        package_dirs=package_dirs,
        base_link=base_link,
        tip_link=tip_link,
        coupling=coupling,
    )
    return make(scene, request, progress)


def make(scene: Scene, request: PlanRequest, step: Step | None = None) -> Plan:
    """Make a plan.

    Parameters
    ----------
    scene : Scene
    request : PlanRequest
    step : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    IrbcalError
        If the request cannot be met; the sentence counts what each condition removed.
    """
    step = step or (lambda text: None)
    setting = scene.setting
    _, no_program = language_of(setting.arm, request)
    model = Model(scene.nominal, setting.targets, request.level or default_level(scene.nominal), request.noise)
    if request.zeros:
        model = model_of_zeros(scene, request.zeros)
        request = replace(request, noise=model.noise)
    seeds = [int(k) for k in np.random.SeedSequence(request.seed).generate_state(6)]
    axis: list[Poses] = []
    movable: list[Poses] = []
    tallies: dict[str, Tally] = {}
    missing: list[str] = []
    if request.axis:
        step("axis moves")
        try:
            axis.append(axis_moves(setting, request.axis == MANY))
            tallies["axis"] = axis[0].tally
        except MeasurementError as error:
            if request.must or request.axis == MANY:
                raise
            missing.append(f"the plan is without axis moves, which only the method circles needs: {error}")
    kinds: tuple[tuple[int, str, Region | None, int], ...] = (
        (request.cube, "iso_cube", in_cube(*scene.cube), seeds[0]),
        (request.all_range, "all_range", None, seeds[1]),
    )
    for count, group, region, seed in kinds:
        if count:
            step(f"{count} poses, {group}")
            movable.append(random_poses(setting, count, group, seed, region))
            tallies[group] = movable[-1].tally
    samples, comparison = choosing.samples(scene, seeds[4:], step), None
    fixed_poses = [*axis, *movable]

    def chosen(request: PlanRequest) -> tuple[Poses, DesignComparison, dict[str, Tally]]:
        return choosing.optimal(scene, request, model, fixed_poses, samples, seeds[2:4], step)

    if request.zeros and not (request.optimal or fixed_poses):
        request = enough_poses(request, lambda request: predict(model, *_measured(chosen(request)[0])))
    if request.optimal:
        poses_chosen, comparison, more = chosen(request)
        movable.append(poses_chosen)
        tallies |= more
    step("order")
    start = home_joints(setting.arm)
    poses, over_home, notes = choosing.in_order(scene, axis, movable, start)
    measured = _measured(poses)[1]
    step("prediction")
    prediction = predict(model, poses.q, measured)
    if request.zeros:
        notes += zeros_of_plan_in_words(request, prediction, len(poses.q))
    first = prediction.model.targets.names[0]
    std = {name: prediction.position_std(q_samples, first) for name, q_samples in samples.items()}
    times = stops(scene, request, poses.q, measured, start, over_home)
    outside = "" if scene.certainty is None else scene.certainty.outside_in_words(poses.q, "planned poses")
    notes = [*scene.notes, *missing, *notes, *(text for text in (outside, no_program) if text)]
    return Plan(
        scene,
        request,
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
