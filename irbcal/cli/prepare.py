"""What stands before a measurement: ``irbcal robots``, ``urdf``, ``plan``, ``simulate``, ``samples``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from irbcal import literals
from irbcal.cli import programs, show
from irbcal.cli.programs import PROGRAM_FLAGS, PROGRAM_TEXTS, PROGRAM_TYPED
from irbcal.cli.signature import (
    DEG,
    LOST_JOINTS,
    MM,
    PLACE,
    Command,
    Json,
    OutFile,
    Typed,
    for_function,
    numbers,
    public,
    scaled,
)
from irbcal.correction.known_languages import PLANNED
from irbcal.units import DEG as DEG_PER_RAD
from irbcal.units import MM as MM_PER_M


@Command("robots")
def robots(options: dict[str, Any], json: Json = False) -> None:
    """List the robots that --robot takes by name."""
    listed = public("robots")(**options)
    if json:
        show.print_json(listed.to_dict()["robots"])
    else:
        show.tell(listed.report())


@Command("urdf_from_dh")
def urdf(options: dict[str, Any], out: OutFile, json: Json = False) -> None:
    """Write a URDF from a Denavit-Hartenberg table, for robots that have none."""
    result = public("urdf_from_dh")(**options)
    result.save(out)
    show.written(result, out, json)


@Command(
    "plan device_plan compare_devices",
    typed={
        "targets": Typed(str, "FILE|N|NAME,…"),
        "tracker": numbers("X,Y,Z[,DEGREES]", 3, 4, units=[MM_PER_M] * 3 + [DEG_PER_RAD]),
        "cube_centre": PLACE,
        "cube_edge": MM,
        "margin": DEG,
        "acceptance": DEG,
        "unmodelled": DEG,
        "min_height": numbers("FRONT,BACK", 2, units=[MM_PER_M]),
        "speed": scaled(MM_PER_M, "MM/S"),
        "noise": MM,
        "approach": MM,
        "prior": MM,
        "pulses": numbers("P1,…,P6", 6),
        "language": Typed(Literal[PLANNED], f"<{' | '.join(PLANNED)}>"),
        "refit_zeros": LOST_JOINTS,
    },
    panels={
        "Options": ("out",),
        "Everyday": ("device", "poses", "compare_devices", "json"),
    },
    optional=("device",),
    texts={
        "poses": "Number of poses with a device; without one, --axis, --cube, --all-range and --optimal say it.",
        "candidates": "Poses that --optimal (2000) or a device (600) chooses from.",
        "acceptance": "Largest angle between reflector and beam, up to 90; of a device between the tool's axis and "
        "surface (60), bar (90) or string (120), of a camera its view and the board's normal (50).",
    },
)
def plan(
    options: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the plan; needed but for --compare-devices.", metavar="FOLDER", show_default=False
        ),
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
            planned = public("device_plan")(**options, progress=step)
        files = planned.save(out)
    else:
        counts = ": --axis, --cube, --all-range and --optimal say how many" if "poses" in options else ""
        for_function("plan", options, f"is for --device and --compare-devices{counts}")
        planned, files = _write_plan(out, json, options)
    names = [path.name for path in files]
    show.result(planned, json, f"Written to {out}: {', '.join(names)}", out=str(out), files=names)


def _write_plan(out: Path, json: bool, options: dict[str, Any]) -> tuple[Any, tuple[Path, ...]]:
    """A plan and its files; a folder that had to be made for it goes where there is none."""
    from irbcal.safe_files import made_folders
    from irbcal.viewer.building import plan_page

    with made_folders(out), show.progress(12, quiet=json) as step:
        step("robot")
        planned = public("plan")(**options, progress=step)
        step("files")
        try:
            page = plan_page(planned)
        except ModuleNotFoundError as error:
            if error.name != "meshcat":
                raise
            page = None
            show.warn("plan.html is not written, as it needs meshcat: pip install meshcat")
        return planned, planned.save(out, page)


@Command(
    "simulate simulate_device",
    arguments=("plan",),
    typed=PROGRAM_TYPED
    | {
        "plan": Typed(Path, None),
        "only": Typed(list[str], "EFFECT", lambda names, option: () if names == ["none"] else names),
        "without": Typed(list[str], "EFFECT"),
        "also": Typed(list[str], "EFFECT"),
        "targets": Typed(
            str, "N|NAME,…", lambda text, option: int(text) if text.isdigit() else [n.strip() for n in text.split(",")]
        ),
        "tracker": PLACE,
        "noise": MM,
    },
    flags=PROGRAM_FLAGS,
    panels={"Everyday": ("out", "list_", "json")},
    without=("at",),
    optional=("robot", "device"),
    texts=PROGRAM_TEXTS
    | {
        "only": "Only this effect (repeat for more); none: no effect at all.",
    },
)
def simulate(
    options: dict[str, Any],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Measurement file to write; the truth goes beside it, as NAME.truth.json, and of a device what is "
            "known of its features, as NAME.features.csv.",
            show_default=False,
        ),
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="Name the effects and stop.")] = False,
    json: Json = False,
) -> None:
    """Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and calibrations."""
    if list_:
        _list(json)
        return
    if "robot" not in options or out is None:
        raise typer.BadParameter("missing", param_hint="--robot" if "robot" not in options else "--out")
    if "device" in options:
        for_function("simulate_device", options, "--device does not take it: its poses are at its features")
        found = public("simulate_device")(**options)
        rows, features, truth = found.save(out)
        sentence = f"Written to {rows}, what is known of the features to {features}, the truth to {truth}"
        show.result(found, json, sentence, out=str(rows), features_out=str(features), truth=str(truth))
        return
    for_function("simulate", options, "only --device has one: a tracker's noise is an effect")
    programs.read_frames(options, options.get("plan"))
    simulated = public("simulate")(**options)
    measured, truth = simulated.save(out)
    sentence = f"Written to {measured}, the truth to {truth}"
    show.result(simulated, json, sentence, out=str(measured), truth=str(truth))


def _list(json: bool) -> None:
    """Name the effects, as JSON with their parameters."""
    from irbcal.simulation.effects import ALL

    if json:
        show.print_json([{"name": e.name, "summary": e.summary, "parameters": e().parameters()} for e in ALL])
        return
    width = max(len(effect.name) for effect in ALL)
    show.tell([f"{effect.name:{width}}  {effect.summary}" for effect in ALL])


@Command("samples", arguments=("folder",))
def samples(options: dict[str, Any], json: Json = False) -> None:
    """Write small example files for every command, all SIMULATED, with the lines that try them."""
    written = public("samples")(**options)
    folder = literals.shell(str(written.folder))
    show.result(written, json)
    if not json:
        show.say("Next:")
        show.say(f"  cd {folder}", whole=True)
        show.say(f"  {show.this_command()} calibrate measured.csv --robot my_robot.urdf --out my-robot", whole=True)
