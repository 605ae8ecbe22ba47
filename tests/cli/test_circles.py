"""``irbcal circles`` as a user meets it, and the model of ``calibrate --method circles``."""

import json

import numpy as np
import pytest
from one_joint import one_joint_moves, true_robot
from support import TARGETS, arm, measured, write_measurements
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import OptionError


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Moves of one joint and other poses of a robot with errors of all links."""
    path = tmp_path_factory.mktemp("circles") / "moves.csv"
    robot = true_robot(arm("irb1600"), 2, 0.002)
    q, groups = one_joint_moves(0.0, degrees=(-60, -30, 0, 30, 60))
    q, groups = np.vstack([q, arm("irb1600").random_joints(20, 1)]), [*groups, *["all_range"] * 20]
    points = measured(robot, q, 2e-5, np.random.default_rng(0), groups)
    return write_measurements(path, points, groups=True), robot


def test_the_command_prints_all_parts(file, tmp_path):
    path, robot = file
    drawn = tmp_path / "cad.csv"
    cells = [f"{name},{','.join(str(1e3 * v) for v in place)}\n" for name, place in TARGETS.items()]
    drawn.write_text("target,x_mm,y_mm,z_mm\n" + "".join(cells))
    done = CliRunner().invoke(app, ["circles", str(path), "--robot", "irb1600", "--drawn", str(drawn), "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert [found["base"][f"{a}_mm"] for a in "xyz"] == pytest.approx(robot.T_world_base[:3, 3] * 1e3, abs=0.5)
    assert max(found["base"]["std_mm"]) < 0.5
    assert len(found["compared"]) == 3
    text = CliRunner().invoke(app, ["circles", str(path), "--robot", "irb1600", "--part", "tool"]).stdout
    assert "Targets in the tip link, from the last two axes" in text
    wrong = ["circles", str(path), "--robot", "irb1600", "--part", "base", "--parallel", "forced"]
    assert CliRunner().invoke(app, wrong).exit_code == 2


def test_the_model_of_method_circles_is_never_another_one_silently(file):
    path, _ = file
    for model in ("34", "nominal", "best-level"):
        with pytest.raises(OptionError) as refused:
            irbcal.calibrate(path, "irb1600", model, method="circles")
        assert refused.value.parameter == "model"
    with pytest.raises(OptionError, match="parallel: only method circles"):
        irbcal.calibrate(path, "irb1600", "26", parallel="forced")
    kept = irbcal.calibrate(path, "irb1600", method="circles")
    assert kept.validated.fit.level == "26"
    assert any("Method circles takes all link geometry" in note for note in kept.record.notes)
    assert (
        irbcal.calibrate(path, "irb1600", "26", method="circles").record.heldout.all.mean_mm
        == kept.record.heldout.all.mean_mm
    )
    forced = irbcal.calibrate(path, "irb1600", method="circles", parallel="forced")
    assert forced.validated.fit.robot.table.beta[2] == forced.validated.fit.robot.table.alpha[2] == 0.0
    assert forced.record.heldout.all.mean_mm > 2 * kept.record.heldout.all.mean_mm, "the tilt of 2 mrad is real"
