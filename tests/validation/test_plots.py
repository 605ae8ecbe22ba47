"""Charts of the validation: what is drawn is what was found."""

from dataclasses import replace

import numpy as np
import pytest
from chart_data import given, texts

from irbcal.correction.paths import Reversal
from irbcal.plotting.charts import FONT
from irbcal.validation import ballbar_check
from irbcal.validation.comparing import COLOURS, Compared
from irbcal.validation.iso9283_check import PathCheck, PathErrors
from irbcal.validation.settling import Settling, stabilisation
from irbcal.validation.tracker_check import ScaleBar

__all__ = ["given"]


def test_marks_of_neighbours_are_one():
    turns = [Reversal(0.5, 2, 0.1, "max"), Reversal(0.1, 1, 0.1, "min"), Reversal(0.51, 3, 0.1, "min")]
    (first, one), (second, two) = ballbar_check._marks(turns)
    assert (one, two) == ("J1 min", "J2 max\nJ3 min")
    assert (first, second) == (pytest.approx(0.2 * np.pi), pytest.approx(2 * np.pi * 0.505))


def test_scale_bar_has_a_mean_for_each_position(given):
    found = ScaleBar(1.0, np.array(["A", "A", "B"], dtype=object), np.array([1e-6, 3e-6, -4e-6]), 0)
    chart = found.plot()
    assert [y[0] for _, _, y in given["accent"]] == pytest.approx([0.002, -0.004])
    ((_, x, y),) = [row for row in given["measured"] if row[0] == "dots"]
    assert (x.tolist(), y) == ([0, 1, 2], pytest.approx([0.001, 0.003, -0.004]))
    assert {"A", "B"} <= set(texts(chart))
    assert chart._repr_svg_().startswith("<?xml")


def test_approaches_are_drawn_with_their_settling(given):
    time = np.arange(4.0)
    xyz = np.column_stack([[3e-3, 2e-3, 0.0, 0.0], np.zeros((4, 2))])
    chart = Settling(1e-3, 2.0, {"7": stabilisation(time, xyz, np.zeros(3), 1e-3)}).plot()
    (_, _, distance), (_, settled, _) = given["series0"]
    assert distance == pytest.approx([3, 2, 1e-4, 1e-4])
    assert settled == pytest.approx([1.5, 1.5])
    assert [words for *_, words in chart.legend] == ["run 7: PSt 0.00 s", "band 1 mm"]


def test_path_errors_along_the_way(given):
    errors = PathErrors(np.array([[3e-3, 4e-3, 0], [0, 0, 1e-3]]), np.array([1e-3, 2e-3]), None, None, np.arange(2))
    PathCheck(errors, np.array([0.0, 0.1]), 2, 2).plot()
    ((_, x, mean),), ((_, _, spread),) = given["measured"], given["accent"]
    assert (mean, spread) == (pytest.approx([5, 1]), pytest.approx([1, 2]))
    assert x == pytest.approx([0, 100])


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
    chart = found.plot()
    (drawing,) = chart.drawings
    words = [item for item in drawing.marks if getattr(item, "text", "").startswith("J")]
    assert len(words) == len(places)
    boxes = []
    for word in words:
        wide = 0.56 * word.size * len(word.text)
        left = word.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[word.anchor] * wide
        boxes.append((left, word.y - 0.5 * word.size, left + wide, word.y + 0.5 * word.size))
        assert 0 < left < left + wide < drawing.width
        assert 0.5 * FONT < word.y < drawing.height - 0.5 * FONT
    for k, (x0, y0, x1, y1) in enumerate(boxes):
        assert not any(x0 < b[2] and b[0] < x1 and y0 < b[3] and b[1] < y1 for b in boxes[:k])
    assert chart.mark == "Calibration from SIMULATED data. "
    assert not replace(found, simulated=False).plot().mark


@pytest.fixture
def compared():
    error = np.random.default_rng(0).random((30, 3))
    names = ("a", "b", "c")
    statistics = {name: {"mean_mm": float(error[:, k].mean())} for k, name in enumerate(names)}
    poses = tuple(str(k) for k in range(30))
    return Compared(names, names, statistics, poses, poses, error, error, (), 0, (), (), (), True)


def test_every_calibration_side_by_side_is_drawn(compared, given):
    chart = compared.by_pose()
    best = compared.names.index(compared.ranking[0])
    for k, colour in enumerate(COLOURS[:3]):
        ((_, _, y),) = given[colour]
        assert sorted(y) == pytest.approx(sorted(compared.error_mm[:, k]))
    assert (np.diff(given[COLOURS[best]][0][2]) >= 0).all()
    assert len(chart.legend) == 3
    assert "SIMULATED" in chart.svg()
    given.clear()
    compared.shares()
    ((_, x, y),) = given[COLOURS[0]]
    for share in (0.25, 0.7):  # the step function is the share of errors at or below
        at = np.quantile(compared.distance_mm[:, 0], share) + 1e-9
        assert y[np.flatnonzero(x <= at)[-1]] == pytest.approx((compared.distance_mm[:, 0] <= at).mean())
    assert list(compared.plots()) == ["by_pose", "shares"]
