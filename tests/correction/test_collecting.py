"""The collector rests, and goes on as it did."""

import gc

import pytest

from irbcal.correction.collecting import resting


def fails():
    with resting():
        assert not gc.isenabled()
        raise KeyError


def test_the_collector_is_as_it_was_even_after_an_error():
    assert gc.isenabled()
    with pytest.raises(KeyError):
        fails()
    assert gc.isenabled()
    gc.disable()
    with resting():
        assert not gc.isenabled()
    assert not gc.isenabled(), "it was off before"
    gc.enable()
