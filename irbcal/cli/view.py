"""``irbcal view``: a calibration, its measured points and its errors in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import Typed, command, public


@command(
    "view",
    arguments=("source", "measurements"),
    typed={"source": Typed(str, None), "package_dir": Typed(list[Path], "FOLDER")},
    without=("cube",),
)
def view(
    options: dict[str, Any],
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page in place of serving it.")] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1: 8160 or a free one unless given.")
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open a browser.")] = False,
) -> None:
    """Look at the robot, measured and modelled points and magnified errors, pose by pose (served on 127.0.0.1 only)."""
    if html is not None and port is not None:
        raise typer.BadParameter("--html writes a page, it is not served: leave one of them out", param_hint="--port")
    result = public("view")(**options)
    show.tell(result.report())
    if html is None:
        result.serve(port, open_browser, show.say)
    else:
        show.say(f"Written to {result.save(html)}")
