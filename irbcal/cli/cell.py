"""``irbcal cell``: tools and work objects by the calibrated robot, from touches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import program_words, show
from irbcal.cli.program_words import PROGRAM_FLAGS, PROGRAM_TEXTS, PROGRAM_TYPED
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import PLACE, Typed, command, public

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.cell.cell_file import Notation
    from irbcal.io.controller_model import ControllerFrames

MAKERS = "kuka, abb, fanuc, yaskawa, kawasaki, staubli or ur"
NAMES = "tool", "wobj"
FOR_PROGRAMS = {"program", "pulses", "where", "controller_model"}
"""Options that say how to read programs."""


TOUCH = "FRAME NAME POINT [TOOL]=TARGET,…"
"""How touches are typed whose joints stand in a program."""


@command(
    "cell_frames program_touches",
    arguments=("calibration", "touches"),
    typed=PROGRAM_TYPED | {"payload_place": PLACE, "program": Typed(list[Path], "PATH")},
    flags=PROGRAM_FLAGS,
    without=("out",),
    optional=("touches", "program"),
    texts=PROGRAM_TEXTS
    | {
        "touches": "Touches (CSV or Parquet): frame, name, point, tool, q1_deg … (with --program: target), at will "
        "x_mm, y_mm, z_mm, u95_mm, kind, radius_mm and tracker_x_mm ….",
        "program": "Program or position list with points that were taught at touches (repeat for more files).",
        "tool": "What the controller has for a tool: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion), or with --as or "
        "--program six numbers as the maker writes them.",
        "wobj": "Likewise for a work object (base, user frame).",
    },
)
def cell(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(help="File for the cell, such as cell.json.")],
    as_: Annotated[
        str | None,
        typer.Option(
            "--as",
            help=f"Write frames as this maker does: {MAKERS}.",
            metavar="MAKER",
        ),
    ] = None,
    declare: Annotated[
        Path | None,
        typer.Option(
            help="File for the true tools and work objects as this maker declares them: TOOL_DATA, tooldata, .TRANS, "
            "… to load, of fanuc and yaskawa a list to type in.",
        ),
    ] = None,
    urdf: Annotated[
        Path | None,
        typer.Option(help="File for the URDF of the whole cell: calibrated robot, axes, tools, work objects."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="File for a page of the cell: frames with intervals, axes, touches with residuals (HTML)."),
    ] = None,
    touch: Annotated[
        list[str] | None,
        typer.Option(
            help="Points of --program that are touches, in place of a file: 'tool 1 socket=P1,P2,P3', "
            "'work_object 1 origin 1=P4' (touched with tool 1; repeat for more).",
            metavar=TOUCH,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Compute tools and work objects with the calibrated robot from touches, and how far off the controller's are."""
    from irbcal.atomic import write_set
    from irbcal.cell.cell_urdf import with_cell
    from irbcal.correction import languages
    from irbcal.correction.declarations import DECLARATIONS, declared
    from irbcal.io.calibration_folder import read
    from irbcal.io.controller_model import controller_frames
    from irbcal.modeling import frames
    from irbcal.overwriting import refuse_overwriting

    calibration = options.pop("calibration")
    if as_ is not None and as_ not in DECLARATIONS:
        raise typer.BadParameter(f"expected {MAKERS}, found {as_!r}", param_hint="--as")
    if declare is not None and as_ is None:
        raise typer.BadParameter("for which maker? say it with --as", param_hint="--declare")
    programs = options.get("program", [])
    for name in () if programs else sorted(FOR_PROGRAMS & options.keys()):
        raise typer.BadParameter("it goes with --program", param_hint=f"--{name.replace('_', '-')}")
    touches = _touches(options.pop("touches", None), touch, bool(programs))
    refuse_overwriting(
        {"out": out, "declare": declare, "urdf": urdf, "report": report}, [touches], programs, calibration
    )
    maker = None if as_ is None else languages.by_name()[DECLARATIONS[as_].language].MAKER
    program_maker = languages.files_of(programs).language.MAKER if programs else maker
    tools, work_objects = (program_words.frames(options.pop(name, None), f"--{name}", program_maker) for name in NAMES)
    saved = read(calibration)
    robot = saved.record.robot
    ends = controller_frames(saved.urdf, "calibrated.urdf", robot.base_link, robot.tip_link)
    if programs:
        program_words.read_frames(options, programs)
        taken = {name: options.pop(name) for name in FOR_PROGRAMS & options.keys()}
        touches, tools, work_objects = public("program_touches")(
            calibration, touches, tool=tools, wobj=work_objects, **taken
        )
    else:
        tools = {name: ends.T_tip_flange @ T for name, T in tools.items()}
        work_objects = {name: ends.T_base_world @ T for name, T in work_objects.items()}
    cell_file = public("cell_frames")(calibration, touches, tool=tools, wobj=work_objects, **options)
    to_controller = frames.inverse(ends.T_tip_flange), frames.inverse(ends.T_base_world)
    contents: dict[Path, bytes] = {}
    if declare is not None and as_ is not None:
        true = [
            {name: T @ one.T_true for name, one in named.items()}
            for T, named in zip(to_controller, (cell_file.tools, cell_file.work_objects), strict=True)
        ]
        contents[declare] = declared(as_, *true).encode()
    if urdf is not None:
        contents[urdf] = with_cell(saved.urdf, saved.record.arm(), cell_file)
    if report is not None:
        contents[report] = cell_file.page().encode()
    write_set(contents)
    cell_file.save(out)
    if json:
        show.print_json(cell_file.to_dict())
        return
    show.tell(cell_file.report() if as_ is None else cell_file.report(_notation(as_, ends, to_controller)))
    show.say(f"Written to {out}: irbcal filter {calibration} PROGRAM --cell {out}")
    if declare is not None:
        show.say(f"Written to {declare}: frames of the controller, for irbcal filter --controller-frames from-cell")
    if report is not None:
        show.say(f"Written to {report}: the cell as a page")
    if urdf is not None:
        show.say(f"Written to {urdf}: the whole cell, joints of external axes within the touches")


def _touches(file: Path | None, typed: list[str] | None, of_program: bool) -> Any:
    """The touches of a file, or a table of those that were typed."""
    import pandas as pd

    from irbcal.correction import languages

    if file is not None and typed:
        raise typer.BadParameter("touches stand in a file or are typed, not both", param_hint="--touch")
    if file is None and (not typed or not of_program):
        message = (
            "missing: give a file, or points of a --program with --touch" if not typed else "it goes with --program"
        )
        raise typer.BadParameter(message, param_hint="--touch" if typed else "TOUCHES")
    if file is not None:
        endings = {ending: one.NAME for one in languages.known() for ending in one.ENDINGS if one.NAME != "CSV"}
        if (language := endings.get(file.suffix.lower())) is not None:
            message = f"this is {language}: name it with --program, and its points that are touches with --touch"
            raise typer.BadParameter(message, param_hint="TOUCHES")
        return file
    rows = []
    for text in typed or ():
        words, _, targets = text.partition("=")
        names, points = words.split(), [target.strip() for target in targets.split(",")]
        if len(names) not in (3, 4) or not all(points):
            raise typer.BadParameter(f"expected {TOUCH}, found {text!r}", param_hint="--touch")
        rows += [(*names[:3], names[3] if len(names) == 4 else "", point) for point in points]
    return pd.DataFrame(rows, columns=["frame", "name", "point", "tool", "target"])


def _notation(name: str, ends: ControllerFrames, to_controller: tuple[FloatArray, FloatArray]) -> Notation:
    """How a maker's controllers write frames, and what they count from."""
    from irbcal.cell.cell_file import TOOL, Notation
    from irbcal.correction import declarations
    from irbcal.units import MM

    maker = declarations.maker_of(name)

    def numbers(frame: str, T: FloatArray) -> list[float]:
        return declarations.numbers(maker, to_controller[0 if frame == TOOL else 1] @ T)

    flange = "the flange" if ends.flange_known else "the URDF's tip link"
    base = "the controller's base" if ends.base_known else "the URDF's base link"
    unit, digits = ("mm", 6 if len(maker.orientation.names) == 4 else 4) if maker.length == MM else ("m", 6)
    names = ("x", "y", "z", *maker.orientation.names)
    return Notation(names, numbers, f"as {name} writes them, {unit}, in {flange} and {base}", digits)
