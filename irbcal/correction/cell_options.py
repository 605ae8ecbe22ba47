"""Options of `irbcal.cell_frames`: each is declared here, and nowhere else (`irbcal.declared_options`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from irbcal.correction.known_languages import MAKERS
from irbcal.correction.program_options import CONTROLLERS, POINTS, ProgramOptions
from irbcal.declared_options import EVERYDAY, changed_options
from irbcal.errors import OptionError
from irbcal.option_values import checked

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from irbcal.cell.cell_file import CellFile
    from irbcal.io.opening import CalibrationLike
    from irbcal.measurement.input_table import TableLike


@dataclass(frozen=True, eq=False)
class CellOptions(ProgramOptions):
    """What was touched, with what is known of it."""

    touches: TableLike
    """Touches, a row each: frame, name, point, tool, q1_deg … (with ``program``: target), optionally x_mm, y_mm, z_mm,
    u95_mm, kind, radius_mm and tracker_x_mm …, see `irbcal.cell.touches`.
    """
    _: KW_ONLY
    program: Annotated[str | Path | Sequence[str | Path], EVERYDAY] = ()
    """Programs or position lists of one language with the points that the touches name in the column target: taught
    points, whose joints are taken, with the tools and work objects that the programs say.
    """
    payload: Annotated[float | None, EVERYDAY] = None
    """Mass carried at the touches, kg."""
    payload_centre: ArrayLike | None = None
    """Centre of the payload in the tip link, metres; that of the calibration unless given."""
    refit_zeros: Sequence[int] = ()
    """Joints, from 1, whose zeros were lost (a crash, another motor): they are found with the frames, all else of the
    robot stays, and a note tells them with their intervals.
    """
    axes: TableLike | None = None
    """External axes as the controller has them, see `irbcal.cell.external_axes.read_axes`."""
    other: CalibrationLike | None = None
    """Calibration of another robot whose tools were touched, see `irbcal.cell.contacts`."""
    other_cell: CellFile | str | Path | None = None
    """Cell of the other robot, with its tools."""
    out: str | Path | None = None
    """File for the cell, ``cell.json``."""
    as_: Annotated[str | None, EVERYDAY] = None
    """Maker as whose controllers frames are written."""
    declare: Annotated[str | Path | None, EVERYDAY] = None
    """File for the true tools and work objects as this maker declares them: TOOL_DATA, tooldata, .TRANS, … to load, of
    fanuc a listing that sets UTOOL and UFRAME, of yaskawa a list to type in.
    """
    urdf: str | Path | None = None
    """File for the URDF of the whole cell: calibrated robot, axes, tools, work objects."""
    report: Annotated[str | Path | None, EVERYDAY] = None
    """File for a page of the cell: frames with intervals, axes, touches with residuals (HTML)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.as_ is not None:
            checked("as_", self.as_, MAKERS)
        elif self.declare is not None:
            raise OptionError("declare: for which maker? say it with --as", parameter="declare")
        for name in [*changed_options(self, POINTS), *changed_options(self, CONTROLLERS)] if not self.programs else ():
            raise OptionError(f"{name}: it goes with --program", parameter=name)
        if (self.other is None) != (self.other_cell is None):
            raise OptionError("other: contacts take the calibration of the other robot and its cell", parameter="other")
