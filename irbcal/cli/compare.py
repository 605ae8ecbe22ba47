"""``irbcal compare``: calibrations side by side on the same measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def compare(
    calibrations: Annotated[list[Path], typer.Argument(help="Two or more calibration folders.", show_default=False)],
    measurements: Annotated[Path, typer.Option(help="Measurement file (CSV or Parquet).", show_default=False)],
    include_fitted: Annotated[
        bool, typer.Option("--include-fitted", help="Keep poses that one of them was fitted to.")
    ] = False,
    refit_base: Annotated[
        bool, typer.Option("--refit-base", help="Place the base anew: the tracker or the robot was moved.")
    ] = False,
    refit_tool: Annotated[
        bool, typer.Option("--refit-tool", help="Place the targets anew: the reflectors were mounted anew.")
    ] = False,
    refit_from: Annotated[
        int | None,
        typer.Option(
            min=3, help="Poses that place base and tool anew and are not judged.", show_default="as irbcal evaluate"
        ),
    ] = None,
    payload: Annotated[
        float | None,
        typer.Option(min=0.0, help="Mass carried, kg, for files without a column payload_kg.", show_default=False),
    ] = None,
    same_tool: Annotated[
        bool,
        typer.Option("--same-tool", help="With loads unknown to a calibration reflectors stayed in place."),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    csv: Annotated[Path | None, typer.Option(help="Write the errors pose by pose (CSV).", show_default=False)] = None,
    latex: Annotated[Path | None, typer.Option(help="Write the table for LaTeX.", show_default=False)] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
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
            from irbcal.validation import comparing_plots

            written |= {plots / name: content for name, content in comparing_plots.files(result).items()}
        write_set(written)
    if json:
        show.print_json(result.to_dict() | {"written": [str(path) for path in written]})
        return
    show.tell(result.told())
    if written:
        show.say(f"Written: {', '.join(str(path) for path in written)}")
