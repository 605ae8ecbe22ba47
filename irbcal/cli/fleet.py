"""Many robots, many years: calibrate by a list, keep in a store, see what changed and which stand out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import MM, Command, Guarded, Json, Typed, for_typer, path_to_write, public

FAILED = 3
"""Exit code of a run in which robots failed."""
STORE = Typed(str, "FILE|URL")
WRITTEN = Typed(str, "PATH", lambda text, option: path_to_write(text))

app = typer.Typer(
    help=__doc__,
    no_args_is_help=True,
)


@Command(
    "fleet_calibrate",
    arguments=("manifest",),
    typed={"out": WRITTEN},
)
def calibrate(options: dict[str, Any], json: Json = False) -> None:
    """Calibrate every robot of a list into its own folder; goes on where it was stopped; exit code 3 if one failed."""
    from irbcal.fleet import batch

    steps = len(batch.read_manifest(options["manifest"]))
    with show.progress(steps + 1, quiet=json) as step:
        result = public("fleet_calibrate")(**options, progress=step)
    show.result(result, json, f"Written to {options['out']}: {batch.PAGE}, {batch.TABLE} and a folder for each robot")
    if result.failures:
        raise typer.Exit(FAILED)


@Command(
    "fleet_add",
    arguments=("calibrations",),
    typed={"calibrations": Typed(list[Path], "PATH"), "store": STORE, "date": Typed(str, "DATE")},
)
def add(options: dict[str, Any], json: Json = False) -> None:
    """Add calibrations to a store, each whole or not at all, and once; goes on where it was stopped."""
    with show.progress(len(options["calibrations"]), quiet=json) as step:
        result = public("fleet_add")(**options, progress=step)
    show.result(result, json)


@Command("fleet_list", typed={"store": STORE, "tolerance": MM})
def list_(options: dict[str, Any], json: Json = False) -> None:
    """All robots of a store, what changed in their last calibration, and which stand out of their type."""
    show.result(public("fleet_list")(**options), json)


@Command("fleet_drift", arguments=("robot",), typed={"store": STORE})
def drift(options: dict[str, Any], json: Json = False) -> None:
    """What changed in a robot, or in all, between their calibrations by more than their uncertainty."""
    show.result(public("fleet_drift")(**options), json)


@Command("fleet_prior", typed={"store": STORE, "out": WRITTEN})
def prior(options: dict[str, Any], json: Json = False) -> None:
    """Write what calibrated robots show of their type, for irbcal calibrate --prior: fewer poses do."""
    with show.progress(1, quiet=json) as step:
        result = public("fleet_prior")(**options, progress=step)
    show.result(result, json)


@Command("fleet_export", typed={"store": STORE, "out": WRITTEN})
def export(options: dict[str, Any]) -> None:
    """Write a table of a store as CSV or Parquet."""
    rows = public("fleet_export")(**options)
    show.say(f"{rows} rows written to {options['out']}")


for function in (calibrate, add, list_, drift, prior, export):
    app.command(function.__name__.rstrip("_"), cls=Guarded)(for_typer(function))
