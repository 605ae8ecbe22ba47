"""``irbcal verify``: is a URDF the one of this calibration."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def verify(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    urdf: Annotated[Path, typer.Option(help="URDF to compare with it.", show_default=False)],
    base_link: Annotated[
        str | None, typer.Option(help="Base link in the URDF.", show_default="the calibration's")
    ] = None,
    tip_link: Annotated[
        str | None, typer.Option(help="Tip link in the URDF.", show_default="the calibration's")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Tell whether a URDF found somewhere is this calibration; exit code 1 if it is not."""
    from irbcal.errors import RobotError
    from irbcal.files import calibration_folder, origins

    saved = calibration_folder.load(calibration)
    try:
        data = urdf.read_bytes()
    except OSError as error:
        raise RobotError(f"{urdf}: cannot read this file: {error.strerror}") from None
    result = origins.verify(saved, data, str(urdf), base_link, tip_link)
    if json:
        show.print_json(asdict(result))
    else:
        show.say(f"{urdf}: {result.explanation}")
    if not result.is_calibration:
        raise typer.Exit(1)
