"""``irbcal ik``: inverse kinematics for a file of poses."""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer


def ik(
    robot: Annotated[
        str, typer.Argument(help="Calibration folder, URDF or shipped robot (irb1600, irb120).", show_default=False)
    ],
    poses: Annotated[
        Path,
        typer.Option(help="CSV with x_mm,y_mm,z_mm,qw,qx,qy,qz: the tip in the base link.", show_default=False),
    ],
    near: Annotated[
        str | None,
        typer.Option(help="Joints in degrees (mm): the nearest solution is taken.", show_default="zero, or near it"),
    ] = None,
    all_branches: Annotated[bool, typer.Option("--all-branches", help="Every branch within the joint limits.")] = False,
    nominal: Annotated[bool, typer.Option("--nominal", help="Nominal behaviour of a calibration.")] = False,
    base_link: Annotated[
        str | None, typer.Option(help="Base link of a URDF.", show_default="base_link or the root")
    ] = None,
    tip_link: Annotated[
        str | None,
        typer.Option(help="Tip link of a URDF.", show_default="tool0, flange, ee_link, tcp or the last link"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")] = False,
):
    """Joints to command so that a robot reaches poses of its tip, as CSV; empty joints and a note where it cannot."""
    import numpy as np

    from irbcal import kinematics as tables
    from irbcal.measurement import lists

    model, arm = tables.open_pair(robot, nominal, base_link, tip_link)
    start = np.clip(np.zeros(len(arm.lower)), arm.lower, arm.upper)
    if near is not None:
        try:
            start = np.array([float(value) for value in near.split(",")])
        except ValueError:
            start = np.zeros(0)
        if len(start) != len(arm.lower) or not np.isfinite(start).all():
            raise typer.BadParameter(
                f"expected {len(arm.lower)} numbers ({', '.join(arm.joint_columns)}), found {near!r}",
                param_hint="--near",
            )
        start = start * arm.joint_units
    frame = tables.joint_table(model, arm, lists.read_poses(poses), start, all_branches)
    if json:
        for record in frame.astype(object).where(frame.notna(), None).to_dict(orient="records"):
            sys.stdout.write(json_module.dumps(record) + "\n")
    else:
        frame.to_csv(sys.stdout, index=False, float_format="%.9f")
    missing = int(frame[arm.joint_columns[0]].isna().sum())
    if missing:
        print(f"irbcal: {missing} of {len(frame)} poses have no joints, see the column note", file=sys.stderr)
