"""What a measuring plan should hold: how many poses of which kinds, and what they are chosen for."""

from __future__ import annotations

from dataclasses import dataclass

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import OptionError
from irbcal.options import MOST_POSES, number
from irbcal.options import seed as check_seed
from irbcal.planning.information import CRITERIA, IMAGINED_SIZE, NOISE
from irbcal.planning.sources import FEW, MANY
from irbcal.simulation.virtual_cell import SECONDS_PER_POINT, WAIT_S

READINGS_S = SECONDS_PER_POINT
"""Seconds that the tracker needs for a reflector."""
VOLUMES = ("both", "cube", "range")


@dataclass(frozen=True, eq=False)
class Wish:
    """What a plan should hold.

    Parameters
    ----------
    axis : int
        18 or 158 axis moves (of six joints; as many for each joint of others), or 0.
    cube, all_range : int
        Random poses in the cube and in the whole range.
    optimal : int
        Poses chosen out of ``candidates``, half in the cube, half in the whole range.
    candidates : int
    criterion : str
        See `irbcal.planning.information`.
    volume : str
        Where positions count for the criterion ``position``: ``cube``, ``range`` or ``both``.
    level : str, optional
        Error model; that of a calibration without a wish unless given.
    noise : float
        Standard deviation of a coordinate, metres.
    imagined : float
        Size of joint errors that no model describes, against which the criterion ``position`` guards, radians.
    wait_s, speed : float
        Seconds of rest before a measurement; speed of the tip, m/s.
    references : int
        Reference reflectors that are measured in each pose, too: they take time.
    payload_kg : float, optional
    seed : int
    must : bool
        Whether a plan without the axis moves is refused where these do not meet the conditions.
    language : str, optional
        Of the program, see `irbcal.correction.languages.by_name`; that of the robot's maker unless given.
    pulses : tuple of float
        Pulses per degree of the six joints, for programs that hold pulses.
    """

    axis: int = FEW
    cube: int = 52
    all_range: int = 50
    optimal: int = 0
    candidates: int = 2000
    criterion: str = "position"
    volume: str = "both"
    level: str | None = None
    noise: float = NOISE
    imagined: float = IMAGINED_SIZE
    wait_s: float = WAIT_S
    references: int = 3
    speed: float = 0.5
    payload_kg: float | None = None
    seed: int = 0
    must: bool = True
    language: str | None = None
    pulses: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.axis not in (0, FEW, MANY):
            raise OptionError(f"expected {FEW}, {MANY} or 0 axis moves, found {self.axis}", parameter="axis")
        for name, choices in (("criterion", CRITERIA), ("volume", VOLUMES)):
            if getattr(self, name) not in choices:
                raise OptionError.unknown(name, getattr(self, name), choices)
        if not (self.axis or self.cube or self.all_range or self.optimal):
            raise OptionError("the plan has no poses: ask for axis moves, cube, all-range or optimal poses")
        for name, smallest in (("cube", 0), ("all_range", 0), ("optimal", 0), ("candidates", 2), ("references", 0)):
            number(name, getattr(self, name), whole=True)
            if getattr(self, name) < smallest:
                raise OptionError(f"{name}: expected at least {smallest}, found {getattr(self, name)}", parameter=name)
        check_seed(self.seed)
        for name in ("cube", "all_range", "optimal", "candidates"):
            number(name, getattr(self, name), high=MOST_POSES)
        for name in ("wait_s", "payload_kg", "imagined"):
            if getattr(self, name) is not None:
                number(name.removesuffix("_kg"), getattr(self, name), 0)
        for name in ("noise", "speed"):
            number(name, getattr(self, name))
            if not getattr(self, name) > 0:
                raise OptionError(f"{name}: expected more than zero, found {getattr(self, name)}", parameter=name)

    def hold_s(self, measured: BoolArray) -> FloatArray:
        """Seconds of standing still in each pose: the wait and the readings, shape (n,)."""
        seconds: FloatArray = self.wait_s + READINGS_S * (measured.sum(axis=1) + self.references)
        return seconds
