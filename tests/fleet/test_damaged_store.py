"""Stores that are damaged, foreign or cut off are refused in a sentence; one that cannot be made is not left empty."""

import os
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress

import pytest

from irbcal.errors import CalibrationError
from irbcal.fleet import store as stores
from irbcal.fleet.overview import EXPORTED, fleet_export
from irbcal.fleet.store import opened

ROWS = [(table.name, column.name) for table in stores.tables.sorted_tables for column in table.c]
WRONG = ("'zz'", "NULL", "-5", "x'00ff'", "1e999")


@pytest.fixture(scope="module")
def whole(stored, tmp_path_factory):
    """A store, as bytes; its columns take anything."""
    path = tmp_path_factory.mktemp("store") / "fleet.db"
    with opened(path, create=True) as store:
        store.add(stored[0])
    with closing(sqlite3.connect(path)) as link:
        link.execute("pragma writable_schema=on")
        link.execute("update sqlite_master set sql=replace(sql, 'NOT NULL', '') where type='table'")
        link.commit()
    return path.read_bytes()


def read(path):
    """All that is read of a store."""
    with opened(path) as store:
        read = (store.calibrations(), store.robots())
    for name in EXPORTED:
        fleet_export(path, path.with_name(f"{name}.csv"), what=name)
    return read


@pytest.mark.parametrize(("table", "column"), ROWS)
def test_damaged_rows_are_refused_or_read(table, column, whole, tmp_path):
    path = tmp_path / "fleet.db"
    refused = 0
    for value in WRONG:
        path.write_bytes(whole)
        with closing(sqlite3.connect(path)) as link, suppress(sqlite3.IntegrityError):  # keys are checked by SQLite
            link.execute(f"update {table} set {column}={value} where rowid=(select max(rowid) from {table})")
            link.commit()
        try:
            read(path)
        except CalibrationError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ")
    assert refused >= 1, "a blob where there is text is refused everywhere"


@pytest.mark.parametrize("size", [100, 1000, 4096, 10000, -100])
def test_a_file_that_was_cut_off_is_refused(size, whole, tmp_path):
    path = tmp_path / "fleet.db"
    path.write_bytes(whole[:size])
    for create in (False, True):
        with pytest.raises(CalibrationError, match=r"the store (failed|is damaged)"), opened(path, create) as store:
            store.calibrations()
    assert path.read_bytes() == whole[:size]


def test_a_schema_that_is_no_text_is_refused(whole, tmp_path):
    """SQLite's message then holds bytes of the file, which Python cannot decode."""
    path = tmp_path / "fleet.db"
    path.write_bytes(whole.replace(b"CREATE TABLE robots", b"CREATE\xee TABLE robots"[:19]))
    assert path.stat().st_size == len(whole)
    with pytest.raises(CalibrationError, match=r"the store (failed|is damaged)"):
        read(path)


@pytest.mark.parametrize("made", ["version int", "name text"])
def test_foreign_tables_of_the_same_name_are_refused(made, tmp_path):
    path = tmp_path / "fleet.db"
    with closing(sqlite3.connect(path)) as link:
        link.execute(f"create table irbcal_fleet ({made})")
        link.commit()
    for create in (False, True):
        with pytest.raises(CalibrationError), opened(path, create):
            pass


FULL = """
import resource, signal, sys
from irbcal.fleet.store import opened
from irbcal.errors import CalibrationError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
try:
    with opened(sys.argv[1], create=True):
        raise KeyboardInterrupt if sys.argv[3] else SystemExit("made")
except CalibrationError as error:
    print(error)
except KeyboardInterrupt:
    print("stopped")
"""


@pytest.mark.parametrize(("most", "stop"), [(0, ""), (4096, ""), (20000, ""), (10**7, "stop")])
def test_a_store_that_cannot_be_made_is_not_left(most, stop, tmp_path):
    """A disk that is full at several sizes, and a stop before anything is added."""
    path = tmp_path / "fleet.db"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path), str(most), stop],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ,
    )
    assert done.stderr == ""
    assert done.stdout.startswith("stopped" if stop else f"{path}: the store failed")
    assert list(tmp_path.iterdir()) == []
