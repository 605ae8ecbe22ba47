"""``irbcal controller``: which numbers a controller computes its poses with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import Typed, command, public


@command("controller", arguments=("poses",), typed={"robot": Typed(str, None)})
def controller(
    options: dict[str, Any],
    out: Annotated[Path | None, typer.Option(help="URDF that equals the controller.", metavar="FILE")] = None,
    json: Json = False,
) -> None:
    """Compare a URDF with the poses that the controller itself reports: which lengths and zeros it computes with."""
    comparison = public("controller")(**options)
    if out is not None:
        comparison.save(out)
    if json:
        show.print_json({**comparison.to_dict(), "out": None if out is None else str(out)})
        return
    show.tell(comparison.report())
    if out is not None:
        show.say(f"Written to {out}")
