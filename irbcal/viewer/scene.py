"""What a view shows, in numbers: robots, poses, measured and modelled points, tracker, references, cube.

Everything is given in the base link of the (calibrated) robot, which is the frame of the drawing: "scene". The
measuring frame stands where the calibration found it.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irbcal.errors import CalibrationError, IrbcalError, MeasurementError, RobotError
from irbcal.files import calibration_folder, robots
from irbcal.files import urdf as urdf_module
from irbcal.files.schema import Record
from irbcal.measurement import columns, lists
from irbcal.measurement.points import rotation_distances
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.thesis_setup import IRB1600_CUBE, IRB1600_P1
from irbcal.units import MM
from irbcal.validation.evaluate import in_frame_of_calibration
from irbcal.viewer import robot as robot_module

NICE = (1.0, 2.0, 5.0)
NEAR_TRACKER = 0.2
"""No tracker stands closer than this to what it measures, metres: the frame's origin is then something else."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """One robot as it is drawn.

    Attributes
    ----------
    links : list of Link
    T_scene_root : ndarray, shape (4, 4)
    tip : int
        Place of the tip link in the list.
    """

    links: list
    T_scene_root: np.ndarray
    tip: int


@dataclass(frozen=True, eq=False)
class Points:
    """Measured points and what the models say of them, in the scene, metres.

    Attributes
    ----------
    pose, target : ndarray of int, shape (m,)
        Row of the scene's poses; index into the scene's targets.
    measured, calibrated, nominal : ndarray, shape (m, 3)
        ``measured`` is None for a plan, ``nominal`` where there is no other model than the robot itself.
    turn_calibrated, turn_nominal : ndarray, shape (m,), or None
        Angles between measured and modelled target frames, radians; NaN where not measured.
    """

    pose: np.ndarray
    target: np.ndarray
    calibrated: np.ndarray
    measured: np.ndarray | None = None
    nominal: np.ndarray | None = None
    turn_calibrated: np.ndarray | None = None
    turn_nominal: np.ndarray | None = None

    def error(self, model="calibrated"):
        """Measured minus modelled points, shape (m, 3), metres."""
        return self.measured - getattr(self, model)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that a page shows.

    Attributes
    ----------
    title : str
    simulated : bool
    mode : str
        ``measured``, ``plan`` or ``sliders``.
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
    notes : list of str
    """

    title: str
    simulated: bool
    mode: str
    robot: Robot
    drawn: Drawn
    ghost: Drawn | None
    meshes: dict
    q: np.ndarray
    effective: np.ndarray
    pose_ids: np.ndarray
    groups: np.ndarray
    targets: dict
    points: Points | None
    prismatic: np.ndarray
    T_scene_world: np.ndarray
    tracker: bool
    references: dict
    cube: tuple | None
    path: np.ndarray | None
    magnification: float
    scale_top: float
    notes: list = field(default_factory=list)

    @property
    def reach(self):
        """Scale of the robot, metres."""
        return robot_module.reach(self.drawn.links)


def build(
    source,
    measurements=None,
    plan=None,
    package_dirs=(),
    magnification=None,
    cube=None,
    refit_base=False,
    base=None,
    tip=None,
):
    """Gather a scene.

    Parameters
    ----------
    source : str, Path or Record
        Calibration folder, URDF, or a shipped robot's name.
    measurements : str, Path or MeasurementSet, optional
        Measurements; or a file of joints only, which is taken as a plan.
    plan : str, Path or array_like of shape (n, joints), optional
        Joints to walk through before they are run; arrays in radians (metres for prismatic joints).
    package_dirs : sequence of str or Path
        Folders with ROS packages for the meshes.
    magnification : float, optional
        Of the error vectors; by default a round number that makes them visible.
    cube : (array_like of shape (3,), float), optional
        Centre in the base link and edge of the ISO 9283 cube, metres; by default that of the IRB 1600, for it only.
    refit_base : bool
        Place the base anew on the measurements, see `irbcal.evaluate`.
    base, tip : str, optional
        Link names, for a URDF.

    Returns
    -------
    Scene

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    if magnification is not None and not 0 < magnification <= 1e6:
        raise IrbcalError(f"the magnification must be above 0 and at most 1e6, found {magnification:g}")
    opened = _open(source, base, tip)
    model, ghost = opened["model"], opened["ghost"]
    notes = opened["notes"]
    if plan is None and isinstance(measurements, (str, Path)) and is_plan(measurements):
        measurements, plan = None, measurements
    if plan is not None and measurements is not None:
        raise MeasurementError("a view shows measurements or a plan, not both: leave one out")
    if measurements is not None and opened["calibration"] is None:
        raise MeasurementError(
            f"{_name(source)}: measured points can be shown for a calibration folder only; for a robot as such give a "
            "file of joints (columns q1_deg …)"
        )

    T_scene_world = frames.inverse(model.T_world_base)
    simulated = opened["calibration"] is not None and opened["calibration"].simulated
    mode, q, ids, groups, points = "sliders", np.zeros((0, len(model.arm.joint_names))), (), (), None
    if measurements is not None:
        mode = "measured"
        seen, found, model, nominal, more = _registered(opened["calibration"], measurements, refit_base)
        notes = notes + more
        simulated = simulated or seen.simulated
        T_scene_world = frames.inverse(model.T_world_base)
        q, ids, groups = found.q, found.pose_ids.astype(str), found.groups.astype(str)
        points = _measured_points(model, nominal, found, T_scene_world)
        ghost = nominal
    elif plan is not None:
        mode = "plan"
        q = _plan_joints(plan, model.arm)
        ids, groups = np.arange(1, len(q) + 1).astype(str), np.full(len(q), "")
        notes = notes + _outside_limits(model.arm, q, ids)
    targets = model.targets or {model.arm.tip_link: np.zeros(3)}
    if mode == "plan":
        points = _planned_points(model.replace(targets=targets), ghost, q, T_scene_world)

    tree = robot_module.links(opened["urdf"])
    drawn = _drawn(opened["urdf"], tree, np.eye(4))
    shadow = None
    if opened["ghost_urdf"] is not None:
        other = opened["ghost_urdf"]
        shadow = _drawn(other, robot_module.links(other), T_scene_world @ ghost.T_world_base)
    packages = robots.package_dirs(*package_dirs)
    meshes, problems = robot_module.meshes(opened["urdf"], tree, opened["folder"], packages)
    references = opened["calibration"].reference_places() if opened["calibration"] is not None else {}
    references = {name: frames.apply(T_scene_world, place[None])[0] for name, place in references.items()}
    size = robot_module.reach(tree)
    errors = (
        None if mode != "measured" else [np.linalg.norm(points.error(m), axis=1) for m in ("nominal", "calibrated")]
    )
    return Scene(
        title=opened["title"],
        simulated=simulated,
        mode=mode,
        robot=model,
        drawn=drawn,
        ghost=shadow,
        meshes=meshes,
        q=q,
        effective=model.joint_map.effective(q) if len(q) else q,
        pose_ids=np.asarray(ids, dtype=object),
        groups=np.asarray(groups, dtype=object),
        targets=targets,
        points=points,
        prismatic=np.array([_kind(tree, k) == "prismatic" for k in range(len(model.arm.joint_names))]),
        T_scene_world=T_scene_world,
        tracker=opened["calibration"] is not None and _tracker_at_origin(T_scene_world, references, points),
        references=references,
        cube=_cube(cube, opened["nominal_arm"]),
        path=_path(model.replace(targets=targets), q, T_scene_world) if mode == "plan" else None,
        magnification=float(magnification or default_magnification(errors, size)),
        scale_top=scale_top(errors),
        notes=notes + problems,
    )


def is_plan(path):
    """Whether a file has joint columns and no measured points."""
    try:
        if Path(path).suffix == ".parquet":
            import pandas as pd

            names = [str(name).strip() for name in pd.read_parquet(path).columns]
        else:
            with open(path, encoding="utf-8-sig") as stream:
                header = next((line for line in (stream.readline(100_000) for _ in range(100)) if line.strip()), "")
            names = [name.strip().strip('"') for name in header.split(",")]
    except Exception:  # whatever is wrong with the file, its reader says it better
        return False
    return bool(columns.joint_columns(names)) and not {"target", *columns.POSITION} & set(names)


def nice(value, up=False):
    """The largest of 1, 2, 5, 10, 20 ... not above a value (the smallest not below it with ``up``)."""
    decade = 10.0 ** np.floor(np.log10(value))
    steps = decade * np.array([*NICE, 10.0])
    return float(steps[steps >= value * (1 - 1e-9)][0] if up else steps[steps <= value * (1 + 1e-9)][-1])


def default_magnification(errors, size):
    """A round factor that makes the vectors of the worse model about a fourteenth of the robot on average."""
    mean = 0.0 if errors is None else max(error.mean() for error in errors)
    return nice(0.07 * size / mean) if mean > 1e-9 else 100.0


def scale_top(errors):
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


# --- what is opened ------------------------------------------------------------------------------------------


def _name(source):
    return "this calibration" if isinstance(source, Record) else str(source)


def _open(source, base, tip):
    """Robot, ghost and their URDFs for a calibration or a robot file."""
    if isinstance(source, Record):
        return _open_calibration(source, *_documents(source))
    if Path(source).is_dir():
        folder = Path(source)
        saved = calibration_folder.read(folder)
        return _open_calibration(saved.record, saved.urdf, saved.nominal_urdf(), folder)
    path = robots.robot_file(source)
    urdf = urdf_module.read(path, base, tip)
    return {
        "calibration": None,
        "model": Robot(urdf.arm),
        "ghost": None,
        "urdf": urdf,
        "ghost_urdf": None,
        "nominal_arm": urdf.arm,
        "folder": path.parent,
        "title": urdf.arm.name,
        "notes": [],
    }


def _documents(calibration):
    """URDFs of a calibration whose folder is not known: those of a shipped robot can be made again."""
    import hashlib

    for name in robots.ROBOTS:
        path = robots.robot_file(name)
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() == calibration.robot.urdf_sha256:
            urdf = urdf_module.from_bytes(data, str(path), calibration.robot.base_link, calibration.robot.tip_link)
            return urdf_module.to_bytes(urdf, calibration.arm()), data, path.parent
    raise CalibrationError(
        f"this calibration of {calibration.robot.name} does not hold the robot's looks: give its folder in its place"
    )


def _open_calibration(calibration, text, nominal_text, folder):
    section = calibration.robot
    urdfs = [
        urdf_module.from_bytes(data, f"{which} URDF of {section.name}", section.base_link, section.tip_link)
        for which, data in (("calibrated", text), ("nominal", nominal_text))
    ]
    return {
        "calibration": calibration,
        "model": calibration.robot_calibrated(),
        "ghost": calibration.robot_nominal(),
        "urdf": urdfs[0],
        "ghost_urdf": urdfs[1],
        "nominal_arm": calibration.arm(calibrated=False),
        "folder": folder,
        "title": f"{section.name}, model {calibration.model}",
        "notes": [],
    }


def _kind(tree, joint):
    return next((link.kind for link in tree if link.joint == joint and link.factor == 1.0), "revolute")


def _drawn(urdf, tree, T_scene_base):
    names = [link.name for link in tree]
    return Drawn(tree, T_scene_base @ frames.inverse(urdf.T_root_base), names.index(urdf.arm.tip_link))


# --- points --------------------------------------------------------------------------------------------------


def _registered(calibration, measurements, refit_base):
    """Measurements in the calibration's frame, cleaned as `irbcal.evaluate` does."""
    ready, robots = in_frame_of_calibration(calibration, measurements, refit_base)
    seen, notes = ready.measurements, list(ready.notes)
    if ready.excluded:
        count = len(ready.excluded)
        notes.insert(0, f"{count} points are left out (lost, or wrong); irbcal evaluate lists them.")
    if seen.sha256 in {item.sha256 for item in calibration.data}:
        notes.append("This file was used for the calibration: fitted poses among these are no proof of accuracy.")
    return seen, ready.points, robots["calibrated"], robots["nominal"], notes


def _measured_points(model, nominal, points, T_scene_world):
    modelled = [frames.apply(T_scene_world, points.predicted(robot)) for robot in (model, nominal)]
    turns = [_turns(robot, points) for robot in (model, nominal)]
    return Points(
        points.pose,
        _target_index(model, points),
        modelled[0],
        frames.apply(T_scene_world, points.xyz),
        modelled[1],
        *turns,
    )


def _target_index(model, points):
    names = list(model.targets)
    return np.array([names.index(name) for name in points.target_names])[points.target]


def _turns(robot, points):
    """Orientation error of each point, radians; None where no orientation was measured."""
    found = rotation_distances(robot, points)
    if not len(found):
        return None
    out = np.full(len(points), np.nan)
    out[points.oriented() & np.isin(points.names().astype(str), list(robot.target_rotations))] = found
    return out


def _plan_joints(plan, arm):
    if isinstance(plan, (str, Path)):
        return lists.read_joints(plan, arm.joint_columns)
    plan = np.asarray(plan, dtype=float)
    if plan.ndim != 2 or not len(plan) or not np.isfinite(plan).all():
        raise RobotError(
            f"a plan for {arm.name} needs finite joints of shape (n, {len(arm.joint_names)}), n at least 1"
        )
    return arm.check_joints(plan)


def _outside_limits(arm, q, ids):
    wrong = ((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=1)
    if not wrong.any():
        return []
    more = f" and {wrong.sum() - 1} more" if wrong.sum() > 1 else ""
    return [f"The plan leaves the joint limits of {arm.name}: pose {ids[np.argmax(wrong)]}{more}."]


def _planned_points(model, ghost, q, T_scene_world):
    count = len(model.targets)
    rows, names = np.repeat(np.arange(len(q)), count), np.tile(list(model.targets), len(q))
    nominal = None
    if ghost is not None:
        nominal = frames.apply(T_scene_world, ghost.replace(targets=model.targets).points(q[rows], names))
    return Points(
        rows,
        np.tile(np.arange(count), len(q)),
        frames.apply(T_scene_world, model.points(q[rows], names)),
        nominal=nominal,
    )


def _path(model, q, T_scene_world, most=20_000):
    """Way of the first target when the robot goes from pose to pose linearly in its joints."""
    if len(q) < 2:
        return None
    steps = int(np.clip(most // len(q), 2, 24))
    part = np.arange(steps) / steps
    between = q[:-1, None] + part[:, None] * (q[1:] - q[:-1])[:, None]
    way = np.concatenate([between.reshape(-1, q.shape[1]), q[-1:]])
    return frames.apply(T_scene_world, model.points(way, next(iter(model.targets))))


def _tracker_at_origin(T_scene_world, references, points):
    """Not where the frame was made of reference points, nor where something is measured in its origin."""
    origin = T_scene_world[:3, 3]
    near = list(references.values())
    if points is not None:
        near.append(points.calibrated)
    places = np.concatenate([np.atleast_2d(place) for place in near]) if near else np.zeros((0, 3))
    return bool((np.linalg.norm(places - origin, axis=1) > NEAR_TRACKER).all())


def _cube(cube, nominal):
    if cube is not None:
        centre, edge = np.array(cube[0], dtype=float), float(cube[1])
        if centre.shape != (3,) or not np.isfinite(centre).all() or not 0 < edge < 100:
            raise RobotError(f"a cube needs its centre (three numbers) and an edge above zero, found {cube}")
        return centre, edge
    if len(nominal.joint_names) != 6:
        return None
    flange = nominal.forward(IRB1600_P1)[0, :3, 3]
    return IRB1600_CUBE if np.linalg.norm(flange - IRB1600_CUBE[0]) < 0.02 * MM else None
