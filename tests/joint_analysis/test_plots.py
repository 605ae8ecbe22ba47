"""Figures: those that the measurements allow, by name and as files."""

import numpy as np
import pytest
from moving import moves, random_commands, refusal, simulated, there_and_back

from irbcal.joint_analysis import plots
from irbcal.joint_analysis.behaviour import JointBehaviour
from irbcal.joint_analysis.moves import analyse_moves
from irbcal.joint_analysis.residuals import analyse_residuals


@pytest.fixture(scope="module")
def found():
    q = np.vstack([moves(2, there_and_back(-40, 40, 10)), moves(2, there_and_back(-40, 40, 10), (0, 0, -60, 0, 30, 0))])
    groups = np.full(len(q), "axis2", object)
    points, step, _ = simulated(q, groups, noise=1e-5, rng=np.random.default_rng(0), stiffness=(8e-4, 4e-4))
    return JointBehaviour("points.csv", True, tuple(analyse_moves(points, step)), None)


def test_figures_by_name_are_those_of_the_files(found):
    assert found.figures == (
        "errors_axis2_1",
        "errors_axis2_2",
        "fourier_joint_2",
        "angular_errors",
        "stiffness_joint_2",
    )
    files = plots.draw(found)
    assert list(files) == [f"{name}.png" for name in found.figures]
    assert all(content.startswith(b"\x89PNG") for content in files.values())


def test_a_figure_shows_the_errors_of_each_home_pose(found):
    figure = found.plot("stiffness_joint_2")
    (axes,) = figure.axes
    drawn = [line for line in axes.get_lines() if line.get_marker() == "."]
    for line, series in zip(drawn, found.moves[0].series, strict=True):
        assert line.get_xdata() == pytest.approx(np.degrees(series.turn), abs=1e-9)
        assert line.get_ydata() == pytest.approx(np.degrees(series.angle), abs=1e-12)
    assert figure.get_suptitle() == "SIMULATED data: equivalent error of joint 2"


def test_other_figures_are_refused(found):
    assert refusal(found.plot, "backlash").startswith("figure: expected errors_axis2_1, errors_axis2_2,")


@pytest.fixture(scope="module")
def few():
    """Few random poses: joint 1 never moves, and there are too few poses for means."""
    q = random_commands(24, 1)
    q[:, 0] = 0.3
    points, step, robot = simulated(q, noise=1e-5, rng=np.random.default_rng(0))
    seen = analyse_residuals(robot, points, step)
    return JointBehaviour("points.csv", True, (), seen)


def test_panels_say_where_there_are_no_means(few):
    figure = few.plot("residuals_by_direction")
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_xlabel().split(";")[0] for axes in shown] == [f"joint {k} (deg)" for k in (2, 3, 4, 5, 6)]
    for axes in shown:
        assert sum(len(line.get_xdata()) for line in axes.get_lines() if line.get_marker() == ".") > 10
        assert axes.get_xlabel().split("; ")[1].startswith("too few poses for means")


def test_words_of_panels_neither_collide_nor_leave_the_figure(few):
    figure = few.plot("residuals_by_direction")
    figure.draw_without_rendering()
    width, height = figure.bbox.size
    labels = [axes.xaxis.label.get_window_extent() for axes in figure.axes[:3]]
    titles = [axes.get_tightbbox() for axes in figure.axes[3:] if axes.get_visible()]
    assert min(box.y0 for box in labels) > max(box.y1 for box in titles) + 4
    for axes in filter(lambda axes: axes.get_visible(), figure.axes):
        box = axes.yaxis.label.get_window_extent()
        assert box.x0 > 8
        assert 0 < box.y0 < box.y1 < height
        assert box.x1 < width
