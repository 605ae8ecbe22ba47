"""RAPID modules by hand: what is read, and that no other byte ever changes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moves_cases import written
from rapid_modules import (
    CELL,
    EXT,
    LEFT,
    MOVES,
    TOOLS,
    USE,
    J,
    P,
    module,
    named,
    parsed,
    pose,
    refused,
    rewritten,
    skipped,
)
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp
from support import arm, random_robot

from irbcal.correction import instructions, notation
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import rapid
from irbcal.correction.languages.rapid_reader import RapidData, Reader, may_be
from irbcal.correction.listing import Listing, one_word
from irbcal.correction.maker import ConfData, configuration_of
from irbcal.correction.program import ControllerSetup
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.robot import Robot


def test_declared_targets_with_their_uses():
    seen = parsed(CELL.encode())
    names = ["p10", "pRest", "pRow{1}", "pRow{2}", "jHome", "MoveC in line 21"]
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
    assert seen.correctable() == [0, 1, 2, 3, 4, 5]
    assert seen.correctable("joint") == [4]
    assert seen.unchanged_targets() == []
    (shift,) = seen.shifts
    assert (shift.target, shift.instruction, shift.text, shift.numeric) == (p10, "MoveL", "Offs(p10,0,0,10)", True)
    assert [note.line for note in seen.axes_notes()] == [21]  # its first external axis has a value
    with pytest.raises(ValueError, match="read-only"):
        p10.value[0, 0] = 0.0


def test_notes():
    seen = parsed(module("PDispOn p10,tool0;", "PDispSet x;", "SetDataVal a,b;", "PDispOn p10,tool0;", "PDispOff;"))
    assert [note.line for note in seen.notes] == [4, 5, 6]


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
        seen = parsed(content, "m.mod")
    except ProgramError as error:
        assert re.fullmatch(r"m\.mod: \S[^\r\n]*", str(error))
        return False
    assert rewritten(seen, {}) == content
    T = pose(*numbers[:3], frames.rot_x(numbers[3]) @ frames.rot_y(numbers[4]) @ frames.rot_z(numbers[5]))
    new = {k: T if target.kind == "pose" else np.array(numbers) for k, target in enumerate(seen.targets)}
    new = {k: value for k, value in new.items() if k % 2 == 0}
    written = rewritten(seen, new)
    again = parsed(written, "m.mod")
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
        cuts = sorted((number.start, number.end) for k in new for number in program.targets[k].numbers)
        starts, ends = [0, *(end for _, end in cuts)], [*(start for start, _ in cuts), len(program.text)]
        return [program.text[a:b] for a, b in zip(starts, ends, strict=True)]

    assert frame(again) == frame(seen)
    return True


@settings(max_examples=120, deadline=None)
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


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=30), st.integers(0, len(CELL)), NUMBERS)
def test_any_bytes_in_a_module(piece, place, numbers):
    content = CELL.encode()
    check_rewriting(content[:place] + piece + content[place:], numbers)
    check_rewriting(content[:place], numbers)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.sampled_from([*PIECES, *(line for line, _ in MOVES), *(line for line, _ in LEFT)]), max_size=8), NUMBERS
)
def test_any_words_in_a_routine(words, numbers):
    check_rewriting(module(" ".join(words)), numbers)


@settings(max_examples=40, deadline=None)
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
    assert parsed(content).correctable() == list(range(len(targets)))
    assert all(check_rewriting(content, numbers) for numbers, _ in targets)


def reader(text):
    return Reader(Listing([("m.mod", text.encode())], "RAPID", ("utf-8",)), rapid.MOTIONS)


def test_tokens_are_words_in_lower_case_without_space_and_comments():
    seen = reader('MoveL P10,\r\n  0x1F "a ""b"" !c" -1.5E3 ! irbcal MoveJ\n:= <> ! MoveL')
    kinds = ["name", "name", "symbol", "hex", "string", "symbol", "number", "symbol", "symbol", "end"]
    assert [token.kind for token in seen.tokens] == kinds
    assert [token.word for token in seen.tokens[:3]] == ["movel", "p10", ","]
    assert [token.word for token in seen.tokens[-4:]] == ["1.5E3", ":=", "<>", ""]
    assert seen.marks == ["! irbcal MoveJ"]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_places_are_counted_from_one(newline):
    seen = reader(newline.join(["a", " b", "", "  c d"]))
    places = [(seen.line(token.start), seen.listing.column(token.start)) for token in seen.tokens[:-1]]
    assert places == [(1, 1), (2, 2), (4, 3), (4, 5)]
    assert seen.listing.quote_line(seen.tokens[3].start) == "c d"


def test_refusals_carry_their_place():
    with pytest.raises(ProgramError) as caught:
        reader("a\nb $")
    assert str(caught.value) == "m.mod: line 2: unexpected character '$'"
    assert (caught.value.file, caught.value.row) == ("m.mod", 2)


def test_encodings_give_the_bytes_back():
    for data in ("é".encode(), "é".encode("latin-1"), "\ufeffa".encode()):
        assert Listing([("m", data)], "RAPID", ("utf-8",)).files_with([]) == {"m": data}
    with pytest.raises(ProgramError, match="binary"):
        parsed(b"MODULE\x00", "m")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "expected a RAPID module, found no MODULE"),
        (b"PROC main() ENDPROC", "expected a RAPID module, found no MODULE"),
        (b"MODULE m\nPROC main()\nENDPROC\n", "line 4: the module has no ENDMODULE: the file is not whole"),
        (b"MODULE ;", "line 1: expected the name of the module, found ';'"),
        (b"MODULE m(NOVIEW", "line 1: expected ')' after the attributes of the module"),
        (b"MODULE m ENDMODULE PROC n ENDMODULE", "line 1: expected the end of the file after ENDMODULE, found 'PROC'"),
        (b"MODULE m MODULE n ENDMODULE", "line 1: MODULE stands in a module: the end of that one is missing"),
        (b"MODULE m PROC a() ENDMODULE MODULE n ENDMODULE", "line 1: ENDMODULE stands in a routine: its end is missing"),
        (b"MODULE m PROC a() ENDMODULE", "line 1: ENDMODULE stands in a routine: its end is missing"),
        (b"MODULE m PROC a() PROC b()", "line 1: PROC stands in a routine: the end of that one is missing"),
        (b"MODULE m ENDPROC ENDMODULE", "line 1: ENDPROC ends no routine"),
        (b"MODULE m RECORD a", "line 1: RECORD has no ENDRECORD"),
        (b"MODULE m PROC a(num b; ENDPROC ENDMODULE", "line 1: expected ')', found ';'"),
        (b"MODULE m\x00", "expected a program in RAPID, found binary data"),
        (module('TPWrite "abc;'), "line 4: the string is not closed in its line"),
        (module("a$b;"), "line 4: unexpected character '$'"),
        (module("f(1;"), "line 4: expected ')', found ';'"),
        (module("f 1);"), "line 4: ')' closes nothing"),
        (module("f 1];"), "line 4: ']' closes nothing"),
        (module("VAR num 5;"), "line 4: expected a name, found '5'"),
        (module("VAR num p"), "line 5: expected ';', found 'ENDPROC'"),
        (module(f"VAR robtarget p:={P}"), "line 5: expected ';', found 'ENDPROC'"),
        (module("VAR robtarget p:=[[1,2,3]"), "line 5: expected ',' or ']', found 'ENDPROC'"),
        (module("VAR robtarget p:=[[1,2 3]];"), "line 4: expected an operator or ']', found '3'"),
        (module("VAR robtarget p:=[[1,2,]];"), "line 4: expected a value, found ']'"),
        (module("VAR robtarget p:=" + "[" * 1000), "line 4: more than 12 lists within each other"),
        (module("MoveL p10,,v1,z1,tool0;"), "line 4: expected an argument of MoveL, found ','"),
        (module("MoveL p10,v1,z1,tool0"), "line 5: expected ',' or '\\' or ';', found 'ENDPROC'"),
        (module("MoveL p10,v1,z1,tool0", "MoveL p10,v1,z1,tool0;"), "line 5: expected an operator or ';', found 'MoveL'"),
    ],
)  # fmt: skip
def test_refusals_name_the_line(content, expected):
    assert refused(content) == expected


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("VAR robtarget p:=[[1,2,3],[1,0,0,0]];", "expected [[x, y, z], [q1, q2, q3, q4], [cf1, cf4, cf6, cfx], [six external axes]], found 2 parts"),
        (f"VAR robtarget p:=[[1,2],[1,0,0,0],[0,0,0,0],{EXT}];", "expected [x, y, z], found [1,2]"),
        (f"VAR robtarget p:=[7,[1,0,0,0],[0,0,0,0],{EXT}];", "expected [x, y, z], found 7"),
        (f"VAR robtarget p:=[[1,2,[3]],[1,0,0,0],[0,0,0,0],{EXT}];", "expected a number, found [3]"),
        (f"VAR jointtarget j:=[[1,2,3,4,5],{EXT}];", "expected [six joints], found [1,2,3,4,5]"),
        (f"VAR robtarget p{{3}}:=[{P},{P}];", "expected 3 elements, found 2"),
        (f"MoveL [[1,2,3],[1,0.1,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "expected a unit quaternion, found one of length 1.005"),
        (f"MoveL [[1,2,3],[0,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "expected a unit quaternion, found one of length 0"),
        (f"MoveL [[1,2,1E999],[1,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "found a number that is too large"),
        (f"MoveAbsJ [[1,2,1E999,4,5,6],{EXT}],v1,z1,tool0;", "joint 3 has no value (9E9)"),
        ("MoveAbsJ p10,v1,z1,tool0;", "p10 is declared as robtarget"),
        ("MoveL p10{1},v1,z1,tool0;", "p10 has 0 indices, but p10{1} has 1"),
        ("MoveL p10,v1,z1;", "MoveL is known as to speed zone tool, found 3 arguments"),
        ("MoveL p10,v1,z1,tool0,1;", "MoveL is known as to speed zone tool, found 5 arguments"),
        ("MoveL p10,v1,z1,tNone;", "the program does not define the tool tnone: give it with --tool tnone=…"),
    ],
)  # fmt: skip
def test_one_target_that_is_wrong_stops_no_other(line, expected):
    seen = parsed(module(line, "MoveL p20,v1,z1,tool0;", data=f"CONST robtarget p10:={P}; CONST robtarget p20:={P};"))
    assert expected in [left.reason for left in seen.unchanged_targets()]
    assert [seen.targets[k].name for k in seen.correctable()] == ["p20"]


def test_several_modules_in_one_file():
    first, second = (
        module(USE, data=TOOLS + f"CONST robtarget p10:={P};"),
        module("MoveL p20,v1,z1,tA;", data=f"CONST robtarget p20:={P};"),
    )
    whole = first + second.replace(b"MODULE m", b"MODULE 2_Job")
    seen = parsed(whole)
    assert [(seen.targets[k].name, seen.targets[k].line) for k in seen.correctable()] == [("p10", 2), ("p20", 8)]
    at = seen.mark("abc", seen.mark_at)[0]
    assert whole[:at] == b"MODULE m\n"
    both = parsed(first + first)  # which p10 and which tool a move means is not known
    assert both.correctable() == []
    assert len(both.unchanged_targets()) >= 2


def test_data_that_are_declared_twice_may_be_either():
    seen = parsed(module("VAR num x; VAR num X; MoveL p10,v1,z1,tool0;"))
    assert seen.correctable() == [0]
    twice = parsed(module("MoveL p10,v1,z1,tool0;", data=f"CONST robtarget p10:={P}; CONST robtarget p10:={P};"))
    assert twice.correctable() == []


def value(text):
    seen = reader(text)
    node, _ = seen._list(0)
    return node, seen


def numbers(node):
    return [numbers(item) for item in node.elements] if node.elements is not None else node.number


def test_lists_of_numbers():
    node, seen = value("[1, -2.5, + 3, [.5, 1E2], []x]".replace(", []x", ""))
    assert numbers(node) == [1.0, -2.5, 3.0, [0.5, 100.0]]
    assert seen.mentions == []


@pytest.mark.parametrize("text", ["[1,2]", "[ -1.5 ,\n.5, +2E-3]", "[9E9]", "[ 0 ]"])
def test_a_list_of_plain_numbers_is_what_it_is_number_by_number(text):
    """Beside a comment it is no single token."""
    one, whole = value(text), value(text[:-1] + " ! c\n]")
    assert [token.kind for token in one[1].tokens] == ["list", "end"]
    assert len(whole[1].tokens) > 3
    assert one[0].elements == whole[0].elements
    assert [float(text[leaf.start : leaf.end]) for leaf in one[0].elements] == numbers(one[0])


def test_computed_numbers_are_none_and_their_names_are_mentioned():
    node, seen = value("[a + 1, f(b{2,3}, \\opt:=4), c.trans.x, - 5 * 2, TRUE]")
    assert numbers(node) == [None] * 5
    assert [(mention.name, mention.indices) for mention in seen.mentions] == [
        ("a", ()),
        ("f", ()),
        ("b", (2, 3)),
        ("c", ()),
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1 2]", "expected an operator or ']', found '2'"),
        ("[1,]", "expected a value, found ']'"),
        ("[(1]", r"expected '\)', found '\]'"),
        ("[1)]", r"'\)' closes nothing"),
        ("[" * 20, "more than 12 lists within each other"),
        ("[1,2", "found the end of the file"),
    ],
)
def test_what_is_no_list(text, expected):
    with pytest.raises(ProgramError, match=expected):
        value(text)


def test_assignments_of_literals_are_targets():
    seen = parsed(
        module("p10:=[[4,5,6],[1,0,0,0],[0,0,0,0]," + EXT + "];", "MoveL p10,v1,z1,tool0;", data="VAR robtarget p10;")
    )
    assert seen.correctable() == [0]
    assert seen.targets[0].line == 4
    both = parsed(module(f"p10:={P};", "MoveL p10,v1,z1,tool0;", data=f"VAR robtarget p10:={P};"))
    assert both.correctable() == [0, 1]
    row = f"VAR robtarget p{{3}}:=[{P},{P},{P}];"
    one = parsed(module(f"p{{2}}:={P};", "MoveL p{2},v1,z1,tool0;", data=row))
    assert [(t.name, t.correctable) for t in one.targets] == [
        ("p{1}", False),
        ("p{2}", True),
        ("p{3}", False),
        ("p{2}", True),
    ]
    all_ = parsed(module(f"p{{q{{1}}}}:={P};", "MoveL p{n+1},v1,z1,tool0;", data=row))
    assert [(t.name, t.correctable) for t in all_.targets] == [
        ("p{1}", True),
        ("p{2}", True),
        ("p{3}", True),
        ("p{?}", True),
    ]
    whole = parsed(module(f"p:=[{P},{P},{P}];", "MoveL p{1},v1,z1,tool0;", data=row))
    assert whole.correctable() == [0, 3]


def test_arrays():
    two = f"CONST robtarget p{{2,2}}:=[[{P},{P.replace('1,2,3', '4,5,6')}],[{P},{P}]];"
    seen = parsed(module("MoveL p{1,2},v1,z1,tool0;", "MoveL p{2,i},v1,z1,tool0;", data=two))
    assert [target.name for target in seen.targets] == ["p{1,1}", "p{1,2}", "p{2,1}", "p{2,2}"]
    assert seen.correctable() == [1, 2, 3]
    assert np.abs(seen.targets[1].value - pose(4, 5, 6)).max() < 1e-15
    mixed = parsed(module("MoveL p{i},v1,z1,tool0;", data=f"CONST robtarget p{{n}}:=[{P},q];"))
    assert mixed.correctable() == []
    assert mixed.targets[0].reason == "p{i} is computed or changed in line 2"
    assert [entry.reason for entry in mixed.unchanged_moves] == ["p{i} is computed or changed in line 2"]
    one = parsed(module("MoveL p{1},v1,z1,tool0;", "f p{2};", data=f"CONST robtarget p{{2}}:=[{P},{P}];"))
    assert one.correctable() == [0]
    assert one.targets[1].reason == "line 5 uses it in another way: f p{2};"
    out = parsed(module("MoveL p{3},v1,z1,tool0;", data=f"CONST robtarget p{{2}}:=[{P},{P}];"))
    assert [entry.reason for entry in out.unchanged_moves] == ["p{3} has no value in this module"]


def test_joints_without_a_value_are_left():
    seen = parsed(module("MoveAbsJ j,v1,fine,tool0;", data=f"CONST jointtarget j:=[[1,9E9,3,4,5,6],{EXT}];"))
    assert seen.targets[0].reason == "joint 2 has no value (9E9)"
    assert np.isnan(seen.targets[0].value).tolist() == [False, True] + [False] * 4


@pytest.mark.parametrize(
    ("kind", "numbers", "problem"),
    [
        ("pose", (1, 2, 3, 1, 0, 0, 0), None),
        ("pose", (1, 2, 9e9, 1, 0, 0, 0), "found a number that is too large"),
        ("pose", (1, 2, 3, 1, 1, 0, 0), "expected a unit quaternion, found one of length 1.414"),
        ("joint", (1, 2, 3, 4, 5, 6), None),
        ("joint", (1, 2, float("inf"), 4, 5, 6), "found a number that is too large"),
    ],
)
def test_numbers_that_are_no_target(kind, numbers, problem):
    assert rapid.ABB.problem(kind, numbers) == problem


def test_entries_are_looked_up_as_they_would_be_looked_through():
    """Plain, computed and missing indices, against every pair of indices compared."""
    data = RapidData("p", "robtarget", 0, sizes=(3, 2))
    indices = [(1, 1), (1, 2), (None, 2), (2, 1), (1, 2), (3, None)]
    for k, index in enumerate(indices):
        data.entries.append((index, k))
    for asked in [(1, 2), (2, 2), (3, 1), (None, 1), (1, None), (), (9, 9)]:
        assert data.literals(asked) == [k for k, index in enumerate(indices) if may_be(index, asked)]
    data.entries.append(((2, 2), 6))
    assert data.literals((2, 2)) == [2, 6], "what comes later is found, too"


@pytest.mark.parametrize(("line", "role"), MOVES)
def test_moves_and_their_arguments(line, role):
    seen = parsed(module(line))
    assert seen.correctable() == [0], skipped(seen)
    (use,) = seen.targets[0].uses
    assert (use.role, use.tool, use.work_object, use.line) == (role, "tool0", "wobj0", 4)
    assert all(entry.target.endswith(" q") for entry in seen.unchanged_moves)


@pytest.mark.parametrize(("line", "reason"), LEFT)
def test_moves_that_are_left_are_reported(line, reason):
    data = f"CONST robtarget p10:={P}; VAR num number; VAR robtarget empty;"
    seen = parsed(module(line, data=data))
    assert seen.correctable() == []
    assert [(entry.line, entry.reason) for entry in seen.unchanged_moves] == [(4, reason)]


CONFLICTS = [
    ("MyMove p10,v1;", "line 5 uses it in another way: MyMove p10,v1;"),
    ("MyMove p10,v1,tA;", "line 5 uses it in another way: MyMove p10,v1,tA; (if it moves there, teach it with --instructions: rapid MyMove to argument2 tool)"),
    ("p20:=p10;", "line 5 uses it in another way: p20:=p10;"),
    ("IF p10.trans.z>5 THEN ENDIF", "line 5 uses it in another way: IF p10.trans.z>5 THEN ENDIF"),
    ("MoveL Offs(p10,0,0,1),v1,z1,tB;", "line 5 uses it in another way"),
    (r"MoveL RelTool(p10,0,0,1\Rz:=9),v1,z1,tA;", r"line 5 uses it in another way: MoveL RelTool(p10,0,0,1\Rz:=9),v1,z1,tA;"),
    ("MoveL Offs(Offs(p10,0,0,1),1,2,3),v1,z1,tA;", "line 5 uses it in another way: MoveL Offs(Offs(p10,0,0,1),1,2,3),v1,z1,tA;"),
    ("MoveL Offs(p10,p10.trans.x,2,3),v1,z1,tA;", "line 5 uses it in another way: MoveL Offs(p10,p10.trans.x,2,3),v1,z1,tA;"),
    ("p10.trans.x:=p10.trans.x+1;", "p10 is computed or changed in line 5; line 5 uses it in another way: p10.trans.x:=p10.trans.x+1;"),
    ("p10:=CRobT();", "p10 is computed or changed in line 5"),
    ("SearchL di,p10,q,v1,tA;", "p10 is computed or changed in line 5"),
    ("MoveJ p10,v1,z1,tB;", "used with different tools: tb (line 5), ta (line 4)"),
    (r"MoveJ p10,v1,z1,tA\WObj:=wA;", "used with different work objects: wa (line 5), wobj0 (line 4)"),
    ("MoveJ p10,v1,z1,tools{1};", "the tool of MoveJ in line 5 is computed: tools{1}; used with different tools: a computed one (line 5), ta (line 4)"),
    (r"MoveJ p10,v1,z1,tA\WObj?w;", "the work object of MoveJ in line 5 is computed: w; used with different work objects: a computed one (line 5), wobj0 (line 4)"),
    ("tA.tframe.trans:=CPos();", "the tool tA is changed in line 5"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "reason"), CONFLICTS)
def test_targets_that_do_more_are_not_corrected(line, reason):
    seen = parsed(module(USE, line, data=TOOLS + f"VAR robtarget p10:={P};"))
    (target,) = seen.targets
    assert target.reason == reason
    assert target.uses
    assert not target.correctable
    assert skipped(seen) == [(target, reason)]
    changed = parsed(rewritten(seen, {0: pose(3, 4, 5)}))  # the caller may decide otherwise
    assert np.abs(changed.targets[0].value - pose(3, 4, 5)).max() < 1e-15


SHIFTS = [  # its argument, whether the shift is in the tool, the shifts to look at, mm
    ("Offs(p10,0,0,50)", False, [[0, 0, 50]]),
    ("Offs( p10 , -20 , 5 , 60.5 )", False, [[-20, 5, 60.5]]),
    ("RelTool(p10,10,0,-80)", True, [[10, 0, -80]]),
    ("Offs(p10,0,0,height)", False, [[100, 0, 0], [0, 100, 0], [0, 0, 100]]),
]


@pytest.mark.parametrize(("argument", "in_tool", "shifts"), SHIFTS)
def test_a_point_that_is_also_shifted_is_corrected_and_the_shifted_one_is_told(argument, in_tool, shifts):
    """The figures in the note against the new numbers of the file, read by hand, and joints by least squares."""
    nominal = arm()
    robot = random_robot(nominal, "16", np.random.default_rng(5), size=0.5)
    q = np.radians([10, -20, 30, 5, 40, 20])
    tool, table = pose(0, 0, 120, frames.rot_y(0.4)), pose(300, -100, 50, frames.rot_z(0.3))
    T = frames.inverse(table) @ nominal.forward(q[None])[0] @ tool

    def listed(T):
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        return f"[{','.join(f'{1e3 * v:.6f}' for v in T[:3, 3])}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}]"

    data = f"PERS tooldata t:=[TRUE,[{listed(tool)}],[1,[0,0,1],[1,0,0,0],0,0,0]];"
    data += f'PERS wobjdata w:=[FALSE,TRUE,"",[{listed(table)}],[[0,0,0],[1,0,0,0]]];'
    data += f"CONST robtarget p10:=[{listed(T)},[0,0,0,0],{EXT}];"
    moves = [rf"MoveL {argument},v1,z1,t\WObj:=w;", r"MoveL p10,v1,fine,t\WObj:=w;"]
    found = filter_program(parsed(module(*moves, data=data)), CorrectionModel(robot, nominal, "abc"))
    assert (found.unchanged_targets, found.targets.tolist()) == ((), ["p10"])
    (note,) = found.notes
    assert note.line == 4
    told = [float(value) for value in re.findall(r"(\d+\.\d+) mm", note.text)]
    assert ("at 100 mm" in note.text) == (len(shifts) == 3)
    text = re.search(r"p10:=\[\[([^\]]*)\],\[([^\]]*)\]", found.data.decode())
    x, w = (np.array([float(v) for v in text[k].split(",")]) for k in (1, 2))
    new = frames.transform(Rotation.from_quat(w[[1, 2, 3, 0]]).as_matrix(), x / 1e3)

    def error(value, shift):
        d = frames.transform(None, np.array(shift) / 1e3)
        wanted, asked = (table @ (v @ d if in_tool else d @ v) @ frames.inverse(tool) for v in (T, value))

        def misses(q):
            at = nominal.forward(q[None])[0]
            return np.r_[at[:3, 3] - asked[:3, 3], Rotation.from_matrix(at[:3, :3] @ asked[:3, :3].T).as_rotvec()]

        joints = least_squares(misses, q, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        return 1e3 * np.linalg.norm((robot.poses(joints[None])[0] @ tool - wanted @ tool)[:3, 3])

    expected = [max(error(value, shift) for shift in shifts) for value in (new, T)]
    np.testing.assert_allclose(told[-2:], expected, rtol=0, atol=1e-3)
    assert told[-2] < told[-1]


def test_what_is_only_shifted_is_no_target():
    seen = parsed(module("MoveL Offs(p10,0,0,1),v1,z1,tA;", data=TOOLS + f"VAR robtarget p10:={P};"))
    assert seen.correctable() == []
    assert [left.reason for left in seen.unchanged_targets()] == [
        "line 4 uses it in another way",
        "it is shifted, and no move goes to p10 itself with the same tool and frame",
    ]


PROCESS = [
    ("ArcLStart p10,v1,seam1,weld1,fine,tA;", "to"),
    (r"ArcL p10,v1,seam1,weld1\Weave:=weave1,z10,tA\WObj:=wA;", "to"),
    (r"ArcL\On,p10,v1,seam1,weld1,weave1,z10,tA\WObj:=wA;", "to"),  # weave data of older versions
    ("ArcC q,p10,v1,seam1,weld1,z10,tA;", "to"),
    ("ArcCEnd p10,q,v1,seam1,weld1,fine,tA;", "via"),
    (r"SpotL p10,v1,gun1,spot10\InPos,tA\WObj:=wA;", "to"),
    ("SpotJ p10,v1,spot10,tA;", "to"),
    (r"SpotML p10,v1\G1:=spot1\G2:=spot2,tA;", "to"),
    (r"DispL\On,p10,v1,bead1,z30,tA;", "to"),
    ("DispC q,p10,v1,bead1,z30,tA;", "to"),
    ("PaintL p10,v1,z50,tA;", "to"),
    ("CapL p10,v1,cdata,weavestart,weave,z50,tA;", "to"),
    ("NutL p10,v1,nut1,tA;", "to"),
    ("MoveLGO p10,v1,z1,tA,go1;", "to"),
]


@pytest.mark.parametrize(("line", "role"), PROCESS)
def test_process_instructions_are_moves(line, role):
    """As the manuals list their arguments; the tool is the declared one."""
    seen = parsed(module(line, data=TOOLS + f"VAR robtarget p10:={P}; VAR robtarget q:={P};"))
    ((target),) = [target for target in seen.targets if target.name == "p10"]
    assert seen.unchanged_targets() == []
    (use,) = target.uses
    assert (use.role, use.tool, use.work_object) == (role, "ta", "wa" if "WObj" in line else "wobj0")


def test_a_routine_of_the_programs_own_is_no_built_in_move():
    own = "PROC SpotL(robtarget p,tooldata t)\nMoveL Offs(p,0,0,9),v1,z1,t;\nENDPROC\n"
    content = module("SpotL p10,v1,tA;", data=TOOLS + f"VAR robtarget p10:={P};").replace(
        b"PROC main", own.encode() + b"PROC main"
    )
    assert parsed(content).correctable() == []


LESSONS = [
    ("MyMove p10,v1,tA;", "rapid MyMove to argument2 tool"),
    (f"MyArc p10,{P},v1,Grip;", "rapid MyArc via to argument3 tool"),
    (r"Glue\On,p10,Speed(2,[1,2]),tA\WObj:=wA;", "rapid Glue to argument2 tool"),
]


@pytest.mark.parametrize(("line", "lesson"), LESSONS)
def test_a_move_that_is_not_known_says_the_line_that_teaches_it(tmp_path, line, lesson):
    content = module(line, data=TOOLS + f"VAR robtarget p10:={P};")
    seen = parsed(content)
    assert seen.correctable() == []
    assert any(f"--instructions: {lesson})" in left.reason for left in seen.unchanged_targets())
    (tmp_path / "taught.txt").write_text(f"# of our cell\n{lesson}  # so\n")
    (tmp_path / "m.mod").write_bytes(content)
    tools = {"grip": np.eye(4)}
    setup = ControllerSetup(
        tools, {}, unknown_frames(), instructions=instructions.read(tmp_path / "taught.txt", {"rapid": True})
    )
    (again,) = rapid.read_for(arm(), [tmp_path / "m.mod"], setup)
    assert again.unchanged_targets() == []
    assert all(target.uses[0].tool in ("ta", "grip") for target in again.targets)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(rapid.MOTIONS)), st.integers(0, 3), NUMBERS)
def test_any_target_of_any_instruction_of_the_table(name, more, numbers):
    """A literal in the place of the target is corrected, and no other byte changes."""
    move = rapid.MOTIONS[name]
    if "AbsJ" in move.name:
        return
    words = [word for known in move.required for word in ([known] if known != "*" else ["x"] * more)]
    args = [
        "tool0" if word == "tool" else "q" if word in ("via", "writes") else P if word == "to" else "x"
        for word in words
    ]
    seen = parsed(module(f"{move.name} {','.join(args)};", data=f"VAR robtarget q:={P};"))
    ((target),) = [target for target in seen.targets if target.line == 4]
    assert target.correctable
    assert check_rewriting(seen.data, numbers)


def test_what_does_not_conflict():
    lines = [USE, "MoveL p10,v1,z1,tA;", "x.p10:=1;", r"Call \p10:=2;", 'TPWrite "p10";', "! p10", "MoveAbsJ j,v1,fine,tA;", "MoveAbsJ j,v1,fine,tB;"]  # fmt: skip
    seen = parsed(module(*lines, data=TOOLS + f"VAR robtarget p10:={P}; VAR jointtarget j:={J};"))
    assert seen.correctable() == [0, 1]
    many = parsed(module(USE, *["f p10;"] * 5, data=TOOLS + f"VAR robtarget p10:={P};"))
    assert many.targets[0].conflicts[3] == "so do 2 more lines"
    unused = parsed(module(data=f"VAR robtarget p10:={P}; VAR robtarget p20:=[[0,0,0],[0,0,0,0],[0,0,0,0],{EXT}];"))
    assert [target.reason for target in unused.targets] == ["no move of this module uses it"] * 2
    assert unused.unchanged_targets() == [], "an element that was never taught and that nobody uses"


def test_routines_have_data_of_their_own():
    content = f"""MODULE m
    CONST robtarget p10:={P};
    PROC a(robtarget p10, \\switch s | switch t, INOUT num p20{{*}})
      MoveL p10,v1,z1,tool0;
      p10:={P};
    ENDPROC
    FUNC num b(num x)
      VAR robtarget p10:=[[7,8,9],[1,0,0,0],[0,0,0,0],{EXT}];
      p10.trans.x:=x;
      MoveL p10,v1,z1,tool0;
      RETURN 1;
    ENDFUNC
    TRAP c
      MoveL p10,v1,z1,tool0;
    ENDTRAP
    RECORD pair robtarget first; num second; ENDRECORD
    PROC d(PERS tooldata tool0) MoveL p10,v1,z1,tool0; ENDPROC
    ENDMODULE""".encode()
    seen = parsed(content)
    outer, inner = seen.targets
    assert [use.line for use in outer.uses] == [14, 17]
    assert outer.conflicts[0] == "the tool tool0 is a parameter of the routine"
    assert inner.conflicts == ["p10 is computed or changed in line 9"]
    assert [entry.reason for entry in seen.unchanged_moves] == [
        "p10 is a parameter of the routine",
        "is a parameter of the routine",
        "p10 is computed or changed in line 9",
        "the tool tool0 is a parameter of the routine",
    ]


TOOL = "PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
OTHER_TOOL = TOOL.replace("100", "200")


def read(folder, given=None, **modules):
    """The modules of a call by their names, each from its data and the lines of its routine."""
    paths = []
    for name, (data, *lines) in modules.items():
        path = folder / f"{name}.mod"
        body = "\n".join(lines)
        path.write_text(f"MODULE {name}\n{data}\nPROC r{name}()\n{body}\nENDPROC\nENDMODULE\n")
        paths.append(path)
    found = rapid.read_for(arm(), paths, ControllerSetup(given or {}, {}, unknown_frames()))
    return dict(zip(modules, found, strict=True))


@pytest.mark.parametrize("how", ["CONST", "PERS", "TASK PERS", "VAR"])
def test_a_target_is_corrected_where_it_stands(how, tmp_path):
    seen = read(
        tmp_path,
        Data=(f"{TOOL} {how} robtarget p:={P}; {how} jointtarget j:={J}; {how} robtarget unused:={P};",),
        Work=("", "MoveAbsJ J,v1,fine,tA;", "MoveL P,v1,fine,tA;", "MoveJ p,v1,fine,tA;"),
    )
    data, work = seen["Data"], seen["Work"]
    assert [data.targets[k].name for k in data.correctable()] == ["p", "j"]
    assert [(use.line, use.file, use.instruction) for use in data.targets[0].uses] == [
        (5, "Work.mod", "MoveL"),
        (6, "Work.mod", "MoveJ"),
    ]
    assert data.tools["ta"][2, 3] == 0.1
    assert (work.unchanged_targets(), data.unchanged_targets()) == ([], [])
    assert all(stop.target is None for stop in work.stops())


def test_elements_of_arrays(tmp_path):
    row = f"CONST robtarget p{{2}}:=[{P},{P}]; CONST robtarget q{{2}}:=[{P},{P}];"
    seen = read(tmp_path, Data=(row,), Work=("", "MoveL p{2},v1,fine,tool0;", "MoveL q{i},v1,fine,tool0;"))
    assert [seen["Data"].targets[k].name for k in seen["Data"].correctable()] == ["p{2}", "q{1}", "q{2}"]


IN_DOUBT = [  # of the declaring module, of the using one, and what is said
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "f p;"], "line 5 of Work.mod uses it in another way"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "p:=CRobT();"], "line 5 of Work.mod gives it another value"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "p.trans.x:=1;"], "gives it another value"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "SearchL d,p,q,v1,tA;"], "gives it another value"),
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "MoveL p,v1,fine,tool0;"], "used with different tools: tool0 (line 5 of Work.mod), ta (line 4 of Work.mod)"),
    (f"{TOOL} CONST robtarget p:={P};", f"LOCAL {OTHER_TOOL}", ["MoveL p,v1,fine,tA;"], "the tool ta is another one in another module"),
    (f"CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tX;"], "the tool tx is not defined in numbers in these modules"),
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "tA:=tool0;"], "the tool ta is changed"),
    (f"{TOOL} CONST robtarget p:={P};", "", [r"MoveL p,v1,fine,\Tool?tB;"], "is computed: tB of Work.mod"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "own", "lines", "reason"), IN_DOUBT)
def test_in_doubt_it_is_left_with_the_reason(data, own, lines, reason, tmp_path):
    seen = read(tmp_path, Data=(data,), Work=(own, *lines))
    assert seen["Data"].correctable() == []
    ((target, why),) = skipped(seen["Data"])
    assert target.uses
    assert reason in why


def test_uses_of_the_own_module_and_of_others_count_together(tmp_path):
    data = f"{TOOL} CONST robtarget p:={P};"
    agree = read(tmp_path, Data=(data, "MoveL p,v1,fine,tA;"), Work=("", "MoveL p,v1,fine,tA;"))
    assert agree["Data"].correctable() == [0]
    differ = read(tmp_path, Data=(data, "MoveL p,v1,fine,tA;"), Work=("", "MoveL p,v1,fine,tool0;"))
    assert "used with different tools" in differ["Data"].targets[0].reason


@pytest.mark.parametrize(
    ("own", "line"),
    [
        (f"LOCAL CONST robtarget p:={P};", ""),  # hidden by data of the module
        (f"CONST robtarget p:={P};", ""),
        ("VAR num p;", ""),
        ("", f"VAR robtarget p:={P};"),  # and of the routine
    ],
)
def test_names_that_hide_the_other_modules_target(own, line, tmp_path):
    moves = [line, "" if own.startswith("VAR num") else "MoveL p,v1,fine,tool0;"]
    seen = read(tmp_path, Data=(f"CONST robtarget p:={P};",), Work=(own, *moves))
    assert not seen["Data"].targets[0].uses
    assert seen["Data"].correctable() == []


def test_a_routines_parameter_hides_it_too(tmp_path):
    (tmp_path / "a.mod").write_text(f"MODULE a\nCONST robtarget p:={P};\nENDMODULE\n")
    text = "MODULE b\nPROC go(robtarget p)\nMoveL p,v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    (tmp_path / "b.mod").write_text(text)
    a, b = rapid.read_for(arm(), [tmp_path / "a.mod", tmp_path / "b.mod"], ControllerSetup({}, {}, unknown_frames()))
    assert not a.targets[0].uses
    assert [entry.reason for entry in b.unchanged_moves] == ["p is a parameter of the routine"]


def test_local_data_are_not_seen_and_names_declared_twice_are_left(tmp_path):
    seen = read(tmp_path, Data=(f"LOCAL CONST robtarget p:={P};",), Work=("", "MoveL p,v1,fine,tool0;"))
    assert not seen["Data"].targets[0].uses
    assert [entry.reason for entry in seen["Work"].unchanged_moves] == ["p is not declared in this module"]
    one = f"CONST robtarget p:={P};"
    seen = read(tmp_path, A=(one, "MoveL p,v1,fine,tool0;"), B=(one,), C=("", "MoveL p,v1,fine,tool0;"))
    assert seen["A"].correctable() == []
    assert "line 4 of C.mod uses this name, which A.mod and B.mod declare" in seen["A"].targets[0].reason
    assert "declare" in seen["B"].targets[0].reason


def test_a_given_tool_goes_before_what_modules_say(tmp_path):
    T = np.eye(4)
    T[0, 3] = 0.3
    data = (f"{TOOL} CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0],{EXT}];",)
    seen = read(tmp_path, {"ta": T}, Data=data, Work=(f"LOCAL {OTHER_TOOL}", "MoveL p,v1,fine,tA;"))
    assert seen["Data"].correctable() == [0]
    assert seen["Data"].tools["ta"][0, 3] == 0.3


def test_frames_of_tools_and_work_objects():
    seen = parsed(CELL.encode())
    assert set(seen.tools) == {"tgrip", "tool0"}
    assert set(seen.work_objects) == {"wfix", "wobj0"}
    assert np.array_equal(seen.tools["tool0"], np.eye(4))
    tool = pose(10, 0, 120.5, frames.rot_y(np.pi / 2))
    cyclic = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x to y, y to z, z to x
    work_object = pose(800, 0, 500, cyclic) @ pose(10, 20, 30, frames.rot_z(np.pi))
    assert np.abs(seen.tools["tgrip"] - tool).max() < 1e-7
    assert np.abs(seen.work_objects["wfix"] - work_object).max() < 1e-15
    chosen = [named(seen, "pRest"), named(seen, "pRow{2}")]
    T_base_tip = seen.tip_poses(chosen)
    assert np.abs(T_base_tip[0] @ tool - work_object @ pose(150, -20, 3)).max() < 1e-7
    assert np.abs(T_base_tip[1] - pose(4, 5, 6)).max() < 1e-15
    back = seen.values_for_tip_poses(chosen, T_base_tip)
    assert max(np.abs(back[k] - seen.targets[k].value).max() for k in chosen) < 1e-15


FRAME = "[[1,0,0],[1,0,0,0]]"
LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (f"PERS tooldata t:=[FALSE,{FRAME},{LOAD}];", "the tool t is not held by the robot (robhold FALSE), and the work object wobj0 neither"),
        (f"PERS tooldata t:=[n,{FRAME},{LOAD}];", "tool t of line 3: expected TRUE or FALSE for robhold, found n"),
        (f"PERS tooldata t:=[TRUE,[[1,0,0],[1,0,1,0]],{LOAD}];", "tool t of line 3: expected a unit quaternion, found one of length 1.414"),
        (f"PERS tooldata t:=[TRUE,[[1,0,n],[1,0,0,0]],{LOAD}];", "tool t of line 3: expected a frame [[x, y, z], [q1, q2, q3, q4]] in numbers, found [[1,0,n],[1,0,0,0]]"),
        (f"PERS tooldata t:=[TRUE,[[1,0,1E999],[1,0,0,0]],{LOAD}];", "tool t of line 3: found a number that is too large"),
        ("PERS tooldata t:=other;", "tool t of line 3 has no frame in numbers: give it with --tool t=…"),
        ("PERS tooldata t;", "tool t of line 3 has no frame in numbers: give it with --tool t=…"),
        ("VAR num t;", "expected a tooldata, but t is declared as num"),
        (f'PERS wobjdata w:=[TRUE,TRUE,"",{FRAME},{FRAME}];', "the robot holds both tool0 and w (robhold TRUE)"),
        (f'PERS wobjdata w:=[FALSE,FALSE,"STN1",{FRAME},{FRAME}];', "work object w of line 3 is moved by a mechanical unit (ufprog FALSE): this is not supported"),
        (f'PERS wobjdata w:=[FALSE,TRUE,"",{FRAME},[[1,0,0],[1,0,0]]];', "work object w of line 3: expected a frame [[x, y, z], [q1, q2, q3, q4]] in numbers, found [[1,0,0],[1,0,0]]"),
    ],
)  # fmt: skip
def test_frames_that_are_not_supported(data, expected):
    move = r"MoveL p10,v1,z1,tool0\WObj:=w;" if " w:" in data else "MoveL p10,v1,z1,t;"
    content = module(move, data=f"CONST robtarget p10:={P};\n{data}")
    assert expected in parsed(content).targets[0].reason
    assert parsed(content.replace(move.encode(), b"")).unchanged_targets() == [], "nobody needs it"


def test_frames_from_the_caller():
    content = module(r"MoveL p10,v1,z1,tGrip\WObj:=wFix;")
    assert parsed(content).targets[0].conflicts == [
        "the program does not define the tool tgrip: give it with --tool tgrip=…",
        "the program does not define the frame wfix: give it with --frame wfix=…",
    ]
    T = pose(1, 2, 3, frames.rot_y(0.3))
    assert len(parsed(content, tools={"TGRIP": T}).targets[0].conflicts) == 1
    seen = parsed(content, tools={"TGRIP": T}, work_objects={"wFix": T})
    assert seen.correctable() == [0]
    assert np.array_equal(seen.tools["tgrip"], T)
    over = parsed(module(USE, data=TOOLS + f"VAR robtarget p10:={P};"), tools={"ta": T})
    assert np.array_equal(over.tools["ta"], T)
    # what is not corrected needs no frame
    assert parsed(module("MoveL Offs(p10,0,0,1),v1,z1,tGrip;")).tools == {}
    assert parsed(module("MoveL p10,v1,z1,tGrip;", "f p10;")).tools == {}


def order(body, more=""):
    """(name, name of the stop before) of each stop of a module with targets a, b, c and an array r of two."""
    data = "".join(f"CONST robtarget {n}:=[[{k},2,3],[1,0,0,0],[0,0,0,0],{EXT}];\n" for k, n in enumerate("abc"))
    two = ",".join([f"[[7,2,3],[1,0,0,0],[0,0,0,0],{EXT}]"] * 2)
    text = f"MODULE m\n{data}CONST robtarget r{{2}}:=[{two}];\nPROC main()\n{body}\nENDPROC\n{more}ENDMODULE\n"
    module = parsed(text.encode())
    names = [target.name for target in module.targets]
    return [
        (None if s.target is None else names[s.target], None if s.previous is None else names[s.previous])
        for s in module.stops()
    ]


def to(name):
    return f"MoveL {name},v100,fine,tool0;\n"


def test_moves_follow_one_another_past_what_does_not_move():
    body = f"{to('a')}SetDO do1,1;\nn:=n+1;\nWaitTime 1;\n{to('b')}MoveC a,c,v1,z1,tool0;\n{to('r{2}')}"
    assert order(f"VAR num n;\n{body}") == [("a", None), ("b", "a"), ("a", "b"), ("c", "a"), ("r{2}", "c")]


@pytest.mark.parametrize(
    "between",
    [
        "grip;",
        'grip 1,"x";',
        '%"routine"%;',
        "GOTO again;",
        "again:",
        "MoveL Offs(b,0,0,1),v1,fine,tool0;",
        "MoveL r{n},v1,fine,tool0;",
        "SearchL di1,found,b,v1,tool0;",
        "IF n>1 MoveL b,v1,fine,tool0;",
        "IF n>1 THEN\nn:=2;\nENDIF\ngrip;",
        "WHILE n>1 DO\nn:=2;\nENDWHILE\nperhaps;",
        "perhaps;",
        "MoveL b,v1,fine,tool0,twice,more;",
        "IF n>1 THEN\nMoveL b,v1,fine,tool0;\nENDIF",
        "FOR i FROM 1 TO 3 DO\nMoveL b,v1,fine,tool0;\nENDFOR",
        "TEST n\nCASE 1:\nMoveL b,v1,fine,tool0;\nENDTEST",
        "ERROR",
    ],
)
def test_behind_branches_calls_and_computed_moves_the_stop_before_is_not_known(between):
    perhaps = f"PROC perhaps()\nIF x>1 {to('b')}ENDPROC\n"
    found = order(f"{to('a')}{between}\n{to('c')}", more=perhaps if "perhaps" in between else "")
    assert found[0] == ("a", None)
    assert ("c", None) in found
    if "perhaps" in between or "grip" in between:
        return
    if "IF" in between or "FOR" in between or "CASE" in between:
        assert found[1] == ("b", None)


def test_moves_outside_of_routines_and_routines_in_records_are_read():
    data = f"CONST robtarget a:={P};\n"
    assert len(parsed(f"MODULE m\n{data}{to('a')}ENDMODULE".encode()).stops()) == 1
    text = f"MODULE m\nRECORD r\nPROC num;\nENDRECORD\n{data}PROC main()\nGripLoad load0;\n{to('a')}ENDPROC\nENDMODULE"
    assert len(parsed(text.encode()).stops()) == 1


def test_routines_begin_with_an_unknown_stop():
    assert order(to("a"), more=f"PROC other()\n{to('b')}{to('c')}ENDPROC\n") == [
        ("a", None),
        ("b", None),
        ("c", "b"),
    ]


FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
T_TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
WOBJ = frames.from_xyz_angles([0.5, 0.0, 0.3, 0.0, 0.0, 0.2])
TOLERANCE = 3e-5
PLACES = {
    "p1": (0.75, -0.35, 0.8, 0.0),
    "p2": (0.95, 0.35, 1.0, 0.3),
    "p3": (0.8, 0.45, 1.15, 0.2),
    "p4": (0.7, 0.0, 1.1, 0.0),
    "p5": (0.75, -0.30, 0.85, 0.1),
}
PATH_MOVES = (
    r"MoveJ p1,v100,fine,tGrip\WObj:=wTable;",
    r"MoveL p2,v100\V:=50,fine,tGrip\WObj:=wTable;",
    r"MoveC p3,p4,v100,fine,tGrip\WObj:=wTable; ! round",
    r"MoveL p5,v100,fine,tGrip\WObj:=wTable;",
)


@pytest.fixture(scope="module")
def robots():
    nominal = arm()
    return nominal, random_robot(nominal, "34", np.random.default_rng(1), size=0.3)


def text_of(T):
    numbers = notation.numbers_from_poses(T[None])[0]
    parts = [",".join(notation.number_text(v, 9) for v in part) for part in (numbers[:3], numbers[3:])]
    return f"[{parts[0]}],[{parts[1]}]"


def target(nominal, x, y, z, turn):
    """A robtarget in the work object with the tool."""
    T_tcp = frames.from_xyz_angles([x, y, z, np.pi, 0.4 + turn, 0.2])
    branches = closed_form.branches(nominal, T_tcp[None] @ frames.inverse(T_TOOL))
    q, inside = closed_form.with_configuration(nominal, branches, 0, np.radians([0, 0, 0, 0, 90, 180]))
    assert inside.all()
    conf = configuration_of(q[0], 0)
    return f"[{text_of(frames.inverse(WOBJ) @ T_tcp)},[{','.join(map(str, conf))}],{FAR}]"


def cell_module(nominal, *moves):
    lines = [
        "MODULE M",
        f"PERS tooldata tGrip:=[TRUE,[{text_of(T_TOOL)}],[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'PERS wobjdata wTable:=[FALSE,TRUE,"",[{text_of(WOBJ)}],[[0,0,0],[1,0,0,0]]];',
        "CONST zonedata zMine:=[FALSE,5,5,5,1,5,1];",
    ]
    lines += [f"CONST robtarget {name}:={target(nominal, *place)};" for name, place in PLACES.items()]
    return "\r\n".join([*lines, "PROC main()", *(f"  {move}" for move in moves), "ENDPROC", "ENDMODULE", ""]).encode()


def joints(nominal, T_tcp, near):
    """Joints of the nominal arm next to others, at first of branch 0."""
    T = T_tcp @ frames.inverse(T_TOOL)
    if not near.any():
        return closed_form.branches(nominal, T).joints[:, 0]
    found = any_arm.solve(Robot(nominal), nominal, T, seed=near, thorough=False)
    assert found.converged.all()
    return found.joints


def run(nominal, robot, data):
    """True places of the tool centre point on each move of a module, as its controller moves: list of (n, 3)."""
    program = parsed(data)
    moves = [stop for stop in program.stops() if stop.target is not None]
    tcp = dict(enumerate(WOBJ @ np.array([target.value for target in program.targets])))
    out, k, here = [], 1, tcp[moves[0].target]
    q = joints(nominal, here[None], np.zeros((1, 6)))[0]
    s = np.linspace(0, 1, 200)
    while k < len(moves):
        uses = program.targets[moves[k].target].uses
        via = any(use.line == moves[k].line and use.role == "via" for use in uses)
        there = tcp[moves[k + via].target]
        T = np.tile(np.eye(4), (200, 1, 1))
        T[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix(np.array([here[:3, :3], there[:3, :3]])))(s).as_matrix()
        T[:, :3, 3] = here[:3, 3] + s[:, None] * (there - here)[:3, 3]
        if via:
            T[:, :3, 3] = arc(here[:3, 3], tcp[moves[k].target][:3, 3], there[:3, 3], s)
        commanded = joints(nominal, T, np.repeat(q[None], 200, axis=0))
        out.append((robot.forward(commanded) @ T_TOOL)[:, :3, 3])
        q, here, k = commanded[-1], there, k + 1 + via
    return out


def arc(a, b, c, s):
    """Places on the arc from a over b to c, by the centre from perpendicular bisectors."""
    normal = np.cross(b - a, c - a)
    rows = np.array([b - a, c - a, normal])
    centre = np.linalg.solve(rows, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a])
    x, n = a - centre, normal / np.linalg.norm(normal)
    y = np.cross(n, x)
    angle = np.arctan2((c - centre) @ y, (c - centre) @ x) % (2 * np.pi)
    return centre + np.cos(s * angle)[:, None] * x + np.sin(s * angle)[:, None] * y


def away(wanted, places):
    """Largest distance of places from a finely sampled path."""
    a, b = wanted[:-1], np.diff(wanted, axis=0)
    rel = places[:, None] - a
    t = np.clip(np.einsum("ijk,jk->ij", rel, b) / np.sum(b * b, axis=1), 0, 1)
    return np.linalg.norm(rel - t[..., None] * b, axis=2).min(axis=1).max()


def test_the_true_tool_keeps_to_the_wanted_path(robots):
    nominal, robot = robots
    data = cell_module(nominal, *PATH_MOVES)
    wanted = run(nominal, Robot(nominal), data)
    plain = filter_program(parsed(data), CorrectionModel(robot, nominal, "abc"))
    found = filter_program(parsed(data), CorrectionModel(robot, nominal, "abc", path_tolerance=TOLERANCE))
    assert plain.paths is None
    assert found.unchanged_targets == ()
    uncut = [away(w, p) for w, p in zip(wanted, run(nominal, robot, plain.data), strict=True)]
    places = run(nominal, robot, found.data)
    assert list(found.paths_to_frame()["move"]) == ["MoveL p2", "MoveC p4", "MoveL p5"]
    at = 0
    for k, cut in enumerate(found.paths):
        off = max(away(wanted[k], piece) for piece in places[at : at + cut.pieces])
        at += cut.pieces
        assert off < TOLERANCE * 1.02
        assert off == pytest.approx(cut.deviation, abs=2e-6)
        assert uncut[k] == pytest.approx(cut.uncut, abs=2e-6)
        assert cut.pieces > 1
        assert uncut[k] > TOLERANCE
    assert at == len(places)
    lines = found.data.decode().split("\r\n")
    new = [line for line in lines if line.startswith("  MoveL [")]
    assert len(new) == found.paths[0].pieces + found.paths[2].pieces - 2
    assert all(line.endswith(r",v100\V:=50,z0,tGrip\WObj:=wTable;") for line in new[: found.paths[0].pieces - 1])
    # all else is as it was
    kept = [line for line in lines if line.startswith("  Move") and not line.startswith(("  MoveL [", "  MoveC"))]
    assert kept == [f"  {PATH_MOVES[0]}", f"  {PATH_MOVES[1]}", f"  {PATH_MOVES[3]}"]
    assert "joints that turn back" in "\n".join(map(str, found.report()))
    assert found.to_dict()["paths"][0]["pieces"] == found.paths[0].pieces


def test_joints_that_turn_back_are_named_where_they_do(robots):
    nominal, robot = robots
    data = cell_module(nominal, *PATH_MOVES)
    cut = filter_program(parsed(data), CorrectionModel(robot, nominal, "abc", path_tolerance=1e-3)).paths[0]
    ends = WOBJ @ np.array([target.value for target in parsed(data).targets[:2]])
    s = np.linspace(0, 1, 2001)
    T = np.tile(np.eye(4), (len(s), 1, 1))
    T[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix(ends[:, :3, :3]))(s).as_matrix()
    T[:, :3, 3] = ends[0, :3, 3] + s[:, None] * (ends[1] - ends[0])[:3, 3]
    q = np.unwrap(closed_form.branches(nominal, T @ frames.inverse(T_TOOL)).joints[:, 0], axis=0)
    turned = np.diff(np.sign(np.diff(q, axis=0)), axis=0)
    expected = sorted((int(joint) + 1, round(s[row + 1], 2)) for row, joint in np.argwhere(turned))
    assert expected
    assert sorted((turn.joint, round(turn.s, 2)) for turn in cut.turns) == expected


def test_points_stay_out_of_the_zones(robots):
    nominal, robot = robots
    moves = [move.replace("fine", "z50") for move in PATH_MOVES[:2]]
    found = filter_program(
        parsed(cell_module(nominal, *moves)), CorrectionModel(robot, nominal, "abc", path_tolerance=TOLERANCE)
    )
    cut = found.paths[0]
    assert cut.move.zones == (0.05, 0.05)
    program = parsed(found.data)
    inner = [k for k, t in enumerate(program.targets) if not t.name.startswith("p")]
    assert len(inner) == cut.pieces - 1 > 0
    ends = program.tip_poses([0, 1]) @ T_TOOL
    for T in program.tip_poses(inner) @ T_TOOL:
        assert min(np.linalg.norm((T - end)[:3, 3]) for end in ends) > 0.099


@pytest.mark.parametrize(
    ("moves", "words"),
    [
        ((PATH_MOVES[1],), "the program does not tell where it starts"),
        ((PATH_MOVES[0], "IF di1=1 THEN", PATH_MOVES[1], "ENDIF"), "the program does not tell where it starts"),
        ((PATH_MOVES[0], "IF di1=1 " + PATH_MOVES[1]), "the program does not tell where it starts"),
        ((PATH_MOVES[0], r"MoveL p2,v100,zMine,tGrip\WObj:=wTable;"), "a zone is not one of the predefined ones"),
        ((PATH_MOVES[0], r"MoveL p2,v100\T:=5,fine,tGrip\WObj:=wTable;"), r"no points are put into a move with \t"),
        ((PATH_MOVES[0], r"MoveL \Conc,p2,v100,fine,tGrip\WObj:=wTable;"), r"no points are put into a move with \conc"),
        ((PATH_MOVES[0], r"TriggL p2,v100,trig1,fine,tGrip\WObj:=wTable;"), "no points are put into TriggL"),
        (
            (PATH_MOVES[0], r"MoveL Offs(p1,0,0,1),v100,fine,tGrip\WObj:=wTable;"),
            "the program does not tell where it ends",
        ),
    ],
)
def test_what_may_not_be_cut_is_named(robots, moves, words):
    nominal, robot = robots
    found = filter_program(
        parsed(cell_module(nominal, *moves)), CorrectionModel(robot, nominal, "abc", path_tolerance=TOLERANCE)
    )
    reasons = [item.reason for item in found.unchanged_targets if item.target.startswith("the path of")]
    assert len(reasons) == 1
    assert words in reasons[0]
    assert found.data.count(b"Move") == sum("Move" in move for move in moves)


def test_an_end_that_the_path_does_not_lead_to_is_not_cut(robots):
    """Joint 6 would come to the end a whole turn from where its configuration data say."""
    nominal, robot = robots
    data = cell_module(nominal, *PATH_MOVES[:2]).decode()
    head, tail = data.split("p2:=")
    conf = re.search(r"\],\[(-?\d,-?\d,)(\d)(,0\])", tail)
    turned = tail[: conf.start(2)] + str(int(conf[2]) - 4) + tail[conf.end(2) :]
    found = filter_program(
        parsed((head + "p2:=" + turned).encode()), CorrectionModel(robot, nominal, "abc", path_tolerance=TOLERANCE)
    )
    assert "a configuration that the path does not lead to (joint 6)" in found.unchanged_targets[-1].reason


@pytest.mark.parametrize("axis", [b"5", b"-", b"-.", b"track"])
def test_moves_with_external_axes_are_not_cut(robots, axis):
    nominal, robot = robots
    data = cell_module(nominal, *PATH_MOVES[:2])
    old = FAR.encode() + b"];\r\nCONST robtarget p3"
    assert old in data
    moved = data.replace(old, old.replace(b"9E9", axis, 1))
    found = filter_program(parsed(moved), CorrectionModel(robot, nominal, "abc", path_tolerance=TOLERANCE))
    assert "there are external axes" in found.unchanged_targets[-1].reason
    # within a large tolerance nothing needs to be cut, whatever the axes
    whole = filter_program(parsed(moved), CorrectionModel(robot, nominal, "abc", path_tolerance=0.01))
    assert [cut.pieces for cut in whole.paths] == [1]
    assert whole.unchanged_targets == ()
    assert b"MoveL [" not in whole.data


def marked(content, fingerprint):
    program = parsed(content)
    return program.listing.files_with([program.mark(one_word(fingerprint), program.mark_at)])[program.source]


def marked_module(line):
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
    assert parsed(content).fingerprint is None
    new = marked(content, "12ab-cd")
    assert new.decode() == expected.format("! irbcal: fake targets, calibration 12ab-cd") + "ENDMODULE"
    seen = parsed(new)
    assert seen.fingerprint is not None
    assert seen.fingerprint == "12ab-cd"
    for wrong in ("", "a b", "a\n"):
        with pytest.raises(ValueError, match="one word"):
            marked(content, wrong)


def test_other_marks():
    assert parsed(marked_module("!Irbcal: fake targets")).fingerprint == ""
    assert parsed(marked_module('! not irbcal: fake targets\nf "! irbcal: fake targets";')).fingerprint is None


def test_the_mark_is_found_without_reading_the_module():
    content = marked_module("MoveL [[1,2,3")
    with pytest.raises(ProgramError):
        parsed(content)
    assert rapid.LANGUAGE.fingerprint(content) is None
    assert (
        rapid.LANGUAGE.fingerprint(content.replace(b"m\n", b"m\n! irbcal: fake targets, calibration 12ab-cd\n", 1))
        == "12ab-cd"
    )
    assert rapid.LANGUAGE.fingerprint(marked_module("!Irbcal: fake targets")) == ""
    with pytest.raises(ProgramError, match=r"m\.mod: expected a RAPID module"):
        rapid.LANGUAGE.fingerprint(b"PROC main() ENDPROC", "m.mod")


def test_only_numbers_that_change_are_written():
    seen = parsed(CELL.encode())
    k = named(seen, "jHome")
    value = np.radians([0, 10, -20, 30.25, 41.5, -90])
    ((start, end, text),) = seen.edits({k: value}, {})
    assert (CELL[start:end], text) == ("40", "41.5")


LINE = (
    "MoveAbsJ [[10.0000,-60.0000,95.5000,20.0000,30.1250,-40.0000],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,v100,fine,tool0;"
)


def test_joints_rests_and_speeds():
    files = written("rapid", "irb120")
    text = files["plan.mod"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\n    WaitTime 4.5;\n" in text
