"""``irbcal filter`` with programs of URScript, VAL3, INFORM, Kawasaki AS: one, several, and wrong calls."""

import numpy as np
import pytest
from maker_cases import path_of, well_inside
from moves_cases import PULSES, Q
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.correction import languages
from irbcal.correction.moves import JointMove, Moves
from irbcal.correction.program_options import ControllerOptions
from irbcal.errors import IrbcalError
from irbcal.io import urdf
from irbcal.simulation import pose_list
from irbcal.units import DEG

COUNTS = ",".join(map(str, PULSES))
CASES = {
    "urscript": ("ur10", [], 1e-8),
    "val3": ("rx160", [], 1e-7),
    "inform": ("gp8", ["--pulses", COUNTS], 0.9e-3 * DEG),
    "kawasaki": ("rs007n", [], 1e-7),
}
"""Robot, options, and how far joints may be off from those of the same program as CSV, radians: what is printed."""


@pytest.fixture(scope="module", params=list(CASES))
def job(request, tmp_path_factory):
    """A language, its calibration, a program of six joint moves, and the wanted joints."""
    name, options, least = CASES[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    robot = name if name == "ur10" else path_of(name)
    nominal = urdf.read(robot).arm
    found = irbcal.calibrate(irbcal.simulate(robot, random=30, seed=3, only=[]), robot, model="16")
    irbcal.save(found, folder / "cal")
    q = Q[1] + np.outer(np.arange(6), np.full(6, 5 * DEG)) if name == "ur10" else well_inside(nominal, 6)
    q = np.round(q / DEG, 4) * DEG
    moves = Moves(nominal, q, (JointMove("", 1.0, 0.2, 0.5),) * 6, ("größe",), pulses=PULSES)
    application = folder / "application"
    application.mkdir()
    for file, data in languages.write(languages.by_name()[request.param], moves).items():
        (application / file).write_bytes(data)
    return request.param, robot, nominal, folder, application, q, options, least


def refused(*words):
    """What a command that must not work says."""
    runner = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
    done = runner.invoke(main.app, [*map(str, words)])
    assert done.exit_code in (1, 2)
    assert done.exit_code == 2 or isinstance(done.exception, IrbcalError)
    return done.output + (str(done.exception) if done.exit_code == 1 else "")


def joints(path, robot, nominal):
    return pose_list.read_program(
        path, nominal, pose_list.given_for(robot, nominal, path, ControllerOptions(pulses=PULSES))
    )[0]


def test_corrected_joints_are_those_of_the_same_rows_in_csv(job, tmp_path, program):
    language, robot, nominal, folder, application, q, options, least = job
    source = application if language == "val3" else next(application.iterdir())
    out = tmp_path / ("out" if language == "val3" else f"out{source.suffix}")
    program("filter", folder / "cal", source, "--out", out, *options)
    header = ",".join(nominal.joint_columns)
    rows = joints(source, robot, nominal) / DEG
    np.savetxt(tmp_path / "job.csv", rows, delimiter=",", header=header, comments="", fmt="%.9f")
    irbcal.correct(folder / "cal", tmp_path / "job.csv", out=tmp_path / "new.csv")
    expected = np.loadtxt(tmp_path / "new.csv", delimiter=",", skiprows=1, usecols=range(6)) * DEG
    np.testing.assert_allclose(joints(out, robot, nominal), expected, rtol=0, atol=least)
    assert np.abs(expected - q).max() > 1e-4
    marked = out / "plan.dtx" if language == "val3" else out
    fingerprint = irbcal.load(folder / "cal").record.fingerprint
    assert languages.language_of(marked).fingerprint(marked.read_bytes(), "x").replace("_", "-") == fingerprint
    again = tmp_path / f"again{out.suffix}"
    assert "fake targets already" in refused("filter", folder / "cal", out, "--out", again, *options)
    assert not again.exists()


def test_several_files_go_into_a_folder(job, tmp_path):
    language, robot, nominal, folder, application, q, options, least = job
    if language == "val3":
        pytest.skip("an application is a folder in any case")
    source = next(application.iterdir())
    sources = [tmp_path / f"{name}{source.suffix}" for name in ("A", "B")]
    for k, file in enumerate(sources):
        text = source.read_bytes()
        file.write_bytes(text.replace(b"#plan", b"#p%d_" % k) if language == "kawasaki" else text)
    words = ["filter", folder / "cal", *sources, "--out", tmp_path / "both", *options]
    done = CliRunner().invoke(main.app, [*map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    for file in sources:
        found = joints(tmp_path / "both" / file.name, robot, nominal)
        assert len(found) == len(q)
        assert np.abs(found - q).max() > max(1e-4, least)


WRONG = (
    (["--pulses", "1,2,3"], "expected 6 numbers"),
    (["--pulses", "a,b"], "expected 6 numbers"),
    (["--tool", "1=0,0"], "expected NAME="),
    (["--frame", "0,0,0,0,0,0"], "expected NAME="),
    (["--where", "1,2,3"], "expected J1,…,J6=X,Y,Z,O,A,T"),
)


def test_wrong_options(job, tmp_path):
    language, _, _, folder, application, *_ = job
    asked = "quarter turns about z" if language == "kawasaki" else "need no pair of joints and pose"
    for words, expected in (*WRONG, (["--where", "1,2,3,4,5,6=1,2,3,4,5,6"], asked)):
        said = refused("filter", folder / "cal", application, "--out", tmp_path / "out", *words)
        assert expected in " ".join(said.replace("│", " ").split())
        assert list(tmp_path.iterdir()) == []
