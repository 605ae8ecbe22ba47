"""``irbcal calibrate``: identify, validate, export."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.modeling.parameters import LEVELS

STEPS = 6

Model = Enum("Model", {name: name for name in LEVELS}, type=str)
Split = Enum("Split", {"random": "random", "last": "last"}, type=str)


def calibrate(
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    robot: Annotated[
        str, typer.Option(help="URDF of the nominal robot, or a shipped one: irb1600, irb120.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder for the calibration.", show_default=False)],
    model: Annotated[Model, typer.Option(help="Level of the error model (thesis, section 5.4).")] = Model["34"],
    holdout: Annotated[
        float, typer.Option(min=0.0, help="Poses kept from the fit to prove it: a fraction below 1, or a number.")
    ] = 0.25,
    split: Annotated[Split, typer.Option(help="Which poses: drawn at random, or the last of the file.")] = Split.random,
    seed: Annotated[int, typer.Option(help="Seed of the random split.")] = 0,
    verify: Annotated[
        Path | None, typer.Option(help="Measurements to prove it with, in place of --holdout.", show_default=False)
    ] = None,
    base_link: Annotated[str | None, typer.Option(help="Base link [default: base_link or the root].")] = None,
    tip_link: Annotated[
        str | None, typer.Option(help="Tip link [default: tool0, flange, ee_link or the last link].")
    ] = None,
    world_link: Annotated[bool, typer.Option("--world-link", help="Add the measuring frame to the URDF.")] = False,
    target_links: Annotated[bool, typer.Option("--target-links", help="Add the reflectors to the URDF.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Identify a robot, prove it on held-out poses, write calibrated.urdf, calibration.json and report.html."""
    run(
        measurements,
        robot,
        out,
        json,
        save={"with_world": world_link, "with_targets": target_links},
        model=model.value,
        holdout=holdout,
        order=split.value,
        seed=seed,
        verify=verify,
        base=base_link,
        tip=tip_link,
    )


def run(measurements, robot, out, json, save, **options):
    """The main job with its output; also what the demo runs."""
    from irbcal import workflow
    from irbcal.export import calibration_file

    calibration_file.check_writable(out)
    with show.progress(STEPS, quiet=json) as step:
        outcome = workflow.calibrate(measurements, robot, progress=step, **options)
        step("checking with Pinocchio, writing")
        calibration = calibration_file.save(outcome, out, **save)
    if json:
        show.print_json(summary(calibration, out))
    else:
        _print(calibration, out)


def summary(calibration, out):
    """The result as the JSON that scripts rely on."""

    def overall(errors):
        return errors.all.model_dump() if errors else None

    return {
        "out": str(out),
        "robot": calibration.robot.name,
        "model": calibration.model,
        "simulated": calibration.simulated,
        "objective": calibration.objective.model_dump(),
        "poses": {
            "fit": calibration.poses_fit,
            "heldout": calibration.poses_heldout,
            "excluded": calibration.poses_excluded,
        },
        "fit": overall(calibration.fit),
        "heldout": overall(calibration.heldout),
        "nominal_heldout": overall(calibration.heldout_nominal),
        "per_target": calibration.heldout.model_dump()["per_target"] if calibration.heldout else None,
        "rank": calibration.rank,
        "parameters": calibration.parameter_count,
        "held": calibration.held,
        "excluded": [item.model_dump() for item in calibration.excluded],
        "notes": calibration.notes,
        "pinocchio_check": calibration.pinocchio_check.model_dump(),
        "seconds": calibration.seconds,
    }


def _print(calibration, out):
    parts = [("all targets", calibration.heldout_nominal, calibration.heldout)]
    proven = calibration.heldout is not None
    if not proven:
        parts = [("all targets", calibration.fit_nominal, calibration.fit)]
    rows = []
    for label, nominal, calibrated in parts:
        rows.append((label, "nominal", nominal.all.model_dump(), False))
        rows.append((label, f"model {calibration.model}", calibrated.all.model_dump(), True))
        for name in calibrated.per_target if len(calibrated.per_target) > 1 else ():
            rows.append((name, "nominal", nominal.per_target[name].model_dump(), False))
            rows.append((name, f"model {calibration.model}", calibrated.per_target[name].model_dump(), False))
    kind = "SIMULATED data: " if calibration.simulated else ""
    if proven:
        title = f"{kind}position errors on {calibration.poses_heldout} poses that the fit never saw"
    else:
        title = f"{kind}position errors on the fitted poses: NOTHING WAS HELD OUT, this is not the robot's accuracy"
    show.statistics_table(title, rows)
    show.say(
        f"{calibration.robot.name}, model {calibration.model}: {calibration.rank} independent combinations of "
        f"{calibration.parameter_count} parameters identified from {calibration.poses_fit} poses "
        f"(fitted rms {calibration.objective.value_mm:.3f} mm)"
    )
    for sentence in calibration.held:
        show.say(f"  held: {sentence}")
    if calibration.excluded:
        show.say(f"Left out: {len(calibration.excluded)} points, of which {calibration.poses_excluded} whole poses")
        for line in show.exclusions([item.model_dump() for item in calibration.excluded]):
            show.say(line)
    for note in calibration.notes:
        show.say(f"Note: {note}")
    check = calibration.pinocchio_check
    show.say(
        f"Pinocchio on the written URDF, {check.poses} random poses: differs by {check.position_m:.1e} m, "
        f"{check.rotation_rad:.1e} rad"
    )
    show.say(f"Written to {out}: calibrated.urdf, calibration.json, report.html")
