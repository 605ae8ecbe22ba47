"""Numbers in the text of exports."""

import numpy as np

from irbcal.exporting.written import cpp, line


def test_numbers_keep_their_last_digit():
    values = np.random.default_rng(0).standard_normal((2, 3)) * 10.0 ** np.array([-20, 0, 20])
    assert np.array_equal(eval(cpp(values).replace("{", "(").replace("}", ")")), values)


def test_other_values():
    assert cpp([True, 3, np.nan, -np.inf]) == "{true, 3, data::nan, -data::inf}"


def test_names_cannot_leave_their_comment():
    assert line('a\nb"""c\\') == "a b'''c/"
