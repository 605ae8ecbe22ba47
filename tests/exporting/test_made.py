"""What an export lacks is told, with names, wherever the export is told."""

import pytest

from irbcal.exporting import drake, mujoco, ros
from irbcal.exporting.export import Exported
from irbcal.exporting.source import Source

TEXTURED = b'<material name="steel"><texture filename="meshes/steel.png"/></material></robot>'


@pytest.mark.parametrize("target", [mujoco, drake])
def test_meshes_and_textures_that_are_not_taken_are_told(described, tmp_path, target):
    source = described["ur10"]
    assert source.urdf.count(b".dae") == 7
    textured = source.urdf.replace(b"</robot>", TEXTURED)
    source = Source(source.robot, source.parts, source.vectors, 0.0, None, textured, source.folder)
    made = target.files(source)
    assert not [name for name in made.files if name.endswith((".dae", ".png"))]
    meshes, textures = made.notes
    assert "7 meshes are left out" in meshes
    assert "only STL and OBJ" in meshes
    assert all(f"{link}.dae" in meshes for link in ("base", "shoulder", "upperarm", "forearm", "wrist1"))
    assert textures == "textures are left out: steel.png"
    told = Exported("any", tmp_path, tuple(made.files), "", False, 0.0, "", made.notes).report()
    assert f"Note: {textures}" in told
    assert f"Note: {meshes}" in told


def test_nothing_is_told_where_nothing_is_left_out(described):
    assert ros.files(described["ur10"]).notes == ()
