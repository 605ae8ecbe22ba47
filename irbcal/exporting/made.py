"""What a target makes of a calibration: files, and what their reader must be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from irbcal.arrays import Locked


@dataclass(frozen=True, eq=False)
class ExportFiles(Locked):
    """The files of an export.

    Attributes
    ----------
    files : mapping of str to bytes
        By their names in the folder.
    notes : tuple of str
        What is not in them though the calibration's URDF has it.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
