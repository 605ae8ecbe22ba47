"""A URDF with its meshes in one folder."""

import pytest

from irbcal.errors import CalibrationError, RobotError
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import urdf_of, urdf_with_meshes


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
    with pytest.raises(RobotError, match="the file was not found"):
        urdf_with_meshes(Source(source.robot, source.parts, source.vectors, 0.0, None, gone, source.folder), keep)
    with pytest.raises(CalibrationError, match="give its folder instead"):
        urdf_of(Source(source.robot, source.parts, source.vectors, 0.0))
