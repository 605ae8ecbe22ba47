"""One non-geometric effect of a joint: its size with an interval, a test, and whether it is worth having."""

from dataclasses import dataclass, replace

import numpy as np

CONFIDENCE, SIGNIFICANT = 0.95, 0.05
WORTH = 0.02
"""Share by which a term must lower the rms of poses left out of the fit to be called worth it."""

LOWEST_FREQUENCY, HIGHEST_FREQUENCY = 0.5, 120.0
"""Periods per turn between which a free frequency is looked for."""


@dataclass(frozen=True)
class Term:
    """One non-geometric effect: its size, whether it is real, and whether it is worth having.

    Attributes
    ----------
    kind : str
        ``backlash`` (reached from above minus from below), ``move`` (error per radian of the last move), ``gain``
        (eq. 3.31), ``fourier`` (eq. 5.8), ``gravity`` (one period a turn for each home pose of joints 2 and 3) or
        ``stiffness`` (A and B, see `irbcal.modeling.joint_map`).
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
    """

    kind: str
    joint: int | None
    names: tuple = ()
    values: tuple = ()
    low: tuple = ()
    high: tuple = ()
    p: float = 1.0
    rms_without: float = np.nan
    rms_with: float = np.nan
    at_tool: float = np.nan
    verdict: str = "not tested"
    frequency: tuple | None = None
    note: str = ""

    @property
    def tested(self):
        """Whether the data allowed a test."""
        return self.verdict != "not tested"

    def coefficients(self):
        """Values by name."""
        return dict(zip(self.names, self.values, strict=True))


def fourier_names(order):
    """Names of the coefficients of a series: a1, b1, a2, b2, ..."""
    return tuple(f"{letter}{k}" for k in range(1, order + 1) for letter in "ab")


def fourier_columns(q, order, frequency):
    """Terms cos and sin of k times the frequency times ``q``, shape (n, 2 order)."""
    return np.column_stack(
        [function(k * frequency * np.asarray(q)) for k in range(1, order + 1) for function in (np.cos, np.sin)]
    )


def quantile(freedom):
    """Half-width of the interval in standard deviations (Student)."""
    from scipy.stats import t as student

    return float(student.ppf(0.5 + CONFIDENCE / 2, freedom))


def frequencies(extent, highest):
    """Frequencies to try: half a period at least over the range ``extent`` (rad), a quarter of a period apart."""
    step, lowest = np.pi / 2 / extent, max(LOWEST_FREQUENCY, np.pi / extent)
    return np.arange(lowest, max(highest, lowest + 1.5 * step), step)


def best_frequency(misfit, tried):
    """The frequency with the smallest misfit: the best of those tried, refined between its neighbours."""
    from scipy.optimize import minimize_scalar

    best = tried[int(np.argmin([misfit(f) for f in tried]))]
    step = tried[1] - tried[0]
    bounds = (max(best - step, tried[0]), best + step)
    return float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


def judged(terms):
    """Terms of one kind with Holm's correction and verdicts."""
    tested = [term for term in terms if term.note == ""]
    adjusted, largest = {}, 0.0
    for rank, term in enumerate(sorted(tested, key=lambda term: term.p)):
        largest = min(1.0, max(largest, (len(tested) - rank) * term.p))
        adjusted[id(term)] = largest
    return [replace(t, p=adjusted[id(t)], verdict=_verdict(t, adjusted[id(t)])) if t.note == "" else t for t in terms]


def _verdict(term, p):
    if not p < SIGNIFICANT or term.rms_with >= term.rms_without:
        return "not seen"
    return "worth it" if term.rms_with < (1 - WORTH) * term.rms_without else "small"
