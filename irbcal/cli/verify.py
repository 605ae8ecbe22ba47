"""``irbcal verify``: is a URDF or a corrected program the one of this calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def verify(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    urdf: Annotated[Path | None, typer.Option(help="URDF to compare with it.", show_default=False)] = None,
    program: Annotated[
        Path | None, typer.Option(help="Program with fake targets to compare with it.", show_default=False)
    ] = None,
    base_link: Annotated[
        str | None, typer.Option(help="Base link in the URDF.", show_default="the calibration's")
    ] = None,
    tip_link: Annotated[
        str | None, typer.Option(help="Tip link in the URDF.", show_default="the calibration's")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
) -> None:
    """Tell whether a URDF or a program found somewhere is of this calibration; exit code 1 if it is not."""
    from irbcal.validation.verification import verify as compare

    if (urdf is None) == (program is None):
        raise typer.BadParameter("give one of --urdf and --program", param_hint="--urdf")
    result = compare(calibration, urdf, program=program, base_link=base_link, tip_link=tip_link)
    if json:
        show.print_json(result.to_dict())
    else:
        show.say(f"{urdf or program}: {result.explanation}")
    if not result.is_calibration:
        raise typer.Exit(1)
