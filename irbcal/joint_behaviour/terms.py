"""One non-geometric effect of a joint: its size with an interval, a test, and whether it is worth having."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray
from irbcal.chance import student_within
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM

CONFIDENCE, SIGNIFICANT = 0.95, 0.05
WORTH = 0.02
"""Share by which a term must lower the rms of poses left out of the fit to be called worth it."""

LOWEST_FREQUENCY, HIGHEST_FREQUENCY = 0.5, 120.0
"""Periods per turn between which a free frequency is looked for."""

Kind: TypeAlias = Literal["backlash", "move", "gain", "fourier", "gravity", "stiffness"]
Judgement: TypeAlias = Literal["worth it", "small", "not seen", "not tested"]
Slides: TypeAlias = "BoolArray | Sequence[bool]"
"""Of each joint, whether it is prismatic; empty where all turn."""


@dataclass(frozen=True, repr=False)
class Term(Speaks):
    """One non-geometric effect: its size, whether it is real, and whether it is worth having.

    Attributes
    ----------
    kind : str
        ``backlash`` (reached from above minus from below, Nubiola 2011, section 4.2), ``move`` (error per radian of the
        last move), ``gain`` (eq. 3.31), ``fourier`` (section 5.2), ``gravity`` (one period a turn for each home pose of
        joints 2 and 3) or ``stiffness`` (A and B, see `irbcal.modeling.thesis_map`).
    joint : int or None
        Counted from 1; None for the stiffness of joints 2 and 3.
    names : tuple of str
    values, low, high : tuple of float
        Estimates and their 95 % intervals; radians (metres for prismatic joints), ``move`` and ``gain`` dimensionless.
    p : float
        Probability that chance alone gives as much, corrected for the number of joints and of frequencies tried.
    rms_without, rms_with : float
        Root mean square distance (one-joint moves: tangential, of that joint) of poses that were left out of the fit,
        without and with the term, metres.
    at_tool : float
        Root mean square displacement of the targets by the term, beyond what a refit of all else takes over, metres.
    verdict : str
        ``worth it``, ``small`` (significant, but it lowers the error by less than `WORTH`), ``not seen`` (not
        significant, or it does not lower the error of what was left out) or ``not tested``.
    frequency : tuple of float, optional
        Of a Fourier series, periods per turn; with the interval where it was free.
    note : str
        Why it was not tested.
    beside_needed : Term, optional
        The same estimated and tested beside all other terms that the robot needs, where it is one of these and was not
        called worth it when it was tested by itself: their errors had hidden it.
    """

    kind: Kind
    joint: int | None
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    p: float = 1.0
    rms_without: float = np.nan
    rms_with: float = np.nan
    at_tool: float = np.nan
    verdict: Judgement = "not tested"
    frequency: tuple[float, ...] | None = None
    note: str = ""
    beside_needed: Term | None = None

    @property
    def tested(self) -> bool:
        """Whether the data allowed a test."""
        return self.verdict != "not tested"

    @property
    def seen(self) -> bool:
        """Whether it is real, worth having or not."""
        return self.verdict in ("worth it", "small")

    @property
    def shown(self) -> Term:
        """The term as people are told of it: beside the others that the robot needs, where these had hidden it."""
        return self if self.beside_needed is None else self.beside_needed

    def coefficients(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values, strict=True))

    def told(self) -> Sequence[Told]:
        """Its size and its verdict in one sentence."""
        where = "" if self.joint is None else f" of joint {self.joint}"
        if self.note:
            return (f"{self.kind}{where}: not tested: {self.note}",)
        unit, size = unit_of(self)
        values = ", ".join(
            f"{name} {value / size:.4f} ± {(high - low) / 2 / size:.4f}"
            for name, value, low, high in zip(self.names, self.values, self.low, self.high, strict=True)
        )
        unit = "" if unit == "1" else f" {unit}"
        rms = f"left-out rms {self.rms_without / MM:.3f} mm without and {self.rms_with / MM:.3f} mm with it"
        return (f"{self.kind}{where}: {values}{unit}, p = {self.p:.2g}, {rms}: {self.verdict}",)


def unit_of(term: Term, slides: Slides = ()) -> tuple[str, float]:
    """Unit of a term's values outside, and its SI value."""
    if term.kind == "gain":
        return "1", 1.0
    if term.kind == "move":
        return "deg/100 deg", 0.01
    if term.joint is not None and len(slides) and slides[term.joint - 1]:
        return "mm", MM
    return "deg", DEG


def fourier_names(order: int) -> tuple[str, ...]:
    """Names of the coefficients of `fourier_columns`: a1, b1, a2, b2, ..."""
    return tuple(f"{letter}{k}" for k in range(1, order + 1) for letter in "ab")


def fourier_order(term: Term) -> int:
    """Order of a series by the names of its coefficients."""
    return max(int(name[1:]) for name in term.names)


def fourier_columns(q: ArrayLike, order: int, frequency: float) -> FloatArray:
    """Terms of Nubiola 2011, eq. 5.8: cos and sin of k times the frequency times ``q``, shape (n, 2 order)."""
    return np.column_stack(
        [function(k * frequency * np.asarray(q)) for k in range(1, order + 1) for function in (np.cos, np.sin)]
    )


def quantile(freedom: float) -> float:
    """Half-width of the interval in standard deviations (Student)."""
    return student_within(CONFIDENCE, freedom)


def frequencies(extent: float, highest: float) -> FloatArray:
    """Frequencies to try: half a period at least over the range ``extent`` (rad), a quarter of a period apart."""
    step, lowest = np.pi / 2 / extent, max(LOWEST_FREQUENCY, np.pi / extent)
    return np.arange(lowest, max(highest, lowest + 1.5 * step), step)


def best_frequency(misfit: Callable[[float], float], tried: FloatArray) -> float:
    """The frequency with the smallest misfit: the best of those tried, refined between its neighbours.

    So was omega of Nubiola 2011, eq. 5.8, found before it was set to 1 (Table 5.2: 1.001).
    """
    from scipy.optimize import minimize_scalar

    best = tried[int(np.argmin([misfit(f) for f in tried]))]
    step = tried[1] - tried[0]
    bounds = (max(best - step, tried[0]), best + step)
    return float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


def judged(terms: Sequence[Term]) -> list[Term]:
    """Terms of one kind with Holm's correction and verdicts.

    Of n tests, the smallest p value counts n times, the next n - 1 times and so on, none less than the one before it
    (S. Holm, *A simple sequentially rejective multiple test procedure*, 1979).
    """
    tested = [term for term in terms if term.note == ""]
    adjusted, largest = {}, 0.0
    for rank, term in enumerate(sorted(tested, key=lambda term: term.p)):
        largest = min(1.0, max(largest, (len(tested) - rank) * term.p))
        adjusted[id(term)] = largest
    return [replace(t, p=adjusted[id(t)], verdict=_verdict(t, adjusted[id(t)])) if t.note == "" else t for t in terms]


def _verdict(term: Term, p: float) -> Judgement:
    if not p < SIGNIFICANT or term.rms_with >= term.rms_without:
        return "not seen"
    return "worth it" if is_worth(term.rms_without, term.rms_with) else "small"


def is_worth(without: float, with_it: float) -> bool:
    """Whether an rms of poses left out is lower by `WORTH`."""
    return with_it < (1 - WORTH) * without
