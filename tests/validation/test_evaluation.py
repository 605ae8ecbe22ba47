"""The further options of ``irbcal evaluate`` on simulated measurements."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.error_statistics import statistics
from irbcal.errors import CalibrationError, MeasurementError, OptionError
from irbcal.io import robots
from irbcal.measurement import table
from irbcal.units import MM


@pytest.fixture(scope="module")
def verification(tmp_path_factory):
    """60 poses of the simulated verification data, half of them called measured with 6 kg; one cannot be corrected."""
    rows = pd.read_csv(robots.demo_file("demo_verification.csv"), dtype=str)
    rows = pd.concat([part[part["pose"].isin(part["pose"].unique()[100:130])] for _, part in rows.groupby("group")])
    poses = list(rows["pose"].unique())
    rows = rows[~rows["target"].str.startswith("ref")].copy()  # so that nothing is registered
    rows["payload_kg"] = ["6" if poses.index(name) % 2 else "3" for name in rows["pose"]]
    path = tmp_path_factory.mktemp("evaluate") / "v.csv"
    rows.to_csv(path, index=False)
    return path


def test_statistics_are_those_of_numpy_by_hand(program, demo_calibration, verification):
    found = program("evaluate", demo_calibration, verification, "--intervals", "--json")
    robot = irbcal.load(demo_calibration).robot_calibrated()
    raw = table.read(verification).table
    raw = raw[raw["x_mm"].notna()]
    q = np.radians(raw[[f"q{i}_deg" for i in range(1, 7)]].to_numpy(float))
    error = np.linalg.norm(
        robot.points(q, list(raw["target"])) / MM - raw[["x_mm", "y_mm", "z_mm"]].to_numpy(float), axis=1
    )
    assert found["calibrated"]["n"] == len(error)
    values = found["calibrated"] | found["percentiles"]["calibrated"]
    assert values["mean_mm"] == pytest.approx(error.mean(), abs=1e-9)
    assert values["mean_plus_3sigma_mm"] == pytest.approx(error.mean() + 3 * error.std(ddof=1), abs=1e-9)
    assert values["p95_mm"] == pytest.approx(np.percentile(error, 95), abs=1e-9)
    for part in ("per_group", "per_payload", "per_group_payload", "per_target"):
        assert sum(values["calibrated"]["n"] for values in found[part].values()) == len(error)
    assert set(found["per_payload"]) == {"3 kg", "6 kg"}
    assert set(found["per_group_payload"]) == {f"{g}, {p} kg" for g in found["per_group"] for p in "36"}
    low, high = found["intervals"]["calibrated"]["mean_mm"]
    assert low < found["calibrated"]["mean_mm"] < high
    low, high = found["intervals"]["per_group"]["iso_cube"]["calibrated"]["p95_mm"]
    assert low < high
    assert found["percentiles"]["calibrated"]["p50_mm"] < found["calibrated"]["max_mm"]
    assert found["relative"] is found["verified"] is found["flange"] is None


def test_flange_relative_and_sphere(program, demo_calibration, verification):
    found = program("evaluate", demo_calibration, verification, "--flange", "--relative", "virtual", "--json")
    assert found["flange"]["calibrated"]["position"]["n"] == 58, "two poses lost a target"
    assert found["flange"]["calibrated"]["position"]["mean_mm"] < found["flange"]["nominal"]["position"]["mean_mm"]
    assert found["relative"]["calibrated"]["rms_mm"] <= found["calibrated"]["rms_mm"]
    shift = np.linalg.norm(found["relative"]["shift_mm"]["calibrated"])
    assert found["relative"]["calibrated"]["rms_mm"] ** 2 + shift**2 == pytest.approx(
        found["calibrated"]["rms_mm"] ** 2
    )
    three = ["--relative", "three-points", "--json"]
    found = program("evaluate", demo_calibration, verification, *three)["relative"]
    again = program("evaluate", demo_calibration, verification, *three, "--frame-points", ",".join(found["points"]))
    assert again["relative"] == found
    inside = program("evaluate", demo_calibration, verification, "--sphere", "645,0,1165,900", "--json")
    assert 0 < inside["calibrated"]["n"] < 180
    with pytest.raises(MeasurementError, match="no point was measured inside"):
        program("evaluate", demo_calibration, verification, "--sphere", "9000,0,0,10")
    with pytest.raises(MeasurementError, match="smr9"):
        program("evaluate", demo_calibration, verification, *three, "--frame-points", "1/smr9,2/smr1,3/smr1")
    for wrong in (
        ["--sphere", "1,2,3"],
        ["--frame-points", "1/a,2/b,3/c"],
        ["--relative", "three-points", "--frame-points", "1"],
    ):
        assert CliRunner().invoke(app, ["evaluate", str(demo_calibration), str(verification), *wrong]).exit_code == 2


def test_expected_against_verified(program, demo_calibration, verification, tmp_path):
    """The verified poses are simulated: a robot that is truly the calibrated one, off by 0.2 mm along z."""
    rows = pd.read_csv(verification, dtype=str)
    (tmp_path / "program.csv").write_text(rows.drop_duplicates("pose").to_csv(index=False))
    program("filter", demo_calibration, tmp_path / "program.csv", "--out", tmp_path / "fake.csv", "--allow-partial")
    fake = pd.read_csv(tmp_path / "fake.csv", dtype=str).set_index("pose")
    joints = [f"q{i}_deg" for i in range(1, 7)]
    robot = irbcal.load(demo_calibration).robot_calibrated()
    before = rows.drop_duplicates("pose").set_index("pose")[joints].astype(float)
    corrected = (before != fake[joints].astype(float)).any(axis=1)
    assert 50 < corrected.sum() < 60, "some cannot be corrected: they stay as they were"
    rows[joints] = fake.loc[rows["pose"], joints].to_numpy()
    xyz = robot.points(np.radians(rows[joints].to_numpy(float)), list(rows["target"])) / MM + np.array([0, 0, 0.2])
    for k, name in enumerate(("x_mm", "y_mm", "z_mm")):
        rows[name] = [f"{v:.6f}" for v in xyz[:, k]]
    rows.to_csv(tmp_path / "verified.csv", index=False)
    found = program("evaluate", demo_calibration, verification, "--verified", tmp_path / "verified.csv", "--json")
    assert found["verified"]["verified"]["mean_mm"] == pytest.approx(0.2, abs=1e-4)
    assert sorted(found["verified"]["poses"]["set_aside"]) == sorted(corrected.index[~corrected])
    table = irbcal.evaluate(demo_calibration, verification).to_frame()
    expected = table["calibrated_mm"][table["pose"].isin(corrected.index[corrected])]
    assert found["verified"]["expected"]["mean_mm"] == pytest.approx(expected.mean()), "of the poses that were verified"
    assert found["verified"]["uncorrected"]["mean_mm"] > found["verified"]["expected"]["mean_mm"]
    assert set(found["verified"]["per_group"]) == {"iso_cube", "all_range"}
    text = program("evaluate", demo_calibration, verification, "--verified", tmp_path / "verified.csv")
    assert "Expected against verified errors" in text
    assert "verified poses left out" in text
    assert "not its fake targets" not in text
    assert "not its fake targets" in program("evaluate", demo_calibration, verification, "--verified", verification)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seed": -1}, "seed: .* found -1"),
        ({"sphere": (0, 0, 0)}, "sphere: expected x, y, z of the centre and the diameter in metres"),
        ({"sphere": (1000, 0, 900, 400)}, "sphere: metres expected"),
    ],
)
def test_options_that_make_no_sense_are_refused(demo_calibration, verification, options, words):
    with pytest.raises(OptionError, match=words) as refused:
        irbcal.evaluate(demo_calibration, verification, **options)
    assert refused.value.parameter == next(iter(options))


def test_what_is_no_calibration_is_refused(verification):
    with pytest.raises(CalibrationError, match="found None") as refused:
        irbcal.evaluate(None, verification)
    assert refused.value.parameter == "calibration"


def test_errors_and_figures_are_printed_short_and_show_themselves_only(demo_calibration, verification):
    found = irbcal.evaluate(demo_calibration, verification)
    for part in (found.errors, *found.errors.models.values(), found.plot):
        assert 10 < len(repr(part)) < 500
    assert "evaluation" not in [name for name in dir(found.plot) if not name.startswith("_")]


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


@pytest.mark.parametrize("flat", [True, False])
def test_columns_that_are_carried_along_stand_beside_the_errors(
    program, demo_calibration, verification, flat, tmp_path
):
    """Each point has the texts of its row: also where rows of a pose differ, some were lost, and names are taken."""
    rows = pd.read_csv(verification, dtype=str)
    rows["operator"] = ["007" if k % 3 else "" for k in range(len(rows))]
    rows.loc[rows["pose"] == rows["pose"].iloc[0], "x_mm"] = ""  # the first pose is lost
    rows["nominal_mm"], rows["=note"] = rows["target"] + " of " + rows["pose"], "n" + rows.index.astype(str)
    if not flat:
        rows = rows[["operator", *rows.columns.drop("operator")]].sample(frac=1, random_state=2).sort_values("pose")
    rows.to_csv(tmp_path / "v.csv", index=False)
    page = ["--report", tmp_path / "c.html", "--data", tmp_path]
    program("evaluate", demo_calibration, tmp_path / "v.csv", *page)
    points = pd.read_csv(tmp_path / "points.csv", dtype=str, keep_default_na=False)
    new = ["given_nominal_mm", "'=note", "simulated"]
    assert sorted(points.columns[-4:]) == sorted([*new, "operator"])
    assert list(points.columns[:5]) == ["pose", "group", "target", "nominal_mm", "calibrated_mm"]
    joined = points.merge(rows.fillna(""), on=["pose", "group", "target"], suffixes=("", "_file"))
    assert len(joined) == len(points) > 100
    assert (joined["operator"] == joined["operator_file"]).all()
    assert (joined["'=note"] == joined["=note"]).all()
    assert (joined["given_nominal_mm"] == joined["nominal_mm_file"]).all()


def test_poses_of_a_tool_have_the_texts_of_their_first_rows(verification):
    fit = pd.read_csv(robots.demo_file("demo_identification.csv"))
    calibration = irbcal.calibrate(fit, "irb1600", "nominal", holdout=0, as_poses=True)
    rows = pd.read_csv(verification).assign(note=lambda table: table["target"] + " of " + table["pose"].astype(str))
    points = irbcal.evaluate(calibration, rows, refit_base=True, refit_tool=True, refit_from=10).to_frame()
    assert set(points["target"]) == {"tool"}
    assert (points["note"] == "smr1 of " + points["pose"]).all()


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
