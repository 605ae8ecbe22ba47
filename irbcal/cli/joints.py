"""``irbcal joints``: what each joint does beyond geometry."""

from __future__ import annotations

from typing import Any, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json
from irbcal.cli.signature import Typed, command, public


def _frequency(text: str, option: str) -> float | Literal["free"]:
    """Periods per turn, or free."""
    if text == "free":
        return "free"
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1000.0:
        raise typer.BadParameter(
            f"expected free or a number of periods per turn above zero, found {text!r}", param_hint=option
        )
    return value


@command(
    "joints",
    arguments=("measurements",),
    typed={"frequency": Typed(str, "NUMBER|free", _frequency), "robot": Typed(str, None)},
)
def joints(options: dict[str, Any], json: Json = False) -> None:
    """Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.

    One-joint moves (groups axis1, axis2, …) need no robot: their circles are enough. Any other poses are analysed by
    the residuals of a calibration (--calibration) or of a robot that is identified from them first (--robot).
    """
    if "calibration" in options and "robot" in options:
        raise typer.BadParameter("give --calibration or --robot, not both")
    with show.progress(3, quiet=json) as step:
        result = public("joints")(**options, progress=step)
    show.result(result, json)
