"""Tables of the thesis from the rows of a study, read once more with pandas."""

import pytest

from irbcal.studies.results import Cell
from irbcal.studies.settings import AREAS, NOMINAL
from irbcal.studies.tables import TABLES, markdown

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
