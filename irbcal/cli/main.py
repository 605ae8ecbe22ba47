"""Entry point of the ``irbcal`` command."""

from __future__ import annotations

import errno
import os
import sys
import warnings
from typing import Annotated

import typer

from irbcal.cli import (
    ballbar,
    calibrate,
    circles,
    compare,
    controller,
    demo,
    evaluate,
    export,
    filter,
    fk,
    ik,
    import_,
    iso9283,
    joints,
    plan,
    report,
    robots,
    samples,
    simulate,
    study,
    tracker,
    urdf,
    verify,
    view,
)
from irbcal.cli.guarded import Guarded
from irbcal.cli.root import NAME, Root
from irbcal.errors import IrbcalError

app = typer.Typer(
    name=NAME,
    cls=Root,
    help="Calibrate robot arms from laser-tracker measurements: corrected URDF, joint map, proof.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from irbcal import __version__

        print(f"irbcal {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Calibrate robot arms from laser-tracker measurements: corrected URDF, joint map, proof."""


app.command("demo", rich_help_panel="Calibrate", cls=Guarded)(demo.demo)
app.command("import", rich_help_panel="Calibrate", cls=Guarded)(import_.import_files)
app.command("calibrate", rich_help_panel="Calibrate", cls=Guarded)(calibrate.calibrate)
app.command("evaluate", rich_help_panel="Calibrate", cls=Guarded)(evaluate.evaluate)
app.command("compare", rich_help_panel="Calibrate", cls=Guarded)(compare.compare)
app.command("view", rich_help_panel="Calibrate", cls=Guarded)(view.view)
app.command("report", rich_help_panel="Calibrate", cls=Guarded)(report.report)
app.command("robots", rich_help_panel="Prepare", cls=Guarded)(robots.robots)
app.command("urdf", rich_help_panel="Prepare", cls=Guarded)(urdf.urdf)
app.command("fk", rich_help_panel="Use", cls=Guarded)(fk.fk)
app.command("ik", rich_help_panel="Use", cls=Guarded)(ik.ik)
app.command("filter", rich_help_panel="Use", cls=Guarded)(filter.filter_program)
app.command("export", rich_help_panel="Use", cls=Guarded)(export.export)
app.command("verify", rich_help_panel="Use", cls=Guarded)(verify.verify)
app.command("plan", rich_help_panel="Prepare", cls=Guarded)(plan.plan)
app.command("simulate", rich_help_panel="Prepare", cls=Guarded)(simulate.simulate)
app.command("samples", rich_help_panel="Prepare", cls=Guarded)(samples.samples)
app.command("study", rich_help_panel="Prepare", cls=Guarded)(study.study)
app.command("joints", rich_help_panel="Validate", cls=Guarded)(joints.joints)
app.command("circles", rich_help_panel="Validate", cls=Guarded)(circles.circles)
app.command("axes", hidden=True, cls=Guarded)(joints.joints)  # its name before
app.command("controller", rich_help_panel="Validate", cls=Guarded)(controller.controller)
app.command("iso9283", rich_help_panel="Validate", cls=Guarded)(iso9283.iso9283)
app.command("tracker", rich_help_panel="Validate", cls=Guarded)(tracker.tracker)
app.command("ballbar", rich_help_panel="Validate", cls=Guarded)(ballbar.ballbar)


def main() -> None:
    """Run a command; refusals become one sentence on stderr and exit code 1."""
    try:
        with warnings.catch_warnings():
            # numbers that overflow are refused in a sentence of ours, or end in a result that is checked
            warnings.simplefilter("ignore", RuntimeWarning)
            app(prog_name=NAME)
    except IrbcalError as error:
        print(f"irbcal: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.filename is not None:  # a name too long, a circle of links, a disk that fails
            print(f"irbcal: {IrbcalError(str(error.strerror), file=error.filename)}", file=sys.stderr)
            sys.exit(1)
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"irbcal: cannot write the output: {error.strerror}", file=sys.stderr)
        sys.exit(1)
