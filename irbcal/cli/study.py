"""``irbcal study``: the studies of the thesis's chapter 7 in the virtual cell."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

Method = Enum("Method", {name: name for name in ("nelder-mead", "least-squares", "max")}, type=str)
Model = Enum("Model", {name: name for name in ("34", "26", "16", "11")}, type=str)

INTERRUPTED = 130
HEADLINES = ("7.13", "curve")
"""Tables that are printed unless others are asked for."""


def study(
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the study; where it holds one, what is missing of it is done.", show_default=False
        ),
    ] = None,
    procedures: Annotated[
        str, typer.Option(help="Numbers of identification measurements of the procedures.")
    ] = "80,120,180,200",
    each: Annotated[int, typer.Option(min=1, help="Random choices of each number of measurements.")] = 5,
    model: Annotated[Model, typer.Option(help="Error model of the procedures and of the curve.")] = Model["34"],
    method: Annotated[
        Method,
        typer.Option(help="nelder-mead: as the thesis searched; max: its objective with a certificate."),
    ] = Method["nelder-mead"],
    seed: Annotated[int, typer.Option(min=0, help="Of poses, noise and choices.")] = 0,
    points: Annotated[
        int,
        typer.Option(
            help="Verification points in each area with each payload; an eighth of them with fake targets; 520 or more."
        ),
    ] = 8000,
    poses_curve: Annotated[
        str, typer.Option(help="Numbers of measurements for the curve of the error; none: no curve.")
    ] = "20,30,40,60,80,120,200,400,1000",
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes; the results do not depend on it. [default: one for each core]")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Do and print only this table: 7.1 … 7.16, procedures, targets, curve (repeat for more)."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Calibrate and verify a virtual robot again and again: tables and figures of the thesis's chapter 7, SIMULATED."""
    import time

    if out is None:
        raise typer.BadParameter("missing", param_hint="--out")
    sizes, curve = _counts(procedures, "--procedures"), _counts(poses_curve, "--poses-curve", empty=True)

    from irbcal.studies import repetition as studies
    from irbcal.studies import runner as study_run

    settings = studies.Settings(sizes, each, curve, model.value, method.value, points, seed)
    start = time.perf_counter()
    steps = study_run.missing(settings, out, only)
    with show.progress(steps + 1, quiet=json) as step:
        try:
            outcome = study_run.run(settings, out, jobs, only, step)
        except KeyboardInterrupt:
            left = study_run.missing(settings, out, only)
            typer.echo(
                f"irbcal: interrupted with {left} calibrations to do: the same call goes on from there", err=True
            )
            raise typer.Exit(INTERRUPTED) from None
    seconds = time.perf_counter() - start
    shown = [table for table in outcome.tables if table.key in (only or HEADLINES)]
    if json:
        show.print_json(_document(out, settings, outcome, shown if only else outcome.tables, seconds))
        return
    _print(shown)
    show.say(f"{outcome.done} calibrations done, {outcome.kept} found finished, {seconds:.1f} s")
    show.say(f"Written to {out / study_run.PAGE}, {out / study_run.TABLES}, {out / study_run.RESULTS}")


def _counts(text, option, empty=False):
    """Whole numbers separated by commas."""
    if empty and text == "none":
        return ()
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        sentence = f"expected whole numbers with commas between them, found {text!r}"
        raise typer.BadParameter(sentence, param_hint=option) from None


def _print(tables):
    """Tables as aligned text, as wide as they are."""
    for table in tables:
        show.say(f"SIMULATED (in brackets: the thesis, a real robot). {table.heading}")
        rows = [table.columns, *([str(value) for value in row] for row in table.rows)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            show.say("  " + "  ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip())
        for note in table.notes:
            show.say(f"  {note}")
        show.say()


def _document(out, settings, outcome, tables, seconds):
    from irbcal.studies.tables import Cell

    def plain(value):
        return {"value": value.value, "thesis": value.thesis} if isinstance(value, Cell) else value

    return {
        "out": str(out),
        "simulated": True,
        "settings": settings.document(),
        "done": outcome.done,
        "kept": outcome.kept,
        "seconds": seconds,
        "tables": {
            table.key: {
                "title": table.title,
                "columns": list(table.columns),
                "rows": [[plain(value) for value in row] for row in table.rows],
                "notes": list(table.notes),
            }
            for table in tables
        },
    }
