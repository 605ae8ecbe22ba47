"""The main job and its worth: ``irbcal calibrate``, ``demo``, ``evaluate``, ``compare``, ``report``, ``view``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from irbcal.cli import show
from irbcal.cli.signature import (
    LOST_JOINTS,
    MM,
    NAMES,
    PLACE,
    Command,
    FailIfWorse,
    Json,
    Typed,
    Verbose,
    numbers,
    path_to_write,
    public,
)
from irbcal.errors import IrbcalError
from irbcal.identification.choices import ModelName
from irbcal.io import robots
from irbcal.units import MM as MM_PER_M

PROGRESS_STEPS = 6
OF_URDF = ("world_link", "target_links", "mesh_paths")
"""Options of `irbcal.save`."""
OF_CERTIFICATE = ("report", "figures", "format", "data", "language")
"""Options of `irbcal.certificate`."""


@Command(
    "calibrate save",
    arguments=("measurements",),
    without=("calibration", "folder", "overwrite"),
    typed={
        "measurements": Typed(list[Path], None, lambda files, option: files[0] if len(files) == 1 else files),
        "frame": NAMES,
        "session_by": Typed(str, "COLUMN"),
        "leave_out": Typed(str, "COLUMN"),
        "payload_centre": PLACE,
    },
    panels={"Everyday": ("force", "verbose", "json")},
)
def calibrate(
    options: dict[str, Any],
    out: Annotated[Path, typer.Option(parser=path_to_write, metavar="FOLDER", help="Folder for the calibration.")],
    force: Annotated[bool, typer.Option("--force", help="Replace a calibration that is in --out already.")] = False,
    fail_if_worse: FailIfWorse = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Identify a robot, prove it on held-out poses, write a folder with URDF, JSON, YAML and report."""
    of_urdf = {name: options.pop(name) for name in OF_URDF if name in options}
    run(options, out, json, force, verbose, fail_if_worse, **of_urdf)


def run(
    options: dict[str, Any],
    out: Path,
    json: bool = False,
    force: bool = False,
    verbose: bool = False,
    fail_if_worse: bool = False,
    **of_urdf: Any,
) -> None:
    """The main job with its output; also what the demo runs."""
    from irbcal.io.calibration_folder import FILE_NAMES as FILES
    from irbcal.overwriting import refuse_replacing, replacing
    from irbcal.safe_files import made_folders

    refuse_replacing(out, force)
    with replacing(force), made_folders(out, names=FILES), show.progress(PROGRESS_STEPS, quiet=json) as step:
        calibration = public("calibrate")(**options, progress=step)
        step("checking the URDF, writing")
        calibration.save(out, **of_urdf, overwrite=force)
    if json:
        show.print_json(calibration.to_dict(out))
    else:
        show.tell(calibration.proof() if verbose else calibration.report())
        show.say(f"Written to {out}: {', '.join(FILES)}")
    show.fail(calibration.verdict, fail_if_worse)


OWN = Path("irbcal-demo")
"""Where the demonstration writes unless told otherwise, and replaces its own work."""
MEASURED = "demo_identification.csv"


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the calibration.", metavar="FOLDER")] = OWN,
    model: Annotated[ModelName, typer.Option(help="Error model; 34 is the largest level of the thesis.")] = "auto",
    force: Annotated[
        bool,
        typer.Option(
            "--force", help=f"Replace a calibration that is in --out already (a demonstration in {OWN} always is)."
        ),
    ] = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Calibrate a simulated IRB 1600 with the shipped measurements and prove it on 1,000 other poses."""
    if not json:
        show.say("Demonstration on SIMULATED measurements of an IRB 1600 with errors like those of the thesis's robot.")
    options = {
        "measurements": robots.demo_file(MEASURED),
        "robot": "irb1600",
        "model": model,
        "verify": robots.demo_file("demo_verification.csv"),
    }
    run(options, out, json, force or (out == OWN and _from_a_demonstration(out)), verbose)
    if not json:
        show.say(
            f"\nOpen {out / 'report.html'}. Next, SIMULATED examples for every command, with the lines that try them:"
        )
        show.say(f"  {show.this_command()} samples try-irbcal", whole=True)
        show.say("The whole job in a browser (pip install 'irbcal[app]'; in a checkout scripts/app):")
        show.say(f"  {show.this_command()} app my-project", whole=True)


def _from_a_demonstration(folder: Path) -> bool:
    """Whether the calibration in a folder, if there is one, is of the demonstration's measurements."""
    from irbcal.io.calibration_folder import read

    if not (folder / "calibration.json").exists():
        return True
    try:
        record = read(folder).record
    except IrbcalError:
        return False
    return record.simulated and bool(record.data) and Path(record.data[0].file).name == MEASURED


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    """Names and values of texts ``key=value``."""
    out: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise typer.BadParameter(f"expected key=value, found {text!r}", param_hint=option)
        if key in out:
            raise typer.BadParameter(f"{key} is given twice", param_hint=option)
        out[key] = value
    return out


def _frame_points(text: str, option: str) -> list[tuple[str, ...]]:
    points = [tuple(name.strip().rsplit("/", 1)) for name in text.split(",")]
    if len(set(points)) != 3 or len(points) != 3 or any(len(name) != 2 for name in points):
        raise typer.BadParameter(f"expected three different points as POSE/TARGET, found {text!r}", param_hint=option)
    return points


@Command(
    "evaluate certificate",
    arguments=("calibration", "measurements"),
    without=("evaluation",),
    optional=("report",),
    typed={
        "sphere": numbers("X,Y,Z,DIAMETER", 4, units=[MM_PER_M]),
        "tolerance": MM,
        "tracker_u95": MM,
        "info": Typed(list[str], "KEY=VALUE", _pairs),
        "refit_zeros": LOST_JOINTS,
        "frame_points": Typed(str, "POSE/TARGET,…", _frame_points),
    },
    flags={"tracker_u95": "--tracker-u95-mm"},
    panels={"Everyday": ("report", "language", "verbose", "json")},
)
def evaluate(
    options: dict[str, Any],
    fail_if_worse: FailIfWorse = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Mean, sigma, max and mean + 3 sigma per group, reflector and payload, of the nominal and the calibrated robot."""
    of_certificate = {name: options.pop(name) for name in OF_CERTIFICATE if name in options}
    if of_certificate and "report" not in of_certificate:
        raise typer.BadParameter(
            "only a certificate has them: name its page with --report",
            param_hint="--figures, --format, --data, --language",
        )
    if of_certificate:
        from irbcal.reports.certificate import refuse_wrong_options

        refuse_wrong_options(**of_certificate)
    with show.progress(1, quiet=json or not show.long_file(options["measurements"])) as step:
        result = public("evaluate")(**options, progress=step)
    written = public("certificate")(result, **of_certificate) if of_certificate else {}
    if json:
        show.print_json(
            result.to_dict() | {"written": [str(path / name) for path in written for name in written[path]]}
        )
    else:
        show.tell(result.report(verbose))
        for folder, files in written.items():
            show.say(f"Written to {', '.join(str(folder / name) for name in files)}")
    if result.conformity is not None and not result.conformity:
        raise typer.Exit(show.NOT_TRUSTED)
    show.fail(result.verdict, fail_if_worse)


@Command(
    "compare",
    arguments=("calibrations",),
    typed={"calibrations": Typed(list[Path], "PATH")},
)
def compare(
    options: dict[str, Any],
    csv: Annotated[Path | None, typer.Option(help="Write the errors pose by pose (CSV).")] = None,
    latex: Annotated[Path | None, typer.Option(help="Write the table for LaTeX.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for figures (PNG).")] = None,
    json: Json = False,
) -> None:
    """Compare calibrations of one robot pose by pose: which is better, and whether that is beyond chance."""
    from irbcal.names import csv_bytes
    from irbcal.safe_files import made_folders, write_set

    with made_folders(*(path for path in (plots, *(file.parent for file in (csv, latex) if file)) if path)):
        result = public("compare")(**options)
        written: dict[Path, bytes] = {}
        if csv is not None:
            written[csv] = csv_bytes(result.to_frame(), float_format="%.6f")
        if latex is not None:
            written[latex] = result.latex().encode()
        if plots is not None:
            written |= {plots / f"{name}.png": chart.content("png") for name, chart in result.plots().items()}
        write_set(written)
    names = [str(path) for path in written]
    show.result(result, json, *([f"Written: {', '.join(names)}"] if names else []), written=names)


@Command("report", arguments=("calibration",))
def report(options: dict[str, Any], json: Json = False) -> None:
    """Write report.html again from calibration.json; its figures (PNG, SVG) and data (CSV) on request."""
    with show.progress(3, quiet=json) as step:
        folders = public("report")(**options, progress=step)
    signature = public("verify")(options["calibration"]).signature
    if json:
        written = [str(folder / name) for folder, names in folders.items() for name in names]
        simulated = public("load")(options["calibration"]).record.simulated
        show.print_json(
            {"out": str(options["calibration"]), "simulated": simulated, "written": written, "signature": signature}
        )
        return
    for folder, names in folders.items():
        show.say(f"Written to {folder}: {', '.join(names)}")
    if signature == "stale":
        show.say("The signature is of the earlier page: irbcal sign")


@Command(
    "view",
    arguments=("source", "measurements"),
    without=("cube",),
)
def view(
    options: dict[str, Any],
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page in place of serving it.")] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port on 127.0.0.1: 8160 or a free one unless given.")
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open a browser.")] = False,
) -> None:
    """Look at the robot, measured and modelled points and magnified errors, pose by pose (served on 127.0.0.1 only)."""
    if html is not None and port is not None:
        raise typer.BadParameter("--html writes a page, it is not served: leave one of them out", param_hint="--port")
    result = public("view")(**options)
    show.tell(result.report())
    if html is None:
        result.serve(port, open_browser, show.say)
    else:
        show.say(f"Written to {result.save(html)}")
