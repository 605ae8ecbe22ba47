"""``irbcal calibrate``: identify, validate, export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from irbcal.cli import grid, show
from irbcal.cli.shared_options import BaseLink, Coupling, FailIfWorse, Jobs, Json, Measurements, TipLink, Verbose
from irbcal.cli.wrong_calls import path_to_write, wrong_calls
from irbcal.identification.choices import Loss, MethodOrAlias, Model, Objective, Parallel, Terms

if TYPE_CHECKING:
    from irbcal.validation.verdict import Verdict

STEPS = 6


def calibrate(
    measurements: Measurements,
    out: Annotated[
        Path,
        typer.Option(parser=path_to_write, metavar="PATH", help="Folder for the calibration.", show_default=False),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            help="URDF of the nominal robot, a name (see irbcal robots), or a calibration folder, whose measurements "
            "are fitted, too. Needed unless --with is given.",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        Model | None,
        typer.Option(
            help="auto: the average of many error models by their evidence; a level (thesis, section 5.4); offsets, "
            "placement: levels for any arm; best-level: chosen by cross-validation.",
            show_default="auto; 34 or placement with options of a level",
        ),
    ] = None,
    terms: Annotated[
        Terms,
        typer.Option(
            help="Of model auto: joint-map: URDF and joint map are the whole truth; all: frame terms, too (bending, "
            "wobble), more accurate, known to irbcal's own kinematics only."
        ),
    ] = "joint-map",
    method: Annotated[
        MethodOrAlias,
        typer.Option(help="How to identify: circles (or axes) needs moves of one joint in groups axis1 … axis6."),
    ] = "least-squares",
    objective: Annotated[
        Objective, typer.Option(help="What to minimise: rms, the largest error (max) or between (pnorm).")
    ] = "rms",
    power: Annotated[float | None, typer.Option(min=2.0, help="Power of pnorm.", show_default="8")] = None,
    loss: Annotated[Loss, typer.Option(help="With rms: soft_l1 or huber bend less to gross errors.")] = "linear",
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
    session_by: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Column that names sessions with a base and a tool of their own; none for one session.",
            show_default="session; group where groups differ grossly",
        ),
    ] = None,
    with_: Annotated[
        Path | None,
        typer.Option(
            "--with",
            help="An earlier calibration, which these measurements are added to as a new session.",
            show_default=False,
        ),
    ] = None,
    payload_place: Annotated[
        str | None,
        typer.Option(help="Centre of the payload in the tip link: x,y,z in mm.", show_default="column, or 0,0,0"),
    ] = None,
    same_tool: Annotated[
        bool, typer.Option("--same-tool", help="The reflectors stayed in their places when the payload was changed.")
    ] = False,
    torques: Annotated[
        bool, typer.Option("--torques", help="Model auto: use measured torques, columns tau1_nm … (a mass is better).")
    ] = False,
    parallel: Annotated[
        Parallel, typer.Option(help="Method circles: keep the tilt of nearly parallel axes, or force one direction.")
    ] = "hayati",
    features: Annotated[
        Path | None,
        typer.Option(
            help="Without a tracker: what is known of the balls, sockets, planes and lengths that the measurements are "
            "at (CSV or YAML; docs/without-a-tracker.md).",
            show_default=False,
        ),
    ] = None,
    leave_out: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="With --features: column of the places that are left out in turn to prove it; none for no proof.",
            show_default="place, or features that lengths tie together",
        ),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="What calibrated robots of the same type show, by irbcal fleet prior: fewer poses do.",
            show_default=False,
        ),
    ] = None,
    jobs: Jobs = None,
    holdout: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Poses kept from the fit to prove it: a fraction below 1, or a number.", show_default="0.25"
        ),
    ] = None,
    split: Annotated[
        Literal["random", "last"], typer.Option(help="Which poses: drawn at random, or the last of the file.")
    ] = "random",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random split.")] = 0,
    verify: Annotated[
        Path | None, typer.Option(help="Measurements to prove it with, in place of --holdout.", show_default=False)
    ] = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    coupling: Coupling = None,
    world_link: Annotated[bool, typer.Option("--world-link", help="Add the measuring frame to the URDF.")] = False,
    target_links: Annotated[bool, typer.Option("--target-links", help="Add the reflectors to the URDF.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a calibration that is in --out already.")] = False,
    mesh_paths: Annotated[
        Literal["package", "relative", "absolute"],
        typer.Option(help="Mesh files in the URDF: as they were, or as paths, which MuJoCo, urchin and yourdfpy open."),
    ] = "package",
    fail_if_worse: FailIfWorse = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Identify a robot, prove it on held-out poses, write a folder with URDF, JSON, YAML and report."""
    if robot is None and with_ is None:
        raise typer.BadParameter("name the nominal robot, or an earlier calibration with --with", param_hint="--robot")
    if power is not None and objective != "pnorm":
        raise typer.BadParameter("only --objective pnorm has a power", param_hint="--power")
    verdict = run(
        measurements,
        robot,
        out,
        json,
        {"world_link": world_link, "target_links": target_links, "mesh_paths": mesh_paths},
        model=model,
        terms=terms,
        holdout=holdout,
        split=split,
        seed=seed,
        verify=verify,
        base_link=base_link,
        tip_link=tip_link,
        coupling=coupling,
        method=method,
        objective=objective,
        power=8.0 if power is None else power,
        loss=loss,
        free=free or (),
        hold=hold or (),
        targets=targets,
        frame=None if frame is None else [name.strip() for name in frame.split(",")],
        as_poses=as_poses,
        session_by=session_by,
        with_=with_,
        payload_place=grid.metres(payload_place, "--payload-place"),
        same_tool=same_tool,
        torques=torques,
        parallel=parallel,
        features=features,
        leave_out=leave_out,
        prior=prior,
        jobs=jobs,
        force=force,
        verbose=verbose,
    )
    show.fail(verdict, fail_if_worse)


def run(
    measurements: Path,
    robot: str | None,
    out: Path,
    json: bool,
    links: dict[str, Any],
    force: bool = False,
    verbose: bool = False,
    **options: Any,
) -> Verdict:
    """The main job with its output; also what the demo runs. The verdict comes back."""
    from irbcal.atomic import made_folders
    from irbcal.calibration import calibrate as identify
    from irbcal.io.calibration_folder import NAMES
    from irbcal.overwriting import refuse_replacing

    refuse_replacing(out, force)
    with made_folders(out, names=NAMES), show.progress(STEPS, quiet=json) as step:
        with wrong_calls():
            calibration = identify(measurements, robot, progress=step, **options)
        step("checking with Pinocchio, writing")
        calibration.save(out, **links)
    if json:
        show.print_json(calibration.to_dict(out))
        return calibration.verdict
    show.tell(calibration.proof(verbose))
    show.say(f"Written to {out}: {', '.join(NAMES)}")
    return calibration.verdict
