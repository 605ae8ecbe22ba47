"""``irbcal joints`` as a user meets it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support import arm, measured, random_robot, write_measurements

from irbcal.cli import main
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.plotting import charts


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command; returns exit code, stdout and stderr."""

    def irbcal(*arguments):
        monkeypatch.setattr("sys.argv", ["irbcal", "joints", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "120")
        monkeypatch.setenv("NO_COLOR", "1")
        code = 0
        try:
            main.main()
        except SystemExit as end:
            code = end.code or 0
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return irbcal


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Simulated: joint 6 with a backlash of 0.04 degrees there and back, and random poses of a whole robot."""
    folder, rng = tmp_path_factory.mktemp("axes"), np.random.default_rng(5)
    nominal = arm("irb1600")
    up = np.radians(np.arange(-180, 181, 20.0))
    q = np.zeros((2 * len(up), 6))
    q[:, 5] = np.r_[up, up[::-1]]
    q[:, 4] = 0.5
    effective = q.copy()
    effective[1:, 5] -= np.radians(0.02) * np.sign(
        np.r_[np.diff(q[:, 5])[: len(up) - 1], [1.0], np.diff(q[:, 5])[len(up) :]]
    )
    truth = Robot(
        nominal, None, frames.transform(None, [3.0, 0.5, 0.2]), {"smr1": [0.1, 0, 0.1], "smr2": [0, 0.1, 0.1]}
    )
    points = measured(truth, effective, 1e-5, rng, np.full(len(q), "axis6", object))
    write_measurements(folder / "moves.csv", replace(points, q=q), groups=True)
    robot = random_robot(nominal, "34", rng)
    q = nominal.random_joints(60, 4) * 0.6
    write_measurements(folder / "random.csv", measured(robot, q, 3e-5, rng))
    return folder


def test_moves_without_a_robot(run, data, tmp_path):
    code, out, err = run(data / "moves.csv", "--plots", tmp_path / "figures")
    assert (code, err) == (0, "")
    assert "backlash joint 6: 0.04" in out
    assert "no " not in out.partition("Verdict")[2].split("\n")[1]
    assert "backlash of joint 6" in out
    figures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert figures == ["angular_errors.png", "errors_axis6.png", "fourier_joint_6.png"]
    for name in figures:
        with Image.open(tmp_path / "figures" / name) as image:
            assert image.width > 600
            # something is drawn: not one colour, and more than black on white
            colours = image.convert("RGB").getcolors(1 << 20)
            assert len(colours) > 50
            # no figure is drawn over its right edge
            edge = np.asarray(image.convert("L"))[:, -3:]
            assert edge.min() > 250


def test_json_of_random_poses_with_a_robot(run, data, tmp_path, monkeypatch):
    monkeypatch.setattr(charts, "DPI", 20)
    code, out, _ = run(data / "random.csv", "--robot", "irb1600", "--json", "--plots", tmp_path / "figures")
    assert code == 0
    found = json.loads(out)
    assert found["moves"] == []
    assert found["residuals"]["poses"] == 60
    kinds = [(term["kind"], term["joint"]) for term in found["residuals"]["terms"]]
    assert kinds == [(kind, k) for kind in ("backlash", "move", "gain", "fourier") for k in range(1, 7)] + [
        ("stiffness", None)
    ]
    assert found["residuals"]["needed"][0]["kind"] in ("stiffness", "fourier")
    assert len(found["plots"]) == 4
    assert len(found["verdict"]) > 0
    # only one joint, the series' order and frequency as asked
    code, out, _ = run(
        data / "random.csv", "--robot", "irb1600", "--json", "--joint", 6, "--order", 3, "--frequency", 2
    )
    series = next(term for term in json.loads(out)["residuals"]["terms"] if term["kind"] == "fourier")
    assert (series["joint"], list(series["values"]), series["frequency"]) == (
        6,
        ["a1", "b1", "a2", "b2", "a3", "b3"],
        [2.0],
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["random.csv"], "random.csv"),
        (["moves.csv", "--joint", "3"], "axis3"),
        (["random.csv", "--robot", "irb120"], "irb120"),
        (["absent.csv"], "there is no such file"),
        (["random.csv", "--calibration", "nowhere"], "nowhere"),
    ],
)
def test_refusals(run, data, arguments, sentence):
    code, out, err = run(data / arguments[0], *arguments[1:])
    assert (code, out) == (1, "")
    assert sentence in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments", [["--frequency", "often"], ["--robot", "irb120", "--calibration", "x"], ["--order", "0"]]
)
def test_wrong_calls(run, data, arguments):
    assert run(data / "moves.csv", *arguments)[0] == 2
