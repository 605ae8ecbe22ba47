import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import features
from irbcal.measurement.features import read

JOINTS = {f"q{k}_deg": [10.0 * k, 20.0, 30.0, 40.0] for k in range(1, 7)}


def table(**more):
    return pd.DataFrame(JOINTS | {"pose": ["1", "2", "3", "3"]} | more)


def known(*rows):
    return pd.DataFrame([dict(row) for row in rows]).fillna("")


def turned(qw, qy, qz):
    """Rows with an orientation."""
    return table(feature="A", x_mm="1", y_mm="2", z_mm="3", qw=qw, qx="0", qy=qy, qz=qz)


POSED = known({"feature": "A", "kind": "pose"})


def test_rows_may_have_an_orientation_or_none():
    seen = features.read(
        turned(["1", "", "0.5003", "0.5"], ["0", "", "0.5", "-0.5"], "0").assign(
            qx=["0", "", "0.5", "0.5"], qz=["0", "", "0.5", "0.5"]
        ),
        POSED,
        cases.arm(),
    )
    np.testing.assert_allclose(seen.rotation[0], np.eye(3), atol=1e-15)
    assert np.isnan(seen.rotation[1]).all()
    np.testing.assert_allclose(seen.rotation[2], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-3)
    np.testing.assert_allclose(seen.rotation[2] @ seen.rotation[2].T, np.eye(3), atol=1e-15)


def test_names_are_made_of_columns():
    rows = table(place=["left", "left", "right", "right"], socket=["0", "1", "0", "1"])
    seen = features.read(
        rows,
        known(
            {"feature": "{place}/{socket}", "kind": "point", "target": "tip", "u95_mm": "0.2"},
            {
                "feature": "{place} bar",
                "kind": "distance",
                "first": "{place}/0",
                "second": "{place}/1",
                "length_mm": "50",
            },
        ),
        cases.arm(),
    )
    assert list(seen.feature) == ["left/0", "left/1", "right/0", "right/1"]
    assert {(one.name, one.first, one.second, one.value) for one in seen.relations} == {
        ("left bar", "left/0", "left/1", 0.05),
        ("right bar", "right/0", "right/1", 0.05),
    }
    assert set(seen.target) == {"tip"}
    np.testing.assert_allclose(seen.u95, 0.2e-3, rtol=0, atol=1e-12)
    assert len(set(seen.left_out_together())) == 2
    assert list(seen.left_out_together("socket")) == ["0", "1", "0", "1"]
    left = seen.select(seen.left_out_together("place") == "left")
    assert [one.name for one in left.relations] == ["left bar"]
    assert set(left.features) == {"left/0", "left/1"}


def test_radians_programmed_joints_and_poses():
    rows = table(feature=["A", "A", "A", "B"], kind="point").rename(columns=lambda c: c.replace("_deg", "_rad"))
    rows[[f"q{k}_rad" for k in range(1, 7)]] = np.arange(24).reshape(4, 6) / 20
    seen = features.read(rows, None, cases.arm())
    np.testing.assert_allclose(seen.q, np.arange(24).reshape(4, 6) / 20, rtol=0, atol=1e-12)
    assert seen.poses == 4  # the same name, other joints
    rows = table(feature="A", kind="point")
    for k in range(1, 7):
        rows[f"c{k}_deg"] = 90.0
    seen = features.read(rows, None, cases.arm())
    assert seen.programmed
    np.testing.assert_allclose(seen.q, np.pi / 2, rtol=0, atol=1e-12)
    assert seen.as_measurements().joints() == pytest.approx(np.full((4, 6), np.pi / 2))


def test_rows_of_a_tracker_have_places_and_no_feature():
    seen = features.read(
        table(feature=["A", "", "", ""], kind=["point", "", "", ""], x_mm="1", y_mm="2", z_mm="3"), None, cases.arm()
    )
    assert list(seen.kind) == ["point"] * 4
    assert list(seen.left_out_together()) == ["A", "tracker", "tracker", "tracker"]


@pytest.mark.parametrize(
    ("rows", "what", "words"),
    [
        (table(), known({"feature": "A", "kind": "point"}), "missing column feature"),
        (
            table(feature=["A", "B", "A", "A"]),
            known({"feature": "A", "kind": "point"}),
            "row 2.*nothing is known of.*B",
        ),
        (table(feature="A"), known({"feature": "A", "kind": "point", "size": "3"}), "there is a column size"),
        (table(feature="A"), known({"feature": "A", "kind": "sphere", "radius_mm": "big"}), "row 1.*radius_mm.*'big'"),
        (table(), known({"feature": "{site}/{n}", "kind": "point"}), "asks for the column site"),
        (
            table(feature="A"),
            known({"feature": "A", "kind": "point"}, {"feature": "d", "kind": "distance", "first": "A"}),
            "a feature of kind distance needs first, second and length_mm",
        ),
        (
            table(feature="A"),
            known(
                {"feature": "A", "kind": "point"},
                {"feature": "d", "kind": "distance", "first": "A", "second": "Z", "length_mm": "5"},
            ),
            "no row is at Z",
        ),
        (table(feature="A"), known({"feature": "A", "kind": "point", "x_mm": "5"}), "x_mm, y_mm and z_mm, all or none"),
        (
            table(feature="A"),
            known({"feature": "A", "kind": "sphere", "radius_mm": "9" * 26}),
            r"column radius_mm: expected a number within ±1e\+06 or nothing, found 1e\+26",
        ),
        (table(feature="A"), known({"feature": "A", "kind": "sphere", "radius_mm": "-5"}), "a radius from 0 on"),
        (
            table(feature="A"),
            known({"feature": "A", "kind": "radius", "u95_deg": "0.02"}),
            "row 1, column u95_deg: a feature of kind radius takes u95_mm, found u95_deg",
        ),
        (
            table(feature="A", value_mm="1e300"),
            known({"feature": "A", "kind": "radius"}),
            r"column value_mm: expected a number within ±1e\+06 or nothing, found 1e\+300",
        ),
        (table(feature="A", q2_deg="1e20"), known({"feature": "A", "kind": "point"}), "column q2_deg"),
        (
            turned(["1", "2", "1", "1"], "0", "0"),
            POSED,
            "row 2, columns? qw, qx, qy, qz: expected a unit quaternion or nothing, found 2, 0, 0, 0",
        ),
        (turned("1", ["0", "0", "", "0"], "0"), POSED, "row 3.*unit quaternion or nothing, found 1, 0, nan, 0"),
        (turned("0", "0", "0"), POSED, "row 1.*unit quaternion or nothing, found 0, 0, 0, 0"),
        (turned("1", "0", "0").drop(columns="qz"), POSED, "missing column qz"),
        (
            table(feature=["A", "A" * 201, "A", "A"]),
            known({"feature": "A", "kind": "point"}),
            "row 2, column feature.*found 201",
        ),
        (
            table(feature="A"),
            known({"feature": "A", "kind": "point"}, {"feature": "d" * 201, "kind": "distance", "first": "A"}),
            "row 2, column feature.*found 201",
        ),
        (
            table(n=["1", "2" * 180, "1", "1"]),
            known({"feature": "a" * 30 + "{n}", "kind": "point"}),
            "row 2, column feature.*found 210",
        ),
        (table(feature="A").drop(columns="q6_deg"), known({"feature": "A", "kind": "point"}), "missing column q6_deg"),
    ],
)
def test_refusals_name_row_and_column(rows, what, words):
    with pytest.raises(MeasurementError, match=words):
        features.read(rows, what, cases.arm())


JOINTS_KNOWN_FEATURES = {f"q{k}_deg": [10.0, 20.0] for k in range(1, 7)}


def table_of_known_features(**more):
    return pd.DataFrame(JOINTS_KNOWN_FEATURES | {"pose": ["1", "2"]} | more)


def test_yaml_says_the_same(tmp_path):
    (tmp_path / "features.yaml").write_text(
        "- {feature: A, kind: sphere, radius_mm: 12.5, x_mm: 1, y_mm: 2, z_mm: 3}\n"
    )
    seen = read(table_of_known_features(feature="A"), tmp_path / "features.yaml", cases.arm())
    assert seen.features["A"].radius == 0.0125
    np.testing.assert_allclose(seen.features["A"].centre, [1e-3, 2e-3, 3e-3], rtol=0, atol=1e-12)
    (tmp_path / "features.yaml").write_text("A: sphere\n")
    with pytest.raises(MeasurementError, match="expected a list of features"):
        read(table_of_known_features(feature="A"), tmp_path / "features.yaml", cases.arm())
