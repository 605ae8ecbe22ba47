"""Measuring plans: each pose checked again by other means, counts that add up, short and free ways."""

import itertools

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.errors import MeasurementError
from irbcal.files import urdf, urdf_check
from irbcal.files.robots import robot_file
from irbcal.modeling.robot import Robot
from irbcal.planning import conditions, route
from irbcal.planning.conditions import Setting, Targets
from irbcal.thesis_setup import IRB1600_CUBE, IRB1600_HEIGHTS
from irbcal.units import DEG, MM

PLACE = np.array([1.55, 1.63, 1.51])
LOOK = np.array([-0.176, 0.898, 0.404])
TARGETS = Targets(
    ("smr1", "smr2", "smr5"),
    [[-0.087, 0.087, 0.109], [0.084, 0.084, 0.109], [-0.06, 0.06, 0.057]],
    [LOOK, LOOK, LOOK * [1, 1, -1]],
)
CHEAP = ("limits", "height", "acceptance")


class Wall:
    """Stands in for a robot's solids: what it says is known beforehand."""

    def touching(self, theta):
        return (theta[:, 3] > 2.0) | (theta[:, 4] > 0.9) & (theta[:, 4] < 1.2)

    def blocked(self, theta, points, place, asked=None):
        return (points[..., 1] < 0.0) | ~asked


def setting(conditions=CHEAP, **changes):
    values = {"heights": IRB1600_HEIGHTS, "solids": Wall()} | changes
    return Setting(Robot(arm()), TARGETS, PLACE, conditions, **values)


def angle(a, b):
    """Angle between two vectors by the law of cosines, degrees."""
    a, b = a / np.sqrt(a @ a), b / np.sqrt(b @ b)
    return np.degrees(np.arccos(np.clip(1 - (a - b) @ (a - b) / 2, -1, 1)))


def recheck(q, seen, margin_deg=2.0, acceptance_deg=30.0):
    """Limits, heights, acceptance and what the wall says, one pose at a time, with Pinocchio's forward kinematics."""
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    lower = np.array([-180, -90, -245, -200, -115, -400])
    upper = np.array([180, 120, 65, 200, 115, 400])
    good = []
    for joints, pose, row in zip(np.degrees(q), T, seen, strict=True):
        ok = (joints >= lower + margin_deg - 1e-9).all() and (joints <= upper - margin_deg + 1e-9).all()
        points = [pose[:3, :3] @ place + pose[:3, 3] for place in TARGETS.places]
        ok &= all(p[2] > (0.7 if p[0] >= 0.15 else 1.1) for p in [pose[:3, 3], *points])
        in_sight = [
            angle(pose[:3, :3] @ look, PLACE - p) <= acceptance_deg and p[1] >= 0
            for look, p in zip(TARGETS.directions, points, strict=True)
        ]
        ok &= joints[3] <= np.degrees(2.0) and joints[4] <= np.degrees(0.9)  # behind 1.2 there is no way from home
        good.append(ok and row.any() and row.tolist() == in_sight)
    return np.array(good), T[:, :3, 3]


def test_every_random_pose_meets_its_conditions_and_the_counts_add_up():
    everything = tuple(conditions.CONDITIONS)
    for region, inside in ((conditions.in_cube(*IRB1600_CUBE), True), (None, False)):
        found = conditions.random_poses(setting(everything), 40, "group", 3, region)
        good, tip = recheck(found.q, found.seen)
        assert good.all()
        if inside:
            assert np.abs(tip - [0.64565, 0.0, 1.1657]).max() <= 0.325
        assert set(found.groups) == {"group"}
        tally = found.tally
        assert tally.tried == tally.kept + sum(tally.removed.values())
        assert list(tally.removed) == [*(["place"] if inside else []), *conditions.CONDITIONS]
        assert all(tally.removed[name] > 0 for name in conditions.CONDITIONS)


def test_check_keeps_all_poses_that_meet_the_conditions():
    q = conditions.rounded(arm(), arm().random_joints(4000, 9))
    keep, seen = conditions.check(setting(tuple(conditions.CONDITIONS)), q)
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    points = TARGETS.places @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    looks = TARGETS.directions @ np.swapaxes(T[:, :3, :3], 1, 2)
    beam = PLACE - points
    cosine = np.sum(beam * looks, axis=-1) / np.linalg.norm(beam, axis=-1)
    in_sight = (np.degrees(np.arccos(cosine)) <= 30.0) & (points[..., 1] >= 0)
    good, _ = recheck(q, in_sight)
    assert (keep == good).all()
    assert (seen[keep] == in_sight[keep]).all()
    assert not seen[~keep].any()
    assert keep.sum() > 20


def test_conditions_can_be_switched_off_and_are_off_where_nothing_is_known():
    assert setting(()).conditions == ()
    assert setting(("sight", "limits")).conditions == ("limits", "sight")  # in the order of checking
    blind = Targets(TARGETS.names, TARGETS.places)
    free = Setting(Robot(arm()), blind, PLACE, tuple(conditions.CONDITIONS), solids=Wall())
    assert free.conditions == ("limits", "collision", "sight", "way")
    q = arm().random_joints(500, 0)
    assert conditions.check(setting(()), q)[0].all()
    with pytest.raises(MeasurementError, match="unknown condition 'luck': conditions are limits, height, acceptance"):
        setting(("luck",))
    with pytest.raises(MeasurementError, match="need the robot's collision geometry"):
        setting(("sight",), solids=None)


def test_wishes_that_cannot_be_met_name_the_conditions_with_their_counts(monkeypatch):
    monkeypatch.setattr(conditions, "MOST_TRIED", 100_000)
    with pytest.raises(MeasurementError) as refusal:
        conditions.random_poses(setting(acceptance=0.05 * DEG), 50, "iso_cube", 0, conditions.in_cube(*IRB1600_CUBE))
    sentence = str(refusal.value)
    assert sentence.startswith("only ")
    assert "of 50 iso_cube poses meet the conditions: of 100,000 candidates place removed " in sentence
    for name in CHEAP:
        assert f"{name} removed " in sentence


def test_seeds_decide_the_poses():
    first, same, other = (conditions.random_poses(setting(), 20, "g", seed).q for seed in (1, 1, 2))
    assert (first == same).all()
    assert not (first == other).any(axis=1).any()
    larger = conditions.random_poses(setting(), 30, "g", 1).q
    assert (larger[:20] == first).all()


def test_joints_are_what_can_be_commanded():
    q = np.degrees(conditions.random_poses(setting(), 30, "g", 0).q)
    assert np.abs(q - np.round(q, 4)).max() < 1e-11


def test_axis_moves_are_those_of_the_thesis():
    few = conditions.axis_moves(setting())
    assert np.degrees(few.q).round(9).tolist() == [
        (angle * np.eye(6)[joint]).tolist() for joint in range(6) for angle in (-30.0, 0.0, 30.0)
    ]
    assert few.groups.tolist() == [f"axis{joint}" for joint in range(1, 7) for _ in range(3)]
    many = conditions.axis_moves(setting(), many=True)
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
        conditions.axis_moves(setting(("sight",), solids=Hiding()))

    class Partly(Hiding):
        def blocked(self, theta, points, place, asked=None):
            return super().blocked(theta, points, place) & [True, True, False]

    seen = conditions.axis_moves(setting(("sight",), solids=Partly())).seen
    assert seen[:3].tolist() == [[False, False, True]] * 3
    assert seen[3:].tolist() == [[True, False, True]] * 15  # joint 1 is at zero there


def test_axis_moves_that_collide_are_refused_with_their_counts():
    class Touching(Wall):
        def touching(self, theta):
            return theta[:, 1] > 0.1

    with pytest.raises(MeasurementError, match=r"axis2\).*collision removed 1"):
        conditions.axis_moves(setting(("limits", "collision"), solids=Touching()))


GANTRY = """<robot name="gantry"><link name="base_link"/><link name="a"/><link name="b"/><link name="tool0"/>
<joint name="x" type="prismatic"><parent link="base_link"/><child link="a"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
<limit lower="{x0}" upper="{x1}" effort="1" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.9" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="b"/><child link="tool0"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1.2" effort="1" velocity="1"/></joint></robot>"""


def gantry(x0=0.2, x1=1.0):
    return urdf.from_bytes(GANTRY.format(x0=x0, x1=x1).encode(), "gantry").arm


def test_the_largest_cube_of_a_gantry_is_its_shortest_travel():
    """A gantry reaches a box: 0.8 x 1.4 x 1.2 m. Cells are 1.4 / 60 m; the cube is at most three of them smaller."""
    centre, edge = conditions.largest_cube(gantry(), samples=300_000)
    cell = 1.4 / 60
    assert 0.8 - 4 * cell <= edge <= 0.8
    assert np.all(centre - edge / 2 >= [0.2 - cell / 2, -0.5, 0.3])
    assert np.all(centre + edge / 2 <= [1.0 + cell / 2, 0.9, 1.5])
    assert abs(centre[1]) < 1e-9
    assert conditions.largest_cube(gantry(-1.0, 0.5), samples=300_000)[1] == pytest.approx(
        0.5, abs=0.12
    )  # only in front
    with pytest.raises(MeasurementError, match="reaches nothing in front"):
        conditions.largest_cube(gantry(-2.0, -1.0), samples=50_000)


def test_home_is_zero_or_the_middle_of_limits_that_leave_no_room():
    assert conditions.home_joints(arm()).tolist() == [0.0] * 6
    assert conditions.home_joints(gantry()) == pytest.approx([0.6, 0.0, 0.6])


def test_axis_moves_are_scaled_into_the_limits():
    carriage = Setting(Robot(gantry()), Targets(("t",), [[0, 0, 0]]), PLACE, ("limits",), margin=2 * DEG)
    q = conditions.axis_moves(carriage).q
    # 30 degrees count as 300 mm; the margin of 2 degrees as 20 mm
    assert q[:3, 0] == pytest.approx([0.3, 0.6, 0.9])
    assert q[3:6, 1] == pytest.approx([-0.3, 0.0, 0.3])
    tight = Setting(Robot(gantry(0.2, 0.4)), Targets(("t",), [[0, 0, 0]]), PLACE, ("limits",), margin=2 * DEG)
    assert conditions.axis_moves(tight).q[:3, 0] == pytest.approx([0.22, 0.3, 0.38])


def test_the_thesis_cube_is_for_the_irb_1600_calibrated_or_not():
    centre, edge = conditions.iso_cube(arm())
    assert (centre / MM).tolist() == pytest.approx([645.6547, 0.0, 1165.707])
    assert edge == 650 * MM
    calibrated = random_robot(arm(), "26", np.random.default_rng(0), size=0.1).arm
    assert conditions.iso_cube(calibrated)[1] == edge
    assert not conditions.has_thesis_cube(arm("irb120"))


# --- order ---------------------------------------------------------------------------------------------------


def length(q, order, start):
    places = np.concatenate([start[None], q[list(order)]])
    return np.abs(np.diff(places, axis=0)).max(axis=1).sum()


def test_orders_are_permutations_near_the_shortest_of_all():
    rng = np.random.default_rng(1)
    excess = []
    for _ in range(8):
        q = rng.uniform(-1, 1, (7, 6))
        order, bad = route.shortest_order(q, np.zeros(6), np.ones(6))
        assert sorted(order) == list(range(7))
        assert not len(bad)
        best = min(length(q, p, np.zeros(6)) for p in itertools.permutations(range(7)))
        excess.append(length(q, order, np.zeros(6)) / best - 1)
    assert min(excess) >= -1e-12
    assert max(excess) < 0.15
    assert np.mean(excess) < 0.05


def test_orders_are_far_shorter_than_random_ones():
    rng = np.random.default_rng(2)
    q = rng.uniform(-1, 1, (100, 6))
    order, _ = route.shortest_order(q, np.zeros(6), np.ones(6))
    assert length(q, order, np.zeros(6)) < 0.6 * min(length(q, rng.permutation(100), np.zeros(6)) for _ in range(20))


def test_a_part_of_a_way_is_turned_where_that_makes_it_shorter():
    cost = np.abs(np.subtract.outer(np.arange(6.0), np.arange(6.0)))
    assert route._two_opt(cost, np.array([0, 1, 4, 3, 2, 5])).tolist() == [0, 1, 2, 3, 4, 5]
    assert route._two_opt(cost, np.array([0, 5, 4, 3, 2, 1])).tolist() == [0, 1, 2, 3, 4, 5]  # the end is open


def test_ways_go_round_what_is_in_the_way():
    """Poses on both sides of a wall at zero of joint 1, with a gap where joint 2 is above 0.9."""
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.2, 1, 24) * np.tile([1, -1], 12), rng.uniform(-1, 0.8, 24)])
    q = np.concatenate([q, [[0.1, 1.0], [-0.1, 1.0]]])

    def blocked(a, b):
        crossing = a[:, 0] * b[:, 0] < 0
        with np.errstate(divide="ignore", invalid="ignore"):
            height = a[:, 1] + (b[:, 1] - a[:, 1]) * a[:, 0] / (a[:, 0] - b[:, 0])
        return crossing & (height < 0.9)

    start = np.array([0.5, 0.0])
    order, bad = route.shortest_order(q, start, np.ones(2), blocked)
    places = np.concatenate([start[None], q[order]])
    assert sorted(order) == list(range(26))
    assert not len(bad)
    assert not blocked(places[:-1], places[1:]).any()
    no_gap = route.shortest_order(q[:24], start, np.ones(2), blocked)
    places = np.concatenate([start[None], q[no_gap[0]]])
    assert np.flatnonzero(blocked(places[:-1], places[1:])).tolist() == no_gap[1].tolist() != []


def test_moves_are_looked_at_in_small_steps_from_end_to_end():
    q, starts = route.between(
        np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.5, 0.01], [1.0, 0.0]]), np.array([False, False])
    )
    assert np.abs(np.diff(q[: starts[1]], axis=0)).max() <= 4 * DEG
    assert q[0].tolist() == [0, 0]
    assert q[starts[1] - 1] == pytest.approx([0.5, 0.01])
    assert q[starts[1] :].tolist() == [[1, 0], [1, 0]]


def test_moves_below_the_heights_and_through_the_arm_are_blocked():
    there = setting(("limits", "height", "collision"))
    level = np.zeros((1, 6))
    turned = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    assert not conditions.blocked_moves(there, level, turned)[0]
    # from one side of joint 4's forbidden range to the other
    a, b = np.array([[0.0, 0, 0, 1.9, 0, 0]]), np.array([[0.0, 0, 0, 2.1, 0, 0]])
    assert conditions.blocked_moves(there, a, b)[0]
    # from low in front to high at the back: the ends are free, the way over the side is too low
    front, back = np.radians([[0.0, 20, 0, 0, 0, 0]]), np.radians([[180.0 - 2.0, -30, 10, 0, 0, 0]])
    way = front + np.linspace(0, 1, 400)[:, None] * (back - front)
    tip, points, _ = there.places(way)
    high = there.high(tip, points)
    assert high[[0, -1]].all()
    assert conditions.blocked_moves(there, front, back)[0] == (not high.all())
    assert not high.all()


def test_ways_that_are_not_free_go_over_home_where_that_is_free():
    """Joints 1 and 2 must not both be above 0.2: from one corner to the other over home, into the middle not at all."""

    class Corner(Wall):
        def touching(self, theta):
            return (theta[:, 0] > 0.2) & (theta[:, 1] > 0.2)

    there = setting(("collision",), solids=Corner())
    start = np.array([0.9, 0, 0, 0, 0, 0])
    for second, over, blocked in (([0.0, 0.9], True, False), ([0.9, 0.9], False, True), ([0.5, 0.1], False, False)):
        q = np.array([[*second, 0, 0, 0, 0]])
        poses = conditions.Poses(q, np.ones((1, 3), dtype=bool), np.array(["g"], dtype=object), conditions.Tally())
        found = conditions.ordered(there, poses, start, np.ones(6))
        assert found[1].tolist() == [over]
        assert found[2].tolist() == [blocked]


def test_the_first_reflectors_seen_are_measured():
    seen = np.array([[1, 1, 1, 1], [0, 1, 0, 1], [0, 0, 0, 1]], dtype=bool)
    assert conditions.first_seen(seen, 2).astype(int).tolist() == [[1, 1, 0, 0], [0, 1, 0, 1], [0, 0, 0, 1]]
