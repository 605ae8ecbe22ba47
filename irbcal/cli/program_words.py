"""What the command line says about robot programs: frames and pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from irbcal.cli.signature import Typed, numbers

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.correction.maker import Maker


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
    from irbcal.correction.languages import files_of

    given = options.keys() & {"tool", "wobj", "where"}
    if not given:
        return
    files = program if isinstance(program, list) else [] if program is None else [program]
    maker = files_of(files).language.MAKER if files else None
    for name in given:
        read = where(options[name], maker) if name == "where" else frames(options[name], f"--{name}", maker)
        options[name] = read


def frames(texts: list[str] | None, option: str, maker: Maker | None) -> dict[str, FloatArray]:
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
        raise typer.BadParameter(f"expected six joints=six numbers of the pose, found {text!r}", param_hint="--where")
    return np.array(pieces[0]) * maker.joint, maker.poses(np.array([pieces[1]]))[0]
