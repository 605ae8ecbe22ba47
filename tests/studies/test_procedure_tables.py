"""The procedures A to E: letters and the thesis's figures beside them."""

from dataclasses import replace

import pandas as pd

from irbcal.studies.procedure_tables import chosen
from irbcal.studies.results import Cell, Results


def thesis_of(table, row):
    """The thesis's numbers of a table's row."""
    return [cell.thesis for cell in table.rows[row] if isinstance(cell, Cell)]


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
