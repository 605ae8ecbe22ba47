"""Status and turn of joints, as KUKA's system manual counts them: bit k of T is set where axis k + 1 is negative."""

import numpy as np
import pytest

from irbcal.correction.languages.krl.writing import KrlProgram, posture_of


@pytest.mark.parametrize("angles", [(-10, 20, -30, 40, -50, 60), (1, -2, 3, -4, 5, -6), (0, 0, 0, 0, 0, 0), (-1,) * 6])
@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize("bent", [True, False])
def test_status_and_turn_of_joints(angles, back, bent):
    turn = int("".join("1" if angle < 0 else "0" for angle in reversed(angles)), 2)
    status = (1 if back else 0) + (0 if bent else 2)
    found = KrlProgram.posture(None, back, bent, False, np.radians(angles))
    assert found == posture_of(status, turn)
    assert found != posture_of(status, turn ^ 1)
