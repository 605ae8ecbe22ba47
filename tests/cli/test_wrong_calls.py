"""Refused options become wrong calls that name the option as the command line does."""

import pytest
import typer
from typer.testing import CliRunner

from irbcal.cli.main import app
from irbcal.cli.programs import read_frames
from irbcal.cli.signature import refusals
from irbcal.errors import MeasurementError, OptionError


def refused(error, *arguments):
    with pytest.raises(typer.BadParameter) as found, refusals(arguments):
        raise error
    return found.value


def test_options_are_named():
    found = refused(OptionError("two cycles or more", parameter="set_size"))
    assert (found.param_hint, str(found)) == ("--set-size", "two cycles or more")
    assert refused(OptionError("give one", parameter="measurements"), "measurements").param_hint == "MEASUREMENTS"
    assert refused(OptionError("no")).param_hint is None


def test_other_refusals_stay_what_they_are():
    with pytest.raises(MeasurementError, match="too few"), refusals():
        raise MeasurementError("too few")


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["calibrate", "m.csv", "--robot", "irb1600", "--out", ""], "--out"),
        (["calibrate", "m.csv", "--robot", "irb1600", "--out", "o", "--free", "gain2", "--hold", "gain2"], "--hold"),
        (
            ["calibrate", "m.csv", "--robot", "irb1600", "--out", "o", "--verify", "v.csv", "--holdout", "0.2"],
            "--holdout",
        ),
        (["calibrate", "m.csv", "--robot", "irb1600", "--out", "-"], "--out"),
        (["filter", "cal", "job.mod", "--out", "-"], "--out"),
        (["iso9283", "m.csv", "--plan", "irb1600"], "MEASUREMENTS"),
        (["ik", "irb1600", "--poses", "p.csv", "--near", "0,0,0,0,0,0", "--all-branches"], "--near"),
        (["report", "cal", "--format", "svg"], "--format"),
        (["simulate", "--robot", "irb1600", "--random", "99999999999", "--out", "m.csv"], "--random"),
        (["simulate", "--robot", "irb1600", "--random", "9", "--tracker", "2e9,0,0", "--out", "m.csv"], "--tracker"),
    ],
)
def test_contradictions_and_absurd_values_are_wrong_calls(words, option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert option in done.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["report", "c", "--language", "DE"], "expected en, de, fr, ja or zh, found 'DE': did you mean de?"),
        (["calibrate", "m", "--robot", "r", "--split", "randm"], "found 'randm': did you mean ra"),
        (["plan", "--robot", "r", "--criterion", "it's"], """found "it's\""""),
        (["calibrate", "m", "--robot", "r", "--holdout", "abc"], "found 'abc'"),
        (
            ["plan", "--robot", "irb1600", "--out", "p", "--poses", "9"],
            "--cube, --all-range and --optimal say how many",
        ),
        (["plan", "--robot", "r", "--optimal=3.5"], "found '3.5'"),
        (["fleet", "export", "--out", "a.csv", "--what", "robotts"], "found 'robotts': did you mean robots?"),
    ],
)
def test_a_wrong_choice_is_refused_with_all_choices_and_the_nearest(words, sentence):
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    said = " ".join(done.output.replace("│", " ").split())  # however wide the box is
    assert sentence in said
    assert "Value error" not in said
    assert "what: what:" not in said


def test_of_several_wrong_frames_the_first_option_is_refused_whatever_the_order_of_hashes():
    with pytest.raises(typer.BadParameter) as refusal:
        read_frames({"where": "x", "wobj": ["x"], "tool": ["x"]}, None)
    assert refusal.value.param_hint == "--tool"


def test_a_frame_is_refused_by_both_names_of_its_option():
    with pytest.raises(typer.BadParameter) as refusal:
        read_frames({"wobj": ["x"]}, None)
    assert refusal.value.param_hint == "--wobj (--frame)"


def test_a_tool_in_millimetres_is_refused_where_programs_count_in_metres(tmp_path):
    (tmp_path / "job.script").write_text("def job():\n  movej([0,0,0,0,0,0])\nend\n")
    with pytest.raises(typer.BadParameter, match="expected a position in metres"):
        read_frames({"tool": ["active=0,0,150,0,0,0"]}, tmp_path / "job.script")


def test_standard_input_is_refused_where_a_file_is_read(tmp_path):
    done = CliRunner().invoke(app, ["calibrate", "-", "--robot", "irb1600", "--out", str(tmp_path / "cal")])
    assert "only irbcal fk, ik, view and stream read standard input" in str(done.exception)
