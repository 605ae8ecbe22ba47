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
from irbcal.planning import choosing, plan_files
from irbcal.planning.choosing import MOST_REFLECTORS, Step
from irbcal.planning.information import IMAGINED_SIZE, NOISE, Model
from irbcal.planning.made import PlannedPoses
from irbcal.planning.prediction import predict
from irbcal.planning.program import language_of
from irbcal.planning.reflectors import TargetsLike
from irbcal.planning.scene import Scene, open_scene
from irbcal.planning.sources import FEW, MANY, Poses, Region, Tally, axis_moves, first_seen, in_cube, random_poses
from irbcal.planning.timing import stops
from irbcal.planning.wish import Wish
from irbcal.simulation.tracker import ACCEPTANCE
from irbcal.simulation.virtual_cell import WAIT_S
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG

if TYPE_CHECKING:
    import pandas as pd

_SHOWN = {"axis": "axis moves", "iso_cube": "ISO cube", "all_range": "all range"}
_WHERE = {"cube": "in the cube", "range": "in the whole range"}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(PlannedPoses, Speaks):
    """Poses to measure, in their order, and what they promise; attributes as `irbcal.planning.made.PlannedPoses`."""

    def told(self) -> list[Told]:
        """See `Speaks.told`."""
        found = self.to_dict()
        predicted, compared = found["predicted"], found["compared_with_random"]
        told: list[Told] = [
            f"{found['robot']}: {found['poses']} poses, {found['points']} points, about "
            f"{found['duration_s'] / 60:.0f} minutes",
            self._counts(),
        ]
        if found["conditions_off"]:
            told.append(f"Conditions that are off: {', '.join(found['conditions_off'])}")
        single = sum(item["state"] == "identified" for item in predicted["parameters"])
        told.append(
            f"Model {predicted['model']}, scatter of {predicted['noise_mm']:g} mm a coordinate: {single} of "
            f"{len(predicted['parameters'])} parameters identified by themselves;"
        )
        told += [
            f"  positions of {predicted['position_target']} {_WHERE[name]} predicted to {std['rms']:.3f} mm "
            f"(at worst {std['max']:.3f} mm)"
            for name, std in predicted["position_std_mm"].items()
        ]
        told.append(
            "  These are standard deviations from scatter alone; what the model does not describe is not in them."
        )
        if compared:
            told += _beside_random(compared)
        return told + [f"Note: {note}" for note in self.notes]

    def _counts(self) -> Table:
        tallies = self.tallies.values()
        rows: list[tuple[str | int | None, ...]] = [("looked at", *(tally.tried for tally in tallies))]
        for name in ("place", *self.scene.setting.conditions):
            words = "outside the cube" if name == "place" else f"removed by {name}"
            rows.append((words, *(tally.removed.get(name) for tally in tallies)))
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
        return plan_files.pose_table(self)

    def to_dict(self) -> dict[str, Any]:
        """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
        return plan_files.facts(self)

    def save(self, folder: str | Path, page: str | None = None) -> tuple[Path, ...]:
        """Write the files that carry the plan out; see `irbcal.planning.plan_files.files`.

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
        contents = plan_files.files(self, page)
        atomic.write_together(folder, contents)
        return tuple(Path(folder) / name for name in contents)


def _beside_random(compared: dict[str, Any]) -> list[str]:
    """What the choice promises beside as many random poses: with errors that no model describes, and without."""
    scatter = compared["scatter_alone"]
    both = {"errors imagined in the joints and scatter": compared, "scatter alone": scatter}
    if compared["criterion"] != "position":
        both = {"the information that scatter leaves (log det, less is better)": compared}
    elif scatter is None:
        both = {"scatter alone": compared}
    out = []
    for what, found in both.items():
        chosen, random = found["optimal"], {item["poses"]: item for item in found["random"]}[found["optimal"]["poses"]]
        if "error_mm" in chosen:
            figures = (
                f"{chosen['error_mm']:.3f} mm with the {chosen['poses']} chosen poses, {random['error_mm']:.3f} mm with"
            )
        else:
            figures = f"{chosen['value']:.1f} with the {chosen['poses']} chosen poses, {random['value']:.1f} with"
        same, most = found["as_good_as_random_poses"], found["random"][-1]["poses"]
        of = "Predicted error of positions (rms)" if "error_mm" in chosen else "By"
        out.append(
            f"{of}{' from' if 'error_mm' in chosen else ''} {what}: {figures} as many random ones of the same "
            f"candidates (by this, {'about' if same else 'more than'} {same or most} would do as well)."
        )
    return out


def _words(source: str) -> str:
    for name, words in _SHOWN.items():
        source = source.replace(name, words)
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
        URDF, shipped robot, or calibration folder.
    axis, cube, all_range : int, optional
        Moves of one joint (18, 158 or 0), random poses in the ISO cube and in the whole range; 18, 52 and 50 unless
        given, with ``optimal`` none.
    optimal, candidates : int
        Poses chosen out of so many candidates.
    criterion, volume : str
        What is best, ``position`` or ``D``; where predicted positions count, ``both``, ``cube`` or ``range``.
    level : str, optional
        Error model to plan for; that of a calibration without a wish unless given.
    targets, tracker, margin, acceptance, min_height, without, package_dirs, base_link, tip_link, coupling
        See `irbcal.planning.scene.open_scene`.
    cube_centre, cube_edge : array_like of shape (3,) and float, optional
        ISO cube in the base link; both or none.
    payload : float, optional
        Kilograms; goes into the plan's table.
    wait_s : float
        Rest before a measurement, seconds.
    references : int
        References on the floor that are measured in each pose, too: they take time.
    speed : float
        Of the tool, m/s.
    noise, imagined, seed
        See `irbcal.planning.wish.Wish`.
    language : str, optional
        Of the robot program: ``rapid``, ``krl``, ``fanuc``, ``urscript``, ``val3``, ``inform``, ``kawasaki``, or
        ``csv`` for none; that of the robot's maker unless given, as far as the robot's name tells it.
    pulses : sequence of float, optional
        Pulses per degree of the six joints, for Yaskawa jobs.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Returns
    -------
    Plan

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
    number("optimal", optimal, 0, whole=True)
    usual = {"axis": FEW, "cube": 52, "all_range": 50} if not optimal else {}
    given = {"axis": axis, "cube": cube, "all_range": all_range}
    counts = {name: usual.get(name, 0) if value is None else value for name, value in given.items()}
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

    Returns
    -------
    Plan

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
    others: list[Poses] = []
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
            others.append(random_poses(setting, count, group, seed, region))
            tallies[group] = others[-1].tally
    there, comparison = choosing.samples(scene, seeds[4:], step), None
    if wish.optimal:
        chosen, comparison, more = choosing.optimal(scene, wish, model, [*axis, *others], there, seeds[2:4], step)
        others.append(chosen)
        tallies |= more
    step("order")
    start = home_joints(setting.arm)
    poses, over_home, notes = choosing.in_order(scene, axis, others, start)
    asked = first_seen(poses.seen, MOST_REFLECTORS)
    step("prediction")
    prediction = predict(model, poses.q, asked)
    first = prediction.model.targets.names[0]
    std = {name: prediction.position_std(places, first) for name, places in there.items()}
    times = stops(scene, wish, poses.q, asked, start, over_home)
    outside = "" if scene.certainty is None else scene.certainty.outside_in_words(poses.q, "planned poses")
    notes = [*scene.notes, *missing, *notes, *(text for text in (outside, no_program) if text)]
    return Plan(
        scene, wish, poses.q, asked, poses.groups, over_home, tallies, prediction, std, times, comparison, tuple(notes)
    )
