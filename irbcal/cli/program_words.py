"""What the command line says about robot programs: frames and pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.correction.maker import Maker


def pulses(text: str | None) -> list[float] | None:
    """Pulses per degree: numbers with commas between them."""
    try:
        return None if text is None else [float(value) for value in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f"expected six numbers with commas, found {text!r}", param_hint="--pulses") from None


NAMED = "NAME=…"
"""How a named frame is typed."""
LARGEST_MM = 1e6
"""Of a tool or work object; a kilometre is none."""


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


def where(text: str | None, maker: Maker | None) -> tuple[FloatArray, FloatArray] | None:
    """Joints in radians and the pose that a controller shows there, ``J1,…,J6=X,Y,Z,O,A,T``."""
    import numpy as np

    if text is None:
        return None
    try:
        pieces = [[float(value) for value in piece.split(",")] for piece in text.split("=")]
    except ValueError:
        pieces = []
    sizes = [len(piece) for piece in pieces]
    if maker is None or sizes != [6, 6] or not (np.abs(np.array(pieces)) < LARGEST_MM).all():
        raise typer.BadParameter(f"expected six joints=six numbers of the pose, found {text!r}", param_hint="--where")
    return np.array(pieces[0]) * maker.joint, maker.poses(np.array([pieces[1]]))[0]
