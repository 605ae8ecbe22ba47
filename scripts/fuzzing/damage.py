"""Damage: what may have happened to a file, by its kind."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from random import Random
from typing import Any

NUMBERS = (
    "1e308", "-1e308", "1e300", "nan", "inf", "-inf", "NaN", "-0", "0", "1e-320", "99999999999999999999999999",
    "1e999", "-1", "1e18", "1,5", "0x10", "1_000", "٣", "", "-", "1e", "9E9", "2147483648", "1e-300", "1e6", "1e12",
)  # fmt: skip
TEXTS = (
    "\x85", "\u2028", "\ufeff", "\x00", "\x0b", "\x0c", "\x1c", "\x1b[31m", "\u202e", "=1+1", "'", '"', "--", "<script>",
    "é", "𝒳", "a\nb", "\r", "A" * 300, "../../x", "%s%n", "[link=x]y", "\t", "!", ";", ",", "nan", "x" * 140_000,
)  # fmt: skip
BYTES = (b"\xff", b"\xed\xa0\x80", b"\x00", b"\xef\xbb\xbf", b"\xc2\x85", b"\xfe\xff", b"\x0b", b"\x1a", b"\r", b"\n\n")
NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def damaged(data: bytes, kind: str, random: Random, words: list[bytes]) -> bytes:
    """A damaged copy.

    Parameters
    ----------
    data : bytes
    kind : str
        ``csv``, ``json``, ``xml``, ``yaml`` or ``text``.
    random : Random
    words : list of bytes
        Pieces of its language, to put anywhere.
    """
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        structured = BY_KIND.get(kind, [])
        choice = random.choice(structured) if structured and random.random() < 0.7 else None
        if choice is not None:
            try:
                data = choice(data, random)
                continue
            except (ValueError, IndexError, csv.Error, RecursionError):
                pass
        if words and random.random() < 0.5:
            at = random.randrange(len(data) + 1)
            data = data[:at] + random.choice(words) + data[at:]
        else:
            data = random.choice(ANY)(data, random)
    return data


# --- any bytes ----------------------------------------------------------------------------------------------


def _flip(data: bytes, random: Random) -> bytes:
    out = bytearray(data)
    for _ in range(random.choice((1, 1, 4, 30))):
        if out:
            out[random.randrange(len(out))] ^= 1 << random.randrange(8)
    return bytes(out)


def _cut(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _piece(data: bytes, random: Random) -> bytes:
    """A piece that is doubled, lost, or put elsewhere."""
    at, end = sorted((random.randrange(len(data) + 1), random.randrange(len(data) + 1)))
    end = min(end, at + random.choice((3, 30, 300)))
    piece, kind = data[at:end], random.randrange(3)
    if kind == 0:
        return data[:at] + data[end:]
    rest = data if kind == 1 else data[:at] + data[end:]
    to = random.randrange(len(rest) + 1)
    return rest[:to] + piece + rest[to:]


def _lines(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    kind = random.randrange(4)
    k = random.randrange(len(lines))
    if kind == 0:
        del lines[k]
    elif kind == 1:
        lines.insert(k, lines[random.randrange(len(lines))])
    elif kind == 2:
        random.shuffle(lines)
    else:
        lines = lines[: k + 1]
    return b"\n".join(lines)


def _number(data: bytes, random: Random) -> bytes:
    """Numbers that no robot has, in place of one, or of all."""
    found = list(NUMBER.finditer(data))
    if not found:
        return _insert(data, random)
    value = random.choice(NUMBERS).encode()
    spot = random.choice(found)
    return data[: spot.start()] + value + data[spot.end() :]


def _insert(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data) + 1)
    piece = random.choice(BYTES) if random.random() < 0.4 else random.choice(TEXTS).encode()
    return data[:at] + piece + data[at:]


def _nest(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data) + 1)
    return (
        data[:at]
        + random.choice((b"[", b"{", b"(", b"<a>", b'{"a":', b"[[", b"-")) * random.choice((50, 5000))
        + data[at:]
    )


def _ends(data: bytes, random: Random) -> bytes:
    """Other ends of lines."""
    return data.replace(b"\n", random.choice((b"\r\n", b"\r", b"\x0b", b"\xc2\x85", b"\xe2\x80\xa8", b"\x0c")))


def _encoding(data: bytes, random: Random) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(random.choice(("utf-16", "utf-8-sig", "utf-16-le", "utf-32")), "replace")


def _empty(data: bytes, random: Random) -> bytes:
    return random.choice((b"", b"\n", b" ", b"\xef\xbb\xbf", b"\x00", b"{}", b"[]", b"null", b"<robot/>", b","))


ANY: list[Callable[[bytes, Random], bytes]] = [
    _flip, _flip, _cut, _piece, _piece, _lines, _number, _number, _number, _insert, _insert, _nest, _ends, _encoding, _empty
]  # fmt: skip


# --- tables -------------------------------------------------------------------------------------------------


def _rows(data: bytes) -> tuple[list[list[str]], str]:
    text = data.decode("utf-8")
    delimiter = ";" if text.count(";") > text.count(",") else ","
    return list(csv.reader(io.StringIO(text), delimiter=delimiter)), delimiter


def _csv(change: Callable[[list[list[str]], Random], None]) -> Callable[[bytes, Random], bytes]:
    def changed(data: bytes, random: Random) -> bytes:
        rows, delimiter = _rows(data)
        change(rows, random)
        return "\n".join(delimiter.join(row) for row in rows).encode("utf-8", "replace") + b"\n"

    return changed


def _column(rows: list[list[str]], random: Random) -> None:
    k = random.randrange(len(rows[0]))
    kind = random.randrange(4)
    other = random.randrange(len(rows[0]))
    for n, row in enumerate(rows):
        if kind == 0:
            del row[k]
        elif kind == 1:
            row.insert(k, row[other])
        elif kind == 2:
            row[k], row[other] = row[other], row[k]
        elif n:
            row[k] = row[other]


def _cell(rows: list[list[str]], random: Random) -> None:
    value = random.choice(NUMBERS if random.random() < 0.7 else TEXTS)
    row = random.choice(rows[1:] if random.random() < 0.9 else rows[:1])
    row[random.randrange(len(row))] = value


def _whole_column(rows: list[list[str]], random: Random) -> None:
    k, value = random.randrange(len(rows[0])), random.choice(NUMBERS)
    for row in rows[1:]:
        row[k] = value


def _factor(rows: list[list[str]], random: Random) -> None:
    """Other units, or one sign turned."""
    k, factor = random.randrange(len(rows[0])), random.choice((1e-3, 1e3, -1.0, 57.29578, 1e150, 0.0, 1e5))
    for row in rows[1:]:
        row[k] = repr(float(row[k]) * factor)


def _shuffled(rows: list[list[str]], random: Random) -> None:
    head = rows[:1]
    body = rows[1:]
    kind = random.randrange(3)
    if kind == 0:
        random.shuffle(body)
    elif kind == 1:
        body = body[: random.choice((0, 1, 2, 3))]
    else:
        body = body + body[: random.randrange(len(body) + 1)]
    rows[:] = head + body


def _header(rows: list[list[str]], random: Random) -> None:
    names = [
        *rows[0],
        "time_s",
        "cycle",
        "group",
        "u95_mm",
        "qw",
        "qx",
        "qy",
        "qz",
        "simulated",
        "c1_deg",
        "q7_deg",
        "run",
    ]
    rows[0][random.randrange(len(rows[0]))] = random.choice(names)


# --- JSON ---------------------------------------------------------------------------------------------------


def _json(data: bytes, random: Random) -> bytes:
    """A value somewhere in the document is another one; mostly it is sealed again."""
    from irbcal.io import integrity

    document = json.loads(data)
    places: list[tuple[Any, Any]] = []
    _places(document, places)
    for _ in range(random.choice((1, 1, 2))):
        holder, key = random.choice(places)
        holder[key] = _value(holder[key], random)
    mark = document.get("seal") if isinstance(document, dict) else None
    if isinstance(mark, dict) and isinstance(mark.get("changes"), list) and random.random() < 0.7:
        with suppress(TypeError, ValueError):  # a seal that is none any more
            document = integrity.sealed(document)
    return json.dumps(document).encode("utf-8", "replace")


def _places(value: Any, found: list[tuple[Any, Any]]) -> None:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        if isinstance(value, list) and isinstance(key, int) and key > 8:
            break
        found.append((value, key))
        _places(item, found)


def _value(value: Any, random: Random) -> Any:
    if isinstance(value, list) and random.random() < 0.8:
        return random.choice((value[:-1], value + value[-1:], [], value * 2, value[::-1], [0.0] * len(value), [None]))
    if isinstance(value, dict) and random.random() < 0.7:
        keys = list(value)
        drop = random.choice(keys) if keys else None
        return {k: v for k, v in value.items() if k != drop} if random.random() < 0.7 else {}
    if isinstance(value, float) and random.random() < 0.6:
        return random.choice((value + 100, -value, value * 2, 0.0, 1e308, 1e17, -1e17, 1e-300, 1e300, value + 5))
    return random.choice(
        (
            None,
            0,
            -1,
            10**30,
            1e308,
            float("nan"),
            float("inf"),
            "",
            "a\nb",
            "x" * 300,
            "\u2028",
            [],
            {},
            [[]],
            True,
            "1",
            1e17,
        )
    )


# --- URDF, YAML ----------------------------------------------------------------------------------------------


def _attribute(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb'="([^"]*)"', data))
    spot = random.choice(found)
    old = spot[1]
    kind = random.randrange(5)
    if kind == 0:
        new = random.choice(TEXTS).encode()
    elif kind == 1:
        new = random.choice(found)[1]
    elif kind == 2 and old.split():
        parts = old.split()
        parts[random.randrange(len(parts))] = random.choice(NUMBERS).encode()
        new = b" ".join(parts)
    elif kind == 3:
        new = b" ".join([random.choice(NUMBERS).encode() for _ in range(random.choice((1, 3, 4)))])
    else:
        new = random.choice((b"1e300 1e300 0", b"0 0 0", b"1 0", b"continuous", b"floating", b"planar", b"0 0 1e-200"))
    return data[: spot.start(1)] + new + data[spot.end(1) :]


def _element(data: bytes, random: Random) -> bytes:
    """An element is lost, doubled, or another one."""
    found = list(re.finditer(rb"<(\w+)[^>]*/>|<(joint|link)\b.*?</\2>", data, re.DOTALL))
    spot, other = random.choice(found), random.choice(found)
    new = random.choice((b"", spot[0] * 2, other[0], b"<mimic joint='x'/>", b"<!-- -- -->", b"<!DOCTYPE a>", b"&lt;"))
    return data[: spot.start()] + new + data[spot.end() :]


def _yaml(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"[\w.;,-]+", data))
    spot = random.choice(found)
    new = random.choice((
        random.choice(found)[0], b"*a", b"&a [*a]", b"!!python/object:os.system", b"[1, 2]", b"{a: b}", b"null", b"~",
        b"2020-01-01", b"1:60", b"99999999999999999999", b".inf", b"- -", b"true", random.choice(NUMBERS).encode(),
        b"((((((a)*)*)*)*)*", b"{pose}{target}{pose}",
    ))  # fmt: skip
    return data[: spot.start()] + new + data[spot.end() :]


def _stored(data: bytes, random: Random) -> bytes:
    """A value, a row, a table or a column of a store of SQLite is another one, or lost."""
    if sys.version_info < (3, 11):  # no deserialize
        return _flip(data, random)
    try:
        with closing(sqlite3.connect(":memory:")) as link:
            link.deserialize(data)
            found = link.execute("select name from sqlite_master where type = 'table' order by name").fetchall()
            table = random.choice(found)[0]
            column = random.choice([row[1] for row in link.execute(f"pragma table_info({table})")])
            rows = link.execute(f"select count(*) from {table}").fetchone()[0]
            row = f"where rowid = (select rowid from {table} limit 1 offset {random.randrange(max(rows, 1))})"
            new: object = random.choice((None, -1, 1e999, b"\x00", random.choice(TEXTS), random.choice(NUMBERS)))
            kind = random.randrange(8)
            if kind == 0:
                link.execute(f"drop table {table}")
            elif kind == 1:
                link.execute(f"delete from {table} {row}")
            elif kind == 2:
                link.execute(f"alter table {table} rename column {column} to other")
            else:
                link.execute(f"update {table} set {column} = ? {row}", (new,))
            link.commit()
            return link.serialize()
    except (sqlite3.Error, IndexError, MemoryError):  # keys are checked, or it is no store any more
        return _flip(data, random)


BY_KIND: dict[str, list[Callable[[bytes, Random], bytes]]] = {
    "csv": [*map(_csv, (_column, _cell, _cell, _cell, _whole_column, _factor, _shuffled, _header))],
    "json": [_json],
    "xml": [_attribute, _attribute, _element],
    "yaml": [_yaml],
    "store": [_stored],
    "text": [_number, _lines, _piece],
}
