"""Poses for a device in place of a tracker, and what each device would leave of a robot's position error.

The error model comes with its natural sizes as prior: the geometry alone, or also what model ``auto`` fits beside it
(gain, gravity, harmonics). Tool and features have next to none. In the terms of
`irbcal.planning.optimal_design`, which chooses among poses at features as it does among poses that a tracker sees.

Best are those that leave the least predicted error of positions over the whole range, for a robot whose joints err
beyond its geometry.

A calculation, no measurement (``irbcal plan --compare-devices``): the arm is uncertain by its natural sizes, each
device shows what its rows show with its noise, and the rest stays as it was. Twice: as if the geometry were all, and
with what model ``auto`` fits beside it (gain, gravity, harmonics of the joints).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd

from irbcal import safe_files
from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import term_sets
from irbcal.identification.feature_problem import TOOL, FeatureProblem, FeatureState, UnknownKey
from irbcal.identification.linear_model import Rows
from irbcal.io.opening import RobotLike, open_robot
from irbcal.measurement import features
from irbcal.measurement.features import FeatureSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import home_joints
from irbcal.modeling.terms import chain, families
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermModel
from irbcal.names import csv_bytes
from irbcal.option_values import MOST_POSES, Progress, checked, number
from irbcal.option_values import seed as check_seed
from irbcal.planning.conditions import Setting, counted
from irbcal.planning.optimal_design import (
    WAVES,
    Aim,
    Candidates,
    Chosen,
    DesignComparison,
    MeanSquaredError,
    compare,
    exchange,
)
from irbcal.planning.plan_options import PlanOptions
from irbcal.planning.route import shortest_order
from irbcal.planning.scene import Scene, open_scene
from irbcal.simulation import devices
from irbcal.simulation.devices import BALL, DEVICES, Device, Placed, drawn, placed, rows_table, values
from irbcal.simulation.devices import poses as device_poses
from irbcal.simulation.simulation_options import DeviceName
from irbcal.summary import Paragraph, Result, Table, remarks
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.planning.collisions import CollisionModel


SAMPLES = 300
"""Random poses on which the error that is left counts."""

FREE = 1e3
"""Tool and features: so many millimetres and milliradians, one standard deviation of what is known before."""


@dataclass(frozen=True, eq=False)
class Rated(Locked):
    """Poses as `irbcal.planning.optimal_design` takes them."""

    poses: Candidates
    aim: Aim
    """Mean squared error of positions over the whole range, m^2; known lengths are given."""

    def remaining(self, rows: IntArray | None = None) -> float:
        """Root mean square error of positions that some poses (all unless given) leave, metres."""
        those = slice(None) if rows is None else rows
        return float(np.sqrt(self.aim.value(self.poses.rows[those], self.poses.errors[those])))


class DeviceModel:
    """An arm with what is not known of it, and positions on which errors count.

    Parameters
    ----------
    arm : Arm
    seed : int
        Of random poses.
    wide : bool
        With gain, gravity and harmonics up to `irbcal.planning.optimal_design.WAVES` beside the geometry.
    prior : float, optional
        Root mean square position error from the geometry before anything is measured, metres; as its natural sizes
        make it unless given.
    """

    def __init__(self, arm: Arm, seed: int = 0, wide: bool = False, prior: float | None = None) -> None:
        self.arm, self.seed = arm, seed
        self.terms = _wide(arm) if wide else GEOMETRY.terms(arm)
        constant = np.array([term.family == "geometry" for term in self.terms], dtype=bool)
        self.sizes: FloatArray = np.array([term.size for term in self.terms])
        natural = self._spread()
        share = np.diagonal(natural)[3:]
        self.geometry = float(np.sqrt(share[constant].sum()))
        factor = np.where(constant, 1.0 if prior is None else prior / self.geometry, 1.0)
        self.sizes = self.sizes * factor
        self.G = natural * np.outer(np.r_[np.ones(3), factor], np.r_[np.ones(3), factor])
        self.geometry *= float(factor[constant][0])
        self.prior_error = float(np.sqrt(np.trace(self.G[3:, 3:])))
        """Root mean square position errors before anything is measured, from the geometry and from all, metres; how the
        arm stands does not count.
        """

    def _spread(self) -> FloatArray:
        """Mean products of what the tool's place and the terms, each in its size, do to positions, m^2."""
        q = self.arm.random_joints(SAMPLES, self.seed + 7)
        path = chain.walk(self.arm, q)
        p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], np.array(BALL))
        J = np.zeros((3 + len(self.terms), 3, SAMPLES))
        J[:3] = path.tip[:3] * FREE * MM
        model = TermModel(self.arm, self.terms)
        J[3:] = model.columns(path, partial(model.values, Motion(q)), p) * self.sizes[:, None, None]
        B = frames.by_motion(p.T)
        across = J.transpose(0, 2, 1).reshape(len(J), -1)
        across = across - (across @ B) @ np.linalg.pinv(B)
        return np.asarray(across @ across.T / SAMPLES)

    def tracked(self, count: int, noise: float) -> Rated:
        """Random poses that a tracker sees, its frame being the base link's."""
        q = self.arm.random_joints(count, self.seed)
        T = self.arm.forward(q)
        xyz = (T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)) / MM
        table = pd.DataFrame(self.arm.joint_table(q))
        table = table.assign(pose=np.arange(count), x_mm=xyz[:, 0], y_mm=xyz[:, 1], z_mm=xyz[:, 2], feature="")
        return self._rated(features.read(table, None, self.arm), {}, noise)

    def at(self, found: Placed, q: FloatArray, which: IntArray, noise: float) -> Rated:
        """Poses (n, joints) at a device's features (n,)."""
        table = rows_table(self.arm, found, q, which, values(self.arm, found, q, which))
        return self._rated(features.read(table, found.table(), self.arm), found.by_key(), noise)

    def _rated(self, rows_read: FeatureSet, unknowns: Mapping[UnknownKey, FloatArray], noise: float) -> Rated:
        rows_read = replace(rows_read, u95=np.full(len(rows_read), NORMAL_95 * noise))
        problem = FeatureProblem(self.arm, rows_read, self.terms)
        target = str(rows_read.target[0])
        state = FeatureState({**unknowns, (TOOL, target): np.array(BALL)}, np.zeros(len(self.terms)))
        joined = Rows.joined(list(problem.dense(state)))
        J, row = joined.J, joined.row
        natural = problem.sizes[problem.nuisance :]
        J = J * (np.r_[np.full(problem.nuisance, FREE), self.sizes / natural] * MM / noise)[:, None]
        size = max(group.kind.size for group in problem.groups)
        order_of = np.argsort(row[row >= 0], kind="stable")
        rows = J[:, row >= 0][:, order_of].reshape(len(J), len(rows_read), size).transpose(1, 2, 0)
        G = np.zeros((len(J), len(J)))
        if (TOOL, target) in problem.layout:
            at = problem.layout[TOOL, target][1]
            columns = np.r_[at : at + 3, problem.nuisance : len(J)]
            G[np.ix_(columns, columns)] = self.G
        else:  # an inclinometer does not see where it is on the tool
            G[problem.nuisance :, problem.nuisance :] = self.G[3:, 3:]
        nuisance = J[:, row < 0]
        aim = Aim(MeanSquaredError(G, np.zeros((len(J), 0))), (nuisance @ nuisance.T, 0.0))
        return Rated(Candidates.without_errors(rows), aim)


def _wide(arm: Arm) -> list[Term]:
    """Geometry and what model ``auto`` fits beside it, harmonics as high as they are unmodelled for tracker plans."""
    terms = term_sets.superset(arm, term_sets.JOINT_MAP, False, None, [])
    terms = [term for term in terms if not families()[term.family].special_case_of]
    return [term for term in terms if term.family != "harmonics" or order(term) <= WAVES]


STAND, BELOW = 40.0 * MM, 60.0 * MM
"""What carries a ball or socket: a ball of this radius so far behind it."""

PATCH, PLATE, GAP = 0.25, 30.0 * MM, 3.0 * MM
"""Planes are patches of this half edge in shares of the reach, so thick, and the plate behind begins so far behind."""

PARTS = 2
"""Places on the last part of the way that are looked at."""

CLOSE = (0.2 * MM, 0.2 * DEG)
"""How near the arm must come to a place and attitude on the way."""


@dataclass(frozen=True, eq=False)
class Access(Locked):
    """What poses at a device must allow."""

    setting: Setting
    """Its solids get what carries the features as obstacles (`with_stands`)."""
    placed: Placed
    cone: float
    """Largest angle between the tool's axis and what it is turned to, radians."""
    approach: float
    """Last part of the way along the tool's axis that must be free, metres."""

    @property
    def touched(self) -> bool:
        """Whether the tool touches the features; else a line leads to them."""
        return self.placed.device.touched

    @property
    def patch(self) -> float:
        """Half the edge of a plane, metres."""
        return PATCH * self.placed.reach

    def in_words(self) -> list[str]:
        """The conditions beside those of the setting."""
        to = {"point": "the socket's or ball's open side", "plane": "the surface"}
        angle = (
            f"tool axis within {self.cone / DEG:.0f}° of {to.get(self.placed.device.kind, 'the line to the anchor')}"
        )
        if self.placed.device.sees:
            angle = f"the whole board in the image, within {self.cone / DEG:.0f}° of its normal"
        if self.placed.device.tilts:
            return [f"the inclinometer's axis within {self.cone / DEG:.0f}° of the horizontal"]
        if not self.touched:
            end = "the board" if self.placed.device.sees else "the anchor"
            return [angle, *([f"the line to {end} free of the arm"] if self.setting.solids else [])]
        last_part = f"the last {self.approach / MM:.0f} mm along the tool axis reached"
        return [
            angle,
            f"{last_part}, free of the arm and of what carries the features" if self.setting.solids else last_part,
        ]

    def keep(self, feature: str, q: FloatArray) -> tuple[BoolArray, dict[str, int]]:
        """Which poses (n, joints) at a feature can be used, and how many each condition removed."""
        good = self._turned(feature, q)
        removed = {"cone": int((~good).sum())}
        rows = np.flatnonzero(good)
        free, _, removed_here = counted(self.setting, q[rows])
        removed |= removed_here
        good[rows] = free
        rows = np.flatnonzero(good)
        if self.touched:
            good[rows] = self.retreated(q[rows])[1]
            removed["approach"] = len(rows) - int(good.sum())
        elif self.setting.solids is not None and len(rows) and not self.placed.device.tilts:
            p = self._points(q[rows])[0]
            theta = self.setting.effective(q[rows])
            good[rows] = ~self.setting.solids.blocked(theta, p[:, None], self.placed.middle[feature])[:, 0]
            removed["line"] = len(rows) - int(good.sum())
        return good, removed

    def retreated(self, q: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Joints (n, joints) before the last part of the way, and whether it can be gone, (n,)."""
        arm, setting = self.setting.arm, self.setting
        lower, upper = setting.bounds
        goal = arm.forward(q)
        good = np.ones(len(q), dtype=bool)
        q_back = q
        for _ in range(PARTS):
            goal[:, :3, 3] -= goal[:, :3, 2] * (self.approach / PARTS)
            q_back, converged = reached(arm, q_back, goal)
            good &= converged & ((q_back >= lower) & (q_back <= upper)).all(axis=1)
            rows = np.flatnonzero(good)
            if setting.solids is not None and len(rows):
                good[rows] = ~setting.touching(q_back[rows])
        return q_back, good

    def _points(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The tool's point (n, 3) and its axis (n, 3) in the base link."""
        T = self.setting.arm.forward(q)
        return T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL), T[:, :3, 2]

    def _turned(self, feature: str, q: FloatArray) -> BoolArray:
        p, axis = self._points(q)
        middle = self.placed.middle[feature]
        if self.placed.device.tilts:
            tilt = values(self.setting.arm, self.placed, q, np.zeros(len(q), dtype=int))
            return np.asarray(np.abs(np.asarray(tilt)) <= self.cone)
        if self.placed.imaging is not None:
            unknowns, T = dict(self.placed.unknowns[feature]), self.setting.arm.forward(q)
            return devices.visible(self.placed.imaging, unknowns, T, np.array(BALL), self.cone)
        if self.touched:
            direction = np.broadcast_to(-_open(self.placed, feature), p.shape)
        else:
            direction = (middle - p) / np.linalg.norm(middle - p, axis=1)[:, None]
        good = np.einsum("ni,ni->n", axis, direction) >= np.cos(self.cone)
        if self.placed.device.kind == "plane":
            Q = frames.with_third(_open(self.placed, feature))
            good &= (np.abs((p - middle) @ Q[:, :2]) <= self.patch + 1e-6).all(axis=1)
        return np.asarray(good, dtype=bool)


def with_stands(solids: CollisionModel, features: Placed) -> None:
    """Put what carries the features of a device in the arm's way; anchors are beside it and carried by nothing here."""
    if features.device.tilts or (features.device.kind == "radius" and not features.bar):
        return
    for name, middle in features.middle.items():
        n = _open(features, name)
        if features.device.kind == "plane":
            edge = 2.0 * PATCH * features.reach
            solids.add_box(frames.transform(frames.with_third(n), middle - n * (GAP + PLATE / 2)), (edge, edge, PLATE))
        else:
            solids.add_obstacle(middle - BELOW * n, STAND)


def _open(features: Placed, feature: str) -> FloatArray:
    """Unit vector to the open side of a feature."""
    return np.array(next(spot.normal for spot in features.device.spots if spot.name == feature))


def reached(arm: Arm, q: FloatArray, goal: FloatArray, steps: int = 6) -> tuple[FloatArray, BoolArray]:
    """Joints near q (n, joints) at which the tip has a place and attitude (n, 4, 4), and whether it has."""
    if not len(q):
        return q, np.zeros(0, dtype=bool)
    good = np.zeros(len(q), dtype=bool)
    for step in range(steps + 1):
        path = chain.walk(arm, q)
        T = chain.poses(path)
        off = goal[:, :3, 3] - T[:, :3, 3]
        turn = frames.vector_from_rotation(goal[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1))
        good = (np.linalg.norm(off, axis=1) < CLOSE[0]) & (np.linalg.norm(turn, axis=1) < CLOSE[1])
        if step == steps or good.all():
            break
        J = np.concatenate([chain.by_joints(path, arm, T[:, :3, 3].T), chain.by_joints(path, arm)], axis=1).T
        q = q + (np.linalg.pinv(J, rcond=1e-3) @ np.concatenate([off, turn], axis=1)[..., None])[..., 0]
    return q, good


ROWS, FEATURES, APPROACH = "rows.csv", "features.csv", "approach.csv"

BATCHES, BATCH = 12, 400
"""Times that random joints are brought to a feature for candidates, and how many at a time."""

FEWEST_PER_FEATURE = 6
"""Poses at each feature, as far as there are so many in all: fewer do not determine its place."""

CANDIDATES, APPROACH_LENGTH = 600, 50.0 * MM

FLOOR_SHARE = 0.75
"""Share of the error that is left, above which all candidates together would leave it, too."""


@dataclass(frozen=True, eq=False, repr=False)
class DevicePlan(Result):
    """Poses at a device's features.

    Attributes
    ----------
    arm : Arm
    placed : Placed
        The device, and where it should stand.
    q : ndarray, shape (n, joints)
    which : ndarray of int, shape (n,)
        Number of the feature at each.
    conditions : tuple of str
        What every pose meets.
    prior_error : float
        Predicted root mean square error of positions over the whole range before, metres.
    comparison : DesignComparison
        Mean squared error of positions that these poses and random ones leave, m^2.
    candidates : dict of str to int
        By feature: poses that they were chosen from.
    tally : dict of str to int
        Condition -> tried poses that it removed.
    approach : ndarray, shape (n, joints), or None
        Joints before the last part of the way, of devices that are touched.
    notes : tuple of str
    remaining_by_all : float
        Predicted error that all candidates together would leave, metres.
    """

    arm: Arm
    placed: Placed
    q: FloatArray
    which: IntArray
    conditions: tuple[str, ...]
    prior_error: float
    comparison: DesignComparison
    candidates: dict[str, int]
    tally: dict[str, int]
    approach: FloatArray | None
    notes: tuple[str, ...]
    remaining_by_all: float

    def to_frame(self) -> pd.DataFrame:
        """The poses as the first file of ``irbcal calibrate --features``; values are to be filled in."""
        return rows_table(self.arm, self.placed, self.q, self.which, None)

    def features(self) -> pd.DataFrame:
        """The second file: lengths are those of the plan, to be replaced by measured ones."""
        return self.placed.table()

    def places_mm(self) -> dict[str, list[float]]:
        """Where each feature should stand, in the base link, mm; a point of planes."""
        return {name: np.round(point / MM, 1).tolist() for name, point in self.placed.middle.items()}

    @property
    def remaining(self) -> float:
        """Predicted root mean square error of positions over the whole range after these poses, metres."""
        return float(np.sqrt(self.comparison.optimal))

    @property
    def remaining_by_random(self) -> float:
        """The same after as many random poses that meet the same conditions, metres."""
        return float(np.sqrt(self.comparison.random[len(self.q)]))

    CONTENT = (
        "robot=arm.name device=placed.device.name poses=q.__len__ features_mm=places_mm conditions "
        "as_good_as_random=comparison.as_good_as candidates removed=tally notes bar_mm predicted_mm"
    )

    @property
    def bar_mm(self) -> float | None:
        """Length of the bar; None without one."""
        return self.placed.bar / MM or None

    @property
    def predicted_mm(self) -> dict[str, float]:
        """Predicted errors."""
        predicted = {
            "before": self.prior_error / MM,
            "left": self.remaining / MM,
            "random": self.remaining_by_random / MM,
        }
        return predicted | {"all_candidates": self.remaining_by_all / MM}

    def report(self) -> Sequence[Paragraph]:
        """What to put where, and what every pose meets."""
        device, counts = self.placed.device, np.bincount(self.which)
        longest = self.placed.bar + self.placed.device.travel * self.placed.reach
        lengths = (
            f"{self.placed.bar / MM:.0f} to {longest / MM:.0f}" if longest > self.placed.bar else f"{longest / MM:.0f}"
        )
        bar = f", bar of {lengths} mm" if self.placed.bar else ""
        lines: list[Paragraph] = [f"{self.arm.name}: {len(self.q)} poses at {device.description}{bar}"]
        for (name, middle), count in zip(self.places_mm().items(), counts, strict=True):
            place = "anywhere" if device.tilts else f"near {', '.join(f'{x:.0f}' for x in middle)} mm in the base link"
            lines.append(f"  {name} {place}: {count} poses")
        lines.append(f"Every pose meets: {', '.join(self.conditions)}")
        largest = max(self.comparison.random)
        good = self.comparison.as_good_as
        equal = f"{good} random ones would be as good" if good else f"{largest} random ones would not be as good"
        lines.append(
            f"Predicted position error: {self.prior_error / MM:.2f} mm before, {self.remaining / MM:.3f} mm after "
            "these "
            f"poses, {self.remaining_by_random / MM:.3f} mm after as many random ones that meet the same ({equal}); "
            "root mean square over the whole range, calculated, with joint errors beyond the geometry"
        )
        advice = "Put features elsewhere, too, or take a device that moves the arm farther"
        if device.tilts:
            advice = (
                "An inclinometer sees no length and nothing of joint 1: measure with a device that sees places, too"
            )
        if self.remaining_by_all > FLOOR_SHARE * self.remaining:
            lines.append(
                f"All {sum(self.candidates.values())} poses that they were chosen from would leave "
                f"{self.remaining_by_all / MM:.3f} mm: no pose at these features determines the rest. {advice} "
                "(irbcal plan --compare-devices)"
            )
        removed = ", ".join(f"{count} by {name}" for name, count in self.tally.items() if count)
        lines.append(f"Chosen from {sum(self.candidates.values())} poses; removed before: {removed or 'none'}")
        return [*lines, *remarks("Note", self.notes)]

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``rows.csv``, ``features.csv`` and of devices that are touched ``approach.csv``, all or none.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        tables = {ROWS: self.to_frame(), FEATURES: self.features()}
        if self.approach is not None:
            tables[APPROACH] = rows_table(self.arm, self.placed, self.approach, self.which, None)
        data = {name: csv_bytes(t) for name, t in tables.items()}
        safe_files.write_together(folder, data)
        return tuple(Path(folder) / name for name in data)


def device_plan(
    robot: RobotLike,
    device: DeviceName,
    poses: int = 100,
    *,
    candidates: int = CANDIDATES,
    acceptance: float | None = None,
    approach: float = APPROACH_LENGTH,
    prior: float | None = None,
    seed: int = 0,
    margin: float = 2 * DEG,
    package_dirs: Sequence[str | Path] = (),
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    progress: Progress | None = None,
) -> DevicePlan:
    """The best poses at a device's features that the robot reaches, with a free way to them.

    Parameters
    ----------
    robot : str, Path or calibration
    device : str
        What takes the tracker's place, see `irbcal.simulation.devices.DEVICES`.
    poses : int
        In all, of a device.
    candidates : int
        Poses that they are chosen from, in all.
    acceptance : float, optional
        Largest angle between the tool's axis and the surface's normal, the bar or the string, or between a camera's
        view and the board's normal, radians; 60 degrees, for ballbars 90, for strings 120 and for a camera 50 unless
        given.
    approach : float
        Last part of the way to a feature, along the tool's axis, that must be free, metres.
    prior : float, optional
        See `irbcal.compare_devices`.
    seed : int
    margin : float
        From the joint limits, radians.
    package_dirs, base_link, tip_link, coupling
        See `irbcal.read_urdf`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    IrbcalError
        If an option or input is refused, or too few poses are found; the sentence counts what each condition removed.
    """
    chosen_device = DEVICES[checked("device", device, tuple(DEVICES))]
    count = number("poses", poses, len(chosen_device.spots), MOST_POSES, whole=True)
    pool = number("candidates", candidates, 2, MOST_POSES, whole=True)
    cone = chosen_device.cone if acceptance is None else number("acceptance", acceptance, 1 * DEG, 180 * DEG)
    length = number("approach", approach, 0.0, 1.0)
    size = None if prior is None else number("prior", prior, 1e-6, 0.1)
    step: Progress = progress or (lambda text: None)
    step("robot")
    scene = open_scene(
        PlanOptions(
            robot,
            ignore=("height", "acceptance", "sight", "path"),
            margin=margin,
            package_dirs=package_dirs,
            base_link=base_link,
            tip_link=tip_link,
            coupling=coupling,
        )
    )
    return _choose_poses(scene, chosen_device, count, max(pool, count), cone, length, size, check_seed(seed), step)


def _choose_poses(
    scene: Scene,
    device: Device,
    count: int,
    pool: int,
    cone: float,
    length: float,
    prior: float | None,
    seed: int,
    step: Progress,
) -> DevicePlan:
    """The plan of a scene, see `device_plan`."""
    setting = scene.setting
    arm, features = setting.arm, placed(setting.arm, device)
    if setting.solids is not None:
        with_stands(cast("CollisionModel", setting.solids), features)
    access = Access(setting, features, cone, length)
    step("candidates")
    q, which, tally = _candidates(access, count, pool, seed)
    model = DeviceModel(arm, seed, wide=True, prior=prior)
    rated = model.at(features, q, which, device.noise)
    step(f"{count} poses of {len(q)} candidates")
    rows = _chosen(rated, which, count, len(device.spots))
    step("random plans to compare with")
    value = rated.remaining(rows) ** 2
    comparison = compare(rated.poses, Chosen(rows, value, value, 0), rated.aim, seed)
    rows = _in_order(scene, q, which, rows)
    notes = (*scene.notes, "the tool's body is not in the URDF: see that it is free, too")
    names = list(features.unknowns)
    return DevicePlan(
        arm,
        features,
        q[rows],
        which[rows],
        (*setting.conditions, *access.in_words()),
        model.prior_error,
        comparison,
        {name: int((which == k).sum()) for k, name in enumerate(names)},
        tally,
        access.retreated(q[rows])[0] if access.touched else None,
        notes,
        rated.remaining(),
    )


def _candidates(access: Access, count: int, pool: int, seed: int) -> tuple[FloatArray, IntArray, dict[str, int]]:
    """Random poses that meet the conditions, as even among the features as can be."""
    features, arm = access.placed, access.setting.arm
    q_parts, which, tally = [], [], dict[str, int]()
    share = -(-pool // len(features.unknowns))
    fewest = min(FEWEST_PER_FEATURE, count // len(features.unknowns))
    for k, name in enumerate(features.unknowns):
        usable: list[FloatArray] = []
        for batch in range(BATCHES):
            q = drawn(arm, features, name, BATCH, seed * 1000 + 50 * k + batch, access.patch)
            good, removed = access.keep(name, q)
            for condition, number_of in removed.items():
                tally[condition] = tally.get(condition, 0) + number_of
            usable.append(q[good])
            if sum(map(len, usable)) >= share:
                break
        q_parts.append(np.concatenate(usable)[:share])
        which += [k] * len(q_parts[-1])
        if len(q_parts[-1]) < fewest:
            removed_by = ", ".join(f"{number_of} by {condition}" for condition, number_of in tally.items() if number_of)
            raise MeasurementError(
                f"{arm.name} can be at {name} of {features.device.description} in {len(q_parts[-1])} poses only "
                f"(removed: {removed_by or 'out of reach'}): at least {fewest} are needed"
            )
    if len(which) < count:
        raise MeasurementError(
            f"{arm.name} can be at {features.device.description} in {len(which)} of {count} poses only: ask for fewer",
            parameter="poses",
        )
    return np.concatenate(q_parts), np.array(which), tally


def _chosen(rated: Rated, which: IntArray, count: int, features: int) -> IntArray:
    """The best poses; where one feature would get too few for its own place, these are chosen first."""
    rows = exchange(rated.poses, count, rated.aim).rows
    fewest = min(FEWEST_PER_FEATURE, count // features)
    if (np.bincount(which[rows], minlength=features) >= fewest).all():
        return rows
    aim, first = rated.aim, np.zeros(0, dtype=int)
    for k in range(features):
        rows_of_feature = np.flatnonzero(which == k)
        rated_here = _picked(rated.poses, rows_of_feature)
        first = np.append(first, rows_of_feature[exchange(rated_here, fewest, aim).rows])
        aim = aim.with_given(_picked(rated.poses, first[-fewest:]))
    others_of = np.setdiff1d(np.arange(len(which)), first)
    if count > len(first):
        first = np.append(first, others_of[exchange(_picked(rated.poses, others_of), count - len(first), aim).rows])
    return np.sort(first)


def _picked(poses: Candidates, rows: IntArray) -> Candidates:
    return Candidates(poses.rows[rows], poses.errors[rows])


def _in_order(scene: Scene, q: FloatArray, which: IntArray, rows: IntArray) -> IntArray:
    """The poses feature by feature, with short moves; the ways between are not looked at."""
    out, start = np.zeros(0, dtype=int), home_joints(scene.setting.arm)
    for k in np.unique(which[rows]):
        rows_of_feature = rows[which[rows] == k]
        rows_of_feature = rows_of_feature[shortest_order(q[rows_of_feature], start, scene.joint_speed)[0]]
        out, start = np.append(out, rows_of_feature), q[rows_of_feature[-1]]
    return out


POSE_COUNTS = (25, 50, 100)
"""Numbers of poses that are compared."""

TRACKER, TRACKER_NOISE = "tracker", 0.03 * MM


@dataclass(frozen=True)
class RemainingError:
    """What one device leaves."""

    device: str
    description: str
    poses: int
    noise: float
    remaining: float
    remaining_with_joints: float
    """Standard deviation of a coordinate, and root mean square error of positions that is left where the geometry is
    all that errs, and where the joints err beyond it, metres.
    """


@dataclass(frozen=True, eq=False, repr=False)
class DeviceComparison(Result):
    """What devices leave of a robot's position error.

    Attributes
    ----------
    robot : str
    prior_error, prior_error_with_joints : float
        Root mean square error without any, from the geometry and with the joints' errors beyond it, metres.
    rows : tuple of RemainingError
        Best first, by the largest number of poses.
    missing : tuple of str
        Devices that the arm does not reach, in sentences.
    """

    robot: str
    prior_error: float
    prior_error_with_joints: float
    rows: tuple[RemainingError, ...]
    missing: tuple[str, ...] = ()

    def report(self) -> Sequence[Paragraph]:
        """A row for each device, a column for each number of poses."""
        counts = sorted({row.poses for row in self.rows})
        devices = list(dict.fromkeys((row.device, row.description, row.noise) for row in self.rows))
        remaining = {(row.device, row.poses): row.remaining / MM for row in self.rows}
        last = {row.device: row.remaining_with_joints / MM for row in self.rows if row.poses == counts[-1]}
        cells = tuple(
            (device, label, noise / MM, *(remaining.get((device, count)) for count in counts), last.get(device))
            for device, label, noise in devices
        )
        unmeasured = (
            "before",
            "no measurement",
            None,
            *(self.prior_error / MM for _ in counts),
            self.prior_error_with_joints / MM,
        )
        columns = ("device", "what it is", "noise", *(f"{count} poses" for count in counts), f"{counts[-1]}, joints")
        return [
            f"{self.robot}: position error before calibration {self.prior_error / MM:.2f} mm from the geometry, "
            f"{self.prior_error_with_joints / MM:.2f} mm with joint errors beyond it (root mean square over the "
            "whole range; gain, gravity and harmonics in their natural sizes)",
            Table("Predicted position error that each device leaves, mm", columns, (unmeasured, *cells)),
            f"Columns with poses alone: errors of the geometry only. {counts[-1]}, joints: joint errors beyond it as "
            "well, as real robots have them; a device that keeps the arm in one place does not show all of them.",
            "Calculated, not measured: what no error model describes is not in it, and remains.",
            *remarks("Note", self.missing),
        ]

    CONTENT = "robot prior_error_mm prior_error_with_joints_mm devices=to_frame notes=missing"
    ROWS, COLUMNS = "rows", "device description poses noise_mm remaining_mm remaining_with_joints_mm"


def compare_devices(
    robot: RobotLike,
    poses: Sequence[int] = POSE_COUNTS,
    *,
    noise: float | None = None,
    prior: float | None = None,
    seed: int = 0,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    progress: Progress | None = None,
) -> DeviceComparison:
    """Predict the position error that a tracker and each device in its place would leave.

    Parameters
    ----------
    robot : str, Path or calibration
    poses : sequence of int
        Numbers of poses to compare.
    noise : float, optional
        Standard deviation of a coordinate for all devices, metres; what is plausible for each unless given.
    prior : float, optional
        Root mean square position error from the geometry before any measurement, metres; what its natural sizes make
        unless given. Sizes of the joints' errors stay.
    seed : int
        Of the random poses.
    base_link, tip_link, coupling
        See `irbcal.read_urdf`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    OptionError
        If an option makes no sense.

    Examples
    --------
    >>> print(compare_devices("irb1600"))  # doctest: +SKIP
    """
    check_seed(seed)
    counts = sorted({number("poses", count, 5, 100_000, whole=True) for count in poses})
    arm = open_robot(robot, base_link=base_link, tip_link=tip_link, coupling=coupling).robot.arm
    say: Progress = progress or (lambda text: None)
    size = None if prior is None else number("prior", prior, 1e-6, 0.1)
    models = [DeviceModel(arm, seed, wide, size) for wide in (False, True)]
    rows: list[RemainingError] = []
    missing: list[str] = []
    for name in (TRACKER, *DEVICES):
        say(name)
        for count in counts:
            spread = TRACKER_NOISE if name == TRACKER else DEVICES[name].noise
            spread = spread if noise is None else number("noise", noise, 1e-7, 0.01)
            try:
                errors = [_remaining_after_random(model, name, count, spread) for model in models]
            except IdentificationError as error:
                missing.append(str(error))
                continue
            label = "laser tracker, one reflector" if name == TRACKER else DEVICES[name].description
            rows.append(RemainingError(name, label, count, spread, *errors))
    with_joints = {row.device: row.remaining_with_joints for row in rows}
    rows.sort(key=lambda row: with_joints[row.device])
    return DeviceComparison(arm.name, models[0].prior_error, models[1].prior_error, tuple(rows), tuple(missing))


def _remaining_after_random(model: DeviceModel, name: str, count: int, noise: float) -> float:
    """What random poses leave."""
    if name == TRACKER:
        return model.tracked(count, noise).remaining()
    features = placed(model.arm, DEVICES[name])
    return model.at(features, *device_poses(model.arm, features, count, model.seed), noise).remaining()
