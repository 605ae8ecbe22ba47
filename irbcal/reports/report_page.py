"""``report.html``: one self-contained page; tables, numbers and data files that the pages of this room share.

The page says what ``calibration.json`` says; what it adds about the poses is computed in `irbcal.validation`. It runs
no script and loads nothing. The same figures and their data can be had as files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from irbcal.error_statistics import FOUR, headed
from irbcal.identification.fit_sections import DIGITS, identified_in_words
from irbcal.io.robot_section import RobotSection
from irbcal.io.schema import Record
from irbcal.joint_analysis.residuals import needed_by_residuals, residual_terms_table
from irbcal.joint_analysis.terms import term_rows
from irbcal.measurement.cleaning import Exclusion
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import name_of
from irbcal.modeling.terms.gear import in_words
from irbcal.modeling.thesis_map import is_of_the_thesis
from irbcal.names import csv_bytes
from irbcal.plotting import charts
from irbcal.plotting.charts import Chart, fixed
from irbcal.plotting.pose_errors import WorstPose, worst_poses
from irbcal.reports.report_facts import ReportFacts, gather, limits
from irbcal.summary import values
from irbcal.units import DEG, MM
from irbcal.validation.verdict import verdict_of
from irbcal.wording import counted

if TYPE_CHECKING:
    from jinja2 import Template

    from irbcal.identification.fit_sections import ModelAverage


def template(name: str) -> Template:
    """A template of this room by the name of its file; what is put into it is escaped, and nothing may be missing."""
    from irbcal.templates import environment as templates

    environment = templates("irbcal.reports")
    environment.filters |= {"fixed": fixed, "unit": in_unit, "std": deviation, "count": counted, "svg": charts.inline}
    environment.filters |= {"repr": repr, "short": short, "file_name": file_name}
    return environment.get_template(name)


def in_unit(value: float, unit: str) -> str:
    """A number with the decimals of its unit."""
    return fixed(value, DIGITS[unit]) if unit in DIGITS else format(value, ".6g")


def deviation(value: float | None, unit: str) -> str:
    """A standard deviation, also one that is too small to show, or none."""
    if value is None:
        return "–"
    smallest = 10.0 ** -DIGITS.get(unit, 6)
    return f"< {in_unit(smallest, unit)}" if value < smallest / 2 else in_unit(value, unit)


def file_name(path: str) -> str:
    """The name of a file without its folders: a page that is handed on must not tell how a disk is laid out."""
    return path.replace("\\", "/").rstrip("/").rpartition("/")[2] or path


def short(text: str, limit: int = 28) -> str:
    """A name from data that must not fill a page: its beginning and its end."""
    return text if len(text) <= limit else f"{text[: limit // 2]}…{text[-(limit // 2 - 1) :]}"


T = TypeVar("T")


def _models(c: Record, nominal: T, calibrated: T) -> dict[str, T]:
    """The models to show; the level ``nominal`` has but one."""
    return {"nominal": nominal} if c.model == "nominal" else {"nominal": nominal, "calibrated": calibrated}


def error_tables(c: Record) -> list[dict[str, Any]]:
    """Per set of poses: title, number of poses, whether it proves anything, and rows by part."""
    out: list[dict[str, Any]] = []
    for title, proves, poses, nominal, calibrated in (
        ("Held-out poses", True, c.poses_heldout, c.heldout_nominal, c.heldout),
        ("Fitted poses", False, c.poses_fit, c.fit_nominal, c.fit),
    ):
        if calibrated is None or nominal is None:
            continue
        overall = _models(c, nominal.all, calibrated.all)
        if proves and c.heldout_least_squares:
            overall["calibrated by rms"] = c.heldout_least_squares.all
        by_kind: dict[str, dict[str, Any]] = {"": {"": overall}}
        for name, of_nominal, of_calibrated, fewest in (
            ("target", nominal.per_target, calibrated.per_target, 2),
            ("group", nominal.per_group, calibrated.per_group, 1),
        ):
            if len(of_calibrated) >= fewest:
                by_kind[name] = {label: _models(c, of_nominal[label], of_calibrated[label]) for label in of_calibrated}
        turned = _models(c, nominal.orientation, calibrated.orientation) if calibrated.orientation else {}
        out.append({"title": title, "proves": proves, "poses": poses, "parts": by_kind, "orientation": turned})
    return out


def families(section: ModelAverage) -> list[dict[str, Any]]:
    """Groups of terms summed up by family: what was expected, what was found, and what is lost without it.

    ``natural`` is in words; ``expected``, ``found`` and ``std`` are root mean squares in natural sizes.
    """
    lost = {row.family: row for row in section.families}
    out: list[dict[str, Any]] = []
    for family in dict.fromkeys(group.family for group in section.groups):
        groups = [group for group in section.groups if group.family == family]
        terms = sum(group.terms for group in groups)
        natural = {unit: size for group in groups for unit, size in group.natural.items()}
        squares = {
            name: sum(group.terms * getattr(group, field) ** 2 for group in groups)
            for name, field in (("expected", "size"), ("found", "estimate"), ("std", "std"))
        }
        out.append(
            {
                "family": family,
                "terms": terms,
                "determined": sum(group.determined for group in groups),
                "natural": ", ".join(
                    f"{size:.4g}" + ("" if unit == "1" else f" {unit}") for unit, size in natural.items()
                ),
                **{name: (value / terms) ** 0.5 for name, value in squares.items()},
                "lost": lost.get(family),
            }
        )
    return out


def data_files(calibration: Record, facts: ReportFacts) -> dict[str, bytes]:
    """The data behind the figures and tables of the page as CSV files.

    Returns
    -------
    dict of str to bytes
        Contents by file name. Lengths in mm, angles in degrees; places and vectors along the axes of the base link.
    """
    tables = {
        "points.csv": _points_rows(facts),
        "poses.csv": _poses_rows(calibration, facts),
        "errors.csv": _errors_rows(calibration, facts),
        "parameters.csv": [vars(parameter) for parameter in calibration.parameters],
        "singular_values.csv": [
            {"direction": k, "singular_value_mm": value, "determined": k <= calibration.observability.determined}
            for k, value in enumerate(calibration.observability.singular_values_mm, 1)
        ],
        **_model_rows(calibration, facts),
        "left_out.csv": [vars(point) for point in calibration.excluded],
        "joints.csv": _joints_rows(facts),
        "joint_terms.csv": _joint_terms_rows(facts),
    }
    return {name: as_csv(rows, calibration.simulated) for name, rows in tables.items() if rows}


def _model_rows(c: Record, facts: ReportFacts) -> dict[str, list[dict[str, Any]]]:
    """Families, gear scan and coverage of an average of error models."""
    out: dict[str, list[dict[str, Any]]] = {}
    if facts.coverage is not None:
        out["coverage.csv"] = [
            {"part": part, "target": target} | row
            for part, target, row in (
                *((name, "", row) for name, row in facts.coverage["parts"].items()),
                *(("all", name, row) for name, row in facts.coverage["targets"].items()),
            )
        ]
    if c.evidence is None:
        return out
    out["explained.csv"] = [vars(stage) for stage in c.evidence.explained]
    out["groups.csv"] = [
        {key: value for key, value in vars(group).items() if key != "natural"}
        | {"natural": ", ".join(f"{size:.6g} {unit}" for unit, size in group.natural.items())}
        for group in c.evidence.groups
    ]
    out["gears.csv"] = [vars(gear) for gear in c.evidence.gears]
    spectrum = c.evidence.spectrum
    if spectrum is not None:
        out["gear_scan.csv"] = [
            {"joint": joint, "from_cycles_per_turn": spectrum.first + k * spectrum.step, "chi2": value}
            for joint, row in zip(spectrum.joints, spectrum.chi2, strict=True)
            for k, value in enumerate(row)
        ]
    return out


def as_csv(rows: Sequence[Mapping[str, Any]], simulated: bool) -> bytes:
    """Rows as a CSV file with a column that says whether the data are simulated; no cell begins like a formula."""
    import pandas as pd

    return csv_bytes(pd.DataFrame(rows, dtype=object).assign(simulated=int(simulated)))  # 3 stays 3 beside empty cells


def _points_rows(facts: ReportFacts) -> list[dict[str, Any]]:
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for poses in facts.sets:
        columns = {
            "set": poses.name,
            "pose": [poses.pose_names[k] for k in poses.pose],
            "group": [poses.groups[k] for k in poses.pose],
            "target": poses.target,
            **values(poses, "x_mm,y_mm,z_mm?=positions"),
        }
        for name, model in poses.models.items():
            columns |= values(model, f"{name}_dx_mm,{name}_dy_mm,{name}_dz_mm?=vector {name}_mm=distance")
            columns |= values(model, f"{name}_deg?=rotation")
        rows += pd.DataFrame(columns).round(6).to_dict("records")
    return rows


def _poses_rows(c: Record, facts: ReportFacts) -> list[dict[str, Any]]:
    rows = []
    for poses in facts.sets:
        for n, name in enumerate(poses.pose_names):
            row = {"set": poses.name, "pose": name, "group": poses.groups[n]}
            if poses.points is not None:
                for j, (unit, size) in enumerate(c.robot.units):
                    row[f"q{j + 1}_{unit}"] = round(poses.points.q[n, j] / size, 9)
            row |= {f"{model}_mm": round(m.per_pose[n] / MM, 6) for model, m in poses.models.items()}
            rows.append(row)
    return rows


def _errors_rows(c: Record, facts: ReportFacts) -> list[dict[str, Any]]:
    models = {poses.proves: poses.models for poses in facts.sets}
    rows = []
    for table in error_tables(c):
        name_of_set = "held-out" if table["proves"] else "fitted"
        for kind, labels in table["parts"].items():
            for label, statistics in labels.items():
                for name, figures in statistics.items():
                    row = {"set": name_of_set, "by": kind, "label": label, "model": name} | vars(figures)
                    model = models.get(table["proves"], {}).get(name)
                    intervals = model.intervals if model and not kind else None
                    for key, (low, high) in (intervals or {}).items():
                        row |= {f"{key}_low": low, f"{key}_high": high}
                    rows.append(row)
    return rows


def _joint_terms_rows(facts: ReportFacts) -> list[dict[str, Any]]:
    analysis = facts.joints
    return [] if analysis is None else term_rows(analysis.terms)


def _joints_rows(facts: ReportFacts) -> list[dict[str, Any]]:
    import pandas as pd

    analysis = facts.joints
    if analysis is None:
        return []
    arm, (n, j) = analysis.robot.arm, np.nonzero(np.isfinite(analysis.angle))
    size = arm.joint_units[j]
    table = {
        "pose": analysis.points.pose_ids[n],
        "joint": j + 1,
        "unit": np.array(arm.joint_unit_names, dtype=object)[j],
        "q": analysis.points.q[n, j] / size,
        "came_from": np.where(analysis.direction[n, j] > 0, "below", "above"),
        "residual": analysis.angle[n, j] / size,
    }
    return pd.DataFrame(table).round(9).to_dict("records")


MOST_LISTED = 2000
"""Left-out points that are listed one by one; all are in ``calibration.json``."""


VIEW_NAME = "view.html"
"""A page of ``irbcal view --html`` beside the report, which it links into."""


def view_beside(folder: Path) -> str | None:
    """The name of the view page in a calibration folder, where one was made."""
    return VIEW_NAME if (folder / VIEW_NAME).is_file() else None


def render(calibration: Record, facts: ReportFacts | None = None, view: str | None = None) -> str:
    """The report as one HTML page.

    Parameters
    ----------
    calibration : Record
    facts : irbcal.reports.report_facts.ReportFacts, optional
        Computed unless given.
    view : str, optional
        Name of a view page in the same folder, to link into.
    """
    robot = calibration.robot
    facts = gather(calibration) if facts is None else facts
    return template("report.html.j2").render(
        c=calibration,
        key_mark=charts.key,
        verdict=verdict(calibration),
        trusted=verdict_of(calibration).trusted,
        statistics=headed(*FOUR, "rms"),
        with_intervals=headed("mean", "sigma", "mean_plus_3sigma", "rms", "p95"),
        error_tables=error_tables(calibration),
        limits=limits(calibration, facts),
        worst=_worst(calibration, facts),
        joint_units=[unit for unit, _ in robot.units],
        view=view,
        view_name=VIEW_NAME,
        sets={poses.name: poses for poses in facts.sets},
        figures=draw(calibration, facts),
        joints=facts.joints,
        joints_note=facts.joints_note,
        identified=identified_in_words(calibration.rank, calibration.parameter_count, calibration.poses_fit),
        joint_terms=[] if facts.joints is None else residual_terms_table(facts.joints),
        needed="" if facts.joints is None else needed_by_residuals(facts.joints),
        states={s: sum(p.state == s for p in calibration.parameters) for s in ("identified", "tied", "held")},
        dhm_columns=_dhm_columns(robot),
        dhm_rows=list(zip(robot.joint_names, robot.dhm_nominal, robot.dhm_calibrated, strict=True)),
        identity=calibration.robot_calibrated().joint_map.is_identity,
        coefficients=_coefficients(calibration.robot_calibrated().joint_map),
        gears=_gears(calibration),
        joint_ranges=_joint_ranges(calibration),
        families=families(calibration.evidence) if calibration.evidence else [],
        coverage=facts.coverage,
        left_out=_left_out(calibration.excluded),
        notes=calibration.notes_to_read(),
    )


def _worst(calibration: Record, facts: ReportFacts) -> list[WorstPose]:
    """The worst poses of the set with the better claim."""
    first = facts.sets[0]
    if first.points is None:
        number = {name: k for k, name in enumerate(calibration.poses.pose)}
        if not number.keys() >= {*first.pose_names}:
            return worst_poses(first)
        joints = np.array(calibration.poses.joints).T
        return worst_poses(first, joints[[number[name] for name in first.pose_names]])
    return worst_poses(first, first.points.q / calibration.robot.joint_units)


def draw(calibration: Record, facts: ReportFacts) -> dict[str, list[Chart]]:
    """See `irbcal.reports.report_charts.figures`."""
    from irbcal.reports import report_charts

    return report_charts.figures(calibration, facts)


def figure_files(calibration: Record, facts: ReportFacts, kind: Literal["png", "svg"] = "png") -> dict[str, bytes]:
    """The figures of the page as files.

    Parameters
    ----------
    calibration : Record
    facts : ReportFacts
    kind : str
        ``png`` or ``svg``.

    Returns
    -------
    dict of str to bytes
        Contents by file name.
    """
    sections = draw(calibration, facts).values()
    return {f"{f.name}.{kind}": f.marked(calibration.simulated).content(kind) for charts in sections for f in charts}


def verdict(calibration: Record) -> list[str]:
    """The verdict, and what speaks against it, in sentences, see `irbcal.validation.verdict`."""
    judged = verdict_of(calibration)
    return [judged.sentence(), *judged.doubts]


# --- tables ----------------------------------------------------------------------------------------------


def _dhm_columns(robot: RobotSection) -> list[tuple[str, str, str]]:
    """Name in the file, name on the page, unit; the tilt only where there is one."""
    columns = [("alpha_deg", "α", "deg"), ("a_mm", "a", "mm"), ("theta_deg", "θ", "deg"), ("d_mm", "d", "mm")]
    if any(row.beta_deg for row in robot.dhm_nominal + robot.dhm_calibrated):
        columns.append(("beta_deg", "β", "deg"))
    return columns


def _gears(c: Record) -> list[str]:
    """Single waves that were found, in words."""
    return [
        in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg)
        for gear in (c.evidence.gears if c.evidence else ())
    ]


def _joint_ranges(c: Record) -> list[tuple[str, float, float, str]]:
    """Joint, smallest and largest value and unit of a joint map that knows its ranges."""
    if c.joint_map.ranges is None:
        return []
    return [
        (joint, low / size, high / size, unit)
        for joint, low, high, (unit, size) in zip(c.robot.joint_names, *c.joint_map.ranges, c.robot.units, strict=True)
    ]


def _coefficients(joint_map: JointMap) -> list[tuple[str, float, str, float | None]]:
    """Symbol, value, unit and value in degrees of each coefficient of a joint map like the thesis's; else nothing."""
    if not is_of_the_thesis(joint_map):
        return []
    rows: list[tuple[str, float, str, float | None]] = []
    for term, value in zip(joint_map.terms.terms, joint_map.terms.coefficients.tolist(), strict=True):
        symbol = name_of(term).rpartition("_")[2].replace("gain", "gain_")
        rows.append((symbol, value, term.unit, None if term.unit == "1" else value / DEG))
        if term.basis == "gravity":
            phase = joint_map.phase(term)
            rows.append((f"phi{2 + len(term.also)}", phase, "rad", phase / DEG))
    return rows


def _left_out(excluded: Sequence[Exclusion]) -> dict[str, Any]:
    """Counts by kind of reason, and one line for each pose and reason in the order of the file."""
    counts: dict[str, int] = {}
    lines: dict[tuple[str, str], list[str]] = {}
    for point in excluded:
        counts[point.kind] = counts.get(point.kind, 0) + 1
        lines.setdefault((point.pose, point.reason), []).append(point.target)
    listed = [(pose, ", ".join(targets), reason) for (pose, reason), targets in lines.items()]
    return {
        "counts": sorted(counts.items(), key=lambda entry: -entry[1]),
        "lines": listed[:MOST_LISTED],
        "more": max(0, len(listed) - MOST_LISTED),
    }
