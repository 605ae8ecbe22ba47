"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from irbcal.cli import grid, show

if TYPE_CHECKING:
    from irbcal.validation.evaluation import Evaluation

Relative: TypeAlias = Literal["virtual", "three-points"]
Rule: TypeAlias = Literal["mean3sigma", "max", "percentile"]


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
    tolerance: Annotated[
        float | None,
        typer.Option(help="Largest position error allowed, mm: pass or fail; exit code 3 unless it is a pass."),
    ] = None,
    rule: Annotated[
        Rule | None,
        typer.Option(
            help="What must be within the tolerance: mean + 3 sigma, the largest error, or the 95th percentile.",
            show_default="mean3sigma",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a certificate to print and sign (HTML, A4).", show_default=False)
    ] = None,
    info: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="For the certificate: serial_number, operator, tracker, tracker_certificate, temperature, date, "
            "robot_type or any other; repeatable. Columns of the file with these names are taken, too.",
            show_default=False,
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the certificate's figures (PNG).", show_default=False)
    ] = None,
    data: Annotated[Path | None, typer.Option(help="Folder for its data (CSV, JSON).", show_default=False)] = None,
    fail_if_worse: Annotated[bool, typer.Option("--fail-if-worse", help=show.FAIL_IF_WORSE)] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help=show.VERBOSE)] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
) -> None:
    """Mean, sigma, max and mean + 3 sigma per group, target and payload, for the nominal and the calibrated robot."""
    from irbcal.units import MM
    from irbcal.validation.evaluate import evaluate as judge

    if report is None and (figures or data):
        raise typer.BadParameter(
            "only a certificate has them: name its page with --report", param_hint="--figures, --data"
        )
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
        tolerance=None if tolerance is None else tolerance * MM,
        rule=rule,
        info=_told(info),
    )
    written = {} if report is None else _certificate(result, report, figures, data)
    if json:
        show.print_json(
            result.to_dict() | {"written": [str(path / name) for path in written for name in written[path]]}
        )
    else:
        show.tell(result.told(verbose))
        for folder, files in written.items():
            show.say(f"Written to {folder}: {', '.join(files)}")
    if result.conformity is not None and not result.conformity:
        raise typer.Exit(show.NOT_TRUSTED)
    show.fail(result.verdict, fail_if_worse)


def _certificate(
    result: Evaluation, report: Path, figures: Path | None, data: Path | None
) -> dict[Path, tuple[str, ...]]:
    from irbcal.reports.certificate import certificate

    return certificate(result, report, figures=figures, data=data)


def _told(info: list[str] | None) -> dict[str, str]:
    """Names and what they are, of texts ``key=value``."""
    out: dict[str, str] = {}
    for text in info or ():
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise typer.BadParameter(f"expected key=value, found {text!r}", param_hint="--info")
        if key in out:
            raise typer.BadParameter(f"{key} is told twice", param_hint="--info")
        out[key] = value
    return out


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
