"""``irbcal simulate``: measure in a virtual cell."""

from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

MOSTLY_HIDDEN = 0.2


def simulate(
    plan: Annotated[
        Path | None,
        typer.Argument(
            help="CSV of joints to command (q1_deg …), such as a plan or a filtered program; optional columns pose, "
            "group, cycle, targets (names with spaces between them), wait_s.",
            show_default=False,
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="URDF of the nominal robot, or a shipped one: irb1600 (tuned), irb120.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Measurement file to write; the truth goes beside it, as NAME.truth.json.", show_default=False
        ),
    ] = None,
    random: Annotated[
        int | None, typer.Option(min=1, help="That many random poses in the tracker's sight, in place of a plan.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the run: noise, repeatability, lost points, random poses.")] = 0,
    robot_seed: Annotated[
        int | None, typer.Option(min=0, help="Another robot: its link errors are drawn from this seed.")
    ] = None,
    payload: Annotated[
        float | None, typer.Option(min=0.0, help="Mass on the flange, kg; 3 by default, less for smaller arms.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(help="Only this effect (repeat for more); none: no effect at all.")
    ] = None,
    without: Annotated[list[str] | None, typer.Option(help="All effects but this one (repeat for more).")] = None,
    targets: Annotated[
        str, typer.Option(help="How many of the tool's nine reflectors, or their names with commas between them.")
    ] = "3",
    tracker: Annotated[
        str | None, typer.Option(help="Place of the tracker in the base link, x,y,z in mm.", show_default=False)
    ] = None,
    wait: Annotated[float, typer.Option(min=0.0, help="Seconds between stop and measurement.")] = 4.0,
    wanted: Annotated[
        Path | None,
        typer.Option(
            help="The program before it was filtered: tells how far the robot ends from it.", show_default=False
        ),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="With --wanted: the calibration it was filtered with.", show_default=False)
    ] = None,
    base_link: Annotated[str | None, typer.Option(help="Base link; base_link or the root by default.")] = None,
    tip_link: Annotated[
        str | None, typer.Option(help="Tip link; tool0, flange, ee_link or the last link by default.")
    ] = None,
    list_effects: Annotated[bool, typer.Option("--list", help="Name the effects and stop.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and calibrations."""
    from irbcal.cell.effects import EFFECTS, check_names

    if list_effects:
        _list(EFFECTS, json)
        return
    for value, name in ((robot, "--robot"), (out, "--out")):
        if value is None:
            raise typer.BadParameter("missing", param_hint=name)
    if (plan is None) == (random is None):
        raise typer.BadParameter("give either a file of joints or --random", param_hint="PLAN")
    if only and without:
        raise typer.BadParameter("--only and --without exclude each other", param_hint="--only")
    if (wanted is None) != (calibration is None):
        raise typer.BadParameter("--wanted and --calibration go together", param_hint="--wanted")

    from irbcal.cell import simulation
    from irbcal.cell.cell import ROBOT_SEED
    from irbcal.files import calibration_folder
    from irbcal.files.atomic import refuse_to_overwrite, write_together
    from irbcal.measurement.lists import read_joints
    from irbcal.measurement.statistics import statistics

    only = [] if only == ["none"] else only
    check_names([*(only or ()), *(without or ())])
    place = _place(tracker)
    cell = simulation.open_cell(
        robot, base_link, tip_link, seed=seed, robot_seed=ROBOT_SEED if robot_seed is None else robot_seed
    )
    cell = cell.with_targets(_targets(targets, cell.tool.names))
    cell = cell if only is None else cell.only(*only)
    cell = cell.without(*(without or ()))
    cell = cell if payload is None else cell.with_payload(payload)
    refuse_to_overwrite(out, plan, wanted)
    cell = cell if place is None else cell.replace(tracker=cell.tracker.moved(place))
    poses = (
        simulation.random_plan(cell, random, seed, wait) if plan is None else simulation.read_plan(plan, cell.arm, wait)
    )
    run = cell.measure(poses.q, simulation.asked(poses, cell), poses.wait_s)
    found = None
    if wanted is not None:
        saved = calibration_folder.load(calibration)
        found = statistics(simulation.misses(run, read_joints(wanted, cell.arm.joint_columns), saved))
    write_together(out.parent, simulation.files(run, poses, cell, out, robot))
    asked = int(run.asked[:, : run.targets].sum())
    result = {
        "out": str(out),
        "truth": str(out.parent / simulation.truth_name(out)),
        "robot": cell.arm.name,
        "simulated": True,
        "poses": len(run.q),
        "points": int(run.asked.sum()),
        "targets": list(cell.tool.names),
        "references": list(cell.references),
        "unseen": run.unseen,
        "payload_kg": run.payload_kg,
        "duration_s": float(run.time_s[-1].max()),
        "effects": list(cell.on),
        "seed": seed,
        "wanted": found,
    }
    if json:
        show.print_json(result)
        return
    show.say(
        f"SIMULATED: {len(run.q)} poses of {cell.arm.name} with {run.payload_kg:g} kg, {result['points']} points in "
        f"{result['duration_s'] / 60:.0f} minutes of the cell's time"
    )
    show.say(f"Effects: {', '.join(cell.on) or 'none'}")
    for name, count in run.unseen.items():
        show.say(f"  {count} points without a position: {name}")
    if found:
        show.statistics_table(
            "Distances from where the program wanted the targets", [("all targets", "commanded", found, True)]
        )
    show.say(f"Written to {out}, the truth to {result['truth']}")
    beyond = int(((poses.q < cell.arm.lower - 1e-9) | (poses.q > cell.arm.upper + 1e-9)).any(axis=1).sum())
    if beyond:
        show.note(f"{beyond} of {len(poses.q)} poses command joints beyond the limits of {cell.arm.name}")
    if run.unseen.get("visibility", 0) > MOSTLY_HIDDEN * asked:
        show.note(
            f"the tracker did not see {run.unseen['visibility']} of {asked} targets: --random chooses poses that it "
            "sees, --without visibility lets it see through everything"
        )


def _list(effects, json):
    if json:
        show.print_json([{"name": e.name, "summary": e.summary, "parameters": e().parameters()} for e in effects])
        return
    width = max(len(effect.name) for effect in effects)
    for effect in effects:
        show.say(f"{effect.name:{width}}  {effect.summary}")


def _targets(text, names):
    """Names of the targets to measure: the first so many, or those named."""
    if text.isdigit():
        if not 1 <= int(text) <= len(names):
            raise typer.BadParameter(
                f"expected 1 to {len(names)} targets or names, found {text}", param_hint="--targets"
            )
        return names[: int(text)]
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


def _place(text):
    """The tracker's place in metres."""
    from irbcal.units import MM

    if text is None:
        return None
    try:
        values = [float(part) * MM for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3:
        raise typer.BadParameter(f"expected x,y,z in mm, found {text!r}", param_hint="--tracker")
    return values
