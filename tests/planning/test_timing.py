"""How long a plan takes, by hand."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import make
from irbcal.planning.scene import open_scene
from irbcal.planning.wish import Wish


def call(*arguments):
    """Run the command in this process; errors come through."""
    done = CliRunner().invoke(app, ["plan", *map(str, arguments)], catch_exceptions=False, standalone_mode=False)
    return done


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A plan with poses of every kind: folder, plan.csv, what --json printed."""
    out = tmp_path_factory.mktemp("plan") / "new" / "plan"
    kinds = ("--axis", 18, "--cube", 12, "--all-range", 12, "--optimal", 12, "--candidates", 150)
    done = call("--out", out, *kinds, "--targets", "thesis", "--payload", 3, "--json")
    return out, pd.read_csv(out / "plan.csv"), json.loads(done.stdout)


def test_times_follow_from_speed_wait_and_readings():
    """The first axis move: 30 degrees with the tip 815 mm from axis 1, at 250 mm/s."""
    scene = open_scene("irb1600", without=SOLID)
    made = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=0.25, wait_s=3.0, references=0))
    _, _, _, time = made.expected()
    first = np.pi / 6 * 0.815 / 0.25
    assert time[:4] == pytest.approx([first + 3, first + 5.5, first + 8, first + 10.5 + first + 3], rel=1e-3)
    quick = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=7.0, wait_s=3.0))
    assert quick.stops[0] == pytest.approx(30 / 150)  # joint 1 turns 150 degrees a second
