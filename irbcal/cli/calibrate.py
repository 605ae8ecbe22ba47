"""``irbcal calibrate``: identify, validate, export."""

from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from irbcal.cli import show
from irbcal.identification.choices import LOSSES, METHODS, OBJECTIVES
from irbcal.modeling.parameters import LEVELS

STEPS = 6


def _choices(name, values):
    return Enum(name, {value: value for value in values}, type=str)


Model = _choices("Model", (*LEVELS, "auto"))
Split = _choices("Split", ("random", "last"))
Method = _choices("Method", METHODS)
Objective = _choices("Objective", OBJECTIVES)
Loss = _choices("Loss", LOSSES)


def calibrate(
    measurements: Annotated[Path, typer.Argument(help="Measurement file (CSV or Parquet).", show_default=False)],
    robot: Annotated[
        str, typer.Option(help="URDF of the nominal robot, or a shipped one: irb1600, irb120.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder for the calibration.", show_default=False)],
    model: Annotated[
        Model | None,
        typer.Option(
            help="Level of the error model (thesis, section 5.4); offsets, placement: for any arm; auto: by "
            "cross-validation.",
            show_default="34; placement for other arms than six revolute joints",
        ),
    ] = None,
    method: Annotated[
        Method, typer.Option(help="How to identify: axes needs one-joint moves in groups axis1 … axis6.")
    ] = Method["least-squares"],
    objective: Annotated[
        Objective, typer.Option(help="What to minimise: rms, the largest error (max) or between (pnorm).")
    ] = Objective.rms,
    power: Annotated[float | None, typer.Option(min=2.0, help="Power of pnorm.", show_default="8")] = None,
    loss: Annotated[Loss, typer.Option(help="With rms: soft_l1 or huber bend less to gross errors.")] = Loss.linear,
    free: Annotated[
        list[str] | None, typer.Option(help="Add error parameters by name or pattern, such as 'gain*'.")
    ] = None,
    hold: Annotated[list[str] | None, typer.Option(help="Hold error parameters at nominal, likewise.")] = None,
    targets: Annotated[
        Path | None, typer.Option(help="Known reflector places on the tool: target,x_mm,y_mm,z_mm.", show_default=False)
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(help="Measuring frame from three references: two on x, one on y, as ref1,ref2,ref3."),
    ] = None,
    as_poses: Annotated[
        bool, typer.Option("--as-poses", help="Turn three or more targets of each pose into one full pose.")
    ] = False,
    holdout: Annotated[
        float, typer.Option(min=0.0, help="Poses kept from the fit to prove it: a fraction below 1, or a number.")
    ] = 0.25,
    split: Annotated[Split, typer.Option(help="Which poses: drawn at random, or the last of the file.")] = Split.random,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random split.")] = 0,
    verify: Annotated[
        Path | None, typer.Option(help="Measurements to prove it with, in place of --holdout.", show_default=False)
    ] = None,
    base_link: Annotated[
        str | None, typer.Option(help="Base link of the arm.", show_default="base_link or the root")
    ] = None,
    tip_link: Annotated[
        str | None,
        typer.Option(help="Tip link of the arm.", show_default="tool0, flange, ee_link, tcp or the last link"),
    ] = None,
    world_link: Annotated[bool, typer.Option("--world-link", help="Add the measuring frame to the URDF.")] = False,
    target_links: Annotated[bool, typer.Option("--target-links", help="Add the reflectors to the URDF.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")] = False,
):
    """Identify a robot, prove it on held-out poses, write a folder with URDF, JSON, YAML and report."""
    if power is not None and objective != Objective.pnorm:
        raise typer.BadParameter("only --objective pnorm has a power", param_hint="--power")
    if not holdout < 1 and not (holdout < 1e9 and holdout == int(holdout)):
        raise typer.BadParameter(
            f"expected a fraction below 1 or a whole number, found {holdout:g}", param_hint="--holdout"
        )
    run(
        measurements,
        robot,
        out,
        json,
        save={"with_world": world_link, "with_targets": target_links},
        model=model.value if model else None,
        holdout=holdout,
        order=split.value,
        seed=seed,
        verify=verify,
        base=base_link,
        tip=tip_link,
        method=method.value,
        objective=objective.value,
        power=8.0 if power is None else power,
        loss=loss.value,
        free=free or (),
        hold=hold or (),
        known_targets=targets,
        frame=None if frame is None else [name.strip() for name in frame.split(",")],
        poses=as_poses,
    )


def run(measurements, robot, out, json, save, **options):
    """The main job with its output; also what the demo runs."""
    from irbcal import calibrating
    from irbcal.files import calibration_folder
    from irbcal.files.atomic import check_writable

    made = check_writable(out, calibration_folder.NAMES)
    try:
        with show.progress(STEPS, quiet=json) as step:
            outcome = calibrating.calibrate(measurements, robot, progress=step, **options)
            step("checking with Pinocchio, writing")
            calibration = calibration_folder.save(outcome, out, **save)
    except BaseException:
        for folder in made:  # an empty folder would look like a result
            with suppress(OSError):
                folder.rmdir()
        raise
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
        "method": calibration.method,
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
        "choice": calibration.choice.model_dump() if calibration.choice else None,
        "excluded": [item.model_dump() for item in calibration.excluded],
        "notes": calibration.notes,
        "largest_link_shift_mm": calibration.largest_link_shift_mm,
        "pinocchio_check": calibration.pinocchio_check.model_dump(),
        "seconds": calibration.seconds,
    }


def _reached(calibration):
    """What the method reached, in words."""
    objective = calibration.objective
    names = {"rms": "fitted rms", "max": "largest fitted error", "pnorm": "p-norm of the fitted errors"}
    text = f"{names[objective.name]} {objective.value_mm:.3f} mm"
    if objective.lower_bound_mm is not None:
        text += f", certified: not below {objective.lower_bound_mm:.3f} mm with this model"
    if calibration.method != "least-squares":
        text = f"method {calibration.method}, {text}"
    return text


def _print(calibration, out):
    parts = [("all targets", calibration.heldout_nominal, calibration.heldout)]
    proven = calibration.heldout is not None
    if not proven:
        parts = [("all targets", calibration.fit_nominal, calibration.fit)]
    rows = []
    both = calibration.model != "nominal"
    for label, nominal, calibrated in parts:
        if both:
            rows.append((label, "nominal", nominal.all.model_dump(), False))
        rows.append((label, f"model {calibration.model}", calibrated.all.model_dump(), True))
        if proven and calibration.heldout_least_squares:
            rows.append((label, "… by rms", calibration.heldout_least_squares.all.model_dump(), False))
        for name in calibrated.per_target if len(calibrated.per_target) > 1 else ():
            if both:
                rows.append((name, "nominal", nominal.per_target[name].model_dump(), False))
            rows.append((name, f"model {calibration.model}", calibrated.per_target[name].model_dump(), False))
    kind = "SIMULATED data: " if calibration.simulated else ""
    if proven:
        title = f"{kind}position errors on {calibration.poses_heldout} poses that the fit never saw"
    else:
        title = f"{kind}position errors on the fitted poses: NOTHING WAS HELD OUT, this is not the robot's accuracy"
    show.statistics_table(title, rows)
    if parts[0][2].orientation:
        show.orientation("nominal", parts[0][1].orientation.model_dump())
        show.orientation(f"model {calibration.model}", parts[0][2].orientation.model_dump())
    show.say(
        f"{calibration.robot.name}, model {calibration.model}: {calibration.rank} independent combinations of "
        f"{calibration.parameter_count} parameters identified from {calibration.poses_fit} poses "
        f"({_reached(calibration)})"
    )
    if calibration.choice:
        show.say(calibration.choice.explanation)
    for sentence in calibration.held:
        show.say(f"  held: {sentence}")
    if calibration.excluded:
        show.say(f"Left out: {len(calibration.excluded)} points, of which {calibration.poses_excluded} whole poses")
        for line in show.exclusions([item.model_dump() for item in calibration.excluded]):
            show.say(line)
    for note in calibration.notes:
        show.note(note)
    check = calibration.pinocchio_check
    show.say(
        f"Pinocchio on the written URDF, {check.poses} random poses: differs by {check.position_m:.1e} m, "
        f"{check.rotation_rad:.1e} rad"
    )
    show.say(f"Link frames moved by at most {calibration.largest_link_shift_mm:.3f} mm at zero joints")
    show.say(f"Written to {out}: calibrated.urdf, joint_origins.yaml, calibration.json, report.html")
