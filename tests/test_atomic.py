"""Files are written whole or not at all, and never over what was read."""

import json
import os
import signal

import pytest

from irbcal import overwriting, safe_files
from irbcal.errors import CalibrationError


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_files_replace_earlier_ones_and_leave_others_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    safe_files.write_together(tmp_path, {"a": b"irbcal 1", "b": b"irbcal 2"})
    safe_files.write_together(tmp_path, {"a": b"irbcal 3", "b": b"irbcal 4"})
    assert content(tmp_path) == {"a": b"irbcal 3", "b": b"irbcal 4", "notes.txt": b"mine"}


HEADER = b"pose,q1_deg,target,x_mm\n"
MEASURED = {"m.csv": HEADER + b"1,2,smr1,3\n"}
IMPORTED = {"m.csv": HEADER + b"1,2,smr1,4\n"}
SIMULATED = {"m.csv": b"pose,q1_deg,simulated\r\n1,2,yes\r\n"}
PLAN = {"plan.csv": b"pose,q1_deg,expected_x_mm\n1,2,3\n"}
ROWS = {"rows.csv": b"pose,q1_deg,feature,value_mm\n1,2,bar,\n"}
MAP = {"m.map.yaml": b"# for irbcal import --as\n"}
MINE = [
    (MEASURED, IMPORTED),
    (MEASURED, SIMULATED),
    (SIMULATED, MEASURED),
    (MEASURED | {"m.truth.json": b"irbcal"}, SIMULATED | {"m.truth.json": b"irbcal 2"}),
    (MEASURED | MAP, IMPORTED | MAP),
    ({"m.csv": b"pose,target,x_mm,file\n1,smr1,3,irbcal-samples/a\n"}, IMPORTED),
    ({"m.csv": b"pose,q1_deg,simulated\n1,2,yes\n2,3,no\n"}, SIMULATED),
    ({"m.csv": b"pose,q1_deg,simulated\n1,2,yes\n2,3\n"}, SIMULATED),
    # exports and logs of others
    ({"m.csv": b"X;Y;Z;Q0;Qx;Qy;Qz\r\n1,0;2,0;3,0;1;0;0;0\r\n"}, IMPORTED),
    ({"m.csv": b"x;y;z\n1;2;3\n"}, IMPORTED),
    ({"m.csv": b"J1,J2,X,Y,Z\n1,2,3,4,5\n"}, SIMULATED),
    ({"m.csv": HEADER.decode().encode("utf-16")}, IMPORTED),
    ({"m.csv": b"# cell 3, Monday\n" + MEASURED["m.csv"]}, IMPORTED),
    ({"m.csv": MEASURED["m.csv"].upper()}, SIMULATED),
    ({"points.txt": b"smr1 1 2 3\n"}, {"points.txt": MEASURED["m.csv"]}),
    # tables of irbcal that were filled in
    ({"plan.csv": b"pose,q1_deg,expected_x_mm,x_mm\n1,2,3,3.1\n"}, PLAN),
    ({"plan.csv": b"pose,q1_deg,x_mm\n1,2,3.1\n"}, PLAN),
    ({"rows.csv": b"pose,q1_deg,feature,value_mm\n1,2,bar,300.1\n2,3,bar,\n"}, ROWS),
    ({"rows.csv": b"pose,q1_deg,feature,value_mm\n1,2,bar,,300.1\n"}, ROWS),
    ({"rows.csv": b"pose,q1_deg,feature,value_mm\n1,2,%b,\n2,3,bar,300.1\n" % (b"x" * 200_000)}, ROWS),
    ({"features.csv": b"feature,length_mm\nbar,300.02\n"}, {"features.csv": b"feature,length_mm\nbar,300\n"}),
    ({"touches.csv": b"frame,q1_deg\ntool,10\n"}, {"touches.csv": b"frame,q1_deg\ntool,\n"}),
    ({"touches.csv": b"frame,q1_deg,x_mm\ntool,10,\n"}, {"touches.csv": b"frame,q1_deg,x_mm\ntool,,\n"}),
    # one file of a set says nothing of the others
    ({"$config.dat": b"DEFDAT", "cell.json": b"irbcal"}, {"$config.dat": b"DEFDAT ", "cell.json": b"irbcal 2"}),
    ({"data.mod": b"a", "job.mod": b"! irbcal\n"}, {"data.mod": b"b", "job.mod": b"! irbcal 2\n"}),
    ({"arm.urdf": b"<robot/>"}, {"arm.urdf": b"<robot><!-- irbcal --></robot>"}),
    ({"job.mod": b"MODULE a"}, {"job.mod": b"! irbcal\nMODULE a", "other.mod": b""}),
    ({"cell.json": b"{}"}, {"cell.json": b'{"irbcal": "cell"}'}),
    ({"thesis.tex": b"\\chapter{1}"}, {"thesis.tex": b"% irbcal: errors"}),
    ({"photo.png": b"\x89PNG"}, {"photo.png": b"\x89PNG irbcal"}),
    ({"notes": b"1"}, {"notes": b"irbcal"}),
    ({"page.html": b"<html>"}, {"page.html": b"<html> irbcal"}),
]
IRBCALS = [
    (SIMULATED, {"m.csv": b"pose,q1_deg,payload_kg,simulated\n1,3,2,yes\n"}),
    (MEASURED, MEASURED),
    ({"m.csv": b""}, MEASURED),
    ({"a.casadi": b"1"}, {"a.casadi": b"1"}),
    (PLAN, {"plan.csv": b"pose,q1_deg,expected_x_mm\n1,3,4\n"}),
    (PLAN, {"plan.csv": b"pose,q1_deg,expected_x_mm,payload_kg\n1,3,4,2\n"}),
    ({"poses.csv": b"q1_deg,targets,wait_s\n1,a,5\n"}, {"poses.csv": b"q1_deg,targets,wait_s\n2,a,5\n"}),
    (ROWS, {"rows.csv": b"pose,q1_deg,feature,value_mm\n1,3,bar,\n2,4,bar,\n"}),
    ({"errors.csv": b"pose,error_mm\n1,2\n"}, {"errors.csv": b"pose,error_mm\n1,3\n"}),
    ({"job.csv": b"q1_deg,irbcal_filtered\n1,x\n"}, {"job.csv": b"q1_deg,irbcal_filtered\n2,x\n"}),
    ({"job.mod": b"! irbcal\n"}, {"job.mod": b"! irbcal 2\n"}),
]


@pytest.mark.parametrize(("before", "after"), MINE)
def test_files_that_irbcal_did_not_write_are_not_replaced(tmp_path, before, after):
    for name, data in before.items():
        (tmp_path / name).write_bytes(data)
    with pytest.raises(CalibrationError, match="does not say that irbcal wrote it: name another one") as raised:
        safe_files.write_together(tmp_path, {"new.txt": b"", **after})
    assert raised.value.file == str(tmp_path / next(iter(before)))
    assert content(tmp_path) == before
    with overwriting.replacing():
        safe_files.write_together(tmp_path, after)
    assert content(tmp_path) == before | after


@pytest.mark.parametrize(("before", "after"), IRBCALS)
def test_files_that_irbcal_wrote_are_replaced(tmp_path, before, after):
    for name, data in before.items():
        (tmp_path / name).write_bytes(data)
    safe_files.write_together(tmp_path, after)
    assert content(tmp_path) == before | after


def test_what_is_written_by_a_function_is_compared_as_well(tmp_path):
    for data in (b"q1_deg\n1\n", b"q1_deg\n1\n"):
        safe_files.write_together(tmp_path, {"long.csv": lambda file, data=data: file.write(data)})
    with pytest.raises(CalibrationError, match="does not say"):
        safe_files.write_together(tmp_path, {"long.csv": lambda file: file.write(b"q1_deg\n2\n")})
    assert content(tmp_path) == {"long.csv": data}


def test_long_files_are_told_by_their_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(overwriting, "LONGEST_LOOK", 10)
    (tmp_path / "a.json").write_bytes(b"x" * 100 + b"irbcal")
    (tmp_path / "b.json").write_bytes(b"x" * 100)
    safe_files.write_together(tmp_path, {"a.json": b"irbcal"})
    safe_files.write_together(tmp_path, {"b.json": b"x" * 100})
    with pytest.raises(CalibrationError, match="does not say"):
        safe_files.write_together(tmp_path, {"b.json": b"irbcal" * 100})


@pytest.mark.parametrize("fail_at", [1, 2, 3])
@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_interrupted_write_leaves_everything_as_it_was(tmp_path, monkeypatch, fail_at, earlier, error):
    folder = tmp_path / "out"
    if earlier:
        safe_files.write_together(folder, dict.fromkeys("abc", b"irbcal"))
    before = content(folder) if earlier else {}
    calls, replace = [], os.replace

    def fails(source, target):
        calls.append(target)
        if len(calls) == fail_at:
            raise error
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises((CalibrationError, KeyboardInterrupt)):
        safe_files.write_together(folder, dict.fromkeys("abc", b"irbcal 2"))
    assert content(folder) == before


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(CalibrationError, match="expected a folder to write to, found a file"):
        safe_files.check_writable(tmp_path / "out")


def test_every_file_is_on_the_disk_before_it_takes_its_name(tmp_path, monkeypatch):
    """Contents are synced first: a power cut after the rename must not leave an empty file under the name."""
    events, sync, replace = [], os.fsync, os.replace

    def synced(handle):
        events.append(("sync", os.fstat(handle).st_ino))
        sync(handle)

    def named(source, target):
        events.append(("name", os.stat(source).st_ino))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", named)
    safe_files.write_together(tmp_path, {"a": b"1", "b": b"2"})
    for name in ("a", "b"):
        node = (tmp_path / name).stat().st_ino
        assert events.index(("sync", node)) < events.index(("name", node))


def test_folders_made_for_nothing_go_again(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(KeyboardInterrupt), safe_files.made_folders(tmp_path / "a" / "b", tmp_path / "mine"):
        raise KeyboardInterrupt
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]
    with safe_files.made_folders(tmp_path / "kept"):
        pass
    assert (tmp_path / "kept").is_dir()


# --- killed, and disks that fail ---------------------------------------------------------------------------------

NEW_SET = {name: f"irbcal: new {name}".encode() for name in ("a", "b", "sub/c")}
OLD_SET = {name: f"irbcal: old {name}".encode() for name in ("a", "sub/c")}


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def write_new(folder):
    safe_files.write_set({folder / name: content for name, content in NEW_SET.items()})


def prepared(folder):
    for name, content in OLD_SET.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def killed_at(call, folder):
    """A child process that writes the set and is killed at a call of the system; whether it came so far."""
    child = os.fork()
    if child == 0:
        count = 0

        def counted(function):
            def wrapped(*arguments, **options):
                nonlocal count
                count += 1
                if count == call:
                    os.kill(os.getpid(), signal.SIGKILL)
                return function(*arguments, **options)

            return wrapped

        for name in ("replace", "link", "fsync", "unlink", "open", "chmod"):
            setattr(os, name, counted(getattr(os, name)))
        try:
            write_new(folder)
        finally:
            os._exit(0)
    return os.waitpid(child, 0)[1] != 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.parametrize("opened_first", ["", "sub"])
def test_killed_anywhere_leaves_the_old_or_the_new_set(tmp_path, opened_first):
    """SIGKILL at every call that changes the disk; whichever folder is opened first finds what was meant."""
    seen = set()
    for call in range(1, 200):
        folder = prepared(tmp_path / str(call))
        if not killed_at(call, folder):
            break
        safe_files.recover(folder / opened_first)
        safe_files.recover(folder)
        safe_files.recover(folder / "sub")
        found = tree(folder)
        assert found in (OLD_SET, NEW_SET), f"call {call}: {found}"
        seen.add(found == NEW_SET)
        write_new(folder)
        assert tree(folder) == NEW_SET
    assert call > 15
    assert seen == {True, False}


@pytest.mark.parametrize("name", ["replace", "fsync", "link", "open", "chmod"])
@pytest.mark.parametrize("number", [28, 5])  # no space left, input/output error
def test_a_disk_that_fails_at_any_call_changes_nothing(tmp_path, monkeypatch, name, number):
    failures = 0
    for call in range(1, 40):
        folder = prepared(tmp_path / f"{name}{call}")
        count, own = 0, getattr(os, name)

        def failing(*arguments, own=own, call=call, **options):
            nonlocal count
            count += 1
            if count == call:
                raise OSError(number, os.strerror(number))
            return own(*arguments, **options)

        with monkeypatch.context() as patched:
            patched.setattr(os, name, failing)
            try:
                write_new(folder)
            except CalibrationError as error:
                failures += 1
                assert os.strerror(number) in str(error)
                assert count >= call
            else:
                assert tree(folder) == NEW_SET
                if count < call:
                    break
                continue
        safe_files.recover(folder)
        assert tree(folder) == OLD_SET, (name, call)
    assert failures or name == "link"  # without links old files are copied


def test_links_and_modes_stay(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a").write_text("irbcal: old")
    (tmp_path / "real" / "a").chmod(0o640)
    (tmp_path / "a").symlink_to("real/a")
    safe_files.write_together(tmp_path, {"a": b"irbcal: new", "b": b"1"})
    assert (tmp_path / "a").is_symlink()
    assert (tmp_path / "real" / "a").read_bytes() == b"irbcal: new"
    assert (tmp_path / "real" / "a").stat().st_mode & 0o777 == 0o640


def test_a_journal_from_elsewhere_reaches_no_other_folder(tmp_path):
    """Somebody's folder may hold any journal: it moves files within that folder only."""
    given, mine = tmp_path / "given", tmp_path / "mine"
    given.mkdir()
    mine.mkdir()
    (mine / "keep").write_text("mine")
    word = ".irbcal-0123456789ab"
    (given / f"{word}-0.new").write_text("theirs")
    rows = [
        ["../mine/keep", f"{word}-0.new", f"{word}-0.old", True],
        ["../mine/keep", f"../mine/{word}-0.new", "x", True],
    ]
    (given / f"{word}.journal").write_text(json.dumps({"irbcal": "journal", "forward": True, "files": rows}))
    (mine / f"{word}-0.new").write_text("theirs")
    safe_files.recover(given)
    assert (mine / "keep").read_text() == "mine"


def test_rubbish_is_swept_and_other_files_are_not(tmp_path):
    (tmp_path / ".irbcal-0123456789ab-3.new").write_text("left")
    (tmp_path / ".irbcal-0123456789ab.journal").write_text("{")
    (tmp_path / ".irbcal-notes").write_text("mine")
    safe_files.recover(tmp_path)
    assert content(tmp_path) == {".irbcal-notes": b"mine"}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_writers_at_once_leave_the_set_of_one(tmp_path):
    children = []
    for k in range(4):
        child = os.fork()
        if child == 0:
            for _ in range(5):
                safe_files.write_together(tmp_path, {name: f"irbcal: {name} of {k}".encode() for name in "abc"})
            os._exit(0)
        children.append(child)
    assert all(os.waitpid(child, 0)[1] == 0 for child in children)
    found = content(tmp_path)
    assert found in [{name: f"irbcal: {name} of {k}".encode() for name in "abc"} for k in range(4)]
