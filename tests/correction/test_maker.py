"""Joints of the controller, and the joints that a posture names."""

import numpy as np
import pytest
from maker_cases import robot_of, well_inside
from support import random_robot

from irbcal.correction import maker
from irbcal.correction.languages import krl, urscript
from irbcal.correction.maker import Posture, joints_of
from irbcal.errors import ProgramError
from irbcal.io import urdf


@pytest.fixture(scope="module")
def nominal():
    return robot_of("kr120r2500pro")[0]


def test_axes(nominal):
    assert maker.axes_of(nominal) == ("-z", "+y", "+y", "-x", "+y", "-x")
    krl.MAKER.check(nominal, "job.src")
    with pytest.raises(ProgramError, match="are of six revolute joints"):
        krl.MAKER.check(robot_of("kr120r2500pro")[0].__class__(**{**vars(nominal), "joint_names": ("a",)}), "job.src")


def test_every_posture_names_its_joints(nominal):
    q = well_inside(nominal, 300)
    back, bent, negative = krl.MAKER.postures(nominal, q)
    postures = [
        Posture(b, e, -1 if w else 1, tuple(np.where(p < 0, -np.inf, 0)), tuple(np.where(p < 0, 0, np.inf)))
        for b, e, w, p in zip(back.tolist(), bent.tolist(), negative.tolist(), q, strict=True)
    ]
    found, reasons = joints_of(krl.MAKER, nominal, nominal.forward(q), postures, np.full((300, 6), np.nan))
    assert set(reasons) == {""}
    assert np.abs(found - q).max() < 1e-8
    assert len({p[:3] for p in postures}) == 6


def test_without_a_posture_the_joints_before_tell(nominal):
    q = well_inside(nominal, 20)
    near = q + 0.02
    found, reasons = joints_of(krl.MAKER, nominal, nominal.forward(q), [Posture()] * 20, near)
    assert set(reasons) == {""}
    assert np.abs(found - q).max() < 1e-8
    found, reasons = joints_of(krl.MAKER, nominal, nominal.forward(q), [Posture()] * 20, np.full((20, 6), np.nan))
    assert set(reasons) == {maker.NO_POSTURE}
    far = nominal.forward(q)
    far[:, 0, 3] += 9
    _, reasons = joints_of(krl.MAKER, nominal, far, [Posture()] * 20, near)
    assert set(reasons) == {maker.NO_REACH}


@pytest.mark.parametrize("name", ["kr120r2500pro", "ur10"])
def test_joints_are_those_of_the_controllers_own_model(name):
    """With a closed form for the nominal arm, and without one."""
    nominal = robot_of(name)[0] if name != "ur10" else urdf.read("ur10").arm
    own = random_robot(nominal, "placement", np.random.default_rng(2), size=0.3).arm
    q = well_inside(nominal, 40) if name != "ur10" else 0.4 * nominal.random_joints(40, 3) + [0, -1, 1, 0, 1, 0]
    T = own.forward(q)
    near = q + np.random.default_rng(3).uniform(-0.02, 0.02, q.shape)
    maker = krl.MAKER if name != "ur10" else urscript.MAKER
    found, reasons = joints_of(maker, nominal, T, [Posture()] * 40, near, own)
    assert reasons == [""] * 40
    assert np.abs(found - q).max() < 1e-8
    assert np.abs(joints_of(maker, nominal, T, [Posture()] * 40, near)[0] - q).max() > 1e-4
