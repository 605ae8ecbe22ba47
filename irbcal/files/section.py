"""What every part of ``calibration.json`` is: a checked model that takes nothing unknown."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A part of ``calibration.json``; unknown keys, NaN and infinities are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, serialize_by_alias=True)

    def __repr__(self) -> str:
        parts = (f"{name}={_short(getattr(self, name))}" for name in type(self).model_fields)
        return f"<{type(self).__name__}: {', '.join(parts)}>"

    __str__ = __repr__


def _short(value: Any) -> str:
    """A value for the interpreter: what holds many is counted."""
    if isinstance(value, BaseModel):
        return f"<{type(value).__name__}>"
    if isinstance(value, (list, tuple, dict)) and len(value) > 4:
        return f"<{len(value)} items>"
    text = repr(value)
    return text if len(text) <= 80 else text[:79] + "…"
