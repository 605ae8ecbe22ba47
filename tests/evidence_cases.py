"""What the tests of identification by evidence need: arms with known terms that measure themselves, real robots."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, measured, random_robot

from irbcal.identification import linear_model
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit import identify
from irbcal.identification.linear_model import Rows
from irbcal.identification.term_sets import superset
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap

MM = 1e-3
PAGE = Path(__file__).parents[1] / "docs" / "error-model.md"


def documented():
    """Figures of docs/error-model.md: (robot, terms, poses, gear scan) -> mean and largest error (mm), share inside."""
    table = re.search(r"<!-- measured -->\n(.*?)<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in table.splitlines()[2:]]
    return {
        (robot, terms, int(poses), gears == "yes"): (
            float(mean),
            float(largest),
            float(inside.strip("% ")) / 100 if inside.strip() else None,
        )
        for robot, terms, poses, gears, mean, largest, inside in (row + [""] * (7 - len(row)) for row in rows)
    }


def assert_documented(key, mean, largest, inside=None):
    """Figures (mm) are those that the page shows, as far as other processors round alike."""
    expected = documented()[key]
    assert mean == pytest.approx(expected[0], rel=0.03, abs=0.001)
    assert largest == pytest.approx(expected[1], rel=0.06)
    assert (inside is None) == (expected[2] is None)
    if inside is not None:
        assert inside == pytest.approx(expected[2], abs=0.015)


class Truth:
    """An arm with random terms of some families, that measures itself."""

    def __init__(self, names, seed=1, scale=0.7, extra=(), T_world_base=None):
        rng = np.random.default_rng(seed)
        self.nominal = arm("irb120")
        geometry = families()["geometry"].terms(self.nominal)
        self.constants = {t.name: 0.5 * t.size * rng.standard_normal() for t in geometry}
        columns = {k: getattr(self.nominal.table, k).copy() for k in DHM_COLUMNS.values()}
        for t in geometry:
            columns[DHM_COLUMNS[t.axis]][t.joint] += self.constants[t.name]
        self.arm = self.nominal.with_table(replace(self.nominal.table, **columns))
        terms = [t for name in names for t in families()[name].terms(self.nominal)]
        terms = [t for t in terms if t.family != "harmonics" or t.parameters["cycles_per_turn"] <= 2]
        values = [scale * t.size * rng.standard_normal() for t in terms]
        self.map = TermMap(self.nominal, (*terms, *(t for t, _ in extra)), np.array([*values, *(c for _, c in extra)]))
        self.T_world_base = frames.from_xyz_angles([0.4, -1.0, 0.2, 0.1, 0.2, -2.0])

    def points(self, motion, name):
        T = self.T_world_base @ self.map.forward(self.arm, motion)
        return T[:, :3, :3] @ np.asarray(TARGETS[name]) + T[:, :3, 3]

    def measured(self, motion, noise, seed=2):
        rng = np.random.default_rng(seed)
        n, names = len(motion), tuple(TARGETS)
        xyz = np.stack([self.points(motion, name) for name in names], axis=1).reshape(-1, 3)
        xyz += noise * rng.standard_normal(xyz.shape)
        pose, target = np.repeat(np.arange(n), 3), np.tile(np.arange(3), n)
        return PointSet(motion.q, pose, target, xyz, names, np.arange(n), np.full(n, "", dtype=object))


def moves(model, n, seed):
    return Motion.in_order(model.random_joints(n, seed))


def linear_case(poses=30, orientations=False, sessions=False):
    model, rng = arm("irb120"), np.random.default_rng(7)
    robot = random_robot(model, "26", rng)
    points = measured(robot, model.random_joints(poses, 2), 5e-5, rng)
    points = points.take(rng.uniform(size=len(points)) > 0.1)  # poses see two or three targets
    if orientations:
        T = (robot.T_world_base @ robot.poses(points.q))[points.pose, :3, :3].copy()
        T[rng.uniform(size=len(T)) > 0.5] = np.nan
        points = replace(points, rotation=T, u95=rng.uniform(1e-5, 4e-5, len(points)))
    if sessions:  # the first half as seen from another place
        own = np.where(np.arange(poses) < poses // 2, "first", "second").astype(object)
        T = np.where(
            (points.pose < poses // 2)[:, None, None], frames.from_xyz_angles([2, -1, 0.5, 0.3, 1, -2]), np.eye(4)
        )
        points = replace(points, xyz=np.einsum("mij,mj->mi", T[:, :3, :3], points.xyz) + T[:, :3, 3], session=own)
        if points.rotation is not None:
            points = replace(points, rotation=T[:, :3, :3] @ points.rotation)
    motion = Motion.in_order(points.q)
    geometry = GEOMETRY.terms(model)
    problem = linear_model.geometry_problem(model, points, geometry, None)
    state = linear_model.geometry_solution(problem, motion, geometry)
    terms = superset(model, "all", True, None, [10.0])
    return problem, state, motion, terms


def rows_of(linear, columns=None):
    """All blocks of a linear model as one, by pose."""
    blocks = list(linear.blocks(columns))
    pose = np.concatenate([block.pose for block in blocks])
    order = np.argsort(pose, kind="stable")
    J, y = np.concatenate([block.J for block in blocks], axis=1), np.concatenate([block.y for block in blocks])
    return Rows(J[:, order], y[order], pose[order], np.concatenate([block.row for block in blocks])[order])


class Measured:
    """Clean poses of a real robot with programmed joints and last moves."""

    def __init__(self, model, points, motion):
        self.model, self.points, self.motion = model, points, motion
        self.fits = {}

    def first(self, n, **options):
        """The fit to the first n poses, made once."""
        rows, key = np.arange(self.points.poses) < n, (n, *sorted(options.items()))
        if key not in self.fits:
            select = self.points.select(rows), self.motion.select(rows)
            self.fits[key] = identify_evidence(self.model, *select, **options)
        return self.fits[key]

    def of_level(self, n, level):
        """Mean and largest error (mm) of a level of the thesis on the poses after the first n."""
        rows = np.arange(self.points.poses) < n
        fit = identify(self.model, self.points.select(rows), level)
        error = distances(fit.robot, self.points.select(~rows)) / MM
        return error.mean(), error.max()

    def heldout(self, found, n):
        """Mean and largest error (mm) and coverage of the interval on the poses after the first n."""
        rows = np.arange(self.points.poses) >= n
        points, motion = self.points.select(rows), self.motion.select(rows)
        errors, inside = [], []
        for k, name in enumerate(points.target_names):
            mine = points.target == k
            q = motion.q[points.pose[mine]]
            seen = found.robot.predict(q, q - motion.moves[points.pose[mine]], name)
            errors.append(np.linalg.norm(points.xyz[mine] - seen.position, axis=1) / MM)
            inside.append(np.abs(points.xyz[mine] - seen.position) < seen.interval)
        error = np.concatenate(errors)
        return error.mean(), error.max(), np.concatenate(inside).mean()


def irb120(shared_data, joints="c"):
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements_with_commands.csv")
    first = seen.table.groupby("pose_index", sort=True).first()
    q = np.radians(first[[f"{joints}{i}_deg" for i in range(1, 7)]].to_numpy(dtype=float))
    cleaned = cleaning.clean(seen)
    row = pd.Index(first["pose"]).get_indexer(cleaned.points.pose_ids)
    keep = cleaned.registration.with_references[row]
    motion = Motion.in_order(q, readings=joints == "q").select(row[keep])
    points = replace(cleaned.points, q=q[row]).select(keep)
    return Measured(urdf.read("irb120").arm, points, motion)
