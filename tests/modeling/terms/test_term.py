"""Single terms: names, JSON, refusals."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm
from term_cases import every_term, rail

from irbcal.errors import RobotError
from irbcal.modeling.terms.term import AXES, Term, own_axis, own_unit, revolute

FINITE = st.floats(-1e3, 1e3, allow_nan=False)
TERMS = st.builds(
    Term,
    joint=st.integers(0, 6),
    axis=st.sampled_from(AXES),
    basis=st.sampled_from(["cos", "gravity", "payload", "decay"]),
    size=st.floats(1e-9, 1.0),
    group=st.text(max_size=8),
    family=st.text(max_size=8),
    unit=st.sampled_from(["rad", "m", "1", "rad/(N m)"]),
    parameters=st.dictionaries(
        st.sampled_from(["cycles_per_turn", "link", "vector", "place", "tau", "width_rad"]),
        st.integers(0, 500) | FINITE | st.sampled_from(["x", "y"]) | st.tuples(FINITE, FINITE, FINITE),
    ),
    also=st.lists(st.integers(0, 6), max_size=2, unique=True).map(tuple),
)


@pytest.mark.parametrize(
    "wrong", [{"size": {}}, {"also": 3}, {"also": ["x"]}, {"joint": None}, {"std": []}, {"size": 10**400}]
)
def test_what_is_no_term_is_refused(wrong):
    entry = {"joint": 1, "axis": "rz", "basis": "cos", "cycles_per_turn": 2, "coefficient_rad": 1e-4} | wrong
    with pytest.raises(RobotError, match="not a term of a joint map"):
        Term.from_json(entry)


@settings(max_examples=30)
@given(TERMS, FINITE, st.floats(0.0, 1.0))
def test_terms_are_written_and_read(term, coefficient, std):
    again, value, deviation = Term.from_json(json.loads(json.dumps(term.to_json(coefficient, std))))
    assert again == term
    assert (value, deviation) == (coefficient, std)
    assert pickle.loads(pickle.dumps(term)) == term


def test_json_counts_joints_from_one_and_names_the_unit():
    term = Term(3, "rz", "cos", 5e-5, "gear_4_242", "gear", parameters={"cycles_per_turn": 242})
    assert term.name == "rz4 cos 242 gear"
    entry = term.to_json(3.1e-5, 4e-6)
    assert list(entry)[:5] == ["joint", "axis", "basis", "cycles_per_turn", "coefficient_rad"]
    assert (entry["joint"], entry["coefficient_rad"], entry["std"]) == (4, 3.1e-5, 4e-6)
    assert Term(0, "tx", "sin", 1.0, "", "", "m").to_json(1.0, 0.0)["coefficient_m"] == 1.0
    assert Term(0, "rz", "payload", 1.0, "", "", "rad/(N m)").to_json(1.0, 0.0)["unit"] == "rad/(N m)"
    assert Term(1, "rz", "gravity", 1.0, "", "", also=(2,)).name == "rz2+3 gravity"


def test_a_file_may_leave_out_what_only_identification_needs():
    term, coefficient, std = Term.from_json({"joint": 1, "axis": "rz", "basis": "q", "coefficient": 2})
    assert (term.family, term.group, term.size, term.unit) == ("q", "q", 1.0, "1")
    assert coefficient == 2.0
    assert np.isnan(std)


@pytest.mark.parametrize("entry", [{"joint": "one"}, {"coefficient": None}, {"joint": None}])
def test_what_is_not_a_term_is_refused(entry):
    whole = {"joint": 1, "axis": "rz", "basis": "q", "coefficient": 1.0}
    with pytest.raises(RobotError, match="not a term"):
        Term.from_json(whole | entry)
    with pytest.raises(RobotError, match="not a term"):
        Term.from_json({key: value for key, value in whole.items() if key not in entry})
    with pytest.raises(RobotError, match="axis"):
        Term.from_json(whole | {"axis": "rw"})


def test_terms_of_a_whole_arm_survive_json():
    for term in every_term(arm("irb120")):
        assert Term.from_json(json.loads(json.dumps(term.to_json(0.5, 0.1)))) == (term, 0.5, 0.1)


def test_own_axes(tmp_path):
    model = rail(tmp_path)
    assert [own_axis(model, j) for j in range(3)] == ["tz", "rz", "rz"]
    assert [own_unit(model, j) for j in range(2)] == ["m", "rad"]
    assert revolute(model) == [1, 2, 3, 4, 5, 6]
