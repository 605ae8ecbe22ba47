"""``irbcal ik``: inverse kinematics for a file of poses."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import (
    BaseLink,
    Coupling,
    Jobs,
    JsonLines,
    Payload,
    PayloadPlace,
    RobotOrCalibration,
    TipLink,
)
from irbcal.cli.wrong_calls import wrong_calls


def ik(
    robot: RobotOrCalibration,
    poses: Annotated[
        Path,
        typer.Option(
            help="CSV with x_mm,y_mm,z_mm,qw,qx,qy,qz: the tip in the base link; - for standard input.",
            show_default=False,
        ),
    ],
    near: Annotated[
        str | None,
        typer.Option(help="Joints in degrees (mm): the nearest solution is taken.", show_default="zero, or near it"),
    ] = None,
    all_branches: Annotated[bool, typer.Option("--all-branches", help="Every branch within the joint limits.")] = False,
    path: Annotated[
        bool,
        typer.Option(
            "--path", help="The poses are a path: no jumps from one solution to another, singularities are told."
        ),
    ] = False,
    redundancy: Annotated[
        str | None,
        typer.Option(
            help="For more than six joints: limits (stay away from them) or near (--near).", show_default=False
        ),
    ] = None,
    nominal: Annotated[bool, typer.Option("--nominal", help="Nominal behaviour of a calibration.")] = False,
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    jobs: Jobs = None,
    json: JsonLines = False,
) -> None:
    """Joints to command so that a robot reaches poses of its tip, as CSV; empty joints and a note where it cannot.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    import numpy as np

    from irbcal.io.opening import open_robot
    from irbcal.kinematics import inverse_kinematics

    opened = open_robot(robot, nominal=nominal, base_link=base_link, tip_link=tip_link, coupling=coupling)
    start = None
    if near is not None:
        columns = opened.nominal.joint_columns
        given = np.asarray(grid.numbers(near, [len(columns)], "--near", columns)) * opened.nominal.joint_units
        start = opened.nominal.from_controller(given).tolist()
    with wrong_calls():
        found = inverse_kinematics(
            opened,
            poses,
            near=start,
            all_branches=all_branches,
            path=path,
            redundancy=redundancy,
            payload=payload,
            payload_place=grid.metres(payload_place, "--payload-place"),
            jobs=jobs,
        )
    grid.write(found.to_frame(as_written=not json), json)
    for place in found.singular:
        show.warn(place.in_words())
    missing = len(found) - int(found.found.sum())
    if missing:
        show.warn(f"{missing} of {len(found)} poses have no joints, see the column note")
