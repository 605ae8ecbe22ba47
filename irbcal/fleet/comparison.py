"""What changed between two calibrations of a robot, and which robots of a type stand out of it.

The difference of the parameters that both calibrations have is tested by chi-square on the directions that both have
seen: what the poses do not show (such as joint 1's zero, which turns with the base) has no say. Which parameters
explain it is found one after the other, each as the only change beside those found before: a crash or an exchanged
motor changes few.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.fleet.store import Dated, ParameterList, covariances
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
    """A parameter that changed."""

    name: str
    unit: str
    value: float
    std: float
    """New minus old, SI units."""
    chi2: float
    """By how much it explains the difference."""
    alternatives: tuple[str, ...] = ()
    """Parameters that would explain it about as well."""

    def in_words(self, first: date, second: date) -> str:
        """A sentence."""
        title, cause = called(self.name)
        return (
            f"{title[0].upper()}{title[1:]} moved by {amount(self.value, self.std, self.unit)} between {first} and "
            f"{second}: {cause}?{self._others_in_words()}"
        )

    def _others_in_words(self) -> str:
        if not self.alternatives:
            return ""
        first = " or ".join(called(name)[0] for name in self.alternatives[:2])
        return f" ({first[0].upper()}{first[1:]} would explain it about as well.)"


@dataclass(frozen=True)
class Change:
    """Two calibrations of one robot compared."""

    robot: str
    before: date
    after: date
    chi2: float
    directions: int
    """That both have seen: the degrees of freedom."""
    p: float
    """Probability of so large a difference by chance."""
    parameters: tuple[ParameterChange, ...]
    """The largest first; empty where it is chance."""
    left_p: float
    """Probability of what they leave unexplained."""
    agreeing: tuple[str, ...] = ()
    """Other robots whose calibrations agree with the later one: it may be theirs."""

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
        if self.agreeing:
            names = " and ".join(self.agreeing)
            return [*out, f"The later one agrees with {names}: were the files of two robots exchanged?"]
        out += [parameter.in_words(self.before, self.after) for parameter in self.parameters]
        if self.left_p < CHANCE:
            out.append(f"That does not explain all of it (p = {self.left_p:.2g} of what is left): more has changed.")
        return out


DatedPair: TypeAlias = "tuple[Dated, Dated]"
"""The same estimate of two calibrations."""


def change(first: Dated, second: Dated) -> Change:
    """Compare two calibrations of a robot, see `changes`."""
    return changes([(first, second)])[0]


def changes(pairs: Sequence[DatedPair]) -> list[Change]:
    """Compare two calibrations each of many robots, by the level that both have.

    Averages of many error models cannot be compared parameter by parameter: what one of them explains by a wave
    another explains by weight. The arm's own level, fitted to the points of both, has the same parameters in both.

    Parameters
    ----------
    pairs : sequence of (Dated, Dated)
        Some hundred at most: their covariances need memory.
    """
    out: list[Change | None] = [None] * len(pairs)
    for rows, difference in _differences(pairs):
        for k, row in enumerate(rows):
            first, second = pairs[row]
            chi2, directions, p = float(difference.chi2[k]), int(difference.directions[k]), float(difference.p[k])
            causes: list[ParameterChange] = []
            left_p = p
            if p < CHANCE:
                parameters, W = first.packed.parameters, difference.weight(k)
                causes, remaining = _explained(difference.d[k], W, difference.names, parameters)
                left_p = _beyond(remaining, max(directions - len(causes), 1))
            out[row] = Change(second.robot, first.measured, second.measured, chi2, directions, p, tuple(causes), left_p)
    return [step for step in out if step is not None]


SURELY_ANOTHER = 4.0
"""Chi-square of a single parameter, in that of `CHANCE` on all of them, beyond which a robot is surely another."""


class OthersOfType:
    """Levels of a fleet, in which a calibration is looked for that is like another's.

    Parameters
    ----------
    levels : iterable of Dated
        They may be without their factors.
    """

    def __init__(self, levels: Iterable[Dated]) -> None:
        groups: dict[tuple[str, ParameterList], list[Dated]] = {}
        for level in levels:
            groups.setdefault((level.type, level.packed.parameters), []).append(level)
        self._groups = {key: _LevelGroup(group) for key, group in groups.items()}

    def perhaps_of(self, second: Dated) -> list[Dated]:
        """Calibrations of other robots of the type that may agree with one, by each of their parameters alone.

        What one of the two holds has no say, as in `agreeing`, which needs covariances.
        """
        from scipy.special import chdtri

        level = second.packed
        value, variance = level.numbers("value"), level.numbers("std") ** 2
        limit = SURELY_ANOTHER * float(chdtri(max(len(value), 1), CHANCE))
        out = []
        for (type, parameters), group in self._groups.items():
            if type == second.type:
                places = [level.parameters.column_of.get(name, -1) for name in parameters.names]
                out += group.like(np.append(value, np.nan)[places], np.append(variance, np.nan)[places], limit)
        return [dated for dated in out if dated.robot != second.robot]


class _LevelGroup:
    """Levels with the same parameters: those that scatter most, in their deviations, are looked at first."""

    def __init__(self, levels: Sequence[Dated]) -> None:
        self.levels = levels
        self.values = np.ascontiguousarray(_values(levels).T)
        self.variances = np.ascontiguousarray(_std(levels).T ** 2)
        self.lowest, self.highest = self.variances.min(axis=1), self.variances.max(axis=1)
        spread = np.divide(
            self.values.var(axis=1), self.highest, out=np.zeros(len(self.highest)), where=self.highest > 0.0
        )
        self.order = np.argsort(-spread).tolist()
        self.sorted = {k: np.argsort(self.values[k]) for k in self.order[:1]}

    def like(self, value: FloatArray, variance: FloatArray, limit: float) -> list[Dated]:
        """Those of which no parameter is farther away than a chi-square; not a number where there is none."""
        rows = np.arange(len(self.levels))
        for k, in_order in self.sorted.items():
            if min(self.lowest[k], variance[k]) > ONE_SIDED * max(
                self.highest[k], variance[k]
            ):  # all of them have a say
                far = np.sqrt(limit * (self.highest[k] + variance[k]))
                ends = np.searchsorted(self.values[k], [value[k] - far, value[k] + far], sorter=in_order)
                rows = np.sort(in_order[slice(*ends)])
        for k in self.order:
            theirs = self.variances[k, rows]
            both = np.minimum(theirs, variance[k]) > ONE_SIDED * np.maximum(theirs, variance[k])
            rows = rows[~(both & ((self.values[k, rows] - value[k]) ** 2 > limit * (theirs + variance[k])))]
            if not len(rows):
                break
        return [self.levels[row] for row in rows.tolist()]


def _values(group: Sequence[Dated]) -> FloatArray:
    """Values of estimates with the same parameters, shape (n, k)."""
    return np.frombuffer(b"".join(level.packed.value for level in group), "<f8").reshape(len(group), -1)


def _std(group: Sequence[Dated]) -> FloatArray:
    """Their deviations, shape (n, k)."""
    return np.frombuffer(b"".join(level.packed.std for level in group), "<f4").reshape(len(group), -1).astype(float)


def agreeing(second: Dated, others: Sequence[Dated]) -> tuple[str, ...]:
    """Ids of robots with a calibration that agrees with that of another robot."""
    agree = set()
    for rows, difference in _differences([(level, second) for level in others]):
        like = (difference.directions >= FEWEST_DIRECTIONS) & (difference.p >= CHANCE)
        agree |= {int(row) for row in rows[like]}
    return tuple(dict.fromkeys(others[row].robot for row in sorted(agree)))


def _beyond(chi2: float, directions: int) -> float:
    """Probability of a larger chi-square by chance."""
    from scipy.special import chdtrc

    return float(chdtrc(directions, chi2)) if directions else 1.0


@dataclass(frozen=True, eq=False)
class _Differences:
    """Differences of pairs of estimates: n pairs, k parameters that both have, in natural sizes."""

    names: tuple[str, ...]
    d: FloatArray
    """Shape (n, k)."""
    chi2: FloatArray
    directions: IntArray
    p: FloatArray
    """Shape (n,). Of the directions that both have seen; and the probability of so large a chi-square by chance."""
    variances: FloatArray
    vectors: FloatArray
    """Shapes (n, k) and (n, k, k). Of the sum of the covariances, along its principal directions."""
    keep: BoolArray
    """Shape (n, k). The directions that both have seen."""

    def weight(self, k: int) -> FloatArray:
        """Weight of a pair's differences."""
        U = self.vectors[k][:, self.keep[k]]
        return (U / self.variances[k][self.keep[k]]) @ U.T


def _differences(pairs: Sequence[DatedPair]) -> Iterator[tuple[IntArray, _Differences]]:
    """Differences of pairs, those with the same parameters together; and which pairs they are."""
    groups: dict[tuple[ParameterList, ParameterList], list[int]] = {}
    for row, pair in enumerate(pairs):
        groups.setdefault((pair[0].packed.parameters, pair[1].packed.parameters), []).append(row)
    for lists, rows in groups.items():
        sides = [[pairs[row][side] for row in rows] for side in range(2)]
        yield np.array(rows), _differences_of(lists, sides)


def _differences_of(lists: tuple[ParameterList, ParameterList], sides: Sequence[Sequence[Dated]]) -> _Differences:
    """Differences of n pairs with the same parameters."""
    from scipy.special import chdtrc

    names = tuple(name for name in lists[0].names if name in lists[1].column_of)
    column_lists = [[parameters.column_of[name] for name in names] for parameters in lists]
    size = np.array([lists[0].natural[k] for k in column_lists[0]], dtype=float)
    first, second = (_values(side)[:, columns] for side, columns in zip(sides, column_lists, strict=True))
    d = (second - first) / size
    C = [
        covariances([level.packed.factor for level in side], len(parameters.names))[:, columns][:, :, columns]
        / np.outer(size, size)
        for side, parameters, columns in zip(sides, lists, column_lists, strict=True)
    ]
    values, vectors = np.linalg.eigh(C[0] + C[1])
    variances = np.array([np.einsum("nik,nik->nk", vectors, matrix @ vectors) for matrix in C])
    largest = values.max(axis=1, initial=0.0, keepdims=True)
    keep = (variances.min(axis=0) > ONE_SIDED * variances.max(axis=0)) & (values > HELD * largest)
    along = np.einsum("nik,ni->nk", vectors, d)
    chi2 = np.divide(along**2, values, out=np.zeros_like(along), where=keep).sum(axis=1)
    directions = keep.sum(axis=1)
    p = np.where(directions > 0, chdtrc(np.maximum(directions, 1), chi2), 1.0)
    return _Differences(names, d, chi2, directions, p, values, vectors, keep)


def _explained(
    d: FloatArray, W: FloatArray, names: Sequence[str], parameters: ParameterList
) -> tuple[list[ParameterChange], float]:
    """Parameters whose change explains a difference, one after the other, and the chi-square that is left."""
    from scipy.special import chdtri

    limit = float(chdtri(1, CHANCE / max(len(names), 1)))
    chosen: list[int] = []
    remaining = float(d @ W @ d)
    values, stds, gains, ties = np.zeros(0), np.zeros(0), list[float](), list[tuple[str, ...]]()
    while len(chosen) < MOST_CAUSES:
        candidates = [k for k in range(len(names)) if k not in chosen and W[k, k] > 0.0]
        solutions = dict(zip(candidates, _left(d, W, [[*chosen, k] for k in candidates]), strict=True))
        rests = {k: solution[0] for k, solution in solutions.items() if solution is not None}
        best = min(rests, key=lambda k: rests[k], default=-1)
        if best < 0 or remaining - rests[best] < limit:
            break
        equal = [k for k, chi2 in rests.items() if chi2 < rests[best] + TIE]
        zeros = [k for k in equal if names[k].startswith("delta_theta")]
        best = min(zeros or [best], key=lambda k: rests[k])
        chosen.append(best)
        ties.append(tuple(names[k] for k in sorted(equal, key=lambda k: rests[k]) if k != best))
        gains.append(remaining - rests[best])
        solution = solutions[best]
        assert solution is not None
        remaining, values, stds = solution
    out = []
    for k, value, std, gain, tied in zip(chosen, values, stds, gains, ties, strict=True):
        row = parameters.column_of[names[k]]
        size = parameters.natural[row]
        assert size is not None
        changed, unsure = float(value * size), float(std * size)
        out.append(ParameterChange(names[k], parameters.units[row], changed, unsure, gain, tied))
    return out, remaining


def _left(
    d: FloatArray, W: FloatArray, choices: Sequence[Sequence[int]]
) -> list[tuple[float, FloatArray, FloatArray] | None]:
    """Chi-square that is left where some parameters changed, by how much they did, and its standard deviations.

    Of each of n choices of m parameters; None where these are not known, or cannot be told apart.
    """
    if not choices:
        return []
    chosen = np.array(choices)
    N = W[chosen[:, :, None], chosen[:, None, :]]
    scale = np.sqrt(np.diagonal(N, axis1=1, axis2=2))
    sizes = scale[:, :, None] * scale[:, None, :]
    scaled = N / sizes
    singular = np.linalg.svd(scaled, compute_uv=False)
    apart = singular[:, 0] <= 1e6 * singular[:, -1]
    scaled[~apart] = np.eye(chosen.shape[1])
    inverse = np.linalg.inv(scaled) / sizes
    b = (W @ d)[chosen]
    values = np.einsum("nij,nj->ni", inverse, b)
    stds = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
    rests = d @ W @ d - np.einsum("ni,ni->n", b, values)
    known = apart & (stds.max(axis=1) <= VAGUE)
    return [(float(rests[k]), values[k], stds[k]) if known[k] else None for k in range(len(chosen))]


FEWEST_OF_TYPE = 5
"""Robots of a type that are needed to say what is usual."""
STANDS_OUT = 5.0
"""Standard deviations (of the type and of the identification) from the middle of the type."""
MOST_REASONS = 3
"""Parameters of a robot that are told of."""


@dataclass(frozen=True)
class StandsOut:
    """A robot unlike others of its type."""

    robot: str
    deviations: float
    """The largest."""
    sentence: str


def standing_out(levels: Sequence[Dated], errors: Mapping[str, float | None]) -> list[StandsOut]:
    """Robots of one type that stand out of it, the farthest first; none of fewer than `FEWEST_OF_TYPE`.

    Parameters
    ----------
    levels : sequence of Dated
        One calibration of each robot.
    errors : dict of str to float or None
        Held-out mean error of each robot, mm.
    """
    if len(levels) < FEWEST_OF_TYPE:
        return []
    reasons_of: dict[str, list[tuple[float, str]]] = {}
    groups: dict[ParameterList, list[Dated]] = {}
    for level in levels:
        groups.setdefault(level.packed.parameters, []).append(level)
    arrays = {parameters: (_values(group), _std(group)) for parameters, group in groups.items()}
    for name in sorted({name for parameters in groups for name in parameters.names}):
        having = [(parameters, parameters.column_of[name]) for parameters in groups if name in parameters.column_of]
        values = np.concatenate([arrays[parameters][0][:, k] for parameters, k in having])
        if len(values) < FEWEST_OF_TYPE:
            continue
        stds = np.concatenate([arrays[parameters][1][:, k] for parameters, k in having])
        units = np.concatenate([np.full(len(groups[p]), p.units[k], dtype=object) for p, k in having])
        robots = [level.robot for parameters, _ in having for level in groups[parameters]]
        middle, spread = _middle(values)
        deviation = values - middle
        total = np.sqrt(spread**2 + stds**2)
        far = np.divide(np.abs(deviation), total, out=np.zeros_like(total), where=total > 0.0)
        for row in np.flatnonzero(far > STANDS_OUT):
            text = f"{called(name)[0]} is {amount(deviation[row], total[row], units[row])}"
            reason = float(far[row]), f"{text} from the middle of its type"
            reasons_of.setdefault(robots[row], []).append(reason)
    for robot, z, text in _errors({level.robot: errors.get(level.robot) for level in levels}):
        reasons_of.setdefault(robot, []).append((z, text))
    out = []
    for robot, reasons in reasons_of.items():
        reasons.sort(reverse=True)
        more = f"; and {len(reasons) - MOST_REASONS} more" if len(reasons) > MOST_REASONS else ""
        out.append(StandsOut(robot, reasons[0][0], "; ".join(text for _, text in reasons[:MOST_REASONS]) + more))
    return sorted(out, key=lambda robot_out: -robot_out.deviations)


def _errors(errors: Mapping[str, float | None]) -> list[tuple[str, float, str]]:
    """Robots whose calibrated error is far larger than that of others of the type."""
    errors_above_zero = {robot: error for robot, error in errors.items() if error}
    if len(errors_above_zero) < FEWEST_OF_TYPE:
        return []
    values = np.array(list(errors_above_zero.values()))
    middle, spread = _middle(np.log(values))
    far = (np.log(values) - middle) / max(spread, 0.05)
    usual = float(np.exp(middle))
    return [
        (robot, float(z), f"its held-out mean error is {error:.3f} mm, that of its type {usual:.3f} mm")
        for (robot, error), z in zip(errors_above_zero.items(), far, strict=True)
        if z > STANDS_OUT
    ]


def _middle(values: FloatArray) -> tuple[float, float]:
    """Median, and standard deviation from the median of distances from it."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))
