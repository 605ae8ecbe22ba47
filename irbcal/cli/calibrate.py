"""``irbcal calibrate``: identify, validate, export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from irbcal.cli import show
from irbcal.cli.shared_options import FailIfWorse, Json, Verbose
from irbcal.cli.signature import NAMES, PLACE, Typed, command, path_to_write, public

STEPS = 6


@command(
    "calibrate",
    arguments=("measurements",),
    typed={
        "measurements": Typed(list[Path], None, lambda files, option: files[0] if len(files) == 1 else files),
        "robot": Typed(str, None),
        "frame": NAMES,
        "session_by": Typed(str, "COLUMN"),
        "leave_out": Typed(str, "COLUMN"),
        "payload_place": PLACE,
    },
    panels={
        "Everyday": ("robot", "model", "holdout", "verify", "with_", "prior", "force", "verbose", "json"),
        "Measurements": ("features", "targets", "frame", "as_poses", "session_by", "payload_place", "same_tool"),
        "URDF": ("base_link", "tip_link", "coupling", "world_link", "target_links", "mesh_paths"),
    },
)
def calibrate(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(parser=path_to_write, metavar="PATH", help="Folder for the calibration.")],
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
    if "robot" not in options and "with_" not in options:
        raise typer.BadParameter("name the nominal robot, or an earlier calibration with --with", param_hint="--robot")
    if "power" in options and options.get("objective") != "pnorm":
        raise typer.BadParameter("only --objective pnorm has a power", param_hint="--power")
    links = {"world_link": world_link, "target_links": target_links, "mesh_paths": mesh_paths}
    run(options, out, json, force, verbose, fail_if_worse, **links)


def run(
    options: dict[str, Any],
    out: Path,
    json: bool = False,
    force: bool = False,
    verbose: bool = False,
    fail_if_worse: bool = False,
    **links: Any,
) -> None:
    """The main job with its output; also what the demo runs."""
    from irbcal.atomic import made_folders
    from irbcal.io.calibration_folder import NAMES as FILES
    from irbcal.overwriting import refuse_replacing

    refuse_replacing(out, force)
    with made_folders(out, names=FILES), show.progress(STEPS, quiet=json) as step:
        calibration = public("calibrate")(**options, progress=step)
        step("checking the URDF, writing")
        calibration.save(out, **links)
    if json:
        show.print_json(calibration.to_dict(out))
    else:
        show.tell(calibration.proof() if verbose else calibration.report())
        show.say(f"Written to {out}: {', '.join(FILES)}")
    show.fail(calibration.verdict, fail_if_worse)
