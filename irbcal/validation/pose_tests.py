"""From files to the criteria of ISO 9283: pose tests, stabilisation and paths, as `irbcal.validation.iso9283` has them.

The pose tests are a measurement file with the columns ``pose`` (P1 to P5, or any names) and ``cycle``. Where there is
a column ``group``, rows of ``iso9283`` are the cycles of pose accuracy and repeatability; rows with something in a
column ``direction`` (three directions of approach) are those of the multi-directional variation, and rows of the group
``iso9283_drift`` the sets of the drift test, in the order of the file.
"""

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.measurement import readings
from irbcal.measurement.poses import as_poses
from irbcal.measurement.statistics import rotation_statistics, statistics
from irbcal.modeling import frames
from irbcal.units import DEG, MM
from irbcal.validation import accuracy, iso9283
from irbcal.validation.prepared import prepare

GROUP, DRIFT = "iso9283", "iso9283_drift"
SET_SIZE = 10
"""Cycles of a set of the drift test."""

AXES, ANGLES = "xyz", "abc"


def evaluate(measurements, calibration=None, commanded=None, target=None, set_size=SET_SIZE):
    """Pose accuracy and repeatability, variation, distance and drift.

    Parameters
    ----------
    measurements : MeasurementSet
    calibration : Record, optional
        Gives the commanded poses at the file's joints, by the nominal and by the calibrated robot.
    commanded : str or Path, optional
        File of commanded poses: ``pose,x_mm,y_mm,z_mm`` and for orientations ``qw,qx,qy,qz``. With a calibration, poses
        of the tip in the base link; without, places of what was measured in the measuring frame.
    target : str, optional
        Regard the position of this target; by default the tip, where poses were measured as a whole.
    set_size : int
        Cycles of a set of the drift test.

    Returns
    -------
    dict
        ``models``: for each model (``nominal`` and ``calibrated``; ``measured`` without a calibration) ``poses``,
        ``overall``, ``distance``, ``directions``, ``drift``, ``history``; ``subject``; ``excluded``, ``notes``,
        ``simulated``. Lengths in mm, angles in degrees, along and about the axes of the base link (of the measuring
        frame without a calibration); None for what the file does not hold.

    Raises
    ------
    MeasurementError
        If the file has no cycles, a pose was measured once only, or a target or a commanded pose is missing.
    """
    _check_cycles(measurements)
    ready = prepare(measurements, calibration)
    if target is not None:
        if target not in ready.points.target_names:
            raise MeasurementError(
                f"{measurements.source}: no usable point of target {target}; targets are "
                f"{', '.join(ready.points.target_names)}"
            )
        ready = ready.keep(ready.points.names() == target)
    robots = {"measured": None}
    if calibration is not None:
        robots = {"nominal": calibration.robot_nominal(), "calibrated": calibration.robot_calibrated()}
    table = None if commanded is None else _commanded_table(commanded)
    whole = target is None and _whole(ready.points, robots, table)
    if not whole and target is None:
        counts = np.bincount(ready.points.target)
        ready = ready.keep(ready.points.target == int(np.argmax(counts)))
    models = {}
    for name, robot in robots.items():
        attained = _attained(ready, robot, whole)
        attained.command(robot, table)
        if robot is not None:
            attained.turn_to(robot.T_world_base)
        models[name] = _criteria(attained, set_size)
    subject = f"target {ready.points.names()[0]}"
    if whole:
        subject = "flange" if calibration else ("measured frame" if ready.points.oriented().any() else "all targets")
    return {
        "subject": subject,
        "models": models,
        "excluded": [vars(item) for item in ready.excluded],
        "notes": ready.notes,
        "simulated": measurements.simulated or bool(calibration and calibration.simulated),
    }


def _check_cycles(measurements):
    table, source = measurements.table, measurements.source
    if "cycle" not in table.columns:
        raise MeasurementError(f"{source}: row 1: missing column cycle: ISO 9283 repeats its poses in numbered cycles")
    used = ~measurements.is_reference()
    double = table[used].duplicated(["pose_index", "target"]).to_numpy()
    if double.any():
        row = table[used][double].iloc[0]
        raise MeasurementError(
            f"{source}: row {row['row']}, column cycle: pose {row['pose']} with target {row['target']} stands there "
            f"twice in cycle {row['cycle']}: number the cycles through, over directions and sets, too"
        )


def _commanded_table(path):
    table = readings.read(path, ("x_mm", "y_mm", "z_mm"), ("pose",))
    double = table["pose"].duplicated()
    if double.any():
        row = table[double].iloc[0]
        raise MeasurementError(f"{path}: row {row['row']}, column pose: {row['pose']} stands there more than once")
    return table


def _whole(points, robots, table):
    """Whether poses are measured as a whole and what was commanded is, too."""
    if table is not None and readings.rotations(table) is None:
        return False
    robot = next(iter(robots.values()))
    if robot is None:
        return bool(points.oriented().any()) or (table is None and _three(points))
    return bool(
        (points.oriented() & np.isin(points.names().astype(str), list(robot.target_rotations))).any()
    ) or _three(points)


def _three(points):
    return bool((np.bincount(points.pose) >= 3).any())


class _Attained:
    """What was reached, pose by pose and cycle by cycle, and what was commanded."""

    def __init__(self, ready, rows, xyz, rotation=None):
        self.source = ready.measurements.source
        self.q = ready.points.q[rows]
        self.pose = ready.points.pose_ids[rows].astype(str)
        self.group = ready.points.groups[rows].astype(str)
        self.cycle = ready.labels("cycle")[rows].astype(str)
        self.direction = ready.labels("direction")[rows].astype(str)
        self.time = ready.labels("time_s")[rows]
        self.order = _order(ready.measurements.table)[ready.number[rows]]
        self.target = str(ready.points.names()[0])
        self.xyz, self.rotation = xyz, rotation
        self.wanted = self.wanted_rotation = None

    def command(self, robot, table):
        """Set the commanded positions and orientations, where there are any."""
        if table is not None:
            missing = sorted(set(self.pose) - set(table["pose"]))
            if missing:
                raise MeasurementError(f"{table.attrs['source']}: there is no commanded pose {missing[0]}")
            rows = [list(table["pose"]).index(name) for name in self.pose]
            place, R = table[["x_mm", "y_mm", "z_mm"]].to_numpy()[rows] * MM, readings.rotations(table)
            T = np.tile(np.eye(4), (len(rows), 1, 1))
            T[:, :3, 3] = place
            if R is not None:
                T[:, :3, :3] = R[rows]
            if robot is None:
                self._want(T, None if R is None or self.rotation is None else T)
                return
            if self.rotation is None and R is None:
                raise MeasurementError(
                    f"{table.attrs['source']}: row 1: missing columns qw, qx, qy, qz: where a target on the tool is "
                    "commanded to be depends on the orientation"
                )
            T = robot.T_world_base @ T
        elif robot is None:
            return
        else:
            T = robot.T_world_base @ robot.poses(self.q)
        if self.rotation is None:
            T = T.copy()
            T[:, :3, 3] += T[:, :3, :3] @ robot.targets[self.target]
            self._want(T, None)
        else:
            self._want(T, T)

    def _want(self, T, oriented):
        self.wanted = T[:, :3, 3]
        self.wanted_rotation = None if oriented is None else oriented[:, :3, :3]

    def turn_to(self, T_world_base):
        """Everything in the base link: errors are then told along its axes."""
        T = frames.inverse(T_world_base)
        self.xyz, self.wanted = frames.apply(T, self.xyz), frames.apply(T, self.wanted)
        for name in ("rotation", "wanted_rotation"):
            if getattr(self, name) is not None:
                setattr(self, name, T[:3, :3] @ getattr(self, name))

    def select(self, rows):
        """The same for some rows."""
        out = object.__new__(_Attained)
        for name, value in vars(self).items():
            out.__dict__[name] = value[rows] if isinstance(value, np.ndarray) else value
        return out

    def angles(self):
        """Angles a, b, c from the commanded orientation, or from the mean one; None without orientations."""
        if self.rotation is None:
            return None
        about = self.wanted_rotation
        return iso9283.small_angles(self.rotation, iso9283.mean_rotation(self.rotation) if about is None else about)


def _order(table):
    """Which repetition of its pose in its group each pose of the file is, counted from 0, lost ones too."""
    first = table.drop_duplicates("pose_index").sort_values("pose_index")
    keys = [name for name in ("pose", "group") if name in table.columns]
    return first.groupby(keys).cumcount().to_numpy()


def _attained(ready, robot, whole):
    points = ready.points
    if not whole:
        return _Attained(ready, points.pose, points.xyz)
    source = ready.measurements.source
    if robot is not None:
        found = accuracy.tip_errors(robot, points, source)
        return _Attained(ready, found.pose, found.T_world_tip[:, :3, 3], found.T_world_tip[:, :3, :3])
    if points.oriented().any():
        rows = np.flatnonzero(points.oriented())
        return _Attained(ready, points.pose[rows], points.xyz[rows], points.rotation[rows])
    numbered = points.__class__(**{**vars(points), "pose_ids": np.arange(points.poses)})
    poses, _ = as_poses(numbered, source)
    return _Attained(ready, poses.pose_ids, poses.xyz, poses.rotation)


def _criteria(attained, set_size):
    grouped = (attained.group == GROUP).any()
    approached = attained.direction != ""
    drifting = attained.group == DRIFT
    plain = ~approached & ~drifting & ((attained.group == GROUP) | ~np.bool_(grouped))
    out = {"poses": {}, "overall": None, "distance": None, "directions": None, "drift": None, "history": None}
    if plain.any():
        cycles = attained.select(plain)
        out["poses"] = {name: _pose(cycles, name) for name in _in_order(cycles.pose)}
        out["overall"], out["history"] = _overall(cycles)
        out["distance"] = _distance(cycles)
    if approached.any():
        out["directions"] = _directions(attained.select(approached))
    if drifting.any():
        out["drift"] = _drift(attained.select(drifting), set_size)
    if not (plain.any() or approached.any() or drifting.any()):
        raise MeasurementError(f"{attained.source}: no usable row of the groups {GROUP} and {DRIFT}")
    return out


def _in_order(names):
    """Names as they come first, P1 to P5 in that order."""
    found = list(dict.fromkeys(names))
    return sorted(found) if set(found) <= set(iso9283.POSES) else found


def _mm(value):
    return float(value / MM)


def _pose(cycles, name):
    mine = cycles.select(cycles.pose == name)
    n = len(mine.xyz)
    if n < 2:
        raise MeasurementError(f"{cycles.source}: pose {name} was measured in one cycle only: repeatability needs two")
    repeatability, distance = iso9283.position_repeatability(mine.xyz)
    out = {
        "n": n,
        "AP_mm": None,
        "RP_mm": _mm(repeatability),
        "l_mean_mm": _mm(distance.mean()),
        "l_sigma_mm": _mm(distance.std(ddof=1)),
        "l_max_mm": _mm(distance.max()),
    }
    if mine.wanted is not None:
        # the joints, and so the commanded places, may differ between cycles by the readings' last digit
        shift = mine.xyz - mine.wanted
        total, axes = iso9283.pose_accuracy(shift, 0.0)
        out["AP_mm"] = _mm(total)
        out |= {f"AP_{axis}_mm": _mm(value) for axis, value in zip(AXES, axes, strict=True)}
    angles = mine.angles()
    if angles is not None:
        spread = iso9283.angle_repeatability(angles)
        out |= {f"RP_{a}_deg": float(value / DEG) for a, value in zip(ANGLES, spread, strict=True)}
        if mine.wanted_rotation is not None:
            mean = iso9283.angle_accuracy(angles)
            out |= {f"AP_{a}_deg": float(value / DEG) for a, value in zip(ANGLES, mean, strict=True)}
    return out


def _overall(cycles):
    """Errors of every pose and cycle (Table 7.8, figures 7.8 and 7.9): from the command, else from the pose's mean."""
    names = _in_order(cycles.pose)
    if cycles.wanted is not None:
        error = np.linalg.norm(cycles.xyz - cycles.wanted, axis=1)
    else:
        error = np.empty(len(cycles.xyz))
        for name in names:
            mine = cycles.pose == name
            error[mine] = iso9283.position_repeatability(cycles.xyz[mine])[1]
    turn = None
    if cycles.rotation is not None:
        about = cycles.wanted_rotation
        if about is None:
            means = {name: iso9283.mean_rotation(cycles.rotation[cycles.pose == name]) for name in names}
            about = np.array([means[name] for name in cycles.pose])
        turn = frames.rotation_distance(cycles.rotation, about)
    overall = {
        "from": "commanded" if cycles.wanted is not None else "mean",
        "position": statistics(error),
        "orientation": None if turn is None else rotation_statistics(turn),
    }
    history = {
        "pose": cycles.pose.tolist(),
        "cycle": cycles.cycle.tolist(),
        "position_mm": (error / MM).tolist(),
        "orientation_deg": None if turn is None else (turn / DEG).tolist(),
    }
    return overall, history


def _distance(cycles):
    """Between P2 and P4, in the cycles that have both."""
    parts = [cycles.select(cycles.pose == name) for name in ("P2", "P4")]
    common = [c for c in parts[0].cycle if c in set(parts[1].cycle)]
    if len(common) < 2:
        return None
    parts = [part.select(np.array([list(part.cycle).index(c) for c in common])) for part in parts]
    wanted = [None if part.wanted is None else part.wanted.mean(axis=0) for part in parts]
    total, spread = iso9283.distance_accuracy(*(part.xyz for part in parts), *wanted)
    return {
        "poses": ["P2", "P4"],
        "n": len(common),
        "AD_mm": None if total is None else _mm(total),
        "RD_mm": _mm(spread),
    }


def _directions(approached):
    out = {}
    for name in _in_order(approached.pose):
        mine = approached.select(approached.pose == name)
        ways = list(dict.fromkeys(mine.direction))
        if len(ways) < 2:
            raise MeasurementError(
                f"{approached.source}: column direction: pose {name} was approached from {ways[0]} only: the variation "
                "needs several directions (ISO 9283: three, perpendicular)"
            )
        means = np.array([mine.xyz[mine.direction == way].mean(axis=0) for way in ways])
        out[name] = {"directions": len(ways), "vAP_mm": _mm(iso9283.multidirectional_variation(means))}
        angles = mine.angles()
        if angles is not None:
            means = np.array([angles[mine.direction == way].mean(axis=0) for way in ways])
            out[name] |= {f"vAP_{a}_deg": float(np.ptp(means[:, k]) / DEG) for k, a in enumerate(ANGLES)}
    return out


def _drift(drifting, set_size):
    """Of the first pose of the group (P1)."""
    name = _in_order(drifting.pose)[0]
    mine = drifting.select(drifting.pose == name)
    rows = [np.flatnonzero(mine.order // set_size == k) for k in range(int(mine.order.max()) // set_size + 1)]
    rows = [k for k in rows if len(k) > set_size // 2 and len(k) > 1]  # lost points and an unfinished last set
    if len(rows) < 2:
        raise MeasurementError(
            f"{drifting.source}: group {DRIFT} has {len(mine.xyz)} cycles of {name}: drift needs two sets of {set_size}"
        )
    wanted = None if mine.wanted is None else mine.wanted.mean(axis=0)
    found = iso9283.drift([mine.xyz[k] for k in rows], wanted)
    out = {"pose": name, "sets": len(rows), "set_size": set_size, "n": [len(k) for k in rows]}
    out |= {f"{key}_mm": (value / MM).tolist() if np.ndim(value) else _mm(value) for key, value in found.items()}
    timed = (mine.time != "").all()
    out["time_s"] = [float(np.mean(mine.time[k].astype(float))) for k in rows] if timed else None
    return out


# --- stabilisation and paths ------------------------------------------------------------------------------


def read_approaches(path):
    """Approaches to a pose: columns ``time_s``, ``x_mm``, ``y_mm``, ``z_mm`` and, for several, ``run``.

    Returns
    -------
    dict of str to (time, xyz)
        Seconds (n,) and metres (n, 3) of each run.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or time does not go on.
    """
    table = readings.read_points(path, numbers=("time_s",))
    runs = table["run"].astype(str).str.strip() if "run" in table.columns else None
    out = {}
    for name in ["1"] if runs is None else list(dict.fromkeys(runs)):
        part = table if runs is None else table[runs == name]
        time = part["time_s"].to_numpy()
        back = np.flatnonzero(np.diff(time) <= 0)
        if len(back):
            raise MeasurementError(
                f"{path}: row {part['row'].iloc[back[0] + 1]}, column time_s: expected a later time than in the row "
                f"before, found {time[back[0] + 1]:g}"
            )
        out[str(name)] = time, part[["x_mm", "y_mm", "z_mm"]].to_numpy() * MM
    return out


def stabilisation(path, band, after=10.0, count=100):
    """Position stabilisation time and overshoot: the mean over the runs of a file (ISO 9283: three).

    Parameters
    ----------
    path : str or Path
        See `read_approaches`.
    band : float
        Limit band, metres.
    after, count
        See `irbcal.validation.iso9283.final_position`.

    Returns
    -------
    dict
        ``band_mm``, ``PSt_s`` (mean, None where a run never settled), ``overshoot_mm`` (largest), ``runs``.

    Raises
    ------
    MeasurementError
        As `read_approaches`, or if a run ends too early.
    """
    runs = {}
    for name, (time, xyz) in read_approaches(path).items():
        try:
            final = iso9283.final_position(time, xyz, after, count)
        except MeasurementError as error:
            raise MeasurementError(f"{path}: run {name}: {error}") from None
        found = iso9283.stabilisation(time, xyz, final, band)
        settled = np.isfinite(found.settled)
        runs[name] = {
            "PSt_s": found.time if settled else None,
            "first_entry_s": found.first_entry if np.isfinite(found.first_entry) else None,
            "settled_s": found.settled if settled else None,
            "overshoot_mm": _mm(found.overshoot) if np.isfinite(found.overshoot) else None,
            "time_s": time.tolist(),
            "distance_mm": (found.distance / MM).tolist(),
        }
    times = [run["PSt_s"] for run in runs.values()]
    over = [run["overshoot_mm"] for run in runs.values() if run["overshoot_mm"] is not None]
    return {
        "band_mm": _mm(band),
        "after_s": after,
        "PSt_s": None if None in times else float(np.mean(times)),
        "overshoot_mm": max(over) if over else None,
        "runs": runs,
    }


def path_accuracy(measured, commanded):
    """Path accuracy and repeatability from a file of sampled paths.

    Parameters
    ----------
    measured : str or Path
        Columns ``cycle``, ``x_mm``, ``y_mm``, ``z_mm`` in the order of the samples, optional ``qw,qx,qy,qz``.
    commanded : str or Path
        Points of the commanded path in order, in the same frame, likewise without ``cycle``.

    Returns
    -------
    dict
        ``AT_mm``, ``RT_mm``, ``planes``, ``cycles``; with orientations ``AT_a_deg`` ... ``RT_c_deg``.

    Raises
    ------
    MeasurementError
        If a file does not keep the format or the paths do not fit.
    """
    table, path = readings.read_points(measured, labels=("cycle",)), readings.read_points(commanded)
    if len(path) < 3:
        raise MeasurementError(f"{commanded}: a commanded path needs three points or more, found {len(path)}")
    place, turn = table[["x_mm", "y_mm", "z_mm"]].to_numpy() * MM, readings.rotations(table)
    rows = [np.flatnonzero(table["cycle"] == name) for name in dict.fromkeys(table["cycle"])]
    short = [k for k in rows if len(k) < 2]
    if short:
        raise MeasurementError(f"{measured}: row {table['row'][short[0][0]]}: a path needs two samples in each cycle")
    try:
        found = iso9283.path_errors(
            [place[k] for k in rows],
            path[["x_mm", "y_mm", "z_mm"]].to_numpy() * MM,
            None if turn is None else [turn[k] for k in rows],
            readings.rotations(path),
        )
    except MeasurementError as error:
        raise MeasurementError(f"{measured}: {error}") from None
    out = {
        "AT_mm": _mm(found.AT),
        "RT_mm": _mm(found.RT),
        "planes": len(found.planes),
        "planes_of": len(path),
        "cycles": len(rows),
    }
    if found.mean_angles is not None:
        for k, a in enumerate(ANGLES):
            out[f"AT_{a}_deg"] = float(np.abs(found.mean_angles[:, k]).max() / DEG)
            out[f"RT_{a}_deg"] = float(found.angle_repeatability[:, k].max() / DEG)
    out["along_mm"] = (_along(path[["x_mm", "y_mm", "z_mm"]].to_numpy())[found.planes]).tolist()
    out["mean_error_mm"] = (np.linalg.norm(found.mean, axis=1) / MM).tolist()
    out["repeatability_mm"] = (found.repeatability / MM).tolist()
    return out


def _along(points):
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
