"""Long tables are corrected in pieces to the same bytes as a whole."""

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.correction.filter import NotWritten
from irbcal.errors import ProgramError
from irbcal.io import robots
from irbcal.measurement import pieces

ROWS = 1200


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """With terms of last moves, so that the row before matters."""
    folder = tmp_path_factory.mktemp("long") / "cal"
    irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600").save(folder)
    return folder


@pytest.fixture
def cut(monkeypatch):
    monkeypatch.setattr(pieces, "LONG", 400)
    monkeypatch.setattr(pieces, "ROWS", 250)


def joints():
    rng = np.random.default_rng(1)
    q = np.array([0.0, 20.0, 10.0, 20.0, 40.0, 10.0]) + np.cumsum(rng.uniform(-0.5, 0.5, (ROWS, 6)), axis=0)
    return pd.DataFrame(np.round(q, 4), columns=[f"q{k}_deg" for k in range(1, 7)]).assign(note="a")


def test_the_bytes_are_those_of_the_whole(calibration, tmp_path, monkeypatch):
    joints().to_csv(tmp_path / "job.csv", index=False)
    whole = irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "whole.csv", allow_partial=True)
    monkeypatch.setattr(pieces, "LONG", 400)
    monkeypatch.setattr(pieces, "ROWS", 250)
    texts = []
    found = irbcal.correct(
        calibration, tmp_path / "job.csv", out=tmp_path / "pieces.csv", allow_partial=True, progress=texts.append
    )
    assert len(texts) >= 4
    assert (tmp_path / "pieces.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    np.testing.assert_allclose(found.all_shifts, whole.shift, atol=1e-12)
    assert found.left == whole.left
    assert found.targets.tolist() == whole.targets[:10].tolist()
    assert found.report()[0] == whole.report()[0]
    assert found.written == tmp_path / "pieces.csv"


def test_a_row_that_cannot_be_read_or_reached_is_named_and_nothing_is_written(cut, calibration, tmp_path):
    for cell, error, words in (("abc", ProgramError, "row 902, column q2_deg"), ("170", NotWritten, "row 902")):
        frame = joints().astype({"q2_deg": object})
        frame.loc[900, "q2_deg"] = cell
        frame.to_csv(tmp_path / "job.csv", index=False)
        with pytest.raises(error, match=words):
            irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["job.csv"]
    found = irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv", allow_partial=True)
    assert [left.line for left in found.left] == [902]
    back = pd.read_csv(tmp_path / "out.csv")
    assert back["irbcal_filtered"].isna().sum() == 1
    assert back.loc[900, "q2_deg"] == 170.0


def test_a_corrected_table_is_refused(cut, calibration, tmp_path):
    joints().to_csv(tmp_path / "job.csv", index=False)
    irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv")
    with pytest.raises(ProgramError, match="fake targets already"):
        irbcal.correct(calibration, tmp_path / "out.csv", out=tmp_path / "again.csv")
    assert not (tmp_path / "again.csv").exists()


def test_pieces_with_rows_before_them(cut, tmp_path):
    joints().to_csv(tmp_path / "job.csv", index=False)
    file = pieces.long_table(tmp_path / "job.csv")
    lines = (tmp_path / "job.csv").read_bytes().splitlines(keepends=True)
    rows = []
    for piece in file.pieces:
        data, before = pieces.content(piece, 100)
        assert before == min(100, piece.row)
        own = data.splitlines(keepends=True)
        assert own[0] == lines[0]
        assert own[1:] == lines[1 + piece.row - before : piece.row + len(own) - before]
        rows += own[1 + before :]
    assert rows == lines[1:]
