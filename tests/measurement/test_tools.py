"""A tool per payload: names of targets."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import table, tools


def seen(loads):
    n = len(loads)
    frame = pd.DataFrame(np.random.default_rng(0).uniform(-90, 90, (n, 6)), columns=[f"q{k}_deg" for k in range(1, 7)])
    frame.insert(0, "pose", [f"p{k}" for k in range(n)])
    frame = frame.assign(x_mm=100.0, y_mm=200.0, z_mm=300.0, payload_kg=loads)
    return table.read(pd.concat([frame.assign(target=name) for name in ("smr1", "ref1")]))


def names(measurements):
    return list(measurements.table["target"])


def test_the_load_of_most_poses_keeps_the_names():
    measurements = seen([0.0, 3.0, 3.0, np.nan])
    assert tools.usual(measurements) == 3.0
    assert tools.usual(seen([3.0, 0.0])) == 0.0  # as many: the last one
    assert tools.usual(seen([np.nan])) is None
    assert tools.several_loads(measurements)
    assert not tools.several_loads(seen([3.0, np.nan]))
    named = tools.with_tool_per_load(measurements, 3.0)
    assert names(named) == ["smr1@0kg", "smr1", "smr1", "smr1", *["ref1"] * 4]
    assert names(measurements)[0] == "smr1"
    assert tools.with_tool_per_load(measurements, None) is measurements


def test_names_are_those_of_the_calibration():
    known = ("smr1", "smr1@0kg")
    found, notes = tools.as_calibrated(seen([0.0, 3.0, 5.0]), known, 3.0)
    assert names(found)[:3] == ["smr1@0kg", "smr1", "smr1@5kg"]
    assert "5 kg is not known" in notes[0]
    found, notes = tools.as_calibrated(seen([0.0, 3.0, 5.0]), known, 3.0, same_tool=True)
    assert names(found)[:3] == ["smr1@0kg", "smr1", "smr1"]
    assert "taken to be where they were with 3 kg for 5 kg" in notes[0]
    with pytest.raises(MeasurementError, match="5, 7 kg is not known"):
        tools.as_calibrated(seen([5.0, 7.0]), known, 3.0)
    # a calibration without a tool for each load asks no questions
    measurements = seen([5.0])
    assert tools.as_calibrated(measurements, ("smr1", "smr2"), 3.0) == (measurements, [])
