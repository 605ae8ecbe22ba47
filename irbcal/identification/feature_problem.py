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
from irbcal.identification.observations import KINDS, Kind, Misses, Observed, Shape
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
        for name, unknown in self.kind.own.items():
            if name == "centre" and (self.measured or self.feature.centre is not None):
                continue
            if name not in self.kind.fixed(self.feature):
                out[name] = (name, self.feature.name if unknown.of == "feature" else self.target)
        return out


@dataclass(frozen=True, eq=False)
class Missed:
    """What a group misses at one state."""

    group: Group
    seen: Observed
    own: Mapping[str, FloatArray]
    path: chain.Walk
    found: Misses


class FeatureProblem:
    """Rows at features against an arm with terms.

    Parameters
    ----------
    arm : Arm
        Nominal.
    rows : FeatureSet
    terms : sequence of Term
        All that may be fitted.
    fixed : dict, optional
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
        rows: FeatureSet,
        terms: Sequence[Term],
        fixed: Mapping[Key, FloatArray] | None = None,
        base: FloatArray | None = None,
    ) -> None:
        self.arm, self.seen, self.terms = arm, rows, list(terms)
        self.held = dict(fixed or {})
        self.known_base = base
        self.groups = _groups(rows)
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
                unknown = group.kind.own[name]
                shapes.setdefault(key, (unknown.shape, unknown.unit))
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
        self.motion = rows.motion()
        self.pose = np.unique(rows.pose_index, return_inverse=True)[1].ravel()
        u95 = np.where(np.isfinite(rows.u95), rows.u95, ROW_U95)
        self.typical = float(np.median(u95))
        self.weights: FloatArray = np.clip(self.typical / np.maximum(u95, 1e-9), 0.01, 100.0)
        self.lengths = [length for length in rows.lengths if ("centre", length.first) in self.layout]
        self.lengths = [length for length in self.lengths if ("centre", length.second) in self.layout]
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
            constants = [k for k, t in enumerate(self.terms) if self.geometry[k] and DHM_COLUMNS[t.axis] == kind]
            if constants:
                column = getattr(table, kind).copy()
                for k in constants:
                    column[self.terms[k].joint] += state.coefficients[k]
                table = replace(table, **{kind: column})
        return self.arm.with_table(table)

    def term_map(self, state: FeatureState) -> TermMap:
        """Its terms beside the geometry."""
        return replace(self.others, coefficients=state.coefficients[~self.geometry])

    def moved(self, state: FeatureState, step: FloatArray) -> FeatureState:
        """A state after a step of the flat columns, in their units; coefficients stay unless the step has them, too."""
        si = step[: self.flat] * self.sizes[: self.flat]
        values, T = dict(state.own), state.T_world_base
        for key, (shape, at) in self.layout.items():
            if shape is None:
                T = T @ frames.transform(frames.rotation_from_vector(si[:3]), si[3:6])
            else:
                values[key] = observations.moved(shape, values[key], si[at : at + observations.DIMENSIONS[shape]])
        if len(step) == self.flat:
            return replace(state, own=values, T_world_base=T)
        return FeatureState(values, step[self.flat :] * self.sizes[self.flat :], T)

    # ---------------------------------------------------------------- predictions

    def walk(self, state: FeatureState, rows: IntArray, arm: Arm | None = None) -> chain.Walk:
        """The chain at some rows' joints."""
        motion = self.motion.select(rows)
        arm = self.arm_of(state) if arm is None else arm
        if not self.others.terms or not state.coefficients[~self.geometry].any():
            return chain.walk(arm, motion.q)
        return chain.walk(arm, *self.term_map(state).split(motion))

    def seen_of(self, state: FeatureState, group: Group, tip: FloatArray) -> Observed:
        """Where the tool is at a group's rows, ``tip`` (4, 3, m); at the tip where its place is not known yet."""
        tool = state.own.get((TOOL, group.target), np.zeros(3))
        R = tip[:3].transpose(2, 1, 0)
        rows, features = group.rows, self.seen
        p = tip[3].T + R @ tool
        return Observed(
            group.feature,
            p,
            R,
            features.value[rows],
            features.xyz[rows],
            features.rotation[rows],
            state.T_world_base,
            None if features.corners is None else features.corners[rows],
            {name: state.own[key] for name, key in group.keys().items() if key in state.own},
        )

    def own_of(self, state: FeatureState, group: Group) -> dict[str, FloatArray]:
        """The unknowns of a group's kind; a centre that is known in the measuring frame is brought to the base link."""
        values = dict(group.kind.fixed(group.feature))
        values |= {name: state.own[key] for name, key in group.keys().items()}
        if "centre" in group.kind.own and "centre" not in values:
            world = self.seen.xyz[group.rows] if group.measured else group.feature.centre
            assert world is not None
            values["centre"] = frames.apply(frames.inverse(state.T_world_base), np.atleast_2d(world))
        return values

    def misses(self, state: FeatureState) -> Iterator[Missed]:
        """What every group misses."""
        arm = self.arm_of(state)
        for group in self.groups:
            path = self.walk(state, group.rows, arm)
            obs, values = self.seen_of(state, group, path.tip), self.own_of(state, group)
            yield Missed(group, obs, values, path, group.kind.misses(obs, values))

    def residuals(self, state: FeatureState) -> FloatArray:
        """Size of what each row misses, metres, shape (rows,): the distance of places; turns are left out."""
        out = np.full(len(self.seen), np.nan)
        for missed in self.misses(state):
            size = missed.found.size
            out[missed.group.rows] = np.linalg.norm(missed.found.r[:, :3], axis=1) if size is None else size
        return out

    def length_errors(self, state: FeatureState) -> FloatArray:
        """Found minus known length of each pair of features that are both unknown, metres."""
        values = state.own
        return np.array(
            [
                observations.length_misses(
                    values["centre", length.first], values["centre", length.second], length.length
                )[0]
                for length in self.seen.lengths
                if ("centre", length.first) in values and ("centre", length.second) in values
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
        for missed in self.misses(state):
            rows, r = missed.group.rows, missed.found.r
            J = np.zeros((width, *r.shape))
            if len(chosen):
                J[self.flat :] = self._by_terms(missed, chosen)
            self._flat_columns(J, missed)
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
        for block in self.dense(state, columns):
            H += block.J @ block.J.T
            g += block.J @ block.y
            yy += float(block.y @ block.y)
            equations += len(block.y)
        return NormalEquations(H, g, yy, equations)

    def _by_terms(self, missed: Missed, chosen: IntArray) -> FloatArray:
        """Derivatives of a group's residuals by terms, shape (terms, m, k), SI units."""
        group, path, misses = missed.group, missed.path, missed.found
        terms = [self.terms[k] for k in chosen]
        values = basis_values(terms, Situation(self.arm, self.motion.select(group.rows)))
        out = np.zeros((len(chosen), *misses.r.shape))
        if group.kind.pointed:
            moves = term_columns(terms, path, values, missed.seen.p.T)
            out += np.einsum("mki,cim->cmk", misses.point, moves, optimize=True)
        if misses.turn is not None:
            out += np.einsum("mki,cim->cmk", misses.turn, term_columns(terms, path, values), optimize=True)
        return out

    def points_by_terms(self, path: chain.Walk, p: FloatArray, motion: Motion) -> FloatArray:
        """Derivative of points p (m, 3) at some joints by all terms, shape (terms, 3, m), SI units."""
        return term_columns(self.terms, path, basis_values(self.terms, Situation(self.arm, motion)), p.T)

    def _flat_columns(self, J: FloatArray, missed: Missed) -> None:
        """Derivatives by base, tool and features into (columns, m, k), SI units."""
        group, misses = missed.group, missed.found
        key = (TOOL, group.target)
        if group.kind.pointed and key in self.layout:
            at = self.layout[key][1]
            J[at : at + 3] += np.einsum("mki,aim->amk", misses.point, missed.path.tip[:3])
        for name, key in group.keys().items():
            if key in self.layout:
                shape, at = self.layout[key]
                assert shape is not None
                J[at : at + observations.DIMENSIONS[shape]] += misses.own[name].transpose(2, 0, 1)
        if BASE not in self.layout or not self._in_world(group):
            return
        if "base" in misses.own:
            J[:6] += misses.own["base"].transpose(2, 0, 1)
        else:  # as the base turns and shifts, a place c of the measuring frame moves by -w x c - t
            by, c = misses.own["centre"], np.broadcast_to(missed.own["centre"], (len(group.rows), 3))
            J[:3] += (by @ observations.cross(c)).transpose(2, 0, 1)
            J[3:6] -= by.transpose(2, 0, 1)

    def _of_lengths(self, state: FeatureState, width: int) -> Rows:
        """Known lengths as rows; they belong to no row of the file."""
        J, y = np.zeros((width, len(self.lengths))), np.zeros(len(self.lengths))
        for k, length in enumerate(self.lengths):
            keys = ("centre", length.first), ("centre", length.second)
            miss, by = observations.length_misses(state.own[keys[0]], state.own[keys[1]], length.length)
            w = np.clip(self.typical / max(length.u95, 1e-9), 0.01, 100.0) / MM
            for key, sign in zip(keys, (1.0, -1.0), strict=True):
                at = self.layout[key][1]
                J[at : at + 3, k] = sign * by * w * self.sizes[at : at + 3]
            y[k] = -miss * w
        return self._beside(J, y, 0)

    def _beside(self, J: FloatArray, y: FloatArray, count: int) -> Rows:
        """Rows of no measurement, each as if of a pose of its own."""
        return Rows(J, y, self.seen.poses + count + np.arange(len(y)), np.full(len(y), -1))

    def _of_expected(self, state: FeatureState, width: int) -> Rows:
        """What is known of unknowns beforehand as rows."""
        J, y = np.zeros((width, len(self.expected))), np.zeros(len(self.expected))
        for k, (key, prior) in enumerate(self.expected.items()):
            at, w = self.layout[key][1], self.typical / MM / prior.u95
            J[at, k] = w * self.sizes[at]
            y[k] = w * float(prior.value[0] - state.own[key][0])
        return self._beside(J, y, len(self.lengths))


def _groups(seen: FeatureSet) -> list[Group]:
    """Rows by kind, feature and target, in parts of `BLOCK` rows; refused where something is missing."""
    out = []
    for name in dict.fromkeys(seen.kind):
        kind = KINDS.get(str(name))
        of_kind = seen.kind == name
        if kind is None:
            raise MeasurementError(
                f"unknown kind {name!r} of a row: kinds are {', '.join(KINDS)}",
                file=seen.source,
                row=int(seen.row[of_kind][0]),
                column="kind",
            )
        for feature in dict.fromkeys(seen.feature[of_kind]):
            for target in dict.fromkeys(seen.target[of_kind & (seen.feature == feature)]):
                rows = np.flatnonzero(of_kind & (seen.feature == feature) & (seen.target == target))
                _check(seen, kind, str(feature), rows)
                feature_of_rows = seen.features.get(str(feature), Feature(str(feature), kind.name, str(target)))
                measured = not feature and "centre" in kind.own
                out += [
                    Group(kind, feature_of_rows, str(target), rows[at : at + BLOCK], measured)
                    for at in range(0, len(rows), BLOCK)
                ]
    return out


def _check(measured: FeatureSet, kind: Kind, feature: str, rows: IntArray) -> None:
    """Whether rows have what their kind needs."""
    has_feature = any(unknown.of == "feature" for unknown in kind.own.values())
    needs = (*kind.needs, *(("xyz",) if not feature and "centre" in kind.own else ()))
    if not feature and has_feature and kind.name != "point":
        raise MeasurementError(
            f"a row of kind {kind.name} needs its feature",
            file=measured.source,
            row=int(measured.row[rows[0]]),
            column="feature",
        )
    columns = {"value": "value_mm" if kind.pointed else "value_deg", "xyz": "x_mm", "rotation": "qw"}
    for need in [need for need in needs if need in columns]:  # images are whole as they are read
        bad = ~np.isfinite(getattr(measured, need)[rows].reshape(len(rows), -1)).all(axis=1)
        if bad.any():
            raise MeasurementError(
                f"a row of kind {kind.name} needs {need if need != 'value' else columns[need]}"
                + (" (or the name of the feature that it is at)" if need == "xyz" and not feature else ""),
                file=measured.source,
                row=int(measured.row[rows[bad][0]]),
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
    name, name_of_unknown = [key for at, key in starts if at <= worst][-1]
    subject = {"tool": f"the place of {name_of_unknown} on the tool", "base": "the base in the measuring frame"}.get(
        name, f"{name} of {name_of_unknown}"
    )
    raise IdentificationError(
        f"these rows do not tell {subject}: turn the tool about more axes there, touch more of it, or say what is known"
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
    best, smallest = None, np.inf
    for tools in candidates:
        try:
            state = settle(problem, _features(problem, zero, tools))
        except (np.linalg.LinAlgError, IdentificationError):
            continue
        rss = problem.sums(state, np.zeros(0, dtype=int)).yy
        if rss < smallest:
            best, smallest = state, rss
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
    values = dict(problem.held)
    for group in problem.groups:
        if group.measured:
            continue
        current = replace(state, own=values)
        obs = problem.seen_of(current, group, problem.walk(current, group.rows).tip)
        for name, key in group.keys().items():
            values.setdefault(key, group.kind.start(obs)[name])
    settled = settle(problem, replace(state, own=values))
    refuse_undetermined(problem, problem.sums(settled, np.zeros(0, dtype=int)))
    return settled


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


def points_of(measured: FeatureSet, rows: FloatArray) -> PointSet:
    """Rows with positions as points, sorted by pose."""
    rows = rows[np.argsort(measured.pose_index[rows], kind="stable")]
    _, first, pose = np.unique(measured.pose_index[rows], return_index=True, return_inverse=True)
    names = tuple(sorted(set(measured.target[rows].astype(str))))
    number = np.array([names.index(str(name)) for name in measured.target[rows]])
    rotation = measured.rotation[rows]
    return PointSet(
        measured.q[rows][first],
        pose,
        number,
        measured.xyz[rows],
        names,
        measured.pose[rows][first],
        np.full(len(first), "", dtype=object),
        rotation if np.isfinite(rotation).all(axis=(1, 2)).any() else None,
    )


def _tools(problem: FeatureProblem, zero: FeatureState) -> dict[str, FloatArray]:
    """Places of the targets in the tip link, each from the rows that tell it."""
    estimates: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for group in problem.groups:
        if not group.kind.pointed or (TOOL, group.target) in problem.held or group.measured:
            continue
        obs = problem.seen_of(replace(zero, own={}), group, problem.walk(zero, group.rows, problem.arm).tip)
        estimate = group.kind.tool(obs)
        if estimate is not None and np.isfinite(estimate[0]).all():
            estimates.setdefault(group.target, []).append(estimate)
    return {
        name: np.asarray(np.linalg.solve(sum(H for _, H in pairs), sum(H @ t for t, H in pairs)), dtype=float)
        for name, pairs in estimates.items()
    }


def _features(problem: FeatureProblem, zero: FeatureState, tools: dict[str, FloatArray]) -> FeatureState:
    """All unknowns from the tool's places: first what a tracker saw, then features in closed form, then the base."""
    values, T = dict(zero.own), zero.T_world_base
    points = tracked(problem)
    if points is not None and problem.known_base is None:
        solution = first_state(Problem(problem.arm, points, ()))
        T = solution.T_world_base
        for k, name in enumerate(points.target_names):
            values.setdefault((TOOL, name), solution.targets[k])
            values.setdefault(("axes", name), solution.rotations[k])
    for key in problem.layout:
        if key[0] == TOOL:
            values.setdefault(key, tools.get(key[1], np.zeros(3)))
    state = replace(zero, own=values, T_world_base=T)
    centres = []
    for group in problem.groups:
        if group.measured:
            continue
        obs = problem.seen_of(state, group, problem.walk(state, group.rows, problem.arm).tip)
        found_own = group.kind.start(obs)
        if group.feature.centre is not None and "centre" in found_own:
            centres.append((found_own["centre"], group.feature.centre))
        for name, key in group.keys().items():
            if name in found_own:
                values.setdefault(key, found_own[name])
    if points is None and problem.framed and problem.known_base is None:
        centres_base, centres_world = (np.array(list(column)) for column in zip(*centres, strict=True))
        T = rigid(centres_base, centres_world)
    return FeatureState(values, zero.coefficients, T)


def rigid(points: FloatArray, targets: FloatArray) -> FloatArray:
    """The motion (4, 4) that brings places (n, 3) nearest to others."""
    a, b = points.mean(axis=0), targets.mean(axis=0)
    U, _, Vt = np.linalg.svd((targets - b).T @ (points - a))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return frames.transform(R, b - R @ a)
