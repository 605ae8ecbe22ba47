"""The ISO cube of an arm: that of the thesis, and the largest one of another arm."""

import numpy as np
import pytest
from planning_support import gantry
from support import arm, random_robot

from irbcal.errors import MeasurementError
from irbcal.planning import scene
from irbcal.units import MM


def test_the_largest_cube_of_a_gantry_is_its_shortest_travel():
    """A gantry reaches a box: 0.8 x 1.4 x 1.2 m. Cells are 1.4 / 60 m; the cube is at most three of them smaller."""
    centre, edge = scene.largest_cube(gantry(), samples=300_000)
    cell = 1.4 / 60
    assert 0.8 - 4 * cell <= edge <= 0.8
    assert np.all(centre - edge / 2 >= [0.2 - cell / 2, -0.5, 0.3])
    assert np.all(centre + edge / 2 <= [1.0 + cell / 2, 0.9, 1.5])
    assert abs(centre[1]) < 1e-9
    assert scene.largest_cube(gantry(-1.0, 0.5), samples=300_000)[1] == pytest.approx(0.5, abs=0.12)  # only in front
    with pytest.raises(MeasurementError, match="reaches nothing in front"):
        scene.largest_cube(gantry(-2.0, -1.0), samples=50_000)


def test_the_thesis_cube_is_for_the_irb_1600_calibrated_or_not():
    centre, edge = scene.iso_cube(arm())
    assert (centre / MM).tolist() == pytest.approx([645.6547, 0.0, 1165.707])
    assert edge == 650 * MM
    calibrated = random_robot(arm(), "26", np.random.default_rng(0), size=0.1).arm
    assert scene.iso_cube(calibrated)[1] == edge
    assert not scene.has_thesis_cube(arm("irb120"))
