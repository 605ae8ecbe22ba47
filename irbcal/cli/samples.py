"""``irbcal samples``: example files for every command."""

from __future__ import annotations

import shlex
from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import command, public


@command("samples", arguments=("folder",))
def samples(options: dict[str, Any], json: Json = False) -> None:
    """Write small example files for every command, all SIMULATED, with the lines that try them."""
    written = public("samples")(**options)
    folder = shlex.quote(str(written.folder))
    show.result(written, json)
    if not json:
        show.say("Next:")
        show.say(f"  cd {folder}", whole=True)
        show.say(f"  {show.this_command()} calibrate measured.csv --robot my_robot.urdf --out my-robot", whole=True)
