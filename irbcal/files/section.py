"""What every part of ``calibration.json`` is: a checked model that takes nothing unknown."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A part of ``calibration.json``; unknown keys, NaN and infinities are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, serialize_by_alias=True)
