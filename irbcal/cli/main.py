"""Entry point of the ``irbcal`` command."""

import errno
import os
import sys
from typing import Annotated

import typer

from irbcal.cli import (
    axes,
    ballbar,
    calibrate,
    demo,
    evaluate,
    filter,
    fk,
    ik,
    import_,
    iso9283,
    plan,
    simulate,
    study,
    tracker,
    verify,
    view,
)
from irbcal.errors import IrbcalError

app = typer.Typer(
    name="irbcal",
    help="Calibrate six-axis robots from laser-tracker measurements: corrected URDF, joint map, proof.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool):
    if wanted:
        from importlib.metadata import version

        print(f"irbcal {version('irbcal')}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
):
    """Calibrate six-axis robots from laser-tracker measurements: corrected URDF, joint map, proof."""


app.command("demo")(demo.demo)
app.command("import")(import_.import_files)
app.command("plan")(plan.plan)
app.command("simulate")(simulate.simulate)
app.command("study")(study.study)
app.command("calibrate")(calibrate.calibrate)
app.command("evaluate")(evaluate.evaluate)
app.command("verify")(verify.verify)
app.command("fk")(fk.fk)
app.command("ik")(ik.ik)
app.command("filter")(filter.filter_program)
app.command("axes")(axes.axes)
app.command("iso9283")(iso9283.iso9283)
app.command("tracker")(tracker.tracker)
app.command("ballbar")(ballbar.ballbar)
app.command("view")(view.view)


def main():
    """Run a command; refusals become one sentence on stderr and exit code 1."""
    try:
        app()
    except IrbcalError as error:
        print(f"irbcal: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"irbcal: cannot write the output: {error.strerror}", file=sys.stderr)
        sys.exit(1)
