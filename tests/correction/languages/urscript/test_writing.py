"""The mark and the numbers of URScript; the reader's tests go through both."""

from irbcal.correction.languages.urscript.writing import UNIVERSAL_ROBOTS


def test_units_are_si():
    assert (UNIVERSAL_ROBOTS.length, UNIVERSAL_ROBOTS.angle, UNIVERSAL_ROBOTS.joint) == (1, 1, 1)
