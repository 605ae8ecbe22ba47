"""One pose on plain floats: what irbcal computes, and derivatives as the module on numpy has them."""

import numpy as np
import pytest
from export_harness import situations

from irbcal.exporting.batch import Batch
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import constants


@pytest.mark.parametrize("name", ["irb1600", "ur10", "panda", "level", "rail"])
def test_it_computes_what_irbcal_computes(sources, name):
    source = sources[name]
    numbers = constants(source.numbers, source.vectors)
    robot, batch, plain = source.robot, Batch(**numbers), Plain(**numbers)
    q, situation = situations(robot, 20, 21)
    theta, T = robot.joint_map.effective(q, **situation), robot.forward(q, **situation)
    rows = [(q[k].tolist(), {name: values[k].tolist() for name, values in situation.items()}) for k in range(len(q))]
    for function, wanted in (
        (plain.effective, theta),
        (plain.forward, T[:, :3]),
        (plain.jacobian, batch.jacobian(q, **situation)),
        (plain.tip_jacobian, batch.tip_jacobian(q, **situation)),
    ):
        assert np.abs(np.array([function(x, **given) for x, given in rows]) - wanted).max() < 1e-12
    for (at, given), wanted in zip(rows, T.tolist(), strict=True):
        joints = plain.inverse(wanted, [x + 0.02 for x in at], **given)
        if joints is not None:
            assert np.abs(np.array(plain.forward(joints, **given)) - np.array(wanted)[:3]).max() < 5e-12


def test_wrong_shapes_are_refused(sources):
    source = sources["level"]
    with pytest.raises(ValueError, match="expected 6 joints"):
        Plain(**constants(source.numbers, source.vectors)).effective([0.0] * 5)
