"""``report.html``: one self-contained page that shows what a calibration is worth and how to use it.

The page says what ``calibration.json`` says; what it adds about the poses is computed in `irbcal.validation`. It runs
no script and loads nothing. The same figures and their data can be had as files.
"""

import csv
from io import StringIO

from irbcal.figures import charts
from irbcal.figures.charts import fixed
from irbcal.figures.colours import CALIBRATED, NOMINAL
from irbcal.units import DEG, MM

__all__ = ["CALIBRATED", "NOMINAL", "data_files", "figure_files", "fixed", "render", "verdict"]

DIGITS = {"mm": 3, "deg": 4, "rad": 6, "1": 6}
STATISTICS = (
    ("mean", "mean_mm"),
    ("sigma", "sigma_mm"),
    ("max", "max_mm"),
    ("mean+3σ", "mean_plus_3sigma_mm"),
    ("rms", "rms_mm"),
)
MOST_LISTED = 2000
"""Left-out points that are listed one by one; all are in ``calibration.json``."""


def render(calibration, evidence=None):
    """The report as one HTML page.

    Parameters
    ----------
    calibration : Record
    evidence : irbcal.reports.evidence.Evidence, optional
        Computed unless given.

    Returns
    -------
    str
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("irbcal.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"fixed": fixed, "unit": _in_unit, "std": _deviation, "count": _count, "svg": charts.inline}
    environment.filters["repr"] = repr
    robot = calibration.robot
    evidence = gather(calibration) if evidence is None else evidence
    return environment.get_template("report.html.j2").render(
        c=calibration,
        paint=charts.PAINT,
        key_mark=charts.key,
        verdict=verdict(calibration),
        statistics=STATISTICS,
        error_tables=_error_tables(calibration),
        sets={poses.name: poses for poses in evidence.sets},
        figures=draw(calibration, evidence),
        approach=evidence.approach,
        approach_name=evidence.approach_name,
        approach_note=evidence.approach_note,
        backlash=_backlash(evidence.approach),
        seen=_seen(evidence.approach),
        states=_states(calibration.parameters),
        dhm_columns=_dhm_columns(robot),
        dhm_rows=list(zip(robot.joint_names, robot.dhm_nominal, robot.dhm_calibrated, strict=True)),
        identity=calibration.robot_calibrated().joint_map.is_identity,
        coefficients=_coefficients(calibration.joint_map),
        left_out=_left_out(calibration.excluded),
    )


def gather(calibration):
    """See `irbcal.reports.evidence.gather`."""
    from irbcal.reports import evidence

    return evidence.gather(calibration)


def draw(calibration, evidence):
    """See `irbcal.reports.report_figures.figures`."""
    from irbcal.reports import report_figures

    return report_figures.figures(calibration, evidence)


def figure_files(calibration, evidence, kind="png"):
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
    mark = "SIMULATED data. " if calibration.simulated else ""
    sections = draw(calibration, evidence).values()
    return {f"{f.name}.{kind}": charts.file(f, kind, mark) for figures in sections for f in figures}


def verdict(calibration):
    """What the calibration is worth, in one sentence (two where nothing was held out).

    Parameters
    ----------
    calibration : Record

    Returns
    -------
    str
    """
    c = calibration
    if c.heldout is None:
        opening = "Nothing is proven: no poses were held out, so the accuracy of this robot is unknown. "
        poses = f"On the {_count(c.poses_fit, 'fitted pose')}"
        return opening + _change(poses, c.model, c.fit_nominal, c.fit)
    poses = f"On {_count(c.poses_heldout, 'pose')} the fit never saw"
    return _change(poses, c.model, c.heldout_nominal, c.heldout)


def _change(poses, model, nominal, calibrated):
    before, largest_before = fixed(nominal.all.mean_mm, 3), fixed(nominal.all.max_mm, 3)
    if model == "nominal":
        start = f"{poses}, the mean position error of the nominal robot with base and targets identified is"
        return f"{start} {before} mm (largest {largest_before} mm)."
    mean, largest = fixed(calibrated.all.mean_mm, 3), fixed(calibrated.all.max_mm, 3)
    ends = f"(largest {largest_before} to {largest} mm)."
    if mean == before:
        return f"{poses}, the mean position error stays at {mean} mm {ends}"
    verb = "falls" if calibrated.all.mean_mm < nominal.all.mean_mm else "rises"
    return f"{poses}, the mean position error {verb} from {before} mm to {mean} mm {ends}"


# --- numbers ---------------------------------------------------------------------------------------------


def _in_unit(value, unit):
    return fixed(value, DIGITS[unit]) if unit in DIGITS else format(value, ".6g")


def _deviation(value, unit):
    if value is None:
        return "–"
    smallest = 10.0 ** -DIGITS.get(unit, 6)
    return f"< {_in_unit(smallest, unit)}" if value < smallest / 2 else _in_unit(value, unit)


def _count(n, noun):
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


# --- tables ----------------------------------------------------------------------------------------------


def _models(c, nominal, calibrated):
    """The models to show; the level ``nominal`` has but one."""
    return {"nominal": nominal} if c.model == "nominal" else {"nominal": nominal, "calibrated": calibrated}


def _error_tables(c):
    """Per set of poses: title, number of poses, whether it proves anything, and rows by part."""
    out = []
    for title, proves, poses, nominal, calibrated in (
        ("Held-out poses", True, c.poses_heldout, c.heldout_nominal, c.heldout),
        ("Fitted poses", False, c.poses_fit, c.fit_nominal, c.fit),
    ):
        if calibrated is None:
            continue
        overall = _models(c, nominal.all, calibrated.all)
        if proves and c.heldout_least_squares:
            overall["calibrated by rms"] = c.heldout_least_squares.all
        parts = {"": {"": overall}}
        for name, before, after, least in (
            ("target", nominal.per_target, calibrated.per_target, 2),
            ("group", nominal.per_group, calibrated.per_group, 1),
        ):
            if len(after) >= least:
                parts[name] = {label: _models(c, before[label], after[label]) for label in after}
        turned = _models(c, nominal.orientation, calibrated.orientation) if calibrated.orientation else {}
        out.append({"title": title, "proves": proves, "poses": poses, "parts": parts, "orientation": turned})
    return out


def _states(parameters):
    return {s: sum(p.state == s for p in parameters) for s in ("identified", "tied", "held")}


def _dhm_columns(robot):
    """Name in the file, name on the page, unit; the tilt only where there is one."""
    columns = [("alpha_deg", "α", "deg"), ("a_mm", "a", "mm"), ("theta_deg", "θ", "deg"), ("d_mm", "d", "mm")]
    if any(row.beta_deg for row in robot.dhm_nominal + robot.dhm_calibrated):
        columns.append(("beta_deg", "β", "deg"))
    return columns


def _coefficients(joint_map):
    """Symbol, name in the file, value, unit and value in degrees of each coefficient."""
    rows = [(f"gain_{i + 1}", f"gain[{i}]", value, "1", None) for i, value in enumerate(joint_map.gain)]
    for symbol, name in (
        ("A", "stiffness_A_rad"),
        ("B", "stiffness_B_rad"),
        ("phi2", "phi2_rad"),
        ("phi3", "phi3_rad"),
        *((key, f"fourier_{key}_rad") for key in ("a1", "b1", "a2", "b2")),
    ):
        value = getattr(joint_map, name)
        rows.append((symbol, name, value, "rad", value * 57.29577951308232))
    return rows


def _left_out(excluded):
    """Counts by kind of reason, and one line for each pose and reason in the order of the file."""
    counts, lines = {}, {}
    for item in excluded:
        kind = item.reason.split(":")[0]
        counts[kind] = counts.get(kind, 0) + 1
        lines.setdefault((item.pose, item.reason), []).append(item.target)
    listed = [(pose, ", ".join(targets), reason) for (pose, reason), targets in lines.items()]
    return {
        "counts": sorted(counts.items(), key=lambda item: -item[1]),
        "lines": listed[:MOST_LISTED],
        "more": max(0, len(listed) - MOST_LISTED),
    }


def _backlash(approach):
    """Joint, value and interval in its unit, p and what to think of it, for each joint."""
    if approach is None:
        return []
    slides = approach.robot.arm.table.prismatic
    rows = []
    for term in approach.terms:
        unit, size = ("mm", MM) if slides[term.joint - 1] else ("deg", DEG)
        amount = [value[0] / size for value in (term.values, term.low, term.high)] if term.tested else None
        rows.append({"joint": term.joint, "unit": unit, "amount": amount, "term": term})
    return rows


def _seen(approach):
    """Joints with an effect of the direction, in words, and those of them where it is negative."""
    terms = () if approach is None else approach.terms
    seen = [term for term in terms if term.tested and term.verdict != "not seen"]
    return {"all": _joints(seen), "beyond": _joints([term for term in seen if term.values[0] < 0])}


def _joints(terms):
    numbers = [str(term.joint) for term in terms]
    if len(numbers) < 2:
        return "".join(f"joint {number}" for number in numbers)
    return f"joints {', '.join(numbers[:-1])} and {numbers[-1]}"


# --- data ------------------------------------------------------------------------------------------------


def data_files(calibration, evidence):
    """The data behind the figures and tables of the page as CSV files.

    Parameters
    ----------
    calibration : Record
    evidence : Evidence

    Returns
    -------
    dict of str to bytes
        Contents by file name. Lengths in mm, angles in degrees; places and vectors along the axes of the base link.
    """
    tables = {
        "points.csv": _points_rows(evidence),
        "poses.csv": _poses_rows(calibration, evidence),
        "errors.csv": _errors_rows(calibration, evidence),
        "parameters.csv": [vars(parameter) for parameter in calibration.parameters],
        "singular_values.csv": [
            {"direction": k, "singular_value_mm": value, "seen": k <= calibration.observability.seen}
            for k, value in enumerate(calibration.observability.singular_values_mm, 1)
        ],
        "left_out.csv": [vars(item) for item in calibration.excluded],
        "joints.csv": _joints_rows(evidence),
        "backlash.csv": [
            {
                "joint": row["joint"],
                "unit": row["unit"],
                **dict(zip(("backlash", "low", "high"), row["amount"] or (None,) * 3, strict=True)),
                "p": row["term"].p if row["amount"] else None,
                "verdict": row["term"].verdict,
                "note": row["term"].note,
            }
            for row in _backlash(evidence.approach)
        ],
    }
    return {name: _csv(rows, calibration.simulated) for name, rows in tables.items() if rows}


def _csv(rows, simulated):
    stream = StringIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(stream, [*columns, "simulated"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(row | {"simulated": int(simulated)} for row in rows)
    return stream.getvalue().encode("utf-8", "replace")


def _points_rows(evidence):
    rows = []
    for poses in evidence.sets:
        for m, pose in enumerate(poses.pose):
            row = {"set": poses.name, "pose": poses.pose_names[pose], "group": poses.groups[pose]}
            row["target"] = poses.target[m]
            if poses.place is not None:
                row |= {f"{axis}_mm": round(v / MM, 6) for axis, v in zip("xyz", poses.place[m], strict=True)}
            for name, model in poses.models.items():
                if model.vector is not None:
                    for axis, v in zip("xyz", model.vector[m], strict=True):
                        row[f"{name}_d{axis}_mm"] = round(v / MM, 6)
                row[f"{name}_mm"] = round(model.distance[m] / MM, 6)
                if model.rotation is not None:
                    row[f"{name}_deg"] = round(model.rotation[m] / DEG, 6)
            rows.append(row)
    return rows


def _poses_rows(c, evidence):
    kinds = [("mm", MM) if kind == "prismatic" else ("deg", DEG) for kind in c.robot.joint_types]
    rows = []
    for poses in evidence.sets:
        for n, name in enumerate(poses.pose_names):
            row = {"set": poses.name, "pose": name, "group": poses.groups[n]}
            if poses.points is not None:
                for j, (unit, size) in enumerate(kinds):
                    row[f"q{j + 1}_{unit}"] = round(poses.points.q[n, j] / size, 9)
            row |= {f"{model}_mm": round(m.per_pose[n] / MM, 6) for model, m in poses.models.items()}
            rows.append(row)
    return rows


def _errors_rows(c, evidence):
    models = {poses.proves: poses.models for poses in evidence.sets}
    rows = []
    for table in _error_tables(c):
        name_of_set = "held-out" if table["proves"] else "fitted"
        for part, labels in table["parts"].items():
            for label, statistics in labels.items():
                for name, values in statistics.items():
                    row = {"set": name_of_set, "by": part, "label": label, "model": name} | vars(values)
                    model = models.get(table["proves"], {}).get(name)
                    intervals = model.intervals if model and not part else None
                    for key, (low, high) in (intervals or {}).items():
                        row |= {f"{key}_low": low, f"{key}_high": high}
                    rows.append(row)
    return rows


def _joints_rows(evidence):
    found = evidence.approach
    if found is None:
        return []
    slides = found.robot.arm.table.prismatic
    rows = []
    for n, pose in enumerate(found.points.pose_ids):
        for j in range(found.angle.shape[1]):
            if found.angle[n, j] == found.angle[n, j]:
                unit, size = ("mm", MM) if slides[j] else ("deg", DEG)
                rows.append(
                    {
                        "set": evidence.approach_name,
                        "pose": pose,
                        "joint": j + 1,
                        "unit": unit,
                        "q": round(found.points.q[n, j] / size, 9),
                        "came_from": "below" if found.direction[n, j] > 0 else "above",
                        "residual": round(found.angle[n, j] / size, 9),
                    }
                )
    return rows
