"""``irbcal export``: the calibrated robot as a part of other programs."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Calibration, Json, Payload, PayloadPlace


class Target(str, Enum):
    """What can be written."""

    cpp, python, casadi = "cpp", "python", "casadi"
    urdf, mujoco, drake, ros = "urdf", "mujoco", "drake", "ros"


class Meshes(str, Enum):
    """How meshes stand in a URDF."""

    relative, absolute, package = "relative", "absolute", "package"


def export(
    calibration: Calibration,
    as_: Annotated[Target, typer.Option("--as", help="What to write.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder to write to; an earlier export is replaced.", show_default=False)],
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    mesh_paths: Annotated[Meshes, typer.Option(help="How a URDF names its meshes.")] = Meshes.relative,
    without_frame_terms: Annotated[
        bool, typer.Option("--without-frame-terms", help="URDF and joint map alone where there is more.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the calibrated robot as a part of other programs, with test vectors and fingerprint inside."""
    from irbcal.exporting.export import export as write

    found = write(
        calibration,
        as_.value,
        out,
        payload=payload,
        payload_place=grid.metres(payload_place, "--payload-place"),
        mesh_paths=mesh_paths.value,
        without_frame_terms=without_frame_terms,
    )
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())
