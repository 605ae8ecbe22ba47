"""``irbcal ballbar``: radial errors of circular paths, predicted and measured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import DEG, MM, Typed, command, numbers, public
from irbcal.units import MM as MM_PER_M

DIRECTION = numbers("X,Y,Z", 3)


@command(
    "ballbar",
    arguments=("calibration", "measured"),
    typed={
        "bar": MM,
        "height": MM,
        "tilt": DEG,
        "tool": numbers("X,Y,Z[,QW,QX,QY,QZ]", 3, 7, units=[MM_PER_M] * 3 + [1.0]),
        "normal": DIRECTION,
        "start": DIRECTION,
        "joints": Typed(str, "J1,J2,…"),
    },
    texts={"joints": "Joints in degrees (mm) with the tool in the circle's centre: 0,0,0,0,90,0 unless given."},
)
def ballbar(
    options: dict[str, Any],
    plot: Annotated[Path | None, typer.Option(help="Polar plot to write (.png, .svg, .pdf).")] = None,
    magnify: Annotated[
        float | None, typer.Option(min=1e-3, help="Magnification of the errors: a round number unless given.")
    ] = None,
    json: Json = False,
) -> None:
    """Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint reversals."""
    import numpy as np

    if "joints" in options:
        units = public("load")(options["calibration"]).arm().joint_units
        options["joints"] = np.array(grid.numbers(options["joints"], (len(units),), "--joints")) * units
    show.with_plot(
        plot, json, lambda: public("ballbar")(**options), lambda result, file: result.plot(magnify).save(file)
    )
