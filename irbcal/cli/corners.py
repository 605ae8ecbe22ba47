"""``irbcal corners``: pictures of a ChArUco board in, rows for a calibration out."""

from __future__ import annotations

from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json, OutFile
from irbcal.cli.signature import command, public
from irbcal.overwriting import refuse_overwriting


@command("corners", arguments=("images",))
def corners(options: dict[str, Any], out: OutFile, json: Json = False) -> None:
    """Find the corners of a ChArUco board in pictures: rows for calibrate --features.

    Needs OpenCV: pip install 'irbcal[camera]'.
    """
    refuse_overwriting({"out": out}, [options["joints"], options["features"]])
    result = public("corners")(**options)
    result.save(out)
    show.result(result, json, f"Written to {out}", out=str(out))
