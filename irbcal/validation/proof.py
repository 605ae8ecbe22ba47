"""What a calibration reached, in words and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from irbcal.identification.evidence_fit import models_table
from irbcal.identification.fit import ParameterReport
from irbcal.io.schema import Errors, EvidenceChoice, Record
from irbcal.measurement.cleaning import left_out
from irbcal.summary import Cell, Paragraph, Table, simulated_mark
from irbcal.validation.evaluation import statistics_table

DIGITS = {"mm": 3, "deg": 4, "rad": 6, "1": 6}


def parameter_row(row: ParameterReport) -> tuple[Cell, ...]:
    """A parameter for a table: name, value, standard deviation, unit, state."""
    digits = DIGITS.get(row.unit, 6)
    std = "–" if row.std is None else f"{row.std:.{digits}f}"
    return row.name, f"{row.value:+.{digits}f}", std, row.unit, row.state


def error_table(r: Record, nominal: Errors, calibrated: Errors, proven: bool, targets: bool = True) -> Table:
    """Position errors of a calibration and its nominal robot, all and by target on request."""
    compared, model = r.model != "nominal", f"model {r.model}"
    entries: list[tuple[str, str, Mapping[str, Any]]] = []
    if compared:
        entries.append(("all targets", "nominal", nominal.all.model_dump()))
    headline = len(entries)
    entries.append(("all targets", model, calibrated.all.model_dump()))
    if proven and r.heldout_least_squares:
        entries.append(("all targets", "… by rms", r.heldout_least_squares.all.model_dump()))
    for name in calibrated.per_target if targets and len(calibrated.per_target) > 1 else ():
        if compared:
            entries.append((name, "nominal", nominal.per_target[name].model_dump()))
        entries.append((name, model, calibrated.per_target[name].model_dump()))
    kind = simulated_mark(r.simulated)
    errors = "position errors" if r.features is None else "distances of rows from their features"
    scope = (
        f"{errors} on {r.poses_heldout} poses that the fit never saw"
        if proven
        else f"{errors} on the fitted poses: NOTHING WAS HELD OUT, this is not the robot's accuracy"
    )
    return statistics_table(f"{kind}{scope}, mm", entries, {headline})


def reached(r: Record) -> str:
    """What the method reached, in words."""
    names = {"rms": "fitted rms", "max": "largest fitted error", "pnorm": "p-norm of the fitted errors"}
    text = f"{names[r.objective.name]} {r.objective.value_mm:.3f} mm"
    if r.objective.lower_bound_mm is not None:
        text += f", certified: not below {r.objective.lower_bound_mm:.3f} mm with this model{_held(r)}"
    return text if r.method == "least-squares" else f"method {r.method}, {text}"


def held_lines(r: Record, verbose: bool) -> list[str]:
    """What is held, each in a line, or how many in one."""
    if verbose or not r.held:
        return [f"  held: {sentence}" for sentence in r.held]
    count = f"{len(r.held)} combinations" if len(r.held) > 1 else "1 combination"
    return [f"  held: {count} of these parameters, which these poses do not show: --verbose lists them"]


def left_out_lines(r: Record, verbose: bool) -> list[str]:
    """How many points were left out, and which ones: the first of each reason, or all."""
    if not r.excluded:
        return []
    full = f" ({r.poses_excluded} poses left out whole)" if r.poses_excluded else ""
    return [
        f"Left out: {len(r.excluded)} point{'' if len(r.excluded) == 1 else 's'}{full}",
        *left_out(r.excluded, None if verbose else 8),
    ]


def _held(r: Record) -> str:
    """What a certificate rests on."""
    names = [parameter.name for parameter in r.parameters if parameter.state == "held"]
    return f" and with {', '.join(names)} held" if names else ""


def feature_tables(r: Record, verbose: bool) -> list[Paragraph]:
    """What was left out in turn and how it agreed with itself, known lengths, and where the scale comes from."""
    section = r.features
    if section is None:
        return []
    lines: list[Paragraph] = []
    pair = section.length_error()
    if pair is not None:
        lines.append(
            f"Known lengths at places left out: wrong by {pair[1]:.3f} mm on average ({pair[0]:.3f} mm with the "
            "nominal robot)"
        )
    if section.places:
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (row.name, row.rows, row.nominal_mean_mm, row.mean_mm, row.rms_mm, row.max_mm) for row in section.places
        )
        columns = (section.left_out or "", "rows", "nominal mean", "mean", "rms", "max")
        lines.append(Table(f"Each {_one(section.left_out)} left out of the fit in turn, mm", columns, rows))
    if verbose:
        fitted = tuple((row.name, row.kind, row.rows, row.nominal_rms_mm, row.rms_mm) for row in section.features)
        lines.append(
            Table("Features in the fit, rms in mm", ("feature", "kind", "rows", "nominal", "calibrated"), fitted)
        )
    return lines


def model_tables(r: Record) -> list[Paragraph]:
    """Why this model, and the error models that were compared."""
    lines: list[Paragraph] = [r.choice.explanation] if r.choice else []
    if isinstance(r.choice, EvidenceChoice):
        rows = [
            (row.name, row.terms, row.log_evidence, row.weight, row.sigma_mm, row.leave_one_out_mm)
            for row in r.choice.table
        ]
        lines.append(models_table(rows))
    return lines


def _one(by: str | None) -> str:
    return "set of features" if by == "features" else str(by)
