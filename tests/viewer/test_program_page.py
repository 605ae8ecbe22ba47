"""The page of a corrected program: where the tool goes before and after, by joints from an independent reading."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured, random_robot, write_measurements
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.correction.filter import correct
from irbcal.io.opening import open_calibration
from irbcal.viewer.program_page import changed_moves, program_view, singularities

FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
Q = np.array([[10, -14, 14, 0, 30, 0], [-20, 5, 10, 20, 40, 10], [30, -10, 25, 10, 35, 60.0]])
TOOL = [0.05, 0.0, 0.12]


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    nominal = arm()
    folder = tmp_path_factory.mktemp("page")
    truth = random_robot(nominal, "34", np.random.default_rng(1), size=0.1)
    points = measured(truth, nominal.random_joints(60, 1), 5e-5, np.random.default_rng(3))
    write_measurements(folder / "fit.csv", points)
    irbcal.save(irbcal.calibrate(folder / "fit.csv", "irb1600", "34", holdout=10), folder / "cal")
    return folder / "cal"


@pytest.fixture
def program(tmp_path):
    """Targets are declared in another order than they are gone to; one is left."""
    lines = ["MODULE M", "PERS tooldata t:=[TRUE,[[50,0,120],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"]
    for k in (2, 0, 1):
        lines.append(f"CONST jointtarget j{k}:=[[{','.join(map(str, Q[k]))}],{FAR}];")
    moves = [f"MoveAbsJ j{k},v100,fine,t;" for k in (0, 1, 2, 0)]
    lines += ["PROC main()", *moves, "MoveL Offs(p9,1,2,3),v100,fine,t;", "ENDPROC", "ENDMODULE", ""]
    path = tmp_path / "job.mod"
    path.write_text("\n".join(lines))
    return path


def test_places_are_those_of_the_tool_centre_point(calibration, program):
    found = correct(calibration, program)
    nominal, robot = arm(), open_calibration(calibration).robot_calibrated()
    order = [2, 0, 1]
    assert [str(t) for t in found.targets] == [f"j{k}" for k in order]
    q = np.radians([[float(v) for v in re.search(rb"j%d:=\[\[([^\]]*)" % k, found.data)[1].split(b",")] for k in order])
    poses = nominal.forward(np.radians(Q[order])), robot.forward(np.radians(Q[order])), robot.forward(q)
    for column, T in enumerate(poses):
        np.testing.assert_allclose(found.positions[:, column], T[:, :3, :3] @ TOOL + T[:, :3, 3], rtol=0, atol=2e-8)
    assert found.visited.tolist() == [1, 2, 0, 1]
    scene = program_view(calibration, found).scene
    np.testing.assert_allclose(
        scene.points.distance("nominal"),
        np.linalg.norm(found.positions[:, 0] - found.positions[:, 1], axis=1),
        rtol=0,
        atol=1e-12,
    )
    assert scene.points.distance("nominal").min() > 5e-5
    assert scene.points.distance("calibrated").max() < 1e-7
    np.testing.assert_array_equal(scene.path, found.positions[[1, 2, 0, 1], 0])
    assert scene.title == "job.mod: 3 targets corrected, 1 left"
    assert scene.pose_ids[0] == "j2 (line 3)"
    assert any("left as it was" in note and "(line 11)" in note for note in scene.notes)


def test_singularities_and_changed_moves_are_named(calibration, program, tmp_path):
    found = correct(calibration, program)
    robot = open_calibration(calibration).robot_calibrated()
    nominal, names = robot.arm, ["a", "b", "c"]
    q = found.q.copy()
    q[1, 4] = np.radians(1.0)
    # central differences of the tip's pose: degrees of joint 4 or 6 for one degree of the tool
    step, columns = 1e-6, []
    for k in range(6):
        low, high = nominal.forward(np.stack([q[1] - step * np.eye(6)[k], q[1] + step * np.eye(6)[k]]))
        turn = (high[:3, :3] - low[:3, :3]) @ low[:3, :3].T / (2 * step)
        moved = (high[:3, 3] - low[:3, 3]) / (2 * step)
        columns.append([*moved / 1.5, turn[2, 1], turn[0, 2], turn[1, 0]])
    gain = 1 / np.linalg.svd(np.array(columns).T)[1][-1]
    (sentence,) = singularities(nominal, replace(found, q=q), 1.5, names)
    assert sentence.startswith("next to a singularity: b: joint ")
    assert float(re.search(r"turns by (\d+) degrees", sentence)[1]) == pytest.approx(gain, abs=0.6)
    assert gain > 30
    # what the correction itself changes is a tenth of a degree
    assert changed_moves(nominal, found, names) == []
    q = found.q_before.copy()
    q[found.visited[0], 0] += np.radians(3.0)
    # joint 1 turns from 10 to -20 degrees, then from 13; from j2 joint 6 turns farther than it
    assert changed_moves(nominal, replace(found, q=q), names) == [
        "another speed: from b to c a joint turns by 33.0 degrees, 30.0 before"
    ]


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_writes_the_page_of_what_it_would_write(calibration, program, tmp_path):
    page = tmp_path / "page.html"
    result = run("filter", calibration, program, "--out", tmp_path / "new.mod", "--page", page)
    assert result.exit_code == 1, "one target is left"
    assert not (tmp_path / "new.mod").exists()
    text = page.read_text(encoding="utf-8")
    assert '"mode":"program"' in text
    assert "left as it was" in text
    before = program.read_bytes()
    result = run("filter", calibration, program, "--out", tmp_path / "new.mod", "--page", program)
    assert result.exit_code != 0
    assert program.read_bytes() == before
