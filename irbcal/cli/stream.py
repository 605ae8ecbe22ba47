"""``irbcal stream``: live correction of wanted joints or poses."""

from __future__ import annotations

import sys
from typing import Any

from irbcal.cli import grid, show
from irbcal.cli.signature import PLACE, Typed, command, public
from irbcal.errors import IrbcalError


@command(
    "stream",
    arguments=("calibration",),
    typed={
        "at": Typed(str, "J1,J2,…", lambda text, option: grid.numbers(text, [text.count(",") + 1], option)),
        "payload_place": PLACE,
    },
)
def stream(options: dict[str, Any]) -> None:
    """Correct wanted joints or poses, a line of JSON each, as they come; bring the arm to rest where one is not safe.

    Lines on standard input: {"joints": [...]}, {"pose": [...]} (x, y, z, qw, qx, qy, qz) or {"model": [...]}; the first
    one with "at": [...], the arm's actual joints, unless --at gives them.
    """
    from irbcal.exporting.running import run

    if sys.stdin is None:
        raise IrbcalError("there is no standard input")
    live = public("stream")(**options)
    simulated = ", from SIMULATED measurements" if live.simulated else ""
    show.warn(f"ready, calibration {live.fingerprint}{simulated}")
    run(live, sys.stdin.buffer, sys.stdout.buffer, show.warn)
