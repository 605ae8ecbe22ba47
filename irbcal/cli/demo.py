"""``irbcal demo``: the main job on the data that ship with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import calibrate, show
from irbcal.cli.shared_options import Json, Verbose
from irbcal.errors import IrbcalError
from irbcal.identification.choices import Model
from irbcal.io import robots

OWN = Path("irbcal-demo")
"""Where the demonstration writes unless told otherwise, and replaces its own work."""
MEASURED = "demo_identification.csv"


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the calibration.")] = OWN,
    model: Annotated[Model, typer.Option(help="Level of the error model (thesis, section 5.4).")] = "34",
    force: Annotated[
        bool,
        typer.Option(
            "--force", help=f"Replace a calibration that is in --out already (a demonstration in {OWN} always is)."
        ),
    ] = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Calibrate a simulated IRB 1600 with the shipped measurements and prove it on 1,000 other poses."""
    if not json:
        show.say("Demonstration on SIMULATED measurements of an IRB 1600 that errs like the one of the thesis.")
    options = {
        "measurements": robots.demo_file(MEASURED),
        "robot": "irb1600",
        "model": model,
        "verify": robots.demo_file("demo_verification.csv"),
    }
    calibrate.run(options, out, json, force or (out == OWN and _from_a_demonstration(out)), verbose)
    if not json:
        show.say(
            f"\nOpen {out / 'report.html'}. Next, SIMULATED examples for every command, with the lines that try them:"
        )
        show.say(f"  {show.this_command()} samples try-irbcal", whole=True)


def _from_a_demonstration(folder: Path) -> bool:
    """Whether the calibration in a folder, if there is one, is of the demonstration's measurements."""
    from irbcal.io.calibration_folder import read

    if not (folder / "calibration.json").exists():
        return True
    try:
        record = read(folder).record
    except IrbcalError:
        return False
    return record.simulated and bool(record.data) and Path(record.data[0].file).name == MEASURED
