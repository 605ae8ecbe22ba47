"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show

PARTS = ("per_target", "per_group", "per_payload", "per_group_payload")
Relative = Enum("Relative", {"virtual": "virtual", "three-points": "three-points"}, type=str)


def evaluate(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    refit_base: Annotated[
        bool, typer.Option("--refit-base", help="Place the base anew: the tracker or the robot was moved.")
    ] = False,
    intervals: Annotated[
        bool, typer.Option("--intervals", help="Percentiles and 95 % bootstrap intervals (poses drawn again).")
    ] = False,
    flange: Annotated[
        bool, typer.Option("--flange", help="Position and orientation of the flange, from three targets of a pose.")
    ] = False,
    relative: Annotated[
        Relative | None,
        typer.Option(help="Relative errors: all places shifted to fit best, or in a frame of three measured points."),
    ] = None,
    frame_points: Annotated[
        str | None,
        typer.Option(help="The three points as POSE/TARGET,POSE/TARGET,POSE/TARGET.", show_default="a wide triangle"),
    ] = None,
    sphere: Annotated[
        str | None, typer.Option(help="Only points inside: x,y,z,diameter in mm, in the base link.", show_default=False)
    ] = None,
    compare: Annotated[
        Path | None, typer.Option(help="Another calibration, pose by pose on the same data.", show_default=False)
    ] = None,
    verified: Annotated[
        Path | None,
        typer.Option(help="The same poses (by name) measured with fake targets: expected against verified error."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Mean, sigma, max and mean + 3 sigma per group, target and payload, for the nominal and the calibrated robot."""
    from irbcal import calibrating
    from irbcal.files import calibration_folder
    from irbcal.units import MM

    points = _frame_points(frame_points, relative)
    ball = None if sphere is None else [value * MM for value in grid.numbers(sphere, (4,), "--sphere")]
    saved = calibration_folder.load(calibration)
    result = calibrating.evaluate(
        saved,
        measurements,
        refit_base,
        intervals,
        relative.value if relative else None,
        points,
        ball,
        flange,
        calibration_folder.load(compare) if compare else None,
        verified,
        seed,
    )
    if json:
        show.print_json(result)
        return
    shown = {"nominal": "nominal", "calibrated": f"model {saved.model}"}
    _print_errors(calibration, result, shown)
    if refit_base:
        show.say("The base was placed anew on these points for each model: these are relative errors.")
    if result["excluded"]:
        show.say(f"Left out: {len(result['excluded'])} points")
        for line in show.exclusions(result["excluded"]):
            show.say(line)
    for name in shown if result["orientation"] else ():
        show.orientation(shown[name], result["orientation"][name])
    for part, print_part in (
        ("intervals", _print_intervals),
        ("flange", _print_flange),
        ("relative", _print_relative),
        ("comparison", _print_comparison),
        ("verified", _print_verified),
    ):
        if result[part]:
            print_part(result, shown)
    for note in result["notes"]:
        show.note(note)


def _frame_points(text, relative):
    if text is None:
        return None
    if relative is None or relative.value != "three-points":
        raise typer.BadParameter("only --relative three-points takes them", param_hint="--frame-points")
    points = [tuple(item.strip().rsplit("/", 1)) for item in text.split(",")]
    if len(points) != 3 or len(set(points)) != 3 or any(len(item) != 2 for item in points):
        raise typer.BadParameter(
            f"expected three different points as POSE/TARGET, found {text!r}", param_hint="--frame-points"
        )
    return points


def _print_errors(calibration, result, shown):
    rows = [("all", shown[name], result[name], name == "calibrated") for name in shown]
    for part in PARTS:
        if len(result[part]) > 1:
            rows += [
                (label, shown[name], values[name], False) for label, values in result[part].items() for name in shown
            ]
    show.statistics_table(f"{'SIMULATED data: ' if result['simulated'] else ''}position errors of {calibration}", rows)


def _print_intervals(result, shown):
    found = result["intervals"]
    rows = []
    for name in shown:
        ends, values = found[name] or {}, result[name] | result["percentiles"][name]
        for label, key in (
            ("mean", "mean_mm"),
            ("sigma", "sigma_mm"),
            ("mean + 3σ", "mean_plus_3sigma_mm"),
            *((f"{p[1:]} % of the points below", f"{p}_mm") for p in ("p50", "p90", "p95", "p99")),
        ):
            rows.append((label, shown[name], values[key], grid.interval(ends.get(key))))
    title = f"Bootstrap intervals ({found['level']:.0%}, {found['resamples']} resamples of the poses), mm"
    grid.table(title, ("", "model", "value", "interval"), rows)
    show.say(
        f"With 95 % confidence {result['largest_covers']:.1%} of all such poses stay below the largest error seen."
    )


def _print_flange(result, shown):
    found = result["flange"]
    keys = ("mean", "sigma", "max", "mean_plus_3sigma")
    for what, unit, digits in (("position", "mm", 3), ("orientation", "deg", 4)):
        rows = [(shown[name], *((found[name][what][f"{key}_{unit}"], digits) for key in keys)) for name in found]
        title = f"{what.capitalize()} errors of the flange ({found['nominal'][what]['n']} poses), {unit}"
        grid.table(title, ("model", "mean", "sigma", "max", "mean+3σ"), rows)


def _print_relative(result, shown):
    found = result["relative"]
    rows = [(shown[name], *_four(found[name])) for name in shown]
    how = "from a virtual frame" if found["kind"] == "virtual" else f"in the frame of {', '.join(found['points'])}"
    grid.table(f"Relative position errors {how}, mm", ("model", "mean", "sigma", "max", "mean+3σ"), rows)
    if found["kind"] == "virtual":
        x, y, z = found["shift_mm"]["calibrated"]
        show.say(f"Shift taken off for {shown['calibrated']}: {x:+.3f}, {y:+.3f}, {z:+.3f} mm in the base link")


def _print_comparison(result, shown):
    found = result["comparison"]
    rows = [
        (shown["calibrated"], *_four(found["this"])),
        (f"other, model {found['other_model']}", *_four(found["other"])),
    ]
    grid.table(
        f"Two calibrations on the same {found['poses']} poses, mm", ("", "mean", "sigma", "max", "mean+3σ"), rows
    )
    show.say(f"{found['verdict']} The other has the smaller error in {found['other_better_share']:.0%} of the poses.")


def _print_verified(result, shown):
    found = result["verified"]
    names = ("uncorrected", "expected", "verified")
    rows = [(name, found[name]["n"], *_four(found[name])) for name in names]
    for group, values in found["per_group"].items():
        rows += [(f"{group}: {name}", values[name]["n"], *_four(values[name])) for name in names if values[name]]
    grid.table("Expected against verified errors, mm", ("", "points", "mean", "sigma", "max", "mean+3σ"), rows)
    if found["poses"]["set_aside"]:
        names = found["poses"]["set_aside"]
        more = f" … and {len(names) - 8} more" if len(names) > 8 else ""
        show.note(
            "verified poses left out, because their commands are no fake targets of this calibration: "
            f"{', '.join(names[:8])}{more}"
        )
    if found["command_mm"] > 0.1:
        show.note(
            f"the verified commands miss this calibration's own fake targets by up to {found['command_mm']:.3f} mm: "
            "they are not its fake targets for poses of these names (not filtered, filtered with another calibration, "
            "or poses named otherwise)"
        )


def _four(values):
    return tuple(values[key] for key in ("mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm"))
