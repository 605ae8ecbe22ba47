"""Standard deviations of predictions against finite differences and a cloud of parameters."""

import numpy as np
import pytest
from simulated_fit import predicted_covariance

import irbcal
from irbcal.modeling import parameters
from irbcal.modeling.parameters import all_names, parameter
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation.accuracy import position_std


def test_tips_spread_as_the_parameters_do(record):
    """Parameters drawn from the covariance: the tips of the robots that they make, in the base link."""
    robot, nominal = record.robot_calibrated(), record.arm(calibrated=False)
    factor = dict(UNIT_OUTSIDE.values())
    rows = [row for row in record.parameters if row.name in all_names(nominal)]
    chosen = [parameter(row.name) for row in rows]
    values = np.array([row.value * factor[row.unit] for row in rows])
    C = record.covariance_matrix()[-len(rows) :, -len(rows) :]
    draws = np.random.default_rng(0).multivariate_normal(values, C, 1500, method="eigh")
    q = nominal.random_joints(4, 0)
    tips = []
    for errors in draws:
        table, joint_map = parameters.apply(chosen, errors, nominal.table, ThesisMap.of(robot.joint_map))
        tips.append(
            robot.replace(arm=nominal.with_table(table), joint_map=joint_map.joint_map(nominal)).poses(q)[:, :3, 3]
        )
    found = position_std(record, q)
    assert found.shape == (4, 3)
    assert found == pytest.approx(np.std(tips, axis=0), rel=0.1)
    assert (found > 1e-7).all()


def test_a_target_is_surer_than_the_tip_where_it_was_measured(record):
    """In the measuring frame, base and target errors belong to it; the fitted points themselves are known best."""
    q = np.radians([[0.0, -14, 14, 0, 10, 0]])
    at_target = position_std(record, q, "smr1")
    assert at_target.shape == (1, 3)
    assert 1e-6 < at_target.min() < at_target.max() < 1e-4
    assert not np.allclose(at_target, position_std(record, q), rtol=1e-3, atol=0.0)


def test_uncertainty_of_a_saved_calibration_is_that_of_its_fit(proven, folder):
    loaded = irbcal.load(folder)
    q = proven.urdf.arm.random_joints(20, 6)
    expected = np.sqrt(np.einsum("nii->ni", predicted_covariance(proven.fit, q, "smr2")))
    assert np.abs(position_std(loaded, q, "smr2") / expected - 1).max() < 1e-6
    tip = position_std(loaded, q)
    assert tip.shape == (20, 3)
    assert 0 < tip.min() < tip.max() < 1e-3
