"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def evaluate(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    refit_base: Annotated[
        bool, typer.Option("--refit-base", help="Place the base anew: the tracker or the robot was moved.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Mean, sigma, max and mean + 3 sigma per group and target, for the nominal and the calibrated robot."""
    from irbcal import workflow
    from irbcal.export import calibration_file

    saved = calibration_file.load(calibration)
    result = workflow.evaluate(saved, measurements, refit_base)
    if json:
        show.print_json(result)
        return
    shown = {"nominal": "nominal", "calibrated": f"model {saved.model}"}
    rows = [("all", shown[name], result[name], name == "calibrated") for name in shown]
    for part in ("per_target", "per_group"):
        if len(result[part]) > 1:
            rows += [
                (label, shown[name], values[name], False) for label, values in result[part].items() for name in shown
            ]
    show.statistics_table(f"{'SIMULATED data: ' if result['simulated'] else ''}position errors of {calibration}", rows)
    if refit_base:
        show.say("The base was placed anew on these points for each model: these are relative errors.")
    if result["excluded"]:
        show.say(f"Left out: {len(result['excluded'])} points")
        for line in show.exclusions(result["excluded"]):
            show.say(line)
    for name in shown if result["orientation"] else ():
        show.orientation(shown[name], result["orientation"][name])
    for note in result["notes"]:
        show.note(note)
