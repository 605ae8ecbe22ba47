"""All rows at features against an arm: the linear model of base, tool, features and terms at one state.

The kinds of `irbcal.identification.observations` say what a row misses and how that moves with the tool's point; here
this is chained to the arm's kinematics with all terms of the error model, and to the unknowns of tool and features.
Base, tool and features on the robot as it is come from closed forms, then a damped least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import observations
from irbcal.identification.evidence_maximisation import NormalEquations
from irbcal.identification.initial_guess import first_state
from irbcal.identification.linear_model import Rows
from irbcal.identification.observations import KINDS, Kind, Misses, Seen, Shape
from irbcal.identification.problem import Problem
from irbcal.measurement.features import Feature, FeatureSet
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap, basis_values, term_columns
from irbcal.units import MM

BLOCK = 1500
"""Rows whose Jacobian is in memory at a time."""

ROW_U95 = 0.1 * MM
"""Uncertainty of a row that tells none, metres: what a contact repeats to on an industrial arm."""

RAD = 1e-3
"""Radians: the unit of turns that have no prior."""

Key: TypeAlias = tuple[str, str]
"""Name of an unknown, and its feature or target: ``("centre", "A")``, ``("tool", "ball")``, ``("base", "")``."""

BASE: Key = ("base", "")
TOOL = "tool"


@dataclass(frozen=True, eq=False)
class FeatureState:
    """One candidate.

    Attributes
    ----------
    own : dict
        Unknowns of tool and features by their key.
    coefficients : ndarray, shape (terms,)
        SI units.
    T_world_base : ndarray, shape (4, 4)
    """

    own: Mapping[Key, FloatArray]
    coefficients: FloatArray
    T_world_base: FloatArray = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True, eq=False)
class Group:
    """Rows of one kind at one feature with one target."""

    kind: Kind
    feature: Feature
    target: str
    rows: IntArray
    measured: bool
    """Whether the place is the row's own, in the measuring frame."""

    def keys(self) -> dict[str, Key]:
        """Its unknowns by their name in the kind."""
        out = {}
        for name, own in self.kind.own.items():
            if name == "centre" and (self.measured or self.feature.centre is not None):
                continue
            if name not in self.kind.fixed(self.feature):
                out[name] = (name, self.feature.name if own.of == "feature" else self.target)
        return out


@dataclass(frozen=True, eq=False)
class Missed:
    """What a group misses at one state."""

    group: Group
    seen: Seen
    own: Mapping[str, FloatArray]
    path: chain.Walk
    found: Misses


class FeatureProblem:
    """Rows at features against an arm with terms.

    Parameters
    ----------
    arm : Arm
        Nominal.
    seen : FeatureSet
    terms : sequence of Term
        All that may be fitted.
    held : dict, optional
        Unknowns of tool and features that are known, by their key.
    base : ndarray, shape (4, 4), optional
        The base in the measuring frame, where it is known.

    Attributes
    ----------
    flat : int
        Number of unknowns of base, tool and features.
    layout : dict
        Key -> (shape, first column).

    Raises
    ------
    MeasurementError
        If a kind is not known or a row lacks what its kind needs.
    """

    def __init__(
        self,
        arm: Arm,
        seen: FeatureSet,
        terms: Sequence[Term],
        held: Mapping[Key, FloatArray] | None = None,
        base: FloatArray | None = None,
    ) -> None:
        self.arm, self.seen, self.terms = arm, seen, list(terms)
        self.held = dict(held or {})
        self.known_base = base
        self.groups = _groups(seen)
        self.layout: dict[Key, tuple[Shape | None, int]] = {}
        self.framed = any(self._in_world(group) for group in self.groups)
        units: list[FloatArray] = []
        if self.framed and base is None:
            self.layout[BASE] = None, 0
            units.append(np.r_[np.full(3, RAD), np.full(3, MM)])
        shapes: dict[Key, tuple[Shape, str]] = {}
        for group in self.groups:
            if group.kind.pointed:
                shapes.setdefault((TOOL, group.target), ("place", "m"))
            for name, key in group.keys().items():
                own = group.kind.own[name]
                shapes.setdefault(key, (own.shape, own.unit))
        for key in sorted(shapes, key=lambda key: (key[0] != TOOL, key[0] != "axes")):
            if key in self.held:
                continue
            shape, unit = shapes[key]
            self.layout[key] = shape, int(sum(map(len, units)))
            size = np.full(observations.DIMENSIONS[shape], observations.STEPS[unit])
            if shape == "line":
                size[:2] = RAD
            units.append(size)
        self.flat = int(sum(map(len, units)))
        self.sizes: FloatArray = np.concatenate([*units, np.array([t.size for t in self.terms])])
        self.geometry = np.array([t.family == "geometry" for t in self.terms], dtype=bool)
        self.others = TermMap(
            arm, tuple(t for t in self.terms if t.family != "geometry"), np.zeros(int((~self.geometry).sum()))
        )
        self.motion = seen.motion()
        self.pose = np.unique(seen.pose_index, return_inverse=True)[1].ravel()
        u95 = np.where(np.isfinite(seen.u95), seen.u95, ROW_U95)
        self.typical = float(np.median(u95))
        self.weights: FloatArray = np.clip(self.typical / np.maximum(u95, 1e-9), 0.01, 100.0)
        self.lengths = [one for one in seen.lengths if ("centre", one.first) in self.layout]
        self.lengths = [one for one in self.lengths if ("centre", one.second) in self.layout]
        self.expected = {
            key: group.kind.expected(group.feature)[name]
            for group in self.groups
            for name, key in group.keys().items()
            if key in self.layout and name in group.kind.expected(group.feature)
        }

    def _in_world(self, group: Group) -> bool:
        """Whether rows of a group tie the base to the measuring frame."""
        return group.measured or group.feature.centre is not None or "rotation" in group.kind.needs

    @property
    def noise(self) -> float:
        """Standard deviation of a row as the rows themselves tell it, mm."""
        return self.typical / 1.96 / MM

    @property
    def scalars(self) -> int:
        """Number of equations of the rows."""
        return sum(group.kind.size * len(group.rows) for group in self.groups)

    @property
    def per_pose(self) -> float:
        """Equations in a pose, on average."""
        return self.scalars / self.seen.poses

    # ---------------------------------------------------------------- states

    def arm_of(self, state: FeatureState) -> Arm:
        """The arm with the constants of a state in its table."""
        table = self.arm.table
        for kind in set(DHM_COLUMNS.values()):
            mine = [k for k, t in enumerate(self.terms) if self.geometry[k] and DHM_COLUMNS[t.axis] == kind]
            if mine:
                column = getattr(table, kind).copy()
                for k in mine:
                    column[self.terms[k].joint] += state.coefficients[k]
                table = replace(table, **{kind: column})
        return self.arm.with_table(table)

    def term_map(self, state: FeatureState) -> TermMap:
        """Its terms beside the geometry."""
        return replace(self.others, coefficients=state.coefficients[~self.geometry])

    def moved(self, state: FeatureState, step: FloatArray) -> FeatureState:
        """A state after a step of the flat columns, in their units; coefficients stay unless the step has them, too."""
        si = step[: self.flat] * self.sizes[: self.flat]
        own, T = dict(state.own), state.T_world_base
        for key, (shape, at) in self.layout.items():
            if shape is None:
                T = T @ frames.transform(frames.rotation_from_vector(si[:3]), si[3:6])
            else:
                own[key] = observations.moved(shape, own[key], si[at : at + observations.DIMENSIONS[shape]])
        if len(step) == self.flat:
            return replace(state, own=own, T_world_base=T)
        return FeatureState(own, step[self.flat :] * self.sizes[self.flat :], T)

    # ---------------------------------------------------------------- predictions

    def walk(self, state: FeatureState, rows: IntArray, arm: Arm | None = None) -> chain.Walk:
        """The chain at some rows' joints."""
        motion = self.motion.select(rows)
        arm = self.arm_of(state) if arm is None else arm
        if not self.others.terms or not state.coefficients[~self.geometry].any():
            return chain.walk(arm, motion.q)
        return chain.walk(arm, *self.term_map(state).split(motion))

    def seen_of(self, state: FeatureState, group: Group, tip: FloatArray) -> Seen:
        """Where the tool is at a group's rows, ``tip`` (4, 3, m); at the tip where its place is not known yet."""
        tool = state.own.get((TOOL, group.target), np.zeros(3))
        R = tip[:3].transpose(2, 1, 0)
        rows, seen = group.rows, self.seen
        p = tip[3].T + R @ tool
        return Seen(
            group.feature,
            p,
            R,
            seen.value[rows],
            seen.xyz[rows],
            seen.rotation[rows],
            state.T_world_base,
            None if seen.corners is None else seen.corners[rows],
            {name: state.own[key] for name, key in group.keys().items() if key in state.own},
        )

    def own_of(self, state: FeatureState, group: Group) -> dict[str, FloatArray]:
        """The unknowns of a group's kind; a centre that is known in the measuring frame is brought to the base link."""
        own = dict(group.kind.fixed(group.feature))
        own |= {name: state.own[key] for name, key in group.keys().items()}
        if "centre" in group.kind.own and "centre" not in own:
            world = self.seen.xyz[group.rows] if group.measured else group.feature.centre
            assert world is not None
            own["centre"] = frames.apply(frames.inverse(state.T_world_base), np.atleast_2d(world))
        return own

    def misses(self, state: FeatureState) -> Iterator[Missed]:
        """What every group misses."""
        arm = self.arm_of(state)
        for group in self.groups:
            path = self.walk(state, group.rows, arm)
            seen, own = self.seen_of(state, group, path.tip), self.own_of(state, group)
            yield Missed(group, seen, own, path, group.kind.misses(seen, own))

    def residuals(self, state: FeatureState) -> FloatArray:
        """Size of what each row misses, metres, shape (rows,): the distance of places; turns are left out."""
        out = np.full(len(self.seen), np.nan)
        for one in self.misses(state):
            size = one.found.size
            out[one.group.rows] = np.linalg.norm(one.found.r[:, :3], axis=1) if size is None else size
        return out

    def length_errors(self, state: FeatureState) -> FloatArray:
        """Found minus known length of each pair of features that are both unknown, metres."""
        own = state.own
        return np.array(
            [
                observations.length_misses(own["centre", one.first], own["centre", one.second], one.length)[0]
                for one in self.seen.lengths
                if ("centre", one.first) in own and ("centre", one.second) in own
            ]
        )

    # ---------------------------------------------------------------- the linear model

    def dense(self, state: FeatureState, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model in blocks of rows; the flat columns are steps, the terms' count from nominal.

        Parameters
        ----------
        state : FeatureState
        columns : ndarray of int, optional
            Numbers of the terms' columns wanted beside the flat ones, from 0; all unless given.
        """
        chosen = np.arange(len(self.terms)) if columns is None else columns
        width = self.flat + len(chosen)
        sizes = np.concatenate([self.sizes[: self.flat], self.sizes[self.flat + chosen]])
        values = state.coefficients[chosen] / sizes[self.flat :]
        for one in self.misses(state):
            rows, r = one.group.rows, one.found.r
            J = np.zeros((width, *r.shape))
            if len(chosen):
                J[self.flat :] = self._by_terms(one, chosen)
            self._flat_columns(J, one)
            w = self.weights[rows][:, None] / MM
            J *= w
            J *= sizes[:, None, None]
            y = np.einsum("c,cmk->mk", values, J[self.flat :]) - r * w
            each = np.repeat(rows, r.shape[1])
            yield Rows(J.reshape(width, r.size), y.ravel(), self.pose[each], each)
        if self.lengths:
            yield self._of_lengths(state, width)
        if self.expected:
            yield self._of_expected(state, width)

    def sums(self, state: FeatureState, columns: IntArray | None = None) -> NormalEquations:
        """Normal equations of the linear model; columns as `dense`."""
        width = self.flat + (len(self.terms) if columns is None else len(columns))
        H, g, yy, equations = np.zeros((width, width)), np.zeros(width), 0.0, 0
        for part in self.dense(state, columns):
            H += part.J @ part.J.T
            g += part.J @ part.y
            yy += float(part.y @ part.y)
            equations += len(part.y)
        return NormalEquations(H, g, yy, equations)

    def _by_terms(self, one: Missed, chosen: IntArray) -> FloatArray:
        """Derivatives of a group's residuals by terms, shape (terms, m, k), SI units."""
        group, path, found = one.group, one.path, one.found
        pose = np.arange(len(group.rows))
        here = Situation(self.arm, self.motion.select(group.rows))
        out = np.zeros((len(chosen), *found.r.shape))
        for constant in (True, False):
            where = np.flatnonzero(self.geometry[chosen] == constant)
            if not len(where):
                continue
            terms = [self.terms[k] for k in chosen[where]]
            values = np.ones((len(terms), len(pose))) if constant else basis_values(terms, here)
            if group.kind.pointed:
                moves = term_columns(terms, chain.point_columns(path, one.seen.p.T, pose, constant), values, pose)
                out[where] = np.einsum("mki,cim->cmk", found.point, moves, optimize=True)
            if found.turn is not None:
                turns = term_columns(terms, chain.turn_columns(path, pose, constant), values, pose)
                out[where] += np.einsum("mki,cim->cmk", found.turn, turns, optimize=True)
        return out

    def points_by_terms(self, path: chain.Walk, p: FloatArray, motion: Motion) -> FloatArray:
        """Derivative of points p (m, 3) at some joints by all terms, shape (terms, 3, m), SI units."""
        pose, here = np.arange(len(p)), Situation(self.arm, motion)
        out = np.zeros((len(self.terms), 3, len(p)))
        for constant in (True, False):
            where = np.flatnonzero(self.geometry == constant)
            terms = [self.terms[k] for k in where]
            values = basis_values(terms, here)
            out[where] = term_columns(terms, chain.point_columns(path, p.T, pose, constant), values, pose)
        return out

    def _flat_columns(self, J: FloatArray, one: Missed) -> None:
        """Derivatives by base, tool and features into (columns, m, k), SI units."""
        group, found = one.group, one.found
        key = (TOOL, group.target)
        if group.kind.pointed and key in self.layout:
            at = self.layout[key][1]
            J[at : at + 3] += np.einsum("mki,aim->amk", found.point, one.path.tip[:3])
        for name, key in group.keys().items():
            if key in self.layout:
                shape, at = self.layout[key]
                assert shape is not None
                J[at : at + observations.DIMENSIONS[shape]] += found.own[name].transpose(2, 0, 1)
        if BASE not in self.layout or not self._in_world(group):
            return
        if "base" in found.own:
            J[:6] += found.own["base"].transpose(2, 0, 1)
        else:  # as the base turns and shifts, a place c of the measuring frame moves by -w x c - t
            by, c = found.own["centre"], np.broadcast_to(one.own["centre"], (len(group.rows), 3))
            J[:3] += (by @ observations.cross(c)).transpose(2, 0, 1)
            J[3:6] -= by.transpose(2, 0, 1)

    def _of_lengths(self, state: FeatureState, width: int) -> Rows:
        """Known lengths as rows; they belong to no row of the file."""
        J, y = np.zeros((width, len(self.lengths))), np.zeros(len(self.lengths))
        for k, one in enumerate(self.lengths):
            keys = ("centre", one.first), ("centre", one.second)
            miss, by = observations.length_misses(state.own[keys[0]], state.own[keys[1]], one.length)
            w = np.clip(self.typical / max(one.u95, 1e-9), 0.01, 100.0) / MM
            for key, sign in zip(keys, (1.0, -1.0), strict=True):
                at = self.layout[key][1]
                J[at : at + 3, k] = sign * by * w * self.sizes[at : at + 3]
            y[k] = -miss * w
        return self._beside(J, y, 0)

    def _beside(self, J: FloatArray, y: FloatArray, before: int) -> Rows:
        """Rows of no measurement, each as if of a pose of its own."""
        return Rows(J, y, self.seen.poses + before + np.arange(len(y)), np.full(len(y), -1))

    def _of_expected(self, state: FeatureState, width: int) -> Rows:
        """What is known of unknowns beforehand as rows."""
        J, y = np.zeros((width, len(self.expected))), np.zeros(len(self.expected))
        for k, (key, one) in enumerate(self.expected.items()):
            at, w = self.layout[key][1], self.typical / MM / one.u95
            J[at, k] = w * self.sizes[at]
            y[k] = w * float(one.value[0] - state.own[key][0])
        return self._beside(J, y, len(self.lengths))


def _groups(seen: FeatureSet) -> list[Group]:
    """Rows by kind, feature and target, in parts of `BLOCK` rows; refused where something is missing."""
    out = []
    for name in dict.fromkeys(seen.kind):
        kind = KINDS.get(str(name))
        mine = seen.kind == name
        if kind is None:
            raise MeasurementError(
                f"unknown kind {name!r} of a row: kinds are {', '.join(KINDS)}",
                file=seen.source,
                row=int(seen.row[mine][0]),
                column="kind",
            )
        for feature in dict.fromkeys(seen.feature[mine]):
            for target in dict.fromkeys(seen.target[mine & (seen.feature == feature)]):
                rows = np.flatnonzero(mine & (seen.feature == feature) & (seen.target == target))
                _check(seen, kind, str(feature), rows)
                what = seen.features.get(str(feature), Feature(str(feature), kind.name, str(target)))
                measured = not feature and "centre" in kind.own
                out += [
                    Group(kind, what, str(target), rows[at : at + BLOCK], measured) for at in range(0, len(rows), BLOCK)
                ]
    return out


def _check(seen: FeatureSet, kind: Kind, feature: str, rows: IntArray) -> None:
    """Whether rows have what their kind needs."""
    own = any(item.of == "feature" for item in kind.own.values())
    needs = (*kind.needs, *(("xyz",) if not feature and "centre" in kind.own else ()))
    if not feature and own and kind.name != "point":
        raise MeasurementError(
            f"a row of kind {kind.name} needs its feature",
            file=seen.source,
            row=int(seen.row[rows[0]]),
            column="feature",
        )
    columns = {"value": "value_mm" if kind.pointed else "value_deg", "xyz": "x_mm", "rotation": "qw"}
    for need in [need for need in needs if need in columns]:  # images are whole as they are read
        bad = ~np.isfinite(getattr(seen, need)[rows].reshape(len(rows), -1)).all(axis=1)
        if bad.any():
            raise MeasurementError(
                f"a row of kind {kind.name} needs {need if need != 'value' else columns[need]}"
                + (" (or the name of the feature that it is at)" if need == "xyz" and not feature else ""),
                file=seen.source,
                row=int(seen.row[rows[bad][0]]),
                column=columns[need],
            )


def refuse_undetermined(problem: FeatureProblem, sums: NormalEquations) -> None:
    """Refuse rows that leave base, tool or features open even on the robot as it is.

    Raises
    ------
    IdentificationError
        With what is open.
    """
    if not problem.flat:
        return
    H = sums.H[: problem.flat, : problem.flat]
    scale = np.sqrt(np.maximum(np.diagonal(H), 1e-30))
    value, vector = np.linalg.eigh(H / np.outer(scale, scale))
    if value[0] > 1e-11 and scale.min() > 1e-12:
        return
    worst = int(np.argmax(np.abs(vector[:, 0] / scale)))
    starts = sorted((at, key) for key, (_, at) in problem.layout.items())
    name, of = [key for at, key in starts if at <= worst][-1]
    what = {"tool": f"the place of {of} on the tool", "base": "the base in the measuring frame"}.get(
        name, f"{name} of {of}"
    )
    raise IdentificationError(
        f"these rows do not tell {what}: turn the tool about more axes there, touch more of it, or say what is known"
    )


STEPS = 200
"""Steps of the damped least squares."""

FALL = 1e-10
"""Relative fall of the sum of squares below which it has arrived."""


def start(problem: FeatureProblem) -> FeatureState:
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


def start_of_features(problem: FeatureProblem, state: FeatureState) -> FeatureState:
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


def settle(problem: FeatureProblem, state: FeatureState, steps: int = STEPS) -> FeatureState:
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


def tracked(problem: FeatureProblem) -> PointSet | None:
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


def _tools(problem: FeatureProblem, zero: FeatureState) -> dict[str, FloatArray]:
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


def _features(problem: FeatureProblem, zero: FeatureState, tools: dict[str, FloatArray]) -> FeatureState:
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
