"""The exported URDF: meshes by paths of a kind, the same poses."""

import pytest
import yourdfpy
from export_harness import situations
from support import assert_same_poses

import irbcal
from irbcal.exporting.source import Source
from irbcal.io import urdf_check


@pytest.mark.parametrize("paths", ["relative", "absolute", "package"])
def test_urdf_with_mesh_paths(folder, tmp_path, paths):
    found = irbcal.export(folder, "urdf", tmp_path / "out", mesh_paths=paths)
    (name,) = (name for name in found.files if name.endswith(".urdf"))
    text = (tmp_path / "out" / name).read_bytes()
    source = Source.from_calibration(folder)
    q, situation = situations(source.robot, 1000 if paths == "relative" else 50, 4)
    theta = source.robot.joint_map.effective(q, **situation)
    tips = urdf_check.poses(text, source.robot.arm, theta)
    assert_same_poses(tips, source.robot.forward(q, **situation), 1e-12, 1e-12)
    assert (b"package://" in text) is (paths == "package")
    if paths != "package":
        assert len(yourdfpy.URDF.load(str(tmp_path / "out" / name)).scene.geometry) > 10
    assert irbcal.load(folder).record.fingerprint in (tmp_path / "out" / "joint_origins.yaml").read_text()
