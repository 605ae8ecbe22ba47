"""Arm stiffness as one angle of joint 2, against a plane arm that bends."""

import numpy as np
import pytest

from irbcal.joint_behaviour.equivalent_angle import equivalent_error
from irbcal.modeling.stiffness import Stiffness


def test_stiffness_as_one_angle():
    L_1, L_2 = 0.7, 0.6

    def wrist(q2, q3):
        return L_1 * np.exp(1j * q2) + L_2 * np.exp(1j * (q2 + q3 + np.pi / 2))

    for guess in (Stiffness.guess(L_1, L_2), Stiffness(1.8e-3, 0.3, 0.9, 2.0, L_1, L_2)):
        A, B = guess.coefficients
        # stretched, all the way down: eq. 5.16
        found = equivalent_error([np.pi / 2], -np.pi / 2, (A, B), (0, np.pi / 2), (L_1, L_2))
        assert np.sin(found[0]) * (L_1 + L_2) == pytest.approx(guess.delta_L, rel=1e-5)
        # any elbow: the wrist of a plane arm with both joints bent, moved along its circle about joint 2
        for elbow in np.radians([30, 0, -60]):
            q2 = np.radians([-70.0, 25.0, 50.0])

            bent_3 = B * np.cos(q2 + elbow)
            at_zero_3 = B * np.cos(elbow)
            bent = wrist(q2 + A * np.sin(q2) + bent_3, elbow + bent_3) / wrist(q2, elbow)
            at_zero = wrist(at_zero_3, elbow + at_zero_3) / wrist(0.0, elbow)
            expected = np.angle(bent / at_zero)
            found = equivalent_error(q2, elbow, (A, B), (0, np.pi / 2), (L_1, L_2))
            assert found == pytest.approx(expected, abs=3e-6)
