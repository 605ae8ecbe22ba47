"""The circle of a ballbar: where the ball stands, how the tool leans, and what makes no circle."""

import numpy as np
import pytest
from circles import small
from support import arm, random_rotation

from irbcal.errors import RobotError
from irbcal.validation.ballbar_check import tool_frame


def test_the_bar_reaches_from_the_ball_to_every_place():
    path, _, _ = small(arm(), height=0.05, tilt=0.1)
    places = path.poses(np.linspace(0, 1, 9))[:, :3, 3]
    assert np.abs(np.linalg.norm(places - path.ball, axis=1) - 0.15).max() < 1e-15
    assert path.ball == pytest.approx(path.center - [0, 0, 0.05])
    assert path.bar == pytest.approx(0.15)


def test_the_tool_leans_inwards():
    """Its z axis points down here: the tip of that axis leans towards the centre by the tilt."""
    tilt = np.radians(8.0)
    upright, leaning = (small(arm(), tilt=t)[0] for t in (0.0, tilt))
    s = np.linspace(0, 1, 5)[:-1]
    before, after = upright.poses(s), leaning.poses(s)
    inwards = (upright.center - before[:, :3, 3]) / 0.15
    assert np.abs(np.einsum("ij,ij->i", before[:, :3, 2], after[:, :3, 2]) - np.cos(tilt)).max() < 1e-12
    assert np.abs(np.einsum("ij,ij->i", inwards, after[:, :3, 2]) - np.sin(tilt)).max() < 1e-12
    assert np.array_equal(before[:, :3, 3], after[:, :3, 3])


def test_no_circles():
    nominal = arm()
    with pytest.raises(RobotError, match="along its normal"):
        small(nominal, start=[0, 0, 1])
    with pytest.raises(RobotError, match="longer than"):
        small(nominal, height=0.2)
    with pytest.raises(RobotError, match="needs a normal"):
        small(nominal, normal=[0, 0, 0])


def test_tools():
    from scipy.spatial.transform import Rotation

    R = random_rotation(np.random.default_rng(0))
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    T = tool_frame([0.1, 0.2, 0.3, w, x, y, z])
    assert np.abs(T[:3, :3] - R).max() < 1e-14
    assert T[:3, 3].tolist() == [0.1, 0.2, 0.3]
    assert np.array_equal(tool_frame([0.1, 0.2, 0.3])[:3, :3], np.eye(3))
    with pytest.raises(RobotError, match="unit quaternion, found one of length 2"):
        tool_frame([0, 0, 0, 2, 0, 0, 0])
