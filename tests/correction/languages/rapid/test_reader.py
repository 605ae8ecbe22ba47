"""RAPID modules by hand: what is read, and that no other byte ever changes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rapid_modules import CELL, LEFT, MOVES, J, P, module, pose

from irbcal.correction import text_program as programs
from irbcal.correction.configurations import ConfData
from irbcal.correction.languages import rapid
from irbcal.errors import ProgramError
from irbcal.modeling import frames


def test_declared_targets_with_their_uses():
    seen = rapid.parse(CELL.encode())
    names = ["p10", "pRest", "pRow{1}", "pRow{2}", "jHome", "of MoveC in line 21"]
    assert [target.name for target in seen.targets] == names
    assert [target.kind for target in seen.targets] == ["pose"] * 4 + ["joint", "pose"]
    assert [(t.line, t.column) for t in seen.targets] == [(5, 24), (6, 33), (10, 29), (11, 5), (12, 26), (21, 11)]
    p10, rest, row_1, row_2, home, inline = seen.targets
    assert np.abs(p10.value - pose(100, -0.5, 1, frames.rot_x(np.pi))).max() < 1e-15
    assert np.abs(rest.value - pose(150, -20, 3)).max() < 1e-15
    assert np.abs(row_2.value - pose(4, 5, 6)).max() < 1e-15
    assert np.abs(np.degrees(home.value) - [0, 10, -20, 30.25, 40, -90]).max() < 1e-13
    assert p10.configuration == ConfData(0, -1, -2, 1)
    assert home.configuration is None
    assert p10.external == "[9E9,9E+09,9E9,9E9,9E9,9E9]"
    uses = [(use.line, use.column, use.instruction, use.role, use.tool, use.work_object) for use in p10.uses]
    assert uses == [(16, 12, "MoveL", "to", "tgrip", "wfix"), (17, 5, "MoveJ", "to", "tgrip", "wfix")]
    assert [(use.instruction, use.tool, use.work_object) for use in home.uses] == [("MoveAbsJ", "tool0", "wobj0")]
    assert [(use.instruction, use.role) for use in (*inline.uses, *rest.uses)] == [("MoveC", "via"), ("MoveC", "to")]
    assert row_1.uses == row_2.uses
    assert seen.correctable() == [1, 2, 3, 4, 5]
    assert seen.correctable("joint") == [4]
    assert seen.skipped() == [
        (p10, r"line 22 uses it in another way: MoveL Offs(p10,0,0,10),v100,z10,tGrip\WObj:=wFix;")
    ]
    (left,) = seen.uncorrected
    assert (left.line, left.column, left.instruction, left.target) == (22, 5, "MoveL", "Offs(p10,0,0,10)")
    assert left.reason == "its target is computed: Offs(p10,0,0,10)"
    assert [note.line for note in seen.notes] == [21]  # its first external axis has a value
    with pytest.raises(ValueError, match="read-only"):
        p10.value[0, 0] = 0.0


def test_notes():
    seen = rapid.parse(
        module("PDispOn p10,tool0;", "PDispSet x;", "SetDataVal a,b;", "PDispOn p10,tool0;", "PDispOff;")
    )
    assert [note.line for note in seen.notes] == [4, 5, 6]


def test_files(tmp_path):
    path = tmp_path / "m.mod"
    path.write_bytes(CELL.encode())
    assert rapid.read(path).source == str(path)
    with pytest.raises(ProgramError, match="there is no such file"):
        rapid.read(tmp_path / "none.mod")


# property tests

WORDS = re.findall(r'"[^"\n]*"|![^\n]*\n|\w+|\s+|.', CELL)
PIECES = [
    *["[", "]", "{", "}", "(", ")", ",", ";", ":=", "\\", "!", '"', ".", "-", "+", "*", "%", "$", "\n", "\r\n", " ", "é", "\x85", "\xa0"],
    *["9E9", "1E999", ".5", "1.", "0x1F", "MoveL", "MoveC", "p10", "pRow", "tGrip", "tool0", "i", "CONST", "VAR", "robtarget", "PROC x()"],
    *["ENDPROC", "ENDMODULE", "MODULE", "TRUE", "RECORD", "pRow{1}", "p10:=", P, J, "MoveL p10,v1,z1,tool0;", "[[", "]]", "٣", "²"],
]  # fmt: skip
EDIT = st.tuples(
    st.integers(0, len(WORDS) - 1), st.sampled_from(["cut", "put", "swap", "twice"]), st.sampled_from(PIECES)
)
NUMBERS = st.tuples(*[st.floats(-2e3, 2e3)] * 3, *[st.floats(-3.1, 3.1)] * 3)


def check_rewriting(content, numbers):
    """Either one clear sentence, or a parse whose targets can be rewritten without touching anything else."""
    try:
        seen = rapid.parse(content, "m.mod")
    except ProgramError as error:
        assert re.fullmatch(r"m\.mod: \S[^\r\n]*", str(error))
        return False
    assert programs.with_targets(seen, {}) == content
    T = pose(*numbers[:3], frames.rot_x(numbers[3]) @ frames.rot_y(numbers[4]) @ frames.rot_z(numbers[5]))
    new = {k: T if target.kind == "pose" else np.array(numbers) for k, target in enumerate(seen.targets)}
    new = {k: value for k, value in new.items() if k % 2 == 0}
    written = programs.with_targets(seen, new)
    again = rapid.parse(written, "m.mod")
    assert len(again.targets) == len(seen.targets)
    for k, (before, after) in enumerate(zip(seen.targets, again.targets, strict=True)):
        want = new.get(k, before.value)
        assert np.array_equal(np.isnan(after.value), np.isnan(want))
        assert not (np.abs(after.value - want) > 1e-8).any()
        assert (after.name, after.kind) == (before.name, before.kind)
        assert (after.line, after.external, after.configuration) == (before.line, before.external, before.configuration)
        assert [replace(use, column=0) for use in after.uses] == [replace(use, column=0) for use in before.uses]

    def frame(program):
        """The text without the numbers of the changed targets."""
        cuts = sorted(span for k in new for span in program.targets[k].spans)
        starts, ends = [0, *(end for _, end in cuts)], [*(start for start, _ in cuts), len(program.text)]
        return [program.text[a:b] for a, b in zip(starts, ends, strict=True)]

    assert frame(again) == frame(seen)
    return True


@settings(max_examples=300, deadline=None)
@given(
    st.lists(EDIT, min_size=0, max_size=4),
    NUMBERS,
    st.sampled_from(["utf-8", "utf-8-sig"]),
    st.sampled_from(["\n", "\r\n"]),
)
def test_mutated_modules_are_refused_or_rewritten_without_damage(edits, numbers, encoding, newline):
    words = list(WORDS)
    for place, what, piece in edits:
        words[place] = {"cut": "", "put": piece, "swap": words[place - 1] + piece, "twice": words[place] + piece}[what]
    check_rewriting("".join(words).replace("\n", newline).encode(encoding), numbers)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=30), st.integers(0, len(CELL)), NUMBERS)
def test_any_bytes_in_a_module(piece, place, numbers):
    content = CELL.encode()
    check_rewriting(content[:place] + piece + content[place:], numbers)
    check_rewriting(content[:place], numbers)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.sampled_from([*PIECES, *(line for line, _ in MOVES), *(line for line, _ in LEFT)]), max_size=8), NUMBERS
)
def test_any_words_in_a_routine(words, numbers):
    check_rewriting(module(" ".join(words)), numbers)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(NUMBERS, st.booleans()), min_size=1, max_size=5))
def test_numbers_come_through(targets):
    names = [f"p{k}" for k in range(len(targets))]
    kinds = ["pose" if is_pose else "joint" for _, is_pose in targets]
    data = [
        f"VAR {'robtarget' if kind == 'pose' else 'jointtarget'} {name}:={P if kind == 'pose' else J};"
        for name, kind in zip(names, kinds, strict=True)
    ]
    lines = [
        f"{'MoveL' if kind == 'pose' else 'MoveAbsJ'} {name},v1,z1,tool0;"
        for name, kind in zip(names, kinds, strict=True)
    ]
    content = module(*lines, data="\n".join(data))
    assert rapid.parse(content).correctable() == list(range(len(targets)))
    assert all(check_rewriting(content, numbers) for numbers, _ in targets)
