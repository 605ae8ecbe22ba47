"""Measuring plans: from a robot and wishes to poses in their order; what ``irbcal plan`` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal import atomic
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import RobotLike
from irbcal.modeling.home import home_joints
from irbcal.modeling.parameters import default_level
from irbcal.options import number, pulses_per_degree
from irbcal.planning import choosing
from irbcal.planning.choosing import MOST_REFLECTORS, Step
from irbcal.planning.information import IMAGINED_SIZE, NOISE, Model
from irbcal.planning.planned_poses import PlannedPoses, predict, stops
from irbcal.planning.program import language_of
from irbcal.planning.reflectors import TargetsLike
from irbcal.planning.scene import Scene, open_scene
from irbcal.planning.sources import FEW, MANY, Poses, Region, Tally, axis_moves, first_seen, in_cube, random_poses
from irbcal.planning.wish import Wish
from irbcal.simulation.tracker import ACCEPTANCE
from irbcal.simulation.virtual_cell import WAIT_S
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG

if TYPE_CHECKING:
    import pandas as pd
import json
from collections import Counter
from typing import TYPE_CHECKING

from irbcal.arrays import FloatArray
from irbcal.measurement.columns import joint_columns
from irbcal.modeling.home import DECIMALS
from irbcal.names import csv_bytes
from irbcal.planning import program
from irbcal.planning.conditions import CONDITIONS
from irbcal.planning.exchange import DesignComparison
from irbcal.planning.wish import READINGS_S
from irbcal.thesis_setup import FRONT
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd


def files(planned: PlannedPoses, page: str | None = None) -> dict[str, bytes]:
    """The files of a plan.

    Parameters
    ----------
    planned : PlannedPoses
    page : str, optional
        The scene to look at, HTML.

    Returns
    -------
    dict of str to bytes
        ``plan.csv`` (what the tracker is asked for), ``poses.csv`` (what the robot does), ``plan.json``; the program
        of `irbcal.planning.program`; ``plan.html`` with a page.
    """
    out = {
        "plan.csv": _csv(plan_table(planned)),
        "poses.csv": _csv(pose_table(planned)),
        "plan.json": (json.dumps(facts(planned), indent=1, allow_nan=False) + "\n").encode(),
    }
    out |= program.files(planned)
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


def _joints(planned: PlannedPoses) -> FloatArray:
    """Joints as they are commanded and as the controller counts them, degrees and millimetres, shape (n, joints)."""
    arm = planned.scene.setting.arm
    return np.round(arm.to_controller(planned.q) / arm.joint_units, DECIMALS) + 0.0


def plan_table(planned: PlannedPoses) -> pd.DataFrame:
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
    if planned.wish.payload_kg is not None:
        table["payload_kg"] = planned.wish.payload_kg
    return table


def pose_table(planned: PlannedPoses) -> pd.DataFrame:
    """A row for each pose: joints, reflectors with spaces between them, wait."""
    import pandas as pd

    table = pd.DataFrame(_joints(planned), columns=planned.scene.setting.arm.joint_columns)
    table.insert(0, "pose", np.arange(1, len(table) + 1))
    table.insert(1, "group", planned.groups)
    table["targets"] = _target_texts(planned)
    table["wait_s"] = planned.wish.wait_s
    return table


def _target_texts(planned: PlannedPoses) -> list[str]:
    names = np.array(planned.scene.setting.targets.names, dtype=object)
    return [" ".join(names[row]) for row in planned.asked]


def facts(planned: PlannedPoses) -> dict[str, Any]:
    """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
    scene, wish, setting = planned.scene, planned.wish, planned.scene.setting
    return {
        "robot": setting.arm.name,
        "source": scene.name,
        "language": program.language_of(setting.arm, wish)[0] or None,
        "poses": len(planned.q),
        "points": int(planned.asked.sum()),
        "duration_s": planned.duration_s,
        "groups": dict(Counter(planned.groups.tolist())),
        "conditions": list(setting.conditions),
        "conditions_off": [name for name in CONDITIONS if name not in setting.conditions],
        "counts": {
            name: {"tried": tally.tried, "kept": tally.kept, "removed": dict(tally.removed)}
            for name, tally in planned.tallies.items()
        },
        "predicted": {
            "noise_mm": wish.noise / MM,
            "note": "from the scatter of the points alone: what the model does not describe is not in it",
            "model": planned.prediction.model.level,
            "position_target": planned.prediction.model.targets.names[0],
            "position_std_mm": {
                name: {"rms": float(np.sqrt(np.mean(std**2)) / MM), "max": float(std.max() / MM)}
                for name, std in planned.position_std.items()
            },
            "parameters": [
                {"name": parameter.name, "unit": parameter.unit, "std": parameter.std, "state": parameter.state}
                for parameter in planned.prediction.parameters
            ],
        },
        "compared_with_random": None if planned.comparison is None else _compared(planned.comparison, wish),
        "settings": _settings(planned),
        "notes": list(planned.notes),
    }


def _compared(comparison: DesignComparison, wish: Wish) -> dict[str, Any]:
    """Chosen poses beside random ones; of the criterion ``position`` also as predicted errors, rms in mm."""

    def values(value: float) -> dict[str, float]:
        return {"value": value} | ({"error_mm": float(np.sqrt(value) / MM)} if wish.criterion == "position" else {})

    return {
        "criterion": wish.criterion,
        "optimal": {"poses": wish.optimal, **values(comparison.optimal)},
        "random": [{"poses": n, **values(value)} for n, value in comparison.random.items()],
        "as_good_as_random_poses": comparison.as_good_as,
        "scatter_alone": None if comparison.scatter is None else _compared(comparison.scatter, wish),
    }


def _settings(planned: PlannedPoses) -> dict[str, Any]:
    scene, wish, setting = planned.scene, planned.wish, planned.scene.setting
    return {
        "seed": wish.seed,
        "axis": wish.axis,
        "cube": wish.cube,
        "all_range": wish.all_range,
        "optimal": wish.optimal,
        "candidates": wish.candidates if wish.optimal else 0,
        "criterion": wish.criterion,
        "volume": wish.volume,
        "imagined_joint_errors_deg": wish.imagined / DEG if wish.criterion == "position" else 0.0,
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
        "wait_s": wish.wait_s,
        "readings_s": READINGS_S,
        "speed_mm_s": wish.speed / MM,
        "payload_kg": wish.payload_kg,
    }


_SHOWN = {"axis": "axis moves", "iso_cube": "ISO cube", "all_range": "all range"}
_WHERE = {"cube": "in the cube", "range": "in the whole range"}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(PlannedPoses, Result):
    """Poses to measure, in their order, and what they promise; attributes as `PlannedPoses`."""

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
            lines += _beside_random(compared)
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
        return pose_table(self)

    def to_dict(self) -> dict[str, Any]:
        """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
        return facts(self)

    def save(self, folder: str | Path, page: str | None = None) -> tuple[Path, ...]:
        """Write the files that carry the plan out; see `irbcal.planning.measuring_plan.files`.

        Parameters
        ----------
        folder : str or Path
        page : str, optional
            The plan to look at, HTML; see `irbcal.viewer.plan_page.page`.

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
        atomic.write_together(folder, contents)
        return tuple(Path(folder) / name for name in contents)


def _beside_random(compared: dict[str, Any]) -> list[str]:
    """What the choice promises beside as many random poses: with errors that no model describes, and without."""
    scatter = compared["scatter_alone"]
    comparisons = {"errors imagined in the joints and scatter": compared, "scatter alone": scatter}
    if compared["criterion"] != "position":
        comparisons = {"the information that scatter leaves (log det, less is better)": compared}
    elif scatter is None:
        comparisons = {"scatter alone": compared}
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
    language : {"rapid", "krl", "fanuc", "urscript", "val3", "inform", "kawasaki", "csv"}, optional
        Of the robot program, ``csv`` for none: that of the robot's maker unless given, as far as its name tells it.
    pulses : sequence of float, optional
        Pulses per degree of the six joints, for Yaskawa jobs.
    package_dirs : sequence of str or Path
        Folders in which package:// names of meshes are looked up.
    base_link, tip_link, coupling : str, optional
        See `irbcal.planning.scene.open_scene`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    OptionError
        If an option has an unknown value or options need one another.
    IrbcalError
        If an input is refused or the wish cannot be met; the sentence counts what each condition removed.

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
    number("optimal", optimal, 0, whole=True)
    usual = {"axis": FEW, "cube": 52, "all_range": 50} if not optimal else {}
    counts_given = {"axis": axis, "cube": cube, "all_range": all_range}
    counts = {name: usual.get(name, 0) if value is None else value for name, value in counts_given.items()}
    wish = Wish(
        **counts,
        optimal=optimal,
        candidates=candidates,
        criterion=criterion,
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
    return make(scene, wish, progress)


def make(scene: Scene, wish: Wish, step: Step | None = None) -> Plan:
    """Make a plan.

    Parameters
    ----------
    scene : Scene
    wish : Wish
    step : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    IrbcalError
        If the wish cannot be met; the sentence counts what each condition removed.
    """
    step = step or (lambda text: None)
    setting = scene.setting
    _, no_program = language_of(setting.arm, wish)
    model = Model(scene.nominal, setting.targets, wish.level or default_level(scene.nominal), wish.noise)
    seeds = [int(k) for k in np.random.SeedSequence(wish.seed).generate_state(6)]
    axis: list[Poses] = []
    movable: list[Poses] = []
    tallies: dict[str, Tally] = {}
    missing: list[str] = []
    if wish.axis:
        step("axis moves")
        try:
            axis.append(axis_moves(setting, wish.axis == MANY))
            tallies["axis"] = axis[0].tally
        except MeasurementError as error:
            if wish.must or wish.axis == MANY:
                raise
            missing.append(f"the plan is without axis moves, which only the method circles needs: {error}")
    kinds: tuple[tuple[int, str, Region | None, int], ...] = (
        (wish.cube, "iso_cube", in_cube(*scene.cube), seeds[0]),
        (wish.all_range, "all_range", None, seeds[1]),
    )
    for count, group, region, seed in kinds:
        if count:
            step(f"{count} poses, {group}")
            movable.append(random_poses(setting, count, group, seed, region))
            tallies[group] = movable[-1].tally
    samples, comparison = choosing.samples(scene, seeds[4:], step), None
    if wish.optimal:
        chosen, comparison, more = choosing.optimal(scene, wish, model, [*axis, *movable], samples, seeds[2:4], step)
        movable.append(chosen)
        tallies |= more
    step("order")
    start = home_joints(setting.arm)
    poses, over_home, notes = choosing.in_order(scene, axis, movable, start)
    measured = first_seen(poses.seen, MOST_REFLECTORS)
    step("prediction")
    prediction = predict(model, poses.q, measured)
    first = prediction.model.targets.names[0]
    std = {name: prediction.position_std(q_samples, first) for name, q_samples in samples.items()}
    times = stops(scene, wish, poses.q, measured, start, over_home)
    outside = "" if scene.certainty is None else scene.certainty.outside_in_words(poses.q, "planned poses")
    notes = [*scene.notes, *missing, *notes, *(text for text in (outside, no_program) if text)]
    return Plan(
        scene,
        wish,
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
