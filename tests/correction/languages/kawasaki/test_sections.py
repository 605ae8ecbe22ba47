"""Sections of a Kawasaki file."""

import pytest

from irbcal.correction.languages.kawasaki.sections import keyed, read
from irbcal.correction.listing import Listing

TEXT = (
    ".NETCONF     192.168.0.2,x\n.***---- comment\n.SYSDATA\nTOOL 1 2 3 4 5 6\n#p 9 9 9 9 9 9\n.END\n"
    '.PROGRAM main(.a) ; says JMOVE\n  .end_x = 1\n  PRINT "JMOVE #p"\n10 JMOVE #p[1 , 2]\n.END\n'
    ".TRANS\nshelf.open[1,1]   1.000000 -2 .5 1e1 0 0 -300\nshort 1 2 3\n.END\n"
    ".JOINTS\n#p[1,2] 1 2 3 4 5 6\n#P[ 1, 2 ] 1 2 3 4 5 7\np 1 2 3 4 5 6\n.END\n"
)


def test_only_programs_and_locations_are_read():
    found = read(Listing([("a.as", TEXT.encode())], "AS"))
    assert [line.program for line in found.lines if line.program] == ["main"]
    words = [[token.word for token in line.tokens] for line in found.lines if line.tokens]
    assert words == [[".end_x", "=", "1"], ["print", '"JMOVE #p"'], ["10", "jmove", "#p", "[", "1", ",", "2", "]"]]
    assert list(found.names) == ["shelf.open", "short", "#p"]
    shelf = found.locations["shelf.open[1,1]"]
    assert [number.value for number in shelf.numbers] == [1.0, -2.0, 0.5, 10.0, 0.0, 0.0]
    assert [TEXT[number.start : number.end] for number in shelf.numbers] == ["1.000000", "-2", ".5", "1e1", "0", "0"]
    assert (shelf.external, shelf.reasons) == ("JT7", [])
    assert found.locations["short"].reasons == ["its six numbers are not understood"]
    assert found.locations["#p[1,2]"].reasons == ["there are two of this name"]
    assert [found.locations[key].reasons for key in found.numbered["#p[1,2]"]] == [["there are two of this name"]] * 2
    assert TEXT[found.begins[0] :].startswith("  .end_x")


@pytest.mark.parametrize(("name", "index", "key"), [("#P", None, "#p"), ("a.b", " 1 ,2", "a.b[1,2]")])
def test_names_are_looked_up_without_case_and_blanks(name, index, key):
    assert keyed(name, index) == key
