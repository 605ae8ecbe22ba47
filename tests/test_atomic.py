"""Files are written whole or not at all, and never over what was read."""

import os

import pytest

from irbcal import atomic
from irbcal.errors import CalibrationError


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_files_replace_earlier_ones_and_leave_others_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    atomic.write_together(tmp_path, {"a": b"1", "b": b"2"})
    atomic.write_together(tmp_path, {"a": b"3", "b": b"4"})
    assert content(tmp_path) == {"a": b"3", "b": b"4", "notes.txt": b"mine"}


@pytest.mark.parametrize("fail_at", [1, 2, 3])
@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_interrupted_write_leaves_everything_as_it_was(tmp_path, monkeypatch, fail_at, earlier, error):
    folder = tmp_path / "out"
    if earlier:
        atomic.write_together(folder, {"a": b"1", "b": b"2", "c": b"3"})
    before = content(folder) if earlier else {}
    calls, replace = [], os.replace

    def fails(source, target):
        calls.append(target)
        if len(calls) == fail_at:
            raise error
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises((CalibrationError, KeyboardInterrupt)):
        atomic.write_together(folder, {"a": b"x", "b": b"y", "c": b"z"})
    assert content(folder) == before


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(CalibrationError, match="expected a folder to write to, found a file"):
        atomic.check_writable(tmp_path / "out")


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
    atomic.write_together(tmp_path, {"a": b"1", "b": b"2"})
    for name in ("a", "b"):
        node = (tmp_path / name).stat().st_ino
        assert events.index(("sync", node)) < events.index(("name", node))


def test_folders_made_for_nothing_go_again(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(KeyboardInterrupt), atomic.made_folders(tmp_path / "a" / "b", tmp_path / "mine"):
        raise KeyboardInterrupt
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]
    with atomic.made_folders(tmp_path / "kept"):
        pass
    assert (tmp_path / "kept").is_dir()
