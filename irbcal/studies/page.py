"""``page.html`` of a study: its figures and tables as one self-contained page that runs no script and loads nothing.

No text but this room's own goes into the figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from irbcal.figures import inline_svg
from irbcal.figures.colours import CALIBRATED
from irbcal.studies.figures import Series, figures
from irbcal.studies.results import Cell, Results, Table
from irbcal.studies.settings import NOMINAL, procedures


def render(results: Results, tables: Sequence[Table], series: Series) -> str:
    """The page.

    Parameters
    ----------
    results : Results
    tables : sequence of Table
    series : dict of Repetition to dict of str to ndarray
        Errors one by one of `irbcal.studies.figures.drawn`.

    Returns
    -------
    str
    """
    from irbcal.templates import environment

    sections: dict[str, list[tuple[str, Any]]] = {}
    with inline_svg.style():
        for item in figures(results):
            if results.has(*item.needs):
                drawing = inline_svg.drawn(partial(item.draw, results=results, series=series), item.key, item.caption)
                sections.setdefault(item.section, []).append((item.caption, drawing))
    return (
        environment("irbcal.studies")
        .get_template("study.html.j2")
        .render(
            settings=results.settings,
            procedures=len(procedures(results.settings)),
            sections=sections,
            tables=tables,
            verdict=verdict(results),
            calibrated=CALIBRATED,
            is_cell=lambda value: isinstance(value, Cell),
            is_number=lambda value: isinstance(value, (Cell, int)),
        )
    )


def verdict(results: Results) -> str | None:
    """What the procedures came to, in a sentence; None while they are not done."""
    settings = results.settings
    every = procedures(settings)
    if not results.has(*every):
        return None
    found = [results.row(r, "verified", "all_range") for r in every]
    expected = [results.row(r, "expected", "all_range") for r in every]
    before = results.row(NOMINAL, "verified", "all_range")["mean"] if results.has(NOMINAL) else None
    low, high = min(row["mean"] for row in found), max(row["mean"] for row in found)
    ratio = np.median([a["mean"] / b["mean"] for a, b in zip(found, expected, strict=True)])
    start = f"{len(every)} simulated calibrations by {settings.method}: with fake targets the virtual robot"
    where = "in the whole range with 3 kg"
    nominal = f" ({before:.3f} mm without)" if before is not None else ""
    return (
        f"{start} misses by {low:.3f} to {high:.3f} mm on average {where}{nominal}; "
        f"that is {ratio:.2f} times what the models had promised (median)."
    )
