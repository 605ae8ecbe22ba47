"""``irbcal simulate``: measure in a virtual cell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from irbcal.correction.maker import Maker

from irbcal.cli import program_words, show
from irbcal.cli.shared_options import BaseLink, Coupling, Json, TipLink

_Plan = Annotated[
    Path | None,
    typer.Argument(
        help="Robot program of any language of docs/programs.md, or CSV of joints (q1_deg …) or poses (x_mm … qz), "
        "such as a plan; optional columns pose, group, cycle, targets (names with spaces between them), wait_s.",
        show_default=False,
    ),
]
_Robot = Annotated[
    str | None,
    typer.Option(
        help="URDF of the nominal robot, a name, such as irb1600 (tuned) or irb120, or a calibration folder.",
        show_default=False,
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(help="Measurement file to write; the truth goes beside it, as NAME.truth.json.", show_default=False),
]
_Random = Annotated[
    int | None, typer.Option(min=1, help="That many random poses in the tracker's sight, in place of a plan.")
]
_Seed = Annotated[int, typer.Option(min=0, help="Of the run: noise, repeatability, lost points, random poses.")]
_RobotSeed = Annotated[int | None, typer.Option(min=0, help="Another robot: its link errors are drawn from this seed.")]
_Payload = Annotated[
    float | None, typer.Option(min=0.0, help="Mass on the flange, kg; 3 by default, less for smaller arms.")
]
_Only = Annotated[list[str] | None, typer.Option(help="Only this effect (repeat for more); none: no effect at all.")]
_Without = Annotated[list[str] | None, typer.Option(help="All effects but this one (repeat for more).")]
_Also = Annotated[
    list[str] | None,
    typer.Option(
        help="An effect that the cell of the thesis leaves off: reading_lag, bending, gear, wobble, direction, move, "
        "thaw (repeat for more)."
    ),
]
_Cell = Annotated[
    Literal["thesis", "realistic"],
    typer.Option(
        help="A robot with the thesis's errors, or with those that measured robots show: weight at all joints, "
        "harmonic drives, wobbling bearings, warm-up, direction of approach, early readings."
    ),
]
_Targets = Annotated[
    str, typer.Option(help="How many of the tool's nine reflectors, or their names with commas between them.")
]
_Tracker = Annotated[
    str | None, typer.Option(help="Place of the tracker in the base link, x,y,z in mm.", show_default=False)
]
_Wait = Annotated[float, typer.Option(min=0.0, help="Seconds between stop and measurement.")]
_Wanted = Annotated[
    Path | None,
    typer.Option(help="The program before it was filtered: tells how far the robot ends from it.", show_default=False),
]
_Calibration = Annotated[
    Path | None, typer.Option(help="With --wanted: the calibration it was filtered with.", show_default=False)
]
_Tool = Annotated[
    list[str] | None,
    typer.Option(help="A tool that a program does not define: NAME=numbers, as in irbcal filter; likewise"),
]
_Wobj = Annotated[
    list[str] | None, typer.Option("--wobj", "--frame", help="a work object (base, user frame) in the base frame.")
]
_Pulses = Annotated[
    str | None,
    typer.Option(help="Pulses per degree of the six joints, with commas, for Yaskawa jobs.", show_default=False),
]
_Where = Annotated[
    str | None,
    typer.Option(help="Joints and pose of one place, for poses of Kawasaki programs, as in irbcal filter."),
]
_Device = Annotated[
    str | None,
    typer.Option(
        help="In place of a tracker: balls, string, ballbar, two-balls, sockets, ball, camera or plane; with --random. "
        "Writes NAME.features.csv, too, for irbcal calibrate --features.",
        show_default=False,
    ),
]
_Noise = Annotated[
    float | None,
    typer.Option("--noise-mm", min=0.0, help="With --device: standard deviation of a contact.", show_default="0.03"),
]
_List = Annotated[bool, typer.Option("--list", help="Name the effects and stop.")]


def simulate(
    plan: _Plan = None,
    robot: _Robot = None,
    out: _Out = None,
    random: _Random = None,
    seed: _Seed = 0,
    robot_seed: _RobotSeed = None,
    payload: _Payload = None,
    only: _Only = None,
    without: _Without = None,
    also: _Also = None,
    cell: _Cell = "thesis",
    targets: _Targets = "3",
    tracker: _Tracker = None,
    wait: _Wait = 4.0,
    wanted: _Wanted = None,
    calibration: _Calibration = None,
    tool: _Tool = None,
    wobj: _Wobj = None,
    pulses: _Pulses = None,
    where: _Where = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    device: _Device = None,
    noise: _Noise = None,
    list_: _List = False,
    json: Json = False,
) -> None:
    """Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and calibrations."""
    if list_:
        _list(json)
        return
    if robot is None:
        raise typer.BadParameter("missing", param_hint="--robot")
    if out is None:
        raise typer.BadParameter("missing", param_hint="--out")
    if device is not None:
        _with_device(
            robot,
            out,
            device,
            json,
            {"also": also, "wanted": wanted, "plan": plan},
            {
                "random": random,
                "payload": payload,
                "seed": seed,
                "robot_seed": robot_seed,
                "cell": cell,
                "coupling": coupling,
            }
            | {"only": None if not only else () if only == ["none"] else only, "without": without or ()}
            | {"noise": None if noise is None else noise * 1e-3, "base_link": base_link, "tip_link": tip_link},
        )
        return
    if noise is not None:
        raise typer.BadParameter("only --device has one: a tracker's noise is an effect", param_hint="--noise-mm")
    if (plan is None) == (random is None):
        raise typer.BadParameter("give either a program or plan, or --random", param_hint="PLAN")
    if only and without:
        raise typer.BadParameter("--only and --without exclude each other", param_hint="--only")
    if (wanted is None) != (calibration is None):
        raise typer.BadParameter("--wanted and --calibration go together", param_hint="--wanted")
    place = _place(tracker)

    from irbcal.errors import OptionError
    from irbcal.simulation import simulation

    try:
        simulated = simulation.simulate(
            robot,
            plan,
            random=random,
            seed=seed,
            **({} if robot_seed is None else {"robot_seed": robot_seed}),
            payload=payload,
            only=None if not only else () if only == ["none"] else only,
            without=without or (),
            also=also or (),
            cell=cell,
            targets=int(targets) if targets.isdigit() else [name.strip() for name in targets.split(",")],
            tracker=place,
            wait=wait,
            wanted=wanted,
            calibration=calibration,
            tool=program_words.frames(tool, "--tool", _maker(plan) if tool else None),
            wobj=program_words.frames(wobj, "--wobj", _maker(plan) if wobj else None),
            pulses=program_words.pulses(pulses),
            where=program_words.where(where, _maker(plan) if where else None),
            base_link=base_link,
            tip_link=tip_link,
            coupling=coupling,
        )
    except OptionError as error:
        raise typer.BadParameter(str(error), param_hint=f"--{error.parameter}") from None
    measured, truth = simulated.save(out)
    if json:
        show.print_json({"out": str(measured), "truth": str(truth), **simulated.to_dict()})
        return
    show.tell([*simulated.told(), f"Written to {measured}, the truth to {truth}"])


def _with_device(
    robot: str, out: Path, device: str, json: bool, foreign: dict[str, Any], options: dict[str, Any]
) -> None:
    """Measure with a device in place of a tracker, write, tell."""
    from irbcal.errors import OptionError
    from irbcal.simulation.device_simulation import simulate_device

    for name, value in foreign.items():
        if value:
            hint = "PLAN" if name == "plan" else f"--{name}"
            raise typer.BadParameter("--device does not take it: its poses are at its features", param_hint=hint)
    try:
        result = simulate_device(robot, device, **{name: value for name, value in options.items() if value is not None})
    except OptionError as error:
        raise typer.BadParameter(str(error), param_hint=f"--{error.parameter}") from None
    rows, features, truth = result.save(out)
    if json:
        paths = {"out": str(rows), "features_out": str(features), "truth": str(truth)}
        show.print_json({**paths, **result.to_dict()})
        return
    show.tell([*result.told(), f"Written to {rows}, what is known of the features to {features}, the truth to {truth}"])


def _maker(program: Path | None) -> Maker | None:
    """How six numbers of a frame are meant."""
    from irbcal.correction.languages import files_of

    return None if program is None else files_of([program])[0].MAKER


def _list(json: bool) -> None:
    from irbcal.simulation.effects import ALL

    if json:
        show.print_json([{"name": e.name, "summary": e.summary, "parameters": e().parameters()} for e in ALL])
        return
    width = max(len(effect.name) for effect in ALL)
    show.tell([f"{effect.name:{width}}  {effect.summary}" for effect in ALL])


def _place(text: str | None) -> list[float] | None:
    """The tracker's place in metres."""
    from irbcal.units import MM

    if text is None:
        return None
    try:
        values = [float(word) * MM for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3:
        raise typer.BadParameter(f"expected x,y,z in mm, found {text!r}", param_hint="--tracker")
    return values
