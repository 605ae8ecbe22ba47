"""A line for ``irbcal import`` that would read a refused table, from the names of its columns.

Nothing is read by it: names are compared with those that others use, units are taken from the header where they stand
there, else from the size of the numbers, and are to be checked by whoever runs the line.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import NamedTuple

import numpy as np
import pandas as pd

JOINT = re.compile(r"(?:q|j|a|jt|ax|axis|joint|theta|pos_j|joint_a|actual_q|target_q|achse)[ _.\-]?(\d{1,2})")
"""Names of joints, in lower case and without units."""

MAKERS = (
    ("s", "l", "u", "r", "b", "t"),
    ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
)
"""Joints that have names in place of numbers."""

UNITS = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radians": "rad", "radian": "rad"}
UNITS |= {"mm": "mm", "m": "m", "meter": "m", "metre": "m", "inch": "inch", "in": "inch"}
AXIS = re.compile(
    r"(?P<before>.*?)[ _.\-]?(?<![a-z])(?P<axis>[xyz])(?:pos|coord|_?meas(?:ured)?)?(?:[ _.\-]?(?P<after>\w*))?"
)
POSE = ("pose", "nr", "no", "id", "#", "index", "pose_id", "poseid", "pose_nr", "config", "configuration", "pose no")
TARGET = (
    "target",
    "point",
    "point_name",
    "name",
    "reflector",
    "smr",
    "marker",
    "ball",
    "punkt",
    "target_name",
    "label",
)
QUATERNIONS = (("qw", "qx", "qy", "qz"), ("q0", "q1", "q2", "q3"), ("quat_w", "quat_x", "quat_y", "quat_z"))
PLAIN = ("", "pos", "position", "meas", "measured", "measurement", "tcp", "p", "t", "point", "coord", "actual")
"""What may stand before or behind x, y, z where there is one target in a row."""

FEW_RADIANS, FEW_METRES = 6.4, 20.0
"""Numbers below look like radians and metres."""


class _Name(NamedTuple):
    """A column: as it stands, bare in lower case, and its unit."""

    text: str
    bare: str
    unit: str | None


def proposed(data: bytes, source: str, header: Sequence[str] | None = None) -> str | None:
    """The line that would import a table, as text to run; None where its columns cannot be guessed.

    Parameters
    ----------
    data : bytes
        The file.
    source : str
        Its name.
    header : sequence of str, optional
        Its columns, where they are known.
    """
    text = data[:100_000].decode("utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines() if line.strip()][:50]
    if len(lines) < 2:
        return None
    mark = next((m for m in "\t;|," if m in lines[0]), None)
    names = [name.strip().strip('"') for name in (lines[0].split(mark) if mark else lines[0].split())]
    found = [_parsed(name) for name in (header or names)]
    joints = _joints(found)
    position = _position(found, {name.text for name in joints or ()})
    if not joints or position is None:
        return None
    try:
        rows = StringIO("\n".join(lines))
        cells = pd.read_csv(rows, sep=mark or r"\s+", dtype=str, engine="python", on_bad_lines="skip")
    except (pd.errors.ParserError, pd.errors.EmptyDataError):
        return None
    cells.columns = cells.columns.str.strip()
    options = [f"columns.joints=[{', '.join(map(_quoted, (name.text for name in joints)))}]", _option_of(position)]
    used = {name.text for name in joints} | {name.text for three in position.values() for name in three}
    for key, names_known in (("pose", POSE), ("target", TARGET)):
        of_one = key == "pose" or None in position
        match = next((name for name in found if name.bare in names_known and name.text not in used), None)
        if match is not None and of_one:
            options.append(f"columns.{key}={_quoted(match.text)}")
            used.add(match.text)
        elif key == "target" and of_one:
            options.append("fixed.target=smr1")
    for four in QUATERNIONS:
        quaternion = [
            next((name for name in found if name.bare == piece and name.text not in used), None) for piece in four
        ]
        if None in position and all(quaternion):
            columns = ", ".join(_quoted(name.text) for name in quaternion if name is not None)
            options += [f"columns.orientation=[{columns}]", "orientation.kind=quaternion", "orientation.scalar=first"]
            break
    first = next(iter(position.values()))
    options.append(f"units.joints={_unit(joints, cells, ('deg', 'rad'), FEW_RADIANS)}")
    options.append(f"units.lengths={_unit(first, cells, ('mm', 'm', 'inch'), FEW_METRES)}")
    options_text = [f"--set {shlex.quote(option)}" for option in options]
    return f"irbcal import {shlex.quote(source)} --as table {' '.join(options_text)} --out measured.csv"


def _parsed(name: str) -> _Name:
    """A header's name without its unit, in brackets or behind an underscore."""
    text = name.strip().casefold()
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]", text)
    if bracket:
        return _Name(name, bracket[1], UNITS.get(bracket[2]))
    start, mark, end = text.rpartition("_")
    if mark and end in UNITS and end != "in":
        return _Name(name, start, UNITS[end])
    return _Name(name, text, None)


def _joints(names: Sequence[_Name]) -> list[_Name] | None:
    """Columns of the joints from the first to the last; None where there are none."""
    by_prefix: dict[str, dict[int, _Name]] = {}
    for name in names:
        match = JOINT.fullmatch(name.bare)
        if match and name.unit not in ("mm", "m", "inch"):
            by_prefix.setdefault(name.bare[: match.start(1)], {}).setdefault(int(match[1]), name)
    for by_number in sorted(by_prefix.values(), key=len, reverse=True):
        first = 0 if 0 in by_number and len(by_number) not in by_number else 1
        count = 0
        while first + count in by_number:
            count += 1
        if count >= 4:
            return [by_number[first + k] for k in range(count)]
    bare = {name.bare: name for name in names}
    return next(([bare[name] for name in maker] for maker in MAKERS if set(maker) <= set(bare)), None)


def _position(names: Sequence[_Name], used: set[str]) -> dict[str | None, list[_Name]] | None:
    """Columns of the positions by target, None for one target in a row; None where there are none."""
    by_label: dict[str, dict[str, _Name]] = {}
    for name in names:
        match = AXIS.fullmatch(name.bare)
        if match and name.text not in used:
            label = "_".join(
                complete for complete in (match["before"].strip(" _.-"), (match["after"] or "").strip()) if complete
            )
            by_label.setdefault(label, {}).setdefault(match["axis"], name)
    whole = {label: [axes[k] for k in "xyz"] for label, axes in by_label.items() if len(axes) == 3}
    plain = next((label for label in PLAIN if label in whole), None)
    if plain is not None:
        return {None: whole[plain]}
    numbered: dict[str | None, list[_Name]] = {}
    numbered |= {f"smr{label}" if label.isdigit() else label: three for label, three in whole.items()}
    return numbered or None


def _option_of(position: Mapping[str | None, Sequence[_Name]]) -> str:
    triples = {label: f"[{', '.join(_quoted(name.text) for name in three)}]" for label, three in position.items()}
    if None in triples:
        return f"columns.position={triples[None]}"
    return f"columns.position={{{', '.join(f'{label}: {three}' for label, three in triples.items())}}}"


def _quoted(name: str) -> str:
    """A name as YAML takes it in a list: in quotes where it could be read otherwise."""
    plain = re.fullmatch(r"[A-Za-z_][\w ]*", name) and name.lower() not in ("y", "n", "yes", "no", "on", "off", "true")
    return name if plain else json.dumps(name, ensure_ascii=False)


def _unit(names: Sequence[_Name], cells: pd.DataFrame, units: Sequence[str], small: float) -> str:
    """The unit that the header says, else that which the size of the numbers suggests: the first, or the second."""
    said = [name.unit for name in names if name.unit in units]
    if said:
        return str(said[0])
    columns = [name.text for name in names if name.text in cells.columns]
    text = cells[columns].stack().str.strip().str.replace(",", ".", regex=False)
    values = np.abs(pd.to_numeric(text, errors="coerce").to_numpy(dtype=float))
    values = values[np.isfinite(values)]
    return units[1] if len(values) and values.max() < small else units[0]
