"""What a view shows, in numbers: robots, poses, measured and modelled points, tracker, references, cube.

Everything is given in the base link of the (calibrated) robot, which is the frame of the drawing: "scene". The
measuring frame stands where the calibration found it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.modeling.robot import Robot
from irbcal.viewer.links import Link, reach
from irbcal.viewer.shapes import Mesh

if TYPE_CHECKING:
    from irbcal.viewer.features import ShownFeature

Mode: TypeAlias = Literal["measured", "plan", "program", "sliders"]
Model: TypeAlias = Literal["calibrated", "nominal"]


@dataclass(frozen=True, eq=False, repr=False)
class Drawn(Locked):
    """One robot as it is drawn.

    Attributes
    ----------
    links : tuple of Link
    T_scene_root : ndarray, shape (4, 4)
    tip : int
        Place of the tip link in the list.
    """

    links: tuple[Link, ...]
    T_scene_root: FloatArray
    tip: int


@dataclass(frozen=True, eq=False, repr=False)
class Points(Locked):
    """Measured points and what the models say of them, in the scene, metres.

    Attributes
    ----------
    pose, target : ndarray of int, shape (m,)
        Row of the scene's poses; index into the scene's targets.
    measured, calibrated, nominal : ndarray, shape (m, 3)
        ``measured`` is None for a plan, ``nominal`` where there is no other model than the robot itself.
    turn_calibrated, turn_nominal : ndarray, shape (m,), or None
        Angles between measured and modelled target frames, radians; NaN where not measured.
    u95 : ndarray, shape (m,), or None
        Half-width that holds 95 % of a coordinate's errors of the calibrated robot, the largest of the three, metres;
        None where nothing is known of it.
    attitudes : dict of str to ndarray, shape (m, 6)
        For each model, rotation vectors in the scene, radians: of the modelled target frame, and from it to the
        measured one. NaN for points without orientation; empty where none has one.
    without : dict of str to ndarray, shape (m, 3)
        How far the calibrated points move without a family of terms, see `irbcal.viewer.points`.
    """

    pose: IntArray
    target: IntArray
    calibrated: FloatArray
    measured: FloatArray | None = None
    nominal: FloatArray | None = None
    turn_calibrated: FloatArray | None = None
    turn_nominal: FloatArray | None = None
    u95: FloatArray | None = None
    attitudes: Mapping[str, FloatArray] = field(default_factory=dict)
    without: Mapping[str, FloatArray] = field(default_factory=dict)

    def error(self, model: Model = "calibrated") -> FloatArray | None:
        """Measured minus modelled points, shape (m, 3), metres; None where one of them is not there."""
        modelled = self.calibrated if model == "calibrated" else self.nominal
        return None if self.measured is None or modelled is None else self.measured - modelled

    def distance(self, model: Model = "calibrated") -> FloatArray | None:
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
    """Everything that a page shows.

    Attributes
    ----------
    title : str
    simulated : bool
    mode : str
        ``measured``, ``plan``, ``program`` (targets before and after a correction) or ``sliders``.
    robot : Robot
        Predicts; its base link is the scene.
    drawn, ghost : Drawn
        Calibrated (or only) robot; nominal robot or None.
    meshes : dict of int to Mesh
        Looks of the links, the same for both.
    q, effective : ndarray, shape (n, joints)
        Commanded and effective joints of the poses, radians or metres; no rows for ``sliders``.
    pose_ids, groups : ndarray of str, shape (n,)
    targets : dict of str to ndarray, shape (3,)
        In the tip link, metres.
    points : Points or None
    prismatic : ndarray of bool, shape (joints,)
    T_scene_world : ndarray, shape (4, 4)
        The measuring frame.
    tracker : bool
        Whether the tracker stands in the origin of the measuring frame.
    references : dict of str to ndarray, shape (3,)
        In the scene, metres.
    cube : tuple or None
        Centre (3,) and edge in the scene, metres.
    path : ndarray, shape (k, 3), or None
        Way of the first target through a plan.
    magnification : float
    scale_top : float
        Error at the upper end of the colours, metres.
    own_scales : dict of str to tuple
        Magnification and end of the colours for the errors of each model alone.
    fitted : ndarray of bool, shape (n,), or None
        Which poses the calibration was fitted to: their errors prove nothing. None where that is not known.
    features : tuple of ShownFeature
        Of a calibration from rows at features.
    at_features : bool
        Whether the points are rows at features, and their errors distances from these.
    notes : tuple of str
    cell : tuple of CellFrame
        Tools and work objects.
    """

    title: str
    simulated: bool
    mode: Mode
    robot: Robot
    drawn: Drawn
    ghost: Drawn | None
    meshes: Mapping[int, Mesh]
    q: FloatArray
    effective: FloatArray
    pose_ids: NameArray
    groups: NameArray
    targets: Mapping[str, FloatArray]
    points: Points | None
    prismatic: BoolArray
    T_scene_world: FloatArray
    tracker: bool
    references: Mapping[str, FloatArray]
    cube: tuple[FloatArray, float] | None
    path: FloatArray | None
    magnification: float
    scale_top: float
    notes: tuple[str, ...] = ()
    own_scales: Mapping[Model, tuple[float, float]] = field(default_factory=dict)
    fitted: BoolArray | None = None
    features: tuple[ShownFeature, ...] = ()
    at_features: bool = False
    cell: tuple[CellFrame, ...] = ()

    @property
    def reach(self) -> float:
        """Scale of the robot, metres."""
        return reach(self.drawn.links)
