"""``irbcal ballbar``: radial errors of circular paths, predicted and measured."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show

Run = Enum("Run", {"nominal": "nominal", "fake": "fake"}, type=str)


def ballbar(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    file: Annotated[
        Path | None,
        typer.Argument(help="Measured: angle_deg,radius_mm (or error_mm)[,run].", show_default=False),
    ] = None,
    bar: Annotated[float, typer.Option(min=1.0, help="Length of the ballbar, mm: the radius, unless --height.")] = 150,
    joints: Annotated[
        str | None,
        typer.Option(help="Joints in degrees with the tool in the circle's centre.", show_default="0,0,0,0,90,0"),
    ] = None,
    tool: Annotated[
        str, typer.Option(help="The cup's centre on tool0: x,y,z in mm, optionally with qw,qx,qy,qz.")
    ] = "0,0,0",
    normal: Annotated[str, typer.Option(help="The path turns about it, in the base link.")] = "0,0,1",
    start: Annotated[str, typer.Option(help="Direction from the centre to the start, in the base link.")] = "1,0,0",
    height: Annotated[float, typer.Option(help="Of the circle's plane above the ball, along the normal, mm.")] = 0.0,
    tilt: Annotated[float, typer.Option(help="Lean of the tool's z axis towards the centre, degrees.")] = 0.0,
    arcs: Annotated[int, typer.Option(min=0, max=512, help="Arcs of the path of fake targets; 0: none.")] = 6,
    run: Annotated[
        Run, typer.Option(help="What was run when FILE was measured: the nominal targets or the fake ones.")
    ] = Run.nominal,
    plot: Annotated[Path | None, typer.Option(help="Polar plot to write (.png, .svg, .pdf).")] = None,
    magnify: Annotated[
        float | None, typer.Option(min=1e-3, help="Magnification of the errors.", show_default="a round number")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint reversals."""
    import numpy as np

    from irbcal.files import calibration_folder
    from irbcal.units import DEG, MM
    from irbcal.validation import ballbar as bars
    from irbcal.validation import plots

    if plot is not None:
        plots.check_name(plot)
    place = np.array(grid.numbers(tool, (3, 7), "--tool"))
    place[:3] *= MM
    T_tip_tcp = bars.tool(place)
    axes = [grid.numbers(text, (3,), option) for text, option in ((normal, "--normal"), (start, "--start"))]
    saved = calibration_folder.load(calibration)
    robot, nominal = saved.robot_calibrated(), saved.arm(calibrated=False)
    q = np.array(grid.numbers(joints or "0,0,0,0,90,0", (len(nominal.joint_names),), "--joints")) * nominal.joint_units
    circle = bars.circle(nominal, q, bar * MM, T_tip_tcp, *axes, height * MM, tilt * DEG)
    if run == Run.fake and not arcs:
        raise typer.BadParameter("fake targets were run in at least one arc", param_hint="--arcs")
    found = bars.predict(circle, robot, nominal, q, arcs, T_tip_tcp)
    measured = bars.read(file, bar * MM) if file is not None else {}
    expected = found.corrected if run == Run.fake else found.uncorrected
    result = _result(found, measured, expected, run.value, saved)
    if plot is not None:
        traces = [("nominal targets, predicted", plots.NOMINAL, "-", found.uncorrected)]
        if found.corrected is not None:
            traces.append((f"fake targets ({arcs} arcs), predicted", plots.CALIBRATED, "-", found.corrected))
        lines = (":", "--", "-.")
        traces += [
            (name if name == "measured" else f"measured, run {name}", plots.MEASURED, lines[k % 3], trace)
            for k, (name, trace) in enumerate(measured.items())
        ]
        plots.save(plots.ballbar, plot, traces, found.reversals, bar * MM, magnify, size=(6.4, 7.0))
    if json:
        show.print_json(result)
        return
    _print(result, bar, arcs)
    if plot is not None:
        show.say(f"Figure written to {plot}")


def _result(found, measured, expected, run, saved):
    from irbcal.units import DEG, MM
    from irbcal.validation import ballbar as bars

    runs = {}
    for name, trace in measured.items():
        before, after = bars.explained(trace, expected)
        runs[name] = {**bars.summary(trace), "variation_rms_mm": before / MM, "unexplained_rms_mm": after / MM}
    return {
        "simulated": saved.simulated,
        "nominal_targets": bars.summary(found.uncorrected),
        "fake_targets": None if found.corrected is None else bars.summary(found.corrected),
        "arcs": found.arcs,
        "run": run,
        "measured": runs,
        "reversals": [
            {"path_angle_deg": 360 * r.s, "joint": r.joint, "joint_angle_deg": r.angle / DEG, "kind": r.kind}
            for r in found.reversals
        ],
    }


def _print(result, bar, arcs):
    rows = [("nominal targets, predicted", *_figures(result["nominal_targets"]))]
    if result["fake_targets"]:
        rows.append((f"fake targets ({arcs} arcs), predicted", *_figures(result["fake_targets"])))
    rows += [(f"measured ({name})", *_figures(values)) for name, values in result["measured"].items()]
    start = "Calibration from SIMULATED data: " if result["simulated"] else ""
    columns = ("", "mean", "rms", "largest", "circularity")
    grid.table(f"{start}radial errors of the circle, ballbar {bar:g} mm, centre fitted, mm", columns, rows)
    which = {"nominal": "nominal", "fake": "calibrated"}[result["run"]]
    for name, values in result["measured"].items():
        show.say(
            f"Run {name}: the readings vary by {values['variation_rms_mm']:.4f} mm rms; the prediction for the path of "
            f"{which} targets leaves {values['unexplained_rms_mm']:.4f} mm unexplained."
        )
    rows = [
        ((r["path_angle_deg"], 1), (r["joint_angle_deg"], 1), str(r["joint"]), r["kind"]) for r in result["reversals"]
    ]
    if rows:
        grid.table("Joints that turn back", ("path angle deg", "joint angle deg", "joint", "min/max"), rows)


def _figures(values):
    return tuple(values[key] for key in ("mean_mm", "rms_mm", "max_abs_mm", "circularity_mm"))
