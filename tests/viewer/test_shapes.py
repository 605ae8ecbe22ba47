"""Bodies against closed forms, and how they are shaded."""

import numpy as np
import pytest
from viewer_urdf import document, link_poses

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


def surface_points(mesh):
    corners = mesh.vertices[mesh.faces].astype(float)
    return np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])


def test_coarser_bodies_keep_their_shape_and_colours():
    ball = shapes.sphere(0.2)
    cubes = np.concatenate([shapes.moved(shapes.box([0.1] * 3), [1 + 0.1 * k, 0, 0]) for k in range(8)])
    colours = np.repeat([[1.0, 0, 0], [0, 0, 1.0]], [len(ball), len(cubes)], axis=0)
    coarse = shapes.coarser(shapes.smooth(np.concatenate([ball, cubes]), colours), 0.3)
    red = (coarse.colours == [255, 0, 0]).all(axis=1)
    assert (red | (coarse.colours == [0, 0, 255]).all(axis=1)).all()
    of_ball = red[coarse.faces[:, 0]]
    assert (red[coarse.faces].all(axis=1) == of_ball).all()  # no face has two colours
    assert abs(of_ball.sum() - 0.3 * 960) < 4  # 64 of the ball's 1,024 have no area
    assert (~of_ball).sum() == 60
    parts = [shapes.Mesh(coarse.vertices, coarse.normals, coarse.colours, coarse.faces[k]) for k in (of_ball, ~of_ball)]
    assert np.abs(np.linalg.norm(surface_points(parts[0]), axis=1) - 0.2).max() < 0.02
    assert volume(coarse.vertices[parts[0].faces].astype(float)) == pytest.approx(4 / 3 * np.pi * 0.008, rel=0.07)
    off_cubes = np.abs(surface_points(parts[1]) - [1.35, 0, 0]) - [0.4, 0.05, 0.05]
    assert off_cubes.max() < 1e-6


def test_a_coarser_robot_stays_within_millimetres():
    from trimesh.triangles import closest_point

    import irbcal

    mesh = irbcal.view("irb1600").scene.meshes[1]
    coarse = shapes.coarser(mesh, 0.25)
    assert len(coarse.faces) < 0.26 * len(mesh.faces)
    assert set(map(tuple, coarse.colours)) == set(map(tuple, mesh.colours))
    rng = np.random.default_rng(1)
    for one, other in ((mesh, coarse), (coarse, mesh)):
        triangles, few = other.vertices[other.faces].astype(float), rng.choice(surface_points(one), 150)
        on_it = closest_point(np.tile(triangles, (len(few), 1, 1)), np.repeat(few, len(triangles), axis=0))
        away = np.linalg.norm(on_it.reshape(len(few), -1, 3) - few[:, None], axis=2).min(axis=1)
        assert away.max() < 6e-3
        assert away.mean() < 1e-3


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
        for link, T in zip(tree, link_poses(tree, q), strict=True):
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
