"""``irbcal hand-eye``: cameras and boards on the flange and in the cell, from corners."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import Typed, command, public


@command(
    "hand_eye",
    arguments=("measurements",),
    typed={"robot": Typed(str, None)},
    without=("out",),
    texts={"robot": "Calibration folder, URDF or name of the robot whose joints these are (see irbcal robots)."},
)
def hand_eye(
    options: dict[str, Any],
    out: Annotated[Path | None, typer.Option(help="File for the result, such as hand_eye.json.")] = None,
    json: Json = False,
) -> None:
    """Where cameras and boards are on the flange and in the cell, the robot taken as it is.

    With --images needs OpenCV: pip install 'irbcal[camera]'.
    """
    result = public("hand_eye")(**options, out=out)
    show.result(result, json, "" if out is None else f"Written to {out}", out=None if out is None else str(out))
