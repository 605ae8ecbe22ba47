r"""Two sets of tools and work objects: those that the controller computes with, and those that are true.

A program says: with the tool ``Tc`` and the work object ``Oc``, as the controller has them, go to the pose ``P``. What
is wanted is ``P`` for the true tool ``Tt`` in the true work object ``Ot``. With the calibrated robot ``C`` and the model
``N`` of the controller::

    C(q) = Ot P Tt^-1       joints to command
    P'   = Oc^-1 N(q) Tc    the target to write

Tools are seen from the tip link, work objects from the base link. Tools and work objects that were taught with the
robot hold errors of the nominal model: a correction with them in place of the true ones makes the part worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Literal, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, NameArray, lock
from irbcal.correction.program import Goals, Program
from irbcal.correction.text_program import TextProgram
from irbcal.errors import OptionError
from irbcal.files.controller_frames import ControllerFrames, unknown
from irbcal.modeling import frames

ControllerNumbers: TypeAlias = Literal["same", "from-cell"]
"""Which numbers the controller will have for tools and work objects: its own, or those of the cell file."""

NULL, MEASURED, CELL, UNKNOWN = "null", "measured", "cell", "unknown"
"""Origins of a frame: flange or robot base themselves, measured independently of the robot, a cell file, none known."""

_ORDER = (NULL, MEASURED, CELL, UNKNOWN)
"""Of the two frames of a target the later one counts."""


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
    origins : ndarray of str, shape (n,)
        `NULL`, `MEASURED`, `CELL` or `UNKNOWN`; empty where no tool and work object matter: joint targets that are
        corrected for the robot alone, and files without frames.
    T_left, T_right : ndarray, shape (n, 4, 4)
        ``Ot Oc^-1`` and ``Tc Tt^-1``: between them stands the flange as the controller computes it.
    tcp : ndarray, shape (n, 3)
        Tool centre point of the controller's tool in the tip link, metres.
    """

    tools: NameArray
    work_objects: NameArray
    origins: NameArray
    T_left: FloatArray
    T_right: FloatArray
    tcp: FloatArray

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True, eq=False, repr=False)
class TrueFrames:
    """What is known of the tools and work objects of programs.

    Attributes
    ----------
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        True tools in the tip link and true work objects in the base link, metres, by their names in lower case.
    measured : bool
        Whether all others were measured independently of the robot, and so are true as the controller has them.
    numbers : str
        Which numbers the controller will have.
    points : PointOrigin
    ends : ControllerFrames
        Where the controller's flange and world are.
    """

    tools: Mapping[str, FloatArray] = field(default_factory=dict)
    work_objects: Mapping[str, FloatArray] = field(default_factory=dict)
    measured: bool = False
    numbers: ControllerNumbers = "same"
    points: PointOrigin = PointOrigin()
    ends: ControllerFrames = field(default_factory=unknown)

    def of_goals(self, program: Program, goals: Goals) -> FramesOfGoals:
        """Tools and work objects of the goals of a program."""
        n = len(goals.names)
        text = np.full((3, n), "", dtype=object)
        T, tcp = np.tile(np.eye(4), (2, n, 1, 1)), np.zeros((n, 3))
        if isinstance(program, TextProgram):
            for k, number in enumerate(goals.numbers.tolist()):
                uses = {(use.tool, use.work_object) for use in program.targets[number].uses}
                tool, work_object = uses.pop() if len(uses) == 1 else (None, None)
                if tool not in program.tools or work_object not in program.work_objects:
                    continue  # of joint targets only: poses have known frames
                Tc, Oc = program.tools[tool or ""], program.work_objects[work_object or ""]
                Tt, tool_from = self._true(self.tools, tool or "", Tc, self.ends.T_tip_flange)
                Ot, object_from = self._true(self.work_objects, work_object or "", Oc, self.ends.T_base_world)
                origin = max(tool_from, object_from, key=_ORDER.index)
                matters = goals.kind == "pose" or CELL in (tool_from, object_from)
                text[:, k] = tool, work_object, origin if matters else ""
                T[0, k], T[1, k], tcp[k] = Ot @ frames.inverse(Oc), Tc @ frames.inverse(Tt), Tc[:3, 3]
        return FramesOfGoals(text[0], text[1], text[2], T[0], T[1], tcp)

    def _true(
        self, known: Mapping[str, FloatArray], name: str, T: FloatArray, T_null: FloatArray
    ) -> tuple[FloatArray, str]:
        """The true frame, and where it is from."""
        if name in known:
            return known[name], CELL
        if min(np.abs(T - T_null).max(), np.abs(T - np.eye(4)).max()) < 1e-12:
            return T, NULL
        return T, MEASURED if self.measured else UNKNOWN
