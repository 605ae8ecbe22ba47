"""``irbcal study``: the studies of the thesis's chapter 7 in the virtual cell."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Engine, Jobs, Json
from irbcal.cli.wrong_calls import wrong_calls

Method = Enum(
    "Method",
    {"nelder-mead": "nelder-mead", "least-squares": "least-squares", "max": "max"},
    type=str,
)
Model = Enum("Model", {"34": "34", "26": "26", "16": "16", "11": "11"}, type=str)


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
    jobs: Jobs = None,
    engine: Engine = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Do and print only this table: 7.1 … 7.16, procedures, targets, curve (repeat for more)."),
    ] = None,
    json: Json = False,
) -> None:
    """Calibrate and verify a virtual robot again and again: tables and figures of the thesis's chapter 7, SIMULATED."""
    if out is None:
        raise typer.BadParameter("missing", param_hint="--out")
    sizes, curve = _counts(procedures, "--procedures"), _counts(poses_curve, "--poses-curve", empty=True)

    from irbcal.studies import runner
    from irbcal.studies.settings import Settings

    steps = runner.missing(Settings(sizes, each, curve, model.value, method.value, points, seed), out, only)
    with show.progress(steps + 1, quiet=json) as step, wrong_calls():
        found = runner.study(
            out=out,
            procedures=sizes,
            each=each,
            model=model.value,
            method=method.value,
            seed=seed,
            points=points,
            poses_curve=curve,
            jobs=jobs,
            engine=engine,
            only=only,
            progress=step,
        )
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())


def _counts(text: str, option: str, empty: bool = False) -> tuple[int, ...]:
    """Whole numbers separated by commas."""
    if empty and text == "none":
        return ()
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        sentence = f"expected whole numbers with commas between them, found {text!r}"
        raise typer.BadParameter(sentence, param_hint=option) from None
