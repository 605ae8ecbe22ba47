"""KUKA KRL programs: a routine's ``.src`` with the ``.dat`` of the same name, and ``$config.dat`` where it is given.

Targets are values in numbers of ``E6POS``, ``POS``, ``E6AXIS``, ``AXIS`` and ``FRAME``, in declarations, in assignments
and inside moves. Where a component is missing the value before stays, so that such a target has no pose of its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from irbcal.correction.languages.krl.data import TYPES, Data
from irbcal.correction.languages.krl.statements import NULLFRAME, Statements
from irbcal.correction.languages.krl.tokens import Line, lines_of
from irbcal.correction.languages.krl.writing import KUKA, KrlProgram, integer
from irbcal.correction.listing import Listing, mark_in
from irbcal.correction.maker import Maker
from irbcal.correction.maker_program import Found, parts_of
from irbcal.correction.program import Given, Note, read_bytes
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

_BEGIN = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(DEF|DEFFCT|DEFDAT)\b", re.IGNORECASE | re.MULTILINE)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like KRL."""
    return data.lstrip(b"\xef\xbb\xbf \r\n\t").upper().startswith(b"&ACCESS") or _BEGIN.search(data) is not None


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[KrlProgram]:
    """Read KRL for an arm: all files are one program; see `irbcal.correction.languages.Language`."""
    KUKA.check(arm, str(files[0]))
    files = list(files)
    for file in [file for file in files if file.suffix.lower() in (".src", ".sub")]:
        beside = [path for path in sorted(file.parent.glob("*")) if path.name.lower() == file.stem.lower() + ".dat"]
        files += [path for path in beside if path not in files]
    return [parse(arm, [(str(file), read_bytes(file)) for file in files], given)]


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], given: Given, maker: Maker = KUKA) -> KrlProgram:
    """Read KRL from the names and contents of files.

    Raises
    ------
    ProgramError
        If this is no KRL, or a tool or base that is needed is not known.
    """
    # declarations before routines, so that moves find their targets
    ordered = sorted(files, key=lambda file: (Path(file[0]).suffix.lower() != ".dat", files.index(file)))
    maker, listing = maker.of(arm), Listing(ordered, "KUKA KRL")
    for part in listing.parts:
        if not looks_like(listing.text[part.start : part.end].encode("latin-1")):
            raise ProgramError("expected a KRL program with DEF or DEFDAT", file=part.name)
    lines, comments = lines_of(listing)
    data = Data(listing, [Path(part.name).stem.lower() for part in listing.parts])
    rest = [line for line in lines if line.tokens[0].word != "&" and not data.declaration(line)]
    statements = Statements(listing, data)
    rest = _values_first(statements, data, rest)
    data.collect()
    for line in rest:
        line.at = 0
        statements.statement(line)
    statements.conclude()
    found = [one for variable in data.variables.values() for one in variable.found.values()]
    return _program(arm, maker, listing, given, statements, [*found, *statements.literals], comments)


def _values_first(statements: Statements, data: Data, lines: list[Line]) -> list[Line]:
    """Take values of data files and assignments in numbers; returns the other lines."""
    rest = []
    for line in lines:
        line.at = 0
        if _is_value(line, data):
            statements.statement(line)
        else:
            rest.append(line)
    return rest


def _is_value(line: Line, data: Data) -> bool:
    """Whether a line gives a value to a variable that is declared, to one of its components, or to a numbered frame."""
    if line.next.kind != "name" or line.word() in ("$tool", "$base", "fdat_act"):
        return False
    name = line.word()
    line.at = 1
    index = line.index()
    member = line.word() == "." and line.word(2) == "="
    given = line.take("=") and line.word() != ""
    line.at = 0
    if name in ("tool_data", "base_data"):
        return given and bool(index)
    variable = data.lookup(line.part, name)
    return (given or member) and variable is not None and variable.type in TYPES


def _program(
    arm: Arm,
    maker: Maker,
    listing: Listing,
    given: Given,
    statements: Statements,
    found: list[Found],
    comments: list[str],
) -> KrlProgram:
    found.sort(key=lambda one: one.start)
    if len(listing.parts) > 1:
        for one in found:
            one.name += f" of {Path(listing.parts[listing.part(one.start)].name).name}"
    order = statements.course.order({id(one): k for k, one in enumerate(found)})
    eye = {NULLFRAME: frames.transform()}
    main = next((p for p in listing.parts if Path(p.name).suffix.lower() != ".dat"), listing.parts[0])
    tools, bases = {**statements.tools, **eye}, {**statements.frames, **eye}
    parts = parts_of(maker, arm, listing, found, order, given, tools, bases, main.name)
    notes = [Note(listing.line(at), text) for at, text in statements.notes]
    if any(one.external and one.uses for one in found):
        moved = next(one for one in found if one.external and one.uses)
        if re.search(r"[1-9]", re.sub(r"E\d", "", moved.external)):
            text = f"{moved.name} has external axes: where they carry the robot or the work, its place is another"
            notes.append(Note(listing.line(moved.start), text))
    status = [
        integer(listing.text[slice(*t.configuration_spans[0])]) or 0 for t in parts["targets"] if t.configuration_spans
    ]
    if any(value & 16 for value in status) and given.own_model is None:
        text = (
            "points say (S, bit 4) that the robot was absolutely accurate: it must not be corrected twice; what such a "
            "controller computes with is given with --controller-model"
        )
        notes.append(Note(1, text))
    return KrlProgram(
        **parts,
        uncorrected=tuple(statements.course.uncorrected),
        notes=tuple(dict.fromkeys(notes)),
        fingerprint=mark_in(comments),
        mark_at=_behind_head(listing, main.start, main.end),
    )


def _behind_head(listing: Listing, start: int, end: int) -> int:
    """Behind the first line with ``DEF``; before everything where there is none."""
    found = _BEGIN.search(listing.text[start:end].encode("latin-1"))
    if found is None:
        return start
    at = listing.after_line(start + found.start())
    return at if at < end or listing.text[at - 1 : at] in "\r\n" else start


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a KRL file; empty where it names none, None without mark.

    Raises
    ------
    ProgramError
        If this is no text.
    """
    _, comments = lines_of(Listing([(source, data)], "KUKA KRL"))
    return mark_in(comments)
