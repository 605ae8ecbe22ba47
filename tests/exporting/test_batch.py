"""Many poses on numpy alone: what irbcal computes."""

import numpy as np
import pytest
from export_harness import situations

from irbcal.exporting.batch import Batch
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import constants


@pytest.mark.parametrize(
    ("name", "poses"), [("irb1600", 10_000), ("ur10", 10_000), ("panda", 10_000), ("level", 500), ("rail", 500)]
)
def test_it_computes_what_irbcal_computes(sources, name, poses):
    source = sources[name]
    robot, batch = source.robot, Batch(**constants(source.numbers, source.vectors))
    q, situation = situations(robot, poses, 21)
    theta, T = robot.joint_map.effective(q, **situation), robot.forward(q, **situation)
    assert np.abs(batch.effective(q, **situation) - theta).max() < 1e-12
    assert np.abs(batch.forward(q, **situation) - T).max() < 1e-12
    some = slice(0, 1000)
    assert (
        np.abs(batch.commanded(theta[some], **{name: part[some] for name, part in situation.items()}) - q[some]).max()
        < 1e-12
    )
    few = slice(0, 20)
    rest = {name: part[few] for name, part in situation.items()}
    back, found = batch.inverse(T[few], q[few] + 0.02, **rest)
    assert found.mean() > 0.9
    assert np.abs(batch.forward(back, **rest) - T[few])[found].max() < 5e-12
    known = ~np.isnan(rest["previous"][:, 0])
    usual = q[few][known], rest["previous"][known]
    assert np.abs(batch.jacobian(*usual) - robot.joint_map.jacobian(*usual)).max() < 1e-12
    plain, J = Plain(**constants(source.numbers, source.vectors)), batch.tip_jacobian(q[few], **rest)
    for k, x in enumerate(q[few].tolist()):
        wanted = plain.tip_jacobian(x, **{name: values[k].tolist() for name, values in rest.items()})
        assert np.abs(J[k] - wanted).max() < 1e-12


def test_wrong_shapes_are_refused(sources):
    source = sources["level"]
    with pytest.raises(ValueError, match="joints need shape"):
        Batch(**constants(source.numbers, source.vectors)).effective([[0.0] * 5])
