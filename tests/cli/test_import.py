"""``irbcal import`` as a user meets it."""

import json

import numpy as np
import pytest
from support import started
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError
from irbcal.measurement.imports import column_map

ROW = "10,-20,30,0,45,90,1200.5,-35.25,640.75"


@pytest.fixture
def source(tmp_path):
    """Three rows as RoboDK takes them, the last one lost."""
    path = tmp_path / "robodk.csv"
    path.write_text(f"J1,J2,J3,J4,J5,J6,X,Y,Z,TCP\n{ROW},1\n{ROW},2\n11,-20,30,0,45,90,0,0,0,1\n")
    return path


def run(*arguments):
    """The command within this process: exit code, stdout and what it raised."""
    return CliRunner().invoke(app, ["import", *map(str, arguments)])


def test_a_file_goes_in_and_a_measurement_file_comes_out(source, tmp_path):
    out = tmp_path / "new" / "measured.csv"
    done = run(source, "--as", "robodk", "--set", "rename={'1': smr1, '2': smr2}", "--out", out, "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["out"] == str(out)
    assert (said["rows"], said["poses"], said["lost"]) == (3, 2, 1)
    assert said["targets"] == {"smr1": {"measured": 1, "lost": 1}, "smr2": {"measured": 1, "lost": 0}}
    assert [path.name for path in out.parent.iterdir()] == ["measured.csv"]
    seen = irbcal.read_measurements(out)
    assert np.allclose(seen.positions()[0], [1.2005, -0.03525, 0.64075], rtol=0, atol=1e-12)
    assert np.allclose(
        np.degrees(seen.joints()), [[10, -20, 30, 0, 45, 90], [11, -20, 30, 0, 45, 90]], rtol=0, atol=1e-12
    )


def test_dry_run_shows_rows_map_and_counts_and_writes_nothing(source, tmp_path):
    done = run(source, "--as", "robodk", "--dry-run", "--out", tmp_path / "measured.csv")
    assert done.exit_code == 0, done.output
    assert not (tmp_path / "measured.csv").exists()
    lines = done.stdout.splitlines()
    table = {line.split()[0]: line.split()[1:] for line in lines if line.startswith(" ") and line.split()}
    assert table["row"] == ["of", "file", "2", "3", "4"]
    assert table["q2_deg"] == ["-20.0000"] * 3
    assert table["x_mm"] == ["1200.5000", "1200.5000"]
    assert any(line.startswith("units: ") for line in lines)
    assert any(line.startswith("3 rows, 2 poses, ") for line in lines)
    said = json.loads(run(source, "--as", "robodk", "--dry-run", "--json").stdout)
    assert said["out"] is None
    assert [row["row"] for row in said["first_rows"]] == [2, 3, 4]
    assert said["first_rows"][2]["x_mm"] is None


def test_a_preset_is_printed_to_be_changed(source, tmp_path):
    done = run("--show-preset", "robodk")
    assert done.exit_code == 0
    assert done.stdout == column_map.preset_text("robodk")
    mine = tmp_path / "mine.yaml"
    mine.write_text(done.stdout.replace("lengths: mm", "lengths: inch"))
    assert run(source, "--as", mine, "--out", tmp_path / "m.csv").exit_code == 0
    assert irbcal.read_measurements(tmp_path / "m.csv").positions()[0, 0] == pytest.approx(1200.5 * 0.0254)
    assert isinstance(run("--show-preset", "nonsense").exception, MeasurementError)


def test_refused_input_is_one_sentence_and_leaves_an_earlier_file(source, tmp_path):
    out = tmp_path / "measured.csv"
    out.write_text("earlier")
    source.write_text(source.read_text().replace("640.75,2", "n/a,2"))
    done = started("import", source, "--as", "robodk", "--out", out)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        f"irbcal: {source}: row 3, column 9: expected a position in mm or a mark of a lost point, found 'n/a'\n"
    )
    assert out.read_text() == "earlier"


def test_wrong_calls(source, tmp_path):
    assert run(source, "--as", "robodk").exit_code == 2
    assert run(source, "--out", tmp_path / "m.csv").exit_code == 1  # three rows, and no robot
    assert not (tmp_path / "m.csv").exists()
    assert run("--as", "robodk", "--dry-run").exit_code == 2
    before = source.read_text()
    assert run(source, "--as", "robodk", "--out", source).exit_code == 1
    assert source.read_text() == before
    assert "found a folder" in str(run(source, "--as", "robodk", "--out", tmp_path).exception)


def test_help_has_an_example_for_each_preset():
    done = run("--help")
    assert all(f"--as {name}" in " ".join(done.stdout.split()) for name in column_map.presets())
