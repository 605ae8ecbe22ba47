"""One pose on plain floats: what irbcal computes, and derivatives of it by differences."""

import numpy as np
import pytest
from export_harness import situations

from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import constants


@pytest.mark.parametrize("name", ["irb1600", "ur10", "panda", "level", "rail"])
def test_it_computes_what_irbcal_computes(sources, name):
    source = sources[name]
    numbers = constants(source.numbers, source.vectors)
    robot, plain = source.robot, Plain(**numbers)
    q, situation = situations(robot, 20, 21)
    theta, T = robot.joint_map.effective(q, **situation), robot.forward(q, **situation)
    rows = [(q[k].tolist(), {name: values[k].tolist() for name, values in situation.items()}) for k in range(len(q))]
    for function, wanted in ((plain.effective, theta), (plain.forward, T[:, :3])):
        assert np.abs(np.array([function(x, **given) for x, given in rows]) - wanted).max() < 1e-12
    for x, given in rows:
        step = 1e-5 * np.eye(len(x))
        sides = [[(x + sign * e).tolist() for e in step] for sign in (1.0, -1.0)]
        ahead, behind = (np.array([plain.effective(y, **given) for y in side]) for side in sides)
        assert np.abs(np.array(plain.jacobian(x, **given)) - (ahead - behind).T / 2e-5).max() < 1e-8
        ahead, behind = (np.array([plain.forward(y, **given) for y in side]) for side in sides)
        moved, turned = np.array(plain.tip_jacobian(x, **given)).reshape(2, 3, -1)
        assert np.abs(moved - (ahead - behind)[:, :, 3].T / 2e-5).max() < 1e-8
        R, slopes = np.array(plain.forward(x, **given))[:, :3], (ahead - behind)[:, :, :3] / 2e-5
        assert np.abs(np.cross(turned.T[:, None], R.T[None]).swapaxes(1, 2) - slopes).max() < 1e-8
    for (at, given), wanted in zip(rows, T.tolist(), strict=True):
        joints = plain.inverse(wanted, [x + 0.02 for x in at], **given)
        if joints is not None:
            assert np.abs(np.array(plain.forward(joints, **given)) - np.array(wanted)[:3]).max() < 5e-12


def test_wrong_shapes_are_refused(sources):
    source = sources["level"]
    with pytest.raises(ValueError, match="expected 6 joints"):
        Plain(**constants(source.numbers, source.vectors)).effective([0.0] * 5)
