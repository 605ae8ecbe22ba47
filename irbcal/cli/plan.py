"""``irbcal plan``: which poses to measure, and the files that carry them out."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

Axis = Enum("Axis", {name: name for name in ("18", "158", "0")}, type=str)
Criterion = Enum("Criterion", {name: name for name in ("position", "D")}, type=str)
Volume = Enum("Volume", {name: name for name in ("both", "cube", "range")}, type=str)
Condition = Enum(
    "Condition", {name: name for name in ("limits", "height", "acceptance", "collision", "sight", "way")}, type=str
)
SHOWN_NAMES = {"axis": "axis moves", "iso_cube": "ISO cube", "all_range": "all range"}


def plan(
    out: Annotated[Path, typer.Option(help="Folder for the plan.", show_default=False)],
    robot: Annotated[
        str, typer.Option(help="URDF, shipped robot (irb1600, irb120) or calibration folder.")
    ] = "irb1600",
    axis: Annotated[
        Axis | None,
        typer.Option(help="Moves of one joint: three poses a joint (18), many (158) or none (0).", show_default="18"),
    ] = None,
    cube: Annotated[int | None, typer.Option(min=0, help="Random poses in the ISO cube.", show_default="52")] = None,
    all_range: Annotated[
        int | None, typer.Option(min=0, help="Random poses in the whole range.", show_default="50")
    ] = None,
    optimal: Annotated[
        int,
        typer.Option(min=0, help="Poses chosen out of many candidates; other kinds then only where asked for."),
    ] = 0,
    candidates: Annotated[int, typer.Option(min=2, max=100_000, help="Candidates for --optimal.")] = 2000,
    criterion: Annotated[
        Criterion, typer.Option(help="What is best: predicted positions, or all parameters together (D).")
    ] = Criterion.position,
    volume: Annotated[Volume, typer.Option(help="Where predicted positions count.")] = Volume.both,
    level: Annotated[
        str | None, typer.Option(help="Error model to plan for.", show_default="34, placement for other arms")
    ] = None,
    targets: Annotated[
        str | None,
        typer.Option(
            help="Reflectors: a CSV (target,x_mm,y_mm,z_mm in the tip link and, at will, nx,ny,nz: where they look); "
            "or how many of the thesis tool's nine, or their names with commas.",
            show_default="3, or the calibration's",
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            help="Tracker in the base link, x,y,z in mm, and at will the turn of its axes about z in degrees.",
            show_default="as in the thesis's cell, or as for the calibration",
        ),
    ] = None,
    cube_centre: Annotated[
        str | None, typer.Option(help="x,y,z in mm.", show_default="the largest cube in front")
    ] = None,
    cube_edge: Annotated[float | None, typer.Option(help="In mm.", show_default=False)] = None,
    margin_deg: Annotated[float, typer.Option(min=0.0, help="From the joint limits (10 mm each on rails).")] = 2.0,
    acceptance_deg: Annotated[
        float, typer.Option(min=1.0, max=90.0, help="Largest angle between reflector and beam.")
    ] = 30.0,
    min_height: Annotated[
        str | None,
        typer.Option(
            help="Lowest z of tool and reflectors, mm: in front (x from 150) and at the back, as FRONT,BACK.",
            show_default="700,1100 for the irb1600, none for others",
        ),
    ] = None,
    without: Annotated[list[Condition] | None, typer.Option(help="Condition to switch off (repeat for more).")] = None,
    payload: Annotated[
        float | None, typer.Option(min=0.0, help="kg; goes into the plan's table.", show_default=False)
    ] = None,
    wait_s: Annotated[float, typer.Option(min=0.0, max=3600.0, help="Rest before a measurement.")] = 4.0,
    references: Annotated[
        int, typer.Option(min=0, max=20, help="References on the floor to measure in each pose, too: they take time.")
    ] = 3,
    speed: Annotated[float, typer.Option(min=1.0, max=7000.0, help="Of the tool, mm/s.")] = 500.0,
    noise_mm: Annotated[
        float, typer.Option(min=1e-4, max=10.0, help="Standard deviation of a measured coordinate.")
    ] = 0.1,
    seed: Annotated[int, typer.Option(min=0, help="Of the random poses.")] = 0,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(help="Folder in which package:// names of meshes are looked up; repeatable.", show_default=False),
    ] = None,
    base_link: Annotated[str | None, typer.Option(help="Base link of a URDF.", show_default=False)] = None,
    tip_link: Annotated[str | None, typer.Option(help="Tip link of a URDF.", show_default=False)] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Plan measurements: poses that the robot reaches and the tracker sees, a RAPID module, and what they promise."""
    from irbcal.files.atomic import check_writable, write_together
    from irbcal.planning import measuring_plan, plan_files
    from irbcal.units import DEG, MM

    made_folders = check_writable(out)
    try:
        with show.progress(12, quiet=json) as step:
            step("robot")
            scene = measuring_plan.open_scene(
                robot,
                targets,
                _tracker(tracker),
                [item.value for item in without or ()],
                margin_deg * DEG,
                acceptance_deg * DEG,
                _numbers(min_height, (2,), "--min-height", "FRONT,BACK in mm"),
                _cube(cube_centre, cube_edge),
                package_dir or (),
                base_link,
                tip_link,
            )
            usual = {"axis": Axis["18"], "cube": 52, "all_range": 50} if not optimal else {}
            given = {"axis": axis, "cube": cube, "all_range": all_range}
            counts = {name: usual.get(name, 0) if value is None else value for name, value in given.items()}
            wish = measuring_plan.Wish(
                axis=int(getattr(counts["axis"], "value", counts["axis"])),
                cube=counts["cube"],
                all_range=counts["all_range"],
                optimal=optimal,
                candidates=candidates,
                criterion=criterion.value,
                volume=volume.value,
                level=level,
                noise=noise_mm * MM,
                wait_s=wait_s,
                references=references,
                speed=speed * MM,
                payload_kg=payload,
                seed=seed,
            )
            made = measuring_plan.make(scene, wish, step)
            step("files")
            page = _page(made, package_dir or ())
            contents = plan_files.files(made, page)
            write_together(out, contents)
    except BaseException:
        for folder in made_folders:  # innermost first; those that are still empty were made for nothing
            try:
                folder.rmdir()
            except OSError:
                break
        raise
    result = {"out": str(out), "files": list(contents), **plan_files.summary(made)}
    if json:
        show.print_json(result)
    else:
        _print(result, out)


def _page(made, package_dirs):
    """The plan to look at: robot, tracker, cube, reflectors and their way; HTML."""
    from dataclasses import replace

    from irbcal.modeling import frames
    from irbcal.viewer.scene import Points
    from irbcal.viewer.view import View, view

    scene, setting = made.scene, made.scene.setting
    base, tip = scene.links
    shown = view(scene.name, plan=made.q, package_dir=package_dirs, cube=scene.cube, base_link=base, tip_link=tip).scene
    pose, target, xyz, _ = made.expected()
    T_scene_world = frames.inverse(scene.T_world_base)
    return View(
        replace(
            shown,
            robot=setting.robot.replace(T_world_base=scene.T_world_base),
            targets=dict(zip(setting.targets.names, setting.targets.places, strict=True)),
            points=Points(pose, target, frames.apply(T_scene_world, xyz)),
            groups=made.groups,
            path=_way(made),
            T_scene_world=T_scene_world,
            tracker=True,
        )
    ).html


def _way(made):
    """Way of the first reflector from pose to pose in the base link, (k, 3), metres."""
    from irbcal.planning import route

    setting = made.scene.setting
    if len(made.q) < 2:
        return None
    q, _ = route.between(made.q[:-1], made.q[1:], setting.arm.table.prismatic)
    return setting.places(q)[1][:, 0]


def _numbers(text, counts, option, expected, unit=1e-3):
    """Numbers with commas between them; None for None."""
    if text is None:
        return None
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(abs(value) < 1e6 for value in values):
        raise typer.BadParameter(f"expected {expected}, found {text!r}", param_hint=option)
    return [value * unit for value in values]


def _tracker(text):
    from irbcal.units import DEG, MM

    values = _numbers(text, (3, 4), "--tracker", "x,y,z in mm and at will a turn in degrees", 1.0)
    return values and [*(value * MM for value in values[:3]), *(value * DEG for value in values[3:])]


def _cube(centre, edge):
    if (centre is None) != (edge is None):
        raise typer.BadParameter("--cube-centre and --cube-edge go together", param_hint="--cube-centre")
    if centre is None:
        return None
    if not 0 < edge < 1e5:
        raise typer.BadParameter(f"expected an edge above zero in mm, found {edge:g}", param_hint="--cube-edge")
    return _numbers(centre, (3,), "--cube-centre", "x,y,z in mm"), edge * 1e-3


def _print(result, out):
    show.say(
        f"{result['robot']}: {result['poses']} poses, {result['points']} points, about "
        f"{result['duration_s'] / 60:.0f} minutes"
    )
    _print_counts(result)
    if result["conditions_off"]:
        show.say(f"Conditions that are off: {', '.join(result['conditions_off'])}")
    predicted = result["predicted"]
    single = sum(item["state"] == "identified" for item in predicted["parameters"])
    show.say(
        f"Model {predicted['model']}, scatter of {predicted['noise_mm']:g} mm a coordinate: {single} of "
        f"{len(predicted['parameters'])} parameters identified by themselves;"
    )
    where = {"cube": "in the cube", "range": "in the whole range"}
    for name, std in predicted["position_std_mm"].items():
        show.say(
            f"  positions of {predicted['position_target']} {where[name]} predicted to {std['rms']:.3f} mm "
            f"(at worst {std['max']:.3f} mm)"
        )
    show.say("  These are standard deviations from scatter alone; what the model does not describe is not in them.")
    if compared := result["compared_with_random"]:
        same, most = compared["as_good_as_random_poses"], compared["random"][-1]["poses"]
        show.say(
            f"By the criterion {compared['criterion']}, the {compared['optimal']['poses']} chosen poses are as good as "
            f"{f'about {same}' if same else f'more than {most}'} random ones of the same candidates."
        )
    for text in result["notes"]:
        show.note(text)
    show.say(f"Written to {out}: {', '.join(result['files'])}")


def _print_counts(result):
    from rich import box
    from rich.console import Console
    from rich.table import Table

    counts = result["counts"]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("candidates")
    for source in counts:
        table.add_column(_words(source), justify="right")
    table.add_row("looked at", *(f"{tally['tried']:,}" for tally in counts.values()))
    for name in ("place", *result["conditions"]):
        removed = [tally["removed"].get(name) for tally in counts.values()]
        words = "outside the cube" if name == "place" else f"removed by {name}"
        table.add_row(words, *("" if count is None else f"{count:,}" for count in removed))
    table.add_row("left", *(f"{tally['kept']:,}" for tally in counts.values()), style="bold")
    Console(markup=False).print(table)


def _words(source):
    for name, words in SHOWN_NAMES.items():
        source = source.replace(name, words)
    return source
