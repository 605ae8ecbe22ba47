"""``report.html``: one self-contained page that shows what a calibration is worth and how to use it.

The page says what ``calibration.json`` says; what it adds about the poses is computed in `irbcal.validation`. It runs
no script and loads nothing. The same figures and their data can be had as files.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from irbcal.identification.fit import ParameterReport
from irbcal.io.schema import Record, RobotSection
from irbcal.joint_analysis.residuals import needed_by_residuals, residual_terms_table
from irbcal.measurement.cleaning import Exclusion
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import FOURIER
from irbcal.modeling.terms.gear import in_words
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.plotting import charts
from irbcal.plotting.charts import Chart
from irbcal.plotting.pose_errors import WorstPose, worst_poses
from irbcal.reports import report_data
from irbcal.reports.limits import limits
from irbcal.units import DEG, MM
from irbcal.validation.verdict import verdict_of

if TYPE_CHECKING:
    from irbcal.reports.evidence import Evidence

STATISTICS = (
    ("mean", "mean_mm"),
    ("sigma", "sigma_mm"),
    ("max", "max_mm"),
    ("mean+3σ", "mean_plus_3sigma_mm"),
    ("rms", "rms_mm"),
)
MOST_LISTED = 2000
"""Left-out points that are listed one by one; all are in ``calibration.json``."""


VIEW_NAME = "view.html"
"""A page of ``irbcal view --html`` beside the report, which it links into."""


def view_beside(folder: Path) -> str | None:
    """The name of the view page in a calibration folder, where one was made."""
    return VIEW_NAME if (folder / VIEW_NAME).is_file() else None


def render(calibration: Record, evidence: Evidence | None = None, view: str | None = None) -> str:
    """The report as one HTML page.

    Parameters
    ----------
    calibration : Record
    evidence : irbcal.reports.evidence.Evidence, optional
        Computed unless given.
    view : str, optional
        Name of a view page in the same folder, to link into.
    """
    robot = calibration.robot
    evidence = gather(calibration) if evidence is None else evidence
    return report_data.template("report.html.j2").render(
        c=calibration,
        style=charts.page_style(),
        key_mark=charts.key,
        verdict=verdict(calibration),
        trusted=verdict_of(calibration).trusted,
        statistics=STATISTICS,
        error_tables=report_data.error_tables(calibration),
        limits=limits(calibration, evidence),
        worst=_worst(calibration, evidence),
        joint_units=["mm" if kind == "prismatic" else "deg" for kind in robot.joint_types],
        view=view,
        view_name=VIEW_NAME,
        sets={poses.name: poses for poses in evidence.sets},
        figures=draw(calibration, evidence),
        joints=evidence.joints,
        joints_note=evidence.joints_note,
        joint_terms=[] if evidence.joints is None else residual_terms_table(evidence.joints),
        needed="" if evidence.joints is None else needed_by_residuals(evidence.joints),
        states=_states(calibration.parameters),
        dhm_columns=_dhm_columns(robot),
        dhm_rows=list(zip(robot.joint_names, robot.dhm_nominal, robot.dhm_calibrated, strict=True)),
        identity=calibration.robot_calibrated().joint_map.is_identity,
        coefficients=_coefficients(calibration.robot_calibrated().joint_map),
        gears=_gears(calibration),
        joint_ranges=_joint_ranges(calibration),
        families=report_data.families(calibration.evidence) if calibration.evidence else [],
        coverage=evidence.coverage,
        left_out=_left_out(calibration.excluded),
        ends=[note for note in calibration.notes_to_read() if note not in calibration.notes],
    )


def _worst(calibration: Record, evidence: Evidence) -> list[WorstPose]:
    """The worst poses of the set with the better claim."""
    first = evidence.sets[0]
    if first.points is None:
        return worst_poses(first)
    slides = np.array([kind == "prismatic" for kind in calibration.robot.joint_types])
    return worst_poses(first, first.points.q / np.where(slides, MM, DEG))


def gather(calibration: Record) -> Evidence:
    """See `irbcal.reports.evidence.gather`."""
    from irbcal.reports import evidence

    return evidence.gather(calibration)


def draw(calibration: Record, evidence: Evidence) -> dict[str, list[Chart]]:
    """See `irbcal.reports.report_charts.figures`."""
    from irbcal.reports import report_charts

    return report_charts.figures(calibration, evidence)


def figure_files(calibration: Record, evidence: Evidence, kind: Literal["png", "svg"] = "png") -> dict[str, bytes]:
    """The figures of the page as files.

    Parameters
    ----------
    calibration : Record
    evidence : Evidence
    kind : str
        ``png`` or ``svg``.

    Returns
    -------
    dict of str to bytes
        Contents by file name.
    """
    sections = draw(calibration, evidence).values()
    return {f"{f.name}.{kind}": f.marked(calibration.simulated).content(kind) for charts in sections for f in charts}


def verdict(calibration: Record) -> list[str]:
    """The verdict, and what speaks against it, in sentences, see `irbcal.validation.verdict`."""
    judged = verdict_of(calibration)
    return [judged.sentence(), *judged.doubts]


# --- tables ----------------------------------------------------------------------------------------------


def _states(parameters: Sequence[ParameterReport]) -> dict[str, int]:
    return {s: sum(p.state == s for p in parameters) for s in ("identified", "tied", "held")}


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
    units = [("mm", MM) if kind == "prismatic" else ("deg", DEG) for kind in c.robot.joint_types]
    return [
        (joint, low / size, high / size, unit)
        for joint, low, high, (unit, size) in zip(c.robot.joint_names, *c.joint_map.ranges, units, strict=True)
    ]


def _coefficients(joint_map: JointMap) -> list[tuple[str, float, str, float | None]]:
    """Symbol, value, unit and value in degrees of each coefficient of a joint map like the thesis's; else nothing."""
    thesis = ThesisMap.of(joint_map)
    if thesis is None:
        return []
    rows: list[tuple[str, float, str, float | None]] = [
        (f"gain_{k}", float(value), "1", None) for k, value in enumerate(thesis.gain, start=1)
    ]
    symbols, angles = ("A", "B", "phi2", "phi3", *FOURIER), (*thesis.stiffness, *thesis.phases, *thesis.fourier)
    return rows + [(name, float(value), "rad", float(value) / DEG) for name, value in zip(symbols, angles, strict=True)]


def _left_out(excluded: Sequence[Exclusion]) -> dict[str, Any]:
    """Counts by kind of reason, and one line for each pose and reason in the order of the file."""
    counts: dict[str, int] = {}
    lines: dict[tuple[str, str], list[str]] = {}
    for point in excluded:
        kind = point.reason.split(":")[0]
        counts[kind] = counts.get(kind, 0) + 1
        lines.setdefault((point.pose, point.reason), []).append(point.target)
    listed = [(pose, ", ".join(targets), reason) for (pose, reason), targets in lines.items()]
    return {
        "counts": sorted(counts.items(), key=lambda entry: -entry[1]),
        "lines": listed[:MOST_LISTED],
        "more": max(0, len(listed) - MOST_LISTED),
    }
