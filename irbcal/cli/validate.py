"""Checks of robot, controller and tracker, from ``irbcal joints`` to ``irbcal ballbar``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from irbcal.cli import show
from irbcal.cli.signature import DEG, MM, PLACE, Command, Json, Typed, numbers, numbers_in, public
from irbcal.units import MM as MM_PER_M


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


@Command(
    "joints",
    arguments=("measurements",),
    typed={"frequency": Typed(str, "NUMBER|free", _frequency)},
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


@Command(
    "circles",
    arguments=("measurements",),
    typed={"tolerance": DEG},
)
def circles(options: dict[str, Any], json: Json = False) -> None:
    """Base, tool and links of a robot by the circles of one-joint moves alone.

    The base comes from axes 1 and 2, the tool from the last two, links from all six. The tool can be compared with its
    drawing. Nothing is written: calibrate --method circles makes a calibration.
    """
    show.result(public("circles")(**options), json)


@Command("controller", arguments=("poses",))
def controller(
    options: dict[str, Any],
    out: Annotated[Path | None, typer.Option(help="URDF that equals the controller.", metavar="FILE")] = None,
    json: Json = False,
) -> None:
    """Compare a URDF with the poses that the controller itself reports: which lengths and zeros it computes with."""
    comparison = public("controller")(**options)
    if out is not None:
        comparison.save(out)
    show.written(comparison, out, json)


PLAN = ("center", "edge", "inset", "plane", "near")
"""Options of the test poses."""


@Command(
    "iso9283 iso9283_plan",
    arguments=("measurements",),
    typed={
        "band": MM,
        "velocity": MM,
        "center": PLACE,
        "edge": MM,
        "inset": Typed(float, "PERCENT", lambda value, option: value / 100, lambda value: round(100 * value, 3)),
        "plane": Typed(str, "x=z|x=-z|y=z|y=-z"),
        "near": Typed(str, "J1,J2,…"),
    },
    without=("robot",),
    panels={
        "Everyday": ("calibration", "commanded", "target", "plan", "plot", "json"),
        "Measurements": ("path", "commanded_path", "velocity", "approaches", "moves", "forces"),
    },
    texts={"inset": "Points this far from the corners, % of the diagonal."},
)
def iso9283(
    options: dict[str, Any],
    plan: Annotated[
        str | None, typer.Option(help="Robot (URDF or name, see irbcal robots): print its test poses as CSV.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).")] = None,
    json: Json = False,
) -> None:
    """Accuracy, repeatability, drift, settling, velocity, corners, posing time, compliance, after ISO 9283:1998."""
    poses = {name: options.pop(name) for name in PLAN if name in options}
    if plan is None:
        show.with_plot(plot, json, lambda: public("iso9283")(**options), lambda result, file: result.save_plots(file))
        return
    if "measurements" in options:
        raise typer.BadParameter("--plan takes no measurements: leave one of them out", param_hint="MEASUREMENTS")
    import numpy as np

    from irbcal.io.opening import open_robot

    arm = open_robot(plan, nominal=True).nominal
    if "near" in poses:
        poses["near"] = np.array(numbers_in(poses["near"], (len(arm.joint_names),), "--near")) * arm.joint_units
    table = public("iso9283_plan")(arm, **poses).to_frame().set_index("pose").round(6) + 0.0  # no minus before zero
    show.print_rows(table.reset_index(), as_json=False, decimals=6)


@Command(
    "tracker",
    arguments=("readings",),
    typed={"length": MM, "band": MM},
)
def tracker(
    options: dict[str, Any],
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).")] = None,
    json: Json = False,
) -> None:
    """Scale-bar distances, repeatability, long-term drift with the air, stabilisation time.

    Columns: x_mm,y_mm,z_mm and, for bar: end (two names, in turn), optional position; or distance_mm alone. For
    repeat: optional position. For drift: time_s, optional temperature_c, pressure_mmhg, humidity_percent. For settle:
    time_s, run.
    """
    show.with_plot(plot, json, lambda: public("tracker")(**options), lambda result, file: result.plot().save(file))


DIRECTION = numbers("X,Y,Z", 3)


@Command(
    "ballbar",
    arguments=("calibration", "measured"),
    typed={
        "bar": MM,
        "height": MM,
        "tilt": DEG,
        "tool": numbers("X,Y,Z[,QW,QX,QY,QZ]", 3, 7, units=[MM_PER_M] * 3 + [1.0]),
        "normal": DIRECTION,
        "start": DIRECTION,
        "joints": Typed(str, "J1,J2,…"),
    },
)
def ballbar(
    options: dict[str, Any],
    plot: Annotated[Path | None, typer.Option(help="Polar plot to write (.png, .svg, .pdf).")] = None,
    magnify: Annotated[
        float | None, typer.Option(min=1e-3, help="Magnification of the errors: a round number unless given.")
    ] = None,
    json: Json = False,
) -> None:
    """Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint reversals."""
    import numpy as np

    if "joints" in options:
        units = public("load")(options["calibration"]).arm().joint_units
        options["joints"] = np.array(numbers_in(options["joints"], (len(units),), "--joints")) * units
    show.with_plot(
        plot, json, lambda: public("ballbar")(**options), lambda result, file: result.plot(magnify).save(file)
    )
