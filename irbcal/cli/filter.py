"""``irbcal filter``: a robot program in, the same program with fake targets out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import program_words, show
from irbcal.cli.program_words import PROGRAM_FLAGS, PROGRAM_TEXTS, PROGRAM_TYPED
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import MM, PLACE, Typed, command, numbers, public
from irbcal.units import DEG

if TYPE_CHECKING:
    from irbcal.correction.filtered import Filtered


JOINTS = numbers("J1,…,J6", 6, units=[DEG])


@command(
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
        "Everyday": ("allow_partial", "changes", "path_tolerance", "payload", "payload_place", "json"),
        "Tools and work objects": ("cell", "tool", "wobj", "controller_frames", "frames_measured", "strict"),
        "Points": ("points", "re_express", "start", "posture", "instructions", "harmless"),
        "Controllers": ("controller_model", "pulses", "where"),
    },
    texts=PROGRAM_TEXTS,
)
def filter_program(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(help="File for the program with fake targets; of several files, a folder.")],
    json: Json = False,
) -> None:
    """Replace a program's targets so that the controller with its nominal model reaches the true poses."""
    from irbcal.correction.filter import NotWritten

    program_words.read_frames(options, options["program"])
    refused, strict = False, options.get("strict", False)
    try:
        result = public("correct")(**options, out=out)
    except NotWritten as refusal:
        result, refused = refusal.filtered, True
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
        "corrected": len(result.targets),
        "left": [target._asdict() for target in result.left],
        "notes": [note._asdict() for note in result.notes],
        "cautions": list(result.cautions),
        "mean_shift_mm": float(result.shift.mean() / MM) if corrected else None,
        "max_shift_mm": float(result.shift.max() / MM) if corrected else None,
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
