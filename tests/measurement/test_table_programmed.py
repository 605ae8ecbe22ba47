"""Programmed joints in measurement files: taken where they are, refused in one sentence where they are not whole."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, measured, random_robot, validated_of

import irbcal
from irbcal.errors import MeasurementError
from irbcal.measurement import cleaning, table
from irbcal.measurement.column_names import commanded
from irbcal.measurement.input_table import InputTable

Q = [f"q{k}_deg" for k in range(1, 7)]
C = [f"c{k}_deg" for k in range(1, 7)]
XYZ = ["x_mm", "y_mm", "z_mm"]


def frame(joints=6, poses=3):
    """Two targets in each pose; programmed joints are the readings plus 0.5."""
    rows = [(p, t) for p in range(poses) for t in ("smr1", "smr2")]
    out = pd.DataFrame({"pose": [p for p, _ in rows], "target": [t for _, t in rows]})
    for k in range(1, joints + 1):
        out[f"q{k}_deg"] = [10.0 * p + k for p, _ in rows]
        out[f"c{k}_deg"] = out[f"q{k}_deg"] + 0.5
    for k, name in enumerate(XYZ):
        out[name] = np.arange(len(rows)) * 10.0 + k + 1
    return out


def refused(made):
    with pytest.raises(MeasurementError) as caught:
        table.read(made)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_programmed_joints_are_what_models_take():
    seen = table.read(frame())
    assert seen.programmed
    assert seen.programmed_columns == C
    assert seen.joint_columns == Q
    np.testing.assert_allclose(np.degrees(seen.joints() - seen.readings()), 0.5, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cleaning.clean(seen).points.q, seen.joints(), rtol=0, atol=0)
    assert list(seen.to_frame().columns)[:14] == ["pose", *Q, *C, "target"]
    assert table.read(seen.to_frame()).to_frame().equals(seen.to_frame())
    assert "c6_deg" in seen.summary()


def test_without_them_nothing_changes():
    plain = table.read(frame().drop(columns=C))
    assert not plain.programmed
    assert plain.reading_lag() is None
    assert plain.joint_notes() == []
    np.testing.assert_allclose(plain.joints(), plain.readings(), rtol=0, atol=0)
    np.testing.assert_allclose(plain.joints(), table.read(frame()).readings(), rtol=0, atol=0)
    assert cleaning.clean(plain).notes == ()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda f: f.drop(columns="c3_deg"), "<DataFrame>: missing column c3_deg: programmed joints are for all joints (c1_deg … c6_deg) or for none, found c1_deg, c2_deg, c4_deg, c5_deg, c6_deg"),
        (lambda f: f.drop(columns=C[1:]), "missing column c2_deg, c3_deg, c4_deg, c5_deg, c6_deg: programmed"),
        (lambda f: f.assign(c7_deg=1.0), "there is a column c7_deg: programmed"),
        (lambda f: f.assign(c1_mm=1.0), "there is a column c1_mm: programmed"),
        (lambda f: f.rename(columns={"c2_deg": "c2_mm"}), "missing column c2_deg: programmed"),
        (lambda f: f.drop(columns="q3_deg"), "missing column q3_deg; found"),
        (lambda f: f.drop(columns=Q), "missing column q1_deg; found"),
        (lambda f: f.assign(c4_deg=["1", "1", "", "2", "3", "3"]), "row 3, column c4_deg: expected a programmed joint angle in degrees, found nothing"),
        (lambda f: f.assign(c4_deg=["1", "1", "x", "2", "3", "3"]), "row 3, column c4_deg: expected a programmed joint angle in degrees, found 'x'"),
        (lambda f: f.assign(c4_deg=[1, 1, 2e4, 2e4, 3, 3]), "row 3, column c4_deg: expected a programmed joint angle in degrees, found 20000"),
        (lambda f: f.assign(c4_deg=[1, 1, 2, 2.1, 3, 3]), "row 4, column c4_deg: expected the programmed joints of pose 1 as in row 3, found 2.1"),
    ],
)  # fmt: skip
def test_refusals(change, expected):
    assert expected in refused(change(frame()))


CELL = st.sampled_from(["", "0", "1.5", "-3e2", "nan", "inf", "x", " 7 ", "1,5", "1e999", "20000"])


@settings(max_examples=30, deadline=None)
@given(st.sets(st.sampled_from([*C, "c1_mm", "c7_deg"])), st.lists(CELL, min_size=6, max_size=6))
def test_any_programmed_joints_are_taken_whole_or_refused_in_one_sentence(names, cells):
    made = frame().drop(columns=C).assign(**dict.fromkeys(names, 2.0))
    for name in sorted(names)[:1]:
        made[name] = cells
    try:
        seen = table.read(made)
    except MeasurementError as error:
        assert "\n" not in str(error)
    else:
        assert names in (set(), set(C))
        assert seen.programmed == bool(names)
        assert np.isfinite(seen.joints()).all()
        assert seen.joints().shape == (3, 6)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(20)), st.lists(st.floats(-1e4, 1e4), min_size=6, max_size=6))
def test_order_of_columns_does_not_matter_and_digits_stay(order, values):
    made = frame(poses=1).assign(**dict(zip(C, values, strict=True)), note="n", group="g", u95_mm=0.1)
    seen = table.read(made.iloc[:, list(order)])
    np.testing.assert_allclose(np.degrees(seen.joints()[0]), values, rtol=0, atol=1e-11)


def test_sliding_joints_and_lists_of_joints():
    made = frame(2).rename(columns={"q1_deg": "q1_mm", "c1_deg": "c1_mm"})
    seen = table.read(made)
    np.testing.assert_allclose(seen.joints()[0], [1.5e-3, np.radians(2.5)], rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        InputTable.read(made, ["q1_mm", "q2_deg"]).joints(["q1_mm", "q2_deg"])[0],
        seen.joints()[0],
        rtol=0,
        atol=0,
    )
    bare = made.drop(columns=["c1_mm", "c2_deg"])
    np.testing.assert_allclose(
        InputTable.read(bare, ["q1_mm", "q2_deg"]).joints(["q1_mm", "q2_deg"])[0],
        [1e-3, np.radians(2)],
        rtol=0,
        atol=1e-15,
    )
    with pytest.raises(MeasurementError, match="missing column c1_mm: programmed joints"):
        InputTable.read(made.drop(columns="c1_mm"), ["q1_mm", "q2_deg"]).joints(["q1_mm", "q2_deg"])


def test_the_columns_to_command():
    assert commanded([*Q, *C], Q[:3], "m.csv") == C[:3]
    assert commanded(Q, Q, "m.csv") == Q


# --- what calibrations and evaluations say --------------------------------------------------------------------


@pytest.fixture(scope="module")
def files():
    """Simulated measurements with lagging readings: with the commands, and with the readings alone."""
    nominal = arm()
    rng = np.random.default_rng(2)
    points = measured(random_robot(nominal, "11", rng), nominal.random_joints(60, 3), 2e-5, rng)
    move = np.diff(points.q, axis=0, prepend=points.q[:1])
    readings = points.q - rng.gamma(2.0, 2e-4, 60)[:, None] * move
    made = pd.DataFrame({"pose": points.pose, "target": points.names()})
    made[Q] = np.degrees(readings)[points.pose]
    made[C] = np.degrees(points.q)[points.pose]
    made[XYZ] = points.xyz * 1e3
    return made, made.drop(columns=C)


def test_calibrations_of_both_kinds_and_what_they_say_of_the_other(files):
    both, readings = files
    first, second = irbcal.calibrate(both, "irb1600", "11"), irbcal.calibrate(readings, "irb1600", "11")
    assert first.validated.fit.rms < 0.1 * second.validated.fit.rms
    assert first.record.programmed
    assert not second.record.programmed
    assert any("stood still" in note for note in first.record.notes)
    assert not any("programmed" in note for note in second.record.notes)
    assert any("has joint readings only" in note for note in irbcal.evaluate(first, readings).notes)
    assert any("has programmed joints, while" in note for note in irbcal.evaluate(second, both).notes)
    same = irbcal.evaluate(first, both).notes
    assert any("programmed joints" in note for note in same)
    assert not any("while the calibration" in note for note in same)


def test_verification_of_the_other_kind_is_said(files):
    both, readings = files
    validated = validated_of(both.iloc[:90], "irb1600", "11", verify=readings.iloc[90:])
    assert any("has joint readings only" in note for note in validated.notes)


def test_joints_tells_of_the_readings(files):
    both, readings = files
    found = irbcal.joints(both, robot="irb1600")
    assert found.reading_lag.before_standstill
    assert "Joint readings minus programmed joints" in found.summary()
    assert found.to_dict()["reading_lag"]["before_standstill"] is True
    assert any("programmed joints" in note for note in found.notes)
    plain = irbcal.joints(readings, robot="irb1600")
    assert plain.reading_lag is None
    assert "reading_lag" not in plain.to_dict()
    calibration = irbcal.calibrate(both, "irb1600", "11")
    assert any("has joint readings only" in note for note in irbcal.joints(readings, calibration=calibration).notes)
