"""``irbcal plan``: which poses to measure, and the files that carry them out."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import program_words, show
from irbcal.cli.shared_options import BaseLink, Coupling, Json, TipLink


class Axis(str, Enum):
    """Numbers of axis moves."""

    few, many, none = "18", "158", "0"


class Criterion(str, Enum):
    """What optimal poses are chosen for."""

    position, determinant = "position", "D"


class Volume(str, Enum):
    """Where predicted positions count."""

    both, cube, range = "both", "cube", "range"


class Condition(str, Enum):
    """Conditions of poses."""

    limits, height, acceptance, collision, sight, way = "limits", "height", "acceptance", "collision", "sight", "way"


class PlanLanguage(str, Enum):
    """Languages that a plan can be written in, see `irbcal.correction.languages.by_name`."""

    rapid, krl, fanuc, urscript = "rapid", "krl", "fanuc", "urscript"
    val3, inform, kawasaki, csv = "val3", "inform", "kawasaki", "csv"


_Out = Annotated[
    Path | None, typer.Option(help="Folder for the plan; needed but for --compare-devices.", show_default=False)
]
_Device = Annotated[
    str | None,
    typer.Option(
        help="Poses for a device in place of a tracker: balls, string, ballbar, two-balls, sockets, ball, camera or "
        "plane.",
        show_default=False,
    ),
]
_Poses = Annotated[
    int | None,
    typer.Option(min=5, max=100_000, help="With --device and --compare-devices.", show_default="100; 25, 50 and 100"),
]
_Compare = Annotated[
    bool,
    typer.Option(
        "--compare-devices", help="Predict what a tracker and each device would leave of the position error, and stop."
    ),
]
_Prior = Annotated[
    float | None,
    typer.Option(
        "--prior-mm",
        min=0.001,
        max=100.0,
        help="With --device and --compare-devices: position error from the geometry before any measurement, root mean "
        "square over the whole range.",
        show_default="what natural sizes of its errors make",
    ),
]
_Robot = Annotated[
    str, typer.Option(help="URDF, a robot's name (see irbcal robots) or calibration folder.", show_default=False)
]
_Axis = Annotated[
    Axis | None,
    typer.Option(help="Moves of one joint: three poses a joint (18), many (158) or none (0).", show_default="18"),
]
_Cube = Annotated[int | None, typer.Option(min=0, help="Random poses in the ISO cube.", show_default="52")]
_AllRange = Annotated[int | None, typer.Option(min=0, help="Random poses in the whole range.", show_default="50")]
_Optimal = Annotated[
    int,
    typer.Option(min=0, help="Poses chosen out of many candidates; other kinds then only where asked for."),
]
_Candidates = Annotated[
    int | None,
    typer.Option(min=2, max=100_000, help="Candidates for --optimal and --device.", show_default="2000; 600"),
]
_Criterion = Annotated[
    Criterion, typer.Option(help="What is best: predicted positions, or all parameters together (D).")
]
_Volume = Annotated[Volume, typer.Option(help="Where predicted positions count.")]
_Level = Annotated[
    str | None, typer.Option(help="Error model to plan for.", show_default="34, placement for other arms")
]
_Targets = Annotated[
    str | None,
    typer.Option(
        help="Reflectors: a CSV (target,x_mm,y_mm,z_mm in the tip link and, at will, nx,ny,nz: where they look); "
        "or how many of the thesis tool's nine, or their names with commas.",
        show_default="3, or the calibration's",
    ),
]
_Tracker = Annotated[
    str | None,
    typer.Option(
        help="Tracker in the base link, x,y,z in mm, and at will the turn of its axes about z in degrees.",
        show_default="as in the thesis's cell, or as for the calibration",
    ),
]
_CubeCentre = Annotated[str | None, typer.Option(help="x,y,z in mm.", show_default="the largest cube in front")]
_CubeEdge = Annotated[float | None, typer.Option(help="In mm.", show_default=False)]
_Margin = Annotated[float, typer.Option("--margin-deg", min=0.0, help="From the joint limits (10 mm each on rails).")]
_Acceptance = Annotated[
    float | None,
    typer.Option(
        "--acceptance-deg",
        min=1.0,
        max=180.0,
        help="Largest angle between reflector and beam, up to 90; with --device of the tool's axis with surface, bar, "
        "string, or of a camera's view with the board's normal.",
        show_default="30; 60 to touch, 90 for a ballbar, 120 for strings, 50 for a camera",
    ),
]
_Approach = Annotated[
    float | None,
    typer.Option(
        "--approach-mm",
        min=0.0,
        max=1000.0,
        help="With --device: last part of the way to a feature, along the tool's axis, that must be free.",
        show_default="50",
    ),
]
_MinHeight = Annotated[
    str | None,
    typer.Option(
        help="Lowest z of tool and reflectors, mm: in front (x from 150) and at the back, as FRONT,BACK.",
        show_default="700,1100 for the irb1600, none for others",
    ),
]
_Without = Annotated[list[Condition] | None, typer.Option(help="Condition to switch off (repeat for more).")]
_Payload = Annotated[float | None, typer.Option(min=0.0, help="kg; goes into the plan's table.", show_default=False)]
_WaitS = Annotated[float, typer.Option(min=0.0, max=3600.0, help="Rest before a measurement.")]
_References = Annotated[
    int, typer.Option(min=0, max=20, help="References on the floor to measure in each pose, too: they take time.")
]
_Speed = Annotated[float, typer.Option(min=1.0, max=7000.0, help="Of the tool, mm/s.")]
_Noise = Annotated[
    float, typer.Option("--noise-mm", min=1e-4, max=10.0, help="Standard deviation of a measured coordinate.")
]
_Seed = Annotated[int, typer.Option(min=0, help="Of the random poses.")]
_Language = Annotated[
    PlanLanguage | None,
    typer.Option(help="Of the robot program; csv: none.", show_default="that of the maker, by the robot's name"),
]
_Pulses = Annotated[
    str | None,
    typer.Option(help="Pulses per degree of the six joints, with commas, for Yaskawa jobs.", show_default=False),
]
_PackageDirs = Annotated[
    list[Path] | None,
    typer.Option(
        "--package-dir",
        help="Folder in which package:// names of meshes are looked up; repeatable.",
        show_default=False,
    ),
]


def plan(
    robot: _Robot,
    out: _Out = None,
    device: _Device = None,
    poses: _Poses = None,
    compare_devices: _Compare = False,
    prior: _Prior = None,
    axis: _Axis = None,
    cube: _Cube = None,
    all_range: _AllRange = None,
    optimal: _Optimal = 0,
    candidates: _Candidates = None,
    criterion: _Criterion = Criterion.position,
    volume: _Volume = Volume.both,
    level: _Level = None,
    targets: _Targets = None,
    tracker: _Tracker = None,
    cube_centre: _CubeCentre = None,
    cube_edge: _CubeEdge = None,
    margin: _Margin = 2.0,
    acceptance: _Acceptance = None,
    approach: _Approach = None,
    min_height: _MinHeight = None,
    without: _Without = None,
    payload: _Payload = None,
    wait_s: _WaitS = 4.0,
    references: _References = 3,
    speed: _Speed = 500.0,
    noise: _Noise = 0.1,
    seed: _Seed = 0,
    language: _Language = None,
    pulses: _Pulses = None,
    package_dirs: _PackageDirs = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    json: Json = False,
) -> None:
    """Plan measurements: poses that the robot reaches and the tracker sees, a robot program, and what they promise."""
    links = {"base_link": base_link, "tip_link": tip_link, "coupling": coupling}
    if compare_devices:
        _compare(robot, poses, prior, seed, json, links)
        return
    if out is None:
        raise typer.BadParameter("missing", param_hint="--out")
    if device is not None:
        from irbcal.units import DEG, MM

        values = {"candidates": candidates, "acceptance": acceptance, "approach": approach, "prior": prior}
        units = {"acceptance": DEG, "approach": MM, "prior": MM}
        options = {name: value * units.get(name, 1) for name, value in values.items() if value is not None}
        more: dict[str, Any] = {"seed": seed, "margin": margin * DEG, "package_dirs": package_dirs or ()}
        _device(robot, out, device, poses or 100, json, options | more | links)
        return
    if poses is not None:
        raise typer.BadParameter("is for --device and --compare-devices", param_hint="--poses")
    if approach is not None:
        raise typer.BadParameter("is for --device", param_hint="--approach-mm")
    if prior is not None:
        raise typer.BadParameter("is for --device and --compare-devices", param_hint="--prior-mm")
    if acceptance is not None and acceptance > 90.0:
        raise typer.BadParameter(
            f"a reflector cannot be seen from behind: expected 90 or less without --device, found {acceptance:g}",
            param_hint="--acceptance-deg",
        )
    position = _tracker(tracker)
    heights = _numbers(min_height, 2, "--min-height", "FRONT,BACK in mm")
    centre, edge = _cube(cube_centre, cube_edge)

    from irbcal.units import DEG, MM

    _run(
        out,
        json,
        robot,
        axis=None if axis is None else int(axis.value),
        cube=cube,
        all_range=all_range,
        optimal=optimal,
        candidates=2000 if candidates is None else candidates,
        criterion=criterion.value,
        volume=volume.value,
        level=level,
        targets=targets,
        tracker=position,
        cube_centre=centre,
        cube_edge=edge,
        margin=margin * DEG,
        acceptance=(30.0 if acceptance is None else acceptance) * DEG,
        min_height=None if heights is None else (heights[0], heights[1]),
        without=[condition.value for condition in without or ()],
        payload=payload,
        wait_s=wait_s,
        references=references,
        speed=speed * MM,
        noise=noise * MM,
        seed=seed,
        language=None if language is None else language.value,
        pulses=program_words.pulses(pulses),
        package_dirs=package_dirs or (),
        base_link=base_link,
        tip_link=tip_link,
        coupling=coupling,
    )


def _compare(robot: str, poses: int | None, prior: float | None, seed: int, json: bool, links: dict[str, Any]) -> None:
    """Tell what each device would leave."""
    from irbcal.planning import device_comparison
    from irbcal.units import MM

    counts = device_comparison.POSES if poses is None else (poses,)
    with show.progress(9, quiet=json) as step:
        size = None if prior is None else prior * MM
        result = device_comparison.compare_devices(robot, counts, prior=size, seed=seed, progress=step, **links)
    if json:
        show.print_json(result.to_dict())
    else:
        show.tell(result.told())


def _device(robot: str, out: Path, device: str, poses: int, json: bool, options: dict[str, Any]) -> None:
    """Choose poses at a device, write, tell."""
    from irbcal.errors import OptionError
    from irbcal.planning.device_plan import device_plan

    try:
        with show.progress(4, quiet=json) as step:
            device_poses = device_plan(robot, device, poses, progress=step, **options)
    except OptionError as error:
        raise typer.BadParameter(str(error), param_hint=f"--{error.parameter}") from None
    files = [path.name for path in device_poses.save(out)]
    if json:
        show.print_json({"out": str(out), "files": files, **device_poses.to_dict()})
    else:
        show.tell([*device_poses.told(), f"Written to {out}: {', '.join(files)}"])


def _run(out: Path, json: bool, robot: str, **options: Any) -> None:
    """Make, write and print a plan; a folder that had to be made for it goes where there is none."""
    from irbcal.atomic import check_writable
    from irbcal.planning import measuring_plan
    from irbcal.viewer import plan_page

    made_folders = check_writable(out)
    try:
        with show.progress(12, quiet=json) as step:
            step("robot")
            result = measuring_plan.plan(robot, progress=step, **options)
            step("files")
            try:
                page = plan_page.page(result)
            except ModuleNotFoundError as error:
                if error.name != "meshcat":
                    raise
                page = None
                typer.echo("irbcal: plan.html is not written, as it needs meshcat: pip install meshcat", err=True)
            files = [path.name for path in result.save(out, page)]
    except BaseException:
        for folder in made_folders:  # innermost first; those that are still empty were made for nothing
            try:
                folder.rmdir()
            except OSError:
                break
        raise
    if json:
        show.print_json({"out": str(out), "files": files, **result.to_dict()})
    else:
        show.tell([*result.told(), f"Written to {out}: {', '.join(files)}"])


def _numbers(text: str | None, counts: int | tuple[int, ...], option: str, expected: str) -> list[float] | None:
    """Numbers with commas between them, millimetres, as metres; a fourth one is degrees and becomes radians."""
    from irbcal.units import DEG, MM

    if text is None:
        return None
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    allowed = (counts,) if isinstance(counts, int) else counts
    if len(values) not in allowed or not all(abs(value) < 1e6 for value in values):
        raise typer.BadParameter(f"expected {expected}, found {text!r}", param_hint=option)
    return [value * (MM if k < 3 else DEG) for k, value in enumerate(values)]


def _tracker(text: str | None) -> list[float] | None:
    return _numbers(text, (3, 4), "--tracker", "x,y,z in mm and at will a turn in degrees")


def _cube(centre: str | None, edge: float | None) -> tuple[list[float] | None, float | None]:
    if (centre is None) != (edge is None):
        raise typer.BadParameter("--cube-centre and --cube-edge go together", param_hint="--cube-centre")
    if edge is None:
        return None, None
    if not 0 < edge < 1e5:
        raise typer.BadParameter(f"expected an edge above zero in mm, found {edge:g}", param_hint="--cube-edge")
    return _numbers(centre, 3, "--cube-centre", "x,y,z in mm"), edge * 1e-3
