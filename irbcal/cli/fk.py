"""``irbcal fk``: forward kinematics for a file of joints."""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer


def fk(
    robot: Annotated[
        str, typer.Argument(help="Calibration folder, URDF or shipped robot (irb1600, irb120).", show_default=False)
    ],
    joints: Annotated[
        Path, typer.Option(help="CSV with the columns q1_deg … q6_deg: commanded joints.", show_default=False)
    ],
    target: Annotated[
        str | None, typer.Option(help="Positions of this reflector in the measuring frame, not the tip's pose.")
    ] = None,
    nominal: Annotated[bool, typer.Option("--nominal", help="Nominal behaviour of a calibration.")] = False,
    json: Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")] = False,
):
    """Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV."""
    from irbcal.export import poses
    from irbcal.measurement import table

    model = poses.open_robot(robot, nominal)
    q = table.read_joints(joints)
    frame = poses.target_table(model, q, target) if target else poses.pose_table(model, q)
    if json:
        for record in frame.to_dict(orient="records"):
            sys.stdout.write(json_module.dumps(record) + "\n")
    else:
        frame.to_csv(sys.stdout, index=False, float_format="%.9f")
