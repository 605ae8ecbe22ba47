"""The verdict on a calibration: better than the nominal robot, no better, or worse; and what stands against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal.io.schema import FeaturesSection, Record
from irbcal.measurement.cleaning import LeftOut
from irbcal.summary import Paragraph, Result

Outcome = Literal["better", "no better", "worse"]
MOST_LEFT_OUT = 0.15
"""Share of the points left out above which it is part of the verdict."""
NOT_COUNTED = ("lost", "target unknown to the calibration", "wrong reference")
"""Reasons of points that were not there to be used."""
NO_PROOF = "Poses {basis} are no proof of accuracy: measure others, or hold some out of the fit."
LEFT_OUT = "{share:.0%} of the measured points were left out, which may be the rule."
CLEAR = 2.0
"""Standard errors of the difference, pose by pose, beyond which one model is called better."""


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """Whether a calibration serves these measurements.

    Attributes
    ----------
    outcome : str
        ``better``, ``no better`` or ``worse`` than the nominal robot.
    words : str
        One or two sentences.
    left_out : float
        Share of the points that were left out.
    trusted : bool
        Whether nothing speaks against it: better, few points were left out, and there are no doubts.
    doubts : tuple of str
        All that speaks against it besides the outcome, in sentences.
    """

    outcome: Outcome
    words: str
    left_out: float
    trusted: bool
    doubts: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.trusted

    CONTENT = "outcome words left_out trusted doubts"

    def report(self) -> Sequence[Paragraph]:
        """The words, and what speaks against it."""
        return [f"Verdict: {self.sentence()}", *(f"Doubt: {doubt}" for doubt in self.doubts)]

    def sentence(self) -> str:
        """The words, and that it must not be trusted where that does not follow from them."""
        if self.outcome == "better" and not self.trusted:
            return f"NOT TO BE TRUSTED, though {self.words}"
        return self.words[0].upper() + self.words[1:]


def verdict(
    nominal: ArrayLike,
    calibrated: ArrayLike,
    pose: ArrayLike,
    left_out: int = 0,
    proven: bool = True,
    doubts: Sequence[str] = (),
    used: int | None = None,
    basis: str = "",
) -> Verdict:
    """Judge errors of the same points under both models, pose by pose.

    Parameters
    ----------
    nominal, calibrated : array_like, shape (m,)
        Errors, mm.
    pose : array_like, shape (m,)
        Pose of each point: any labels.
    left_out : int
        Points that were measured, but left out.
    proven : bool
        Whether the fit never saw these poses.
    doubts : sequence of str
        What else speaks against the calibration.
    used : int, optional
        Points that were used in all; m unless given.
    basis : str
        What poses these are, in words that follow "poses"; by default that the fit saw them, or never did.
    """
    a, b = np.asarray(nominal, dtype=float), np.asarray(calibrated, dtype=float)
    _, number = np.unique(np.asarray(pose), return_inverse=True)
    number = number.ravel()
    gain = np.bincount(number, a - b) / np.bincount(number)
    n = len(gain)
    error = float(gain.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf
    mean = float(gain.mean())
    outcome: Outcome = "better" if mean > CLEAR * error else "worse" if mean < -CLEAR * error else "no better"
    figures = f"mean {b.mean():.3f} mm against {a.mean():.3f} mm, largest {b.max():.3f} against {a.max():.3f} mm"
    poses = f"{n} pose{'s' if n > 1 else ''}"
    on = f"{poses} {basis or ('that the fit never saw' if proven else 'that were fitted, which proves nothing')}"
    text = {
        "better": f"better than the nominal robot on {on} ({figures}).",
        "no better": f"NO BETTER than the nominal robot on {on}, beyond chance ({figures}).",
        "worse": f"WORSE than the nominal robot on {on} ({figures}). Is it this robot's calibration, with this tool, "
        "and are these poses like those of the fit? Do not correct programs with it.",
    }[outcome]
    if np.array_equal(a, b):
        text = f"the nominal robot itself, its base and targets identified, on {on}: mean {b.mean():.3f} mm, largest "
        text += f"{b.max():.3f} mm."
    share = left_out / (left_out + (len(a) if used is None else used))
    if share > MOST_LEFT_OUT:
        text += (
            f" {share:.0%} of the points were left out: this is the verdict on the rest only, and what was left out "
            "may be the rule. See why each was."
        )
    against = [] if proven else [NO_PROOF.format(basis=basis or "that were fitted")]
    against += [LEFT_OUT.format(share=share)] if share > MOST_LEFT_OUT else []
    reasons = (*doubts, *(reason for reason in against if reason not in doubts))
    return Verdict(outcome, text, float(share), outcome == "better" and not reasons, reasons)


def verdict_of(record: Record) -> Verdict:
    """The verdict on a calibration by its own held-out poses; by the fitted ones, where nothing was held out."""
    p = record.points
    heldout = np.array(p.heldout, dtype=bool)
    proven = bool(heldout.any())
    rows = heldout == proven
    pose = np.array(p.row if p.row else p.pose)[rows]
    nominal, calibrated = (np.array(column)[rows] for column in (p.nominal_mm, p.calibrated_mm))
    if record.model == "nominal":
        calibrated = nominal
    warning = record.certainty.warning()
    doubts = [*record.doubts, *([warning] if warning and warning not in record.doubts else [])]
    result = verdict(nominal, calibrated, pose, counted(record.excluded), proven, doubts, len(heldout))
    return (
        result if record.features is None else replace(result, words=f"{result.words} {_at_features(record.features)}")
    )


def _at_features(section: FeaturesSection) -> str:
    """What errors at features mean."""
    turn = f"Each {'set' if section.left_out == 'features' else section.left_out} was left out of the fit in turn. "
    return (
        f"{turn if section.left_out else ''}These are distances of rows from features whose own places are fitted: "
        "how well the robot agrees with itself, not its accuracy in a measuring frame."
    )


def counted(excluded: Sequence[LeftOut]) -> int:
    """How many points were left out though they were measured and known."""
    return sum(not point.reason.startswith(NOT_COUNTED) for point in excluded)
