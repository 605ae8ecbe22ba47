"""Refused options become wrong calls that name the option as the command line does."""

import pytest
import typer

from irbcal.cli.wrong_calls import wrong_calls
from irbcal.errors import MeasurementError, OptionError


def refused(error, **options):
    with pytest.raises(typer.BadParameter) as found, wrong_calls(**options):
        raise error
    return found.value


def test_options_are_named():
    found = refused(OptionError("two cycles or more", parameter="set_size"))
    assert (found.param_hint, str(found)) == ("--set-size", "two cycles or more")
    assert refused(OptionError("give one", parameter="measurements"), measurements="FILE").param_hint == "FILE"
    assert refused(OptionError("no")).param_hint is None


def test_other_refusals_stay_what_they_are():
    with pytest.raises(MeasurementError, match="too few"), wrong_calls():
        raise MeasurementError("too few")
