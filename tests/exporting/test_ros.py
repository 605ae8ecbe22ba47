"""The exported ROS package: xacro and check_urdf take it, and it is the calibrated robot."""

import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
import xacro
from export_harness import situations
from scipy.spatial.transform import Rotation
from support import assert_same_poses

import irbcal
from irbcal.exporting import ros as target
from irbcal.io import urdf_check
from irbcal.modeling import frames


def write(source, folder):
    made = target.files(source).files
    for name, content in made.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return f"{source.numbers.identifier}_calibrated", made


@pytest.mark.parametrize("name", ["irb1600", "ur10", "panda"])
def test_xacro_makes_the_calibrated_robot(described, tmp_path, name):
    source = described[name]
    word, made = write(source, tmp_path)
    text = xacro.process_file(str(tmp_path / "urdf" / f"{word}.urdf.xacro")).toxml().encode()
    q, situation = situations(source.robot, 500, 6)
    theta = source.robot.joint_map.effective(q, **situation)
    for data in (text, made[f"urdf/{word}.urdf"]):
        tips = urdf_check.poses(data, source.robot.arm, theta)
        assert_same_poses(tips, source.robot.forward(q, **situation), 1e-12, 1e-12)
    names = {mesh.get("filename") for mesh in ET.fromstring(text).iter("mesh")}
    assert names == {f"package://{word}/{mesh}" for mesh in made if mesh.startswith("meshes/")}
    check = shutil.which("check_urdf", path=str(Path(sys.executable).parent))
    if check is not None:
        (tmp_path / "made.urdf").write_bytes(text)
        done = subprocess.run([check, tmp_path / "made.urdf"], capture_output=True, text=True)
        assert "Successfully Parsed XML" in done.stdout + done.stderr


def test_a_prefix_names_every_link_and_joint(described, tmp_path):
    source = described["panda"]
    word, _ = write(source, tmp_path)
    text = xacro.process_file(str(tmp_path / "urdf" / f"{word}.urdf.xacro"), mappings={"prefix": "left_"}).toxml()
    root = ET.fromstring(text)
    names = [element.get("name") for tag in ("link", "joint") for element in root.findall(tag)]
    names += [element.get("link") for tag in ("parent", "child") for element in root.iter(tag)]
    names += [element.get("joint") for element in root.iter("mimic")]
    assert len(names) > 40
    assert all(name.startswith("left_") for name in names)


def test_joint_origins_and_fingerprint_come_along(folder, tmp_path):
    found = irbcal.export(folder, "ros", tmp_path / "out")
    assert "config/joint_origins.yaml" in found.files
    for name in ("package.xml", "config/joint_origins.yaml"):
        assert found.fingerprint in (tmp_path / "out" / name).read_text()
    assert "install(DIRECTORY urdf meshes config" in (tmp_path / "out" / "CMakeLists.txt").read_text()


def test_cameras_and_boards_of_pictures_are_links(tmp_path):
    """At their true places, of SIMULATED corners without noise; a prefix names them, too."""
    rng = np.random.default_rng(2)
    truth = cases.unknowns("image-on-tool", rng)
    rows = cases.images("image-on-tool", cases.arm(), truth, 12, rng, 0.0)
    rows["pose"] = [f"p{k}" for k in np.repeat(range(12), len(cases.corners()))]
    rows["feature"] = "wall board"
    known = pd.DataFrame([{"feature": "wall board", "kind": "image-on-tool", **cases.camera(target="eye")}])
    options = {"robot": "irb1600", "features": known, "model": "placement", "leave_out": "none"}
    irbcal.calibrate(rows, **options).save(tmp_path / "c")
    irbcal.export(tmp_path / "c", "ros", tmp_path / "out", without_meshes=True)
    (file,) = (tmp_path / "out" / "urdf").glob("*_calibrated.urdf.xacro")
    root = ET.fromstring(xacro.process_file(str(file), mappings={"prefix": "a_"}).toxml())
    for name, parent, expected in (
        ("a_eye", "a_tool0", frames.transform(truth["axes"], cases.TOOL)),
        ("a_wall_board", "a_base_link", frames.transform(truth["attitude"], truth["centre"])),
    ):
        (joint,) = (
            j for j in root.iter("joint") if j.find("child") is not None and j.find("child").get("link") == name
        )
        assert joint.find("parent").get("link") == parent
        xyz, rpy = (np.array(joint.find("origin").get(key).split(), dtype=float) for key in ("xyz", "rpy"))
        found = frames.transform(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)
        assert_same_poses(found, expected, 1e-6, 1e-6)
