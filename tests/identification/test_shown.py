"""What the data show: families that are there, and no others, on SIMULATED robots whose errors are known."""

import sys
from dataclasses import replace
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pytest
from evidence_cases import Truth, moves

from irbcal.identification import term_sets
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.evidence_fit import FamilyShown, sentence
from irbcal.units import MM

SCRIPT = Path(__file__).parents[2] / "scripts" / "false_alarms"


@pytest.fixture(scope="module")
def robots():
    """Robots of the script that counts a hundred: three whose points err by themselves, one with a tracker's errors."""
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    loader = SourceFileLoader("false_alarms", str(SCRIPT))
    script = module_from_spec(spec_from_loader("false_alarms", loader))
    sys.modules["false_alarms"] = script  # dataclasses look their module up
    loader.exec_module(script)
    sys.dont_write_bytecode = before
    return script, [script.prove("irb120", s, white=w) for s, w in ((3, True), (4, True), (10, True), (2, False))]


def test_no_family_is_shown_that_is_not_there_and_none_is_missed(robots):
    for robot in robots[1]:
        assert robot.there
        assert not robot.alarms
        assert not robot.missed


def test_gears_coefficients_positions_and_intervals_are_right(robots):
    *found, tracked = robots[1]
    assert sum(len(robot.gears) for robot in found) >= 8
    assert all(robot.gears == robot.gears_found for robot in found)
    for name, low, high in (("coefficients", 0.99, 1.0), ("positions", 0.99, 1.0), ("coordinates", 0.93, 0.97)):
        pairs = [getattr(robot, name) for robot in found]
        assert low <= sum(a for a, _ in pairs) / sum(b for _, b in pairs) <= high, name
    assert max(robot.mean for robot in found) < 0.006 * MM
    # errors common to a pose: deviations are a little too small, intervals hold
    for name, low in (("coefficients", 0.96), ("positions", 0.97), ("coordinates", 0.93)):
        inside, count = getattr(tracked, name)
        assert inside / count > low, name


def test_the_script_says_what_it_counted(robots):
    script, found = robots
    wrong = replace(found[0], there=set(), shown={"gravity", "thesis"})
    told = script.summary([*found, wrong])
    assert "5 SIMULATED robots, 1 with a false alarm (2 of" in told
    assert "gravity: shown 1 of" in told
    assert "thesis: shown 1 times where none of ('gravity', 'harmonics') is there" in told
    assert "false alarms ['gravity', 'thesis']" in wrong.line()


def test_a_family_is_worth_what_a_fit_without_it_lacks(monkeypatch):
    """Against identifications of robots with and without it, not against the fast sub-blocks."""
    truth = Truth(["gravity", "direction"])
    motion = replace(moves(truth.nominal, 100, 3), elapsed=None)
    points = truth.measured(motion, 1e-5)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    rows = {row.family: row for row in found.families}
    assert rows["gravity"].shown
    assert rows["direction"].shown
    assert not {"gain", "harmonics", "move"} & {name for name, row in rows.items() if row.shown}
    monkeypatch.setattr(term_sets, "HISTORY_FAMILIES", ("move",))
    still = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    best = max(row.log_evidence for row in found.term_sets) - max(row.log_evidence for row in still.term_sets)
    assert rows["direction"].evidence == pytest.approx(best, rel=0.05)
    before = motion.q - motion.moves
    change = np.concatenate(
        [
            found.predict(motion.q, before, name).position - still.predict(motion.q, before, name).position
            for name in points.target_names
        ]
    )
    assert rows["direction"].moves == pytest.approx(np.sqrt(np.mean(np.sum(change**2, axis=1))), rel=0.2)


def test_sentences():
    there = FamilyShown("gravity", 12.3, 500.0, 0.2134 * MM), FamilyShown("warm_up", 3.0, 9.0, 0.0051 * MM)
    small, doubtful = FamilyShown("move", 3.0, 90.0, 0.001 * MM), FamilyShown("thesis", 3.0, 4.0, 1.0 * MM)
    assert sentence([*reversed(there), small, doubtful]) == (
        "What the data show beside errors of the geometry (in brackets, how far points move if a model does without): "
        "gravity (0.213 mm), warm-up (0.005 mm). Not shown: move, the thesis's joint map."
    )
    assert sentence([small]) == "Beside errors of the geometry the data show nothing. Not shown: move."
    assert sentence([]) == "Beside errors of the geometry the data show nothing."
