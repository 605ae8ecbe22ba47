"""Tools and work objects of a cell file in a view: tools at the tip, work objects in the base, of this calibration."""

from dataclasses import replace

import numpy as np
import pytest
import umsgpack

import irbcal
from irbcal.cell.cell_file import CellFile, FrameInCell
from irbcal.errors import CalibrationError, OptionError
from irbcal.modeling import frames
from irbcal.viewer import page

T_TOOL = frames.from_xyz_angles([0.01, -0.02, 0.18, 0.0, 0.3, 0.1])
T_OBJECT = frames.from_xyz_angles([0.7, -0.2, 0.4, 0.0, 0.1, 0.5])


@pytest.fixture(scope="module")
def known(cell):
    """A cell file's content whose coordinates are known to 0.1 mm and 0.2 mm (standard deviations)."""
    C = np.diag(np.repeat([1e-5, 1e-4, 1e-5, 2e-4], 3)) ** 2
    tools = {"grip": FrameInCell("grip", T_TOOL, np.eye(4))}
    work_objects = {"part": FrameInCell("part", T_OBJECT, np.eye(4))}
    print_ = irbcal.load(cell / "cal").record.fingerprint
    return CellFile(print_, "robot", True, tools, work_objects, 0.0 * C, C, np.zeros((12, 0)))


def test_true_frames_are_drawn_and_labelled(cell, known, tmp_path):
    view = irbcal.view(cell / "cal", cell=known.save(tmp_path / "cell.json"))
    tool, work_object = view.scene.cell
    assert (tool.label, tool.on_tip) == ("tool grip ± 0.20 mm", True)
    assert (work_object.label, work_object.on_tip) == ("work object part ± 0.39 mm", False)
    np.testing.assert_allclose(tool.T, T_TOOL, rtol=0, atol=1e-12)
    np.testing.assert_allclose(work_object.T, T_OBJECT, rtol=0, atol=1e-12)
    assert "tool grip ± 0.20 mm, work object part ± 0.39 mm" in view.summary()
    places = [(item["place"], item["on_tip"]) for item in page.content(view.scene)["cell"]]
    assert places == [(pytest.approx(T_TOOL[:3, 3]), True), (pytest.approx(T_OBJECT[:3, 3]), False)]
    commands = [umsgpack.unpackb(command) for command in page.record(view.scene).commands]
    nodes = {command["path"]: command for command in commands if command["type"] == "set_object"}
    for node, T in (("tools", T_TOOL), ("work_objects", T_OBJECT)):
        (geometry,) = nodes[f"/irbcal/cell/{node}"]["object"]["geometries"]
        position = np.frombuffer(geometry["data"]["attributes"]["position"]["array"].data, "<f4").reshape(-1, 3)
        local = (position - T[:3, 3]) @ T[:3, :3]  # three rods from the origin along +x, +y and +z
        length = 0.08 * view.scene.reach
        np.testing.assert_allclose(local.max(axis=0), 1.06 * length, rtol=1e-3)
        np.testing.assert_allclose(local.min(axis=0), -0.06 * length, rtol=1e-3)


def test_frames_of_another_calibration_or_of_none_are_refused(cell, known):
    with pytest.raises(CalibrationError):
        irbcal.view(cell / "cal", cell=replace(known, fingerprint="0" * len(known.fingerprint)))
    with pytest.raises(OptionError, match="its tools and work objects are of a calibration"):
        irbcal.view("irb120", cell=known)
