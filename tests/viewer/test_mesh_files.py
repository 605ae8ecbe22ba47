"""Mesh files: what is read, and what may not be."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from viewer_urdf import looks, mesh

from irbcal.io.meshes import read_mesh
from irbcal.io.urdf_xml import MeshProblem

MESHES = Path(__file__).parents[2] / "urdf" / "irbcal_description" / "meshes"


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


@pytest.mark.parametrize("folder", ["irb1600/visual", "irb120/visual", "irb1600/collision"])
def test_collada_and_stl_are_what_trimesh_reads(folder):
    files = sorted((MESHES / folder).iterdir())
    assert len(files) > 5
    for path in files:
        triangles, colours = read_mesh(path.read_bytes(), path.suffix[1:], path.name, 10**6)
        scene = trimesh.load_scene(path, process=False)
        expected = []
        for node in scene.graph.nodes_geometry:
            T, name = scene.graph[node]
            mesh = scene.geometry[name]
            corners = mesh.triangles @ T[:3, :3].T + T[:3, 3]
            colour = mesh.visual.material.main_color[:3] / 255 if path.suffix == ".dae" else np.full(3, np.nan)
            expected.append(np.concatenate([corners.reshape(-1, 9), np.tile(colour, (len(corners), 1))], axis=1))
        if colours is None:
            colours = np.full((len(triangles), 3), np.nan)
        actual = np.concatenate([triangles.reshape(-1, 9), colours], axis=1)
        np.testing.assert_allclose(actual, np.concatenate(expected), atol=1e-7, rtol=0.0)


def test_more_triangles_than_allowed_are_refused():
    for path in ("irb1600/visual/link_1.dae", "irb1600/collision/base_link_1.stl"):
        file = MESHES / path
        with pytest.raises(MeshProblem, match="more than 5 triangles"):
            read_mesh(file.read_bytes(), file.suffix[1:], file.name, 5)
