"""Options of `irbcal.correct`: each is declared here, and nowhere else (`irbcal.declared_options`)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from irbcal.correction.program_options import ProgramOptions
from irbcal.correction.true_frames import ControllerNumbers, PointOrigin, point_origin
from irbcal.declared_options import EVERYDAY, Bounds
from irbcal.errors import OptionError
from irbcal.option_values import Progress

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from irbcal.cell.cell_file import CellFile

IN_PIECES = "long tables that are corrected in pieces take it"


@dataclass(frozen=True, eq=False)
class CorrectionOptions(ProgramOptions):
    """What is corrected, and how."""

    _: KW_ONLY
    out: Annotated[str | Path | None, IN_PIECES] = None
    """File for the program with fake targets, or, where it lies in several files, the folder for them, or the archive
    (``.zip``) with all files of the one that was given; without it the bytes are in the result only. Beside the
    programs of a folder or an archive lies ``changes.csv``.
    """
    allow_partial: Annotated[bool, EVERYDAY, IN_PIECES] = False
    """Write files even if some targets could not be corrected; these stay as they are."""
    changes: Annotated[str | Path | None, EVERYDAY] = None
    """File for what changed, target by target, as CSV (millimetres and degrees)."""
    path_tolerance: Annotated[float | None, Bounds(1e-6, 1.0)] = None
    """Put points into straight and circular moves, so that the tool centre point leaves the wanted path by less than
    this, metres. For RAPID.
    """
    payload: Annotated[float | None, EVERYDAY, IN_PIECES] = None
    """See `irbcal.forward_kinematics`."""
    payload_centre: Annotated[ArrayLike | None, IN_PIECES] = None
    """See `irbcal.forward_kinematics`."""
    cell: Annotated[CellFile | str | Path | None, EVERYDAY] = None
    """True tools and work objects, as ``irbcal cell`` writes them, see `irbcal.correction.true_frames`."""
    controller_frames: ControllerNumbers = "same"
    """Which numbers the controller will have for them: ``same`` as now, or those ``from-cell``."""
    frames_measured: bool = False
    """Tools and work objects that are not in the cell file were measured independently of the robot."""
    strict: bool = False
    """Write nothing where tools or work objects are of unknown origin."""
    points: Annotated[str, EVERYDAY] = "offline"
    """``offline``: coordinates of points are wanted. ``taught``, or ``taught:PATTERN`` of their names: they were shown
    on the real robot, so they stay as they are.
    """
    re_express: bool = False
    """Rewrite the taught points as offline points of the true frames, and correct nothing."""
    split_points: bool = False
    """Put a point of its own, in numbers, into moves that go to another point with an offset in numbers, and correct it
    by itself. For RAPID, KRL, VAL3 and Kawasaki.
    """
    progress: Annotated[Progress | None, IN_PIECES] = None
    """Called with a short text after each piece of a long table."""

    def __post_init__(self) -> None:
        super().__post_init__()
        taught = self.origin.taught is not None
        if self.split_points and (taught or self.path_tolerance is not None):
            raise OptionError(
                "split_points: goes with offline points, and without a path tolerance", parameter="split_points"
            )
        if self.controller_frames == "from-cell" and (self.cell is None or self.re_express):
            message = "controller_frames: numbers from-cell are for corrections with a cell, give cell too"
            raise OptionError(message, parameter="controller_frames")
        if self.re_express and self.cell is None and not self.frames_measured:
            message = (
                "re_express: the true tools and work objects are not known: give a cell, or say frames_measured if "
                "they were measured independently of the robot"
            )
            raise OptionError(message, parameter="re_express")
        if self.path_tolerance is not None and (self.cell is not None or taught):
            message = "path_tolerance: paths are cut for the controller's own tools and work objects only, without cell"
            raise OptionError(f"{message} and taught points", parameter="path_tolerance")

    @property
    def origin(self) -> PointOrigin:
        """Which points are taught."""
        return point_origin(self.points, self.re_express)
