"""Calibrations side by side: the same figures as evaluations one by one, fitted poses of all counted out."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError, OptionError
from irbcal.io import robots

FIT = robots.demo_file("demo_identification.csv")


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    table = pd.read_csv(robots.demo_file("demo_verification.csv"))
    path = tmp_path_factory.mktemp("compare") / "v.csv"
    table[table["pose"].isin(table["pose"].unique()[::10])].to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def three(calibrated, tmp_path_factory):
    root = tmp_path_factory.mktemp("three")
    return [calibrated(root / f"m_{model}&", model) for model in ("11", "34", "26")]


@pytest.fixture(scope="module")
def found(three, proof):
    return irbcal.compare(three, proof)


def test_figures_are_those_of_evaluations(three, proof, found):
    assert found.names == ("m_11&", "m_34&", "m_26&")
    for k, folder in enumerate(three):
        one = irbcal.evaluate(folder, proof)
        mine = found.statistics[found.names[k]]
        assert mine["mean_mm"] == pytest.approx(one.calibrated["mean_mm"], abs=1e-12)
        assert mine["p95_mm"] == pytest.approx(one.percentiles["calibrated"]["p95_mm"], abs=1e-12)
        table = one.to_frame()
        means = table.groupby("pose", sort=False)["calibrated_mm"].mean()
        assert found.error_mm[:, k] == pytest.approx(means.loc[list(found.poses)].to_numpy(), abs=1e-12)
    assert found.statistics["nominal"]["mean_mm"] == pytest.approx(one.nominal["mean_mm"], abs=0.02)
    assert found.trusted


def test_the_verdict_names_the_best(found):
    assert found.ranking[0] == "m_34&"
    words = found.verdict()
    assert words.startswith("On these 100 SIMULATED poses m_34& has the smallest mean error")
    assert "better than m_11& by" in words
    best = {(pair.better, pair.worse): pair for pair in found.pairs}["m_34&", "m_11&"]
    assert best.told_apart
    low, high = best.interval_mm
    assert low < best.difference_mm < high
    gain = found.error_mm[:, 0] - found.error_mm[:, 1]
    assert best.difference_mm == pytest.approx(gain.mean(), abs=1e-12)
    # three intervals at once are wider than one of 95 %, about as normal quantiles tell (2.394 against 1.960)
    assert high - low == pytest.approx(2 * 2.394 * gain.std(ddof=1) / np.sqrt(len(gain)), rel=0.15)


def test_one_and_the_same_is_not_told_apart(three, proof):
    twice = irbcal.compare({"a": three[1], "b": three[1]}, proof)
    assert "not told apart from b" in twice.verdict()
    assert not twice.pairs[0].told_apart


def test_fitted_poses_of_any_are_counted_out(three):
    table = pd.read_csv(FIT)
    half = table["pose"].unique()[1::2]
    other = irbcal.calibrate(table[table["pose"].isin(half)], "irb1600", "26", holdout=0)
    pair = {"one": three[0], "half": other}
    known = {
        str(name)
        for record in (irbcal.load(three[0]).record, other.record)
        for name, heldout in zip(record.poses.pose, record.poses.heldout, strict=True)
        if not heldout
    }
    found = irbcal.compare(pair, FIT)
    assert known.isdisjoint(found.poses)
    assert found.counted_out == len(known)
    kept = irbcal.compare(pair, FIT, include_fitted=True)
    assert set(kept.fitted_by) == {"one", "half"}
    assert kept.verdict().startswith("NO PROOF")
    assert not kept.trusted
    fitted = table[table["pose"].astype(str).isin(other.record.poses.pose)]
    with pytest.raises(MeasurementError, match=r"calibration half: .*prove nothing"):
        irbcal.compare(pair, fitted)


def test_names_and_wrong_calls(three, proof):
    assert irbcal.compare([three[0], three[0], irbcal.load(three[1])], proof).names[0] == "m_11&"
    for wrong in (three[0], [three[0]], {}, {"nominal": three[0], "b": three[1]}):
        with pytest.raises(OptionError, match="calibrations"):
            irbcal.compare(wrong, proof)


def test_the_command_and_its_files(three, proof, tmp_path):
    call = ["compare", *three, "--measurements", proof]
    files = ["--csv", tmp_path / "c.csv", "--latex", tmp_path / "c.tex", "--plots", tmp_path / "p"]
    done = CliRunner().invoke(app, [str(word) for word in [*call, *files]])
    assert done.exit_code == 0, done.output
    assert "SIMULATED data: position errors" in done.stdout
    rows = pd.read_csv(tmp_path / "c.csv")
    assert list(rows) == ["pose", "group", "m_11&_mm", "m_34&_mm", "m_26&_mm", "simulated"]
    text = (tmp_path / "c.tex").read_text()
    assert r"m\_34\& (34)" in text
    assert not re.search(r"(?<!\\)[_%]", text.replace("% SIM", "SIM"))
    assert {path.name for path in (tmp_path / "p").iterdir()} == {"by_pose.png", "shares.png"}
    found = json.loads(CliRunner().invoke(app, [str(word) for word in [*call, "--json"]]).stdout)
    assert found["ranking"][0] == "m_34&"
    assert len(found["per_pose"]["pose"]) == found["poses"] == 100
    alone = CliRunner().invoke(app, ["compare", str(three[0]), "--measurements", str(proof)])
    assert alone.exit_code == 2
