"""Programs for the true tools and work objects: SIMULATED robots, whose controllers have taught ones, run them."""

from dataclasses import replace

import numpy as np
import pytest
from maker_cases import LANGUAGES, language_tests, robot_of, universal_robot, well_inside
from rapid_modules import parsed
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support import arm, random_robot

from irbcal.cell.cell_file import CellFile, FrameInCell
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.correction_options import CorrectionOptions
from irbcal.correction.filter_program import filter_program
from irbcal.correction.maker import configuration_of
from irbcal.correction.notation import numbers_from_poses
from irbcal.correction.true_frames import (
    CELL,
    PointOrigin,
    TargetFrames,
    TrueFrames,
    lengths,
    part_errors,
    point_origin,
)
from irbcal.errors import OptionError
from irbcal.modeling import frames
from irbcal.modeling.certainty import Certainty, FitLimits
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term

DIGEST = "abc123"
FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
MOTION = frames.from_xyz_angles([0.0011, -0.0007, 0.0015, 0.001, -0.002, 0.0015])
"""From the controller's frames to the true ones."""


def cell_with(tools, work_objects):
    """A cell file's content with such true frames."""
    k = 6 * (len(tools) + len(work_objects))
    named = ({name: FrameInCell(name, T, T) for name, T in each.items()} for each in (tools, work_objects))
    return CellFile(DIGEST, "robot", True, *named, np.zeros((k, k)), np.zeros((k, k)), np.zeros((k, 0)))


def off_and_turned(robot, q, T_wanted, tool, work_object):
    """Distance (mm) and angle (degrees) of the true tool in the true work object from where it is wanted, (n,) each."""
    T = np.linalg.inv(work_object) @ robot.forward(q) @ tool
    turned = Rotation.from_matrix(np.swapaxes(T_wanted[:, :3, :3], 1, 2) @ T[:, :3, :3])
    return np.linalg.norm(T[:, :3, 3] - T_wanted[:, :3, 3], axis=1) * 1e3, np.degrees(turned.magnitude())


# ---------------------------------------------------------------- every language


@pytest.mark.parametrize("numbers", ["same", "from-cell"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_true_tool_reaches_the_true_work_object(language, numbers):
    """The controller, with its own or the cell's numbers, takes the true robot where the program means."""
    name, size, printed = LANGUAGES[language]
    tests = language_tests(language)
    robots = nominal, robot, at = universal_robot() if name is None else robot_of(name, size)
    q0 = tests.joints(3) if language == "urscript" else getattr(tests, "in_front", well_inside)(nominal, 3)
    arguments = {"krl": (nominal, q0), "fanuc": (nominal, at, q0)}.get(language, (robots, q0))
    before = tests.parsed(robots, tests.program(*arguments))
    tools = {key: T @ MOTION for key, T in before.tools.items()}
    work_objects = {key: T @ np.linalg.inv(MOTION) for key, T in before.work_objects.items()}
    known = TrueFrames(cell_with(tools, work_objects), numbers=numbers)
    found = filter_program(before, CorrectionModel(robot, nominal, DIGEST, true_frames=known))
    assert found.unchanged_targets == ()
    assert found.unknown_frames is None
    files = found.files if language in ("krl", "val3") else found.data
    after = tests.parsed(robots, files)
    q_of = dict(zip(found.targets, found.q, strict=True))
    assert len(q_of) >= 6
    for k in before.correctable():
        old, new = before.targets[k], after.targets[k]
        names = old.uses[0].tool, old.uses[0].work_object
        T_tool, T_object = before.tools[names[0]], before.work_objects[names[1]]
        if old.kind == "joint":
            P = np.linalg.inv(T_object) @ nominal.forward(old.value[None])[0] @ T_tool
            q = new.value
        else:
            P, q = old.value, q_of[old.name]
            own = (T_tool, T_object) if numbers == "same" else (tools[names[0]], work_objects[names[1]])
            asked = own[1] @ new.value @ np.linalg.inv(own[0])
            np.testing.assert_allclose(asked[:3, 3], nominal.forward(q[None])[0, :3, 3], atol=printed * 1e-3)
        off, turn = off_and_turned(robot, q[None], P[None], tools[names[0]], work_objects[names[1]])
        assert off[0] < printed, old.name
        assert turn[0] < printed, old.name


# ---------------------------------------------------------------- a cell whose truth is known


class TaughtCell:
    """A SIMULATED robot whose controller, with the nominal model, was taught tool and work object by touching."""

    def __init__(self):
        self.nominal = arm()
        self.robot = random_robot(self.nominal, "34", np.random.default_rng(3), size=0.1)
        self.tool = frames.transform(None, [0.02, -0.01, 0.2])
        self.work_object = frames.from_xyz_angles([0.7, -0.2, 0.4, 0.0, 0.0, 0.3])
        rng = np.random.default_rng(0)
        tips = [
            frames.from_xyz_angles([0.05, 0.05, 0.02, np.pi + a, b, c]) for a, b, c in rng.uniform(-0.5, 0.5, (6, 3))
        ]
        q = self.reach(np.array(tips))
        T = self.nominal.forward(q)
        A = np.concatenate([np.hstack([one[:3, :3], -np.eye(3)]) for one in T])
        tip = np.linalg.lstsq(A, -T[:, :3, 3].ravel(), rcond=None)[0][:3]
        self.tool_taught = frames.transform(None, tip)
        corners = np.array([frames.from_xyz_angles([x, y, 0, np.pi, 0, 0]) for x, y in ((0, 0), (0.4, 0), (0.2, 0.3))])
        o, x, y = (self.nominal.forward(self.reach(corners)) @ self.tool_taught)[:, :3, 3]
        e_x = (x - o) / np.linalg.norm(x - o)
        e_z = np.cross(e_x, y - o) / np.linalg.norm(np.cross(e_x, y - o))
        self.work_object_taught = frames.transform(np.column_stack([e_x, np.cross(e_z, e_x), e_z]), o)
        grid = np.stack(np.meshgrid([0, 0.2, 0.4], [0, 0.15, 0.3], [0, 0.1]), axis=-1).reshape(-1, 3)
        turns = rng.uniform(-0.2, 0.2, (len(grid), 3)) + np.array([np.pi, 0, 0])
        self.wanted = np.array([frames.from_xyz_angles([*p, *a]) for p, a in zip(grid, turns, strict=True)])
        self.cell = cell_with({"tGrip": self.tool}, {"wPart": self.work_object})

    def reach(self, T):
        """Joints with which the true tool is at poses in the true work object, by SciPy."""
        T = self.work_object @ T @ np.linalg.inv(self.tool)
        return np.array([_solved(self.robot.forward, one, self.seed(one)) for one in T])

    def seed(self, T):
        return closed_form.nearest(self.nominal, closed_form.branches(self.nominal, T[None]), np.zeros(6))[0][0]

    def controller(self, data, tool=None, work_object=None):
        """Joints that the controller commands for the robtargets of a module."""
        tool = self.tool_taught if tool is None else tool
        work_object = self.work_object_taught if work_object is None else work_object
        T = np.array([target.value for target in parsed(data).targets])
        T = work_object @ T @ np.linalg.inv(tool)
        return np.array([_solved(self.nominal.forward, one, self.seed(one)) for one in T])

    def module(self, T):
        """A RAPID module of robtargets in the taught work object."""
        q = [self.seed(one) for one in self.work_object_taught @ T @ np.linalg.inv(self.tool_taught)]
        cfx = closed_form.configuration(self.nominal, np.array(q))
        lines = [
            "MODULE M",
            f"PERS tooldata tGrip:=[TRUE,{_frame(self.tool_taught)},[1,[0,0,1],[1,0,0,0],0,0,0]];",
            f'PERS wobjdata wPart:=[FALSE,TRUE,"",{_frame(self.work_object_taught)},[[0,0,0],[1,0,0,0]]];',
        ]
        for k, one in enumerate(T):
            conf = configuration_of(q[k], int(cfx[k]))
            lines.append(f"CONST robtarget p{k}:=[{_frame(one)[1:-1]},{[*conf]},{FAR}];")
        lines.append("PROC main()")
        lines += [f"MoveJ p{k},v100,fine,tGrip\\WObj:=wPart;" for k in range(len(T))]
        return "\n".join([*lines, "ENDPROC", "ENDMODULE", ""]).encode()

    def errors(self, q):
        return off_and_turned(self.robot, q, self.wanted, self.tool, self.work_object)[0]

    def filtered(self, data, **known):
        return filter_program(
            parsed(data), CorrectionModel(self.robot, self.nominal, DIGEST, true_frames=TrueFrames(**known))
        )


def _solved(forward, T, seed):
    def off(q):
        made = forward(q[None])[0]
        return np.concatenate([(made[:3, 3] - T[:3, 3]), (made[:3, :3] - T[:3, :3]).ravel()])

    found = least_squares(off, seed, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(found.fun).max() < 1e-7
    return found.x


def _frame(T):
    row = numbers_from_poses(T[None])[0]
    return "[[{:.6f},{:.6f},{:.6f}],[{:.10f},{:.10f},{:.10f},{:.10f}]]".format(*row)


@pytest.fixture(scope="module")
def taught():
    return TaughtCell()


def test_taught_frames_make_a_corrected_part_worse_and_the_cell_makes_it_right(taught):
    data = taught.module(taught.wanted)
    as_it_is = taught.errors(taught.controller(data))
    unaware = taught.filtered(data)
    with_taught = taught.errors(taught.controller(unaware.data))
    same = taught.filtered(data, cell=taught.cell)
    new = taught.filtered(data, cell=taught.cell, numbers="from-cell")
    assert with_taught.mean() > 2 * as_it_is.mean()
    assert taught.errors(taught.controller(same.data)).max() < 2e-3
    assert taught.errors(taught.controller(new.data, taught.tool, taught.work_object)).max() < 2e-3
    assert (unaware.unknown_frames.tools, unaware.unknown_frames.work_objects) == (("tgrip",), ("wpart",))
    q = np.array(
        [taught.seed(one) for one in taught.work_object_taught @ taught.wanted @ np.linalg.inv(taught.tool_taught)]
    )
    apart = (taught.robot.forward(q) - taught.nominal.forward(q)) @ taught.tool_taught[:, 3]
    size = np.linalg.norm(apart[:, :3], axis=1)
    assert unaware.unknown_frames.mean == pytest.approx(size.mean(), rel=1e-6)
    assert unaware.unknown_frames.largest == pytest.approx(size.max(), rel=1e-6)
    assert unaware.report()[0].startswith("WARNING: tool tgrip and work object wpart are of unknown origin")
    assert set(same.to_frame()["frames"]) == {"cell"}
    measured = taught.filtered(data, measured=True)
    assert measured.unknown_frames is None
    assert measured.data == unaware.data


@pytest.mark.parametrize("numbers", ["same", "from-cell"])
def test_the_error_of_a_shifted_target_is_that_of_the_true_tool_in_the_true_work_object(taught, numbers):
    data = taught.module(taught.wanted[:2])
    data = data.replace(b"ENDPROC", b"MoveL Offs(p1,0,0,80),v100,fine,tGrip\\WObj:=wPart;\nENDPROC")
    found = taught.filtered(data, cell=taught.cell, numbers=numbers)
    assert not found.unchanged_targets
    (note,) = [note.text for note in found.notes if "the shifted target" in note.text]
    own = (None, None) if numbers == "same" else (taught.tool, taught.work_object)
    lift = frames.transform(None, [0, 0, 0.08])
    off = []
    for text, names in ((found.data, own), (data, (None, None))):
        values = [lift @ target.value for target in parsed(text).targets]
        q = taught.controller(taught.module(np.array(values)), *names)
        off.append(
            off_and_turned(taught.robot, q[1:], lift @ taught.wanted[1:2], taught.tool, taught.work_object)[0][0]
        )
    assert f"off by {off[0]:.3f} mm ({off[1]:.3f} mm without the correction)" in note
    assert off[0] < 0.5 * off[1]


def test_a_frame_that_the_cell_file_does_not_have_is_named(taught):
    data = taught.module(taught.wanted[:3])
    found = taught.filtered(data, cell=cell_with({"TGRIP": taught.tool}, {}))
    assert (found.unknown_frames.tools, found.unknown_frames.work_objects) == ((), ("wpart",))
    assert found.unknown_frames.targets == 3
    assert "irbcal cell" in found.unknown_frames.in_words()


def test_frames_of_the_cell_that_no_target_uses_are_named(taught):
    data = taught.module(taught.wanted[:3])
    cell = cell_with({"gripper": taught.tool}, {"wPart2": taught.work_object})
    found = taught.filtered(data, cell=cell)
    assert "No target uses tool gripper and work object wPart2 of the cell file" in found.unknown_frames.in_words()
    assert "irbcal cell" not in found.unknown_frames.in_words()
    measured = taught.filtered(data, cell=cell, measured=True)
    assert measured.report()[1].startswith("No target uses tool gripper and work object wPart2")


def test_a_frame_of_the_cell_that_is_another_one_is_named_where_targets_fail(taught):
    """Another work object of the same name, 0.5 m to the side."""
    data = taught.module(taught.wanted[:3])
    other = frames.transform(None, [0.0, 0.5, 0.0]) @ taught.work_object
    found = taught.filtered(data, cell=cell_with({"tGrip": taught.tool}, {"wPart": other}))
    assert not found.complete
    assert all("differ in work object wpart by 500 mm" in target.reason for target in found.unchanged_targets)


def test_a_tool_known_by_its_tip_has_the_axes_of_the_controller(taught):
    turned = frames.transform(Rotation.from_euler("x", 30, degrees=True).as_matrix(), taught.tool[:3, 3])
    tools = {"tGrip": FrameInCell("tGrip", turned, turned, position_only=True)}
    cell = cell_with({"tGrip": turned}, {"wPart": taught.work_object})
    cell = CellFile(DIGEST, "robot", True, tools, cell.work_objects, *[np.zeros((12, 12))] * 2, np.zeros((12, 0)))
    data = taught.module(taught.wanted[:3])
    assert taught.filtered(data, cell=cell).data == taught.filtered(data, cell=taught.cell).data


def test_taught_points_stay_and_can_be_re_expressed(taught):
    q = taught.reach(taught.wanted)  # shown on the real robot where they are right
    seen = np.linalg.inv(taught.work_object_taught) @ taught.nominal.forward(q) @ taught.tool_taught
    data = taught.module(seen)
    assert taught.errors(taught.controller(data)).max() < 1e-3
    stays = taught.filtered(data, cell=taught.cell, points=PointOrigin("*"))
    assert (stays.data, stays.unchanged_targets, stays.unchanged, len(stays.targets)) == (data, (), len(q), 0)
    new = taught.filtered(data, cell=taught.cell, points=PointOrigin("*"), numbers="from-cell")
    assert taught.errors(taught.controller(new.data, taught.tool, taught.work_object)).max() < 2e-3
    expressed = taught.filtered(data, cell=taught.cell, points=PointOrigin("*", re_express=True))
    P = np.array([target.value for target in parsed(expressed.data).targets])
    assert np.abs(P - taught.wanted).max() < 1e-6
    assert parsed(expressed.data).fingerprint is None, "offline points are no fake targets"
    assert expressed.report()[0].startswith("18 taught points are re-expressed")
    again = taught.filtered(expressed.data, cell=taught.cell)
    assert np.abs(again.q - q).max() < 1e-5, "corrected as offline points they are where they were taught"
    half = taught.filtered(data, cell=taught.cell, points=PointOrigin("P1?"))
    assert half.unchanged == 8
    assert sorted(set(half.to_frame()["target"])) == sorted({f"p{k}" for k in range(10)})


@pytest.mark.parametrize(
    ("points", "re_express"), [("shown", False), ("offline:p*", False), ("taught:", False), ("offline", True)]
)
def test_wrong_origins_of_points(points, re_express):
    with pytest.raises(OptionError):
        point_origin(points, re_express)


def test_wrong_options():
    with pytest.raises(OptionError, match="from-cell"):
        CorrectionOptions("cal", "job.mod", controller_frames="from-cell")
    with pytest.raises(OptionError, match="the true tools and work objects are not known"):
        CorrectionOptions("cal", "job.mod", points="taught", re_express=True)
    with pytest.raises(OptionError, match="path_tolerance"):
        CorrectionOptions("cal", "job.mod", cell=cell_with({}, {}), path_tolerance=1e-4)


TOOL = frames.from_xyz_angles([0.02, -0.05, 0.2, 0.1, 0.4, -0.2])
WORK_OBJECT = frames.from_xyz_angles([0.8, -0.2, 0.3, 0.1, -0.2, 0.3])
NOISE = np.array([3e-4, 2e-4, 4e-4, 1e-4, 2e-4, 1.5e-4] * 2)
"""Standard deviations of the small motions by touching, radians and metres."""
ZEROS = 2e-4
"""Standard deviation of the zeros of joints 2 and 3, radians."""


def near_the_part(n):
    """Joints with which the tool is near the work object."""
    return np.array([-0.2, 0.4, 0.1, 0.3, 0.6, 0.2]) + np.random.default_rng(5).uniform(-0.2, 0.2, (n, 6))


def motion(row):
    """The transform of a rotation vector and a translation, by SciPy."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(row[:3]).as_matrix(), row[3:]
    return T


def situation(gain):
    """A robot of which the zeros of two joints are not known, a cell, and the frames of four targets."""
    nominal = arm()
    terms = tuple(Term(k, "rz", "constant", 1e-3, "zero", "geometry") for k in (1, 2))
    covariance = np.diag([0.0] * 6 + [ZEROS**2] * 2)
    limits = FitLimits(leave_one_out_mm={"": 0.0}, leave_fifths_out_mm={}, ranges=[[-9.0] * 6, [9.0] * 6])
    certainty = Certainty(nominal, terms, covariance, (), np.zeros(2), limits)
    robot = Robot(nominal, certainty=certainty)
    touching = np.diag(NOISE**2)
    tools, work_objects = ({name: FrameInCell(name, T, T)} for name, T in (("T", TOOL), ("W", WORK_OBJECT)))
    whole = touching + gain @ covariance @ gain.T
    cell = CellFile("x", "robot", True, tools, work_objects, touching, whole, gain)
    n = 4
    names = [np.full(n, name, dtype=object) for name in ("t", "w", CELL, CELL)]
    at = TargetFrames(
        *names,
        *np.tile(np.eye(4), (2, n, 1, 1)),
        np.zeros((n, 3)),
        *(np.tile(T, (n, 1, 1)) for T in (TOOL, WORK_OBJECT, np.eye(4))),
        np.zeros((n, 0)),
        np.zeros((n, 3)),
    )
    return nominal, robot, cell, at


def test_drawn_errors_are_as_large_as_expected():
    """Tool, work object and zeros of joints are drawn, frames follow the zeros: mean within 4 %, 95 % hold 93 to 97 %."""
    rng = np.random.default_rng(0)
    gain = np.zeros((12, 8))
    gain[9:, 6:] = rng.normal(size=(3, 2))  # the place of the work object follows the robot, some decimetres a radian
    nominal, robot, cell, at = situation(gain)
    q = near_the_part(4)
    mean, u95 = part_errors(robot, cell, q, at).T
    P = np.linalg.inv(WORK_OBJECT) @ nominal.forward(q) @ TOOL
    draws = 3000
    zeros = np.zeros((draws, 8))
    zeros[:, 6:] = ZEROS * rng.standard_normal((draws, 2))
    motions = NOISE * rng.standard_normal((draws, 12)) + zeros @ gain.T
    shifted = np.zeros((draws, 4, 6))
    shifted[:, :, 1:3] = zeros[:, None, 6:]
    T = nominal.forward((q + shifted).reshape(-1, 6)).reshape(draws, 4, 4, 4)
    tools = np.array([TOOL @ motion(row[:6]) for row in motions])[:, None]
    work_objects = np.array([np.linalg.inv(WORK_OBJECT @ motion(row[6:])) for row in motions])[:, None]
    off = np.linalg.norm((work_objects @ T @ tools - P)[..., :3, 3], axis=-1)
    np.testing.assert_allclose(off.mean(axis=0), mean, rtol=0.04)
    held = (off < u95).mean(axis=0)
    assert held.min() > 0.93, held
    assert held.max() < 0.97, held


def test_what_touches_and_program_have_in_common_cancels():
    """A work object taught where the target is, with the same joints: the errors of the robot are not in the part."""
    nominal, robot, cell, at = situation(np.zeros((12, 8)))
    q = np.repeat(near_the_part(1), 4, axis=0)
    tcp = nominal.forward(q[:1]) @ TOOL
    certainty = robot.certainty
    J = certainty.jacobian(robot.walk(Motion(q[:1])), tcp[0, :3, 3:], Motion(q[:1]), np.zeros(1, dtype=bool), None)
    gain = np.zeros((12, 8))
    gain[9:] = WORK_OBJECT[:3, :3].T @ J[:, :, 0].T
    apart = part_errors(robot, cell, q, at)
    _, _, tied, _ = situation(gain)
    alone = robot.replace(certainty=None)
    assert np.isnan(part_errors(alone, cell, q, at)).all()
    together = part_errors(robot, tied, q, at)
    exact = robot.replace(certainty=replace(robot.certainty, covariance=np.zeros((8, 8))))
    np.testing.assert_allclose(together, part_errors(exact, cell, q, at), rtol=1e-9)
    assert (apart > 1.05 * together).all()


@pytest.mark.parametrize("sizes", [(1, 1, 1), (1, 0, 0), (1, 0.5, 0.2), (1, 1, 0.01)])
def test_lengths_of_gaussian_vectors(sizes):
    drawn = np.linalg.norm(np.random.default_rng(1).standard_normal((200_000, 3)) * np.array(sizes), axis=1)
    mean, u95 = lengths(np.diag(np.square(sizes))[None].astype(float))
    assert mean[0] == pytest.approx(drawn.mean(), rel=0.02)
    assert u95[0] == pytest.approx(np.quantile(drawn, 0.95), rel=0.02)
