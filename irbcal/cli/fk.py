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
        Path,
        typer.Option(
            help="CSV with the columns q1_deg … q6_deg (q1_mm of a rail): commanded joints.", show_default=False
        ),
    ],
    target: Annotated[
        str | None, typer.Option(help="Positions of this reflector in the measuring frame, not the tip's pose.")
    ] = None,
    uncertainty: Annotated[
        bool, typer.Option("--uncertainty", help="Add standard deviations of the position (calibrations only).")
    ] = False,
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
    """Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV."""
    from irbcal import kinematics
    from irbcal.measurement import lists

    model = kinematics.open_robot(robot, nominal, base_link, tip_link)
    q = lists.read_joints(joints, model.arm.joint_columns)
    frame = kinematics.target_table(model, q, target) if target else kinematics.pose_table(model, q)
    if uncertainty:
        from irbcal.errors import RobotError
        from irbcal.files import calibration_folder
        from irbcal.units import MM
        from irbcal.validation.uncertainty import position_std

        if not Path(robot).is_dir() or nominal:
            raise RobotError(f"{robot}: only the calibrated behaviour of a calibration folder knows its uncertainty")
        saved = calibration_folder.load(robot)
        std = position_std(saved, q, target) / MM
        for k, axis in enumerate("xyz"):
            frame[f"std_{axis}_mm"] = std[:, k]
        if saved.heldout:
            print(
                f"irbcal: standard deviations are those of the parameters; held-out errors of this calibration: mean "
                f"{saved.heldout.all.mean_mm:.3f} mm, rms {saved.heldout.all.rms_mm:.3f} mm",
                file=sys.stderr,
            )
    if json:
        for record in frame.to_dict(orient="records"):
            sys.stdout.write(json_module.dumps(record) + "\n")
    else:
        frame.to_csv(sys.stdout, index=False, float_format="%.9f")
