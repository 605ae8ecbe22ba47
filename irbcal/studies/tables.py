"""Tables 7.1 to 7.16 of Nubiola 2011 from the rows of a study, with the thesis's figures beside, and a few more.

Everything here is read from ``results.csv``; nothing is computed but choices, medians and ratios.
"""

from dataclasses import dataclass, field

import numpy as np

from irbcal.studies import repetition as study
from irbcal.studies import thesis as study_thesis
from irbcal.studies.repetition import AREAS, PAYLOADS, Repetition

AREA_NAMES = {"iso_cube": "ISO cube", "all_range": "all range"}
STATISTICS = ("mean", "sigma", "max", "mean_plus_3sigma")
SYMBOLS = ("μ", "σ", "max", "μ+3σ")
KIND_NAMES = {"expected": "expected", "verified": "found", "verified_all": "found"}
MODEL_NAMES = {"nominal": "nominal", "11": "11 parameters", "axes": "kinematic", "34": "34 parameters"}
COMPARED = {"nominal": study.NOMINAL, "11": study.SMALL, "axes": study.AXES[18], "34": study.FULL}
"""The models of Tables 7.8 and 7.9."""


@dataclass(frozen=True)
class Cell:
    """A number of a study and the thesis's beside it; None where there is none."""

    value: float
    thesis: float | None = None
    digits: int = 3

    @property
    def number(self):
        """The study's number as text."""
        return f"{self.value:.{self.digits}f}"

    @property
    def beside(self):
        """The thesis's number as text; empty where there is none."""
        return "" if self.thesis is None else f"{self.thesis:.{self.digits}f}"

    def __str__(self):
        return f"{self.number} ({self.beside})" if self.beside else self.number


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
    rows : list of tuple
        Text, whole numbers and `Cell`.
    notes : tuple of str
    """

    key: str
    title: str
    columns: tuple
    rows: list
    notes: tuple = ()

    @property
    def heading(self):
        """Number and title."""
        return f"Table {self.key}. {self.title}" if self.key[0].isdigit() else self.title


class Results:
    """The rows of a study by what they say.

    Parameters
    ----------
    frame : DataFrame
        As ``results.csv``.
    settings : Settings
    """

    def __init__(self, frame, settings):
        self.frame, self.settings = frame, settings
        keys = ["repetition", "kind", "area", "payload_kg", "targets", "quantity"]
        first = frame.drop_duplicates(keys)  # the method of the settings comes first
        self.rows = first.set_index(keys).to_dict("index")
        second = frame[frame.duplicated(keys)].drop_duplicates(keys)
        self.least_squares = second.set_index(keys).to_dict("index")

    def has(self, *repetitions):
        """Whether these repetitions are done."""
        done = set(self.frame["repetition"])
        return all(r.name in done for r in repetitions)

    def row(self, repetition, kind, area, load=PAYLOADS[0], targets=None, quantity="point", least_squares=False):
        """One row as a dict."""
        if targets is None:
            targets = "1-3" if kind in ("poses", "iso9283") else "1-8"
        rows = self.least_squares if least_squares else self.rows
        return rows[repetition.name, kind, area, load, targets, quantity]

    def cells(self, thesis, *query, names=STATISTICS, **options):
        """Statistics of a row beside the thesis's."""
        found = self.row(*query, **options)
        thesis = thesis or (None,) * len(names)
        return [Cell(found[name], beside) for name, beside in zip(names, thesis, strict=True)]

    def worst(self, repetition, least_squares=False):
        """Largest expected error in the ISO cube and in the whole range, 3 kg."""
        return tuple(self.row(repetition, "expected", area, least_squares=least_squares)["max"] for area in AREAS)


def needed(settings):
    """Table -> repetitions that it is made from."""
    twenty, sizes = study.procedures(settings), [Repetition(settings.model, n) for n in settings.procedures]
    four = list(COMPARED.values())
    table = {"7.1": [study.NOMINAL], "7.2": list(study.AXES.values()), "7.3": [study.AXES[18]]}
    table |= {"7.4": [study.FULL], "7.5": [study.FULL], "7.6": [study.SMALL], "7.7": [study.SMALL]}
    table |= {"7.8": four, "7.9": four, "7.10": [study.FULL], "7.11": [study.FULL], "7.12": sizes}
    table |= dict.fromkeys(("7.13", "7.14", "7.15", "7.16"), twenty)
    return table | {"procedures": twenty, "targets": twenty, "curve": study.curve(settings), "course": [study.COURSE]}


def tables(results):
    """All tables that the rows at hand can fill, in order."""
    return [
        BUILDERS[key](results)
        for key, repetitions in needed(results.settings).items()
        if key in BUILDERS and repetitions and results.has(*repetitions)
    ]


# --- the thesis's -----------------------------------------------------------------------------------------


def _nominal(results):
    rows = []
    for load in PAYLOADS:
        for k, area in enumerate(AREAS):
            thesis = (*study_thesis.TABLE_7_1[load][k], study_thesis.TABLE_7_1_LAST[load][k])
            cells = results.cells(thesis, study.NOMINAL, "expected", area, load)
            rows.append((AREA_NAMES[area], f"{load} kg", *cells))
    note = "Base and tool from moves of one joint; the link errors of the virtual robot were tuned on this table."
    return Table(
        "7.1", "Nominal model, expected position error of 8 targets (mm)", ("area", "load", *SYMBOLS), rows, (note,)
    )


_KINEMATIC_NOTE = (
    "Directly from the circles of target 1, without a fit. Such a model has no stiffness and takes the arm as it is "
    "bent in moves about zero joints. Without arm stiffness in the cell this error all but vanishes: the virtual arm "
    "seems to bend more between there and the areas than the thesis's."
)


def _kinematic(results, key, title, counts, load, thesis):
    rows = []
    for area in AREAS:
        for count in counts:
            row = [AREA_NAMES[area], f"{count} points"]
            for k, targets in enumerate(("1", "1-8")):
                beside = thesis[area][count][k]
                query = (study.AXES[count], "expected", area, load)
                row += results.cells(beside, *query, targets=targets, names=STATISTICS[:3])
            rows.append(tuple(row))
    columns = ("area", "made from", *(f"{who}: {s}" for who in ("target 1", "8 targets") for s in SYMBOLS[:3]))
    return Table(key, title, columns, rows, (_KINEMATIC_NOTE,))


def _table_7_2(results):
    title = "Kinematic calibration by axes, expected position error, 3 kg (mm)"
    return _kinematic(results, "7.2", title, tuple(study.MOVES), 3, study_thesis.TABLE_7_2)


def _table_7_3(results):
    title = "Kinematic calibration by axes, expected position error, 6 kg (mm)"
    beside = {area: {18: values} for area, values in study_thesis.TABLE_7_3.items()}
    found = _kinematic(results, "7.3", title, (18,), 6, beside)
    note = "The thesis's print has lost the order of its columns; read here as in Table 7.2."
    return Table(found.key, found.title, found.columns, found.rows, (*found.notes, note))


_AREA_COLUMNS = tuple(f"{AREA_NAMES[area]}: {s}" for area in AREAS for s in SYMBOLS)


def _found(results, key, title, repetition, load, thesis):
    rows = []
    for kind, beside in thesis.items():
        count = results.row(repetition, kind, AREAS[0], load)["n"]
        cells = [c for k, area in enumerate(AREAS) for c in results.cells(beside[k], repetition, kind, area, load)]
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
    return Table(key, title, ("error (mm)", *_AREA_COLUMNS), rows, tuple(notes))


def _model(key, repetition, load):
    def build(results):
        title = f"{repetition.model}-parameter calibration from {repetition.measures} measurements, {load} kg (mm)"
        return _found(results, key, title, repetition, load, getattr(study_thesis, f"TABLE_{key.replace('.', '_')}"))

    return build


def _table_7_8(results):
    rows = []
    for model, repetition in COMPARED.items():
        cells = []
        for quantity, beside in zip(("flange", "orientation"), study_thesis.TABLE_7_8[model], strict=True):
            query = (repetition, "iso9283", "iso_poses")
            cells += results.cells(beside, *query, quantity=quantity, names=("mean", "max"))
        rows.append((MODEL_NAMES[model], *cells))
    columns = ("model", "position: mean (mm)", "max (mm)", "orientation: mean (°)", "max (°)")
    notes = (
        f"Five poses in {study.CYCLES} cycles with fake targets of each model, targets 1 to 3, 3 kg. P1 lies at the "
        "wrist's singularity: where a model has no fake target for it, it is left out.",
        "The kinematic model is that of 18 axis points.",
    )
    return Table("7.8", "ISO 9283 poses: position reduced to the flange, and orientation, 3 kg", columns, rows, notes)


_POSE_COLUMNS = (*(f"position: {s} (mm)" for s in SYMBOLS), *(f"orientation: {s} (°)" for s in SYMBOLS))


def _pose_cells(results, repetition, area, thesis):
    thesis = thesis or (None, None)
    return [
        cell
        for quantity, beside in zip(("flange", "orientation"), thesis, strict=True)
        for cell in results.cells(beside, repetition, "poses", area, quantity=quantity)
    ]


_POSES_NOTE = "Whole range (the thesis does not say where); poses with targets 1 to 3 in sight, fake targets."


def _table_7_9(results):
    rows = [
        (MODEL_NAMES[model], *_pose_cells(results, repetition, "all_range", study_thesis.TABLE_7_9[model]))
        for model, repetition in COMPARED.items()
    ]
    title = "Position reduced to the flange, and orientation, of the four models, 3 kg"
    return Table("7.9", title, ("model", *_POSE_COLUMNS), rows, (_POSES_NOTE,))


def _table_7_10(results):
    cells = results.cells(study_thesis.TABLE_7_10, study.FULL, "sphere_virtual_frame", "sphere")
    note = (
        f"{study.SPHERE_POINTS} poses in the sphere of 400 mm, a random target of eight in each, the tool turned up to "
        f"{np.degrees(study.SPHERE_TURN):.0f}° from its orientation at zero joints (the thesis does not say how)."
    )
    columns = ("model", *(f"{s} (mm)" for s in SYMBOLS))
    return Table("7.10", "Relative errors from a virtual frame, 3 kg", columns, [("34 parameters", *cells)], (note,))


def _table_7_11(results):
    cells = results.cells(study_thesis.TABLE_7_11, study.FULL, "sphere_three_points", "sphere")
    note = "The frame is that of three of the same points, far apart; the thesis measured three targets in three poses."
    columns = ("model", *(f"{s} (mm)" for s in SYMBOLS))
    return Table("7.11", "Relative errors from three points, 3 kg", columns, [("34 parameters", *cells)], (note,))


def _table_7_12(results):
    model, rows = results.settings.model, []
    for n in results.settings.procedures:
        thesis = study_thesis.TABLE_7_12.get(n) if model == "34" else None
        rows.append((f"{n} measures", *_pose_cells(results, Repetition(model, n), "all_range", thesis)))
    title = f"Position and orientation of the {model}-parameter procedures, 3 kg"
    notes = (_POSES_NOTE, "The first procedure of each size; its measurements are drawn anew for each procedure.")
    return Table("7.12", title, ("procedure from", *_POSE_COLUMNS), rows, notes)


# --- the procedures A to E --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chosen:
    """A procedure of Table 7.13: its letter, its repetition, why it is shown."""

    letter: str
    repetition: Repetition
    reason: str
    thesis: dict = field(default_factory=dict)


def chosen(results):
    """The worst procedure of each size and the best of all, by the larger of the two largest expected errors.

    Returns
    -------
    list of Chosen
        In the thesis's order: worst of the first size, best of all, worst of the others.
    """
    settings = results.settings
    every = study.procedures(settings)
    by_error = sorted(every, key=lambda r: max(results.worst(r)))
    worst = {n: [r for r in by_error if r.measures == n][-1] for n in settings.procedures}
    reasons = [(r, f"worst of the {n}-measurement procedures") for n, r in worst.items()]
    reasons = [(r, f"{text}; worst of all the {len(every)}" if r == by_error[-1] else text) for r, text in reasons]
    reasons.insert(1, (by_error[0], f"best of all the {len(every)} procedures"))
    same = settings.procedures == study_thesis.SIZES and settings.model == "34"
    out = []
    for k, (repetition, reason) in enumerate(reasons):
        letter = chr(ord("A") + k)
        beside = {name: getattr(study_thesis, f"TABLE_7_{name}")[letter] for name in range(13, 17)} if same else {}
        out.append(Chosen(letter, repetition, reason, beside))
    return out


def _table_7_13(results):
    rows = []
    for item in chosen(results):
        thesis = item.thesis.get(13, (None,) * 3)
        values = (*results.worst(item.repetition), results.row(item.repetition, "expected", AREAS[0])["objective_mm"])
        cells = [Cell(value, beside) for value, beside in zip(values, thesis, strict=True)]
        rows.append((item.letter, item.repetition.measures, *cells, item.reason))
    columns = ("procedure", "measures", "max expected, ISO cube", "max expected, all range", "objective", "remark")
    notes = ["The thesis's B came from 120 measurements, and its E was the worst of all."]
    if results.settings.method != "least-squares":
        notes.append(f"By least squares from the same measurements, all procedures: {_least_squares(results)}.")
    title = f"Best and worst of {len(study.procedures(results.settings))} procedures, 3 kg (mm)"
    return Table("7.13", title, columns, rows, tuple(notes))


def _least_squares(results):
    found = np.array([results.worst(r, least_squares=True) for r in study.procedures(results.settings)])
    return "; ".join(
        f"max expected, {AREA_NAMES[area]}, {low:.3f} to {high:.3f}"
        for area, low, high in zip(AREAS, found.min(axis=0), found.max(axis=0), strict=True)
    )


def _letters(key, title, unit, query, note, **options):
    def build(results):
        rows = [
            (item.letter, *results.cells(item.thesis.get(int(key[2:])), item.repetition, *query, **options))
            for item in chosen(results)
        ]
        return Table(key, title, ("procedure", *(f"{s} ({unit})" for s in SYMBOLS)), rows, (note,))

    return build


# --- more -------------------------------------------------------------------------------------------------


def _procedures(results):
    """Expected and found errors of all procedures."""
    rows = []
    for r in study.procedures(results.settings):
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
        for r in study.procedures(results.settings)
        for area in AREAS
        for load in PAYLOADS
    ]
    notes = (
        f"Found over expected mean, all areas and payloads: {min(ratio):.3f} to {max(ratio):.3f}, "
        f"median {np.median(ratio):.3f}. Found maxima are of an eighth as many points, so mostly smaller.",
    )
    title = "Every procedure: expected against found (mm)"
    return Table("procedures", title, ("measures", "no.", *head, "objective"), rows, notes)


def _targets(results):
    """Targets that were identified with against those that were not."""
    rows = []
    for area in AREAS:
        for load in PAYLOADS:
            cells = []
            for targets in ("1-3", "4-8"):
                found = [
                    results.row(r, "expected", area, load, targets=targets) for r in study.procedures(results.settings)
                ]
                cells += [Cell(float(np.median([row[name] for row in found]))) for name in ("mean", "max")]
            rows.append((AREA_NAMES[area], f"{load} kg", *cells))
    columns = ("area", "load", "targets 1 to 3: μ", "max", "targets 4 to 8: μ", "max")
    note = "Medians of all procedures. Only targets 1 to 3, with 3 kg, were identified with."
    return Table("targets", "Targets and payloads that the identification never saw (mm)", columns, rows, (note,))


def curve_values(results, least_squares=False):
    """Expected errors against the number of measurements, 3 kg, targets 1 to 8.

    Returns
    -------
    dict of tuple to ndarray, shape (sizes, repetitions)
        (area, ``mean`` or ``max``) -> mm.
    """
    settings = results.settings
    return {
        (area, name): np.array(
            [
                [
                    results.row(Repetition(settings.model, n, k + 1), "expected", area, least_squares=least_squares)[
                        name
                    ]
                    for k in range(settings.each)
                ]
                for n in settings.curve
            ]
        )
        for area in AREAS
        for name in ("mean", "max")
    }


def _curve(results):
    settings = results.settings
    methods = [settings.method] + (["least-squares"] if settings.method != "least-squares" else [])
    rows = []
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
    return Table("curve", title, columns, rows, (note,))


BUILDERS = {
    "7.1": _nominal,
    "7.2": _table_7_2,
    "7.3": _table_7_3,
    "7.4": _model("7.4", study.FULL, 3),
    "7.5": _model("7.5", study.FULL, 6),
    "7.6": _model("7.6", study.SMALL, 3),
    "7.7": _model("7.7", study.SMALL, 6),
    "7.8": _table_7_8,
    "7.9": _table_7_9,
    "7.10": _table_7_10,
    "7.11": _table_7_11,
    "7.12": _table_7_12,
    "7.13": _table_7_13,
    "7.14": _letters(
        *("7.14", "Position error of the procedures, all range, 6 kg", "mm", ("verified", "all_range", 6)),
        "Fake targets, the same poses for all procedures, eight targets.",
    ),
    "7.15": _letters(
        *("7.15", "Position reduced to the flange, ISO cube, 3 kg", "mm", ("poses", "iso_cube", 3)),
        "Fake targets, the same poses for all procedures, targets 1 to 3.",
        quantity="flange",
    ),
    "7.16": _letters(
        *("7.16", "Orientation, ISO cube, 3 kg", "°", ("poses", "iso_cube", 3)),
        "As Table 7.15.",
        quantity="orientation",
    ),
    "procedures": _procedures,
    "targets": _targets,
    "curve": _curve,
}
TABLES = tuple(BUILDERS)
"""Names of the tables, as they can be asked for."""


def markdown(found, settings):
    """``tables.md``.

    Parameters
    ----------
    found : list of Table
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
