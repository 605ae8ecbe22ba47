from typing import get_args

import feature_cases as cases
import numpy as np
import pytest

from irbcal.errors import IdentificationError
from irbcal.identification.feature_problem import FeatureProblem, FeatureState
from irbcal.measurement import features
from irbcal.simulation.devices import BALL, DEVICES, TILT, placed, poses, readings_at, rows_table, touched_poses
from irbcal.simulation.simulation_options import DeviceName

LONGER = {"ballbar": (0.0,), "ballbars": (0.0, 0.07, 0.14), "telescope": None}
"""What ballbars are longer than the shortest, in shares of the reach; anything up to 0.08 where it telescopes."""


def test_options_know_all_devices():
    assert get_args(DeviceName) == tuple(DEVICES)


@pytest.mark.parametrize("name", DEVICES)
def test_poses_are_at_the_features(name):
    """The oracle is the nominal arm and plain geometry."""
    arm = cases.arm()
    found = placed(arm, DEVICES[name])
    q, which = poses(arm, found, 12, seed=1)
    T = arm.forward(q)
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    assert len(q) == len(which) == 12
    assert set(which) == set(range(len(DEVICES[name].spots)))
    for k, own in enumerate(found.unknowns.values()):
        mine = p[which == k]
        if name == "plane":
            np.testing.assert_allclose(mine @ own["normal"][:, 2], own["height"][0], atol=1e-9)
        elif name in LONGER:
            longer = np.linalg.norm(mine - own["centre"], axis=1) - found.bar
            if LONGER[name] is None:
                assert longer.min() > -1e-9
                assert np.ptp(longer) > 0.01 * found.reach
                assert longer.max() < 0.08 * found.reach + 1e-9
            else:
                away = np.abs(longer[:, None] - found.reach * np.array(LONGER[name]))
                np.testing.assert_allclose(away.min(axis=1), 0.0, atol=1e-9)
        elif name == "camera":
            y = own["centre"] + np.array([0.06, 0.09, 0.0]) @ own["attitude"].T - mine
            assert (np.einsum("ni,nij->nj", y, T[which == k, :3, :3])[:, 2] > 0.2).all()
        elif name == "inclinometer":
            rising = (T @ np.r_[TILT[:, 2], 0.0])[:, 2]
            across = np.linalg.norm((T @ np.r_[TILT[:, 2], 0.0])[:, :2], axis=1)
            np.testing.assert_allclose(readings_at(T, found, which), np.arctan2(rising, across), atol=1e-9)
            assert np.abs(np.arctan2(rising, across)).max() < DEVICES[name].cone
        elif name != "string":
            np.testing.assert_allclose(mine, np.tile(own["centre"], (len(mine), 1)), atol=1e-9)
    seen = features.read(rows_table(arm, found, q, which, readings_at(T, found, which)), found.table(), arm)
    np.testing.assert_allclose(seen.q, q, atol=1e-8)
    if name in ("camera", "inclinometer"):  # the kind itself, written by other hands, sees nothing missed
        problem = FeatureProblem(arm, seen, [])
        assert problem.distances(FeatureState(found.by_key(), np.zeros(0))).max() < 1e-6
    if name == "camera":
        assert ((seen.corners[..., 2:4] > 0) & (seen.corners[..., 2:4] < [1920, 1200])).all()
    assert len(seen.relations) == (len(found.unknowns) * (len(found.unknowns) - 1) // 2 if DEVICES[name].lengths else 0)


def test_a_contact_is_met_with_the_real_tip_and_its_noise():
    arm, truth = cases.arm(), cases.true_arm(cases.arm(), 2)
    found = placed(arm, DEVICES["ball"])
    q, _ = poses(arm, found, 8, seed=2)
    off = 1e-4 * np.random.default_rng(0).standard_normal((8, 3))
    q, good = touched_poses(arm, found, "ball 1", q, truth.forward, off)
    T = truth.forward(q)
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    assert good.all()
    np.testing.assert_allclose(p - found.unknowns["ball 1"]["centre"], off, atol=1e-7)


def test_what_is_out_of_reach_is_told():
    arm = cases.arm()
    with pytest.raises(IdentificationError, match="reaches ball 1 of one ball in 0 of 5 poses only"):
        poses(arm, placed(arm, DEVICES["ball"]), 5, keep=lambda q: np.zeros(len(q), dtype=bool))
