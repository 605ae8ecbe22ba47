"""Elements of data with the places of their attributes."""

import pytest

from irbcal.correction.languages.val3.data import POSE, numbers, read, target
from irbcal.correction.listing import Listing

TEXT = """<?xml version="1.0"?><!-- note <Value x="9"/> -->
<Datas><Data name="p" type="pointRx" size="2">
<Value key="0" x="1.5" y='-2' z = "3" rx="0" ry="0" rz=" 90 " shoulder="lefty" elbow="epositive" wrist="wnegative"/>
<Value key="1" x="1" /></Data><Data name="f" type="frame"><Value key="0" z="5"/></Data>
<Code><![CDATA[begin movej(p[0],t,m) end]]></Code></Datas>"""


def test_what_is_found():
    listing = Listing([("a.dtx", TEXT.encode())], "VAL3")
    values, codes, comments = read(listing)
    assert [value.shown for value in values] == ["p[0]", "p[1]", "f[0]"]
    assert [TEXT[code.start : code.end] for code in codes] == ["begin movej(p[0],t,m) end"]
    assert len(comments) == 1
    one = target(values[0])
    assert [(n.value, TEXT[n.start : n.end]) for n in one.numbers] == [
        (1.5, "1.5"), (-2, "-2"), (3, "3"), (0, "0"), (0, "0"), (90, "90")
    ]  # fmt: skip
    assert one.posture[:3] == (False, False, -1)
    assert target(values[1]).reasons == ["not all of its numbers are written"]
    assert target(values[2]) is None
    assert [n.value for n in numbers(values[2], POSE, absent=True)] == [0, 0, 5, 0, 0, 0]


@pytest.mark.parametrize(("old", "reason"), [("righty", "righty"), ("xx", "not known")])
def test_postures_that_are_not_confirmed(old, reason):
    values, _, _ = read(Listing([("a.dtx", TEXT.replace("lefty", old).encode())], "VAL3"))
    assert reason in target(values[0]).reasons[0]
