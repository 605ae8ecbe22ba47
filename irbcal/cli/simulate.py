"""``irbcal simulate``: measure in a virtual cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import program_words, show
from irbcal.cli.program_words import PROGRAM_FLAGS, PROGRAM_TEXTS, PROGRAM_TYPED
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import MM, PLACE, Typed, command, for_function, public


@command(
    "simulate simulate_device",
    arguments=("plan",),
    typed=PROGRAM_TYPED
    | {
        "plan": Typed(Path, None),
        "robot": Typed(str, None),
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
    panels={
        "Everyday": ("robot", "out", "random", "seed", "payload", "targets", "tracker", "wait", "json"),
        "Errors": ("cell", "robot_seed", "only", "without", "also", "list_"),
        "A corrected program": ("wanted", "calibration", "tool", "wobj", "pulses", "where"),
        "A device in place of a tracker": ("device", "noise"),
    },
    without=("at",),
    optional=("robot", "device"),
    texts=PROGRAM_TEXTS
    | {
        "only": "Only this effect (repeat for more); none: no effect at all.",
        "noise": "Standard deviation of a contact, mm: what is plausible for the device unless given.",
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
        line = f"Written to {rows}, what is known of the features to {features}, the truth to {truth}"
        show.result(found, json, line, out=str(rows), features_out=str(features), truth=str(truth))
        return
    for_function("simulate", options, "only --device has one: a tracker's noise is an effect")
    program_words.read_frames(options, options.get("plan"))
    simulated = public("simulate")(**options)
    measured, truth = simulated.save(out)
    line = f"Written to {measured}, the truth to {truth}"
    show.result(simulated, json, line, out=str(measured), truth=str(truth))


def _list(json: bool) -> None:
    """Name the effects, as JSON with their parameters."""
    from irbcal.simulation.effects import ALL

    if json:
        show.print_json([{"name": e.name, "summary": e.summary, "parameters": e().parameters()} for e in ALL])
        return
    width = max(len(effect.name) for effect in ALL)
    show.tell([f"{effect.name:{width}}  {effect.summary}" for effect in ALL])
