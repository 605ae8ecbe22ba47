"""Covariance packed by its factor: layout by hand, accuracy where parameters are nearly tied, damage."""

import base64
import struct

import numpy as np
import pytest
from pydantic import ValidationError
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.files.certainty_section import CovarianceSection


def test_the_layout_is_rows_of_the_lower_triangle():
    factor = base64.b64encode(struct.pack("<6f", 2.0, 1.0, 3.0, 0.5, -1.0, 4.0)).decode()
    section = CovarianceSection(layout="cholesky-rows-float32-base64", size=3, factor=factor)
    L = np.array([[2.0, 0, 0], [1.0, 3.0, 0], [0.5, -1.0, 4.0]])
    np.testing.assert_array_equal(section.matrix(), L @ L.T)
    np.testing.assert_array_equal(CovarianceSection.of(L @ L.T).matrix().round(5), (L @ L.T).round(5))


def test_what_is_known_well_stays_known_well():
    # a sum is known ten thousand times better than its parts: rounding of the matrix itself would lose it
    rng = np.random.default_rng(1)
    A = rng.standard_normal((40, 40))
    V = np.linalg.qr(A)[0]
    C = (V * np.geomspace(1e-6, 1e-15, 40)) @ V.T
    there = CovarianceSection.of(C).matrix()
    for v in V.T:
        assert np.sqrt(v @ there @ v) == pytest.approx(np.sqrt(v @ C @ v), rel=2e-3)
    assert abs(v @ C.astype("f4").astype(float) @ v / (v @ C @ v) - 1.0) > 0.1


def test_held_directions_and_nothing_are_kept():
    v = np.array([[1.0, -1.0, 0.0]])
    C = np.eye(3) - v.T @ v / 2
    np.testing.assert_allclose(CovarianceSection.of(C).matrix(), C, atol=1e-6)
    assert CovarianceSection.of(np.zeros((2, 2))).matrix().tolist() == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("size", "factor", "words"),
    [
        (2, "!!!", "factor"),
        (3, base64.b64encode(bytes(12)).decode(), "of size 3 has 12 bytes"),
        (1, base64.b64encode(struct.pack("<f", np.inf)).decode(), "not finite"),
    ],
)
def test_damage_is_refused(size, factor, words):
    with pytest.raises(ValidationError, match=words):
        CovarianceSection(layout="cholesky-rows-float32-base64", size=size, factor=factor)


def test_a_folder_gives_the_same_predictions(outcome, folder):
    fresh, loaded = outcome.fit.robot, irbcal.load(folder).robot_calibrated()
    q = fresh.arm.random_joints(30, 4)
    for name in fresh.targets:
        one, two = fresh.predict(q, target=name), loaded.predict(q, target=name)
        np.testing.assert_allclose(two.position, one.position, rtol=0, atol=1e-12)
        np.testing.assert_allclose(two.interval, one.interval, rtol=1e-5)
        np.testing.assert_array_equal(two.outside, one.outside)


def test_intervals_are_as_wide_as_the_errors_where_two_families_share_a_function(tmp_path):
    """Joint 6's series of the thesis and the harmonics are averaged: each keeps its columns of the covariance."""
    nominal, rng = arm(), np.random.default_rng(2)
    robot = random_robot(nominal, "34", rng)
    points = measured(robot, nominal.random_joints(40, 2), 3e-5, rng)
    irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb1600", holdout=0).save(tmp_path / "out")
    loaded = irbcal.load(tmp_path / "out")
    families = {term.family for term in loaded.robot_calibrated().certainty.terms}
    assert {"thesis", "harmonics"} <= families
    names = [row.name for row in loaded.record.parameters]
    assert len(set(names)) == len(names)
    q = nominal.random_joints(300, 9)
    found = loaded.robot_calibrated().predict(q, target="smr1")
    errors = found.position - (robot.points(q, "smr1") + 3e-5 * rng.standard_normal((300, 3)))
    assert 0.92 <= (np.abs(errors) <= found.interval).mean() <= 0.985
    assert np.sqrt(np.mean(found.interval**2)) < 1.5 * 1.96 * np.sqrt(np.mean(errors**2))
