"""The folder of a project: what a user dropped, what the commands wrote, and what was typed into the pages.

All state is on disk. A browser that is closed, a server that is stopped and a second tab lose nothing: each page reads
the folder again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irbcal.errors import IrbcalError, MeasurementError
from irbcal.overwriting import replacing
from irbcal.safe_files import read_bytes, write_set

UPLOADS = ("robot", "data", "touches", "programs", "verification")
"""Folders of what users drop."""
CORRECTED = "corrected"
CHOICES = "project.json"
LONGEST_NAME = 120
FORBIDDEN = '<>:"/\\|?*'
"""Characters that some file system does not take."""


@dataclass(frozen=True)
class Project:
    """A project's folder."""

    folder: Path

    @classmethod
    def open(cls, folder: Path) -> Project:
        """The project of a folder, which is made where it is not there.

        Raises
        ------
        IrbcalError
            If the folder cannot be made, or holds files that are not a project's.
        """
        strange = folder.exists() and (
            not folder.is_dir() or (any(folder.iterdir()) and not (folder / CHOICES).exists())
        )
        if strange:
            raise IrbcalError(
                f"this folder has files and no {CHOICES}: it is not a project of irbcal app; name a new folder",
                file=str(folder),
            )
        project = cls(folder.absolute())
        for name in (*UPLOADS, CORRECTED):
            (folder / name).mkdir(parents=True, exist_ok=True)
        if not (folder / CHOICES).exists():
            project.keep({})
        project.choices()
        return project

    def choices(self) -> dict[str, dict[str, Any]]:
        """What was typed, by step."""
        path = self.folder / CHOICES
        try:
            content = json.loads(read_bytes(path, IrbcalError))
        except ValueError as error:
            raise IrbcalError(f"expected JSON: {error}", file=str(path)) from None
        if not isinstance(content, dict) or not all(isinstance(value, dict) for value in content.values()):
            raise IrbcalError("expected an object with an object for each step", file=str(path))
        return content

    def keep(self, choices: Mapping[str, Mapping[str, Any]]) -> None:
        """Write what was typed, whole or not at all."""
        with replacing():
            write_set({self.folder / CHOICES: json.dumps(choices, indent=1).encode()})

    def choose(self, step: str, **values: Any) -> None:
        """Keep values of a step beside those that it has."""
        choices = self.choices()
        choices[step] = choices.get(step, {}) | values
        self.keep(choices)

    def files(self, folder: str) -> list[str]:
        """Paths of the files of a folder, in the project, sorted by name."""
        return sorted(
            path.relative_to(self.folder).as_posix()
            for path in (self.folder / folder).glob("*")
            if path.is_file() and not path.name.startswith(".")
        )

    def has(self, name: str) -> bool:
        """Whether a file or a folder is there."""
        return (self.folder / name).exists()

    def add(self, folder: str, name: str, content: bytes) -> str:
        """Write a dropped file, whole or not at all.

        Parameters
        ----------
        folder : str
            One of `UPLOADS`.
        name : str
            As the browser says it; its folders are dropped.
        content : bytes

        Returns
        -------
        str
            The file's path in the project.

        Raises
        ------
        MeasurementError
            If the name is none that a file can have on every system.
        """
        name = name.replace("\\", "/").rpartition("/")[2].strip()
        bad = not name or name.startswith((".", "-")) or len(name.encode()) > LONGEST_NAME
        if bad or any(letter in FORBIDDEN or not letter.isprintable() for letter in name):
            raise MeasurementError(f"{name!r} is no name for a file: rename it before you drop it")
        with replacing():
            write_set({self.folder / folder / name: content})
        return f"{folder}/{name}"

    def remove(self, path: str) -> None:
        """Remove a dropped file."""
        if path in {file for folder in UPLOADS for file in self.files(folder)}:
            (self.folder / path).unlink()

    def inside(self, path: str) -> Path | None:
        """The regular file of a path in the project, None where there is none or the path leads out of it."""
        file = (self.folder / path).resolve()
        return file if file.is_file() and file.is_relative_to(self.folder.resolve()) else None

    @property
    def robot(self) -> str:
        """The robot that was chosen: a name of the catalogue or a dropped file; empty where none was."""
        return str(self.choices().get("robot", {}).get("robot", ""))
