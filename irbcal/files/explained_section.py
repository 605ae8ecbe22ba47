"""What each family of terms explains and what the gear scan saw, in ``calibration.json``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field, model_validator

from irbcal.files.section import Name, Section, Word
from irbcal.identification.explained import Stage
from irbcal.identification.gear_scan import Spectrum
from irbcal.identification.shown import FamilyShown
from irbcal.units import MM

THINNED = 3
"""Cycles per turn of which the file has the strongest one."""


class ExplainedStage(Section):
    """A fit with all families so far, which the calibration has or (``carried`` false) which were only tried.

    Of ``terms`` coefficients ``seen`` are determined by the data. Errors of poses that are left out of the fit one at a
    time (rms) and of held-out poses, mm: of the warm robot as it is used, and with the warmth of each pose (``timed``).
    """

    added: Name
    terms: int
    seen: float
    carried: bool
    leave_one_out_mm: float
    mean_mm: float | None
    max_mm: float | None
    timed_mean_mm: float | None

    @staticmethod
    def of(stage: Stage) -> ExplainedStage:
        """The section of a stage."""
        return ExplainedStage(
            added=stage.added,
            terms=stage.terms,
            seen=stage.seen,
            carried=stage.carried,
            leave_one_out_mm=stage.loo / MM,
            mean_mm=_mm(stage.mean),
            max_mm=_mm(stage.largest),
            timed_mean_mm=_mm(stage.timed),
        )


class GearSpectrum(Section):
    """What the gear scan saw before it took a wave, thinned: the strongest of every ``step`` cycles per turn.

    ``chi2`` has a row for each of ``joints`` (from 1); beyond ``limit`` a wave is not chance.
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
    def of(seen: Spectrum | None) -> GearSpectrum | None:
        """The section of a spectrum."""
        if seen is None:
            return None
        starts = np.arange(0, len(seen.cycles), THINNED)
        strongest = np.maximum.reduceat(seen.chi2, starts, axis=1)
        return GearSpectrum(
            joints=[joint + 1 for joint in seen.joints],
            first=int(seen.cycles[0]),
            step=THINNED,
            limit=round(seen.limit, 3),
            chi2=np.round(strongest, 1).tolist(),
        )


class FamilyRow(Section):
    """A family in the best choice of terms: what is lost without it.

    ``evidence`` in nats; ``moves_mm``: how far the fitted points move (rms); ``shown``: beyond doubt and not small.
    """

    family: Word
    seen: float
    evidence: float
    moves_mm: float
    shown: bool

    @staticmethod
    def of(families: Sequence[FamilyShown]) -> list[FamilyRow]:
        """The rows of a fit."""
        return [
            FamilyRow(family=f.family, seen=f.seen, evidence=f.evidence, moves_mm=f.moves / MM, shown=f.shown)
            for f in families
        ]


def _mm(length: float | None) -> float | None:
    return None if length is None else length / MM
