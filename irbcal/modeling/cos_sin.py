"""Cosine and sine of many angles at once: by the compiled kernel, in a fifth of numpy's time, where there is one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from irbcal import kernel
from irbcal.arrays import FloatArray


def cos_sin(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine, each of the shape of the angles (radians, below a million)."""
    angle = np.asarray(angle, dtype=float, order="C")
    out = np.empty((2, *angle.shape))
    if kernel.Kernel is None:
        np.cos(angle, out=out[0, ...])
        np.sin(angle, out=out[1, ...])
    else:
        kernel.cos_sin(angle, out)
    return out[0, ...], out[1, ...]
