"""A store takes a calibration once and whole, and refuses what is damaged."""

import hashlib
import multiprocessing
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from dataclasses import replace
from datetime import date

import numpy as np
import pandas as pd
import pytest
import sqlalchemy as sql

from irbcal.errors import CalibrationError, OptionError
from irbcal.fleet import store as stores
from irbcal.fleet.queries import EXPORTED, fleet_export
from irbcal.fleet.store import Estimate, opened


def same(a, b):
    assert a.robot == b.robot
    for name in ("fingerprint", "measured", "model", "heldout_mean_mm", "json_sha256", "simulated"):
        assert a.calibration[name] == b.calibration[name]
    for one, other in ((a.fit, b.fit), (a.level, b.level), (a.terms, b.terms)):
        assert one.names == other.names
        np.testing.assert_array_equal(one.values, other.values)
        std = np.outer(one.std, one.std)
        np.testing.assert_allclose(other.covariance / std, one.covariance / std, atol=1e-6)
        np.testing.assert_array_equal((one.natural, one.units), (other.natural, other.units))
        np.testing.assert_allclose(one.prior, other.prior, rtol=1e-7)
    for row, other_row in zip(a.nuisance, b.nuisance, strict=True):
        assert {**other_row, "std": None} == {**row, "std": None}
        assert other_row["std"] == (None if row["std"] is None else pytest.approx(row["std"], rel=1e-7))
    assert a.files == b.files


def test_what_is_added_comes_back_and_once(place, stored):
    with opened(place, create=True) as store:
        assert [store.add(one) for one in stored] == [True] * len(stored)
        assert [store.add(one) for one in stored] == [False] * len(stored)
    with opened(place) as store:
        found = list(store.calibrations())
        assert len(list(store.calibrations(robot="R1"))) == 1
        assert list(store.calibrations(type="another")) == []
        assert [row["id"] for row in store.robots()] == [one.robot["id"] for one in stored]
        assert sum(map(len, store.frames("parameters"))) == sum(
            len(one.fit.names) + len(one.level.names) + len(one.terms.names) + len(one.nuisance) for one in stored
        )
    for one, back in zip(stored, found, strict=True):
        same(one, back)


def test_the_last_of_each_robot_and_what_is_asked_for_of_them(place, stored):
    days = [date(2026, 5, 1), date(2026, 1, 1), date(2026, 9, 1)]
    with opened(place, create=True) as store:
        for one in stored:
            for k, day in enumerate(days):
                store.add(replace(one, calibration={**one.calibration, "fingerprint": f"{k}", "measured": day}))
        levels = list(store.calibrations(last=2, parts=("level",)))
        heads = list(store.calibrations(last=1, parts=()))
        assert store.counts() == {one.robot["id"]: (3, 3) for one in stored}
        assert store.counts(type="another") == {}
    assert [(one.robot["id"], one.measured) for one in levels] == [
        (one.robot["id"], day) for one in stored for day in (days[0], days[2])
    ]
    assert [one.measured for one in heads] == [days[2]] * len(stored)
    for back, one in zip(levels[::2], stored, strict=True):
        assert (back.fit, back.terms, back.nuisance, back.files) == (None, None, (), ())
        std = np.outer(one.level.std, one.level.std)
        np.testing.assert_allclose(back.level.covariance / std, one.level.covariance / std, atol=1e-6)
    assert all((one.fit, one.level, one.terms) == (None, None, None) for one in heads)


def test_levels_are_read_light_and_with_their_factors(place, stored):
    with opened(place, create=True) as store:
        store.add_all([*stored[1:], replace(stored[0], level=None)])
        light = list(store.estimates("level", factors=False))
        whole = store.with_factors("level", light)
        assert [one.packed.factor for one in light] == [b""] * len(stored)
        assert [(one.robot, one.type, one.measured) for one in whole] == [
            (one.robot["id"], one.robot["type"], one.measured) for one in stored
        ]
        assert whole[0].packed.parameters.names == ()
        for one, back in zip(stored[1:], whole[1:], strict=True):
            assert back.packed.factor == one.level.packed().factor
            np.testing.assert_allclose(back.packed.estimate().std, one.level.std, rtol=1e-6)


@pytest.mark.parametrize("rank", [0, 1, 3, 4])
def test_factors_keep_covariances_that_hold_directions(rank):
    """Of some rank, in units that differ by eight orders of magnitude; what is known exactly stays so."""
    rng = np.random.default_rng(rank)
    size = np.array([1e-6, 1.0, 1e2, 1e-3])
    A = rng.standard_normal((4, rank)) * size[:, None]
    one = Estimate(tuple("abcd"), ("m",) * 4, np.zeros(4), np.full(4, np.inf), np.ones(4), A @ A.T)
    back = one.packed().estimate()
    np.testing.assert_allclose(back.covariance / np.outer(size, size), (A @ A.T) / np.outer(size, size), atol=2e-6)
    assert np.linalg.eigvalsh(back.covariance / np.outer(size, size)).min() > -1e-12
    np.testing.assert_array_equal(back.prior, one.prior)


def test_a_batch_is_added_up_to_the_first_that_contradicts(place, stored):
    wrong = replace(stored[1], robot={**stored[1].robot, "serial": "SN-X"})
    with opened(place, create=True) as store:
        store.add(stored[1])
        with pytest.raises(CalibrationError, match="robot R1 is in the store with serial SN-1, not SN-X"):
            store.add_all([stored[0], stored[0], wrong, stored[2]])
        assert [one.robot["id"] for one in store.calibrations(parts=())] == ["R0", "R1"]
        assert [row["id"] for row in store.robots()] == ["R0", "R1"]
        assert store.add_all([stored[2], stored[0], stored[2]]) == [True, False, False]
        assert store.add_all([]) == []


@pytest.mark.parametrize("seed", range(3))
def test_any_order_of_additions_gives_the_same_lists(seed, place, stored):
    """A dict is the oracle: batches of random sizes, calibrations again and again, dates in any order."""
    rng = np.random.default_rng(seed)
    known = {}
    with opened(place, create=True) as store:
        for _ in range(12):
            batch = []
            for _ in range(rng.integers(1, 6)):
                one, day, mark = stored[rng.integers(3)], date(2026, 1, int(rng.integers(1, 28))), f"{rng.integers(4)}"
                changed = {**one.calibration, "measured": day, "fingerprint": mark, "created": f"2026-{mark}"}
                parts = {"level": one.level if rng.random() < 0.8 else None}
                batch.append(replace(one, calibration=changed, **parts))
            news = []
            for one in batch:
                news.append(one.key not in known)
                known.setdefault(one.key, one)
            assert store.add_all(batch) == news
        order = sorted(known, key=lambda key: (key[0], key[2], known[key].calibration["created"]))
        read = list(store.calibrations())
        assert [one.key for one in read] == order
        for one in read:
            assert (one.level is None) == (known[one.key].level is None)
        last = [key for robot in ("R0", "R1", "R2") for key in [key for key in order if key[0] == robot][-2:]]
        assert [(one.robot, one.measured) for one in store.estimates("level", last=2)] == [(k[0], k[2]) for k in last]
        counts = {robot: sum(key[0] == robot for key in known) for robot in ("R0", "R1", "R2")}
        assert {robot: count for robot, (count, _) in store.counts().items()} == {k: n for k, n in counts.items() if n}


def test_an_addition_that_is_cut_off_leaves_nothing(place, stored, monkeypatch):
    with opened(place, create=True) as store:
        store.add(stored[0])
        fill = store._fill
        monkeypatch.setattr(
            store, "_fill", lambda link, table, rows: fill(link, table, rows if table.name != "files" else 1 / 0)
        )
        with pytest.raises(ZeroDivisionError):
            store.add(stored[1])
        monkeypatch.undo()
        assert len(store.robots()) == 1
        assert store.add(stored[1])


def keep_adding(place, stored, ready):
    with opened(place, create=True) as store:
        for k in range(10_000):
            for one in stored:
                again = replace(one, calibration={**one.calibration, "fingerprint": f"{k}"})
                store.add(again)
            ready.set()


def test_a_writer_that_is_killed_leaves_the_store_consistent(place, stored):
    """Killed without warning in the middle of transactions; then another goes on."""
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    writer = context.Process(target=keep_adding, args=(place, stored, ready), daemon=True)
    writer.start()
    assert ready.wait(60)
    time.sleep(0.05)
    os.kill(writer.pid, signal.SIGKILL)
    writer.join()
    with opened(place) as store:
        found = list(store.calibrations())
        assert len(found) >= len(stored)
        by_id = {one.robot["id"]: one for one in stored}
        assert len({(one.robot["id"], one.calibration["fingerprint"]) for one in found}) == len(found)
        for one in found:
            own = by_id[one.robot["id"]]
            assert (one.fit.names, one.level.names, one.terms.names) == (
                own.fit.names,
                own.level.names,
                own.terms.names,
            )
            assert len(one.nuisance) == len(own.nuisance)
            assert one.files == own.files
        assert store.add(stored[0])


def test_two_that_make_and_fill_a_store_at_a_time_fill_it_once(place, stored):
    results = []

    def fill():
        with opened(place, create=True) as store:
            results.extend(store.add(one) for one in stored)

    threads = [threading.Thread(target=fill) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(results) == [False] * len(stored) + [True] * len(stored)


def test_a_store_that_many_make_at_a_time_is_whole_for_each(tmp_path):
    failed = []

    def make(place):
        try:
            with opened(place, create=True):
                pass
        except Exception as error:
            failed.append(error)

    for number in range(20):
        threads = [threading.Thread(target=make, args=(tmp_path / f"{number}.db",)) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert failed == []


def test_another_serial_number_is_refused(place, stored):
    with opened(place, create=True) as store:
        store.add(stored[0])
        other = stores.Stored({**stored[0].robot, "serial": "SN-X"}, stored[0].calibration, stored[0].fit, None)
        with pytest.raises(CalibrationError, match="robot R0 is in the store with serial SN-0, not SN-X"):
            store.add(other)


def test_what_is_no_store_is_refused(tmp_path):
    with (
        pytest.raises(CalibrationError, match="no store of a fleet: irbcal fleet add makes one"),
        opened(tmp_path / "no.db"),
    ):
        pass
    (tmp_path / "text.db").write_text("not a database, but long enough to look like one " * 20)
    with (
        pytest.raises(CalibrationError, match="the store failed: file is not a database"),
        opened(tmp_path / "text.db"),
    ):
        pass
    engine = sql.create_engine(f"sqlite:///{tmp_path}/other.db")
    pd.DataFrame({"id": [1]}).to_sql("robots", engine, index=False)
    engine.dispose()
    with pytest.raises(CalibrationError, match="has a table robots"), opened(tmp_path / "other.db", create=True):
        pass
    for url in ("mysql://me@here/x", "nonsense://x", "://"):
        with pytest.raises(OptionError, match=r"store: expected a file or postgresql\+psycopg"), opened(url):
            pass
    with pytest.raises(CalibrationError, match="found a folder"), opened(tmp_path):
        pass


def test_a_password_is_never_shown():
    url = "postgresql+psycopg://me:secret@127.0.0.1:9/none"
    pytest.importorskip("psycopg", reason="irbcal[postgres] is not installed")
    with pytest.raises(CalibrationError) as caught, opened(url):
        pass
    assert "secret" not in str(caught.value)
    assert "me:***@127.0.0.1" in str(caught.value)


ROWS = [(table.name, column.name) for table in stores.tables.sorted_tables for column in table.c]
WRONG = ("NULL", "-5", "x'00ff'")
BY_TURNS = ("'zz'", "1e999")


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
        read = (list(store.calibrations()), store.robots())
    for name in EXPORTED:
        fleet_export(path.with_name(f"{name}.csv"), path, what=name)
    return read


@pytest.mark.parametrize(("number", "table", "column"), [(k, *row) for k, row in enumerate(ROWS)])
def test_damaged_rows_are_refused_or_read(number, table, column, whole, tmp_path):
    path = tmp_path / "fleet.db"
    refused = 0
    for value in (*WRONG, BY_TURNS[number % 2]):
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


@pytest.mark.parametrize("table", [table.name for table in stores.tables.sorted_tables if table.name.startswith("est")])
@pytest.mark.parametrize("seed", range(4))
def test_damaged_bytes_of_estimates_are_refused_or_read(table, seed, whole, tmp_path):
    """Bits that turned, numbers that are none, and other lengths, in every column of bytes."""
    rng, path = np.random.default_rng(seed), tmp_path / "fleet.db"
    columns = [column.name for column in stores.tables.tables[table].c if isinstance(column.type, sql.LargeBinary)]
    for column in columns:
        path.write_bytes(whole)
        with closing(sqlite3.connect(path)) as link:
            content = bytearray(link.execute(f"select {column} from {table}").fetchone()[0])
            if not content:
                continue
            at = int(rng.integers(len(content)))
            if seed == 0:
                content[at] ^= 1 << int(rng.integers(8))
            elif seed == 1:
                content[at // 8 * 8 : at // 8 * 8 + 8] = b"\xff" * 8
            else:
                content = content[:at] if seed == 2 else content + content[:4]
            link.execute(f"update {table} set {column} = ?", (bytes(content),))
            link.commit()
        expected = (
            pytest.raises(CalibrationError, match="the store is damaged") if seed > 1 else suppress(CalibrationError)
        )
        with expected:
            read(path)


@pytest.mark.parametrize(
    "content", ["", "[", "[[]]", "{}", "[1]", '[["a","m",1.0,"x"]]', '[["a","m",NaN,"x"]]', "[" * 9999]
)
def test_a_damaged_list_of_parameters_is_refused(content, whole, tmp_path):
    path = tmp_path / "fleet.db"
    path.write_bytes(whole)
    with closing(sqlite3.connect(path)) as link:
        for (number,) in link.execute("select number from parameter_lists").fetchall():
            text = content + " " * number
            row = text, hashlib.sha256(text.encode()).hexdigest(), number
            link.execute("update parameter_lists set content = ?, sha256 = ? where number = ?", row)
        link.commit()
    with pytest.raises(CalibrationError, match="the store is damaged"):
        read(path)


@pytest.mark.parametrize("size", [100, 1000, 4096, 10000, -5000])
def test_a_file_that_was_cut_off_is_refused(size, whole, tmp_path):
    path = tmp_path / "fleet.db"
    path.write_bytes(whole[:size])
    for create in (False, True):
        with pytest.raises(CalibrationError, match=r"the store (failed|is damaged)"), opened(path, create) as store:
            list(store.calibrations())
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


def test_a_store_of_another_version_is_refused_and_stays_as_it_was(place, stored):
    with opened(place, create=True) as store, store.engine.execution_options(writes=True).begin() as link:
        link.execute(sql.text("update irbcal_fleet set version = 2"))
    for create in (False, True):
        with pytest.raises(CalibrationError, match="version 2"), opened(place, create) as store:
            store.add(stored[0])


FULL = """
import os, resource, signal, sys
from irbcal.fleet.store import opened
from irbcal.errors import CalibrationError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
for most in (0, 4096, 20000, 10**7):
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, unlimited))
    try:
        with opened(sys.argv[1], create=True):
            raise KeyboardInterrupt if most > 20000 else SystemExit("made")
    except CalibrationError as error:
        said = str(error).partition("failed")[:2]
    except KeyboardInterrupt:
        said = ["stopped"]
    resource.setrlimit(resource.RLIMIT_FSIZE, (unlimited, unlimited))
    print(*said, os.listdir(os.path.dirname(sys.argv[1])))
"""


def test_a_store_that_cannot_be_made_is_not_left(tmp_path):
    """A disk that is full at several sizes, and a stop before anything is added."""
    path = tmp_path / "fleet.db"
    done = subprocess.run([sys.executable, "-c", FULL, path], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [*[f"{path}: the store  failed []"] * 3, "stopped []"]
