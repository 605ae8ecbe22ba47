"""What changed between two calibrations of a robot by more than their uncertainty.

The difference of the parameters that both have is tested by chi-square on the directions that both have seen: what the
poses do not show (such as joint 1's zero, which turns with the base) has no say. Which parameters explain it is found
one after the other, each as the only change beside those found before: a crash or an exchanged motor changes few.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.fleet.store import Stored
from irbcal.fleet.words import amount, called, high_wave

SEEN = 0.25
"""Largest share of its prior variance that a direction may keep and count as seen."""
ONE_SIDED = 1e-4
"""A direction of which one calibration knows so much less variance than the other is held in one of them."""
HELD = 1e-10
"""Share of the largest variance below which a direction is held: calibrations keep their covariance in four bytes."""
CHANCE = 0.001
"""Probability of a change to be told of where there is none."""
MOST = 6
"""Parameters that a change is explained by at most."""


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that changed.

    Attributes
    ----------
    name, unit : str
    value, std : float
        New minus old, SI units.
    chi2 : float
        By how much it explains the difference.
    """

    name: str
    unit: str
    value: float
    std: float
    chi2: float

    def in_words(self, before: date, after: date) -> str:
        """A sentence."""
        what, why = called(self.name)
        return (
            f"{what[0].upper()}{what[1:]} moved by {amount(self.value, self.std, self.unit)} between {before} and "
            f"{after}: {why}?"
        )


@dataclass(frozen=True)
class Change:
    """Two calibrations of one robot compared.

    Attributes
    ----------
    before, after : date
    chi2 : float
    directions : int
        That both have seen: the degrees of freedom.
    p : float
        Probability of so large a difference by chance.
    parameters : tuple of ParameterChange
        The largest first; empty where it is chance.
    left_p : float
        Probability of what they leave unexplained.
    """

    before: date
    after: date
    chi2: float
    directions: int
    p: float
    parameters: tuple[ParameterChange, ...]
    left_p: float

    @property
    def real(self) -> bool:
        """Whether it is beyond chance."""
        return self.p < CHANCE

    def in_words(self) -> list[str]:
        """What changed, or that nothing did."""
        test = f"chi-square {self.chi2:.1f} on {self.directions} directions that both have seen, p = {self.p:.2g}"
        if not self.directions:
            return [f"{self.before} to {self.after}: the two calibrations have seen nothing in common."]
        if not self.real:
            return [f"{self.before} to {self.after}: no change beyond the uncertainty ({test})."]
        out = [f"{self.before} to {self.after}: CHANGED ({test})."]
        out += [item.in_words(self.before, self.after) for item in self.parameters]
        if self.left_p < CHANCE:
            out.append(f"That does not explain all of it (p = {self.left_p:.2g} of what is left): more has changed.")
        return out


def change(before: Stored, after: Stored) -> Change:
    """Compare two calibrations of a robot.

    Parameters
    ----------
    before, after : Stored

    Returns
    -------
    Change
    """
    from scipy.special import chdtrc

    names = [name for name in before.names if _shown(name, before) and _shown(name, after)]
    d, W, seen = _difference(before, after, names)
    chi2 = float(d @ W @ d)
    p = float(chdtrc(seen, chi2)) if seen else 1.0
    found: list[ParameterChange] = []
    left, left_p = chi2, p
    if p < CHANCE:
        found, left = _explained(d, W, names, before)
        left_p = float(chdtrc(max(seen - len(found), 1), left))
    return Change(before.measured, after.measured, chi2, seen, p, tuple(found), left_p)


def _shown(name: str, one: Stored) -> bool:
    """Whether a calibration's data tell of a parameter: else it stays where it was expected, and has no say."""
    k = one.place.get(name)
    return k is not None and not high_wave(name) and bool(one.covariance[k, k] < SEEN * one.prior[k] ** 2)


def _difference(before: Stored, after: Stored, names: list[str]) -> tuple[FloatArray, FloatArray, int]:
    """Differences in natural sizes, their weight on the seen directions, and how many these are."""
    rows = [[one.place[name] for name in names] for one in (before, after)]
    size = before.natural[rows[0]]
    d = (after.values[rows[1]] - before.values[rows[0]]) / size
    C = [one.covariance[np.ix_(r, r)] / np.outer(size, size) for one, r in zip((before, after), rows, strict=True)]
    for k, one in enumerate((before, after)):
        if not np.isfinite(one.prior).any():  # levels count the points of a pose as if they were independent
            C[k] *= one.calibration["points_per_pose"]
    V = C[0] + C[1]
    priors = [one.prior[r] / size for one, r in zip((before, after), rows, strict=True)]
    scale = np.sqrt(np.where(np.isfinite(priors).all(axis=0), np.square(priors).sum(axis=0), 1.0))
    values, vectors = np.linalg.eigh(V / np.outer(scale, scale))
    directions = vectors / scale[:, None]
    own = np.array([np.einsum("ik,ij,jk->k", directions, part, directions) for part in C])
    keep = (own.min(axis=0) > ONE_SIDED * own.max(axis=0)) & (values > HELD * values.max(initial=0.0))
    for part, prior in zip(own, priors, strict=True):
        if np.isfinite(prior).all():
            keep &= part < SEEN * np.einsum("ik,i->k", directions**2, prior**2)
    U = directions[:, keep]
    return d, (U / values[keep]) @ U.T, int(keep.sum())


def _explained(d: FloatArray, W: FloatArray, names: list[str], before: Stored) -> tuple[list[ParameterChange], float]:
    """Parameters whose change explains a difference, one after the other, and the chi-square that is left."""
    from scipy.special import chdtri

    limit = float(chdtri(1, CHANCE / max(len(names), 1)))
    taken: list[int] = []
    left = float(d @ W @ d)
    values, stds, gains = np.zeros(0), np.zeros(0), list[float]()
    while len(taken) < MOST:
        best, best_left = -1, left
        for k in range(len(names)):
            if k not in taken and W[k, k] > 0.0:
                rest = _left(d, W, [*taken, k])
                if rest is not None and rest[0] < best_left:
                    best, best_left = k, rest[0]
        if best < 0 or left - best_left < limit:
            break
        taken.append(best)
        gains.append(left - best_left)
        found = _left(d, W, taken)
        assert found is not None
        left, values, stds = found
    out = []
    for k, value, std, gain in zip(taken, values, stds, gains, strict=True):
        row = before.place[names[k]]
        size = before.natural[row]
        out.append(ParameterChange(names[k], before.units[row], float(value * size), float(std * size), gain))
    return out, left


def _left(d: FloatArray, W: FloatArray, taken: list[int]) -> tuple[float, FloatArray, FloatArray] | None:
    """Chi-square that is left where some parameters changed, by how much they did, and its standard deviations."""
    N = W[np.ix_(taken, taken)]
    scale = np.sqrt(np.diagonal(N))
    scaled = N / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e6:  # cannot be told apart
        return None
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    values = inverse @ (W[taken] @ d)
    return float(d @ W @ d - (W[taken] @ d) @ values), values, np.sqrt(np.diagonal(inverse))
