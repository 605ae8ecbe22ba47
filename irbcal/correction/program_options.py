"""Options of all that reads robot programs: each is declared here, and nowhere else (`irbcal.declared_options`)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from irbcal.declared_options import check_fields

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from irbcal.io.opening import CalibrationLike

POINTS = "points of programs take it"
CONTROLLERS = "numbers of controllers"


@dataclass(frozen=True, eq=False)
class ControllerOptions:
    """What programs do not say of their controller."""

    _: KW_ONLY
    tool: Mapping[str, ArrayLike] | None = None
    """Tools as the controller has them, by their names, that a program does not define: transforms of shape (4, 4) in
    the controller's flange, metres.
    """
    wobj: Mapping[str, ArrayLike] | None = None
    """Work objects (bases, user frames) likewise, in the controller's world."""
    start: Annotated[ArrayLike | None, POINTS] = None
    """Joints where the program begins, as the controller counts them, radians. Poses whose configuration the program
    does not say are meant next to the stop before.
    """
    posture: Annotated[ArrayLike | None, POINTS] = None
    """Joints in whose configuration, and next to which, poses are meant where the program does not say it and no stop
    before is known; radians.
    """
    instructions: Annotated[str | Path | None, POINTS] = None
    """File that teaches motion instructions of RAPID and INFORM, and routines of KRL, AS, URScript and VAL3 that move
    to one of their arguments, a line each: ``rapid ArcL to speed seam weld * tool``, ``krl DISPENSE to bead``, see
    `irbcal.correction.instructions`.
    """
    ignored_calls: Annotated[Sequence[str], POINTS] = ()
    """Names of routines, or patterns of names with ``*``, that the programs call and that are not among them: they
    neither move the robot nor set its tool or work object.
    """
    pulses: Annotated[Sequence[float] | None, CONTROLLERS] = None
    """Pulses per degree of the six joints, for Yaskawa jobs whose positions are in pulses."""
    where: Annotated[tuple[ArrayLike, ArrayLike] | None, CONTROLLERS] = None
    """For poses of Kawasaki programs: joints (6,) as the controller counts them, radians, and the pose (4, 4), metres,
    that it reports there with null tool and null base.
    """

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False)
class ProgramOptions(ControllerOptions):
    """Programs of a calibrated robot."""

    calibration: CalibrationLike
    """Calibration folder."""
    program: str | Path | Sequence[str | Path]
    """Robot program in one of the languages of docs/programs.md, or CSV or Parquet of joints or of tip poses; several
    files of one language, or a folder or a zip archive, which are searched with all their folders. Of several files
    one that cannot be read is left as it is.
    """
    _: KW_ONLY
    controller_model: Annotated[str | Path | None, CONTROLLERS] = None
    """What the controller itself computes with where that is not the nominal robot: a URDF (``irbcal controller``
    writes one), or joint origins in the layout of ``ur_description``'s calibration files. Poses of the program, its
    tools and its work objects are then those of this model. ``nominal`` says that it is the nominal robot, though a
    backup says that the controller corrects its robot itself.
    """

    @property
    def programs(self) -> list[str | Path]:
        """The programs, folders and archives that are given."""
        return [self.program] if isinstance(self.program, (str, os.PathLike)) else [*self.program]
