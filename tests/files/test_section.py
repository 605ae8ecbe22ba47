"""Every part of ``calibration.json`` takes nothing unknown."""

import pytest
from pydantic import ValidationError

from irbcal.files.section import Section


class Number(Section):
    value: float


def test_unknown_keys_and_numbers_that_are_none_are_refused():
    assert Number(value=1.0).value == 1.0
    with pytest.raises(ValidationError, match="extra"):
        Number(value=1.0, other=2.0)
    with pytest.raises(ValidationError, match="finite"):
        Number(value=float("nan"))
