"""``irbcal corners``: pictures of a ChArUco board in, rows for a calibration out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import path_to_write, wrong_calls


def corners(
    images: Annotated[Path, typer.Argument(help="Folder of the pictures.", show_default=False)],
    joints: Annotated[
        Path,
        typer.Option(help="CSV with a row a picture: image (its name), q1_deg …; optional pose, feature, place."),
    ],
    features: Annotated[
        Path,
        typer.Option(help="CSV or YAML with what is known of camera and board, as for calibrate; also dictionary."),
    ],
    out: Annotated[
        Path, typer.Option(parser=path_to_write, metavar="PATH", help="CSV of corners to write.", show_default=False)
    ],
    legacy: Annotated[
        bool, typer.Option("--legacy", help="The board is of the pattern that OpenCV drew before version 4.6.")
    ] = False,
    json: Json = False,
) -> None:
    """Find the corners of a ChArUco board in pictures: rows for calibrate --features.

    Needs OpenCV: pip install 'irbcal[camera]'.
    """
    from irbcal.measurement import charuco
    from irbcal.overwriting import refuse_overwriting

    refuse_overwriting({"out": out}, [joints, features])
    with wrong_calls():
        found = charuco.corners(images, joints, features, legacy=legacy)
    found.save(out)
    if json:
        show.print_json({"out": str(out), **found.to_dict()})
        return
    show.tell([*found.told(), f"Written to {out}"])
