"""Tools that stand and parts that the robot holds: from touches, and in programs of makers that have them."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from maker_cases import given, pose_numbers, poses, robot_of, well_inside
from rapid_modules import parsed
from scipy.spatial.transform import Rotation
from support import Posed, arm, assert_derivative, assert_same_poses, random_robot
from touching import START, TIP, reach

from irbcal.cell.adjusted_cell import Adjusted, adjust
from irbcal.cell.cell_file import FIXED_TOOL, HELD_PART, TOOL, CellFile, FrameInCell, read_cell
from irbcal.cell.frames_from_touches import _covariance
from irbcal.cell.touches import read_touches
from irbcal.correction.cell_frames import cell_frames
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.declarations import declared
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import krl, rapid
from irbcal.correction.maker import configuration_of
from irbcal.correction.notation import numbers_from_poses
from irbcal.correction.true_frames import CELL, TrueFrames, part_errors
from irbcal.errors import CalibrationError, MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.modeling.certainty import Certainty, FitLimits
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.term import Term

PART = frames.transform(frames.rotation_from_vector([0.1, 0.9, 0.4]), [0.05, 0.02, 0.15])
"""The part in the tip link."""
CAD = np.array([[10, 20, 30], [210, 20, 30], [210, 170, 30], [10, 170, 30], [110, 90, 80]]) * 1e-3
TURN = frames.rotation_from_vector([0.2, -0.1, 0.4])
SIDES = {"origin": [0.0, 0.0, 0.0], "x": [0.1, 0.0, 0.0], "xy": [0.02, 0.1, 0.0]}


def nozzle(robot):
    """The fixed tool in the base link: where the part's origin is at one pose."""
    return frames.transform(TURN, (robot.poses(START[None])[0] @ PART)[:3, 3])


def touches_of(robot, fixed=("origin",), part="cad", probe=5, sides=2, cad=CAD):
    """SIMULATED touches without noise."""
    rng, T_nozzle = np.random.default_rng(1), nozzle(robot)
    socket = frames.apply(robot.poses(START[None])[0], TIP[None])[0]
    rows = []

    def add(frame, name, point, tool, place, local, xyz=("", "", "")):
        rows.append([frame, name, point, tool, *np.degrees(reach(robot, place, rng, local)), *xyz])

    for _ in range(probe):
        add("tool", "probe", "socket", "", socket, TIP)
    for point in fixed:
        add("fixed_tool", "nozzle", point, "probe", frames.apply(T_nozzle, np.array([SIDES[point]]))[0], TIP)
    if part == "cad":
        for k, c in enumerate(np.repeat(cad, sides, axis=0)):
            add(
                "held_part",
                "door",
                f"p{k // sides}",
                "nozzle",
                T_nozzle[:3, 3],
                frames.apply(PART, c[None])[0],
                c * 1e3,
            )
    else:
        for point, c in SIDES.items():
            add("held_part", "door", point, "nozzle", T_nozzle[:3, 3], frames.apply(PART, np.array([c]))[0])
    columns = ["frame", "name", "point", "tool", *robot.arm.joint_columns, "x_mm", "y_mm", "z_mm"]
    return pd.DataFrame(rows, columns=columns)


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"fixed": SIDES},
        {"part": "pendant"},
        {"fixed": SIDES, "part": "pendant"},
        {"fixed": (), "probe": 0},
        {"fixed": (), "probe": 0, "sides": 1},
        {"sides": 1, "cad": CAD[:3]},
    ],
)
def test_without_noise_the_truth_comes_back(record, robot, kind, tmp_path):
    """With and without axes of the fixed tool, by CAD points and as pendants do, with a probe and by the part alone."""
    cell_frames(record, touches_of(robot, **kind), out=tmp_path / "cell.json")
    cell = read_cell(tmp_path / "cell.json")
    found = cell.work_objects["nozzle"]
    assert_same_poses(cell.tools["door"].T_true, PART, 1e-8, 1e-7)
    np.testing.assert_allclose(found.T_true[:3, 3], nozzle(robot)[:3, 3], rtol=0, atol=1e-8)
    if "fixed" in kind and len(kind["fixed"]) == 3:
        assert_same_poses(found.T_true, nozzle(robot), 1e-8, 1e-7)
    assert found.position_only is ("fixed" not in kind or len(kind["fixed"]) < 3)
    assert cell.tools["door"].fixed_tool
    assert found.fixed_tool
    assert cell.left_out == ()


def test_a_part_measured_in_the_gripper(record, robot):
    """A tracker measures points of the part at some joints."""
    rows = []
    for k, c in enumerate(CAD):
        q = START + 0.1 * k
        place = frames.apply(robot.T_world_base @ robot.poses(q[None])[0] @ PART, c[None])[0]
        rows.append(["held_part", "door", f"p{k}", "", *np.degrees(q), *(c * 1e3), *(place * 1e3)])
    tracker = [f"tracker_{axis}_mm" for axis in "xyz"]
    columns = ["frame", "name", "point", "tool", *robot.arm.joint_columns, "x_mm", "y_mm", "z_mm", *tracker]
    cell = cell_frames(record, pd.DataFrame(rows, columns=columns))
    assert_same_poses(cell.tools["door"].T_true, PART, 1e-8, 1e-7)


@pytest.mark.parametrize("fixed", [("origin",), SIDES])
def test_residuals_have_their_derivatives_and_intervals_hold(robot, fixed):
    """The tip link shifted at random at each touch: 95 % of the errors are within 1.96 deviations."""
    rng = np.random.default_rng(3)
    rows, source = read_touches(touches_of(robot, fixed), robot.arm)
    q = np.array([touch.q for touch in rows])
    T, sigma = robot.poses(q), np.full(len(rows), 1e-4)

    def drawn(size):
        moved = T.copy()
        moved[:, :3, 3] += rng.normal(scale=size, size=(len(q), 3))
        return adjust(rows, Posed(robot, q, moved), sigma, source)

    adjusted = drawn(1e-3)
    problem, state = adjusted.problem, adjusted.state
    assert_derivative(
        lambda u: -Adjusted(problem, problem.moved(state, u / problem.sizes)).rows[1],
        np.zeros(problem.nuisance),
        adjusted.rows[0],
        1e-3,
        1e-5,
    )
    exact = adjust(rows, robot, sigma, source)
    names = [(TOOL, "probe"), (HELD_PART, "door"), (FIXED_TOOL, "nozzle")]
    M = np.concatenate([exact.motions(*name, np.eye(3)) for name in names])
    std = np.sqrt(np.diagonal(M @ _covariance(exact, robot.certainty)[0] @ M.T))
    errors = []
    for _ in range(50):
        steps = [frames.inverse(exact.frame(*name)) @ found for name in names for found in [adjusted.frame(*name)]]
        errors.append(np.concatenate([np.r_[frames.vector_from_rotation(s[:3, :3]), s[:3, 3]] for s in steps]))
        adjusted = drawn(1e-4)
    shown = std > 0
    assert 0.92 < np.mean(np.abs(np.array(errors[1:]))[:, shown] < 1.96 * std[shown]) < 0.98


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frame": ("held_part", "part")}, "found 'part'"),
        ({"tool": ("nozzle", "")}, "expected the fixed tool that held part door was brought to, found nothing"),
        ({"tool": ("probe", "")}, "expected the tool that touched fixed tool nozzle, found nothing"),
        ({"x_mm": (10, "")}, "expected the point's coordinates in the held part, all or none"),
        ({"name": ("door", "probe")}, "probe is the name of a tool and held part: give them different names"),
    ],
)
def test_rows_that_are_no_touches_are_refused(record, robot, change, words):
    table = touches_of(robot).astype(object)
    ((column, (old, new)),) = change.items()
    table[column] = [new if value == old else value for value in table[column]]
    with pytest.raises(MeasurementError, match=re.escape(words)):
        cell_frames(record, table)


def test_touches_that_do_not_show_part_or_tool_are_refused(record, robot):
    table = touches_of(robot)
    of_part = table["frame"] == "held_part"
    with pytest.raises(MeasurementError, match="held part door"):
        cell_frames(record, table[~of_part | (table["point"] == "p0")])
    with pytest.raises(MeasurementError, match="held part door: its points with coordinates are on a line"):
        cell_frames(record, table[~of_part | table["point"].isin(["p0", "p1"])])
    turned = touches_of(robot, fixed=(), probe=0, sides=1, cad=CAD[:3])
    with pytest.raises(MeasurementError):
        cell_frames(record, turned.assign(**{f"q{k}_deg": turned[f"q{k}_deg"].iloc[0] for k in range(1, 7)}))


def test_a_fixed_tool_that_is_named_wrongly_once_is_refused(record, robot):
    table = touches_of(robot)
    table.loc[table.index[-1], "tool"] = "nozle"
    with pytest.raises(MeasurementError, match="fixed tool nozle has no rows of its own, and 1 of parts"):
        cell_frames(record, table)


def test_swapped_points_are_named(record, robot):
    """Two points of the part touched in the other order: the touches contradict one another, which is told."""
    table = touches_of(robot)
    rows = table.index[table["frame"] == "held_part"][[0, 2]]
    joints = [*robot.arm.joint_columns]
    table.loc[rows, joints] = table.loc[rows[::-1], joints].to_numpy()
    cell = cell_frames(record, table)
    assert any("is left out" in text or "touch again" in text for text in cell.left_out)


# ---------------------------------------------------------------- programs

MOTION = frames.from_xyz_angles([0.0011, -0.0007, 0.0015, 0.001, -0.002, 0.0015])
PART_TAUGHT = frames.from_xyz_angles([0.03, -0.05, 0.2, 0.1, 0.4, -0.2])
FIXED_TAUGHT = frames.from_xyz_angles([0.9, 0.2, 0.6, 0.3, -0.2, 0.5])
TRUE_PART, TRUE_TOOL = PART_TAUGHT @ MOTION, np.linalg.inv(MOTION) @ FIXED_TAUGHT


def cell_with(part, tool):
    named = {part: FrameInCell(part, TRUE_PART, TRUE_PART, fixed_tool=True)}
    stands = {tool: FrameInCell(tool, TRUE_TOOL, TRUE_TOOL, fixed_tool=True)}
    return CellFile("abc123", "robot", True, named, stands, np.zeros((12, 12)), np.zeros((12, 12)), np.zeros((12, 0)))


def off(robot, q, P):
    """Distance (m) and angle (rad) of the true fixed tool in the true part from where it is wanted, at most."""
    T = np.linalg.inv(P) @ np.linalg.inv(robot.forward(q) @ TRUE_PART) @ TRUE_TOOL
    turned = Rotation.from_matrix(T[:, :3, :3]).magnitude()
    return np.linalg.norm(T[:, :3, 3], axis=1).max(), turned.max()


def abb_pose(T):
    row = numbers_from_poses(T[None])[0]
    return "[[{:.6f},{:.6f},{:.6f}],[{:.10f},{:.10f},{:.10f},{:.10f}]]".format(*row)


def rapid_program(nominal, q):
    """Targets of a fixed tool in a part that the robot holds, and the same as joints."""
    wanted = np.linalg.inv(nominal.forward(q) @ PART_TAUGHT) @ FIXED_TAUGHT
    cfx = closed_form.configuration(nominal, q)
    far = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    lines = [
        "MODULE M",
        f"PERS tooldata nozzle:=[FALSE,{abb_pose(FIXED_TAUGHT)},[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'PERS wobjdata door:=[TRUE,TRUE,"",{abb_pose(PART_TAUGHT)},[[0,0,0],[1,0,0,0]]];',
    ]
    for k, T in enumerate(wanted):
        conf = configuration_of(q[k], int(cfx[k]))
        lines.append(f"CONST robtarget p{k}:=[{abb_pose(T)[1:-1]},{[*conf]},{far}];")
        lines.append(f"CONST jointtarget j{k}:=[{[round(float(a), 8) for a in np.degrees(q[k])]},{far}];")
    lines.append("PROC main()")
    for k in range(len(q)):
        lines += [f"MoveJ p{k},v100,fine,nozzle\\WObj:=door;", f"MoveAbsJ j{k},v100,fine,nozzle\\WObj:=door;"]
    return "\n".join([*lines, "ENDPROC", "ENDMODULE", ""]).encode(), wanted


@pytest.mark.parametrize("numbers", ["same", "from-cell"])
def test_rapid_brings_the_part_to_the_true_tool(numbers):
    """The true part is at the true tool; the controller commands these joints with its own numbers, or the cell's."""
    nominal = arm()
    robot, q = random_robot(nominal, "34", np.random.default_rng(3), size=0.1), well_inside(nominal, 6)
    data, wanted = rapid_program(nominal, q)
    known = TrueFrames(cell_with("door", "nozzle"), numbers=numbers)
    found = filter_program(parsed(data), CorrectionModel(robot, nominal, "abc123", true_frames=known))
    assert found.unchanged_targets == ()
    assert found.unknown_frames is None
    q_of = dict(zip(found.targets, found.q, strict=True))
    for word in "pj":
        by_word = np.array([q_of[f"{word}{k}"] for k in range(6)])
        assert off(robot, by_word, wanted) == pytest.approx((0.0, 0.0), abs=2e-7), word
    own = (PART_TAUGHT, FIXED_TAUGHT) if numbers == "same" else (TRUE_PART, TRUE_TOOL)
    text = found.data.decode()
    rows = re.findall(r"robtarget p\d:=\[\[([^\]]*)\],\[([^\]]*)\]", text)
    new = np.array([[float(x) for x in ",".join(row).split(",")] for row in rows])
    P = np.tile(np.eye(4), (6, 1, 1))
    P[:, :3, 3], P[:, :3, :3] = new[:, :3] / 1e3, Rotation.from_quat(new[:, [4, 5, 6, 3]]).as_matrix()
    asked = own[1] @ np.linalg.inv(P) @ np.linalg.inv(own[0])
    assert_same_poses(asked, nominal.forward(np.array([q_of[f"p{k}"] for k in range(6)])), 1e-6, 1e-6)


def test_frames_of_another_module_and_mixed_frames():
    """Fixed tool and part of a module beside; a tool in the hall with a work object in the hall is refused."""
    nominal = arm()
    data, _ = rapid_program(nominal, well_inside(nominal, 3))
    frames_of_cell = "".join(line + "\n" for line in data.decode().splitlines() if "data " in line)
    moves = "".join(line + "\n" for line in data.decode().splitlines() if "data " not in line)
    known = rapid.frames_in_numbers(
        rapid.Literals(rapid._listing(f"MODULE C\n{frames_of_cell}ENDMODULE\n".encode(), "c"), {}).reader
    )
    assert [*known["tooldata"]] == ["door"]
    assert [*known["wobjdata"]] == ["nozzle"]
    apart = parsed(moves.encode(), tools=known["tooldata"], work_objects=known["wobjdata"])
    whole = parsed(data)
    assert len(apart.correctable()) == len(whole.correctable()) == 6
    np.testing.assert_allclose(
        apart.tip_poses(apart.correctable("pose")), whole.tip_poses(whole.correctable("pose")), rtol=0, atol=1e-12
    )
    hall = parsed(data.replace(b"\\WObj:=door", b""))
    assert "robhold FALSE" in hall.targets[0].reason


def kuka_program(nominal, q, inverted, whole=True):
    """Points of an external TCP with S and T, counted in the part (``inverted``) or at the tool."""
    T = np.linalg.inv(FIXED_TAUGHT) @ nominal.forward(q) @ PART_TAUGHT
    T = np.linalg.inv(T) if inverted else T
    (part,), (tool,) = (pose_numbers(frame[None], "ZYX") for frame in (PART_TAUGHT, FIXED_TAUGHT))

    def text(values):
        return ",".join(f"{name} {value:.6f}" for name, value in zip("XYZABC", values, strict=True))

    lines = ["DEF job()", f"TOOL_DATA[2]={{{text(part)}}}", f"BASE_DATA[3]={{{text(tool)}}}"]
    lines += ["$TOOL=TOOL_DATA[2]", "$BASE=BASE_DATA[3]", "$IPO_MODE=#TCP"]
    for joints, row in zip(q, pose_numbers(T, "ZYX"), strict=True):
        wrist = nominal.forward(joints[None])[0]
        wrist = wrist[:3, 3] - 0.215 * wrist[:3, 2]
        a = np.degrees(joints)
        back = wrist[0] * np.cos(joints[0]) - wrist[1] * np.sin(joints[0]) < 0
        s = int(back) | 2 * int(a[2] >= np.degrees(np.arctan2(-0.041, 1.0))) | 4 * int(a[4] < 0)
        t = sum(1 << k for k in range(6) if a[k] < 0)
        lines.append(f"LIN {{{text(row)}{f',S {s},T {t}' if whole else ''}}}")
    return "\n".join([*lines, "END", ""]).encode()


@pytest.mark.parametrize("inverted", [False, True])
def test_kuka_points_are_taken_as_their_postures_say(inverted):
    nominal, robot, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 8)
    program = krl.parse(nominal, [("job.src", kuka_program(nominal, q, inverted))], given(at))
    assert [target.inverted for target in program.targets] == [inverted] * 8
    np.testing.assert_allclose(program.tools["2"], at.T_tip_flange @ PART_TAUGHT, atol=1e-8)
    cell = cell_with("2", "3")
    known = TrueFrames(cell, ends=at)
    found = filter_program(program, CorrectionModel(robot, nominal, "abc123", true_frames=known))
    assert found.unchanged_targets == ()
    wanted = np.linalg.inv(nominal.forward(q) @ PART_TAUGHT) @ FIXED_TAUGHT
    assert off(robot, found.q, wanted) == pytest.approx((0.0, 0.0), abs=2e-7)
    rows = re.findall(r"LIN \{([^}]*)\}", found.files["job.src"].decode())
    new = poses([[float(x) for x in re.findall(r"[XYZABC] ([-\d.]+)", row)] for row in rows], "ZYX")
    new = np.linalg.inv(new) if inverted else new
    asked = FIXED_TAUGHT @ new @ np.linalg.inv(PART_TAUGHT)
    assert_same_poses(asked, nominal.forward(found.q), 1e-6, 1e-6)


def test_kuka_points_whose_postures_do_not_say_it_are_left():
    nominal, robot, at = robot_of("kr120r2500pro")
    data = kuka_program(nominal, well_inside(nominal, 4), True, whole=False)
    found = filter_program(
        krl.parse(nominal, [("job.src", data)], given(at)), CorrectionModel(robot, nominal, "abc123")
    )
    assert len(found.unchanged_targets) == 4
    assert all("the tool is fixed and the part on the robot" in left.reason for left in found.unchanged_targets)
    assert found.files["job.src"] == data


def test_drawn_errors_are_as_large_as_expected():
    """Part, fixed tool and a zero of the robot are drawn: the error is that where the tool meets the part."""
    nominal, rng = arm(), np.random.default_rng(0)
    q = well_inside(nominal, 3)
    data, wanted = rapid_program(nominal, q)
    term = Term(1, "rz", "constant", 1e-3, "zero", "geometry")
    zero, size = np.zeros((7, 7)), np.array([3e-4, 2e-4, 4e-4, 1e-4, 2e-4, 1.5e-4] * 2)
    zero[6, 6] = 2e-4**2
    limits = FitLimits(leave_one_out_mm={"": 0.0}, leave_fifths_out_mm={}, ranges=[[-9.0] * 6, [9.0] * 6])
    robot = Robot(nominal, certainty=Certainty(nominal, (term,), zero, (), np.zeros(1), limits))
    cell = cell_with("door", "nozzle")
    cell = CellFile(
        "x", "r", True, cell.tools, cell.work_objects, np.diag(size**2), np.diag(size**2), np.zeros((12, 7))
    )
    known, program = TrueFrames(cell), parsed(data)
    (batch,) = [batch for batch in program.wanted_targets() if batch.kind == "pose"]
    at = known.frames_of(program, batch, nominal)
    assert {*at.origins} == {CELL}
    np.testing.assert_allclose(at.contact, wanted[:, :3, 3], atol=1e-7)
    found = filter_program(program, CorrectionModel(robot, nominal, "x", true_frames=known))
    q_true = np.array([row for name, row in zip(found.targets, found.q, strict=True) if name[0] == "p"])
    mean, u95 = part_errors(robot, cell, q_true, at).T
    errors = []
    for _ in range(600):
        m, moved = size * rng.standard_normal(12), q_true.copy()
        moved[:, 1] += 2e-4 * rng.standard_normal()
        motions = [frames.transform(Rotation.from_rotvec(m[k : k + 3]).as_matrix(), m[k + 3 : k + 6]) for k in (0, 6)]
        T = np.linalg.inv(TRUE_TOOL @ motions[1]) @ nominal.forward(moved) @ TRUE_PART @ motions[0]
        errors.append(np.linalg.norm((T @ wanted)[:, :3, 3], axis=1))
    np.testing.assert_allclose(np.mean(errors, axis=0), mean, rtol=0.04)
    assert 0.93 < (np.array(errors) < u95).mean() < 0.97


def test_declarations_have_what_holds_what():
    tools, stands = {"door": TRUE_PART}, {"nozzle": TRUE_TOOL}
    text = declared("abb", tools, stands, {"door", "nozzle"})
    known = rapid.frames_in_numbers(rapid.Literals(rapid._listing(text.encode(), "cell.mod"), {}).reader)
    np.testing.assert_allclose(known["tooldata"]["door"], TRUE_PART, atol=1e-6)
    np.testing.assert_allclose(known["wobjdata"]["nozzle"], TRUE_TOOL, atol=1e-6)
    assert "PERS tooldata nozzle:=[FALSE," in text
    assert 'PERS wobjdata door:=[TRUE,TRUE,"",' in text
    with pytest.raises(OptionError, match="held part 1: how fanuc has fixed tools is not known"):
        declared("fanuc", {"1": TRUE_PART}, {"2": TRUE_TOOL}, {"1", "2"})


def test_a_cell_that_is_not_written_leaves_its_other_files_alone(record, robot, tmp_path):
    """A file of others in the place of the cell: neither declaration nor page is written without it."""
    (tmp_path / "cell.json").write_text("{}")
    files = {"out": tmp_path / "cell.json", "report": tmp_path / "cell.html", "declare": tmp_path / "cell.mod"}
    with pytest.raises(CalibrationError, match=r"cell\.json: .* name another one, or replace it with --force"):
        cell_frames(record, touches_of(robot), as_="abb", **files)
    assert [path.name for path in tmp_path.iterdir()] == ["cell.json"]


def test_the_command(record, robot, demo_calibration, tmp_path, program):
    """Touches, cell, declaration, page and corrected program on the command line."""
    touches_of(robot).to_csv(tmp_path / "touches.csv", index=False)
    ran = program("cell", demo_calibration, tmp_path / "touches.csv", "--out", tmp_path / "cell.json", "--as", "abb",
                  "--declare", tmp_path / "cell.mod", "--report", tmp_path / "cell.html")  # fmt: skip
    assert "held part" in ran
    assert "fixed tool" in ran
    assert "held part" in (tmp_path / "cell.html").read_text()
    kinds = {touch["frame"] for touch in json.loads((tmp_path / "cell.json").read_text())["touches"]}
    assert kinds == {"tool", "fixed_tool", "held_part"}
