"""Links where Pinocchio puts them."""

import numpy as np
import pytest
from viewer_urdf import document

from irbcal.io import urdf_xml
from irbcal.viewer import shapes


def test_links_move_as_pinocchio_says():
    import pinocchio as pin

    grip = (
        '<link name="finger"/><joint name="grip" type="prismatic"><parent link="l6"/><child link="finger"/>'
        '<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
        '<mimic joint="j2" multiplier="0.01" offset="0.02"/></joint>'
    )
    arm = document("", grip)
    model = pin.buildModelFromXML(urdf_xml.serialised(arm.tree).decode(), mimic=True)
    data = model.createData()
    tree = shapes.links(arm)
    for q in np.random.default_rng(1).uniform(-3, 3, (5, 6)):
        pin.framesForwardKinematics(model, data, q)
        for link, T in zip(tree, shapes.place(tree, q), strict=True):
            assert np.abs(T - data.oMf[model.getFrameId(link.name)].homogeneous).max() < 1e-12, link.name


def test_numbers_of_urdfs_are_finite():
    assert shapes.vector(" 1 -2e1  .5", 3).tolist() == [1.0, -20.0, 0.5]
    for text in ("1 2", "1 2 nan", "1 2 x", "", None):
        with pytest.raises(ValueError, match=r"expected 3 numbers|could not convert"):
            shapes.vector(text, 3)


def test_the_reach_is_the_longest_chain():
    tree = shapes.links(document(""))
    expected = sum(np.hypot(0.1 * k, 0.2) for k in range(1, 7))
    assert abs(shapes.reach(tree) - expected) < 1e-12
