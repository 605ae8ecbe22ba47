"""Long files are judged in pieces as they are judged as a whole."""

import csv

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError
from irbcal.io import robots
from irbcal.measurement import long_files


@pytest.fixture
def cut(monkeypatch):
    """Files from 100 rows on are long, in pieces of 50."""
    monkeypatch.setattr(long_files, "LONG", 100)
    monkeypatch.setattr(long_files, "ROWS", 50)


@pytest.fixture(scope="module")
def verification(tmp_path_factory):
    """80 poses of the SIMULATED verification data, without reference points."""
    rows = pd.read_csv(robots.demo_file("demo_verification.csv"))
    rows = rows[rows["pose"].isin(rows["pose"].unique()[::6][:80]) & ~rows["target"].str.startswith("ref")]
    path = tmp_path_factory.mktemp("long") / "v.csv"
    rows.to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def whole(demo_calibration, verification):
    return irbcal.evaluate(demo_calibration, verification, tolerance=1e-3)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_pieces_give_what_the_whole_gives(ending, cut, whole, demo_calibration, verification, tmp_path):
    path = tmp_path / f"long.{ending}"
    frame = pd.read_csv(verification).assign(operator=lambda table: "of " + table["pose"].astype(str))
    if ending == "csv":
        frame.to_csv(path, index=False)
    else:
        pytest.importorskip("pyarrow", reason="irbcal[parquet] is not installed")
        frame.to_parquet(path, index=False, row_group_size=70)
    file = long_files.long_file(path)
    assert len(file.pieces) > 3
    texts = []
    found = irbcal.evaluate(demo_calibration, path, intervals=True, tolerance=1e-3, jobs=1, progress=texts.append)
    assert texts == [f"{k} of {len(file.pieces)} pieces" for k in range(1, len(file.pieces) + 1)]
    for model in ("nominal", "calibrated"):
        statistics, expected = getattr(found, model), getattr(whole, model)
        assert statistics["n"] == expected["n"]
        for name in ("mean_mm", "sigma_mm", "max_mm", "rms_mm"):
            assert statistics[name] == pytest.approx(expected[name], rel=1e-5)
        assert found.percentiles[model] == pytest.approx(whole.percentiles[model], rel=1e-5)
    for part in ("per_target", "per_group"):
        assert list(getattr(found, part)) == list(getattr(whole, part))
        for label, models in getattr(whole, part).items():
            assert getattr(found, part)[label]["calibrated"] == pytest.approx(models["calibrated"], rel=1e-5)
    assert found.verdict.outcome == whole.verdict.outcome
    assert found.verdict.sentence().partition("(")[0] == whole.verdict.sentence().partition("(")[0]
    assert found.conformity.outcome == whole.conformity.outcome
    assert found.conformity.poses == whole.conformity.poses
    assert found.origin.judged == whole.origin.judged
    assert found.origin.unseen == whole.origin.unseen
    assert found.simulated == whole.simulated
    assert found.origin.files[0].sha256 == file.sha256
    low, high = found.intervals["calibrated"]["mean_mm"]
    assert low < found.calibrated["mean_mm"] < high
    points = found.to_frame()
    assert (points["operator"] == "of " + points["pose"]).all()


@pytest.mark.parametrize("quoting", [csv.QUOTE_MINIMAL, csv.QUOTE_ALL])
def test_rows_of_a_pose_stay_together_and_all_rows_are_there(quoting, cut, verification, tmp_path):
    path, frame = tmp_path / "long.csv", pd.read_csv(verification)
    frame.insert(0, "note", 'a, "b"')
    frame.to_csv(path, index=False, quoting=quoting)
    read = [long_files.read(piece) for piece in long_files.long_file(path).pieces]
    poses = [set(one.table["pose"]) for one in read]
    assert sum(map(len, poses)) == len(set.union(*poses)) == frame["pose"].nunique()
    assert np.concatenate([one.table["row"] for one in read]).tolist() == list(range(2, len(frame) + 2))
    np.testing.assert_array_equal(np.concatenate([one.table["x_mm"] for one in read]), frame["x_mm"])


@pytest.mark.parametrize("row", [2, 57, 111, 140])
def test_a_wrong_cell_is_named_by_its_row_of_the_file(row, cut, demo_calibration, verification, tmp_path):
    frame = pd.read_csv(verification).astype({"x_mm": object})
    frame.loc[row - 2, "x_mm"] = "abc"
    frame.to_csv(tmp_path / "long.csv", index=False)
    with pytest.raises(MeasurementError, match=f"row {row}, column x_mm: expected .*, found 'abc'"):
        irbcal.evaluate(demo_calibration, tmp_path / "long.csv", jobs=1)


def test_what_was_judged_before_a_stop_is_kept(cut, demo_calibration, verification, tmp_path):
    pd.read_csv(verification).to_csv(tmp_path / "long.csv", index=False)

    def stop(text):
        if text.startswith("2 of"):
            raise KeyboardInterrupt

    found = irbcal.evaluate(demo_calibration, tmp_path / "long.csv", jobs=1, progress=stop)
    assert 60 < found.calibrated["n"] < 140
    assert not found.verdict.trusted
    assert any(doubt.startswith("Stopped after 2 of ") for doubt in found.verdict.doubts)


def test_what_is_not_plain_or_needs_all_points_is_read_as_a_whole(cut, demo_calibration, verification, tmp_path):
    frame = pd.read_csv(verification)
    frame.assign(group='a\n"b"').to_csv(tmp_path / "quoted.csv", index=False)
    assert long_files.long_file(tmp_path / "quoted.csv") is None
    frame.assign(session="1").to_csv(tmp_path / "session.csv", index=False)
    assert long_files.long_file(tmp_path / "session.csv") is None
    text = frame.to_csv(index=False)
    for name, damaged in (("twice.csv", text.replace("group", "target", 1)), ("blank.csv", f"\n{text}")):
        (tmp_path / name).write_text(damaged)
        assert long_files.long_table(tmp_path / name) is None  # the header as the reader of the whole has it
    frame.to_csv(tmp_path / "long.csv", index=False)
    texts = []
    irbcal.evaluate(demo_calibration, tmp_path / "long.csv", flange=True, progress=texts.append)
    assert texts == []
