"""Tables that compare the procedures of a study: worst and best of them, all of them, error against measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.studies import thesis
from irbcal.studies.results import AREA_NAMES, SYMBOLS, Cell, Results, Table, Value
from irbcal.studies.settings import AREAS, PAYLOADS, Repetition, procedures


@dataclass(frozen=True)
class Chosen:
    """A procedure of Nubiola 2011, Table 7.13: its letter, its repetition, why it is shown.

    Attributes
    ----------
    letter : str
    repetition : Repetition
    reason : str
    thesis : dict of int to tuple of float
        Number of the table after 7 -> the thesis's row; empty where the study's sizes are not the thesis's.
    """

    letter: str
    repetition: Repetition
    reason: str
    thesis: Mapping[int, tuple[float, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        lock(self)


def chosen(results: Results) -> list[Chosen]:
    """The worst procedure of each size and the best of all, by the larger of the two largest expected errors.

    Returns
    -------
    list of Chosen
        In the order of Nubiola 2011, Table 7.13: worst of the first size, best of all, worst of the others.
    """
    settings = results.settings
    every = procedures(settings)
    by_error = sorted(every, key=lambda r: max(results.worst(r)))
    worst = {n: [r for r in by_error if r.measures == n][-1] for n in settings.procedures}
    reasons = [(r, f"worst of the {n}-measurement procedures") for n, r in worst.items()]
    reasons = [(r, f"{text}; worst of all the {len(every)}" if r == by_error[-1] else text) for r, text in reasons]
    reasons.insert(1, (by_error[0], f"best of all the {len(every)} procedures"))
    same = settings.procedures == thesis.SIZES and settings.model == "34"
    out = []
    for k, (repetition, reason) in enumerate(reasons):
        letter = chr(ord("A") + k)
        beside = {name: getattr(thesis, f"TABLE_7_{name}")[letter] for name in range(13, 17)} if same else {}
        out.append(Chosen(letter, repetition, reason, beside))
    return out


def table_7_13(results: Results) -> Table:
    """Nubiola 2011, Table 7.13: worst procedure of each size and the best of all, expected (section 7.7.5)."""
    rows: list[tuple[Value, ...]] = []
    for item in chosen(results):
        beside = item.thesis.get(13, (None,) * 3)
        values = (*results.worst(item.repetition), results.row(item.repetition, "expected", AREAS[0])["objective_mm"])
        cells = [Cell(value, known) for value, known in zip(values, beside, strict=True)]
        rows.append((item.letter, item.repetition.measures, *cells, item.reason))
    columns = ("procedure", "measures", "max expected, ISO cube", "max expected, all range", "objective", "remark")
    notes = ["The thesis's B came from 120 measurements, and its E was the worst of all."]
    if results.settings.method != "least-squares":
        notes.append(f"By least squares from the same measurements, all procedures: {_least_squares(results)}.")
    title = f"Best and worst of {len(procedures(results.settings))} procedures, 3 kg (mm)"
    return Table("7.13", title, columns, tuple(rows), tuple(notes))


def _least_squares(results: Results) -> str:
    found = np.array([results.worst(r, least_squares=True) for r in procedures(results.settings)])
    return "; ".join(
        f"max expected, {AREA_NAMES[area]}, {low:.3f} to {high:.3f}"
        for area, low, high in zip(AREAS, found.min(axis=0), found.max(axis=0), strict=True)
    )


def _of_letters(
    results: Results, key: str, title: str, note: str, *query: Any, unit: str = "mm", quantity: str = "point"
) -> Table:
    """Statistics of the chosen procedures, a row for each letter."""
    rows: list[tuple[Value, ...]] = [
        (
            item.letter,
            *results.cells(item.thesis.get(int(key.split(".")[1])), item.repetition, *query, quantity=quantity),
        )
        for item in chosen(results)
    ]
    return Table(key, title, ("procedure", *(f"{s} ({unit})" for s in SYMBOLS)), tuple(rows), (note,))


def table_7_14(results: Results) -> Table:
    """Nubiola 2011, Table 7.14: position errors found in the whole range with 6 kg (section 7.7.5.1)."""
    title = "Position error of the procedures, all range, 6 kg"
    note = "Fake targets, the same poses for all procedures, eight targets."
    return _of_letters(results, "7.14", title, note, "verified", "all_range", 6)


def table_7_15(results: Results) -> Table:
    """Nubiola 2011, Table 7.15: position reduced to the flange, ISO cube, 3 kg (section 7.7.5.2)."""
    title = "Position reduced to the flange, ISO cube, 3 kg"
    note = "Fake targets, the same poses for all procedures, targets 1 to 3."
    return _of_letters(results, "7.15", title, note, "poses", "iso_cube", 3, quantity="flange")


def table_7_16(results: Results) -> Table:
    """Nubiola 2011, Table 7.16: orientation, ISO cube, 3 kg (section 7.7.5.2)."""
    title, note = "Orientation, ISO cube, 3 kg", "As Table 7.15."
    return _of_letters(results, "7.16", title, note, "poses", "iso_cube", 3, unit="°", quantity="orientation")


# --- what the thesis has no table of ----------------------------------------------------------------------


def every_procedure(results: Results) -> Table:
    """Expected and found errors of all procedures (Nubiola 2011, section 7.6: they agree)."""
    rows: list[tuple[Value, ...]] = []
    for r in procedures(results.settings):
        cells = []
        for area, load in ((AREAS[0], 3), (AREAS[1], 6)):
            for kind in ("expected", "verified"):
                cells += results.cells(None, r, kind, area, load, names=("mean", "max"))
        rows.append((r.measures, r.index, *cells, Cell(results.row(r, "expected", AREAS[0])["objective_mm"])))
    head = [
        f"{where}: {kind} {s}"
        for where in ("cube 3 kg", "range 6 kg")
        for kind in ("expected", "found")
        for s in ("μ", "max")
    ]
    ratio = [
        results.row(r, "verified", area, load)["mean"] / results.row(r, "expected", area, load)["mean"]
        for r in procedures(results.settings)
        for area in AREAS
        for load in PAYLOADS
    ]
    notes = (
        f"Found over expected mean, all areas and payloads: {min(ratio):.3f} to {max(ratio):.3f}, "
        f"median {np.median(ratio):.3f}. Found maxima are of an eighth as many points, so mostly smaller.",
    )
    title = "Every procedure: expected against found (mm)"
    return Table("procedures", title, ("measures", "no.", *head, "objective"), tuple(rows), notes)


def unseen_targets(results: Results) -> Table:
    """Targets that were identified with against those that were not (Nubiola 2011, section 7.7)."""
    rows: list[tuple[Value, ...]] = []
    for area in AREAS:
        for load in PAYLOADS:
            cells = []
            for targets in ("1-3", "4-8"):
                found = [results.row(r, "expected", area, load, targets=targets) for r in procedures(results.settings)]
                cells += [Cell(float(np.median([row[name] for row in found]))) for name in ("mean", "max")]
            rows.append((AREA_NAMES[area], f"{load} kg", *cells))
    columns = ("area", "load", "targets 1 to 3: μ", "max", "targets 4 to 8: μ", "max")
    note = "Medians of all procedures. Only targets 1 to 3, with 3 kg, were identified with."
    title = "Targets and payloads that the identification never saw (mm)"
    return Table("targets", title, columns, tuple(rows), (note,))


def curve_values(results: Results, least_squares: bool = False) -> dict[tuple[str, str], FloatArray]:
    """Expected errors against the number of measurements, 3 kg, targets 1 to 8.

    Returns
    -------
    dict of tuple to ndarray, shape (sizes, repetitions)
        (area, ``mean`` or ``max``) -> mm.
    """
    settings = results.settings

    def of(n: int, k: int, area: str) -> dict[str, Any]:
        return results.row(Repetition(settings.model, n, k + 1), "expected", area, least_squares=least_squares)

    return {
        (area, name): np.array([[of(n, k, area)[name] for k in range(settings.each)] for n in settings.curve])
        for area in AREAS
        for name in ("mean", "max")
    }


def error_curve(results: Results) -> Table:
    """Expected error against the number of measurements (Nubiola 2011, section 7.7.3: from 80 to 1000)."""
    settings = results.settings
    methods = [settings.method] + (["least-squares"] if settings.method != "least-squares" else [])
    rows: list[tuple[Value, ...]] = []
    for k, method in enumerate(methods):
        values = curve_values(results, least_squares=k > 0)
        for i, n in enumerate(settings.curve):
            cells = []
            for key in ((a, s) for a in AREAS for s in ("mean", "max")):
                middle, low, high = np.median(values[key][i]), values[key][i].min(), values[key][i].max()
                cells.append(f"{middle:.3f} ({low:.3f} to {high:.3f})")
            rows.append((method, n, *cells))
    columns = ("method", "measures", *(f"{AREA_NAMES[a]}: {s}" for a in AREAS for s in ("μ", "max")))
    title = f"Expected error against the number of measurements, {settings.model} parameters, 3 kg (mm)"
    note = f"Median of {settings.each} choices, least and most in brackets."
    return Table("curve", title, columns, tuple(rows), (note,))
