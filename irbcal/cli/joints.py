"""``irbcal joints``: what each joint does beyond geometry."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import Json, Measurements


def _frequency(text: str) -> float | Literal["free"]:
    """Periods per turn, or free."""
    if text == "free":
        return "free"
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1000.0:
        raise typer.BadParameter(f"expected free or a number of periods per turn above zero, found {text!r}")
    return value


def joints(
    measurements: Measurements,
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration folder: its residuals are analysed, too.", show_default=False)
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="URDF or shipped robot, identified from these poses first.", show_default=False),
    ] = None,
    joint: Annotated[int | None, typer.Option(min=1, help="Only this joint.", show_default="all joints")] = None,
    order: Annotated[int, typer.Option(min=1, max=12, help="Order of the Fourier series.")] = 2,
    frequency: Annotated[str, typer.Option(help="Of the Fourier series, periods per turn; or: free.")] = "1",
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).", show_default=False)] = None,
    json: Json = False,
) -> None:
    """Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.

    One-joint moves (groups axis1, axis2, …) need no robot: their circles are enough. Any other poses are analysed by
    the residuals of a calibration (--calibration) or of a robot that is identified from them first (--robot).
    """
    if calibration is not None and robot is not None:
        raise typer.BadParameter("give --calibration or --robot, not both")
    periods = _frequency(frequency)
    from irbcal.joint_analysis import behaviour

    with show.progress(3, quiet=json) as step:
        found = behaviour.joints(
            measurements,
            calibration=calibration,
            robot=robot,
            joint=joint,
            order=order,
            frequency=periods,
            plots=plots,
            progress=step,
        )
    if json:
        show.print_json(found.to_dict())
    else:
        show.tell(found.told())
