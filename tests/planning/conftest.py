"""A plan with poses of every kind, as the command writes it."""

import json

import pandas as pd
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app


def call(*arguments):
    """Run the command in this process; errors come through."""
    done = CliRunner().invoke(app, ["plan", *map(str, arguments)], catch_exceptions=False, standalone_mode=False)
    return done


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A plan with poses of every kind: folder, plan.csv, what --json printed."""
    out = tmp_path_factory.mktemp("plan") / "new" / "plan"
    kinds = ("--axis", 18, "--cube", 12, "--all-range", 12, "--optimal", 12, "--candidates", 150)
    done = call("--out", out, *kinds, "--targets", "thesis", "--payload", 3, "--json")
    return out, pd.read_csv(out / "plan.csv"), json.loads(done.stdout)
