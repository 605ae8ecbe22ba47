"""Sections, instructions with continuation lines, positions."""

from irbcal.correction.languages.fanuc.sections import instructions, points, sections
from irbcal.correction.listing import Listing

TEXT = b"""/PROG A
/MN
   1:  ! x ;
   2:C P[1]
    :  P[2] 5mm/sec ;
/POS
P[1:"a b"]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, -1, 1',
\tX =   -.070  mm,\tY = 2 mm,\tZ =  3  mm,
\tW = 1 deg,\tP = 2 deg,\tR = 3 deg,
\tE1=  5.000  mm
};
P[3]{
   GP2:
\tUF : 0, UT : 1,
\tJ1 =  5.000  mm
};
/END
"""


def test_everything_is_found_in_its_place():
    listing = Listing([("a.ls", TEXT)], "FANUC LS")
    places = sections(listing)
    assert list(places) == ["PROG", "MN", "POS", "END"]
    steps = instructions(listing, *places["MN"])
    assert [step.number for step in steps] == [1, 2]
    assert "P[2] 5mm/sec" in listing.text[steps[1].start : steps[1].end]
    one, other = points(listing, *places["POS"])
    assert [number.value for number in one.found.numbers] == [-0.07, 2, 3, 1, 2, 3]
    assert (one.user_frame, one.tool, one.found.external) == ("0", "1", "E1")
    assert [listing.text[slice(*span)] for span in one.found.posture_spans] == ["0", "-1", "1"]
    assert other.reason == "it is of another motion group"
