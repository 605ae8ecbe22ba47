"""The tables of Nubiola 2011, chapter 7, from the rows of a study, with the thesis's figures beside, and all at once.

Everything here is read from ``results.csv``; nothing is computed but choices, medians and ratios. Tables that compare
many procedures are in `irbcal.studies.procedure_tables`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from irbcal.studies import procedure_tables, thesis
from irbcal.studies.results import (
    AREA_NAMES,
    COMPARED,
    KIND_NAMES,
    MODEL_NAMES,
    STATISTICS,
    SYMBOLS,
    Cell,
    Results,
    Table,
    Value,
)
from irbcal.studies.settings import (
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
from irbcal.studies.stage import SPHERE_POINTS, SPHERE_TURN
from irbcal.studies.trial import CYCLES

Four: TypeAlias = "tuple[float, float, float, float]"
"""Mean, sigma, maximum, mean + 3 sigma."""

# --- models, point by point -------------------------------------------------------------------------------


def table_7_1(results: Results) -> Table:
    """Nubiola 2011, Table 7.1: expected position error of the nominal model (section 7.7.1)."""
    rows: list[tuple[Value, ...]] = []
    for load in PAYLOADS:
        for k, area in enumerate(AREAS):
            beside = (*thesis.TABLE_7_1[load][k], thesis.TABLE_7_1_LAST[load][k])
            cells = results.cells(beside, NOMINAL, "expected", area, load)
            rows.append((AREA_NAMES[area], f"{load} kg", *cells))
    note = "Base and tool from moves of one joint; the link errors of the virtual robot were tuned on this table."
    title = "Nominal model, expected position error of 8 targets (mm)"
    return Table("7.1", title, ("area", "load", *SYMBOLS), tuple(rows), (note,))


_KINEMATIC_NOTE = (
    "Directly from the circles of target 1, without a fit. Such a model has no stiffness and takes the arm as it is "
    "bent in moves about zero joints. Without arm stiffness in the cell this error all but vanishes: the virtual arm "
    "seems to bend more between there and the areas than the thesis's."
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
    return _kinematic(results, "7.2", 3, MOVES, thesis.TABLE_7_2)


def table_7_3(results: Results) -> Table:
    """Nubiola 2011, Table 7.3: expected error of the calibration from 18 axis points, 6 kg (section 7.7.2)."""
    beside = {area: {18: values} for area, values in thesis.TABLE_7_3.items()}
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
    return _found(results, "7.4", FULL, 3, thesis.TABLE_7_4)


def table_7_5(results: Results) -> Table:
    """Nubiola 2011, Table 7.5: 34 parameters from 200 measurements, 6 kg (section 7.7.3.1)."""
    return _found(results, "7.5", FULL, 6, thesis.TABLE_7_5)


def table_7_6(results: Results) -> Table:
    """Nubiola 2011, Table 7.6: 11 parameters from 400 measurements, 3 kg (section 7.7.3.2)."""
    return _found(results, "7.6", SMALL, 3, thesis.TABLE_7_6)


def table_7_7(results: Results) -> Table:
    """Nubiola 2011, Table 7.7: 11 parameters from 400 measurements, 6 kg (section 7.7.3.2)."""
    return _found(results, "7.7", SMALL, 6, thesis.TABLE_7_7)


# --- poses ------------------------------------------------------------------------------------------------


def table_7_8(results: Results) -> Table:
    """Nubiola 2011, Table 7.8: position and orientation at the ISO 9283 poses, four models (section 7.7.3.4)."""
    rows: list[tuple[Value, ...]] = []
    for model, repetition in COMPARED.items():
        cells = []
        for quantity, beside in zip(("flange", "orientation"), thesis.TABLE_7_8[model], strict=True):
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
        (MODEL_NAMES[model], *_pose_cells(results, repetition, "iso_cube", thesis.TABLE_7_9[model]))
        for model, repetition in COMPARED.items()
    )
    title = "ISO cube: position reduced to the flange, and orientation, of the four models, 3 kg"
    return Table("7.9", title, ("model", *_POSE_COLUMNS), rows, (_POSES_NOTE,))


_RELATIVE_COLUMNS = ("model", *(f"{s} (mm)" for s in SYMBOLS))


def table_7_10(results: Results) -> Table:
    """Nubiola 2011, Table 7.10: errors relative to a virtual frame in a sphere of 400 mm (section 7.7.3.6)."""
    cells = results.cells(thesis.TABLE_7_10, FULL, "sphere_virtual_frame", "sphere")
    note = (
        f"{SPHERE_POINTS} poses in the sphere of 400 mm, a random target of eight in each, the tool turned up to "
        f"{np.degrees(SPHERE_TURN):.0f}° from its orientation at zero joints (the thesis does not say how)."
    )
    title = "Relative errors from a virtual frame, 3 kg"
    return Table("7.10", title, _RELATIVE_COLUMNS, (("34 parameters", *cells),), (note,))


def table_7_11(results: Results) -> Table:
    """Nubiola 2011, Table 7.11: errors relative to three points in the same sphere (section 7.7.3.7)."""
    cells = results.cells(thesis.TABLE_7_11, FULL, "sphere_three_points", "sphere")
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
        beside = thesis.TABLE_7_12.get(n) if model == "34" else None
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
    "7.13": procedure_tables.table_7_13,
    "7.14": procedure_tables.table_7_14,
    "7.15": procedure_tables.table_7_15,
    "7.16": procedure_tables.table_7_16,
    "procedures": procedure_tables.every_procedure,
    "targets": procedure_tables.unseen_targets,
    "curve": procedure_tables.error_curve,
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
    for table in found:
        numbers = [isinstance(cell, (Cell, int)) for cell in table.rows[0]]
        lines += ["", f"## {table.heading}", "", "| " + " | ".join(table.columns) + " |"]
        lines.append("| " + " | ".join("---:" if number else "---" for number in numbers) + " |")
        lines += ["| " + " | ".join(map(str, row)) + " |" for row in table.rows]
        lines += ["", *table.notes]
    return "\n".join(lines) + "\n"
