"""A URDF with its meshes in one folder."""

import re
import shutil
from io import BytesIO

import numpy as np
import pytest
import trimesh
from lxml import etree

import irbcal
from irbcal.errors import CalibrationError
from irbcal.exporting import drake, mujoco
from irbcal.exporting.export import Exported
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
    found = urdf_with_meshes(Source(source.robot, source.numbers, source.vectors, 0.0, None, gone, source.folder), keep)
    assert "link_17.dae" in found.notes[0]
    assert "on this computer" in found.notes[0]
    left = [shape for shape in found.tree.getroot().iter("visual") if shape.find("geometry/mesh") is not None]
    assert len(left) == source.urdf.count(b"/visual/") - 1
    with pytest.raises(CalibrationError, match="give its folder instead"):
        urdf_of(Source(source.robot, source.numbers, source.vectors, 0.0))


TEXTURED = b'<material name="steel"><texture filename="meshes/steel.png"/></material></robot>'


@pytest.mark.parametrize("target", [mujoco, drake])
def test_collada_becomes_obj_of_the_same_size_and_textures_are_left_out(described, tmp_path, target):
    """The UR10's drawings, which trimesh reads twice: as COLLADA, in its own units, and as what was written."""
    source = described["ur10"]
    finder = MeshFolders(source.folder, robots.package_dirs())
    textured = source.urdf.replace(b"</robot>", TEXTURED)
    made = target.files(Source(source.robot, source.numbers, source.vectors, 0.0, None, textured, source.folder))
    written = made.files
    assert not [name for name in written if name.endswith((".dae", ".png"))]
    assert made.notes == ("textures are left out: steel.png",)
    told = Exported("any", tmp_path, tuple(written), "", False, 0.0, "", made.notes).report()
    assert f"Note: {made.notes[0]}" in told
    for uri in {
        mesh.get("filename") for mesh in etree.fromstring(source.urdf).iter("mesh") if ".dae" in mesh.get("filename")
    }:
        path = finder.find(uri)
        scene = trimesh.load_scene(path)
        obj = trimesh.load(BytesIO(written[f"meshes/{path.stem}.obj"]), file_type="obj")
        unit = float(re.search(r"meter=.([\d.]+)", path.read_text()[:20000])[1])
        assert np.allclose(obj.bounds, scene.bounds * unit, rtol=0, atol=1e-6)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A robot whose meshes lie in a package of their own, beside the robot's, beside the URDF, and far away."""
    folder = tmp_path_factory.mktemp("workspace")
    shipped = robots.urdf_folder() / "irbcal_description"
    text = robots.robot_file("irb120").read_text(encoding="utf-8")
    text = text.replace("irbcal_description/meshes/irb120/visual", "arm_visual/meshes")
    text = text.replace("package://irbcal_description/meshes/irb120/collision/link_1.stl", "../solids/link_1.stl")
    text = text.replace("irbcal_description/meshes/irb120/collision", "arm_far/solids")
    for name in ("src/arm/urdf", "src/arm/solids", "src/arm_visual", "elsewhere/arm_far"):
        (folder / name).mkdir(parents=True)
    for name in ("arm", "arm_visual"):
        (folder / "src" / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    shutil.copytree(shipped / "meshes" / "irb120" / "visual", folder / "src" / "arm_visual" / "meshes")
    shutil.copytree(shipped / "meshes" / "irb120" / "collision", folder / "elsewhere" / "arm_far" / "solids")
    shutil.copy(shipped / "meshes" / "irb120" / "collision" / "link_1.stl", folder / "src" / "arm" / "solids")
    robot = folder / "src" / "arm" / "urdf" / "arm.urdf"
    robot.write_text(text, encoding="utf-8")
    irbcal.simulate("irb120", random=30, seed=1).to_frame().to_csv(folder / "measured.csv", index=False)
    return folder, robot


@pytest.fixture(scope="module")
def remembering(workspace):
    folder, robot = workspace
    options = {"package_dirs": [folder / "elsewhere"], "model": "placement"}
    irbcal.calibrate(folder / "measured.csv", robot, **options).save(folder / "cal")
    return folder / "cal"


@pytest.mark.parametrize("target", ["mujoco", "drake", "ros", "urdf"])
def test_a_calibration_remembers_where_its_meshes_lie(remembering, tmp_path, monkeypatch, target):
    monkeypatch.chdir(tmp_path)
    written = irbcal.export(remembering, target, tmp_path / target)
    assert written.notes == ()
    if target == "urdf":
        (name,) = (name for name in written.files if name.endswith(".urdf"))
        names = etree.parse(tmp_path / target / name).getroot().iter("mesh")
        assert all((tmp_path / target / mesh.get("filename")).is_file() for mesh in names)
    else:
        assert len([name for name in written.files if name.startswith("meshes/")]) == 17
    assert not [note for note in irbcal.view(remembering).scene.notes if "mesh" in note or ".dae" in note]


@pytest.mark.parametrize("target", ["mujoco", "drake", "ros", "urdf"])
def test_an_export_does_without_meshes(remembering, workspace, tmp_path, target):
    """Without those that are not wanted, and without those that have moved since."""
    out = tmp_path / "without"
    assert "--without-meshes" in irbcal.export(remembering, target, out, without_meshes=True).notes[0]
    calibration, moved = shutil.copytree(remembering, tmp_path / "cal"), tmp_path / "moved"
    workspace[0].rename(moved)
    try:
        again = irbcal.export(calibration, target, tmp_path / "again")
        assert "--package-dir" in again.notes[0]
        folders = [moved / "src", moved / "elsewhere", moved / "src" / "arm" / "urdf", moved / "src" / "arm"]
        assert irbcal.export(calibration, target, tmp_path / "named", package_dirs=folders).notes == ()
    finally:
        moved.rename(workspace[0])
    for folder in (out, tmp_path / "again"):
        assert not (folder / "meshes").exists()
        assert all(b"<mesh" not in file.read_bytes() for file in folder.rglob("*.urdf"))


def test_shipped_robots_leave_no_folder_of_this_computer(folder):
    assert irbcal.load(folder).record.mesh_folders is None
