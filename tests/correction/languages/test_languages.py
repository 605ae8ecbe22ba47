"""Which language a file is of, and that every language keeps to what is asked of it."""

import pytest
from moves_cases import written

from irbcal.correction import languages
from irbcal.correction.known_languages import KNOWN
from irbcal.correction.languages import by_name
from irbcal.errors import ProgramError


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a.mod", "rapid"),
        ("A.MOD", "rapid"),
        ("a.prg", "rapid"),
        ("a.sys", "rapid"),
        ("a.modx", "rapid"),
        ("a.csv", "csv"),
        ("a.SRC", "krl"),
    ],
)
def test_files_go_by_their_ending(name, expected):
    assert languages.language_of(name) is by_name()[expected]


def test_other_files_go_by_what_they_look_like(tmp_path):
    for text, expected in (
        ("&ACCESS RVP\nDEF job()\n", "krl"),
        ("%%%\n  VERSION:1\n%%%\nMODULE M\nENDMODULE\n", "rapid"),
        ("q1_deg,q2_deg\n1,2\n", "csv"),
    ):
        (tmp_path / "job.txt").write_text(text)
        assert languages.language_of(tmp_path / "job.txt") is by_name()[expected]


@pytest.mark.parametrize(
    ("name", "data", "found"),
    [
        ("job.abc", b"hello\n", "found the ending .abc"),
        ("job", b"hello\n", "found a name without ending"),
        ("job.urp", b"\x1f\x8b\x08\x00", "export it as .script"),
        ("job.tp", b"\x00\x01", "have the controller write it as .LS"),
        ("job.zip", b"PK\x03\x04", "found a zip archive: unpack it"),
    ],
)
def test_other_files_are_refused(tmp_path, name, data, found):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(
        ProgramError, match=r"expected a program in one of RAPID \(.mod, .prg, .sys, .modx, .sysx\), "
    ) as caught:
        languages.language_of(tmp_path / name)
    assert found in str(caught.value)
    with pytest.raises(ProgramError, match="there is no such file"):
        languages.language_of(tmp_path / "none")
    with pytest.raises(ProgramError, match="found a folder"):
        languages.language_of(tmp_path)


def test_folders_and_several_files(tmp_path):
    with pytest.raises(ProgramError, match="a folder with some, found none"):
        languages.files_of([tmp_path])
    for name in ("b.mod", "a.mod", "notes.txt"):
        (tmp_path / name).write_text("MODULE M\nENDMODULE\n")
    assert languages.files_of([tmp_path])[:2] == (by_name()["rapid"], [tmp_path / "a.mod", tmp_path / "b.mod"])
    (tmp_path / "c.csv").write_text("q1_deg,q2_deg\n1,2\n")
    with pytest.raises(ProgramError, match=r"this is CSV, but a\.mod is RAPID"):
        languages.files_of([tmp_path / "a.mod", tmp_path / "c.csv"])


def test_a_folder_is_searched_to_its_end_and_what_is_passed_over_is_listed(tmp_path):
    texts = {
        "RAPID/TASK1/PROGMOD/Job.mod": "MODULE Job\nENDMODULE\n",
        "RAPID/TASK2/PROGMOD/Job.mod": "MODULE Job\nENDMODULE\n",
        "HOME/encoded.sys": "\x00\x01",
        "HOME/notes.csv": "q1_deg,q2_deg\n1,2\n",
        "HOME/other.ls": "/PROG X\n/MN\n/POS\n/END\n",
        "HOME/other.tp": "binary",
        "HOME/alone.tp": "binary",
        "HOME/settings.yaml": "a: 1\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = languages.files_of([tmp_path])
    assert found.language is by_name()["rapid"]
    assert [place.as_posix() for place in found.relative.values()] == [*texts][:2]
    assert {path.name: reason.partition(",")[0].partition(":")[0] for path, reason in found.skipped} == {
        "encoded.sys": "it does not look like RAPID",
        "notes.csv": "it is CSV",
        "other.ls": "it is FANUC LS",
        "alone.tp": "it is a binary FANUC program",
    }
    with pytest.raises(ProgramError, match="two files of this name"):
        languages.files_of([tmp_path / name for name in [*texts][:2]])


def test_the_list_of_known_languages_says_what_they_declare():
    for file, language in zip(KNOWN, languages.all_languages(), strict=True):
        assert (file.maker != "") == (language.declaration is not None), file
        assert file.plans == (language.write_moves is not None or language.name == "CSV"), file


def test_languages_offer_what_they_must():
    endings = [ending for language in languages.all_languages() for ending in language.endings]
    assert len(set(endings)) == len(endings)
    assert all(ending == ending.lower() and ending.startswith(".") for ending in endings)
    for language in languages.all_languages():
        assert callable(language.read_for)
        assert language.name
        assert not language.looks_like(b"")
        with pytest.raises(ProgramError, match=r"^job: "):
            language.fingerprint(b"\x00\x01", "job")


WILD = "x ; J P[9] 9% FINE ;\r\nPTP {A1 9} ]]> </Code> \u2028 movej([9]) 'C00009=9' \x85MoveAbsJ *"
"""A name that tries to be a program."""


@pytest.mark.parametrize(
    ("language", "robot"),
    [
        ("fanuc", "m20ia"),
        ("inform", "gp8"),
        ("kawasaki", "rs007n"),
        ("krl", "kr120r2500pro"),
        ("rapid", "irb120"),
        ("urscript", "ur10"),
        ("val3", "rx160"),
    ],
)
def test_no_name_gets_out_of_its_comment(language, robot):
    """Without the words of comments the program is that of a tame name, line by line."""
    wild, tame = written(language, robot, text=WILD), written(language, robot, text="tame")
    assert wild.keys() == tame.keys()
    for name, text in wild.items():
        pairs = zip(text.splitlines(), tame[name].splitlines(), strict=True)
        others = [(one, other) for one, other in pairs if one != other]
        assert all("tame" in other and other.split("tame")[0] == one[: other.index("tame")] for one, other in others)
        assert len(others) <= 3
