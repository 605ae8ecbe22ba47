"""Every optional column of every table, there and not there, with text as pandas keeps it where pyarrow is not installed.

With pyarrow, as all other tests run, arrays of text are copies; without it they belong to the table, and cannot be written to.
"""

import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.examples import measurements
from irbcal.measurement import features

LOAD = {"payload_kg": "2.5", "payload_x_mm": "10", "payload_y_mm": "0", "payload_z_mm": "40"}
JOINTS = {f"c{k}_deg": f"q{k}_deg" for k in range(1, 7)}
"""Programmed joints: those that were read."""
ANY = {"time_s": "3.5", "simulated": "yes", "note": "a, b", "group": "g", "session": "mon", "cycle": "1"}
UNTIMED = {name: value for name, value in ANY.items() if name != "time_s"}
TABLES = {
    # table: (command, columns that may be there)
    "measured.csv": ("evaluate calibration {} --include-fitted", ANY | LOAD | JOINTS | {"u95_mm": "0.03"}),
    "joints.csv": ("fk calibration --joints {} --intervals", ANY | LOAD | {"pose": "p", "id": "7", "x_mm": "1"}),
    "poses.csv": ("ik calibration --poses {}", ANY | LOAD | {"pose": "p", "id": "7"}),
    "job.csv": ("filter calibration {} --out new.csv", UNTIMED | LOAD | {"pose": "p", "v_mm_s": "5"}),
    "moves.csv": ("joints {}", ANY | JOINTS | {"u95_mm": "0.03"}),
    "forces.csv": ("iso9283 --forces {}", ANY),
    "posing.csv": ("iso9283 --moves {} --band 0.1", ANY),
    "bar.csv": ("tracker {} --length 1050.688", ANY),
    "repeat.csv": ("tracker {}", UNTIMED),
    "drift.csv": ("tracker {}", ANY),
    "circle.csv": ("ballbar calibration {} --bar 150", ANY),
    "reported.csv": ("controller {} --robot my_robot.urdf --out new.urdf", ANY | {"pose": "p"}),
}
NEEDED = ("cycle", "group", "time_s")
"""By some of these commands."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("columns")
    for sample in [
        *measurements.tracker_files(),
        *measurements.check_files(),
        *measurements.rail_files(),
        *measurements.touched_files(),
    ]:
        (folder / sample.path).write_bytes(sample.content)
    irbcal.save(irbcal.calibrate(folder / "measured.csv", folder / "my_robot.urdf", "nominal"), folder / "calibration")
    return folder


@pytest.fixture(autouse=True)
def _without_pyarrow():
    with pd.option_context("mode.string_storage", "python"):
        yield


def cells(path):
    return pd.read_csv(path, dtype=str, keep_default_na=False, comment="#")


@pytest.mark.parametrize("name", list(TABLES))
def test_columns_may_be_there_or_not(name, folder, tmp_path, monkeypatch):
    """Text in all rows, in some rows, in none."""
    command, optional = TABLES[name]
    monkeypatch.chdir(folder)
    rows = cells(name)
    new = {column: value for column, value in optional.items() if column not in rows}
    text = {column: value for column, value in new.items() if column in ANY and column != "time_s"}
    some = rows.assign(**{column: [value if k % 2 else "" for k in range(len(rows))] for column, value in text.items()})
    tables = {
        "all": rows.assign(**{column: rows.get(value, value) for column, value in new.items()}),
        "none": rows.drop(columns=[column for column in optional if column in rows and column not in NEEDED]),
        "some": some,
    }
    for what, table in tables.items():
        path = tmp_path / f"{what}-in.csv"
        table.to_csv(path, index=False)
        words = [str(path) if word == "{}" else word.replace("new", str(tmp_path / what)) for word in command.split()]
        done = CliRunner().invoke(app, words, catch_exceptions=False)
        assert done.exit_code == 0, (what, done.output)


@pytest.mark.parametrize(
    "given", [{"target": "rod"}, {"kind": "point"}, {"target": "rod", "kind": "point", "note": "x"}, LOAD]
)
@pytest.mark.parametrize("every", [1, 2])
def test_columns_of_rows_at_features(given, every, folder, tmp_path):
    """Two rods, of which the table names one; kinds of some rows or of all."""
    rows = cells(folder / "touched.csv")
    if every > 1 and given is LOAD:
        pytest.skip("a payload is that of all rows, or named in each")
    rows = rows.assign(
        **{name: [value if k % every == 0 else "" for k in range(len(rows))] for name, value in given.items()}
    )
    rows.to_csv(tmp_path / "rows.csv", index=False)
    found = features.read(tmp_path / "rows.csv", folder / "balls.csv", irbcal.read_urdf(folder / "my_robot.urdf").arm)
    named = ["rod" if "target" in given and k % every == 0 else "ball" for k in range(len(rows))]
    assert found.target.tolist() == named
    assert set(found.kind) == {"point"}
    assert ("payload_kg" in found.inputs) == (given is LOAD)


def test_rows_of_a_tracker_among_contacts(folder, tmp_path):
    """Positions without a feature beside contacts with one, in a file that says the kinds and targets."""
    contacts = cells(folder / "touched.csv").assign(target="rod", kind="point")
    seen = cells(folder / "measured.csv").query("target == 'smr1'").head(20)
    seen = seen.assign(pose="t" + seen["pose"], kind="", feature="")
    both = pd.concat([contacts, seen[[name for name in seen if name in contacts or name in ("x_mm", "y_mm", "z_mm")]]])
    both.fillna("").to_csv(tmp_path / "rows.csv", index=False)
    found = features.read(tmp_path / "rows.csv", folder / "balls.csv", irbcal.read_urdf(folder / "my_robot.urdf").arm)
    assert found.target.tolist() == ["rod"] * len(contacts) + ["smr1"] * 20
