"""The verdict on a calibration: better than the nominal robot, no better, or worse; and what stands against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal.summary import Speaks, Told

Outcome = Literal["better", "no better", "worse"]
MOST_LEFT_OUT = 0.15
"""Share of the points left out above which it is part of the verdict."""
CLEAR = 2.0
"""Standard errors of the difference, pose by pose, beyond which one model is called better."""


@dataclass(frozen=True, repr=False)
class Verdict(Speaks):
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
        Whether nothing speaks against it: better, and few points were left out.
    """

    outcome: Outcome
    words: str
    left_out: float
    trusted: bool

    def __bool__(self) -> bool:
        return self.trusted

    def to_dict(self) -> dict[str, object]:
        """What ``--json`` prints."""
        return {"outcome": self.outcome, "words": self.words, "left_out": self.left_out, "trusted": self.trusted}

    def told(self) -> Sequence[Told]:
        """The words."""
        return [f"Verdict: {self.words}"]


def verdict(
    nominal: ArrayLike, calibrated: ArrayLike, pose: ArrayLike, left_out: int = 0, proven: bool = True
) -> Verdict | None:
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

    Returns
    -------
    Verdict or None
        None without points.
    """
    a, b = np.asarray(nominal, dtype=float), np.asarray(calibrated, dtype=float)
    if not len(a):
        return None
    _, number = np.unique(np.asarray(pose), return_inverse=True)
    number = number.ravel()
    count = np.bincount(number)
    gain = np.bincount(number, a - b) / count
    n = len(gain)
    error = float(gain.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf
    mean = float(gain.mean())
    outcome: Outcome = "better" if mean > CLEAR * error else "worse" if mean < -CLEAR * error else "no better"
    figures = f"mean {b.mean():.3f} mm against {a.mean():.3f} mm, largest {b.max():.3f} against {a.max():.3f} mm"
    on = f"{n} pose{'s' if n > 1 else ''}{'' if proven else ' that were fitted, which proves nothing'}"
    words = {
        "better": f"better than the nominal robot on {on} ({figures}).",
        "no better": f"NO BETTER than the nominal robot on {on}, beyond chance ({figures}).",
        "worse": f"WORSE than the nominal robot on {on} ({figures}). Is it this robot's calibration, with this tool, "
        "and are these poses like those of the fit? Do not correct programs with it.",
    }[outcome]
    share = left_out / (left_out + len(a))
    if share > MOST_LEFT_OUT:
        words += (
            f" {share:.0%} of the points were left out: this is the verdict on the rest only, and what was left out "
            "may be the rule. See why each was."
        )
    return Verdict(outcome, words, float(share), outcome == "better" and proven and share <= MOST_LEFT_OUT)
