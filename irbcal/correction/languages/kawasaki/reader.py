"""Kawasaki AS: programs with their locations, ``.JOINTS`` (``#name``) and ``.TRANS``.

A transformation names no posture: the arm keeps its own, so the solution is the one next to the stop before. Tools,
frames and plain numbers stand in ``.TRANS``, too: only what moves alone use is a target. How the controller's base and
flange are turned against the URDF is told by one pair of joints and pose.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from irbcal.arrays import FloatArray
from irbcal.correction.course import Course, State
from irbcal.correction.languages.kawasaki.sections import Line, Sections, keyed, read, split
from irbcal.correction.languages.kawasaki.writing import KAWASAKI, NO_WHERE, AsProgram, ends
from irbcal.correction.listing import Listing, mark_in
from irbcal.correction.maker_program import Found, frame, parts_of
from irbcal.correction.program import Given, Note, read_bytes
from irbcal.correction.text_program import Role
from irbcal.correction.tokens import Tokens, numbers
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

MOVES = ("jmove", "lmove", "hmove", "xmove", "c1move", "c2move")
BLOCKS = ("joint", "linear", "linear2", "cir1", "cir2")
"""Steps of teach programs, which end with their joints."""
RELATIVE = ("jappro", "lappro", "jdepart", "ldepart", "draw", "tdraw", "drive", "align", "home", "home2")
POSTURES = ("lefty", "righty", "above", "below", "uwrist", "dwrist")
NULL = "null"
LISTS = ("()", "[]")
_BEGIN = re.compile(
    rb"(?:\A(?:\xef\xbb\xbf)?|[\r\n])\.(?:PROGRAM[ \t]|(?:TRANS|JOINTS)[ \t]*(?:[\r\n]|\Z))", re.IGNORECASE
)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like one of a Kawasaki controller."""
    return _BEGIN.search(data) is not None


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[AsProgram]:
    """Read Kawasaki files for an arm: all are one program; see `irbcal.correction.languages.Language`."""
    KAWASAKI.check(arm, str(files[0]))
    return [parse(arm, [(str(file), read_bytes(file)) for file in files], given)]


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], given: Given) -> AsProgram:
    """Read Kawasaki AS from the names and contents of files.

    Raises
    ------
    ProgramError
        If this is none, or a tool or base that is needed is not known.
    OptionError
        If the pair of joints and pose does not fit the arm.
    """
    listing = Listing(files, "Kawasaki AS")
    for part in listing.parts:
        if not looks_like(listing.text[part.start : part.end].encode("latin-1")):
            raise ProgramError("expected a Kawasaki file with .PROGRAM, .TRANS or .JOINTS", file=part.name)
    sections = read(listing)
    reader = _Reader(listing, sections)
    for line in sections.lines:
        reader.take(line)
    reader.conclude()
    found = sorted([*sections.locations.values(), *reader.literals], key=lambda one: one.start)
    if given.where is None:
        for one in found:
            one.reasons += [NO_WHERE] if one.kind == "pose" and one.uses else []
    else:
        given = given._replace(controller=ends(arm, *given.where))
    order = reader.course.order({id(one): k for k, one in enumerate(found)})
    eye = {NULL: frames.transform()}
    tools, bases = ({**reader.frames(), **eye} for _ in range(2))
    return AsProgram(
        **parts_of(KAWASAKI.of(arm), arm, listing, found, order, given, tools, bases, listing.parts[0].name),
        uncorrected=tuple(reader.course.uncorrected),
        notes=_notes(listing, found),
        fingerprint=mark_in(sections.comments),
        mark_at=sections.begins[0] if sections.begins else len(listing.text),
    )


def _notes(listing: Listing, found: Sequence[Found]) -> tuple[Note, ...]:
    moved = next((one for one in found if one.external and one.uses), None)
    if moved is None:
        return ()
    text = f"{moved.name} has other axes: where they carry the robot or the work, its place is another"
    return (Note(listing.line(moved.start), text),)


class _Reader:
    """Follows the programs."""

    def __init__(self, listing: Listing, sections: Sections) -> None:
        self.listing, self.sections = listing, sections
        self.course = Course(listing)
        self.literals: list[Found] = []
        self._literal_frames: dict[str, FloatArray] = {}
        self._bad = {key for key, one in sections.locations.items() if one.reasons}
        self._framed: dict[str, str] = {}
        self._quiet = _quiet(sections.lines)

    def take(self, line: Line) -> None:
        """Take one line."""
        if line.program:
            self.course.restart()
            return
        tokens = self._without_label(line.tokens)
        if not tokens:
            return
        word, rest, at = tokens[0].word, tokens[1:], tokens[0].start
        if word in MOVES:
            self._move(word, rest, at)
        elif word in BLOCKS and any(token.word == "#" for token in rest):
            first = next(k for k, token in enumerate(rest) if token.word == "#")
            self._mention(rest[:first], at)
            self._go(word, rest[first:], at, "via" if word == "cir1" else "to")
        elif word in ("tool", "base"):
            self._frame(word, rest, at)
        elif word in RELATIVE:
            self.course.left(at, word.upper(), self.listing.quote(at, tokens[-1].end), "it moves by a distance")
            self.course.stop(None, at)
            self._mention(rest, at)
        else:
            self._flow(word, tokens, at)
            self._mention(tokens, at)

    def _without_label(self, tokens: Tokens) -> Tokens:
        """The statement behind a label; behind one nothing is known."""
        named = len(tokens) > 1 and tokens[1].word == ":" and tokens[0].word not in ("any", "else")
        if tokens[0].kind != "number" and not named:
            return tokens
        why = f"the label in line {self.listing.line(tokens[0].start)} is jumped to"
        self.course.forget()
        self.course.state = State(None, None, why)
        return tokens[2 if named else 1 :]

    def _flow(self, word: str, tokens: Tokens, at: int) -> None:
        words = [token.word for token in tokens if token.kind == "name"]
        if word in ("if", "while", "for", "do", "case", "scase"):
            if word != "if" or words[-1] == "then":
                self.course.open(word in ("while", "for", "do"))
        elif word in ("else", "elseif", "value", "svalue", "any"):
            self.course.alternative()
        elif word in ("end", "until"):
            self.course.close(at)
        elif word in POSTURES or word in ("return", "goto", "here", "point"):
            self.course.forget()
        if "call" in words or word in ("gosub", "on", "oni", "pcexecute"):
            callee = words[words.index("call") + 1 :][:1] if "call" in words else []
            self.course.forget()
            if not callee or callee[0] not in self._quiet:
                why = f"what is called in line {self.listing.line(at)} may set the tool or base"
                self.course.state = State(None, None, why)
        elif "goto" in words:
            self.course.forget()

    def _move(self, word: str, rest: Tokens, at: int) -> None:
        till = next((k for k, token in enumerate(rest) if token.word == "till"), len(rest))
        points = split(rest[:till])
        for other in [*points[1:], rest[till:]]:
            self._mention(other, at)
        self._go(word, points[0], at, "via" if word == "c1move" else "to")
        if word == "xmove":  # a signal may stop it on the way
            self.course.forget()

    def _go(self, word: str, point: Tokens, at: int, role: Role) -> None:
        """Use the target of a move."""
        goals, reason = self._goals(point, f"of {word.upper()} in line {self.listing.line(at)}")
        if not goals:
            text = self.listing.quote(point[0].start, point[-1].end) if point else ""
            self.course.left(at, word.upper(), text, reason)
            self._mention(point, at)
        for one in goals:
            self.course.use(one, at, word.upper(), role)
        if role == "to":
            self.course.stop(goals[0] if len(goals) == 1 else None, at)

    def _goals(self, tokens: Tokens, name: str) -> tuple[list[Found], str]:
        """The locations that an argument names, all of an array where its index is computed."""
        named = self._named(tokens)
        if named is not None:
            keys = named
            return [self.sections.locations[key] for key in keys], "" if keys else "it is not in these files"
        head = tokens[0].word if tokens else ""
        joint = head in ("#ppoint", "#")
        values = numbers(tokens[1:], LISTS) if joint or head == "trans" else None
        if values is None or len(values) < 6 or (len(values) > 6 and not joint):
            return [], "its target is computed"
        found = Found(name, "joint" if joint else "pose", tokens[0].start, values[:6])
        found.external = "JT7" if len(values) > 6 else ""
        self.literals.append(found)
        return [found], ""

    def _named(self, tokens: Tokens) -> list[str] | None:
        """Keys of the locations that a name with or without index stands for; None where it is something else."""
        if not tokens or tokens[0].kind != "name" or tokens[0].word in ("trans", "#ppoint", NULL):
            return None
        inside = tokens[2:-1]
        indexed = len(tokens) > 3 and tokens[1].word == "[" and tokens[-1].word == "]"
        if len(tokens) > 1 and (not indexed or any(token.word in ("[", "]") for token in inside)):
            return None
        name = tokens[0].word
        if len(tokens) > 1 and not all(token.kind == "number" or token.word == "," for token in inside):
            return self.sections.names.get(name, [])
        key = keyed(name, "".join(token.word for token in inside) if len(tokens) > 1 else None)
        return self.sections.numbered.get(key, [])

    def _frame(self, word: str, rest: Tokens, at: int) -> None:
        """``TOOL`` and ``BASE``."""
        set_to = self.course.tool if word == "tool" else self.course.frame
        line = self.listing.line(at)
        values = numbers(rest[1:], LISTS) if rest and rest[0].word == "trans" else None
        if values is not None and len(values) == 6:
            name = f"of line {line}"
            self._literal_frames[name] = frame(KAWASAKI, [value.value for value in values])
            set_to(name)
        elif len(rest) == 1 and rest[0].word == NULL:
            set_to(NULL)
        else:
            index = rest[2:-1]
            plain = self._named(rest) is not None and all(t.kind == "number" or t.word == "," for t in index)
            inside = "".join(token.word for token in index) if len(rest) > 1 else None
            key = keyed(rest[0].word, inside) if plain else None
            set_to(key, f"{word.upper()} in line {line} is computed")
            if key is None:
                self._mention(rest, at)
            else:
                self._framed[key] = f"line {line} uses it in another way"

    def _mention(self, tokens: Tokens, at: int) -> None:
        """Names that something else than a move uses."""
        for token in tokens:
            for key in self.sections.names.get(token.word, ()) if token.kind == "name" else ():
                used = f"line {self.listing.line(at)} uses it in another way"
                self.sections.locations[key].reasons.append(used)
                self._bad.add(key)

    def frames(self) -> dict[str, FloatArray]:
        """Transformations that may serve as tool or base: those that nothing changes."""
        own = {
            key: frame(KAWASAKI, [number.value for number in one.numbers])
            for key, one in self.sections.locations.items()
            if one.kind == "pose" and key not in self._bad
        }
        return {**own, **self._literal_frames}

    def conclude(self) -> None:
        """Tell the targets that are a tool or base as well."""
        for key, why in self._framed.items():
            one = self.sections.locations.get(key)
            if one is not None and one.uses:
                one.reasons.append(why)


def _quiet(lines: Sequence[Line]) -> set[str]:
    """Programs that set no tool or base and call none."""
    words: dict[str, set[str]] = {}
    name = ""
    for line in lines:
        name = line.program or name
        words.setdefault(name, set()).update(token.word for token in line.tokens if token.kind == "name")
    loud = {"tool", "base", "call", "gosub", "on", "oni"}
    return {name for name, inside in words.items() if not inside & loud}


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a Kawasaki file; empty where it names none, None without mark.

    Raises
    ------
    ProgramError
        If this is no text.
    """
    return mark_in(read(Listing([(source, data)], "Kawasaki AS")).comments)
