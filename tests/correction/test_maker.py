"""Joints of the controller, and the joints that a posture names."""

import numpy as np
import pytest
from maker_cases import robot_of, well_inside
from support import arm, random_robot

from irbcal.correction import maker
from irbcal.correction.languages import krl, urscript
from irbcal.correction.maker import ConfData, Posture, Solutions, configuration_of, seeds_of
from irbcal.errors import ProgramError
from irbcal.io import urdf
from irbcal.modeling.inverse import closed_form


@pytest.fixture(scope="module")
def nominal():
    return robot_of("kr120r2500pro")[0]


def joints_of(maker, arm, T, postures, near, own=None):
    return Solutions(maker, arm, T, postures, own).next_to(np.arange(len(postures)), near)


def test_axes(nominal):
    assert maker.axes_of(nominal) == ("-z", "+y", "+y", "-x", "+y", "-x")
    krl.KUKA.check(nominal, "job.src")
    with pytest.raises(ProgramError, match="are of six revolute joints"):
        krl.KUKA.check(urdf.read("panda").arm, "job.src")


def test_every_posture_names_its_joints(nominal):
    q = well_inside(nominal, 300)
    back, bent, negative = krl.KUKA.postures(nominal, q)
    postures = [
        Posture(b, e, -1 if w else 1, tuple(np.where(p < 0, -np.inf, 0)), tuple(np.where(p < 0, 0, np.inf)))
        for b, e, w, p in zip(back.tolist(), bent.tolist(), negative.tolist(), q, strict=True)
    ]
    found, reasons = joints_of(krl.KUKA, nominal, nominal.forward(q), postures, np.full((300, 6), np.nan))
    assert set(reasons) == {""}
    assert np.abs(found - q).max() < 1e-8
    assert len({p[:3] for p in postures}) == 6


def test_without_a_posture_the_joints_before_tell(nominal):
    q = well_inside(nominal, 20)
    near = q + 0.02
    found, reasons = joints_of(krl.KUKA, nominal, nominal.forward(q), [Posture()] * 20, near)
    assert set(reasons) == {""}
    assert np.abs(found - q).max() < 1e-8
    found, reasons = joints_of(krl.KUKA, nominal, nominal.forward(q), [Posture()] * 20, np.full((20, 6), np.nan))
    assert set(reasons) == {maker.NO_POSTURE}
    far = nominal.forward(q)
    far[:, 0, 3] += 9
    _, reasons = joints_of(krl.KUKA, nominal, far, [Posture()] * 20, near)
    assert set(reasons) == {maker.NO_REACH}


@pytest.mark.parametrize("name", ["kr120r2500pro", "ur10"])
def test_joints_are_those_of_the_controllers_arm(name):
    """With a closed form for the nominal arm, and without one."""
    nominal = robot_of(name)[0] if name != "ur10" else urdf.read("ur10").arm
    own = random_robot(nominal, "placement", np.random.default_rng(2), size=0.3).arm
    q = well_inside(nominal, 40) if name != "ur10" else 0.4 * nominal.random_joints(40, 3) + [0, -1, 1, 0, 1, 0]
    T = own.forward(q)
    near = q + np.random.default_rng(3).uniform(-0.02, 0.02, q.shape)
    maker = krl.KUKA if name != "ur10" else urscript.UNIVERSAL_ROBOTS
    found, reasons = joints_of(maker, nominal, T, [Posture()] * 40, near, own)
    assert reasons == [""] * 40
    assert np.abs(found - q).max() < 1e-8
    assert np.abs(joints_of(maker, nominal, T, [Posture()] * 40, near)[0] - q).max() > 1e-4


def test_quadrants_are_floors_of_ninety_degrees():
    q = np.radians([[10, 0, 0, 90, 0, 180], [-10, 0, 0, -90.5, 0, 359], [0, 0, 0, 190, 0, -181]])
    assert [configuration_of(row, 5) for row in q] == [(0, 1, 2, 5), (-1, -2, 3, 5), (0, 2, -3, 5)]


def test_the_solution_with_the_configuration_data_is_taken():
    nominal = arm()
    q = np.radians([[100, 10, -20, 120, 40, -100], [100, 10, -20, 120, 40, 260]])
    branch = closed_form.configuration(nominal, q)
    confs = [configuration_of(row, int(cfx)) for row, cfx in zip(q, branch, strict=True)]
    assert [conf.cf6 for conf in confs] == [-2, 2], "the same pose a turn further"
    found, told = seeds_of(nominal, nominal.forward(q), confs)
    assert told.all()
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-9)


def test_data_that_fit_nothing_are_told_from_poses_out_of_reach():
    nominal = arm()
    T = np.repeat(nominal.forward([[0.2, 0, 0, 0, 0.5, 0]]), 3, axis=0)
    T[2, 0, 3] = 9.0
    found, told = seeds_of(nominal, T, [ConfData(3, 3, 3, 0), None, ConfData(0, 0, 0, 0)])
    assert told.tolist() == [False, True, True]
    assert np.isfinite(found).all(axis=1).tolist() == [False, True, False]
    np.testing.assert_allclose(found[1], [0.2, 0, 0, 0, 0.5, 0], rtol=0, atol=1e-9)
