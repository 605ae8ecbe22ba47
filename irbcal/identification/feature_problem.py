"""All rows at features against an arm: the linear model of base, tool, features and terms at one state.

The kinds of `irbcal.identification.observations` say what a row misses and how that moves with the tool's point. Here
both are chained along the cell's graph of frames (`irbcal.modeling.cell_graph`): a row looks at a point of one frame,
its *carrier* (usually the flange), from another, in which the feature is known (the measuring frame, a work object) or
else sought (the robot base). Unknown edges on that path, the arm's terms, the tool and the features get their
derivatives there. Base, tool and features on the robot as it is come from closed forms, then a damped least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import observation_kind
from irbcal.identification.evidence_maximisation import NormalEquations
from irbcal.identification.initial_guess import first_state
from irbcal.identification.linear_model import Rows
from irbcal.identification.observation_kind import (
    DIMENSIONS,
    STEP_OF_UNIT,
    Kind,
    Observed,
    Residuals,
    UnknownShape,
)
from irbcal.identification.observations import KINDS
from irbcal.identification.problem import Problem
from irbcal.identification.relations import RELATION_KINDS
from irbcal.measurement.features import Feature, FeatureSet, Relation
from irbcal.measurement.points import PointSet
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.cell_graph import ARM, FLANGE, WORLD, Edge, RelativeFrame
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermModel
from irbcal.units import MM

BLOCK = 1500
"""Rows whose Jacobian is in memory at a time."""

REMEMBERED = 20_000
"""Rows up to which chains are kept while coefficients stay as they are."""

ROW_U95 = 0.1 * MM
"""Uncertainty of a row that tells none, metres: what a contact repeats to on an industrial arm."""

RAD = 1e-3
"""Radians: the unit of turns that have no prior."""

NO_TERMS: IntArray = np.zeros(0, dtype=int)
"""Columns of the nuisance unknowns alone."""

UnknownKey: TypeAlias = tuple[str, str]
"""Name of an unknown, and its feature or target: ``("centre", "A")``, ``("tool", "ball")``, ``("base", "")``."""

BASE: UnknownKey = ("base", "")
"""The robot base in the measuring frame."""
STANDING = (cell_graph.BASE, cell_graph.FLOOR)
"""Frames whose points are places of features."""
TOOL, FRAME, SCREW = "tool", "frame", "screw"


def edge_key(edge: Edge) -> UnknownKey:
    """Key of an unknown edge."""
    return (SCREW, edge.child) if edge.e is not None else BASE if edge.child == cell_graph.BASE else (FRAME, edge.child)


@dataclass(frozen=True, eq=False)
class FeatureState:
    """One candidate."""

    values: Mapping[UnknownKey, FloatArray]
    """Unknowns of frames, tool and features by their key."""
    coefficients: FloatArray
    """Shape (terms,). SI units."""

    @property
    def T_world_base(self) -> FloatArray:
        """The robot base in the measuring frame, shape (4, 4); the identity where nothing ties them."""
        return self.values.get(BASE, np.eye(4))


@dataclass(frozen=True, eq=False)
class Group:
    """Rows of one kind at one feature with one target."""

    kind: Kind
    feature: Feature
    target: str
    """Whose point is looked at: a target of the tool, or the feature whose place is ``carrier``'s."""
    rows: IntArray
    measured: bool
    """Whether the place is the row's own, in ``frame``."""
    frame: str
    """In which the feature is known, or sought."""
    carrier: str = FLANGE
    """Whose point is looked at: the flange, the frame of a tool, or the base, which carries places."""

    @property
    def point(self) -> UnknownKey:
        """Key of the point that is looked at."""
        return ("centre" if self.carrier in STANDING else TOOL, self.target)

    def keys(self) -> dict[str, UnknownKey]:
        """Its unknowns by their name in the kind."""
        out, fixed = {}, self.kind.fixed(self.feature)
        for name, unknown in self.kind.unknowns.items():
            if name == "centre" and (self.measured or self.feature.centre is not None):
                continue
            if name not in fixed:
                out[name] = (name, self.feature.name if unknown.owner == "feature" else self.target)
        return out


@dataclass(frozen=True, eq=False)
class GroupResiduals:
    """What a group misses at one state."""

    group: Group
    observed: Observed
    values: Mapping[str, FloatArray]
    path: chain.Walk
    residuals: Residuals
    view: RelativeFrame
    p: FloatArray
    """The point in the base link, shape (m, 3)."""

    @property
    def in_base(self) -> dict[str, FloatArray]:
        """Places and turns of the feature brought to the base link; all else as it is."""
        T = frames.inverse(self.view.frames[cell_graph.BASE][0])
        out = dict(self.values)
        for name, value in self.values.items():
            unknown = self.group.kind.unknowns.get(name)
            if name == "centre":
                out[name] = frames.apply(T, np.atleast_2d(value)).reshape(value.shape)
            elif unknown is not None and (unknown.shape, unknown.owner) == ("turn", "feature"):
                out[name] = T[:3, :3] @ value
        return out


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
        Unknowns of frames, tool and features that are known, by their key.
    edges : sequence of Edge, optional
        Of frames beside base, flange and measuring frame. A frame that rows name and no edge joins is a work object of
        unknown place on the robot base.
    robot : Robot, optional
        Whose kinematics are taken, where no terms are fitted; the arm unless given.

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
        fixed: Mapping[UnknownKey, FloatArray] | None = None,
        edges: Sequence[Edge] = (),
        robot: Robot | None = None,
    ) -> None:
        self.arm, self.rows, self.terms, self.robot = arm, rows, list(terms), robot
        self.fixed = dict(fixed or {})
        self.groups = _groups(rows)
        self.edges = [ARM if rows.flange is None else Edge(cell_graph.BASE, FLANGE, rows.flange), *edges]
        named = dict.fromkeys(name for group in self.groups for name in (group.frame, group.carrier))
        joined = {cell_graph.BASE, FLANGE, *(name for edge in edges for name in (edge.parent, edge.child))}
        for name in [name for name in named if name not in joined]:
            self.edges.append(Edge(WORLD, cell_graph.BASE) if name == WORLD else Edge(cell_graph.BASE, name))
        self.in_frame = WORLD in named
        shapes: dict[UnknownKey, tuple[UnknownShape, str]] = {}
        for edge in self.edges:
            if edge is not ARM and edge.T is None:
                shapes[edge_key(edge)] = "frame" if edge.e is None else "screw", "m"
        for group in self.groups:
            if group.kind.pointed and group.carrier in (FLANGE, *STANDING):
                shapes.setdefault(group.point, ("place", "m"))
            for name, key in group.keys().items():
                unknown = group.kind.unknowns[name]
                shapes.setdefault(key, (unknown.shape, unknown.unit))
        order = {"base": 0, FRAME: 1, TOOL: 2, "axes": 3}
        self.layout: dict[UnknownKey, tuple[UnknownShape, int]] = {}
        """Key -> (shape, first column)."""
        units: list[FloatArray] = []
        for key in sorted(shapes, key=lambda key: order.get(key[0], 4)):
            if key in self.fixed:
                continue
            shape, unit = shapes[key]
            self.layout[key] = shape, int(sum(map(len, units)))
            size = np.full(DIMENSIONS[shape], STEP_OF_UNIT[unit])
            size[: {"line": 2, "frame": 3, "screw": 3}.get(shape, 0)] = RAD
            units.append(size)
        self.nuisance = int(sum(map(len, units)))
        """Number of unknowns of base, tool and features."""
        self.sizes: FloatArray = np.concatenate([*units, np.array([t.size for t in self.terms])])
        self._walked: tuple[FloatArray | None, dict[int, chain.Walk]] = None, {}
        self.geometry = np.array([t.family == "geometry" for t in self.terms], dtype=bool)
        self.term_model = TermModel(arm, self.terms, at_frames=True)
        self.motion = rows.motion()
        self.pose = np.unique(rows.pose_index, return_inverse=True)[1].ravel()
        self.u95: FloatArray = rows.u95.copy()
        """Shape (m,). Stated 95 % uncertainty of each row's residual, metres; NaN where none is."""
        for group in self.groups:
            self.u95[group.rows] *= group.kind.lever
        u95 = np.where(np.isfinite(self.u95), self.u95, ROW_U95)
        self.typical = float(np.median(u95))
        self.weights: FloatArray = np.clip(self.typical / np.maximum(u95, 1e-9), 0.01, 100.0)
        _check_relations(rows, self.groups)
        self.relations = [relation for relation in rows.relations if related(relation, self.layout)]
        self.priors = {
            key: group.kind.priors(group.feature)[name]
            for group in self.groups
            for name, key in group.keys().items()
            if key in self.layout and name in group.kind.priors(group.feature)
        }

    @property
    def noise(self) -> float:
        """Standard deviation of a row as the rows themselves tell it, mm."""
        return self.typical / NORMAL_95 / MM

    @property
    def scalars(self) -> int:
        """Number of equations of the rows."""
        return sum(group.kind.size * len(group.rows) for group in self.groups)

    @property
    def per_pose(self) -> float:
        """Equations in a pose, on average."""
        return self.scalars / self.rows.poses

    # ---------------------------------------------------------------- states

    def arm_at(self, state: FeatureState) -> Arm:
        """The arm with the constants of a state in its table."""
        return self.term_model.arm_at(state.coefficients)

    def moved(self, state: FeatureState, step: FloatArray) -> FeatureState:
        """A state after a step of the nuisance columns, in their units; coefficients stay unless the step has them."""
        si = step[: self.nuisance] * self.sizes[: self.nuisance]
        values = dict(state.values)
        for key, (shape, at) in self.layout.items():
            values[key] = observation_kind.moved(shape, values[key], si[at : at + DIMENSIONS[shape]])
        if len(step) == self.nuisance:
            return replace(state, values=values)
        return FeatureState(values, step[self.nuisance :] * self.sizes[self.nuisance :])

    # ---------------------------------------------------------------- predictions

    def walk(self, state: FeatureState, group: Group) -> chain.Walk:
        """The chain at a group's rows."""
        if len(self.rows) > REMEMBERED:
            return self.walk_at(state, self.motion.select(group.rows))
        if self._walked[0] is not state.coefficients:
            path = self.walk_at(state, self.motion)
            self._walked = state.coefficients, {int(each.rows[0]): path.select(each.rows) for each in self.groups}
        return self._walked[1][int(group.rows[0])]

    def walk_at(self, state: FeatureState, motion: Motion) -> chain.Walk:
        """The chain at a motion."""
        if self.robot is not None:
            return self.robot.walk(motion)
        effective, xi = self.term_model.joints(motion.q, state.coefficients, partial(self.term_model.values, motion))
        return chain.walk(self.arm_at(state), effective.T, xi)

    def view(self, state: FeatureState, group: Group, path: chain.Walk) -> RelativeFrame:
        """A group's carrier in the axes of its frame, on a chain."""
        transforms = {FLANGE: chain.poses(path)}
        for edge in self.edges:
            if edge is not ARM:
                T = edge.at(state.values.get(edge_key(edge)))
                transforms[edge.child] = T if T.ndim == 2 else T[group.rows]
        return cell_graph.view(self.edges, transforms, group.frame, group.carrier, len(group.rows))

    def observed(self, state: FeatureState, group: Group, view: RelativeFrame) -> Observed:
        """Where the point is at a group's rows; at the carrier's origin where its place is not known yet."""
        R = view.T[:, :3, :3]
        rows, features = group.rows, self.rows
        return Observed(
            group.feature,
            view.T[:, :3, 3] + np.einsum("nij,nj->ni", R, self.point_of(state, group)),
            R,
            features.value[rows],
            features.xyz[rows],
            features.rotation[rows],
            None if features.corners is None else features.corners[rows],
            {name: state.values[key] for name, key in group.keys().items() if key in state.values},
        )

    def point_of(self, state: FeatureState, group: Group) -> FloatArray:
        """The point in its carrier, shape (m, 3)."""
        shape = len(group.rows), 3
        if group.carrier in (FLANGE, *STANDING):
            return np.broadcast_to(state.values.get(group.point, np.zeros(3)), shape)
        return np.zeros(shape) if self.rows.point is None else self.rows.point[group.rows]

    def values_of(self, state: FeatureState, group: Group) -> dict[str, FloatArray]:
        """The unknowns of a group's kind, in the axes of its frame."""
        values = dict(group.kind.fixed(group.feature))
        values |= {name: state.values[key] for name, key in group.keys().items()}
        if "centre" in group.kind.unknowns and "centre" not in values:
            known = self.rows.xyz[group.rows] if group.measured else group.feature.centre
            assert known is not None
            values["centre"] = known
        return values

    def residuals_of(self, state: FeatureState, group: Group, path: chain.Walk) -> GroupResiduals:
        """What a group misses on a chain."""
        view = self.view(state, group, path)
        obs, values = self.observed(state, group, view), self.values_of(state, group)
        p, T = obs.p, view.frames.get(cell_graph.BASE)
        if T is not None and group.frame != cell_graph.BASE:
            p = np.einsum("nji,nj->ni", T[:, :3, :3], p - T[:, :3, 3])
        return GroupResiduals(group, obs, values, path, group.kind.residuals(obs, values), view, p)

    def group_residuals(self, state: FeatureState) -> Iterator[GroupResiduals]:
        """What every group misses."""
        for group in self.groups:
            yield self.residuals_of(state, group, self.walk(state, group))

    def distances(self, state: FeatureState) -> FloatArray:
        """Size of what each row misses, metres, shape (rows,): the distance of places; turns are left out."""
        out = np.full(len(self.rows), np.nan)
        for of_group in self.group_residuals(state):
            size = of_group.residuals.size
            out[of_group.group.rows] = np.linalg.norm(of_group.residuals.r[:, :3], axis=1) if size is None else size
        return out

    # ---------------------------------------------------------------- the linear model

    def dense(self, state: FeatureState, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model in blocks of rows; the nuisance columns are steps, the terms' count from nominal.

        Parameters
        ----------
        state : FeatureState
        columns : ndarray of int, optional
            Numbers of the terms' columns wanted beside the nuisance ones, from 0; all unless given.
        """
        chosen = np.arange(len(self.terms)) if columns is None else columns
        width = self.nuisance + len(chosen)
        sizes = np.concatenate([self.sizes[: self.nuisance], self.sizes[self.nuisance + chosen]])
        values = state.coefficients[chosen] / sizes[self.nuisance :]
        for of_group in self.group_residuals(state):
            rows, r = of_group.group.rows, of_group.residuals.r
            J = np.zeros((width, *r.shape))
            if len(chosen):
                J[self.nuisance :] = self._by_terms(of_group, chosen)
            self._flat_columns(J, of_group, state)
            w = self.weights[rows][:, None] / MM
            J *= w
            J *= sizes[:, None, None]
            y = np.einsum("c,cmk->mk", values, J[self.nuisance :]) + r * w
            each = np.repeat(rows, r.shape[1])
            yield Rows(J.reshape(width, r.size), y.ravel(), self.pose[each], each)
        if self.relations or self.priors or any(key[0] == SCREW for key in self.layout):
            yield self.known_rows(state, width)

    def sums(self, state: FeatureState, columns: IntArray | None = None) -> NormalEquations:
        """Normal equations of the linear model; columns as `dense`."""
        width = self.nuisance + (len(self.terms) if columns is None else len(columns))
        return NormalEquations.total((block.sums() for block in self.dense(state, columns)), width)

    def _by_terms(self, of_group: GroupResiduals, chosen: IntArray) -> FloatArray:
        """Derivatives of a group's predictions by terms, shape (terms, m, k), SI units."""
        values = cache(partial(self.term_model.values, self.motion.select(of_group.group.rows)))
        columns = partial(self.term_model.columns, of_group.path, values, chosen=chosen)
        points = columns(p=of_group.p.T) if of_group.group.kind.pointed else None
        return self.by_arm(of_group, points, None if of_group.residuals.turn is None else columns())

    def by_arm(self, of_group: GroupResiduals, points: FloatArray | None, turns: FloatArray | None) -> FloatArray:
        """Derivatives of a group's predictions by what changes the arm.

        Parameters
        ----------
        of_group : GroupResiduals
        points : ndarray, shape (count, 3, m), or None
            Derivatives of the points as if fixed to the flange, in the base link; None where points do not matter.
        turns : ndarray, shape (count, 3, m), or None
            Derivatives of the flange's rotation vector likewise.

        Returns
        -------
        ndarray, shape (count, m, k)
            SI units; zero where the arm is not on the group's path.
        """
        misses, view = of_group.residuals, of_group.view
        pairs = [(by, moves) for by, moves in ((misses.point, points), (misses.turn, turns)) if moves is not None]
        out = np.zeros((len(pairs[0][1]), *misses.r.shape))
        if FLANGE in view.signs:
            R = view.signs[FLANGE] * view.frames[cell_graph.BASE][:, :3, :3]
            for by, moves in pairs:
                assert by is not None
                out += np.einsum("mki,cim->cmk", by @ R, moves, optimize=True)
        return out

    def _flat_columns(self, J: FloatArray, of_group: GroupResiduals, state: FeatureState) -> None:
        """Derivatives by frames, tool and features into (columns, m, k), SI units."""
        group, misses, view = of_group.group, of_group.residuals, of_group.view
        if group.kind.pointed and group.point in self.layout:
            at = self.layout[group.point][1]
            J[at : at + 3] += np.einsum("mki,mia->amk", misses.point, view.T[:, :3, :3])
        for name, key in group.keys().items():
            if key in self.layout:
                shape, at = self.layout[key]
                J[at : at + DIMENSIONS[shape]] += misses.by_unknown[name].transpose(2, 0, 1)
        for edge in self.edges:
            if edge is not ARM and edge.child in view.signs and edge_key(edge) in self.layout:
                at = self.layout[edge_key(edge)][1]
                by = self.by_edge(of_group, edge.child)
                if edge.e is not None:
                    D = cell_graph.screw_derivative(state.values[edge_key(edge)], edge.e[group.rows])
                    by = np.einsum("amk,mab->bmk", by, D)
                J[at : at + 6] += by

    def by_edge(self, of_group: GroupResiduals, child: str) -> FloatArray:
        """Derivatives of a group's predictions by a small motion of an edge on its path, shape (6, m, k)."""
        shift, turn = of_group.view.moved_by(child, of_group.observed.p)
        by = of_group.residuals.point @ shift
        if of_group.residuals.turn is not None:
            by = by + of_group.residuals.turn @ turn
        return by.transpose(2, 0, 1)

    def known_rows(self, state: FeatureState, width: int | None = None) -> Rows:
        """What is known beforehand (relations, priors, external axes), as rows of so many columns, all unless given.

        They belong to no row of the file, and each is as if of a pose of its own.
        """
        known = list(self._priors(state))
        weight = np.concatenate([weight for *_, weight in known])
        J = np.zeros((self.nuisance + len(self.terms) if width is None else width, len(weight)))
        at = 0
        for r, by, _ in known:
            columns = slice(at, at + len(r))
            for key, D in by.items():
                unknowns = slice(self.layout[key][1], self.layout[key][1] + D.shape[1])
                J[unknowns, columns] = D.T * weight[columns] * self.sizes[unknowns, None]
            at += len(r)
        y = weight * np.concatenate([r for r, *_ in known])
        return Rows(J, y, self.rows.poses + np.arange(at), np.full(at, -1))

    def _priors(self, state: FeatureState) -> Iterator[tuple[FloatArray, Mapping[UnknownKey, FloatArray], FloatArray]]:
        """Residuals (k,) of what is known beforehand, derivatives (k, d) of the predicted, and weights (k,), per mm."""
        for relation in self.relations:
            kind, keys = RELATION_KINDS[relation.kind], related(relation, self.layout)
            r, by = kind.residual(state.values[keys[0]], state.values[keys[1]], relation.value)
            weight = np.clip(self.typical / max(kind.lever * (relation.u95 or kind.u95), 1e-9), 0.01, 100.0) / MM
            yield (
                np.array([kind.lever * r]),
                {key: kind.lever * slope[None] for key, slope in zip(keys, by, strict=True)},
                np.array([weight]),
            )
        for key, prior in self.priors.items():
            yield (
                prior.value[:1] - state.values[key][:1],
                {key: np.ones((1, 1))},
                np.array([self.typical / MM / prior.u95]),
            )
        for edge in self.edges:
            if edge.screw is not None and edge_key(edge) in self.layout:
                off, D, u95 = cell_graph.screw_prior(state.values[edge_key(edge)], not edge.screw[:3].any())
                yield -off, {edge_key(edge): D}, self.typical / MM / u95


def _check_relations(rows: FeatureSet, groups: Sequence[Group]) -> None:
    """Refuse what is said to be known between features that do not have it."""
    for relation in rows.relations:
        of = set(RELATION_KINDS[relation.kind].of)
        for group in groups:
            if group.feature.name in (relation.first, relation.second) and not of & set(group.kind.unknowns):
                kinds = ", ".join(kind.name for kind in KINDS.values() if of & set(kind.unknowns))
                raise MeasurementError(
                    f"{relation.name}: {relation.kind} is known between features of the kinds {kinds}; "
                    f"{group.feature.name} is of kind {group.kind.name}",
                    parameter="features",
                )


def related(relation: Relation, unknowns: Collection[UnknownKey]) -> tuple[UnknownKey, ...]:
    """The two unknowns that a relation is between; none where they are not both there."""
    keys = [
        (name, feature) for feature in (relation.first, relation.second) for name in RELATION_KINDS[relation.kind].of
    ]
    present = tuple(key for key in keys if key in unknowns)
    return present if len(present) == 2 else ()


def relation_residuals(relations: Sequence[Relation], values: Mapping[UnknownKey, FloatArray]) -> dict[str, float]:
    """Known minus fitted value of relations between features that are fitted, by their names, metres or radians."""
    keys = {relation: related(relation, values) for relation in relations}
    return {
        relation.name: RELATION_KINDS[relation.kind].residual(values[pair[0]], values[pair[1]], relation.value)[0]
        for relation, pair in keys.items()
        if pair
    }


def _groups(rows_read: FeatureSet) -> list[Group]:
    """Rows by kind, feature, target and frames, in parts of `BLOCK` rows; refused where something is missing."""
    frame = np.full(len(rows_read), "") if rows_read.frame is None else rows_read.frame.astype(str)
    carrier = np.full(len(rows_read), FLANGE) if rows_read.carrier is None else rows_read.carrier.astype(str)
    out = []
    for name in dict.fromkeys(rows_read.kind):
        kind = KINDS.get(str(name))
        of_kind = rows_read.kind == name
        if kind is None:
            raise MeasurementError(
                f"unknown kind {name!r} of a row: kinds are {', '.join(KINDS)}",
                file=rows_read.source,
                row=int(rows_read.row[of_kind][0]),
                column="kind",
            )
        texts = (column[of_kind].astype(str) for column in (rows_read.feature, rows_read.target, frame, carrier))
        together: dict[tuple[str, ...], list[int]] = {}
        for key, row in zip(zip(*texts, strict=True), np.flatnonzero(of_kind).tolist(), strict=True):
            together.setdefault(key, []).append(row)
        for (feature, target, frame_of_rows, carrier_of_rows), row_numbers in together.items():
            rows = np.array(row_numbers)
            _check(rows_read, kind, feature, rows)
            declared = rows_read.features.get(feature, Feature(feature, kind.name, target))
            measured = not feature and "centre" in kind.unknowns
            in_world = measured or declared.centre is not None or "rotation" in kind.needs
            out += [
                Group(
                    kind,
                    declared,
                    target,
                    rows[at : at + BLOCK],
                    measured,
                    frame_of_rows or (WORLD if in_world else cell_graph.BASE),
                    carrier_of_rows,
                )
                for at in range(0, len(rows), BLOCK)
            ]
    return out


def _check(measured: FeatureSet, kind: Kind, feature: str, rows: IntArray) -> None:
    """Whether rows have what their kind needs."""
    has_feature = any(unknown.owner == "feature" for unknown in kind.unknowns.values())
    needs = (*kind.needs, *(("xyz",) if not feature and "centre" in kind.unknowns else ()))
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


def refuse_undetermined(problem: FeatureProblem, state: FeatureState) -> None:
    """Refuse rows that leave base, tool or features open even on the robot as it is.

    Raises
    ------
    IdentificationError
        With what is open.
    """
    if not problem.nuisance:
        return
    H = problem.sums(state, NO_TERMS).H
    scale = np.sqrt(np.maximum(np.diagonal(H), 1e-30))
    value, vector = np.linalg.eigh(H / np.outer(scale, scale))
    if value[0] > 1e-11 and scale.min() > 1e-12:
        return
    worst = int(np.argmax(np.abs(vector[:, 0] / scale)))
    starts = sorted((at, key) for key, (_, at) in problem.layout.items())
    name, name_of_unknown = [key for at, key in starts if at <= worst][-1]
    subject = {
        "tool": f"the place of {name_of_unknown} on the tool",
        "base": "the base in the measuring frame",
        FRAME: f"where {name_of_unknown} is",
        SCREW: f"how the external axis of {name_of_unknown} moves",
    }.get(name, f"{name} of {name_of_unknown}")
    raise IdentificationError(
        f"these rows do not determine {subject}: turn the tool about more axes there, touch more of it, "
        "or state what is known"
    )


MOST_STEPS = 200
"""Steps of the damped least squares."""

LAST_STEP = 1e-9
"""Steps, in units of the nuisance columns, that are lost in rounding."""

FALL = 1e-10
"""Relative fall of the sum of squares below which it has arrived."""


def start(
    problem: FeatureProblem, near: Mapping[UnknownKey, FloatArray] | None = None, steps: int = MOST_STEPS
) -> FeatureState:
    """The robot as it is, placed among the features: no guess is needed, but what is ``near`` goes before.

    So many ``steps`` at most are gone.

    Raises
    ------
    IdentificationError
        If the rows leave base, tool or features open.
    """
    zero = FeatureState({**(near or {}), **problem.fixed}, np.zeros(len(problem.terms)))
    candidates = [_tools(problem, zero), {}]
    best, smallest, reason = None, np.inf, "no place of tool and features was found that these rows fit"
    for tools in candidates:
        try:
            state = settle(problem, _features(problem, zero, tools), steps)
        except np.linalg.LinAlgError:
            continue
        except IdentificationError as error:
            reason = str(error)
            continue
        rss = problem.sums(state, NO_TERMS).yy
        if rss < smallest:
            best, smallest = state, rss
        if rss < 100.0 * problem.scalars:  # a centimetre: there is one minimum as near as that
            break
    if best is None:
        raise IdentificationError(reason)
    refuse_undetermined(problem, best)
    return best


def start_of_features(problem: FeatureProblem, state: FeatureState) -> FeatureState:
    """Features placed about a robot whose base and tool are held, at some coefficients.

    Raises
    ------
    IdentificationError
        If the rows leave a feature open.
    """
    values = dict(problem.fixed)
    for group in problem.groups:
        if group.measured:
            continue
        current = replace(state, values=values)
        obs = _observed(problem, current, group, group.frame)
        for name, key in group.keys().items():
            values.setdefault(key, group.kind.start(obs)[name])
    settled = settle(problem, replace(state, values=values))
    refuse_undetermined(problem, settled)
    return settled


def settle(problem: FeatureProblem, state: FeatureState, steps: int = MOST_STEPS) -> FeatureState:
    """Least squares of base, tool and features, the robot held (Levenberg and Marquardt)."""
    if not problem.nuisance:
        return state
    sums, damp = problem.sums(state, NO_TERMS), 1e-6
    for _ in range(steps):
        diagonal = np.maximum(np.diagonal(sums.H), 1e-12)
        step = np.asarray(np.linalg.solve(sums.H + np.diag(damp * diagonal), sums.g), dtype=float)
        if np.abs(step).max() < LAST_STEP:
            break
        tried = problem.moved(state, step)
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is taken back
            new = problem.sums(tried, NO_TERMS)
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
        group.rows
        for group in problem.groups
        if group.frame == WORLD and group.carrier == FLANGE and (group.measured or "rotation" in group.kind.needs)
    ]
    return points_of(problem.rows, np.concatenate(rows)) if rows else None


def points_of(measured: FeatureSet, rows: IntArray) -> PointSet:
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


def _observed(problem: FeatureProblem, state: FeatureState, group: Group, frame: str) -> Observed:
    """A group's rows in the axes of another frame than its own."""
    moved = replace(group, frame=frame)
    return problem.observed(state, moved, problem.view(state, moved, problem.walk(state, group)))


def _tools(problem: FeatureProblem, zero: FeatureState) -> dict[str, FloatArray]:
    """Places of the targets in the tip link, each from the rows that tell it."""
    estimates: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for group in problem.groups:
        on_flange = group.carrier in (FLANGE, *(edge.child for edge in problem.edges if edge.parent == FLANGE))
        tracked_rows = group.measured and group.frame == WORLD
        if not group.kind.pointed or group.point in problem.fixed or not on_flange or tracked_rows:
            continue
        parent = next((edge.parent for edge in problem.edges if edge_key(edge) == (FRAME, group.frame)), group.frame)
        parent = cell_graph.BASE if parent == WORLD else parent
        obs = _observed(problem, replace(zero, values={}), replace(group, carrier=FLANGE), parent)
        # places that are known in a frame whose place is not: as if each was measured in the axes of that frame
        kind = KINDS["offset"] if group.measured else group.kind
        estimate = kind.tool(obs)
        if estimate is not None and np.isfinite(estimate[0]).all():
            estimates.setdefault(group.target, []).append(estimate)
    return {
        name: np.asarray(np.linalg.solve(sum(H for _, H in pairs), sum(H @ t for t, H in pairs)), dtype=float)
        for name, pairs in estimates.items()
    }


def _features(problem: FeatureProblem, zero: FeatureState, tools: dict[str, FloatArray]) -> FeatureState:
    """All unknowns from the tool's places: first what a tracker saw, then features in closed form, then frames."""
    values = dict(zero.values)
    for edge in problem.edges:
        if edge.screw is not None:
            values.setdefault(edge_key(edge), edge.screw)
    points = tracked(problem)
    if points is not None and BASE not in problem.fixed:
        solution = first_state(Problem(problem.arm, points, ()))
        values[BASE] = solution.T_world_base
        for k, name in enumerate(points.target_names):
            values.setdefault((TOOL, name), solution.targets[k])
            values.setdefault(("axes", name), solution.rotations[k])
    for key in problem.layout:
        if key[0] == TOOL:
            values.setdefault(key, tools.get(key[1], np.zeros(3)))
    for edge in problem.edges:
        if edge.parent == FLANGE and edge_key(edge) in problem.layout:
            of = next(group.target for group in problem.groups if group.carrier == edge.child)
            values.setdefault(edge_key(edge), frames.transform(np.eye(3), tools.get(of, np.zeros(3))))
    state = replace(zero, values=values)

    def start_features(in_frames: Callable[[str], bool]) -> None:
        for group in problem.groups:
            if not group.measured and in_frames(group.frame):
                estimate = group.kind.start(_observed(problem, state, group, group.frame))
                for name, key in group.keys().items():
                    values.setdefault(key, estimate[name])

    unknown = [edge for edge in problem.edges if edge_key(edge) in problem.layout and edge.e is None]
    turned = {edge.child for edge in unknown if edge.parent == FLANGE}
    later = {edge.parent if edge.child == cell_graph.BASE else edge.child for edge in unknown} - turned
    if BASE in values:
        later.discard(WORLD)
    start_features(lambda frame: frame not in later | turned)
    for edge in unknown:
        frame, parent = (edge.parent, edge.child) if edge.child == cell_graph.BASE else (edge.child, edge.parent)
        if frame in later | turned and edge_key(edge) not in zero.values:
            T = _placed(problem, state, frame, parent, values.get((FRAME, frame)))
            values[edge_key(edge)] = frames.inverse(T) if frame == WORLD else T
    start_features(lambda frame: frame in later)
    return state


def _placed(
    problem: FeatureProblem, state: FeatureState, frame: str, parent: str, T_known: FloatArray | None
) -> FloatArray:
    """A frame in its parent, from points that are known in it: three places, or one, a half-line and a half-plane.

    Raises
    ------
    IdentificationError
        If they are too few.
    """
    point_pairs: list[tuple[FloatArray, FloatArray]] = []
    if T_known is not None:
        point_pairs.append((T_known[:3, 3], np.zeros(3)))
    sides: dict[str, tuple[FloatArray, FloatArray]] = {}
    for group in problem.groups:
        if group.carrier == frame and group.measured:
            moved = replace(group, frame=parent, carrier=group.frame)
            T = problem.view(state, moved, problem.walk(state, group)).T
            measured = np.einsum("nij,nj->ni", T[:, :3, :3], problem.rows.xyz[group.rows]) + T[:, :3, 3]
            point_pairs += zip(measured, problem.point_of(state, group), strict=True)
        if group.frame != frame:
            continue
        obs = _observed(problem, state, group, parent)
        if group.measured:
            point_pairs += zip(obs.p, obs.xyz, strict=True)
        elif group.feature.centre is not None and "centre" in group.kind.unknowns:
            point_pairs.append((group.kind.start(obs)["centre"], group.feature.centre))
        elif group.feature.axes is not None:
            sides.setdefault(group.kind.name, (obs.p[0], group.feature.axes[:, 2]))
    if len({tuple(local) for _, local in point_pairs}) == 1 and set(sides) == {"line", "plane"}:
        (origin, local), (along, u), (over, n) = point_pairs[0], sides["line"], sides["plane"]
        length = max(float(np.linalg.norm(along - origin)), 1e-12)
        forward = float((over - origin) @ (along - origin)) / length
        beside = np.sqrt(max(float(np.sum((over - origin) ** 2)) - forward**2, 0.0))
        point_pairs += [(along, local + u * length), (over, local + u * forward + frames.cross(n, u) * beside)]
    points, local_points = (
        np.array(column, dtype=float).reshape(-1, 3) for column in (list(zip(*point_pairs, strict=True)) or [(), ()])
    )
    spans = len(points) >= 3 and np.linalg.svd(local_points - local_points.mean(axis=0), compute_uv=False)[1] > MM
    if not spans:
        raise IdentificationError(
            f"these rows do not determine where {frame} is: three points that are known in it and not "
            "on a line are needed"
        )
    return frames.rigid_fit(local_points, points)
