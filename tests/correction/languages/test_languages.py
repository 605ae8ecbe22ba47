"""Which language a file is of, and that every language keeps to what is asked of it."""

import pytest

from irbcal.correction import languages
from irbcal.correction.languages import krl, rapid, table
from irbcal.errors import ProgramError


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a.mod", rapid),
        ("A.MOD", rapid),
        ("a.prg", rapid),
        ("a.sys", rapid),
        ("a.modx", rapid),
        ("a.csv", table),
        ("a.SRC", krl),
    ],
)
def test_files_go_by_their_ending(name, expected):
    assert languages.of(name) is expected


def test_other_files_go_by_what_they_look_like(tmp_path):
    for text, expected in (
        ("&ACCESS RVP\nDEF job()\n", krl),
        ("%%%\n  VERSION:1\n%%%\nMODULE M\nENDMODULE\n", rapid),
        ("q1_deg,q2_deg\n1,2\n", table),
    ):
        (tmp_path / "job.txt").write_text(text)
        assert languages.of(tmp_path / "job.txt") is expected


@pytest.mark.parametrize(
    ("name", "data", "found"),
    [
        ("job.abc", b"hello\n", "found the ending .abc"),
        ("job", b"hello\n", "found a name without ending"),
        ("job.urp", b"\x1f\x8b\x08\x00", "export the program as .script"),
        ("job.tp", b"\x00\x01", "have the controller write it as .LS"),
        ("job.zip", b"PK\x03\x04", "found a zip archive: unpack it"),
    ],
)
def test_other_files_are_refused(tmp_path, name, data, found):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(
        ProgramError, match=r"expected a program in one of RAPID \(.mod, .prg, .sys, .modx, .sysx\), "
    ) as caught:
        languages.of(tmp_path / name)
    assert found in str(caught.value)
    with pytest.raises(ProgramError, match="there is no such file"):
        languages.of(tmp_path / "none")
    with pytest.raises(ProgramError, match="found a folder"):
        languages.of(tmp_path)


def test_folders_and_several_files(tmp_path):
    with pytest.raises(ProgramError, match="a folder with some, found none"):
        languages.files_of([tmp_path])
    for name in ("b.mod", "a.mod", "notes.txt"):
        (tmp_path / name).write_text("MODULE M\nENDMODULE\n")
    assert languages.files_of([tmp_path]) == (rapid, [tmp_path / "a.mod", tmp_path / "b.mod"])
    (tmp_path / "c.csv").write_text("q1_deg\n1\n")
    with pytest.raises(ProgramError, match=r"this is CSV, but a\.mod is RAPID"):
        languages.files_of([tmp_path])


def test_languages_offer_what_they_must():
    endings = [ending for language in languages.known() for ending in language.ENDINGS]
    assert len(set(endings)) == len(endings)
    assert all(ending == ending.lower() and ending.startswith(".") for ending in endings)
    for language in languages.known():
        assert callable(language.read_for)
        assert language.NAME
        assert not language.looks_like(b"")
        with pytest.raises(ProgramError, match=r"^job: "):
            language.fingerprint(b"\x00\x01", "job")
