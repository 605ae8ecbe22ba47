"""Names of the columns of tables that are read and written: what each holds, which belong together."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.modeling.terms import inputs
from irbcal.modeling.terms.payload import CENTRE, MASS
from irbcal.modeling.terms.term import Input
from irbcal.units import DEG, MM, ColumnKind
from irbcal.wording import first_of

JOINTS = [f"q{i}_deg" for i in range(1, 7)]
"""Joint columns of arms with six revolute joints."""
ALL_JOINTS = "q1 …"
"""Stands for the joint columns of any arm among required columns: from joint 1 to the last one in the header."""
POSITION = ["x_mm", "y_mm", "z_mm"]
QUATERNION = ["qw", "qx", "qy", "qz"]
POSE = [*POSITION, *QUATERNION]
PAYLOAD, PAYLOAD_CENTRE = MASS.name, [*CENTRE.columns]
"""Centre of the payload in the tip link."""
LARGEST_ANGLE_DEG, LARGEST_POSITION_MM, LARGEST_NUMBER = 1e4, 1e6, 1e12
"""Numbers beyond are no joints and lengths of a robot cell; squares of the last can be computed with."""


def _within(expected: str, most: float, unit: float = 1.0) -> ColumnKind:
    return ColumnKind(expected, -most, most, unit)


DECLARED: Mapping[str, ColumnKind] = {
    r"q[1-9]\d?_deg": _within("a joint angle in degrees", LARGEST_ANGLE_DEG, DEG),
    r"c[1-9]\d?_deg": _within("a programmed joint angle in degrees", LARGEST_ANGLE_DEG, DEG),
    r"[qc][1-9]\d?_rad": _within("a joint angle in radians", LARGEST_ANGLE_DEG * DEG),
    r"q[1-9]\d?_mm": _within("a joint's travel in mm", LARGEST_POSITION_MM, MM),
    r"c[1-9]\d?_mm": _within("a joint's programmed travel in mm", LARGEST_POSITION_MM, MM),
    r"[xyz]_mm": _within("a position within 1 km in mm", LARGEST_POSITION_MM, MM),
    "u95_mm": ColumnKind("an uncertainty above zero in mm", 1e-6, LARGEST_POSITION_MM, MM),
    ".*_mm": _within(f"a number within ±{LARGEST_POSITION_MM:g}", LARGEST_POSITION_MM, MM),
    ".*_m": _within(f"a number within ±{LARGEST_POSITION_MM:g}", LARGEST_POSITION_MM),
    ".*_deg": _within(f"a number within ±{LARGEST_ANGLE_DEG:g}", LARGEST_ANGLE_DEG, DEG),
    ".*": _within(f"a number within ±{LARGEST_NUMBER:g}", LARGEST_NUMBER),
}
"""Names of columns, as patterns, and what they hold; the first that fits counts."""


def input_of(name: str) -> Input | None:
    """The input of the error model's terms that a column tells; None where it tells none."""
    return next((quantity for quantity in inputs().values() if quantity.pattern.fullmatch(name)), None)


@cache
def declared(name: str) -> ColumnKind:
    """What a column holds, by its name."""
    quantity = input_of(name)
    return (
        quantity.kind if quantity else next(kind for pattern, kind in DECLARED.items() if re.fullmatch(pattern, name))
    )


NAMES = ("pose", "target", "group", "session", "cycle")
"""Columns that are names even where they look like numbers."""
FRAME = "<DataFrame>"
"""What messages call a table that is no file."""
_JOINT = re.compile(r"q([1-9]\d?)_(?:deg|mm)")
_RADIANS = re.compile(r"((?:other_)?[qc][1-9]\d?)_rad")
_PROGRAMMED = re.compile(r"c([1-9]\d?)_(?:deg|mm)")
_LONGEST_NAME, _MOST_NAMES = 40, 40


def spherical(names: Sequence[str]) -> str:
    """What to say of columns of spherical coordinates, whose sense of turning no header tells; empty without."""
    angles = [name for name in names if re.search(r"azimuth|zenith|elevation", name, re.IGNORECASE)]
    if not angles:
        return ""
    words = "are of spherical coordinates: export Cartesian ones, for a header does not say which way angles turn"
    return f"; {' and '.join(angles)} {words}"


def check_header(
    names: Sequence[str], required: Sequence[str], source: str, allowed: Sequence[str] | None = None
) -> None:
    """Refuse a header that lacks a required column, has one that is not known or names one twice.

    Parameters
    ----------
    names : sequence of str
        The columns that are there.
    required : sequence of str
        As for `InputTable.read`.
    source : str
        File name for messages.
    allowed : sequence of str, optional
        As for `InputTable.read`.

    Raises
    ------
    MeasurementError
        The sentence lists the columns that are there and says whether they seem to have other units.
    """
    row = header_row(source)
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise MeasurementError(f"column {double[0]!r} stands there more than once", file=source, row=row)
    if ALL_JOINTS in required:
        numbered = sorted(int(match[1]) for name in names if (match := _JOINT.fullmatch(name)))
        twice = [k for k in set(numbered) if numbered.count(k) > 1]
        if twice:
            raise MeasurementError(f"joint {twice[0]} stands there in degrees and in mm", file=source, row=row)
        last = numbered[-1] if numbered else 1
        joints = [f"q{k}_deg" for k in range(1, last + 1) if f"q{k}_mm" not in names]
        position = required.index(ALL_JOINTS)
        required = [*required[:position], *joints, *required[position + 1 :]]
    missing = [name for name in required if name not in names]
    if missing:
        hint = ""
        if any(name.removesuffix("_mm") + "_m" in names for name in missing):
            hint = "; positions are expected in millimetres (x_mm, y_mm, z_mm), found metres"
        hint += spherical(names) if "x_mm" in missing else ""
        found_as = {name.lower(): name for name in names}
        if any(name in found_as for name in missing):
            hint += f"; names of columns are in small letters: {', '.join(n for n in missing if n in found_as)}"
        raise MeasurementError(
            f"missing column {', '.join(missing)}; found {listed(names)}{hint}", file=source, row=row
        )
    strange = [name for name in names if allowed is not None and name not in allowed]
    if strange and allowed is not None:
        raise MeasurementError(
            f"there is a column {strange[0]}: expected only {', '.join(allowed)}", file=source, row=row
        )


def in_degrees(name: str) -> str:
    """The column of degrees for one of a joint in radians; any other name as it is."""
    joint = _RADIANS.fullmatch(name)
    return name if joint is None else f"{joint[1]}_deg"


def header_row(source: str) -> int | None:
    """Row of the header for messages: 1 in a file, none in a DataFrame."""
    return None if source == FRAME else 1


def listed(names: Sequence[str]) -> str:
    """Column names for messages: the first ones, long ones cut."""
    return first_of([n if len(n) < _LONGEST_NAME else f"{n[:_LONGEST_NAME]}…" for n in names], _MOST_NAMES)


def is_joint(name: str) -> bool:
    """Whether a column is one of joints, read or programmed."""
    return bool(_JOINT.fullmatch(name) or _PROGRAMMED.fullmatch(name))


def joint_columns(names: Iterable[str]) -> list[str]:
    """Joint columns among column names, ordered by the joints' numbers; only whole series from joint 1."""
    numbered = {int(match[1]): name for name in names if (match := _JOINT.fullmatch(name))}
    columns: list[str] = []
    while len(columns) + 1 in numbered:
        columns.append(numbered[len(columns) + 1])
    return columns


def commanded(names: Iterable[str], joints: Sequence[str], source: str) -> list[str]:
    """The columns that hold what joints were sent to: programmed joints where there are any, else the joint columns."""
    return [f"c{name[1:]}" for name in joints] if programmed_columns(names, source) else list(joints)


def all_or_none(
    names: Iterable[str], expected: Sequence[str], source: str, rule: str, pattern: re.Pattern[str] | None = None
) -> list[str]:
    """Columns that stand in a table all or not at all.

    Parameters
    ----------
    names : iterable of str
        The columns that are there.
    expected : sequence of str
    source : str
        File name for messages.
    rule : str
        Why they belong together, for messages.
    pattern : regular expression, optional
        Names of such columns where there can be others than the expected ones.

    Returns
    -------
    list of str
        The expected columns, or none.

    Raises
    ------
    MeasurementError
        If some are missing, or there are others.
    """
    present = [name for name in names if (pattern.fullmatch(name) if pattern else name in expected)]
    if not present or set(present) == set(expected):
        return list(expected) if present else []
    raise MeasurementError(
        f"{difference(expected, present)}: {rule}, found {listed(present)}", file=source, row=header_row(source)
    )


def difference(expected: Sequence[str], present: Sequence[str]) -> str:
    """The columns that are missing, else the first that is too many."""
    missing = [name for name in expected if name not in present]
    strange = [name for name in present if name not in expected]
    return f"missing column {', '.join(missing)}" if missing else f"there is a column {strange[0]}"


def _of_all_joints(names: Iterable[str], source: str, of_joint: str, noun: str, pattern: re.Pattern[str]) -> list[str]:
    names = list(names)
    expected = [re.sub(r"q(\d+)_(.*)", of_joint, name) for name in joint_columns(names)]
    joints_text = f"({expected[0]} … {expected[-1]})" if expected else "(there are no joint columns)"
    return all_or_none(names, expected, source, f"{noun} are for all joints {joints_text} or for none", pattern)


def programmed_columns(names: Iterable[str], source: str) -> list[str]:
    """Columns of programmed joints (``c1_deg`` …) among column names, in the order of the joints; `all_or_none`."""
    return _of_all_joints(names, source, r"c\1_\2", "programmed joints", _PROGRAMMED)


def input_columns(quantity: Input, names: Iterable[str], source: str) -> list[str]:
    """Columns of an input of terms among column names, where they are there: `all_or_none`."""
    names = list(names)
    if quantity.of_joints:
        return _of_all_joints(names, source, quantity.columns[0].format(r"\1"), quantity.noun, quantity.pattern)
    if not any(name in quantity.columns for name in names):
        return []
    needed = [*quantity.with_columns, *quantity.columns]
    return all_or_none(names, needed, source, f"the {quantity.noun} needs {', '.join(needed)}")[
        len(quantity.with_columns) :
    ]


def joint_units(columns: Iterable[str]) -> FloatArray:
    """What one unit of each joint column is in radians or metres, shape (columns,)."""
    return np.array([declared(name).unit for name in columns])
