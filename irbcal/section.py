"""What every part of ``calibration.json`` is, and every result that stands in it: a frozen, checked model.

It takes nothing unknown, and no text that could act. Each text of it has one of the types here. They are printed, and
written into pages, programs and generated code: none can hold a line end or a character that a terminal obeys.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, GetCoreSchemaHandler, StringConstraints
from pydantic_core import CoreSchema, core_schema

from irbcal.arrays import FloatArray
from irbcal.names import LONGEST_NAME, fault_of

LONGEST_SENTENCE = 20_000
"""Characters: a note may list every point that was left out."""


def _printable(text: str, longest: int = 3 * LONGEST_NAME) -> str:
    fault = fault_of(text, longest)
    if fault is not None:
        raise ValueError(fault)
    return text


def _all_printable(texts: list[str]) -> list[str]:
    for text in set(texts):
        _printable(text)
    return texts


def _sentence(text: str) -> str:
    return _printable(text, LONGEST_SENTENCE)


Name: TypeAlias = Annotated[str, AfterValidator(_printable)]
"""A name from a file, see `irbcal.names`, or one that irbcal made of two such names and words."""
Names: TypeAlias = Annotated[list[str], AfterValidator(_all_printable)]
"""A column of names; each is looked at once."""
Sentence: TypeAlias = Annotated[str, AfterValidator(_sentence)]
"""Words of irbcal, with names in them: printable, one line."""
Word: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z ()*+,./^_@:-]{0,79}$|^$")]
"""A word that irbcal chose: of a model, a term, a unit; may be empty."""
Fingerprint: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
Sha256: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Base64: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z+/]*={0,2}$")]
Date: TypeAlias = Annotated[
    str, StringConstraints(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\+00:00$")
]
"""ISO 8601, UTC."""
Version: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z.+!_-]{1,80}$")]


class Numbers:
    """How an array of a result stands in a file, as metadata of its type: (nested) lists of finite numbers.

    Parameters
    ----------
    *shape : int
        -1 stands for any length; none at all is a single number.
    unit : float
        Of the file, in SI units.
    """

    def __init__(self, *shape: int, unit: float = 1.0) -> None:
        self.shape, self.unit = shape, unit

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(lambda value: in_unit(value, self.unit))
        return core_schema.no_info_plain_validator_function(self._read, serialization=written)

    def _read(self, content: Any) -> FloatArray | float:
        array = np.array(content)  # a ValueError where rows differ in length
        if array.shape == (0,):
            array = array.reshape((0,) * len(self.shape))
        fits = array.ndim == len(self.shape) and all(
            expected in (-1, length) for expected, length in zip(self.shape, array.shape, strict=True)
        )
        if not fits or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
            raise ValueError(f"expected finite numbers of shape {self.shape}, -1 being any length".replace("'", ""))
        return array * self.unit if self.shape else float(array) * self.unit


class Section(BaseModel):
    """A part of ``calibration.json``; unknown keys, NaN and infinities are refused."""

    model_config = ConfigDict(
        extra="forbid",
        allow_inf_nan=False,
        serialize_by_alias=True,
        from_attributes=True,
        frozen=True,
        defer_build=True,  # a record that is only read needs no validators of its parts by themselves
    )

    def __repr__(self) -> str:
        fields_text = (f"{name}={_short(getattr(self, name))}" for name in type(self).model_fields)
        return f"<{type(self).__name__}: {', '.join(fields_text)}>"

    __str__ = __repr__


def in_unit(value: Any, unit: float) -> Any:
    """Numbers of SI units, one, many or by name, in a unit; None stays."""
    if isinstance(value, Mapping):
        return {name: in_unit(entry, unit) for name, entry in value.items()}
    return None if value is None else (np.asarray(value) / unit).tolist()


def _short(value: Any) -> str:
    """A value for the interpreter: what holds many is counted."""
    if isinstance(value, BaseModel):
        return f"<{type(value).__name__}>"
    if isinstance(value, (list, tuple, dict)) and len(value) > 4:
        return f"<{len(value)} items>"
    text = repr(value)
    return text if len(text) <= 80 else text[:79] + "…"
