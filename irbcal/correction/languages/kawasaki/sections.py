"""Sections of a Kawasaki file: programs by lines of tokens, and locations with their numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker_program import Found
from irbcal.correction.tokens import Token, Tokens

_LINE = re.compile(r"[^\r\n]+")
_SECTION = re.compile(
    r"(?:\xef\xbb\xbf)?\.(?:(PROGRAM)[ \t]+([^\s(;]+)|(TRANS|JOINTS)[ \t]*\Z|(END)\b|([A-Z]\w*))", re.I
)
_LOCATION = re.compile(r"[ \t]*(#?[A-Za-z_][\w.]*)[ \t]*(?:\[([^\[\]]*)\])?(?=[ \t])")
_VALUE = re.compile(r"[ \t,]+([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?=[ \t,]|\Z)")
_TOKEN = re.compile(
    r"""(?P<space>[ \t]+)
    |(?P<comment>;.*)
    |(?P<string>"[^"]*"?)
    |(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w))
    |(?P<name>[\#$]?\.?[A-Za-z_][\w.]*)
    |(?P<symbol>.)""",
    re.VERBOSE,
)


class Line(NamedTuple):
    """A statement of a program; the first of each has the program's name and no tokens."""

    start: int
    tokens: list[Token]
    program: str


@dataclass
class Sections:
    """What stands in the files.

    Attributes
    ----------
    lines : list of Line
    comments : list of str
    locations : dict of str to Found
        By name and index in lower case, ``#p[1,2]``.
    names : dict of str to list of str
        Locations of each name.
    numbered : dict of str to list of str
        Locations of each name and index: several where it is given again.
    begins : list of int
        Behind the first line of each program.
    """

    lines: list[Line] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    locations: dict[str, Found] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    numbered: dict[str, list[str]] = field(default_factory=dict)
    begins: list[int] = field(default_factory=list)


def read(listing: Listing) -> Sections:
    """Read all programs, ``.TRANS`` and ``.JOINTS`` of the files; other sections are passed over."""
    out = Sections()
    section = ""
    for part in listing.parts:
        section = ""
        for line in _LINE.finditer(listing.text, part.start, part.end):
            head = _SECTION.match(line[0])
            if head is not None and (head[1] or head[3]):
                section = (head[1] or head[3]).upper()
                if head[1]:
                    out.lines.append(Line(line.start(), [], head[2].lower()))
                    out.begins.append(listing.after_line(line.start()))
            elif head is not None and head[4]:
                section = ""
            elif head is not None and section != "PROGRAM":
                section = "other"
            elif section == "PROGRAM":
                tokens = _tokens(line[0], line.start(), out.comments)
                out.lines += [Line(line.start(), tokens, "")] if tokens else []
            elif section in ("TRANS", "JOINTS"):
                _location(out, line[0], line.start(), section)
    return out


def _tokens(text: str, start: int, comments: list[str]) -> list[Token]:
    tokens = []
    for found in _TOKEN.finditer(text):
        kind = str(found.lastgroup)
        if kind == "comment":
            comments.append(found[0])
        elif kind != "space":
            word = found[0].lower() if kind == "name" else found[0]
            tokens.append(Token(kind, word, start + found.start(), start + found.end()))
    return tokens


def _location(out: Sections, text: str, start: int, section: str) -> None:
    """A line of ``.TRANS`` or ``.JOINTS``."""
    head = _LOCATION.match(text)
    if head is None or head[1].startswith("#") != (section == "JOINTS"):
        return
    numbers: list[Number] = []
    at = head.end()
    while (value := _VALUE.match(text, at)) is not None:
        numbers.append(Number(float(value[1]), start + value.start(1), start + value.end(1)))
        at = value.end()
    key = plain = keyed(head[1], head[2])
    shown = text[head.start(1) : head.end()].strip()
    whole = len(numbers) >= 6 and not text[at:].strip()
    empty = [Number(0.0, start, start)] * 6
    one = Found(shown, "joint" if section == "JOINTS" else "pose", start, numbers[:6] if whole else empty)
    if not whole:
        one.reasons.append("its six numbers are not understood")
    if len(numbers) > 6:
        one.external = "JT7"
    if key in out.locations:
        for other in (one, out.locations[key]):
            other.reasons.append("there are two of this name")
        key = f"{key} (again in line {start})"
    out.locations[key] = one
    out.names.setdefault(head[1].lower(), []).append(key)
    out.numbered.setdefault(plain, []).append(key)


def keyed(name: str, index: str | None) -> str:
    """Name and index of a location as they are looked up."""
    return name.lower() if index is None else f"{name.lower()}[{''.join(index.split())}]"


def split(tokens: Tokens) -> list[Tokens]:
    """Tokens between commas that stand in no brackets."""
    out: list[Tokens] = []
    depth, begin = 0, 0
    for k, token in enumerate(tokens):
        depth += (token.word in ("(", "[")) - (token.word in (")", "]"))
        if depth == 0 and token.word == ",":
            out.append(tokens[begin:k])
            begin = k + 1
    return [*out, tokens[begin:]]
