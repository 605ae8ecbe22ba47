"""The covariance of a calibration as ``calibration.json`` has it."""

from __future__ import annotations

import base64
import binascii
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from irbcal.arrays import FloatArray
from irbcal.section import Base64, Section


class PackedCovariance(Section):
    """A covariance matrix ``C = L L'`` by its factor, packed.

    ``factor`` is base64 of the lower triangle of L, row by row (L11, L21, L22, L31, …), as little-endian floats of four
    bytes. The factor keeps what is known well beside what is not: a rounding of C itself to four bytes would not.
    """

    layout: Literal["cholesky-rows-float32-base64"]
    size: int = Field(ge=0)
    factor: Base64

    @model_validator(mode="after")
    def _whole(self) -> PackedCovariance:
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
    def from_matrix(matrix: FloatArray) -> PackedCovariance:
        """The section of a covariance, shape (k, k), which may be singular."""
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        scale[scale == 0.0] = 1.0
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        # R'R = V diag(values) V' with R upper triangular: a factor although directions may be held
        R: FloatArray = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
        L = R.T * scale[:, None]
        data = L[np.tril_indices(len(L))].astype("<f4").tobytes()
        return PackedCovariance(
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
