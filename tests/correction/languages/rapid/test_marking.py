"""The comment that marks a corrected module."""

import pytest

from irbcal.correction.languages import rapid
from irbcal.errors import ProgramError


def module(line):
    return f"MODULE m\nPROC main()\n{line}\nENDPROC\nENDMODULE\n".encode()


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        ("MODULE m\r\n  ! x\r\n", "MODULE m\r\n{}\r\n  ! x\r\n"),
        ("! MODULE\nmodule m ( NOVIEW,\n NOSTEPIN ) ! x\n", "! MODULE\nmodule m ( NOVIEW,\n NOSTEPIN ) ! x\n{}\n"),
        ("MODULE m VAR num x; ", "MODULE m\n{}\n VAR num x; "),
        ("\ufeff%%%\n  VERSION:1\n%%%\nMODULE m\n", "\ufeff%%%\n  VERSION:1\n%%%\nMODULE m\n{}\n"),
    ],
)
def test_the_mark(head, expected):
    content = (head + "ENDMODULE").encode()
    assert rapid.parse(content).fingerprint is None
    marked = rapid.mark(content, "12ab-cd")
    assert marked.decode() == expected.format("! irbcal: fake targets, calibration 12ab-cd") + "ENDMODULE"
    seen = rapid.parse(marked)
    assert seen.fingerprint is not None
    assert seen.fingerprint == "12ab-cd"
    for wrong in ("", "a b", "a\n"):
        with pytest.raises(ValueError, match="one word"):
            rapid.mark(content, wrong)


def test_other_marks():
    assert rapid.parse(module("!Irbcal: fake targets")).fingerprint == ""
    assert rapid.parse(module('! not irbcal: fake targets\nf "! irbcal: fake targets";')).fingerprint is None


def test_the_mark_is_found_without_reading_the_module():
    content = module("MoveL [[1,2,3")
    with pytest.raises(ProgramError):
        rapid.parse(content)
    assert rapid.fingerprint(content) is None
    assert rapid.fingerprint(rapid.mark(content, "12ab-cd")) == "12ab-cd"
    assert rapid.fingerprint(module("!Irbcal: fake targets")) == ""
    with pytest.raises(ProgramError, match=r"m\.mod: expected a RAPID module"):
        rapid.fingerprint(b"PROC main() ENDPROC", "m.mod")
