"""By which share all link lengths differ from the nominal ones: a tracker with a wrong scale looks the same.

Certificates say it of calibrations that were fitted long before, which need no fit for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, isfinite, sqrt

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.distributions import f_survival
from irbcal.modeling.arm import Arm
from irbcal.units import MM

MACHINING = 0.2 * MM
"""Least standard deviation of link lengths of a robot as they are made and identified, metres; where they scatter more,
that counts."""
BEYOND_MACHINING = 0.001
"""Chance below which machining does not explain a common scale."""
TYPICAL = 5e-4
"""Error of a tracker's scale that a scale bar would show: a wrong temperature, pressure or distance constant."""


@dataclass(frozen=True)
class LengthScale:
    """By which share all link lengths are longer than the nominal ones."""

    share: float
    std: float
    """Estimate and standard deviation."""
    freedom: float = np.inf
    """Numbers that the standard deviation rests on; infinite where it is that of machining."""

    @property
    def beyond_machining(self) -> bool:
        """Whether machining does not explain it (Student's t)."""
        t = abs(self.share) / self.std
        chance = f_survival(t * t, 1.0, self.freedom) if isfinite(self.freedom) else erfc(t / sqrt(2.0))
        return chance < BEYOND_MACHINING

    def doubt(self) -> str:
        """What to clear up, in a sentence."""
        return (
            f"All link lengths are {abs(self.share):.2%} {'longer' if self.share > 0.0 else 'shorter'} than the "
            f"nominal ones (± {2.0 * self.std:.2%}), more than machining leaves: measure a scale bar, for a wrong "
            "scale of the tracker looks the same and shows in no residual."
        )


def length_scale(nominal: Arm, calibrated: Arm) -> LengthScale | None:
    """Common scale of the link lengths, by least squares; None where no length was identified.

    No residual shows a tracker whose lengths are all too long: every link becomes longer by the same share. The only
    known lengths of a robot that is measured without a scale bar are its nominal ones, which differ from the true ones
    by what machining leaves, independently of one another.
    """
    pairs = [(nominal.table.a, calibrated.table.a), (nominal.table.d, calibrated.table.d)]
    length, change = (np.concatenate(arrays) for arrays in zip(*((a, b - a) for a, b in pairs), strict=True))
    length, change = length[change != 0.0], change[change != 0.0]
    total = float((length**2).sum())
    if not total or len(length) < 2:
        return None
    share = float(length @ change) / total
    scatter = float(np.sqrt(((change - share * length) ** 2).sum() / (len(length) - 1)))
    std = max(MACHINING, scatter) / float(np.sqrt(total))
    return LengthScale(share, std, len(length) - 1.0 if scatter > MACHINING else np.inf)


def scale_in_words(scale: LengthScale | None, xyz: ArrayLike, bar: str) -> str:
    """What a certificate says of the scale.

    Parameters
    ----------
    scale : LengthScale or None
        Of the calibration.
    xyz : array_like, shape (m, 3)
        Judged points, metres.
    bar : str
        What the user says of a known length that the tracker measured; empty for none.
    """
    if bar:
        return f"The scale rests on a known length, as stated: {bar}."
    points: FloatArray = np.asarray(xyz, dtype=float)
    reach = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max()) / MM
    text = (
        "The scale is not proven, for no known length is stated (scale_bar): a tracker whose scale is wrong by "
        f"{TYPICAL:.2%} would leave no trace here, and the robot would err by up to {TYPICAL * reach:.2f} mm more"
    )
    if scale is None:
        return f"{text}."
    bound = abs(scale.share) + 2.0 * scale.std
    return f"{text}; the nominal link lengths exclude no more than {bound:.2%}, which is {bound * reach:.2f} mm."
