"""Poses of a plan: each checked again by other means, counts that add up, moves of one joint."""

import numpy as np
import pytest
from planning_support import CHEAP, PLACE, Wall, gantry, recheck, setting

from irbcal.errors import MeasurementError
from irbcal.modeling.robot import Robot
from irbcal.planning import choosing, conditions
from irbcal.planning.conditions import Setting, Targets
from irbcal.simulation.instruments import IRB1600_CUBE
from irbcal.units import DEG


def test_every_random_pose_meets_its_conditions_and_the_counts_add_up():
    everything = tuple(conditions.CONDITIONS)
    for region, inside in ((choosing.in_cube(*IRB1600_CUBE), True), (None, False)):
        found = choosing.random_poses(setting(everything), 40, "group", 3, region)
        good, tip = recheck(found.q, found.seen)
        assert good.all()
        if inside:
            assert np.abs(tip - [0.64565, 0.0, 1.1657]).max() <= 0.325
        assert set(found.groups) == {"group"}
        tally = found.tally
        assert tally.tried == tally.kept + sum(tally.removed.values())
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

    seen = choosing.axis_moves(setting(("sight",), solids=Partly())).seen
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
