"""Which level the data support."""

import pickle

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError, OptionError
from irbcal.identification.fit import choose_level


def test_the_level_is_chosen_by_what_the_data_support():
    nominal = arm()
    rng = np.random.default_rng(9)
    for level in ("nominal", "11", "34"):
        truth = random_robot(nominal, level, rng, size=0.3)
        choice = choose_level(nominal, measured(truth, nominal.random_joints(60, 1), 5e-5, rng))
        assert choice.level == level
        assert [row.level for row in choice.table] == ["nominal", "11", "16", "26", "34", "34b", "placement"]
        for row in choice.table[1:]:
            assert row.chosen == (row.gain_mm > row.gain_std_mm)
        assert choice.explanation.count(". ") == 1
    short = choose_level(nominal, measured(truth, nominal.random_joints(10, 1), 5e-5, rng))
    assert any("unknowns of level 34" in row.refused for row in short.table) or short.table[-1].mean_mm is not None


def test_the_choice_speaks_and_can_be_pickled():
    nominal = arm()
    rng = np.random.default_rng(9)
    points = measured(random_robot(nominal, "11", rng), nominal.random_joints(9, 1), 5e-5, rng)
    choice = choose_level(nominal, points, levels=("nominal", "11", "34"))
    assert choice.told()[0] == choice.explanation == choice.headline()
    assert repr(choice) == f"<Choice: {choice.explanation}>"
    shown = [line.split() for line in choice.summary().splitlines()]
    for row in choice.table:
        assert [row.level, f"{row.mean_mm:.3f}"] in [words[:2] for words in shown]
    frame = choice.to_frame()
    assert list(frame["level"]) == ["nominal", "11", "34"]
    assert frame["mean_mm"][1] == choice.table[1].mean_mm
    again = pickle.loads(pickle.dumps(choice))
    assert again.table == choice.table


def test_refused_levels_say_why():
    nominal = arm()
    rng = np.random.default_rng(9)
    points = measured(random_robot(nominal, "11", rng), nominal.random_joints(5, 1), 5e-5, rng)
    choice = choose_level(nominal, points, levels=("nominal", "34"))
    assert choice.table[1].refused in choice.told()[-1]
    with pytest.raises(IdentificationError):
        choose_level(nominal, points, levels=("34", "nominal"))
    with pytest.raises(OptionError, match=r"levels: expected nominal, 11, .* found '12'"):
        choose_level(nominal, points, levels=("12",))
