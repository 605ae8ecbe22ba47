r"""Two sets of tools and work objects: those that the controller computes with, and those that are true.

A program says: with the tool ``Tc`` and the work object ``Oc``, as the controller has them, go to the pose ``P``. What
is wanted is ``P`` for the true tool ``Tt`` in the true work object ``Ot``. With the calibrated robot ``C`` and the
model ``N`` of the controller::

    C(q) = Ot P Tt^-1       joints to command
    P'   = Oc^-1 N(q) Tc    the target to write

Tools are seen from the tip link, work objects from the base link. Tools and work objects that were taught with the
robot hold errors of the nominal model: a correction with them in place of the true ones makes the part worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, NameArray, lock
from irbcal.cell.cell_file import CellFile, read_cell
from irbcal.correction.program import Goals, Program
from irbcal.correction.text_program import TextProgram
from irbcal.errors import CalibrationError, OptionError
from irbcal.io.controller_model import ControllerFrames, unknown_frames
from irbcal.modeling import frames

ControllerNumbers: TypeAlias = Literal["same", "from-cell"]
"""Which numbers the controller will have for tools and work objects: its own, or those of the cell file."""

NULL, MEASURED, CELL, UNKNOWN = "null", "measured", "cell", "unknown"
"""Origins of a frame: flange or robot base themselves, measured independently of the robot, a cell file, none known."""

_ORDER = ("", NULL, MEASURED, CELL, UNKNOWN)
"""Of the two frames of a target the later one counts."""
ROUNDING = 1e-9
"""Metres and matrix elements within which a frame is the flange, or the robot base, itself."""


@dataclass(frozen=True)
class PointOrigin:
    """Which points of a program are taught.

    Attributes
    ----------
    taught : str or None
        Pattern of their names (``*`` and ``?``, upper and lower case alike); all other points are offline points, whose
        coordinates are wanted. None: no point is taught.
    re_express : bool
        Rewrite taught points as offline points of the true frames, and correct nothing.
    """

    taught: str | None = None
    re_express: bool = False

    def are_taught(self, names: Sequence[str]) -> BoolArray:
        """Which points are taught, shape (n,)."""
        pattern = None if self.taught is None else self.taught.lower()
        return np.array(
            [pattern is not None and (n.lower() == pattern or fnmatchcase(n.lower(), pattern)) for n in names],
            dtype=bool,
        )


def cell_of(cell: CellFile | str | Path | None, fingerprint: str) -> CellFile | None:
    """A cell, from its file where that is named.

    Raises
    ------
    CalibrationError
        If it cannot be read, or was computed with another calibration than that of the fingerprint.
    """
    found = cell if isinstance(cell, CellFile) or cell is None else read_cell(cell)
    if found is not None and found.fingerprint != fingerprint:
        raise CalibrationError(
            f"its tools and work objects are by calibration {found.fingerprint}, this one is {fingerprint}: call "
            "irbcal cell with this calibration and the same touches",
            file=cell if isinstance(cell, (str, Path)) else None,
        )
    return found


def point_origin(points: str | None, re_express: bool) -> PointOrigin:
    """Of the option: ``offline``, ``taught`` or ``taught:PATTERN``.

    Raises
    ------
    OptionError
        If it is something else, or points are to be re-expressed of which none is taught.
    """
    kind, colon, pattern = (points or "offline").partition(":")
    if kind not in ("offline", "taught") or (colon and (kind == "offline" or not pattern)):
        raise OptionError(f"points: expected offline, taught or taught:PATTERN, found {points!r}", parameter="points")
    if re_express and kind == "offline":
        raise OptionError("re_express: rewrites taught points, give points=taught too", parameter="re_express")
    return PointOrigin((pattern or "*") if kind == "taught" else None, re_express)


@dataclass(frozen=True, eq=False, repr=False)
class FramesOfGoals:
    """Tools and work objects of n goals.

    Attributes
    ----------
    tools, work_objects : ndarray of str, shape (n,)
        Names as programs have them; empty where the program does not tell one.
    tool_origins, object_origins : ndarray of str, shape (n,)
        `NULL`, `MEASURED`, `CELL` or `UNKNOWN`; empty where no tool and work object matter: joint targets that are
        corrected for the robot alone, and files without frames.
    T_left, T_right : ndarray, shape (n, 4, 4)
        ``Ot Oc^-1`` and ``Tc Tt^-1``: between them stands the flange as the controller computes it.
    tcp : ndarray, shape (n, 3)
        Tool centre point of the controller's tool in the tip link, metres.
    T_tool, T_object : ndarray, shape (n, 4, 4)
        ``Tt`` and ``Ot``, as far as they are known.
    """

    tools: NameArray
    work_objects: NameArray
    tool_origins: NameArray
    object_origins: NameArray
    T_left: FloatArray
    T_right: FloatArray
    tcp: FloatArray
    T_tool: FloatArray
    T_object: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def origins(self) -> NameArray:
        """Of each target the origin of its frame that is known worst."""
        return worst(self.tool_origins, self.object_origins)


def worst(tool_origins: NameArray, object_origins: NameArray) -> NameArray:
    """Of each target the origin of its frame that is known worst, shape (n,)."""
    pairs = zip(tool_origins, object_origins, strict=True)
    return np.array([max(pair, key=_ORDER.index) for pair in pairs], dtype=object)


@dataclass(frozen=True, eq=False, repr=False)
class TrueFrames:
    """What is known of the tools and work objects of programs.

    Attributes
    ----------
    cell : CellFile or None
        Its tools and work objects are true; their names are compared without upper and lower case.
    measured : bool
        Whether all others were measured independently of the robot, and so are true as the controller has them.
    numbers : str
        Which numbers the controller will have.
    points : PointOrigin
    ends : ControllerFrames
        Where the controller's flange and world are.
    """

    cell: CellFile | None = None
    measured: bool = False
    numbers: ControllerNumbers = "same"
    points: PointOrigin = PointOrigin()
    ends: ControllerFrames = field(default_factory=unknown_frames)

    def check(self, cutting: bool) -> None:
        """Refuse options that contradict each other; ``cutting``: points shall be put into moves.

        Raises
        ------
        OptionError
            If some do.
        """
        if self.numbers not in ("same", "from-cell"):
            message = f"controller_frames: expected same or from-cell, found {self.numbers!r}"
            raise OptionError(message, parameter="controller_frames")
        if self.numbers == "from-cell" and (self.cell is None or self.points.re_express):
            message = "controller_frames: numbers from-cell are for corrections with a cell, give cell too"
            raise OptionError(message, parameter="controller_frames")
        if self.points.re_express and self.cell is None and not self.measured:
            message = (
                "re_express: the true tools and work objects are not known: give a cell, or say frames_measured if "
                "they were measured independently of the robot"
            )
            raise OptionError(message, parameter="re_express")
        if cutting and (self.cell is not None or self.points.taught is not None):
            message = "path_tolerance: paths are cut for the controller's own tools and work objects only, without cell"
            raise OptionError(f"{message} and taught points", parameter="path_tolerance")

    def of_goals(self, program: Program, goals: Goals) -> FramesOfGoals:
        """Tools and work objects of the goals of a program."""
        n = len(goals.names)
        tools, work_objects, tool_origins, object_origins = (np.full(n, "", dtype=object) for _ in range(4))
        T_left, T_right, T_tool, T_object = np.tile(np.eye(4), (4, n, 1, 1))
        tcp = np.zeros((n, 3))
        for k, number in enumerate(goals.numbers.tolist()):
            names = _names_of(program, number) if isinstance(program, TextProgram) else None
            if names is None or not isinstance(program, TextProgram):
                continue  # of joint targets and of files without frames: those of other poses are known
            tools[k], work_objects[k] = names
            Tc, Oc = program.tools[names[0]], program.work_objects[names[1]]
            Tt, tool_origin = self._true("tools", names[0], Tc, self.ends.T_tip_flange)
            Ot, object_origin = self._true("work_objects", names[1], Oc, self.ends.T_base_world)
            if goals.kind == "pose" or CELL in (tool_origin, object_origin):
                tool_origins[k], object_origins[k] = tool_origin, object_origin
            T_left[k], T_right[k], tcp[k] = Ot @ frames.inverse(Oc), Tc @ frames.inverse(Tt), Tc[:3, 3]
            T_tool[k], T_object[k] = Tt, Ot
        return FramesOfGoals(tools, work_objects, tool_origins, object_origins, T_left, T_right, tcp, T_tool, T_object)

    def _true(self, kind: str, name: str, T: FloatArray, T_null: FloatArray) -> tuple[FloatArray, str]:
        """The true frame of a name, and its origin; ``T`` is what the controller has."""
        for one in () if self.cell is None else getattr(self.cell, kind).values():
            if one.name.lower() == name:
                # a tip alone tells no axes: they are the controller's
                R = T[:3, :3] if one.position_only else one.T_true[:3, :3]
                return frames.transform(R, one.T_true[:3, 3]), CELL
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
