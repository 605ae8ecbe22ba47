"""``irbcal urdf``: a URDF from a Denavit-Hartenberg table."""

from __future__ import annotations

from math import inf
from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json, OutFile
from irbcal.cli.signature import command, public
from irbcal.overwriting import refuse_overwriting


@command("urdf_from_dh")
def urdf(options: dict[str, Any], out: OutFile, json: Json = False) -> None:
    """Write a URDF from a Denavit-Hartenberg table, for robots that have none."""
    refuse_overwriting({"out": out}, [options["dh"]])
    result = public("urdf_from_dh")(**options)
    result.save(out)
    if json:
        rows = result.to_frame().to_dict("records")
        finite = [{k: None if v in (inf, -inf) else v for k, v in row.items()} for row in rows]  # no limit: null
        show.print_json({"out": str(out), "joints": finite})
        return
    show.tell([*result.report(), f"Written to {out}"])
