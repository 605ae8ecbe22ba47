r"""ABB RAPID modules: which targets stand in them as numbers, and which moves use them.

Literals of ``robtarget`` and ``jointtarget`` in declarations, in assignments and inside moves are read; a move whose
target the program computes (``Offs``, ``RelTool``, arithmetic, a function) is reported and left. A target is not
corrected where its literal does more than the direct moves that use it: where it is also an argument of something
else, where its variable is also computed, where moves use it with different tools or work objects. Only this one
module is seen: other modules may use its data too.
"""

import re
from dataclasses import replace

import numpy as np

from irbcal.correction.languages.rapid.frames import ABSENT, given_frames, quaternion_problem, read_frame
from irbcal.correction.languages.rapid.syntax import Node, Reader
from irbcal.correction.languages.rapid.tokens import decode
from irbcal.correction.program import ConfData, Note, Program, Target, Uncorrected, Use, poses_from_numbers, read_bytes
from irbcal.errors import ProgramError
from irbcal.units import DEG

MARK = "! irbcal: fake targets, calibration "
"""Begin of the comment line that marks a corrected module."""

_MARK = re.compile(r"!\s*irbcal: fake targets(?:, calibration (\S+))?", re.IGNORECASE)
_TYPES = {"robtarget": "pose", "jointtarget": "joint"}
_TYPE_OF = {"pose": "robtarget", "joint": "jointtarget"}
_PARTS = {
    "pose": ((3, "[x, y, z]"), (4, "[q1, q2, q3, q4]"), (4, "[cf1, cf4, cf6, cfx]"), (6, "[six external axes]")),
    "joint": ((6, "[six joints]"), (6, "[six external axes]")),
}
_NOTES = {
    **dict.fromkeys(["pdispon", "pdispset"], "a program displacement moves targets that are corrected without it"),
    **dict.fromkeys(["getdataval", "setdataval", "setalldataval"], "data are reached by a name that is not followed"),
}
_QUOTED = 3  # mentions of a target that are quoted before the rest is counted


def read(path, tools=None, work_objects=None):
    """Read a RAPID module from a file; see `parse`."""
    return parse(read_bytes(path), str(path), tools, work_objects)


def parse(data, source="program", tools=None, work_objects=None):
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
    Program

    Raises
    ------
    ProgramError
        If this is not a whole RAPID module, or a needed tool or work object is not known or not supported.
    """
    text, encoding = decode(data, source)
    reader = Reader(text, source)
    reader.read()
    resolver = _Resolver(reader, tools or {}, work_objects or {})
    resolver.collect()
    for move in reader.moves:
        resolver.move(move)
    resolver.mentions()
    tools, work_objects = resolver.frames()
    marks = [found[1] or "" for found in map(_MARK.match, reader.comments) if found]
    order = sorted(resolver.uncorrected, key=lambda entry: (entry.line, entry.column))
    return Program(
        source=source,
        text=text,
        encoding=encoding,
        targets=resolver.targets(),
        tools=tools,
        work_objects=work_objects,
        uncorrected=tuple(order),
        notes=tuple(resolver.notes()),
        fingerprint=marks[0] if marks else None,
    )


def mark(data, fingerprint, source="program"):
    """Bytes of a module with the comment line that says what its targets are corrected for.

    The line comes behind the one with ``MODULE``; all other bytes stay.

    Parameters
    ----------
    data : bytes
    fingerprint : str
        Of the calibration: one word.
    source : str
        File name for messages.

    Returns
    -------
    bytes
    """
    if not fingerprint.isascii() or not fingerprint.isprintable() or fingerprint.split() != [fingerprint]:
        raise ValueError("expected a fingerprint of one word")
    text, encoding = decode(data, source)
    reader = Reader(text, source)
    end = reader.tokens[reader.header() - 1].end
    newline = re.search(r"\r\n|\n|\r|$", text)[0] or "\n"
    rest = re.match(r"[ \t]*(?:![^\r\n]*)?(\r\n|\n|\r)", text[end:])
    at, before = (end + rest.end(), "") if rest else (end, newline)
    return (text[:at] + before + MARK + fingerprint + newline + text[at:]).encode(encoding)


class _Literal:
    """A target in numbers while its uses are gathered."""

    def __init__(self, kind, name, start, numbers, configuration, external):
        self.kind, self.name, self.start, self.numbers = kind, name, start, numbers
        self.configuration, self.external = configuration, external
        self.uses, self.reasons, self.mentioned, self.problem = [], [], [], None


class _Resolver:
    """What the names, moves and literals of a module mean for its targets."""

    def __init__(self, reader, tools, work_objects):
        self.reader = reader
        self.given = {"tooldata": given_frames("tool0", tools), "wobjdata": given_frames("wobj0", work_objects)}
        self.literals, self.uncorrected = [], []

    # literals

    def collect(self):
        """Find all literals and everything that gives a target another value."""
        reader = self.reader
        for scope in [reader.data, *reader.scopes]:
            for data in scope.values():
                if data.type in _TYPES:
                    if data.node is not None:
                        self._fill(data, (), data.node)
                    elif data.computed is not None:
                        data.changes.append(((), data.computed))
        for scope, name, index, node, start in reader.assignments:
            data = reader.lookup(scope, name)
            if data is not None and data.type in _TYPES and node is not None:
                self._fill(data, index, node)
            elif data is not None:
                data.changes.append((index, start))
            if (data is None or data.type == "parameter") and node is not None and _looks_like_target(node):
                where = "is not declared in this module" if data is None else "is a parameter of the routine"
                self._report(start, "assignment", name, where)
        for move in reader.moves:
            for role, arg in move.points:
                data = reader.lookup(move.scope, arg.name) if role == "w" and arg.name else None
                if data is not None:
                    data.changes.append((arg.index, move.start))
        for node in reader.loose:
            if _looks_like_target(node):
                text = reader.quote(node.start, node.end)
                self._report(node.start, "other", text, "this is no move that is known")

    def _fill(self, data, index, node):
        """Take the literals of a declaration or an assignment, element by element."""
        sizes = data.sizes[len(index) :] if not index or len(index) == len(data.sizes) else ()
        kind = _TYPES[data.type]
        pending = [(index, node, sizes)]
        while pending:
            index, node, sizes = pending.pop()
            if sizes:
                if node.items is None:
                    data.changes.append((index, node.start))
                    continue
                if sizes[0] is not None and len(node.items) != sizes[0]:
                    raise self._wrong(node, data.type, data.spelling, f"{sizes[0]} elements", len(node.items))
                new = [((*index, k + 1), item, sizes[1:]) for k, item in enumerate(node.items)]
                pending.extend(reversed(new))
                continue
            inside = ",".join("?" if k is None else str(k) for k in index)
            literal = self._literal(node, kind, data.spelling + (f"{{{inside}}}" if index else ""))
            if literal is None:
                data.changes.append((index, node.start))
            else:
                data.entries.append((index, literal))

    def _wrong(self, node, type_name, name, expected, found):
        return self.reader.error(node.start, f"{type_name} {name!r}: expected {expected}, found {found}")

    def _literal(self, node, kind, name):
        """The literal that a list of values is; None if some of its numbers are computed."""
        reader, type_name = self.reader, _TYPE_OF[kind]
        if node.items is None:
            return None
        if len(node.items) != len(_PARTS[kind]):
            expected = "[" + ", ".join(text for _, text in _PARTS[kind]) + "]"
            raise self._wrong(node, type_name, name, expected, f"{len(node.items)} parts")
        for part, (size, text) in zip(node.items, _PARTS[kind], strict=True):
            if part.number is not None or (part.items is not None and len(part.items) != size):
                found = reader.quote(part.start, part.end)
                raise self._wrong(part, type_name, name, text, found)
        parts = node.items[:2] if kind == "pose" else node.items[:1]
        if any(part.items is None for part in parts):
            return None
        numbers = [leaf for part in parts for leaf in part.items]
        for leaf in numbers:
            if leaf.items is not None:
                raise self._wrong(leaf, type_name, name, "a number", reader.quote(leaf.start, leaf.end))
        if any(leaf.number is None for leaf in numbers):
            return None
        configuration = node.items[2].items if kind == "pose" else None
        if configuration is not None:
            if any(leaf.number is None for leaf in configuration):
                configuration = None
            elif any(abs(leaf.number) > ABSENT * 100 or leaf.number % 1 for leaf in configuration):
                part = node.items[2]
                found = reader.quote(part.start, part.end)
                raise self._wrong(part, type_name, name, "a configuration in whole numbers", found)
        literal = _Literal(kind, name, node.start, numbers, configuration, node.items[-1])
        literal.problem = self._problem(literal)
        self.literals.append(literal)
        return literal

    def _problem(self, literal):
        values = np.array([leaf.number for leaf in literal.numbers])
        if not np.isfinite(values).all() or (literal.kind == "pose" and np.abs(values).max() >= ABSENT):
            return "found a number that is too large"
        if literal.kind == "pose":
            return quaternion_problem(values[3:])
        absent = np.flatnonzero(np.abs(values) >= ABSENT)
        if len(absent):
            literal.reasons.append(f"joint {absent[0] + 1} has no value (9E9)")
        return None

    # uses

    def _report(self, start, instruction, target, reason):
        line, column = self.reader.line(start), self.reader.column(start)
        self.uncorrected.append(Uncorrected(line, column, instruction, target, reason))

    def move(self, move):
        """Give the literals that a move goes to this use, or report what is in the way."""
        reader = self.reader
        kind = "joint" if move.name.endswith("AbsJ") else "pose"
        line = reader.line(move.start)
        tool, no_tool = self._frame_name(move, move.tool, "tooldata", "tool")
        wobj, no_wobj = self._frame_name(move, move.work_object, "wobjdata", "work object")
        use = Use(line, reader.column(move.start), move.name, "to", tool, wobj)
        unknown = no_tool or no_wobj if kind == "pose" else ""
        for role, arg in move.points:
            if role == "w":
                continue
            found, reason = self._goals(move, arg, kind, line)
            if reason or unknown:
                self._report(move.start, move.name, arg.text, reason or unknown)
            for literal in found:
                literal.uses.append(use if role == "to" else replace(use, role=role))
                literal.reasons.extend(text for text in (reason, unknown) if text)

    def _goals(self, move, arg, kind, line):
        """Literals that an argument stands for, and why these are not all, or not to be changed."""
        reader = self.reader
        if arg.node is not None:
            literal = self._literal(arg.node, kind, f"of {move.name} in line {line}")
            return ([], f"its numbers are computed: {arg.text}") if literal is None else ([literal], "")
        if arg.name is None:
            if arg.text == "*":
                return [], "the position * stands in the controller only"
            return [], f"its target is computed: {arg.text}"
        data = reader.lookup(move.scope, arg.name)
        if data is None:
            return [], f"{arg.text} is not declared in this module"
        if data.type == "parameter":
            return [], f"{arg.text} is a parameter of the routine"
        if _TYPES.get(data.type) != kind:
            if data.type in _TYPES:
                message = f"{move.name} goes to a {_TYPE_OF[kind]}, but {data.spelling} is a {data.type}"
                raise reader.error(arg.start, message)
            return [], f"{arg.text} is declared as {data.type}"
        if len(arg.index) != len(data.sizes):
            message = f"{data.spelling} has {len(data.sizes)} indices, but {arg.text} has {len(arg.index)}"
            raise reader.error(arg.start, message)
        found = [literal for index, literal in data.entries if _may_be(index, arg.index)]
        changes = sorted(position for index, position in data.changes if _may_be(index, arg.index))
        if changes:
            return found, f"{arg.text} is computed or changed in line {reader.line(changes[0])}"
        return found, "" if found else f"{arg.text} has no value in this module"

    def _frame_name(self, move, arg, type_name, what):
        """Name of a tool or work object, or None and why there is no one name."""
        if arg is None:
            return "wobj0", ""
        if arg.name is None or arg.index:
            return None, f"the {what} of {move.name} in line {self.reader.line(move.start)} is computed: {arg.text}"
        data = self.reader.lookup(move.scope, arg.name)
        if data is None or (arg.name in self.given[type_name] and data.type != "parameter"):
            return arg.name, ""
        if data.type == "parameter" or self.reader.data.get(arg.name) is not data:
            kind = "a parameter of" if data.type == "parameter" else "declared in"
            return None, f"the {what} {arg.text} is {kind} the routine"
        if data.changes:
            return None, f"the {what} {arg.text} is changed in line {self.reader.line(data.changes[0][1])}"
        if data.type != type_name:
            raise self.reader.error(arg.start, f"expected a {type_name}, but {arg.text} is declared as {data.type}")
        return arg.name, ""

    def mentions(self):
        """Note for each literal where its variable is used in another way than as the target of a move."""
        for scope, name, index, start in self.reader.mentions:
            data = self.reader.lookup(scope, name)
            for at, literal in data.entries if data is not None else ():
                if _may_be(at, index):
                    literal.mentioned.append(start)

    # frames

    def frames(self):
        """Frames of the tools and work objects that correctable poses need; refuse what cannot be had."""
        found = {"tooldata": {}, "wobjdata": {}}
        missing = {}
        for literal in self.literals:
            self._conclude(literal)
            for use in literal.uses if literal.kind == "pose" else ():
                for type_name, name in (("tooldata", use.tool), ("wobjdata", use.work_object)):
                    if name is None or name in found[type_name]:
                        continue
                    if name in self.given[type_name]:
                        found[type_name][name] = self.given[type_name][name]
                    elif name in self.reader.data:
                        try:
                            found[type_name][name] = read_frame(self.reader, self.reader.data[name], use.line)
                        except ProgramError:
                            if not literal.reasons:
                                raise
                    elif not literal.reasons:
                        missing.setdefault((type_name, name), use)
        if missing:
            entries = sorted(missing.items(), key=lambda entry: entry[1].line)
            texts = [
                f"{'tool' if type_name == 'tooldata' else 'work object'} {name}" for (type_name, name), _ in entries
            ]
            first = entries[0][1]
            more = [f"{text} in line {use.line}" for text, (_, use) in zip(texts[1:], entries[1:], strict=True)]
            also = f" (also: {', '.join(more)})" if more else ""
            message = (
                f"{first.instruction} uses the {texts[0]}, which this module does not define: give its frame{also}"
            )
            raise ProgramError(f"{self.reader.source}: line {first.line}: {message}")
        return found["tooldata"], found["wobjdata"]

    def _conclude(self, literal):
        """Put together what speaks against changing a literal."""
        reader = self.reader
        if literal.problem and literal.uses:
            raise reader.error(literal.start, f"{_TYPE_OF[literal.kind]} {literal.name!r}: {literal.problem}")
        if literal.problem:
            literal.reasons.append(literal.problem)
        if literal.kind == "pose":
            for what in ("tool", "work_object"):
                names = {getattr(use, what): use.line for use in reversed(literal.uses)}
                if len(names) > 1:
                    seen = ", ".join(f"{name or 'a computed one'} (line {line})" for name, line in names.items())
                    literal.reasons.append(f"used with different {what.replace('_', ' ')}s: {seen}")
        lines = sorted({reader.line(start) for start in literal.mentioned})
        for line in lines[:_QUOTED]:
            literal.reasons.append(f"line {line} uses it in another way: {reader.quote_line(line)}")
        if len(lines) > _QUOTED:
            literal.reasons.append(f"so do {len(lines) - _QUOTED} more lines")
        literal.reasons = list(dict.fromkeys(literal.reasons))

    # results

    def targets(self):
        """The targets in the order of the file."""
        reader = self.reader
        literals = sorted(self.literals, key=lambda literal: literal.start)
        numbers = [tuple(leaf.number for leaf in literal.numbers) for literal in literals]
        poses = [k for k, literal in enumerate(literals) if literal.kind == "pose" and not literal.problem]
        values = [np.full((4, 4) if literal.kind == "pose" else 6, np.nan) for literal in literals]
        for k, T in zip(poses, poses_from_numbers([numbers[k] for k in poses]), strict=True):
            values[k] = T
        out = []
        for literal, written, value in zip(literals, numbers, values, strict=True):
            if literal.kind == "joint" and not literal.problem:
                value = np.where(np.abs(written) < ABSENT, written, np.nan) * DEG
            value.setflags(write=False)
            leaves = literal.configuration or ()
            conf = ConfData(*(int(leaf.number) for leaf in leaves)) if leaves else None
            out.append(
                Target(
                    name=literal.name,
                    kind=literal.kind,
                    value=value,
                    configuration=conf,
                    external=reader.text[literal.external.start : literal.external.end],
                    line=reader.line(literal.start),
                    column=reader.column(literal.start),
                    uses=tuple(literal.uses),
                    conflicts=tuple(literal.reasons),
                    written=written,
                    spans=tuple((leaf.start, leaf.end) for leaf in literal.numbers),
                    configuration_spans=tuple((leaf.start, leaf.end) for leaf in leaves),
                )
            )
        return tuple(out)

    def notes(self):
        """What the corrections do not know about."""
        seen = {}
        for mention in self.reader.mentions:
            if mention.name in _NOTES:
                seen.setdefault(mention.name, Note(self.reader.line(mention.start), _NOTES[mention.name]))
        for literal in self.literals:
            axes = literal.external.items or ()
            if literal.uses and any(leaf.number is not None and abs(leaf.number) < ABSENT for leaf in axes):
                text = f"{literal.name} has external axes: where they carry the robot or the work, its place is another"
                seen.setdefault("external", Note(self.reader.line(literal.start), text))
        return sorted(seen.values(), key=lambda note: note.line)


def _may_be(index, other):
    """Whether two indices may name the same element; None, or no index at all, stands for any."""
    return all(a is None or b is None or a == b for a, b in zip(index, other, strict=False))


def _looks_like_target(node: Node):
    sizes = [len(part.items) if part.items is not None else None for part in node.items or []]
    return sizes in ([3, 4, 4, 6], [6, 6])
