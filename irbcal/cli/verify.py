"""``irbcal verify``: is a calibration as it was written, and a URDF or a corrected program of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import wrong_calls


def verify(
    calibration: Annotated[
        Path, typer.Argument(help="Calibration folder, or with --public-key a signed file.", show_default=False)
    ],
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
    reseal: Annotated[
        str | None,
        typer.Option(metavar="WHY", help="Accept a deliberate change of the folder, for a reason.", show_default=False),
    ] = None,
    public_key: Annotated[
        Path | None, typer.Option(help="Key of whom it must be signed (irbcal sign).", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Tell whether a calibration is as it was written, or a URDF or program its own; exit code 1 if it is not."""
    from irbcal.validation.verification import verify as compare

    if urdf is not None and program is not None:
        raise typer.BadParameter("give one of --urdf and --program", param_hint="--urdf")
    with wrong_calls():
        result = compare(
            calibration,
            urdf,
            program=program,
            base_link=base_link,
            tip_link=tip_link,
            reseal=reseal,
            public_key=public_key,
        )
    if json:
        show.print_json(result.to_dict())
    else:
        first, *more = result.told()
        show.tell([f"{urdf or program or calibration}: {first}", *more])
    if not result:
        raise typer.Exit(1)
