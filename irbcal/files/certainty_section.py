"""What is known of a calibration's predictions, in ``calibration.json``: covariance, left-out errors, joint ranges."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from irbcal.arrays import FloatArray
from irbcal.files.section import Base64, Name, Section
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.elsewhere import Elsewhere
from irbcal.units import MM


class CovarianceSection(Section):
    """A covariance matrix ``C = L L'`` by its factor, packed.

    ``factor`` is base64 of the lower triangle of L, row by row (L11, L21, L22, L31, …), as little-endian floats of four
    bytes. The factor keeps what is known well beside what is not: a rounding of C itself to four bytes would not.
    """

    layout: Literal["cholesky-rows-float32-base64"]
    size: int = Field(ge=0)
    factor: Base64

    @model_validator(mode="after")
    def _whole(self) -> CovarianceSection:
        try:
            data = base64.b64decode(self.factor, validate=True)
        except binascii.Error:
            raise ValueError("the factor of the covariance is not base64") from None
        if len(data) != 2 * self.size * (self.size + 1):
            raise ValueError(f"the factor of a covariance of size {self.size} has {len(data)} bytes")
        if not np.isfinite(np.frombuffer(data, "<f4")).all():
            raise ValueError("the factor of the covariance has numbers that are not finite")
        return self

    @staticmethod
    def of(matrix: FloatArray) -> CovarianceSection:
        """The section of a covariance, shape (k, k), which may be singular."""
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        scale[scale == 0.0] = 1.0
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        # R'R = V diag(values) V' with R upper triangular: a factor although directions may be held
        R: FloatArray = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
        L = R.T * scale[:, None]
        data = L[np.tril_indices(len(L))].astype("<f4").tobytes()
        return CovarianceSection(
            layout="cholesky-rows-float32-base64", size=len(L), factor=base64.b64encode(data).decode("ascii")
        )

    def matrix(self) -> FloatArray:
        """The covariance, shape (size, size), read-only."""
        return _unpacked(self.factor, self.size)


@lru_cache(maxsize=4)
def _unpacked(factor: str, size: int) -> FloatArray:
    L = np.zeros((size, size))
    L[np.tril_indices(size)] = np.frombuffer(base64.b64decode(factor), "<f4")
    C: FloatArray = L @ L.T
    C.setflags(write=False)
    return C


class ElsewhereSection(Section):
    """Expected errors (rms, mm) at the poses of the fit and anywhere within the joint limits.

    ``shares`` of its limits that each joint went through; ``difference_mm`` between the predictions of the calibrated
    and the nominal robot anywhere; see `irbcal.modeling.elsewhere`.
    """

    shares: list[float]
    here_mm: float
    there_mm: float
    difference_mm: float

    @staticmethod
    def of(found: Elsewhere | None) -> ElsewhereSection | None:
        """The section of what was found."""
        if found is None:
            return None
        return ElsewhereSection(
            shares=found.shares.tolist(),
            here_mm=found.here / MM,
            there_mm=found.there / MM,
            difference_mm=found.difference / MM,
        )

    def found(self) -> Elsewhere:
        """What the section tells."""
        return Elsewhere(np.array(self.shares), self.here_mm * MM, self.there_mm * MM, self.difference_mm * MM)


class CertaintySection(Section):
    """What intervals of predictions need beside the covariance, and where they are valid.

    Leave-one-out errors (mm) are root mean square lengths by target, under the empty name for all: of single poses, and
    of contiguous fifths of the poses; null where what is left does not determine them. ``ranges`` are the smallest and
    the largest joints of the fit, rad (m).
    """

    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    ranges: list[list[float]] = Field(min_length=2, max_length=2)
    elsewhere: ElsewhereSection | None = None

    @staticmethod
    def of(known: Certainty, found: Elsewhere | None) -> CertaintySection:
        """The section of what an identification knows."""
        assert known.ranges is not None
        return CertaintySection(
            leave_one_out_mm=in_mm(known.loo),
            leave_fifths_out_mm=in_mm(known.loo_blocks),
            ranges=known.ranges.tolist(),
            elsewhere=ElsewhereSection.of(found),
        )

    def warning(self) -> str:
        """The warning of a calibration that is that of a corner of the workspace; else an empty text."""
        return "" if self.elsewhere is None else self.elsewhere.found().in_words()


def in_mm(lengths: Mapping[str, float | None]) -> dict[str, float | None]:
    """Lengths by name, metres, in millimetres."""
    return {name: None if value is None else value / MM for name, value in lengths.items()}


def in_metres(lengths: Mapping[str, float | None]) -> dict[str, float | None]:
    """Lengths by name, millimetres, in metres."""
    return {name: None if value is None else value * MM for name, value in lengths.items()}
