"""``irbcal controller``: which numbers a controller computes its poses with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import BaseLink, Coupling, Json, TipLink
from irbcal.cli.wrong_calls import wrong_calls


def controller(
    poses: Annotated[
        Path,
        typer.Argument(
            help="Joints and the poses that the controller reports for them: q1_deg … (or q1_rad …), x_mm, y_mm, z_mm "
            "(or x_m …), qw, qx, qy, qz; also with controller_ before them.",
            show_default=False,
        ),
    ],
    robot: Annotated[str, typer.Option(help="URDF, or a name: see irbcal robots.", show_default=False)],
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    out: Annotated[
        Path | None, typer.Option(help="URDF that equals the controller.", metavar="FILE", show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Compare a URDF with the poses that the controller itself reports: which lengths and zeros it computes with."""
    from irbcal.validation.controller_check import controller as check

    with wrong_calls():
        found = check(poses, robot, base_link=base_link, tip_link=tip_link, coupling=coupling)
    if out is not None:
        found.save(out)
    if json:
        show.print_json({**found.to_dict(), "out": None if out is None else str(out)})
        return
    show.tell(found.told())
    if out is not None:
        show.say(f"Written to {out}")
