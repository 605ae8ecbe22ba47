"""Options of the main job: what is refused, and that one declaration makes the option wherever it appears."""

import inspect
import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pandas as pd
import pytest

import irbcal
from irbcal.calibration_options import AT_FEATURES, OF_AUTO, OF_LEVELS, CalibrationOptions
from irbcal.correction.cell_options import CellOptions
from irbcal.correction.correction_options import CorrectionOptions
from irbcal.correction.program_options import ProgramOptions
from irbcal.declared_options import changed_options, fields_of, options_of
from irbcal.errors import OptionError
from irbcal.planning.plan_options import PlanOptions
from irbcal.simulation.simulation_options import DeviceOptions, SimulationOptions
from irbcal.validation.evaluation_options import EvaluationOptions

PACKAGE = Path(irbcal.__file__).parent
NEW = '''
    grease: Annotated[float | None, MEASUREMENTS, Bounds(0.0, 5.0), OF_AUTO] = None
    """Grammes of grease in the wrist, not with ``same_tool``."""
'''
BEFORE = """
import inspect, json, irbcal
from typer.testing import CliRunner
from irbcal.cli.main import application

def said(call, *arguments, **options):
    try:
        return call(*arguments, **options)
    except irbcal.IrbcalError as error:
        return str(error)

runner = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1"})
"""
ASK = """
from irbcal.fleet.batch import read_manifest

line = ["calibrate", "m.csv", "--robot", "irb120", "--out", "new"]
print(json.dumps({
    "signature": str(inspect.signature(irbcal.calibrate).parameters["grease"]),
    "docstring": inspect.getdoc(irbcal.calibrate),
    "help": runner.invoke(application(["calibrate"]), ["calibrate", "--help"]).output,
    "bounds": said(irbcal.calibrate, "m.csv", "irb120", grease=6),
    "typed": runner.invoke(application(["calibrate"]), [*line, "--grease", "6"]).output,
    "level": said(irbcal.calibrate, "m.csv", "irb120", 34, grease=1.5),
    "features": said(irbcal.calibrate, "m.csv", "irb120", features="f.csv", grease=1.5),
    "listed": [entry.options for entry in read_manifest("robots.csv")],
    "refused": said(read_manifest, "wrong.csv"),
}))
"""


def with_field(folder, file, before, field):
    """A copy of the package, of links, with a field put into a class of options."""
    copy, file = folder / "irbcal", Path(file)
    for place in reversed(file.parents):
        (copy / place).mkdir()
        for part in (PACKAGE / place).iterdir():
            if (inside := place / part.name) != file and inside not in file.parents:
                (copy / inside).symlink_to(part)
    source = (PACKAGE / file).read_text()
    changed = source.replace(before, textwrap.indent(textwrap.dedent(field), "    ") + before, 1)
    assert changed != source
    (copy / file).write_text(changed)


def answers(folder, code):
    """What a Python in that folder prints, from JSON."""
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_new_option_is_declared_in_one_place(tmp_path):
    """A field and the text below it: signature, docstring, help, bounds, refusals, lists of robots follow."""
    with_field(tmp_path, "calibration_options.py", "    jobs: Annotated", NEW)
    for name, grease in (("robots.csv", "1.5"), ("wrong.csv", "much")):
        (tmp_path / name).write_text(f"id,measurements,robot,options\na,m.csv,irb120,grease={grease}\n")
    told = answers(tmp_path, BEFORE + ASK)
    assert told["signature"] == "grease: 'float | None' = None"
    assert "grease : float | None\n    Grammes of grease in the wrist, not with ``same_tool``.\n" in told["docstring"]
    (row,) = [line for line in told["help"].splitlines() if "--grease" in line]
    assert "Grammes of grease in the wrist, not with --same-tool." in row
    assert told["help"].index("Measurements ─") < told["help"].index("--grease") < told["help"].index("Model ─")
    assert told["bounds"] == "grease: expected a number from 0 to 5, found 6"
    assert "Invalid value for --grease" in told["typed"]
    assert "expected a number from 0 to 5, found 6" in told["typed"]
    assert told["level"] == "grease: only model auto takes it: leave it out, or model 34"
    assert told["features"] == "grease: rows at features do not take it, leave it out"
    assert told["listed"] == [{"grease": 1.5}]
    assert "grease: expected a number, found 'much'" in told["refused"]


BEACON = '''
    beacon: Annotated[Literal["red", "blue"], CONTROLLERS] = "red"
    """Colour of the beacon on the controller, not with ``pulses``."""
'''
OF_CONTROLLERS = {"correct": "filter", "cell_frames": "cell", "simulate": "simulate", "needed_touches": "cell"}
"""Functions that read programs, and their commands."""
ASK_EACH = """
print(json.dumps({
    name: {
        "signature": str(inspect.signature(getattr(irbcal, name)).parameters["beacon"]),
        "docstring": inspect.getdoc(getattr(irbcal, name)),
        "help": runner.invoke(application([command]), [command, "--help-all"]).output,
        "bounds": said(getattr(irbcal, name), "a", "b", beacon="green"),
    }
    for name, command in COMMANDS.items()
}))
"""


def test_a_new_option_of_programs_is_declared_once_for_all_that_reads_programs(tmp_path):
    before = "    pulses: Annotated"
    with_field(tmp_path, "correction/program_options.py", before, BEACON)
    told = answers(tmp_path, f"COMMANDS = {OF_CONTROLLERS!r}\n{BEFORE}{ASK_EACH}")
    for function in OF_CONTROLLERS:
        words = told[function]
        assert words["signature"] == """beacon: "Literal['red', 'blue']" = 'red'"""
        text = "beacon : {'red', 'blue'}\n    Colour of the beacon on the controller, not with ``pulses``.\n"
        assert text in words["docstring"]
        (row,) = [line for line in words["help"].splitlines() if "--beacon" in line]
        assert "Colour of the beacon on the controller, not with --pulses. [default: red]" in row
        assert "Expert ─" in words["help"][: words["help"].index("--beacon")]
        assert words["bounds"] == "beacon: expected red or blue, found 'green'"


@pytest.mark.parametrize(
    ("function", "options"),
    [
        ("calibrate", CalibrationOptions),
        ("evaluate", EvaluationOptions),
        ("plan", PlanOptions),
        ("correct", CorrectionOptions),
        ("needed_touches", ProgramOptions),
        ("cell_frames", CellOptions),
        ("simulate", SimulationOptions),
        ("simulate_device", DeviceOptions),
    ],
)
def test_every_option_is_explained_and_has_a_type(function, options):
    call, options = getattr(irbcal, function), fields_of(options)
    assert [option.name for option in options] == list(inspect.signature(call).parameters)
    assert all(option.text.endswith(".") and option.annotation for option in options)
    assert call.__doc__.index("Parameters\n---") < call.__doc__.index("Raises\n---")
    assert options == options_of(function)[1]
    assert "See `" not in call.__doc__, "what another function explains stands here, too"
    assert max(map(len, call.__doc__.splitlines())) <= 120


def test_marks_say_what_goes_together():
    assert {mark for option in fields_of(CalibrationOptions) for mark in option.marks} >= {
        AT_FEATURES,
        OF_AUTO,
        OF_LEVELS,
    }


def test_what_is_given_is_what_differs_from_the_defaults():
    table = pd.DataFrame({"pose": [1, 2]})
    options = CalibrationOptions(table, "irb1600", free=[], hold=["gain1"], verify=table, seed=0, frame=None)
    assert changed_options(options) == ["measurements", "robot", "verify", "hold"]
    assert changed_options(options, OF_LEVELS) == ["hold"]


@pytest.mark.parametrize(
    ("options", "parameter"),
    [
        ({"split": "first"}, "split"),
        ({"holdout": 2.5}, "holdout"),
        ({"holdout": float("inf")}, "holdout"),
        ({"free": "gain*"}, "free"),
        ({"model": "99"}, "model"),
    ],
)
def test_wrong_options_are_named(options, parameter):
    with pytest.raises(OptionError) as refused:
        CalibrationOptions("m.csv", "irb1600", **options)
    assert refused.value.parameter == parameter


@pytest.mark.parametrize(
    ("options", "parameter", "words"),
    [
        ({"holdout": "abc"}, "holdout", "holdout: expected a fraction below 1 or a whole number, found 'abc'"),
        ({"holdout": -1}, "holdout", "holdout: expected a fraction below 1 or a whole number, found -1"),
        ({"seed": -1}, "seed", "seed: expected a whole number of at least 0, found -1"),
        ({"power": "8"}, "power", "power: expected a number of at least 2, found '8'"),
        ({"power": 9.0}, "power", "power: only objective pnorm has a power"),
        ({"frame": "ref1,ref2,ref3"}, "frame", "one text: give ['ref1', 'ref2', 'ref3']"),
        ({"frame": ("ref1", "ref2")}, "frame", "three reference points, found 2"),
        ({"hold": "gain*"}, "hold", "hold: expected a sequence of names"),
        ({"free": ["gain1", "gain2"], "hold": ["gain2"]}, "hold", "hold: gain2 is to be freed, too"),
        ({"verify": "v.csv", "holdout": 0.25}, "holdout", "leave one out"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_sentence(options, parameter, words):
    with pytest.raises(OptionError) as refused:
        CalibrationOptions("m.csv", "irb1600", **options)
    assert words in str(refused.value)
    assert refused.value.parameter == parameter


def test_the_share_held_out_is_a_quarter_unless_given():
    assert [
        CalibrationOptions("m.csv", "irb1600", **options).share for options in ({}, {"holdout": 5}, {"verify": "v.csv"})
    ] == [
        0.25,
        5,
        0.25,
    ]


def test_a_level_may_be_given_as_a_number():
    assert CalibrationOptions("m.csv", "irb1600", model=34).model == "34"
    with pytest.raises(OptionError, match="found '35'"):
        CalibrationOptions("m.csv", "irb1600", model=35)
