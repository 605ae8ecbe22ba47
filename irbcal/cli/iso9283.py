"""``irbcal iso9283``: poses, distances, drift, stabilisation, paths, posing time, compliance."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import MM, PLACE, Typed, command, public

PLAN = ("center", "edge", "inset", "plane", "near")
"""Options of the test poses."""


@command(
    "iso9283 iso9283_plan",
    arguments=("measurements",),
    typed={
        "band": MM,
        "velocity": MM,
        "center": PLACE,
        "edge": MM,
        "inset": Typed(float, "PERCENT", lambda value, option: value / 100, lambda value: round(100 * value, 3)),
        "plane": Typed(str, "x=z|x=-z|y=z|y=-z"),
        "near": Typed(str, "J1,J2,…"),
    },
    without=("robot",),
    panels={
        "Poses": ("calibration", "commanded", "target", "set_size"),
        "Paths, stops, forces": (
            "path",
            "commanded_path",
            "velocity",
            "window",
            "approaches",
            "band",
            "rest",
            "moves",
            "forces",
        ),
        "Test poses": ("plan", *PLAN),
        "Output": ("plot", "json"),
    },
    texts={
        "velocity": "Commanded velocity of the path, mm/s.",
        "inset": "Points this far from the corners, % of the diagonal.",
        "near": "Joints in degrees that set the orientation; zero unless given.",
    },
)
def iso9283(
    options: dict[str, Any],
    plan: Annotated[
        str | None, typer.Option(help="Robot (URDF or name, see irbcal robots): print its test poses as CSV.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).")] = None,
    json: Json = False,
) -> None:
    """Accuracy, repeatability, drift, settling, velocity, corners, posing time, compliance, after ISO 9283:1998."""
    poses = {name: options.pop(name) for name in PLAN if name in options}
    if plan is None:
        show.with_plot(plot, json, lambda: public("iso9283")(**options), lambda result, file: result.save_plots(file))
        return
    if "measurements" in options:
        raise typer.BadParameter("--plan takes no measurements: leave one of them out", param_hint="MEASUREMENTS")
    import numpy as np

    from irbcal.io.opening import open_nominal

    arm = open_nominal(plan).arm
    if "near" in poses:
        poses["near"] = np.array(grid.numbers(poses["near"], (len(arm.joint_names),), "--near")) * arm.joint_units
    table = public("iso9283_plan")(arm, **poses).to_frame().set_index("pose").round(6) + 0.0  # no minus before zero
    table.to_csv(sys.stdout, float_format="%.6f")
