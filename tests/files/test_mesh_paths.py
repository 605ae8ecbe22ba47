"""URDFs whose meshes other readers find: MuJoCo, urchin and yourdfpy open them and compute the same poses."""

import hashlib
import os

import numpy as np
import pytest
import urchin
import yourdfpy
from lxml import etree
from support import assert_same_poses
from viewer_urdf import document, mesh, write_stl

import irbcal
from irbcal.errors import OptionError, RobotError
from irbcal.files.mesh_paths import MeshFolders, Problem, with_mesh_paths
from irbcal.viewer import shapes


@pytest.fixture(scope="session")
def mujoco():
    return pytest.importorskip("mujoco", reason="MuJoCo needs Python 3.11")


@pytest.fixture(scope="module", params=["relative", "absolute"])
def written(request, outcome, tmp_path_factory):
    """A calibration folder with mesh paths, blanks and letters beyond ASCII in its own."""
    folder = tmp_path_factory.mktemp("mesh") / "a cell of Zürich" / "cal"
    irbcal.save(outcome, folder, mesh_paths=request.param, world_link=True, target_links=True)
    return folder


@pytest.fixture
def joints(outcome):
    """Commanded and effective joints, and the tip in the base link by irbcal."""
    robot = outcome.fit.robot
    q = robot.arm.random_joints(40, 4)
    return robot.joint_map.effective(q), robot.poses(q)


def test_mujoco_computes_the_same_poses(written, joints, mujoco):
    model = mujoco.MjModel.from_xml_path(str(written / "calibrated.urdf"))
    data = mujoco.MjData(model)
    assert model.nmesh == 14  # its 14 convex collision shapes
    found = []
    for theta in joints[0]:
        data.qpos[:] = theta
        mujoco.mj_kinematics(model, data)
        T_world_base, T_world_tip = np.eye(4), np.eye(4)
        for T, name in ((T_world_base, "base_link"), (T_world_tip, "tool0")):
            T[:3, :3], T[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        found.append(np.linalg.inv(T_world_base) @ T_world_tip)
    assert_same_poses(found, joints[1], 1e-9, 1e-9)


def test_urchin_and_yourdfpy_find_the_meshes_and_compute_the_same_poses(written, joints):
    file = str(written / "calibrated.urdf")
    theirs, other = urchin.URDF.load(file), yourdfpy.URDF.load(file)
    assert sum(len(v.geometry.mesh.meshes) for link in theirs.links for v in link.visuals) > 20
    assert len(other.scene.geometry) > 20
    names = irbcal.load(written).robot_calibrated().arm.joint_names
    found = {"urchin": [], "yourdfpy": []}
    for theta in joints[0]:
        configuration = dict(zip(names, theta.tolist(), strict=True))
        poses = theirs.link_fk(configuration, use_names=True)
        found["urchin"].append(np.linalg.inv(poses["base_link"]) @ poses["tool0"])
        other.update_cfg(configuration)
        found["yourdfpy"].append(other.get_transform("tool0", "base_link"))
    for poses in found.values():
        assert_same_poses(poses, joints[1], 1e-9, 1e-9)


def test_the_calibration_is_whole(written):
    record = irbcal.load(written).record
    content = (written / "calibrated.urdf").read_bytes()
    assert record.calibrated_urdf_sha256 == hashlib.sha256(content).hexdigest()
    assert irbcal.verify(written)
    assert irbcal.verify(written, written / "calibrated.urdf").same_file
    assert not any("mesh" in str(said) for said in irbcal.view(written).told())  # the view finds the meshes, too
    other = written.parent / "whole"
    again = irbcal.load(written).save(other, mesh_paths="absolute")  # of one that was loaded
    assert again.fingerprint == record.fingerprint
    names = [e.get("filename") for e in etree.parse(other / "calibrated.urdf").iter("mesh")]
    assert len(names) == 21
    assert all(os.path.isabs(name) and os.path.isfile(name) for name in names)


def test_package_leaves_the_urdf_as_it_is(outcome, tmp_path):
    calibration = irbcal.calibration.Calibration(outcome)
    calibration.save(tmp_path / "cal", mesh_paths="package")
    assert (tmp_path / "cal" / "calibrated.urdf").read_bytes() == calibration.urdf
    assert calibration.urdf.count(b"package://") == 21
    with pytest.raises(OptionError, match="mesh_paths"):
        irbcal.save(outcome, tmp_path / "c", mesh_paths="short")


# ---------------------------------------------------------------- what a URDF may name


@pytest.fixture
def cell(tmp_path):
    """A URDF's folder with a mesh and a texture, a package, and a secret outside."""
    box = shapes.box([1, 1, 1])
    for name in ("urdf/meshes/part.stl", "ws/my_robot/meshes/part.stl", "secret.stl"):
        write_stl(tmp_path / name, box)
    (tmp_path / "urdf" / "wood.png").write_bytes(b"")
    (tmp_path / "urdf" / "notes.txt").write_text("private")
    return tmp_path


def written_names(cell, how, *names, extra=""):
    data = etree.tostring(document("".join(map(mesh, names)), extra).tree)
    folders = MeshFolders(cell / "urdf", [cell / "ws"])
    root = etree.fromstring(with_mesh_paths(data, how, cell / "out" / "cal", folders, "arm.urdf"))
    return [element.get("filename") for element in root.iter("mesh", "texture")], root


def test_names_become_paths(cell):
    names = ["package://my_robot/meshes/part.stl", "meshes/part.stl", f"file://{cell}/ws/my_robot/meshes/part.stl"]
    assert written_names(cell, "relative", *names)[0] == [
        "../../ws/my_robot/meshes/part.stl",
        "../../urdf/meshes/part.stl",
        "../../ws/my_robot/meshes/part.stl",
    ]
    assert written_names(cell, "absolute", *names)[0] == [
        f"{cell}/ws/my_robot/meshes/part.stl",
        f"{cell}/urdf/meshes/part.stl",
        f"{cell}/ws/my_robot/meshes/part.stl",
    ]
    texture = '<material name="wood"><texture filename="wood.png"/></material>'
    assert written_names(cell, "absolute", extra=texture)[0] == [f"{cell}/urdf/wood.png"]


@pytest.mark.parametrize("name", ["http://example.org/part.stl", "https://example.org/x", "/etc/passwd", "/dev/zero"])
def test_other_addresses_and_whole_paths_stay(cell, name):
    assert written_names(cell, "absolute", name)[0] == [name]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("../../etc/passwd", "not found"),
        ("../secret.stl", "outside"),
        ("package://my_robot/../../secret.stl", "outside"),
        ("package://../secret.stl", "outside"),
        ("file:///etc/passwd", "outside"),
        ("package://my_robot/meshes/absent.stl", "not found"),
        ("notes.txt", "are read as meshes"),
    ],
)
@pytest.mark.parametrize("how", ["relative", "absolute"])
def test_what_is_not_found_or_lies_outside_is_refused(cell, how, name, why):
    with pytest.raises(RobotError, match=why) as refused:
        written_names(cell, how, "meshes/part.stl", name)
    assert f"cannot be made {how}: {name}" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_too_many_files_are_refused(cell, monkeypatch):
    monkeypatch.setattr("irbcal.files.mesh_paths.MOST_FILES", 2)
    names = ["meshes/part.stl", "./meshes/part.stl"]
    assert len(written_names(cell, "relative", *names, *names)[0]) == 4
    with pytest.raises(RobotError, match="more than 2 files are too many"):
        written_names(cell, "relative", *names, "../urdf/meshes/part.stl")


def test_a_file_is_found_by_whichever_folder_it_lies_in(cell):
    folders = MeshFolders(cell / "urdf", [cell / "ws"])
    assert folders.find("../ws/my_robot/meshes/part.stl") == cell / "ws" / "my_robot" / "meshes" / "part.stl"
    with pytest.raises(Problem, match="outside"):
        folders.find("../secret.stl")


def test_what_a_urdf_says_to_mujoco_is_kept(cell):
    said = '<mujoco><compiler meshdir="../m" strippath="true" balanceinertia="true"/><option timestep="0.1"/></mujoco>'
    root = written_names(cell, "relative", "meshes/part.stl", extra=said)[1]
    (element,) = root.findall("mujoco")
    assert dict(element.find("compiler").attrib) == {"strippath": "false", "balanceinertia": "true"}
    assert element.find("option").get("timestep") == "0.1"
    root = written_names(cell, "relative", extra='<mujoco><option timestep="0.1"/></mujoco>')[1]
    assert root.find("mujoco/compiler").get("strippath") == "false"


def test_the_command_writes_paths_or_nothing(outcome, tmp_path, program):
    data = outcome.measurements.source
    robot = tmp_path / "my_robot.urdf"
    text = irbcal.shipped.robot_file("irb1600").read_text()
    robot.write_text(text)
    call = ["calibrate", data, "--robot", robot, "--model", "offsets", "--mesh-paths", "absolute", "--out"]
    program(*call, tmp_path / "cal")
    assert b'="package:' not in (tmp_path / "cal" / "calibrated.urdf").read_bytes()
    robot.write_text(text.replace("visual/link_1.dae", "visual/absent.dae"))
    with pytest.raises(RobotError, match=r"absent\.dae: the file was not found"):
        program(*call, tmp_path / "none")
    assert not (tmp_path / "none").exists()
