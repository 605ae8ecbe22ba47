"""Straight and circular moves cut: the written module, run by a controller of our own, keeps the true tool on its path."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support import arm, random_robot

from irbcal.correction import notation
from irbcal.correction.configurations import configuration_of
from irbcal.correction.filter import filter_program
from irbcal.correction.languages import rapid
from irbcal.correction.text_program import tip_poses
from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.robot import Robot

FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
WOBJ = frames.from_xyz_angles([0.5, 0.0, 0.3, 0.0, 0.0, 0.2])
TOLERANCE = 3e-5
PLACES = {
    "p1": (0.75, -0.35, 0.8, 0.0),
    "p2": (0.95, 0.35, 1.0, 0.3),
    "p3": (0.8, 0.45, 1.15, 0.2),
    "p4": (0.7, 0.0, 1.1, 0.0),
    "p5": (0.75, -0.30, 0.85, 0.1),
}
MOVES = (
    r"MoveJ p1,v100,fine,tGrip\WObj:=wTable;",
    r"MoveL p2,v100\V:=50,fine,tGrip\WObj:=wTable;",
    r"MoveC p3,p4,v100,fine,tGrip\WObj:=wTable; ! round",
    r"MoveL p5,v100,fine,tGrip\WObj:=wTable;",
)


@pytest.fixture(scope="module")
def robots():
    nominal = arm()
    return nominal, random_robot(nominal, "34", np.random.default_rng(1), size=0.3)


def text_of(T):
    numbers = notation.numbers_from_poses(T[None])[0]
    parts = [",".join(notation.number_text(v, 9) for v in part) for part in (numbers[:3], numbers[3:])]
    return f"[{parts[0]}],[{parts[1]}]"


def target(nominal, x, y, z, turn):
    """A robtarget in the work object with the tool."""
    T_tcp = frames.from_xyz_angles([x, y, z, np.pi, 0.4 + turn, 0.2])
    branches = closed_form.branches(nominal, T_tcp[None] @ frames.inverse(TOOL))
    q, inside = closed_form.with_configuration(nominal, branches, 0, np.radians([0, 0, 0, 0, 90, 180]))
    assert inside.all()
    conf = configuration_of(q[0], 0)
    return f"[{text_of(frames.inverse(WOBJ) @ T_tcp)},[{','.join(map(str, conf))}],{FAR}]"


def module(nominal, *moves):
    lines = [
        "MODULE M",
        f"PERS tooldata tGrip:=[TRUE,[{text_of(TOOL)}],[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'PERS wobjdata wTable:=[FALSE,TRUE,"",[{text_of(WOBJ)}],[[0,0,0],[1,0,0,0]]];',
        "CONST zonedata zMine:=[FALSE,5,5,5,1,5,1];",
    ]
    lines += [f"CONST robtarget {name}:={target(nominal, *place)};" for name, place in PLACES.items()]
    return "\r\n".join([*lines, "PROC main()", *(f"  {move}" for move in moves), "ENDPROC", "ENDMODULE", ""]).encode()


def joints(nominal, T_tcp, near):
    """Joints of the nominal arm next to others, at first of branch 0."""
    T = T_tcp @ frames.inverse(TOOL)
    if not near.any():
        return closed_form.branches(nominal, T).joints[:, 0]
    found = any_arm.solve(Robot(nominal), nominal, T, seed=near, thorough=False)
    assert found.converged.all()
    return found.joints


def run(nominal, robot, data):
    """True places of the tool centre point on each move of a module, as its controller moves: list of (n, 3)."""
    program = rapid.parse(data)
    moves = [stop for stop in program.stops() if stop.target is not None]
    tcp = dict(enumerate(WOBJ @ np.array([target.value for target in program.targets])))
    out, k, here = [], 1, tcp[moves[0].target]
    q = joints(nominal, here[None], np.zeros((1, 6)))[0]
    s = np.linspace(0, 1, 200)
    while k < len(moves):
        uses = program.targets[moves[k].target].uses
        via = any(use.line == moves[k].line and use.role == "via" for use in uses)
        there = tcp[moves[k + via].target]
        T = np.tile(np.eye(4), (200, 1, 1))
        T[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix(np.array([here[:3, :3], there[:3, :3]])))(s).as_matrix()
        T[:, :3, 3] = here[:3, 3] + s[:, None] * (there - here)[:3, 3]
        if via:
            T[:, :3, 3] = arc(here[:3, 3], tcp[moves[k].target][:3, 3], there[:3, 3], s)
        commanded = joints(nominal, T, np.repeat(q[None], 200, axis=0))
        out.append((robot.forward(commanded) @ TOOL)[:, :3, 3])
        q, here, k = commanded[-1], there, k + 1 + via
    return out


def arc(a, b, c, s):
    """Places on the arc from a over b to c, by the centre from perpendicular bisectors."""
    normal = np.cross(b - a, c - a)
    rows = np.array([b - a, c - a, normal])
    centre = np.linalg.solve(rows, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, normal @ a])
    x, n = a - centre, normal / np.linalg.norm(normal)
    y = np.cross(n, x)
    angle = np.arctan2((c - centre) @ y, (c - centre) @ x) % (2 * np.pi)
    return centre + np.cos(s * angle)[:, None] * x + np.sin(s * angle)[:, None] * y


def away(wanted, places):
    """Largest distance of places from a finely sampled path."""
    a, b = wanted[:-1], np.diff(wanted, axis=0)
    rel = places[:, None] - a
    t = np.clip(np.einsum("ijk,jk->ij", rel, b) / np.sum(b * b, axis=1), 0, 1)
    return np.linalg.norm(rel - t[..., None] * b, axis=2).min(axis=1).max()


def test_the_true_tool_keeps_to_the_wanted_path(robots):
    nominal, robot = robots
    data = module(nominal, *MOVES)
    wanted = run(nominal, Robot(nominal), data)
    plain = filter_program(robot, nominal, rapid.parse(data), "abc")
    found = filter_program(robot, nominal, rapid.parse(data), "abc", path_tolerance=TOLERANCE)
    assert plain.paths is None
    assert found.left == ()
    uncut = [away(w, p) for w, p in zip(wanted, run(nominal, robot, plain.data), strict=True)]
    places = run(nominal, robot, found.data)
    assert list(found.paths_to_frame()["move"]) == ["MoveL p2", "MoveC p4", "MoveL p5"]
    at = 0
    for k, cut in enumerate(found.paths):
        off = max(away(wanted[k], piece) for piece in places[at : at + cut.pieces])
        at += cut.pieces
        assert off < TOLERANCE * 1.02
        assert off == pytest.approx(cut.deviation, abs=2e-6)
        assert uncut[k] == pytest.approx(cut.uncut, abs=2e-6)
        assert cut.pieces > 1
        assert uncut[k] > TOLERANCE
    assert at == len(places)
    lines = found.data.decode().split("\r\n")
    new = [line for line in lines if line.startswith("  MoveL [")]
    assert len(new) == found.paths[0].pieces + found.paths[2].pieces - 2
    assert all(line.endswith(r",v100\V:=50,z0,tGrip\WObj:=wTable;") for line in new[: found.paths[0].pieces - 1])
    # all else is as it was
    kept = [line for line in lines if line.startswith("  Move") and not line.startswith(("  MoveL [", "  MoveC"))]
    assert kept == [f"  {MOVES[0]}", f"  {MOVES[1]}", f"  {MOVES[3]}"]
    assert "joints that turn back" in "\n".join(map(str, found.told()))
    assert found.to_dict()["paths"][0]["pieces"] == found.paths[0].pieces


def test_joints_that_turn_back_are_named_where_they_do(robots):
    nominal, robot = robots
    data = module(nominal, *MOVES)
    cut = filter_program(robot, nominal, rapid.parse(data), "abc", path_tolerance=1e-3).paths[0]
    ends = WOBJ @ np.array([target.value for target in rapid.parse(data).targets[:2]])
    s = np.linspace(0, 1, 2001)
    T = np.tile(np.eye(4), (len(s), 1, 1))
    T[:, :3, :3] = Slerp([0, 1], Rotation.from_matrix(ends[:, :3, :3]))(s).as_matrix()
    T[:, :3, 3] = ends[0, :3, 3] + s[:, None] * (ends[1] - ends[0])[:3, 3]
    q = np.unwrap(closed_form.branches(nominal, T @ frames.inverse(TOOL)).joints[:, 0], axis=0)
    turned = np.diff(np.sign(np.diff(q, axis=0)), axis=0)
    expected = sorted((int(joint) + 1, round(s[row + 1], 2)) for row, joint in np.argwhere(turned))
    assert expected
    assert sorted((turn.joint, round(turn.s, 2)) for turn in cut.turns) == expected


def test_points_stay_out_of_the_zones(robots):
    nominal, robot = robots
    moves = [move.replace("fine", "z50") for move in MOVES[:2]]
    found = filter_program(robot, nominal, rapid.parse(module(nominal, *moves)), "abc", path_tolerance=TOLERANCE)
    cut = found.paths[0]
    assert cut.move.zones == (0.05, 0.05)
    program = rapid.parse(found.data)
    inner = [k for k, t in enumerate(program.targets) if not t.name.startswith("p")]
    assert len(inner) == cut.pieces - 1 > 0
    ends = tip_poses(program, [0, 1]) @ TOOL
    for T in tip_poses(program, inner) @ TOOL:
        assert min(np.linalg.norm((T - end)[:3, 3]) for end in ends) > 0.099


@pytest.mark.parametrize(
    ("moves", "words"),
    [
        ((MOVES[1],), "the program does not tell where it starts"),
        ((MOVES[0], "IF di1=1 THEN", MOVES[1], "ENDIF"), "the program does not tell where it starts"),
        ((MOVES[0], "IF di1=1 " + MOVES[1]), "the program does not tell where it starts"),
        ((MOVES[0], r"MoveL p2,v100,zMine,tGrip\WObj:=wTable;"), "a zone is not one of the predefined ones"),
        ((MOVES[0], r"MoveL p2,v100\T:=5,fine,tGrip\WObj:=wTable;"), r"no points are put into a move with \t"),
        ((MOVES[0], r"MoveL \Conc,p2,v100,fine,tGrip\WObj:=wTable;"), r"no points are put into a move with \conc"),
        ((MOVES[0], r"TriggL p2,v100,trig1,fine,tGrip\WObj:=wTable;"), "no points are put into TriggL"),
        ((MOVES[0], r"MoveL Offs(p1,0,0,1),v100,fine,tGrip\WObj:=wTable;"), "the program does not tell where it ends"),
    ],
)
def test_what_may_not_be_cut_is_named(robots, moves, words):
    nominal, robot = robots
    found = filter_program(robot, nominal, rapid.parse(module(nominal, *moves)), "abc", path_tolerance=TOLERANCE)
    reasons = [item.reason for item in found.left if item.target.startswith("the path of")]
    assert len(reasons) == 1
    assert words in reasons[0]
    assert found.data.count(b"Move") == sum("Move" in move for move in moves)


def test_an_end_that_the_path_does_not_lead_to_is_not_cut(robots):
    """Joint 6 would come to the end a whole turn from where its configuration data say."""
    nominal, robot = robots
    data = module(nominal, *MOVES[:2]).decode()
    head, tail = data.split("p2:=")
    conf = re.search(r"\],\[(-?\d,-?\d,)(\d)(,0\])", tail)
    turned = tail[: conf.start(2)] + str(int(conf[2]) - 4) + tail[conf.end(2) :]
    found = filter_program(
        robot, nominal, rapid.parse((head + "p2:=" + turned).encode()), "abc", path_tolerance=TOLERANCE
    )
    assert "a configuration that the path does not lead to (joint 6)" in found.left[-1].reason


@pytest.mark.parametrize("axis", [b"5", b"-", b"-.", b"track"])
def test_moves_with_external_axes_are_not_cut(robots, axis):
    nominal, robot = robots
    data = module(nominal, *MOVES[:2])
    old = FAR.encode() + b"];\r\nCONST robtarget p3"
    assert old in data
    moved = data.replace(old, old.replace(b"9E9", axis, 1))
    found = filter_program(robot, nominal, rapid.parse(moved), "abc", path_tolerance=TOLERANCE)
    assert "there are external axes" in found.left[-1].reason
    # within a large tolerance nothing needs to be cut, whatever the axes
    whole = filter_program(robot, nominal, rapid.parse(moved), "abc", path_tolerance=0.01)
    assert [cut.pieces for cut in whole.paths] == [1]
    assert whole.left == ()
    assert b"MoveL [" not in whole.data
