"""What a calibration is worth: an ideal robot, statistics of the rows, expected against found."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from irbcal.modeling.thesis_map import ThesisMap
from irbcal.simulation import simulation
from irbcal.studies import folder, trial
from irbcal.studies.settings import AREAS, NOMINAL, Repetition
from irbcal.studies.stage import Stage


def test_without_errors_that_the_model_lacks_fake_targets_reach_the_nominal_poses(small, monkeypatch):
    """Rigid links, no effects: expected and found errors of every kind vanish, with the nominal robot they do not."""
    ideal = simulation.open_cell("irb1600").only().replace(compliance=(0.0,) * 6, joint_map=ThesisMap(np.zeros(6)))
    monkeypatch.setattr(simulation, "open_cell", lambda *args, **options: ideal)
    perfect = Stage.of(small)
    rows = pd.DataFrame(trial.run(perfect, Repetition("34", 80))[0])
    kinds = {"expected", "verified", "poses", "iso9283", "sphere_virtual_frame", "sphere_three_points"}
    assert set(rows["kind"]) == kinds
    assert rows.loc[rows["unit"] == "mm", "max"].max() < 1e-5
    assert rows.loc[rows["unit"] == "deg", "max"].max() < 1e-6
    # without correction found and expected errors of the same poses are the same thing, and not small
    every = replace(perfect, settings=replace(small, points=8 * small.points))
    rows = pd.DataFrame(trial.run(every, NOMINAL)[0]).set_index(["kind", "area", "payload_kg", "targets"])
    for area in AREAS:
        expected, found = rows.loc[[("expected", area, 3, "1-8"), ("verified", area, 3, "1-8")], "mean"]
        assert found == pytest.approx(expected, abs=1e-9)
        assert expected > 0.4


def test_every_repetition_has_a_seed_of_its_own_and_rows_are_those_of_its_errors(small, done, frame, tmp_path):
    repetition = Repetition("34", 120, 2)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "34-120-2.npz").write_bytes(done[repetition][1])
    series = folder.read_series(tmp_path, repetition)
    before = frame[frame["repetition"] == "34-120-2"]
    assert set(before["seed"]) == {repetition.seed(small)}
    other = frame[frame["repetition"] == "34-120-1"]
    assert set(other["seed"]) != set(before["seed"])
    assert (other["mean"].to_numpy() != before["mean"].to_numpy()).all()
    assert repetition.seed(replace(small, seed=5)) != repetition.seed(small)
    values = series["verified/all_range/6/point"]
    row = before[(before["kind"] == "verified") & (before["area"] == "all_range") & (before["payload_kg"] == 6)]
    assert row["sigma"].item() == pytest.approx(np.std(values, ddof=1), abs=1e-5)
    assert row["rms"].item() == pytest.approx(np.sqrt(np.mean(np.square(values))), abs=1e-5)
    assert row["p75"].item() == pytest.approx(np.percentile(values, 75), abs=1e-5)


def test_expected_and_found_agree_and_least_squares_halves_the_nominal_error(frame):
    main = frame[(frame["targets"] == "1-8") & (frame["model"] == "34")].drop_duplicates(
        ["repetition", "kind", "area", "payload_kg"]
    )
    pivot = main.pivot_table(index=["repetition", "area", "payload_kg"], columns="kind", values="mean")
    pivot = pivot.dropna(subset=["expected", "verified"])  # the poses of the other tests are elsewhere
    assert len(pivot) == 5 * 4
    ratio = (pivot["verified"] / pivot["expected"]).to_numpy()
    assert 0.75 < ratio.min() < ratio.max() < 1.35
    nominal = frame[(frame["repetition"] == "nominal") & (frame["kind"] == "verified")]["mean"].min()
    assert pivot["verified"].max() < 0.5 * nominal


def test_mean_plus_three_sigma_and_order_of_percentiles(frame):
    np.testing.assert_allclose(frame["mean_plus_3sigma"], frame["mean"] + 3 * frame["sigma"], rtol=0, atol=3e-6)
    np.testing.assert_allclose(
        frame["rms"] ** 2, frame["mean"] ** 2 + frame["sigma"] ** 2 * (1 - 1 / frame["n"]), atol=1e-5
    )
    ordered = frame[["p5", "p25", "p50", "p75", "p95", "max"]].to_numpy()
    assert (np.diff(ordered, axis=1) >= 0).all()
