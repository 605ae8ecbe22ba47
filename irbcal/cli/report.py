"""``irbcal report``: write the report of a calibration again, with its figures and data as files on request."""

from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

Kind = Enum("Kind", [(kind, kind) for kind in ("png", "svg")], type=str)


def report(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the figures as files of their own.", show_default=False)
    ] = None,
    format: Annotated[Kind, typer.Option(help="Of these figures.")] = Kind.png,
    data: Annotated[
        Path | None, typer.Option(help="Folder for the data behind figures and tables (CSV).", show_default=False)
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Write report.html again from calibration.json; its figures (PNG, SVG) and data (CSV) on request."""
    from irbcal.files import calibration_folder
    from irbcal.files.atomic import check_writable, write_together
    from irbcal.reports import report_page as page

    made = []
    try:
        with show.progress(3, quiet=json) as step:
            step("reading the calibration")
            saved = calibration_folder.load(calibration)
            folders = {folder: {} for folder in (calibration, figures, data) if folder is not None}
            for folder in folders:
                made += check_writable(folder)
            step("computing errors")
            evidence = page.gather(saved)
            step("drawing")
            if figures is not None:
                folders[figures] |= page.figure_files(saved, evidence, format.value)
            if data is not None:
                folders[data] |= page.data_files(saved, evidence)
            folders[calibration][calibration_folder.REPORT_NAME] = page.render(saved, evidence).encode("utf-8")
            for folder, files in folders.items():
                write_together(folder, files)
    except BaseException:
        for folder in made:  # an empty folder would look like a result
            with suppress(OSError):
                folder.rmdir()
        raise
    written = [str(folder / name) for folder, files in folders.items() for name in files]
    if json:
        show.print_json({"out": str(calibration), "simulated": saved.simulated, "written": written})
        return
    for folder, files in folders.items():
        show.say(f"Written to {folder}: {', '.join(files)}")
