"""``irbcal cell``: tools and work objects by the calibrated robot, from touches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from irbcal.cli import program_words, show
from irbcal.cli.program_words import NAMED
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import PLACE, command, public

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.cell.cell_file import Notation
    from irbcal.correction.maker import Maker
    from irbcal.io.controller_model import ControllerFrames

LANGUAGES = {
    "kuka": "krl",
    "abb": "rapid",
    "fanuc": "fanuc",
    "yaskawa": "inform",
    "kawasaki": "kawasaki",
    "staubli": "val3",
    "ur": "urscript",
}
"""Of the makers, by the names that ``--as`` takes."""


@command(
    "cell_frames",
    arguments=("calibration", "touches"),
    typed={"payload_place": PLACE},
    without=("out", "tool", "wobj"),
    texts={
        "touches": "Touches (CSV or Parquet): frame, name, point, tool, q1_deg …, at will x_mm, y_mm, z_mm and u95_mm."
    },
)
def cell(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(help="File for the cell, such as cell.json.")],
    as_: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="Write frames as this maker does: kuka, abb, fanuc, yaskawa, kawasaki, staubli or ur.",
            metavar="MAKER",
        ),
    ] = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(
            metavar=NAMED,
            help="What the controller has for a tool: NAME=x,y,z,q1,q2,q3,q4 (mm, quaternion), or with --as six "
            "numbers as the maker writes them.",
        ),
    ] = None,
    wobj: Annotated[
        list[str] | None,
        typer.Option("--wobj", "--frame", metavar=NAMED, help="Likewise for a work object (base, user frame)."),
    ] = None,
    json: Json = False,
) -> None:
    """Compute tools and work objects with the calibrated robot from touches, and how far off the controller's are."""
    from irbcal.correction import languages
    from irbcal.io.calibration_folder import read
    from irbcal.io.controller_model import controller_frames
    from irbcal.modeling import frames

    calibration = options.pop("calibration")
    if as_ is not None and as_ not in LANGUAGES:
        raise typer.BadParameter(f"expected {', '.join(LANGUAGES)}, found {as_!r}", param_hint="--as")
    maker = None if as_ is None else languages.by_name()[LANGUAGES[as_]].MAKER
    saved = read(calibration)
    robot = saved.record.robot
    ends = controller_frames(saved.urdf, "calibrated.urdf", robot.base_link, robot.tip_link)
    tools = program_words.frames(tool, "--tool", maker)
    work_objects = program_words.frames(wobj, "--wobj", maker)
    frames_found = public("cell_frames")(
        calibration,
        out=out,
        tool={name: ends.T_tip_flange @ T for name, T in tools.items()},
        wobj={name: ends.T_base_world @ T for name, T in work_objects.items()},
        **options,
    )
    if json:
        show.print_json(frames_found.to_dict())
        return
    to_controller = frames.inverse(ends.T_tip_flange), frames.inverse(ends.T_base_world)
    show.tell(frames_found.told() if as_ is None else frames_found.told(_notation(as_, maker, ends, to_controller)))
    show.say(f"Written to {out}: irbcal filter {calibration} PROGRAM --cell {out}")


def _notation(
    name: str, maker: Maker | None, ends: ControllerFrames, to_controller: tuple[FloatArray, FloatArray]
) -> Notation:
    """How a maker's controllers write frames, and what they count from."""
    import numpy as np

    from irbcal.cell.cell_file import TOOL, Notation
    from irbcal.correction.notation import numbers_from_poses
    from irbcal.units import MM

    def numbers(frame: str, T: FloatArray) -> list[float]:
        T = to_controller[0 if frame == TOOL else 1] @ T
        rows = numbers_from_poses(T) if maker is None else maker.numbers(T[None], np.zeros((1, 6)))
        return [float(number) for number in rows[0]]

    flange = "the flange" if ends.flange_known else "the URDF's tip link"
    base = "the controller's base" if ends.base_known else "the URDF's base link"
    names = ("q1", "q2", "q3", "q4") if maker is None else maker.orientation.names
    lengths = "m" if maker is not None and maker.length == 1.0 else "mm"
    description = f"as {name} writes them, {lengths}, in {flange} and {base}"
    return Notation(("x", "y", "z", *names), numbers, description, 4 if maker is not None and maker.length == MM else 6)
