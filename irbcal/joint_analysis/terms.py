"""One non-geometric effect of a joint: its size with an interval, and what the data say of it; frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.distributions import student_within
from irbcal.identification.fit_sections import LEAST_SHIFT, NATS
from irbcal.summary import Paragraph, Result, Table, TableValue
from irbcal.units import MM, joint_unit
from irbcal.wording import inflected, joined

CONFIDENCE = 0.95

LOWEST_FREQUENCY, HIGHEST_FREQUENCY = 0.5, 120.0
"""Periods per turn between which a free frequency is looked for."""

EffectKind: TypeAlias = Literal["backlash", "move", "gain", "fourier", "gravity", "stiffness"]
Judgement: TypeAlias = Literal["needed", "not needed", "not tested"]


@dataclass(frozen=True, repr=False)
class JointTerm(Result):
    """One non-geometric effect: its size, and whether the joint needs it."""

    kind: EffectKind
    """``backlash`` (reached from above minus from below, Nubiola 2011, section 4.2), ``move`` (error per radian of the
    last move), ``gain`` (eq. 3.31), ``fourier`` (section 5.2), ``gravity`` (one period a turn for each home pose of
    joints that lift the arm; of any poses the levers of the links) or ``stiffness`` (A and B, see
    `irbcal.modeling.thesis_map`).
    """
    joint: int | None
    """Counted from 1; None for the stiffness of joints 2 and 3."""
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    """Estimates and their 95 % intervals; radians (metres for prismatic joints), ``move`` and ``gain`` dimensionless.
    """
    evidence: float = np.nan
    """Log evidence with the term minus without it, nats; less what the search for a free frequency costs."""
    moves: float = np.nan
    """Root mean square distance by which the fitted points move without it, metres."""
    frequency: tuple[float, ...] | None = None
    """Of a Fourier series, periods per turn; of one-joint moves with the interval where it was free."""
    note: str = ""
    """Why it was not tested."""
    prismatic: bool = False
    """Whether the joint is."""

    CONTENT = "kind joint unit values=estimates log_evidence=evidence probability moves_mm verdict frequency note"

    @property
    def tested(self) -> bool:
        """Whether the data allowed a test."""
        return not self.note

    @property
    def needed(self) -> bool:
        """Whether the joint needs it: the evidence is worth `NATS`, and points move by `LEAST_SHIFT` without it."""
        return self.tested and self.evidence >= NATS and self.moves >= LEAST_SHIFT

    @property
    def probability(self) -> float:
        """That the joint needs it, where it was as likely as not before the measurements."""
        return float(1.0 / (1.0 + np.exp(-np.clip(self.evidence, -700.0, 700.0))))

    @property
    def verdict(self) -> Judgement:
        """In words."""
        return "needed" if self.needed else "not needed" if self.tested else "not tested"

    @property
    def unit(self) -> str:
        """Unit of its values outside."""
        return self.unit_and_size[0]

    @property
    def unit_and_size(self) -> tuple[str, float]:
        """Unit of its values outside, and its SI value."""
        if self.kind == "gain":
            return "1", 1.0
        unit, size = joint_unit(self.prismatic)
        return (f"{unit}/100 {unit}", 0.01) if self.kind == "move" else (unit, size)

    def coefficients(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values, strict=True))

    def estimates(self) -> dict[str, dict[str, float]]:
        """Value and ends of its interval by name, in `unit`; empty where it was not tested."""
        size = self.unit_and_size[1]
        intervals = zip(self.values, self.low, self.high, strict=True)
        return {
            name: {"value": value / size, "low": low / size, "high": high / size}
            for name, (value, low, high) in zip(self.names, intervals, strict=False)
        }

    def report(self) -> Sequence[Paragraph]:
        """Its size and its verdict in one sentence."""
        where = "" if self.joint is None else f" of joint {self.joint}"
        if self.note:
            return (f"{self.kind}{where}: not tested: {self.note}",)
        unit, size = self.unit_and_size
        values = ", ".join(
            f"{name} {plus_minus(value, low, high, size)}"
            for name, value, low, high in zip(self.names, self.values, self.low, self.high, strict=True)
        )
        unit = "" if unit == "1" else f" {unit}"
        return (f"{self.kind}{where}: {values}{unit}: {evidence_in_words(self)}",)


def fourier_names(order: int) -> tuple[str, ...]:
    """Names of the coefficients of `fourier_columns`: a1, b1, a2, b2, ..."""
    return tuple(f"{letter}{k}" for k in range(1, order + 1) for letter in "ab")


def fourier_order(term: JointTerm) -> int:
    """Order of a series by the names of its coefficients."""
    return max(int(name[1:]) for name in term.names)


def fourier_columns(q: ArrayLike, order: int, frequency: float) -> FloatArray:
    """Columns of Nubiola 2011, eq. 5.8: cos and sin of k times the frequency times ``q``, shape (n, 2 order)."""
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


def best_frequency(misfit: Callable[[float], float], frequencies: FloatArray) -> float:
    """The frequency with the smallest misfit: the best of those tried, refined between its neighbours.

    So was omega of Nubiola 2011, eq. 5.8, found before it was set to 1 (Table 5.2: 1.001).
    """
    from scipy.optimize import minimize_scalar

    best = frequencies[int(np.argmin([misfit(f) for f in frequencies]))]
    step = frequencies[1] - frequencies[0]
    bounds = (max(best - step, frequencies[0]), best + step)
    return float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


SLOWEST = 0.05
"""Smallest frequency that is looked at, periods per turn: below it a series is a constant and a slope."""

WIDER = 1.6
"""Factor of the steps by which the end of the interval is looked for."""


def interval(
    x: FloatArray,
    y: FloatArray,
    covariance: FloatArray,
    beside: FloatArray,
    order: int,
    tried: FloatArray,
    best: float,
    freedom: int,
) -> tuple[float, float, float]:
    """The best frequency of a series and its 95 % interval by likelihood ratio.

    Parameters
    ----------
    x, y : ndarray, shape (r,)
        Joint angles and angular errors, radians.
    covariance : ndarray, shape (r, r)
        Of ``y``.
    beside : ndarray, shape (r, k)
        Columns that are fitted beside the series, such as its constant.
    order : int
    tried : ndarray
        Frequencies among which the best was looked for, periods per turn, ascending.
    best : float
        Near the best.
    freedom : int
        Degrees of freedom of the scale of ``covariance``.

    Returns
    -------
    found, low, high : float
        Periods per turn. Where nothing refuses the smallest frequency, ``low`` is 0; ``high`` ends at the largest that
        the steps between the angles allow.
    """
    from scipy.optimize import brentq, minimize_scalar

    root = np.linalg.cholesky(covariance)
    z, Z = np.linalg.solve(root, y), np.linalg.solve(root, beside)

    def misfit(f: float) -> float:
        M = np.column_stack([Z, np.linalg.solve(root, fourier_columns(x, order, f))])
        Q, R = np.linalg.qr(M)
        size = np.abs(np.diag(R))
        Q = Q[:, size > 1e-9 * size.max()]
        residual = z - Q @ (Q.T @ z)
        return float(residual @ residual)

    step, highest = float(tried[1] - tried[0]), float(max(tried[-1], best))
    bounds = (max(SLOWEST, best - 0.5 * step), min(highest, best + 0.5 * step))
    nearest = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    best_f = float(nearest.x) if nearest.fun <= misfit(best) else best
    limit = misfit(best_f) + quantile(freedom) ** 2

    def over(f: float) -> float:
        return misfit(f) - limit

    accepted = [float(f) for f in tried if over(f) <= 0.0]
    for ratio in sorted({k / m for k in range(1, order + 1) for m in range(1, order + 1)} - {1.0}):
        near = ratio * best_f  # harmonics of the one may be those of the other
        ends = (max(SLOWEST, near - 0.5 * step), min(highest, near + 0.5 * step))
        if ends[0] < ends[1]:
            other = minimize_scalar(misfit, bounds=ends, method="bounded", options={"xatol": 1e-7})
            accepted += [float(other.x)] if other.fun <= limit else []
    low, high = min([best_f, *accepted]), max([best_f, *accepted])
    first = _scale(misfit, best_f, limit, step)
    return best_f, _end(over, low, -first, SLOWEST, brentq), _end(over, high, first, highest, brentq)


def _scale(misfit: Callable[[float], float], best_f: float, limit: float, step: float) -> float:
    """A step that is of the size of the interval, from the curvature at the best frequency."""
    h = 1e-3 * step
    bend = (misfit(best_f + h) + misfit(best_f - h) - 2 * misfit(best_f)) / h**2
    return min(step, np.sqrt(2 * (limit - misfit(best_f)) / bend) / 2) if bend > 0 else step


def _end(over: Callable[[float], float], start: float, step: float, last: float, root: Callable[..., float]) -> float:
    """Where an accepted frequency's interval ends in the direction of a step, at last at ``last`` (below: 0)."""
    inner = start
    while True:
        outer = inner + step
        if (outer - last) * step >= 0:
            return (0.0 if step < 0 else last) if over(last) <= 0 else float(root(over, inner, last, xtol=1e-9))
        if over(outer) > 0:
            return float(root(over, inner, outer, xtol=1e-9))
        inner, step = outer, WIDER * step


def not_tested(terms: Sequence[JointTerm], source: str) -> list[str]:
    """One sentence for each reason, with its joints."""
    reasons: dict[tuple[str, str], list[int | None]] = {}
    for term in terms:
        if term.note and term.kind not in ("gain", "move"):
            reasons.setdefault((name_of(term), term.note), []).append(term.joint)
    return [f"{name}{of_joints(joints)} not tested by {source}: {note}" for (name, note), joints in reasons.items()]


def of_joints(joints: Sequence[int | None]) -> str:
    """Joints in words: `` of joints 1, 2 and 3``; empty for the stiffness alone."""
    if list(joints) == [None]:
        return ""
    return f" of {inflected(len(joints), 'joint')} {joined([str(joint) for joint in joints])}"


def plus_minus(value: float, low: float, high: float, size: float, digits: int = 4) -> str:
    """A value with half its interval, in a unit."""
    return f"{rounded(value / size, digits)} ± {(high - low) / 2 / size:.{digits}f}"


def rounded(value: float, digits: int) -> str:
    """A number with some decimals; what rounds to zero has no sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def evidence_in_words(term: JointTerm) -> str:
    """What the data say of a term."""
    return f"log evidence {term.evidence:+.1f}, points move by {term.moves / MM:.3f} mm without it: {term.verdict}"


def name_of(term: JointTerm) -> str:
    """A term in words."""
    if term.kind == "fourier":
        return f"Fourier series of order {fourier_order(term)}{frequency_text(term)}"
    names = {"backlash": "backlash", "gain": "gain error", "gravity": "bending under gravity"}
    return names.get(term.kind, "arm stiffness")


def frequency_text(term: JointTerm) -> str:
    """A series's frequency in words; empty for one period a turn."""
    if not term.frequency or term.frequency == (1.0,):
        return ""
    if len(term.frequency) == 1:
        return f" at {term.frequency[0]:.4g} periods per turn"
    frequency, low, high = term.frequency
    return f" at {frequency:.4g} ({low:.4g} to {high:.4g}) periods per turn (free)"


def play_in_words(term: JointTerm) -> str:
    """A joint's backlash in words."""
    unit, size = term.unit_and_size
    unit = {"deg": "degrees"}.get(unit, unit)
    amount = plus_minus(term.values[0], term.low[0], term.high[0], size)
    return f"backlash joint {term.joint}: {amount} {unit}"


TITLES = {"move": "per move", "fourier": "Fourier"}
"""Kinds of terms as tables name them, where they name them otherwise."""


MOVES_TITLE = "Terms from one-joint moves, each beside the zeros of the series"


def terms_table(terms: Sequence[JointTerm], title: str = MOVES_TITLE) -> Table:
    """Values with intervals, log evidence, probability that the joint needs the term, and how far points move."""
    columns = ("joint", "term", "value, deg", "log evidence", "probability", "moves, mm", "verdict")
    rows: list[tuple[TableValue, ...]] = []
    for term in terms:
        joint = "2, 3" if term.joint is None else str(term.joint)
        name = TITLES.get(term.kind, term.kind) + (", mm" if term.unit == "mm" else "")
        if term.note:
            rows.append((joint, name, term.note, None, None, None, "not tested"))
            continue
        values = "\n".join(values_in_words(term))
        worth = (rounded(term.evidence, 1), f"{term.probability:.3f}", term.moves / MM)
        rows.append((joint, name, values, *worth, term.verdict))
    return Table(title, columns, tuple(rows))


def values_in_words(term: JointTerm) -> list[str]:
    """Lines with the values of a term and their intervals."""
    unit, size = term.unit_and_size
    digits = 5 if unit == "1" else 4
    lines = []
    for name, value, low, high in zip(term.names, term.values, term.low, term.high, strict=True):
        label = f"{name} " if len(term.values) > 1 else ""
        lines.append(label + plus_minus(value, low, high, size, digits))
    if term.frequency is not None and len(term.frequency) == 3:
        frequency, low, high = term.frequency
        lines.append(f"frequency {frequency:.4f} ({low:.4f} to {high:.4f})")
    return lines


def term_rows(terms: Sequence[JointTerm]) -> list[dict[str, Any]]:
    """A row for each coefficient, with what is known of its term; of terms that were not tested a row without value."""
    rows = []
    for term in terms:
        entry = term.to_dict()
        none = {"": dict.fromkeys(("value", "low", "high"))}
        rows += [{**entry, "name": name, **three} for name, three in (entry.pop("values") or none).items()]
    return rows
