"""``irbcal ballbar``: radial errors of circular paths, predicted and measured."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Calibration, Json
from irbcal.cli.wrong_calls import wrong_calls

Run = Enum("Run", {"nominal": "nominal", "fake": "fake"}, type=str)


def ballbar(
    calibration: Calibration,
    file: Annotated[
        Path | None,
        typer.Argument(help="Measured: angle_deg,radius_mm (or error_mm)[,run].", show_default=False),
    ] = None,
    bar: Annotated[float, typer.Option(min=1.0, help="Length of the ballbar, mm: the radius, unless --height.")] = 150,
    joints: Annotated[
        str | None,
        typer.Option(help="Joints in degrees with the tool in the circle's centre.", show_default="0,0,0,0,90,0"),
    ] = None,
    tool: Annotated[
        str, typer.Option(help="The cup's centre on tool0: x,y,z in mm, optionally with qw,qx,qy,qz.")
    ] = "0,0,0",
    normal: Annotated[str, typer.Option(help="The path turns about it, in the base link.")] = "0,0,1",
    start: Annotated[str, typer.Option(help="Direction from the centre to the start, in the base link.")] = "1,0,0",
    height: Annotated[float, typer.Option(help="Of the circle's plane above the ball, along the normal, mm.")] = 0.0,
    tilt: Annotated[float, typer.Option(help="Lean of the tool's z axis towards the centre, degrees.")] = 0.0,
    arcs: Annotated[int, typer.Option(min=0, max=512, help="Arcs of the path of fake targets; 0: none.")] = 6,
    run: Annotated[
        Run, typer.Option(help="What was run when FILE was measured: the nominal targets or the fake ones.")
    ] = Run.nominal,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="The same circle measured earlier, a file like FILE: what changed since.", show_default=False
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Polar plot to write (.png, .svg, .pdf).")] = None,
    magnify: Annotated[
        float | None, typer.Option(min=1e-3, help="Magnification of the errors.", show_default="a round number")
    ] = None,
    json: Json = False,
) -> None:
    """Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint reversals."""
    import numpy as np

    from irbcal.io.opening import open_calibration
    from irbcal.plotting.charts import check_name
    from irbcal.units import DEG, MM
    from irbcal.validation import ballbar_check

    if plot is not None:
        check_name(plot)
    place = np.array(grid.numbers(tool, (3, 7), "--tool"))
    place[:3] *= MM
    axes = [grid.numbers(text, (3,), option) for text, option in ((normal, "--normal"), (start, "--start"))]
    saved = open_calibration(calibration)
    units = saved.arm().joint_units
    with wrong_calls():
        result = ballbar_check.ballbar(
            saved,
            file,
            bar=bar * MM,
            joints=None if joints is None else np.array(grid.numbers(joints, (len(units),), "--joints")) * units,
            tool=place,
            normal=axes[0],
            start=axes[1],
            height=height * MM,
            tilt=tilt * DEG,
            arcs=arcs,
            run=run.value,
            baseline=baseline,
        )
    if plot is not None:
        result.plot(magnify).save(plot)
    if json:
        show.print_json(result.to_dict())
        return
    show.tell(result.told())
    if plot is not None:
        show.say(f"Figure written to {plot}")
