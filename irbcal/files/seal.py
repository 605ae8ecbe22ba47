"""The seal of ``calibration.json``: hashes of its parts, by which a later change is seen and named.

A robot moves by these numbers. A file that was edited or damaged after it was written is refused, with the names of the
parts that differ; a deliberate change is accepted by `resealed`, which adds a line to the history.

The hash of a part is SHA-256 of its canonical JSON: keys sorted, no spaces, numbers as Python writes them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import datetime, timezone
from typing import Any

from irbcal.errors import CalibrationError
from irbcal.files.section import Section

KEY = "seal"


class Seal(Section):
    """Hashes of all other parts, by name, and a line for every deliberate change since."""

    parts: dict[str, str]
    changes: list[str]


def digest(part: Any) -> str:
    """SHA-256 of a part's canonical JSON."""
    text = json.dumps(part, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document with a seal that fits it; lines of its history stay.

    Parameters
    ----------
    document : dict
        As JSON has it.

    Returns
    -------
    dict
        The seal is its last part.
    """
    rest = {name: part for name, part in document.items() if name != KEY}
    changes = (document.get(KEY) or {}).get("changes", [])
    return rest | {KEY: {"parts": {name: digest(part) for name, part in rest.items()}, "changes": list(changes)}}


def resealed(document: Mapping[str, Any], why: str) -> dict[str, Any]:
    """A document whose changes are accepted, with a line in its history that says when, what and why.

    Parameters
    ----------
    document : dict
    why : str
        One line.

    Raises
    ------
    CalibrationError
        If nothing has changed since it was sealed.
    """
    differ = broken(document)
    if differ == []:
        raise CalibrationError("nothing was changed since it was sealed: there is nothing to accept")
    what = "not sealed before" if differ is None else ", ".join(differ)
    line = f"{datetime.now(timezone.utc).isoformat(timespec='seconds')}: {what}: {why}"
    before = dict(document.get(KEY) or {"parts": {}, "changes": []})
    before["changes"] = [*before.get("changes", []), line]
    return sealed({**document, KEY: before})


def broken(document: Mapping[str, Any]) -> list[str] | None:
    """Names of the parts that are not as they were sealed.

    Parameters
    ----------
    document : dict
        As JSON has it.

    Returns
    -------
    list of str or None
        None where there is no seal, as in files of earlier versions.
    """
    seal = document.get(KEY)
    if seal is None:
        return None
    parts: Mapping[str, str] = seal["parts"]
    names = [name for name in (*document, *parts) if name != KEY]
    return [
        name
        for name in dict.fromkeys(names)
        if name not in document or name not in parts or digest(document[name]) != parts[name]
    ]
