"""The front door of the viewer: what it says, saves and serves, in Python and on the command line."""

import http.client
import pickle
import re
import signal
import subprocess
import sys
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest
from support import arm, started
from typer.testing import CliRunner
from viewer_page import data_of

import irbcal
from irbcal.cli.main import app
from irbcal.errors import IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.units import MM


def get(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    connection.request("GET", path)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def test_notebooks_get_a_frame_of_their_own(view):
    text = view._repr_html_()
    assert text.startswith("<iframe sandbox=")
    assert "allow-same-origin" not in text
    srcdoc = re.search(r'srcdoc="([^"]*)"></iframe>$', text)[1]
    assert "<" not in srcdoc
    assert len(srcdoc) > len(view.html)


def test_saving(view, tmp_path):
    assert view.save(tmp_path / "view.html").read_text(encoding="utf-8") == view.html
    assert [path.name for path in tmp_path.iterdir()] == ["view.html"]
    with pytest.raises(IrbcalError, match="found a folder"):
        view.save(tmp_path)


def test_import_stays_quick():
    code = "import irbcal, sys; irbcal.view; print([m for m in ('meshcat', 'pinocchio', 'jinja2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def command(*arguments):
    return [sys.executable, "-m", "irbcal", "view", *map(str, arguments)]


def called(*arguments):
    """The command in this process."""
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


def test_command_serves_until_interrupted(cell):
    with subprocess.Popen(command("irb120", "--port", "0"), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert "joints have sliders" in process.stdout.readline()
            line = process.stdout.readline()
            found = re.search(r"http://127\.0\.0\.1:(\d+)(/\S+)", line)
            port = int(found[1])
            assert f"ssh -L {port}:127.0.0.1:{port}" in process.stdout.readline()
            assert b"irbcal view" in get(port, found[2])[1]
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0


def test_command_writes_a_page(cell, tmp_path):
    done = called(cell / "cal", cell / "poses.csv", "--html", tmp_path / "view.html", "--magnify", 25)
    assert done.exit_code == 0, done.output
    assert "Written to" in done.output
    assert data_of((tmp_path / "view.html").read_text(encoding="utf-8"))["scale"]["common"]["magnification"] == 25


def test_command_refuses_in_one_sentence(cell, tmp_path):
    (tmp_path / "bad.csv").write_text("pose,target,x_mm\n1,a,2\n")
    done = started("view", cell / "cal", tmp_path / "bad.csv", "--html", tmp_path / "view.html")
    assert done.returncode == 1
    assert done.stdout == ""
    assert "missing column" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "view.html").exists()
    assert called("irb120", "--port", "70000").exit_code == 2


def test_a_view_tells_what_is_to_be_seen(cell, view):
    text = view.summary().splitlines()
    assert text[0].endswith("model 34: 40 measured poses, 120 points of smr1, smr2, smr3")
    mean = view.scene.points.distance("calibrated").mean() / MM
    assert f"calibrated {mean:.3f} mm on average" in text[1]
    assert repr(view).startswith("<View: ")
    assert len(repr(view)) < 300
    assert "sliders" in irbcal.view("irb120").headline()


def test_a_plan_is_told_with_its_notes():
    q = arm().random_joints(4, 8)
    q[2:, 1] += 10
    text = irbcal.view("irb1600", plan=q).summary()
    assert "4 poses of a plan, 4 points of tool0" in text
    assert "Note: The plan leaves the joint limits" in text


def test_the_frame_has_a_row_for_each_point(view):
    frame = view.to_frame()
    points = view.scene.points
    assert len(frame) == 120
    assert set(frame["target"]) == {"smr1", "smr2", "smr3"}
    error = frame[[f"measured_{x}_m" for x in "xyz"]].to_numpy() - frame[[f"nominal_{x}_m" for x in "xyz"]].to_numpy()
    np.testing.assert_allclose(np.linalg.norm(error, axis=1), frame["error_nominal_m"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(frame["error_calibrated_m"], points.distance(), rtol=0, atol=0)
    assert "turn_nominal_rad" not in frame
    assert len(irbcal.view("irb120").to_frame()) == 0
    planned = irbcal.view("irb1600", plan=arm().random_joints(4, 8)).to_frame()
    assert [name for name in planned if name.endswith("_m")] == [f"calibrated_{x}_m" for x in "xyz"]


def test_views_are_locked_and_pickle(view):
    again = pickle.loads(pickle.dumps(view))
    assert again.summary() == view.summary()
    with pytest.raises(ValueError, match="read-only"):
        view.scene.points.measured[0, 0] = 1.0


def test_measurements_may_be_a_frame(cell, view):
    shown = irbcal.view(irbcal.load(cell / "cal"), pd.read_csv(cell / "poses.csv"))
    np.testing.assert_allclose(shown.scene.points.measured, view.scene.points.measured, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "error", "parameter"),
    [
        ({"magnify": 0.0}, OptionError, "magnify"),
        ({"magnify": float("nan")}, OptionError, "magnify"),
        ({"plan": np.zeros((0, 6))}, RobotError, "plan"),
        ({"cube": ([0, 0], 1.0)}, RobotError, "cube"),
        ({"plan": np.zeros((1, 6)), "measurements": pd.DataFrame()}, MeasurementError, "plan"),
    ],
)
def test_refusals_name_their_option(options, error, parameter):
    with pytest.raises(error) as caught:
        irbcal.view("irb120", **options)
    assert caught.value.parameter == parameter


@pytest.mark.parametrize("name", ["html", "scene", "more"])
def test_a_view_stays_as_it_is(view, name):
    with pytest.raises(FrozenInstanceError):
        setattr(view, name, "x")


def test_a_page_that_is_written_has_no_port(cell, tmp_path):
    words = ["view", str(cell / "cal"), "--html", str(tmp_path / "v.html"), "--port", "8161"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert "--port" in done.output
    assert not (tmp_path / "v.html").exists()
