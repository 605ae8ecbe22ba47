"""``irbcal axes``: what each joint does beyond geometry."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def _frequency(text):
    """Periods per turn; None for a free one."""
    if text == "free":
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1000.0:
        raise typer.BadParameter(f"expected free or a number of periods per turn above zero, found {text!r}")
    return value


def axes(
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration folder: its residuals are analysed, too.", show_default=False)
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="URDF or shipped robot, identified from these poses first.", show_default=False),
    ] = None,
    joint: Annotated[int | None, typer.Option(min=1, help="Only this joint.", show_default="all joints")] = None,
    order: Annotated[int, typer.Option(min=1, max=12, help="Order of the Fourier series.")] = 2,
    frequency: Annotated[str, typer.Option(help="Of the Fourier series, periods per turn; or: free.")] = "1",
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.

    One-joint moves (groups axis1, axis2, …) need no robot: their circles are enough. Any other poses are analysed by
    the residuals of a calibration (--calibration) or of a robot that is identified from them first (--robot).
    """
    if calibration is not None and robot is not None:
        raise typer.BadParameter("give --calibration or --robot, not both")
    periods = _frequency(frequency)
    from irbcal.joint_behaviour import behaviour as joint_behaviour
    from irbcal.measurement import table

    with show.progress(3, quiet=json) as step:
        step("reading the measurements")
        seen = table.read(measurements)
        model, options = _model(calibration, robot, seen)
        step("analysing the joints")
        report = joint_behaviour.analyse(seen, model, joint=joint, order=order, frequency=periods, **options)
        written = []
        if plots is not None:
            from irbcal.files.atomic import write_together
            from irbcal.joint_behaviour import plots as joint_plots

            step("drawing")
            drawn = joint_plots.draw(report)
            write_together(plots, drawn)
            written = [str(plots / name) for name in drawn]
    result = joint_behaviour.as_dict(report)
    if json:
        show.print_json(result | {"plots": written})
        return
    _print(result)
    for name in written:
        show.say(f"Written to {name}")


def _model(calibration, robot, seen):
    """The robot of a calibration with what belongs to it, or a nominal arm."""
    if calibration is not None:
        from irbcal.files import calibration_folder

        saved = calibration_folder.load(calibration)
        seen.check_joints(saved.arm())
        options = {
            "nominal": saved.arm(calibrated=False),
            "references": saved.reference_places() or None,
            "simulated": saved.simulated,
        }
        return saved.robot_calibrated(), options
    if robot is not None:
        from irbcal.files import urdf

        arm = urdf.read(robot).arm
        seen.check_joints(arm)
        return arm, {}
    return None, {}


def _print(result):
    mark = "SIMULATED data: " if result["simulated"] else ""
    if result["moves"]:
        title = f"errors of one-joint moves in {result['source']}: rms (tangential: largest, too), mm"
        _errors(f"{mark}{title}", result["moves"])
        title = "Terms from one-joint moves; without and with: tangential rms of joint angles left out of the fit, mm"
        _terms(f"{mark}{title}", [term for joint in result["moves"] for term in joint["terms"]])
    if result["residuals"]:
        found = result["residuals"]
        title = (
            f"Terms from the residuals of {found['robot']} on {found['poses']} poses, geometry refitted "
            f"({found['rms_mm']:.3f} mm rms); without and with: rms of poses left out of the fit, mm"
        )
        _terms(f"{mark}{title}", found["terms"])
    show.say("± is the half-width of the 95 % interval; backlash is reached from above minus reached from below.")
    show.say("Per move: for each 100 degrees of the last move. Gain: a ratio. p: F test, corrected for what was tried.")
    show.say()
    show.say("Verdict")
    for sentence in result["verdict"]:
        show.say(f"- {sentence}")
    if result["excluded"]:
        show.say(f"Left out: {len(result['excluded'])} points")
        for line in show.exclusions(result["excluded"]):
            show.say(line)
    for note in result["notes"]:
        show.note(note)


def _table(title, columns, rows):
    from rich import box
    from rich.console import Console
    from rich.table import Table

    show.say(title)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name, right in columns:
        table.add_column(name, justify="right" if right else "left")
    for row in rows:
        table.add_row(*row)
    Console(markup=False).print(table)


def _errors(title, moves):
    names = ("group", "n", "range, deg", "radial", "tangential", "largest", "axial", "p-p, deg")
    rows = []
    for series in (series for joint in moves for series in joint["series"]):
        low, high = series["range_deg"]
        sizes = [series["radial"]["rms_mm"], *series["tangential"].values(), series["axial"]["rms_mm"]]
        sizes = [f"{size:.3f}" for size in sizes]
        angle = f"{series['angle_peak_to_peak_deg']:.4f}"
        rows.append((series["group"], str(series["poses"]), f"{low:.0f}…{high:.0f}", *sizes, angle))
    _table(title, [(name, name != "group") for name in names], rows)


NAMES = {"move": "per move", "fourier": "Fourier"}


def _terms(title, terms):
    names = ("joint", "term", "value, deg", "p", "without", "with", "verdict")
    rows = []
    for term in terms:
        joint = "2, 3" if term["joint"] is None else str(term["joint"])
        name = NAMES.get(term["kind"], term["kind"]) + (", mm" if term["unit"] == "mm" else "")
        if term["note"]:
            rows.append((joint, name, term["note"], "", "", "", "not tested"))
            continue
        p = "<0.001" if term["p"] < 1e-3 else f"{term['p']:.3f}"
        rms = [f"{term[key]:.3f}" for key in ("rms_without_mm", "rms_with_mm")]
        rows.append((joint, name, "\n".join(_values(term)), p, *rms, term["verdict"]))
    _table(title, [(name, name in ("p", "without", "with")) for name in names], rows)


def _values(term):
    """Lines with the values of a term and their intervals."""
    digits = 5 if term["unit"] == "1" else 4
    lines = []
    for name, v in term["values"].items():
        label = f"{name} " if len(term["values"]) > 1 else ""
        lines.append(f"{label}{v['value']:.{digits}f} ± {(v['high'] - v['low']) / 2:.{digits}f}")
    if term["frequency"] and len(term["frequency"]) == 3:
        found, low, high = term["frequency"]
        lines.append(f"frequency {found:.4f} ± {(high - low) / 2:.4f}")
    return lines
