"""Effects of the tracker: scatter, drift, hidden and lost points."""

import numpy as np
import pytest

from irbcal.modeling import frames
from irbcal.simulation import tracker_effects


def test_tracker_noise_has_the_stated_sigmas_along_and_across_the_beam():
    noise = tracker_effects.Noise(range_um=2.0, range_um_per_m=0.5, across_um=3.0, across_um_per_m=2.0)
    beam = np.array([0.6, -0.64, 0.48])
    u = np.cross(beam, [0, 0, 1.0]) / np.linalg.norm(np.cross(beam, [0, 0, 1.0]))
    off = noise.points(np.tile(4.0 * beam, (40_000, 1, 1)), None, np.random.default_rng(1))[:, 0] - 4.0 * beam
    # 2 + 0.5 * 4 = 4 um along, 3 + 2 * 4 = 11 um across; 40,000 samples know a sigma to 0.35 %
    assert (off @ beam).std() == pytest.approx(4e-6, rel=0.02)
    for across in (u, np.cross(beam, u)):
        assert (off @ across).std() == pytest.approx(11e-6, rel=0.02)
    assert np.abs(off.mean(axis=0)).max() < 0.3e-6


def test_drift_moves_all_points_of_a_moment_as_one_body_and_references_take_it_out(cell):
    run = cell.only("drift").measure(np.zeros((400, 6)), wait_s=300.0)
    still = cell.only().measure(np.zeros((400, 6)), wait_s=300.0)
    moved = run.xyz - still.xyz
    assert 2e-6 < np.linalg.norm(moved, axis=2).mean() < 40e-6  # annex IV: 0.012 mm on average
    T = frames.rigid_fit(run.xyz, still.xyz)
    left = np.einsum("nij,nkj->nki", T[:, :3, :3], run.xyz) + T[:, None, :3, 3] - still.xyz
    # points of a pose are measured within 20 s: nearly at one moment
    assert np.abs(left).max() < 0.1e-6


def test_random_poses_are_seen_and_hidden_ones_are_lost_points(cell, q):
    seeing = cell.only("visibility")
    assert seeing.measure(q).unseen["visibility"] < 5  # the true robot stands a millimetre beside the nominal one
    anywhere = cell.arm.random_joints(500, seed=2)
    run = seeing.measure(anywhere)
    lost = np.isnan(run.xyz).any(axis=2)
    assert run.unseen["visibility"] == lost[:, :3].sum() > 1000
    assert not lost[:, 3:].any()
    # by the definition, from the truth: angle between where the reflector looks and the tracker
    T = run.T_base_tip
    p = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.real) + T[:, None, :3, 3]
    look = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.direction)
    beam = cell.tracker.place - p
    angle = np.degrees(np.arccos(np.sum(beam * look, axis=2) / np.linalg.norm(beam, axis=2)))
    assert (lost[:, :3] >= (angle > 30.0)).all()
    assert (lost[:, :3] & (angle < 30.0)).sum() < 0.4 * (angle < 30.0).sum()


def test_lost_points_are_as_many_as_stated(cell, q):
    run = cell.only("lost").with_effect(tracker_effects.Lost(share=0.05)).measure(np.tile(q, (20, 1)))
    assert run.unseen["lost"] == np.isnan(run.xyz[..., 0]).sum() == pytest.approx(0.05 * 6000 * 7, rel=0.1)
