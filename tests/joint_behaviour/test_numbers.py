"""Numbers for others: the frame, the tables and the plain values say the same."""

import numpy as np
import pytest
from moving import moves, random_commands, simulated, there_and_back

from irbcal.joint_behaviour import numbers
from irbcal.joint_behaviour.behaviour import JointBehaviour
from irbcal.joint_behaviour.moves import analyse_moves
from irbcal.joint_behaviour.residuals import analyse_residuals
from irbcal.joint_behaviour.terms import Term


@pytest.fixture(scope="module")
def both():
    play = np.radians([0, 0, 0.02, 0, 0, 0.06])
    q = moves(6, there_and_back(-180, 180, 20))
    points, step, _ = simulated(q, np.full(len(q), "axis6", object), play, noise=1e-5, rng=np.random.default_rng(0))
    some = analyse_moves(points, step)
    points, step, robot = simulated(random_commands(40, 0), None, play, noise=3e-5, rng=np.random.default_rng(0))
    return JointBehaviour("points.csv", False, tuple(some), analyse_residuals(robot, points, step))


def test_error_size_by_hand():
    assert numbers.error_size([3e-3, -4e-3]) == pytest.approx({"rms_mm": np.sqrt(12.5), "max_mm": 4.0}, rel=1e-12)


def test_frame_tables_and_plain_values_say_the_same(both):
    frame, plain, (_, by_moves, by_residuals) = both.to_frame(), both.to_dict(), numbers.tables(both)
    for source, plain_terms, table in (
        ("moves", plain["moves"][0]["terms"], by_moves),
        ("residuals", plain["residuals"]["terms"], by_residuals),
    ):
        assert len(table.rows) == len(plain_terms)
        for term, row in zip(plain_terms, table.rows, strict=True):
            mine = frame[(frame["source"] == source) & (frame["kind"] == term["kind"]) & ~frame["beside_needed"]]
            mine = mine[mine["joint"].isna() if term["joint"] is None else mine["joint"] == term["joint"]]
            if term["note"]:
                assert mine["note"].tolist() == [term["note"]] == [row[2]]
                continue
            assert dict(zip(mine["name"], mine["value"], strict=True)) == pytest.approx(
                {name: value["value"] for name, value in term["values"].items()}, rel=1e-12
            )
            assert mine["p"].tolist() == pytest.approx([term["p"]] * len(mine), rel=1e-12)
            if not row[-1].endswith("*"):
                assert row[-1] == term["verdict"] == mine["verdict"].iloc[0]
                assert row[4:6] == pytest.approx((term["rms_without_mm"], term["rms_with_mm"]), rel=1e-12)


def test_a_sliding_joint_is_told_in_millimetres():
    term = Term("backlash", 1, ("backlash",), (2e-4,), (1e-4,), (3e-4,), 0.01, 1e-3, 5e-4, verdict="worth it")
    assert numbers.term_dict(term, [True])["values"]["backlash"] == pytest.approx(
        {"value": 0.2, "low": 0.1, "high": 0.3}, rel=1e-12
    )
    (row,) = numbers.terms_table([term], slides=[True]).rows
    assert row[1:3] == ("backlash, mm", "0.2000 ± 0.1000")


def test_a_term_that_others_hid_has_both_versions(both):
    beside = Term("gain", 1, ("gain",), (2e-4,), (1e-4,), (3e-4,), 0.01, 1e-3, 5e-4, verdict="worth it")
    term = Term(
        "gain", 1, ("gain",), (1e-4,), (-1e-4,), (3e-4,), 0.5, 2e-3, 2e-3, verdict="not seen", beside_needed=beside
    )
    (row,) = numbers.terms_table([term]).rows
    assert row == ("1", "gain", "0.00020 ± 0.00010", "0.010", 1.0, 0.5, "worth it*")
