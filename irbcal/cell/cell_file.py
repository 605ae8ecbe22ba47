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
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, WrapSerializer

from irbcal.arrays import FloatArray, Locked
from irbcal.cell.external_axes import ExternalAxis
from irbcal.distributions import NORMAL_95
from irbcal.errors import CalibrationError, OptionError
from irbcal.io.integrity import KEY, digest, refuse_absurd
from irbcal.io.robot_section import Transform
from irbcal.modeling import frames
from irbcal.option_values import excerpt
from irbcal.safe_files import read_bytes, write_set
from irbcal.section import Date, Fingerprint, Name, Numbers, Sentence
from irbcal.summary import Paragraph, Result, Table, html_page, remarks
from irbcal.units import DEG, MM

SCHEMA = "irbcal-cell-1"
TOOL, WORK_OBJECT, AXIS = "tool", "work_object", "axis"
HELD_PART, FIXED_TOOL = "held_part", "fixed_tool"
"""A part on the flange counts among the tools, the tool that stands and works on it among the work objects."""
FrameKind: TypeAlias = Literal["tool", "work_object", "held_part", "fixed_tool"]
TouchKind: TypeAlias = Literal["point", "sphere", "plane", "line"]
ON_FLANGE, STANDING = (TOOL, HELD_PART), (WORK_OBJECT, FIXED_TOOL)
RESIDUALS = ("residual", "residual_nominal")
IN_FILE = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)
Joints: TypeAlias = Annotated[FloatArray, Numbers(-1)]
CellPoint: TypeAlias = Annotated[FloatArray, Numbers(3, unit=MM)]
FrameMatrix: TypeAlias = Annotated[FloatArray, Numbers(-1, -1)]


class Notation(NamedTuple):
    """How frames are written for people."""

    names: tuple[str, ...]
    """Of the numbers."""
    numbers: Callable[[str, FloatArray], Sequence[float]]
    """From ``tool`` or ``work_object`` and its transform to the numbers."""
    description: str
    """What they count from."""
    digits: int = 4
    """Decimals."""


AS_URDF = Notation(
    ("x mm", "y mm", "z mm", "roll", "pitch", "yaw"),
    lambda _, T: [*(T[:3, 3] / MM), *(frames.rpy_from_matrix(T[:3, :3]) / DEG)],
    "in the URDF's tip link and base link, angles in degrees",
)


@dataclass(frozen=True, eq=False)
class FrameInCell(Locked):
    """A tool or a work object."""

    __pydantic_config__ = IN_FILE

    name: Name
    """As programs call it."""
    T_true: Annotated[Transform, Field(alias="true")]
    """Shape (4, 4). By the calibrated robot, metres: a tool in the tip link (``T_f_t``), a work object in the base link
    (``T_b_o``).
    """
    T_nominal: Annotated[Transform, Field(alias="nominal")]
    """Shape (4, 4). From the same touches by the nominal robot: what a controller that computes with it has."""
    T_controller: Annotated[Transform | None, Field(alias="controller")] = None
    """Shape (4, 4). What the controller has, in the same links, where that is known."""
    position_only: bool = False
    """A tool taught by its tip alone: its axes are the controller's, or the tip link's (of a fixed tool the base
    link's), and count as exact.
    """
    fixed_tool: bool = False
    """A part that the robot holds, or the tool that stands and works on it."""

    def title(self, mount: str) -> str:
        """What it is, and its name; ``mount`` is ``tool`` on the flange, else ``work_object``."""
        nouns = (HELD_PART, FIXED_TOOL) if self.fixed_tool else (TOOL, WORK_OBJECT)
        return f"{nouns[mount != TOOL].replace('_', ' ')} {self.name}"


@dataclass(frozen=True, eq=False)
class Touch(Locked):
    """A touch and what is left of it."""

    __pydantic_config__ = IN_FILE

    row: int
    """In the table, for messages."""
    frame: FrameKind
    """What is sought."""
    name: Name
    """Of what is sought, as programs call it."""
    point: Name
    """Of what is sought: the point that was touched."""
    tool: Name
    """Whose tip touched: for a tool the tool itself, for a held part the fixed tool that was touched with it."""
    q: Annotated[Joints, Field(alias="joints_rad")]
    """Shape (joints,). Radians (metres)."""
    u95: Annotated[float, Numbers(unit=MM), Field(alias="u95_mm")]
    """Of the touch, metres."""
    xyz: Annotated[CellPoint | None, Field(alias="xyz_mm")] = None
    """Shape (3,). The point in the work object (held part, fixed tool), where it is known, metres."""
    kind: TouchKind = "point"
    """What the tip of a tool touched."""
    radius: Annotated[Annotated[float, Numbers(unit=MM)] | None, Field(alias="radius_mm")] = None
    """Of the sphere, to the tip, where it is known, metres."""
    tracker: Annotated[CellPoint | None, Field(alias="tracker_mm")] = None
    """Shape (3,). The point as a tracker measured it, in the measuring frame of the calibration, metres."""
    residual: Annotated[CellPoint, Field(alias="residual_mm")] = field(default_factory=lambda: np.zeros(3))
    residual_nominal: Annotated[CellPoint, Field(alias="residual_nominal_mm")] = field(
        default_factory=lambda: np.zeros(3)
    )
    """Shape (3,). In the base link, metres: where the tip should be less the tip by the calibrated (nominal) robot."""
    axis_positions: Annotated[Joints, Field(alias="axes")] = field(default_factory=lambda: np.zeros(0))
    """Shape (axes,). Of the external axes, radians (metres)."""

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


def _by_name(frames_in_file: Any) -> Any:
    """Frames of a file by their names; anything else is left to the check of its type."""
    if not isinstance(frames_in_file, list) or not all(isinstance(frame, dict) for frame in frames_in_file):
        return frames_in_file
    by_name = {str(frame.get("name")): frame for frame in frames_in_file}
    if len(by_name) < len(frames_in_file):
        raise ValueError("two frames have the same name")
    return by_name


FramesByName: TypeAlias = Annotated[
    Mapping[str, FrameInCell],
    BeforeValidator(_by_name),
    WrapSerializer(lambda by_name, written: list(written(by_name).values())),
]
"""Frames by their names; in the file a list."""


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

    __pydantic_config__ = IN_FILE

    fingerprint: Fingerprint
    robot: Name
    simulated: bool
    tools: FramesByName
    work_objects: FramesByName
    touch_covariance: Annotated[FrameMatrix, Field(alias="touch_covariance_rad_m")]
    covariance: Annotated[FrameMatrix, Field(alias="covariance_rad_m")]
    robot_gain: Annotated[FrameMatrix, Field(alias="robot_gain_rad_m")]
    axes: tuple[ExternalAxis, ...] = ()
    touches: tuple[Touch, ...] = ()
    left_out: tuple[Sentence, ...] = ()
    notes: tuple[Sentence, ...] = ()
    created: Date = field(default_factory=lambda: datetime.now(timezone.utc).isoformat(timespec="seconds"))

    def __post_init__(self) -> None:
        super().__post_init__()
        size = 6 * (len(self.tools) + len(self.work_objects) + len(self.axes))
        if not self.covariance.shape == self.touch_covariance.shape == (size, size) or len(self.robot_gain) != size:
            raise ValueError(f"covariances and robot_gain need {size} rows, six for each frame and axis")

    def report(self, notation: Notation = AS_URDF) -> list[Paragraph]:
        """The frames with their intervals, and by how much the controller's differ; see `Result.report`."""
        by = [f"mean {size.mean():.3f}, largest {size.max():.3f} mm" for size in self._residual_sizes()]
        headline = (
            f"{'SIMULATED: ' if self.simulated else ''}{len(self.touches)} touches by the calibrated {self.robot}: "
            f"they miss by {by[0]}; by the nominal robot {by[1]}"
        )
        rows: list[tuple[str | float | None, ...]] = []
        for frame, member in self._all():
            touching = self.u95(frame, member.name, self.touch_covariance)
            theirs = member.T_nominal if member.T_controller is None else member.T_controller
            away = float(np.linalg.norm(theirs[:3, 3] - member.T_true[:3, 3])) / MM
            turned = float(frames.rotation_distance(theirs[:3, :3], member.T_true[:3, :3])) / DEG
            true, other = (map(float, notation.numbers(frame, T)) for T in (member.T_true, theirs))
            label = member.title(frame).removeprefix("work ")
            rows.append(
                (label, *true, touching[0] / MM, None if member.position_only else touching[1] / DEG, None, None)
            )
            word = "  nominal" if member.T_controller is None else "  controller"
            rows.append((word, *other, None, None, away, None if member.position_only else turned))
        heads = ("frame", *notation.names, "u95 mm", "deg", "off mm", "deg")
        table = Table(f"Frames {notation.description}", heads, tuple(rows), digits=notation.digits)
        return [
            headline,
            table,
            *self._axes_in_words(),
            *remarks("Note", (*self.left_out, self._whole_in_words(), *self.notes)),
        ]

    def _whole_in_words(self) -> str:
        """The intervals with the robot's own errors."""
        sizes = [self.u95(frame, one.name, self.covariance)[0] / MM for frame, one in self._all()]
        return (
            "u95 is that of the touches alone; with the uncertainty of the robot, which is common to all programs and "
            f"included by irbcal filter --cell, {', '.join(f'{size:.2f}' for size in sizes)} mm"
        )

    def page(self, title: str = "Cell", more: Sequence[Paragraph] = (), notation: Notation = AS_URDF) -> str:
        """The report with all touches as one HTML page; see `Result.page`."""
        rows = [
            (touch.row, touch.frame.replace("_", " "), touch.name, touch.point, touch.tool, touch.u95 / MM, *sizes)
            for touch, sizes in zip(self.touches, self._residual_sizes().T.tolist(), strict=True)
        ]
        heads = ("row", "frame", "name", "point", "tool", "u95 mm", "residual mm", "by nominal mm")
        touches = Table("Touches", heads, tuple(rows))
        return html_page(f"{title} of {self.robot}", [*self.report(notation), touches, *more])

    def _residual_sizes(self) -> FloatArray:
        """Lengths of residuals by the calibrated and by the nominal robot, shape (2, touches), mm."""
        return np.array([[np.linalg.norm(getattr(touch, name)) for touch in self.touches] for name in RESIDUALS]) / MM

    def _axes_in_words(self) -> list[str]:
        """How far external axes are from where the controller has them, at the touches."""
        out = []
        for k, axis in enumerate(self.axes):
            e = np.array([touch.axis_positions[k] for touch in self.touches])
            rows = self.rows(AXIS, axis.column)
            std = np.sqrt(np.maximum(np.diagonal(self.covariance)[rows], 0.0))
            points = [one.T_true[:3, 3] for name, one in self.work_objects.items() if name.lower() in axis.carries]
            turn, shift = axis.departure(e, (points or [np.zeros(3)])[0])
            direction = NORMAL_95 * std[3:].max() if axis.slides else NORMAL_95 * std[:3].max()
            out.append(
                f"External axis {axis.column} from {e.min() / axis.unit:g} to {e.max() / axis.unit:g}: it carries "
                f"{' and '.join(axis.carries)} up to {shift / MM:.3f} mm and {turn / DEG:.4f} deg beside where the "
                f"controller has it; u95 of its direction {direction / DEG:.4f} deg"
            )
        return out

    def u95(self, frame: str, name: str, covariance: FloatArray) -> tuple[float, float]:
        """Half-widths that hold 95 % of a coordinate's errors (metres) and an angle's (radians), largest of three."""
        std = np.sqrt(np.maximum(np.diagonal(covariance)[self.rows(frame, name)], 0.0))
        return float(NORMAL_95 * std[3:].max()), float(NORMAL_95 * std[:3].max())

    def _all(self) -> list[tuple[str, FrameInCell]]:
        pairs = ((TOOL, self.tools), (WORK_OBJECT, self.work_objects))
        return [(frame, one) for frame, named in pairs for one in named.values()]

    def to_dict(self) -> dict[str, Any]:
        """The content of the file but for its seal, ready for JSON."""
        return {"schema_name": SCHEMA, **_IN_FILE.dump_python(self, mode="json", by_alias=True)}

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
            If it cannot be written, or `read_cell` would refuse it.
        """
        write_set({Path(path): self.content(path)})
        return Path(path)

    def content(self, path: str | PathLike[str]) -> bytes:
        """Content of the file; a `CalibrationError` that names it if `read_cell` would refuse it."""
        document = self.to_dict()
        _checked(document, path)
        return (json.dumps(document | {KEY: digest(document)}, indent=1) + "\n").encode()


_IN_FILE = TypeAdapter(CellFile)


def frames_by_name(transforms: Mapping[str, ArrayLike] | None, parameter: str) -> dict[str, FloatArray]:
    """Frames (4, 4), metres, from the caller, by names in lower case.

    Raises
    ------
    OptionError
        If they are no rigid transforms by their names.
    """
    if transforms is not None and not isinstance(transforms, Mapping):
        raise OptionError(
            f"{parameter}: expected frames by their names, a dict of (4, 4), found {excerpt(transforms)}",
            parameter=parameter,
        )
    out = {}
    for name, T in (transforms or {}).items():
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
    return _checked(content, path)


def _checked(content: dict[str, Any], path: str | PathLike[str]) -> CellFile:
    try:
        cell = _IN_FILE.validate_python({name: content[name] for name in content.keys() - {KEY, "schema_name"}})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise CalibrationError(f"{where}: {first['msg']}", file=path, parameter=where) from None
    refuse_absurd(content, Path(path))
    return cell


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
