"""Options and arguments that several commands have, each with one name, one type and one help text."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.signature import path_to_write

OutFile = Annotated[Path, typer.Option(parser=path_to_write, metavar="PATH", help="File to write.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")]
JsonLines = Annotated[bool, typer.Option("--json", help="JSON lines in place of CSV.")]
Verbose = Annotated[bool, typer.Option("--verbose", help=show.VERBOSE)]
FailIfWorse = Annotated[bool, typer.Option("--fail-if-worse", help=show.FAIL_IF_WORSE)]
