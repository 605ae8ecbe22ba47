"""An example as bytes."""

import pandas as pd

from irbcal.practice.sample import csv


def test_csv_has_line_feeds_and_no_formulas():
    table = pd.DataFrame({"name": ["=1+1", "smr1"], "x": [1.5, 2.0]})
    assert csv(table) == b"name,x\n'=1+1,1.5\nsmr1,2.0\n"
    assert csv(table[["x"]], sep=";", decimal=",") == b"x\n1,5\n2,0\n"
