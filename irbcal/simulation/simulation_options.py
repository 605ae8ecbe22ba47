"""Options of `irbcal.simulate` and `irbcal.simulate_device`: each is declared here, and nowhere else.

See `irbcal.declared_options`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from irbcal.correction.program_options import ControllerOptions
from irbcal.declared_options import EVERYDAY, Bounds, check_fields
from irbcal.errors import OptionError
from irbcal.option_values import MOST_POSES
from irbcal.simulation.virtual_cell import WAIT_S
from irbcal.units import LARGEST_PAYLOAD_KG

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from irbcal.arrays import FloatArray, IntArray
    from irbcal.io.opening import CalibrationLike
    from irbcal.measurement.input_table import TableLike
    from irbcal.simulation.pose_list import PosesLike

CellKind: TypeAlias = Literal["thesis", "realistic"]
DeviceName: TypeAlias = Literal[
    "balls",
    "string",
    "ballbar",
    "ballbars",
    "telescope",
    "two-balls",
    "sockets",
    "ball",
    "camera",
    "inclinometer",
    "plane",
]
ROBOT_SEED = 1600
"""Seed of the shipped robot's errors."""


@dataclass(frozen=True, eq=False)
class VirtualCellOptions:
    """A virtual robot and what acts on it."""

    robot: Annotated[str | Path, EVERYDAY]
    """URDF of the nominal robot, a name, such as irb1600 (tuned on the thesis) or irb120, or a calibration folder."""
    _: KW_ONLY
    seed: Annotated[int, EVERYDAY, Bounds(0)] = 0
    """Of the run: noise, repeatability, lost points, random poses."""
    payload: Annotated[float | None, EVERYDAY, Bounds(0, LARGEST_PAYLOAD_KG)] = None
    """Mass on the flange, kg; 3 unless given, less for smaller arms. Where it is given, its centre is told, too."""
    cell: Annotated[CellKind, EVERYDAY] = "thesis"
    """A robot with the thesis's errors, or with those that measured robots show: weight at all joints, harmonic drives,
    wobbling bearings, warm-up, direction of approach, early readings.
    """
    robot_seed: Annotated[int, Bounds(0)] = ROBOT_SEED
    """Of the robot's own errors: another number is another robot."""
    only: Sequence[str] | None = None
    """Only these effects, none at all if empty; names as in `irbcal.simulation.effects.EFFECT_NAMES`. The geometry of a
    robot at a device has errors in any case.
    """
    without: Sequence[str] = ()
    """All effects but these."""
    also: Sequence[str] = ()
    """Effects to switch on that the cell of the thesis leaves off: reading_lag, bending, gear, wobble, direction, move,
    thaw.
    """
    base_link: str | None = None
    """See `irbcal.read_urdf`."""
    tip_link: str | None = None
    """See `irbcal.read_urdf`."""
    coupling: str | None = None
    """See `irbcal.read_urdf`."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.only is not None and self.without:
            raise OptionError("only and without exclude each other", parameter="only")


@dataclass(frozen=True, eq=False)
class SimulationOptions(ControllerOptions, VirtualCellOptions):
    """What is measured with a tracker."""

    plan: PosesLike | None = None
    """Robot program (docs/programs.md) of which the stops are measured, or a table of joints (q1_deg …) or poses
    (x_mm … qz), such as a plan; optional columns pose, group, cycle, targets (names with spaces between them), wait_s,
    see `irbcal.simulation.pose_list.taken`.
    """
    _: KW_ONLY
    random: Annotated[int | None, EVERYDAY, Bounds(1, MOST_POSES)] = None
    """In place of a plan, that many random poses in the tracker's sight."""
    targets: Annotated[int | Sequence[str], EVERYDAY] = 3
    """How many of the tool's nine reflectors, or their names."""
    tracker: Annotated[ArrayLike | None, EVERYDAY] = None
    """Place of the tracker in the base link, metres."""
    wait: Annotated[float, Bounds(0)] = WAIT_S
    """Seconds between stop and measurement, where the plan does not say."""
    wanted: Annotated[TableLike | None, EVERYDAY] = None
    """The program before it was filtered: tells how far the robot ends from it."""
    calibration: Annotated[CalibrationLike | None, EVERYDAY] = None
    """With ``wanted``: the calibration it was filtered with."""

    def __post_init__(self) -> None:
        VirtualCellOptions.__post_init__(self)
        if (self.wanted is None) != (self.calibration is None):
            raise OptionError("wanted and calibration go together", parameter="wanted")
        if (self.plan is None) == (self.random is None):
            raise OptionError("give either a plan or a number of random poses", parameter="plan")


@dataclass(frozen=True, eq=False)
class DeviceOptions(VirtualCellOptions):
    """What is measured with a device in place of a tracker."""

    device: Annotated[DeviceName, EVERYDAY]
    """What takes the tracker's place, see `irbcal.simulation.devices.DEVICES`."""
    random: Annotated[int, EVERYDAY] = 100
    """Number of poses, shared out among the device's features."""
    _: KW_ONLY
    noise: Annotated[float | None, Bounds(0, 0.01)] = None
    """Standard deviation of a contact or a value, of a camera that of an image as a whole, metres; what is plausible
    for the device unless given.
    """
    at: tuple[FloatArray, IntArray] | None = None
    """Joints (n, joints) and number of the feature of each (n,), as `irbcal.device_plan` gives them: the real robot is
    brought to the features from there. Random ones unless given.
    """
