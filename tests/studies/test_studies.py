"""Studies of chapter 7: one repetition, and what the tables and the page make of the rows."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from irbcal.cell import simulation
from irbcal.errors import IrbcalError
from irbcal.modeling.joint_map import JointMap
from irbcal.studies import page as study_page
from irbcal.studies import repetition as study
from irbcal.studies import runner as study_run
from irbcal.studies import tables as study_tables
from irbcal.studies.repetition import AREAS, Repetition

SMALL = study.Settings(procedures=(80, 120), each=2, curve=(80,), method="least-squares", points=520, seed=4)


@pytest.fixture(scope="module")
def stage():
    return study.Stage.of(SMALL)


@pytest.fixture(scope="module")
def done(stage):
    """Rows of all repetitions but the watched search, through CSV text as in a folder, and their series."""
    parts = {r: study_run.part(stage, r) for r in study.repetitions(SMALL) if r != study.COURSE}
    return parts


@pytest.fixture(scope="module")
def frame(done, tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "results.csv"
    texts = [rows.decode() for rows, _ in done.values()]
    path.write_text(texts[0] + "".join(text.split("\n", 1)[1] for text in texts[1:]))
    return study_run.read_rows(path)


@pytest.fixture(scope="module")
def results(frame):
    return study_tables.Results(frame, SMALL)


@pytest.fixture(scope="module")
def tables(results):
    return {table.key: table for table in study_tables.tables(results)}


def test_shares_and_moves_are_those_of_the_thesis():
    assert study.shares(120) == (18, 52, 50)  # section 7.2
    assert study.shares(140) == (54, 46, 40)  # section 7.5
    assert study.shares(200) == (54, 76, 70)  # section 7.7.3.1
    assert all(sum(study.shares(n)) == n and min(study.shares(n)[1:]) > 0 for n in range(20, 1001))
    for count, angles in study.MOVES.items():  # sections 7.2, 7.5 and 7.7
        assert sum(map(len, angles)) == count
    assert [len(a) for a in study.MOVES[158]] == [17] * 5 + [73]
    default = study.Settings()
    assert default.pool == 3000  # 1,000 for each of targets 1 to 3
    assert default.verified == 1000
    assert [r.measures for r in study.procedures(default)] == [n for n in (80, 120, 180, 200) for _ in range(5)]


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


def test_without_errors_that_the_model_lacks_fake_targets_reach_the_nominal_poses(monkeypatch):
    """Rigid links, no effects: expected and found errors of every kind vanish, with the nominal robot they do not."""
    ideal = simulation.open_cell("irb1600").only().replace(compliance=(0.0,) * 6, joint_map=JointMap(np.zeros(6)))
    monkeypatch.setattr(simulation, "open_cell", lambda *args, **options: ideal)
    perfect = study.Stage.of(SMALL)
    rows = pd.DataFrame(study.run(perfect, Repetition("34", 80))[0])
    kinds = {"expected", "verified", "poses", "iso9283", "sphere_virtual_frame", "sphere_three_points"}
    assert set(rows["kind"]) == kinds
    assert rows.loc[rows["unit"] == "mm", "max"].max() < 1e-5
    assert rows.loc[rows["unit"] == "deg", "max"].max() < 1e-6
    # without correction found and expected errors of the same poses are the same thing, and not small
    every = replace(perfect, settings=replace(SMALL, points=8 * SMALL.points))
    rows = pd.DataFrame(study.run(every, study.NOMINAL)[0]).set_index(["kind", "area", "payload_kg", "targets"])
    for area in AREAS:
        expected, found = rows.loc[[("expected", area, 3, "1-8"), ("verified", area, 3, "1-8")], "mean"]
        assert found == pytest.approx(expected, abs=1e-9)
        assert expected > 0.4


def test_every_repetition_has_a_seed_of_its_own_and_rows_are_those_of_its_errors(done, frame, tmp_path):
    repetition = Repetition("34", 120, 2)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "34-120-2.npz").write_bytes(done[repetition][1])
    series = study_run.read_series(tmp_path, repetition)
    before = frame[frame["repetition"] == "34-120-2"]
    assert set(before["seed"]) == {repetition.seed(SMALL)}
    other = frame[frame["repetition"] == "34-120-1"]
    assert set(other["seed"]) != set(before["seed"])
    assert (other["mean"].to_numpy() != before["mean"].to_numpy()).all()
    assert repetition.seed(replace(SMALL, seed=5)) != repetition.seed(SMALL)
    values = series["verified/all_range/6/point"]
    row = before[(before["kind"] == "verified") & (before["area"] == "all_range") & (before["payload_kg"] == 6)]
    assert row["sigma"].item() == pytest.approx(np.std(values, ddof=1), abs=1e-5)
    assert row["rms"].item() == pytest.approx(np.sqrt(np.mean(np.square(values))), abs=1e-5)
    assert row["p75"].item() == pytest.approx(np.percentile(values, 75), abs=1e-5)


def test_nothing_that_is_identified_from_is_verified_with(stage):
    for area in AREAS:
        q = stage.commanded[area][0]
        pool = stage.identification[area].q
        assert np.abs(q[:, None] - pool[None]).max(axis=2).min() > 1e-6
        assert set(stage.identification[area].target_names) == {"smr1", "smr2", "smr3"}
        for load in (3, 6):
            assert set(stage.verification[load][area].target_names) == {f"smr{k}" for k in range(1, 9)}


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


def values_of(table, row):
    """The numbers of a table's row."""
    return [cell.value for cell in table.rows[row] if isinstance(cell, study_tables.Cell)]


def thesis_of(table, row):
    """The thesis's numbers of a table's row."""
    return [cell.thesis for cell in table.rows[row] if isinstance(cell, study_tables.Cell)]


STATISTICS = ["mean", "sigma", "max", "mean_plus_3sigma"]


def test_tables_are_what_pandas_reads_from_the_results(frame, tables):
    def pick(names=STATISTICS, **query):
        rows = frame
        for column, value in query.items():
            rows = rows[rows[column] == value]
        assert len(rows) == 1, query
        return rows[names].iloc[0].tolist()

    assert list(tables) == list(study_tables.TABLES)
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
            ("7.9", "poses", "all_range", STATISTICS),
        ):
            query = {"repetition": name, "kind": kind, "area": area}
            found = [v for quantity in ("flange", "orientation") for v in pick(names, quantity=quantity, **query)]
            assert values_of(tables[key], k) == found
    assert values_of(tables["7.10"], 0) == pick(repetition="34-200-1", kind="sphere_virtual_frame")
    assert values_of(tables["7.11"], 0) == pick(repetition="34-200-1", kind="sphere_three_points")
    for k, n in enumerate((80, 120)):
        query = {"repetition": f"34-{n}-1", "kind": "poses", "area": "all_range"}
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


def test_mean_plus_three_sigma_and_order_of_percentiles(frame):
    np.testing.assert_allclose(frame["mean_plus_3sigma"], frame["mean"] + 3 * frame["sigma"], atol=3e-6)
    np.testing.assert_allclose(
        frame["rms"] ** 2, frame["mean"] ** 2 + frame["sigma"] ** 2 * (1 - 1 / frame["n"]), atol=1e-5
    )
    ordered = frame[["p5", "p25", "p50", "p75", "p95", "max"]].to_numpy()
    assert (np.diff(ordered, axis=1) >= 0).all()


def test_the_letters_of_the_thesis_stand_beside_its_own_procedures_only(results, tables):
    assert all(value is None for value in thesis_of(tables["7.13"], 0))  # these are not the thesis's four sizes
    frame = results.frame[results.frame["measures"].isin([80])]
    frame = pd.concat([frame.assign(measures=n, repetition=f"34-{n}-1") for n in (80, 120, 180, 200)])
    frame = frame.drop_duplicates(["repetition", "kind", "area", "payload_kg", "targets", "quantity"])
    frame["max"] += frame["measures"] / 1e3 * (frame["measures"] != 120)
    settings = replace(SMALL, procedures=(80, 120, 180, 200), each=1, curve=())
    found = study_tables.chosen(study_tables.Results(frame, settings))
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


def test_markdown_says_simulated_and_shows_the_thesis_beside(tables, results):
    text = study_tables.markdown(list(tables.values()), SMALL)
    assert text.splitlines()[0].endswith("SIMULATED")
    line = next(line for line in text.splitlines() if line.startswith("| ISO cube | 3 kg |"))
    found = results.row(study.NOMINAL, "expected", "iso_cube")
    assert f"{found['mean']:.3f} (1.004)" in line
    widths = [line.count("|") for line in text.splitlines() if line.startswith("|")]
    assert min(widths) >= 6


def test_the_page_loads_nothing_runs_nothing_and_escapes(done, results, tables, tmp_path):
    (tmp_path / "parts").mkdir()
    wanted = study_page.drawn(results)
    for r in wanted:
        (tmp_path / "parts" / f"{r.name}.npz").write_bytes(done[r][1])
    series = {r: study_run.read_series(tmp_path, r) for r in wanted}
    hostile = study_tables.Table(
        "x", "<script>alert(1)</script>", ("a",), [('"><img src=http://x>',)], ("<b>note</b>",)
    )
    page = study_page.render(results, [*tables.values(), hostile], series)
    assert "default-src 'none'" in page
    assert "<strong>Simulated.</strong>" in page
    assert "<script" not in page
    assert "<img" not in page
    assert "<b>note" not in page
    assert "&lt;script&gt;" in page
    links = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", page) + re.findall(r"url\(([^)]*)\)", page)
    assert links
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    assert page.count("<figure>") == len([f for f in study_page.figures(results) if results.has(*f.needs)]) == 20
    assert page.count("<h3>") == len(tables) + 1
    ids = re.findall(r'\sid="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert "0.272" in page  # the thesis's, Table 7.4
    (tmp_path / "parts" / f"{wanted[0].name}.npz").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(IrbcalError, match=r"damaged: delete it and nominal\.csv"):
        study_run.read_series(tmp_path, wanted[0])


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
def test_settings_that_make_no_study_are_refused(changes, sentence):
    with pytest.raises(IrbcalError) as caught:
        replace(SMALL, **changes)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
