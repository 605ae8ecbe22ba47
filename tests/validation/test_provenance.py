"""Where an evaluation comes from: what was told, hashes of files as sha256sum has them, and new poses counted."""

import hashlib
from pathlib import Path

import pandas as pd
import pytest

import irbcal
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.validation.provenance import FIELDS, checked_info


@pytest.fixture(scope="module")
def fitted():
    return robots.demo_file("demo_identification.csv")


@pytest.fixture(scope="module")
def made(fitted, tmp_path_factory):
    folder = tmp_path_factory.mktemp("origin") / "cal"
    irbcal.calibrate(fitted, "irb1600", "26").save(folder)
    return folder


def test_hashes_and_counts(made, fitted):
    found = irbcal.evaluate(made, fitted)
    files = {item.purpose: item for item in found.origin.files}
    assert files["measurements"].sha256 == hashlib.sha256(Path(fitted).read_bytes()).hexdigest()
    assert files["calibration"].sha256 == hashlib.sha256((made / "calibration.json").read_bytes()).hexdigest()
    assert files["calibrated URDF"].sha256 == hashlib.sha256((made / "calibrated.urdf").read_bytes()).hexdigest()
    assert all("/" not in item.name for item in found.origin.files)
    record = irbcal.load(made).record
    assert found.origin.counted_out == record.poses_fit
    assert found.origin.fitted == 0
    poses = record.poses
    known = {name for name, heldout in zip(poses.pose, poses.heldout, strict=True) if not heldout}
    new = len(found.errors.pose_names)
    assert known.isdisjoint(found.errors.pose_names)
    assert found.origin.unseen == new >= record.poses_heldout
    assert found.origin.joints.shape == (new, 6)
    kept = irbcal.evaluate(made, fitted, include_fitted=True).origin
    assert (kept.counted_out, kept.unseen) == (0, new)


def test_poses_measured_anew_at_fitted_joints_are_counted_out(made, fitted):
    again = pd.read_csv(fitted)
    again.loc[~again["target"].str.startswith("ref"), "x_mm"] += 0.03
    assert irbcal.evaluate(made, again).origin.counted_out == irbcal.load(made).record.poses_fit


def test_columns_and_options_tell(made, fitted):
    table = pd.read_csv(fitted).assign(operator="Ann", temperature_c=21.5, serial_number="7")
    table.loc[table["pose"] > 60, "temperature_c"] = 22.0
    found = irbcal.evaluate(made, table, info={"Serial": "1600-1", "tracker-certificate": "F 77", "hall": "B"})
    told = dict(found.origin.stated())
    assert told["Operator"] == "Ann"
    assert told["Temperature"] == "21.5 to 22 °C"
    assert told["Serial number"] == "1600-1", "what is told outright counts before a column"
    assert told["Tracker certificate"] == "F 77"
    assert told["Hall"] == "B"
    assert told["Robot type"] == ""
    assert list(told)[: len(FIELDS)] == list(FIELDS.values())


@pytest.mark.parametrize(
    ("info", "words"),
    [
        ({"serial": "1", "serial_number": "2"}, "given twice"),
        ({"operator": "a\nb"}, "printable"),
        ({"operator": "x" * 61}, "at most 60"),
        ({"": "x"}, "expected a name"),
        ({f"k{k}": "x" for k in range(11)}, "at most 10"),
        (["operator"], "expected names"),
    ],
)
def test_what_cannot_be_told_is_refused(info, words):
    with pytest.raises(OptionError, match=words):
        checked_info(info)
