"""``report.html``: one self-contained page that shows what a calibration is worth and how to use it.

The page says what ``calibration.json`` says: nothing is computed here beyond differences and counts. It
runs no script and loads nothing.
"""

from io import BytesIO

NOMINAL, CALIBRATED = "#dd7d11", "#1f72bd"
"""Colours of the two models, the same in every figure and table; safe for the colour-blind."""
INK = "#010203"
"""Stands for the text's colour in figures until the page's own takes its place."""

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


def render(calibration):
    """The report as one HTML page.

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    str
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("irbcal.export"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"fixed": fixed, "unit": _in_unit, "std": _deviation, "count": _count}
    environment.filters["repr"] = repr
    robot = calibration.robot
    return environment.get_template("report.html.j2").render(
        c=calibration,
        colours={"nominal": NOMINAL, "calibrated": CALIBRATED},
        verdict=verdict(calibration),
        statistics=STATISTICS,
        error_tables=_error_tables(calibration),
        figures=_figures(calibration),
        states=_states(calibration.parameters),
        dhm_columns=_dhm_columns(robot),
        dhm_rows=list(zip(robot.joint_names, robot.dhm_nominal, robot.dhm_calibrated, strict=True)),
        identity=calibration.robot_calibrated().joint_map.is_identity,
        coefficients=_coefficients(calibration.joint_map),
        left_out=_left_out(calibration.excluded),
    )


def verdict(calibration):
    """What the calibration is worth, in one sentence (two where nothing was held out).

    Parameters
    ----------
    calibration : Calibration

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


def fixed(value, digits):
    """A number with a fixed count of decimals, without a minus sign before zero."""
    return format(round(value, digits) + 0.0, f".{digits}f")


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


# --- figures ---------------------------------------------------------------------------------------------


def _figures(c):
    """Per set of poses: errors in order of measurement and their histogram (Nubiola 2011, Figures 7.4-7.7).

    No name from the data goes into a figure.
    """
    import matplotlib

    out = []
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "svg.fonttype": "none",
                "svg.hashsalt": "irbcal",
                "text.parse_math": False,
                "font.size": 12,
                "axes.labelcolor": INK,
                "axes.edgecolor": INK,
                "text.color": INK,
                "xtick.color": INK,
                "ytick.color": INK,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.axisbelow": True,
                "axes.grid": True,
                "grid.color": INK,
                "grid.alpha": 0.15,
            }
        )
        for key, wanted, title, nominal, calibrated in (
            ("heldout", True, "held-out", c.heldout_nominal, c.heldout),
            ("fit", False, "fitted", c.fit_nominal, c.fit),
        ):
            picked = [k for k, heldout in enumerate(c.points.heldout) if heldout == wanted]
            if not picked:
                continue
            errors = {
                name: ([getattr(c.points, f"{name}_mm")[k] for k in picked], statistics.all)
                for name, statistics in _models(c, nominal, calibrated).items()
            }
            drawings = []
            for name, draw, text in (
                ("order", _in_order, "Position error of each {} point in order of measurement"),
                ("histogram", _histogram, "Histogram of the position errors of the {} points"),
            ):
                text = text.format(title)
                drawings.append((text, _draw(draw, errors, f"{key}-{name}", text)))
            out.append({"title": f"{title.capitalize()} points", "drawings": drawings})
        drawings = []
        if c.observability.singular_values_mm:
            text = "Singular values of the scaled Jacobian: how far all points move together for a plausible error"
            drawings.append((text, _draw(_singular_values, c.observability, "singular-values", text)))
        if len(c.history.get("iteration", ())) > 1:
            text = "Course of the identification: objective, and mean and largest error of poses that took no part"
            unused = [name.removesuffix("_mean_mm") for name in c.history if name.endswith("_mean_mm")]
            if len(unused) > 1:
                text += f" ({', '.join(f'{k}: {name}' for k, name in enumerate(unused, 1))})"
            drawings.append((text, _draw(_course, c.history, "course", text)))
        if drawings:
            out.append({"title": "Identification", "drawings": drawings})
    return out


def _draw(draw, data, key, text):
    """One figure as inline SVG; ``draw`` returns the handles of a legend, if there is one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.8, 3.6), layout="constrained")
    handles = draw(figure, data)
    if handles:
        figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, handlelength=1.0)
    stream = BytesIO()
    figure.savefig(stream, format="svg", transparent=True, dpi=180, metadata={"Date": None})
    return _inline(stream.getvalue(), key, text)


def _colour(name):
    return NOMINAL if name == "nominal" else CALIBRATED


def _models_legend(errors):
    from matplotlib.patches import Patch

    return [
        Patch(color=_colour(name), label=f"{name} (mean {fixed(all_.mean_mm, 3)} mm)")
        for name, (_, all_) in errors.items()
    ]


def _singular_values(figure, observability):
    axes = figure.add_subplot()
    values = observability.singular_values_mm
    seen = range(1, observability.seen + 1)
    axes.semilogy(seen, values[: observability.seen], "o", color=CALIBRATED, label="seen")
    held = range(observability.seen + 1, len(values) + 1)
    floor = min(values[: observability.seen], default=1.0) / 10
    shown = [max(value, floor) for value in values[observability.seen :]]
    if shown:
        axes.semilogy(held, shown, "v", color=NOMINAL, label=f"held (below {floor:.2g} mm drawn there)")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("direction")
    axes.set_ylabel("singular value (mm)")
    _plain_numbers(axes)
    return axes.get_legend_handles_labels()[0]


def _plain_numbers(axes):
    """A logarithmic axis labelled 1, 10, 100 where it spans decades, and 1, 2, 5, 10 where it does not."""
    from matplotlib.ticker import LogLocator

    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 50 * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")


def _course(figure, history):
    axes = figure.add_subplot()
    iteration = history["iteration"]
    axes.semilogy(iteration, history["objective_mm"], "-o", color=CALIBRATED, markersize=4, label="objective")
    unused = [name for name in history if name.endswith(("_mean_mm", "_max_mm"))]
    for k, name in enumerate(unused):
        what, number = ("mean", "max")[k % 2], f" {k // 2 + 1}" if len(unused) > 2 else ""
        style = {"color": NOMINAL, "marker": "osd^v"[k // 2 % 5], "linestyle": ("-", "--")[k % 2], "markersize": 4}
        axes.semilogy(iteration, history[name], label=f"unused{number}, {what}", **style)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("iteration")
    axes.set_ylabel("error (mm)")
    _plain_numbers(axes)
    return axes.get_legend_handles_labels()[0]


def _in_order(figure, errors):
    """A panel for each model, one above the other, so that neither hides the other."""
    panels = figure.subplots(len(errors), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (name, (distance, _)) in zip(panels, errors.items(), strict=True):
        n = len(distance)
        size = min(6.0, max(2.6, 90 / n**0.5))
        style = {"color": _colour(name), "alpha": 0.75, "markersize": size, "markeredgewidth": 0}
        axes.plot(range(1, n + 1), distance, "o", rasterized=True, **style)
        axes.set_ylabel("error (mm)")
        axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlim(1 - 0.02 * n, n + 0.02 * n)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("point, in order of measurement")
    return _models_legend(errors)


def _histogram(figure, errors):
    import numpy as np

    axes = figure.add_subplot()
    largest = max(max(distance) for distance, _ in errors.values())
    edges = np.linspace(0.0, largest or 1.0, 41)
    for name, (distance, all_) in errors.items():
        colour = _colour(name)
        style = {"facecolor": (colour, 0.3), "edgecolor": colour, "linewidth": 1.2}
        axes.hist(distance, edges, histtype="stepfilled", **style)
        axes.axvline(all_.mean_mm, color=colour, linewidth=1.4, linestyle=(0, (4, 2)))
    axes.set_xlim(0, edges[-1])
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("error (mm); dashed: mean")
    axes.set_ylabel("points")
    return _models_legend(errors)


def _inline(svg, key, text):
    """An SVG file as part of a page: ids of its own, the page's colour, no metadata, no namespaces."""
    from lxml import etree
    from markupsafe import Markup

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    root = etree.fromstring(svg, parser)
    for element in list(root.iter()):
        element.tag = etree.QName(element).localname
        if element.tag in ("metadata", "style"):
            element.getparent().remove(element)
            continue
        for name, value in list(element.attrib.items()):
            local = etree.QName(name).localname
            del element.attrib[name]
            if local == "id":
                value = f"{key}-{value}"
            elif local == "href" and value.startswith("#"):
                value = f"#{key}-{value[1:]}"
            element.set(local, value.replace("url(#", f"url(#{key}-").replace(INK, "currentColor"))
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("role", "img")
    root.set("aria-label", text)
    etree.cleanup_namespaces(root)
    return Markup(etree.tostring(root, encoding="unicode"))
