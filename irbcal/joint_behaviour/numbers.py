"""What the joints do, in numbers for others: plain values in mm and degrees, tables, a data frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.joint_behaviour.terms import Slides, Term, unit_of
from irbcal.summary import Cell, Table
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.joint_behaviour.behaviour import JointBehaviour
    from irbcal.joint_behaviour.moves import JointMoves
    from irbcal.joint_behaviour.residuals import ResidualAnalysis
    from irbcal.joint_behaviour.series import Series

NAMES = {"move": "per move", "fourier": "Fourier"}
"""Kinds of terms as tables name them, where they name them otherwise."""

# --- plain values ----------------------------------------------------------------------------------------


def as_dict(found: JointBehaviour) -> dict[str, Any]:
    """The result as plain numbers and words: lengths in mm, angles in degrees.

    Parameters
    ----------
    found : JointBehaviour

    Returns
    -------
    dict
        ``source``, ``simulated``, ``moves`` (by joint: series with errors, terms), ``residuals`` (terms, halves,
        approach, needed; None without a robot), ``payloads`` (Table 4.3), ``verdict`` (sentences), ``excluded``,
        ``notes``, ``plots`` (files); where there are programmed joints, ``reading_lag``.
    """
    from irbcal.joint_behaviour.verdict import verdict

    residuals = found.residuals
    return {
        "source": found.source,
        "simulated": found.simulated,
        "moves": [_moves_dict(joint) for joint in found.moves],
        "residuals": None if residuals is None else _residuals_dict(residuals),
        "payloads": [effect.to_dict() for effect in found.payloads()],
        "verdict": verdict(found),
        "excluded": [{"pose": x.pose, "target": x.target, "reason": x.reason} for x in found.excluded],
        "notes": list(found.notes),
        "plots": list(found.plots),
        **({} if found.reading_lag is None else {"reading_lag": found.reading_lag.to_dict()}),
    }


def error_size(values: ArrayLike) -> dict[str, float]:
    """Root mean square and largest size of errors in metres, in mm."""
    values = np.asarray(values, dtype=float) / MM
    return {"rms_mm": float(np.sqrt(np.mean(values**2))), "max_mm": float(np.abs(values).max())}


def _moves_dict(joint: JointMoves) -> dict[str, Any]:
    return {
        "joint": joint.joint,
        "series": [_series_dict(s) for s in joint.series],
        "terms": [term_dict(term) for term in joint.terms],
    }


def _series_dict(s: Series) -> dict[str, Any]:
    """One series, as Nubiola 2011, Table 4.1, Table 4.2 and Table 4.4 describe theirs.

    With the sizes of its errors, the largest as in Table 4.3.
    """
    names = s.points.target_names
    return {
        "group": s.name,
        "poses": len(s.q),
        "payload_kg": None if np.isnan(s.payload_kg) else s.payload_kg,
        "from_both_sides": s.from_both_sides,
        "home_deg": [None if k == s.joint - 1 else float(v / DEG) for k, v in enumerate(s.q[0])],
        "range_deg": [float(s.turn.min() / DEG), float(s.turn.max() / DEG)],
        "radius_mm": {names[t]: float(r / MM) for t, r in zip(s.fit.targets, s.fit.radii, strict=True)},
        "radial": error_size(s.radial),
        "tangential": error_size(s.tangential),
        "axial": error_size(s.axial),
        "angle_peak_to_peak_deg": float(np.ptp(s.angle) / DEG),
        "zero_deg": s.zero / DEG,
    }


def _residuals_dict(found: ResidualAnalysis) -> dict[str, Any]:
    slides = found.robot.arm.table.prismatic
    halves = [
        {
            "joint": j + 1,
            "first": _outside(found.halves[j, 0], slides[j]),
            "second": _outside(found.halves[j, 1], slides[j]),
            "p": _number(found.halves_p[j]),
        }
        for j in range(len(slides))
    ]
    return {
        "robot": found.robot.arm.name,
        "poses": found.points.poses,
        "points": len(found.points),
        "rms_mm": found.rms / MM,
        "terms": [_beside_dict(term, slides) for term in found.terms],
        "backlash_halves": halves,
        "left_out_rms_by_approach_mm": {name: _number(value / MM) for name, value in found.approach.items()},
        "left_out_rms_geometry_mm": found.rms_geometry / MM,
        "needed": [
            {"kind": step.kind, "joint": step.joint, "p": step.p, "left_out_rms_mm": step.rms / MM}
            for step in found.needed
        ],
    }


def _beside_dict(term: Term, slides: Slides) -> dict[str, Any]:
    """One term as it was tested by itself and, where others had hidden it, ``beside_needed`` (else None)."""
    beside = None if term.beside_needed is None else term_dict(term.beside_needed, slides)
    return term_dict(term, slides) | {"beside_needed": beside}


def term_dict(term: Term, slides: Slides = ()) -> dict[str, Any]:
    """One term as plain numbers; values in degrees, millimetres, degrees per 100 degrees, or none."""
    unit, size = unit_of(term, slides)
    values = {
        name: {"value": value / size, "low": low / size, "high": high / size}
        for name, value, low, high in zip(term.names, term.values, term.low, term.high)  # noqa: B905
    }
    frequency = None if term.frequency is None or term.note else [float(f) for f in term.frequency]
    return {
        "kind": term.kind,
        "joint": term.joint,
        "unit": unit,
        "values": values,
        "p": None if term.note else term.p,
        "rms_without_mm": _number(term.rms_without / MM),
        "rms_with_mm": _number(term.rms_with / MM),
        "at_tool_mm": _number(term.at_tool / MM),
        "verdict": term.verdict,
        "frequency": frequency,
        "note": term.note,
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _outside(value: float, slides: bool) -> float | None:
    return _number(value / (MM if slides else DEG))


# --- tables ----------------------------------------------------------------------------------------------


def tables(found: JointBehaviour) -> list[Table]:
    """All tables of a result: errors and terms of one-joint moves, terms of residuals."""
    mark = "SIMULATED data: " if found.simulated else ""
    out = []
    if found.moves:
        out.append(errors_table(found.moves, f"{mark}errors of one-joint moves in {found.source}"))
        terms = [term for joint in found.moves for term in joint.terms]
        out.append(terms_table(terms, f"{mark}{MOVES_TITLE}"))
    if found.residuals is not None:
        out.append(residual_terms_table(found.residuals, mark))
    return out


MOVES_TITLE = "Terms from one-joint moves; without and with: tangential rms of joint angles left out of the fit, mm"


def errors_table(moves: Sequence[JointMoves], title: str = "Errors of one-joint moves") -> Table:
    """Radial, tangential and axial errors of each series, as Nubiola 2011, Figure 4.3, draws them."""
    columns = ("group", "n", "range, deg", "radial", "tangential", "largest", "axial", "p-p, deg")
    rows: list[tuple[Cell, ...]] = []
    for s in (s for joint in moves for s in joint.series):
        low, high = s.turn.min() / DEG, s.turn.max() / DEG
        along = error_size(s.tangential)
        sizes = [error_size(s.radial)["rms_mm"], along["rms_mm"], along["max_mm"], error_size(s.axial)["rms_mm"]]
        rows.append((s.name, len(s.q), f"{low:.0f}…{high:.0f}", *sizes, f"{np.ptp(s.angle) / DEG:.4f}"))
    return Table(f"{title}: rms (tangential: largest, too), mm", columns, tuple(rows))


def residual_terms_table(found: ResidualAnalysis, mark: str = "") -> Table:
    """The terms of `terms_table` from the residuals of a robot model."""
    title = (
        f"{mark}Terms from the residuals of {found.robot.arm.name} on {found.points.poses} poses, geometry refitted "
        f"({found.rms / MM:.3f} mm rms); without and with: rms of poses left out of the fit, mm"
    )
    return terms_table(found.terms, title, found.robot.arm.table.prismatic)


def terms_table(terms: Sequence[Term], title: str = MOVES_TITLE, slides: Slides = ()) -> Table:
    """Values, intervals, tests and verdicts of terms."""
    columns = ("joint", "term", "value, deg", "p", "without", "with", "verdict")
    rows: list[tuple[Cell, ...]] = []
    for tested in terms:
        term = tested.shown
        unit, _ = unit_of(term, slides)
        joint = "2, 3" if term.joint is None else str(term.joint)
        name = NAMES.get(term.kind, term.kind) + (", mm" if unit == "mm" else "")
        if term.note:
            rows.append((joint, name, term.note, None, None, None, "not tested"))
            continue
        p = "<0.001" if term.p < 1e-3 else f"{term.p:.3f}"
        values = "\n".join(_values(term, slides))
        rms = (term.rms_without / MM, term.rms_with / MM)
        rows.append(
            (joint, name, values, p, *rms, term.verdict if tested.beside_needed is None else f"{term.verdict}*")
        )
    return Table(title, columns, tuple(rows))


def _values(term: Term, slides: Slides) -> list[str]:
    """Lines with the values of a term and their intervals."""
    unit, size = unit_of(term, slides)
    digits = 5 if unit == "1" else 4
    lines = []
    for name, value, low, high in zip(term.names, term.values, term.low, term.high, strict=True):
        label = f"{name} " if len(term.values) > 1 else ""
        lines.append(f"{label}{value / size:.{digits}f} ± {(high - low) / 2 / size:.{digits}f}")
    if term.frequency is not None and len(term.frequency) == 3:
        found, low, high = term.frequency
        lines.append(f"frequency {found:.4f} ({low:.4f} to {high:.4f})")
    return lines


def frame(found: JointBehaviour) -> pd.DataFrame:
    """All coefficients of all terms, a row for each; of terms that were not tested a row without value.

    A term that others had hidden has rows of its own for what it is beside these (``beside_needed``).

    Returns
    -------
    DataFrame
        ``source`` (moves or residuals), ``beside_needed``, ``kind``, ``joint``, ``name``, ``value``, ``low``, ``high``,
        ``unit`` (as in `as_dict`), ``p``, ``rms_without_mm``, ``rms_with_mm``, ``verdict``, ``note``.
    """
    import pandas as pd

    slides: Slides = () if found.residuals is None else found.residuals.robot.arm.table.prismatic
    sources: list[tuple[str, Term, Slides]] = [("moves", term, ()) for joint in found.moves for term in joint.terms]
    if found.residuals is not None:
        sources += [("residuals", term, slides) for term in found.residuals.terms]
    both = [(source, t, slides, k > 0) for source, term, slides in sources for k, t in enumerate(_versions(term))]
    rows = []
    for source, term, sliding, beside in both:
        unit, size = unit_of(term, sliding)
        first = (source, beside, term.kind, term.joint)
        rest = (unit, term.p, term.rms_without / MM, term.rms_with / MM, term.verdict, term.note)
        values = list(zip(term.names, term.values, term.low, term.high, strict=False)) if term.tested else []
        for name, *three in values or [("", np.nan, np.nan, np.nan)]:
            rows.append((*first, name, *(v / size for v in three), *rest))
    columns = ("source", "beside_needed", "kind", "joint", "name", "value", "low", "high", "unit", "p")
    table = pd.DataFrame(rows, columns=[*columns, "rms_without_mm", "rms_with_mm", "verdict", "note"])
    return table.astype({"joint": "Int64"})


def _versions(term: Term) -> list[Term]:
    return [term] if term.beside_needed is None else [term, term.beside_needed]
