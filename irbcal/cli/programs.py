"""Robot programs and cells: ``irbcal filter``, ``cell``; how frames, joints and pulses of programs are typed."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from irbcal.cli import show
from irbcal.cli.signature import LOST_JOINTS, MM, PLACE, Command, Json, Typed, for_function, numbers, public
from irbcal.correction.known_languages import MAKERS
from irbcal.units import DEG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from irbcal.arrays import FloatArray
    from irbcal.correction.maker import Maker


NAMED_FRAME = "NAME=…"
"""How a named frame is typed."""
JOINTS = numbers("J1,…,J6", 6, units=[DEG])
PROGRAM_TYPED = {
    "program": Typed(list[Path], "PATH"),
    "start": JOINTS,
    "posture": JOINTS,
    "ignored_calls": Typed(list[str], "ROUTINE"),
    "pulses": numbers("P1,…,P6", 6),
    "where": Typed(str, "J1,…,J6=X,Y,Z,O,A,T"),
    "tool": Typed(list[str], NAMED_FRAME),
    "wobj": Typed(list[str], NAMED_FRAME),
}
PROGRAM_FLAGS = {"wobj": "--wobj --frame"}
PROGRAM_TEXTS = {
    "tool": "A tool as the controller has it, where no program defines it: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion), or "
    "six numbers as the maker writes them.",
    "wobj": "Likewise a work object (base, user frame).",
    "where": "For poses of Kawasaki programs, what the controller shows at one place with null tool and base: "
    "J1,J2,J3,J4,J5,J6=X,Y,Z,O,A,T.",
}
"""How tools, work objects and pulses of programs are typed, and their explanations."""
FLAGS_OF_FRAMES = {"tool": "--tool", "wobj": "--wobj (--frame)"}
LARGEST_MM = 1e6
"""Of a tool or work object; a kilometre is none."""


def read_frames(options: dict[str, Any], program: Any, maker_name: str | None = None) -> None:
    """Read typed tools, work objects and the place, in place, as the program's language (or a maker) writes them."""
    from irbcal.correction.backup import unpacked
    from irbcal.correction.languages import files_of, of_maker

    given = [name for name in ("tool", "wobj", "where") if name in options]
    if not given:
        return
    files = program if isinstance(program, list) else [] if program is None else [program]
    with unpacked(files) as opened:
        usual = None if maker_name is None else of_maker(maker_name).six_numbers
        maker = files_of(opened.programs).language.six_numbers if files else usual
    for name in given:
        read = (
            where(options[name], maker)
            if name == "where"
            else named_frames(options[name], FLAGS_OF_FRAMES[name], maker)
        )
        options[name] = read


def named_frames(texts: list[str] | None, option: str, maker: Maker | None) -> dict[str, FloatArray]:
    """Frames from the command line, dict of name to (4, 4) in metres."""
    import numpy as np

    from irbcal.correction.maker import FARTHEST_TOOL
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
            if maker.seem_millimetres(values[:3], FARTHEST_TOOL):
                raise typer.BadParameter(
                    f"expected a position in metres, as programs have it, found {text!r}", param_hint=option
                )
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


@Command(
    "correct",
    arguments=("calibration", "program"),
    typed=PROGRAM_TYPED | {"payload_centre": PLACE, "path_tolerance": MM},
    flags=PROGRAM_FLAGS,
    without=("out",),
    panels={"Everyday": ("tool", "wobj", "page", "json")},
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
    from irbcal.correction.corrected_program import NotWritten

    read_frames(options, options["program"])
    refusal = None
    try:
        with show.progress(1, quiet=json or not show.long_file(*options["program"])) as step:
            result = public("correct")(**options, out=out, progress=step)
    except NotWritten as error:
        result, refusal = error.filtered, error
    if page is not None and result.shifts is not None:
        show.warn("no page was written: it shows every target, and the table is too long for that")
    elif page is not None and len(result.targets):
        from irbcal.viewer.program_page import program_view

        program_view(options["calibration"], result).save(page)
    show.result(result, json)
    if refusal is not None:
        show.warn(str(refusal))
        raise typer.Exit(3 if options.get("strict") and result.unknown_frames is not None else 1)


TOUCH = "FRAME NAME POINT [TOOL]=TARGET,…"
"""How touches are typed whose joints stand in a program."""


@Command(
    "cell_frames",
    arguments=("calibration", "touches"),
    typed=PROGRAM_TYPED
    | {
        "payload_centre": PLACE,
        "refit_zeros": LOST_JOINTS,
        "as_": Typed(Literal[MAKERS], f"<{' | '.join(MAKERS)}>"),
    },
    flags=PROGRAM_FLAGS,
    without=("out",),
    optional=("touches",),
    panels={"Everyday": ("touch", "interactive", "json")},
    texts=PROGRAM_TEXTS
    | {
        "touches": "Touches (CSV, XLSX, Parquet): frame, name, point, tool, q1_deg … (with --program: target), "
        "optionally x_mm, y_mm, z_mm, u95_mm, kind, radius_mm and tracker_x_mm …; or a backup: its tools, work objects "
        "and the touches to make, which --out takes.",
    },
)
def cell(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(help="File for the cell, such as cell.json.")],
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
    from irbcal.correction.cell_frames import notation
    from irbcal.correction.opened_programs import opened_calibration

    calibration, backup = options["calibration"], options.get("touches")
    if backup is not None and (backup.is_dir() or backup.suffix.lower() == ".zip"):
        options["program"] = [options.pop("touches"), *options.get("program", [])]
    programs = options.get("program", [])
    if programs and "touches" not in options and not touch:
        _needed(options, out, json)
        return
    if interactive:
        if programs or touch or "touches" not in options:
            raise typer.BadParameter("expected the touches file alone, such as touches.csv", param_hint="--interactive")
        _type_touches(options["touches"], opened_calibration(calibration).record.arm().joint_columns)
    options["touches"] = _touches(options.pop("touches", None), touch, bool(programs))
    maker = options.get("as_")
    read_frames(options, programs, maker)
    result = public("cell_frames")(**options, out=out)
    if json:
        show.print_json(result.to_dict())
        return
    show.tell(result.report(notation(opened_calibration(calibration), maker)))
    show.say(f"Written to {out}: irbcal filter {calibration} PROGRAM --cell {out}")
    for name, words in (
        ("declare", "frames of the controller, for irbcal filter --controller-frames from-cell"),
        ("report", "the cell as a page"),
        ("urdf", "the whole cell, joints of external axes within the touches"),
    ):
        if name in options:
            show.say(f"Written to {options[name]}: {words}")


def _type_touches(path: Path, joints: Sequence[str]) -> None:
    """Ask for touches until an empty line; the file has each as soon as it was typed."""
    import pandas as pd

    from irbcal.measurement.input_table import InputTable
    from irbcal.names import csv_bytes
    from irbcal.overwriting import replacing
    from irbcal.safe_files import write_set

    table = pd.DataFrame(columns=["frame", "name", "point", "tool"])
    if path.exists():
        table = InputTable.read(path, table.columns.tolist()).cells
    show.say(
        "Each touch: frame name point tool (tool 1 socket, work_object 1 origin 1), then what the controller shows."
    )
    typed_words: list[str] = []
    while True:
        usual = f" [{' '.join(typed_words)}]" if typed_words else ""
        typed = input(f"touch {len(table) + 1}{usual}, . ends: ").split() or typed_words
        if typed == ["."]:
            return
        if len(typed) not in (3, 4) or typed[0] not in ("tool", "work_object"):
            show.say("expected such as: tool 1 socket, or work_object 1 origin 1")
            continue
        typed_words = typed
        of_cad = typed_words[0] == "work_object" and typed_words[2] not in ("origin", "x", "xy")
        values = _typed_numbers(f"{', '.join(joints)}: ", len(joints))
        xyz = _typed_numbers("x, y, z of the point in the work object, mm: ", 3) if of_cad else []
        row = {**dict(zip(("frame", "name", "point", "tool"), [*typed_words, typed_words[1]], strict=False))}
        row |= dict(zip([*joints, "x_mm", "y_mm", "z_mm"], [*values, *xyz], strict=False))
        table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
        with replacing():  # the rows that it had stand in it
            write_set({path: csv_bytes(table)})


def _typed_numbers(question: str, count: int) -> list[str]:
    """So many numbers, with blanks or commas between them."""
    while True:
        typed_words = input(question).replace(",", " ").split()
        with suppress(ValueError):
            if len(typed_words) == count and [float(word) for word in typed_words]:
                return typed_words
        show.say(f"expected {count} numbers, found {len(typed_words)} words: {' '.join(typed_words)[:60]}")


def _needed(options: dict[str, Any], out: Path, json: bool) -> None:
    """Tell which tools and work objects programs use, and write a table of the touches that would make them true."""
    from irbcal.names import csv_bytes
    from irbcal.safe_files import write_set

    words = "it goes with touches; of programs alone the touches to make are listed"
    for_function("needed_touches", options, words)
    read_frames(options, options["program"])
    needed = public("needed_touches")(**options)
    if needed.frames:
        write_set({out: csv_bytes(needed.touches())})
    written = [f"Written to {out}: the touches to make, joints are to be filled in"] if needed.frames else []
    show.result(needed, json, *written)


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
        endings = {
            ending: each.name for each in languages.all_languages() for ending in each.endings if each.name != "CSV"
        }
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
