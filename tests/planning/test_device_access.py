import numpy as np
import pytest

from irbcal.identification.observation_kind import vectors
from irbcal.planning.device_plan import Access, reached, with_stands
from irbcal.planning.scene import open_scene
from irbcal.simulation.devices import BALL, DEVICES, drawn, placed
from irbcal.units import DEG, MM


@pytest.fixture(scope="module")
def setting():
    return open_scene("irb1600", without=("height", "acceptance", "sight", "way")).setting


def _access(setting, name, cone=60 * DEG, approach=50 * MM):
    return Access(setting, placed(setting.arm, DEVICES[name]), cone, approach)


def test_the_arm_goes_back_along_its_tool(setting):
    """The oracle is the forward kinematics: 50 mm back along z, the attitude as it was."""
    access = _access(setting, "ball")
    q = drawn(setting.arm, access.found, "ball 1", 60, 0)
    there, good = access.retreated(q)
    assert good.sum() > 20
    before, after = setting.arm.forward(there[good]), setting.arm.forward(q[good])
    np.testing.assert_allclose(after[:, :3, 3] - before[:, :3, 3], 50 * MM * after[:, :3, 2], atol=0.3 * MM)
    turned = vectors(after[:, :3, :3] @ before[:, :3, :3].transpose(0, 2, 1))
    assert np.linalg.norm(turned, axis=1).max() < 0.3 * DEG


def test_a_place_out_of_reach_is_not_reached(setting):
    q = setting.arm.random_joints(3, 0)
    goal = setting.arm.forward(q)
    goal[:, :3, 3] += 5.0
    assert not reached(setting.arm, q, goal)[1].any()


def test_sockets_are_entered_from_above_and_planes_from_their_open_side(setting):
    for name in ("ball", "plane"):
        access = _access(setting, name)
        for spot in DEVICES[name].spots:
            q = drawn(setting.arm, access.found, spot.name, 200, 1, access.patch)
            good, removed = access.keep(spot.name, q)
            assert removed["cone"] > 0
            T = setting.arm.forward(q[good])
            assert (T[:, :3, 2] @ np.array(spot.normal) <= -0.5 + 1e-9).all()
            p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
            across = np.abs(p - access.found.middle[spot.name]).max()
            assert across < (1e-6 if name == "ball" else access.patch + 1e-6)


def test_a_string_through_the_arm_is_refused(setting):
    """The oracle: an anchor behind the base column, straight through the arm's own foot."""
    access = _access(setting, "string", 180 * DEG)
    low = {name: np.array([-2.0, 0.0, 0.45]) for name in access.found.middle}
    object.__setattr__(access.found, "middle", low)
    q = np.zeros((1, 6))
    q[0, 1] = 60 * DEG  # the tool low in front of the base
    q[0, 2] = 20 * DEG
    good, removed = access.keep("string 1", q)
    assert not good.any()
    assert removed["line"] == 1
    low = {name: np.array([3.0, 0.0, 0.45]) for name in access.found.middle}
    object.__setattr__(access.found, "middle", low)
    assert access.keep("string 1", q)[0].all()


def test_what_carries_a_socket_stands_in_the_way():
    own = open_scene("irb1600", without=("height", "acceptance", "sight", "way")).setting
    found = placed(own.arm, DEVICES["plane"])
    q = own.arm.random_joints(150, 3)
    free = own.touching(q)
    with_stands(own.solids, found, own.arm)
    blocked = own.touching(q)
    assert (blocked | ~free).all()
    assert blocked.sum() > free.sum()
