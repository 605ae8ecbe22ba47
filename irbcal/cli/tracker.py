"""``irbcal tracker``: checks of the laser tracker itself."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show

Check = Enum("Check", {name: name for name in ("bar", "repeat", "drift", "settle")}, type=str)


def tracker(
    file: Annotated[Path, typer.Argument(help="Readings (CSV or Parquet), see below.", show_default=False)],
    check: Annotated[Check | None, typer.Option(help="Which check.", show_default="by the columns")] = None,
    length: Annotated[
        float | None, typer.Option(min=1e-3, help="bar: certified length of the scale bar, mm.", show_default=False)
    ] = None,
    band: Annotated[float, typer.Option(min=1e-6, help="settle: limit band, mm.")] = 0.02,
    rest: Annotated[float, typer.Option(min=0.0, help="settle: seconds after which the robot is at rest.")] = 10.0,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).", show_default=False)] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Scale-bar distances, repeatability, long-term drift with the air, stabilisation time.

    Columns: x_mm,y_mm,z_mm and, for bar: end (two names, in turn), optional position; or distance_mm alone. For
    repeat: optional position. For drift: time_s, optional temperature_c, pressure_mmhg, humidity_percent. For settle:
    time_s, run.
    """
    from irbcal.units import MM
    from irbcal.validation import plots, pose_tests
    from irbcal.validation import tracker as checks

    if plot is not None:
        plots.check_name(plot)
    kind = check.value if check else checks.kind(file)
    if kind == "bar":
        if length is None:
            raise typer.BadParameter("a scale bar needs its certified length in mm", param_hint="--length")
        result = checks.scale_bar(file, length * MM)
    elif kind == "repeat":
        result = checks.repeatability(file)
    elif kind == "drift":
        result = checks.drift(file)
    else:
        result = pose_tests.stabilisation(file, band * MM, rest)
    result = {"check": kind, **result}
    if plot is not None:
        size = (7.2, 2.2 * (1 + len(result["series"]["air"]))) if kind == "drift" else (7.2, 4.4)
        plots.save(getattr(plots, kind), plot, result, size=size)
    if json:
        show.print_json(result)
        return
    {"bar": _bar, "repeat": _repeat, "drift": _drift, "settle": _settle}[kind](result)
    if plot is not None:
        show.say(f"Figure written to {plot}")


def _bar(result):
    rows = [("all", *_signed(result))]
    if len(result["per_position"]) > 1:
        rows += [(name, *_signed(values)) for name, values in result["per_position"].items()]
    columns = ("position", "n", "mean", "sigma", "largest", "rms")
    grid.table(f"Distance errors of the scale bar of {result['length_mm']:.10g} mm, mm", columns, rows)


def _signed(values):
    return (values["n"], *((values[key], 4) for key in ("mean_mm", "sigma_mm", "max_abs_mm", "rms_mm")))


def _repeat(result):
    keys = ("mean_mm", "max_mm", "sigma_mm", "mean_plus_3sigma_mm")
    rows = [(name, values["n"], *((values[key], 4) for key in keys)) for name, values in result["per_position"].items()]
    grid.table("Repeatability, distances from the mean, mm", ("point", "n", "mean", "max", "sigma", "mean+3σ"), rows)
    _lost(result)


def _drift(result):
    rate = result["rate_mm_per_hour"]
    show.say(
        f"{result['n']} readings over {result['hours']:.2f} hours: error mean {result['mean_mm']:.4f}, sigma "
        f"{result['sigma_mm']:.4f}, max {result['max_mm']:.4f} mm"
    )
    show.say(
        f"Trend: x {rate['x']:+.5f}, y {rate['y']:+.5f}, z {rate['z']:+.5f} mm per hour, {rate['total']:.5f} together"
    )
    rows = []
    for name, found in result["correlation"].items():
        for key in ("error", "x", "y", "z"):
            if key in found:
                c = found[key]
                told = "yes" if c["told"] else "no"
                rows.append((name, key, (c["r"], 2), grid.interval(c["interval"], 2), (c["n_eff"], 0), told))
            elif key == "error":
                rows.append((name, "constant", None, "–", None, "–"))
    if rows:
        columns = ("air", "of", "r", "95 % interval", "n effective", "told from none")
        grid.table("Correlation with the air", columns, rows)
        show.say("Of twenty such intervals, one leaves out zero by chance.")
    _lost(result)


def _settle(result):
    from irbcal.cli import iso9283

    iso9283.print_stabilisation(result)


def _lost(result):
    if result["lost"]:
        show.say(f"Left out: {result['lost']} lost points")
