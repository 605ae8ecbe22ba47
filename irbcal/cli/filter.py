"""``irbcal filter``: a robot program in, the same program with fake targets out."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import grid, program_words, show
from irbcal.cli.shared_options import Calibration, Json, Payload, PayloadPlace

if TYPE_CHECKING:
    from irbcal.correction.filtered import Filtered
    from irbcal.correction.true_frames import ControllerNumbers

FRAMES = "Tools, work objects, points"


class NumbersChoice(str, Enum):
    """Which numbers the controller will have for tools and work objects."""

    same = "same"
    from_cell = "from-cell"

    @property
    def literal(self) -> ControllerNumbers:
        """As `irbcal.correct` takes it."""
        return "same" if self is NumbersChoice.same else "from-cell"


def filter_program(
    calibration: Calibration,
    program: Annotated[
        list[Path],
        typer.Argument(
            help="Program: RAPID, KRL or another language of docs/programs.md, or CSV of joints or poses; several "
            "files of one language, or a folder.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(help="File for the program with fake targets; of several files, a folder.", show_default=False),
    ],
    allow_partial: Annotated[
        bool, typer.Option("--allow-partial", help="Write it even if some targets could not be corrected.")
    ] = False,
    changes: Annotated[
        Path | None, typer.Option(help="Write what changed, target by target, as CSV.", show_default=False)
    ] = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(
            help="A tool the program does not define: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion), or six numbers as the "
            "language writes them; likewise"
        ),
    ] = None,
    wobj: Annotated[
        list[str] | None, typer.Option("--wobj", "--frame", help="a work object (base, user frame) in the base frame.")
    ] = None,
    payload: Payload = None,
    payload_place: PayloadPlace = None,
    pulses: Annotated[
        str | None,
        typer.Option(help="Pulses per degree of the six joints, with commas, for Yaskawa jobs.", show_default=False),
    ] = None,
    controller_model: Annotated[
        Path | None,
        typer.Option(
            help="What the controller itself computes with, where that is not the nominal robot: a URDF (irbcal "
            "controller writes it), or ur_description's calibration YAML.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    where: Annotated[
        str | None,
        typer.Option(
            help="For poses of Kawasaki programs, what the controller shows at one place with null tool and base: "
            "J1,J2,J3,J4,J5,J6=X,Y,Z,O,A,T.",
            show_default=False,
        ),
    ] = None,
    path_tolerance: Annotated[
        float | None,
        typer.Option(
            help="Put points into straight and circular moves, so that the tool leaves the wanted path by less than so "
            "many mm (RAPID).",
            show_default=False,
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            help="True tools and work objects, as irbcal cell writes them: corrections stand for these.",
            metavar="FILE",
            show_default=False,
            rich_help_panel=FRAMES,
        ),
    ] = None,
    controller_frames: Annotated[
        NumbersChoice,
        typer.Option(
            help="Which numbers the controller will have for tools and work objects: the same as now, or those "
            "from-cell.",
            rich_help_panel=FRAMES,
        ),
    ] = NumbersChoice.same,
    points: Annotated[
        str | None,
        typer.Option(
            help="offline: coordinates of points are wanted; taught: they were shown on the real robot and stay; "
            "taught:PATTERN: those with such names.",
            metavar="KIND",
            show_default="offline",
            rich_help_panel=FRAMES,
        ),
    ] = None,
    re_express: Annotated[
        bool,
        typer.Option(
            "--re-express",
            help="Rewrite taught points as offline points of the true frames; correct nothing.",
            rich_help_panel=FRAMES,
        ),
    ] = False,
    frames_measured: Annotated[
        bool,
        typer.Option(
            "--frames-measured",
            help="Tools and work objects (others than the cell's) were measured independently of the robot: by CAD, by "
            "tracker.",
            rich_help_panel=FRAMES,
        ),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Write nothing, with exit code 3, where a tool or work object is of unknown origin.",
            rich_help_panel=FRAMES,
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Replace a program's targets so that the controller with its nominal model reaches the true poses."""
    from irbcal.correction.filter import NotWritten, correct
    from irbcal.correction.languages import files_of

    maker = files_of(program)[0].MAKER
    tools = program_words.frames(tool, "--tool", maker)
    work_objects = program_words.frames(wobj, "--wobj", maker)
    refused = False
    try:
        found = correct(
            calibration,
            program,
            out=out,
            allow_partial=allow_partial,
            changes=changes,
            tool=tools,
            wobj=work_objects,
            payload=payload,
            payload_place=grid.metres(payload_place, "--payload-place"),
            pulses=program_words.pulses(pulses),
            controller_model=controller_model,
            where=program_words.where(where, maker),
            path_tolerance=None if path_tolerance is None else path_tolerance * 1e-3,
            cell=cell,
            controller_frames=controller_frames.literal,
            points=points,
            re_express=re_express,
            frames_measured=frames_measured,
            strict=strict,
        )
    except NotWritten as refusal:
        found, refused = refusal.filtered, True
    if json:
        show.print_json(_content(found))
    else:
        show.tell(found.told())
    if strict and found.unknown_frames is not None:
        show.warn("nothing was written: tools or work objects are of unknown origin (--strict)")
        raise typer.Exit(3)
    if refused:
        some = len(found.targets) > 0
        why = "correct these targets or call again with --allow-partial" if some else "no target could be corrected"
        why += f", {found.unchanged} need no change" if found.unchanged and not some else ""
        show.warn(f"nothing was written: {why}")
        raise typer.Exit(1)


def _content(found: Filtered) -> dict[str, Any]:
    from irbcal.units import MM

    some = len(found.targets) > 0
    return {
        "out": None if found.written is None else str(found.written),
        "corrected": len(found.targets),
        "left": [item._asdict() for item in found.left],
        "notes": [note._asdict() for note in found.notes],
        "cautions": list(found.cautions),
        "mean_shift_mm": float(found.shift.mean() / MM) if some else None,
        "max_shift_mm": float(found.shift.max() / MM) if some else None,
        "expected_error_mm": None if found.expected_error is None else found.expected_error / MM,
        "unknown_frames": None if found.unknown_frames is None else found.unknown_frames.to_dict(),
        "unchanged": found.unchanged,
        **_part(found),
        **_last_moves(found),
        "fingerprint": found.fingerprint,
        **({} if found.paths is None else {"paths": found.to_dict()["paths"]}),
    }


def _part(found: Filtered) -> dict[str, Any]:
    """The expected error of the part over all targets; nothing where it is not known."""
    frame = found.to_frame()
    if "part_mean_mm" not in frame:
        return {}
    return {"part_mean_mm": float(frame["part_mean_mm"].mean()), "max_part_u95_mm": float(frame["part_u95_mm"].max())}


def _last_moves(found: Filtered) -> dict[str, Any]:
    """What is known of last moves; nothing for calibrations that do not depend on them."""
    from irbcal.units import MM

    if found.last_moves is None or found.last_move_error is None:
        return {}
    expected = found.expected_errors
    return {
        "last_moves_known": found.last_moves[0],
        "stops": found.last_moves[1],
        "max_last_move_mm": float(found.last_move_error.max(initial=0.0) / MM),
        "expected_with_last_moves_mm": None if expected is None or not expected.size else float(expected.mean() / MM),
    }
