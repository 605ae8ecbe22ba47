"""``irbcal report``: write the report of a calibration again, with its figures and data as files on request."""

from __future__ import annotations

from typing import Any

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import command, public


@command("report", arguments=("calibration",))
def report(options: dict[str, Any], json: Json = False) -> None:
    """Write report.html again from calibration.json; its figures (PNG, SVG) and data (CSV) on request."""
    with show.progress(3, quiet=json) as step:
        folders = public("report")(**options, progress=step)
    signature = public("verify")(options["calibration"]).signature
    if json:
        written = [str(folder / name) for folder, names in folders.items() for name in names]
        simulated = public("load")(options["calibration"]).record.simulated
        show.print_json(
            {"out": str(options["calibration"]), "simulated": simulated, "written": written, "signature": signature}
        )
        return
    for folder, names in folders.items():
        show.say(f"Written to {folder}: {', '.join(names)}")
    if signature == "stale":
        show.say("The signature is of the earlier page: irbcal sign")
