"""What a calibration is used for: ``irbcal fk``, ``ik``, ``export``, ``stream``, ``verify``, ``sign``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import PLACE, Command, Json, JsonLines, Typed, numbers_in, public
from irbcal.errors import IrbcalError


@Command(
    "forward_kinematics",
    arguments=("robot",),
    typed={"payload_centre": PLACE},
    flags={"q": "--joints"},
    panels={"Everyday": ("target", "intervals", "nominal", "payload", "json")},
)
def fk(options: dict[str, Any], json: JsonLines = False) -> None:
    """Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    result = public("forward_kinematics")(**options)
    if result.caution:
        show.warn(result.caution)
    show.print_rows(result.to_frame(as_written=not json), json)


@Command(
    "inverse_kinematics",
    arguments=("robot",),
    typed={"payload_centre": PLACE, "near": Typed(str, "J1,J2,…")},
    flags={"T_base_tip": "--poses"},
    panels={"Everyday": ("near", "path", "nominal", "payload", "json")},
)
def ik(options: dict[str, Any], json: JsonLines = False) -> None:
    """Joints to command so that a robot reaches poses of its tip, as CSV; empty joints and a note where it cannot.

    Columns of the input are kept, as given_NAME where the result has their name.
    """
    import numpy as np

    from irbcal.io.opening import open_robot

    how = {name: options.pop(name) for name in ("nominal", "base_link", "tip_link", "coupling") if name in options}
    opened = open_robot(options.pop("robot"), **how)
    if "near" in options:
        columns = opened.nominal.joint_columns
        typed = np.asarray(numbers_in(options["near"], [len(columns)], "--near", columns))
        options["near"] = opened.nominal.from_controller(typed * opened.nominal.joint_units).tolist()
    result = public("inverse_kinematics")(opened, **options)
    show.print_rows(result.to_frame(as_written=not json), json)
    for pose in result.singular:
        show.warn(pose.in_words())
    missing = len(result) - int(result.solved.sum())
    if missing:
        show.warn(f"{missing} of {len(result)} poses have no joints, see the column note")


@Command(
    "export",
    arguments=("calibration",),
    typed={"out": Typed(Path, "FOLDER"), "payload_centre": PLACE},
)
def export(options: dict[str, Any], json: Json = False) -> None:
    """Write the calibrated robot as a part of other programs, with test vectors and fingerprint inside."""
    show.result(public("export")(**options), json)


@Command(
    "stream",
    arguments=("calibration",),
    typed={
        "at": Typed(str, "J1,J2,…", lambda text, option: numbers_in(text, [text.count(",") + 1], option)),
        "payload_centre": PLACE,
    },
)
def stream(options: dict[str, Any]) -> None:
    """Correct wanted joints or poses, a line of JSON each, as they come; bring the arm to rest where one is not safe.

    Lines on standard input: {"joints": [...]}, {"pose": [...]} (x, y, z, qw, qx, qy, qz) or {"model": [...]}; the first
    one with "at": [...], the arm's actual joints, unless --at gives them.
    """
    from irbcal.exporting.live_correction import run

    if sys.stdin is None:
        raise IrbcalError("there is no standard input")
    live = public("stream")(**options)
    simulated = ", from SIMULATED measurements" if live.simulated else ""
    show.warn(f"ready, calibration {live.fingerprint}{simulated}")
    run(live, sys.stdin.buffer, sys.stdout.buffer, show.warn)


@Command("verify", arguments=("calibration",), typed={"reseal": Typed(str, "WHY")})
def verify(options: dict[str, Any], json: Json = False) -> None:
    """Tell whether a calibration is as it was written, or a URDF or program its own; exit code 1 if it is not."""
    urdf, program = options.get("urdf"), options.get("program")
    if urdf is not None and program is not None:
        raise typer.BadParameter("give one of --urdf and --program", param_hint="--urdf")
    result = public("verify")(**options)
    if json:
        show.print_json(result.to_dict())
    else:
        first, *more = result.report()
        show.tell([f"{urdf or program or options['calibration']}: {first}", *more])
    if not result:
        raise typer.Exit(1)


@Command("sign", arguments=("path",))
def sign(options: dict[str, Any], json: Json = False) -> None:
    """Sign a calibration folder or a certificate with a laboratory's key; irbcal verify --public-key checks it."""
    out = public("sign")(**options)
    if json:
        show.print_json({"signature": str(out)})
    else:
        show.say(f"Signed: {out}")
