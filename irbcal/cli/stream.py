"""``irbcal stream``: live correction of wanted joints or poses."""

from __future__ import annotations

import sys
from enum import Enum
from typing import Annotated

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import Calibration, Payload, PayloadPlace


class Units(str, Enum):
    """Of joints and poses in the lines."""

    deg, rad = "deg", "rad"


def stream(
    calibration: Calibration,
    rate: Annotated[
        float, typer.Option(min=1.0, help="Lines per second: how far a joint may go in one line follows from it.")
    ] = 1000.0,
    units: Annotated[Units, typer.Option(help="Degrees and millimetres, or radians and metres.")] = Units.deg,
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    without_frame_terms: Annotated[
        bool, typer.Option("--without-frame-terms", help="URDF and joint map alone where there is more.")
    ] = False,
) -> None:
    """Correct wanted joints or poses, a line of JSON each, as they come; hold the last command where one is not safe.

    Lines on standard input: {"joints": [...]}, {"pose": [...]} (x, y, z, qw, qx, qy, qz) or {"model": [...]}.
    """
    from irbcal.exporting.live import stream as open_stream
    from irbcal.exporting.running import run

    live = open_stream(
        calibration,
        rate=rate,
        units=units.value,
        payload=payload,
        payload_place=grid.metres(payload_place, "--payload-place"),
        without_frame_terms=without_frame_terms,
    )
    simulated = ", from SIMULATED measurements" if live.simulated else ""
    show.warn(f"ready, calibration {live.fingerprint}{simulated}")
    run(live, sys.stdin.buffer, sys.stdout.buffer, show.warn)
