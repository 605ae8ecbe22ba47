"""``irbcal filter``: a robot program in, the same program with fake targets out."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show

SHOWN = 10


def filter_program(
    calibration: Annotated[Path, typer.Argument(help="Calibration folder.", show_default=False)],
    program: Annotated[
        Path,
        typer.Argument(help="RAPID module (.mod, .prg, .sys, .modx), or CSV of joints or poses.", show_default=False),
    ],
    out: Annotated[Path, typer.Option(help="File for the program with fake targets.", show_default=False)],
    allow_partial: Annotated[
        bool, typer.Option("--allow-partial", help="Write it even if some targets could not be corrected.")
    ] = False,
    changes: Annotated[
        Path | None, typer.Option(help="Write what changed, target by target, as CSV.", show_default=False)
    ] = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(help="A tool the module does not define: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion); likewise"),
    ] = None,
    wobj: Annotated[list[str] | None, typer.Option(help="a work object in the base frame.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Replace a program's targets so that the controller with its nominal model reaches the true poses."""
    from irbcal.correction import filter as filters
    from irbcal.correction.languages import rapid, table
    from irbcal.files import calibration_folder
    from irbcal.files.atomic import refuse_to_overwrite, write_together
    from irbcal.units import MM

    refuse_to_overwrite(out, program)
    saved = calibration_folder.load(calibration)
    robot, nominal = saved.robot_calibrated(), saved.arm(calibrated=False)
    fingerprint = saved.calibrated_urdf_sha256[:16]
    if program.suffix.lower() == ".csv":
        found = filters.filter_table(robot, nominal, table.read(program, nominal.joint_columns), fingerprint)
    else:
        module = rapid.read(program, _frames(tool, "--tool"), _frames(wobj, "--wobj"))
        found = filters.filter_module(robot, nominal, module, fingerprint, rapid.mark)
    shifts = found.shifts / MM
    write = bool(len(shifts)) and (allow_partial or not found.left)
    if write:
        contents = {out.name: found.data}
        write_together(out.parent, contents)
        if changes:
            text = found.changes.to_csv(index=False, float_format="%.6f")
            write_together(changes.parent, {changes.name: text.encode()})
    expected = saved.heldout.all.mean_mm if saved.heldout else None
    if json:
        show.print_json(
            {
                "out": str(out) if write else None,
                "corrected": len(shifts),
                "left": [{"target": name, "line": line, "reason": reason} for name, line, reason in found.left],
                "notes": [{"line": line, "text": text} for line, text in found.notes],
                "mean_shift_mm": float(shifts.mean()) if len(shifts) else None,
                "max_shift_mm": float(shifts.max()) if len(shifts) else None,
                "expected_error_mm": expected,
                "fingerprint": fingerprint,
            }
        )
    else:
        _print(found, out, write, expected)
    if found.left and not allow_partial:
        print("irbcal: nothing was written: correct these targets or call again with --allow-partial", file=sys.stderr)
        raise typer.Exit(1)
    if not len(shifts):
        print("irbcal: nothing was written: no target could be corrected", file=sys.stderr)
        raise typer.Exit(1)


def _frames(given, option):
    """Frames from the command line, dict of name to (4, 4) in metres."""
    from irbcal.correction.program import poses_from_numbers

    out = {}
    for text in given or ():
        name, _, numbers = text.partition("=")
        try:
            values = [float(value) for value in numbers.split(",")]
        except ValueError:
            values = []
        if not name or len(values) != 7 or abs(sum(v * v for v in values[3:]) - 1) > 1e-3:
            raise typer.BadParameter(f"expected NAME=x,y,z,q1,q2,q3,q4, found {text!r}", param_hint=option)
        out[name.lower()] = poses_from_numbers([values])[0]
    return out


def _print(found, out, written, expected):
    from rich import box
    from rich.console import Console
    from rich.table import Table

    changes = found.changes
    if len(changes):
        slides = any(name.endswith("_mm") for name in found.joint_columns)
        view = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for name in (
            "target",
            "line",
            "shift mm",
            "turn deg",
            "largest joint change deg (mm)" if slides else "largest joint change deg",
        ):
            view.add_column(name, justify="left" if name == "target" else "right")
        for _, row in changes.head(SHOWN).iterrows():
            largest = max(abs(row[name] - row[f"{name}_before"]) for name in found.joint_columns)
            cells = (f"{row['shift_mm']:.3f}", f"{row['turn_deg']:.4f}", f"{largest:.4f}")
            view.add_row(str(row["target"]), str(row["line"]), *cells)
        Console(markup=False).print(view)
        if len(changes) > SHOWN:
            show.say(f"… and {len(changes) - SHOWN} more")
        shifts = changes["shift_mm"]
        show.say(
            f"{len(changes)} target{'s' if len(changes) != 1 else ''} corrected, by {shifts.mean():.3f} mm on average "
            f"and at most {shifts.max():.3f} mm"
        )
    if expected is not None:
        show.say(f"Expected error afterwards: {expected:.3f} mm mean, that of the calibration's held-out poses")
    for name, line, reason in found.left:
        show.say(f"  left as it was: {name} (line {line}): {reason}")
    for line, text in found.notes:
        show.note(f"line {line}: {text}")
    if written:
        show.say(f"Written to {out}")
