"""What robots tell of a type: mean and scatter of SIMULATED populations, and from the store to a calibration."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from fleet_support import measured
from typer.testing import CliRunner

import irbcal
from irbcal import pipeline
from irbcal.cli import main
from irbcal.errors import CalibrationError, OptionError
from irbcal.fleet.prior import population, type_prior
from irbcal.fleet.store import opened
from irbcal.identification import term_sets
from irbcal.identification.type_prior import TypePrior, TypeTerm
from irbcal.io import robots


def test_mean_and_scatter_of_a_population_are_found():
    """40 robots with 6 terms, of which each shows 5 directions: means within their scatter, scatter within a third."""
    rng = np.random.default_rng(1)
    mean, scatter = np.array([1.0, -0.5, 0.0, 2.0, 0.3, 0.0]), np.array([0.5, 0.2, 1.0, 0.05, 0.3, 0.1])
    likelihoods = []
    for _ in range(40):
        own = mean + scatter * rng.standard_normal(6)
        J = rng.standard_normal((5, 6)) / 0.05
        y = J @ own + rng.standard_normal(5)
        likelihoods.append((J.T @ J, J.T @ y))
    found, std = population(likelihoods)
    assert (np.abs(found - mean) < 3.0 * scatter / np.sqrt(40) + 0.02).all()
    np.testing.assert_allclose(std, scatter, rtol=0.35, atol=0.02)


def test_what_no_robot_shows_stays_open():
    found, std = population([(np.diag([1e4, 0.0]), np.array([1e4, 0.0]))] * 6)
    assert found == pytest.approx([1.0, 0.0], abs=1e-3)
    assert std[1] > 1.0


def test_of_two_terms_that_look_alike_the_sum_stays_known():
    """A prior without correlations keeps what robots show: by hand the sum is known to 0.008, each to 2.8 alone."""
    J = np.array([[50.0, 50.0]])
    found, std = population([(J.T @ J, (J.T @ [100.0]).ravel())] * 6)
    assert found == pytest.approx([1.0, 1.0], abs=1e-2)
    assert np.hypot(*std) < 0.1


def test_numbers_that_cannot_be_are_refused(stored):
    one = stored[0]
    robots = [replace(one, terms=replace(one.terms, values=one.terms.values * size)) for size in (1.0, 1.0, 1e300)]
    with pytest.raises(CalibrationError, match="is it damaged"):
        type_prior(robots)


@pytest.fixture(scope="module")
def store(stored, tmp_path_factory):
    """Three robots, and three more whose terms are drawn about theirs."""
    rng = np.random.default_rng(2)
    path = tmp_path_factory.mktemp("prior") / "fleet.db"
    with opened(path, create=True) as held:
        for one in stored:
            held.add(one)
            own = [0.3 * name.startswith("delta") for name in one.terms.names] * one.terms.natural
            covariance = one.terms.covariance + np.diag(own**2)
            drawn = rng.multivariate_normal(one.terms.values, covariance, method="cholesky")  # the same on all machines
            again = replace(one.terms, values=drawn)
            robot = {**one.robot, "id": f"{one.robot['id']}b", "serial": f"{one.robot['serial']}b"}
            head = {**one.calibration, "robot": robot["id"]}
            held.add(replace(one, robot=robot, calibration=head, terms=again))
    return path


def test_from_the_store_to_a_calibration(store, tmp_path, monkeypatch):
    monkeypatch.setattr(term_sets, "CHOICES", term_sets.CHOICES[:6])  # quick
    out = tmp_path / "prior.json"
    words = ["fleet", "prior", "--type", "irb1600_6_145", "--store", str(store), "--out", str(out)]
    done = CliRunner(env={"COLUMNS": "200"}).invoke(main.app, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("SIMULATED: 156 terms of type irb1600_6_145 from 6 robots")
    assert json.loads(out.read_bytes())["robots"] == ["R0", "R0b", "R1", "R1b", "R2", "R2b"]
    measured(tmp_path, "new.csv", 17, 17, poses=20)
    without = irbcal.calibrate(tmp_path / "new.csv", "irb1600")
    found = irbcal.calibrate(tmp_path / "new.csv", "irb1600", prior=out)
    assert found.record.heldout.all.mean_mm < 0.85 * without.record.heldout.all.mean_mm
    assert any(
        "What 6 SIMULATED robots of type irb1600_6_145 show was taken as a prior" in n for n in found.record.notes
    )
    for options in ({"model": 34}, {"terms": "all"}, {"loss": "huber"}):
        with pytest.raises(OptionError, match=r"prior: .* leave (it )?out"):
            irbcal.calibrate(tmp_path / "new.csv", "irb1600", prior=out, **options)


def test_a_prior_is_never_dropped_in_silence(tmp_path, monkeypatch):
    """Too few poses for model auto refuse it; another robot's is refused before anything is fitted."""
    sha256 = hashlib.sha256(robots.robot_file("irb1600").read_bytes()).hexdigest()
    term = TypeTerm(name="delta_a1", unit="m", mean=1.0, std=1.0, natural=1.0)
    own = TypePrior(
        type="irb1600_6_145", nominal_urdf_sha256=sha256, robots=tuple("abcde"), simulated=True, terms=(term,)
    )
    measured(tmp_path, "few.csv", 17, 17, poses=11)
    with pytest.raises(
        OptionError, match=r"prior: it is for model auto, and 8 poses are too few .*, without the prior"
    ):
        irbcal.calibrate(tmp_path / "few.csv", "irb1600", prior=own)
    monkeypatch.setattr(pipeline, "identify", None)
    with pytest.raises(OptionError, match="irb120") as caught:
        irbcal.calibrate(tmp_path / "few.csv", "irb1600", prior=own.model_copy(update={"type": "irb120"}))
    assert caught.value.parameter == "prior"


def test_too_few_robots_and_other_files_are_refused(store, stored, tmp_path):
    with pytest.raises(CalibrationError, match="type irb120"):
        irbcal.fleet_prior("irb120", tmp_path / "p.json", store)
    with opened(tmp_path / "few.db", create=True) as held:
        held.add(stored[0])
    with pytest.raises(CalibrationError, match="expected 5 or more calibrated robots of type irb1600_6_145 with their"):
        irbcal.fleet_prior("irb1600_6_145", tmp_path / "p.json", tmp_path / "few.db")
    assert not (tmp_path / "p.json").exists()
    other = replace(stored[0], calibration={**stored[0].calibration, "nominal_urdf_sha256": "00"})
    with pytest.raises(CalibrationError, match="were calibrated from different files of the nominal robot"):
        type_prior([other, *stored])
    assert len(irbcal.fleet_prior("irb1600_6_145", tmp_path / "p.json", store, without="R0").prior.robots) == 5
