"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from irbcal.cli import grid, show

Relative: TypeAlias = Literal["virtual", "three-points"]


def evaluate(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    refit_base: Annotated[
        bool, typer.Option("--refit-base", help="Place the base anew: the tracker or the robot was moved.")
    ] = False,
    refit_tool: Annotated[
        bool, typer.Option("--refit-tool", help="Place the targets anew: the reflectors were mounted anew.")
    ] = False,
    refit_from: Annotated[
        int | None,
        typer.Option(
            min=3,
            help="Poses that place base and tool anew and are not judged.",
            show_default="half with --refit-tool; with --refit-base alone all, which are judged, too",
        ),
    ] = None,
    intervals: Annotated[
        bool,
        typer.Option(
            "--intervals",
            help="Percentiles, 95 % bootstrap intervals (poses drawn again), coverage of predicted intervals.",
        ),
    ] = False,
    include_fitted: Annotated[
        bool, typer.Option("--include-fitted", help="Keep poses that the calibration was fitted to.")
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
    payload: Annotated[
        float | None,
        typer.Option(min=0.0, help="Mass carried, kg, for files without a column payload_kg.", show_default=False),
    ] = None,
    same_tool: Annotated[
        bool,
        typer.Option("--same-tool", help="With loads unknown to the calibration reflectors stayed in place."),
    ] = False,
    fail_if_worse: Annotated[bool, typer.Option("--fail-if-worse", help=show.FAIL_IF_WORSE)] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
) -> None:
    """Mean, sigma, max and mean + 3 sigma per group, target and payload, for the nominal and the calibrated robot."""
    from irbcal.units import MM
    from irbcal.validation.evaluate import evaluate as judge

    result = judge(
        calibration,
        measurements,
        refit_base=refit_base,
        refit_tool=refit_tool,
        refit_from=refit_from,
        intervals=intervals,
        include_fitted=include_fitted,
        relative=relative,
        frame_points=_frame_points(frame_points, relative),
        sphere=None if sphere is None else [value * MM for value in grid.numbers(sphere, (4,), "--sphere")],
        flange=flange,
        compare=compare,
        verified=verified,
        seed=seed,
        payload=payload,
        same_tool=same_tool,
    )
    if json:
        show.print_json(result.to_dict())
    else:
        show.tell(result.told())
    show.fail(result.verdict, fail_if_worse)


def _frame_points(text: str | None, relative: Relative | None) -> list[tuple[str, str]] | None:
    if text is None:
        return None
    if relative != "three-points":
        raise typer.BadParameter("only --relative three-points takes them", param_hint="--frame-points")
    points = [item.strip().rsplit("/", 1) for item in text.split(",")]
    if len({tuple(item) for item in points}) != 3 or len(points) != 3 or any(len(item) != 2 for item in points):
        raise typer.BadParameter(
            f"expected three different points as POSE/TARGET, found {text!r}", param_hint="--frame-points"
        )
    return [(pose, target) for pose, target in points]
