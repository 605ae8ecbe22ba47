"""``irbcal tracker``: checks of the laser tracker itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import MM, command, public


@command(
    "tracker",
    arguments=("readings",),
    typed={"length": MM, "band": MM},
    texts={"readings": "Readings (CSV or Parquet), see above."},
)
def tracker(
    options: dict[str, Any],
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).")] = None,
    json: Json = False,
) -> None:
    """Scale-bar distances, repeatability, long-term drift with the air, stabilisation time.

    Columns: x_mm,y_mm,z_mm and, for bar: end (two names, in turn), optional position; or distance_mm alone. For
    repeat: optional position. For drift: time_s, optional temperature_c, pressure_mmhg, humidity_percent. For settle:
    time_s, run.
    """
    show.with_plot(plot, json, lambda: public("tracker")(**options), lambda result, file: result.plot().save(file))
