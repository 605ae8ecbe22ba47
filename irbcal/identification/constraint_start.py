"""Base, tool and features of rows at features, on the robot as it is: closed forms, then a damped least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError
from irbcal.identification.constraint_problem import (
    TOOL,
    ConstraintProblem,
    FeatureState,
    refuse_undetermined,
)
from irbcal.identification.fit import first_state
from irbcal.identification.residuals import Problem
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames

STEPS = 200
"""Steps of the damped least squares."""

FALL = 1e-10
"""Relative fall of the sum of squares below which it has arrived."""


def start(problem: ConstraintProblem) -> FeatureState:
    """The robot as it is, placed among the features: no guess is needed.

    Raises
    ------
    IdentificationError
        If the rows leave base, tool or features open.
    """
    zero = FeatureState(dict(problem.held), np.zeros(len(problem.terms)))
    if problem.known_base is not None:
        zero = replace(zero, T_world_base=problem.known_base)
    candidates = [_tools(problem, zero), {}]
    best, least = None, np.inf
    for tools in candidates:
        try:
            state = settle(problem, _features(problem, zero, tools))
        except (np.linalg.LinAlgError, IdentificationError):
            continue
        rss = problem.sums(state, np.zeros(0, dtype=int)).yy
        if rss < least:
            best, least = state, rss
        if rss < 100.0 * problem.scalars:  # a centimetre: there is one minimum as near as that
            break
    if best is None:
        raise IdentificationError("no place of tool and features was found that these rows fit")
    refuse_undetermined(problem, problem.sums(best, np.zeros(0, dtype=int)))
    return best


def start_of_features(problem: ConstraintProblem, state: FeatureState) -> FeatureState:
    """Features placed about a robot whose base and tool are held, at some coefficients.

    Raises
    ------
    IdentificationError
        If the rows leave a feature open.
    """
    own = dict(problem.held)
    for group in problem.groups:
        if group.measured:
            continue
        here = replace(state, own=own)
        seen = problem.seen_of(here, group, problem.walk(here, group.rows).tip)
        for name, key in group.keys().items():
            own.setdefault(key, group.kind.start(seen)[name])
    there = settle(problem, replace(state, own=own))
    refuse_undetermined(problem, problem.sums(there, np.zeros(0, dtype=int)))
    return there


def settle(problem: ConstraintProblem, state: FeatureState, steps: int = STEPS) -> FeatureState:
    """Least squares of base, tool and features, the robot held (Levenberg and Marquardt)."""
    if not problem.flat:
        return state
    none = np.zeros(0, dtype=int)
    sums, damp = problem.sums(state, none), 1e-6
    for _ in range(steps):
        diagonal = np.maximum(np.diagonal(sums.H), 1e-12)
        step = np.asarray(np.linalg.solve(sums.H + np.diag(damp * diagonal), sums.g), dtype=float)
        tried = problem.moved(state, step)
        new = problem.sums(tried, none)
        if not np.isfinite(new.yy) or new.yy > sums.yy * (1.0 + 1e-12):
            damp *= 10.0
            if damp > 1e8:
                break
            continue
        fall = sums.yy - new.yy
        state, sums, damp = tried, new, max(damp / 10.0, 1e-12)
        if fall <= FALL * new.yy and np.abs(step).max() < 1e-6:
            break
    return state


def tracked(problem: ConstraintProblem) -> PointSet | None:
    """The rows that a tracker measured, as points; None where there are none."""
    rows = [
        (group, k)
        for group in problem.groups
        if group.measured or "rotation" in group.kind.needs
        for k in group.rows.tolist()
    ]
    return None if not rows else points_of(problem.seen, np.array([k for _, k in rows]))


def points_of(seen: FeatureSet, rows: FloatArray) -> PointSet:
    """Rows with positions as points, sorted by pose."""
    rows = rows[np.argsort(seen.pose_index[rows], kind="stable")]
    _, first, pose = np.unique(seen.pose_index[rows], return_index=True, return_inverse=True)
    names = tuple(sorted(set(seen.target[rows].astype(str))))
    number = np.array([names.index(str(name)) for name in seen.target[rows]])
    rotation = seen.rotation[rows]
    return PointSet(
        seen.q[rows][first],
        pose,
        number,
        seen.xyz[rows],
        names,
        seen.pose[rows][first],
        np.full(len(first), "", dtype=object),
        rotation if np.isfinite(rotation).all(axis=(1, 2)).any() else None,
    )


def _tools(problem: ConstraintProblem, zero: FeatureState) -> dict[str, FloatArray]:
    """Places of the targets in the tip link, each from the rows that tell it."""
    told: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for group in problem.groups:
        if not group.kind.pointed or (TOOL, group.target) in problem.held or group.measured:
            continue
        seen = problem.seen_of(replace(zero, own={}), group, problem.walk(zero, group.rows, problem.arm).tip)
        found = group.kind.tool(seen)
        if found is not None and np.isfinite(found[0]).all():
            told.setdefault(group.target, []).append(found)
    return {
        name: np.asarray(np.linalg.solve(sum(H for _, H in parts), sum(H @ t for t, H in parts)), dtype=float)
        for name, parts in told.items()
    }


def _features(problem: ConstraintProblem, zero: FeatureState, tools: dict[str, FloatArray]) -> FeatureState:
    """All unknowns from the tool's places: first what a tracker saw, then features in closed form, then the base."""
    own, T = dict(zero.own), zero.T_world_base
    points = tracked(problem)
    if points is not None and problem.known_base is None:
        found = first_state(Problem(problem.arm, points, ()))
        T = found.T_world_base
        for k, name in enumerate(points.target_names):
            own.setdefault((TOOL, name), found.targets[k])
            own.setdefault(("axes", name), found.rotations[k])
    for key in problem.layout:
        if key[0] == TOOL:
            own.setdefault(key, tools.get(key[1], np.zeros(3)))
    state = replace(zero, own=own, T_world_base=T)
    centres = []
    for group in problem.groups:
        if group.measured:
            continue
        seen = problem.seen_of(state, group, problem.walk(state, group.rows, problem.arm).tip)
        found_own = group.kind.start(seen)
        if group.feature.centre is not None and "centre" in found_own:
            centres.append((found_own["centre"], group.feature.centre))
        for name, key in group.keys().items():
            if name in found_own:
                own.setdefault(key, found_own[name])
    if points is None and problem.framed and problem.known_base is None:
        here, there = (np.array(list(column)) for column in zip(*centres, strict=True))
        T = rigid(here, there)
    return FeatureState(own, zero.coefficients, T)


def rigid(here: FloatArray, there: FloatArray) -> FloatArray:
    """The motion (4, 4) that brings places (n, 3) nearest to others."""
    a, b = here.mean(axis=0), there.mean(axis=0)
    U, _, Vt = np.linalg.svd((there - b).T @ (here - a))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return frames.transform(R, b - R @ a)
