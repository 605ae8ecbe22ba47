"""What a calibration reached, in words and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from irbcal.files.schema import Errors, Record
from irbcal.measurement.cleaning import left_out
from irbcal.summary import Table
from irbcal.validation.evaluation import statistics_table


def error_table(r: Record, nominal: Errors, calibrated: Errors, proven: bool) -> Table:
    """Position errors of a calibration and its nominal robot, all and by target."""
    both, model = r.model != "nominal", f"model {r.model}"
    entries: list[tuple[str, str, Mapping[str, Any]]] = []
    if both:
        entries.append(("all targets", "nominal", nominal.all.model_dump()))
    headline = len(entries)
    entries.append(("all targets", model, calibrated.all.model_dump()))
    if proven and r.heldout_least_squares:
        entries.append(("all targets", "… by rms", r.heldout_least_squares.all.model_dump()))
    for name in calibrated.per_target if len(calibrated.per_target) > 1 else ():
        if both:
            entries.append((name, "nominal", nominal.per_target[name].model_dump()))
        entries.append((name, model, calibrated.per_target[name].model_dump()))
    kind = "SIMULATED data: " if r.simulated else ""
    what = (
        f"position errors on {r.poses_heldout} poses that the fit never saw"
        if proven
        else "position errors on the fitted poses: NOTHING WAS HELD OUT, this is not the robot's accuracy"
    )
    return statistics_table(f"{kind}{what}, mm", entries, {headline})


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
    many = f"{len(r.held)} combinations" if len(r.held) > 1 else "1 combination"
    return [f"  held: {many} of these parameters, which these poses do not show: --verbose lists them"]


def left_out_lines(r: Record, verbose: bool) -> list[str]:
    """How many points were left out, and which ones: the first of each reason, or all."""
    if not r.excluded:
        return []
    whole = f" ({r.poses_excluded} poses left out whole)" if r.poses_excluded else ""
    return [
        f"Left out: {len(r.excluded)} point{'' if len(r.excluded) == 1 else 's'}{whole}",
        *left_out(r.excluded, None if verbose else 8),
    ]


def _held(r: Record) -> str:
    """What a certificate rests on."""
    names = [item.name for item in r.parameters if item.state == "held"]
    return f" and with {', '.join(names)} held" if names else ""
