"""What an evaluation says: as words, as tables, as JSON, point by point."""

import json

import numpy as np
import pytest

import irbcal
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.measurement.statistics import statistics


@pytest.fixture(scope="module")
def found(record):
    proof = robots.demo_file("demo_verification.csv")
    return irbcal.evaluate(record, proof, intervals=True, flange=True, relative="virtual")


def test_the_table_of_points_gives_the_statistics_back(found):
    frame = found.to_frame()
    for name in ("nominal", "calibrated"):
        again = statistics(frame[f"{name}_mm"].to_numpy() * 1e-3)
        assert {key: again[key] for key in ("n", "mean_mm", "max_mm")} == pytest.approx(
            {key: getattr(found, name)[key] for key in ("n", "mean_mm", "max_mm")}, rel=1e-12
        )
    of_target = frame[frame["target"] == "smr2"]["calibrated_mm"].mean()
    assert of_target == pytest.approx(found.per_target["smr2"]["calibrated"]["mean_mm"], rel=1e-12)


def test_everything_asked_for_is_told(found):
    text = found.summary()
    for words in ("SIMULATED", "Bootstrap intervals", "errors of the flange", "virtual frame", "Left out"):
        assert words in text, words
    assert f"{found.calibrated['mean_mm']:.3f}" in text


def test_what_was_not_asked_for_is_not_told(record):
    plain = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"))
    assert plain.intervals is None
    assert "Bootstrap" not in plain.summary()
    assert "flange" not in plain.summary()


def test_json_holds_what_scripts_rely_on(found):
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert set(content) >= {"nominal", "calibrated", "per_target", "per_group", "excluded", "notes", "simulated"}
    assert set(content["nominal"]) == {"n", "mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm", "rms_mm"}
    assert set(content["excluded"][0]) == {"pose", "target", "reason"}


def test_errors_of_poses_are_means_of_their_points(found):
    errors = found.errors.models["calibrated"]
    pose = int(found.errors.pose[100])
    mine = np.asarray(found.errors.pose) == pose
    assert errors.per_pose[pose] == pytest.approx(errors.distance[mine].mean(), rel=1e-12)


def test_options_are_checked(record):
    proof = robots.demo_file("demo_verification.csv")
    with pytest.raises(OptionError, match="relative: expected virtual or three-points, found 'real'"):
        irbcal.evaluate(record, proof, relative="real")
    with pytest.raises(OptionError, match="frame_points"):
        irbcal.evaluate(record, proof, frame_points=[("1", "smr1"), ("2", "smr1"), ("3", "smr1")])
