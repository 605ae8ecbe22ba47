"""Points without a family of terms, against models that never had it."""

import numpy as np
from support import arm, measured, random_robot
from term_cases import framed_robot
from thesis_formula import ThesisMap

from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import family_in_words
from irbcal.modeling.terms.term_map import TermMap
from irbcal.viewer import scene as viewed


def test_parts_of_the_thesis_are_left_out_one_by_one():
    truth = random_robot(arm("irb1600"), "34", np.random.default_rng(2))
    nominal, map_34 = truth.joint_map.terms.arm, ThesisMap.from_joint_map(truth.joint_map)
    own = ThesisMap(np.full(6, 1e-4), map_34.stiffness, map_34.phases, map_34.fourier)
    truth = truth.replace(joint_map=own.joint_map(nominal))
    points = measured(truth, truth.arm.random_joints(20, 1), 0.0, np.random.default_rng(3))
    T = frames.inverse(truth.T_world_base)
    shifts = viewed.shifts(truth, points, T)
    assert list(shifts) == ["gain", "arm stiffness and joint-6 series"]
    plain = {
        "gain": ThesisMap(np.zeros(6), own.stiffness, own.phases, own.fourier),
        "thesis": ThesisMap(own.gain),
    }
    for family, joint_map in plain.items():
        expected = frames.apply(T, points.predicted(truth.replace(joint_map=joint_map.joint_map(nominal))))
        expected -= frames.apply(T, points.predicted(truth))
        assert np.abs(expected).max() > 1e-5
        np.testing.assert_allclose(shifts[family_in_words(family)], expected, rtol=0, atol=1e-12)
    # several together are the sum, but for products of small angles
    together = frames.apply(T, points.predicted(truth.replace(joint_map=JointMap.identity(nominal))))
    together -= frames.apply(T, points.predicted(truth))
    np.testing.assert_allclose(sum(shifts.values()), together, rtol=0, atol=2e-5)
    assert viewed.families(truth.replace(joint_map=JointMap.identity(nominal))) == []


def test_terms_and_frame_terms_are_left_out_as_if_they_were_not_there():
    truth = framed_robot("irb120", np.random.default_rng(5))
    points = measured(truth, truth.arm.random_joints(12, 1), 0.0, np.random.default_rng(3))
    names = viewed.families(truth)
    assert {"gravity", "bending"} <= set(names)
    for family in names:
        terms, frame_terms = (dropped(part, family) for part in (truth.joint_map.terms, truth.frame_terms))
        bare = truth.replace(joint_map=JointMap(terms), frame_terms=frame_terms)
        found = points.predicted(viewed.without(truth, family))
        np.testing.assert_allclose(found, points.predicted(bare), rtol=0, atol=1e-12)


def dropped(terms, family):
    keep = np.array([term.family != family for term in terms.terms])
    return TermMap(terms.arm, tuple(np.array(terms.terms, dtype=object)[keep]), terms.coefficients[keep])
