"""Tracks and positioners from touches: SIMULATED axes with errors come back, and programs with external axes are right.

The truth is composed here by rotations about lines and shifts along directions, without screws.
"""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pinocchio
import pytest
from maker_cases import given, language_tests, pose_numbers, robot_of, well_inside
from rapid_modules import parsed
from scipy.spatial.transform import Rotation
from support import assert_derivative
from touching import SOCKET, START, TIP, reach

from irbcal.cell.adjusted_cell import Adjusted, adjust
from irbcal.cell.cell_file import AXIS, CellFile, FrameInCell, read_cell
from irbcal.cell.cell_urdf import with_cell
from irbcal.cell.external_axes import carried, read_axes
from irbcal.cell.touches import read_touches
from irbcal.correction.cell_frames import cell_frames
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.declarations import declared
from irbcal.correction.filter import correct
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import fanuc, inform, krl
from irbcal.correction.maker import configuration_of
from irbcal.correction.notation import numbers_from_poses
from irbcal.correction.true_frames import CELL, TargetFrames, TrueFrames, _derivatives
from irbcal.errors import MeasurementError, OptionError, ProgramError, RobotError
from irbcal.io import calibration_folder
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form
from irbcal.units import DEG, MM

T_OBJECT = frames.transform(frames.rotation_from_vector([0.02, -0.05, 0.6]), [0.9, -0.2, 0.55])
NOMINAL = pd.DataFrame(
    {
        "axis": ["e1_mm", "e2_deg", "e3_deg"],
        "carries": ["robot", "fixture", "fixture"],
        "dx": [0, 0, 0],
        "dy": [1, 1, 0],
        "dz": [0, 0, 1],
        "x_mm": ["", 900, 900],
        "y_mm": ["", 0, 0],
        "z_mm": ["", 400, 450],
    }
)
"""A track along y under the robot, a table that tilts about y and turns about z before it."""
DIRECTIONS = np.array([[3e-4, 1.0003, -2e-4], [2e-4, 1.0, 4e-4], [-3e-4, 3e-4, 1.0]])
POINTS = np.array([[0.9003, 0.0, 0.3997], [0.9002, 0.0003, 0.45]])
"""The true axes: 0.3 mm and 0.3 mm per metre beside the nominal ones, the track 0.03 % too long."""


def about(point, direction, angle):
    """Turn about a line."""
    R = Rotation.from_rotvec(angle * direction / np.linalg.norm(direction)).as_matrix()
    return frames.transform(R, point - R @ point)


def true_object(e):
    """The true work object in the base link at positions e (m, rad, rad)."""
    T = about(POINTS[0], DIRECTIONS[1], e[1]) @ about(POINTS[1], DIRECTIONS[2], e[2]) @ T_OBJECT
    return frames.transform(None, -e[0] * DIRECTIONS[0]) @ T


def touches_of(robot, noise=0.0, seed=1, marks=True):
    """A table of touches at several positions of all axes."""
    rng = np.random.default_rng(seed)
    rows = []

    def add(frame, name, point, place, e):
        q = reach(robot, place + rng.normal(scale=noise, size=3) * (noise > 0), rng)
        rows.append([frame, name, point, "grip", *np.degrees(q), e[0] / MM, *np.degrees(e[1:])])

    for track in (0.0, 0.0, 0.0, 0.0, 0.3, -0.3):
        add("tool", "grip", "socket", SOCKET - track * DIRECTIONS[0], [track, 0.0, 0.0])
    points = {"origin": [0, 0, 0], "x": [0.2, 0, 0], "xy": [0.05, 0.15, 0]}
    points |= {"mark": [0.17, 0.12, 0.03]} if marks else {}
    for e in ([0, 0, 0], [0.2, 0.5, 0], [-0.2, 0, 1.5], [0.1, -0.5, -1.2]):
        for point, xyz in points.items():
            add("work_object", "fixture", point, frames.apply(true_object(e), np.array([xyz], dtype=float))[0], e)
    columns = ["frame", "name", "point", "tool", *(f"q{k}_deg" for k in range(1, 7)), *NOMINAL["axis"]]
    return pd.DataFrame(rows, columns=columns)


@pytest.fixture(scope="module")
def touches(robot):
    return touches_of(robot)


def test_without_noise_the_true_axes_come_back(record, touches, tmp_path):
    cell = cell_frames(record, touches, axes=NOMINAL, out=tmp_path / "cell.json")
    np.testing.assert_allclose(cell.tools["grip"].T_true[:3, 3], TIP, rtol=0, atol=1e-5)
    for e in ([0, 0, 0], [0.3, 0.5, 1.0], [-0.3, -0.4, -1.5]):
        by_name = {"e1": e[0] / MM, "e2": e[1] / DEG, "e3": e[2] / DEG}
        T = carried(cell.axes, "Fixture", by_name) @ cell.work_objects["fixture"].T_true
        np.testing.assert_allclose(T, true_object(e), rtol=0, atol=2e-5)
        nominal = carried(cell.axes, "fixture", by_name, nominal=True) @ T_OBJECT
        assert np.abs(nominal - true_object(e)).max() > 1e-4 or not any(e)
    again = read_cell(tmp_path / "cell.json")
    np.testing.assert_array_equal([axis.screw for axis in again.axes], [axis.screw for axis in cell.axes])
    assert again.rows(AXIS, "e3_deg") == slice(24, 30)
    text = "\n".join(map(str, cell.report()))
    assert "External axis e1_mm from -300 to 300: it carries robot up to 0.1" in text


def test_residuals_have_their_derivatives(robot, touches):
    axes = read_axes(NOMINAL)
    rows, source = read_touches(touches, robot.arm, axes)
    adjusted = adjust(rows, robot, np.full(len(rows), 1e-4), source, axes)
    problem, state = adjusted.problem, adjusted.state

    def residuals(u):
        return -Adjusted(problem, problem.moved(state, u / problem.sizes), adjusted.root).rows[1]

    assert_derivative(residuals, np.zeros(problem.nuisance), adjusted.rows[0], 1e-3, 1e-5)
    assert {key[1] for key in problem.layout if key[0] == "screw"} == {"base", "e2_deg", "e3_deg"}


def test_two_touches_of_a_mark_show_a_conveyor(record, robot):
    """The belt's true direction is turned by a degree and 0.05 % too long against what the controller has."""
    belt = Rotation.from_euler("z", 1, degrees=True).apply([0.0, 1.0005, 0.001])
    rng = np.random.default_rng(2)
    points = {"origin": [0, 0, 0], "x": [0.2, 0, 0], "xy": [0.05, 0.15, 0], "mark": [0.1, 0.1, 0.0]}
    places = [("tool", "grip", "socket", SOCKET, 0.0)] * 5
    places += [
        ("work_object", "belt", name, frames.apply(T_OBJECT, np.array([xyz]))[0], 0.0) for name, xyz in points.items()
    ]
    places.append(("work_object", "belt", "mark", places[-1][3] + 0.25 * belt, 250.0))
    rows = [[*head, "grip", *np.degrees(reach(robot, place, rng)), e] for *head, place, e in places]
    columns = ["frame", "name", "point", "tool", *(f"q{k}_deg" for k in range(1, 7)), "e1_mm"]
    axes = pd.DataFrame({"axis": ["e1_mm"], "carries": ["belt"], "dx": [0], "dy": [1], "dz": [0]})
    cell = cell_frames(record, pd.DataFrame(rows, columns=columns).assign(u95_mm=0.05), axes=axes)
    T = carried(cell.axes, "belt", {"e1": 400.0}) @ cell.work_objects["belt"].T_true
    np.testing.assert_allclose(T[:3, 3], T_OBJECT[:3, 3] + 0.4 * belt, rtol=0, atol=5e-5)


# ---------------------------------------------------------------- programs

FIXTURE_CONTROLLER = T_OBJECT @ frames.from_xyz_angles([0.0004, -0.0006, 0.0003, 0.0, 0.0005, 0.0])
TOOL_CONTROLLER = frames.transform(None, TIP + np.array([0.0003, 0.0002, -0.0004]))
POSITIONS = np.array([[0.0, 0.0, 0.0], [0.25, 0.4, 0.8], [-0.25, -0.4, -0.8], [0.1, 0.3, -1.2]])


def controller_object(e):
    """The controller's work object in the base link at positions e: nominal axes."""
    T = about(np.array([0.9, 0.0, 0.4]), np.array([0.0, 1.0, 0.0]), e[1])
    T = T @ about(np.array([0.9, 0.0, 0.45]), np.array([0.0, 0.0, 1.0]), e[2])
    return frames.transform(None, [0.0, -e[0], 0.0]) @ T @ FIXTURE_CONTROLLER


def wanted(robot):
    """Poses of the tool in the work object, with positions of the axes."""
    down, rng = robot.poses(START[None])[0][:3, :3], np.random.default_rng(2)
    for e in POSITIONS:
        for xyz in ([0, 0, 0], [0.2, 0, 0.02], [0.2, 0.15, 0], [0.0, 0.15, 0.05]):
            R = true_object(e)[:3, :3].T @ down @ frames.rotation_from_vector(rng.uniform(-0.1, 0.1, 3))
            yield e, frames.transform(R, xyz)


def rapid_module(nominal, robot, no_track=False):
    """A module for a controller with nominal robot and axes, which has taught tool and work object."""
    frames_of_controller = {"tGrip": TOOL_CONTROLLER}, {"fixture": FIXTURE_CONTROLLER}
    lines, moves = [declared("abb", *frames_of_controller).removesuffix("ENDMODULE\n")], []
    for k, (e, P) in enumerate(wanted(robot)):
        T = controller_object(e) @ P @ np.linalg.inv(TOOL_CONTROLLER)
        q, _ = closed_form.nearest(nominal, closed_form.branches(nominal, T[None]), START)
        conf = configuration_of(q[0], int(closed_form.configuration(nominal, q)[0]))
        row = numbers_from_poses(P[None])[0]
        pose = "[{:.6f},{:.6f},{:.6f}],[{:.10f},{:.10f},{:.10f},{:.10f}]".format(*row)
        first = "9E9" if no_track else f"{e[0] / MM:.4f}"
        axes = f"[{first},{e[1] / DEG:.6f},{e[2] / DEG:.6f},9E9,9E9,9E9]"
        lines.append(f"  CONST robtarget p{k}:=[{pose},[{','.join(map(str, conf))}],{axes}];")
        moves.append(f"    MoveJ p{k},v100,fine,tGrip\\WObj:=fixture;")
    return "\n".join([*lines, "  PROC main()", *moves, "  ENDPROC", "ENDMODULE", ""])


@pytest.mark.parametrize("numbers", ["same", "from-cell"])
def test_the_part_on_the_positioner_is_right(record, robot, tmp_path, numbers):
    """Axes that are 0.3 mm beside the nominal ones, touches with 0.02 mm noise: the part within 0.05 mm."""
    nominal = record.arm(calibrated=False)
    touches = touches_of(robot, 2e-5).replace({"grip": "tGrip"})
    cell = cell_frames(record, touches, axes=NOMINAL, tool={"tgrip": TOOL_CONTROLLER})
    (tmp_path / "job.mod").write_text(rapid_module(nominal, robot))
    found = correct(record, tmp_path / "job.mod", cell=cell, controller_frames=numbers)
    assert len(found.targets) == len([*wanted(robot)])
    assert not any("external axes" in note.text for note in found.notes)
    tool, fixture = TOOL_CONTROLLER, FIXTURE_CONTROLLER
    if numbers == "from-cell":
        tool, fixture = cell.tools["tGrip"].T_true, cell.work_objects["fixture"].T_true
    before, after = (parsed(data).targets for data in ((tmp_path / "job.mod").read_bytes(), found.data))
    errors = {"before": [], "after": []}
    for (e, P), old, new in zip(wanted(robot), before, after, strict=True):
        assert old.external == new.external
        for name, target, Tc, Oc in (
            ("before", old, TOOL_CONTROLLER, FIXTURE_CONTROLLER),
            ("after", new, tool, fixture),
        ):
            T = controller_object(e) @ np.linalg.inv(FIXTURE_CONTROLLER) @ Oc @ target.value @ np.linalg.inv(Tc)
            q, _ = closed_form.nearest(nominal, closed_form.branches(nominal, T[None]), START)
            reached = np.linalg.inv(true_object(e)) @ robot.poses(q)[0] @ frames.transform(None, TIP)
            errors[name].append(np.linalg.norm(reached[:3, 3] - P[:3, 3]) / MM)
    assert max(errors["after"]) < 0.05
    assert np.mean(errors["before"]) > 0.5
    assert (found.frames.part_error[:, 1] > 0).all()


def test_a_target_without_the_position_of_the_track_is_left(record, robot, tmp_path):
    cell = cell_frames(record, touches_of(robot), axes=NOMINAL)
    (tmp_path / "job.mod").write_text(rapid_module(record.arm(calibrated=False), robot, no_track=True))
    with pytest.raises(ProgramError):
        correct(record, tmp_path / "job.mod", out=tmp_path / "out.mod", cell=cell)
    found = correct(record, tmp_path / "job.mod", cell=cell)
    assert {left.reason for left in found.unchanged_targets} == {"it has no position of external axis e1"}


def test_the_error_of_the_part_follows_the_axes(record, robot, touches):
    """The screws drawn from their covariance: the error of a part at the far end is as large as expected."""
    cell = cell_frames(record, touches.assign(u95_mm=0.2), axes=NOMINAL)
    rng, e = np.random.default_rng(0), POSITIONS[1]
    by_name = {"e1": e[0] / MM, "e2": e[1] / DEG, "e3": e[2] / DEG}
    C = cell.touch_covariance
    draws = rng.multivariate_normal(np.zeros(len(C)), C, size=4000, method="eigh")
    P = np.array([0.2, 0.15, 0.0, 1.0])
    T_now = carried(cell.axes, "fixture", by_name) @ cell.work_objects["fixture"].T_true
    at = TargetFrames(
        *(np.array([name], dtype=object) for name in ("grip", "fixture", CELL, CELL)),
        *(np.eye(4)[None] for _ in range(2)),
        np.zeros((1, 3)),
        cell.tools["grip"].T_true[None],
        T_now[None],
        np.eye(4)[None],
        e[None],
        np.zeros((1, 3)),
    )
    q = reach(robot, (T_now @ P)[:3], rng)[None]
    errors = []
    for u in draws[:400]:
        axes = [replace(axis, screw=axis.screw + u[cell.rows(AXIS, axis.column)]) for axis in cell.axes]
        m = u[cell.rows("work_object", "fixture")]
        T_object = cell.work_objects["fixture"].T_true @ frames.transform(frames.rotation_from_vector(m[:3]), m[3:])
        tip = cell.tools["grip"].T_true[:3, 3] + u[cell.rows("tool", "grip")][3:]
        reached = robot.poses(q)[0] @ np.append(tip, 1.0)
        errors.append((np.linalg.inv(carried(axes, "fixture", by_name) @ T_object) @ reached - P)[:3])
    exact = robot.replace(certainty=replace(robot.certainty, covariance=0.0 * robot.certainty.covariance))
    _, by_frames, _ = _derivatives(exact, exact.certainty, cell, q, at, np.array([0]))
    expected = by_frames[0] @ C @ by_frames[0].T
    linear = draws[:400] @ by_frames[0].T
    np.testing.assert_allclose(np.array(errors), linear, rtol=0, atol=2e-5)
    assert np.cov(np.array(errors).T) == pytest.approx(expected, rel=0.2, abs=0.1 * np.abs(expected).max())


def test_the_urdf_of_the_cell_by_pinocchio(demo_calibration, record, robot, tmp_path):
    """Tip of the tool in the work object at positions of all joints, by another library."""
    cell = cell_frames(record, touches_of(robot), axes=NOMINAL)
    made, again = (with_cell(calibration_folder.read(demo_calibration).urdf, record.arm(), cell) for _ in range(2))
    assert made == again
    (tmp_path / "cell.urdf").write_bytes(made)
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "cell.urdf"))
    data = model.createData()
    assert [*model.names][1:] == ["e1", *record.arm().joint_names, "e2", "e3"]
    for e in POSITIONS:
        scales = [np.linalg.norm(axis.screw[3:] if axis.slides else axis.screw[:3]) for axis in cell.axes]
        along = e * scales
        q = np.concatenate([along[:1], START, along[1:]])
        pinocchio.forwardKinematics(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        tool, fixture = (data.oMf[model.getFrameId(name)] for name in ("tool_grip", "work_object_fixture"))
        by_name = {"e1": e[0] / MM, "e2": e[1] / DEG, "e3": e[2] / DEG}
        T_object = carried(cell.axes, "fixture", by_name) @ cell.work_objects["fixture"].T_true
        T = np.linalg.inv(T_object) @ record.arm().forward(START[None])[0] @ cell.tools["grip"].T_true
        np.testing.assert_allclose((fixture.inverse() * tool).homogeneous, T, rtol=0, atol=3e-5)
    with pytest.raises(RobotError, match="a track needs a base that stands: base_link moves with joint_1"):
        with_cell(calibration_folder.read(demo_calibration).urdf, replace(record.arm(), joints_up=1), cell)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axis": ["e1", "e2_deg", "e3_deg"]}, "expected e1_mm"),
        ({"dy": [0, 1, 0]}, "a length of zero"),
        ({"x_mm": ["", "", 900]}, "e2_deg turns: expected a point on it"),
        ({"axis": ["e2_deg", "e2_deg", "e3_deg"]}, "e2_deg"),
    ],
)
def test_axes_that_are_none_are_refused(change, message):
    with pytest.raises(MeasurementError, match=message):
        read_axes(NOMINAL.assign(**change))


def test_touches_that_do_not_show_an_axis_are_refused(record, touches):
    with pytest.raises(MeasurementError, match=r"how the external axis of e[23]_deg moves"):
        cell_frames(record, touches.assign(e3_deg=0.0), axes=NOMINAL)
    with pytest.raises(MeasurementError, match="e2_deg"):
        cell_frames(record, touches.drop(columns="e2_deg"), axes=NOMINAL)
    with pytest.raises(OptionError, match="carries jig, which is neither"):
        cell_frames(record, touches[touches["point"] != "mark"], axes=NOMINAL.assign(carries=["robot", "jig", "jig"]))


# ---------------------------------------------------------------- other makers

TRUE_SCREWS = [
    np.r_[np.zeros(3), DIRECTIONS[0]],
    *(
        np.r_[w, np.cross(p, w)]
        for p, w in zip(POINTS, DIRECTIONS[1:] / np.linalg.norm(DIRECTIONS[1:], axis=1)[:, None], strict=True)
    ),
]
"""The true axes as turns and shifts by one radian or metre."""


def true_cell(tool, fixture):
    """The true frames and axes under the names of a program."""
    nominal = read_axes(NOMINAL.replace({"fixture": fixture}))
    axes = tuple(replace(axis, screw=screw) for axis, screw in zip(nominal, TRUE_SCREWS, strict=True))
    named = ({name: FrameInCell(name, T, T)} for name, T in ((tool, frames.transform(None, TIP)), (fixture, T_OBJECT)))
    return CellFile("abc123", "robot", True, *named, np.zeros((30, 30)), np.zeros((30, 30)), np.zeros((30, 0)), axes)


def programmed(nominal, q):
    """Positions of the axes, and the targets with which this controller commands joints, (n, 4, 4)."""
    e = POSITIONS[np.arange(len(q)) % len(POSITIONS)]
    return e, np.linalg.inv([controller_object(row) for row in e]) @ nominal.forward(q) @ TOOL_CONTROLLER


def kuka(nominal, q):
    """A KRL program on a base that external axes carry; S and T as of its joints."""
    status_and_turn = language_tests("krl").status_and_turn
    lines = ["DEF job()", "BAS(#TOOL,1)", "BAS(#EX_BASE,2)"]
    e, T = programmed(nominal, q)
    for joints, row, at in zip(q, pose_numbers(T, "ZYX"), e, strict=True):
        s, t = status_and_turn(nominal, joints)
        text = ",".join(f"{name} {value:.6f}" for name, value in zip("XYZABC", row, strict=True))
        turns = np.degrees(at[1:])
        lines.append(f"LIN {{{text},S {s},T {t},E1 {at[0] / MM:.4f},E2 {turns[0]:.6f},E3 {turns[1]:.6f}}}")
    return "\n".join([*lines, "END", ""]).encode()


def fanuc_listing(nominal, q):
    """A FANUC listing, the track an axis of the first group, the table the second group."""
    tests = language_tests("fanuc")
    points, (e, T) = [], programmed(nominal, q)
    for k, (joints, row, at) in enumerate(zip(q, pose_numbers(T, "xyz"), e, strict=True), 1):
        turns = np.degrees(at[1:])
        group = f",\n\tE1 = {at[0] / MM:.4f}  mm\n   GP2:\n\tUF : 2, UT : 1,\n\tJ1 = {turns[0]:.6f} deg,\tJ2 = {turns[1]:.6f} deg\n}};"
        points.append(tests.point(k, row, tests.config(joints)).replace("\n};", group))
    return tests.listing([f"L P[{k}] 100mm/sec FINE" for k in range(1, len(q) + 1)], points)


@pytest.mark.parametrize("maker", ["kuka", "fanuc"])
def test_other_makers_bring_the_tool_to_the_true_place(maker):
    """Track and positioner with their errors: the true tool is where it is wanted in the true work object."""
    nominal, robot, at = robot_of("kr120r2500pro" if maker == "kuka" else "m20ia", size=0.05)
    q = well_inside(nominal, 8) if maker == "kuka" else language_tests("fanuc").in_front(nominal, 8)
    tool, fixture = ("1", "ex_base2") if maker == "kuka" else ("1", "2")
    to_controller = np.linalg.inv(at.T_tip_flange), np.linalg.inv(at.T_base_world)
    setup = given(at, {tool: to_controller[0] @ TOOL_CONTROLLER}, {fixture: to_controller[1] @ FIXTURE_CONTROLLER})
    cell = true_cell(tool, fixture)
    e, wanted_now = programmed(nominal, q)
    data = (kuka if maker == "kuka" else fanuc_listing)(nominal, q)

    def read(content):
        name = "job.src" if maker == "kuka" else "job.ls"
        return (
            krl.parse(nominal, [(name, content)], setup)
            if maker == "kuka"
            else fanuc.parse(nominal, content, name, setup)
        )

    program = read(data).on_axes(cell.axes)
    found = filter_program(program, CorrectionModel(robot, nominal, "abc123", true_frames=TrueFrames(cell, ends=at)))
    assert found.unchanged_targets == ()
    reached = np.linalg.inv([true_object(row) for row in e]) @ robot.forward(found.q) @ frames.transform(None, TIP)
    printed = 2e-6 if maker == "kuka" else 2e-5
    assert np.linalg.norm((reached - wanted_now)[:, :3, 3], axis=1).max() < printed
    before = np.linalg.inv([true_object(row) for row in e]) @ robot.forward(q) @ frames.transform(None, TIP)
    assert np.linalg.norm((before - wanted_now)[:, :3, 3], axis=1).mean() > 3e-4
    content = next(iter(found.files.values()))
    text = content.decode("latin-1")
    for k in (1, 2, 3):  # the axes keep their values to the letter
        assert re.findall(rf"(?:E{k}|J{k - 1})\s*=?\s*([-\d.]+) ?(?:mm|deg)?", text) == re.findall(
            rf"(?:E{k}|J{k - 1})\s*=?\s*([-\d.]+) ?(?:mm|deg)?", data.decode("latin-1")
        )
    asked = read(content.replace(b"irbcal", b"x")).on_axes(cell.axes)
    T_asked = asked.tip_poses(asked.correctable("pose"))
    np.testing.assert_allclose(T_asked, nominal.forward(found.q), rtol=0, atol=2e-6 if maker == "kuka" else 3e-5)


def test_bases_of_kuka_on_axes_that_the_cell_does_not_have_are_left():
    nominal, _, at = robot_of("kr120r2500pro")
    data = kuka(nominal, well_inside(nominal, 3))
    setup = given(at, {"1": TOOL_CONTROLLER}, {"ex_base2": FIXTURE_CONTROLLER})
    for axes in ((), true_cell("1", "other").axes):
        program = krl.parse(nominal, [("job.src", data)], setup).on_axes(axes)
        assert program.correctable() == []
        assert "external axes carry its base" in program.targets[0].reason
    without = krl.parse(nominal, [("job.src", data)], given(at, {"1": TOOL_CONTROLLER}))
    assert "give it with --frame ex_base2=" in without.targets[0].reason


def test_stations_of_yaskawa_are_left_with_axes():
    tests = language_tests("inform")
    nominal, _, at = robots = robot_of("gp8", size=0.05)
    data = (
        tests.program(robots, tests.in_front(nominal, 2))
        .replace(b" VJ=", b" EC00000 VJ=")
        .replace(b"  V=", b" EC00001 V=")
    )
    setup = given(at, **tests.FRAMES)._replace(pulses=tests.PULSES)
    program = inform.parse(nominal, data, "job.jbi", setup)
    assert len(program.correctable()) == 4
    program = program.on_axes(true_cell("1", "2").axes)
    assert {target.reason for target in program.targets} == {
        "its external axes are in pulses, of which it is not known how many a mm or degree has"
    }
