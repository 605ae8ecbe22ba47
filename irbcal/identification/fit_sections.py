"""What ``calibration.json`` says of a fit: its parameters, the choice of its level or terms, what the data show.

Readers of a calibration need these without the fit itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from irbcal.arrays import FloatArray
from irbcal.distributions import NORMAL_95
from irbcal.modeling.levels import Level
from irbcal.modeling.terms import family_in_words
from irbcal.section import Name, Section, Sentence, Word
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM, UNIT_OUTSIDE
from irbcal.wording import counted

ParameterState: TypeAlias = Literal["identified", "tied", "held"]
NATS = 5.0
"""Log evidence that a part of the terms must be worth to count as shown: odds of 150 to 1; false alarms are counted on
SIMULATED robots by ``scripts/false_alarms``. Of parts that can stand in for one another (gravity at joint 2 is a first
harmonic) each is shown only by what the others cannot explain."""
LEAST_SHIFT = 0.003 * MM
"""Root mean square distance by which the fitted points must move without it, metres: a third of a tracker's noise."""
THINNED = 3
"""Cycles per turn of which the spectrum has the strongest one."""


DIGITS = {"mm": 3, "deg": 4, "rad": 6, "1": 6}
"""Decimals of values of parameters, by their units."""


class ParameterReport(Section):
    """One parameter as it is reported."""

    name: Name
    value: float
    unit: Word
    std: float | None
    """At the surface's unit; ``std`` is None where the parameter was not identified by itself."""
    low: float | None
    high: float | None
    """95 % interval."""
    state: ParameterState
    """``identified``, ``tied`` (only a combination with others was seen) or ``held``."""
    reason: Sentence
    """Why it is not simply identified, in words; empty otherwise."""

    @staticmethod
    def from_si(
        name: str, value: float, unit: str, std: float | None, state: ParameterState = "identified", reason: str = ""
    ) -> ParameterReport:
        """A report from value and standard deviation in SI units."""
        outside, factor = UNIT_OUTSIDE.get(unit, (unit, 1.0))
        value, std = float(value) / factor, None if std is None else float(std) / factor
        low, high = (None, None) if std is None else (value - NORMAL_95 * std, value + NORMAL_95 * std)
        return ParameterReport(
            name=name, value=value, unit=outside, std=std, low=low, high=high, state=state, reason=reason
        )


class Candidate(Section):
    """Cross-validated error of one level."""

    level: Level
    mean_mm: float | None
    """Mean over the poses of the mean distance of a pose that the fit did not see."""
    gain_mm: float | None
    gain_std_mm: float | None
    """By how much it is better than the level chosen before it, pose by pose, with standard error; None for the first.
    """
    chosen: bool
    """Whether it was better by more than the standard error, and so replaced the level before it."""
    refused: Sentence = ""
    """Why it could not be fitted, else empty."""


class LevelChoice(Result, Section):
    """A chosen level with the comparison that led to it."""

    level: Level
    table: tuple[Candidate, ...]
    """In the order of growing size."""
    explanation: Sentence
    """Two sentences."""

    def report(self) -> Sequence[Paragraph]:
        """Which level and why; the levels compared; why some could not be."""
        rows = tuple((row.level, row.mean_mm, row.gain_mm, row.gain_std_mm) for row in self.table)
        columns = ("model", "mean (mm)", "gain (mm)", "±")
        bold = frozenset(k for k, row in enumerate(self.table) if row.level == self.level)
        title = "Cross-validated errors; gain over the smaller model chosen before"
        refused = [f"  model {row.level}: {row.refused}" for row in self.table if row.refused]
        return (self.explanation, Table(title, columns, rows, bold=bold), *refused)

    CONTENT: ClassVar[str] = "level table explanation"
    ROWS: ClassVar[str] = "table"
    COLUMNS: ClassVar[str] = "level mean_mm gain_mm gain_std_mm chosen refused"


class FamilyShown(Section):
    """A family of terms in the best choice of terms."""

    family: Word
    determined: float
    """Number of its coefficients that the data determine."""
    evidence: float
    """Log evidence that is lost without it, nats."""
    moves_mm: float
    """Root mean square distance by which the fitted points move without it."""

    @property
    def supported(self) -> bool:
        """Whether it counts as there."""
        return self.evidence >= NATS and self.moves_mm * MM >= LEAST_SHIFT

    def in_words(self) -> str:
        """Name and size: ``gravity (0.213 mm)``."""
        return f"{family_in_words(self.family)} ({self.moves_mm:.3f} mm)"


def sentence(families: Sequence[FamilyShown]) -> str:
    """What the data show and what not, in words."""
    there = sorted((row for row in families if row.supported), key=lambda row: -row.moves_mm)
    rest = [family_in_words(row.family) for row in families if not row.supported]
    said = "Beside errors of the geometry the data show nothing."
    if there:
        said = (
            "What the data show beside errors of the geometry (in brackets, how far points move if a model does "
            f"without): {', '.join(row.in_words() for row in there)}."
        )
    return said + (f" Not shown: {', '.join(rest)}." if rest else "")


class TermSetResult(Section):
    """A choice of terms in the comparison."""

    name: Name
    terms: int
    """Number of columns, base and targets included."""
    log_evidence: float
    """Nats, of residuals in millimetres; differences matter."""
    weight: float
    """In the average."""
    sigma_mm: float | None
    leave_one_out_mm: float | None
    """Residual standard deviation of a coordinate and root mean square length of the leave-one-pose-out residuals; of
    term sets with weight only, as averaged."""


class AverageChoice(Section):
    """Which error models were averaged."""

    level: Level | Literal["auto"]
    table: tuple[TermSetResult, ...]
    explanation: Sentence


class GroupResult(Section):
    """How much the data show of a group of terms."""

    name: Name
    terms: int
    determined: float
    """Number of its coefficients that the data determine (MacKay's gamma), averaged."""
    size: float
    """Prior standard deviation of its coefficients, in natural sizes, over the term sets that have it."""
    family: Word
    natural: dict[Word, float]
    """Natural size of its coefficients by their unit (deg, mm, 1, …)."""
    estimate: float
    std: float
    """Root mean squares of its coefficients and of their standard deviations, in natural sizes."""


def models_table(term_sets: Sequence[TermSetResult]) -> Table:
    """The error models that were compared as a table for people."""
    rows = tuple(
        (r.name, r.terms, f"{r.log_evidence:.1f}", f"{r.weight:.3f}", r.sigma_mm, r.leave_one_out_mm) for r in term_sets
    )
    columns = ("error model", "terms", "log evidence", "weight", "sigma (mm)", "leave one out (mm)")
    bold = frozenset(k for k, row in enumerate(term_sets) if row.weight > 0.0)
    return Table("Error models compared by their evidence", columns, rows, digits=4, bold=bold)


def groups_table(groups: Sequence[GroupResult]) -> Table:
    """Groups of terms as a table for people: name, terms, how many of them the data determine, prior size."""
    rows = tuple((g.name.replace("_", " "), g.terms, f"{g.determined:.1f}", g.size) for g in groups)
    return Table("Groups of terms", ("group", "terms", "determined", "size / typical size"), rows)


REACHED = {"rms": "fitted rms", "max": "largest fitted error", "pnorm": "p-norm of the fitted errors"}
"""Objective -> what its value is called."""


def identified_in_words(rank: int, parameter_count: int, poses: int) -> str:
    """What the fitted poses determine."""
    return (
        f"{rank} independent combinations of {counted(parameter_count, 'parameter')} were identified from "
        f"{counted(poses, 'pose')}, base and targets included"
    )


def reached_in_words(objective: str, value_mm: float, lower_bound_mm: float | None, method: str, held: str = "") -> str:
    """What a method reached, in words."""
    text = f"{REACHED[objective]} {value_mm:.3f} mm"
    if lower_bound_mm is not None:
        text += f", certified: not below {lower_bound_mm:.3f} mm with this model{held}"
    return text if method == "least-squares" else f"method {method}, {text}"


class GearSpectrum(Section):
    """What the gear scan saw before it took a wave, thinned: the strongest of every ``step`` cycles per turn.

    ``chi2`` has a row for each of ``joints`` (from 1): by how much a wave would explain the residuals, a pose counted
    as one vector, two degrees of freedom; beyond ``limit`` it is not chance.
    """

    joints: list[int]
    first: int
    step: int = Field(ge=1)
    limit: float
    chi2: list[list[float]]

    @model_validator(mode="after")
    def _of_one_shape(self) -> GearSpectrum:
        if len(self.chi2) != len(self.joints) or len({len(row) for row in self.chi2}) > 1:
            raise ValueError("the gear spectrum needs a row of one length for each joint")
        return self

    @staticmethod
    def from_scan(joints: Sequence[int], first: int, chi2: FloatArray, limit: float) -> GearSpectrum:
        """Of joints from 0: ``chi2``, shape (joints, frequencies), is that of each number of cycles from the first."""
        strongest = np.maximum.reduceat(chi2, np.arange(0, chi2.shape[1], THINNED), axis=1)
        return GearSpectrum(
            joints=[joint + 1 for joint in joints],
            first=first,
            step=THINNED,
            limit=round(limit, 3),
            chi2=np.round(strongest, 1).tolist(),
        )


class Stage(Section):
    """A fit with all families so far."""

    added: Name
    """What this stage adds to the one before, in words."""
    terms: int
    """All terms, without base and targets."""
    determined: float
    """Number of coefficients that the data determine."""
    carried: bool
    """Whether the calibration has terms of such families; others, such as frame terms beside a joint map, are only
    tried."""
    leave_one_out_mm: float
    """Root mean square distance of poses left out of the fit one at a time; of points that the others determine."""
    mean_mm: float | None
    max_mm: float | None
    """Distance of held-out points from the robot at use, which is warm; None where none are held out."""
    timed_mean_mm: float | None
    """Mean distance with the warmth that the arm had at each held-out pose; None where nothing is known of it."""


class GearWave(Section):
    """A single high harmonic of a joint (from 1): how far it turns the joint to and fro, and what shows it.

    ``chi2``: by how much it explains the residuals, two degrees of freedom; ``evidence_gain`` in nats.
    """

    joint: int
    cycles_per_turn: int
    amplitude_deg: float
    chi2: float
    evidence_gain: float


class ModelAverage(Section):
    """What is known of an average of error models beside its parameters."""

    terms: Word
    """``joint-map`` or ``all``."""
    poses: int
    """After averaging repeats."""
    sigma_mm: float
    """Residual standard deviation of a coordinate."""
    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    """As of `irbcal.modeling.certainty.FitLimits`."""
    groups: tuple[GroupResult, ...]
    families: tuple[FamilyShown, ...]
    """What the best choice of terms would lose without each of its families."""
    gears: tuple[GearWave, ...] = ()
    spectrum: GearSpectrum | None = None
    """What the gear scan saw; None where there was none, because long series of harmonics take its place."""
    explained: tuple[Stage, ...] = ()
    """Fits with one family after the other (`irbcal.identification.explanation`), where they were made."""
    warm_up_tau: float | None
    """Time constant of warm-up in the choice of terms with most weight, in the unit of the motion's time: poses."""
    readings_gain: float | None = None
    """Where only readings were known: by which factor residuals fell with a share of the last move free in each pose.
    """
    readings_lag: bool = False
    """Whether that was so much that readings were taken before the arm stood still."""

    @property
    def warms_up(self) -> bool:
        """Whether the data show that the arm drifted as it warmed up."""
        return any(row.family == "warm_up" and row.supported for row in self.families)


class CorrelatedPair(Section):
    """Two parameters that the data can hardly tell apart."""

    first: Name
    second: Name
    coefficient: float


class Observability(Section):
    """What the poses can show of the error parameters, base and targets eliminated.

    Singular values (mm) are those of the Jacobian scaled by plausible sizes; ``indices`` are O1 to O5 and the condition
    number over the seen directions. Of an average all but ``seen`` is empty: how much is seen stands with the groups of
    terms, nothing is held.
    """

    singular_values_mm: list[float]
    determined: int
    indices: dict[Word, float]
    correlations: list[CorrelatedPair]
