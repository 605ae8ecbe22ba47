r"""Two sets of tools and work objects: those that the controller computes with, and those that are true.

A program says: with the tool ``Tc`` and the work object ``Oc``, as the controller has them, go to the pose ``P``. What
is wanted is ``P`` for the true tool ``Tt`` in the true work object ``Ot``. With the calibrated robot ``C`` and the
model ``N`` of the controller::

    C(q) = Ot P Tt^-1       joints to command
    P'   = Oc^-1 N(q) Tc    the target to write

Tools are seen from the tip link, work objects from the base link. Tools and work objects that were taught with the
robot hold errors of the nominal model: a correction with them in place of the true ones makes the part worse.

The expected error of a part is that of robot, tool and work object together, by one covariance. The tool centre point
in the work object is off by ``e = Ot^-1 C(q) Tt - P``. To first order, with small motions ``m`` of tool and work object
in their own axes (rotation ``w``, translation ``v``) and errors ``d`` of the robot's parameters::

    e = Ro' (J d + Rf Rt v_t) - (w_o x p + v_o),    m = touching + G d

The robot's terms act in the touches as in the program, so what both have in common cancels: the variances of robot and
frames must not be added.

Where the robot holds the part, ``Tc`` and ``Tt`` are that part, ``Oc`` and ``Ot`` the fixed tool, and ``P`` is the
inverse of what such programs say. The error is that of the point ``p`` of the part that stands at the tip of the tool::

    e = Ot^-1 C(q) Tt p,    de = Ro' (J d + Rf Rt (w_t x p + v_t)) - v_o
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
from typing import Any, Literal, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked, NameArray
from irbcal.cell import external_axes
from irbcal.cell.cell_file import AXIS, TOOL, WORK_OBJECT, CellFile
from irbcal.cell.external_axes import carried
from irbcal.cell.robot_derivatives import point_derivatives
from irbcal.correction.fake_targets import FakeTargets
from irbcal.correction.program import Program, WantedTargets
from irbcal.correction.text_program import TextProgram
from irbcal.errors import OptionError
from irbcal.io.controller_model import ControllerFrames, unknown_frames
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.cell_graph import BASE, Edge
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.robot import Robot
from irbcal.summary import Content, Paragraph
from irbcal.units import DEG, MM
from irbcal.wording import first_of, inflected

ControllerNumbers: TypeAlias = Literal["same", "from-cell"]
"""Which numbers the controller will have for tools and work objects: its own, or those of the cell file."""

NULL, MEASURED, CELL, UNKNOWN = "null", "measured", "cell", "unknown"
"""Origins of a frame: flange or robot base themselves, measured independently of the robot, a cell file, none known."""

_ORDER = ("", NULL, MEASURED, CELL, UNKNOWN)
"""Of the two frames of a target the later one counts."""
FAR = 10.0 * MM, 2.0 * DEG
"""Metres and radians by which a frame of the cell file is not the controller's of that name, but another one."""
MOST_NAMED = 5
"""Frames of the cell file that a sentence names."""
ROUNDING = 1e-9
"""Metres and matrix elements within which a frame is the flange, or the robot base, itself."""


@dataclass(frozen=True)
class PointOrigin:
    """Which points of a program are taught."""

    taught: str | None = None
    """Pattern of their names (``*`` and ``?``, upper and lower case alike); all other points are offline points, whose
    coordinates are wanted. None: no point is taught.
    """
    re_express: bool = False
    """Rewrite taught points as offline points of the true frames, and correct nothing."""

    def are_taught(self, names: Sequence[str]) -> BoolArray:
        """Which points are taught, shape (n,)."""
        pattern = None if self.taught is None else self.taught.lower()
        return np.array(
            [pattern is not None and (n.lower() == pattern or fnmatchcase(n.lower(), pattern)) for n in names],
            dtype=bool,
        )


def point_origin(points: str, re_express: bool) -> PointOrigin:
    """Of the option: ``offline``, ``taught`` or ``taught:PATTERN``.

    Raises
    ------
    OptionError
        If it is something else, or points are to be re-expressed of which none is taught.
    """
    kind, colon, pattern = points.partition(":")
    if kind not in ("offline", "taught") or (colon and (kind == "offline" or not pattern)):
        raise OptionError(f"points: expected offline, taught or taught:PATTERN, found {points!r}", parameter="points")
    if re_express and kind == "offline":
        raise OptionError("re_express: rewrites taught points, give points=taught too", parameter="re_express")
    return PointOrigin((pattern or "*") if kind == "taught" else None, re_express)


@dataclass(frozen=True)
class UnknownFrames(Content):
    """Tools and work objects of unknown origin."""

    tools: tuple[str, ...]
    work_objects: tuple[str, ...]
    targets: int
    """How many targets are corrected with them."""
    mean: float
    largest: float
    """Distance between the tool centre points of the nominal and the calibrated robot at these targets, metres: errors
    of this size are in tools and work objects that were taught with the robot.
    """
    unused: str = ""
    """Tools and work objects of the cell file that no target uses, in words; empty where there are none."""

    CONTENT = "tools work_objects targets mean_mm max_mm=largest"

    def in_words(self) -> str:
        """What may go wrong, by how much, and what to do."""
        origins = [
            f"{inflected(len(names), noun)} {', '.join(names)}"
            for noun, names in (("tool", self.tools), ("work object", self.work_objects))
            if names
        ]
        verb = inflected(len(self.tools) + len(self.work_objects), "is", "are")
        advice = "Compute them with irbcal cell and give --cell"
        if self.unused:
            advice = f"No target uses {self.unused} of the cell file: give its frames the names that the program has"
        return (
            f"{' and '.join(origins)} {verb} of unknown origin. If taught with the robot, the correction makes the "
            f"part worse: at these {self.targets} targets the nominal and the calibrated robot differ by "
            f"{self.mean / MM:.3f} mm on average and {self.largest / MM:.3f} mm at most. {advice}; "
            "if they were measured independently of the robot (CAD, tracker), say --frames-measured"
        )


@dataclass(frozen=True, eq=False, repr=False)
class TargetFrames(Locked):
    """Tools and work objects of n targets, and what is at stake at those that were corrected."""

    tools: NameArray
    work_objects: NameArray
    """Shape (n,). Names as programs have them; empty where the program does not tell one."""
    tool_origins: NameArray
    object_origins: NameArray
    """Shape (n,). `NULL`, `MEASURED`, `CELL` or `UNKNOWN`; empty where no tool and work object matter: joint targets
    that are corrected for the robot alone, and files without frames.
    """
    T_left: FloatArray
    T_right: FloatArray
    """Shape (n, 4, 4). ``Ot Oc^-1`` and ``Tc Tt^-1``: between them stands the flange as the controller computes it."""
    tcp: FloatArray
    """Shape (n, 3). The same by the controller's tool in the tip link, metres."""
    T_tool: FloatArray
    T_object: FloatArray
    """Shape (n, 4, 4). ``Tt`` and ``Ot``, as far as they are known."""
    T_numbers: FloatArray
    """Shape (n, 4, 4). ``Oc On^-1``: from the true work object, as the controller moves it with its external axes, to
    its own.
    """
    e: FloatArray
    """Shape (n, axes). Positions of the cell's external axes, radians (metres)."""
    contact: FloatArray
    """Shape (n, 3). Where the work is done, in the axes of what is on the flange, metres: zero, the tip of the tool,
    but with a part that the robot holds its point at the tip of the fixed tool.
    """
    points: NameArray = field(default_factory=lambda: np.zeros(0, dtype=object))
    """Shape (n,). ``offline`` or ``taught``; this and what follows of corrected targets."""
    at_stake: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Shape (n,). Distance between the tool centre points of the nominal and the calibrated robot, metres."""
    part_error: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    """Shape (n, 2). Mean and 95 % of the expected error in the work object, metres; see `part_errors`."""
    numbers: str = "same"
    """Which numbers the controller will have."""
    re_expressed: bool = False
    """Whether the targets are offline points of the true frames, and no fake targets."""
    cell: CellFile | None = None

    def of_corrected(
        self, robot: Robot, controller: Arm, true_frames: TrueFrames, batch: WantedTargets, fake: FakeTargets
    ) -> TargetFrames:
        """Of the targets of a batch that were corrected, with what is at stake there."""
        ok, q = fake.ok, fake.q_nominal[fake.ok]
        off = np.zeros((len(q), 3))
        if len(q):
            apart = robot.forward(q) - controller.forward(q)
            off = np.einsum("nij,nj->ni", apart[:, :3, :3], self.tcp[ok]) + apart[:, :3, 3]
        rows: dict[str, Any] = {name: getattr(self, name)[ok] for name in _OF_FRAMES}
        rows["points"] = np.where(true_frames.points.are_taught(batch.names)[ok], "taught", "offline").astype(object)
        rows["at_stake"] = np.linalg.norm(off, axis=1)
        rows["part_error"] = part_errors(robot, true_frames.cell, fake.q, self)[ok]
        return replace(
            self, **rows, numbers=true_frames.numbers, re_expressed=true_frames.points.re_express, cell=true_frames.cell
        )

    @staticmethod
    def joined(sets: Sequence[TargetFrames]) -> TargetFrames | None:
        """Of several programs; None of none."""
        if not sets:
            return None
        names = (*_OF_FRAMES, "points", "at_stake", "part_error")
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(frames_of_program, name) for frames_of_program in sets]) for name in names
        }
        return replace(sets[0], **arrays)

    @property
    def origins(self) -> NameArray:
        """Of each target the origin of its frame that is known worst."""
        pairs = zip(self.tool_origins, self.object_origins, strict=True)
        return np.array([max(pair, key=_ORDER.index) for pair in pairs], dtype=object)

    def columns(self) -> dict[str, NameArray | FloatArray]:
        """For tables; errors of the part in millimetres, where they are known."""
        columns: dict[str, NameArray | FloatArray] = {
            "tool": np.array(self.tools),
            "work_object": np.array(self.work_objects),
            "frames": self.origins,
            "points": np.array(self.points),
        }
        if np.isfinite(self.part_error).any():
            columns |= {"part_mean_mm": self.part_error[:, 0] / MM, "part_u95_mm": self.part_error[:, 1] / MM}
        return columns

    def unknown(self) -> UnknownFrames | None:
        """Those of unknown origin; None where there are none."""
        rows = self.origins == UNKNOWN
        if not rows.any():
            return None
        tools = sorted(set(self.tools[self.tool_origins == UNKNOWN]))
        work_objects = sorted(set(self.work_objects[self.object_origins == UNKNOWN]))
        stake = self.at_stake[rows]
        return UnknownFrames(
            tuple(tools), tuple(work_objects), int(rows.sum()), float(stake.mean()), float(stake.max()), self.unused
        )

    @property
    def unused(self) -> str:
        """Tools and work objects of the cell file that no target uses, in words."""
        if self.cell is None:
            return ""
        frames_by_noun = (
            ("tool", self.cell.tools, self.tools),
            ("work object", self.cell.work_objects, self.work_objects),
        )
        of_nouns = []
        for noun, in_cell, names in frames_by_noun:
            unused = [name for name in in_cell if name.lower() not in {*names}]
            of_nouns += [f"{inflected(len(unused), noun)} {first_of(unused, MOST_NAMED)}"] if unused else []
        return " and ".join(of_nouns)

    def far_in_words(self, k: int) -> str:
        """Which of a target's frames lies far from the cell file's of that name, in words; empty where none does."""
        T_tool, T_object = self.T_tool[k], self.T_object[k]
        out = []
        for noun, name, origin, T, T_controller in (
            ("tool", self.tools[k], self.tool_origins[k], T_tool, self.T_right[k] @ T_tool),
            (
                "work object",
                self.work_objects[k],
                self.object_origins[k],
                T_object,
                frames.inverse(self.T_left[k]) @ T_object,
            ),
        ):
            shift = float(np.linalg.norm(T[:3, 3] - T_controller[:3, 3]))
            turn = float(frames.rotation_distance(T[:3, :3], T_controller[:3, :3]))
            if origin == CELL and (shift > FAR[0] or turn > FAR[1]):
                out.append(f"{noun} {name} by {shift / MM:.0f} mm and {turn / DEG:.1f} degrees")
        return f" (the cell file's frames are not the program's: they differ in {' and '.join(out)})" if out else ""

    def report(self, unchanged: int) -> list[Paragraph]:
        """Which points were taken for offline points, and what the controller must have."""
        if self.re_expressed:
            return [
                f"{len(self.tools)} taught points are re-expressed as offline points of the true frames, {unchanged} "
                "stay as they are; nothing is corrected: filter the new program"
            ]
        sentences: list[Paragraph] = []
        in_cell = self.origins == CELL
        if in_cell.any():
            ours = "its own numbers" if self.numbers == "same" else "the cell file's numbers"
            sentences.append(
                f"{in_cell.sum()} targets stand for the cell file's tools and work objects; the controller must "
                f"compute with {ours} of them"
            )
        elif self.unused and not (self.origins == UNKNOWN).any():
            sentences.append(f"No target uses {self.unused} of the cell file: names are compared")
        if (in_cell & (self.points == "offline")).any():
            sentences.append(
                "All of them are taken for offline points: name those that were shown on the robot with --points"
            )
        held = int(np.any(self.contact != 0.0, axis=1).sum())
        if held:
            sentences.append(f"At {held} targets the robot holds the part, and the tool stands")
        expected = self.part_error[np.isfinite(self.part_error).all(axis=1)] / MM
        if len(expected):
            sentences.append(
                f"Expected error of the part: {expected[:, 0].mean():.3f} mm mean, at the worst target within "
                f"{expected[:, 1].max():.3f} mm with 95 % (robot, tools and work objects together)"
            )
        if unchanged:
            sentences.append(f"{unchanged} targets need no change")
        return sentences


_OF_FRAMES = tuple(column.name for column in fields(TargetFrames))[:12]
"""Arrays that tell of tools and work objects."""


@dataclass(frozen=True, eq=False, repr=False)
class TrueFrames:
    """What is known of the tools and work objects of programs."""

    cell: CellFile | None = None
    """Its tools and work objects are true; their names are compared without upper and lower case."""
    measured: bool = False
    """Whether all others were measured independently of the robot, and so are true as the controller has them."""
    numbers: ControllerNumbers = "same"
    """Which numbers the controller will have."""
    points: PointOrigin = PointOrigin()
    ends: ControllerFrames = field(default_factory=unknown_frames)
    """Where the controller's flange and world are."""

    def frames_of(self, program: Program, batch: WantedTargets, controller: Arm) -> TargetFrames:
        """Tools and work objects of the goals of a program; ``controller``: what it computes with."""
        n = len(batch.names)
        T_tip = controller.forward(batch.values) if batch.kind == "joint" else batch.values
        tools, work_objects, tool_origins, object_origins = (np.full(n, "", dtype=object) for _ in range(4))
        T_left, T_right, T_tool, T_object, T_numbers = np.tile(np.eye(4), (5, n, 1, 1))
        axes = () if self.cell is None else self.cell.axes
        e = np.zeros((n, len(axes)))
        tcp, contact = np.zeros((2, n, 3))
        for k, number in enumerate(batch.numbers.tolist()):
            names = _names_of(program, number) if isinstance(program, TextProgram) else None
            if names is None or not isinstance(program, TextProgram):
                continue  # of joint targets and of files without frames: those of other poses are known
            tools[k], work_objects[k] = names
            Tc, Oc = program.tools[names[0]], program.work_objects[names[1]]
            Tt, tool_origin = self._true("tools", names[0], Tc, self.ends.T_tip_flange)
            Ot, object_origin = self._true("work_objects", names[1], Oc, self.ends.T_base_world)
            if batch.kind == "pose" or CELL in (tool_origin, object_origin):
                tool_origins[k], object_origins[k] = tool_origin, object_origin
            On = Ot
            if axes:
                positions = program.targets[number].e
                T_controller = carried(axes, names[1], positions, nominal=True)
                Oc, On, Ot = T_controller @ Oc, T_controller @ Ot, carried(axes, names[1], positions) @ Ot
                e[k] = [positions.get(axis.name, 0.0) * axis.unit for axis in axes]
            if program.targets[number].uses[0].part_on_robot:
                contact[k] = (frames.inverse(T_tip[k] @ Tc) @ Oc)[:3, 3]
            T_left[k], T_right[k] = Ot @ frames.inverse(Oc), Tc @ frames.inverse(Tt)
            tcp[k] = Tc[:3, :3] @ contact[k] + Tc[:3, 3]
            T_tool[k], T_object[k], T_numbers[k] = Tt, Ot, Oc @ frames.inverse(On)
        of_frames = tools, work_objects, tool_origins, object_origins, T_left, T_right, tcp, T_tool, T_object
        return TargetFrames(*of_frames, T_numbers, e, contact)

    def _true(self, kind: str, name: str, T: FloatArray, T_null: FloatArray) -> tuple[FloatArray, str]:
        """The true frame of a name, and its origin; ``T`` is what the controller has."""
        for cell_frame in () if self.cell is None else getattr(self.cell, kind).values():
            if cell_frame.name.lower() == name:
                # a tip alone tells no axes: they are the controller's
                R = T[:3, :3] if cell_frame.position_only else cell_frame.T_true[:3, :3]
                return frames.transform(R, cell_frame.T_true[:3, 3]), CELL
        if min(np.abs(T - T_null).max(), np.abs(T - np.eye(4)).max()) < ROUNDING or name == "null":
            return T, NULL
        return T, MEASURED if self.measured else UNKNOWN


def _names_of(program: TextProgram, number: int) -> tuple[str, str] | None:
    """Tool and work object of a target where its uses name one of each, and their numbers are known."""
    uses = {(use.tool, use.work_object) for use in program.targets[number].uses}
    tool, work_object = uses.pop() if len(uses) == 1 else (None, None)
    if tool is None or work_object is None or tool not in program.tools or work_object not in program.work_objects:
        return None
    return tool, work_object


def part_errors(robot: Robot, cell: CellFile | None, q: FloatArray, at: TargetFrames) -> FloatArray:
    """Mean and 95 % of the distance of the tool centre point from where it is wanted in the work object.

    Parameters
    ----------
    robot : Robot
        Calibrated, with its certainty.
    cell : CellFile or None
    q : ndarray, shape (n, joints)
        Commanded, radians (metres).
    at : TargetFrames
        Of the n targets. Frames that are not of the cell file count as exact, unless their origin is unknown.

    Returns
    -------
    ndarray, shape (n, 2)
        Metres; NaN where tool or work object are of unknown origin or none of them is of the cell file, and everywhere
        if the certainty of the robot is not known or the cell was computed with another one.
    """
    out = np.full((len(q), 2), np.nan)
    rows = np.flatnonzero((at.origins == CELL) & np.isfinite(q).all(axis=1))
    if cell is None or robot.certainty is None or not len(rows):
        return out
    if cell.robot_gain.shape[1] not in (0, len(robot.certainty.covariance)):
        return out
    by_robot, by_frames, left_over = _derivatives(robot, robot.certainty, cell, q[rows], at, rows)
    if cell.robot_gain.shape[1]:
        by_robot = by_robot + by_frames @ cell.robot_gain
    C = by_robot @ robot.certainty.covariance @ np.swapaxes(by_robot, 1, 2)
    C = C + by_frames @ cell.touch_covariance @ np.swapaxes(by_frames, 1, 2) + left_over[:, None, None] * np.eye(3)
    out[rows] = np.column_stack(lengths(C))
    return out


def lengths(C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and 95 % quantile of the length of Gaussian vectors with covariances (n, 3, 3).

    The squared length counts as a multiple of chi squared with the same mean and variance (Satterthwaite 1946): exact
    for errors along one line and for those alike in all directions, within 2 % between.
    """
    from scipy.special import chdtri, gammaln

    trace, square = np.trace(C, axis1=1, axis2=2), np.sum(C * C, axis=(1, 2))
    scale = np.divide(square, trace, out=np.zeros_like(trace), where=trace > 0)
    freedom = np.divide(trace**2, square, out=np.ones_like(trace), where=square > 0)
    mean = np.sqrt(2.0 * scale) * np.exp(gammaln((freedom + 1.0) / 2.0) - gammaln(freedom / 2.0))
    return mean, np.sqrt(scale * chdtri(freedom, 0.05))


def _derivatives(
    robot: Robot, certainty: Certainty, cell: CellFile, q: FloatArray, at: TargetFrames, rows: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the errors (n, 3) in the work object by the robot's parameters and by the small motions of all frames.

    And the variance of each coordinate that neither explains: what the fit leaves over, and last moves.
    """
    p_tool = at.contact[rows]
    on_tip = np.einsum("nij,nj->ni", at.T_tool[rows, :3, :3], p_tool) + at.T_tool[rows, :3, 3]
    tcp, J, left_over = point_derivatives(robot, certainty, q, on_tip)
    T = robot.forward(q)
    to_object = np.swapaxes(at.T_object[rows, :3, :3], 1, 2)
    p = np.einsum("nij,nj->ni", to_object, tcp - at.T_object[rows, :3, 3])
    F = np.zeros((len(q), 3, len(cell.touch_covariance)))
    tools = {name.lower(): name for name in cell.tools}
    work_objects = {name.lower(): name for name in cell.work_objects}
    for n, row in enumerate(rows):
        if at.tool_origins[row] == CELL:
            name = tools[at.tools[row]]
            columns = cell.rows(TOOL, name)
            by_motion = frames.by_motion(p_tool[n][None])
            F[n, :, columns] = to_object[n] @ T[n, :3, :3] @ cell.tools[name].T_true[:3, :3] @ by_motion
    for name in dict.fromkeys(at.work_objects[rows]):
        chosen = np.flatnonzero(at.work_objects[rows] == name)
        moved = external_axes.edges(cell.axes, at.e[rows[chosen]])
        stand = external_axes.stand(cell.axes, name)
        transforms = {edge.child: edge.at(None) for edge in moved}
        T_stand = cell_graph.view(moved, transforms, BASE, stand, len(chosen)).T
        transforms[WORK_OBJECT] = frames.inverse(T_stand) @ at.T_object[rows[chosen]]
        view = cell_graph.view([*moved, Edge(stand, WORK_OBJECT)], transforms, WORK_OBJECT, BASE, len(chosen))
        if at.object_origins[rows[chosen[0]]] == CELL:
            F[chosen, :, cell.rows(WORK_OBJECT, work_objects[name])] = view.moved_by(WORK_OBJECT, p[chosen])[0]
        for k, (axis, edge) in enumerate(zip(cell.axes, moved, strict=True)):
            if edge.child in view.signs:
                D = cell_graph.screw_derivative(axis.screw, at.e[rows[chosen], k])
                F[chosen, :, cell.rows(AXIS, axis.column)] = view.moved_by(edge.child, p[chosen])[0] @ D
    return to_object @ J, F, left_over
