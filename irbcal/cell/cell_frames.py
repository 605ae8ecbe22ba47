"""Tools and work objects of a cell, computed with the calibrated robot from touches, with what is known of them.

One row a touch: which joints bring the tip of a tool to which point of what::

    frame,name,point,tool,q1_deg,...,q6_deg[,x_mm,y_mm,z_mm,u95_mm,kind,radius_mm,tracker_x_mm,tracker_y_mm,tracker_z_mm]

Rows of a ``tool`` bring its tip to places, one a ``point``, from several sides; with a ``kind`` to a ball
(``sphere``), a ``plane`` or a ``line`` of unknown place. Rows ``x`` and ``xy`` bring a point of the tool's half-line +x
and of its half-plane +y to the place that its tip touches: they show its axes. Rows of a ``work_object`` bring the tip
of ``tool`` to its ``origin``, to a point ``x`` on its half-line +x, to a point ``xy`` in its half-plane +y, or to any
point of which the coordinates in the work object are known (``x_mm`` …). A tracker that stands in the measuring frame
of the calibration may measure the tip of a tool (``tracker_x_mm`` …), or a point of a work object of known
coordinates: such rows have no joints.

Unknown are the tip of each tool in the tip link, or its frame ``T_f_t``, each place that a tool touches in the base
link, and each work object ``T_b_o``. Each touch is an observation (`irbcal.identification.observations`) along the
cell's graph of frames (`irbcal.modeling.cell_graph`), all are adjusted together by least squares, so that an error of a
tool goes on into the work objects touched with it.

Where the robot holds the part, rows of a ``fixed_tool`` bring the tip of ``tool`` to its tip (``origin``), or to points
that show its axes, too, as of a work object; rows of a ``held_part`` bring points of the part to the tip of the fixed
``tool`` (`irbcal.cell.held_parts`).

External axes (`irbcal.cell.external_axes`) are edges of that graph whose screws are unknown, too: columns ``e1_mm``,
``e2_deg`` … say where they were. Places of tools stand on the floor; on a work object that an axis carries any point
without coordinates may be touched at several positions of the axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray
from irbcal.cell import external_axes
from irbcal.cell.cell_file import (
    AXIS,
    FIXED_TOOL,
    HELD_PART,
    ON_FLANGE,
    STANDING,
    TOOL,
    WORK_OBJECT,
    CellFile,
    FrameInCell,
    Touch,
    frames_by_name,
)
from irbcal.cell.contacts import Contacts, with_contacts
from irbcal.cell.external_axes import ExternalAxis
from irbcal.cell.held_parts import start_of_held_parts
from irbcal.cell.robot_derivatives import robot_derivatives
from irbcal.errors import IdentificationError, MeasurementError, OptionError, RobotError
from irbcal.identification import feature_problem
from irbcal.identification.feature_problem import (
    BASE,
    FRAME,
    SCREW,
    FeatureProblem,
    FeatureState,
    GroupResiduals,
    Key,
    edge_key,
)
from irbcal.identification.observation_kind import with_third
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import RobotSection
from irbcal.measurement.columns import POSITION, InputTable, TableLike
from irbcal.measurement.features import Feature, FeatureSet
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.cell_graph import FLANGE, WORLD, Edge
from irbcal.modeling.certainty import COVERAGE, Certainty
from irbcal.modeling.lost_zeros import lost_joints, zeros_in_words
from irbcal.modeling.robot import Robot, loaded
from irbcal.modeling.terms import chain
from irbcal.safe_files import refuse_overwriting
from irbcal.units import MM

LEAST_SIDES = 3
LEAST_TURN = 0.02
"""Root mean square of the tip link's turns about the axis it turns about least, radians: less shows no tip."""
LEAST_LENGTH = 1.0 * MM
"""Between points of a work object, and of the third from the line through the others."""
ALONE = 5
"""Points with coordinates that show a tool without rows of its own along with their work object."""
TEXT = ("frame", "name", "point", "tool")
KINDS = ("point", "sphere", "plane", "line")
"""What a tip may touch, or be on."""
TRACKER = [f"tracker_{name}" for name in POSITION]
U95_BY_EYE = 0.2 * MM
"""How well a tip is brought to a point by eye, metres: for rows that do not say it."""
U95_BY_TRACKER = 0.05 * MM
"""The same of a point that a tracker measured."""
TAUGHT = ("origin", "x", "xy")
"""Points of a work object that need no coordinates, as pendants call them; the last two show a tool's axes, too."""
SIDES: Mapping[str, tuple[str, FloatArray, int]] = {
    "x": ("line", with_third(np.array([1.0, 0.0, 0.0])), 0),
    "xy": ("plane", np.eye(3), 1),
}
"""Of points on a half-line or in a half-plane of a frame: kind, axes, and the coordinate that must be positive."""


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
        """Derivative of the residuals by the unknowns, the residuals, and their touches.

        Returns
        -------
        A : ndarray, shape (equations, unknowns)
            Standard deviations per unit of the unknowns (SI units).
        r : ndarray, shape (equations,)
            In standard deviations.
        touch : ndarray of int, shape (equations,)
        """
        blocks = list(self.problem.dense(self.state, np.zeros(0, dtype=int)))
        unit = COVERAGE * MM / self.problem.typical
        A = np.concatenate([block.J for block in blocks], axis=1).T / self.problem.sizes * unit
        A = np.hstack([A, self._stacked([self._by_zeros(of_group) for of_group in self.by_group], len(A))])
        return A, -unit * np.concatenate([block.y for block in blocks]), np.concatenate([block.row for block in blocks])

    def _by_zeros(self, of_group: GroupResiduals) -> FloatArray:
        """Derivative of a group's residuals by the zeros, shape (zeros, m, k)."""
        path, p, slides = of_group.path, of_group.p.T, self.problem.arm.table.prismatic
        moves = np.zeros((len(self.zeros), *p.shape))
        for k, joint in enumerate(np.array(self.zeros, dtype=int) - 1):
            z, o = path.z[joint], path.o[joint]
            moves[k] = z if slides[joint] else np.cross(z, p - o, axis=0)
        return self.problem.by_arm(of_group, moves, None)

    def _stacked(self, by_group: Sequence[FloatArray], equations: int) -> FloatArray:
        """Derivatives of the groups' residuals (count, m, k) as rows of equations, shape (equations, count)."""
        unit = COVERAGE / self.problem.typical
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
    def _tip(kind: str, name: str) -> Key:
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
        out = np.zeros((6, self.problem.flat + len(self.zeros)))
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
        """How residuals follow the robot's parameters, and what these leave open.

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


def frame_name(kind: str, name: str) -> str:
    """Name of a tool or a work object in the cell's graph of frames."""
    return f"{kind.replace('_', ' ')} {name}"


def adjust(
    touches: Sequence[Touch],
    robot: Robot,
    sigma: FloatArray,
    source: str,
    axes: Sequence[ExternalAxis] = (),
    nominal: bool = False,
    zeros: Sequence[int] = (),
) -> Adjusted:
    """Adjust tools and work objects to touches, and zeros of joints that were lost.

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
    zeros : sequence of int
        Joints, from 1, that do not show what they did.

    Raises
    ------
    MeasurementError
        If the touches do not determine a tool, a work object or a zero: the sentence says what is missing.
    """
    for _ in range(STEPS if zeros else 0):
        adjusted = replace(adjust(touches, robot, sigma, source, axes, nominal), zeros=tuple(zeros))
        A, r, _ = adjusted.rows
        of_frames, of_zeros = A[:, : -len(zeros)], A[:, -len(zeros) :]
        unexplained = of_zeros - of_frames @ np.linalg.lstsq(of_frames, of_zeros, rcond=None)[0]
        if np.linalg.svd(unexplained / np.linalg.norm(of_zeros, axis=0), compute_uv=False)[-1] < SHOWN:
            raise MeasurementError(
                f"the touches do not show the zeros of joints {', '.join(map(str, zeros))}: touch from more sides with "
                "the arm folded and stretched. Touches of what is sought itself never show the first joint's, nor the "
                "last joint's without known axes of the tool",
                file=source,
            )
        step = np.zeros(len(robot.arm.joint_names))
        step[np.array(zeros) - 1] = np.linalg.lstsq(unexplained, -r, rcond=None)[0]
        touches = [replace(touch, q=touch.q + step) for touch in touches]
        if np.abs(step).max() < SMALL:
            break
    framed = {frame_name(t.frame, t.name) for t in touches if _shows_axes(t)}
    root = external_axes.root(axes)
    rows = _feature_rows(touches, framed, COVERAGE * sigma, robot.arm, source, root)
    load = robot.joint_map.load(len(rows))
    rows = replace(rows, payload_kg=load["payload_kg"], payload_place=load["payload_place"])
    carried = sorted({frame_name(*t.on_flange) for t in touches} & framed)
    edges = [Edge(FLANGE, name) for name in carried]
    moving = external_axes.edges(axes, np.array([touch.e for touch in touches]))
    known_edges = {BASE: robot.T_world_base} | {
        edge_key(edge): edge.screw for edge in moving if nominal and edge.screw is not None
    }
    if axes:
        objects = dict.fromkeys(t.standing for t in touches if frame_name(*t.standing) in framed)
        edges += [Edge(external_axes.stand(axes, name), frame_name(kind, name)) for kind, name in objects]
        edges += [*moving, Edge(WORLD, root, robot.T_world_base)]
    problem = FeatureProblem(robot.arm, rows, [], known_edges, edges, robot)
    _refuse_too_few(touches, problem, source)
    try:
        held_poses = start_of_held_parts(touches, _tip_link(problem, moving, root))
        starts: dict[Key, FloatArray] = {}
        for (kind, name), T in held_poses.items():
            key = (FRAME if frame_name(kind, name) in framed else "centre"), frame_name(kind, name)
            if kind == HELD_PART or key[0] == "centre":
                starts[key] = T if key[0] == FRAME else T[:3, 3]
        adjusted = Adjusted(problem, feature_problem.start(problem, starts), root, touches, tuple(zeros))
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


def _shows_axes(touch: Touch) -> bool:
    """Whether a touch makes its frame one with axes: of tools and fixed tools only some do, of the others all."""
    if touch.frame == TOOL:
        return touch.point in SIDES
    return touch.frame != FIXED_TOOL or touch.xyz is not None or touch.point in SIDES


def _tip_link(problem: FeatureProblem, moving: Sequence[Edge], root: str) -> FloatArray:
    """The tip link in the frame that stands still at each touch, shape (n, 4, 4); axes as the controller has them."""
    assert problem.robot is not None
    T = chain.poses(problem.robot.walk(problem.motion))
    return cell_graph.view(moving, {edge.child: edge.at(None) for edge in moving}, root, cell_graph.BASE, len(T)).T @ T


def _feature_rows(
    touches: Sequence[Touch], framed: set[str], u95: FloatArray, arm: Arm, source: str, root: str
) -> FeatureSet:
    """Touches as rows at features: frames in which these are known, and carriers whose points touch them."""
    n = len(touches)
    features: dict[str, Feature] = {}
    text: dict[str, list[str]] = {name: [] for name in ("kind", "feature", "target", "frame", "carrier")}
    xyz, point = np.full((n, 3), np.nan), np.zeros((n, 3))

    def row(kind: str, feature: str, target: str, frame: str, carrier: str) -> None:
        for column, value in zip(text.values(), (kind, feature, target, frame, carrier), strict=True):
            column.append(value)

    for k, touch in enumerate(touches):
        tip = frame_name(*touch.on_flange)
        tip = tip if tip in framed else FLANGE
        frame_key = frame_name(touch.frame, touch.name)
        stands = frame_name(*touch.standing)
        if touch.frame == FIXED_TOOL and frame_key not in framed:
            features[frame_key] = Feature(frame_key, "point", touch.tool)
            row("point", frame_key, touch.tool, root, tip)
        elif touch.frame == HELD_PART and touch.tracker is None:
            at = stands if stands in framed else root
            point[k] = np.zeros(3) if touch.xyz is None else touch.xyz
            if touch.point in SIDES and touch.xyz is None:
                kind, axes, _ = SIDES[touch.point]
                feature = Feature(f"{touch.point} of {frame_key}", kind, stands, centre=np.zeros(3), axes=axes)
                features[feature.name] = feature
                row(kind, feature.name, stands, frame_key, at)
            elif at == root:
                features[stands] = Feature(stands, "point", frame_key)
                row("point", stands, frame_key, root, frame_key)
            else:
                xyz[k] = np.zeros(3)
                row("point", "", frame_key, stands, frame_key)
        elif touch.tracker is not None:
            xyz[k] = touch.tracker
            if touch.frame in ON_FLANGE:
                point[k] = np.zeros(3) if touch.xyz is None else touch.xyz
                row("point", "", touch.tool if touch.frame == TOOL else frame_key, WORLD, tip)
            else:
                point[k] = touch.xyz
                row("point", "", frame_key, WORLD, frame_key)
        elif touch.point in SIDES and touch.xyz is None:
            kind, axes, _ = SIDES[touch.point]
            feature = Feature(f"{touch.point} of {frame_key}", kind, touch.tool, centre=np.zeros(3), axes=axes)
            features[feature.name] = feature
            if touch.frame in STANDING:
                row(kind, feature.name, touch.tool, frame_key, tip)
            else:
                places = {t.point for t in touches if _at_place(t, touch.name)}
                if len(places) != 1:
                    raise MeasurementError(
                        f"{frame_key}: its axes are shown at the place that its tip touches, "
                        f"of which there are {len(places)}",
                        file=source,
                        row=touch.row,
                        column="point",
                    )
                row(kind, feature.name, f"{places.pop()} of {frame_key}", frame_key, root)
        elif touch.frame in STANDING and touch.xyz is None and touch.point != TAUGHT[0]:
            name = f"{touch.point} of {frame_key}"
            features[name] = Feature(name, "point", touch.tool)
            row("point", name, touch.tool, frame_key, tip)
        elif touch.frame in STANDING:
            xyz[k] = np.zeros(3) if touch.xyz is None else touch.xyz
            row("point", "", touch.tool, frame_key, tip)
        else:
            name = f"{touch.point} of {frame_key}"
            features[name] = Feature(name, touch.kind, touch.tool, touch.radius)
            row(touch.kind, name, touch.tool, root, tip)
    columns_of = {name: np.array(values, dtype=object) for name, values in text.items()}
    names = np.array([str(k) for k in range(n)], dtype=object)
    return FeatureSet(
        q=np.array([touch.q for touch in touches]),
        pose=names,
        pose_index=np.arange(n),
        value=np.full(n, np.nan),
        u95=u95,
        xyz=xyz,
        rotation=np.full((n, 3, 3), np.nan),
        row=np.array([touch.row for touch in touches]),
        cells=pd.DataFrame(index=range(n)),
        features=features,
        lengths=(),
        joint_columns=tuple(arm.joint_columns),
        source=source,
        sha256="",
        point=point,
        kind=columns_of["kind"],
        feature=columns_of["feature"],
        target=columns_of["target"],
        frame=columns_of["frame"],
        carrier=columns_of["carrier"],
    )


def _at_place(touch: Touch, tool: str) -> bool:
    """Whether the tip of a tool touches a place of its own."""
    own_place = (touch.frame, touch.name, touch.kind) == (TOOL, tool, "point") and touch.tracker is None
    return own_place and touch.point not in SIDES


def _refuse_too_few(touches: Sequence[Touch], problem: FeatureProblem, source: str) -> None:
    """Refuse tools and work objects that their rows cannot show, with what is missing."""
    T = chain.poses(problem.robot.walk(problem.motion)) if problem.robot is not None else np.zeros((0, 4, 4))
    for name in dict.fromkeys(t.tool for t in touches if t.tool and t.frame != HELD_PART):
        sides = {t.point for t in touches if t.frame == TOOL and t.name == name} & set(SIDES)
        if len(sides) == 1:
            raise MeasurementError(
                f"tool {name}: its axes take points x and xy, {(set(SIDES) - sides).pop()} is missing", file=source
            )
        of_tool = [t for t in touches if t.frame == TOOL and t.name == name and t.point not in SIDES]
        by_points = sum(t.frame in STANDING and t.tool == name and t.xyz is not None for t in touches)
        if not of_tool and by_points < ALONE:
            touch = next(t for t in touches if t.tool == name and t.frame != HELD_PART)
            raise MeasurementError(
                f"{frame_name(touch.frame, touch.name)} was touched with tool {name}, of which there are no rows: "
                f"bring the tip of that tool to one place from {LEAST_SIDES} or more sides, too",
                file=source,
                row=touch.row,
                column="tool",
            )
        if by_points >= ALONE or not all(_at_place(t, name) for t in of_tool):
            continue
        of_place = {
            point: [k for k, t in enumerate(touches) if _at_place(t, name) and t.point == point]
            for point in dict.fromkeys(t.point for t in of_tool)
        }
        for point, at in of_place.items():
            if len(at) < 2 or len(of_tool) < LEAST_SIDES:
                raise MeasurementError(
                    f"tool {name}: its tip was brought to {point!r} from {len(at)} side{'s'[: len(at) != 1]}: it takes "
                    f"{LEAST_SIDES} or more, turned about different axes (of several places, two of each)",
                    file=source,
                )
        R = np.concatenate([T[at, :3, :3] - T[at, :3, :3].mean(axis=0) for at in of_place.values()])
        if np.linalg.svd(R.reshape(-1, 3), compute_uv=False)[-1] < LEAST_TURN * np.sqrt(len(R)):
            raise MeasurementError(
                f"tool {name}: all sides are turned about one axis, along which its tip stays unknown: touch the place "
                "with the tool tilted another way, too",
                file=source,
            )
    for kind, name in dict.fromkeys(t.standing for t in touches if t.frame == HELD_PART and t.tool):
        at_tip = [t for t in touches if t.standing == (kind, name)]
        if len(at_tip) < LEAST_SIDES and all(t.frame == HELD_PART for t in at_tip):
            raise MeasurementError(
                f"fixed tool {name} has no rows of its own, and {len(at_tip)} of parts: bring the tip of a tool to it, "
                f"or {LEAST_SIDES} points of a part or more",
                file=source,
                row=at_tip[0].row,
                column="tool",
            )
    for kind, name in dict.fromkeys((t.frame, t.name) for t in touches if t.frame != TOOL):
        of_object = [t for t in touches if (t.frame, t.name) == (kind, name)]
        if not any(map(_shows_axes, of_object)):
            continue
        title = frame_name(kind, name)
        given_points = np.array([t.xyz for t in of_object if t.xyz is not None]).reshape(-1, 3)
        if len(given_points) >= LEAST_SIDES:
            if np.linalg.svd(given_points - given_points.mean(axis=0), compute_uv=False)[1] < LEAST_LENGTH:
                raise MeasurementError(f"{title}: its points with coordinates are on a line", file=source)
            continue
        missing = [point for point in TAUGHT if point not in {t.point for t in of_object if t.xyz is None}]
        if missing:
            raise MeasurementError(
                f"{title}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing, and of "
                f"three or more points with x_mm, y_mm, z_mm there are {len(given_points)}: it takes one or the other",
                file=source,
            )


def read_touches(table: TableLike, arm: Arm, axes: Sequence[ExternalAxis] = ()) -> tuple[list[Touch], str]:
    """Read touches.

    Parameters
    ----------
    table : str, Path or DataFrame
    arm : Arm
        Whose joints they are.
    axes : sequence of ExternalAxis, optional
        Whose columns every row has.

    Returns
    -------
    touches : list of Touch
    source : str
        Name of the table for messages.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    joints = arm.joint_columns
    if isinstance(table, pd.DataFrame) and "tool" in table.columns:
        # pandas reads numbers beside empty cells as 3.0
        table = table.assign(tool=table["tool"].convert_dtypes())
    external = [axis.column for axis in axes]
    known = (*TEXT, *joints, *external, *POSITION, "u95_mm", "kind", "radius_mm", *TRACKER)
    rows = InputTable.read(table, ["frame", "name", "point", *joints, *external], known)
    e = rows.si(external) if axes else np.zeros((len(rows), 0))
    positions, tracked = (np.column_stack([rows.optional(name) for name in names]) for names in (POSITION, TRACKER))
    u95s, radii, texts = rows.optional("u95_mm"), rows.optional("radius_mm"), [rows.filled(name) for name in TEXT[:3]]
    tools, kinds = rows.texts("tool"), rows.texts("kind")
    at_rest = np.isfinite(tracked).all(axis=1) & np.isin(texts[0], STANDING)
    at_rest &= rows.cells[joints].astype(str).apply(lambda column: column.str.strip() == "").all(axis=1).to_numpy()
    cells = rows.cells.copy()
    cells.loc[at_rest, joints] = "0"
    q = arm.from_controller(InputTable(cells, rows.source).si(joints))
    touches = []
    for k, (frame, name, point) in enumerate(zip(*texts, strict=True)):
        tool, kind = tools[k], kinds[k] or "point"
        counts = int(np.isfinite(positions[k]).sum()), int(np.isfinite(tracked[k]).sum())
        point = point[1:] if frame == TOOL and point == "+x" else point
        carried = any(name.lower() in axis.carries for axis in axes)
        fault = _fault(frame, name, point, tool, kind, counts, bool(at_rest[k]), carried)
        if fault is not None:
            raise rows.fault(fault[1], k, fault[0])
        touches.append(
            Touch(
                int(rows.rows[k]),
                frame,
                name,
                point,
                name if frame == TOOL else tool,
                q[k],
                (U95_BY_TRACKER if counts[1] else U95_BY_EYE) if np.isnan(u95s[k]) else float(u95s[k]),
                positions[k] if counts[0] else None,
                kind=kind,
                radius=None if np.isnan(radii[k]) else float(radii[k]),
                tracker=tracked[k] if counts[1] else None,
                e=e[k],
            )
        )
    kinds_of: dict[tuple[bool, str], str] = {}
    for k, touch in enumerate(touches):
        for kind, name in (touch.on_flange, touch.standing):
            if name and kinds_of.setdefault((kind in ON_FLANGE, name.lower()), kind) != kind:
                both = " and ".join(
                    word.replace("_", " ") for word in (kinds_of[kind in ON_FLANGE, name.lower()], kind)
                )
                raise rows.fault(f"{name} is the name of a {both}: give them different names", k, "name")
    return touches, rows.source


def _fault(
    frame: str, name: str, point: str, tool: str, kind: str, counts: tuple[int, int], at_rest: bool, carried: bool
) -> tuple[str | list[str], str] | None:
    """Column and sentence where a row is no touch; ``counts`` of coordinates known in the work object, and measured.

    ``carried``: whether an external axis carries the work object.
    """
    known, tracked = counts
    stands, title = frame in STANDING, frame.replace("_", " ")
    if frame not in (*ON_FLANGE, *STANDING):
        return "frame", f"expected {', '.join((TOOL, WORK_OBJECT, HELD_PART))} or {FIXED_TOOL}, found {frame!r}"
    if carried and frame == FIXED_TOOL:
        return "frame", "a fixed tool stands still, this one is carried by an external axis: name it a work object"
    if known not in (0, 3):
        return POSITION, f"expected the point's coordinates in the {title}, all or none"
    if tracked not in (0, 3):
        return TRACKER, "expected the point's coordinates in the measuring frame of the calibration, all or none"
    if kind not in KINDS:
        return "kind", f"expected {', '.join(KINDS)}, found {kind!r}"
    if kind != "point" and (frame != TOOL or tracked or point in SIDES):
        return "kind", f"a {kind} shows the tip of a tool: expected a row of a tool that touches it, nothing else"
    if frame == TOOL and known:
        return POSITION, "coordinates belong to points of a work object, the place that a tool touches has none"
    if frame == TOOL and tool not in ("", name):
        return "tool", f"a row of tool {name} is touched with this tool, found {tool!r}"
    if frame != TOOL and tracked:
        if not known:
            return POSITION, f"a point that the tracker measured needs its coordinates in the {title}"
        if stands and not at_rest:
            return "tool", "no tool touches a point that the tracker measured: leave the joints out"
        return None
    if frame == HELD_PART and not tool:
        return "tool", f"expected the fixed tool that held part {name} was brought to, found nothing"
    if stands and not tool:
        return "tool", f"expected the tool that touched {title} {name}, found nothing"
    if frame != TOOL and not known and point not in TAUGHT and not carried:
        return "point", f"expected {', '.join(TAUGHT)}, or x_mm, y_mm and z_mm of the point, found {point!r} without"
    return None


OUTLIER = 6.3e-5
"""Chance of a touch as far away as this among good ones: four standard deviations of one coordinate."""
DOUBTFUL = 1e-3
"""Chance of touches that scatter so much with the uncertainty that they are said to have."""
MOST_OUTLIERS = 5
"""One touch of so many may be left out."""
STEPS, SMALL = 20, 1e-12
"""Of the iteration for zeros of joints, and its last, radians and metres."""
SHOWN = 1e-3
"""Share of a touch's variance below which its residual shows nothing, and of what a zero moves."""


def cell_frames(
    calibration: CalibrationLike,
    touches: TableLike,
    out: str | PathLike[str] | None = None,
    *,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    axes: TableLike | None = None,
    other: CalibrationLike | None = None,
    other_cell: CellFile | str | Path | None = None,
    payload: float | None = None,
    payload_place: ArrayLike | None = None,
    refit_zeros: Sequence[int] = (),
) -> CellFile:
    """Tools and work objects by the calibrated robot, from touches.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
    touches : str, Path or DataFrame
        Touches, a row each, as this module's docstring says.
    out : str or Path, optional
        File to write, ``cell.json``.
    tool, wobj : dict of str to array_like, shape (4, 4), optional
        What the controller has, metres: a tool in the tip link, a work object in the base link. A tool that is taught
        by its tip alone has the axes that the controller has.
    axes : str, Path or DataFrame, optional
        External axes as the controller has them, see `irbcal.cell.external_axes.read_axes`.
    other : str, Path, Record or a result that holds one, optional
        Calibration of another robot whose tools were touched, see `irbcal.cell.contacts`.
    other_cell : CellFile, str or Path, optional
        Cell of the other robot, with its tools.
    payload : float, optional
        Mass carried at the touches, kg.
    payload_place : array_like, shape (3,), optional
        Its centre in the tip link, metres.
    refit_zeros : sequence of int
        Joints, from 1, whose zeros were lost (a crash, another motor): they are found with the frames, all else of the
        robot stays, and a note tells them with their intervals.

    Raises
    ------
    MeasurementError
        If the table cannot be read, or does not determine a tool, a work object or a zero.
    CalibrationError
        If the calibration is not whole, or the file cannot be written.
    OptionError
        If the controller's frames are no transforms, or of names that no row has.
    RobotError
        If nothing is known of the robot's certainty, or of the payload.
    """
    inputs = [table for table in (touches, axes, other_cell) if isinstance(table, (str, PathLike))]
    refuse_overwriting({"out": out}, inputs, calibration)
    record = open_calibration(calibration)
    robot = loaded(record.robot_calibrated(), payload, payload_place)
    certainty = robot.certainty
    if certainty is None:
        raise RobotError(f"nothing is known of how certain {robot.arm.name} is: calibrate it", parameter="calibration")
    contacts = None
    if (other is None) != (other_cell is None):
        raise OptionError("other: contacts take the calibration of the other robot and its cell", parameter="other")
    if other is not None and other_cell is not None:
        contacts = with_contacts(touches, other, other_cell)
        touches = contacts.table
    axes_before = () if axes is None else external_axes.read_axes(axes)
    all_rows, source = read_touches(touches, robot.arm, axes_before)
    for axis in axes_before:
        touched = {t.standing[1].lower() for t in all_rows}
        unknown = sorted({*axis.carries} - touched - {external_axes.ROBOT})
        if unknown:
            message = f"axes: {axis.column} carries {unknown[0]}, which is neither robot nor a touched work object"
            raise OptionError(message, parameter="axes")
    of_controller = {
        kind: _of_controller(frames_given, parameter, kind, all_rows)
        for kind, frames_given, parameter in ((TOOL, tool, "tool"), (WORK_OBJECT, wobj, "wobj"))
    }
    zeros = lost_joints(refit_zeros, robot.arm)
    adjusted, sigma, left_out = _without_outliers(all_rows, robot, certainty, source, axes_before, zeros)
    rows = adjusted.touches
    by_nominal = adjust(rows, record.robot_nominal(), sigma, source, axes_before, nominal=True)
    if contacts is not None:
        contacts = replace(contacts, rows=np.array([all_rows[k].row for k in contacts.rows]))
    C, G, doubt = _covariance(adjusted, certainty, [touch.row for touch in rows], contacts)
    of_cell: dict[str, dict[str, FrameInCell]] = {TOOL: {}, WORK_OBJECT: {}}
    M = []
    for mount, frames_of_mount in of_cell.items():
        for kind, name in dict.fromkeys(t.on_flange if mount == TOOL else t.standing for t in rows):
            if not name:
                continue
            T_controller = of_controller[mount].get(name)
            alone = adjusted.position_only(kind, name)
            axes = frames.transform(T_controller[:3, :3]) if alone and T_controller is not None else np.eye(4)
            T_true, T_nominal = (each.frame(kind, name) @ axes for each in (adjusted, by_nominal))
            reverse = kind in (HELD_PART, FIXED_TOOL)
            frames_of_mount[name] = FrameInCell(name, T_true, T_nominal, T_controller, alone, reverse)
            M.append(adjusted.motions(kind, name, axes[:3, :3]))
    axes_of_cell = []
    for axis, edge in zip(axes_before, external_axes.edges(axes_before, np.zeros((1, len(axes_before)))), strict=True):
        axes_of_cell.append(replace(axis, screw=adjusted.state.values[edge_key(edge)]))
        M.append(adjusted.motions(AXIS, edge.child, np.eye(3)))
    motions = np.concatenate(M)
    touching, gain = motions @ C @ motions.T, motions @ G
    sentences = [doubt, *_zeros_in_words(adjusted, robot.arm, all_rows, C + G @ certainty.covariance @ G.T)]
    cell = CellFile(
        record.fingerprint,
        record.robot.name,
        record.simulated,
        of_cell[TOOL],
        of_cell[WORK_OBJECT],
        touching,
        touching + gain @ certainty.covariance @ gain.T,
        gain,
        tuple(axes_of_cell),
        touches=tuple(
            replace(touch, residual=adjusted.residual[k], residual_nominal=by_nominal.residual[k])
            for k, touch in enumerate(rows)
        ),
        left_out=tuple(left_out),
        notes=tuple(filter(None, (*sentences, *_notes(record.robot, rows, of_cell, certainty)))),
    )
    if out is not None:
        cell.save(out)
    return cell


def _of_controller(
    frames_given: Mapping[str, ArrayLike] | None, parameter: str, kind: str, rows: Sequence[Touch]
) -> dict[str, FloatArray]:
    """The controller's frames by the names of the rows."""
    pairs = [t.on_flange if kind == TOOL else t.standing for t in rows]
    names = {name.lower(): name for _, name in pairs if name}
    by_name = frames_by_name(frames_given, parameter)
    for name in by_name:
        if name not in names:
            raise OptionError(f"{parameter}: no touch is of {kind.replace('_', ' ')} {name}", parameter=parameter)
    return {names[name]: T for name, T in by_name.items()}


def _without_outliers(
    rows: Sequence[Touch],
    robot: Robot,
    certainty: Certainty,
    source: str,
    axes: Sequence[ExternalAxis],
    zeros: Sequence[int],
) -> tuple[Adjusted, FloatArray, list[str]]:
    """Adjust, leave out the worst touch, and again, as long as one is far out and the others are enough without it."""
    left_out: list[str] = []
    u95 = np.array([touch.u95 for touch in rows])
    variance = adjust(rows, robot, u95 / COVERAGE, source, axes, zeros=zeros).by_robot(certainty)[1]
    sigma = np.sqrt((u95 / COVERAGE) ** 2 + variance)
    most = len(rows) // MOST_OUTLIERS
    adjusted = adjust(rows, robot, sigma, source, axes, zeros=zeros)
    while True:
        worst, chance, distance = _worst(adjusted, sigma)
        if chance > OUTLIER:
            return adjusted, sigma, left_out
        touch, keep = rows[worst], np.arange(len(rows)) != worst
        words = (
            f"row {touch.row} ({frame_name(touch.frame, touch.name)}, {touch.point}) is {distance / MM:.2f} mm beside "
            "what the other touches say"
        )
        rest = [row for k, row in enumerate(rows) if keep[k]]
        if len(left_out) >= most:
            break
        try:
            again = adjust(rest, robot, sigma[keep], source, axes, zeros=zeros)
        except MeasurementError:
            break
        if not again.redundancy:
            break
        left_out.append(f"{words}: it is left out")
        rows, sigma, adjusted = rest, sigma[keep], again
    return adjusted, sigma, [*left_out, f"{words}; there are too few touches to leave it out: touch again"]


def _zeros_in_words(adjusted: Adjusted, arm: Arm, before: Sequence[Touch], C: FloatArray) -> list[str]:
    """What the touches say of zeros that were lost; C: covariance of the unknowns, the last are the zeros."""
    if not adjusted.zeros:
        return []
    row = {touch.row: touch for touch in before}[adjusted.touches[0].row]
    moved = (adjusted.touches[0].q - row.q)[np.array(adjusted.zeros) - 1]
    half = COVERAGE * np.sqrt(np.diagonal(C)[-len(adjusted.zeros) :])
    return [
        *zeros_in_words(arm, adjusted.zeros, moved, half),
        "tools and work objects here are those after mastering, and so are the joints of the touches in this file",
    ]


def _worst(adjusted: Adjusted, sigma: FloatArray) -> tuple[int, float, float]:
    """The touch that the others contradict most, the chance of that, and how far it is from where they put it."""
    from scipy.special import chdtrc

    A, residual, touch = adjusted.rows
    basis = np.linalg.qr(A)[0]
    worst = (0, 1.0, 0.0)
    for k in range(len(sigma)):
        equations = np.flatnonzero(touch == k)
        values, vectors = np.linalg.eigh(np.eye(len(equations)) - basis[equations] @ basis[equations].T)
        shown = values > SHOWN
        along = vectors[:, shown].T @ residual[equations]
        if shown.any():
            chance = float(chdtrc(int(shown.sum()), np.sum(along**2 / values[shown])))
            if chance < worst[1]:
                worst = (k, chance, float(np.linalg.norm(along / values[shown]) * sigma[k]))
    return worst


def _covariance(
    adjusted: Adjusted, certainty: Certainty, rows: Sequence[int] = (), contacts: Contacts | None = None
) -> tuple[FloatArray, FloatArray, str]:
    """Covariance of the unknowns by touching, their derivative by the robot's parameters, and what is to be doubted.

    ``u = -(A'A)^-1 A' r`` of residuals r and their derivative A, both in standard deviations. Errors of the points of
    another robot that were touched (``rows`` are the numbers of the touches) count as errors of touching.
    """
    from scipy.special import chdtrc

    A, residual, touch = adjusted.rows
    pseudo = np.asarray(np.linalg.pinv(A), dtype=float)
    square = float(residual @ residual)
    factor, doubt = 1.0, ""
    if adjusted.redundancy and chdtrc(adjusted.redundancy, square) < DOUBTFUL:
        factor = square / adjusted.redundancy
        doubt = f"the touches scatter {np.sqrt(factor):.1f} times as much as u95_mm says: the intervals are widened"
    C = factor * (pseudo @ pseudo.T)
    if contacts is not None:
        kept = [k for k, row in enumerate(contacts.rows) if row in rows]
        equations = np.concatenate([np.flatnonzero(touch == rows.index(contacts.rows[k])) for k in kept])
        weight = adjusted.problem.weights[touch[equations]] * COVERAGE / adjusted.problem.typical
        moved = pseudo[:, equations] * weight
        points = (3 * np.array(kept)[:, None] + np.arange(3)).ravel()
        C = C + moved @ contacts.covariance[np.ix_(points, points)] @ moved.T
    return C, -pseudo @ adjusted.by_robot(certainty)[0], doubt


def _notes(
    robot: RobotSection, rows: Sequence[Touch], of_cell: Mapping[str, Mapping[str, FrameInCell]], certainty: Certainty
) -> list[str]:
    """What a reader must know of how this was computed."""
    touched = np.array([touch.q for touch in rows if touch.on_flange[1]])
    outside = certainty.outside_in_words(touched, "touches") if len(touched) else ""
    notes = [outside] if outside else []
    for mount, word, link in ((TOOL, "tool", robot.tip_link), (WORK_OBJECT, "fixed tool", robot.base_link)):
        of_mount = of_cell[mount].items()
        alone = [name for name, frame in of_mount if frame.position_only and frame.T_controller is None]
        if alone:
            notes.append(f"a tip alone tells no axes: {word} {', '.join(alone)} has those of {link}")
    if any(touch.u95 == U95_BY_EYE for touch in rows):
        notes.append(f"touches without u95_mm count as made by eye, u95 {U95_BY_EYE / MM:.1f} mm")
    return [*notes, *filter(None, [certainty.open_ends_in_words()])]
