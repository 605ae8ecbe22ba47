"""A URDF with its meshes in one folder."""

import re
from io import BytesIO

import numpy as np
import pytest
import trimesh
from lxml import etree

from irbcal.errors import CalibrationError
from irbcal.exporting import drake, mujoco
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import urdf_of, urdf_with_meshes
from irbcal.io import robots
from irbcal.io.urdf_xml import MeshFolders


def keep(path):
    return path.suffix.lower(), path.read_bytes()


def test_every_mesh_lies_in_the_folder_once(described):
    found = urdf_with_meshes(described["ur10"], keep)
    names = [mesh.get("filename") for mesh in found.tree.getroot().iter("mesh")]
    assert set(names) == set(found.meshes)
    assert len(names) == 14
    assert all(name.startswith("meshes/") and content for name, content in found.meshes.items())
    assert found.left_out == ()


def test_meshes_that_are_not_taken_leave_no_shape(described):
    found = urdf_with_meshes(described["ur10"], lambda path: keep(path) if path.suffix == ".stl" else None)
    root = found.tree.getroot()
    assert len(found.left_out) == 7
    assert not [shape for shape in root.iter("visual") if shape.find("geometry/mesh") is not None]
    assert len([shape for shape in root.iter("collision") if shape.find("geometry/mesh") is not None]) == 7


def test_what_is_missing_is_named(described):
    source = described["irb1600"]
    gone = source.urdf.replace(b"link_1", b"link_17")
    found = urdf_with_meshes(Source(source.robot, source.parts, source.vectors, 0.0, None, gone, source.folder), keep)
    assert "link_17.dae" in found.notes[0]
    assert "not on this computer" in found.notes[0]
    left = [shape for shape in found.tree.getroot().iter("visual") if shape.find("geometry/mesh") is not None]
    assert len(left) == source.urdf.count(b"/visual/") - 1
    with pytest.raises(CalibrationError, match="give its folder instead"):
        urdf_of(Source(source.robot, source.parts, source.vectors, 0.0))


@pytest.mark.parametrize("target", [mujoco, drake])
def test_collada_becomes_obj_of_the_same_size(described, target):
    """The UR10's drawings, which trimesh reads twice: as COLLADA, in its own units, and as what was written."""
    source = described["ur10"]
    finder = MeshFolders(source.folder, robots.package_dirs())
    written = target.files(source).files
    assert not [name for name in written if name.endswith(".dae")]
    for uri in {
        mesh.get("filename") for mesh in etree.fromstring(source.urdf).iter("mesh") if ".dae" in mesh.get("filename")
    }:
        path = finder.find(uri)
        scene = trimesh.load_scene(path)
        obj = trimesh.load(BytesIO(written[f"meshes/{path.stem}.obj"]), file_type="obj")
        unit = float(re.search(r"meter=.([\d.]+)", path.read_text()[:20000])[1])
        assert np.allclose(obj.bounds, scene.bounds * unit, rtol=0, atol=1e-6)
