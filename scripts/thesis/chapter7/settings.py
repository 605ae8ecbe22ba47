"""What a study consists of: its settings, and the calibrations that they ask for."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from irbcal.errors import OptionError
from irbcal.identification.choices import Goal
from irbcal.simulation import pose_list

AREAS, PAYLOADS = pose_list.AREAS, (3, 6)

METHODS: dict[str, dict[str, Any]] = {
    "least-squares": {},
    "nelder-mead": {"method": "nelder-mead"},
    "max": {"goal": Goal("max")},
}
"""Ways to identify, and what `irbcal.identification.fit.identify_by` calls them."""

MODELS = ("11", "16", "26", "34")
FEWEST_MEASUREMENTS, FEWEST_POINTS = 20, 520
MOST_POINTS = 100_000

MOVES: dict[int, list[Sequence[int]]] = {
    18: [range(-30, 31, 30)] * 6,
    54: [range(-40, 41, 10)] * 6,
    102: [[*range(-40, 41, 10), *range(30, -41, -10)]] * 6,
    158: [[*range(-40, 41, 10), *range(30, -41, -10)]] * 5 + [[*range(-180, 181, 10), *range(170, -181, -10)]],
}
"""Number of axis points -> angles of joints 1 to 6, degrees, the others at zero.

Nubiola 2011, section 7.2 (18 points), section 7.5 (54) and section 7.7 (158); Table 7.2 has all four.
"""


@dataclass(frozen=True)
class Settings:
    """What a study consists of.

    Parameters
    ----------
    procedures : tuple of int
        Numbers of identification measurements (Nubiola 2011, section 7.7.5).
    each : int
        Calibrations for each of these numbers and each of the curve's.
    curve : tuple of int
        Numbers of measurements for the error against the number of measurements (section 7.7.3).
    model : str
        Level of all of them.
    method : str
        One of `METHODS`.
    points : int
        Verification points in each area and with each payload (section 7.7). Three eighths as many are there to choose
        the identification from, an eighth is verified with fake targets: as in the thesis with 8,000.
    seed : int

    Raises
    ------
    OptionError
        If the settings make no study.
    """

    procedures: tuple[int, ...] = (80, 120, 180, 200)
    each: int = 5
    curve: tuple[int, ...] = (20, 30, 40, 60, 80, 120, 200, 400, 1000)
    model: str = "34"
    method: str = "nelder-mead"
    points: int = 8000
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("procedures", "curve"):
            object.__setattr__(self, name, tuple(sorted({int(n) for n in getattr(self, name)})))
        _checked("model", self.model, MODELS)
        _checked("method", self.method, METHODS)
        if not self.procedures:
            raise OptionError(
                "a study needs at least one number of identification measurements", parameter="procedures"
            )
        if not FEWEST_POINTS <= self.points <= MOST_POINTS:
            raise OptionError(
                f"expected {FEWEST_POINTS} to {MOST_POINTS} verification points, found {self.points}",
                parameter="points",
            )
        if not 1 <= self.each <= 1000:
            raise OptionError(f"expected 1 to 1000 calibrations of each size, found {self.each}", parameter="each")
        if self.seed < 0:
            raise OptionError(f"expected a seed of 0 or more, found {self.seed}", parameter="seed")
        for name in ("procedures", "curve"):
            for n in getattr(self, name):
                self._check_size(n, name)

    def _check_size(self, n: int, parameter: str) -> None:
        if n < FEWEST_MEASUREMENTS or max(shares(n)[1:]) > self.pool:
            raise OptionError(
                f"{n} identification measurements: expected {FEWEST_MEASUREMENTS} to {2 * self.pool}, for "
                f"{self.points} verification points come with {self.pool} points in each area to choose from",
                parameter=parameter,
            )

    @property
    def pool(self) -> int:
        """Points in each area that the identification is chosen from."""
        return 3 * self.points // 8

    @property
    def verified(self) -> int:
        """Poses in each area that are verified with fake targets."""
        return self.points // 8

    def document(self) -> dict[str, Any]:
        """The settings as a dict for JSON."""
        return asdict(self) | {"procedures": list(self.procedures), "curve": list(self.curve)}


def _checked(name: str, value: str, allowed: Collection[str]) -> None:
    if value not in allowed:
        raise OptionError(f"unknown {name} {value!r}: choose one of {', '.join(allowed)}", parameter=name)


@dataclass(frozen=True)
class Repetition:
    """One calibration of a study.

    Parameters
    ----------
    model : str
        A level of `MODELS`; ``nominal`` (base and tool only), ``axes`` (directly from axis points) or ``course`` (a
        level-34 search that is watched, Nubiola 2011, section 7.5).
    measures : int
        Measurements it is made from.
    index : int
        From 1, among those of the same size.
    """

    model: str
    measures: int = 0
    index: int = 1

    @property
    def name(self) -> str:
        """Unique in a study, fit for a file name."""
        return self.model if self.model == "nominal" else f"{self.model}-{self.measures}-{self.index}"

    def seed(self, settings: Settings) -> int:
        """The seed of this repetition: of the choice of measurements and of its own runs in the cell."""
        sequence = np.random.SeedSequence([settings.seed, self.measures, self.index])
        return int(sequence.generate_state(1)[0])


NOMINAL, AXES = Repetition("nominal"), {n: Repetition("axes", n) for n in MOVES}
FULL, SMALL = Repetition("34", 200), Repetition("11", 400)
"""Of Nubiola 2011, Table 7.4 and Table 7.6: the first choice, where the thesis shows one of the best."""

COURSE = Repetition("course", 140)
"""The search whose course is Nubiola 2011, Figure 7.2."""


def procedures(settings: Settings) -> list[Repetition]:
    """The repetitions of the procedures, size by size (Nubiola 2011, sections 7.7.4 and 7.7.5: five of each)."""
    return [Repetition(settings.model, n, k + 1) for n in settings.procedures for k in range(settings.each)]


def curve(settings: Settings) -> list[Repetition]:
    """The repetitions of the error against the number of measurements (Nubiola 2011, section 7.7.3)."""
    return [Repetition(settings.model, n, k + 1) for n in settings.curve for k in range(settings.each)]


def repetitions(settings: Settings) -> list[Repetition]:
    """All repetitions of a study, each once, in a fixed order."""
    every = [NOMINAL, *AXES.values(), FULL, SMALL, *procedures(settings), *curve(settings), COURSE]
    return list(dict.fromkeys(every))


def shares(measures: int) -> tuple[int, int, int]:
    """How many measurements are axis points, in the ISO cube and in the whole range.

    The shares of Nubiola 2011 for 120 measurements (section 7.2), 140 (section 7.5), 200 (section 7.7.3.1) and 400
    (section 7.7.3.2): 18, 54, 54, 54 axis points and a few more of the rest in the cube. Fewer than 60 measurements
    leave no room for axis points.
    """
    axes = 54 if measures >= 140 else 18 if measures >= 60 else 0
    cube = (measures - axes + axes // 9 + 1) // 2
    return axes, cube, measures - axes - cube
