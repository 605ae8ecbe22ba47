"""The cell of a robot in a file, ``cell.json``: true tools and work objects, how well they are known, and the touches.

Transforms ``T_a_b`` map coordinates in b to a. Lengths of the file are in millimetres, orientations are unit
quaternions (scalar first), covariances are in radians and metres. A file that was edited or damaged is refused.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, StringConstraints, ValidationError, model_validator

from irbcal.arrays import FloatArray, Locked
from irbcal.cell.external_axes import COLUMN, ExternalAxis
from irbcal.errors import CalibrationError, OptionError
from irbcal.io.integrity import KEY, digest, refuse_absurd
from irbcal.io.schema import PoseSection
from irbcal.modeling import frames
from irbcal.modeling.certainty import COVERAGE
from irbcal.options import shown
from irbcal.safe_files import read_bytes, write_set
from irbcal.section import Date, Fingerprint, Name, Section, Sentence, Sha256
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG, MM

SCHEMA = "irbcal-cell-1"
TOOL, WORK_OBJECT, AXIS = "tool", "work_object", "axis"
HELD_PART, FIXED_TOOL = "held_part", "fixed_tool"
"""A part on the flange counts among the tools, the tool that stands and works on it among the work objects."""
ON_FLANGE, STANDING = (TOOL, HELD_PART), (WORK_OBJECT, FIXED_TOOL)
RESIDUALS = ("residual", "residual_nominal")
QUATERNION_TOLERANCE = 1e-9
"""How far the length of a quaternion of the file may be from one."""


class Notation(NamedTuple):
    """How frames are written for people.

    Attributes
    ----------
    names : tuple of str
        Of the numbers.
    numbers : callable
        From ``tool`` or ``work_object`` and its transform to the numbers.
    words : str
        What they count from.
    digits : int
        Decimals.
    """

    names: tuple[str, ...]
    numbers: Callable[[str, FloatArray], Sequence[float]]
    words: str
    digits: int = 4


def _rpy(_: str, T: FloatArray) -> list[float]:
    return [*(T[:3, 3] / MM), *(frames.rpy_from_matrix(T[:3, :3]) / DEG)]


AS_URDF = Notation(
    ("x mm", "y mm", "z mm", "roll", "pitch", "yaw"), _rpy, "in the URDF's tip link and base link, angles in degrees"
)


@dataclass(frozen=True, eq=False)
class FrameInCell(Locked):
    """A tool or a work object.

    Attributes
    ----------
    name : str
        As programs call it.
    T_true : ndarray, shape (4, 4)
        By the calibrated robot, metres: a tool in the tip link (``T_f_t``), a work object in the base link (``T_b_o``).
    T_nominal : ndarray, shape (4, 4)
        From the same touches by the nominal robot: what a controller that computes with it has.
    T_controller : ndarray, shape (4, 4), or None
        What the controller has, in the same links, where that is known.
    position_only : bool
        A tool taught by its tip alone: its axes are the controller's, or the tip link's (of a fixed tool the base
        link's), and count as exact.
    fixed_tool : bool
        A part that the robot holds, or the tool that stands and works on it.
    """

    name: str
    T_true: FloatArray
    T_nominal: FloatArray
    T_controller: FloatArray | None = None
    position_only: bool = False
    fixed_tool: bool = False

    def title(self, mount: str) -> str:
        """What it is, and its name; ``mount`` is ``tool`` on the flange, else ``work_object``."""
        nouns = (HELD_PART, FIXED_TOOL) if self.fixed_tool else (TOOL, WORK_OBJECT)
        return f"{nouns[mount != TOOL].replace('_', ' ')} {self.name}"


@dataclass(frozen=True, eq=False)
class Touch(Locked):
    """A touch and what is left of it.

    Attributes
    ----------
    row : int
        In the table, for messages.
    frame, name, point, tool : str
        ``tool``, ``work_object``, ``held_part`` or ``fixed_tool``; its name; the point of it; the tool whose tip
        touched, the tool itself for tools, and for a held part the fixed tool that was touched with it.
    q : ndarray, shape (joints,)
        Radians (metres).
    u95 : float
        Of the touch, metres.
    xyz : ndarray, shape (3,), or None
        The point in the work object (held part, fixed tool), where it is known, metres.
    kind : str
        What the tip of a tool touched: a ``point``, ``sphere``, ``plane`` or ``line``.
    radius : float or None
        Of the sphere, to the tip, where it is known, metres.
    tracker : ndarray, shape (3,), or None
        The point as a tracker measured it, in the measuring frame of the calibration, metres.
    residual, residual_nominal : ndarray, shape (3,)
        In the base link, metres: the tip by the calibrated (nominal) robot less where it should be.
    e : ndarray, shape (axes,)
        Positions of the external axes, radians (metres).
    """

    row: int
    frame: str
    name: str
    point: str
    tool: str
    q: FloatArray
    u95: float
    xyz: FloatArray | None = None
    kind: str = "point"
    radius: float | None = None
    tracker: FloatArray | None = None
    residual: FloatArray = field(default_factory=lambda: np.zeros(3))
    residual_nominal: FloatArray = field(default_factory=lambda: np.zeros(3))
    e: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def on_flange(self) -> tuple[str, str]:
        """Kind and name of what the robot carries to the touch; no name where a tracker measured what stands."""
        return (HELD_PART, self.name) if self.frame == HELD_PART else (TOOL, self.tool)

    @property
    def standing(self) -> tuple[str, str]:
        """Kind and name of what stands there; no name where it is a place."""
        if self.frame == HELD_PART:
            return FIXED_TOOL, self.tool
        return (self.frame, self.name) if self.frame in STANDING else (WORK_OBJECT, "")


@dataclass(frozen=True, eq=False, repr=False)
class CellFile(Result):
    """Tools and work objects of a robot.

    The small motion of a frame is six numbers in its own axes: rotation vector (rad), then translation (m),
    ``T_true @ (Exp(motion))``. Their errors are those of touching plus ``robot_gain`` times those of the robot's
    parameters, which are the columns of `irbcal.modeling.certainty.Certainty.covariance`: the same errors that move
    every pose of a program.

    Attributes
    ----------
    fingerprint : str
        Of the calibration.
    robot : str
    simulated : bool
    tools, work_objects : dict of str to FrameInCell
    touch_covariance, covariance : ndarray, shape (6 k, 6 k)
        Of the small motions of all tools, then all work objects, then of the screws of all external axes, in order: by
        touching alone, and with the robot's.
    robot_gain : ndarray, shape (6 k, p)
        Derivative of the small motions by the parameters of the robot.
    axes : tuple of ExternalAxis
    touches : tuple of Touch
    left_out : tuple of str
        Touches that were left out of the adjustment, and why.
    notes : tuple of str
    created : str
        ISO 8601, UTC.
    """

    fingerprint: str
    robot: str
    simulated: bool
    tools: Mapping[str, FrameInCell]
    work_objects: Mapping[str, FrameInCell]
    touch_covariance: FloatArray
    covariance: FloatArray
    robot_gain: FloatArray
    axes: tuple[ExternalAxis, ...] = ()
    touches: tuple[Touch, ...] = ()
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    created: str = field(default_factory=lambda: datetime.now(timezone.utc).isoformat(timespec="seconds"))

    def report(self, notation: Notation = AS_URDF) -> list[Paragraph]:
        """The frames with their intervals, and by how much the controller's differ; see `Result.report`."""
        by = [f"mean {size.mean():.3f}, largest {size.max():.3f} mm" for size in self._residual_sizes()]
        headline = (
            f"{'SIMULATED: ' if self.simulated else ''}{len(self.touches)} touches by the calibrated {self.robot}: "
            f"they miss by {by[0]}; by the nominal robot {by[1]}"
        )
        rows: list[tuple[str | float | None, ...]] = []
        for frame, one in self._all():
            touching = self.u95(frame, one.name, self.touch_covariance)
            theirs = one.T_nominal if one.T_controller is None else one.T_controller
            away = float(np.linalg.norm(theirs[:3, 3] - one.T_true[:3, 3])) / MM
            turned = float(frames.rotation_distance(theirs[:3, :3], one.T_true[:3, :3])) / DEG
            true, other = (map(float, notation.numbers(frame, T)) for T in (one.T_true, theirs))
            label = one.title(frame).removeprefix("work ")
            rows.append((label, *true, touching[0] / MM, None if one.position_only else touching[1] / DEG, None, None))
            word = "  nominal" if one.T_controller is None else "  controller"
            rows.append((word, *other, None, None, away, None if one.position_only else turned))
        heads = ("frame", *notation.names, "u95 mm", "deg", "off mm", "deg")
        table = Table(f"Frames {notation.words}", heads, tuple(rows), digits=notation.digits)
        return [
            headline,
            table,
            *self._axes_in_words(),
            *(f"Note: {text}" for text in (*self.left_out, self._whole_in_words(), *self.notes)),
        ]

    def _whole_in_words(self) -> str:
        """The intervals with the robot's own errors."""
        sizes = [self.u95(frame, one.name, self.covariance)[0] / MM for frame, one in self._all()]
        return (
            "u95 is that of touching; with what is unknown of the robot, which programs share and irbcal filter --cell "
            f"reckons with, {', '.join(f'{size:.2f}' for size in sizes)} mm"
        )

    def page(self, title: str = "Cell", more: Sequence[Paragraph] = ()) -> str:
        """The report with all touches as one HTML page; see `Result.page`."""
        rows = [
            (touch.row, touch.frame.replace("_", " "), touch.name, touch.point, touch.tool, touch.u95 / MM, *sizes)
            for touch, sizes in zip(self.touches, self._residual_sizes().T.tolist(), strict=True)
        ]
        heads = ("row", "frame", "name", "point", "tool", "u95 mm", "residual mm", "by nominal mm")
        return super().page(f"{title} of {self.robot}", [Table("Touches", heads, tuple(rows)), *more])

    def _residual_sizes(self) -> FloatArray:
        """Lengths of residuals by the calibrated and by the nominal robot, shape (2, touches), mm."""
        return np.array([[np.linalg.norm(getattr(touch, name)) for touch in self.touches] for name in RESIDUALS]) / MM

    def _axes_in_words(self) -> list[str]:
        """How far external axes are from where the controller has them, at the touches."""
        out = []
        for k, axis in enumerate(self.axes):
            e = np.array([touch.e[k] for touch in self.touches])
            rows = self.rows(AXIS, axis.column)
            std = np.sqrt(np.maximum(np.diagonal(self.covariance)[rows], 0.0))
            points = [one.T_true[:3, 3] for name, one in self.work_objects.items() if name.lower() in axis.carries]
            turn, shift = axis.departure(e, (points or [np.zeros(3)])[0])
            direction = COVERAGE * std[3:].max() if axis.slides else COVERAGE * std[:3].max()
            out.append(
                f"External axis {axis.column} from {e.min() / axis.unit:g} to {e.max() / axis.unit:g}: it carries "
                f"{' and '.join(axis.carries)} up to {shift / MM:.3f} mm and {turn / DEG:.4f} deg beside where the "
                f"controller has it; u95 of its direction {direction / DEG:.4f} deg"
            )
        return out

    def u95(self, frame: str, name: str, covariance: FloatArray) -> tuple[float, float]:
        """Half-widths that hold 95 % of a coordinate's errors (metres) and an angle's (radians), largest of three."""
        std = np.sqrt(np.maximum(np.diagonal(covariance)[self.rows(frame, name)], 0.0))
        return float(COVERAGE * std[3:].max()), float(COVERAGE * std[:3].max())

    def _all(self) -> list[tuple[str, FrameInCell]]:
        pairs = ((TOOL, self.tools), (WORK_OBJECT, self.work_objects))
        return [(frame, one) for frame, named in pairs for one in named.values()]

    def to_dict(self) -> dict[str, Any]:
        """The content of the file but for its seal, ready for JSON."""
        return self._document().model_dump(mode="json", exclude={KEY})

    def rows(self, frame: str, name: str) -> slice:
        """Rows of a frame in the covariances; ``frame`` is ``tool``, ``work_object`` or ``axis`` (by its column)."""
        pairs = [(TOOL, key) for key in self.tools] + [(WORK_OBJECT, key) for key in self.work_objects]
        start = 6 * [*pairs, *((AXIS, axis.column) for axis in self.axes)].index((frame, name))
        return slice(start, start + 6)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file, whole or not at all.

        Raises
        ------
        CalibrationError
            If it cannot be written.
        """
        document = self.to_dict()
        content = json.dumps(document | {KEY: digest(document)}, indent=1) + "\n"
        write_set({Path(path): content.encode()})
        return Path(path)

    def _document(self) -> _Document:
        return _Document(
            schema_name=SCHEMA,
            created=self.created,
            simulated=self.simulated,
            robot=self.robot,
            fingerprint=self.fingerprint,
            tools=[_FrameSection.of(one) for one in self.tools.values()],
            work_objects=[_FrameSection.of(one) for one in self.work_objects.values()],
            covariance_rad_m=self.covariance.tolist(),
            touch_covariance_rad_m=self.touch_covariance.tolist(),
            robot_gain_rad_m=self.robot_gain.tolist(),
            axes=[
                _AxisSection(
                    axis=axis.column,
                    carries=list(axis.carries),
                    screw_rad_m=axis.screw.tolist(),
                    nominal_rad_m=axis.nominal.tolist(),
                )
                for axis in self.axes
            ],
            touches=[_TouchSection.of(one) for one in self.touches],
            left_out=list(self.left_out),
            notes=list(self.notes),
        )


class _FrameSection(Section):
    """A frame, in the file."""

    name: Name
    true: PoseSection
    nominal: PoseSection
    controller: PoseSection | None
    position_only: bool
    fixed_tool: bool = False

    @staticmethod
    def of(one: FrameInCell) -> _FrameSection:
        """The section of a frame."""
        there = None if one.T_controller is None else _pose(one.T_controller)
        return _FrameSection(
            name=one.name,
            true=_pose(one.T_true),
            nominal=_pose(one.T_nominal),
            controller=there,
            position_only=one.position_only,
            fixed_tool=one.fixed_tool,
        )

    def frame(self) -> FrameInCell:
        """The frame of the section."""
        there = None if self.controller is None else _transform(self.controller)
        true, nominal = _transform(self.true), _transform(self.nominal)
        return FrameInCell(self.name, true, nominal, there, self.position_only, self.fixed_tool)


class _AxisSection(Section):
    """An external axis, in the file."""

    axis: Annotated[str, StringConstraints(pattern=COLUMN.pattern)]
    carries: list[Name]
    screw_rad_m: list[float] = Field(min_length=6, max_length=6)
    nominal_rad_m: list[float] = Field(min_length=6, max_length=6)


class _TouchSection(Section):
    """A touch, in the file; joints in radians (metres)."""

    row: int
    frame: Literal["tool", "work_object", "held_part", "fixed_tool"]
    name: Name
    point: Name
    tool: Name
    joints_rad: list[float]
    u95_mm: float
    xyz_mm: list[float] | None
    kind: Literal["point", "sphere", "plane", "line"]
    radius_mm: float | None
    tracker_mm: list[float] | None
    residual_mm: list[float]
    residual_nominal_mm: list[float]
    axes: list[float]

    @staticmethod
    def of(one: Touch) -> _TouchSection:
        """The section of a touch."""
        return _TouchSection(
            row=one.row,
            frame=one.frame,
            name=one.name,
            point=one.point,
            tool=one.tool,
            joints_rad=one.q.tolist(),
            u95_mm=one.u95 / MM,
            xyz_mm=None if one.xyz is None else (one.xyz / MM).tolist(),
            kind=one.kind,
            radius_mm=None if one.radius is None else one.radius / MM,
            tracker_mm=None if one.tracker is None else (one.tracker / MM).tolist(),
            residual_mm=(one.residual / MM).tolist(),
            residual_nominal_mm=(one.residual_nominal / MM).tolist(),
            axes=one.e.tolist(),
        )

    def touch(self) -> Touch:
        """The touch of the section."""
        return Touch(
            self.row,
            self.frame,
            self.name,
            self.point,
            self.tool,
            np.array(self.joints_rad),
            self.u95_mm * MM,
            None if self.xyz_mm is None else np.array(self.xyz_mm) * MM,
            self.kind,
            None if self.radius_mm is None else self.radius_mm * MM,
            None if self.tracker_mm is None else np.array(self.tracker_mm) * MM,
            np.array(self.residual_mm) * MM,
            np.array(self.residual_nominal_mm) * MM,
            np.array(self.axes),
        )


class _Document(Section):
    """The whole file."""

    schema_name: Literal["irbcal-cell-1"]
    created: Date
    simulated: bool
    robot: Name
    fingerprint: Fingerprint
    tools: list[_FrameSection]
    work_objects: list[_FrameSection]
    covariance_rad_m: list[list[float]]
    touch_covariance_rad_m: list[list[float]]
    robot_gain_rad_m: list[list[float]]
    axes: list[_AxisSection]
    touches: list[_TouchSection]
    left_out: list[Sentence]
    notes: list[Sentence]
    seal: Sha256 | None = None

    @model_validator(mode="after")
    def _fits(self) -> _Document:
        size = 6 * (len(self.tools) + len(self.work_objects) + len(self.axes))
        for name in ("covariance_rad_m", "touch_covariance_rad_m"):
            matrix = getattr(self, name)
            if len(matrix) != size or any(len(row) != size for row in matrix):
                raise ValueError(f"{name} is not of {size} rows and columns, six for each frame")
        if len(self.robot_gain_rad_m) != size or len({len(row) for row in self.robot_gain_rad_m}) > 1:
            raise ValueError(f"robot_gain_rad_m is not of {size} rows of one length")
        for kind in (self.tools, self.work_objects):
            names = [one.name for one in kind]
            if len(names) > len(set(names)):
                raise ValueError("two frames have the same name")
            for one in kind:
                poses = [pose for pose in (one.true, one.nominal, one.controller) if pose is not None]
                lengths = [np.linalg.norm([pose.qw, pose.qx, pose.qy, pose.qz]) for pose in poses]
                if np.abs(np.subtract(lengths, 1.0)).max() > QUATERNION_TOLERANCE:
                    raise ValueError(f"{one.name}: expected a unit quaternion")
        return self


def frames_by_name(given: Mapping[str, ArrayLike] | None, parameter: str) -> dict[str, FloatArray]:
    """Frames (4, 4), metres, from the caller, by names in lower case.

    Raises
    ------
    OptionError
        If they are no rigid transforms by their names.
    """
    if given is not None and not isinstance(given, Mapping):
        raise OptionError(
            f"{parameter}: expected frames by their names, a dict of (4, 4), found {shown(given)}",
            parameter=parameter,
        )
    out = {}
    for name, T in (given or {}).items():
        try:
            frame = np.array(T, dtype=float)
        except (TypeError, ValueError):
            frame = np.zeros(0)
        rigid = frame.shape == (4, 4) and np.isfinite(frame).all() and (frame[3] == [0, 0, 0, 1]).all()
        if not rigid or np.abs(frame @ frames.inverse(frame) - np.eye(4)).max() > 1e-6:
            raise OptionError(f"{parameter}: {name}: expected a rigid transform of shape (4, 4)", parameter=parameter)
        out[name.lower()] = frame
    return out


def read_cell(path: str | PathLike[str]) -> CellFile:
    """Read a cell as `CellFile.save` writes it.

    Raises
    ------
    CalibrationError
        If it cannot be read, is no cell, has absurd numbers, or was edited or damaged after irbcal wrote it.
    """
    data = read_bytes(path, CalibrationError)
    try:
        content: Any = json.loads(data)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("schema_name") != SCHEMA:
        raise CalibrationError(f"expected a cell as irbcal cell writes it ({SCHEMA}), found another content", file=path)
    if content.get(KEY) != digest({name: part for name, part in content.items() if name != KEY}):
        raise CalibrationError(
            "it was changed after irbcal wrote it: a damaged file must not move a robot (call irbcal cell again)",
            file=path,
        )
    try:
        found = _Document.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise CalibrationError(f"{where}: {first['msg']}", file=path, parameter=where) from None
    refuse_absurd(content, Path(path))
    size = len(found.covariance_rad_m)
    return CellFile(
        found.fingerprint,
        found.robot,
        found.simulated,
        _by_name(found.tools),
        _by_name(found.work_objects),
        np.array(found.touch_covariance_rad_m).reshape(size, size),
        np.array(found.covariance_rad_m).reshape(size, size),
        np.array(found.robot_gain_rad_m).reshape(size, -1) if size else np.zeros((0, 0)),
        tuple(
            ExternalAxis(one.axis, tuple(one.carries), np.array(one.screw_rad_m), np.array(one.nominal_rad_m))
            for one in found.axes
        ),
        tuple(one.touch() for one in found.touches),
        tuple(found.left_out),
        tuple(found.notes),
        found.created,
    )


def cell_of(cell: CellFile | str | Path, fingerprint: str) -> CellFile:
    """A cell, from its file where that is named.

    Raises
    ------
    CalibrationError
        If it cannot be read, or was computed with another calibration than that of the fingerprint.
    """
    cell_file = cell if isinstance(cell, CellFile) else read_cell(cell)
    if cell_file.fingerprint != fingerprint:
        raise CalibrationError(
            f"its tools and work objects are by calibration {cell_file.fingerprint}, this one is {fingerprint}: call "
            "irbcal cell with this calibration and the same touches",
            file=None if isinstance(cell, CellFile) else cell,
        )
    return cell_file


def _by_name(sections: Sequence[_FrameSection]) -> dict[str, FrameInCell]:
    return {one.name: one.frame() for one in sections}


def _pose(T: FloatArray) -> PoseSection:
    w, x, y, z = frames.quaternion_from_matrix(T[:3, :3]).tolist()
    return PoseSection(x_mm=T[0, 3] / MM, y_mm=T[1, 3] / MM, z_mm=T[2, 3] / MM, qw=w, qx=x, qy=y, qz=z)


def _transform(pose: PoseSection) -> FloatArray:
    R = frames.matrix_from_quaternion([pose.qw, pose.qx, pose.qy, pose.qz])
    return frames.transform(R, np.array([pose.x_mm, pose.y_mm, pose.z_mm]) * MM)
