"""How poses are chosen and put in order: axis moves first, samples everywhere, optimal poses for what is there."""

import numpy as np
import pytest
from planning_support import CHEAP, PLACE, Wall, gantry, recheck, setting
from support import arm, random_robot

from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling.largest_cube import largest_cube
from irbcal.modeling.robot import Robot
from irbcal.planning import choosing, conditions
from irbcal.planning.choosing import axis_moves, random_poses
from irbcal.planning.conditions import SOLID, Setting, Targets
from irbcal.planning.optimal_design import Model
from irbcal.planning.plan_options import READINGS_S, PlanOptions
from irbcal.planning.scene import open_scene
from irbcal.simulation import instruments
from irbcal.simulation.instruments import IRB1600_CUBE
from irbcal.units import DEG, MM


def test_the_robot_stands_still_for_rest_and_readings():
    asked = np.array([[True, True, False], [False, False, True]])
    assert PlanOptions("irb1600", wait_s=3.0, references=2).hold_s(asked).tolist() == [
        3.0 + 4 * READINGS_S,
        3.0 + 3 * READINGS_S,
    ]


@pytest.mark.parametrize(("name", "value"), [("cube", -1), ("candidates", 1), ("references", -2), ("speed", 0.0)])
def test_numbers_below_the_least_are_refused(name, value):
    with pytest.raises(OptionError, match=f"{name}: expected ") as refusal:
        PlanOptions("irb1600", **{name: value})
    assert refusal.value.parameter == name


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", -1), ("optimal", "x"), ("cube", 99_999_999_999), ("cube", 1.5), ("wait_s", -1), ("speed", "x")],
)
def test_what_is_no_number_or_too_large_is_refused(name, value):
    with pytest.raises(OptionError, match=f"{name}: expected a .*found") as refused:
        PlanOptions("irb1600", **{name: value})
    assert refused.value.parameter == name


def test_every_random_pose_meets_its_conditions_and_the_counts_add_up():
    everything = tuple(conditions.CONDITIONS)
    for region, inside in ((choosing.in_cube(*IRB1600_CUBE), True), (None, False)):
        found = choosing.random_poses(setting(everything), 40, "group", 3, region)
        good, tip = recheck(found.q, found.visible)
        assert good.all()
        if inside:
            assert np.abs(tip - [0.64565, 0.0, 1.1657]).max() <= 0.325
        assert set(found.groups) == {"group"}
        tally = found.tally
        assert tally.tried == tally.accepted + sum(tally.removed.values())
        assert list(tally.removed) == [*(["place"] if inside else []), *conditions.CONDITIONS]
        assert all(tally.removed[name] > 0 for name in conditions.CONDITIONS)


def test_wishes_that_cannot_be_met_name_the_conditions_with_their_counts(monkeypatch):
    monkeypatch.setattr(choosing, "MOST_TRIED", 100_000)
    with pytest.raises(MeasurementError) as refusal:
        choosing.random_poses(setting(acceptance=0.05 * DEG), 50, "iso_cube", 0, choosing.in_cube(*IRB1600_CUBE))
    sentence = str(refusal.value)
    assert sentence.startswith("only ")
    assert "of 50 iso_cube poses meet the conditions: of 100,000 candidates place removed " in sentence
    for name in CHEAP:
        assert f"{name} removed " in sentence


def test_seeds_decide_the_poses():
    first, same, other = (choosing.random_poses(setting(), 20, "g", seed).q for seed in (1, 1, 2))
    assert (first == same).all()
    assert not (first == other).any(axis=1).any()
    larger = choosing.random_poses(setting(), 30, "g", 1).q
    assert (larger[:20] == first).all()


def test_axis_moves_are_those_of_the_thesis():
    few = choosing.axis_moves(setting())
    assert np.degrees(few.q).round(9).tolist() == [
        (angle * np.eye(6)[joint]).tolist() for joint in range(6) for angle in (-30.0, 0.0, 30.0)
    ]
    assert few.groups.tolist() == [f"axis{joint}" for joint in range(1, 7) for _ in range(3)]
    many = choosing.axis_moves(setting(), wide=True)
    assert len(many.q) == 158
    second = np.degrees(many.q[many.groups == "axis2"])
    assert second[:, 1].round(9).tolist() == [*range(-40, 41, 10), *range(30, -41, -10)]
    assert np.abs(second[:, [0, 2, 3, 4, 5]]).max() == 0
    sixth = np.degrees(many.q[many.groups == "axis6"])[:, 5]
    assert sixth.round(9).tolist() == [*range(-180, 181, 10), *range(170, -181, -10)]


def test_axis_moves_need_one_reflector_that_is_seen_in_a_whole_group():
    class Hiding(Wall):
        def blocked(self, theta, points, place, asked=None):
            out = np.zeros(points.shape[:2], dtype=bool)
            out[theta[:, 0] < 0, 0] = True  # each reflector is hidden in some pose of axis 1
            out[theta[:, 0] == 0, 1] = True
            out[theta[:, 0] > 0, 2] = True
            return out

    with pytest.raises(MeasurementError, match="no reflector can be seen in all poses of axis1"):
        choosing.axis_moves(setting(("sight",), solids=Hiding()))

    class Partly(Hiding):
        def blocked(self, theta, points, place, asked=None):
            return super().blocked(theta, points, place) & [True, True, False]

    seen = choosing.axis_moves(setting(("sight",), solids=Partly())).visible
    assert seen[:3].tolist() == [[False, False, True]] * 3
    assert seen[3:].tolist() == [[True, False, True]] * 15  # joint 1 is at zero there


def test_axis_moves_that_collide_are_refused_with_their_counts():
    class Touching(Wall):
        def touching(self, theta):
            return theta[:, 1] > 0.1

    with pytest.raises(MeasurementError, match=r"axis2\).*collision removed 1"):
        choosing.axis_moves(setting(("limits", "collision"), solids=Touching()))


def test_axis_moves_are_scaled_into_the_limits():
    carriage = Setting(Robot(gantry()), Targets(("t",), [[0, 0, 0]]), PLACE, ("limits",), margin=2 * DEG)
    q = choosing.axis_moves(carriage).q
    # 30 degrees count as 300 mm; the margin of 2 degrees as 20 mm
    assert q[:3, 0] == pytest.approx([0.3, 0.6, 0.9])
    assert q[3:6, 1] == pytest.approx([-0.3, 0.0, 0.3])
    tight = Setting(Robot(gantry(0.2, 0.4)), Targets(("t",), [[0, 0, 0]]), PLACE, ("limits",), margin=2 * DEG)
    assert choosing.axis_moves(tight).q[:3, 0] == pytest.approx([0.22, 0.3, 0.38])


def test_the_first_reflectors_seen_are_measured():
    seen = np.array([[1, 1, 1, 1], [0, 1, 0, 1], [0, 0, 0, 1]], dtype=bool)
    assert choosing.first_seen(seen, 2).astype(int).tolist() == [[1, 1, 0, 0], [0, 1, 0, 1], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("travel", "axis", "middle", "shortest", "longest"),
    [
        ({}, 0, 0.6, 0.8, 1.4),
        ({"x1": 1.7, "y1": 0.29}, 1, -0.105, 0.79, 1.5),
        ({"x1": 2.05}, 2, 0.9, 1.2, 1.85),
    ],
    ids=["x", "y", "z"],
)
def test_the_largest_cube_stands_in_the_middle_of_the_shortest_travel(travel, axis, middle, shortest, longest):
    """To half a cell, and as wide as the travel but for the cells at its ends and one more on each side."""
    centre, edge = largest_cube(gantry(**travel), samples=300_000)
    cell = longest / 60
    assert abs(centre[axis] - middle) < 0.6 * cell
    assert shortest - 3.5 * cell <= edge <= shortest - cell


def test_the_largest_cube_of_a_gantry_is_its_shortest_travel():
    """A gantry reaches a box: 0.8 x 1.4 x 1.2 m. Cells are 1.4 / 60 m; the cube is at most three of them smaller."""
    centre, edge = largest_cube(gantry(), samples=300_000)
    cell = 1.4 / 60
    assert 0.8 - 4 * cell <= edge <= 0.8
    assert np.all(centre - edge / 2 >= [0.2 - cell / 2, -0.5, 0.3])
    assert np.all(centre + edge / 2 <= [1.0 + cell / 2, 0.9, 1.5])
    assert abs(centre[1]) < 1e-9
    assert largest_cube(gantry(-1.0, 0.5), samples=300_000)[1] == pytest.approx(0.5, abs=0.12)  # only in front
    with pytest.raises(MeasurementError, match="reaches nothing in front"):
        largest_cube(gantry(-2.0, -1.0), samples=50_000)


@pytest.mark.parametrize("axis", range(3))
def test_one_layer_of_cells_without_a_sample_does_not_divide_the_largest_cube(axis):
    """Two do: half the travel of that axis is left, but for three cells at the ends of the cube."""
    box = gantry(0.0, 1.0, 0.5)  # 1 x 1 x 1.2 m
    cell, travel = 1.2 / 60, box.upper[axis] - box.lower[axis]
    # layers begin at x = 0, half a cell below the lowest y, which is a whole number of cells, and at the lowest z
    layer = box.lower[axis] + (24.5 if axis == 1 else 24.0) * cell
    edges = {}
    for layers in (0, 1, 2):
        empty = layer - 0.1 * cell, layer + (layers + 0.1) * cell
        edges[layers] = largest_cube(box, lambda q, e=empty: (q[:, axis] < e[0]) | (q[:, axis] > e[1]))[1]
    assert edges[0] == edges[1]
    assert edges[2] < travel - 24 * cell


def test_the_thesis_cube_is_for_the_irb_1600_calibrated_or_not():
    centre, edge = instruments.iso_cube(arm())
    assert (centre / MM).tolist() == pytest.approx([645.6547, 0.0, 1165.707])
    assert edge == 650 * MM
    calibrated = random_robot(arm(), "26", np.random.default_rng(0), size=0.1).arm
    assert instruments.iso_cube(calibrated)[1] == edge
    assert not instruments.has_thesis_cube(arm("irb120"))


SCENE = open_scene(PlanOptions("irb1600", ignore=tuple(SOLID)))


def test_samples_fill_both_volumes_whether_the_tracker_sees_them_or_not():
    there = choosing.samples(SCENE, [1, 2], lambda text: None)
    tip = SCENE.setting.tip_and_reflectors(there["cube"])[0]
    assert np.abs(tip - IRB1600_CUBE[0]).max() <= IRB1600_CUBE[1] / 2
    assert len(there["cube"]) == len(there["range"]) == choosing.VOLUME_SAMPLES


def test_axis_moves_come_first_and_the_others_lose_none():
    there = setting()
    axis, others = axis_moves(there), random_poses(there, 20, "all_range", 1)
    poses, over_home, _ = choosing.in_order(SCENE, [axis], [others], np.zeros(6))
    np.testing.assert_array_equal(poses.q[:18], axis.q)
    assert sorted(map(tuple, poses.q[18:])) == sorted(map(tuple, others.q))
    assert len(over_home) == 38


def test_chosen_poses_come_from_both_kinds_of_candidates_and_beat_random_ones():
    steps = []
    there = choosing.samples(SCENE, [1, 2], steps.append)
    model = Model(SCENE.nominal, SCENE.setting.targets, "26")
    request = PlanOptions("irb1600", optimal=8, candidates=80, axis=0, cube=0, all_range=0)
    poses, comparison, tallies = choosing.optimal(SCENE, request, model, [], there, [3, 4], steps.append)
    assert set(poses.groups) == {"optimal_iso_cube", "optimal_all_range"}
    assert comparison.optimal < comparison.random[8]
    assert [tally.accepted >= 40 for tally in tallies.values()] == [True, True]
    assert "8 poses of 80 candidates" in steps
