r"""ABB RAPID modules: which targets stand in them as numbers, and which moves use them.

Literals of ``robtarget`` and ``jointtarget`` in declarations, in assignments and inside moves are read; a move whose
target the program computes (``Offs``, ``RelTool``, arithmetic, a function) is reported and left. A target is not
corrected where its literal does more than the direct moves that use it: where it is also an argument of something
else, where its variable is also computed, where moves use it with different tools or work objects. Uses in
other modules of the same call count, see ``abroad``; what is not in the call is not seen.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.configurations import ConfData, configuration_of
from irbcal.correction.cutting import CutPath, PathMove
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.languages.rapid.abroad import Abroad
from irbcal.correction.languages.rapid.frames import given_frames, shared_frames
from irbcal.correction.languages.rapid.literals import Literals
from irbcal.correction.languages.rapid.marking import in_comments, mark
from irbcal.correction.languages.rapid.needed_frames import needed_frames
from irbcal.correction.languages.rapid.order import breaks, stops
from irbcal.correction.languages.rapid.parts import ABSENT, Literal
from irbcal.correction.languages.rapid.paths import PathText, insertions, paths
from irbcal.correction.languages.rapid.syntax import Reader
from irbcal.correction.languages.rapid.tokens import decode
from irbcal.correction.languages.rapid.uses import Uses
from irbcal.correction.languages.rapid.writing import edits
from irbcal.correction.listing import Edit
from irbcal.correction.notation import poses_from_numbers
from irbcal.correction.program import Given, Goals, Note, Stop, read_bytes
from irbcal.correction.text_program import Configuration, Target, TextProgram, with_targets
from irbcal.errors import ProgramError
from irbcal.modeling.arm import Arm
from irbcal.units import DEG

_NOTES = {
    **dict.fromkeys(["pdispon", "pdispset"], "a program displacement moves targets that are corrected without it"),
    **dict.fromkeys(["getdataval", "setdataval", "setalldataval"], "data are reached by a name that is not followed"),
}


@dataclass(frozen=True, eq=False, repr=False)
class Module(TextProgram):
    """A RAPID module as read.

    Attributes
    ----------
    order : tuple of Stop
        Its stops in the order of the text.
    moves : callable
        Gives its straight and circular moves in the order of the text, and their text; gathered when asked for.
    cuts : tuple of CutPath
        What is put into these; empty: nothing.
    """

    order: tuple[Stop, ...] = ()
    moves: Callable[[], tuple[tuple[PathMove, PathText], ...]] = tuple
    cuts: tuple[CutPath, ...] = ()

    def path_moves(self) -> list[PathMove]:
        """The straight and circular moves, see `irbcal.correction.languages.rapid.paths`."""
        return [move for move, _ in self.moves()]

    def with_cuts(self, cuts: Sequence[CutPath]) -> Module:
        """The module that writes points into its moves, one cut for each."""
        return replace(self, cuts=tuple(cuts))

    def stops(self) -> tuple[Stop, ...]:
        """The stops in the order of the text, see `irbcal.correction.languages.rapid.order`."""
        return self.order

    def edits(self, new_values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of numbers and configuration data, and points put into moves."""
        plain = edits(self, new_values, configurations)
        if not self.cuts:
            return plain
        inserted, replaced = insertions(self.text, self.moves(), self.cuts, self.targets, self.work_objects)
        return [*(edit for edit in plain if not any(a <= edit[0] < b for a, b in replaced)), *inserted]

    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """Quadrants of the axes; ``cfx`` stays."""
        pairs = zip(q, (target.configuration for target in targets), strict=True)
        return [configuration_of(row, old.cfx) if isinstance(old, ConfData) else None for row, old in pairs]

    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """The module with fake targets, their configuration data and the line that says what they are corrected for."""
        values, configurations = self.new_text(found)
        if not values:
            return {self.source: self.data}
        new = with_targets(self, values, configurations)
        return {self.source: new if fingerprint is None else mark(new, fingerprint, self.source)}


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a RAPID module."""
    return re.search(rb"^\s*(?:%%%[\s\S]{0,200}?)?MODULE\s+\w+", data, re.IGNORECASE | re.MULTILINE) is not None


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[Module]:
    """Read RAPID modules for an arm; see `irbcal.correction.languages.Language`.

    Tools and work objects that one of them defines in numbers serve all others.
    """
    if not arm.six_revolute:
        raise ProgramError(f"RAPID targets are of six revolute joints, {arm.name} has others", file=files[0])
    contents = [(read_bytes(path), str(path)) for path in files]
    shared = shared_frames(contents) if len(files) > 1 else {}
    parsed = []
    for data, source in contents:
        others = [frames for name, frames in shared.items() if name != source]
        tools = {name: T for found in others for name, T in found["tooldata"].items()}
        work_objects = {name: T for found in others for name, T in found["wobjdata"].items()}
        own = shared.get(source, {"tooldata": {}, "wobjdata": {}})
        tools = {name: T for name, T in tools.items() if name not in own["tooldata"]} | {**given.tools}
        work_objects = {name: T for name, T in work_objects.items() if name not in own["wobjdata"]}
        parsed.append(_Parsed(data, source, tools, work_objects | {**given.work_objects}))
    everywhere = {
        "tooldata": given_frames("tool0", given.tools),
        "wobjdata": given_frames("wobj0", given.work_objects),
    }
    for one in parsed:
        seen = [other.literals for other in parsed if other is not one]
        one.gather(Abroad(one.literals, seen, shared, everywhere))
    return [one.module() for one in parsed]


def read(
    path: str | Path,
    tools: Mapping[str, FloatArray] | None = None,
    work_objects: Mapping[str, FloatArray] | None = None,
) -> Module:
    """Read a RAPID module from a file; see `parse`."""
    return parse(read_bytes(path), str(path), tools, work_objects)


def parse(
    data: bytes,
    source: str = "program",
    tools: Mapping[str, FloatArray] | None = None,
    work_objects: Mapping[str, FloatArray] | None = None,
) -> Module:
    """Read a RAPID module.

    Parameters
    ----------
    data : bytes
        UTF-8 (with or without byte order mark) or Latin-1.
    source : str
        File name for messages.
    tools, work_objects : dict of str to ndarray, shape (4, 4), optional
        ``T_tip_tcp`` and ``T_base_wobj`` in metres of names that the module does not define; they go before what
        the module says. ``tool0`` and ``wobj0`` need not be given.

    Returns
    -------
    Module

    Raises
    ------
    ProgramError
        If this is not a whole RAPID module, or a needed tool or work object is not known or not supported.
    """
    parsed = _Parsed(data, source, tools or {}, work_objects or {})
    parsed.gather(Abroad(parsed.literals))
    return parsed.module()


class _Parsed:
    """A module on its way: its targets first, their uses when those of all modules are known."""

    def __init__(
        self, data: bytes, source: str, tools: Mapping[str, FloatArray], work_objects: Mapping[str, FloatArray]
    ) -> None:
        self.text, self.encoding = decode(data, source)
        self.reader = Reader(self.text, source)
        self.reader.read()
        self.given = {"tooldata": given_frames("tool0", tools), "wobjdata": given_frames("wobj0", work_objects)}
        self.literals = Literals(self.reader)
        self.literals.collect()
        self.uses = Uses(self.literals, self.given)

    def gather(self, abroad: Abroad) -> None:
        """Gather the uses that this module makes of its targets and of others'."""
        self.uses = Uses(self.literals, self.given, abroad)
        self.uses.gather()

    def module(self) -> Module:
        """The module, once the uses of all are gathered."""
        reader, literals = self.reader, self.literals
        self.uses.conclude()
        numbers = {id(literal): k for k, literal in enumerate(_in_file_order(literals.found))}
        found = needed_frames(reader, literals.found, self.given)
        targets = _targets(reader, literals.found)
        places = breaks(reader)
        reader.tokens.clear()  # nothing below asks for them, and the module keeps the reader
        return Module(
            source=reader.source,
            text=self.text,
            encoding=self.encoding,
            targets=targets,
            tools=found["tooldata"],
            work_objects=found["wobjdata"],
            uncorrected=tuple(sorted(literals.uncorrected, key=lambda entry: (entry.line, entry.column))),
            notes=_notes(reader, literals.found),
            fingerprint=in_comments(reader.comments),
            order=stops(reader, self.uses.goals, numbers, places),
            moves=cache(lambda: paths(reader, self.uses.goals, numbers, targets, found["tooldata"], places)),
        )


def _in_file_order(found: list[Literal]) -> list[Literal]:
    return sorted(found, key=lambda literal: literal.start)


def _targets(reader: Reader, found: list[Literal]) -> tuple[Target, ...]:
    """The targets in the order of the file."""
    literals = _in_file_order(found)
    poses = [k for k, literal in enumerate(literals) if literal.kind == "pose" and not literal.problem]
    values = [np.full((4, 4) if literal.kind == "pose" else 6, np.nan) for literal in literals]
    for k, T in zip(poses, poses_from_numbers([literals[k].values for k in poses]), strict=True):
        values[k] = T
    out = []
    for literal, value in zip(literals, values, strict=True):
        if literal.kind == "joint" and not literal.problem:
            value = np.array([number if abs(number) < ABSENT else np.nan for number in literal.values]) * DEG
        value.setflags(write=False)
        leaves = literal.configuration
        out.append(
            Target(
                name=literal.name,
                kind=literal.kind,
                value=value,
                configuration=ConfData(*(int(leaf.number or 0) for leaf in leaves)) if leaves else None,
                external=reader.text[literal.external.start : literal.external.end],
                line=reader.line(literal.start),
                column=reader.column(literal.start),
                uses=tuple(literal.uses),
                conflicts=tuple(literal.reasons),
                written=literal.values,
                spans=tuple((leaf.start, leaf.end) for leaf in literal.numbers),
                configuration_spans=tuple((leaf.start, leaf.end) for leaf in leaves),
            )
        )
    return tuple(out)


def _notes(reader: Reader, found: list[Literal]) -> tuple[Note, ...]:
    """What the corrections do not know about."""
    seen: dict[str, Note] = {}
    for mention in reader.mentions:
        if mention.name in _NOTES:
            seen.setdefault(mention.name, Note(reader.line(mention.start), _NOTES[mention.name]))
    for literal in found:
        axes = literal.external.items or ()
        if literal.uses and any(leaf.number is not None and abs(leaf.number) < ABSENT for leaf in axes):
            text = f"{literal.name} has external axes: where they carry the robot or the work, its place is another"
            seen.setdefault("external", Note(reader.line(literal.start), text))
    return tuple(sorted(seen.values(), key=lambda note: note.line))
