"""Bodies against closed forms, and how they are shaded."""

import numpy as np
import pytest

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
