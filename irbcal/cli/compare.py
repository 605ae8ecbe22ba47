"""``irbcal compare``: calibrations side by side on the same measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import Typed, command, public


@command(
    "compare",
    arguments=("calibrations",),
    typed={"calibrations": Typed(list[Path], "PATH")},
    texts={"calibrations": "Two or more calibration folders."},
)
def compare(
    options: dict[str, Any],
    csv: Annotated[Path | None, typer.Option(help="Write the errors pose by pose (CSV).")] = None,
    latex: Annotated[Path | None, typer.Option(help="Write the table for LaTeX.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).")] = None,
    json: Json = False,
) -> None:
    """Compare calibrations of one robot pose by pose: which is better, and whether that is beyond chance."""
    from irbcal.atomic import made_folders, write_set
    from irbcal.names import csv_bytes

    with made_folders(*(path for path in (plots, *(file.parent for file in (csv, latex) if file)) if path)):
        result = public("compare")(**options)
        written: dict[Path, bytes] = {}
        if csv is not None:
            written[csv] = csv_bytes(result.to_frame(), float_format="%.6f")
        if latex is not None:
            written[latex] = result.latex().encode()
        if plots is not None:
            written |= {plots / f"{name}.png": chart.content("png") for name, chart in result.plots().items()}
        write_set(written)
    if json:
        show.print_json(result.to_dict() | {"written": [str(path) for path in written]})
        return
    show.tell(result.report())
    if written:
        show.say(f"Written: {', '.join(str(path) for path in written)}")
