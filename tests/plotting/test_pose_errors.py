"""Figures of pose errors show what was measured."""

from dataclasses import replace

import numpy as np
import pytest

import irbcal
from irbcal.error_statistics import statistics
from irbcal.io import robots
from irbcal.modeling.commanded_joints import line_at_home
from irbcal.plotting import pose_errors, pose_sets
from irbcal.plotting.charts import Dots, Lines, Text
from irbcal.plotting.pose_errors import arm_at_home, course, worst_poses


def test_normal_quantiles_of_normal_errors_lie_on_a_line():
    from irbcal.plotting.pose_errors import normal_quantiles

    value = np.random.default_rng(1).normal(3.0, 0.5, 5000)
    quantile, shown = normal_quantiles(value)
    assert len(shown) < 250
    assert shown[-1] == value.max()
    assert np.polyfit(quantile, shown, 1) == pytest.approx([0.5, 3.0], abs=0.02)


@pytest.fixture
def poses():
    """Errors whose largest is a round number, where an axis may end."""
    error = np.array([0.2, 0.6, 1.0, 1.5, 2.0]) * 1e-3
    models = {
        name: pose_sets.ModelErrors(statistics(error), size * error, size * error, None, None, None)
        for name, size in (("nominal", 1.0), ("calibrated", 0.1))
    }
    place = np.random.default_rng(0).normal(size=(5, 3))
    return pose_sets.PoseErrors("held-out", np.arange(5), tuple("abcde"), ("",) * 5, ("smr1",) * 5, models, place)


@pytest.mark.parametrize("draw", [pose_errors.errors_by_pose, pose_errors.distribution])
def test_marks_do_not_touch_the_edge(poses, draw):
    for drawing in draw(poses).drawings:
        frames = [item for item in drawing.marks if isinstance(item, Lines) and item.colour == "soft"]
        dots = [item for item in drawing.marks if isinstance(item, Dots)]
        if dots:
            head = min(place[1] for item in frames for path in item.paths for place in path)
            assert min(item.xy[:, 1].min() for item in dots) > head + 2.0


def test_one_value_is_a_dot_without_a_line(poses):
    error = np.array([1e-3])
    one = pose_sets.ModelErrors(statistics(error), error, error, None, None, None)
    of_one = replace(poses, models={"calibrated": one})
    marks = [
        [item.colour for item in pose_errors._quantiles(p).marks if isinstance(item, Lines)] for p in (of_one, poses)
    ]
    assert ["calibrated" in colours for colours in marks] == [False, True]
    assert len(pose_errors.distribution(of_one).drawings) == len(pose_errors.distribution(poses).drawings)


def test_classes_of_errors_have_as_many_decimals(poses):
    words = [words for _, _, words in pose_errors.workspace(poses).legend]
    decimals = {len(number.split(".")[1]) for text in words for number in text.split() if "." in number}
    assert len(decimals) == 1


def test_colours_are_shares_of_the_tolerance(poses):
    chart = pose_errors.workspace(poses, 0.5)
    names = ["below 0.125 mm", "0.125 to 0.25 mm", "0.25 to 0.375 mm", "0.375 to 0.5 mm", "0.5 mm and more"]
    assert [words for _, _, words in chart.legend] == names
    dots = [item for item in chart.drawings[0].marks if isinstance(item, Dots)]
    error = next(iter(poses.models.values())).per_pose * 1e3
    shares = np.minimum(np.floor(error / 0.125), 4).astype(int)
    counts = {item.colour: len(item.xy) for item in dots if item.colour.startswith("error")}
    assert counts == {f"error{k}": int((shares == k).sum()) for k in set(shares)}


def test_worst_poses_are_those_of_the_table_of_points(demo_calibration):
    record = irbcal.load(demo_calibration).record
    found = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"))
    worst = worst_poses(found.errors, found.origin.joints)
    table = found.to_frame()
    expected = table.groupby("pose")["calibrated_mm"].max().sort_values(ascending=False).head(10)
    assert [row.pose for row in worst] == list(expected.index)
    assert [row.error_mm for row in worst] == pytest.approx(list(expected), abs=1e-12)
    for row in worst:
        assert np.linalg.norm(row.vector_mm) == pytest.approx(row.error_mm, abs=1e-9)
        point = table[(table["pose"] == row.pose) & (table["target"] == row.target)].iloc[0]
        assert point["nominal_mm"] == pytest.approx(row.nominal_mm, abs=1e-12)
        assert len(row.joints) == 6
    assert worst_poses(found.errors, None, 3)[2].joints == ()


@pytest.mark.parametrize("robot", ["irb120", "kuka/kr16-2"])
def test_views_of_one_figure_have_one_scale(robot):
    arm = irbcal.read_urdf(robot).arm
    line = line_at_home(arm) / 1e-3  # mm
    above, side = (
        next(np.asarray(m.paths[0]) for m in d.marks if isinstance(m, Lines) and m.width == 10.0)
        for d in arm_at_home(arm).drawings
    )
    scale = np.ptp(above[:, 0]) / np.ptp(line[:, 0])
    assert np.ptp(side[:, 0]) == pytest.approx(scale * np.ptp(line[:, 0]))
    assert np.ptp(side[:, 1]) == pytest.approx(scale * np.ptp(line[:, 2]))


def test_the_course_of_many_iterations_is_lines_whose_sets_are_numbered():
    def drawn(count):
        names = [f"{name}_{statistic}_mm" for name in ("cube", "range") for statistic in ("mean", "max")]
        falling = {name: np.linspace(9.0, k + 1.0, count).tolist() for k, name in enumerate(["objective_mm", *names])}
        (drawing,) = course({"iteration": np.arange(count).tolist()} | falling).drawings
        dots = [mark for mark in drawing.marks if isinstance(mark, Dots)]
        numbers = {(mark.text, mark.y) for mark in drawing.marks if isinstance(mark, Text) and mark.colour == "accent"}
        lines = [mark.paths[0] for mark in drawing.marks if isinstance(mark, Lines) and mark.colour == "accent"]
        assert numbers == {(text, path[-1][1]) for text, path in zip("1122", lines, strict=True)}
        return len(dots)

    assert drawn(20) == 5
    assert drawn(400) == 0
