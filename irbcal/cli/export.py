"""``irbcal export``: the calibrated robot as a part of other programs."""

from __future__ import annotations

from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import PLACE, command, public


@command("export", arguments=("calibration",), typed={"payload_place": PLACE})
def export(options: dict[str, Any], json: Json = False) -> None:
    """Write the calibrated robot as a part of other programs, with test vectors and fingerprint inside."""
    show.result(public("export")(**options), json)
