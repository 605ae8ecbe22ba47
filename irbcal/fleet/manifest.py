"""The list of a fleet's robots: a row each, with its measurements, its nominal robot and options."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from datetime import date
from pathlib import Path
from typing import Any

from irbcal.calibrating import Options
from irbcal.errors import IrbcalError, MeasurementError
from irbcal.measurement import columns
from irbcal.names import check_names
from irbcal.reading import read_bytes

NEEDED = ("id", "measurements", "robot")
KNOWN = (*NEEDED, "serial", "date", "options")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
"""What an id may be: it is a folder's name."""
RESERVED = {"fleet.html", "fleet.csv", "fleet.json"}


def _words(text: str) -> list[str]:
    return [word for word in text.split(",") if word]


def _yes(text: str) -> bool:
    if text not in ("yes", "no"):
        raise ValueError
    return text == "yes"


KINDS: dict[str, Callable[[str], Any]] = {
    **dict.fromkeys(("model", "terms", "split", "base_link", "tip_link", "coupling", "method", "objective"), str),
    **dict.fromkeys(("loss", "session_by", "parallel", "verify", "targets", "prior"), str),
    **dict.fromkeys(("power", "holdout"), float),
    **dict.fromkeys(("as_poses", "same_tool", "torques"), _yes),
    **dict.fromkeys(("free", "hold", "frame"), _words),
    "seed": int,
}
"""Options of `irbcal.calibrate` that a row may have, and how they are read."""
FILES = ("verify", "targets", "prior")
"""Those that name files."""


@dataclass(frozen=True)
class Entry:
    """A robot of the list.

    Attributes
    ----------
    id : str
        Also the name of its folder.
    serial : str
        Of the robot; the id where the list has none.
    measurements, robot : str
        Paths as a process finds them, or a robot's name.
    date : str
        When it was measured, ISO 8601; empty where the list does not say.
    options : dict
        Of `irbcal.calibrate`.
    """

    id: str
    serial: str
    measurements: str
    robot: str
    date: str
    options: Mapping[str, Any]

    @property
    def name(self) -> str:
        """As messages call it."""
        return f"robot {self.id}"

    def sha256(self) -> str:
        """Fingerprint of the row and of the content of all files that it names, wherever they are.

        Raises
        ------
        MeasurementError
            If one cannot be read.
        """
        options = {name: value for name, value in self.options.items() if name not in FILES}
        row = [self.id, self.serial, self.date, Path(self.robot).name, options]
        digest = hashlib.sha256(json.dumps(row, sort_keys=True).encode())
        named = [self.robot, *(str(self.options[name]) for name in FILES if name in self.options)]
        for path in (self.measurements, *(path for path in named if Path(path).is_file())):
            digest.update(hashlib.sha256(read_bytes(path, MeasurementError)).digest())
        return digest.hexdigest()


def read(manifest: str | Path) -> list[Entry]:
    """Read a list of robots.

    Parameters
    ----------
    manifest : str or Path
        CSV with the columns ``id``, ``measurements`` and ``robot``, and, where wanted, ``serial``, ``date``
        (2026-03-17) and ``options`` (``model=34 holdout=0.2``). Paths are counted from its folder.

    Returns
    -------
    list of Entry

    Raises
    ------
    MeasurementError
        If a row is no robot, or two have one id.
    """
    cells, source, _ = columns.read(manifest, NEEDED)
    strange = [name for name in cells.columns if name not in KNOWN]
    if strange:
        raise MeasurementError(
            f"expected the columns {', '.join(KNOWN)}, found {strange[0]!r}", file=source, column=strange[0]
        )
    out, seen = [], dict[str, int]()
    for row, values in cells.iterrows():
        given = {name: str(value).strip() for name, value in values.items()}
        entry = _entry(given, Path(source).parent, source, int(str(row)))
        folded = entry.id.casefold()  # a folder's name: some systems take A for a
        if folded in seen:
            raise MeasurementError(
                f"the id {entry.id!r} stands in row {seen[folded]}, too", file=source, row=int(str(row)), column="id"
            )
        seen[folded] = int(str(row))
        out.append(entry)
    return out


def _entry(given: Mapping[str, str], folder: Path, source: str, row: int) -> Entry:
    def wrong(column: str, sentence: str) -> MeasurementError:
        return MeasurementError(sentence, file=source, row=row, column=column)

    for column in NEEDED:
        if not given[column]:
            raise wrong(column, "expected a text, found nothing")
    name = given["id"]
    if not NAME.fullmatch(name) or name in RESERVED or len(name) > 100:
        raise wrong("id", f"expected letters, digits, '.', '_' and '-' (it names a folder), found {name!r}")
    check_names(given.values(), MeasurementError, file=source)
    day = given.get("date", "")
    if day:
        try:
            date.fromisoformat(day)
        except ValueError:
            raise wrong("date", f"expected a date such as 2026-03-17, found {day!r}") from None
    options = dict(_option(text, wrong) for text in given.get("options", "").split())
    for option in FILES:
        if option in options:
            options[option] = str(folder / options[option])
    try:
        Options(**options)
    except IrbcalError as error:
        raise wrong("options", str(error)) from None
    robot = given["robot"]
    beside = folder / robot
    return Entry(
        name,
        given.get("serial") or name,
        str(folder / given["measurements"]),
        str(beside) if beside.exists() else robot,
        day,
        options,
    )


def _option(text: str, wrong: Callable[[str, str], MeasurementError]) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    key = key.replace("-", "_")
    if not equals or key not in KINDS:
        raise wrong("options", f"expected OPTION=VALUE with one of {', '.join(KINDS)}, found {text!r}")
    try:
        return key, KINDS[key](value)
    except ValueError:
        kind = {float: "a number", int: "a whole number"}.get(KINDS[key], "yes or no")  # type: ignore[call-overload]
        raise wrong("options", f"{key}: expected {kind}, found {value!r}") from None


assert set(KINDS) <= {field.name for field in fields(Options)}
