"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import (
    BootstrapSeed,
    Calibration,
    FailIfWorse,
    IncludeFitted,
    Jobs,
    Json,
    Measurements,
    PayloadOfFiles,
    RefitBase,
    RefitTool,
    SameTool,
    Verbose,
)

if TYPE_CHECKING:
    from irbcal.validation.evaluation import Evaluation

Relative: TypeAlias = Literal["virtual", "three-points"]
Rule: TypeAlias = Literal["mean3sigma", "max", "percentile"]


def evaluate(
    calibration: Calibration,
    measurements: Measurements,
    refit_base: RefitBase = False,
    refit_tool: RefitTool = False,
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
    include_fitted: IncludeFitted = False,
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
    seed: BootstrapSeed = 0,
    payload: PayloadOfFiles = None,
    same_tool: SameTool = False,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Largest position error allowed, mm: pass, fail or not proven; exit code 3 unless it is a pass."
        ),
    ] = None,
    rule: Annotated[
        Rule | None,
        typer.Option(
            help="What must be within the tolerance: mean + 3 sigma, the largest error, or the 95th percentile.",
            show_default="mean3sigma",
        ),
    ] = None,
    tracker_u95: Annotated[
        float | None,
        typer.Option(
            "--tracker-u95-mm",
            help="Expanded uncertainty (95 %) of a measured position, mm, added to the upper bound of the figure.",
            show_default="the largest u95_mm of the file, else 0.05",
        ),
    ] = None,
    region_only: Annotated[
        bool,
        typer.Option(
            "--region-only",
            help="Judge the tolerance for the region of these poses only; else they must cover the calibrated ranges.",
        ),
    ] = False,
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
    jobs: Jobs = None,
    fail_if_worse: FailIfWorse = False,
    verbose: Verbose = False,
    json: Json = False,
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
        tracker_u95=None if tracker_u95 is None else tracker_u95 * MM,
        region_only=region_only,
        info=_told(info),
        jobs=jobs,
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
