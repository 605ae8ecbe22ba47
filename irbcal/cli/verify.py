"""``irbcal verify``: is a calibration as it was written, and a URDF or a corrected program of it."""

from __future__ import annotations

from typing import Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import Typed, command, public


@command("verify", arguments=("calibration",), typed={"reseal": Typed(str, "WHY")})
def verify(options: dict[str, Any], json: Json = False) -> None:
    """Tell whether a calibration is as it was written, or a URDF or program its own; exit code 1 if it is not."""
    urdf, program = options.get("urdf"), options.get("program")
    if urdf is not None and program is not None:
        raise typer.BadParameter("give one of --urdf and --program", param_hint="--urdf")
    result = public("verify")(**options)
    if json:
        show.print_json(result.to_dict())
    else:
        first, *more = result.report()
        show.tell([f"{urdf or program or options['calibration']}: {first}", *more])
    if not result:
        raise typer.Exit(1)
