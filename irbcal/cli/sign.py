"""``irbcal sign``: a laboratory's signature of a calibration or a certificate."""

from __future__ import annotations

from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import command, public


@command("sign", arguments=("path",))
def sign(options: dict[str, Any], json: Json = False) -> None:
    """Sign a calibration folder or a certificate with a laboratory's key; irbcal verify --public-key checks it."""
    out = public("sign")(**options)
    if json:
        show.print_json({"signature": str(out)})
    else:
        show.say(f"Signed: {out}")
