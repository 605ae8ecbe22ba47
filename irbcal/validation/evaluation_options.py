"""Options of `irbcal.evaluate`: each is declared here, and nowhere else (see `irbcal.declared_options`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from irbcal.declared_options import EVERYDAY, MEASUREMENTS, Bounds, check_fields
from irbcal.errors import OptionError
from irbcal.option_values import Progress, point_in_metres
from irbcal.validation.conformity import Rule

if TYPE_CHECKING:
    from irbcal.io.opening import CalibrationLike
    from irbcal.measurement.table import MeasurementsLike


@dataclass(frozen=True, eq=False)
class EvaluationOptions:
    """What is evaluated, and how."""

    calibration: CalibrationLike
    """Calibration folder."""
    measurements: MeasurementsLike
    """Registered to the calibration's reference points where both have them."""
    _: KW_ONLY
    tolerance: Annotated[float | None, EVERYDAY] = None
    """What the calibrated robot is judged by, metres, see `irbcal.validation.conformity`."""
    intervals: Annotated[bool, EVERYDAY] = False
    """Add bootstrap intervals, see `irbcal.validation.accuracy`, and by reflector how many measured coordinates lie
    within the predicted 95 % intervals, see `irbcal.modeling.robot.Robot.predict`.
    """
    refit_base: Annotated[bool, EVERYDAY] = False
    """Fit the base again for each model (for measurements from another tracker station without references)."""
    refit_tool: Annotated[bool, EVERYDAY] = False
    """Fit the reflectors' places again for each model, because they were remounted; their names may be others."""
    refit_zeros: Annotated[Sequence[int], EVERYDAY] = ()
    """Joints, from 1, whose zeros were lost (a crash, another motor): they are found with what is fitted again, all
    else of the robot stays, and a note tells them with their intervals.
    """
    payload: Annotated[float | None, MEASUREMENTS] = None
    """Mass carried, kg, where the measurements do not tell it (column ``payload_kg``)."""
    same_tool: Annotated[bool, MEASUREMENTS] = False
    """With a load that the calibration does not know the reflectors are where they were with its usual load."""
    include_fitted: Annotated[bool, MEASUREMENTS] = False
    """Keep poses that the calibration was fitted to; they are left out otherwise."""
    sphere: Annotated[Sequence[float] | None, MEASUREMENTS] = None
    """Centre in the base link and diameter, metres: regard only points measured inside."""
    tracker_u95: Annotated[float | None, MEASUREMENTS] = None
    """Expanded uncertainty (95 %) of a measured position, metres, which is added to the upper bound of what ``rule``
    judges; by default the largest ``u95_mm`` of the measurements, else that of a usual tracker, which the certificate
    names, see `irbcal.validation.conformity.ASSUMED_U95`.
    """
    info: Annotated[Mapping[str, str] | None, EVERYDAY] = None
    """What a certificate tells besides: ``serial_number``, ``operator`` or any other name, see
    `irbcal.validation.provenance.FIELDS`. Columns of the measurements with these names are taken, too.
    """
    rule: Rule | None = None
    """What must be within the tolerance; mean + 3 sigma unless given; ``percentile`` is the 95th."""
    region_only: bool = False
    """Judge the tolerance for the region of these poses only, which the certificate states; else they must cover the
    calibrated ranges, see `irbcal.validation.conformity`.
    """
    refit_from: int | None = None
    """Poses from which base and tool are fitted again; they are not judged. By default half of them with
    ``refit_tool``; with ``refit_base`` alone all poses, which are judged, too.
    """
    relative: Literal["virtual", "three-points"] | None = None
    """Add relative errors, see `irbcal.validation.accuracy`."""
    frame_points: Sequence[tuple[str, str]] | None = None
    """The points of the frame for ``three-points``."""
    flange: bool = False
    """Add position and orientation errors of the tip from three reflectors or measured orientations."""
    verified: MeasurementsLike | None = None
    """Measurements of the same poses (by name) run with this calibration's fake targets."""
    seed: Annotated[int, Bounds(0)] = 0
    """Of the bootstrap and of the poses for ``refit_from``."""
    jobs: int | None = None
    """See `irbcal.parallel.using`."""
    progress: Progress | None = None
    """Called with a short text after each piece of a long file."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.sphere is not None:
            point_in_metres("sphere", self.sphere, "x, y, z of the centre and the diameter in metres", (4,))
        if self.frame_points is not None and self.relative != "three-points":
            raise OptionError("frame_points: only relative='three-points' takes them", parameter="frame_points")
