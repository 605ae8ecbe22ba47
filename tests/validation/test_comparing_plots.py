"""Figures of calibrations side by side show all of them, and say that data are simulated."""

import numpy as np
import pytest

from irbcal.figures.style import drawn
from irbcal.validation import comparing_plots
from irbcal.validation.comparing import Compared


@pytest.fixture
def result():
    error = np.random.default_rng(0).random((30, 3))
    names = ("a", "b", "c")
    statistics = {name: {"mean_mm": float(error[:, k].mean())} for k, name in enumerate(names)}
    poses = tuple(str(k) for k in range(30))
    return Compared(names, names, statistics, poses, poses, error, error, (), 0, (), (), (), True)


@pytest.mark.parametrize("draw", [comparing_plots.by_pose, comparing_plots.shares])
def test_every_calibration_is_drawn(result, draw):
    figure = drawn(draw, (7.2, 4.4), result)
    lines = [line for line in figure.axes[0].get_lines() if len(line.get_xdata()) == 30]
    assert len(lines) == 3
    best = result.names.index(result.ranking[0])
    assert sorted(lines[best].get_ydata() if draw is comparing_plots.by_pose else lines[best].get_xdata()) == (
        pytest.approx(sorted(result.error_mm[:, best]))
    )
    assert "SIMULATED" in figure.get_suptitle()
    assert len(figure.legends[0].get_texts()) == 3
