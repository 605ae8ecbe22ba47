"""``irbcal iso9283``: poses, distances, drift, stabilisation, paths, posing time, compliance."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import wrong_calls

Plane = Enum("Plane", {"x=z": "x=z", "x=-z": "x=-z", "y=z": "y=z", "y=-z": "y=-z"}, type=str)


def iso9283(
    measurements: Annotated[
        Path | None,
        typer.Argument(help="Measurement file with columns pose (P1 … P5) and cycle.", show_default=False),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Calibration folder: commanded poses at the file's joints, by both models; the base link of the "
            "commanded path and of forces.",
            show_default=False,
        ),
    ] = None,
    commanded: Annotated[
        Path | None,
        typer.Option(help="File of commanded poses instead: pose,x_mm,y_mm,z_mm[,qw,qx,qy,qz].", show_default=False),
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="Position of this target.", show_default="the flange, where it can be measured")
    ] = None,
    set_size: Annotated[int, typer.Option(min=2, help="Cycles of a set of the drift test.")] = 10,
    approaches: Annotated[
        Path | None,
        typer.Option(help="Time series of approaches to a pose: time_s,x_mm,y_mm,z_mm[,run].", show_default=False),
    ] = None,
    band: Annotated[
        float | None, typer.Option(min=1e-6, help="Limit band, mm.", show_default="RP of P1, else of the first pose")
    ] = None,
    rest: Annotated[float, typer.Option(min=0.0, help="Seconds after which the robot is at rest.")] = 10.0,
    path: Annotated[
        Path | None, typer.Option(help="Sampled paths: cycle,x_mm,y_mm,z_mm[,time_s,qw,qx,qy,qz].", show_default=False)
    ] = None,
    commanded_path: Annotated[
        Path | None,
        typer.Option(
            help="Points of the commanded path, in the same frame; with --calibration in the base link.",
            show_default=False,
        ),
    ] = None,
    velocity: Annotated[
        float | None, typer.Option(help="Commanded velocity of the path, mm/s.", show_default=False)
    ] = None,
    window: Annotated[float, typer.Option(min=0.0, help="Seconds over which velocities are smoothed.")] = 0.0,
    moves: Annotated[
        Path | None,
        typer.Option(help="Moves from rest to rest: move,time_s,x_mm,y_mm,z_mm[,cycle].", show_default=False),
    ] = None,
    forces: Annotated[
        Path | None,
        typer.Option(help="Places under load: direction (+x …),force_n,x_mm,y_mm,z_mm[,cycle].", show_default=False),
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(help="Robot (URDF or name, see irbcal robots): print its test poses as CSV.", show_default=False),
    ] = None,
    center: Annotated[
        str | None, typer.Option(help="With --plan: centre of the cube, x,y,z in mm, in the base link.")
    ] = None,
    edge: Annotated[float | None, typer.Option(min=1e-3, help="With --plan: edge of the cube, mm.")] = None,
    inset: Annotated[
        float | None,
        typer.Option(min=0.0, max=49.0, help="With --plan: points this far from the corners, % of the diagonal."),
    ] = None,
    plane: Annotated[Plane, typer.Option(help="With --plan: inclined plane of the cube.")] = Plane["x=z"],
    near: Annotated[
        str | None, typer.Option(help="With --plan: joints in degrees that set the orientation.", show_default="zero")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Accuracy, repeatability, drift, settling, velocity, corners, posing time, compliance, after ISO 9283:1998."""
    from irbcal.plotting.charts import check_name
    from irbcal.units import MM
    from irbcal.validation import iso9283_check

    if plan is not None:
        _plan(plan, measurements, center, edge, inset, plane.value, near)
        return
    if plot is not None:
        check_name(plot)
    with wrong_calls(measurements="MEASUREMENTS"):
        result = iso9283_check.iso9283(
            measurements,
            calibration=calibration,
            commanded=commanded,
            target=target,
            set_size=set_size,
            approaches=approaches,
            band=None if band is None else band * MM,
            rest=rest,
            path=path,
            commanded_path=commanded_path,
            velocity=None if velocity is None else velocity * MM,
            window=window,
            moves=moves,
            forces=forces,
        )
    if plot is not None:
        result.save_plots(plot)
    if json:
        show.print_json(result.to_dict())
        return
    show.tell(result.told())
    if plot is not None:
        show.say(f"Figure written to {plot}")


def _plan(
    robot: str,
    measurements: Path | None,
    center: str | None,
    edge: float | None,
    inset: float | None,
    plane: Any,
    near: str | None,
) -> None:
    """Print the test poses as CSV."""
    if measurements is not None:
        raise typer.BadParameter("--plan takes no measurements: leave one of them out", param_hint="MEASUREMENTS")
    import sys

    import numpy as np

    from irbcal.io.opening import open_nominal
    from irbcal.units import MM
    from irbcal.validation import iso9283_check
    from irbcal.validation.cube import FRACTION

    arm = open_nominal(robot).arm
    joints = None if near is None else np.array(grid.numbers(near, (len(arm.joint_names),), "--near"))
    with wrong_calls():
        found = iso9283_check.iso9283_plan(
            arm,
            center=None if center is None else np.array(grid.numbers(center, (3,), "--center")) * MM,
            edge=None if edge is None else edge * MM,
            inset=FRACTION if inset is None else inset / 100,
            plane=plane,
            near=None if joints is None else joints * arm.joint_units,
        )
    table = found.to_frame().set_index("pose").round(6) + 0.0  # no minus before zero
    table.to_csv(sys.stdout, float_format="%.6f")
