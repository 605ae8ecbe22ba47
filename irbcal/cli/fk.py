"""``irbcal fk``: forward kinematics for a file of joints."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import BaseLink, Coupling, JsonLines, Payload, PayloadPlace, RobotOrCalibration, TipLink


def fk(
    robot: RobotOrCalibration,
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
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    json: JsonLines = False,
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
        show.warn(found.caution)
    grid.write(found.to_frame(as_written=not json), json)
