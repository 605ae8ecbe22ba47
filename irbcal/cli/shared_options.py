"""Options and arguments that several commands have, each with one name, one type and one help text."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.wrong_calls import path_to_write

Calibration = Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)]
Measurements = Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)]
RobotOrCalibration = Annotated[
    str, typer.Argument(help="Calibration folder, URDF or a robot's name (see irbcal robots).", show_default=False)
]

BaseLink = Annotated[str | None, typer.Option(help="Base link of the arm.", show_default="base_link or the root")]
TipLink = Annotated[
    str | None,
    typer.Option(help="Tip link of the arm.", show_default="tool0, flange, ee_link, tcp or the last link"),
]
Coupling = Annotated[
    str | None,
    typer.Option(
        help="How the controller counts joints: 3+2 adds joint 2 to its joint 3; none: as the URDF.",
        show_default="that of the file beside the URDF",
    ),
]

Payload = Annotated[
    float | None,
    typer.Option(min=0.0, help="Mass carried, kg.", show_default="what most poses were measured with"),
]
PayloadPlace = Annotated[
    str | None,
    typer.Option(help="Its centre in the tip link: x,y,z in mm.", show_default="the calibration's"),
]
PayloadOfFiles = Annotated[
    float | None,
    typer.Option(min=0.0, help="Mass carried, kg, for files without a column payload_kg.", show_default=False),
]
SameTool = Annotated[
    bool, typer.Option("--same-tool", help="With loads unknown to the calibration reflectors stayed in place.")
]

RefitBase = Annotated[
    bool, typer.Option("--refit-base", help="Place the base anew: the tracker or the robot was moved.")
]
RefitTool = Annotated[
    bool, typer.Option("--refit-tool", help="Place the targets anew: the reflectors were mounted anew.")
]
IncludeFitted = Annotated[bool, typer.Option("--include-fitted", help="Keep poses that the calibration was fitted to.")]
BootstrapSeed = Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")]

Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Workers at a time; the result does not depend on it.", show_default="one for each core"),
]
Engine = Annotated[
    str | None,
    typer.Option(
        metavar="dask://HOST:PORT", help="The workers of a Dask cluster in place of this machine's.", show_default=False
    ),
]

OutFile = Annotated[Path, typer.Option(parser=path_to_write, metavar="PATH", help="File to write.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")]
JsonLines = Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")]
Verbose = Annotated[bool, typer.Option("--verbose", help=show.VERBOSE)]
FailIfWorse = Annotated[bool, typer.Option("--fail-if-worse", help=show.FAIL_IF_WORSE)]
