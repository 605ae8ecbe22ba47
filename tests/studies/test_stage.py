"""The campaign of a study: the sphere, and what is verified with was not identified from."""

import numpy as np
import pytest

from irbcal.studies.settings import AREAS


def test_the_sphere_is_the_thesis_s(stage):
    q, target = stage.sphere
    T = stage.cell.arm.forward(q)
    assert np.linalg.norm(T[:, :3, 3] - [0.8457, 0.2, 0.9657], axis=1).max() <= 0.2 + 1e-9
    home = stage.cell.arm.forward(np.zeros((1, 6)))[0, :3, :3]
    angle = np.arccos(np.clip((np.einsum("nij,ij->n", T[:, :3, :3], home) - 1) / 2, -1, 1))
    assert angle.max() <= np.radians(20) + 1e-6
    assert len(q) == 434
    assert set(target) == set(range(8))
    assert np.abs(q).max() < np.radians(130)  # no turned wrist


def test_nothing_that_is_identified_from_is_verified_with(stage):
    for area in AREAS:
        q = stage.commanded[area][0]
        pool = stage.identification[area].q
        assert np.abs(q[:, None] - pool[None]).max(axis=2).min() > 1e-6
        assert set(stage.identification[area].target_names) == {"smr1", "smr2", "smr3"}
        for load in (3, 6):
            assert set(stage.verification[load][area].target_names) == {f"smr{k}" for k in range(1, 9)}


def test_a_stage_cannot_be_changed_and_speaks_shortly(stage):
    with pytest.raises(ValueError, match="read-only"):
        stage.commanded["iso_cube"][0][0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        stage.sphere[0][0, 0] = 1.0
    assert len(repr(stage)) < 2000
    assert "SIMULATED" in repr(stage)
