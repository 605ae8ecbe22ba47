"""The front door of a study: options, result, interruption; folders are tested through the command."""

import signal

import pytest

from irbcal import parallel
from irbcal.errors import OptionError
from irbcal.parallel import Interrupted
from irbcal.studies import folder, runner
from irbcal.studies.settings import COURSE, NOMINAL, repetitions
from irbcal.studies.stage import Stage

OPTIONS = {
    "procedures": (80, 120),
    "each": 2,
    "poses_curve": (80,),
    "method": "least-squares",
    "points": 520,
    "seed": 4,
}


@pytest.fixture(scope="module")
def filled(small, done, tmp_path_factory):
    """A folder in which all but the watched search is done."""
    out = tmp_path_factory.mktemp("runner") / "study"
    folder.open_folder(small, out)
    for repetition, kept in done.items():
        folder.keep(out, repetition, *kept)
    return out


def test_a_finished_folder_is_told_of(filled, frame):
    found = runner.study(out=filled, **OPTIONS, only=["7.1", "7.13"])
    assert (found.done, found.kept) == (0, 5)
    assert found.only == ("7.1", "7.13")
    assert list(found.to_dict()["tables"]) == ["7.1", "7.13"]
    assert found.to_dict()["settings"]["procedures"] == [80, 120]
    assert len(found.to_frame()) == len(frame)
    assert found.table("7.13").rows[0][0] == "A"
    text = found.summary()
    assert "Table 7.1." in text
    assert "Table 7.4." not in text
    assert "0 calibrations done, 5 found finished" in text
    assert len(repr(found)) < 2000
    assert "simulated calibrations by least-squares" in repr(found)
    assert "figure-7-4" in found.figures
    assert len(found.plot("figure-7-4").axes) == 1


def test_what_the_folder_cannot_fill_is_refused(filled):
    found = runner.study(out=filled, **OPTIONS, only=["7.1"])
    with pytest.raises(OptionError, match=r"^figure: expected expected-found, curve-iso_cube.*found 'figure-7-2'$"):
        found.plot("figure-7-2")
    with pytest.raises(OptionError, match=r"^table: expected 7\.1, 7\.2"):
        found.table("7.17")


def test_options_are_checked_before_anything_is_written(tmp_path):
    out = tmp_path / "new"
    for options, sentence in (
        ({"only": ["7.17"]}, "unknown table '7.17': tables are 7.1, 7.2"),
        ({"jobs": 0}, "jobs: expected 1 or more, found 0"),
        ({"model": "12"}, "unknown model '12': choose one of 11, 16, 26, 34"),
    ):
        with pytest.raises(OptionError) as caught:
            runner.study(out=out, **(OPTIONS | options))
        assert str(caught.value).startswith(sentence)
        assert caught.value.parameter == next(iter(options))
    assert not out.exists()


def test_an_interruption_says_what_is_left(small, done, stage, tmp_path, monkeypatch):
    folder.open_folder(small, tmp_path)
    folder.keep(tmp_path, NOMINAL, *done[NOMINAL])

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "_compute", interrupted)
    monkeypatch.setattr(Stage, "of", lambda settings: stage)
    said = []
    with pytest.raises(Interrupted, match="the same call goes on from there") as caught:
        runner.study(out=tmp_path, **OPTIONS, progress=said.append)
    assert caught.value.left == len(repetitions(small)) - 1
    assert said == ["poses measured"]
    assert COURSE in repetitions(small)


def test_one_job_runs_in_this_process(small, done, stage, tmp_path, monkeypatch):
    def refused(*arguments, **options):
        raise AssertionError("a process was started")

    monkeypatch.setattr(parallel, "_apart", refused)
    monkeypatch.setattr(runner, "finished", lambda stage, repetition: done[repetition])
    monkeypatch.setattr(Stage, "of", lambda settings: stage)
    said = []
    found = runner.study(out=tmp_path / "s", **OPTIONS, jobs=1, only=["7.13"], progress=said.append)
    assert (found.done, found.kept) == (4, 0)
    assert said == ["poses measured", *(f"{k} of 4 calibrations" for k in (1, 2, 3, 4))]


def test_an_interruption_of_one_job_waits_for_the_calibration_under_way(small, done, stage, tmp_path, monkeypatch):
    def interrupted(stage, repetition):
        signal.raise_signal(signal.SIGINT)
        return done[repetition]

    monkeypatch.setattr(runner, "finished", interrupted)
    monkeypatch.setattr(Stage, "of", lambda settings: stage)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted) as caught:
        runner.study(out=tmp_path / "s", **OPTIONS, jobs=1, only=["7.13"])
    assert caught.value.left == 3
    assert signal.getsignal(signal.SIGINT) is before
