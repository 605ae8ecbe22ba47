"""What each device would leave of a robot's position error, before anything is bought.

A calculation, no measurement (``irbcal plan --compare-devices``): the arm is uncertain by its natural sizes, each
device shows what its rows show with its noise, and the rest stays as it was. Twice: as if the geometry were all, and
with what model ``auto`` fits beside it (gain, gravity, harmonics of the joints).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from irbcal.errors import IdentificationError
from irbcal.io.opening import RobotLike, open_robot
from irbcal.options import number
from irbcal.options import seed as check_seed
from irbcal.planning.device_information import DeviceModel
from irbcal.simulation.devices import DEVICES, placed
from irbcal.simulation.devices import poses as device_poses
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

if TYPE_CHECKING:
    from irbcal.planning.choosing import Step

POSES = (25, 50, 100)
"""Numbers of poses that are compared."""

TRACKER, TRACKER_NOISE = "tracker", 0.03 * MM


@dataclass(frozen=True)
class RemainingError:
    """What one device leaves.

    Attributes
    ----------
    device, words : str
    poses : int
    noise, left, left_with_joints : float
        Standard deviation of a coordinate, and root mean square error of positions that is left where the geometry is
        all that errs, and where the joints err beyond it, metres.
    """

    device: str
    words: str
    poses: int
    noise: float
    left: float
    left_with_joints: float


@dataclass(frozen=True, eq=False, repr=False)
class DeviceComparison(Result):
    """What devices leave of a robot's position error.

    Attributes
    ----------
    robot : str
    before, before_with_joints : float
        Root mean square error without any, from the geometry and with the joints' errors beyond it, metres.
    rows : tuple of RemainingError
        Best first, by the largest number of poses.
    missing : tuple of str
        Devices that the arm does not reach, in sentences.
    """

    robot: str
    before: float
    before_with_joints: float
    rows: tuple[RemainingError, ...]
    missing: tuple[str, ...] = ()

    def report(self) -> Sequence[Paragraph]:
        """A row for each device, a column for each number of poses."""
        counts = sorted({row.poses for row in self.rows})
        devices = list(dict.fromkeys((row.device, row.words, row.noise) for row in self.rows))
        remaining = {(row.device, row.poses): row.left / MM for row in self.rows}
        last = {row.device: row.left_with_joints / MM for row in self.rows if row.poses == counts[-1]}
        cells = tuple(
            (device, label, noise / MM, *(remaining.get((device, count)) for count in counts), last.get(device))
            for device, label, noise in devices
        )
        unmeasured = (
            "before",
            "no measurement",
            None,
            *(self.before / MM for _ in counts),
            self.before_with_joints / MM,
        )
        columns = ("device", "what it is", "noise", *(f"{count} poses" for count in counts), f"{counts[-1]}, joints")
        return [
            f"{self.robot}: position error before calibration {self.before / MM:.2f} mm from the geometry, "
            f"{self.before_with_joints / MM:.2f} mm with what joints err beyond it (root mean square over the whole "
            "range; gain, gravity and harmonics in their natural sizes)",
            Table("Predicted position error that each device leaves, mm", columns, (unmeasured, *cells)),
            f"Columns with poses alone: as if the geometry were all that errs. {counts[-1]}, joints: the joints err "
            "beyond it, as those of real robots do; a device that keeps the arm in one place does not tell them all.",
            "Calculated, not measured: what no error model describes is not in it, and remains.",
            *(f"Note: {text}" for text in self.missing),
        ]

    CONTENT = "robot before_mm before_with_joints_mm devices=to_frame notes=missing"
    ROWS, COLUMNS = "rows", "device words poses noise_mm left_mm left_with_joints_mm"


def compare_devices(
    robot: RobotLike,
    poses: Sequence[int] = POSES,
    *,
    noise: float | None = None,
    prior: float | None = None,
    seed: int = 0,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    progress: Step | None = None,
) -> DeviceComparison:
    """Predict the position error that a tracker and each device in its place would leave.

    Parameters
    ----------
    robot : str, Path or calibration
    poses : sequence of int
        Numbers of poses to compare.
    noise : float, optional
        Standard deviation of a coordinate for all devices, metres; what is plausible for each unless given.
    prior : float, optional
        Root mean square position error from the geometry before any measurement, metres; what its natural sizes make
        unless given. Sizes of the joints' errors stay.
    seed : int
        Of the random poses.
    base_link, tip_link, coupling
        See `irbcal.read_urdf`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Raises
    ------
    OptionError
        If an option makes no sense.

    Examples
    --------
    >>> print(compare_devices("irb1600"))  # doctest: +SKIP
    """
    check_seed(seed)
    counts = sorted({number("poses", count, 5, 100_000, whole=True) for count in poses})
    arm = open_robot(robot, base_link=base_link, tip_link=tip_link, coupling=coupling).robot.arm
    say: Callable[[str], object] = progress or (lambda text: None)
    size = None if prior is None else number("prior", prior, 1e-6, 0.1)
    models = [DeviceModel(arm, seed, wide, size) for wide in (False, True)]
    rows: list[RemainingError] = []
    missing: list[str] = []
    for name in (TRACKER, *DEVICES):
        say(name)
        for count in counts:
            spread = TRACKER_NOISE if name == TRACKER else DEVICES[name].noise
            spread = spread if noise is None else number("noise", noise, 1e-7, 0.01)
            try:
                errors = [_left(model, name, count, spread) for model in models]
            except IdentificationError as error:
                missing.append(str(error))
                continue
            label = "laser tracker, one reflector" if name == TRACKER else DEVICES[name].words
            rows.append(RemainingError(name, label, count, spread, *errors))
    with_joints = {row.device: row.left_with_joints for row in rows}
    rows.sort(key=lambda row: with_joints[row.device])
    return DeviceComparison(arm.name, models[0].before, models[1].before, tuple(rows), tuple(missing))


def _left(model: DeviceModel, name: str, count: int, noise: float) -> float:
    """What random poses leave."""
    if name == TRACKER:
        return model.tracked(count, noise).left()
    features = placed(model.arm, DEVICES[name])
    return model.at(features, *device_poses(model.arm, features, count, model.seed), noise).left()
