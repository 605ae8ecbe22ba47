"""``irbcal robots``: the robots that can be named in place of a URDF file."""

from __future__ import annotations

from irbcal.cli import show
from irbcal.cli.shared_options import Json


def robots(
    json: Json = False,
) -> None:
    """List the robots that --robot takes by name."""
    from irbcal.io.robots import robots as known

    listed = known()
    if json:
        show.print_json(listed.to_frame().astype(object).where(listed.to_frame().notna(), None).to_dict("records"))
    else:
        show.tell(listed.report())
