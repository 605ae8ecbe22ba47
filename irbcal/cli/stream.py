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
    at: Annotated[
        str | None, typer.Option(metavar="J1,J2,...", help="The arm's actual joints; in the first line unless given.")
    ] = None,
    units: Annotated[Units, typer.Option(help="Degrees and millimetres, or radians and metres.")] = Units.deg,
    to_speed: Annotated[
        float, typer.Option(help="Seconds from rest to the speed limit: the largest acceleration.")
    ] = 0.1,
    to_acceleration: Annotated[
        float, typer.Option(help="Seconds from none to the largest acceleration: the largest jerk.")
    ] = 0.05,
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    without_frame_terms: Annotated[
        bool, typer.Option("--without-frame-terms", help="URDF and joint map alone where there is more.")
    ] = False,
) -> None:
    """Correct wanted joints or poses, a line of JSON each, as they come; bring the arm to rest where one is not safe.

    Lines on standard input: {"joints": [...]}, {"pose": [...]} (x, y, z, qw, qx, qy, qz) or {"model": [...]}; the first
    one with "at": [...], the arm's actual joints, unless --at gives them.
    """
    from irbcal.exporting.live import stream as open_stream
    from irbcal.exporting.running import run

    live = open_stream(
        calibration,
        at=None if at is None else grid.numbers(at, [at.count(",") + 1], "--at"),
        units=units.value,
        to_speed=to_speed,
        to_acceleration=to_acceleration,
        payload=payload,
        payload_place=grid.metres(payload_place, "--payload-place"),
        without_frame_terms=without_frame_terms,
    )
    simulated = ", from SIMULATED measurements" if live.simulated else ""
    show.warn(f"ready, calibration {live.fingerprint}{simulated}")
    run(live, sys.stdin.buffer, sys.stdout.buffer, show.warn)
