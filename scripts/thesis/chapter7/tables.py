"""The tables of Nubiola 2011, chapter 7, from the rows of a study, with the printed numbers beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from chapter7 import printed
from chapter7.settings import (
    AREAS,
    AXES,
    COURSE,
    FULL,
    MOVES,
    NOMINAL,
    PAYLOADS,
    SMALL,
    Repetition,
    Settings,
    curve,
    procedures,
)
from chapter7.trial import CYCLES, SPHERE_POINTS, SPHERE_TURN
from irbcal.arrays import FloatArray, lock

if TYPE_CHECKING:
    import pandas as pd

AREA_NAMES = {"iso_cube": "ISO cube", "all_range": "all range"}
STATISTICS = ("mean", "sigma", "max", "mean_plus_3sigma")
SYMBOLS = ("μ", "σ", "max", "μ+3σ")
KIND_NAMES = {"expected": "expected", "verified": "found", "verified_all": "found"}
MODEL_NAMES = {"nominal": "nominal", "11": "11 parameters", "axes": "kinematic", "34": "34 parameters"}
COMPARED = {"nominal": NOMINAL, "11": SMALL, "axes": AXES[18], "34": FULL}
"""The models of Nubiola 2011, Table 7.8 and Table 7.9."""


@dataclass(frozen=True)
class Cell:
    """A number of a study and the thesis's beside it; None where there is none."""

    value: float
    thesis: float | None = None
    digits: int = 3

    @property
    def number(self) -> str:
        """The study's number as text."""
        return f"{self.value:.{self.digits}f}"

    @property
    def beside(self) -> str:
        """The thesis's number as text; empty where there is none."""
        return "" if self.thesis is None else f"{self.thesis:.{self.digits}f}"

    def __str__(self) -> str:
        return f"{self.number} ({self.beside})" if self.beside else self.number


Value: TypeAlias = "str | int | Cell"
"""What stands in a table."""


@dataclass(frozen=True)
class Table:
    """A table ready to print.

    Attributes
    ----------
    key : str
        ``7.1`` and so on; a word for tables that the thesis has not.
    title : str
    columns : tuple of str
        Headings.
    rows : tuple of tuple
        Text, whole numbers and `Cell`.
    notes : tuple of str
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"Table {self.key}. {self.title}" if self.key[0].isdigit() else self.title

    def compared(self) -> Iterator[tuple[str, float]]:
        """Statistic and ratio to the thesis's number, of each number that the thesis has."""
        for row in self.rows:
            for heading, cell in zip(self.columns, row, strict=True):
                if isinstance(cell, Cell) and cell.thesis:
                    yield statistic_of(heading), cell.value / cell.thesis

    def markdown(self) -> str:
        """The table with the thesis's numbers in brackets, and its notes."""
        sides = ["---:" if isinstance(cell, (Cell, int)) else "---" for cell in self.rows[0]]
        lines = ["| " + " | ".join(map(str, row)) + " |" for row in (self.columns, sides, *self.rows)]
        return "\n".join([f"## {self.heading}", "", *lines, "", *self.notes])


def statistic_of(heading: str) -> str:
    """The statistic of `SYMBOLS` that a heading names; the objective and the like are largest errors."""
    words = heading.replace("mean", SYMBOLS[0]).split()
    return next((symbol for symbol in reversed(SYMBOLS) if symbol in words), "max")


def agreement(tables: Iterable[Table], within: float = 0.2) -> str:
    """How many numbers of the tables lie near the thesis's, by statistic.

    Parameters
    ----------
    tables : iterable of Table
    within : float
        Largest relative difference that counts as near.
    """
    ratios: dict[str, list[float]] = {symbol: [] for symbol in SYMBOLS}
    for table in tables:
        for statistic, ratio in table.compared():
            ratios[statistic].append(ratio)
    parts = [
        f"{symbol} {sum(abs(r - 1.0) <= within for r in found)} of {len(found)} (median ratio {np.median(found):.2f})"
        for symbol, found in ratios.items()
        if found
    ]
    return f"Within {100 * within:g} % of the thesis: {', '.join(parts)}."


class Results:
    """The rows of a study by what they say.

    Parameters
    ----------
    frame : DataFrame
        As ``results.csv``.
    settings : Settings
    """

    def __init__(self, frame: pd.DataFrame, settings: Settings) -> None:
        self.frame, self.settings = frame, settings
        keys = ["repetition", "kind", "area", "payload_kg", "targets", "quantity"]
        first = frame.drop_duplicates(keys)  # the method of the settings comes first
        self.rows: dict[tuple[Any, ...], dict[str, Any]] = first.set_index(keys).to_dict("index")
        second = frame[frame.duplicated(keys)].drop_duplicates(keys)
        self.least_squares: dict[tuple[Any, ...], dict[str, Any]] = second.set_index(keys).to_dict("index")

    def has(self, *repetitions: Repetition) -> bool:
        """Whether these repetitions are done."""
        done = set(self.frame["repetition"])
        return all(r.name in done for r in repetitions)

    def row(
        self,
        repetition: Repetition,
        kind: str,
        area: str,
        load: int = PAYLOADS[0],
        targets: str | None = None,
        quantity: str = "point",
        least_squares: bool = False,
    ) -> dict[str, Any]:
        """One row as a dict."""
        if targets is None:
            targets = "1-3" if kind in ("poses", "iso9283") else "1-8"
        rows = self.least_squares if least_squares else self.rows
        return rows[repetition.name, kind, area, load, targets, quantity]

    def cells(
        self, thesis: Sequence[float] | None, *query: Any, names: Sequence[str] = STATISTICS, **options: Any
    ) -> list[Cell]:
        """Statistics of a row beside the thesis's; query and options as `row`."""
        found = self.row(*query, **options)
        known: Sequence[float | None] = thesis or (None,) * len(names)
        return [Cell(found[name], beside) for name, beside in zip(names, known, strict=True)]

    def worst(self, repetition: Repetition, least_squares: bool = False) -> tuple[float, ...]:
        """Largest expected error in the ISO cube and in the whole range, 3 kg."""
        return tuple(self.row(repetition, "expected", area, least_squares=least_squares)["max"] for area in AREAS)


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
    same = settings.procedures == printed.SIZES and settings.model == "34"
    out = []
    for k, (repetition, reason) in enumerate(reasons):
        letter = chr(ord("A") + k)
        beside = {name: getattr(printed, f"TABLE_7_{name}")[letter] for name in range(13, 17)} if same else {}
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


Four: TypeAlias = "tuple[float, float, float, float]"
"""Mean, sigma, maximum, mean + 3 sigma."""

# --- models, point by point -------------------------------------------------------------------------------


def table_7_1(results: Results) -> Table:
    """Nubiola 2011, Table 7.1: expected position error of the nominal model (section 7.7.1)."""
    rows: list[tuple[Value, ...]] = []
    for load in PAYLOADS:
        for k, area in enumerate(AREAS):
            beside = (*printed.TABLE_7_1[load][k], printed.TABLE_7_1_LAST[load][k])
            cells = results.cells(beside, NOMINAL, "expected", area, load)
            rows.append((AREA_NAMES[area], f"{load} kg", *cells))
    note = "Base and tool from moves of one joint; the link errors of the virtual robot were tuned on this table."
    title = "Nominal model, expected position error of 8 targets (mm)"
    return Table("7.1", title, ("area", "load", *SYMBOLS), tuple(rows), (note,))


_KINEMATIC_NOTE = (
    "Directly from the circles of target 1, without a fit. Such a model has no stiffness: it takes the arm as bent "
    "about zero joints, and the error comes from postures in which the arm reaches back over the base and bends the "
    "other way (docs/study.md has the figures)."
)


def _kinematic(
    results: Results,
    key: str,
    load: int,
    counts: Iterable[int],
    beside: Mapping[str, Mapping[int, Sequence[tuple[float, float, float]]]],
    *notes: str,
) -> Table:
    """Expected errors of calibrations from axis points (section 7.7.2), of target 1 and of all eight."""
    rows: list[tuple[Value, ...]] = []
    for area in AREAS:
        for count in counts:
            row: list[Value] = [AREA_NAMES[area], f"{count} points"]
            for k, targets in enumerate(("1", "1-8")):
                query = (AXES[count], "expected", area, load)
                row += results.cells(beside[area][count][k], *query, targets=targets, names=STATISTICS[:3])
            rows.append(tuple(row))
    columns = ("area", "made from", *(f"{who}: {s}" for who in ("target 1", "8 targets") for s in SYMBOLS[:3]))
    title = f"Kinematic calibration by axes, expected position error, {load} kg (mm)"
    return Table(key, title, columns, tuple(rows), (_KINEMATIC_NOTE, *notes))


def table_7_2(results: Results) -> Table:
    """Nubiola 2011, Table 7.2: expected error of calibrations from 18 to 158 axis points, 3 kg (section 7.7.2)."""
    return _kinematic(results, "7.2", 3, MOVES, printed.TABLE_7_2)


def table_7_3(results: Results) -> Table:
    """Nubiola 2011, Table 7.3: expected error of the calibration from 18 axis points, 6 kg (section 7.7.2)."""
    beside = {area: {18: values} for area, values in printed.TABLE_7_3.items()}
    note = "The thesis's print has lost the order of its columns; read here as in Table 7.2."
    return _kinematic(results, "7.3", 6, (18,), beside, note)


_AREA_COLUMNS = tuple(f"{AREA_NAMES[area]}: {s}" for area in AREAS for s in SYMBOLS)


def _found(
    results: Results, key: str, repetition: Repetition, load: int, beside: Mapping[str, tuple[Four, Four]]
) -> Table:
    """Expected errors of one calibration against those found with its fake targets."""
    rows: list[tuple[Value, ...]] = []
    for kind, of_areas in beside.items():
        count = results.row(repetition, kind, AREAS[0], load)["n"]
        cells = [c for k, area in enumerate(AREAS) for c in results.cells(of_areas[k], repetition, kind, area, load)]
        rows.append((f"{KIND_NAMES[kind]}, {count} points", *cells))
    notes = [
        "Expected: the model at measured poses. Found: fake targets of the model, moved to and measured (section 7.6). "
        "Points that were lost or have no fake target within the joint limits are left out."
    ]
    if results.settings.method != "least-squares":
        medians = [results.row(repetition, "expected", area, load, least_squares=True) for area in AREAS]
        least = "; ".join(
            f"{AREA_NAMES[a]} μ {r['mean']:.3f}, max {r['max']:.3f}" for a, r in zip(AREAS, medians, strict=True)
        )
        notes.append(f"The same measurements by least squares, expected: {least}.")
    notes.append("The first random choice of measurements; the thesis shows one of the best of many.")
    title = f"{repetition.model}-parameter calibration from {repetition.measures} measurements, {load} kg (mm)"
    return Table(key, title, ("error (mm)", *_AREA_COLUMNS), tuple(rows), tuple(notes))


def table_7_4(results: Results) -> Table:
    """Nubiola 2011, Table 7.4: 34 parameters from 200 measurements, 3 kg (section 7.7.3.1)."""
    return _found(results, "7.4", FULL, 3, printed.TABLE_7_4)


def table_7_5(results: Results) -> Table:
    """Nubiola 2011, Table 7.5: 34 parameters from 200 measurements, 6 kg (section 7.7.3.1)."""
    return _found(results, "7.5", FULL, 6, printed.TABLE_7_5)


def table_7_6(results: Results) -> Table:
    """Nubiola 2011, Table 7.6: 11 parameters from 400 measurements, 3 kg (section 7.7.3.2)."""
    return _found(results, "7.6", SMALL, 3, printed.TABLE_7_6)


def table_7_7(results: Results) -> Table:
    """Nubiola 2011, Table 7.7: 11 parameters from 400 measurements, 6 kg (section 7.7.3.2)."""
    return _found(results, "7.7", SMALL, 6, printed.TABLE_7_7)


# --- poses ------------------------------------------------------------------------------------------------


def table_7_8(results: Results) -> Table:
    """Nubiola 2011, Table 7.8: position and orientation at the ISO 9283 poses, four models (section 7.7.3.4)."""
    rows: list[tuple[Value, ...]] = []
    for model, repetition in COMPARED.items():
        cells = []
        for quantity, beside in zip(("flange", "orientation"), printed.TABLE_7_8[model], strict=True):
            query = (repetition, "iso9283", "iso_poses")
            cells += results.cells(beside, *query, quantity=quantity, names=("mean", "max"))
        rows.append((MODEL_NAMES[model], *cells))
    columns = ("model", "position: mean (mm)", "max (mm)", "orientation: mean (°)", "max (°)")
    notes = (
        f"Five poses in {CYCLES} cycles with fake targets of each model, targets 1 to 3, 3 kg. P1 lies at the wrist's "
        "singularity: where a model has no fake target for it, it is left out.",
        "The kinematic model is that of 18 axis points.",
    )
    title = "ISO 9283 poses: position reduced to the flange, and orientation, 3 kg"
    return Table("7.8", title, columns, tuple(rows), notes)


_POSE_COLUMNS = (*(f"position: {s} (mm)" for s in SYMBOLS), *(f"orientation: {s} (°)" for s in SYMBOLS))
_POSES_NOTE = (
    "ISO cube, as the thesis's conclusion says of its Table 7.9; poses with targets 1 to 3 in sight, fake targets."
)


def _pose_cells(results: Results, repetition: Repetition, area: str, beside: tuple[Four, Four] | None) -> list[Cell]:
    return [
        cell
        for quantity, four in zip(("flange", "orientation"), beside or (None, None), strict=True)
        for cell in results.cells(four, repetition, "poses", area, quantity=quantity)
    ]


def table_7_9(results: Results) -> Table:
    """Nubiola 2011, Table 7.9: position and orientation of 1,000 poses in the ISO cube, four models.

    Nubiola 2011, section 7.7.3.5; that these poses lie in the ISO cube is said in the conclusion.
    """
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (MODEL_NAMES[model], *_pose_cells(results, repetition, "iso_cube", printed.TABLE_7_9[model]))
        for model, repetition in COMPARED.items()
    )
    title = "ISO cube: position reduced to the flange, and orientation, of the four models, 3 kg"
    return Table("7.9", title, ("model", *_POSE_COLUMNS), rows, (_POSES_NOTE,))


_RELATIVE_COLUMNS = ("model", *(f"{s} (mm)" for s in SYMBOLS))


def table_7_10(results: Results) -> Table:
    """Nubiola 2011, Table 7.10: errors relative to a virtual frame in a sphere of 400 mm (section 7.7.3.6)."""
    cells = results.cells(printed.TABLE_7_10, FULL, "sphere_virtual_frame", "sphere")
    note = (
        f"{SPHERE_POINTS} poses in the sphere of 400 mm, a random target of eight in each, the tool turned up to "
        f"{np.degrees(SPHERE_TURN):.0f}° from its orientation at zero joints (the thesis does not say how)."
    )
    title = "Relative errors from a virtual frame, 3 kg"
    return Table("7.10", title, _RELATIVE_COLUMNS, (("34 parameters", *cells),), (note,))


def table_7_11(results: Results) -> Table:
    """Nubiola 2011, Table 7.11: errors relative to three points in the same sphere (section 7.7.3.7)."""
    cells = results.cells(printed.TABLE_7_11, FULL, "sphere_three_points", "sphere")
    note = "The frame is that of three of the same points, far apart; the thesis measured three targets in three poses."
    title = "Relative errors from three points, 3 kg"
    return Table("7.11", title, _RELATIVE_COLUMNS, (("34 parameters", *cells),), (note,))


def table_7_12(results: Results) -> Table:
    """Nubiola 2011, Table 7.12: position and orientation of a procedure of each size (section 7.7.4).

    The poses are those of Table 7.9, in the ISO cube.
    """
    model = results.settings.model
    rows: list[tuple[Value, ...]] = []
    for n in results.settings.procedures:
        beside = printed.TABLE_7_12.get(n) if model == "34" else None
        rows.append((f"{n} measures", *_pose_cells(results, Repetition(model, n), "iso_cube", beside)))
    title = f"ISO cube: position and orientation of the {model}-parameter procedures, 3 kg"
    notes = (_POSES_NOTE, "The first procedure of each size; its measurements are drawn anew for each procedure.")
    return Table("7.12", title, ("procedure from", *_POSE_COLUMNS), tuple(rows), notes)


# --- all of them ------------------------------------------------------------------------------------------

BUILDERS: dict[str, Callable[[Results], Table]] = {
    "7.1": table_7_1,
    "7.2": table_7_2,
    "7.3": table_7_3,
    "7.4": table_7_4,
    "7.5": table_7_5,
    "7.6": table_7_6,
    "7.7": table_7_7,
    "7.8": table_7_8,
    "7.9": table_7_9,
    "7.10": table_7_10,
    "7.11": table_7_11,
    "7.12": table_7_12,
    "7.13": table_7_13,
    "7.14": table_7_14,
    "7.15": table_7_15,
    "7.16": table_7_16,
    "procedures": every_procedure,
    "targets": unseen_targets,
    "curve": error_curve,
}
TABLES = tuple(BUILDERS)
"""Names of the tables, as they can be asked for."""


def needed(settings: Settings) -> dict[str, list[Repetition]]:
    """Table -> repetitions that it is made from."""
    twenty, sizes = procedures(settings), [Repetition(settings.model, n) for n in settings.procedures]
    four = list(COMPARED.values())
    table = {"7.1": [NOMINAL], "7.2": list(AXES.values()), "7.3": [AXES[18]]}
    table |= {"7.4": [FULL], "7.5": [FULL], "7.6": [SMALL], "7.7": [SMALL]}
    table |= {"7.8": four, "7.9": four, "7.10": [FULL], "7.11": [FULL], "7.12": sizes}
    table |= dict.fromkeys(("7.13", "7.14", "7.15", "7.16"), twenty)
    return table | {"procedures": twenty, "targets": twenty, "curve": curve(settings), "course": [COURSE]}


def tables(results: Results) -> list[Table]:
    """All tables that the rows at hand can fill, in order."""
    return [
        BUILDERS[key](results)
        for key, repetitions in needed(results.settings).items()
        if key in BUILDERS and repetitions and results.has(*repetitions)
    ]


def markdown(found: Sequence[Table], settings: Settings) -> str:
    """``tables.md``.

    Parameters
    ----------
    found : sequence of Table
    settings : Settings

    Returns
    -------
    str
    """
    lines = [
        "# Study of Nubiola 2011, chapter 7: SIMULATED",
        "",
        "All figures come from the virtual cell; in brackets the thesis's, of a real robot.",
        f"{len(settings.procedures) * settings.each} procedures of the {settings.model}-parameter model by "
        f"{settings.method}, {settings.points} verification points in each area with each payload, "
        f"seed {settings.seed}.",
    ]
    return "\n".join([*lines, *(f"\n{table.markdown()}" for table in found)]) + "\n"
