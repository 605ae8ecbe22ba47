"""Data and program texts of a VAL3 application, as they stand in its XML: places are kept, nothing is written anew."""

from __future__ import annotations

import re
from typing import NamedTuple

from irbcal.correction.languages.val3.writing import posture_of
from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker_program import Found

_PIECE = re.compile(
    r"(?P<comment><!--.*?-->)|<!\[CDATA\[(?P<code>.*?)\]\]>|<(?P<end>/?)(?P<tag>[A-Za-z]\w*)(?P<rest>[^<>]*)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([A-Za-z_][\w:.]*)\s*=\s*(?:\"([^\"<]*)\"|'([^'<]*)')")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\Z")

POSE, JOINTS = ("x", "y", "z", "rx", "ry", "rz"), ("j1", "j2", "j3", "j4", "j5", "j6")


class Value(NamedTuple):
    """An element of a datum: its attributes and where their texts stand."""

    type: str
    name: str
    key: str
    attributes: dict[str, str]
    places: dict[str, int]
    start: int

    @property
    def shown(self) -> str:
        """Name with its index."""
        return f"{self.name}[{self.key}]"


class Code(NamedTuple):
    """The text of a program."""

    start: int
    end: int


def read(listing: Listing) -> tuple[list[Value], list[Code], list[str]]:
    """Elements of all data, program texts and comments."""
    values: list[Value] = []
    codes: list[Code] = []
    comments: list[str] = []
    for part in listing.parts:
        datum: dict[str, str] = {}
        for piece in _PIECE.finditer(listing.text, part.start, part.end):
            if piece["comment"]:
                comments.append(piece["comment"])
            elif piece["code"] is not None:
                codes.append(Code(piece.start("code"), piece.end("code")))
            elif piece["tag"] == "Data":
                datum = {} if piece["end"] else _attributes(piece)[0]
            elif piece["tag"] == "Value" and datum and not piece["end"]:
                attributes, places = _attributes(piece)
                key = attributes.get("key", "0")
                kind, name = datum.get("type", ""), datum.get("name", "")
                values.append(Value(kind, name, key, attributes, places, piece.start()))
    return values, codes, comments


def _attributes(piece: re.Match[str]) -> tuple[dict[str, str], dict[str, int]]:
    texts: dict[str, str] = {}
    places: dict[str, int] = {}
    for found in _ATTRIBUTE.finditer(piece["rest"]):
        which = 2 if found[2] is not None else 3
        texts.setdefault(found[1], found[which])
        places.setdefault(found[1], piece.start("rest") + found.start(which))
    return texts, places


def numbers(value: Value, names: tuple[str, ...], absent: bool = False) -> list[Number] | None:
    """Six numbers of an element; None where one is none, or, unless ``absent`` (they are 0 then), is not there."""
    out = []
    for name in names:
        text = value.attributes.get(name, "0" if absent else "").strip()
        if not _NUMBER.match(text):
            return None
        place = value.places.get(name, value.start)
        raw = value.attributes.get(name, text)
        start = place + raw.index(text)
        out.append(Number(float(text), start, start + len(text)))
    return out


def target(value: Value) -> Found | None:
    """The target that an element is; None for other data."""
    if value.type not in ("pointRx", "jointRx"):
        return None
    joint = value.type == "jointRx"
    found = numbers(value, JOINTS if joint else POSE)
    if found is None:
        out = Found(value.shown, "joint" if joint else "pose", value.start, [Number(0.0, value.start, value.start)] * 6)
        out.reasons.append("not all of its numbers are written")
        return out
    out = Found(value.shown, "joint" if joint else "pose", value.start, found)
    if not joint:
        out.posture, reason = posture_of(value.attributes)
        out.reasons += [reason] if reason else []
    return out
