"""``irbcal circles``: base, tool and links from moves of one joint at a time."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import wrong_calls
from irbcal.identification.choices import Parallel


def circles(
    measurements: Annotated[
        Path, typer.Argument(help="Measurement file with groups axis1, axis2, ….", show_default=False)
    ],
    robot: Annotated[str, typer.Option(help="URDF of the nominal robot, or a name: see irbcal robots.")],
    part: Annotated[
        Literal["base", "tool", "links"] | None,
        typer.Option(
            help="base: from axes 1 and 2; tool: from the last two axes; links: from all six.",
            show_default="all that the groups allow",
        ),
    ] = None,
    parallel: Annotated[
        Parallel, typer.Option(help="Of the links: keep the tilt of nearly parallel axes, or force one direction.")
    ] = "hayati",
    tolerance: Annotated[
        float, typer.Option(min=0.0, max=90.0, help="Axes closer than this are parallel for forced, degrees.")
    ] = 1.0,
    drawn: Annotated[
        Path | None,
        typer.Option(help="Targets as drawn (CAD), compared with the tool: target,x_mm,y_mm,z_mm.", show_default=False),
    ] = None,
    json: Json = False,
) -> None:
    """Base, tool and links of a robot by the circles of one-joint moves alone.

    The base comes from axes 1 and 2, the tool from the last two, links from all six. The tool can be compared with its
    drawing. Nothing is written: calibrate --method circles makes a calibration.
    """
    from irbcal.joint_analysis import by_circles
    from irbcal.units import DEG

    with wrong_calls():
        found = by_circles.circles(
            measurements, robot, part=part, parallel=parallel, tolerance=tolerance * DEG, drawn=drawn
        )
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())
