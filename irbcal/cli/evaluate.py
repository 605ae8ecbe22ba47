"""``irbcal evaluate``: errors of a calibration on other measurements, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import FailIfWorse, Json, Verbose
from irbcal.cli.signature import MM, Typed, command, numbers, public
from irbcal.units import MM as MM_PER_M


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    """Names and values of texts ``key=value``."""
    out: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise typer.BadParameter(f"expected key=value, found {text!r}", param_hint=option)
        if key in out:
            raise typer.BadParameter(f"{key} is told twice", param_hint=option)
        out[key] = value
    return out


def _frame_points(text: str, option: str) -> list[tuple[str, ...]]:
    points = [tuple(name.strip().rsplit("/", 1)) for name in text.split(",")]
    if len(set(points)) != 3 or len(points) != 3 or any(len(name) != 2 for name in points):
        raise typer.BadParameter(f"expected three different points as POSE/TARGET, found {text!r}", param_hint=option)
    return points


def _joints(text: str, option: str) -> list[int]:
    try:
        return [int(joint) for joint in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f"expected numbers of joints such as 3,5, found {text!r}", param_hint=option) from None


@command(
    "evaluate",
    arguments=("calibration", "measurements"),
    typed={
        "sphere": numbers("X,Y,Z,DIAMETER", 4, units=[MM_PER_M]),
        "tolerance": MM,
        "tracker_u95": MM,
        "info": Typed(list[str], "KEY=VALUE", _pairs),
        "refit_zeros": Typed(str, "JOINT,JOINT,…", _joints),
        "frame_points": Typed(str, "POSE/TARGET,…", _frame_points),
    },
    flags={"tracker_u95": "--tracker-u95-mm"},
    panels={
        "Everyday": ("tolerance", "report", "intervals", "refit_base", "refit_tool", "refit_zeros", "verbose", "json"),
        "Measurements": ("payload", "same_tool", "include_fitted", "sphere", "tracker_u95"),
        "Certificate": ("info", "figures", "data", "rule", "region_only"),
    },
)
def evaluate(
    options: dict[str, Any],
    report: Annotated[Path | None, typer.Option(help="Write a certificate to print and sign (HTML, A4).")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for the certificate's figures (PNG).")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder for its data (CSV, JSON).")] = None,
    fail_if_worse: FailIfWorse = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Mean, sigma, max and mean + 3 sigma per group, target and payload, for the nominal and the calibrated robot."""
    if report is None and (figures or data):
        raise typer.BadParameter(
            "only a certificate has them: name its page with --report", param_hint="--figures, --data"
        )
    result = public("evaluate")(**options)
    written = {} if report is None else public("certificate")(result, report, figures=figures, data=data)
    if json:
        show.print_json(
            result.to_dict() | {"written": [str(path / name) for path in written for name in written[path]]}
        )
    else:
        show.tell(result.report(verbose))
        for folder, files in written.items():
            show.say(f"Written to {folder}: {', '.join(files)}")
    if result.conformity is not None and not result.conformity:
        raise typer.Exit(show.NOT_TRUSTED)
    show.fail(result.verdict, fail_if_worse)
