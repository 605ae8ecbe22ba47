"""The verdict on a calibration: better than the nominal robot, no better or worse, and whether that may be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, consecutive, group_means
from irbcal.identification.feature_sections import FeaturesSection
from irbcal.io.schema import Record
from irbcal.measurement.cleaning import LOST, UNKNOWN_TARGET, WRONG_REFERENCE, Exclusion
from irbcal.summary import Paragraph, Remark, Result, remarks
from irbcal.wording import counted

Outcome = Literal["better", "no better", "worse"]
MOST_LEFT_OUT = 0.15
"""Share of the points left out above which it is part of the verdict."""
NOT_TO_BE_TRUSTED = "NOT TO BE TRUSTED"
"""Begins the first sentence where doubts speak against a result that is good otherwise."""
NO_PROOF = "Poses {basis} are no proof of accuracy: measure others, or hold some out of the fit."
LEFT_OUT_DOUBT = "{share:.0%} of the measured points were left out, which may be the rule."
CLEAR = 2.0
"""Standard errors of the difference, pose by pose, beyond which one model is called better."""


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """Whether a calibration serves these measurements."""

    outcome: Outcome
    """``better``, ``no better`` or ``worse`` than the nominal robot."""
    statement: str
    """One or two sentences."""
    left_out: float
    """Share of the points that were left out."""
    trusted: bool
    """Whether nothing speaks against it: better, few points were left out, and there are no doubts."""
    doubts: tuple[str, ...] = ()
    """All that speaks against it besides the outcome, in sentences."""

    def __bool__(self) -> bool:
        return self.trusted

    CONTENT = "outcome statement left_out trusted doubts"

    def report(self) -> Sequence[Paragraph]:
        """The words, and what speaks against it."""
        return [Remark("Verdict", self.sentence(), self.trusted), *remarks("Doubt", self.doubts, good=False)]

    def sentence(self) -> str:
        """The words, and that it must not be trusted where that does not follow from them."""
        if self.outcome == "better" and not self.trusted:
            return f"{NOT_TO_BE_TRUSTED}, though {self.statement}"
        return self.statement[0].upper() + self.statement[1:]


def verdict(
    nominal: ArrayLike,
    calibrated: ArrayLike,
    pose: ArrayLike,
    left_out: int = 0,
    proven: bool = True,
    doubts: Sequence[str] = (),
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
    basis : str
        What poses these are, in words that follow "poses"; by default that the fit saw them, or never did.
    """
    before, after = np.asarray(nominal), np.asarray(calibrated)
    share = left_out / (left_out + len(before))
    return _judged(before, after, np.asarray(pose), share, proven, (*doubts, *doubts_of(share, proven, basis)), basis)


def doubts_of(share: float, proven: bool, basis: str = "") -> list[str]:
    """What speaks against errors of points of which a share was left out, in sentences; ``basis`` as for `verdict`."""
    out = [] if proven else [NO_PROOF.format(basis=basis or "that were fitted")]
    return [*out, LEFT_OUT_DOUBT.format(share=share)] if share > MOST_LEFT_OUT else out


def _judged(
    before: FloatArray,
    after: FloatArray,
    pose: np.ndarray,
    share: float,
    proven: bool,
    doubts: Sequence[str],
    basis: str = "",
) -> Verdict:
    """The verdict, whose doubts are all known."""
    gain = _by_pose(before - after, pose)
    outcome = _outcome(gain)
    basis = basis or ("that the fit never saw" if proven else "that were fitted, which proves nothing")
    words = _words(outcome, before, after, f"{counted(len(gain), 'pose')} {basis}")
    if share > MOST_LEFT_OUT:
        words += f" {share:.0%} of the points were left out: this is the verdict on the rest only. See why each was."
    return Verdict(outcome, words, share, outcome == "better" and not doubts, tuple(doubts))


def _by_pose(gain: FloatArray, pose: np.ndarray) -> FloatArray:
    """Means of the points of each pose; the points themselves where each has a pose, in order."""
    if pose.dtype.kind in "iu" and (pose[1:] > pose[:-1]).all():
        return gain
    return group_means(gain, consecutive(pose))


def _outcome(gain: FloatArray) -> Outcome:
    """Whether errors became smaller pose by pose, by more than chance lets them."""
    error = float(gain.std(ddof=1, dtype=float) / np.sqrt(len(gain))) if len(gain) > 1 else np.inf
    mean = float(gain.mean(dtype=float))
    return "better" if mean > CLEAR * error else "worse" if mean < -CLEAR * error else "no better"


def _words(outcome: Outcome, before: FloatArray, after: FloatArray, poses: str) -> str:
    means = [float(errors.mean(dtype=float)) for errors in (before, after)]
    if np.array_equal(before, after):
        return (
            f"the nominal robot itself, its base and targets identified, on {poses}: mean {means[1]:.3f} mm, largest "
            f"{after.max():.3f} mm."
        )
    figures = (
        f"mean {means[1]:.3f} mm against {means[0]:.3f} mm, largest {after.max():.3f} against {before.max():.3f} mm"
    )
    return {
        "better": f"better than the nominal robot on {poses} ({figures}).",
        "no better": f"NOT SIGNIFICANTLY BETTER than the nominal robot on {poses} ({figures}).",
        "worse": f"WORSE than the nominal robot on {poses} ({figures}). Is it this robot's calibration, with this "
        "tool, and are these poses like those of the fit? Do not correct programs with it.",
    }[outcome]


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
    # rows at features are fitted, and held out in turn: the same ones
    used = len(heldout) if record.features is None else int((~heldout).sum())
    result = _judged(nominal, calibrated, pose, share_left_out(record.excluded, used), proven, record.doubts)
    return replace(
        result, statement=result.statement + ("" if record.features is None else _at_features(record.features))
    )


def _at_features(section: FeaturesSection) -> str:
    """What errors at features mean."""
    turn = f" Each {'set' if section.left_out == 'features' else section.left_out} was left out of the fit in turn."
    return (
        f"{turn if section.left_out else ''} These are distances of rows from features whose own places are fitted: "
        "how well the robot agrees with itself, not its accuracy in a measuring frame."
    )


def rejected_count(excluded: Sequence[Exclusion]) -> int:
    """How many points were left out though they were measured and known."""
    return sum(point.kind not in (LOST, UNKNOWN_TARGET, WRONG_REFERENCE) for point in excluded)


def share_left_out(excluded: Sequence[Exclusion], used: int) -> float:
    """Share of the measured points that were left out, where so many others were used."""
    return rejected_count(excluded) / (rejected_count(excluded) + used)
