"""``irbcal report``: write the report of a calibration again, with its figures and data as files on request."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Calibration, Json
from irbcal.cli.wrong_calls import wrong_calls


def report(
    calibration: Calibration,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the figures as files of their own.", show_default=False)
    ] = None,
    format: Annotated[Literal["png", "svg"] | None, typer.Option(help="Of these figures.", show_default="png")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder for the data behind figures and tables (CSV).", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Write report.html again from calibration.json; its figures (PNG, SVG) and data (CSV) on request."""
    from irbcal.calibration import load
    from irbcal.calibration import report as write

    with wrong_calls(), show.progress(3, quiet=json) as step:
        folders = write(calibration, figures=figures, format=format, data=data, progress=step)
    if json:
        written = [str(folder / name) for folder, names in folders.items() for name in names]
        show.print_json({"out": str(calibration), "simulated": load(calibration).record.simulated, "written": written})
        return
    for folder, names in folders.items():
        show.say(f"Written to {folder}: {', '.join(names)}")
