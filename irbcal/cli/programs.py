"""Robot programs and cells: ``irbcal filter``, ``cell``; how frames and pulses are typed."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import LOST_JOINTS, MM, PLACE, Command, Json, Typed, numbers, public
from irbcal.correction.known_languages import MAKERS
from irbcal.units import DEG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from irbcal.arrays import FloatArray
    from irbcal.cell.cell_file import Notation
    from irbcal.correction.filtered import Filtered
    from irbcal.correction.maker import Maker
    from irbcal.io.controller_model import ControllerFrames


NAMED = "NAME=…"
"""How a named frame is typed."""
PROGRAM_TYPED = {
    "pulses": numbers("P1,…,P6", 6),
    "where": Typed(str, "J1,…,J6=X,Y,Z,O,A,T"),
    "tool": Typed(list[str], NAMED),
    "wobj": Typed(list[str], NAMED),
}
PROGRAM_FLAGS = {"wobj": "--wobj --frame"}
PROGRAM_TEXTS = {
    "tool": "A tool the program does not define: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion), or six numbers as the "
    "language writes them.",
    "wobj": "Likewise a work object (base, user frame) in the base frame.",
    "where": "For poses of Kawasaki programs, what the controller shows at one place with null tool and base: "
    "J1,J2,J3,J4,J5,J6=X,Y,Z,O,A,T.",
}
"""How tools, work objects and pulses of programs are typed, and their explanations."""
LARGEST_MM = 1e6
"""Of a tool or work object; a kilometre is none."""


def read_frames(options: dict[str, Any], program: Any) -> None:
    """Read the tools, work objects and the place that were typed as the program's language writes them, in place."""
    from irbcal.correction.backup import unpacked
    from irbcal.correction.languages import files_of

    given = [name for name in ("tool", "wobj", "where") if name in options]
    if not given:
        return
    files = program if isinstance(program, list) else [] if program is None else [program]
    with unpacked(files) as opened:
        maker = files_of(opened.programs).language.six_numbers if files else None
    for name in given:
        read = where(options[name], maker) if name == "where" else named_frames(options[name], f"--{name}", maker)
        options[name] = read


def named_frames(texts: list[str] | None, option: str, maker: Maker | None) -> dict[str, FloatArray]:
    """Frames from the command line, dict of name to (4, 4) in metres."""
    import numpy as np

    from irbcal.correction.notation import poses_from_numbers

    out = {}
    for text in texts or ():
        name, _, numbers = text.partition("=")
        try:
            values = [float(value) for value in numbers.split(",")]
        except ValueError:
            values = []
        if not (np.abs(values) < LARGEST_MM).all():  # nan, too
            values = []
        if name and len(values) == 6 and maker is not None:
            out[name.lower()] = maker.poses(np.array([values]))[0]
            continue
        if not name or len(values) != 7 or abs(sum(v * v for v in values[3:]) - 1) > 1e-3:
            expected = "NAME=x,y,z,q1,q2,q3,q4"
            if maker is not None:
                expected += f" or NAME=x,y,z,{','.join(maker.orientation.names)}"
            raise typer.BadParameter(f"expected {expected}, found {text!r}", param_hint=option)
        out[name.lower()] = poses_from_numbers([values])[0]
    return out


def where(text: str, maker: Maker | None) -> tuple[FloatArray, FloatArray]:
    """Joints in radians and the pose that a controller shows there, ``J1,…,J6=X,Y,Z,O,A,T``."""
    import numpy as np

    try:
        pieces = [[float(value) for value in piece.split(",")] for piece in text.split("=")]
    except ValueError:
        pieces = []
    sizes = [len(piece) for piece in pieces]
    if maker is None or sizes != [6, 6] or not (np.abs(np.array(pieces)) < LARGEST_MM).all():
        raise typer.BadParameter(f"expected J1,…,J6=X,Y,Z,O,A,T, found {text!r}", param_hint="--where")
    return np.array(pieces[0]) * maker.joint, maker.poses(np.array([pieces[1]]))[0]


JOINTS = numbers("J1,…,J6", 6, units=[DEG])


@Command(
    "correct",
    arguments=("calibration", "program"),
    typed=PROGRAM_TYPED
    | {
        "program": Typed(list[Path], "PATH"),
        "payload_place": PLACE,
        "path_tolerance": MM,
        "start": JOINTS,
        "posture": JOINTS,
        "harmless": Typed(list[str], "ROUTINE"),
    },
    flags=PROGRAM_FLAGS,
    without=("out",),
    panels={
        "Everyday": ("allow_partial", "changes", "page", "path_tolerance", "payload", "payload_place", "json"),
        "Tools and work objects": ("cell", "tool", "wobj", "controller_frames", "frames_measured", "strict"),
        "Points": ("points", "re_express", "start", "posture", "instructions", "harmless", "split_points"),
        "Controllers": ("controller_model", "pulses", "where"),
    },
    texts=PROGRAM_TEXTS,
)
def filter_program(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(help="File for the program with fake targets; of several files, a folder.")],
    page: Annotated[
        Path | None, typer.Option(help="File for a page (HTML) with all targets before and after, and what was left.")
    ] = None,
    json: Json = False,
) -> None:
    """Replace a program's targets so that the controller with its nominal model reaches the true poses."""
    from irbcal.correction.filtered import NotWritten
    from irbcal.safe_files import refuse_overwriting

    refuse_overwriting({"out": out, "page": page}, options["program"], options["calibration"])
    read_frames(options, options["program"])
    refused, strict = False, options.get("strict", False)
    try:
        with show.progress(1, quiet=json or not show.long_file(*options["program"])) as step:
            result = public("correct")(**options, out=out, progress=step)
    except NotWritten as refusal:
        result, refused = refusal.filtered, True
    if page is not None and result.shifts is not None:
        show.warn("no page was written: it shows every target, and the table is too long for that")
    elif page is not None and len(result.targets):
        from irbcal.viewer.program_page import program_view

        program_view(options["calibration"], result).save(page)
    if json:
        show.print_json(_content(result))
    else:
        show.tell(result.report())
    if strict and result.unknown_frames is not None:
        show.warn("nothing was written: tools or work objects are of unknown origin (--strict)")
        raise typer.Exit(3)
    if refused:
        any_corrected = len(result.targets) > 0
        reason = (
            "correct these targets or call again with --allow-partial"
            if any_corrected
            else "no target could be corrected"
        )
        reason += f", {result.unchanged} need no change" if result.unchanged and not any_corrected else ""
        show.warn(f"nothing was written: {reason}")
        raise typer.Exit(1)


def _content(result: Filtered) -> dict[str, Any]:
    from irbcal.units import MM

    corrected = len(result.targets) > 0
    return {
        "out": None if result.written is None else str(result.written),
        "corrected": len(result.all_shifts),
        "left": [target._asdict() for target in result.left],
        "notes": [note._asdict() for note in result.notes],
        "cautions": list(result.cautions),
        "mean_shift_mm": float(result.all_shifts.mean() / MM) if corrected else None,
        "max_shift_mm": float(result.all_shifts.max() / MM) if corrected else None,
        "expected_error_mm": None if result.expected_error is None else result.expected_error / MM,
        "unknown_frames": None if result.unknown_frames is None else result.unknown_frames.to_dict(),
        "unchanged": result.unchanged,
        **_part(result),
        **_last_moves(result),
        "fingerprint": result.fingerprint,
        **({} if result.paths is None else {"paths": result.to_dict()["paths"]}),
    }


def _part(result: Filtered) -> dict[str, Any]:
    """The expected error of the part over all targets; nothing where it is not known."""
    frame = result.to_frame()
    if "part_mean_mm" not in frame:
        return {}
    return {"part_mean_mm": float(frame["part_mean_mm"].mean()), "max_part_u95_mm": float(frame["part_u95_mm"].max())}


def _last_moves(result: Filtered) -> dict[str, Any]:
    """What is known of last moves; nothing for calibrations that do not depend on them."""
    from irbcal.units import MM

    if result.last_moves is None or result.last_move_error is None:
        return {}
    expected = result.expected_errors
    return {
        "last_moves_known": result.last_moves[0],
        "stops": result.last_moves[1],
        "max_last_move_mm": float(result.last_move_error.max(initial=0.0) / MM),
        "expected_with_last_moves_mm": None if expected is None or not expected.size else float(expected.mean() / MM),
    }


MAKER_NAMES = f"{', '.join(MAKERS[:-1])} or {MAKERS[-1]}"
NAMES = "tool", "wobj"
FOR_PROGRAMS = {"program", "pulses", "where", "controller_model"}
"""Options that say how to read programs."""


TOUCH = "FRAME NAME POINT [TOOL]=TARGET,…"
"""How touches are typed whose joints stand in a program."""


@Command(
    "cell_frames program_touches",
    arguments=("calibration", "touches"),
    typed=PROGRAM_TYPED | {"payload_place": PLACE, "program": Typed(list[Path], "PATH"), "refit_zeros": LOST_JOINTS},
    flags=PROGRAM_FLAGS,
    without=("out",),
    optional=("touches", "program"),
    texts=PROGRAM_TEXTS
    | {
        "touches": "Touches (CSV or Parquet): frame, name, point, tool, q1_deg … (with --program: target), at will "
        "x_mm, y_mm, z_mm, u95_mm, kind, radius_mm and tracker_x_mm …; or a backup: its tools, work objects "
        "and the touches to make, which --out takes.",
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
            help=f"Write frames as this maker does: {MAKER_NAMES}.",
            metavar="MAKER",
        ),
    ] = None,
    declare: Annotated[
        Path | None,
        typer.Option(
            help="File for the true tools and work objects as this maker declares them: TOOL_DATA, tooldata, .TRANS, "
            "… to load, of fanuc a listing that sets UTOOL and UFRAME, of yaskawa a list to type in.",
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
    interactive: Annotated[
        bool,
        typer.Option(
            help="Type touches one after the other; each is added to the touches file, which may be a new one."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Compute tools and work objects with the calibrated robot from touches, and how far off the controller's are."""
    from irbcal.cell.cell_file import AS_URDF
    from irbcal.cell.cell_urdf import with_cell
    from irbcal.correction import languages
    from irbcal.correction.declarations import declared
    from irbcal.io.calibration_folder import read
    from irbcal.io.controller_model import controller_frames
    from irbcal.modeling import frames
    from irbcal.safe_files import refuse_overwriting, write_set

    calibration = options.pop("calibration")
    if as_ is not None and as_ not in MAKERS:
        raise typer.BadParameter(f"expected {MAKER_NAMES}, found {as_!r}", param_hint="--as")
    if declare is not None and as_ is None:
        raise typer.BadParameter("for which maker? say it with --as", param_hint="--declare")
    folder = options.get("touches")
    if folder is not None and (folder.is_dir() or folder.suffix.lower() == ".zip"):
        options["program"] = [options.pop("touches"), *options.get("program", [])]
    programs = options.get("program", [])
    if programs and "touches" not in options and not touch:
        _needed(calibration, options, out, json)
        return
    for name in () if programs else sorted(FOR_PROGRAMS & options.keys()):
        raise typer.BadParameter("it goes with --program", param_hint=f"--{name.replace('_', '-')}")
    if interactive:
        if programs or touch or "touches" not in options:
            raise typer.BadParameter("expected the touches file alone, such as touches.csv", param_hint="--interactive")
        _type_touches(options["touches"], read(calibration).record.arm().joint_columns)
    touches = _touches(options.pop("touches", None), touch, bool(programs))
    refuse_overwriting(
        {"out": out, "declare": declare, "urdf": urdf, "report": report}, [touches], programs, calibration
    )
    maker = None if as_ is None else languages.of_maker(as_).six_numbers
    program_maker = languages.files_of(programs).language.six_numbers if programs else maker
    tools, work_objects = (named_frames(options.pop(name, None), f"--{name}", program_maker) for name in NAMES)
    saved = read(calibration)
    robot = saved.record.robot
    ends = controller_frames(saved.urdf, "calibrated.urdf", robot.base_link, robot.tip_link)
    if programs:
        read_frames(options, programs)
        taken = {name: options.pop(name) for name in FOR_PROGRAMS & options.keys()}
        touches, tools, work_objects = public("program_touches")(
            calibration, touches, tool=tools, wobj=work_objects, **taken
        )
    else:
        tools = {name: ends.T_tip_flange @ T for name, T in tools.items()}
        work_objects = {name: ends.T_base_world @ T for name, T in work_objects.items()}
    cell_file = public("cell_frames")(calibration, touches, tool=tools, wobj=work_objects, **options)
    to_controller = frames.inverse(ends.T_tip_flange), frames.inverse(ends.T_base_world)
    notation = AS_URDF if as_ is None else _notation(as_, ends, to_controller)
    contents: dict[Path, bytes] = {}
    if declare is not None and as_ is not None:
        true = [
            {name: T @ one.T_true for name, one in named.items()}
            for T, named in zip(to_controller, (cell_file.tools, cell_file.work_objects), strict=True)
        ]
        reverse = {
            name for named in (cell_file.tools, cell_file.work_objects) for name, one in named.items() if one.fixed_tool
        }
        contents[declare] = declared(as_, true[0], true[1], reverse).encode()
    if urdf is not None:
        contents[urdf] = with_cell(saved.urdf, saved.record.arm(), cell_file)
    if report is not None:
        contents[report] = cell_file.page(notation=notation).encode()
    write_set(contents)
    cell_file.save(out)
    if json:
        show.print_json(cell_file.to_dict())
        return
    show.tell(cell_file.report(notation))
    show.say(f"Written to {out}: irbcal filter {calibration} PROGRAM --cell {out}")
    if declare is not None:
        show.say(f"Written to {declare}: frames of the controller, for irbcal filter --controller-frames from-cell")
    if report is not None:
        show.say(f"Written to {report}: the cell as a page")
    if urdf is not None:
        show.say(f"Written to {urdf}: the whole cell, joints of external axes within the touches")


def _type_touches(path: Path, joints: Sequence[str]) -> None:
    """Ask for touches until an empty line; the file has each as soon as it was typed."""
    import pandas as pd

    from irbcal.errors import MeasurementError
    from irbcal.measurement.columns import parse_csv
    from irbcal.names import csv_bytes
    from irbcal.safe_files import read_bytes, write_set

    table = pd.DataFrame(columns=["frame", "name", "point", "tool"])
    if path.exists():
        table = parse_csv(read_bytes(path, MeasurementError), str(path), table.columns.tolist())
    show.say(
        "Each touch: frame name point tool (tool 1 socket, work_object 1 origin 1), then what the controller shows."
    )
    words: list[str] = []
    while True:
        usual = f" [{' '.join(words)}]" if words else ""
        typed = input(f"touch {len(table) + 1}{usual}, . ends: ").split() or words
        if typed == ["."]:
            return
        if len(typed) not in (3, 4) or typed[0] not in ("tool", "work_object"):
            show.say("expected such as: tool 1 socket, or work_object 1 origin 1")
            continue
        words = typed
        of_cad = words[0] == "work_object" and words[2] not in ("origin", "x", "xy")
        values = _typed_numbers(f"{', '.join(joints)}: ", len(joints))
        xyz = _typed_numbers("x, y, z of the point in the work object, mm: ", 3) if of_cad else []
        row = {**dict(zip(("frame", "name", "point", "tool"), [*words, words[1]], strict=False))}
        row |= dict(zip([*joints, "x_mm", "y_mm", "z_mm"], [*values, *xyz], strict=False))
        table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
        write_set({path: csv_bytes(table)})


def _typed_numbers(question: str, count: int) -> list[str]:
    """So many numbers, with blanks or commas between them."""
    while True:
        words = input(question).replace(",", " ").split()
        with suppress(ValueError):
            if len(words) == count and [float(word) for word in words]:
                return words
        show.say(f"expected {count} numbers, found {len(words)} words: {' '.join(words)[:60]}")


def _needed(calibration: Path, options: dict[str, Any], out: Path, json: bool) -> None:
    """Tell which tools and work objects programs use, and write a table of the touches that would make them true."""
    from irbcal.names import csv_bytes
    from irbcal.safe_files import refuse_overwriting, write_set

    if rest := sorted(options.keys() - FOR_PROGRAMS - {*NAMES}):
        message = "it goes with touches; of programs alone the touches to make are listed"
        raise typer.BadParameter(message, param_hint=f"--{rest[0].replace('_', '-')}")
    refuse_overwriting({"out": out}, options["program"], calibration)
    read_frames(options, options["program"])
    needed = public("needed_touches")(calibration, **options)
    if needed.frames:
        write_set({out: csv_bytes(needed.touches())})
    if json:
        show.print_json(needed.to_dict())
        return
    show.tell(needed.report())
    if needed.frames:
        show.say(f"Written to {out}: the touches to make, joints are to be filled in")


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
        endings = {ending: one.name for one in languages.known() for ending in one.endings if one.name != "CSV"}
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
    from irbcal.correction import declarations, languages
    from irbcal.units import MM

    maker = languages.of_maker(name).maker
    assert maker is not None, name

    def numbers(frame: str, T: FloatArray) -> list[float]:
        return declarations.numbers(maker, to_controller[0 if frame == TOOL else 1] @ T)

    flange = "the flange" if ends.flange_known else "the URDF's tip link"
    base = "the controller's base" if ends.base_known else "the URDF's base link"
    unit, digits = ("mm", 6 if len(maker.orientation.names) == 4 else 4) if maker.length == MM else ("m", 6)
    names = ("x", "y", "z", *maker.orientation.names)
    return Notation(names, numbers, f"as {name} writes them, {unit}, in {flange} and {base}", digits)
