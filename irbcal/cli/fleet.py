"""``irbcal fleet``: many robots, many years."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.guarded import Guarded
from irbcal.cli.shared_options import Engine, Jobs, Json
from irbcal.cli.wrong_calls import path_to_write, wrong_calls

FAILED = 3
"""Exit code of a run in which robots failed."""

Store = Annotated[str, typer.Option(help="File (SQLite), or postgresql+psycopg://USER@HOST/NAME.", show_default=True)]

app = typer.Typer(
    help="Many robots, many years: calibrate by a list, keep in a store, see what changed and which stand out.",
    no_args_is_help=True,
)


@app.command("calibrate", cls=Guarded)
def calibrate(
    manifest: Annotated[
        Path,
        typer.Argument(help="CSV with id, measurements, robot and perhaps serial, date, options.", show_default=False),
    ],
    out: Annotated[
        Path,
        typer.Option(parser=path_to_write, metavar="PATH", help="Folder for the robots' folders.", show_default=False),
    ],
    jobs: Jobs = None,
    engine: Engine = None,
    json: Json = False,
) -> None:
    """Calibrate every robot of a list into its own folder; goes on where it was stopped; exit code 3 if one failed."""
    from irbcal.fleet import batch

    steps = len(batch.read_manifest(manifest))
    with show.progress(steps + 1, quiet=json) as step, wrong_calls():
        found = batch.fleet_calibrate(manifest, out, jobs=jobs, engine=engine, progress=step)
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())
        show.say(f"Written to {out}: {batch.PAGE}, {batch.TABLE} and a folder for each robot")
    if found.failures:
        raise typer.Exit(FAILED)


@app.command("add", cls=Guarded)
def add(
    calibrations: Annotated[
        list[Path], typer.Argument(help="Calibration folders, or folders of a fleet.", show_default=False)
    ],
    store: Store = "fleet.db",
    id: Annotated[str | None, typer.Option(help="Which robot it is.", show_default="the folder's name")] = None,
    serial: Annotated[str | None, typer.Option(help="Its serial number.", show_default="the id")] = None,
    date: Annotated[
        str | None, typer.Option(help="When it was measured: 2026-03-17.", show_default="when it was calibrated")
    ] = None,
    json: Json = False,
) -> None:
    """Add calibrations to a store, each whole or not at all, and once."""
    from irbcal.fleet.overview import fleet_add

    with show.progress(len(calibrations), quiet=json) as step, wrong_calls():
        found = fleet_add(list(calibrations), store, id=id, serial=serial, date=date, progress=step)
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())


@app.command("list", cls=Guarded)
def list_(
    store: Store = "fleet.db",
    type: Annotated[str | None, typer.Option(help="Only robots of this type.", show_default="all")] = None,
    report: Annotated[Path | None, typer.Option(help="Page to write, HTML.", show_default=False)] = None,
    json: Json = False,
) -> None:
    """All robots of a store, what changed in their last calibration, and which stand out of their type."""
    from irbcal.fleet.overview import fleet_list

    with wrong_calls():
        found = fleet_list(store, type=type, report=report)
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())


@app.command("drift", cls=Guarded)
def drift(
    robot: Annotated[str, typer.Argument(help="Id of the robot.", show_default=False)],
    store: Store = "fleet.db",
    json: Json = False,
) -> None:
    """What changed in a robot between its calibrations by more than their uncertainty."""
    from irbcal.fleet.overview import fleet_drift

    with wrong_calls():
        found = fleet_drift(robot, store)
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())


@app.command("prior", cls=Guarded)
def prior(
    type: Annotated[str, typer.Option(help="Name of the nominal robot, as fleet list shows it.", show_default=False)],
    out: Annotated[
        Path, typer.Option(parser=path_to_write, metavar="PATH", help="File for the prior, JSON.", show_default=False)
    ],
    store: Store = "fleet.db",
    without: Annotated[str | None, typer.Option(help="Id of a robot to leave out.", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Write what to expect of a robot from its calibrated sisters, for irbcal calibrate --prior: fewer poses do."""
    from irbcal.fleet.prior import fleet_prior

    with show.progress(1, quiet=json) as step, wrong_calls():
        found = fleet_prior(type, out, store, without=without, progress=step)
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())


@app.command("export", cls=Guarded)
def export(
    out: Annotated[
        Path, typer.Option(parser=path_to_write, metavar="PATH", help="NAME.csv or NAME.parquet.", show_default=False)
    ],
    store: Store = "fleet.db",
    what: Annotated[str, typer.Option(help="robots, calibrations, parameters or files.")] = "parameters",
) -> None:
    """Write a table of a store as CSV or Parquet."""
    from irbcal.fleet.overview import fleet_export

    with wrong_calls():
        rows = fleet_export(store, out, what=what)
    show.say(f"{rows} rows written to {out}")
