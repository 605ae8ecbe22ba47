"""``irbcal plan``: which poses to measure, and the files that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import DEG, MM, PLACE, Typed, command, for_function, numbers, public, scaled
from irbcal.units import DEG as DEG_PER_RAD
from irbcal.units import MM as MM_PER_M


@command(
    "plan device_plan compare_devices",
    typed={
        "robot": Typed(str, None),
        "targets": Typed(str, "FILE|N|NAME,…"),
        "tracker": numbers("X,Y,Z[,DEGREES]", 3, 4, units=[MM_PER_M] * 3 + [DEG_PER_RAD]),
        "cube_centre": PLACE,
        "cube_edge": MM,
        "margin": DEG,
        "acceptance": DEG,
        "imagined": DEG,
        "min_height": numbers("FRONT,BACK", 2, units=[MM_PER_M]),
        "speed": scaled(MM_PER_M, "MM/S"),
        "noise": MM,
        "approach": MM,
        "prior": MM,
        "pulses": numbers("P1,…,P6", 6),
        "package_dirs": Typed(list[Path], "FOLDER"),
    },
    flags={"package_dirs": "--package-dir"},
    panels={
        "Everyday": ("robot", "out", "targets", "tracker", "payload", "language", "pulses", "json"),
        "Poses": ("axis", "cube", "all_range", "optimal", "candidates", "criterion", "volume", "level", "seed"),
        "A device in place of a tracker": ("device", "poses", "approach", "prior", "compare_devices"),
        "Conditions": ("margin", "acceptance", "min_height", "cube_centre", "cube_edge", "without", "package_dirs"),
        "Time and errors": ("wait_s", "references", "speed", "noise"),
    },
    optional=("device",),
    texts={
        "candidates": "Poses that --optimal (2000) or a device (600) chooses from.",
        "acceptance": "Largest angle between reflector and beam, up to 90; of a device between the tool's axis and "
        "surface (60), bar (90) or string (120), of a camera its view and the board's normal (50).",
    },
)
def plan(
    options: dict[str, Any],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the plan; needed but for --compare-devices.", show_default=False)
    ] = None,
    compare_devices: Annotated[
        bool,
        typer.Option(
            "--compare-devices",
            help="Predict what a tracker and each device would leave of the position error, and stop.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Plan measurements: poses that the robot reaches and the tracker sees, a robot program, and what they promise."""
    if compare_devices:
        for_function("compare_devices", options, "--compare-devices does not take it")
        options |= {"poses": (options["poses"],)} if "poses" in options else {}
        with show.progress(9, quiet=json) as step:
            compared = public("compare_devices")(**options, progress=step)
        show.result(compared, json)
        return
    if out is None:
        raise typer.BadParameter("missing", param_hint="--out")
    if "device" in options:
        for_function("device_plan", options, "--device does not take it")
        with show.progress(4, quiet=json) as step:
            made = public("device_plan")(**options, progress=step)
        files = made.save(out)
    else:
        for_function("plan", options, "is for --device and --compare-devices")
        made, files = _made(out, json, options)
    names = [path.name for path in files]
    show.result(made, json, f"Written to {out}: {', '.join(names)}", out=str(out), files=names)


def _made(out: Path, json: bool, options: dict[str, Any]) -> tuple[Any, tuple[Path, ...]]:
    """A plan and its files; a folder that had to be made for it goes where there is none."""
    from irbcal.atomic import made_folders
    from irbcal.viewer import plan_page

    with made_folders(out), show.progress(12, quiet=json) as step:
        step("robot")
        made = public("plan")(**options, progress=step)
        step("files")
        try:
            page = plan_page.page(made)
        except ModuleNotFoundError as error:
            if error.name != "meshcat":
                raise
            page = None
            show.warn("plan.html is not written, as it needs meshcat: pip install meshcat")
        return made, made.save(out, page)
