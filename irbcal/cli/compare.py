"""``irbcal compare``: calibrations side by side on the same measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import BootstrapSeed, IncludeFitted, Json, PayloadOfFiles, RefitBase, RefitTool, SameTool


def compare(
    calibrations: Annotated[list[Path], typer.Argument(help="Two or more calibration folders.", show_default=False)],
    measurements: Annotated[Path, typer.Option(help="Measurement file (CSV or Parquet).", show_default=False)],
    include_fitted: IncludeFitted = False,
    refit_base: RefitBase = False,
    refit_tool: RefitTool = False,
    refit_from: Annotated[
        int | None,
        typer.Option(
            min=3, help="Poses that place base and tool anew and are not judged.", show_default="as irbcal evaluate"
        ),
    ] = None,
    payload: PayloadOfFiles = None,
    same_tool: SameTool = False,
    seed: BootstrapSeed = 0,
    csv: Annotated[Path | None, typer.Option(help="Write the errors pose by pose (CSV).", show_default=False)] = None,
    latex: Annotated[Path | None, typer.Option(help="Write the table for LaTeX.", show_default=False)] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Compare calibrations of one robot pose by pose: which is better, and whether that is beyond chance."""
    from irbcal.atomic import made_folders, write_set
    from irbcal.names import without_formulas
    from irbcal.validation.comparing import compare as judge

    with made_folders(*(path for path in (plots, *(file.parent for file in (csv, latex) if file)) if path)):
        result = judge(
            calibrations,
            measurements,
            include_fitted=include_fitted,
            refit_base=refit_base,
            refit_tool=refit_tool,
            refit_from=refit_from,
            payload=payload,
            same_tool=same_tool,
            seed=seed,
        )
        written: dict[Path, bytes] = {}
        if csv is not None:
            written[csv] = without_formulas(result.to_frame()).to_csv(index=False, float_format="%.6f").encode()
        if latex is not None:
            written[latex] = result.latex().encode()
        if plots is not None:
            from irbcal.validation.plots import compared_files

            written |= {plots / name: content for name, content in compared_files(result).items()}
        write_set(written)
    if json:
        show.print_json(result.to_dict() | {"written": [str(path) for path in written]})
        return
    show.tell(result.told())
    if written:
        show.say(f"Written: {', '.join(str(path) for path in written)}")
