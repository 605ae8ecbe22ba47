"""What changed between two calibrations of a robot, and which robots of a type stand out of it.

The difference of the parameters that both calibrations have is tested by chi-square on the directions that both have
seen: what the poses do not show (such as joint 1's zero, which turns with the base) has no say. Which parameters
explain it is found one after the other, each as the only change beside those found before: a crash or an exchanged
motor changes few.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.fleet.store import Estimate, Stored
from irbcal.units import DEG, MM

DHM = {
    "theta": ("joint {j}'s zero", "a crash, an exchanged motor or a lost zero"),
    "d": ("the length along joint {j}'s axis", "a crash or an exchanged link"),
    "a": ("the length of link {j}", "a crash or an exchanged link"),
    "alpha": ("the tilt between joints {j} and {k}", "a crash or an exchanged bearing"),
    "beta": ("the tilt of joint {j}'s axis", "a crash or an exchanged bearing"),
    "b": ("the offset of joint {j}'s axis", "a crash or an exchanged link"),
}
FAMILIES = (
    ("gravity", "how joint {j} gives way under weight", "a worn or exchanged gear, a bearing, a balancer"),
    ("torque", "how joint {j} gives way under torque", "a worn or exchanged gear"),
    ("direction", "the backlash of joint {j}", "a worn or exchanged gear"),
    ("payload", "how joint {j} gives way under a payload", "a worn or exchanged gear"),
    ("angle", "the gain of joint {j}", "an exchanged gear or resolver"),
    ("sin", "a wave of joint {j}", "an exchanged gear or resolver"),
    ("cos", "a wave of joint {j}", "an exchanged gear or resolver"),
)
UNITS = {"rad": ("degrees", DEG), "m": ("mm", MM)}
_CONSTANT = re.compile(r"delta_([a-z]+)(\d+)")
_TERM = re.compile(r"[a-z]+(\d+)(?:\+\d+)* (\S+)")


HIGHEST = 6
"""Cycles per turn up to which a wave is compared: which higher ones a model has is chance from fit to fit."""
_WAVE = re.compile(r"[a-z]+[0-9+]+ (?:sin|cos) (\d+)(?: \w+)?")


def high_wave(name: str) -> bool:
    """Whether a term is a wave of more than `HIGHEST` cycles per turn."""
    wave = _WAVE.fullmatch(name)
    return wave is not None and int(wave[1]) > HIGHEST


def called(name: str) -> tuple[str, str]:
    """A parameter in words, and what may have changed it."""
    constant = _CONSTANT.fullmatch(name)
    if constant and constant[1] in DHM:
        title, cause = DHM[constant[1]]
        joint = int(constant[2])
        return title.format(j=joint, k=joint + 1), cause
    term = _TERM.match(name)
    if term:
        for basis, title, cause in FAMILIES:
            if term[2].startswith(basis):
                return f"{title.format(j=term[1])} ({name})", cause
    return name, "wear, a crash or a repair"


def amount(value: float, std: float, unit: str) -> str:
    """``0.021 ± 0.004 degrees`` of a value in SI units."""
    base, _, per = unit.partition("/")
    unit_shown, factor = UNITS.get(base, (base, 1.0))
    value, std = abs(value) / factor, std / factor
    digits = max(0, 1 - int(f"{std:e}".partition("e")[2])) if std > 0.0 else 6
    tail = f" per {per}" if per else ""
    return f"{value:.{digits}f} ± {std:.{digits}f} {'' if unit_shown == '1' else unit_shown}{tail}".rstrip()


ONE_SIDED = 1e-4
"""A direction of which one calibration knows so much less variance than the other is held in one of them."""
HELD = 1e-10
"""Share of the largest variance below which a direction is held: what is left there is rounding."""
CHANCE = 0.001
"""Probability of a change to be told of where there is none."""
VAGUE = 10.0
"""Natural sizes that a parameter's change must be known to: what the poses do not show would explain anything by
changes without bound."""
MOST_CAUSES = 6
"""Parameters that a change is explained by at most."""
FEWEST_DIRECTIONS = 10
"""Directions that both must have seen for two calibrations to be called those of one robot."""
TIE = 9.0
"""Chi-square by which one explanation must be better than another to be told from it. Where they are equal a zero is
taken: zeros change more often than lengths."""


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
    others : tuple of str
        Parameters that would explain it about as well.
    """

    name: str
    unit: str
    value: float
    std: float
    chi2: float
    others: tuple[str, ...] = ()

    def in_words(self, first: date, second: date) -> str:
        """A sentence."""
        title, cause = called(self.name)
        return (
            f"{title[0].upper()}{title[1:]} moved by {amount(self.value, self.std, self.unit)} between {first} and "
            f"{second}: {cause}?{self._others_in_words()}"
        )

    def _others_in_words(self) -> str:
        if not self.others:
            return ""
        first = " or ".join(called(name)[0] for name in self.others[:2])
        return f" (Hardly to be told from {first}.)"


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
    sisters : tuple of str
        Other robots whose calibrations agree with the later one: it may be theirs.
    """

    before: date
    after: date
    chi2: float
    directions: int
    p: float
    parameters: tuple[ParameterChange, ...]
    left_p: float
    sisters: tuple[str, ...] = ()

    @property
    def real(self) -> bool:
        """Whether it is beyond chance."""
        return self.p < CHANCE

    def in_words(self) -> list[str]:
        """What changed, or that nothing did."""
        test = f"chi-square {self.chi2:.1f} on {self.directions} directions that both have seen, p = {self.p:.2g}"
        if not self.directions:
            return [f"{self.before} to {self.after}: cannot be compared (no points saved, or nothing seen in common)."]
        if not self.real:
            return [f"{self.before} to {self.after}: no change beyond the uncertainty ({test})."]
        out = [f"{self.before} to {self.after}: CHANGED ({test})."]
        if self.sisters:
            names = " and ".join(self.sisters)
            return [*out, f"The later one agrees with {names}: were the files of two robots exchanged?"]
        out += [parameter.in_words(self.before, self.after) for parameter in self.parameters]
        if self.left_p < CHANCE:
            out.append(f"That does not explain all of it (p = {self.left_p:.2g} of what is left): more has changed.")
        return out


def change(first: Stored, second: Stored) -> Change:
    """Compare two calibrations of a robot, by the level that both have.

    Averages of many error models cannot be compared parameter by parameter: what one of them explains by a wave
    another explains by weight. The arm's own level, fitted to the points of both, has the same parameters in both.

    Parameters
    ----------
    first, second : Stored
    """
    dates = first.measured, second.measured
    if first.level is None or second.level is None:
        return Change(*dates, 0.0, 0, 1.0, (), 1.0)
    names = [name for name in first.level.names if name in second.level.place]
    d, W, chi2, directions, p = _difference(first.level, second.level, names)
    causes: list[ParameterChange] = []
    remaining, left_p = chi2, p
    if p < CHANCE:
        causes, remaining = _explained(d, W, names, first.level)
        left_p = _beyond(remaining, max(directions - len(causes), 1))
    return Change(*dates, chi2, directions, p, tuple(causes), left_p)


SURELY_ANOTHER = 4.0
"""Chi-square of a single parameter, in that of `CHANCE` on all of them, beyond which a robot is surely another."""


def perhaps_of(second: Stored, fleet: Sequence[Stored]) -> list[Stored]:
    """Calibrations of other robots of a type that may agree with one, by each of their parameters alone.

    What one of the two holds has no say, as in `agreeing`, which needs covariances.

    Parameters
    ----------
    second : Stored
    fleet : sequence of Stored
        Their levels may be without covariances.
    """
    from scipy.special import chdtri

    robot, level = second.robot, second.level
    assert level is not None
    limit = SURELY_ANOTHER * float(chdtri(max(len(level.names), 1), CHANCE))
    others = [
        (stored, stored.level)
        for stored in fleet
        if stored.robot["type"] == robot["type"] and stored.robot["id"] != robot["id"] and stored.level is not None
    ]
    by_names: dict[tuple[str, ...], list[tuple[Stored, Estimate]]] = {}
    for stored, estimate in others:
        by_names.setdefault(estimate.names, []).append((stored, estimate))
    out = []
    for names, entries in by_names.items():
        common = [name for name in names if name in level.place]
        mine, theirs = ([place[name] for name in common] for place in (level.place, entries[0][1].place))
        d = np.array([estimate.values[theirs] for _, estimate in entries]) - level.values[mine]
        variances = np.array([estimate.std[theirs] for _, estimate in entries]) ** 2
        own = level.std[mine] ** 2
        both = np.minimum(variances, own) > ONE_SIDED * np.maximum(variances, own)
        chi2 = np.divide(d**2, variances + own, out=np.zeros_like(d), where=both)
        out += [entries[k][0] for k in np.flatnonzero(chi2.max(axis=1, initial=0.0) <= limit)]
    return out


def agreeing(second: Stored, others: Iterable[Stored]) -> tuple[str, ...]:
    """Ids of robots with a calibration that agrees with that of another robot."""
    names = dict[str, None]()
    for stored in others:
        assert second.level is not None
        assert stored.level is not None
        common = [name for name in stored.level.names if name in second.level.place]
        *_, directions, p = _difference(stored.level, second.level, common)
        if directions >= FEWEST_DIRECTIONS and p >= CHANCE:
            names[str(stored.robot["id"])] = None
    return tuple(names)


def _beyond(chi2: float, directions: int) -> float:
    """Probability of a larger chi-square by chance."""
    from scipy.special import chdtrc

    return float(chdtrc(directions, chi2)) if directions else 1.0


def _difference(
    first: Estimate, second: Estimate, names: list[str]
) -> tuple[FloatArray, FloatArray, float, int, float]:
    """Differences in natural sizes, their weight, chi-square, its degrees of freedom, and its probability by chance.

    What counts are the directions that both have seen.
    """
    rows = [[estimate.place[name] for name in names] for estimate in (first, second)]
    size = first.natural[rows[0]]
    d = (second.values[rows[1]] - first.values[rows[0]]) / size
    C = [
        estimate.covariance[np.ix_(r, r)] / np.outer(size, size)
        for estimate, r in zip((first, second), rows, strict=True)
    ]
    values, vectors = np.linalg.eigh(C[0] + C[1])
    variances = np.array([np.einsum("ik,ij,jk->k", vectors, matrix, vectors) for matrix in C])
    keep = (variances.min(axis=0) > ONE_SIDED * variances.max(axis=0)) & (values > HELD * values.max(initial=0.0))
    U = vectors[:, keep]
    W, directions = (U / values[keep]) @ U.T, int(keep.sum())
    chi2 = float(d @ W @ d)
    return d, W, chi2, directions, _beyond(chi2, directions)


def _explained(d: FloatArray, W: FloatArray, names: list[str], first: Estimate) -> tuple[list[ParameterChange], float]:
    """Parameters whose change explains a difference, one after the other, and the chi-square that is left."""
    from scipy.special import chdtri

    limit = float(chdtri(1, CHANCE / max(len(names), 1)))
    chosen: list[int] = []
    remaining = float(d @ W @ d)
    values, stds, gains, ties = np.zeros(0), np.zeros(0), list[float](), list[tuple[str, ...]]()
    while len(chosen) < MOST_CAUSES:
        rests = {}
        for k in range(len(names)):
            if k not in chosen and W[k, k] > 0.0 and (fit_left := _left(d, W, [*chosen, k])) is not None:
                rests[k] = fit_left[0]
        best = min(rests, key=lambda k: rests[k], default=-1)
        if best < 0 or remaining - rests[best] < limit:
            break
        equal = [k for k, chi2 in rests.items() if chi2 < rests[best] + TIE]
        zeros = [k for k in equal if names[k].startswith("delta_theta")]
        best = min(zeros or [best], key=lambda k: rests[k])
        chosen.append(best)
        ties.append(tuple(names[k] for k in sorted(equal, key=lambda k: rests[k]) if k != best))
        gains.append(remaining - rests[best])
        solution = _left(d, W, chosen)
        assert solution is not None
        remaining, values, stds = solution
    out = []
    for k, value, std, gain, tied in zip(chosen, values, stds, gains, ties, strict=True):
        row = first.place[names[k]]
        size = first.natural[row]
        out.append(ParameterChange(names[k], first.units[row], float(value * size), float(std * size), gain, tied))
    return out, remaining


def _left(d: FloatArray, W: FloatArray, chosen: list[int]) -> tuple[float, FloatArray, FloatArray] | None:
    """Chi-square that is left where some parameters changed, by how much they did, and its standard deviations.

    None where these are not known, or cannot be told apart.
    """
    N = W[np.ix_(chosen, chosen)]
    scale = np.sqrt(np.diagonal(N))
    scaled = N / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e6:  # cannot be told apart
        return None
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    values, stds = inverse @ (W[chosen] @ d), np.sqrt(np.diagonal(inverse))
    return None if stds.max() > VAGUE else (float(d @ W @ d - (W[chosen] @ d) @ values), values, stds)


FEWEST_SISTERS = 5
"""Sisters that are needed to say what is usual."""
STANDS_OUT = 5.0
"""Standard deviations (of sisters and of the identification) from the middle of the sisters."""
MOST_REASONS = 3
"""Parameters of a robot that are told of."""


@dataclass(frozen=True)
class StandsOut:
    """A robot unlike its sisters.

    Attributes
    ----------
    robot : str
    deviations : float
        The largest.
    words : str
    """

    robot: str
    deviations: float
    words: str


def standing_out(sisters: Sequence[Stored]) -> list[StandsOut]:
    """Robots of one type that stand out of it, the farthest first; none of fewer than `FEWEST_SISTERS` sisters.

    Parameters
    ----------
    sisters : sequence of Stored
        One calibration of each robot.
    """
    if len(sisters) < FEWEST_SISTERS:
        return []
    reasons_of: dict[str, list[tuple[float, str]]] = {}
    levels = [(stored, stored.level) for stored in sisters if stored.level is not None]
    for name in sorted({name for _, level in levels for name in level.names}):
        having = [(stored, level, level.place[name]) for stored, level in levels if name in level.place]
        if len(having) < FEWEST_SISTERS:
            continue
        values = np.array([level.values[k] for _, level, k in having])
        stds = np.array([level.std[k] for _, level, k in having])
        middle, spread = _middle(values)
        deviation = values - middle
        total = np.sqrt(spread**2 + stds**2)
        far = np.divide(np.abs(deviation), total, out=np.zeros_like(total), where=total > 0.0)
        for (one, level, k), value, std, z in zip(having, deviation, total, far, strict=True):
            if z > STANDS_OUT:
                text = f"{called(name)[0]} is {amount(value, std, level.units[k])} from the middle of its sisters"
                reasons_of.setdefault(one.robot["id"], []).append((float(z), text))
    for one, z, text in _errors(sisters):
        reasons_of.setdefault(one.robot["id"], []).append((z, text))
    out = []
    for robot, reasons in reasons_of.items():
        reasons.sort(reverse=True)
        more = f"; and {len(reasons) - MOST_REASONS} more" if len(reasons) > MOST_REASONS else ""
        out.append(StandsOut(robot, reasons[0][0], "; ".join(text for _, text in reasons[:MOST_REASONS]) + more))
    return sorted(out, key=lambda robot_out: -robot_out.deviations)


def _errors(sisters: Sequence[Stored]) -> list[tuple[Stored, float, str]]:
    """Robots whose calibrated error is far larger than their sisters'."""
    with_errors = [stored for stored in sisters if stored.calibration["heldout_mean_mm"]]
    if len(with_errors) < FEWEST_SISTERS:
        return []
    errors = np.array([stored.calibration["heldout_mean_mm"] for stored in with_errors])
    middle, spread = _middle(np.log(errors))
    far = (np.log(errors) - middle) / max(spread, 0.05)
    usual = float(np.exp(middle))
    return [
        (stored, float(z), f"its held-out mean error is {error:.3f} mm, that of its sisters {usual:.3f} mm")
        for stored, error, z in zip(with_errors, errors, far, strict=True)
        if z > STANDS_OUT
    ]


def _middle(values: FloatArray) -> tuple[float, float]:
    """Median, and standard deviation from the median of distances from it."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))
