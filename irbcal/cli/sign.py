"""``irbcal sign``: a laboratory's signature of a calibration or a certificate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import wrong_calls


def sign(
    path: Annotated[Path, typer.Argument(help="Calibration folder, or a file: a certificate.", show_default=False)],
    key: Annotated[Path, typer.Option(help="Private Ed25519 key (PEM).", show_default=False)],
    new_key: Annotated[
        bool, typer.Option("--new-key", help="Make the key first, and the public one beside it (.pub).")
    ] = False,
    json: Json = False,
) -> None:
    """Sign a calibration folder or a certificate with a laboratory's key; irbcal verify --public-key checks it."""
    from irbcal.io.signature import sign as write

    with wrong_calls():
        out = write(path, key, new_key=new_key)
    if json:
        show.print_json({"signature": str(out)})
    else:
        show.say(f"Signed: {out}")
