"""Rewriting targets in a text: the numbers change, and no other byte ever does."""

import numpy as np
import pytest
from rapid_modules import CELL, EXT, module, named, pose

from irbcal.correction import text_program as programs
from irbcal.correction.configurations import ConfData
from irbcal.correction.languages import rapid
from irbcal.errors import ProgramError
from irbcal.modeling import frames


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_unchanged_programs_are_the_same_bytes(encoding, newline):
    content = (
        CELL.replace("a comment", "Größe Ångström").replace("pRest", "pRüst").replace("\n", newline).encode(encoding)
    )
    seen = rapid.parse(content)
    assert seen.data == content
    assert programs.with_targets(seen, {}) == content
    same = {k: target.value for k, target in enumerate(seen.targets)}
    assert programs.with_targets(seen, same) == content
    assert seen.targets[named(seen, "pRüst")].line == 6
    new = programs.with_targets(seen, {1: pose(7, 8, 9)})
    assert new == content.replace(b"[1.5E2, - 20 , +3]", b"[7, 8 , 9]")


def test_one_target_changes_only_its_numbers():
    seen = rapid.parse(CELL.encode())
    text = CELL
    for name, value, old, new in [
        ("pRest", pose(150, -20.0000001, 3.0000019), "+3]", "3.000002]"),  # what does not change keeps its text
        ("pRow{2}", pose(4, -0.00000001, 1e-5 / 3, frames.rot_z(0.2)), "[[4,5,6],[1,0,0,0]", "[[4,0,0.000003],[0.995004165,0,0,0.099833417]"),
        ("jHome", np.radians([0, 10, -20, 30.25, 123456.7890126, -179.5]), "30.25,40,-90]", "30.25,123456.789013,-179.5]"),
        ("p10", pose(1e7, -0.5, -1, frames.rot_x(-np.pi)), "[[100,-.5,1.]", "[[10000000,-.5,-1]"),  # -q is not nearer
    ]:  # fmt: skip
        written = programs.with_targets(seen, {named(seen, name): value})
        assert written.decode() == text.replace(old, new)
        assert text.count(old) == 1


def test_configurations_are_rewritten():
    seen = rapid.parse(CELL.encode())
    k = named(seen, "p10")
    written = programs.with_targets(seen, {}, {k: ConfData(0, 2, -3, 1)})
    assert written.decode() == CELL.replace("[0,-1,-2,1]", "[0,2,-3,1]")
    computed = rapid.parse(
        module("MoveL p10,v1,fine,tool0;", data=f"CONST robtarget p10:=[[1,2,3],[1,0,0,0],conf,{EXT}];"), "m"
    )
    assert computed.correctable() == [0]
    with pytest.raises(ProgramError, match="m: line 2: target p10 has no configuration in numbers to rewrite"):
        programs.with_targets(computed, {}, {0: ConfData(0, 0, 0, 0)})


@pytest.mark.parametrize(
    "value", [np.zeros(6), np.full((4, 4), np.nan), np.diag([2.0, 1, 1, 1]), np.diag([-1.0, 1, 1, 1])]
)
def test_values_that_cannot_be_written_are_refused(value):
    seen = rapid.parse(module("MoveL p10,v1,fine,tool0;"))
    with pytest.raises(ValueError, match="expected"):
        programs.with_targets(seen, {0: value})
