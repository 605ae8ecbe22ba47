"""Error parameters: names, levels, and what they change."""

import numpy as np
import pytest
from support import arm, on_a_rail
from thesis_formula import ThesisMap, apply

from irbcal.errors import IdentificationError
from irbcal.io import urdf
from irbcal.modeling import parameters


@pytest.mark.parametrize("level", ["nominal", "11", "16", "26", "34", "34b"])
def test_levels_have_as_many_parameters_as_their_names_say(level):
    """Nubiola 2011, section 5.4, counts six for the base; the nominal model has no others."""
    count = {"nominal": 6, "34b": 34}.get(level) or int(level)
    assert parameters.thesis_count(parameters.level_parameters(level)) == count


def test_levels_hold_the_deltas_of_their_tables():
    def names(level):
        return {p.name.removeprefix("delta_") for p in parameters.level_parameters(level)}

    assert names("11") == {f"theta{i}" for i in range(2, 7)}  # Table 5.4
    assert names("16") - names("11") == {"a2", "a3", "a4", "d4", "d6"}  # Table 5.5
    assert names("26") == {f"{kind}{i}" for kind in ("alpha", "a", "theta", "d") for i in range(2, 7)}  # Table 5.6
    assert names("34") - names("26") == {
        "stiffness_A",
        "stiffness_B",
        *(f"fourier_{n}" for n in ("a1", "b1", "a2", "b2")),
    }
    assert names("34b") ^ names("34") == {"d3", "beta3"}


def test_every_name_is_a_parameter_of_its_own(tmp_path):
    rail = urdf.read(on_a_rail(tmp_path / "rail.urdf"), "rail_base").arm
    for owner in (None, arm(), rail):
        names = parameters.all_names(owner)
        found = [parameters.parameter(name) for name in names]
        assert [p.name for p in found] == list(names)
        assert len({(p.kind, p.index) for p in found}) == len(names)
        assert all(p.unit == {"a": "m", "d": "m", "b": "m", "gain": "1"}.get(p.kind, "rad") for p in found)
        assert all(p.scale > 0 for p in found)
    placement = parameters.level_parameters("placement", rail)
    assert len(placement) == 6 * 6
    assert [p.name for p in parameters.level_parameters("offsets", rail)] == [f"delta_theta{i}" for i in range(2, 8)]


def test_each_parameter_changes_one_number():
    nominal = arm()
    for name in parameters.all_names(nominal):
        p = parameters.parameter(name)
        table, joint_map = apply([p], [p.scale], nominal.table, ThesisMap())
        before = {kind: getattr(nominal.table, kind) for kind in parameters.GEOMETRIC}
        before |= {kind: getattr(ThesisMap(), kind) for kind in ("gain", "stiffness", "fourier")}
        for kind, values in before.items():
            change = getattr(table if kind in parameters.GEOMETRIC else joint_map, kind) - values
            expected = np.zeros(len(values))
            if kind == p.kind:
                expected[p.index] = p.scale
            np.testing.assert_allclose(change, expected, rtol=0, atol=1e-15)


def test_levels_for_arms():
    ur_like = arm().with_table(apply([parameters.parameter("delta_a5")], [0.1], arm().table, ThesisMap())[0])
    assert parameters.default_level(arm()) == "34"
    assert parameters.default_level(ur_like) == "placement"
    assert parameters.levels_of(arm())[-1] == "placement"


def test_parameters_are_added_and_left_out_by_pattern():
    chosen = [
        p.name for p in parameters.selected_parameters("11", ["gain*", "delta_alpha[45]"], ["gain6", "delta_theta2"])
    ]
    assert chosen == [
        *(f"delta_theta{i}" for i in range(3, 7)),
        *(f"gain{i}" for i in range(1, 6)),
        "delta_alpha4",
        "delta_alpha5",
    ]


@pytest.mark.parametrize(
    ("call", "words", "named"),
    [
        (lambda: parameters.parameter("delta_theta0"), "unknown error parameter 'delta_theta0'", "delta_theta0"),
        (lambda: parameters.level_parameters("35"), "unknown model '35': choose one of nominal, 11, 16", "model"),
        (lambda: parameters.selected_parameters("34", ["gian*"]), "no error parameter is called 'gian", "gian*"),
    ],
)
def test_refusals_name_what_there_is(call, words, named):
    with pytest.raises(IdentificationError) as caught:
        call()
    assert words in str(caught.value)
    assert caught.value.parameter == named
