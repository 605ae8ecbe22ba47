"""``irbcal tracker``: checks of the laser tracker itself."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import wrong_calls

Check = Enum("Check", {name: name for name in ("bar", "repeat", "drift", "settle")}, type=str)  # type: ignore[misc]  # names for typer


def tracker(
    file: Annotated[Path, typer.Argument(help="Readings (CSV or Parquet), see below.", show_default=False)],
    check: Annotated[Check | None, typer.Option(help="Which check.", show_default="by the columns")] = None,
    length: Annotated[
        float | None, typer.Option(min=1e-3, help="bar: certified length of the scale bar, mm.", show_default=False)
    ] = None,
    band: Annotated[float, typer.Option(min=1e-6, help="settle: limit band, mm.")] = 0.02,
    rest: Annotated[float, typer.Option(min=0.0, help="settle: seconds after which the robot is at rest.")] = 10.0,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Scale-bar distances, repeatability, long-term drift with the air, stabilisation time.

    Columns: x_mm,y_mm,z_mm and, for bar: end (two names, in turn), optional position; or distance_mm alone. For
    repeat: optional position. For drift: time_s, optional temperature_c, pressure_mmhg, humidity_percent. For settle:
    time_s, run.
    """
    from irbcal.plotting.charts import check_name
    from irbcal.units import MM
    from irbcal.validation import tracker_check

    if plot is not None:
        check_name(plot)
    with wrong_calls():
        result = tracker_check.tracker(
            file,
            check=check and check.value,
            length=None if length is None else length * MM,
            band=band * MM,
            rest=rest,
        )
    if plot is not None:
        result.plot().save(plot)
    if json:
        show.print_json(result.to_dict())
        return
    show.tell(result.told())
    if plot is not None:
        show.say(f"Figure written to {plot}")
