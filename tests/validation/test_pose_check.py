"""Pose tests from measurements: subjects, tables, figures and refusals."""

import numpy as np
import pytest
from chart_data import given
from iso9283_files import CYCLES, cycles, write

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.validation.pose_check import check_poses

__all__ = ["given"]


@pytest.fixture(scope="module")
def file(record, tmp_path_factory):
    robot = record.robot_calibrated()
    q, T, *_ = cycles(robot)
    return write(tmp_path_factory.mktemp("poses") / "iso.csv", robot, q, T)


def test_subjects(record, file):
    seen = table.read(file)
    assert check_poses(seen, record).subject == "flange"
    assert check_poses(seen).subject == "all targets"
    assert check_poses(seen, target="smr3").subject == "target smr3"
    with pytest.raises(MeasurementError, match="no usable point of target smr9") as refused:
        check_poses(seen, target="smr9")
    assert refused.value.parameter == "target"


def test_tables(record, file):
    found = check_poses(table.read(file), record)
    frame = found.to_frame()
    assert frame["model"].tolist() == ["nominal"] * 5 + ["calibrated"] * 5
    assert frame["RP_mm"].tolist()[:5] == pytest.approx(
        [values["RP_mm"] for values in found.models["nominal"].poses.values()]
    )
    every = found.cycles_to_frame()
    assert len(every) == 2 * 5 * CYCLES
    mean = every[every["model"] == "calibrated"]["position_mm"].mean()
    assert mean == pytest.approx(found.models["calibrated"].overall["position"]["mean_mm"])
    assert found.default_band() == found.models["nominal"].poses["P1"]["RP_mm"] * 1e-3
    assert found.simulated
    data = found.to_dict()
    assert data["models"]["nominal"]["history"]["pose"] == [f"P{k}" for k in range(1, 6)] * CYCLES
    assert isinstance(data["models"]["nominal"]["history"]["pose"], list)


def test_left_out_points_are_told(record, file, tmp_path):
    lines = file.read_text().splitlines()
    lost = [line.rsplit(",", 3)[0] + ",0,0,0" for line in lines[1:12]]
    (tmp_path / "lost.csv").write_text("\n".join([lines[0], *lost, *lines[12:]]))
    found = check_poses(table.read(tmp_path / "lost.csv"), record, target="smr1")
    assert len(found.to_dict()["excluded"]) == 11
    text = found.summary()
    assert "Left out: 11 points" in text
    assert (
        "11 × lost (pose/target P1/smr1, P1/smr2, P1/smr3, P2/smr1, P2/smr2, P2/smr3, P3/smr1, P3/smr2 … and 3 more)"
        in text
    )


def test_figures(record, file, given):
    found = check_poses(table.read(file), record)
    assert (found.has_cycles, found.has_drift) == (True, False)
    assert [d.label for d in found.plot().drawings] == ["position error (mm)", "orientation error (°)"]
    models = [given[name] for name in found.models if given[name]]
    heights = np.concatenate([rows[0][2] for rows in models])
    assert np.sort(heights) == pytest.approx(np.sort(found.cycles_to_frame()["position_mm"]))
    with pytest.raises(MeasurementError, match="no drift was measured"):
        found.plot_drift()


def test_cycles_are_numbered_through(file, tmp_path):
    lines = file.read_text().splitlines()
    (tmp_path / "twice.csv").write_text("\n".join([*lines[:2], lines[1], *lines[2:]]))
    with pytest.raises(MeasurementError, match="pose P1 with target smr1 stands there twice in cycle 1") as refused:
        check_poses(table.read(tmp_path / "twice.csv"))
    assert (refused.value.row, refused.value.column) == (3, "cycle")
