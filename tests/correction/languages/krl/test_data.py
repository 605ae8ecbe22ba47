"""Declarations and aggregates."""

import pytest

from irbcal.correction.languages.krl.data import Data, aggregate, target
from irbcal.correction.languages.krl.tokens import lines_of
from irbcal.correction.listing import Listing

P = "{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}"


def read(text, name="job.dat"):
    listing = Listing([(name, text.encode("latin-1"))], "KUKA KRL")
    data = Data(listing, [name.split(".", maxsplit=1)[0]])
    lines, _ = lines_of(listing)
    taken = [data.declaration(line) for line in lines]
    data.collect()
    return data, taken


@pytest.mark.parametrize(
    "text",
    [
        f"DECL E6POS XP1={P}",
        f"GLOBAL DECL E6POS XP1={P}",
        f"DECL GLOBAL E6POS Xp1={P}",
        f"e6pos xp1 = {P}",
        f"decl pos n, xP1={P}, m",
        f"DECL E6POS XP1={{E6POS: {P[1:]}",
    ],
)
def test_declarations(text):
    data, taken = read(text)
    assert taken == [True]
    (found,) = data.lookup(0, "xp1").found.values()
    assert [number.value for number in found.numbers] == [1, 2, 3, 4, 5, 6]
    assert found.posture.whole


def test_arrays_and_other_lines():
    data, taken = read(f"DECL FRAME v[3]\nDECL INT n=3\nLIN v\nENUM a b\nDECL E6POS q[2]={P}\n")
    assert taken == [True, True, False, True, True]
    assert data.lookup(0, "v").found == {}
    assert list(data.lookup(0, "q").found) == [(2,)]


def test_components_keep_their_places():
    text = "{E6POS: X 1.50, Y - 2 ,Z n+1,T 'B010'}"
    listing = Listing([("a.src", text.encode())], "KUKA KRL")
    (line,), _ = lines_of(listing)
    one = aggregate(line, listing)
    assert one.type == "e6pos"
    assert {key: text[v.start : v.end] for key, v in one.values.items()} == {
        "x": "1.50",
        "y": "- 2",
        "z": "n+1",
        "t": "'B010'",
    }
    assert one.values["y"].number.value == -2
    assert one.values["z"].number is None
    assert target("p", "", one, listing) == (None, "it has no A, so that the value before stays")


@pytest.mark.parametrize(
    ("status", "turn", "reason"), [("x", "2", "no number"), ("2", "16", "contradict"), ("6", "16", "")]
)
def test_status_and_turn(status, turn, reason):
    data, _ = read(f"DECL POS p={{X 1,Y 2,Z 3,A 4,B 5,C 6,S {status},T {turn}}}")
    (found,) = data.lookup(0, "p").found.values()
    assert (reason in "".join(found.reasons)) if reason else not found.reasons
