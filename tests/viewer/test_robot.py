"""Looks of a robot: bodies against closed forms, meshes where the URDF puts them, and files that may not be read."""

import struct

import numpy as np
import pytest

from irbcal.files import urdf
from irbcal.viewer import robot, shapes


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


# --- URDFs -----------------------------------------------------------------------------------------------------

JOINTS = "".join(
    f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
    f'<origin xyz="{0.1 * k:.1f} 0 0.2" rpy="0.1 {0.2 * k:.1f} 0"/><axis xyz="{axis}"/>'
    '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    for k, axis in enumerate(["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"], start=1)
)


def document(visuals, extra=""):
    """An arm of six joints whose first link has these visuals."""
    data = f'<robot name="arm"><link name="l0">{visuals}</link>{JOINTS}{extra}</robot>'.encode()
    return urdf.from_bytes(data, "arm.urdf", "l0", "l6")


def mesh(name, more=""):
    return f'<visual><geometry><mesh filename="{name}" {more}/></geometry></visual>'


def looks(visuals, folder, package_dirs=(), extra=""):
    arm = document(visuals, extra)
    return robot.meshes(arm, robot.links(arm), folder, package_dirs)


def write_stl(path, triangles):
    """A binary STL, by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = b"\0" * 80 + struct.pack("<I", len(triangles))
    for triangle in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *np.ravel(triangle), 0)
    path.write_bytes(data)
    return path


@pytest.fixture
def packages(tmp_path):
    write_stl(tmp_path / "ws" / "my_robot" / "meshes" / "part.stl", shapes.box([1, 1, 1]))
    write_stl(tmp_path / "secret.stl", shapes.box([1, 1, 1]))
    return tmp_path / "ws"


def test_links_move_as_pinocchio_says():
    import pinocchio as pin

    grip = (
        '<link name="finger"/><joint name="grip" type="prismatic"><parent link="l6"/><child link="finger"/>'
        '<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
        '<mimic joint="j2" multiplier="0.01" offset="0.02"/></joint>'
    )
    arm = document("", grip)
    from lxml import etree

    model = pin.buildModelFromXML(etree.tostring(arm.tree).decode(), mimic=True)
    data = model.createData()
    tree = robot.links(arm)
    for q in np.random.default_rng(1).uniform(-3, 3, (5, 6)):
        pin.framesForwardKinematics(model, data, q)
        for link, T in zip(tree, robot.place(tree, q), strict=True):
            assert np.abs(T - data.oMf[model.getFrameId(link.name)].homogeneous).max() < 1e-12, link.name


def test_meshes_stand_where_the_urdf_puts_them(packages):
    visual = (
        '<visual><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry>'
        '<mesh filename="package://my_robot/meshes/part.stl" scale="0.2 0.4 0.6"/></geometry>'
        '<material name="red"><color rgba="1 0 0 1"/></material></visual>'
    )
    found, notes = looks(visual, packages, [packages])
    assert notes == []
    assert list(found) == [0]
    np.testing.assert_allclose(found[0].vertices.min(axis=0), [1 - 0.2, 2 - 0.1, 3 - 0.3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[0].vertices.max(axis=0), [1 + 0.2, 2 + 0.1, 3 + 0.3], rtol=0, atol=1e-6)
    assert (found[0].colours == [255, 0, 0]).all()


def test_collada_units_colours_and_textures(tmp_path):
    collada = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <asset><unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis></asset>
    <library_images><image id="i"><init_from>secret.png</init_from></image></library_images>
    <library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse><color>0 1 0 1</color></diffuse>
    </lambert></technique></profile_COMMON></effect></library_effects>
    <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
    <library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">0 0 0 1000 0 0 0 500 0
    </float_array><technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
    <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="1" material="s"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
    </mesh></geometry></library_geometries>
    <library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="s" target="#m"/></technique_common></bind_material></instance_geometry></node>
    </visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
    (tmp_path / "part.dae").write_text(collada)
    (tmp_path / "secret.png").write_bytes(b"not for others")
    found, notes = looks(mesh("part.dae"), tmp_path)
    assert notes == []
    np.testing.assert_allclose(found[0].vertices.max(axis=0), [1.0, 0.5, 0.0], rtol=0, atol=1e-6)
    assert (found[0].colours == [0, 255, 0]).all()
    (tmp_path / "part.dae").write_text(collada.replace("?>", '?><!DOCTYPE x [<!ENTITY e SYSTEM "secret.png">]>', 1))
    assert "entities" in looks(mesh("part.dae"), tmp_path)[1][0]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("package://my_robot/../../secret.stl", "outside"),
        ("package://../secret.stl", "outside"),
        ("../secret.stl", "outside"),
        ("file://{top}/secret.stl", "outside"),
        ("{top}/secret.stl", "outside"),
        ("package://my_robot/meshes/link.stl", "outside"),
        ("package://my_robot/meshes/notes.txt", "are read as meshes"),
        ("package://my_robot/meshes/absent.stl", "not found"),
        ("package://my_robot/meshes/broken.stl", "no triangles"),
        ("package://my_robot/meshes/broken.dae", "not a readable mesh"),
        ("https://example.org/part.stl", "on this computer"),
        ("/dev/zero", "not found"),
        ("", "not found"),
        ("x" * 5000 + ".stl", "not found"),
    ],
)
def test_what_may_not_be_read_is_one_note_and_a_rod(packages, name, why):
    meshes = packages / "my_robot" / "meshes"
    (meshes / "link.stl").symlink_to(packages.parent / "secret.stl")
    (meshes / "notes.txt").write_text("private")
    (meshes / "broken.stl").write_bytes(b"solid nothing\n")
    (meshes / "broken.dae").write_text("<COLLADA/>")
    found, notes = looks(mesh(name.format(top=packages.parent)), packages, [packages])
    assert len(notes) == 1
    assert why in notes[0]
    assert len(notes[0]) < 400
    assert len(found[0].faces) > 100  # drawn as a rod to its joint


def test_package_may_be_the_folder_itself_or_around_the_urdf(packages):
    name = mesh("package://my_robot/meshes/part.stl")
    assert looks(name, packages.parent, [packages / "my_robot"])[1] == []
    inside = packages / "my_robot" / "urdf"
    inside.mkdir()
    assert "not found" in looks(name, inside)[1][0]  # a folder of that name is not yet a package
    (packages / "my_robot" / "package.xml").write_text("<package/>")
    assert looks(name, inside)[1] == []


@pytest.mark.parametrize(
    "visual",
    [
        "<visual/>",
        "<visual><geometry/></visual>",
        '<visual><geometry><box size="1 2"/></geometry></visual>',
        '<visual><geometry><cylinder radius="1"/></geometry></visual>',
        '<visual><geometry><sphere radius="nan"/></geometry></visual>',
        "<visual><geometry><teapot/></geometry></visual>",
        '<visual><origin xyz="a b c"/><geometry><sphere radius="1"/></geometry></visual>',
    ],
)
def test_visuals_that_make_no_sense_are_noted(visual, tmp_path):
    found, notes = looks(visual, tmp_path)
    assert len(notes) == 1
    assert 0 in found


def test_a_robot_without_looks_is_drawn_as_rods(tmp_path):
    found, notes = looks("", tmp_path)
    assert notes == []
    assert set(found) == set(range(7))


def test_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(robot, "MAX_TRIANGLES", 10)
    write_stl(tmp_path / "part.stl", shapes.box([1, 1, 1]))
    assert "more than 10 triangles" in looks(mesh("part.stl"), tmp_path)[1][0]
