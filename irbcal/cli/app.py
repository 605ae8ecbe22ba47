"""``irbcal app``: the whole job in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show


def app(
    project: Annotated[Path, typer.Argument(metavar="FOLDER", help="Project folder; created if missing.")] = Path(
        "irbcal-project"
    ),
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, metavar="N", help="Port on 127.0.0.1: 8170 or a free one unless given."),
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open/--no-open", help="Open a browser.")] = True,
) -> None:
    """Do the whole job in a browser: robot, plan, data, result, cell, programs, certificate, history.

    The pages are served on this computer only, under an address with a token. All that they do is in the folder: a
    browser that is closed and a server that is stopped lose nothing. Each step shows the command line that does the
    same.
    """
    import webbrowser

    from irbcal.app.server import serve

    def ready(address: str) -> None:
        show.say(f"Serving {project} at {address} (Ctrl-C ends it)", whole=True)
        if open_browser:
            webbrowser.open(address)

    serve(project, port, ready)
