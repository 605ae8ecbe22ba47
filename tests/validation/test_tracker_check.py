"""The door to the checks of the tracker: which check a file is for, and options."""

import pickle

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import OptionError
from irbcal.validation.settling import Settling
from irbcal.validation.tracker_check import CHECKS, PointDrift, PointRepeatability, ScaleBar, kind, tracker

N = 60
X, Y, Z = np.round(np.random.default_rng(0).normal(0, 0.004, (3, N)), 6)
END = np.tile(["A", "B"], N // 2)
TIME = np.tile(np.arange(20) * 0.75, 3)
TABLES = {
    "bar": {"end": END, "x_mm": X + 1000 * (END == "B"), "y_mm": Y, "z_mm": Z},
    "repeat": {"x_mm": X + 900, "y_mm": Y, "z_mm": Z},
    "drift": {"time_s": 17 * np.arange(N), "x_mm": X + 5, "y_mm": Y, "z_mm": Z, "temperature_c": 22 + X},
    "settle": {
        "run": np.repeat([1, 2, 3], 20),
        "time_s": TIME,
        "x_mm": 1 + np.exp(-2 * TIME),
        "y_mm": 0 * Y + 3,
        "z_mm": 0 * Z,
    },
}
KINDS = {"bar": ScaleBar, "repeat": PointRepeatability, "drift": PointDrift, "settle": Settling}


def file_of(folder, name):
    pd.DataFrame(TABLES[name]).to_csv(folder / f"{name}.csv", index=False)
    return folder / f"{name}.csv"


@pytest.mark.parametrize("name", CHECKS)
def test_the_columns_tell_which_check(name, tmp_path):
    path = file_of(tmp_path, name)
    assert kind(path) == name
    found = tracker(path, length=1.0)
    assert isinstance(found, KINDS[name])
    assert found.to_dict()["check"] == name
    assert len(found.to_frame()) == (N // 2 if name == "bar" else N)
    assert len(repr(found)) < 2000
    assert found.headline()
    assert found._repr_html_().startswith("<div>")
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    assert found.plot().content("png").startswith(b"\x89PNG")


@pytest.mark.parametrize("name", CHECKS)
def test_frames_serve_as_files_do(name, tmp_path):
    from_file, from_frame = (
        tracker(source, length=1.0) for source in (file_of(tmp_path, name), pd.DataFrame(TABLES[name]))
    )
    assert from_frame.to_dict() == from_file.to_dict()


def test_options(tmp_path):
    path = file_of(tmp_path, "settle")
    assert tracker(path).band == 2e-5
    assert tracker(path, band=1e-3, rest=3.0).rest == 3.0
    assert isinstance(tracker(path, check="repeat"), PointRepeatability), "if that is what is asked for"
    with pytest.raises(OptionError, match="certified length") as refused:
        tracker(file_of(tmp_path, "bar"))
    assert refused.value.parameter == "length"
    with pytest.raises(OptionError, match="check: expected bar, repeat, drift or settle, found 'ball'"):
        tracker(path, check="ball")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"length": 1050.688}, "metres expected, at most 100, found 1050.69: this looks like millimetres"),
        ({"length": "1"}, "expected a number, found '1'"),
        ({"band": 200}, "looks like millimetres"),
        ({"rest": -1}, "at least 0, found -1"),
    ],
)
def test_sizes_are_numbers_in_metres(tmp_path, options, words):
    with pytest.raises(OptionError, match=words) as refused:
        tracker(file_of(tmp_path, "bar"), **options)
    assert refused.value.parameter == next(iter(options))
