"""``irbcal ik``: inverse kinematics for a file of poses."""

from __future__ import annotations

from typing import Any

from irbcal.cli import grid, show
from irbcal.cli.shared_options import JsonLines
from irbcal.cli.signature import PLACE, Typed, command, public


@command(
    "inverse_kinematics",
    arguments=("robot",),
    typed={"robot": Typed(str, None), "payload_place": PLACE, "near": Typed(str, "J1,J2,…")},
    flags={"T_base_tip": "--poses"},
    texts={
        "robot": "Calibration folder, URDF or a robot's name (see irbcal robots).",
        "T_base_tip": "CSV with x_mm,y_mm,z_mm,qw,qx,qy,qz: the tip in the base link; - for standard input.",
        "near": "Joints in degrees (mm): the nearest solution is taken; zero, or near it, unless given.",
    },
)
def ik(options: dict[str, Any], json: JsonLines = False) -> None:
    """Joints to command so that a robot reaches poses of its tip, as CSV; empty joints and a note where it cannot.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    import numpy as np

    from irbcal.io.opening import open_robot

    how = {name: options.pop(name) for name in ("nominal", "base_link", "tip_link", "coupling") if name in options}
    opened = open_robot(options.pop("robot"), **how)
    if "near" in options:
        columns = opened.nominal.joint_columns
        typed = np.asarray(grid.numbers(options["near"], [len(columns)], "--near", columns))
        options["near"] = opened.nominal.from_controller(typed * opened.nominal.joint_units).tolist()
    result = public("inverse_kinematics")(opened, **options)
    grid.write(result.to_frame(as_written=not json), json)
    for pose in result.singular:
        show.warn(pose.in_words())
    missing = len(result) - int(result.found.sum())
    if missing:
        show.warn(f"{missing} of {len(result)} poses have no joints, see the column note")
