"""``irbcal iso9283``: pose accuracy and repeatability, distance, drift, stabilisation, paths."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import grid, show

Plane = Enum("Plane", {"x=z": "x=z", "x=-z": "x=-z", "y=z": "y=z", "y=-z": "y=-z"}, type=str)


def iso9283(
    measurements: Annotated[
        Path | None,
        typer.Argument(help="Measurement file with columns pose (P1 … P5) and cycle.", show_default=False),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration folder: commanded poses at the file's joints, by both models.")
    ] = None,
    commanded: Annotated[
        Path | None,
        typer.Option(help="File of commanded poses instead: pose,x_mm,y_mm,z_mm[,qw,qx,qy,qz].", show_default=False),
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="Position of this target.", show_default="the flange, where it can be measured")
    ] = None,
    set_size: Annotated[int, typer.Option(min=2, help="Cycles of a set of the drift test.")] = 10,
    approaches: Annotated[
        Path | None,
        typer.Option(help="Time series of approaches to a pose: time_s,x_mm,y_mm,z_mm[,run].", show_default=False),
    ] = None,
    band: Annotated[
        float | None, typer.Option(min=1e-6, help="Limit band, mm.", show_default="RP of P1, else of the first pose")
    ] = None,
    rest: Annotated[float, typer.Option(min=0.0, help="Seconds after which the robot is at rest.")] = 10.0,
    path: Annotated[
        Path | None, typer.Option(help="Sampled paths: cycle,x_mm,y_mm,z_mm[,qw,qx,qy,qz].", show_default=False)
    ] = None,
    commanded_path: Annotated[
        Path | None, typer.Option(help="Points of the commanded path, in the same frame.", show_default=False)
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option(help="Robot (URDF, irb1600, irb120): print its test poses and joints as CSV.", show_default=False),
    ] = None,
    center: Annotated[
        str | None, typer.Option(help="With --plan: centre of the cube, x,y,z in mm, in the base link.")
    ] = None,
    edge: Annotated[float | None, typer.Option(min=1e-3, help="With --plan: edge of the cube, mm.")] = None,
    inset: Annotated[
        float | None,
        typer.Option(min=0.0, max=49.0, help="With --plan: points this far from the corners, % of the diagonal."),
    ] = None,
    plane: Annotated[Plane, typer.Option(help="With --plan: inclined plane of the cube.")] = Plane["x=z"],
    near: Annotated[
        str | None, typer.Option(help="With --plan: joints in degrees that set the orientation.", show_default="zero")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf).", show_default=False)] = None,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Accuracy and repeatability of poses, distances and paths, drift and stabilisation, after ISO 9283:1998."""
    from irbcal.validation import plots

    if plan is not None:
        _plan(plan, center, edge, inset, plane.value, near)
        return
    if (path is None) != (commanded_path is None):
        raise typer.BadParameter("a path needs its commanded points, and they a path", param_hint="--path")
    if measurements is None and approaches is None and path is None:
        raise typer.BadParameter("give a measurement file, --approaches, --path or --plan", param_hint="MEASUREMENTS")
    if plot is not None:
        plots.check_name(plot)
    result = _evaluate(measurements, calibration, commanded, target, set_size, approaches, band, rest)
    if path is not None:
        from irbcal.validation import pose_tests

        result["path"] = pose_tests.path_accuracy(path, commanded_path)
    if plot is not None:
        _plot(plot, result)
    if json:
        show.print_json(result)
        return
    _print(result)
    if plot is not None:
        show.say(f"Figure written to {plot}")


def _evaluate(measurements, calibration, commanded, target, set_size, approaches, band, rest):
    from irbcal.measurement import table
    from irbcal.units import MM
    from irbcal.validation import pose_tests

    result = {"poses": None, "stabilisation": None, "path": None}
    if measurements is not None:
        saved = None
        seen = table.read(measurements)
        if calibration is not None:
            from irbcal.files import calibration_folder

            saved = calibration_folder.load(calibration)
            seen.check_joints(saved.arm())
        result["poses"] = pose_tests.evaluate(seen, saved, commanded, target, set_size)
    if approaches is not None:
        if band is None:
            band = _default_band(result["poses"])
        result["stabilisation"] = pose_tests.stabilisation(approaches, band * MM, rest)
    return result


def _default_band(found):
    """RP of P1 in mm: the limit band unless one is given."""
    poses = next(iter(found["models"].values()))["poses"] if found else None
    if not poses:
        raise typer.BadParameter("there is no repeatability of P1 to take: give a limit band", param_hint="--band")
    return poses.get("P1", next(iter(poses.values())))["RP_mm"]


def _plan(robot, center, edge, inset, plane, near):
    import sys

    import numpy as np

    from irbcal import kinematics
    from irbcal.files import urdf
    from irbcal.modeling.robot import Robot
    from irbcal.units import MM
    from irbcal.validation import iso9283

    arm = urdf.read(robot).arm
    found = iso9283.five_poses(
        arm,
        None if center is None else np.array(grid.numbers(center, (3,), "--center")) * MM,
        None if edge is None else edge * MM,
        None if near is None else np.array(grid.numbers(near, (len(arm.joint_names),), "--near")) * arm.joint_units,
        plane,
        iso9283.FRACTION if inset is None else inset / 100,
    )
    table = kinematics.pose_table(Robot(arm), found.q)
    for k, name in enumerate(arm.joint_columns):
        table.insert(k, name, found.q[:, k] / arm.joint_units[k] + 0.0)
    table = table.round(6) + 0.0  # no minus before zero
    table.insert(0, "pose", iso9283.POSES)
    table.to_csv(sys.stdout, index=False, float_format="%.6f")


def _plot(path, result):
    from irbcal.errors import MeasurementError
    from irbcal.validation import plots

    models = result["poses"]["models"] if result["poses"] else {}
    drawn = []
    if any(m["history"] for m in models.values()):
        drawn.append(("poses", plots.pose_cycles, result["poses"]))
    if any(m["drift"] for m in models.values()):
        drawn.append(("drift", plots.drift_sets, result["poses"]))
    if result["stabilisation"]:
        drawn.append(("stabilisation", plots.approaches, result["stabilisation"]))
    if result["path"]:
        drawn.append(("path", plots.along_path, result["path"]))
    if not drawn:
        raise MeasurementError("there is nothing to draw: only directions of approach were measured")
    for k, (name, draw, data) in enumerate(drawn):
        plots.save(draw, path if k == 0 else path.with_stem(f"{path.stem}-{name}"), data)


def _print(result):
    if result["poses"]:
        _print_poses(result["poses"])
    if result["stabilisation"]:
        print_stabilisation(result["stabilisation"])
    found = result["path"]
    if found:
        show.say(
            f"Path: AT {found['AT_mm']:.3f} mm, RT {found['RT_mm']:.3f} mm ({found['cycles']} cycles, "
            f"{found['planes']} of {found['planes_of']} planes)"
        )
        if "AT_a_deg" in found:
            angles = [f"AT_{a} {found[f'AT_{a}_deg']:.4f}, RT_{a} {found[f'RT_{a}_deg']:.4f}" for a in "abc"]
            show.say(f"Orientation, degrees: {'; '.join(angles)}")


def print_stabilisation(found):
    """Stabilisation time and overshoot, run by run."""
    rows = [
        (name, (run["first_entry_s"], 2), (run["settled_s"], 2), (run["PSt_s"], 2), run["overshoot_mm"])
        for name, run in found["runs"].items()
    ]
    columns = ("run", "first in band s", "settled s", "PSt s", "overshoot mm")
    grid.table(f"Position stabilisation, limit band {found['band_mm']:.4g} mm", columns, rows)
    mean = "a run never settled" if found["PSt_s"] is None else f"PSt {found['PSt_s']:.2f} s (mean)"
    show.say(f"{mean}, overshoot {grid.cell(found['overshoot_mm'])} mm (largest)")


def _print_poses(found):
    start = "SIMULATED data: " if found["simulated"] else ""
    for name, model in found["models"].items():
        if model["poses"]:
            _print_model(f"{start}ISO 9283, {found['subject']}, {name}", model["poses"])
    rows = [
        (
            name,
            *(model["overall"]["position"][key] for key in ("mean_mm", "max_mm")),
            *(((model["overall"]["orientation"] or {}).get(key), 4) for key in ("mean_deg", "max_deg")),
        )
        for name, model in found["models"].items()
        if model["overall"]
    ]
    if rows:
        about = next(iter(found["models"].values()))["overall"]["from"]
        what = "command" if about == "commanded" else "mean"
        columns = ("model", "position mean mm", "max mm", "orientation mean deg", "max deg")
        grid.table(f"Errors from the {what}, all poses and cycles", columns, rows)
    for name, model in found["models"].items():
        if model["distance"]:
            d = model["distance"]
            show.say(f"Distance P2 to P4, {name}: AD {grid.cell(d['AD_mm'])} mm, RD ±{d['RD_mm']:.3f} mm")
    last = list(found["models"].values())[-1]
    for pose, values in (last["directions"] or {}).items():
        angles = "".join(f", {a} {values[f'vAP_{a}_deg']:.4f}°" for a in "abc" if f"vAP_{a}_deg" in values)
        show.say(f"Variation over {values['directions']} directions, {pose}: vAP {values['vAP_mm']:.3f} mm{angles}")
    for name, model in found["models"].items():
        if model["drift"]:
            d = model["drift"]
            accuracy = f"dAP {d['dAP_mm']:+.3f} mm, " if "dAP_mm" in d else ""
            show.say(
                f"Drift of {d['pose']} over {d['sets']} sets of {d['set_size']}, {name}: {accuracy}dRP "
                f"{d['dRP_mm']:+.3f} mm, way of the mean {d['shift_mm'][-1]:.3f} mm"
            )
    if found["excluded"]:
        show.say(f"Left out: {len(found['excluded'])} points")
        for line in show.exclusions(found["excluded"]):
            show.say(line)
    for note in found["notes"]:
        show.note(note)


def _print_model(title, poses):
    keys = ("AP_mm", "AP_x_mm", "AP_y_mm", "AP_z_mm", "RP_mm", "l_mean_mm", "l_max_mm")
    rows = [(pose, values["n"], *(values.get(key) for key in keys)) for pose, values in poses.items()]
    columns = ("pose", "n", "AP", "AP x", "AP y", "AP z", "RP", "mean l", "max l")
    if rows[0][2] is None:
        rows = [(*row[:2], *row[6:]) for row in rows]
        columns = (*columns[:2], *columns[6:])
    grid.table(f"{title}, mm", columns, rows)
    if all("RP_a_deg" in values for values in poses.values()):
        keys = [f"{what}_{a}_deg" for what in ("AP", "RP") for a in "abc"]
        rows = [(pose, *((values.get(key), 4) for key in keys)) for pose, values in poses.items()]
        columns = ("pose", "AP a", "AP b", "AP c", "RP a ±", "RP b ±", "RP c ±")
        grid.table(f"{title}, orientation, degrees", columns, rows)
