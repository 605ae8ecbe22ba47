"""Chapter 7 of Nubiola 2011 over again in the virtual cell: many calibrations, and what each is worth.

A `Stage` is one measuring campaign, the same for all; a `Repetition` is one calibration from it and its tests. It
depends on the settings and its own seed alone, so that any of them can be run again by itself::

    settings = study.Settings()
    stage = study.Stage.of(settings)
    rows, series = study.run(stage, study.Repetition("34", 120, 3))

All data are simulated. Lengths are metres inside, millimetres and degrees in the rows.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from irbcal.cell import procedure, simulation
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification.axes import calibrate_by_axes
from irbcal.identification.methods import identify_by
from irbcal.measurement.points import distances
from irbcal.measurement.statistics import statistics
from irbcal.modeling import frames
from irbcal.modeling.inverse import calibrated_arm, closed_form
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM
from irbcal.validation import accuracy
from irbcal.validation.comparison import replace_geometry

AREAS, PAYLOADS = procedure.AREAS, (3, 6)
TARGETS = {"1": ("smr1",), "1-3": procedure.IDENTIFIED, "4-8": procedure.VERIFIED[3:], "1-8": procedure.VERIFIED}
"""Sets of targets that expected errors are given for."""

METHODS = {
    "least-squares": {},
    "nelder-mead": {"method": "nelder-mead"},
    "max": {"objective": "max"},
}
"""Ways to identify, and what `identify_by` calls them."""
MODELS = ("11", "16", "26", "34")
FEWEST, FEWEST_POINTS = 20, 520
MOST = 100_000

MOVES = {
    18: [range(-30, 31, 30)] * 6,
    54: [range(-40, 41, 10)] * 6,
    102: [[*range(-40, 41, 10), *range(30, -41, -10)]] * 6,
    158: [[*range(-40, 41, 10), *range(30, -41, -10)]] * 5 + [[*range(-180, 181, 10), *range(170, -181, -10)]],
}
"""Number of axis points -> angles of joints 1 to 6, degrees, the others at zero (sections 7.2, 7.5 and 7.7)."""

ISO_POSES = np.array(
    [
        [0.0, -14.0, 14.0, 0.0, 0.0, 0.0],
        [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
        [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
        [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
        [41.373, -24.788, 47.145, 66.643, -46.052, -58.108],
    ]
)
"""P1 to P5 of Table A I-1, degrees."""
CYCLES = 30

SPHERE_CENTRE, SPHERE_DIAMETER, SPHERE_POINTS = np.array([845.7, 200.0, 965.7]) * MM, 400.0 * MM, 434
"""Of the relative analyses, in the base link (section 7.7.3.6)."""
SPHERE_TURN = 20.0 * DEG
"""Largest turn of the tool from its orientation at zero joints there."""

COURSE_UNUSED = 20
"""Points in each area that the course of the search is watched on (section 7.5)."""

PERCENTILES = (5, 25, 50, 75, 95)
COLUMNS = (
    *("repetition", "model", "measures", "index", "seed", "method", "kind", "area", "payload_kg", "targets"),
    *("quantity", "unit", "n", "mean", "sigma", "max", "mean_plus_3sigma", "rms"),
    *(f"p{p}" for p in PERCENTILES),
    "objective_mm",
)
"""Columns of a row.

``kind``: ``expected`` (the model against measured poses, section 7.6), ``verified`` (fake targets, measured),
``verified_all`` (the same with all verification poses), ``poses`` (fake targets, measured with targets 1 to 3),
``iso9283``, ``sphere_virtual_frame`` and ``sphere_three_points``. ``quantity``: ``point``, ``flange``,
``orientation``. ``objective_mm``: largest distance of the measurements that the calibration was made from.
"""


@dataclass(frozen=True)
class Settings:
    """What a study consists of.

    Parameters
    ----------
    procedures : tuple of int
        Numbers of identification measurements (section 7.7.5).
    each : int
        Calibrations for each of these numbers and each of the curve's.
    curve : tuple of int
        Numbers of measurements for the error against the number of measurements.
    model : str
        Level of all of them.
    method : str
        One of `METHODS`.
    points : int
        Verification points in each area and with each payload. Three eighths as many are there to choose the
        identification from, an eighth is verified with fake targets: as in the thesis with 8,000.
    seed : int

    Raises
    ------
    IdentificationError, MeasurementError
        If the settings make no study.
    """

    procedures: tuple = (80, 120, 180, 200)
    each: int = 5
    curve: tuple = (20, 30, 40, 60, 80, 120, 200, 400, 1000)
    model: str = "34"
    method: str = "nelder-mead"
    points: int = 8000
    seed: int = 0

    def __post_init__(self):
        for name in ("procedures", "curve"):
            object.__setattr__(self, name, tuple(sorted({int(n) for n in getattr(self, name)})))
        for value, allowed, what in ((self.model, MODELS, "model"), (self.method, METHODS, "method")):
            if value not in allowed:
                raise IdentificationError(f"unknown {what} {value!r}: choose one of {', '.join(allowed)}")
        if not self.procedures:
            raise MeasurementError("a study needs at least one number of identification measurements")
        if not FEWEST_POINTS <= self.points <= MOST:
            raise MeasurementError(f"expected {FEWEST_POINTS} to {MOST} verification points, found {self.points}")
        if not 1 <= self.each <= 1000:
            raise MeasurementError(f"expected 1 to 1000 calibrations of each size, found {self.each}")
        if self.seed < 0:
            raise MeasurementError(f"expected a seed of 0 or more, found {self.seed}")
        for n in (*self.procedures, *self.curve):
            if n < FEWEST or max(shares(n)[1:]) > self.pool:
                raise MeasurementError(
                    f"{n} identification measurements: expected {FEWEST} to {2 * self.pool}, for {self.points} "
                    f"verification points come with {self.pool} points in each area to choose from"
                )

    @property
    def pool(self):
        """Points in each area that the identification is chosen from."""
        return 3 * self.points // 8

    @property
    def verified(self):
        """Poses in each area that are verified with fake targets."""
        return self.points // 8

    def document(self):
        """The settings as a dict for JSON."""
        return asdict(self) | {"procedures": list(self.procedures), "curve": list(self.curve)}


@dataclass(frozen=True)
class Repetition:
    """One calibration of a study.

    Parameters
    ----------
    model : str
        A level of `MODELS`; ``nominal`` (base and tool only), ``axes`` (directly from axis points) or ``course`` (a
        level-34 search that is watched, section 7.5).
    measures : int
        Measurements it is made from.
    index : int
        From 1, among those of the same size.
    """

    model: str
    measures: int = 0
    index: int = 1

    @property
    def name(self):
        """Unique in a study, fit for a file name."""
        return self.model if self.model == "nominal" else f"{self.model}-{self.measures}-{self.index}"

    def seed(self, settings):
        """The seed of this repetition: of the choice of measurements and of its own runs in the cell."""
        sequence = np.random.SeedSequence([settings.seed, self.measures, self.index])
        return int(sequence.generate_state(1)[0])


NOMINAL, AXES = Repetition("nominal"), {n: Repetition("axes", n) for n in MOVES}
FULL, SMALL = Repetition("34", 200), Repetition("11", 400)
"""The calibrations of Tables 7.4 and 7.6: the first choice, where the thesis shows one of the best."""
COURSE = Repetition("course", 140)


def procedures(settings):
    """The repetitions of the procedures (Table 7.13), size by size."""
    return [Repetition(settings.model, n, k + 1) for n in settings.procedures for k in range(settings.each)]


def curve(settings):
    """The repetitions of the error against the number of measurements."""
    return [Repetition(settings.model, n, k + 1) for n in settings.curve for k in range(settings.each)]


def repetitions(settings):
    """All repetitions of a study, each once, in a fixed order."""
    every = [NOMINAL, *AXES.values(), FULL, SMALL, *procedures(settings), *curve(settings), COURSE]
    return list(dict.fromkeys(every))


def shares(measures):
    """How many measurements are axis points, in the ISO cube and in the whole range.

    The thesis's own shares for 120, 140, 200 and 400: 18, 54, 54, 54 axis points and a few more of the rest in the
    cube. Fewer than 60 measurements leave no room for axis points.
    """
    axes = 54 if measures >= 140 else 18 if measures >= 60 else 0
    cube = (measures - axes + axes // 9 + 1) // 2
    return axes, cube, measures - axes - cube


# --- the campaign -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stage:
    """What all repetitions of a study share.

    Attributes
    ----------
    settings : Settings
    cell : Cell
        Eight targets; the poses were chosen so that the tracker sees them.
    first : Robot
        Base and tool from moves of one joint (sections 3.2 and 3.4.2).
    axes : dict of int to PointSet
        Number of axis points -> the points, of target 1.
    identification : dict of str to PointSet
        Area -> measured points of targets 1 to 3.
    verification : dict of int to dict of str to PointSet
        Payload (kg) -> area -> measured points of targets 1 to 8.
    commanded : dict of str to tuple
        Area -> joints (n, 6) and target (n,) of the verification.
    whole : dict of str to ndarray, shape (n, 6)
        Area -> joints at which targets 1 to 3 are all in sight.
    sphere : tuple
        Joints (n, 6) and target (n,) of the relative analyses.
    """

    settings: Settings
    cell: object
    first: Robot
    axes: dict
    identification: dict
    verification: dict
    commanded: dict
    whole: dict
    sphere: tuple

    @classmethod
    def of(cls, settings):
        """Draw the poses of a study and measure them."""
        cell = simulation.open_cell("irb1600", seed=settings.seed)
        poses = procedure.campaign(cell, settings.pool, settings.points, settings.seed)
        measured = procedure.measure(cell, poses)
        for area in AREAS:
            wanted = max(max(shares(r.measures)[1:]) for r in repetitions(settings))
            if measured.identification[area].poses < wanted:
                raise MeasurementError(
                    f"{measured.identification[area].poses} identification points were seen in {area}, {wanted} are "
                    "needed: ask for more verification points or for smaller procedures"
                )
        heavy = procedure.measure(cell.with_payload(PAYLOADS[1]), poses).verification
        three = cell.with_targets(procedure.IDENTIFIED)
        whole = {
            area: procedure.random_poses(three, settings.verified, [settings.seed, 2, k], where)
            for k, (area, where) in enumerate(zip(AREAS, (procedure.in_cube, procedure.in_range), strict=True))
        }
        cell = cell.with_targets(procedure.VERIFIED).without("visibility")
        return cls(
            settings,
            cell,
            by_axes(cell, measured),
            {n: measured.axes if n == 54 else _axis_points(cell, n) for n in MOVES},
            measured.identification,
            dict(zip(PAYLOADS, (measured.verification, heavy), strict=True)),
            poses.verification,
            whole,
            sphere_poses(cell.arm, settings.seed),
        )


def _axis_points(cell, count):
    """Moves of one joint at a time, seen at target 1."""
    joints = [angle * DEG * np.eye(6)[j] for j, angles in enumerate(MOVES[count]) for angle in angles]
    groups = [f"axis{j + 1}" for j, angles in enumerate(MOVES[count]) for _ in angles]
    return cell.with_targets(["smr1"]).measure(np.array(joints), run=100 + count).points(groups)


def sphere_poses(arm, seed):
    """Random places in the sphere of section 7.7.3.6, the tool turned a little from where it is at zero joints.

    Returns
    -------
    q : ndarray, shape (n, 6)
        Of the configurations the one nearest to zero joints, radians.
    target : ndarray of int, shape (n,)
        Of the eight.
    """
    rng = np.random.default_rng([seed, 3])
    home = arm.forward(np.zeros((1, 6)))[0]
    places = rng.uniform(-1.0, 1.0, (4 * SPHERE_POINTS, 3))
    places = places[np.linalg.norm(places, axis=1) <= 1.0][:SPHERE_POINTS]
    T = np.tile(home, (SPHERE_POINTS, 1, 1))
    T[:, :3, 3] = SPHERE_CENTRE + SPHERE_DIAMETER / 2 * places
    turns = rng.standard_normal((SPHERE_POINTS, 3))
    turns *= SPHERE_TURN * rng.uniform(0, 1, (SPHERE_POINTS, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    T[:, :3, :3] = [home[:3, :3] @ frames.rotation_from_vector(v) for v in turns]
    q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), np.zeros(6))
    if (branch < 0).any():
        raise MeasurementError("the robot does not reach the sphere of the relative analyses")
    return q, rng.integers(0, len(procedure.VERIFIED), SPHERE_POINTS)


# --- one calibration --------------------------------------------------------------------------------------


def by_axes(cell, measured):
    """The robot that the moves of single joints give: base, tool and links."""
    return calibrate_by_axes(cell.arm, measured.moves).robot


def nominal(cell, robot):
    """The nominal robot with base from axes 1 and 2 and tool from axes 5 and 6 (sections 3.2, 3.4.2 and 5.4.1)."""
    return Robot(cell.arm, T_world_base=robot.T_world_base, targets=robot.targets)


def choice(axes, areas, counts, seed):
    """Identification measurements: axis points and a random choice of the others.

    Parameters
    ----------
    axes : PointSet or None
    areas : dict of str to PointSet
    counts : sequence of int
        In each area.
    seed : int

    Returns
    -------
    PointSet
    """
    rng = np.random.default_rng(seed)
    parts = [procedure.drawn(areas[area], count, rng) for area, count in zip(AREAS, counts, strict=True)]
    return procedure.joined(*([] if axes is None else [axes]), *parts)


def fitted(arm, points, level, targets, **options):
    """Fit of a level with the targets as the tool was calibrated; options as `identify_by`."""
    known = {name: targets[name] for name in points.target_names}
    return identify_by(arm, points, level, known_targets=known, **options)


def identify(stage, repetition):
    """The calibrations of a repetition.

    Returns
    -------
    models : list of tuple
        Method, robot with all targets, largest distance of the measurements it was made from (m). The method of the
        settings comes first; where it starts from least squares, these come second.
    watched : DataFrame or None
        Course of the search, for `COURSE`.
    """
    arm, first = stage.cell.arm, stage.first
    if repetition == NOMINAL:
        points = stage.axes[54]
        robot = nominal(stage.cell, first)
        return [("", robot, distances(robot, points).max())], None
    if repetition.model == "axes":
        points = stage.axes[repetition.measures]
        known = {name: first.targets[name] for name in points.target_names}
        robot = calibrate_by_axes(arm, points, known_targets=known).robot.replace(targets=first.targets)
        return [("axes", robot, distances(robot, points).max())], None
    axes, *counts = shares(repetition.measures)
    seed = repetition.seed(stage.settings)
    level, method, watched = repetition.model, stage.settings.method, None
    if repetition == COURSE:
        level, method = "34", "nelder-mead"
        watched, areas = _set_aside(stage.identification, seed)
    else:
        areas = stage.identification
    points = choice(stage.axes.get(axes), areas, counts, seed)
    fit = fitted(arm, points, level, first.targets, watched=watched, **METHODS[method])
    models = [(method, fit)] + ([] if fit.least_squares is None else [("least-squares", fit.least_squares)])
    found = [(name, f.robot, distances(f.robot, points).max()) for name, f in models]
    return (
        [(name, robot.replace(targets=first.targets), largest) for name, robot, largest in found],
        fit.history.to_frame() if watched else None,
    )


def _set_aside(areas, seed):
    """A few points of each area that take no part in the search, and the rest."""
    rng, watched, rest = np.random.default_rng([seed, 1]), {}, {}
    for area, points in areas.items():
        aside = np.zeros(points.poses, dtype=bool)
        aside[rng.permutation(points.poses)[:COURSE_UNUSED]] = True
        watched[area], rest[area] = points.select(aside), points.select(~aside)
    return watched, rest


# --- and what it is worth ---------------------------------------------------------------------------------


def run(stage, repetition, tests=True):
    """Calibrate and test.

    Parameters
    ----------
    stage : Stage
    repetition : Repetition
    tests : bool
        Without, expected errors only.

    Returns
    -------
    rows : list of dict
        With `COLUMNS`.
    series : dict of str to ndarray
        Errors one by one, mm and degrees, under ``kind/area/payload/quantity``, and the course of the search under
        ``course/…``.
    """
    models, course = identify(stage, repetition)
    rows, series = [], {}
    common = asdict(repetition) | {"repetition": repetition.name, "seed": repetition.seed(stage.settings)}
    for method, robot, largest in models:
        rest = common | {"method": method, "objective_mm": largest / MM}
        for key, values, unit in _expected(stage, robot):
            rows.append(rest | _row(key, values, unit))
    if course is not None:
        return rows, {f"course/{name}": course[name].to_numpy() for name in course if name != "seconds"}
    if not tests:
        return rows, series
    method, robot, largest = models[0]
    rest = common | {"method": method, "objective_mm": largest / MM}
    for key, values, unit in _tests(stage, robot, repetition):
        rows.append(rest | _row(key, values, unit))
        series["/".join(str(part) for part in (*key[:3], key[4]))] = (values / unit).astype(np.float32)
    return rows, series


def _row(key, values, unit):
    """Statistics of errors as a row; NaN for what was not seen."""
    values = values[np.isfinite(values)].ravel() / unit
    found = statistics(values * MM)  # of plain numbers: those of angles are in degrees
    row = dict(zip(("kind", "area", "payload_kg", "targets", "quantity"), key, strict=True))
    row |= {"unit": "mm" if unit == MM else "deg", "n": found["n"]}
    row |= {name: found[f"{name}_mm"] for name in ("mean", "sigma", "max", "mean_plus_3sigma", "rms")}
    return row | {f"p{p}": value for p, value in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)}


def _expected(stage, robot):
    """Errors of the model at measured poses, for each area, payload and set of targets."""
    for load in PAYLOADS:
        for area in AREAS:
            points = stage.verification[load][area]
            distance, names = distances(robot, points), points.names()
            for targets, members in TARGETS.items():
                yield ("expected", area, load, targets, "point"), distance[np.isin(names, members)], MM


def _tests(stage, robot, repetition):
    """Errors of what the robot does with fake targets."""
    bench = _Bench(stage, robot, 100 * repetition.seed(stage.settings))
    few = stage.settings.verified
    for load in PAYLOADS:
        for area in AREAS:
            q, which = stage.commanded[area]
            points = bench.measured(q[:few], _asked(which[:few]), load)
            yield ("verified", area, load, "1-8", "point"), distances(bench.meant, points), MM
    load = PAYLOADS[0]
    if repetition == FULL:
        for area in AREAS:
            q, which = stage.commanded[area]
            points = bench.measured(q, _asked(which), load)
            yield ("verified_all", area, load, "1-8", "point"), distances(bench.meant, points), MM
    for area in AREAS:
        errors = accuracy.tip_errors(bench.meant, bench.measured(stage.whole[area], None, load))
        yield ("poses", area, load, "1-3", "flange"), errors.position, MM
        yield ("poses", area, load, "1-3", "orientation"), errors.rotation, DEG
    yield from _iso(bench, load)
    points = bench.measured(stage.sphere[0], _asked(stage.sphere[1]), load)
    key = ("sphere", load, "1-8", "point")
    yield ("sphere_virtual_frame", *key), accuracy.relative_to_virtual_frame(bench.meant, points)[0], MM
    yield ("sphere_three_points", *key), accuracy.relative_to_three_points(bench.meant, points)[0], MM


def _asked(which):
    return which[:, None] == np.arange(len(procedure.VERIFIED))


def _iso(bench, load):
    """The five poses of Table A I-1 in 30 cycles from P5 to P1: errors by cycle and pose, shape (30, 5)."""
    order = np.tile([4, 3, 2, 1, 0], CYCLES)
    points = bench.measured(ISO_POSES[order] * DEG, None, load, thorough=True)  # P1 is at the wrist's singularity
    errors = accuracy.tip_errors(bench.meant, points)
    row = points.pose_ids[errors.pose] - 1
    for name, values, unit in (("flange", errors.position, MM), ("orientation", errors.rotation, DEG)):
        grid = np.full((CYCLES, 5), np.nan)
        grid[row // 5, order[row]] = values
        yield ("iso9283", "iso_poses", load, "1-3", name), grid, unit


class _Bench:
    """A calibrated robot whose fake targets are run in the cell (section 7.4).

    Attributes
    ----------
    meant : Robot
        Where the targets are wanted: the nominal arm on the calibration's base with its tool.
    """

    def __init__(self, stage, robot, run):
        self.cell, self.robot, self.run = stage.cell, robot, run
        self.meant = replace_geometry(robot, stage.cell.arm)

    def measured(self, q, asked, load, thorough=False):
        """Points of a run of fake targets, at the joints that were wanted; targets 1 to 3 where none are asked for.

        Poses without fake targets inside the joint limits are left out, as they are where they are real.
        """
        arm = self.cell.arm
        self.run += 1
        fake, reached = q, np.ones(len(q), dtype=bool)
        if self.robot.arm is not arm:
            found = calibrated_arm.solve(self.robot, arm, arm.forward(q), seed=q, thorough=thorough)
            fake, reached = found.joints, found.inside
        cell = self.cell if asked is not None else self.cell.with_targets(procedure.IDENTIFIED)
        seen = cell.with_payload(load).measure(fake[reached], None if asked is None else asked[reached], run=self.run)
        numbers = np.flatnonzero(reached) + 1
        points = seen.points()
        numbers = numbers[points.pose_ids - 1]
        return replace(points, q=q[numbers - 1], pose_ids=numbers)
