"""Figures of a study: which there are, and what is drawn is what was found."""

import numpy as np
import pytest

from irbcal.studies import folder
from irbcal.studies.figures import drawn, figures, plotted
from irbcal.studies.results import COMPARED
from irbcal.studies.settings import COURSE, procedures


@pytest.fixture(scope="module")
def series(done, results, tmp_path_factory):
    parts = tmp_path_factory.mktemp("figures") / "parts"
    parts.mkdir()
    for r in drawn(results):
        (parts / f"{r.name}.npz").write_bytes(done[r][1])
    return folder.series_of(parts.parent, results)


def test_the_figures_are_those_of_the_thesis_and_a_few_more(results):
    every = {item.key: item for item in figures(results)}
    numbers = [int(key.rsplit("-", 1)[1]) for key in every if key.startswith("figure-7-")]
    assert numbers == [2, *range(4, 12), *range(13, 20)]  # 7.1, 7.3 and 7.12 show places and procedures, not errors
    assert {key for key in every if not key.startswith("figure")} == {
        *("expected-found", "curve-iso_cube", "curve-all_range", "boxes-iso_cube", "boxes-all_range")
    }
    assert every["figure-7-2"].needs == (COURSE,)
    assert every["figure-7-17"].needs == tuple(procedures(results.settings))


def test_strips_hold_every_error_with_a_line_at_the_mean(results, series):
    item = next(item for item in figures(results) if item.key == "figure-7-6")
    (axes,) = plotted(item, results, series).axes
    lines = [line for line in axes.get_lines() if line.get_marker() == "o"]
    members = [COMPARED[name] for name in ("nominal", "11", "34")]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["nominal", "11\nparameters", "34\nparameters"]
    for line, repetition, mean in zip(lines, members, axes.collections, strict=True):
        values = series[repetition]["verified/iso_cube/6/point"]
        np.testing.assert_array_equal(line.get_ydata(), values)
        assert mean.get_segments()[0][:, 1] == pytest.approx(float(np.mean(values)), rel=1e-6)


def test_boxes_are_the_percentiles_of_the_rows(results, series):
    item = next(item for item in figures(results) if item.key == "boxes-iso_cube")
    (axes,) = plotted(item, results, series).axes
    for box, r in zip(axes.patches, procedures(results.settings), strict=True):
        row = results.row(r, "expected", "iso_cube", 3)
        assert (box.get_y(), box.get_y() + box.get_height()) == pytest.approx((row["p25"], row["p75"]), rel=1e-9)
