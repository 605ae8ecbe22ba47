"""``irbcal view``: a calibration, its measured points and its errors in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli.shared_options import BaseLink, RefitBase, RefitTool, TipLink


def view(
    source: Annotated[
        str, typer.Argument(help="Calibration folder, URDF or a robot's name (see irbcal robots).", show_default=False)
    ],
    measurements: Annotated[
        Path | None,
        typer.Argument(
            help="Measurement file (CSV or Parquet); or joints only (q1_deg …): a plan. Without: joint sliders.",
            show_default=False,
        ),
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Write one self-contained page in place of serving it.", show_default=False)
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Joints to walk through before they are run.", show_default=False)
    ] = None,
    magnify: Annotated[
        float | None, typer.Option(help="Magnification of the error vectors.", show_default="a round number")
    ] = None,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(help="Folder in which package:// names of meshes are looked up; repeatable.", show_default=False),
    ] = None,
    refit_base: RefitBase = False,
    refit_tool: RefitTool = False,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1.", show_default="8160 or a free one")
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open a browser.")] = False,
) -> None:
    """Look at the robot, measured and modelled points and magnified errors, pose by pose (served on 127.0.0.1 only)."""
    if html is not None and port is not None:
        raise typer.BadParameter("--html writes a page, it is not served: leave one of them out", param_hint="--port")
    from irbcal.cli import show
    from irbcal.viewer.view import view as look

    shown = look(
        source,
        measurements,
        plan=plan,
        magnify=magnify,
        package_dir=package_dir or (),
        refit_base=refit_base,
        refit_tool=refit_tool,
        base_link=base_link,
        tip_link=tip_link,
    )
    show.tell(shown.told())
    if html is None:
        shown.serve(port, open_browser, show.say)
    else:
        show.say(f"Written to {shown.save(html)}")
