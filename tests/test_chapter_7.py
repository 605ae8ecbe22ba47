"""The study of Nubiola 2011, chapter 7 (scripts/thesis): settings, calibrations, tables, page and folder."""

import io
import json
import re
import runpy
import shutil
import sys
from dataclasses import replace
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from chapter7 import campaign, printed, study, trial
from chapter7 import page as page_module
from chapter7.page import figures, render, verdict
from chapter7.settings import (
    AREAS,
    AXES,
    COURSE,
    MOVES,
    NOMINAL,
    Repetition,
    Settings,
    procedures,
    repetitions,
    shares,
)
from chapter7.tables import COMPARED, TABLES, Cell, Results, Table, agreement, chosen, markdown
from chapter7.tables import tables as tables_of
from chapter7.trial import COURSE_UNUSED, Stage, choice, identify

from irbcal.errors import IrbcalError, MeasurementError, OptionError
from irbcal.modeling.joint_map import JointMap
from irbcal.parallel import Interrupted
from irbcal.plotting.charts import Boxes, Dots, Lines, Text
from irbcal.simulation import simulation
from irbcal.simulation.shipped_cells import open_cell

SMALL = Settings(procedures=(80, 120), each=2, curve=(80,), method="least-squares", points=520, seed=4)


@pytest.fixture(scope="session")
def small():
    """Settings of the small study."""
    return SMALL


@pytest.fixture(scope="session")
def stage():
    return Stage.of(SMALL)


@pytest.fixture(scope="session")
def done(stage):
    """Rows of all repetitions but the watched search, through CSV text as in a folder, and their series."""
    return {r: study.finished(stage, r) for r in repetitions(SMALL) if r != COURSE}


@pytest.fixture(scope="session")
def frame(done, tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "results.csv"
    texts = [rows.decode() for rows, _ in done.values()]
    path.write_text(texts[0] + "".join(text.split("\n", 1)[1] for text in texts[1:]))
    return study.read_rows(path)


@pytest.fixture(scope="session")
def results(frame):
    return Results(frame, SMALL)


@pytest.fixture(scope="session")
def tables(results):
    return {table.key: table for table in tables_of(results)}


def test_shares_and_moves_are_those_of_the_thesis():
    assert shares(120) == (18, 52, 50)  # section 7.2
    assert shares(140) == (54, 46, 40)  # section 7.5
    assert shares(200) == (54, 76, 70)  # section 7.7.3.1
    assert all(sum(shares(n)) == n and min(shares(n)[1:]) > 0 for n in range(20, 1001))
    for count, angles in MOVES.items():  # sections 7.2, 7.5 and 7.7
        assert sum(map(len, angles)) == count
    assert [len(a) for a in MOVES[158]] == [17] * 5 + [73]
    default = Settings()
    assert default.pool == 3000  # 1,000 for each of targets 1 to 3
    assert default.verified == 1000
    assert [r.measures for r in procedures(default)] == [n for n in (80, 120, 180, 200) for _ in range(5)]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"points": 500}, "expected 520 to 100000 verification points, found 500"),
        ({"procedures": (19,)}, "19 identification measurements: expected 20 to 390"),
        ({"procedures": (600,)}, "600 identification measurements: expected 20 to 390, for 520 verification points"),
        ({"procedures": ()}, "at least one number"),
        ({"each": 0}, "expected 1 to 1000 calibrations of each size, found 0"),
        ({"model": "12"}, "unknown model '12': choose one of 11, 16, 26, 34"),
        ({"method": "guess"}, "unknown method 'guess': choose one of least-squares, nelder-mead, max"),
        ({"seed": -1}, "expected a seed of 0 or more, found -1"),
    ],
)
def test_settings_that_make_no_study_are_refused(small, changes, sentence):
    with pytest.raises(IrbcalError) as caught:
        replace(small, **changes)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, OptionError)
    assert caught.value.parameter == next(iter(changes))


def test_the_sphere_is_the_thesis_s(stage):
    q, target = stage.sphere
    T = stage.cell.arm.forward(q)
    assert np.linalg.norm(T[:, :3, 3] - [0.8457, 0.2, 0.9657], axis=1).max() <= 0.2 + 1e-9
    home = stage.cell.arm.forward(np.zeros((1, 6)))[0, :3, :3]
    angle = np.arccos(np.clip((np.einsum("nij,ij->n", T[:, :3, :3], home) - 1) / 2, -1, 1))
    assert angle.max() <= np.radians(20) + 1e-6
    assert len(q) == 434
    assert set(target) == set(range(8))
    assert np.abs(q).max() < np.radians(130)  # no turned wrist


def test_nothing_that_is_identified_from_is_verified_with(stage):
    for area in AREAS:
        q = stage.commanded[area][0]
        pool = stage.identification[area].q
        assert np.abs(q[:, None] - pool[None]).max(axis=2).min() > 1e-6
        assert set(stage.identification[area].target_names) == {"smr1", "smr2", "smr3"}
        for load in (3, 6):
            assert set(stage.verification[load][area].target_names) == {f"smr{k}" for k in range(1, 9)}


def test_a_stage_cannot_be_changed_and_speaks_shortly(stage):
    with pytest.raises(ValueError, match="read-only"):
        stage.commanded["iso_cube"][0][0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        stage.sphere[0][0, 0] = 1.0
    assert len(repr(stage)) < 2000
    assert "SIMULATED" in repr(stage)


def test_measurements_are_axis_points_and_a_choice_of_both_areas(stage):
    points = choice(stage.axes[18], stage.identification, (31, 31), 5)
    assert points.poses == 80
    again = choice(stage.axes[18], stage.identification, (31, 31), 5)
    np.testing.assert_array_equal(points.q, again.q)
    for part, pool in zip((points.q[18:49], points.q[49:]), (stage.identification[a].q for a in AREAS), strict=True):
        assert all((np.abs(pool - q).max(axis=1) == 0).any() for q in part)
    assert np.abs(points.q[:18]).max() == pytest.approx(np.radians(30), abs=1e-12)


def test_each_kind_of_repetition_gives_the_models_that_it_names(stage):
    ((method, robot, largest),), course = identify(stage, NOMINAL)
    assert (method, course) == ("", None)
    assert robot.arm is stage.cell.arm
    assert 1e-4 < largest < 5e-3
    ((method, robot, _),), _ = identify(stage, AXES[18])
    assert method == "axes"
    assert sorted(robot.targets) == sorted(stage.first.targets)
    (found,), _ = identify(stage, Repetition("34", 80))
    assert found[0] == "least-squares"
    assert {term.family for term in found[1].joint_map.terms.terms} == {"thesis"}


def test_the_watched_search_leaves_points_aside(stage, monkeypatch):
    seen = {}

    def fitted(arm, points, level, targets, watched=None, **options):
        seen.update(points=points, watched=watched, level=level, options=options)
        raise KeyboardInterrupt  # two thousand iterations are not needed to see what goes in

    monkeypatch.setattr("chapter7.trial.fitted", fitted)
    with pytest.raises(KeyboardInterrupt):
        identify(stage, COURSE)
    assert (seen["level"], seen["options"]) == ("34", {"method": "nelder-mead"})
    assert {area: points.poses for area, points in seen["watched"].items()} == dict.fromkeys(AREAS, COURSE_UNUSED)
    for points in seen["watched"].values():
        assert np.abs(points.xyz[:, None] - seen["points"].xyz[None]).max(axis=2).min() > 1e-6


def test_without_errors_that_the_model_lacks_fake_targets_reach_the_nominal_poses(small, monkeypatch):
    """Rigid links, no effects: expected and found errors of every kind vanish, with the nominal robot they do not."""
    rigid = simulation.open_cell("irb1600").only()
    ideal = rigid.replace(compliance=(0.0,) * 6, joint_map=JointMap.identity(rigid.arm))
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
    series = study.read_series(tmp_path, repetition)
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


def test_a_number_with_the_thesis_s_beside():
    assert str(Cell(0.12345, 0.5)) == "0.123 (0.500)"
    assert str(Cell(0.12345)) == "0.123"
    assert Cell(1.0).beside == ""


def test_agreement_counts_what_lies_near_the_thesis_by_statistic():
    columns = (
        "area",
        "position: μ (mm)",
        "σ",
        "max expected, ISO cube",
        "μ+3σ (mm)",
        "objective",
        "orientation: mean (°)",
    )
    row = ("cube", Cell(1.19, 1.0), Cell(0.1, 0.2), Cell(0.81, 1.0), Cell(3.0), Cell(2.5, 2.0), Cell(0.79, 1.0))
    text = agreement([Table("7.1", "t", columns, (row,))])
    counts = {
        symbol: (near, of, ratio)
        for symbol, near, of, ratio in re.findall(r"(\S+) (\d+) of (\d+) \(\D*([\d.]+)\)", text)
    }
    assert counts == {"μ": ("1", "2", "0.99"), "σ": ("0", "1", "0.50"), "max": ("1", "2", "1.03")}


def test_rows_by_what_they_say(results):
    row = results.row(NOMINAL, "expected", "iso_cube")
    assert row["unit"] == "mm"
    assert results.row(NOMINAL, "poses", "all_range", quantity="orientation")["unit"] == "deg"
    assert results.has(NOMINAL, Repetition("34", 80, 2))
    assert not results.has(NOMINAL, Repetition("34", 80, 3))
    with pytest.raises(KeyError):
        results.row(NOMINAL, "expected", "iso_cube", 4)


STATISTICS = ["mean", "sigma", "max", "mean_plus_3sigma"]


def values_of(table, row):
    """The numbers of a table's row."""
    return [cell.value for cell in table.rows[row] if isinstance(cell, Cell)]


def thesis_of(table, row):
    """The thesis's numbers of a table's row."""
    return [cell.thesis for cell in table.rows[row] if isinstance(cell, Cell)]


def test_tables_are_what_pandas_reads_from_the_results(frame, tables):
    def pick(names=STATISTICS, **query):
        rows = frame
        for column, value in query.items():
            rows = rows[rows[column] == value]
        assert len(rows) == 1, query
        return rows[names].iloc[0].tolist()

    assert list(tables) == list(TABLES)
    for k, (load, area) in enumerate((load, area) for load in (3, 6) for area in AREAS):
        query = {"repetition": "nominal", "kind": "expected", "area": area, "payload_kg": load, "targets": "1-8"}
        assert values_of(tables["7.1"], k) == pick(**query)
    assert thesis_of(tables["7.1"], 3) == [0.979, 0.222, 2.326, 1.643]
    for key, load, counts in (("7.2", 3, (18, 54, 102, 158)), ("7.3", 6, (18,))):
        for k, (area, count) in enumerate((area, count) for area in AREAS for count in counts):
            query = {"repetition": f"axes-{count}-1", "kind": "expected", "area": area, "payload_kg": load}
            found = [v for targets in ("1", "1-8") for v in pick(STATISTICS[:3], targets=targets, **query)]
            assert values_of(tables[key], k) == found
    for key, name, load in (
        ("7.4", "34-200-1", 3),
        ("7.5", "34-200-1", 6),
        ("7.6", "11-400-1", 3),
        ("7.7", "11-400-1", 6),
    ):
        kinds = ("expected", "verified", "verified_all")[: 3 if key == "7.4" else 2]
        for k, kind in enumerate(kinds):
            query = {"repetition": name, "kind": kind, "payload_kg": load, "targets": "1-8"}
            assert values_of(tables[key], k) == [v for area in AREAS for v in pick(area=area, **query)]
    for k, name in enumerate(("nominal", "11-400-1", "axes-18-1", "34-200-1")):
        for key, kind, area, names in (
            ("7.8", "iso9283", "iso_poses", ["mean", "max"]),
            ("7.9", "poses", "iso_cube", STATISTICS),
        ):
            query = {"repetition": name, "kind": kind, "area": area}
            found = [v for quantity in ("flange", "orientation") for v in pick(names, quantity=quantity, **query)]
            assert values_of(tables[key], k) == found
    assert values_of(tables["7.10"], 0) == pick(repetition="34-200-1", kind="sphere_virtual_frame")
    assert values_of(tables["7.11"], 0) == pick(repetition="34-200-1", kind="sphere_three_points")
    for k, n in enumerate((80, 120)):
        query = {"repetition": f"34-{n}-1", "kind": "poses", "area": "iso_cube"}
        found = [v for quantity in ("flange", "orientation") for v in pick(quantity=quantity, **query)]
        assert values_of(tables["7.12"], k) == found
    # 7.13 to 7.16: choose again
    expected = frame[(frame["kind"] == "expected") & (frame["targets"] == "1-8") & (frame["payload_kg"] == 3)]
    expected = expected[expected["repetition"].isin([f"34-{n}-{i}" for n in (80, 120) for i in (1, 2)])]
    largest = expected.pivot_table(index=["measures", "repetition"], columns="area", values="max")
    worst = largest.max(axis=1)
    names = [worst[80].idxmax(), worst.idxmin()[1], worst[120].idxmax()]
    for k, name in enumerate(names):
        n = int(name.split("-")[1])
        row = largest.loc[n, name]
        objective = frame[frame["repetition"] == name]["objective_mm"].iloc[0]
        assert values_of(tables["7.13"], k) == [row["iso_cube"], row["all_range"], objective]
        assert tables["7.13"].rows[k][:2] == ("ABC"[k], n)
        query = {"repetition": name, "kind": "verified", "area": "all_range", "payload_kg": 6}
        assert values_of(tables["7.14"], k) == pick(**query)
        for key, quantity in (("7.15", "flange"), ("7.16", "orientation")):
            query = {"repetition": name, "kind": "poses", "area": "iso_cube", "quantity": quantity}
            assert values_of(tables[key], k) == pick(**query)
    # medians
    rows = frame[(frame["kind"] == "expected") & frame["repetition"].isin(expected["repetition"])]
    rows = rows[(rows["area"] == "all_range") & (rows["payload_kg"] == 6)]
    found = [rows[rows["targets"] == t][name].median() for t in ("1-3", "4-8") for name in ("mean", "max")]
    assert values_of(tables["targets"], 3) == pytest.approx(found, abs=1e-12)
    rows = frame[(frame["kind"] == "expected") & (frame["measures"] == 80) & (frame["targets"] == "1-8")]
    means = rows[(rows["area"] == "iso_cube") & (rows["payload_kg"] == 3)]["mean"]
    assert tables["curve"].rows[0][2] == f"{means.median():.3f} ({means.min():.3f} to {means.max():.3f})"


def test_markdown_says_simulated_and_shows_the_thesis_beside(small, tables, results):
    text = markdown(list(tables.values()), small)
    assert text.splitlines()[0].endswith("SIMULATED")
    line = next(line for line in text.splitlines() if line.startswith("| ISO cube | 3 kg |"))
    found = results.row(NOMINAL, "expected", "iso_cube")
    assert f"{found['mean']:.3f} (1.004)" in line
    widths = [line.count("|") for line in text.splitlines() if line.startswith("|")]
    assert min(widths) >= 6


def test_the_letters_of_the_thesis_stand_beside_its_own_procedures_only(small, results, tables):
    assert all(value is None for value in thesis_of(tables["7.13"], 0))  # these are not the thesis's four sizes
    frame = results.frame[results.frame["measures"].isin([80])]
    frame = pd.concat([frame.assign(measures=n, repetition=f"34-{n}-1") for n in (80, 120, 180, 200)])
    frame = frame.drop_duplicates(["repetition", "kind", "area", "payload_kg", "targets", "quantity"])
    frame["max"] += frame["measures"] / 1e3 * (frame["measures"] != 120)
    settings = replace(small, procedures=(80, 120, 180, 200), each=1, curve=())
    found = chosen(Results(frame, settings))
    assert [(c.letter, c.repetition.measures) for c in found] == [
        ("A", 80),
        ("B", 120),
        ("C", 120),
        ("D", 180),
        ("E", 200),
    ]
    assert found[1].reason == "best of all the 4 procedures"
    assert found[4].reason.endswith("worst of all the 4")
    assert found[2].thesis[13] == (0.683, 0.945, 0.508)


@pytest.fixture(scope="module")
def series(done):
    def of(repetition):
        return dict(np.load(io.BytesIO(done[repetition][1])))

    return of


def charts(results, series):
    return {chart.name: chart for section in figures(results, series).values() for chart in section}


def marks(drawing, kind):
    return [mark for mark in drawing.marks if isinstance(mark, kind)]


def read_off(drawing, y, to_axis=np.asarray, from_axis=np.asarray):
    """Heights in a drawing as the numbers at its axis tell them."""
    numbers = [(text.y, to_axis(float(text.text))) for text in marks(drawing, Text) if text.anchor == "end"]
    return from_axis(np.polyval(np.polyfit(*np.transpose(numbers), 1), np.asarray(y)))


def test_the_figures_are_those_of_the_thesis_and_a_few_more(results, series):
    every = charts(results, series)
    numbers = [int(name.rsplit("-", 1)[1]) for name in every if name.startswith("figure-7-")]
    assert numbers == [*range(4, 12), *range(13, 20)]  # 7.1, 7.3 and 7.12 show places and procedures, not errors
    assert {name for name in every if not name.startswith("figure")} == {
        *("expected-found", "curve-iso_cube", "curve-all_range", "boxes-iso_cube", "boxes-all_range")
    }
    assert all(chart.svg().count("SIMULATED data.") == 1 for chart in every.values())
    some = Results(results.frame[results.frame["repetition"] != "34-120-2"], results.settings)
    assert every.keys() - charts(some, series).keys() == {
        *("expected-found", "boxes-iso_cube", "boxes-all_range", "figure-7-17", "figure-7-18", "figure-7-19")
    }


def test_the_course_is_that_of_the_watched_search(results, series):
    names = ("objective", *(f"{area}_{statistic}" for area in AREAS for statistic in ("mean", "max")))
    course = {f"course/{name}_mm": np.array([0.9, 0.5, 0.4]) + k for k, name in enumerate(names)}
    frame = pd.concat([results.frame, results.frame.iloc[:1].assign(repetition=COURSE.name)])
    every = {COURSE: course | {"course/iteration": np.arange(3.0)}}
    figure = charts(Results(frame, SMALL), lambda r: every.get(r) or series(r))["figure-7-2"]
    assert "1: ISO cube, 2: all range" in figure.caption
    (drawing,) = figure.drawings
    for dots, name in zip(marks(drawing, Dots), names, strict=True):
        values = read_off(drawing, dots.xy[:, 1], np.log10, lambda logarithm: 10**logarithm)
        np.testing.assert_allclose(values, course[f"course/{name}_mm"], rtol=1e-9)


def test_strips_hold_every_error_with_a_line_at_the_mean(results, series):
    (drawing,) = charts(results, series)["figure-7-6"].drawings
    words = [text.text for text in marks(drawing, Text) if text.anchor == "middle" and text.upright]
    assert words[:3] == ["nominal", "11 parameters", "34 parameters"]
    means = [line for line in marks(drawing, Lines) if line.colour == "ink"]
    members = [COMPARED[name] for name in ("nominal", "11", "34")]
    for dots, repetition, mean in zip(marks(drawing, Dots), members, means, strict=True):
        values = series(repetition)["verified/iso_cube/6/point"]
        np.testing.assert_allclose(read_off(drawing, dots.xy[:, 1]), values, rtol=0, atol=1e-9)
        assert read_off(drawing, mean.paths[0][:, 1]) == pytest.approx(float(np.mean(values)), rel=1e-6)
        assert mean.paths[0][:, 0] == pytest.approx([dots.xy[:, 0].min(), dots.xy[:, 0].max()])


def test_boxes_are_the_percentiles_of_the_rows(results, series):
    (drawing,) = charts(results, series)["boxes-iso_cube"].drawings
    rows = [results.row(r, "expected", "iso_cube", 3) for r in procedures(results.settings)]
    for box, dot, row in zip(marks(drawing, Boxes), marks(drawing, Dots), rows, strict=True):
        assert read_off(drawing, box.corners[0, [1, 3]]) == pytest.approx([row["p25"], row["p75"]], rel=1e-9)
        assert read_off(drawing, dot.xy[0, 1]) == pytest.approx(row["max"], rel=1e-9)
    lines = [read_off(drawing, line.paths[0][:, 1]) for line in marks(drawing, Lines) if line.colour[:6] == "series"]
    expected = [pair for row in rows for pair in ((row["p5"], row["p95"]), (row["p50"], row["p50"]))]
    np.testing.assert_allclose(lines, expected, rtol=0, atol=1e-9)


def test_expected_and_found_errors_stand_beside_the_thesis_s(results, series):
    mean, largest = charts(results, series)["expected-found"].drawings
    for drawing, name, column in ((mean, "mean", 0), (largest, "max", 2)):
        mine, thesis = marks(drawing, Dots)[:4], [mark for mark in marks(drawing, Dots)[4:] if mark.colour != "page"]
        for dots, (area, load) in zip(mine, [(area, load) for area in AREAS for load in (3, 6)], strict=True):
            rows = [results.row(r, "verified", area, load)[name] for r in procedures(results.settings)]
            np.testing.assert_allclose(read_off(drawing, dots.xy[:, 1]), rows, rtol=0, atol=1e-9)
        tables = [table["verified"] for table in (printed.TABLE_7_4, printed.TABLE_7_5)]
        expected = [table[k][column] for table in tables for k in range(2)]
        np.testing.assert_allclose([read_off(drawing, dots.xy[0, 1]) for dots in thesis], expected, rtol=0, atol=1e-9)


def test_the_curve_holds_medians_and_all_choices(results, series):
    (drawing,) = charts(results, series)["curve-all_range"].drawings
    rows = [results.row(Repetition("34", 80, k), "expected", "all_range", 3) for k in (1, 2)]
    lines = [line for line in marks(drawing, Lines) if line.colour == "series0"]
    for bar, dot, name in zip(lines[::2], marks(drawing, Dots)[:2], ("max", "mean"), strict=True):
        values = [row[name] for row in rows]
        assert read_off(drawing, dot.xy[0, 1]) == pytest.approx(np.median(values), rel=1e-9)
        assert sorted(read_off(drawing, bar.paths[0][:, 1])) == pytest.approx(sorted(values), rel=1e-9)


def test_the_page_loads_nothing_runs_nothing_and_escapes(results, series, tables, finished_folder, monkeypatch):
    hostile = Table("x", "<script>alert(1)</script>", ("a",), (('"><img src=http://x>',),), ("<b>note</b>",))
    with monkeypatch.context() as patch:
        patch.setattr(page_module, "figures", lambda *arguments: {})
        bad = render(results, [*tables.values(), hostile], series)
    page = (finished_folder / "page.html").read_text()
    for text in (bad, page):
        assert "default-src 'none'" in text
        assert "<strong>Simulated.</strong>" in text
        assert "<script" not in text
        assert "<img" not in text
        assert "<b>note" not in text
    assert "&lt;script&gt;" in bad
    links = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", page) + re.findall(r"url\(([^)]*)\)", page)
    assert not links
    assert page.count("<figure>") == len(charts(results, series)) == 20
    assert page.count("<h3>") == len(tables)
    ids = re.findall(r'\sid="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert "0.272" in page  # the thesis's, Table 7.4


def test_the_verdict_waits_for_all_procedures(results):
    assert verdict(results).startswith("4 simulated calibrations by least-squares: with fake targets the virtual robot")
    some = Results(results.frame[results.frame["repetition"] != "34-120-2"], results.settings)
    assert verdict(some) is None


def test_a_part_is_read_as_it_was_kept(done, tmp_path):
    repetition = Repetition("34", 80)
    assert not study.is_kept(tmp_path, repetition)
    study.keep(tmp_path, repetition, *done[repetition])
    assert study.is_kept(tmp_path, repetition)
    assert set(study.read_rows(tmp_path / "parts" / "34-80-1.csv")["repetition"]) == {"34-80-1"}
    series = study.read_series(tmp_path, repetition)
    assert series["verified/iso_cube/3/point"].dtype == np.float32


def test_damage_is_refused_with_the_file(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(MeasurementError, match="these are not the rows of a study") as caught:
        study.read_rows(path)
    assert caught.value.file == str(path)
    with pytest.raises(MeasurementError, match=r"damaged: delete it and nominal\.csv") as caught:
        study.read_series(tmp_path, Repetition("nominal"))
    assert caught.value.file == str(tmp_path / "parts" / "nominal.npz")


@pytest.fixture(scope="module")
def finished_folder(done, tmp_path_factory):
    """A folder in which all but the watched search is done."""
    out = tmp_path_factory.mktemp("filled") / "study"
    study.open_folder(SMALL, out)
    (out / "parts").mkdir()
    for repetition, files in done.items():
        study.keep(out, repetition, *files)
    study.write(SMALL, out)
    return out


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_finished_folder_is_not_computed_again(finished_folder, capsys, monkeypatch):
    before = contents(finished_folder)
    monkeypatch.setattr(study, "render", lambda *arguments: before["page.html"].decode())
    options = ["--procedures", "80,120", "--each", "2", "--poses-curve", "80", "--points", "520", "--seed", "4"]
    script = runpy.run_path(str(Path(__file__).parents[1] / "scripts" / "thesis" / "study"))
    script["main"]([str(finished_folder), *options, "--method", "least-squares", "--only", "7.1", "--only", "7.13"])
    text = capsys.readouterr().out
    assert "SIMULATED (in brackets: the thesis, a real robot). ## Table 7.1." in text
    assert "Table 7.4." not in text
    assert "0 calibrations done, 5 found finished" in text
    assert contents(finished_folder) == before
    assert json.loads(before["settings.json"])["simulated"] is True
    assert "SIMULATED" in before["tables.md"].decode().splitlines()[0]
    with pytest.raises(SystemExit, match="study: 1000 identification measurements: expected 20 to 390"):
        script["main"]([str(finished_folder), "--points", "520"])


def test_an_interrupted_study_goes_on_and_ends_in_the_same_bytes_with_any_number_of_processes(
    finished_folder, done, stage, tmp_path, monkeypatch
):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    said = []
    with monkeypatch.context() as patch:
        patch.setattr(study, "_compute", interrupted)
        patch.setattr(Stage, "of", lambda settings: stage)
        with pytest.raises(Interrupted, match="the same call goes on from there") as caught:
            study.study(SMALL, tmp_path, progress=said.append)
    assert caught.value.remaining == len(repetitions(SMALL))
    assert said == ["poses measured"]
    (tmp_path / "parts").mkdir()
    study.keep(tmp_path, NOMINAL, *done[NOMINAL])
    monkeypatch.setattr(study, "render", lambda *arguments: "")
    tables, count, kept = study.study(SMALL, tmp_path, only=["7.1", "7.13"], jobs=2)
    assert (count, kept) == (4, 1)
    assert {"7.1", "7.13"} <= {table.key for table in tables}
    whole = contents(finished_folder)
    parts = {name: data for name, data in contents(tmp_path).items() if name.startswith("parts")}
    assert parts == {name: whole[name] for name in parts}
    assert len(parts) == 10


def test_other_settings_and_strangers_in_the_folder_are_refused(finished_folder, tmp_path, monkeypatch):
    def refused(settings, folder):
        with pytest.raises(MeasurementError) as caught:
            study.study(settings, folder)
        return str(caught.value)

    before = contents(finished_folder)
    sentence = refused(replace(SMALL, seed=7), finished_folder)
    assert sentence.endswith("settings.json: this folder holds a study with seed 4, not 7: choose another folder")
    monkeypatch.setattr(study, "_cell_digest", lambda settings: "another")
    assert "a study with another version of the virtual cell" in refused(SMALL, finished_folder)
    monkeypatch.undo()
    assert contents(finished_folder) == before
    (tmp_path / "results.csv").write_text("mine\n")
    assert "results without settings.json" in refused(SMALL, tmp_path)
    (tmp_path / "settings.json").write_text('{"colour": "red"}')
    assert "not the settings of a study" in refused(SMALL, tmp_path)
    assert (tmp_path / "results.csv").read_text() == "mine\n"
    with pytest.raises(OptionError, match=r"unknown table '7\.17': tables are 7\.1, 7\.2"):
        study.study(SMALL, tmp_path / "new", only=["7.17"])
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("damage", ["repetition,model\n", "", "other"])
def test_damaged_parts_are_refused_by_name(finished_folder, tmp_path, damage):
    out = shutil.copytree(finished_folder, tmp_path / "copy")
    path = out / "parts" / "nominal.csv"
    path.write_text((out / "parts" / "34-80-1.csv").read_text() if damage == "other" else damage)
    with pytest.raises(MeasurementError) as caught:
        study.write(SMALL, out)
    assert caught.value.file == str(path)
    assert ("expected the rows of nominal" if damage == "other" else "delete it") in str(caught.value)
    assert contents(out)["page.html"] == contents(finished_folder)["page.html"]


def fours(value):
    """All rows of four numbers in a table."""
    if isinstance(value, dict):
        return [row for item in value.values() for row in fours(item)]
    if isinstance(value[0], tuple):
        return [row for item in value for row in fours(item)]
    return [value] if len(value) == 4 else []


@pytest.mark.parametrize("number", [4, 5, 6, 7, 9, 10, 11, 12, 14, 15, 16])
def test_the_fourth_number_is_mean_plus_three_sigma(number):
    rows = fours(getattr(printed, f"TABLE_7_{number}"))
    assert rows
    for mean, sigma, largest, last in rows:
        assert last == pytest.approx(mean + 3 * sigma, abs=0.0021)
        assert mean < largest


def test_table_7_1_with_its_last_column():
    for load, areas in printed.TABLE_7_1.items():
        for (mean, sigma, _), last in zip(areas, printed.TABLE_7_1_LAST[load], strict=True):
            assert last == pytest.approx(mean + 3 * sigma, abs=0.0021)


@pytest.fixture(scope="module")
def cell_tables():
    """The functions of scripts/thesis/cell_tables."""
    path = Path(__file__).parents[1] / "scripts" / "thesis" / "cell_tables"
    loader = SourceFileLoader("cell_tables", str(path))
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        loader.exec_module(module := module_from_spec(spec_from_loader("cell_tables", loader)))
    finally:
        sys.dont_write_bytecode = written
    return module


def test_nominal_errors_are_those_of_table_7_1_and_34_parameters_leave_a_third(cell_tables):
    cell = open_cell("irb1600")
    poses = campaign.campaign(cell, identification=150, verification=1600, seed=5)
    measured = campaign.measure(cell, poses)
    found = cell_tables.errors(cell_tables.nominal(cell, cell_tables.by_axes(cell, measured)), measured.verification)
    np.testing.assert_allclose(found[:, 0], [1.004, 0.961], rtol=0.10)
    np.testing.assert_allclose(found[:, 2], [1.890, 2.268], rtol=0.25)  # of 1,600 points, not 8,000
    fit = cell_tables.identified(cell, measured, "34", (76, 70), 0, method="nelder-mead")
    found = cell_tables.errors(fit, measured.verification)
    np.testing.assert_allclose(found[:, 0], [0.272, 0.321], rtol=0.35)
    np.testing.assert_allclose(found[:, 2], [0.714, 0.858], rtol=0.35)
