"""``irbcal urdf``: a URDF from a Denavit-Hartenberg table."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Annotated, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.wrong_calls import path_to_write


def urdf(
    dh: Annotated[
        Path,
        typer.Option(
            help="CSV with a row a joint: alpha_deg, a_mm, theta_deg, d_mm (or _rad, _m); optional joint, type, sign, "
            "lower_deg, upper_deg.",
            show_default=False,
        ),
    ],
    convention: Annotated[
        Literal["modified", "standard"],
        typer.Option(help="modified: Craig's, a and alpha lead to the joint's axis; standard: they lead on from it."),
    ],
    out: Annotated[
        Path, typer.Option(parser=path_to_write, metavar="PATH", help="URDF file to write.", show_default=False)
    ],
    name: Annotated[str, typer.Option(help="Name of the robot.")] = "robot",
    json: Json = False,
) -> None:
    """Write a URDF from a Denavit-Hartenberg table, for robots that have none."""
    from irbcal.io.dh_table import urdf_from_dh
    from irbcal.overwriting import refuse_overwriting

    refuse_overwriting({"out": out}, [dh])
    made = urdf_from_dh(dh, convention, name=name)
    made.save(out)
    if json:
        rows = made.to_frame().to_dict("records")
        finite = [{k: None if v in (inf, -inf) else v for k, v in row.items()} for row in rows]  # no limit: null
        show.print_json({"out": str(out), "joints": finite})
        return
    show.tell([*made.told(), f"Written to {out}"])
