"""``cell.json``: what is written is read, and nothing else."""

import json
from copy import deepcopy

import numpy as np
import pytest

from irbcal.cell.cell_file import CellFile, FrameInCell, Touch, read_cell
from irbcal.cell.external_axes import ExternalAxis
from irbcal.errors import CalibrationError
from irbcal.io.integrity import KEY, digest
from irbcal.modeling import frames


@pytest.fixture
def cell():
    rng = np.random.default_rng(4)

    def T():
        return frames.transform(frames.matrix_from_rpy(rng.uniform(-1, 1, 3)), rng.normal(size=3))

    tools = {"grip": FrameInCell("grip", T(), T(), T())}
    work_objects = {"part": FrameInCell("part", T(), T(), position_only=True)}
    touches = (
        Touch(
            2,
            "tool",
            "grip",
            "p",
            "grip",
            rng.normal(size=6),
            2e-4,
            None,
            "sphere",
            0.0123,
            axis_positions=np.array([0.3]),
        ),
        Touch(3, "work_object", "part", "p", "grip", rng.normal(size=6), 5e-5, rng.normal(size=3)),
    )
    axes = (ExternalAxis("e1_deg", ("part",), rng.normal(size=6), rng.normal(size=6)),)
    C = 1e-8 * np.eye(18)
    return CellFile(
        "a" * 32, "robot", True, tools, work_objects, C, 2 * C, rng.normal(size=(18, 4)), axes, touches, ("l",), ("n",)
    )


def test_what_is_written_is_read(tmp_path, cell):
    again = read_cell(cell.save(tmp_path / "cell.json"))
    for frame, same in (
        (cell.tools["grip"], again.tools["grip"]),
        (cell.work_objects["part"], again.work_objects["part"]),
    ):
        np.testing.assert_allclose(same.T_true, frame.T_true, rtol=0, atol=1e-15)
        assert (same.T_controller is None) == (frame.T_controller is None)
        assert same.position_only == frame.position_only
    for name in ("covariance", "touch_covariance", "robot_gain"):
        np.testing.assert_array_equal(getattr(again, name), getattr(cell, name))
    for touch, same in zip(cell.touches, again.touches, strict=True):
        for name in ("q", "axis_positions", "u95", "radius", "xyz", "residual"):
            value = getattr(touch, name)
            if value is None:
                assert getattr(same, name) is None
            else:
                np.testing.assert_allclose(getattr(same, name), value, rtol=0, atol=1e-15)
    assert again.axes[0].column == "e1_deg"
    assert again.axes[0].carries == ("part",)
    np.testing.assert_array_equal(again.axes[0].screw, cell.axes[0].screw)
    assert (again.left_out, again.notes, again.created) == (cell.left_out, cell.notes, cell.created)
    assert json.loads((tmp_path / "cell.json").read_text())["touches"][0]["radius_mm"] == pytest.approx(12.3, abs=1e-12)


CHANGES = {
    "a tool twice": lambda d: d["tools"].append(deepcopy(d["tools"][0])),
    "a line end": lambda d: d["tools"][0].update(name="a\nb"),
    "no unit quaternion": lambda d: d["tools"][0]["true"].update(qw=2.0),
    "a row too few": lambda d: d["covariance_rad_m"].pop(),
    "a gain too few": lambda d: d["robot_gain_rad_m"].pop(),
    "text for a number": lambda d: d["touches"][0].update(u95_mm="3"),
    "no number": lambda d: d["touches"][0].update(u95_mm=float("nan")),
    "two coordinates": lambda d: d["touches"][1].update(xyz_mm=[1.0, 2.0]),
    "another feature": lambda d: d["touches"][0].update(kind="cone"),
    "an unknown key": lambda d: d.update(more=1),
    "an axis too many": lambda d: d["axes"][0].update(axis="e7_mm"),
    "rows of several lengths": lambda d: d["covariance_rad_m"][0].pop(),
    "a far tool": lambda d: d["tools"][0]["true"].update(x_mm=1e9),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=list(CHANGES))
def test_a_sealed_file_of_another_content_is_refused(tmp_path, cell, change):
    document = json.loads(cell.save(tmp_path / "cell.json").read_text())
    del document[KEY]
    change(document)
    (tmp_path / "bad.json").write_text(json.dumps(document | {KEY: digest(document)}))
    with pytest.raises(CalibrationError, match=r"bad\.json"):
        read_cell(tmp_path / "bad.json")


def test_what_would_be_refused_is_not_written(tmp_path, cell):
    unknown = CellFile("a" * 32, "robot", True, cell.tools, {}, *[np.full((6, 6), np.nan)] * 2, np.zeros((6, 0)))
    with pytest.raises(CalibrationError, match="finite numbers"):
        unknown.save(tmp_path / "cell.json")
    assert not (tmp_path / "cell.json").exists()
