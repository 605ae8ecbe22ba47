"""``irbcal circles``: base, tool and links from moves of one joint at a time."""

from __future__ import annotations

from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import DEG, Typed, command, public


@command(
    "circles",
    arguments=("measurements",),
    typed={"tolerance": DEG, "robot": Typed(str, None)},
)
def circles(options: dict[str, Any], json: Json = False) -> None:
    """Base, tool and links of a robot by the circles of one-joint moves alone.

    The base comes from axes 1 and 2, the tool from the last two, links from all six. The tool can be compared with its
    drawing. Nothing is written: calibrate --method circles makes a calibration.
    """
    show.result(public("circles")(**options), json)
