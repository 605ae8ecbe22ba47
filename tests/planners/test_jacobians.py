"""Jacobians in Pinocchio's reference frames: against central differences and Pinocchio itself."""

import numpy as np
import pinocchio as pin
import pytest
from support import assert_derivative, central_differences, motions

from irbcal.planners import jacobians

REFERENCES = (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED)
FRAMES = ("tool0", "target_smr1", "link_4", "joint_3", "base_link")


def numeric_jacobian(model, q, frame, reference):
    """By central differences of placements in the universe, one pose; columns as Pinocchio defines its frames."""
    T = model.placement(q[None], frame, "universe")[0]
    R, p = T[:3, :3], T[:3, 3]
    rates = central_differences(lambda x: model.placement(x[None], frame, "universe")[0].ravel(), q, 1e-3)
    columns = []
    for dT in rates.T.reshape(6, 4, 4):
        spin = dT[:3, :3] @ R.T
        v, w = dT[:3, 3], np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        if reference == pin.WORLD:
            v = v - np.cross(w, p)
        if reference == pin.LOCAL:
            v, w = R.T @ v, R.T @ w
        columns.append(np.concatenate([v, w]))
    return np.array(columns).T


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
@pytest.mark.parametrize("frame", FRAMES)
def test_jacobian_agrees_with_central_differences_and_pinocchio(cell, frame, reference):
    robot, model = cell
    q, _ = motions(robot, 4)
    found = model.jacobian(q, frame, reference)
    assert np.array_equal(found, model.jacobian(q, frame, str(reference)))
    data, number = model.model.createData(), model.model.getFrameId(frame)
    M = robot.joint_map.jacobian(q)
    for k, configuration in enumerate(model.model_from_command(q)):
        assert np.abs(found[k] - numeric_jacobian(model, q[k], frame, reference)).max() < 1e-10
        J = pin.computeFrameJacobian(model.model, data, configuration, number, reference)
        assert np.abs(found[k] - J @ M[k]).max() < 1e-13


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
@pytest.mark.parametrize("frame", FRAMES)
def test_jacobian_derivative_agrees_with_central_differences(cell, frame, reference):
    robot, model = cell
    q, dq = motions(robot, 4)
    found = model.jacobian_derivative(q, dq, frame, reference)
    for k in range(len(q)):

        def along(t, k=k):
            return model.jacobian((q[k] + t[0] * dq[k])[None], frame, reference)[0]

        assert_derivative(along, [0.0], found[k], 1e-9)


@pytest.mark.parametrize("with_speeds", [True, False])
def test_the_chain_and_pinocchio_agree_on_the_tip(cell, kinova, with_speeds):
    for model in (cell[1], kinova):
        theta, dtheta = motions(model, 10)
        speeds = dtheta if with_speeds else None
        place = model._arm_in_model
        by_chain = jacobians.along_chain(model.arm, model.T_universe_base, theta, speeds)
        by_pinocchio = jacobians.by_pinocchio(model.model, place, place.tip, theta, speeds, model.rest)
        for ours, theirs in zip(by_chain, by_pinocchio, strict=True):
            if not with_speeds and ours is None:
                assert theirs is None
            else:
                np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11)
