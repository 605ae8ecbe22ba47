"""Tables that are kept and handed out as copies."""

import copy
import pickle
from dataclasses import dataclass, replace

import pandas as pd
import pytest

from irbcal.measurement.imports.reader import ReadOnlyTables


@dataclass(frozen=True, eq=False)
class Pair(ReadOnlyTables):
    """Two tables and a name."""

    one: pd.DataFrame
    name: str
    two: pd.DataFrame | None


def test_tables_are_copied_on_the_way_in_and_out():
    frame = pd.DataFrame({"a": [1, 2]})
    pair = Pair(frame, "n", None)
    frame.loc[0, "a"] = 7
    handed = pair.one
    handed.loc[0, "a"] = 8
    pair.one["a"].array[1] = 9
    assert pair.one["a"].tolist() == [1, 2]
    assert pair.two is None
    with pytest.raises(AttributeError, match="'Pair' object has no attribute 'three'"):
        _ = pair.three


def test_they_are_replaced_copied_and_pickled_as_others():
    pair = Pair(pd.DataFrame({"a": [1]}), "n", pd.DataFrame({"b": [2]}))
    for other in (replace(pair, name="m"), copy.copy(pair), copy.deepcopy(pair), pickle.loads(pickle.dumps(pair))):
        assert other.one.equals(pair.one)
        assert other.two.equals(pair.two)
    assert replace(pair, one=pair.two).one.equals(pair.two)
