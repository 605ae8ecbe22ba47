"""``irbcal samples``: example files for every command."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json


def samples(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="New or empty folder.")] = Path("irbcal-samples"),
    json: Json = False,
) -> None:
    """Write small example files for every command, all SIMULATED, with the lines that try them."""
    from irbcal.examples.samples import samples as write

    written = write(out)
    if json:
        show.print_json(written.to_dict())
        return
    show.tell(written.told())
    show.say("Next:")
    show.say(f"  cd {shlex.quote(str(out))}", whole=True)
    show.say(f"  {show.this_command()} calibrate measured.csv --robot my_robot.urdf --out my-robot", whole=True)
