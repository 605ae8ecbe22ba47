"""A calibration as a part of other programs: ``irbcal export``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Protocol

from numpy.typing import ArrayLike

from irbcal import literals
from irbcal.errors import CalibrationError
from irbcal.exporting.robot_numbers import ExportFiles
from irbcal.exporting.source import Source
from irbcal.io.calibration_folder import JSON_NAME
from irbcal.io.opening import CalibrationLike
from irbcal.io.urdf_xml import CHOICES, MeshPaths
from irbcal.option_values import checked
from irbcal.overwriting import CALIBRATION_FILES
from irbcal.safe_files import write_set
from irbcal.summary import Paragraph, Result, Table, remarks
from irbcal.wording import joined

TARGETS = ("cpp", "python", "casadi", "urdf", "mujoco", "drake", "ros")
"""What a calibration can be exported as: each is a module of this package, see `ExportModule`."""


class ExportModule(Protocol):
    """What the module of a target offers."""

    @property
    def DESCRIPTION(self) -> str:
        """What is written."""
        ...

    @property
    def NEXT_STEP(self) -> str:
        """What to do with it.

        Filled in are ``{folder}`` for a shell, ``{package!r}`` (its ``package.xml``) for Python, and ``{word}``, the
        robot's name in names of files.
        """
        ...

    def files(self, source: Source) -> ExportFiles:
        """The files."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class Exported(Result):
    """What was written.

    Attributes
    ----------
    target : str
        One of `TARGETS`.
    folder : Path
    files : tuple of str
        Names in it.
    fingerprint : str
        Of the calibration; it stands in the files.
    simulated : bool
        Whether the calibration comes from SIMULATED data.
    miss : float
        By how much the exported numbers miss irbcal's own kinematics at the test vectors, radians or metres.
    next : str
        What to do with it.
    notes : tuple of str
        What the files lack that the calibration or its URDF has.
    """

    target: str
    folder: Path
    files: tuple[str, ...]
    fingerprint: str
    simulated: bool
    miss: float
    next: str
    notes: tuple[str, ...] = ()

    def report(self) -> Sequence[Paragraph]:
        """Files and what to do with them."""
        simulated = ", from SIMULATED measurements" if self.simulated else ""
        headline = (
            f"exported as {self.target} to {self.folder} (fingerprint {self.fingerprint}{simulated}); the test vectors "
            f"in it are met to {self.miss:.1g}"
        )
        listed = [name for name in self.files if not name.startswith("meshes/")]
        meshes = len(self.files) - len(listed)
        rows = [(name,) for name in listed] + ([(f"{meshes} meshes",)] if meshes else [])
        return [headline, *remarks("Note", self.notes), Table("files", ("file",), tuple(rows)), self.next]

    CONTENT = "target folder files fingerprint simulated largest_miss=miss notes"


def export(
    calibration: CalibrationLike,
    as_: str,
    out: str | os.PathLike[str],
    *,
    payload: float | None = None,
    payload_centre: ArrayLike | None = None,
    mesh_paths: MeshPaths = "relative",
    without_frame_terms: bool = False,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    without_meshes: bool = False,
) -> Exported:
    """Write a calibrated robot as a self-contained part of other programs.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
        Calibration folder (in Python also a loaded calibration).
    as_ : {"cpp", "python", "casadi", "urdf", "mujoco", "drake", "ros"}
        ``cpp`` (one header, C++17), ``python`` (a module on numpy alone, and one on plain floats),
        ``casadi`` (Functions, and C code), ``urdf``, ``mujoco`` (MJCF and meshes), ``drake`` (a package), ``ros`` (an
        ament package with xacro macro).
    out : str or Path
        Folder, made if absent; files of an earlier export in it are replaced, all or none.
    payload : float, optional
        Mass that is carried where the caller tells none, kg; what most poses were measured with unless given.
    payload_centre : array_like, shape (3,), optional
        See `irbcal.forward_kinematics`.
    mesh_paths : {"relative", "absolute", "package"}
        How meshes stand in a URDF.
    without_frame_terms : bool
        Export URDF and joint map alone where the calibration has more.
    package_dirs : sequence of str or Path
        Folders in which meshes are looked up, beside those that the calibration remembers. Shapes of meshes that are
        in none are left out, and a note names them.
    without_meshes : bool
        Leave out all shapes that are made of meshes.

    Raises
    ------
    CalibrationError
        If the calibration cannot be read, has frame terms, or the folder holds a calibration of which a file would be
        replaced, or cannot be written.
    RobotError
        If the payload is not known to the calibration.
    OptionError
        If there is no such target, or what makes it is not installed.
    """
    target = checked("as", as_, TARGETS)
    checked("mesh_paths", mesh_paths, CHOICES)
    folder = Path(out)
    source = replace(
        Source.from_calibration(
            calibration, payload=payload, payload_centre=payload_centre, without_frame_terms=without_frame_terms
        ),
        out=folder,
        mesh_paths=mesh_paths,
        package_dirs=tuple(os.fspath(item) for item in package_dirs),
        without_meshes=without_meshes,
    )
    module: ExportModule = import_module(f"irbcal.exporting.{target}")
    exported = module.files(source)
    replaced = [name for name in exported.files if name in CALIBRATION_FILES and os.path.lexists(folder / name)]
    if replaced and os.path.lexists(folder / JSON_NAME):
        raise CalibrationError(
            f"there is a calibration in this folder, whose {joined(replaced)} would be replaced: name another folder",
            file=folder,
            parameter="out",
        )
    write_set({folder / name: content for name, content in exported.files.items()})
    numbers = source.numbers
    next_step = module.NEXT_STEP.format(
        folder=literals.shell(str(folder)), package=str(folder / "package.xml"), word=numbers.identifier
    )
    notes = (*numbers.notes, *exported.notes)
    return Exported(
        target, folder, tuple(exported.files), numbers.fingerprint, numbers.simulated, source.miss, next_step, notes
    )
