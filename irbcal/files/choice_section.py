"""How the error model was chosen, in ``calibration.json``: by cross-validation, or as an average by evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from irbcal.files.certainty_section import in_mm
from irbcal.files.explained_section import ExplainedStage, FamilyRow, GearSpectrum
from irbcal.files.section import Name, Section, Sentence, Word
from irbcal.identification.averaged import AveragedFit
from irbcal.identification.evidence_fit import EvidenceFit, GroupResult
from irbcal.identification.explained import Stage
from irbcal.units import DEG, MM, UNIT_OUTSIDE


class Candidate(Section):
    """A level in the comparison by cross-validation."""

    level: Word
    mean_mm: float | None
    gain_mm: float | None
    gain_std_mm: float | None
    chosen: bool
    refused: Sentence


class Choice(Section):
    """How the level was chosen."""

    level: Word
    table: list[Candidate]
    explanation: Sentence


class Dictionary(Section):
    """An error model in the comparison by evidence: ``terms`` counts base and targets, too.

    ``log_evidence`` is in nats; residual and leave-one-pose-out error (mm) are null for models without weight.
    """

    name: Name
    terms: int
    log_evidence: float
    weight: float
    sigma_mm: float | None
    leave_one_out_mm: float | None


class EvidenceChoice(Section):
    """Which error models were averaged."""

    level: Literal["auto"]
    table: list[Dictionary]
    explanation: Sentence

    @staticmethod
    def of(fit: AveragedFit) -> EvidenceChoice:
        """The comparison of a fit."""
        rows = [
            Dictionary(
                name=row.name,
                terms=row.terms,
                log_evidence=row.log_evidence,
                weight=row.weight,
                sigma_mm=None if row.sigma is None else row.sigma / MM,
                leave_one_out_mm=None if row.loo is None else row.loo / MM,
            )
            for row in fit.evidence.dictionaries
        ]
        return EvidenceChoice(level="auto", table=rows, explanation=fit.explanation())


class Group(Section):
    """A group of terms with one variance: ``seen`` of its coefficients are determined by the data.

    ``size`` is the standard deviation that its coefficients have before the data, in natural sizes; ``found`` and
    ``std`` are the root mean squares of what was found and of its standard deviations, likewise. ``natural`` has the
    natural sizes by unit (deg, mm, 1, …). Files of earlier versions have the first four only.
    """

    name: Name
    terms: int
    seen: float
    size: float
    family: Word = ""
    natural: dict[Word, float] = Field(default_factory=dict)
    found: float | None = None
    std: float | None = None

    @staticmethod
    def of(group: GroupResult) -> Group:
        """The section of a group."""
        natural = {}
        for unit, size in group.natural.items():
            base, _, per = unit.partition("/")
            outside, factor = UNIT_OUTSIDE.get(base, (base, 1.0))
            natural[f"{outside}/{per}" if per else outside] = size / factor
        return Group(
            name=group.name,
            terms=group.terms,
            seen=group.seen,
            size=group.size,
            family=group.family,
            natural=natural,
            found=group.found,
            std=group.std,
        )


class Gear(Section):
    """A single high harmonic that was found; joints count from 1."""

    joint: int
    cycles_per_turn: int
    amplitude_deg: float
    chi2: float
    evidence_gain: float


class EvidenceSection(Section):
    """What is known of an average of error models beside its parameters.

    Leave-one-out errors are root mean squares by target, under the empty name for all: of single poses, and of
    contiguous fifths of the poses; null where what is left does not determine them. ``warm_up_tau`` is in poses.
    ``explained`` are fits with one family after the other;
    ``spectrum`` is null where no gear scan was made, because long series of harmonics take its place.
    """

    terms: Word
    poses: int
    sigma_mm: float
    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    groups: list[Group]
    families: list[FamilyRow] = Field(default_factory=list)
    gears: list[Gear]
    spectrum: GearSpectrum | None = None
    explained: list[ExplainedStage] = Field(default_factory=list)
    warm_up_tau: float | None
    readings_gain: float | None
    readings_lag: bool

    @staticmethod
    def of(fit: EvidenceFit, stages: Sequence[Stage] = ()) -> EvidenceSection:
        """The section of a fit, with its stages (`irbcal.identification.explained`)."""
        return EvidenceSection(
            terms=fit.kind,
            poses=fit.poses,
            sigma_mm=fit.sigma / MM,
            leave_one_out_mm=in_mm(fit.loo),
            leave_fifths_out_mm=in_mm(fit.loo_blocks),
            groups=[Group.of(group) for group in fit.groups],
            gears=[
                Gear(
                    joint=gear.joint + 1,
                    cycles_per_turn=gear.cycles_per_turn,
                    amplitude_deg=fit.amplitude(gear) / DEG,
                    chi2=gear.chi2,
                    evidence_gain=gear.evidence_gain,
                )
                for gear in fit.gears
            ],
            families=FamilyRow.of(fit.families),
            spectrum=GearSpectrum.of(fit.spectrum),
            explained=[ExplainedStage.of(stage) for stage in stages],
            warm_up_tau=fit.tau,
            readings_gain=fit.readings_gain,
            readings_lag=fit.readings_projected,
        )
