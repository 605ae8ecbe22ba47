"""Figures: what is drawn is what was found."""

from dataclasses import replace

import numpy as np
import pytest

from irbcal.correction.paths import Reversal
from irbcal.figures import colours
from irbcal.figures.drawn_figure import DrawnFigure
from irbcal.validation import ballbar_check, plots
from irbcal.validation.path_check import PathCheck
from irbcal.validation.path_criteria import PathErrors
from irbcal.validation.scale_bar import ScaleBar
from irbcal.validation.settling import stabilisation
from irbcal.validation.settling_check import Settling


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (0.99, 0.5), (7.0, 5.0), (2.0, 2.0), (345.0, 200.0), (0.02, 0.02)]
)
def test_round_numbers(value, expected):
    assert plots.round_number(value) == pytest.approx(expected)


def test_runs_of_labels():
    assert plots._runs(["a", "a", "b", "a"]) == [(0, 2, "a"), (2, 3, "b"), (3, 4, "a")]


def test_marks_of_neighbours_are_one():
    turns = [Reversal(0.5, 2, 0.1, "max"), Reversal(0.1, 1, 0.1, "min"), Reversal(0.51, 3, 0.1, "min")]
    (first, one), (second, two) = plots._marks(turns)
    assert (one, two) == ("J1 min", "J2 max\nJ3 min")
    assert (first, second) == (pytest.approx(0.2 * np.pi), pytest.approx(2 * np.pi * 0.505))


def test_scale_bar_has_a_mean_for_each_position():
    found = ScaleBar(1.0, np.array(["A", "A", "B"], dtype=object), np.array([1e-6, 3e-6, -4e-6]))
    (axes,) = found.plot().figure.axes
    means = [line.get_ydata()[0] for line in axes.get_lines() if line.get_color() == colours.ACCENT]
    assert means == pytest.approx([0.002, -0.004])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["A", "B"]
    assert axes.get_xticks().tolist() == [0.5, 2.0]


def test_approaches_are_drawn_with_their_settling():
    time = np.arange(4.0)
    xyz = np.column_stack([[3e-3, 2e-3, 0.0, 0.0], np.zeros((4, 2))])
    found = Settling(1e-3, 2.0, {"7": stabilisation(time, xyz, np.zeros(3), 1e-3)})
    figure = found.plot().figure
    axes = figure.axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_lines()[0].get_ydata().tolist() == pytest.approx([3, 2, 1e-4, 1e-4])
    assert axes.get_lines()[1].get_xdata() == pytest.approx([1.5, 1.5])
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert labels == ["run 7: PSt 0.00 s", "band 1 mm"]


def test_path_errors_along_the_way():
    errors = PathErrors(np.array([[3e-3, 4e-3, 0], [0, 0, 1e-3]]), np.array([1e-3, 2e-3]), None, None, np.arange(2))
    axes = PathCheck(errors, np.array([0.0, 0.1]), 2, 2).plot().figure.axes[0]
    mean, spread = (line.get_ydata() for line in axes.get_lines())
    assert (mean, spread) == (pytest.approx([5, 1]), pytest.approx([1, 2]))
    assert axes.get_lines()[0].get_xdata() == pytest.approx([0, 100])


def test_the_colour_of_a_model_is_the_reports():
    assert plots.COLOURS == {"nominal": colours.NOMINAL, "calibrated": colours.CALIBRATED, "measured": colours.MEASURED}


def test_figures_show_themselves():
    found = ScaleBar(1.0, np.array(["A", "A"], dtype=object), np.array([1e-6, 3e-6])).plot()
    assert isinstance(found, DrawnFigure)
    assert found._repr_png_().startswith(b"\x89PNG")


def test_words_on_the_rim_stand_apart_and_simulated_data_are_named(record):
    found = ballbar_check.ballbar(record)
    places = [
        (0.0, 1),
        (0.02, 2),
        (0.035, 3),
        (0.24, 4),
        (0.25, 6),
        (0.26, 5),
        (0.73, 1),
        (0.745, 5),
        (0.77, 5),
        (0.98, 3),
    ]
    crowd = tuple(Reversal(s, joint, 0.1, "min") for s, joint in places)
    found = replace(found, prediction=replace(found.prediction, reversals=crowd), simulated=True)
    figure = found.plot().figure
    figure.draw_without_rendering()
    words = [text for text in figure.axes[0].texts if text.get_text().startswith("J")]
    boxes = [text.get_window_extent() for text in words]
    assert len(boxes) >= 5
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    note = figure._supxlabel.get_window_extent()
    assert not any(box.overlaps(note) for box in boxes)
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "Calibration from SIMULATED data"
    assert not replace(found, simulated=False).plot().figure.legends[0].get_title().get_text()
