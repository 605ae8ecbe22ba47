"""A view from what it is asked for: `irbcal.view`, and the page of a plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, CellFile, cell_of
from irbcal.errors import CalibrationError, MeasurementError, OptionError, RobotError
from irbcal.io import robots
from irbcal.io.meshes import GREY, read_mesh
from irbcal.io.opening import Opened, RobotLike, open_robot
from irbcal.io.urdf import UrdfArm
from irbcal.io.urdf_xml import MeshFolders, MeshProblem, MissingMesh, XmlElement
from irbcal.measurement.input_table import column_names
from irbcal.measurement.table import MeasurementsLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import home_joints
from irbcal.modeling.robot import Robot
from irbcal.simulation.instruments import IRB1600_CUBE, has_thesis_cube
from irbcal.units import MM
from irbcal.validation.refit import Refit
from irbcal.viewer import features as feature_views
from irbcal.viewer import scene as point_sets
from irbcal.viewer import shapes
from irbcal.viewer.scene import CellFrame, Drawn, Mode, PageScene, PlanLike, Points, WhichModel
from irbcal.viewer.shapes import Link, links, origin, reach, vector
from irbcal.viewer.view import View
from irbcal.wording import and_more

if TYPE_CHECKING:
    from irbcal.planning.measuring_plan import Plan

MAX_MESH_BYTES = 100_000_000
MAX_TRIANGLES = 2_000_000
"""Triangles of a whole robot beyond which further visuals are left out."""


class MeshFinder(MeshFolders):
    """Finds and reads mesh files that a URDF names, inside the folders that it may read."""

    def read(self, uri: str, budget: int = MAX_TRIANGLES) -> tuple[FloatArray, FloatArray | None]:
        """Triangles of a mesh file.

        Parameters
        ----------
        uri : str
        budget : int
            Most triangles to take.

        Returns
        -------
        triangles : ndarray, shape (m, 3, 3)
            Metres.
        colours : ndarray, shape (m, 3), or None
            Red, green, blue in 0 to 1; None where the file has no colours.

        Raises
        ------
        Problem
            If the file cannot be found, may not be read or is not understood.
        """
        path = self.find(uri)
        try:
            data = path.read_bytes() if path.stat().st_size <= MAX_MESH_BYTES else None
        except OSError as error:
            raise MeshProblem(f"it cannot be read: {error.strerror}", path.name) from None
        if data is None:
            raise MeshProblem(f"it is larger than {MAX_MESH_BYTES // 1_000_000} MB", path.name)
        return read_mesh(data, path.suffix.lower()[1:], path.name, budget)


Painted: TypeAlias = tuple[FloatArray, FloatArray]
"""Triangles, shape (m, 3, 3), and their colours, shape (m, 3)."""


def link_meshes(
    urdf: UrdfArm,
    tree: Sequence[Link],
    folder: str | PathLike[str] | None,
    package_dirs: Sequence[str | PathLike[str]] = (),
) -> tuple[dict[int, shapes.Mesh], list[str]]:
    """What each link looks like.

    Parameters
    ----------
    urdf : UrdfArm
    tree : sequence of Link
        As `irbcal.viewer.shapes.links` gives them.
    folder : Path or None
        Folder of the URDF; relative file names start there.
    package_dirs : sequence of str or Path
        Folders that hold ROS packages (or are one).

    Returns
    -------
    meshes : dict of int to Mesh
        By place of the link in the list.
    notes : list of str
        What could not be drawn, in one sentence at most.
    """
    root = urdf.tree.getroot()
    materials = {m.get("name"): _colour(m) for m in root.findall("material")}
    elements = {link.get("name"): link for link in root.findall("link")}
    finder = MeshFinder(folder, package_dirs)
    painted: dict[int, list[Painted]] = {}
    bare: set[int] = set()
    problems: list[MeshProblem] = []
    budget = MAX_TRIANGLES
    for k, link in enumerate(tree):
        for visual in elements[link.name].findall("visual") if link.name in elements else ():  # none of reversed joints
            try:
                triangles, colours = _visual(visual, materials, finder, budget)
            except MeshProblem as problem:
                problems.append(problem)
                bare.add(k)
                continue
            budget -= len(triangles)
            painted.setdefault(k, []).append((triangles, colours))
    size = reach(tree)
    if not painted:
        bare = set(range(len(tree)))
    for k in sorted(bare - set(painted)):
        rod = _rods(tree, k, size)
        if rod is not None:
            painted[k] = [(rod, _grey(rod))]
    found = {
        k: shapes.smooth(np.concatenate([t for t, _ in pieces]), np.concatenate([c for _, c in pieces]))
        for k, pieces in painted.items()
    }
    return found, _problem_note(problems)


def _problem_note(problems: Sequence[MeshProblem]) -> list[str]:
    if not problems:
        return []
    first, more = problems[0], and_more(len(problems) - 1)
    hint = "; --package-dir names the folder that holds the package" if isinstance(first, MissingMesh) else ""
    return [f"Links without their meshes are drawn as rods: {first.which}{more}: {first.reason}{hint}."]


def _visual(
    visual: XmlElement, materials: Mapping[str | None, FloatArray | None], finder: MeshFinder, budget: int
) -> Painted:
    geometry = visual.find("geometry")
    shape = next((child for child in geometry if isinstance(child.tag, str)), None) if geometry is not None else None
    if shape is None:
        raise MeshProblem("there is no geometry in the visual", "a visual")
    material = visual.find("material")
    colour = None
    if material is not None:
        colour = _colour(material)
        colour = materials.get(material.get("name")) if colour is None else colour
    try:
        T = origin(visual)
        triangles, colours_of_shape = _shape(shape, finder, budget)
    except (ValueError, TypeError) as error:
        raise MeshProblem(f"not understood ({' '.join(str(error).split())})", f"<{shape.tag}>") from None
    if colours_of_shape is None:
        colours_of_shape = _grey(triangles) if colour is None else np.broadcast_to(colour, (len(triangles), 3))
    return triangles @ T[:3, :3].T + T[:3, 3], colours_of_shape


def _shape(shape: XmlElement, finder: MeshFinder, budget: int) -> tuple[FloatArray, FloatArray | None]:
    if shape.tag == "box":
        return shapes.box(vector(shape.get("size"), 3)), None
    if shape.tag == "cylinder":
        return shapes.cylinder(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "capsule":
        return shapes.capsule(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "sphere":
        return shapes.sphere(_size(shape, "radius")), None
    if shape.tag == "mesh":
        triangles, colours = finder.read(shape.get("filename") or "", budget)
        scale = vector(shape.get("scale") or "1 1 1", 3)
        triangles = triangles * scale
        if np.prod(scale) < 0:
            triangles = triangles[:, ::-1]
        return triangles, colours
    raise ValueError(f"unknown geometry {shape.tag}")


def _size(shape: XmlElement, name: str) -> float:
    value = float(shape.get(name))
    if not 0 <= value < 1e3:
        raise ValueError(f"{name} is {value:g}")
    return value


def _colour(material: XmlElement) -> FloatArray | None:
    element = material.find("color")
    try:
        return None if element is None else vector(element.get("rgba"), 4)[:3].clip(0, 1)
    except ValueError:
        return None


def _rods(tree: Sequence[Link], k: int, size: float) -> FloatArray | None:
    """A link as rods from its frame to the joints that it carries, with a drum about each moving joint."""
    radius = 0.022 * size
    rods = []
    for child in tree:
        if child.parent != k:
            continue
        end = child.T_parent_joint[:3, 3]
        if np.linalg.norm(end) > 2 * radius:
            rods.append(shapes.rod(np.zeros(3), end, radius))
    link = tree[k]
    if link.kind == "revolute":
        rods.append(shapes.rod(-1.6 * radius * link.axis, 1.6 * radius * link.axis, 1.5 * radius))
    return np.concatenate(rods) if rods else None


def _grey(triangles: FloatArray) -> FloatArray:
    return np.broadcast_to(GREY, (len(triangles), 3))


NICE = (1.0, 2.0, 5.0)


def nice(value: float, up: bool = False) -> float:
    """The largest of 1, 2, 5, 10, 20 ... not above a value (the smallest not below it with ``up``)."""
    decade = 10.0 ** np.floor(np.log10(value))
    steps = decade * np.array([*NICE, 10.0])
    return float(steps[steps >= value * (1 - 1e-9)][0] if up else steps[steps <= value * (1 + 1e-9)][-1])


def default_magnification(errors: Sequence[FloatArray] | None, size: float) -> float:
    """A round factor that makes the vectors of the worse model about a fourteenth of the robot on average."""
    mean = 0.0 if errors is None else max(error.mean() for error in errors)
    return nice(0.07 * size / mean) if mean > 1e-9 else 100.0


def scale_top(errors: Sequence[FloatArray] | None) -> float:
    """Upper end of the colours, metres: a round number above (nearly) all errors of both models."""
    if errors is None:
        return 1 * MM
    together = np.concatenate(errors)
    largest, usual = together.max(), np.quantile(together, 0.99)
    top = largest if largest < 3 * usual else usual
    if top < 1e-9:
        return 1 * MM
    step = nice(top / 2)
    return float(np.ceil(top / step * (1 - 1e-9)) * step)


NEAR_TRACKER = 0.2
"""No tracker stands closer than this to what it measures, metres: the frame's origin is then something else."""

LARGEST_MAGNIFICATION = 1e6

CubeLike: TypeAlias = tuple[ArrayLike, float]
"""Centre (3,) and edge of a cube, metres."""


def view(
    source: RobotLike,
    measurements: MeasurementsLike | None = None,
    *,
    plan: PlanLike | None = None,
    magnify: float | None = None,
    package_dirs: Sequence[str | Path] = (),
    cube: tuple[ArrayLike, float] | None = None,
    refit_base: bool = False,
    refit_tool: bool = False,
    base_link: str | None = None,
    tip_link: str | None = None,
    cell: CellFile | str | Path | None = None,
) -> View:
    """Look at a calibration, or at a robot.

    Parameters
    ----------
    source : str, Path, or a calibration
        Calibration folder (in Python also a loaded calibration); a URDF or a robot's name (then there is nothing
        measured to show).
    measurements : str, Path, DataFrame or MeasurementSet, optional
        Measured points; a table that holds joints only is taken as a plan. Without it, the joints have sliders.
    plan : str, Path, DataFrame or array_like of shape (n, joints), optional
        Joints to walk through, linearly from pose to pose: columns q1_deg … of a table (in Python also an array
        in radians, metres for prismatic joints).
    magnify : float, optional
        Magnification of the error vectors; by default a round number that makes them visible.
    package_dirs : sequence of str or Path
        See `irbcal.read_urdf`.
    cube : (array_like of shape (3,), float), optional
        ISO 9283 cube: centre in the base link and edge, metres. By default that of the IRB 1600, for it only.
    refit_base : bool
        Fit the base again to the measurements (tracker or robot was moved).
    refit_tool : bool
        Fit the reflectors' places again (they were remounted, or a calibration without a tracker has none): on half of
        the poses, the others are shown.
    base_link, tip_link : str, optional
        See `irbcal.read_urdf`.
    cell : CellFile, str or Path, optional
        Tools and work objects to draw, of a file that ``irbcal cell`` wrote with this calibration; labels have what
        holds 95 % of the errors of their coordinates.

    Raises
    ------
    OptionError
        If the magnification is not above zero and at most 1e6.
    RobotError
        If there is no such robot, its URDF cannot be used, or plan or cube do not fit it.
    CalibrationError
        If a calibration cannot be read, or does not hold the robot's looks.
    MeasurementError
        If measurements are refused, or given together with a plan or for a robot that is not calibrated.

    Examples
    --------
    >>> view = irbcal.view("my-robot", "verification.csv", magnify=200)  # doctest: +SKIP
    >>> view.save("view.html")  # doctest: +SKIP
    """
    if magnify is not None and not 0 < magnify <= LARGEST_MAGNIFICATION:
        raise OptionError(f"the magnification must be above 0 and at most 1e6, found {magnify:g}", parameter="magnify")
    opened = open_robot(source, base_link=base_link, tip_link=tip_link, package_dirs=package_dirs)
    table = measurements if isinstance(measurements, (str, Path, pd.DataFrame)) else None
    rows = opened.record is not None and feature_views.are_rows(opened.record, column_names(table))
    if plan is None and table is not None and not rows and point_sets.is_plan(table):
        measurements, plan = None, table
    _check_request(opened, measurements is not None, plan is not None)
    urdf, shadow = _documents(opened)
    for name, requested in (("refit_base", refit_base), ("refit_tool", refit_tool)):
        if rows and requested:
            frame = name.removeprefix("refit_")
            raise OptionError(f"rows at features do not place the {frame}: leave {name} out", parameter=name)
    refit = Refit(refit_base, refit_tool)
    content = _at_features(opened, table) if rows else _shown(opened, measurements, plan, refit)
    points, T_scene_world = content.points, frames.inverse(content.robot.T_world_base)
    tree = links(urdf)
    ghost = None
    if content.ghost is not None:
        ghost = _drawn(shadow, links(shadow), T_scene_world @ content.ghost.T_world_base)
    folders = robots.package_dirs(*package_dirs, *opened.mesh_folders)
    meshes, problems = link_meshes(urdf, tree, opened.folder, folders)
    points_of = {} if opened.record is None else opened.record.reference_places()
    references = {name: frames.apply(T_scene_world, xyz[None])[0] for name, xyz in points_of.items()}
    models: tuple[WhichModel, ...] = ("nominal", "calibrated")
    each = {} if points is None else {name: e for name in models if (e := points.distance(name)) is not None}
    errors = list(each.values()) or None
    size = reach(tree)
    section = None if opened.record is None else opened.record.features
    scene = PageScene(
        title=urdf.arm.name if opened.record is None else f"{urdf.arm.name}, model {opened.record.model}",
        simulated=content.simulated,
        mode=content.mode,
        robot=content.robot,
        drawn=_drawn(urdf, tree, np.eye(4)),
        ghost=ghost,
        meshes=meshes,
        q=content.q,
        effective=_effective(content),
        pose_ids=np.asarray(content.ids, dtype=object),
        groups=np.asarray(content.groups, dtype=object),
        targets=content.targets,
        points=points,
        prismatic=np.array([_slides(tree, k) for k in range(len(content.robot.arm.joint_names))]),
        T_scene_world=T_scene_world,
        tracker=opened.record is not None and section is None and tracker_at_origin(T_scene_world, references, points),
        references=references,
        cube=_cube(cube, opened.nominal),
        path=content.path,
        magnification=float(magnify or default_magnification(errors, size)),
        scale_top=scale_top(errors),
        notes=(*content.notes, *_not_drawn(content.robot), *problems),
        own_scales={
            name: (float(magnify or default_magnification([error], size)), scale_top([error]))
            for name, error in each.items()
        },
        fitted=content.fitted,
        features=() if section is None else feature_views.shown_features(section, size, T_scene_world),
        at_features=rows,
        cell=_cell_frames(cell, opened),
    )
    return View(scene)


def _cell_frames(cell: CellFile | str | Path | None, opened: Opened) -> tuple[CellFrame, ...]:
    """True tools and work objects, labelled with how well they are known."""
    if cell is None:
        return ()
    if opened.record is None:
        raise OptionError("cell: its tools and work objects are of a calibration: view that", parameter="cell")
    cell_file = cell_of(cell, opened.record.fingerprint)
    assert cell_file is not None
    out = []
    for frame, frames_of in ((TOOL, cell_file.tools), (WORK_OBJECT, cell_file.work_objects)):
        for name, true_frame in frames_of.items():
            u95 = cell_file.u95(frame, name, cell_file.covariance)[0] / MM
            out.append(CellFrame(f"{true_frame.title(frame)} ± {u95:.2f} mm", true_frame.T_true, frame == TOOL))
    return tuple(out)


def _effective(content: _ShownPoses) -> FloatArray:
    """Effective joints of the poses, given their last moves and loads where these are known, shape (n, joints)."""
    if content.effective is not None:
        return content.effective
    return content.robot.joint_map.effective(content.q) if len(content.q) else content.q


def _not_drawn(robot: Robot) -> list[str]:
    """That the robot is drawn from URDF and effective joints, where points know more than that."""
    if robot.frame_terms is None:
        return []
    return [
        "The robot is drawn from its URDF and effective joints. Points and errors are those of the whole model, frame "
        "terms included."
    ]


def _check_request(opened: Opened, measured: bool, planned: bool) -> None:
    if planned and measured:
        raise MeasurementError("a view shows measurements or a plan, not both: leave one out", parameter="plan")
    if measured and opened.record is None:
        raise MeasurementError(
            "measured points can be shown for a calibration folder only; for a robot as such give a file of joints "
            "(columns q1_deg …)",
            file=opened.name,
        )


def _documents(opened: Opened) -> tuple[UrdfArm, UrdfArm]:
    """The URDFs that the robot and the nominal robot are drawn from."""
    if opened.urdf is None:
        raise CalibrationError(
            f"this calibration of {opened.name} does not hold the robot's looks: give its folder in its place"
        )
    return opened.urdf, opened.nominal_urdf


@dataclass(eq=False)
class _ShownPoses:
    """What is shown of a robot; filled by one of the modes."""

    mode: Mode
    robot: Robot
    ghost: Robot | None
    targets: Mapping[str, FloatArray]
    q: FloatArray
    simulated: bool
    ids: Sequence[str] | NameArray = ()
    groups: Sequence[str] | NameArray = ()
    points: Points | None = None
    path: FloatArray | None = None
    notes: list[str] = field(default_factory=list)
    effective: FloatArray | None = None
    fitted: BoolArray | None = None


def _shown(opened: Opened, measurements: MeasurementsLike | None, plan: PlanLike | None, refit: Refit) -> _ShownPoses:
    """Poses and points: measured ones, those of a plan, or none (the joints have sliders)."""
    model = opened.robot
    ghost = None if opened.record is None else opened.record.robot_nominal()
    simulated = opened.record is not None and opened.record.simulated
    if measurements is not None and opened.record is not None:
        registered = point_sets.registered(opened.record, measurements, refit)
        measured, model, ghost = registered.points, registered.calibrated, registered.nominal
        points = point_sets.measured_points(model, ghost, measured, frames.inverse(model.T_world_base))
        return _ShownPoses(
            mode="measured",
            robot=model,
            ghost=ghost,
            targets=model.targets,
            q=measured.q,
            simulated=simulated or registered.measurements.simulated,
            ids=measured.pose_ids.astype(str),
            groups=measured.groups.astype(str),
            points=points,
            notes=list(registered.notes),
            fitted=registered.fitted,
            effective=model.joint_map.effective(measured.q, measured.previous, **measured.inputs),
        )
    targets = model.targets or {model.arm.tip_link: np.zeros(3)}
    if plan is None:
        none = np.zeros((0, len(model.arm.joint_names)))
        return _ShownPoses("sliders", model, ghost, targets, none, simulated)
    q = point_sets.plan_joints(plan, model.arm)
    with_targets, T_scene_world = model.replace(targets=targets), frames.inverse(model.T_world_base)
    ids = np.arange(1, len(q) + 1).astype(str)
    return _ShownPoses(
        mode="plan",
        robot=model,
        ghost=ghost,
        targets=targets,
        q=q,
        simulated=simulated,
        ids=ids,
        groups=np.full(len(q), ""),
        points=point_sets.planned_points(with_targets, ghost, q, T_scene_world),
        path=point_sets.path_of(with_targets, q, T_scene_world),
        notes=point_sets.outside_limits(model.arm, q, ids),
    )


def _at_features(opened: Opened, table: str | Path | pd.DataFrame | None) -> _ShownPoses:
    """Rows at the features of a calibration."""
    assert opened.record is not None
    record, model = opened.record, opened.robot
    rows = feature_views.at_rows(record, table)
    motion = rows.motion
    return _ShownPoses(
        mode="measured",
        robot=model,
        ghost=record.robot_nominal(),
        targets=model.targets,
        q=motion.q,
        simulated=record.simulated or rows.simulated,
        ids=rows.ids,
        groups=rows.groups,
        points=rows.points,
        notes=rows.notes,
        effective=model.joint_map.effective(motion.q, None if motion.move is None else motion.q - motion.move),
        fitted=rows.fitted,
    )


def _slides(tree: Sequence[Link], joint: int) -> bool:
    kinds = (link.kind for link in tree if link.joint == joint and link.factor == 1.0)
    return next(kinds, "revolute") == "prismatic"


def _drawn(urdf: UrdfArm, tree: tuple[Link, ...], T_scene_base: FloatArray) -> Drawn:
    names = [link.name for link in tree]
    T_base_first = np.eye(4) if urdf.arm.joints_up else frames.inverse(urdf.T_root_base)
    return Drawn(tree, T_scene_base @ T_base_first, names.index(urdf.arm.tip_link))


def tracker_at_origin(T_scene_world: FloatArray, references: Mapping[str, FloatArray], points: Points | None) -> bool:
    """Whether the tracker stands in the origin of the measuring frame.

    Not where the frame was made of reference points, nor where something is measured in its origin.
    """
    origin = T_scene_world[:3, 3]
    near = list(references.values())
    if points is not None:
        near.append(points.calibrated)
    xyz = np.concatenate([np.atleast_2d(place) for place in near]) if near else np.zeros((0, 3))
    return bool((np.linalg.norm(xyz - origin, axis=1) > NEAR_TRACKER).all())


def _cube(cube: CubeLike | None, nominal: Arm) -> tuple[FloatArray, float] | None:
    if cube is not None:
        centre, edge = np.array(cube[0], dtype=float), float(cube[1])
        if centre.shape != (3,) or not np.isfinite(centre).all() or not 0 < edge < 100:
            raise RobotError(
                f"a cube needs its centre (three numbers) and an edge above zero, found {cube}", parameter="cube"
            )
        centre.setflags(write=False)
        return centre, edge
    return IRB1600_CUBE if has_thesis_cube(nominal) else None


def plan_page(plan: Plan) -> str:
    """The page of a plan, self-contained HTML: robot, tracker, cube, reflectors and their way from pose to pose."""
    scene, setting, options = plan.scene, plan.scene.setting, plan.options
    view_page = view(
        options.robot,
        plan=np.array(plan.q),
        package_dirs=options.package_dirs,
        cube=scene.cube,
        base_link=options.base_link,
        tip_link=options.tip_link,
    ).scene
    pose, target, xyz, _ = plan.expected()
    T_scene_world = frames.inverse(scene.T_world_base)
    return View(
        replace(
            view_page,
            robot=setting.robot.replace(T_world_base=scene.T_world_base),
            targets=dict(zip(setting.targets.names, setting.targets.positions, strict=True)),
            points=Points(pose, target, frames.apply(T_scene_world, xyz)),
            groups=plan.groups,
            path=_way(plan),
            over_home=(home_joints(setting.arm), np.flatnonzero(plan.over_home)),
            T_scene_world=T_scene_world,
            tracker=True,
        )
    ).html


def _way(plan: Plan) -> FloatArray:
    """Way of the first reflector from home over all poses and back in the base link, (k, 3), metres."""
    from irbcal.planning import measuring_plan, route

    setting, q_stops = plan.scene.setting, measuring_plan.moves(plan).q
    q, _ = route.between(q_stops[:-1], q_stops[1:], setting.arm.table.prismatic)
    return setting.tip_and_reflectors(q)[1][:, 0]
