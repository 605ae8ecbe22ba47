r"""Programs of text in which targets stand as numbers: replacing these and nothing else.

A target is either a set of joints or a pose of the tool centre point in a work object. Writing fake targets
(Nubiola 2011, section 6.2) means to replace the numbers of targets and to leave every other byte::

    T_base_tip = T_base_wobj @ T_wobj_tcp @ inverse(T_tip_tcp)

where ``tip`` is the flange frame that carries the tool (``tool0``) and ``base`` the frame that carries the work
objects (``wobj0``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.correction.configurations import ConfData
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.listing import Edit, Span
from irbcal.correction.maker import Posture
from irbcal.correction.program import Goals, Kind, Left, Note, Stop
from irbcal.modeling import frames

Configuration: TypeAlias = ConfData | Posture
"""Which solution of a pose is meant, as a language says it."""

Role: TypeAlias = Literal["to", "via"]


@dataclass(frozen=True)
class Use:
    """One direct use of a target in a move.

    Attributes
    ----------
    line, column : int
        Of the instruction; both start at 1.
    instruction : str
        As usually spelled: MoveJ, MoveL, MoveC, MoveAbsJ, TriggL, …
    role : str
        ``to``, or ``via`` for the point on the circle.
    tool, work_object : str or None
        Names in lower case; None where the program computes them.
    file : str
        Of the move where that is another than the target's.
    """

    line: int
    column: int
    instruction: str
    role: Role
    tool: str | None
    work_object: str | None
    file: str = ""

    @property
    def place(self) -> str:
        """Where it stands, in words."""
        return f"line {self.line} of {self.file}" if self.file else f"line {self.line}"


@dataclass(frozen=True, eq=False, repr=False)
class Target:
    """A target whose numbers stand in the file.

    Attributes
    ----------
    name : str
        As in the program, with the index for the element of an array; the place for a literal inside a move.
    kind : str
        ``joint`` or ``pose``.
    value : ndarray, shape (6,) or (4, 4)
        Joints in radians, or ``T_wobj_tcp`` in metres; locked. NaN where ``conflicts`` says that it has none.
    configuration : ConfData, Posture or None
        Of a pose; None where it is not a literal.
    external : str
        External axes as they stand in the file.
    line, column : int
        Where the literal begins; both start at 1.
    uses : tuple of Use
        Direct uses in moves.
    conflicts : tuple of str
        Why changing this literal would do more, or something else, than correct its direct uses.
    written : tuple of float
        The numbers as they stand in the file: degrees, or mm and quaternion (scalar first).
    spans, configuration_spans : tuple of (int, int)
        Where these numbers stand in the text.
    near : ndarray, shape (6,) or None
        Joints that the program names as the ones to start from, radians; locked.
    after : tuple of int or None
        For each use the number of the target that the arm comes from; None where it may come from elsewhere.

    There is one for each literal of a module, so the array is locked where it is made.
    """

    name: str
    kind: Kind
    value: FloatArray
    configuration: Configuration | None
    external: str
    line: int
    column: int
    uses: tuple[Use, ...]
    conflicts: tuple[str, ...]
    written: tuple[float, ...]
    spans: tuple[Span, ...]
    configuration_spans: tuple[Span, ...] = ()
    near: FloatArray | None = None
    after: tuple[int | None, ...] = ()

    @property
    def correctable(self) -> bool:
        """Whether a move uses this target and nothing speaks against changing it."""
        return bool(self.uses) and not self.conflicts

    @property
    def reason(self) -> str:
        """Why the target is not correctable, one sentence part; empty if it is."""
        return "; ".join(self.conflicts) or ("" if self.uses else "no move of this module uses it")


@dataclass(frozen=True)
class Uncorrected:
    """A move that goes, at least in part, to a target that cannot be corrected."""

    line: int
    column: int
    instruction: str
    target: str
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class TextProgram(ABC):
    """A program as read: its text and what was understood of it; a language says how it is marked.

    Attributes
    ----------
    source : str
        File name for messages.
    text, encoding : str
        ``text.encode(encoding)`` are the bytes of the file.
    targets : tuple of Target
        In the order of the file.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        ``T_tip_tcp`` and ``T_base_wobj`` of the names (lower case) that direct uses of poses need, and of those of
        joint targets that are known; metres.
    uncorrected : tuple of Uncorrected
        Moves that are left as they are.
    notes : tuple of Note
        What the user should look at.
    fingerprint : str or None
        Of the calibration that this program was already corrected with; empty where the mark does not say.
    """

    source: str
    text: str
    encoding: str
    targets: tuple[Target, ...]
    tools: Mapping[str, FloatArray]
    work_objects: Mapping[str, FloatArray]
    uncorrected: tuple[Uncorrected, ...]
    notes: tuple[Note, ...]
    fingerprint: str | None

    def __post_init__(self) -> None:
        lock(self)

    @abstractmethod
    def edits(self, new_values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of the numbers that change; see `with_targets`."""

    @abstractmethod
    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """Configurations of pose targets that joints (n, 6) in radians reach; None where none is to be written."""

    @property
    def data(self) -> bytes:
        """The bytes of the file."""
        return self.text.encode(self.encoding)

    def correctable(self, kind: Kind | None = None) -> list[int]:
        """Numbers of the targets that may be changed, of one kind or of both: list of int."""
        return [k for k, t in enumerate(self.targets) if t.correctable and kind in (None, t.kind)]

    def skipped(self) -> list[tuple[Target, str]]:
        """Targets that are left as they are, with the reason: list of (Target, str)."""
        return [(t, t.reason) for t in self.targets if not t.correctable]

    def goals(self) -> list[Goals]:
        """The targets that may be corrected: joints first, then poses."""
        out = []
        joints, poses = self.correctable("joint"), self.correctable("pose")
        if joints:
            out.append(self._goals("joint", joints, np.array([self.targets[k].value for k in joints])))
        if poses:
            out.append(self._goals("pose", poses, tip_poses(self, poses)))
        return out

    def _goals(self, kind: Kind, numbers: list[int], values: FloatArray) -> Goals:
        targets = [self.targets[k] for k in numbers]
        return Goals(
            kind,
            np.array(numbers),
            tuple(target.name for target in targets),
            np.array([target.line for target in targets]),
            values,
            tuple(target.configuration for target in targets) if kind == "pose" else None,
        )

    def left(self) -> list[Left]:
        """Targets that are not correctable, and moves whose target is not."""
        targets = [Left(t.name, t.line, reason) for t, reason in self.skipped() if t.uses or t.conflicts]
        moves = [Left(f"{move.instruction} {move.target}", move.line, move.reason) for move in self.uncorrected]
        return targets + moves

    def stops(self) -> tuple[Stop, ...]:
        """The stops in the order of the program; empty where the language does not tell."""
        return ()

    def refused(self, goals: Goals, fake: Corrected) -> list[str]:
        """Why corrections that were found cannot be written, for each goal; empty where they can."""
        return [""] * len(goals.names)

    def new_text(
        self, found: Sequence[tuple[Goals, Corrected]]
    ) -> tuple[dict[int, FloatArray], dict[int, Configuration]]:
        """New values and configurations, by the number of the target, of all targets that are corrected."""
        values: dict[int, FloatArray] = {}
        configurations: dict[int, Configuration] = {}
        for goals, fake in found:
            rows = np.flatnonzero(fake.ok)
            chosen = goals.numbers[rows].tolist()
            if goals.kind == "joint":
                values |= dict(zip(chosen, fake.q[rows], strict=True))
                continue
            values |= values_for_tip_poses(self, chosen, fake.T_fake[rows])
            new = self.new_configurations([self.targets[k] for k in chosen], fake.q[rows])
            configurations |= {k: one for k, one in zip(chosen, new, strict=True) if one is not None}
        return values, configurations

    @abstractmethod
    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """Files of the program with fake targets, configuration data and, with a fingerprint, the language's mark."""


def tip_poses(program: TextProgram, indices: Sequence[int]) -> FloatArray:
    """Poses of the flange that pose targets ask for.

    Parameters
    ----------
    program : TextProgram
    indices : sequence of int
        Numbers of correctable pose targets.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip``, metres.
    """
    T_base_wobj, T_tip_tcp = _frames_of(program, indices)
    values = np.array([program.targets[k].value for k in indices]).reshape(-1, 4, 4)
    return T_base_wobj @ values @ frames.inverse(T_tip_tcp)


def values_for_tip_poses(program: TextProgram, indices: Sequence[int], T_base_tip: ArrayLike) -> dict[int, FloatArray]:
    """Values of pose targets that make the flange reach given poses; the inverse of `tip_poses`.

    Returns
    -------
    dict of int to ndarray, shape (4, 4)
        ``T_wobj_tcp`` by the number of the target, as `with_targets` takes it.
    """
    T_base_wobj, T_tip_tcp = _frames_of(program, indices)
    values = frames.inverse(T_base_wobj) @ np.asarray(T_base_tip, dtype=float).reshape(-1, 4, 4) @ T_tip_tcp
    return dict(zip(indices, values, strict=True))


def _frames_of(program: TextProgram, indices: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    uses = [program.targets[k].uses[0] for k in indices]  # a correctable target is used with one tool and work object
    work_objects = [program.work_objects[use.work_object or ""] for use in uses]
    tools = [program.tools[use.tool or ""] for use in uses]
    return np.array(work_objects).reshape(-1, 4, 4), np.array(tools).reshape(-1, 4, 4)


def with_targets(
    program: TextProgram,
    new_values: Mapping[int, FloatArray],
    configurations: Mapping[int, Configuration] | None = None,
) -> bytes:
    """Bytes of the program with new values for some targets and all else untouched.

    A number that the new value does not change, within the decimals written, keeps its text.

    Parameters
    ----------
    program : TextProgram
    new_values : dict of int to ndarray, shape (6,) or (4, 4)
        By the number of the target: joints in radians or ``T_wobj_tcp`` in metres.
    configurations : dict of int to ConfData or Posture, optional
        New configurations of pose targets.

    Returns
    -------
    bytes

    Raises
    ------
    ProgramError
        If a configuration is to be written where the program has no literal one.
    ValueError
        If a value is not finite, not rigid or of the wrong shape.
    """
    check_values(program, new_values)
    pieces: list[str] = []
    end = 0
    for start, stop, text in sorted(program.edits(new_values, configurations or {})):
        pieces += [program.text[end:start], text]
        end = stop
    return "".join([*pieces, program.text[end:]]).encode(program.encoding)


def check_values(program: TextProgram, new_values: Mapping[int, FloatArray]) -> None:
    """Refuse values that are not finite or of the wrong shape.

    Raises
    ------
    ValueError
        If one is.
    """
    for k, value in new_values.items():
        shape = (4, 4) if program.targets[k].kind == "pose" else (6,)
        if np.shape(value) != shape or not np.isfinite(value).all():
            raise ValueError(f"target {program.targets[k].name}: expected finite numbers of shape {shape}")
