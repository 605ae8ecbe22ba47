"""Options of `irbcal.plan`: each is declared here, and nowhere else (see `irbcal.declared_options`).

Robot, reflectors, tracker and conditions make the scene (`irbcal.planning.scene`), all else says which poses in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from irbcal.declared_options import EVERYDAY, Bounds, check_fields
from irbcal.errors import OptionError
from irbcal.option_values import MOST_POSES, Progress, number, pulses_per_degree
from irbcal.planning.optimal_design import NOISE, UNMODELLED_SIZE
from irbcal.simulation.instruments import ACCEPTANCE
from irbcal.simulation.virtual_cell import SECONDS_PER_POINT, WAIT_S
from irbcal.units import DEG

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from irbcal.arrays import BoolArray, FloatArray
    from irbcal.io.opening import RobotLike
    from irbcal.planning.conditions import TargetsLike

FEW, MANY = 18, 158
"""Poses of the two sets of axis moves of a six-axis arm (Nubiola 2011, section 7.2)."""
READINGS_S = SECONDS_PER_POINT
"""Seconds that the tracker needs for a reflector."""

COUNT = Bounds(0, MOST_POSES)


@dataclass(frozen=True, eq=False)
class PlanOptions:
    """For what robot and place a plan is, and what it shall hold."""

    robot: Annotated[RobotLike, EVERYDAY]
    """URDF, a robot's name (irbcal robots) or calibration folder."""
    _: KW_ONLY
    targets: Annotated[TargetsLike | None, EVERYDAY] = None
    """Reflectors: a CSV (target, x_mm, y_mm, z_mm in the tip link and optionally nx, ny, nz: where they look); how many
    of the thesis tool's nine, or their names with commas. 3 unless given, or the calibration's.
    """
    tracker: Annotated[ArrayLike | None, EVERYDAY] = None
    """Place in the base link, metres, and optionally the turn of its axes about z, radians; as in the thesis's cell, or
    as for the calibration, unless given.
    """
    payload: Annotated[float | None, EVERYDAY, Bounds(0)] = None
    """Kilograms; goes into the plan's table."""
    refit_zeros: Annotated[Sequence[int], EVERYDAY] = ()
    """Joints, from 1, whose zeros were lost: as many poses of a calibrated robot as find them within 0.01 degrees, or
    ``optimal``, chosen for these zeros whatever the ``criterion``, and no others unless asked for.
    """
    language: Annotated[str | None, EVERYDAY] = None
    """Of the robot program, ``csv`` for none: that of the robot's maker unless given, as far as its name tells it."""
    pulses: Annotated[Sequence[float] | None, EVERYDAY] = None
    """Pulses per degree of the six joints, for Yaskawa jobs."""
    axis: int | None = None
    """Moves of one joint: three poses a joint (18), many (158) or none (0); 18 unless given, with ``optimal`` none."""
    cube: Annotated[int | None, COUNT] = None
    """Random poses in the ISO cube; 52 unless given, with ``optimal`` none."""
    all_range: Annotated[int | None, COUNT] = None
    """Random poses in the whole range; 50 unless given, with ``optimal`` none."""
    optimal: Annotated[int, EVERYDAY, COUNT] = 0
    """Poses chosen out of many candidates; other kinds then only where asked for."""
    candidates: Annotated[int, Bounds(2, MOST_POSES)] = 2000
    """Poses that ``optimal`` chooses from."""
    criterion: Literal["position", "D"] = "position"
    """What is best: predicted positions, or all parameters together (D)."""
    volume: Literal["both", "cube", "range"] = "both"
    """Where predicted positions count."""
    level: str | int | None = None
    """Error model to plan for: ``34`` unless given, ``placement`` for arms that it does not fit."""
    seed: Annotated[int, Bounds(0)] = 0
    """Of the random poses."""
    margin: float = 2 * DEG
    """From the joint limits, radians; on rails 10 mm a degree."""
    acceptance: float = ACCEPTANCE
    """Largest angle between reflector and beam, radians."""
    min_height: tuple[float, float] | None = None
    """Lowest z of tool and reflectors, in front (x from 150 mm) and at the back, metres: those of Nubiola 2011,
    section 7.2, for the IRB 1600 unless given, none for others.
    """
    cube_centre: ArrayLike | None = None
    """Centre of the ISO cube in the base link, metres, with ``cube_edge``: the largest cube in front unless given."""
    cube_edge: float | None = None
    """Edge of the ISO cube, metres, with ``cube_centre``."""
    ignore: Sequence[str] = ()
    """Conditions that poses need not keep, of limits, height, acceptance, collision, sight and path."""
    package_dirs: Sequence[str | Path] = ()
    """See `irbcal.read_urdf`."""
    wait_s: Annotated[float, Bounds(0)] = WAIT_S
    """Rest before a measurement, seconds."""
    references: Annotated[int, Bounds(0)] = 3
    """References on the floor to measure in each pose, too: they take time."""
    speed: float = 0.5
    """Of the tool, metres a second."""
    noise: float = NOISE
    """Standard deviation of a measured coordinate, metres."""
    unmodelled: Annotated[float, Bounds(0)] = UNMODELLED_SIZE
    """Root mean square of joint errors that the error model does not have, against which the criterion ``position``
    guards, radians."""
    base_link: str | None = None
    """See `irbcal.read_urdf`."""
    tip_link: str | None = None
    """See `irbcal.read_urdf`."""
    coupling: str | None = None
    """See `irbcal.read_urdf`."""
    progress: Progress | None = None
    """Called with a text at the beginning of each step."""

    def __post_init__(self) -> None:
        check_fields(self)
        if (self.cube_centre is None) != (self.cube_edge is None):
            raise OptionError("cube_centre and cube_edge go together", parameter="cube_centre")
        if self.acceptance > 90 * DEG:
            raise OptionError(
                f"a reflector cannot be seen from behind: expected 90 degrees or less, found {self.acceptance / DEG:g}",
                parameter="acceptance",
            )
        if self.refit_zeros and self.level is not None:
            raise OptionError("level: a plan for lost zeros has no other parameters, leave it out", parameter="level")
        if self.axis not in (None, 0, FEW, MANY):
            raise OptionError(f"expected {FEW}, {MANY} or 0 axis moves, found {self.axis}", parameter="axis")
        for name in ("noise", "speed"):
            if not number(name, getattr(self, name)) > 0:
                raise OptionError(f"{name}: expected more than zero, found {getattr(self, name)}", parameter=name)
        if not (any(self.counts.values()) or self.optimal or self.refit_zeros):
            raise OptionError("the plan has no poses: ask for axis moves, cube, all-range or optimal poses")
        object.__setattr__(self, "pulses", pulses_per_degree(self.pulses) or None)
        object.__setattr__(self, "refit_zeros", tuple(self.refit_zeros))
        if self.refit_zeros:
            object.__setattr__(self, "criterion", "D")

    @property
    def counts(self) -> dict[str, int]:
        """Poses of each kind that is not chosen: those asked for, else the usual ones, with optimal ones none."""
        usual = {"axis": FEW, "cube": 52, "all_range": 50}
        if self.optimal or self.refit_zeros:
            usual = dict.fromkeys(usual, 0)
        return {name: count if (given := getattr(self, name)) is None else given for name, count in usual.items()}

    def hold_s(self, measured: BoolArray) -> FloatArray:
        """Seconds of standing still in each pose: the wait and the readings, shape (n,)."""
        seconds: FloatArray = self.wait_s + READINGS_S * (measured.sum(axis=1) + self.references)
        return seconds
