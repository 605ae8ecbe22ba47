"""Joints along paths of poses: no jumps, and singularities are told with their place."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support import arm, example_robot, on_a_rail, random_robot

from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.modeling.inverse import along_path, any_arm, closed_form, redundancy
from irbcal.modeling.robot import Robot


def straight(T_0, T_1, n=20):
    """A straight path with an even turn, by scipy."""
    s = np.linspace(0.0, 1.0, n)
    out = np.tile(np.eye(4), (n, 1, 1))
    out[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix([T_0[:3, :3], T_1[:3, :3]]))(s).as_matrix()
    out[:, :3, 3] = T_0[:3, 3] + s[:, None] * (T_1[:3, 3] - T_0[:3, 3])
    return out


@pytest.fixture(scope="module")
def calibrated():
    nominal = arm("irb120")
    return random_robot(nominal, "34", np.random.default_rng(1), size=1.0), nominal


def over_the_wrist(aside):
    """The hand of an IRB 120 swings past the wrist's singularity, ``aside`` radians from it."""
    T = arm("irb120").forward(np.radians([[0, 20, -10, 0, 20, 0]]))[0]
    first, last = T.copy(), T.copy()
    first[:3, :3] = frames.rot_z(aside) @ T[:3, :3]
    last[:3, :3] = frames.rot_z(aside) @ frames.rot_y(-np.radians(40)) @ T[:3, :3]
    return straight(first, last)


@pytest.mark.parametrize("branch", [0, 1, 2])
def test_a_path_keeps_to_its_solution_between_the_poses_too(calibrated, branch):
    robot, nominal = calibrated
    a, b = np.radians([[10, 20, -10, 20, 40, 30], [40, 30, 10, -30, 60, 0]])
    T = straight(*robot.poses([a, b]))
    near = closed_form.branches(nominal, T[:1]).joints[0, [closed_form.configuration(nominal, a), 1, 3][branch]]
    near = a if branch == 0 or not np.isfinite(near).all() else near
    found = along_path.follow(robot, nominal, T, near)
    assert found.singular == ()
    assert set(found.note) == {""}
    assert np.abs(robot.poses(found.joints) - T).max() < 1e-9
    assert np.abs(np.diff(found.joints, axis=0)).max() < 0.3
    if branch == 0:
        assert found.joints[[0, -1]] == pytest.approx(np.array([a, b]), abs=1e-8)


def test_a_path_through_a_singularity_is_told_with_its_place():
    """The nominal wrist passes straight through, and stays one solution; a little aside it cannot."""
    nominal = arm("irb120")
    through = along_path.follow(Robot(nominal), nominal, over_the_wrist(0.0), np.radians([0, 20, -10, 0, 20, 0]))
    assert np.isfinite(through.joints).all()
    assert np.abs(through.joints[:, [3, 5]]).max() < 1e-6
    (place,) = through.singular
    assert not place.ends
    assert set(place.joints) == {3, 5}
    assert place.value < 1e-2
    assert np.abs(through.joints[place.row, 4]) < 0.05
    assert "passes close to a singularity" in through.note[place.row]

    aside = along_path.follow(Robot(nominal), nominal, over_the_wrist(1e-4), np.radians([0, 20, -10, 0, 20, 0]))
    (place,) = aside.singular
    assert place.ends
    assert (place.row, place.share) == pytest.approx((7, 0.62), abs=0.02)
    assert place.point == pytest.approx(over_the_wrist(0.0)[7, :3, 3], abs=1e-9)
    assert np.isfinite(aside.joints).all(axis=1).sum() == place.row + 1
    assert "the path ends at a singularity between poses" in aside.note[-1]
    assert "of joint 4 and 6" in aside.note[-1]


def test_a_path_that_begins_or_ends_at_a_singularity_says_so():
    nominal = arm("irb120")
    T = over_the_wrist(0.0)[:10]
    T = straight(nominal.forward(np.radians([[0, 20, -10, 0, 0.5, 0]]))[0], T[0])
    begins = along_path.follow(Robot(nominal), nominal, T, np.radians([0, 20, -10, 0, 0.5, 0]))
    ends = along_path.follow(Robot(nominal), nominal, T[::-1], np.radians([0, 20, -10, 0, 20, 0]))
    assert [(place.row, place.share) for place in begins.singular] == [(0, 0.0)]
    assert [place.row + place.share for place in ends.singular] == [len(T) - 1]


def test_a_path_farther_aside_is_followed():
    nominal = arm("irb120")
    swing = along_path.follow(Robot(nominal), nominal, over_the_wrist(8e-3), np.radians([0, 20, -10, 0, 20, 0]))
    assert [place.ends for place in swing.singular] == [False]
    assert np.abs(np.diff(swing.joints[:, 3])).max() > 2.0  # half a turn of joint 4 between two poses, and it is told
    assert (swing.joints[:, 4] > 0.0).all()
    found = along_path.follow(Robot(nominal), nominal, over_the_wrist(0.1), np.radians([0, 20, -10, 0, 20, 0]))
    assert np.isfinite(found.joints).all()
    assert not any(place.ends for place in found.singular)
    assert np.abs(nominal.forward(found.joints) - over_the_wrist(0.1)).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "wanted"), [("panda", None), ("panda", "limits"), ("panda", "near"), ("rail", "limits")]
)
def test_arms_with_joints_to_spare_go_smoothly(name, wanted, tmp_path):
    """The criterion is followed without jumps and gains what it can."""
    if name == "rail":
        nominal = urdf.read(on_a_rail(tmp_path / "rail.urdf"), "rail_base", "tool0").arm
        a = np.array([0.5, 0.1, 0.3, -0.2, 0.3, 0.7, 0.2])
        b = a + np.array([1.0, 0.3, 0.2, 0.2, -0.3, 0.3, 0.4])
    else:
        nominal = urdf.read(example_robot("panda_description/urdf/panda.urdf"), tip_link="panda_link8").arm
        a = np.array([0, 0.2, 0, -1.8, 0.2, 1.9, 0.3])
        b = a + np.array([0.5, 0.3, -0.4, 0.3, 0.5, -0.3, 0.2])
    robot = random_robot(nominal, "placement", np.random.default_rng(3), size=0.2)
    T = straight(*robot.poses([a, b]), n=6)
    found = along_path.follow(robot, nominal, T, a, wanted)
    assert found.singular == ()
    assert np.abs(robot.poses(found.joints) - T).max() < 1e-9
    assert np.abs(np.diff(found.joints, axis=0)).max() < 0.5
    if wanted == "limits":
        plain = along_path.follow(robot, nominal, T, a)
        value = redundancy.criterion("limits", nominal, a)
        assert (value(found.joints)[0] < value(plain.joints)[0]).all()


def test_the_solution_that_leads_farthest_is_taken():
    """From the nearest one the path leaves the joint limits; another one goes all the way."""
    nominal = arm("irb120")
    a = np.radians([0, 20, -10, 150, 40, 0])
    T = straight(*nominal.forward([a, a + np.radians([0, 0, 0, 25, 0, 0])]), n=8)
    found = along_path.follow(Robot(nominal), nominal, T, a)
    assert set(found.note) == {""}
    assert ((found.joints >= nominal.lower) & (found.joints <= nominal.upper)).all()
    assert np.abs(found.joints[0] - a).max() > 0.5
    assert np.abs(nominal.forward(found.joints) - T).max() < 1e-9


def test_where_the_first_pose_is_out_of_reach_nothing_is_found():
    nominal = arm("irb120")
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 0, 3] = 5.0
    found = along_path.follow(Robot(nominal), nominal, T, np.zeros(6))
    assert np.isnan(found.joints).all()
    assert set(found.note) == {"no joints were found for the first pose"}
    assert any_arm.reach(nominal) > 0.3


@pytest.mark.parametrize("joint", range(6))
def test_joints_beyond_either_limit_are_noted(joint):
    nominal = arm("irb1600")
    q = np.tile(0.5 * (nominal.lower + nominal.upper), (3, 1))
    q[1, joint], q[2, joint] = nominal.lower[joint] - 0.01, nominal.upper[joint] + 0.01
    assert along_path._notes(nominal, q, ()).tolist() == ["", "outside the joint limits", "outside the joint limits"]
