"""Colours are colours, and different things have different ones."""

import re

from irbcal.figures import colours


def test_models_directions_and_words_are_told_apart():
    names = (
        "NOMINAL",
        "CALIBRATED",
        "FROM_BELOW",
        "FROM_ABOVE",
        "UNKNOWN",
        "MEASURED",
        "ACCENT",
        "TEXT",
        "SOFT",
        "RULE",
    )
    values = [getattr(colours, name) for name in (*names, "PAPER")]
    assert all(re.fullmatch("#[0-9a-f]{6}", value) for value in (*values, *colours.ERRORS, *colours.SERIES))
    assert len(set(values)) == len(values)
    assert len(set(colours.ERRORS)) == len(colours.ERRORS)
    assert not set(colours.SERIES) & {colours.NOMINAL, colours.CALIBRATED}, "a run is no model"
