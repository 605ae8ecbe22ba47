"""The seal of a calibration folder: hashes of the parts of ``calibration.json`` and of all files beside it.

A robot moves by these numbers. A folder without a seal, or of which something was edited or damaged after it was
written, is refused with the names of what differs; a deliberate change is accepted by `resealed`, which adds a line to
the history. The *fingerprint* is that of the parts by which a robot moves (`MOVING`); it stands in programs, exports
and certificates.

The hash of a part is SHA-256 of its canonical JSON: keys sorted, no spaces, numbers as Python writes them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import datetime, timezone
from typing import Annotated, Any, TypeAlias

from pydantic import StringConstraints
from pydantic_core import to_jsonable_python

from irbcal.errors import CalibrationError
from irbcal.files.section import Section, Sentence, Sha256, Word

KEY = "seal"
MOVING = ("simulated", "robot", "joint_origins", "joint_map", "frame_terms", "placement", "data")
"""Parts of which the fingerprint is one."""
FileName: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._-]{0,99}$")]
"""Of a file in the folder itself."""


class Seal(Section):
    """Hashes of all other parts and of all other files, by name, and a line for every deliberate change since."""

    parts: dict[Word, Sha256]
    files: dict[FileName, Sha256]
    changes: list[Sentence]


def digest(part: Any) -> str:
    """SHA-256 of a part's canonical JSON."""
    text = json.dumps(part, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def fingerprint(parts: Mapping[str, Any]) -> str:
    """The fingerprint of a calibration.

    Parameters
    ----------
    parts : dict
        Those of `MOVING`, as sections or as JSON has them; others are left out.

    Returns
    -------
    str
        32 digits, hexadecimal.
    """
    return digest(to_jsonable_python({name: parts[name] for name in MOVING}))[:32]


def hashes(files: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of files, by their names."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}


def sealed(document: Mapping[str, Any], files: Mapping[str, str] | None = None) -> dict[str, Any]:
    """A document with a seal that fits it; lines of its history stay.

    Parameters
    ----------
    document : dict
        As JSON has it.
    files : dict of str to str, optional
        SHA-256 of the files beside it; those of its seal unless given.

    Returns
    -------
    dict
        The seal is its last part.
    """
    rest = {name: part for name, part in document.items() if name != KEY}
    before = document.get(KEY) or {}
    return rest | {
        KEY: {
            "parts": {name: digest(part) for name, part in rest.items()},
            "files": dict(before.get("files", {}) if files is None else files),
            "changes": list(before.get("changes", [])),
        }
    }


def resealed(document: Mapping[str, Any], files: Mapping[str, str], why: str) -> dict[str, Any]:
    """A document whose changes are accepted, with a line in its history that says when, what and why.

    Parameters
    ----------
    document : dict
    files : dict of str to str
        SHA-256 of the files beside it, as they are now.
    why : str
        One line.

    Raises
    ------
    CalibrationError
        If nothing has changed since it was sealed.
    """
    before = dict(document.get(KEY) or {})
    listed: Mapping[str, str] = before.get("files", {})
    differ = broken(document) + [name for name in sorted({*listed, *files}) if listed.get(name) != files.get(name)]
    if not differ:
        raise CalibrationError("nothing was changed since it was sealed: there is nothing to accept")
    what = ", ".join(differ) if before else "not sealed before"
    line = f"{datetime.now(timezone.utc).isoformat(timespec='seconds')}: {what}: {why}"
    return sealed({**document, KEY: before | {"changes": [*before.get("changes", []), line]}}, files)


def broken(document: Mapping[str, Any]) -> list[str]:
    """Names of the parts that are not as they were sealed: of all parts, and the seal itself, where there is none.

    Parameters
    ----------
    document : dict
        As JSON has it.
    """
    seal = document.get(KEY)
    if seal is None:
        return [KEY, *(name for name in document if name != KEY)]
    parts: Mapping[str, str] = seal["parts"]
    names = [name for name in (*document, *parts) if name != KEY]
    return [
        name
        for name in dict.fromkeys(names)
        if name not in document or name not in parts or digest(document[name]) != parts[name]
    ]
