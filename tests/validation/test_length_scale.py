"""A tracker's scale is taken for link lengths: told by the nominal ones, and said on the certificate."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured, random_robot

import irbcal
from irbcal.identification.fit import identify
from irbcal.io import robots
from irbcal.units import MM
from irbcal.validation import doubts
from irbcal.validation.doubts import length_scale


@pytest.fixture(scope="module")
def points():
    rng = np.random.default_rng(8)
    nominal = arm()
    return measured(random_robot(nominal, "26", rng, size=0.06), nominal.random_joints(60, 8), 2e-5, rng)


def fits(points):
    return [identify(arm(), points, level) for level in ("nominal", "26")]


@pytest.mark.parametrize("scale", [1.0005, 1.001, 0.9986])
def test_the_share_is_that_of_the_tracker(points, scale):
    plain, scaled = (fits(p)[1].robot.arm for p in (points, replace(points, xyz=scale * points.xyz)))
    before, after = (length_scale(arm(), robot) for robot in (plain, scaled))
    assert after.share - before.share == pytest.approx(scale - 1.0, rel=0.1)
    assert abs(before.share) < 3.0 * before.std


@pytest.mark.parametrize(("scale", "doubted"), [(1.0, False), (1.001, True), (0.9986, True)])
def test_a_wrong_scale_of_the_tracker_is_a_doubt(points, scale, doubted):
    seen = replace(points, xyz=scale * points.xyz)
    nominal, fit = fits(seen)
    assert fit.rms < 5e-5, "no residual shows it"
    said = doubts.doubts(nominal, fit, seen, [seen])
    assert any("scale bar" in words for words in said) == doubted


def test_no_length_identified_says_nothing():
    assert length_scale(arm(), arm()) is None


def test_the_certificate_says_that_the_scale_is_not_proven(record):
    proof = robots.demo_file("demo_verification.csv")
    judged = irbcal.evaluate(record, proof, tolerance=0.95 * MM)
    (words,) = [words for words in judged.origin.scope if "scale" in words]
    assert "not proven" in words
    assert f"Note: {words}" in judged.report()
    stated = irbcal.evaluate(record, proof, tolerance=0.95 * MM, info={"scale_bar": "1001.2 mm, no. 7"})
    assert any("1001.2 mm, no. 7" in words for words in stated.origin.scope)
    assert not any("not proven" in words for words in stated.origin.scope)
