"""Bodies against closed forms, and how they are shaded."""

import numpy as np
import pytest
from viewer_urdf import document

from irbcal.io import urdf_xml
from irbcal.viewer import shapes


def volume(triangles):
    """By the divergence theorem; negative where faces look inside."""
    return np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (shapes.box([0.2, 0.3, 0.5]), 0.03),
        (shapes.cylinder(0.1, 0.4), np.pi * 0.01 * 0.4),
        (shapes.sphere(0.1), 4 / 3 * np.pi * 1e-3),
        (shapes.capsule(0.1, 0.4), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 1e-3),
        (shapes.cone(0.2, 0.1, -0.1, 0.2), np.pi * 0.3 / 3 * (0.04 + 0.02 + 0.01)),
        (shapes.rod([1, 2, 3], [1.3, 2, 2.6], 0.05), np.pi * 0.0025 * 0.5 + 4 / 3 * np.pi * 1.25e-4),
    ],
)
def test_bodies_are_closed_and_as_large_as_they_should_be(body, expected):
    assert 0.97 * expected < volume(body) <= expected * (1 + 1e-9)


def test_shading_is_smooth_on_a_sphere_and_sharp_on_a_box():
    colour = np.full((1, 3), 0.5)
    ball = shapes.smooth(shapes.sphere(0.2), np.repeat(colour, len(shapes.sphere(0.2)), axis=0))
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    normals = ball.normals / np.linalg.norm(ball.normals.astype(float), axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", radial, normals).min() > np.cos(np.radians(3))
    box = shapes.smooth(shapes.box([1, 2, 3]), np.repeat(colour, 12, axis=0))
    assert (np.abs(box.normals).max(axis=1) == 127).all()
    assert (np.count_nonzero(box.normals, axis=1) == 1).all()
    assert (len(box.vertices), len(box.faces)) == (24, 12)
    assert (box.colours == 128).all()


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
