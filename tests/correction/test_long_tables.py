"""Long tables are corrected in pieces to the same bytes as a whole."""

from io import BytesIO

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal import parallel
from irbcal.correction import long_tables
from irbcal.correction.corrected_program import NotWritten
from irbcal.errors import OptionError, ProgramError
from irbcal.io import robots
from irbcal.measurement import long_files

ROWS = 1200


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """With terms of last moves, so that the row before matters."""
    folder = tmp_path_factory.mktemp("long") / "cal"
    irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600").save(folder)
    return folder


@pytest.fixture
def cut(monkeypatch):
    monkeypatch.setattr(long_files, "LONG", 400)
    monkeypatch.setattr(long_files, "ROWS", 250)


def joints():
    rng = np.random.default_rng(1)
    q = np.array([0.0, 20.0, 10.0, 20.0, 40.0, 10.0]) + np.cumsum(rng.uniform(-0.5, 0.5, (ROWS, 6)), axis=0)
    return pd.DataFrame(np.round(q, 4), columns=[f"q{k}_deg" for k in range(1, 7)]).assign(note='a, "b"')


def test_the_bytes_are_those_of_the_whole(calibration, tmp_path, monkeypatch):
    joints().to_csv(tmp_path / "job.csv", index=False)
    whole = irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "whole.csv", allow_partial=True)
    monkeypatch.setattr(long_files, "LONG", 400)
    monkeypatch.setattr(long_files, "ROWS", 250)
    texts = []
    found = irbcal.correct(
        calibration, tmp_path / "job.csv", out=tmp_path / "long_files.csv", allow_partial=True, progress=texts.append
    )
    assert len(texts) >= 4
    assert (tmp_path / "long_files.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    np.testing.assert_allclose(found.all_shifts, whole.shift, atol=1e-12)
    assert found.unchanged_targets == whole.unchanged_targets
    assert found.targets.tolist() == whole.targets[:10].tolist()
    assert found.report()[0] == whole.report()[0]
    assert found.written == tmp_path / "long_files.csv"


def test_what_pieces_do_not_give_is_given_by_the_whole(cut, calibration, tmp_path):
    joints().to_csv(tmp_path / "job.csv", index=False)
    changes = tmp_path / "changes.csv"
    irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv", changes=changes)
    assert len(pd.read_csv(changes)) == ROWS


def test_windows_lines_and_a_quoted_header_go_in_pieces_too(cut, calibration, tmp_path):
    text = joints().to_csv(index=False)
    (tmp_path / "plain.csv").write_text(text)
    header, _, rows = text.partition("\n")
    quoted = ",".join(f'"{name}"' for name in header.split(","))
    (tmp_path / "job.csv").write_bytes(f"{quoted}\n{rows}".replace("\n", "\r\n").encode())
    assert len(long_files.long_table(tmp_path / "job.csv").pieces) == len(
        long_files.long_table(tmp_path / "plain.csv").pieces
    )
    for name in ("plain", "job"):
        irbcal.correct(calibration, tmp_path / f"{name}.csv", out=tmp_path / f"{name}-out.csv")
    plain = (tmp_path / "plain-out.csv").read_bytes()
    assert (tmp_path / "job-out.csv").read_bytes() == plain.replace(b"\n", b"\r\n")


def test_a_row_that_cannot_be_read_or_reached_is_named_and_nothing_is_written(cut, calibration, tmp_path):
    for cell, error, words in (("abc", ProgramError, "row 902, column q2_deg"), ("170", NotWritten, "row 902")):
        frame = joints().astype({"q2_deg": object})
        frame.loc[900, "q2_deg"] = cell
        frame.to_csv(tmp_path / "job.csv", index=False)
        with pytest.raises(error, match=words):
            irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["job.csv"]
    found = irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv", allow_partial=True)
    assert [left.line for left in found.unchanged_targets] == [902]
    back = pd.read_csv(tmp_path / "out.csv")
    assert back["irbcal_filtered"].isna().sum() == 1
    assert back.loc[900, "q2_deg"] == 170.0


@pytest.fixture(scope="module")
def poses(calibration, tmp_path_factory):
    """A table of poses with a column of whole numbers, and its bytes with fake targets."""
    folder = tmp_path_factory.mktemp("poses")
    q = np.radians(joints().iloc[:600, :6].to_numpy())
    frame = irbcal.forward_kinematics("irb1600", q).to_frame()[["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]]
    frame.assign(number=np.arange(600)).to_csv(folder / "job.csv", index=False)
    irbcal.correct(calibration, folder / "job.csv", out=folder / "out.csv")
    return folder


@pytest.mark.parametrize("kind", ["joints", "poses"])
def test_parquet_has_the_numbers_of_csv_whole_and_in_pieces(kind, calibration, poses, tmp_path, monkeypatch):
    pytest.importorskip("pyarrow", reason="irbcal[parquet] is not installed")
    table = pd.read_csv(poses / "job.csv") if kind == "poses" else joints()
    if kind == "joints":
        table.loc[500, "q2_deg"] = 170.0  # cannot be corrected
    table.to_csv(tmp_path / "job.csv", index=False)
    table.to_parquet(tmp_path / "job.parquet", index=False, row_group_size=300)
    of_csv = irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv", allow_partial=True)
    expected = pd.read_csv(tmp_path / "out.csv").convert_dtypes()
    for name in ("whole", "pieces"):
        if name == "pieces":
            monkeypatch.setattr(long_files, "LONG", 400)
            monkeypatch.setattr(long_files, "ROWS", 250)
        out = tmp_path / f"{name}.parquet"
        corrected = irbcal.correct(calibration, tmp_path / "job.parquet", out=out, allow_partial=True)
        pd.testing.assert_frame_equal(pd.read_parquet(out).convert_dtypes(), expected)
        assert [left.line + 1 for left in corrected.unchanged_targets] == [
            left.line for left in of_csv.unchanged_targets
        ]
        np.testing.assert_allclose(corrected.all_shifts, of_csv.shift, atol=1e-12)
        with pytest.raises(ProgramError, match="fake targets already"):
            irbcal.correct(calibration, out, out=tmp_path / "again.parquet")
    with pytest.raises(OptionError, match=r"ends in \.parquet"):
        irbcal.correct(calibration, tmp_path / "job.parquet", out=tmp_path / "again.csv")
    (tmp_path / "job.parquet").write_bytes((tmp_path / "job.csv").read_bytes())
    with pytest.raises(ProgramError, match="not a Parquet file"):
        irbcal.correct(calibration, tmp_path / "job.parquet", out=tmp_path / "again.parquet")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_what_is_done_before_ctrl_c_is_kept_and_the_same_call_goes_on(ending, cut, calibration, tmp_path, monkeypatch):
    job, out = tmp_path / f"job.{ending}", tmp_path / f"out.{ending}"
    if ending == "csv":
        joints().to_csv(job, index=False)
    else:
        pytest.importorskip("pyarrow", reason="irbcal[parquet] is not installed")
        joints().to_parquet(job, index=False)
    whole = irbcal.correct(calibration, job, out=out)
    expected = out.read_bytes()
    out.write_bytes(b"of irbcal before")
    pieces_of_job = len(long_files.long_table(job).pieces)
    rows_done = []
    corrected_piece = long_tables._corrected_piece

    def interrupted(shared, piece):
        if len(rows_done) == 2:
            raise KeyboardInterrupt
        rows_done.append(piece.row)
        return corrected_piece(shared, piece)

    monkeypatch.setattr(long_tables, "_corrected_piece", interrupted)
    with pytest.raises(parallel.Interrupted, match=f"{pieces_of_job - 2} pieces of the table"):
        irbcal.correct(calibration, job, out=out)
    assert out.read_bytes() == b"of irbcal before"
    begun = sorted(path.name for path in tmp_path.iterdir())
    assert begun == [job.name, out.name, f"{out.name}.unfinished", f"{out.name}.unfinished.npz"]
    monkeypatch.setattr(long_tables, "_corrected_piece", corrected_piece)
    texts = []
    found = irbcal.correct(calibration, job, out=out, progress=texts.append)
    assert texts[0] == f"3 of {pieces_of_job} pieces"
    if ending == "csv":
        assert out.read_bytes() == expected
    else:
        pd.testing.assert_frame_equal(pd.read_parquet(out), pd.read_parquet(BytesIO(expected)))
    np.testing.assert_array_equal(found.all_shifts, whole.all_shifts)
    assert found.report() == whole.report()
    assert sorted(path.name for path in tmp_path.iterdir()) == [job.name, out.name]


def test_a_corrected_table_is_refused(cut, calibration, tmp_path):
    joints().to_csv(tmp_path / "job.csv", index=False)
    irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "out.csv")
    with pytest.raises(ProgramError, match="fake targets already"):
        irbcal.correct(calibration, tmp_path / "out.csv", out=tmp_path / "again.csv")
    assert not (tmp_path / "again.csv").exists()


def test_pieces_with_rows_before_them(cut, tmp_path):
    joints().to_csv(tmp_path / "job.csv", index=False)
    file = long_files.long_table(tmp_path / "job.csv")
    lines = (tmp_path / "job.csv").read_bytes().splitlines(keepends=True)
    rows = []
    for piece in file.pieces:
        data, before = long_files.content(piece, 100)
        assert before == min(100, piece.row)
        own = data.splitlines(keepends=True)
        assert own[0] == lines[0]
        assert own[1:] == lines[1 + piece.row - before : piece.row + len(own) - before]
        rows += own[1 + before :]
    assert rows == lines[1:]
