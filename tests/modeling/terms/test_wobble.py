"""Wobble: the axis tilts and shifts as the joint turns."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, rail, some_joints

from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.wobble import FAMILY, SIZES


def test_terms_are_all_but_the_joint_map():
    terms = FAMILY.terms(arm("irb120"))
    assert {t.axis for t in terms} == {"rx", "ry", "tx", "ty", "tz"}
    assert {(t.unit, t.size) for t in terms} == {("rad", SIZES["r"]), ("m", SIZES["t"])}
    assert len({t.group for t in terms}) == 6 * 2 * 2
    by_group = {t.group for t in terms if t.axis[0] == "r"} & {t.group for t in terms if t.axis[0] == "t"}
    assert by_group == set()


def test_a_shifting_axis_shifts_the_tip():
    # joint 1 of the arm stands upright: a shift of its frame along z lifts the tip by the wave of its angle
    model = arm("irb120")
    terms = tuple(t for t in FAMILY.terms(model) if t.joint == 0 and t.axis == "tz")
    assert [(t.basis, t.parameters["cycles_per_turn"]) for t in terms] == [
        ("cos", 1),
        ("sin", 1),
        ("cos", 2),
        ("sin", 2),
    ]
    found = TermMap(model, terms, np.array([0.0, 1e-4, 2e-5, 0.0]))
    q = some_joints(10)
    shift = (found.forward(model, Motion(q)) - model.forward(q))[:, :3, 3]
    lift = 1e-4 * np.sin(q[:, 0]) + 2e-5 * np.cos(2 * q[:, 0])
    np.testing.assert_allclose(shift, np.column_stack([0 * lift, 0 * lift, lift]), rtol=0, atol=1e-15)


def test_derivatives(tmp_path):
    model = arm("irb120")
    assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0])
    assert 0 not in {t.joint for t in FAMILY.terms(rail(tmp_path))}
