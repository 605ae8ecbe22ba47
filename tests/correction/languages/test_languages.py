"""Which language a file is of, and that every language keeps to what is asked of it."""

import pytest

from irbcal.correction import languages
from irbcal.correction.languages import rapid, table
from irbcal.errors import ProgramError


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a.mod", rapid), ("A.MOD", rapid), ("a.prg", rapid), ("a.sys", rapid), ("a.modx", rapid), ("a.csv", table)],
)
def test_files_go_by_their_ending(name, expected):
    assert languages.of(name) is expected


def test_other_files_are_refused(tmp_path):
    for name, found in (("job.src", "the ending .src"), ("job", "a name without ending")):
        (tmp_path / name).write_text("&ACCESS RVP\nDEF job()\n")
        with pytest.raises(ProgramError) as caught:
            languages.of(tmp_path / name)
        expected = f"expected a program in RAPID (.mod, .prg, .sys, .modx, .sysx) or CSV (.csv), found {found}"
        assert str(caught.value) == f"{tmp_path / name}: {expected}"
    with pytest.raises(ProgramError, match="there is no such file"):
        languages.of(tmp_path / "none")
    with pytest.raises(ProgramError, match="found a folder"):
        languages.of(tmp_path)


def test_languages_offer_what_they_must():
    endings = [ending for language in languages.known() for ending in language.ENDINGS]
    assert len(set(endings)) == len(endings)
    assert all(ending == ending.lower() and ending.startswith(".") for ending in endings)
    for language in languages.known():
        assert callable(language.read_for)
        assert language.NAME
        with pytest.raises(ProgramError, match=r"^job: "):
            language.fingerprint(b"\x00\x01", "job")
