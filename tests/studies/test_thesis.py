"""The thesis's figures keep their own arithmetic: mean + 3 sigma, as printed to three decimals."""

import pytest

from irbcal.studies import thesis


def fours(value):
    """All rows of four numbers in a table."""
    if isinstance(value, dict):
        return [row for item in value.values() for row in fours(item)]
    if isinstance(value[0], tuple):
        return [row for item in value for row in fours(item)]
    return [value] if len(value) == 4 else []


@pytest.mark.parametrize("number", [4, 5, 6, 7, 9, 10, 11, 12, 14, 15, 16])
def test_the_fourth_number_is_mean_plus_three_sigma(number):
    rows = fours(getattr(thesis, f"TABLE_7_{number}"))
    assert rows
    for mean, sigma, largest, last in rows:
        assert last == pytest.approx(mean + 3 * sigma, abs=0.0021)
        assert mean < largest


def test_table_7_1_with_its_last_column():
    for load, areas in thesis.TABLE_7_1.items():
        for (mean, sigma, _), last in zip(areas, thesis.TABLE_7_1_LAST[load], strict=True):
            assert last == pytest.approx(mean + 3 * sigma, abs=0.0021)
