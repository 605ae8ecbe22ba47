"""Tools, work objects and external axes by one robot, adjusted together to touches by least squares.

Unknown are the tip of each tool in the tip link, or its frame ``T_f_t``, each place that a tool touches in the base
link, each work object ``T_b_o``, and the screws of external axes. Each touch is an observation
(`irbcal.identification.observations`) along the cell's graph of frames (`irbcal.modeling.cell_graph`), so that an error
of a tool goes on into the work objects touched with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.cell import external_axes
from irbcal.cell.cell_file import AXIS, HELD_PART, TOOL, Touch
from irbcal.cell.external_axes import ExternalAxis
from irbcal.cell.held_parts import start_of_held_parts
from irbcal.cell.robot_derivatives import robot_derivatives
from irbcal.cell.touch_rows import frame_name, refuse_too_few, rows_of_touches, shows_axes
from irbcal.cell.touches import SIDES
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import feature_problem
from irbcal.identification.feature_problem import (
    BASE,
    FRAME,
    NO_TERMS,
    SCREW,
    FeatureProblem,
    FeatureState,
    GroupResiduals,
    UnknownKey,
    edge_key,
)
from irbcal.identification.linear_model import Rows
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.cell_graph import FLANGE, WORLD, Edge
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.units import MM

MOST_ZERO_STEPS = 20
"""Gauss-Newton steps for zeros of joints."""
SMALLEST_ZERO_STEP = 1e-10
"""Radians (metres). The iteration for zeros of joints ends with a step below this; rounding leaves less."""
LEAST_SHARE = 1e-3
"""Share of a touch's variance below which its residual shows nothing, and of what a zero moves."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Tools, work objects and external axes by one robot."""

    problem: FeatureProblem
    """A row of its rows for each touch."""
    state: FeatureState
    root: str = cell_graph.BASE
    """The frame that stands still."""
    touches: Sequence[Touch] = ()
    """With joints as they would be shown with the zeros that were adjusted."""
    zeros: tuple[int, ...] = ()
    """Joints, from 1, whose zeros were adjusted, too: the last unknowns, radians (metres) that each shows too little.
    """

    @cached_property
    def by_group(self) -> list[GroupResiduals]:
        """What touches miss, group by group."""
        return list(self.problem.group_residuals(self.state))

    @cached_property
    def rows(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Derivative of what is predicted by the unknowns, the residuals, and their touches.

        Returns
        -------
        A : ndarray, shape (equations, unknowns)
            Standard deviations per unit of the unknowns (SI units).
        r : ndarray, shape (equations,)
            In standard deviations.
        touch : ndarray of int, shape (equations,)
        """
        rows = Rows.joined(list(self.problem.dense(self.state, NO_TERMS)))
        unit = NORMAL_95 * MM / self.problem.typical
        A = rows.J.T / self.problem.sizes * unit
        A = np.hstack([A, self._stacked([self._by_zeros(of_group) for of_group in self.by_group], len(A))])
        return A, unit * rows.y, rows.row

    def _by_zeros(self, of_group: GroupResiduals) -> FloatArray:
        """Derivative of a group's predictions by the zeros, shape (zeros, m, k)."""
        by_joints = chain.by_joints(of_group.path, self.problem.arm, of_group.p.T)
        return self.problem.by_arm(of_group, by_joints[np.array(self.zeros, dtype=int) - 1], None)

    def _stacked(self, by_group: Sequence[FloatArray], equations: int) -> FloatArray:
        """Derivatives of the groups' predictions (count, m, k) as rows of equations, shape (equations, count)."""
        unit = NORMAL_95 / self.problem.typical
        rows = [
            (J * self.problem.weights[of_group.group.rows][:, None] * unit).reshape(len(J), np.prod(J.shape[1:])).T
            for J, of_group in zip(by_group, self.by_group, strict=True)
        ]
        derivative = np.concatenate(rows)
        return np.vstack([derivative, np.zeros((equations - len(derivative), derivative.shape[1]))])

    @property
    def redundancy(self) -> int:
        """Equations less unknowns."""
        A = self.rows[0]
        return A.shape[0] - A.shape[1]

    @staticmethod
    def _tip(kind: str, name: str) -> UnknownKey:
        """Key of a tip that is known without axes."""
        return (feature_problem.TOOL, name) if kind == TOOL else ("centre", frame_name(kind, name))

    def position_only(self, kind: str, name: str) -> bool:
        """Whether the touches show a tip and no axes."""
        return self._tip(kind, name) in self.state.values

    def frame(self, kind: str, name: str) -> FloatArray:
        """A tool in the tip link or a work object in the base link, shape (4, 4); a tip alone with the link's axes."""
        values = self.state.values
        if self.position_only(kind, name):
            return frames.transform(np.eye(3), values[self._tip(kind, name)])
        return values[FRAME, frame_name(kind, name)]

    def motions(self, kind: str, name: str, R: FloatArray) -> FloatArray:
        """Small motion of a frame in its own axes by the unknowns, shape (6, unknowns); R: axes of a tip alone.

        Of an external axis the change of its screw; ``name`` is the frame that it moves.
        """
        out = np.zeros((6, self.problem.nuisance + len(self.zeros)))
        if self._tip(kind, name) in self.problem.layout:
            at = self.problem.layout[self._tip(kind, name)][1]
            out[3:, at : at + 3] = R.T
        else:
            at = self.problem.layout[(SCREW, name) if kind == AXIS else (FRAME, frame_name(kind, name))][1]
            out[:, at : at + 6] = np.eye(6)
        return out

    @cached_property
    def residual(self) -> FloatArray:
        """In the axes of the root, shape (touches, 3), metres; zero in directions in which a touch says nothing."""
        out = np.zeros((len(self.problem.rows), 3))
        for of_group in self.by_group:
            along = np.einsum("nki,nk->ni", of_group.residuals.point, of_group.residuals.r)
            R = of_group.view.frames[self.root][:, :3, :3]
            out[of_group.group.rows] = np.einsum("nji,nj->ni", R, along)
        return out

    def by_robot(self, certainty: Certainty) -> tuple[FloatArray, FloatArray]:
        """How predictions follow the robot's parameters, and what these leave open.

        Returns
        -------
        derivative : ndarray, shape (equations, parameters)
            Standard deviations per unit of the parameters; zero of terms of the last move, which is not known.
        variance : ndarray, shape (touches,)
            Of a coordinate: what the calibrated robot leaves over at poses that it was not fitted to, and terms of the
            last move, m^2.
        """
        blocks, variance = [], np.zeros(len(self.problem.rows))
        for of_group in self.by_group:
            group = of_group.group
            motion = self.problem.motion.select(group.rows)
            J: FloatArray = np.zeros((len(certainty.covariance), 3, len(motion)))
            if FLANGE in of_group.view.signs:
                J, variance[group.rows] = robot_derivatives(certainty, of_group.path, of_group.p.T, motion)
            out = self.problem.by_arm(of_group, J, None)
            if self.root in of_group.view.signs and group.frame == WORLD:
                out[:6] += self.problem.by_edge(of_group, self.root)
            blocks.append(out)
        return self._stacked(blocks, len(self.rows[0])), variance


def adjust(
    touches: Sequence[Touch],
    robot: Robot,
    sigma: FloatArray,
    source: str,
    axes: Sequence[ExternalAxis] = (),
    nominal: bool = False,
) -> Adjusted:
    """Adjust tools and work objects to touches.

    Parameters
    ----------
    touches : sequence of Touch, length n
    robot : Robot
        Asked where its tip link is, and where its base is in the measuring frame.
    sigma : ndarray, shape (n,)
        Standard deviation of each touch in each direction, metres.
    source : str
        Name of the table, for messages.
    axes : sequence of ExternalAxis, optional
    nominal : bool
        Whether the axes are as the controller has them; else they are adjusted, too.

    Raises
    ------
    MeasurementError
        If the touches do not determine a tool or a work object: the sentence says what is missing.
    """
    framed = {frame_name(t.frame, t.name) for t in touches if shows_axes(t)}
    root = external_axes.root(axes)
    rows = rows_of_touches(touches, framed, NORMAL_95 * sigma, robot.arm, source, root)
    rows = replace(rows, inputs=robot.joint_map.motion(rows.q).inputs)
    carried = sorted({frame_name(*t.on_flange) for t in touches} & framed)
    edges = [Edge(FLANGE, name) for name in carried]
    moving = external_axes.edges(axes, np.array([touch.axis_positions for touch in touches]))
    known_edges = {BASE: robot.T_world_base} | {
        edge_key(edge): edge.screw for edge in moving if nominal and edge.screw is not None
    }
    if axes:
        objects = dict.fromkeys(t.standing for t in touches if frame_name(*t.standing) in framed)
        edges += [Edge(external_axes.stand(axes, name), frame_name(kind, name)) for kind, name in objects]
        edges += [*moving, Edge(WORLD, root, robot.T_world_base)]
    problem = FeatureProblem(robot.arm, rows, [], known_edges, edges, robot)
    refuse_too_few(touches, problem, source)
    try:
        held_poses = start_of_held_parts(touches, _tip_link(problem, moving, root))
        starts: dict[UnknownKey, FloatArray] = {}
        for (kind, name), T in held_poses.items():
            key = (FRAME if frame_name(kind, name) in framed else "centre"), frame_name(kind, name)
            if kind == HELD_PART or key[0] == "centre":
                starts[key] = T if key[0] == FRAME else T[:3, 3]
        adjusted = Adjusted(problem, feature_problem.start(problem, starts), root, touches)
    except IdentificationError as error:
        raise MeasurementError(str(error), file=source) from None
    for of_group in adjusted.by_group:
        for row, p in zip(of_group.group.rows, of_group.observed.p, strict=True):
            touch = touches[row]
            if touch.point in SIDES and touch.xyz is None and p[SIDES[touch.point][2]] <= 0.0:
                raise MeasurementError(
                    f"{frame_name(touch.frame, touch.name)}: point {touch.point} lies on the negative side of the "
                    "frame by the other points",
                    file=source,
                    row=touch.row,
                    column="point",
                )
    return adjusted


def adjust_zeros(
    touches: Sequence[Touch],
    robot: Robot,
    sigma: FloatArray,
    source: str,
    zeros: Sequence[int],
    axes: Sequence[ExternalAxis] = (),
) -> Adjusted:
    """Adjust tools, work objects and the zeros of joints that were lost to touches.

    Parameters
    ----------
    touches, robot, sigma, source, axes
        As `adjust`; external axes are adjusted, too.
    zeros : sequence of int
        Joints, from 1, that do not show what they did; where there are none, this is `adjust`.

    Raises
    ------
    MeasurementError
        If the touches do not determine a tool, a work object or a zero, or the zeros do not converge.
    """
    if not zeros:
        return adjust(touches, robot, sigma, source, axes)
    listed = ", ".join(map(str, zeros))
    for _ in range(MOST_ZERO_STEPS):
        adjusted = replace(adjust(touches, robot, sigma, source, axes), zeros=tuple(zeros))
        A, r, _ = adjusted.rows
        of_frames, of_zeros = A[:, : -len(zeros)], A[:, -len(zeros) :]
        unexplained = of_zeros - of_frames @ np.linalg.lstsq(of_frames, of_zeros, rcond=None)[0]
        if np.linalg.svd(unexplained / np.linalg.norm(of_zeros, axis=0), compute_uv=False)[-1] < LEAST_SHARE:
            raise MeasurementError(
                f"the touches do not show the zeros of joints {listed}: touch from more sides with the arm folded and "
                "stretched. Touches of what is sought itself never show the first joint's, nor the last joint's "
                "without known axes of the tool",
                file=source,
            )
        step = np.zeros(len(robot.arm.joint_names))
        step[np.array(zeros) - 1] = np.linalg.lstsq(unexplained, r, rcond=None)[0]
        touches = [replace(touch, q=touch.q + step) for touch in touches]
        if np.abs(step).max() < SMALLEST_ZERO_STEP:
            return replace(adjust(touches, robot, sigma, source, axes), zeros=tuple(zeros))
    raise MeasurementError(
        f"the zeros of joints {listed} do not converge in {MOST_ZERO_STEPS} steps: set these joints near their marks "
        "on the arm, touch again, and check that each row names the point that was touched",
        file=source,
    )


def _tip_link(problem: FeatureProblem, moving: Sequence[Edge], root: str) -> FloatArray:
    """The tip link in the frame that stands still at each touch, shape (n, 4, 4); axes as the controller has them."""
    assert problem.robot is not None
    T = chain.poses(problem.robot.walk(problem.motion))
    return cell_graph.view(moving, {edge.child: edge.at(None) for edge in moving}, root, cell_graph.BASE, len(T)).T @ T
