"""Frames that a module needs and does not define."""

import numpy as np
import pytest
from rapid_modules import TOOLS, USE, P, module, pose, refused

from irbcal.correction.languages import rapid
from irbcal.modeling import frames


def test_frames_from_the_caller():
    content = module(r"MoveL p10,v1,z1,tGrip\WObj:=wFix;")
    assert refused(content) == (
        "line 4: MoveL uses the tool tgrip, which this module does not define: give its frame (also: work object wfix in line 4)"
    )
    T = pose(1, 2, 3, frames.rot_y(0.3))
    assert "uses the work object wfix, which" in refused(content, tools={"TGRIP": T})
    seen = rapid.parse(content, tools={"TGRIP": T}, work_objects={"wFix": T})
    assert seen.correctable() == [0]
    assert np.array_equal(seen.tools["tgrip"], T)
    over = rapid.parse(module(USE, data=TOOLS + f"VAR robtarget p10:={P};"), tools={"ta": T})
    assert np.array_equal(over.tools["ta"], T)
    with pytest.raises(ValueError, match="frame a: expected a transform"):
        rapid.parse(content, tools={"a": np.eye(3)})
    # what is not corrected needs no frame
    assert rapid.parse(module("MoveL Offs(p10,0,0,1),v1,z1,tGrip;")).tools == {}
    assert rapid.parse(module("MoveL p10,v1,z1,tGrip;", "f p10;")).tools == {}
