"""What a view shows, in numbers: robots, poses, measured and modelled points, tracker, references, cube.

Everything is given in the base link of the (calibrated) robot, which is the frame of the drawing: "scene". The
measuring frame stands where the calibration found it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import RobotError
from irbcal.io.schema import Record
from irbcal.measurement import repeats
from irbcal.measurement.column_names import POSITION, joint_columns
from irbcal.measurement.input_table import InputTable, column_names
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementSet, MeasurementsLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import family_in_words
from irbcal.modeling.terms.term_map import TermMap
from irbcal.validation.accuracy import predictions
from irbcal.validation.accuracy import turns as turns_of
from irbcal.validation.cleaned_points import without_fitted
from irbcal.validation.frame_of_calibration import in_frame_of_calibration
from irbcal.validation.refit import NO_REFIT, Refit
from irbcal.viewer.shapes import Link, Mesh, reach
from irbcal.wording import and_more, counted

if TYPE_CHECKING:
    import pandas as pd


Mode: TypeAlias = Literal["measured", "plan", "program", "sliders"]
WhichModel: TypeAlias = Literal["calibrated", "nominal"]


@dataclass(frozen=True, eq=False)
class ShownFeature(Locked):
    """A feature as it is drawn."""

    name: str
    kind: str
    label: str
    T_scene: FloatArray
    """Shape (4, 4). Its place; z is a plane's normal, the direction of a line, or goes from one end of a length to the
    other.
    """
    size: float
    """Radius of a sphere, half the edge of a plane's patch, half the length of a line, metres."""


@dataclass(frozen=True, eq=False, repr=False)
class Drawn(Locked):
    """One robot as it is drawn."""

    links: tuple[Link, ...]
    T_scene_root: FloatArray
    """Shape (4, 4)."""
    tip: int
    """Place of the tip link in the list."""


@dataclass(frozen=True, eq=False, repr=False)
class Points(Locked):
    """Measured points and what the models say of them, in the scene, metres."""

    pose: IntArray
    target: IntArray
    """Shape (m,). Row of the scene's poses; index into the scene's targets."""
    calibrated: FloatArray
    """Shape (m, 3)."""
    measured: FloatArray | None = None
    """Shape (m, 3). None for a plan."""
    nominal: FloatArray | None = None
    """Shape (m, 3). None where there is no other model than the robot itself."""
    turn_calibrated: FloatArray | None = None
    turn_nominal: FloatArray | None = None
    """Shape (m,). Angles between measured and modelled target frames, radians; NaN where not measured."""
    u95: FloatArray | None = None
    """Shape (m,). Half-width that holds 95 % of a coordinate's errors of the calibrated robot, the largest of three,
    metres; None where nothing is known of it.
    """
    attitudes: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (m, 6). For each model, rotation vectors in the scene, radians: of the modelled target frame, and
    from it to the measured one. NaN for points without orientation; empty where none has one.
    """
    without: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (m, 3). How far calibrated points move without a family of terms, see `irbcal.viewer.scene`."""

    def error(self, model: WhichModel = "calibrated") -> FloatArray | None:
        """Measured minus modelled points, shape (m, 3), metres; None where one of them is not there."""
        modelled = self.calibrated if model == "calibrated" else self.nominal
        return None if self.measured is None or modelled is None else self.measured - modelled

    def distance(self, model: WhichModel = "calibrated") -> FloatArray | None:
        """Length of the errors, shape (m,), metres; None where there are none."""
        error = self.error(model)
        return None if error is None else np.linalg.norm(error, axis=1)


class CellFrame(NamedTuple):
    """A tool or a work object of a cell file: its label, and its pose (4, 4) in tip link or scene, metres."""

    label: str
    T: FloatArray
    on_tip: bool


@dataclass(frozen=True, eq=False, repr=False)
class PageScene(Locked):
    """Everything that a page shows."""

    title: str
    simulated: bool
    mode: Mode
    """``measured``, ``plan``, ``program`` (targets before and after a correction) or ``sliders``."""
    robot: Robot
    """Predicts; its base link is the scene."""
    drawn: Drawn
    ghost: Drawn | None
    """Calibrated (or only) robot; nominal robot or None."""
    meshes: Mapping[int, Mesh]
    """Looks of the links, the same for both."""
    q: FloatArray
    effective: FloatArray
    """Shape (n, joints). Commanded and effective joints of the poses, radians or metres; no rows for ``sliders``."""
    pose_ids: NameArray
    groups: NameArray
    """Shape (n,)."""
    targets: Mapping[str, FloatArray]
    """Values of shape (3,). In the tip link, metres."""
    points: Points | None
    prismatic: BoolArray
    """Shape (joints,)."""
    T_scene_world: FloatArray
    """Shape (4, 4). The measuring frame."""
    tracker: bool
    """Whether the tracker stands in the origin of the measuring frame."""
    references: Mapping[str, FloatArray]
    """Values of shape (3,). In the scene, metres."""
    cube: tuple[FloatArray, float] | None
    """Centre (3,) and edge in the scene, metres."""
    path: FloatArray | None
    """Shape (k, 3). Way of the first target through a plan."""
    magnification: float
    scale_top: float
    """Error at the upper end of the colours, metres."""
    notes: tuple[str, ...] = ()
    own_scales: Mapping[WhichModel, tuple[float, float]] = field(default_factory=dict)
    """Magnification and end of the colours for the errors of each model alone."""
    fitted: BoolArray | None = None
    """Shape (n,). Which poses the calibration was fitted to: their errors prove nothing. None where that is not known.
    """
    features: tuple[ShownFeature, ...] = ()
    """Of a calibration from rows at features."""
    at_features: bool = False
    """Whether the points are rows at features, and their errors distances from these."""
    cell: tuple[CellFrame, ...] = ()
    """Tools and work objects."""
    over_home: tuple[FloatArray, IntArray] | None = None
    """Joints, shape (joints,), and whole numbers. Home joints of a plan, radians or metres, and the poses to which it
    goes over them.
    """

    @property
    def reach(self) -> float:
        """Scale of the robot, metres."""
        return reach(self.drawn.links)


SMALLEST = 1e-9
"""Metres: a family that moves no point by more is not named."""


def shifts(model: Robot, points: PointSet, T_scene_world: FloatArray) -> dict[str, FloatArray]:
    """How far each point moves when the terms of one family are zero.

    Parameters
    ----------
    model : Robot
        Calibrated.
    points : PointSet
    T_scene_world : ndarray, shape (4, 4)

    Returns
    -------
    dict of str to ndarray, shape (m, 3)
        Family's name in words; metres in the scene.
    """
    predicted = points.predicted(model)
    turn = frames.transform(T_scene_world[:3, :3])
    out = {}
    for family in families(model):
        shift = frames.apply(turn, points.predicted(without(model, family)) - predicted)
        if np.abs(shift).max(initial=0.0) > SMALLEST:
            out[family_in_words(family)] = shift
    return out


def families(model: Robot) -> list[str]:
    """Families with terms in a robot's joint map or among its frame terms, in their order."""
    names = [term.family for term in model.joint_map.terms.terms]
    if model.frame_terms is not None:
        names += [term.family for term in model.frame_terms.terms]
    return list(dict.fromkeys(names))


def without(model: Robot, family: str) -> Robot:
    """A robot whose terms of a family are zero."""
    joint_map = replace(model.joint_map, terms=_silenced(model.joint_map.terms, family))
    frame_terms = None if model.frame_terms is None else _silenced(model.frame_terms, family)
    return model.replace(joint_map=joint_map, frame_terms=frame_terms)


def _silenced(terms: TermMap, family: str) -> TermMap:
    keep = np.array([term.family != family for term in terms.terms], dtype=float)
    return replace(terms, coefficients=terms.coefficients * keep)


MOST_KNOWN = 30_000
"""Points whose intervals are shown: more would keep the page waiting."""

PlanLike: TypeAlias = "str | Path | pd.DataFrame | ArrayLike"
"""Joints to walk through: a table in degrees (and mm), or an array in radians (and metres)."""


@dataclass(frozen=True, eq=False, repr=False)
class Registered(Locked):
    """Measurements in a calibration's frame."""

    measurements: MeasurementSet
    points: PointSet
    calibrated: Robot
    nominal: Robot
    fitted: BoolArray | None
    """Shape (n,). Which poses the calibration was fitted to; None where it did not keep them."""
    notes: list[str]


def registered(calibration: Record, measurements: MeasurementsLike, refit: Refit = NO_REFIT) -> Registered:
    """Measurements in the calibration's frame, cleaned as `irbcal.evaluate` does.

    Parameters
    ----------
    calibration : Record
    measurements : str, Path, DataFrame or MeasurementSet
    refit : Refit
        What is fitted again, see `irbcal.evaluate`.
    """
    cleaned, robots = in_frame_of_calibration(calibration, measurements, refit)
    measured, notes = cleaned.measurements, list(cleaned.notes)
    if cleaned.excluded:
        points = counted(len(cleaned.excluded), "point is", "points are")
        notes.insert(0, f"{points} left out (lost, or wrong); irbcal evaluate lists them.")
    notes += without_fitted(cleaned, calibration, include=True).notes[len(cleaned.notes) :]
    used = calibration.used_points(heldout=False)
    fit = None if used is None else repeats.near_fitted(cleaned.points, used[0], calibration.arm().table.prismatic)
    return Registered(measured, cleaned.points, robots["calibrated"], robots["nominal"], fit, notes)


def measured_points(model: Robot, nominal: Robot, points: PointSet, T_scene_world: FloatArray) -> Points:
    """Measured points in the scene, and what both models say of them."""
    modelled = [frames.apply(T_scene_world, points.predicted(robot)) for robot in (model, nominal)]
    turns = [turns_of(robot, points) for robot in (model, nominal)]
    predicted = predictions(model, points) if len(points) <= MOST_KNOWN else None
    return Points(
        points.pose,
        _target_index(model, points),
        modelled[0],
        frames.apply(T_scene_world, points.xyz),
        modelled[1],
        turn_calibrated=turns[0],
        turn_nominal=turns[1],
        u95=None if predicted is None else predicted[1].max(axis=1),
        attitudes=_attitudes({"calibrated": model, "nominal": nominal}, points, T_scene_world),
        without=shifts(model, points, T_scene_world) if len(points) <= MOST_KNOWN else {},
    )


def _attitudes(
    robots: Mapping[WhichModel, Robot], points: PointSet, T_scene_world: FloatArray
) -> dict[str, FloatArray]:
    """Modelled target frames and how the measured ones are turned from them, see `Points`; empty without any."""
    if points.rotation is None or not points.oriented().any():
        return {}
    out: dict[str, FloatArray] = {}
    for name, robot in robots.items():
        modelled = T_scene_world[:3, :3] @ points.predicted_rotations(robot)
        turned = T_scene_world[:3, :3] @ points.rotation @ np.swapaxes(modelled, 1, 2)
        rows = np.isfinite(turned).all(axis=(1, 2)) & np.isfinite(modelled).all(axis=(1, 2))
        out[name] = np.full((len(points), 6), np.nan)
        out[name][rows, :3] = frames.vector_from_rotation(modelled[rows])
        out[name][rows, 3:] = frames.vector_from_rotation(turned[rows])
    return out


def _target_index(model: Robot, points: PointSet) -> IntArray:
    names = list(model.targets)
    return np.array([names.index(name) for name in points.target_names])[points.target]


def is_plan(table: object) -> bool:
    """Whether a file or a DataFrame has joint columns and no measured points: a plan, or a list of joints."""
    names = column_names(table)
    planned = "target" not in names or "expected_x_mm" in names  # a row for each target is to be measured
    return bool(joint_columns(names)) and planned and not set(POSITION) & set(names)


def plan_joints(plan: PlanLike, arm: Arm) -> FloatArray:
    """Joints of a plan, (n, joints), radians or metres: from a table, or as given."""
    import pandas as pd

    if isinstance(plan, (str, Path, pd.DataFrame)):
        table = InputTable.read(plan, arm.joint_columns, stdin=True)
        return arm.from_controller(table.one_row_a_pose(arm.joint_columns)[0].joints(arm.joint_columns))
    q = np.asarray(plan, dtype=float)
    if q.ndim != 2 or not len(q) or not np.isfinite(q).all():
        raise RobotError(
            f"a plan for {arm.name} needs finite joints of shape (n, {len(arm.joint_names)}), n at least 1",
            parameter="plan",
        )
    return arm.check_joints(q)


def outside_limits(arm: Arm, q: FloatArray, ids: Sequence[str] | NameArray) -> list[str]:
    """A note on poses of a plan beyond the joint limits."""
    wrong = ((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=1)
    if not wrong.any():
        return []
    first = f"{ids[int(np.argmax(wrong))]}{and_more(int(wrong.sum()) - 1)}"
    return [f"The plan leaves the joint limits of {arm.name}: pose {first}."]


def planned_points(model: Robot, ghost: Robot | None, q: FloatArray, T_scene_world: FloatArray) -> Points:
    """Where the models put the targets in the poses of a plan."""
    count = len(model.targets)
    rows, names = np.repeat(np.arange(len(q)), count), list(model.targets) * len(q)
    nominal = None
    if ghost is not None:
        nominal = frames.apply(T_scene_world, ghost.replace(targets=model.targets).points(q[rows], names))
    u95 = None
    certainty = model.certainty
    if (
        certainty is not None
        and len(rows) <= MOST_KNOWN
        and all(certainty.left_out(n) is not None for n in model.targets)
    ):
        half_widths = [model.predict(q, None, name).interval.max(axis=1) for name in model.targets]
        u95 = np.column_stack(half_widths).ravel()
    return Points(
        rows,
        np.tile(np.arange(count), len(q)),
        frames.apply(T_scene_world, model.points(q[rows], names)),
        nominal=nominal,
        u95=u95,
    )


def path_of(model: Robot, q: FloatArray, T_scene_world: FloatArray, limit: int = 20_000) -> FloatArray | None:
    """Way of the first target when the robot goes from pose to pose linearly in its joints."""
    if len(q) < 2:
        return None
    steps = int(np.clip(limit // len(q), 2, 24))
    fraction = np.arange(steps) / steps
    between = q[:-1, None] + fraction[:, None] * (q[1:] - q[:-1])[:, None]
    q_path = np.concatenate([between.reshape(-1, q.shape[1]), q[-1:]])
    return frames.apply(T_scene_world, model.points(q_path, next(iter(model.targets))))
