"""Options made from a function's source: units, defaults, explanations, and panels for experts."""

import json
import pickle
import re
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main, show, signature
from irbcal.cli.main import COMMANDS, app
from irbcal.declared_options import options_of
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.option_values import number
from irbcal.planning import device_plan, measuring_plan
from irbcal.units import DEG, MM
from irbcal.validation.conformity import requirement


def shown(*words):
    done = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1"}).invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return done.stdout


def test_values_are_read_in_the_units_of_a_shell_and_defaults_shown_so():
    assert signature.MM.read(2.5, "--band") == pytest.approx(0.0025, abs=1e-15)
    assert signature.DEG.as_typed(30 * DEG) == pytest.approx(30, abs=1e-9)
    pose = signature.numbers("X,Y,Z[,QW,QX,QY,QZ]", 3, 7, units=[MM, MM, MM, 1.0])
    assert pose.read("1,2,3,1,0,0,0", "--tool") == pytest.approx([0.001, 0.002, 0.003, 1, 0, 0, 0], abs=1e-15)
    assert pose.as_typed([0.001, 0.0, 0.25]) == "1,0,250"
    assert "[default: 150.0]" in shown("ballbar", "--help")


def test_functions_are_named_as_a_shell_calls_them():
    text = "As `irbcal.import_measurements`, `irbcal.fleet_prior` and `irbcal.robots` do, of `irbcal.io.urdf.UrdfArm`."
    assert signature.for_shells("A file (in Python also a table): what is measured.", ()) == "A file: what is measured."
    assert signature.for_shells(text, ()) == "As irbcal import, irbcal fleet prior and irbcal robots do, of UrdfArm."


def test_an_explanation_comes_from_the_docstring_even_where_that_names_another_function():
    texts, compared = (
        {item.name: signature.explained(item, [other.name for other in options]) for item in options}
        for _, options in map(options_of, ("evaluate", "compare"))
    )
    assert compared["refit_from"] == texts["refit_from"]
    assert "--refit-tool" in texts["refit_from"]
    assert "`" not in "".join(texts.values())
    of_links, of_workers = (
        {item.text for name in functions for item in options_of(name)[1] if item.name == option}
        for option, functions in (
            ("tip_link", ("read_urdf", "calibrate", "plan", "simulate", "forward_kinematics", "view", "controller")),
            ("jobs", ("parallel.using", "calibrate", "evaluate", "inverse_kinematics", "fleet_add")),
        )
    )
    assert of_links == {"Tip link of the arm: tool0, flange, ee_link, tcp or the last link unless given."}
    assert len(of_workers) == 1
    for command in ("corners", "hand-eye"):
        assert "pip install 'irbcal[camera]'" in shown(command, "--help")


def test_options_for_experts_are_shown_on_request():
    short, whole = shown("calibrate", "--help"), shown("calibrate", "--help-all")
    assert "│ --power " not in short
    assert "│ --power " in whole
    assert "bool" not in whole
    assert "list[" not in whole
    assert "nelder-mead" in whole, "choices come from the docstring"
    assert re.search("Measurements ─.*Model ─.*--model .*--terms .*--method .*--hold .*╯", short, re.DOTALL)


@pytest.mark.parametrize("command", sorted({*COMMANDS} - {"fleet"}))
def test_the_first_help_is_short_and_its_panels_are_few(command):
    short, whole = (shown(command, option) for option in ("--help", "--help-all"))
    assert {*re.findall(r"╭─ (\w+)", short)} <= {"Arguments", "Options", "Everyday", "Measurements", "Model"}
    assert {*re.findall(r"╭─ (\w+)", whole)} - {*re.findall(r"╭─ (\w+)", short)} <= {"Expert"}
    if len(re.findall("│ +--", short)) > 15 or command in ("cell", "filter", "ik", "import"):
        assert "╭─ Expert" in whole
    lines = CliRunner(env={"COLUMNS": "80", "NO_COLOR": "1"}).invoke(app, [command, "--help"]).stdout.count("\n")
    assert lines <= 115
    assert "Python" not in whole


def test_the_list_of_commands_has_no_options_for_experts():
    for group in ([], ["fleet"]):
        assert shown(*group, "--help-all") == shown(*group, "--help")


@pytest.mark.parametrize("command", sorted({*COMMANDS} - {"fleet"}))
def test_help_says_what_a_value_is(command):
    assert not re.search(r"<(str|path|file|int|float|list)\b", shown(command, "--help-all"))


def test_what_is_typed_is_passed_on_even_where_it_is_the_default(monkeypatch):
    """30 degrees are the default for reflectors, not for strings."""
    given = {}

    def stop(name):
        def call(*_, **options):
            given[name] = options
            raise OptionError("enough", parameter="seed")

        return call

    monkeypatch.setattr(device_plan, "device_plan", stop("device"))
    monkeypatch.setattr(measuring_plan, "plan", stop("plan"))
    words = ["plan", "--robot", "irb120", "--out", "unused"]
    for more in (["--device", "string", "--acceptance", "30"], []):
        assert CliRunner().invoke(app, [*words, *more]).exit_code == 2
    assert given["device"]["acceptance"] == pytest.approx(30 * DEG, abs=1e-15)
    assert set(given["plan"]) == {"robot", "progress"}


def test_rows_as_csv_and_as_json(capsys):
    frame = pd.DataFrame({"x_mm": [1.0, np.nan], "note": ["", "far"]})
    show.print_rows(frame, as_json=False)
    assert capsys.readouterr().out == "x_mm,note\n1.000000000,\n,far\n"
    show.print_rows(frame, as_json=True)
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(line) for line in lines] == [{"x_mm": 1.0, "note": ""}, {"x_mm": None, "note": "far"}]


def test_numbers():
    assert signature.numbers_in("1,-2.5, 3e1", [3], "--near") == [1.0, -2.5, 30.0]
    for text in ("1,2", "1,2,x", "1,2,inf", ""):
        with pytest.raises(typer.BadParameter, match=r"expected 3 or 4 numbers \(a, b, c\), found"):
            signature.numbers_in(text, [3, 4], "--cube", ("a", "b", "c"))


@pytest.fixture
def place(tmp_path, demo_calibration):
    shutil.copytree(demo_calibration, tmp_path / "cal")
    (tmp_path / "robot.urdf").write_bytes(robots.robot_file("irb1600").read_bytes())
    (tmp_path / "v.csv").write_bytes(robots.demo_file("demo_identification.csv").read_bytes())
    (tmp_path / "job.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,30,0\n")
    return tmp_path


COMMANDS = [
    "filter cal job.csv --out new.csv --changes job.csv",
    "filter cal job.csv --out new.csv --changes new.csv",
    "filter cal job.csv --out cal/calibration.json",
    "view cal v.csv --html v.csv",
    "view robot.urdf --html robot.urdf",
    "view cal --html cal/calibration.json",
    "simulate job.csv --robot robot.urdf --out robot.urdf",
    "simulate job.csv --robot robot.urdf --out job.csv",
    "calibrate v.csv --robot cal/calibrated.urdf --out cal",
    "ballbar cal v.csv --plot v.csv",
    "tracker v.csv --plot v.csv",
    "iso9283 v.csv --plot v.csv",
]


def contents(folder):
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("line", COMMANDS)
def test_inputs_are_never_written(place, monkeypatch, line):
    monkeypatch.chdir(place)
    before = contents(place)
    done = CliRunner().invoke(app, line.split())
    assert done.exit_code in (1, 2), done.output
    assert "to write" in str(done.exception) or "another file" in str(done.exception), done.exception
    assert contents(place) == before


@pytest.mark.parametrize("option", ["--declare", "--urdf"])
def test_what_a_command_writes_is_no_input(place, option):
    file = str(place / "robot.urdf")
    done = CliRunner().invoke(app, ["cell", str(place / "cal"), "touches.csv", "--out", file, option, file])
    assert "expected another file" in str(done.exception)


def test_a_calibration_is_replaced_with_force_only(place):
    before = contents(place)
    line = ["demo", "--model", "11", "--out", str(place / "cal")]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 1
    assert "replace it with --force" in str(done.exception)
    assert contents(place) == before
    assert CliRunner().invoke(app, [*line, "--force"]).exit_code == 0
    assert irbcal.load(place / "cal").record.model == "11"


def test_what_the_list_says_of_a_command_is_what_it_says_of_itself():
    listed = {name: main._summary(name) for name in main.COMMANDS}
    own = {name: " ".join(c.help.partition("\n\n")[0].split()) for name, c in get_command(main.app).commands.items()}
    assert listed == own


def test_only_the_command_that_is_called_is_loaded():
    def loaded(call):
        done = subprocess.run([sys.executable, "-c", code.format(call)], capture_output=True, text=True, check=True)
        return done.stdout

    code = "from irbcal.cli import main; main.application({}); import sys; print(sorted(m for m in sys.modules if m.startswith('irbcal.cli.')))"
    called = loaded("['fk']")
    assert "'irbcal.cli.use'" in called
    assert "'irbcal.cli.prepare'" not in called
    assert "'irbcal.cli.use'" not in loaded("summary=True")


def test_numbers_out_of_range_are_told_in_the_units_of_the_shell():
    with (
        pytest.raises(typer.BadParameter, match=r"expected a number from 0\.001 to 1000, found 5000"),
        signature.refusals(typed={"path_tolerance": signature.MM}),
    ):
        number("path_tolerance", 5.0, 1e-6, 1.0)
    with (
        pytest.raises(typer.BadParameter, match=r"expected a number from 0\.001 to 100, found 500"),
        signature.refusals(typed={"tolerance": signature.MM}),
    ):
        requirement(0.5)
    with pytest.raises(OptionError, match="path_tolerance: expected a number from 1e-06 to 1, found 5") as refused:
        number("path_tolerance", 5.0, 1e-6, 1.0)
    assert str(pickle.loads(pickle.dumps(refused.value))) == str(refused.value)  # it comes back from workers
