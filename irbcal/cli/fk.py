"""``irbcal fk``: forward kinematics for a file of joints."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid


def fk(
    robot: Annotated[
        str, typer.Argument(help="Calibration folder, URDF or a robot's name (see irbcal robots).", show_default=False)
    ],
    joints: Annotated[
        Path,
        typer.Option(
            help="CSV with the columns q1_deg … q6_deg (q1_mm of a rail): commanded joints; - for standard input.",
            show_default=False,
        ),
    ],
    target: Annotated[
        str | None, typer.Option(help="Positions of this reflector in the measuring frame, not the tip's pose.")
    ] = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Add standard deviations of the position (calibrations only).")
    ] = False,
    intervals: Annotated[
        bool,
        typer.Option(
            "--intervals",
            help="Add half-widths that hold 95 % of a coordinate's errors, and whether a pose is outside the joint "
            "ranges of the fit (calibrations only).",
        ),
    ] = False,
    nominal: Annotated[bool, typer.Option("--nominal", help="Nominal behaviour of a calibration.")] = False,
    payload: Annotated[
        float | None,
        typer.Option(min=0.0, help="Mass carried, kg.", show_default="what most poses were measured with"),
    ] = None,
    payload_place: Annotated[
        str | None, typer.Option(help="Its centre in the tip link: x,y,z in mm.", show_default="the calibration's")
    ] = None,
    base_link: Annotated[
        str | None, typer.Option(help="Base link of a URDF.", show_default="base_link or the root")
    ] = None,
    tip_link: Annotated[
        str | None,
        typer.Option(help="Tip link of a URDF.", show_default="tool0, flange, ee_link, tcp or the last link"),
    ] = None,
    coupling: Annotated[
        str | None,
        typer.Option(
            help="How the controller counts joints: 3+2 adds joint 2 to its joint 3; none: as the URDF.",
            show_default="that of the file beside the URDF",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")] = False,
) -> None:
    """Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    from irbcal.kinematics import forward_kinematics

    found = forward_kinematics(
        robot,
        joints,
        target=target or None,
        uncertainty=uncertainty,
        intervals=intervals,
        nominal=nominal,
        payload=payload,
        payload_place=grid.metres(payload_place, "--payload-place"),
        base_link=base_link,
        tip_link=tip_link,
        coupling=coupling,
    )
    if found.caution:
        print(f"irbcal: {found.caution}", file=sys.stderr)
    grid.write(found.to_frame(as_written=not json), json)
