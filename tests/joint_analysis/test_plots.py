"""Figures: those that the measurements allow, by name and as files."""

import numpy as np
import pytest
from chart_data import given, texts
from moving import moves, random_commands, refusal, simulated, there_and_back

from irbcal.joint_analysis import behaviour
from irbcal.joint_analysis.behaviour import JointBehaviour
from irbcal.joint_analysis.moves import analyse_moves
from irbcal.joint_analysis.residuals import analyse_residuals

__all__ = ["given"]


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
    files = behaviour.draw(found)
    assert list(files) == [f"{name}.png" for name in found.figures]
    assert all(content.startswith(b"\x89PNG") for content in files.values())


def test_a_figure_shows_the_errors_of_each_home_pose(found, given):
    chart = found.plot("stiffness_joint_2")
    for k, series in enumerate(found.moves[0].series):
        ((kind, x, y),) = given[f"error{k}"]
        assert kind == "dots"
        assert x == pytest.approx(np.degrees(series.turn), abs=1e-9)
        assert y == pytest.approx(np.degrees(series.angle), abs=1e-12)
    assert chart.mark + chart.caption == "SIMULATED data. Equivalent error of joint 2"


def test_other_figures_are_refused(found):
    assert refusal(found.plot, "backlash").startswith("figure: expected errors_axis2_1, errors_axis2_2,")


@pytest.fixture(scope="module")
def few():
    """Few random poses: joint 1 never moves, and there are too few poses for means."""
    q = random_commands(24, 1)
    q[:, 0] = 0.3
    points, step, robot = simulated(q, noise=1e-5, rng=np.random.default_rng(0))
    seen = analyse_residuals(robot.arm, points, step)
    return JointBehaviour("points.csv", True, (), seen)


def test_the_caption_says_where_there_are_no_means(few, given):
    chart = few.plot("residuals_by_direction")
    assert [word for word in texts(chart) if word.startswith("joint")] == [f"joint {k} (deg)" for k in (2, 3, 4, 5, 6)]
    assert chart.caption.endswith("At joints 2, 3, 4, 5, 6, 24 poses are too few for means of both directions")
    count = sum(len(x) for colour in ("below", "above") for kind, x, _ in given[colour] if kind == "dots")
    assert count > 5 * 10


def test_words_of_panels_stay_in_their_drawings(few):
    for drawing in few.plot("residuals_by_direction").drawings:
        for item in drawing.items:
            if hasattr(item, "text") and item.upright:
                wide = 0.56 * item.size * len(item.text)
                left = item.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * wide
                assert -2 < left < left + wide < drawing.width + 4, item.text
                assert 0 < item.y < drawing.height
