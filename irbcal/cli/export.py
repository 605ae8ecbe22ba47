"""``irbcal export``: the calibrated robot as a part of other programs."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show


class Target(str, Enum):
    """What can be written."""

    cpp, python, casadi = "cpp", "python", "casadi"
    urdf, mujoco, drake, ros = "urdf", "mujoco", "drake", "ros"


class Meshes(str, Enum):
    """How meshes stand in a URDF."""

    relative, absolute, package = "relative", "absolute", "package"


def export(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    as_: Annotated[Target, typer.Option("--as", help="What to write.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder to write to; an earlier export is replaced.", show_default=False)],
    payload: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Mass carried where none is told, kg.", show_default="what most poses were measured with"
        ),
    ] = None,
    payload_place: Annotated[
        str | None, typer.Option(help="Its centre in the tip link: x,y,z in mm.", show_default="the calibration's")
    ] = None,
    mesh_paths: Annotated[Meshes, typer.Option(help="How a URDF names its meshes.")] = Meshes.relative,
    without_frame_terms: Annotated[
        bool, typer.Option("--without-frame-terms", help="URDF and joint map alone where there is more.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
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
