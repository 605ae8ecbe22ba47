"""Measuring plans of a robot by its name: from wishes to poses. `irbcal.planning.plan_files` writes them."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from irbcal.cell import cell
from irbcal.cell import tool as cell_tool
from irbcal.errors import MeasurementError
from irbcal.files import calibration_folder, robots
from irbcal.files import urdf as urdf_module
from irbcal.measurement import columns, lists
from irbcal.modeling import frames
from irbcal.modeling.parameters import default_level
from irbcal.modeling.robot import Robot
from irbcal.planning import conditions, design, route
from irbcal.thesis_setup import IRB1600_HEIGHTS
from irbcal.units import DEG, MM

READINGS_S = cell.SECONDS_PER_POINT
"""Seconds that the tracker needs for a reflector."""
TRACKER_RADIUS, NEAR_TRACKER = 0.25, 0.3
"""Metres: the ball around the tracker that the robot keeps out of, and how far from the base link it must stand."""
MOST_REFLECTORS = 3
"""Reflectors measured in a pose; more tell little about the robot."""
VOLUME_SAMPLES = 400
USUAL_SPEED = (60 * DEG, 0.5)
"""Of revolute and prismatic joints where the URDF has none, SI units."""
DIRECTIONS = ("nx", "ny", "nz")
VOLUMES = ("both", "cube", "range")


@dataclass(frozen=True, eq=False)
class Wish:
    """What a plan should hold.

    Parameters
    ----------
    axis : int
        `plan.FEW` or `plan.MANY` axis moves (of six joints; as many for each joint of others), or 0.
    cube, all_range : int
        Random poses in the cube and in the whole range.
    optimal : int
        Poses chosen out of ``candidates``, half in the cube, half in the whole range.
    candidates : int
    criterion : str
        See `irbcal.planning.design`.
    volume : str
        Where positions count for the criterion ``position``: ``cube``, ``range`` or ``both``.
    level : str, optional
        Error model; that of a calibration without a wish unless given.
    noise : float
        Standard deviation of a coordinate, metres.
    imagined : float
        Size of joint errors that no model describes, against which the criterion ``position`` guards, radians.
    wait_s, speed : float
        Seconds of rest before a measurement; speed of the tip, m/s.
    references : int
        Reference reflectors that are measured in each pose, too: they take time.
    payload_kg : float, optional
    seed : int
    """

    axis: int = conditions.FEW
    cube: int = 52
    all_range: int = 50
    optimal: int = 0
    candidates: int = 2000
    criterion: str = "position"
    volume: str = "both"
    level: str | None = None
    noise: float = design.NOISE
    imagined: float = design.IMAGINED_SIZE
    wait_s: float = 4.0
    references: int = 3
    speed: float = 0.5
    payload_kg: float | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Scene:
    """Where a plan is made for.

    Attributes
    ----------
    name : str
        As the user named the robot.
    links : tuple of (str or None)
        Base and tip link, where the user named them.
    setting : Setting
    nominal : Arm
        What the controller believes: predictions are made there.
    T_world_base : ndarray, shape (4, 4)
        The base link in the frame of the expected coordinates.
    cube : tuple
        Centre (3,) in the base link and edge, metres.
    joint_speed : ndarray, shape (joints,)
        SI units.
    notes : list of str
    """

    name: str
    links: tuple
    setting: conditions.Setting
    nominal: object
    T_world_base: np.ndarray
    cube: tuple
    joint_speed: np.ndarray
    notes: list = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Made:
    """A plan.

    Attributes
    ----------
    scene : Scene
    wish : Wish
    q : ndarray, shape (n, joints)
        Commanded joints in the order of the run, radians (metres for prismatic joints).
    asked : ndarray of bool, shape (n, k)
        Reflectors measured in each pose.
    groups : ndarray of str, shape (n,)
    over_home : ndarray of bool, shape (n,)
        Poses to which the robot goes over its home joints, for the direct way is not free.
    tallies : dict of str to Tally
        Of each source of poses.
    prediction : Prediction
    position_std : dict of str to ndarray
        Standard deviations of the first measured reflector's predicted position in ``cube`` and ``range``, metres.
    stops : ndarray, shape (n,)
        When the robot stands still in each pose, seconds from the start.
    comparison : Comparison or None
        Of optimal poses with random ones.
    notes : list of str
    """

    scene: Scene
    wish: Wish
    q: np.ndarray
    asked: np.ndarray
    groups: np.ndarray
    over_home: np.ndarray
    tallies: dict
    prediction: design.Prediction
    position_std: dict
    stops: np.ndarray
    comparison: object
    notes: list

    @property
    def hold_s(self):
        """Seconds of standing still in each pose: the wait and the readings, shape (n,)."""
        return self.wish.wait_s + READINGS_S * (self.asked.sum(axis=1) + self.wish.references)

    @property
    def duration_s(self):
        """Of the whole run, an estimate."""
        return float(self.stops[-1] + self.hold_s[-1])

    def expected(self):
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
        time = self.stops[pose] + self.wish.wait_s + READINGS_S * number
        return pose, target, frames.apply(self.scene.T_world_base, points[pose, target]), time


# --- what a plan is made for ---------------------------------------------------------------------------------


def open_scene(
    name,
    targets=None,
    tracker=None,
    without=(),
    margin=2 * DEG,
    acceptance=conditions.ACCEPTANCE,
    heights=None,
    cube=None,
    package_dirs=(),
    base=None,
    tip=None,
):
    """Robot, reflectors, tracker and conditions.

    Parameters
    ----------
    name : str or Path
        Calibration folder, URDF, or shipped robot.
    targets : str or Path, optional
        A file of reflectors (see `read_targets`); how many of the thesis tool's nine reflectors, or which, with
        commas between their names. Three unless given, of a calibration its own.
    tracker : sequence of float, optional
        x, y, z (metres) in the base link and, at will, the turn of its axes about z (radians). Of a calibration, the
        origin of its measuring frame unless given; else the place in the thesis's cell, scaled to the arm.
    without : sequence of str
        Conditions that are switched off.
    margin, acceptance : float
        Radians.
    heights : tuple of float, optional
        In front and at the back, metres; those of the thesis's cell for the IRB 1600, none for others.
    cube : tuple, optional
        Centre (3,) in the base link and edge, metres.
    package_dirs : sequence of str or Path
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
    unknown = [item for item in without if item not in conditions.CONDITIONS]
    if unknown:
        raise MeasurementError(f"unknown condition {unknown[0]!r}: conditions are {', '.join(conditions.CONDITIONS)}")
    robot, nominal, urdf, data, folder = _open_robot(name, base, tip)
    arm, notes = robot.arm, []
    T_world_base = _base(robot, tracker, notes)
    place = frames.inverse(T_world_base)[:3, 3]
    reflectors = _reflectors(robot, targets, place)
    on = tuple(item for item in conditions.CONDITIONS if item not in without)
    if reflectors.directions is None and "acceptance" in on:
        notes.append(
            "the reflectors' directions are not known: the condition acceptance is off (--targets FILE with nx, ny, nz)"
        )
    thesis_robot = conditions.has_thesis_cube(arm)
    heights = IRB1600_HEIGHTS if heights is None and thesis_robot else heights
    solids = None
    if conditions.SOLID & set(on):
        from irbcal.planning.collisions import CollisionModel

        solids = CollisionModel(data, arm, package_dirs=robots.package_dirs(*package_dirs, folder))
        if np.linalg.norm(place) < NEAR_TRACKER:
            raise MeasurementError(
                f"--tracker: expected a place at least {NEAR_TRACKER / MM:.0f} mm from the base link, found "
                f"{np.linalg.norm(place) / MM:.0f} mm"
            )
        solids.add_obstacle(place, TRACKER_RADIUS)
        if solids.overlapping:
            pairs = ", ".join(" and ".join(pair) for pair in solids.overlapping)
            notes.append(f"links that overlap by construction are not checked against each other: {pairs}")
    setting = conditions.Setting(robot, reflectors, place, on, margin, acceptance, heights, solids)
    return Scene(
        str(name), (base, tip), setting, nominal, T_world_base, cube or _cube(setting), _joint_speed(urdf), notes
    )


def _open_robot(name, base, tip):
    if Path(name).is_dir():
        folder = calibration_folder.read(name)
        saved, data = folder.record, folder.urdf
        section = saved.robot
        urdf = urdf_module.from_bytes(data, f"URDF of {section.name}", section.base_link, section.tip_link)
        return saved.robot_calibrated(), saved.arm(calibrated=False), urdf, data, Path(name)
    path = robots.robot_file(name)
    data = path.read_bytes()
    urdf = urdf_module.from_bytes(data, str(path), base, tip)
    return Robot(urdf.arm), urdf.arm, urdf, data, path.parent


def _base(robot, tracker, notes):
    """The base link in the frame of the expected coordinates."""
    if tracker is not None:
        x, y, z, yaw = [*tracker, 0.0][:4]
        return frames.inverse(frames.from_xyz_angles([x, y, z, 0.0, 0.0, yaw]))
    if robot.targets:
        notes.append("no --tracker given: it is taken to stand where it stood for the calibration's measurements")
        return robot.T_world_base
    T = np.array(cell.T_TRACKER_BASE)
    T[:3, 3] *= cell.size_of(robot.arm)
    x, y, z = frames.inverse(T)[:3, 3] / MM
    notes.append(
        f"no --tracker given: it is taken to stand at {x:.0f}, {y:.0f}, {z:.0f} mm in the base link; "
        "the expected coordinates hold for that place and turn only"
    )
    return T


def _reflectors(robot, wanted, place):
    own = robot.targets
    if wanted is None and own:
        return conditions.Targets(tuple(own), np.array(list(own.values())))
    found = read_targets(wanted) if wanted is not None and Path(wanted).is_file() else None
    if found is None:
        found = _thesis_targets(robot.arm, "3" if wanted is None else str(wanted), place)
    if not own:
        return found
    missing = [name for name in found.names if name not in own]
    if missing:
        raise MeasurementError(f"unknown target {missing[0]!r}: this calibration has {', '.join(own)}")
    return conditions.Targets(found.names, [own[name] for name in found.names], found.directions)


def _thesis_targets(arm, wanted, place):
    """Reflectors of the thesis's tool; those on the front look at the tracker when the arm is at home."""
    home = arm.forward(conditions.home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (place - home[:3, 3])
    tool = cell_tool.thesis_tool(look, cell.size_of(arm))
    names = tool.names if wanted == "thesis" else tuple(dict.fromkeys(part.strip() for part in wanted.split(",")))
    if wanted.isdigit() and 1 <= int(wanted) <= len(tool.names):
        names = tool.names[: int(wanted)]
    unknown = [name for name in names if name not in tool.names]
    if unknown:
        raise MeasurementError(
            f"unknown target {unknown[0]!r}: expected a file, a number from 1 to {len(tool.names)} or names of "
            f"{', '.join(tool.names)}"
        )
    tool = tool.only(names)
    return conditions.Targets(tool.names, tool.cad, tool.direction)


def read_targets(path):
    """Read a file of reflectors.

    Columns ``target``, ``x_mm``, ``y_mm``, ``z_mm`` (in the tip link) and, at will, ``nx``, ``ny``, ``nz``: where they
    look.

    Returns
    -------
    Targets

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    places = lists.read_targets(path)
    raw, source, _ = columns.read(path, ["target"])
    given = [name for name in DIRECTIONS if name in raw.columns]
    if not given:
        return conditions.Targets(tuple(places), np.array(list(places.values())))
    if len(given) < 3:
        missing = ", ".join(name for name in DIRECTIONS if name not in given)
        raise MeasurementError(f"{source}: row 1: missing column {missing}; a direction needs nx, ny, nz")
    looks = np.column_stack([columns.numbers(raw, name, source, "a part of a direction") for name in DIRECTIONS])
    short = np.linalg.norm(looks, axis=1) < 1e-6
    if short.any():
        row = raw.index[np.flatnonzero(short)[0]]
        raise MeasurementError(f"{source}: row {row}, columns nx, ny, nz: expected a direction, found zero length")
    return conditions.Targets(tuple(places), np.array(list(places.values())), looks)


def _cube(setting):
    lower, upper = setting.bounds

    def keep(q):
        good = ((q >= lower) & (q <= upper)).all(axis=1)
        return good if setting.heights is None else good & setting.high(*setting.places(q)[:2])

    return conditions.iso_cube(setting.arm, keep)


def _joint_speed(urdf):
    limits = {
        joint.get("name"): joint.find("limit").get("velocity")
        for joint in urdf.tree.getroot().findall("joint")
        if joint.find("limit") is not None
    }
    usual = np.where(urdf.arm.table.prismatic, USUAL_SPEED[1], USUAL_SPEED[0])
    found = np.array([float(limits.get(name) or 0.0) for name in urdf.arm.joint_names])
    return np.where(found > 0, found, usual)


# --- the plan ------------------------------------------------------------------------------------------------


def make(scene, wish, step=None):
    """Make a plan.

    Parameters
    ----------
    scene : Scene
    wish : Wish
    step : callable, optional
        Called with a text at the beginning of each step.

    Returns
    -------
    Made

    Raises
    ------
    IrbcalError
        If the wish cannot be met; the sentence counts what each condition removed.
    """
    step = step or (lambda text: None)
    setting = scene.setting
    if wish.axis not in (0, conditions.FEW, conditions.MANY):
        raise MeasurementError(f"expected {conditions.FEW}, {conditions.MANY} or 0 axis moves, found {wish.axis}")
    if not (wish.axis or wish.cube or wish.all_range or wish.optimal):
        raise MeasurementError("the plan has no poses: ask for axis moves, cube, all-range or optimal poses")
    if wish.volume not in VOLUMES:
        raise MeasurementError(f"unknown volume {wish.volume!r}: choose one of {', '.join(VOLUMES)}")
    model = design.Model(scene.nominal, setting.targets, wish.level or default_level(scene.nominal), wish.noise)
    seeds = [int(k) for k in np.random.SeedSequence(wish.seed).generate_state(6)]
    inside = conditions.in_cube(*scene.cube)
    parts, tallies = [], {}
    if wish.axis:
        step("axis moves")
        parts.append(conditions.axis_moves(setting, wish.axis == conditions.MANY))
        tallies["axis"] = parts[0].tally
    for count, group, region, seed in (
        (wish.cube, "iso_cube", inside, seeds[0]),
        (wish.all_range, "all_range", None, seeds[1]),
    ):
        if count:
            step(f"{count} poses, {group}")
            parts.append(conditions.random_poses(setting, count, group, seed, region))
            tallies[group] = parts[-1].tally
    samples, comparison = _samples(scene, seeds[4:], step), None
    if wish.optimal:
        chosen, comparison = _optimal(scene, wish, model, parts, samples, seeds[2:4], tallies, step)
        parts.append(chosen)
    step("order")
    start = conditions.home_joints(setting.arm)
    q, asked, groups, over_home, notes = _in_order(scene, wish, parts, start)
    step("prediction")
    prediction = design.predict(model, q, asked)
    first = prediction.model.targets.names[0]
    std = {name: prediction.position_std(places, first) for name, places in samples.items()}
    stops = _stops(scene, wish, q, asked, start, over_home)
    notes = [*scene.notes, *notes]
    return Made(scene, wish, q, asked, groups, over_home, tallies, prediction, std, stops, comparison, notes)


def _samples(scene, seeds, step):
    """Poses of cube and range where predicted positions are looked at, whether the tracker sees them or not."""
    step("the workspace")
    wide = replace(scene.setting, conditions=tuple(set(scene.setting.conditions) & {"limits", "height", "collision"}))
    regions = {"cube": conditions.in_cube(*scene.cube), "range": None}
    return {
        name: conditions.random_poses(wide, VOLUME_SAMPLES, name, seed, region).q
        for (name, region), seed in zip(regions.items(), seeds, strict=True)
    }


def _optimal(scene, wish, model, parts, samples, seeds, tallies, step):
    half = wish.candidates // 2
    pools = []
    for count, group, region, seed in (
        (half, "iso_cube", conditions.in_cube(*scene.cube), seeds[0]),
        (wish.candidates - half, "all_range", None, seeds[1]),
    ):
        step(f"{count} candidates, {group}")
        pools.append(conditions.random_poses(scene.setting, count, group, seed, region))
        tallies[f"candidates, {group}"] = pools[-1].tally
    pool = _joined(pools)
    asked = conditions.first_seen(pool.seen, MOST_REFLECTORS)
    step(f"{wish.optimal} poses of {len(pool.q)} candidates")
    imagined = wish.imagined if wish.criterion == "position" else 0.0
    cared_for = np.concatenate([samples[name] for name in samples if wish.volume in ("both", name)])
    most = int(np.argmax(asked.sum(axis=0)))
    aim = model.aim(wish.criterion, cared_for, most, imagined)
    for part in parts:
        there = conditions.first_seen(part.seen, MOST_REFLECTORS)
        aim = aim.with_given(model.candidates(part.q, there, imagined))
    rated = model.candidates(pool.q, asked, imagined)
    found = design.exchange(rated, wish.optimal, aim)
    step("random plans to compare with")
    comparison = design.compare(rated, found, aim, seeds[0])
    chosen = pool.take(found.rows)
    groups = np.array([f"optimal_{group}" for group in chosen.groups], dtype=object)
    return conditions.Poses(chosen.q, chosen.seen, groups, conditions.Tally()), comparison


def _joined(parts):
    return conditions.Poses(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "seen", "groups")),
        conditions.Tally(),
    )


def _in_order(scene, wish, parts, start):
    """Axis moves first, as they are; then all others on a short way."""
    setting, notes = scene.setting, []
    axis = parts[:1] if wish.axis else []
    others = parts[len(axis) :]
    done = list(axis)
    if axis:
        notes += _axis_notes(setting, axis[0])
    over_home = np.zeros(sum(len(part.q) for part in axis), dtype=bool)
    if others:
        rest, over, blocked = conditions.ordered(
            setting, _joined(others), axis[0].q[-1] if axis else start, scene.joint_speed
        )
        done.append(rest)
        if over.any():
            notes.append(f"to {int(over.sum())} poses the robot goes over its home joints: the direct way is not free")
        if blocked.any():
            numbers = [str(len(over_home) + k + 1) for k in np.flatnonzero(blocked)]
            more = " …" if len(numbers) > 8 else ""
            notes.append(f"the way to pose {', '.join(numbers[:8])}{more} is not free: put a pose between by hand")
        over_home = np.append(over_home, over)
    poses = _joined(done)
    return poses.q, conditions.first_seen(poses.seen, MOST_REFLECTORS), poses.groups, over_home, notes


def _axis_notes(setting, axis):
    notes = []
    _, points, looks = setting.places(axis.q)
    if looks is not None:
        away = cell_tool.turned_away(points, looks, setting.place, setting.acceptance)
        count = int((axis.seen & away).any(axis=1).sum())
        if count:
            notes.append(f"in {count} of {len(axis.q)} axis moves a reflector must be turned to the tracker by hand")
    if setting.heights is not None:
        tip, points, _ = setting.places(axis.q)
        low = ~setting.high(tip, points)
        if low.any():
            notes.append(
                f"axis moves below the height limits, which hold for random poses only: {int(low.sum())}, down to z = "
                f"{points[low][..., 2].min() / MM:.0f} mm; see that nothing stands there"
            )
    return notes


def _stops(scene, wish, q, asked, start, over_home):
    """When the robot stands still in each pose: at the speed of the slowest joint or of the tip."""
    before = np.concatenate([start[None], q[:-1]])
    home = np.broadcast_to(start, q.shape)
    direct = _move_times(scene, wish, before, q)
    around = _move_times(scene, wish, before, home) + _move_times(scene, wish, home, q)
    hold = wish.wait_s + READINGS_S * (asked.sum(axis=1) + wish.references)
    return np.cumsum(np.where(over_home, around, direct) + np.concatenate([[0.0], hold[:-1]]))


def _move_times(scene, wish, q_from, q_to):
    way, starts = route.between(q_from, q_to, scene.setting.arm.table.prismatic)
    tip = scene.setting.places(way)[0]
    pieces = np.append(np.linalg.norm(np.diff(tip, axis=0), axis=1), 0.0)
    pieces[starts[1:] - 1] = 0.0
    by_joint = route.move_times(q_from, q_to, scene.joint_speed)
    return np.maximum(by_joint, np.add.reduceat(pieces, starts) / wish.speed)
