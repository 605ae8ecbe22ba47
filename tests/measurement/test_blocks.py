"""Targets of their own for blocks of poses."""

from dataclasses import replace

import numpy as np
from support import TARGETS, arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.measurement.session_blocks import block_of, own_targets

RNG = np.random.default_rng(4)


def test_names_by_block():
    points = measured(random_robot(arm(), "11", RNG), arm().random_joints(3, 1))
    renamed = own_targets(points, np.array(["a", "b", "a"], dtype=object), "a")
    assert renamed.target_names == ("smr1", "smr2", "smr3", "smr1@b", "smr2@b", "smr3@b")
    assert renamed.names().tolist() == [*TARGETS, *(f"{name}@b" for name in TARGETS), *TARGETS]
    np.testing.assert_array_equal(renamed.xyz, points.xyz)
    assert block_of("smr1@b", ("a", "b"), "a") == ("smr1", "b")
    assert block_of("smr1", ("a", "b"), "a") == ("smr1", "a")
    assert block_of("t@x@b", ("b", "x@b"), "a") == ("t", "x@b")


def test_each_block_gets_its_own_tool():
    nominal = arm()
    truth = random_robot(nominal, "11", np.random.default_rng(1))
    moved = {name: np.add(place, [0.01, -0.02, 0.03]) for name, place in truth.targets.items()}
    q = nominal.random_joints(60, 2)
    first, second = measured(truth, q), measured(truth.replace(targets=moved), q)
    late = np.arange(60) >= 30
    both = replace(first, xyz=np.where(late[first.pose][:, None], second.xyz, first.xyz))
    points = own_targets(both, np.where(late, "late", "early"), "late")
    found = identify(nominal, points, "11").robot.targets
    for name in TARGETS:  # turned all alike with the zero of joint 6, which the tool hides
        shift = np.linalg.norm(found[name] - found[f"{name}@early"])
        np.testing.assert_allclose(shift, np.linalg.norm([0.01, -0.02, 0.03]), rtol=0, atol=1e-8)
    with_one_tool = identify(nominal, both, "11")
    assert with_one_tool.rms > 5e-3
