"""Tools and work objects from touches: exact without noise, derivatives and intervals hold, doubts are named."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import Posed, assert_derivative, assert_same_poses
from touching import SOCKET, START, TIP, reach
from typer.testing import CliRunner

from irbcal.cell import adjusted_cell
from irbcal.cell.adjusted_cell import Adjusted, adjust, adjust_zeros
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, Touch, read_cell
from irbcal.cell.frames_from_touches import _covariance
from irbcal.cell.robot_derivatives import point_derivatives
from irbcal.cli.main import app
from irbcal.correction.cell_frames import cell_frames
from irbcal.correction.languages import krl
from irbcal.errors import CalibrationError, MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.modeling.dhm import DHMTable
from irbcal.units import DEG, MM

T_OBJECT = frames.transform(frames.rotation_from_vector([0.02, -0.05, 0.6]), [0.9, -0.3, 0.55])
CAD = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.2, 0.0], [0.0, 0.2, 0.05], [0.15, 0.1, 0.1]])


def rows_of(robot, sides=6, cad=CAD, taught=True, seed=1):
    """SIMULATED touches without noise: a tool from some sides, one work object as pendants do, one from CAD."""
    rng = np.random.default_rng(seed)
    found = [(TOOL, "grip", "socket", SOCKET, None)] * sides
    for point, xyz in (("origin", [0, 0, 0]), ("x", [0.37, 0, 0]), ("xy", [-0.06, 0.25, 0])) if taught else ():
        found.append((WORK_OBJECT, "fixture", point, frames.apply(T_OBJECT, np.array([xyz]))[0], None))
    for k, xyz in enumerate(cad):
        found.append((WORK_OBJECT, "cast", f"hole{k}", frames.apply(T_OBJECT, xyz[None])[0], xyz))
    return [
        Touch(k, frame, name, point, "grip", reach(robot, place, rng), 2e-4, xyz)
        for k, (frame, name, point, place, xyz) in enumerate(found, 2)
    ]


@pytest.fixture(scope="module")
def rows(robot):
    return rows_of(robot)


T_TORCH = frames.transform(frames.rotation_from_vector([0.4, -0.7, 0.3]), TIP)
"""A tool with axes of its own, its tip where that of the gripper is."""


@pytest.fixture(scope="module")
def every_kind(rows, robot):
    """SIMULATED touches of all kinds: axes of a tool, a ball, a plane, a line, a tool by points of an object alone, and
    what a tracker measured."""
    rng = np.random.default_rng(4)
    out = [replace(touch, row=k) for k, touch in enumerate(rows)]

    def add(place, local=TIP, **named):
        q = reach(robot, place, rng, local)
        out.append(Touch(len(out), **{"frame": TOOL, "tool": named.get("name", ""), "q": q, "u95": 2e-4, **named}))

    for _ in range(5):
        add(SOCKET, name="torch", point="tip")
    for point, local in {"x": [0.13, 0, 0], "xy": [-0.05, 0.09, 0]}.items():
        add(SOCKET, frames.apply(T_TORCH, np.array([local]))[0], name="torch", point=point)
    for _ in range(18):
        n = rng.normal(size=3)
        add(SOCKET + 0.02 * n / np.linalg.norm(n), name="ball", point="ball", kind="sphere", radius=0.02)
    for _ in range(9):
        away = rng.uniform(-0.1, 0.1, 3)
        add(SOCKET + away * np.array([1.0, 1.0, 0.0]), name="grip", point="table", kind="plane")
        add(SOCKET + away * np.array([0.0, 0.0, 1.0]), name="grip", point="edge", kind="line")
    for k, xyz in enumerate([*CAD, *(CAD + np.array([0.02, 0.03, 0.0]))]):
        place = frames.apply(T_OBJECT, xyz[None])[0]
        add(place, frame=WORK_OBJECT, name="cast", point=f"p{k}", tool="probe", xyz=xyz)
    for k, xyz in enumerate(CAD):
        place = frames.apply(robot.T_world_base @ T_OBJECT, xyz[None])[0]
        named = {"frame": WORK_OBJECT, "name": "cast", "point": f"m{k}", "tool": "", "xyz": xyz, "tracker": place}
        out.append(Touch(len(out), **named, q=np.zeros(6), u95=5e-5))
    for _ in range(3):
        q = START + rng.uniform(-0.5, 0.5, 6)
        T = robot.T_world_base @ robot.poses(q[None])[0]
        place = frames.apply(T, TIP[None])[0]
        out.append(Touch(len(out), TOOL, "grip", "tracker", "grip", q, 5e-5, tracker=place))
    return out


def test_every_kind_of_touch_gives_the_truth_back(record, robot, every_kind):
    """Without noise, through the table: tools by places, ball, plane, line, tracker and CAD; axes of one of them."""
    cell = cell_frames(record, table_of(every_kind))
    assert cell.left_out == ()
    for name in ("grip", "ball", "probe", "torch"):
        np.testing.assert_allclose(cell.tools[name].T_true[:3, 3], TIP, rtol=0, atol=2e-8)
        assert cell.tools[name].position_only is (name != "torch")
    assert_same_poses(cell.tools["torch"].T_true, T_TORCH, 1e-8, 1e-7)
    for name in ("fixture", "cast"):
        assert_same_poses(cell.work_objects[name].T_true, T_OBJECT, 1e-8, 1e-8)
    for kind in ("point", "sphere", "plane", "line"):  # each of them would be seen
        k = next(k for k, touch in enumerate(every_kind) if touch.kind == kind and touch.tracker is None)
        T = robot.poses(joints(every_kind[k : k + 1]))[0]
        slip = replace(every_kind[k], q=every_kind[k].q + np.radians([0.1, 0.1, 0.1, 0, 0.2, 0]))
        moved = robot.poses(slip.q[None])[0]
        assert np.linalg.norm((moved - T)[:3, 3]) > 1e-3
        residual = adjust(
            [*every_kind[:k], slip, *every_kind[k + 1 :]], robot, np.full(len(every_kind), 1e-4), ""
        ).residual
        assert np.linalg.norm(residual[k]) > 2e-4
        assert residual[k] @ (moved - T)[:3, 3] < 0.0  # back to where it should be


def table_of(rows):
    """The same as a table."""
    columns = {name: [getattr(one, name) for one in rows] for name in ("frame", "name", "point", "tool", "kind")}
    columns["radius_mm"] = ["" if one.radius is None else one.radius / MM for one in rows]
    for k, axis in enumerate("xyz"):
        columns[f"tracker_{axis}_mm"] = ["" if one.tracker is None else one.tracker[k] / MM for one in rows]
    at_rest = [one.tracker is not None and one.frame == WORK_OBJECT for one in rows]
    columns |= {
        f"q{j + 1}_deg": ["" if rest else one.q[j] / DEG for one, rest in zip(rows, at_rest, strict=True)]
        for j in range(6)
    }
    for k, axis in enumerate("xyz"):
        columns[f"{axis}_mm"] = ["" if one.xyz is None else one.xyz[k] / MM for one in rows]
    return pd.DataFrame(columns)


def joints(rows):
    return np.array([one.q for one in rows])


def test_without_noise_the_truth_comes_back(record, rows, tmp_path):
    found = cell_frames(record, table_of(rows), out=tmp_path / "cell.json")
    np.testing.assert_allclose(found.tools["grip"].T_true[:3, 3], TIP, rtol=0, atol=1e-9)
    for name in ("fixture", "cast"):
        assert_same_poses(found.work_objects[name].T_true, T_OBJECT, 1e-9, 1e-9)
        # the nominal robot has other frames: that is what a pendant has swallowed
        assert np.abs(found.work_objects[name].T_nominal - T_OBJECT)[:3, 3].max() > 1e-4
    assert max(np.linalg.norm(one.residual) for one in found.touches) < 1e-9
    assert max(np.linalg.norm(one.residual_nominal) for one in found.touches) > 5e-5
    assert found.left_out == ()
    assert found.tools["grip"].position_only
    again = read_cell(tmp_path / "cell.json")
    assert again.fingerprint == record.fingerprint
    for one in ("covariance", "touch_covariance", "robot_gain"):
        np.testing.assert_array_equal(getattr(again, one), getattr(found, one))
    np.testing.assert_allclose(again.work_objects["cast"].T_true, found.work_objects["cast"].T_true, atol=1e-14)
    np.testing.assert_allclose(again.touches[-1].xyz, found.touches[-1].xyz, atol=1e-15)


def shifted(robot, rows, shift):
    """The robot with its tip link moved at the joints of each touch, metres in the base link."""
    T = robot.poses(joints(rows))
    T[:, :3, 3] += shift
    return Posed(robot, joints(rows), T)


def test_residuals_have_their_derivatives(robot, every_kind):
    noisy = shifted(robot, every_kind, np.random.default_rng(3).normal(scale=1e-3, size=(len(every_kind), 3)))
    adjusted = adjust(every_kind, noisy, np.full(len(every_kind), 1e-4), "")
    problem, state = adjusted.problem, adjusted.state

    def residuals(u):
        return -Adjusted(problem, problem.moved(state, u / problem.sizes)).rows[1]

    assert_derivative(residuals, np.zeros(problem.nuisance), adjusted.rows[0], 1e-3, 1e-5)
    frames_and_tools = {key[1] for key in problem.layout if key[0] in ("frame", "tool")}
    assert frames_and_tools == {"work object fixture", "work object cast", "tool torch", "grip", "probe", "ball"}


def test_the_gain_is_how_frames_follow_the_robot(record, robot, rows):
    """One parameter of the geometry changed in the robot itself, and everything adjusted anew."""
    found = cell_frames(record, table_of(rows))
    certainty = robot.certainty
    names = [term.name for term in certainty.terms]
    first = len(certainty.covariance) - len(names)
    for name, column, joint in (("rz3 constant", "theta", 2), ("tx2 constant", "a", 1)):
        moved = {}
        for sign in (-1, 1):
            values = {key: np.array(getattr(robot.arm.table, key)) for key in ("alpha", "a", "theta", "d", "beta", "b")}
            values[column][joint] += sign * 1e-5
            changed = robot.replace(arm=robot.arm.with_table(DHMTable(**values, prismatic=robot.arm.table.prismatic)))
            moved[sign] = adjust(rows, changed, np.full(len(rows), 1e-4), "")
        before, after = moved[-1], moved[1]
        tips = [adjusted.frame(TOOL, "grip")[:3, 3] for adjusted in (before, after)]
        expected = [np.zeros(3), (tips[1] - tips[0]) / 2e-5]
        for key in found.work_objects:
            step = frames.inverse(before.frame(WORK_OBJECT, key)) @ after.frame(WORK_OBJECT, key)
            expected += [frames.vector_from_rotation(step[:3, :3]) / 2e-5, step[:3, 3] / 2e-5]
        gain = found.robot_gain[:, first + names.index(name)]
        np.testing.assert_allclose(gain, np.concatenate(expected), rtol=0, atol=2e-4)


def test_what_a_tracker_measured_follows_the_base(robot, every_kind):
    """The base moved in the measuring frame, and everything adjusted anew."""
    sigma = np.array([touch.u95 / 1.96 for touch in every_kind])
    gain = _covariance(adjust(every_kind, robot, sigma, ""), robot.certainty)[1]
    for k, step in enumerate(1e-5 * np.eye(6)):
        ends = []
        for sign in (1, -1):
            motion = frames.transform(frames.rotation_from_vector(sign * step[:3]), sign * step[3:])
            moved = robot.replace(T_world_base=robot.T_world_base @ motion)
            adjusted = adjust(every_kind, moved, sigma, "")
            ends.append([adjusted.frame(*name) for name in ((WORK_OBJECT, "cast"), (TOOL, "grip"))])
        for (after, before), name in zip(zip(*ends, strict=True), ((WORK_OBJECT, "cast"), (TOOL, "grip")), strict=True):
            turned = frames.inverse(before) @ after
            expected = np.r_[frames.vector_from_rotation(turned[:3, :3]), turned[:3, 3]] / 2e-5
            by_motion = adjusted.motions(*name, np.eye(3)) @ gain[:, k]
            np.testing.assert_allclose(by_motion, expected, rtol=0, atol=2e-3)
            assert np.abs(expected).max() > 1e-3


@pytest.mark.parametrize("with_robot", [False, True])
def test_intervals_hold(robot, rows, with_robot):
    """Touches, and parameters of the robot, drawn again and again: 95 % of the errors are within 1.96 deviations."""
    rng = np.random.default_rng(5)
    sigma, certainty = np.full(len(rows), 1e-4), robot.certainty
    exact = adjust(rows, robot, sigma, "")
    touching, gain, _ = _covariance(exact, certainty)
    names = [(TOOL, "grip"), (WORK_OBJECT, "fixture"), (WORK_OBJECT, "cast")]
    M = np.concatenate([exact.motions(*name, np.eye(3)) for name in names])
    G = M @ gain * with_robot
    C = (M @ touching @ M.T + G @ certainty.covariance @ G.T)[3:, 3:]
    J = point_derivatives(robot, certainty, joints(rows), np.tile(TIP, (len(rows), 1)))[1]
    L = np.linalg.cholesky(certainty.covariance + 1e-24 * np.eye(len(certainty.covariance)))
    errors = []
    for _ in range(60):
        by_robot = J @ (L @ rng.normal(size=J.shape[2])) * with_robot
        adjusted = adjust(rows, shifted(robot, rows, rng.normal(scale=1e-4, size=by_robot.shape) + by_robot), sigma, "")
        error = [adjusted.frame(TOOL, "grip")[:3, 3] - TIP]
        for name in names[1:]:
            step = frames.inverse(T_OBJECT) @ adjusted.frame(*name)
            error += [frames.vector_from_rotation(step[:3, :3]), step[:3, 3]]
        errors.append(np.concatenate(error))
    assert 0.92 < np.mean(np.abs(errors) < 1.96 * np.sqrt(np.diagonal(C))) < 0.98
    # and as a whole: the mean of 900 squares of standard normal numbers, of deviation 0.047
    assert np.mean(np.linalg.solve(np.linalg.cholesky(C), np.transpose(errors)) ** 2) == pytest.approx(1.0, abs=0.1)


def test_a_slip_is_named_and_left_out(record, robot, rows):
    slipped = list(rows)
    slipped[2] = replace(rows[2], q=rows[2].q + np.radians([0.2, 0, 0, 0, 0, 0]))
    found = cell_frames(record, table_of(slipped))
    assert ["row 3 (tool grip, socket)" in text for text in found.left_out] == [True]
    np.testing.assert_allclose(found.tools["grip"].T_true[:3, 3], TIP, rtol=0, atol=1e-9)
    distance = float(found.left_out[0].split(" mm")[0].split()[-1])
    T = robot.poses(np.array([rows[2].q, slipped[2].q]))
    assert distance == pytest.approx(np.linalg.norm((T[1] - T[0])[:3] @ [*TIP, 1]) / MM, rel=0.02)


def test_more_scatter_than_said_widens_the_intervals(record, rows):
    rng = np.random.default_rng(2)
    rough = [replace(one, q=one.q + rng.normal(scale=5e-4, size=6)) for one in rows]
    found, fine = (cell_frames(record, table_of(some)) for some in (rough, rows))
    assert any("widened" in note for note in found.notes)
    assert np.trace(found.touch_covariance) > 2 * np.trace(fine.touch_covariance)


def about_one_axis(robot):
    """Only joint 6 turns."""
    rows = rows_of(robot, 1, (), taught=False)
    return [replace(rows[0], q=rows[0].q + angle * np.eye(6)[5]) for angle in (0.0, 0.4, 0.9)]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda robot: rows_of(robot, 2, ()), "from 2 sides: it takes 3 or more"),
        (about_one_axis, "all sides are turned about one axis"),
        (lambda robot: rows_of(robot, 0, ()), "was touched with tool grip, of which there are no rows"),
        (lambda robot: rows_of(robot, cad=CAD[:2], taught=False), "origin, x, xy are missing"),
        (lambda robot: rows_of(robot, cad=np.outer([0, 1, 2, 4], [0.1, 0.05, 0]), taught=False), "on a line"),
    ],
)
def test_what_determines_nothing_is_refused(record, robot, make, words, tmp_path):
    with pytest.raises(MeasurementError, match=words):
        cell_frames(record, table_of(make(robot)), out=tmp_path / "cell.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("frame", "base", "row 1, column frame: expected tool, work_object, held_part or fixed_tool"),
        ("tool", "other", "column tool"),
        ("x_mm", "5", "all or none"),
        ("q2_deg", "", "column q2_deg: expected a joint angle in degrees, found nothing"),
        ("e1_mm", "5", "there is a column e1_mm"),
        ("kind", "ball", "row 1, column kind: expected point, sphere, plane, line, found 'ball'"),
        ("tracker_y_mm", "5", "all or none"),
        ("point", "xy", "tool grip: its axes take points x and xy, x is missing"),
    ],
)
def test_rows_that_are_no_touches_are_refused(record, rows, column, value, words):
    table = table_of(rows).astype(object)
    if column not in table:
        table[column] = ""
    table.loc[0, column] = value
    with pytest.raises(MeasurementError, match=words):
        cell_frames(record, table)


def test_tools_with_numbers_for_names_are_read_from_tables(record, rows, tmp_path):
    """As pandas reads a file with empty cells among them."""
    table = table_of(rows).assign(name="3", tool="3")
    table.loc[table["frame"] == TOOL, "tool"] = ""
    table.to_csv(tmp_path / "touches.csv", index=False)
    found = [cell_frames(record, some) for some in (tmp_path / "touches.csv", pd.read_csv(tmp_path / "touches.csv"))]
    assert [list(one.tools) for one in found] == [["3"], ["3"]]
    np.testing.assert_array_equal(found[0].tools["3"].T_true, found[1].tools["3"].T_true)


def test_frames_of_nothing_are_refused(record, rows):
    with pytest.raises(OptionError, match="no touch is of tool 9"):
        cell_frames(record, table_of(rows), tool={"9": np.eye(4)})


def test_an_edited_file_is_refused(record, rows, tmp_path):
    path = tmp_path / "cell.json"
    cell_frames(record, table_of(rows), out=path)
    path.write_text(path.read_text().replace('"name": "grip"', '"name": "other"', 1))
    with pytest.raises(CalibrationError, match=r"cell\.json"):
        read_cell(path)


def test_axes_are_those_of_the_controller(record, rows):
    T = krl.KUKA.poses(np.array([[10.0, -28.0, 205.0, 30.0, 40.0, -50.0]]))[0]
    found = cell_frames(record, table_of(rows), tool={"GRIP": T})
    np.testing.assert_allclose(found.tools["grip"].T_true[:3], np.column_stack([T[:3, :3], TIP]), rtol=0, atol=1e-9)
    plain = cell_frames(record, table_of(rows))
    block = found.rows(TOOL, "grip")
    C, own = found.covariance[block, block][3:, 3:], plain.covariance[block, block][3:, 3:]
    np.testing.assert_allclose(T[:3, :3] @ C @ T[:3, :3].T, own, rtol=0, atol=1e-14)


def test_the_command_writes_as_makers_do(demo_calibration, rows, tmp_path, program):
    table_of(rows).to_csv(tmp_path / "touches.csv", index=False)
    call = ["cell", demo_calibration, tmp_path / "touches.csv", "--out", tmp_path / "cell.json"]
    text = program(*call, "--as", "kuka", "--tool", "grip=12,-30,210,0,0,0")
    assert text.startswith("SIMULATED")
    expected = krl.KUKA.numbers(T_OBJECT[None], np.zeros((1, 6)))[0]
    row = next(line for line in text.splitlines() if line.strip().startswith("object"))
    numbers = [float(word) for word in re.findall(r"-?\d+\.\d{4}", row)[:6]]
    np.testing.assert_allclose(numbers, expected, rtol=0, atol=6e-5)
    program(*call, "--as", "kuka", "--tool", "grip=12,-30,210,0,0,0", "--report", tmp_path / "cell.html")
    page = (tmp_path / "cell.html").read_text()
    assert all(f"{number:.4f}" in page for number in numbers), "the page writes as the maker does, too"
    content = program(*call, "--json")
    assert (content["schema_name"], content["simulated"]) == ("irbcal-cell-1", True)


def test_touches_are_typed_and_kept(demo_calibration, rows, tmp_path):
    """Wrong lines are asked for again; the next touch has the words of the one before unless others are typed."""
    table, path = table_of(rows), tmp_path / "typed.csv"
    typed, words = ["tool grip", "socket 1 x"], ""
    for row in table.to_dict("records"):
        before, words = words, f"{row['frame']} {row['name']} {row['point']} {row['tool']}"
        typed += ["" if words == before else words, "1 2 three", "1 2 3"]
        typed.append(", ".join(str(row[f"q{k}_deg"]) for k in range(1, 7)))
        if words.startswith("work_object") and row["point"] not in ("origin", "x", "xy"):
            typed.append(" ".join(str(row[name]) for name in ("x_mm", "y_mm", "z_mm")))
    call = ["cell", str(demo_calibration), str(path), "--interactive", "--out", str(tmp_path / "cell.json")]
    done = CliRunner().invoke(app, call, input="\n".join([*typed, ".", ""]), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    kept = pd.read_csv(path)
    assert kept[["frame", "name", "point", "tool"]].to_numpy().tolist() == table.iloc[:, :4].to_numpy().tolist()
    for name in (*(f"q{k}_deg" for k in range(1, 7)), "x_mm"):
        asked = pd.to_numeric(table[name])
        np.testing.assert_allclose(kept[name], asked, rtol=0, atol=1e-9)
    stopped = CliRunner().invoke(app, [*call[:2], str(tmp_path / "two.csv"), *call[3:]], input="\n".join(typed[2:6]))
    assert stopped.exit_code == 1
    assert len(pd.read_csv(tmp_path / "two.csv")) == 1, "what was typed before is kept"
    again = [*call[:2], str(tmp_path / "two.csv"), *call[3:]]
    CliRunner().invoke(app, again, input="\n".join([typed[2], *typed[4:6]]))
    two = pd.read_csv(tmp_path / "two.csv")
    np.testing.assert_allclose(two["q1_deg"], [float(table["q1_deg"].iloc[0])] * 2, rtol=0, atol=1e-9)
    (tmp_path / "two.csv").write_text("frame;name\n")
    refused = CliRunner().invoke(app, again, input="\n")
    assert refused.exit_code == 1
    assert isinstance(refused.exception, MeasurementError)
    assert (tmp_path / "two.csv").read_text() == "frame;name\n"


def test_the_example_has_its_check_values(shared_data, tmp_path, program):
    """Computed independently, see the folder's README."""
    folder = shared_data / "cell_example"
    if not folder.is_dir():
        pytest.skip("no cell_example among the measured data")
    program("calibrate", folder / "measurements.csv", "--robot", folder / "kr16.urdf", "--out", tmp_path / "kr")
    found = cell_frames(tmp_path / "kr", folder / "touches.csv")
    tool, base = found.tools["3"], found.work_objects["1"]
    for T, expected, tolerance in (
        (tool.T_nominal, [0.0328, 0.1165, 182.3952], 0.005),
        (tool.T_true, [-0.0140, -0.0116, 182.3329], 0.03),
    ):
        np.testing.assert_allclose(T[:3, 3] / MM, expected, rtol=0, atol=tolerance)
    for T, expected, tolerance in (
        (base.T_nominal, [709.7111, -1078.7046, 502.0156, 25.5484, -0.0349, -0.1042], 0.005),
        (base.T_true, [709.8943, -1077.9177, 500.7108, 25.5356, -0.0014, -0.0042], 0.03),
    ):
        numbers = krl.KUKA.numbers(T[None], np.zeros((1, 6)))[0]
        np.testing.assert_allclose(numbers[:3], expected[:3], rtol=0, atol=tolerance)
        np.testing.assert_allclose(numbers[3:], expected[3:], rtol=0, atol=0.001)


LOST = {3: 0.4 * DEG, 5: -0.7 * DEG}
"""How much more joints stand at than they show."""


def crashed(rows):
    """The touches as a robot shows them whose zeros were lost after it was calibrated."""
    shift = np.zeros(6)
    shift[[joint - 1 for joint in LOST]] = list(LOST.values())
    return [replace(touch, q=touch.q - shift) for touch in rows]


def test_lost_zeros_are_found_with_the_frames(robot, rows):
    adjusted = adjust_zeros(crashed(rows), robot, np.full(len(rows), 1e-4), "", tuple(LOST))
    np.testing.assert_allclose(joints(adjusted.touches), joints(rows), rtol=0, atol=1e-9)
    np.testing.assert_allclose(adjusted.frame(WORK_OBJECT, "cast"), T_OBJECT, rtol=0, atol=1e-9)
    np.testing.assert_allclose(adjusted.frame(TOOL, "grip")[:3, 3], TIP, rtol=0, atol=1e-9)

    def residuals(step):
        turned = [replace(touch, q=touch.q + np.array([0, 0, step[0], 0, step[1], 0])) for touch in rows]
        problem = adjust(turned, robot, np.full(len(rows), 1e-4), "").problem
        return -Adjusted(problem, adjusted.state).rows[1]

    # of thousands; how the joint map itself follows the joints is left out
    assert_derivative(residuals, np.zeros(2), adjusted.rows[0][:, -2:], 5.0, 1e-3)


def test_zeros_that_do_not_converge_are_refused(robot, rows, monkeypatch):
    """Without noise the second step is no more than that of a linear problem leaves: far above rounding."""
    monkeypatch.setattr(adjusted_cell, "MOST_ZERO_STEPS", 2)
    with pytest.raises(MeasurementError, match="the zeros of joints 3, 5 do not converge in 2 steps") as refused:
        adjust_zeros(crashed(rows), robot, np.full(len(rows), 1e-4), "touches.csv", tuple(LOST))
    assert refused.value.file == "touches.csv"


def test_intervals_of_lost_zeros_hold(robot, rows):
    """Touches and parameters of the robot drawn again and again, as for the frames above; both tell alike much."""
    rng = np.random.default_rng(7)
    sigma, certainty, lost = np.full(len(rows), 1e-4), robot.certainty, crashed(rows)
    C, G, _ = _covariance(adjust_zeros(lost, robot, sigma, "", tuple(LOST)), certainty)
    by_touches, by_robot = (np.diagonal(part)[-2:] for part in (C, G @ certainty.covariance @ G.T))
    share = 10.0  # of what the robot leaves open: alike
    std = np.sqrt(by_touches + share**2 * by_robot)
    J = point_derivatives(robot, certainty, joints(rows), np.tile(TIP, (len(rows), 1)))[1]
    L = share * np.linalg.cholesky(certainty.covariance + 1e-24 * np.eye(len(certainty.covariance)))
    errors = []
    for _ in range(30):
        shift = J @ (L @ rng.normal(size=J.shape[2])) + rng.normal(scale=1e-4, size=(len(rows), 3))
        noisy = reached_anew(robot, rows, shift)
        adjusted = adjust_zeros(crashed(noisy), robot, sigma, "", tuple(LOST))
        errors.append((adjusted.touches[0].q - noisy[0].q)[[2, 4]])
    assert np.mean((errors / std) ** 2) == pytest.approx(1.0, abs=0.25)


def reached_anew(robot, rows, shift):
    """Touches with the joints that bring the tip beside its place, metres in the base link, by first order."""
    q, step = joints(rows), 1e-6
    T = robot.poses(q)
    tip = T[:, :3, 3] + T[:, :3, :3] @ TIP
    J = np.empty((len(q), 6, 6))
    for k in range(6):
        moved = robot.poses(q + step * np.eye(6)[k])
        J[:, :3, k] = (moved[:, :3, 3] + moved[:, :3, :3] @ TIP - tip) / step
        turn = moved[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1)
        J[:, 3:, k] = [frames.vector_from_rotation(R) / step for R in turn]
    step_q = np.linalg.solve(J, np.concatenate([-shift, np.zeros_like(shift)], axis=1)[..., None])[..., 0]
    return [replace(touch, q=touch.q + by) for touch, by in zip(rows, step_q, strict=True)]


@pytest.mark.parametrize("zeros", [(1,), (6, 3)])
def test_zeros_that_what_is_sought_hides_are_refused(record, rows, zeros):
    with pytest.raises(MeasurementError, match="the touches do not show the zeros of joints"):
        cell_frames(record, table_of(rows), refit_zeros=zeros)
