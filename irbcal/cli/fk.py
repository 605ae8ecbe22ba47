"""``irbcal fk``: forward kinematics for a file of joints."""

from __future__ import annotations

from typing import Any

from irbcal.cli import grid, show
from irbcal.cli.shared_options import JsonLines
from irbcal.cli.signature import PLACE, Typed, command, public


@command(
    "forward_kinematics",
    arguments=("robot",),
    typed={"robot": Typed(str, None), "payload_place": PLACE},
    flags={"q": "--joints"},
    texts={
        "robot": "Calibration folder, URDF or a robot's name (see irbcal robots).",
        "q": "CSV with the columns q1_deg … q6_deg (q1_mm of a rail): commanded joints; - for standard input.",
    },
)
def fk(options: dict[str, Any], json: JsonLines = False) -> None:
    """Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    result = public("forward_kinematics")(**options)
    if result.caution:
        show.warn(result.caution)
    grid.write(result.to_frame(as_written=not json), json)
