"""Motion instructions of all languages as a table, which users extend: every target of every one is corrected."""

import re

import numpy as np
import pytest
from maker_cases import corrected, given, language_tests, pose_numbers, robot_of, universal_robot, well_inside
from support import assert_same_poses

from irbcal.correction import instructions
from irbcal.correction.languages import inform, kawasaki, krl, taught, urscript, val3
from irbcal.errors import OptionError

HERE = {"krl": krl, "inform": inform, "kawasaki": kawasaki, "urscript": urscript, "val3": val3}
ROBOTS = {"krl": "kr120r2500pro", "inform": "gp8", "kawasaki": "rs007n", "val3": "rx160"}
ANGLES = {"krl": "ZYX", "inform": "xyz", "kawasaki": "ZYZ", "urscript": None, "val3": "XYZ"}


def words(row, names="", between=","):
    return between.join(f"{name} {v:.6f}".strip() for name, v in zip(names.split() or [""] * 6, row, strict=True))


class Cell:
    """An arm, two places next to one another, and a program that goes there by some line."""

    def __init__(self, language):
        self.language, self.tests = language, language_tests(language)
        self.robots = universal_robot() if language == "urscript" else robot_of(ROBOTS[language], size=0.05)
        self.nominal, self.robot, at = self.robots
        if language == "urscript":
            q = np.radians([[30.0, -90, 80, -60, 80, 20]])
        else:
            q = getattr(self.tests, "in_front", well_inside)(self.nominal, 1)
        self.q = np.concatenate([q, q + 0.01])
        world = self.tests.WORLD if language == "kawasaki" else at.T_base_world
        flange = self.tests.FLANGE if language == "kawasaki" else np.eye(4)
        length = 1.0 if language == "urscript" else 1e-3
        self.rows = pose_numbers(np.linalg.inv(world) @ self.nominal.forward(self.q) @ flange, ANGLES[language], length)

    def literals(self):
        """Both places as a move of the language names them."""
        if self.language == "krl":
            return ["{" + words(row, "X Y Z A B C") + "}" for row in self.rows]
        if self.language == "kawasaki":
            return [f"TRANS({words(row)})" for row in self.rows]
        if self.language == "urscript":
            return [f"p[{words(row)}]" for row in self.rows]
        return ["C00000", "C00001"] if self.language == "inform" else ["p[0]", "p[1]"]

    def program(self, line, table=None):
        start = np.degrees(self.q[0])
        options = given(self.robots[2], tools={"0": np.eye(4)})._replace(instructions=table or {})
        if self.language == "krl":
            head = "DEF job()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP $AXIS_ACT\nPTP {" + words(
                start, "A1 A2 A3 A4 A5 A6"
            )
            data = "DECL FRAME P1\nP1=" + self.literals()[1]
            return krl.parse(self.nominal, [("job.src", f"{head}}}\n{line}\nEND\n{data}\n".encode())], options)
        if self.language == "inform":
            elbow = np.atleast_1d(inform.YASKAWA.postures(self.nominal, self.q)[1])
            positions = ["///TOOL 0", "///POSTYPE BASE", "///RECTAN"]
            for k, row in enumerate(self.rows):
                flip = 0 if abs(np.degrees(self.q[k, 3])) < 90 else 1
                positions += [f"///RCONF {flip},{int(elbow[k])},0,0,0,0,0,0", f"C{k:05d}={words(row)}"]
            return inform.parse(self.nominal, self.tests.job(positions, [line]), "job.jbi", options)
        if self.language == "kawasaki":
            lines = ["TOOL NULL", "BASE NULL", f"JMOVE #PPOINT({words(start)})", line]
            data = self.tests.save(lines, [f"p1 {words(self.rows[1], between=' ')}"])
            return kawasaki.parse(
                self.nominal, [("job.as", data)], options._replace(where=self.tests.pair(self.nominal))
            )
        if self.language == "urscript":
            data = f"def job():\n set_tcp(p[0,0,0,0,0,0])\n W1={self.literals()[1]}\n movej([{words(self.q[0])}])\n {line}\nend\n"
            return urscript.parse(self.nominal, data.encode(), "job.script", options)
        elbow, wrist = (np.where(self.q[:, k] >= 0, "positive", "negative") for k in (2, 4))
        points = [
            self.tests.value(row, k, f'shoulder="lefty" elbow="e{elbow[k]}" wrist="w{wrist[k]}" fatherId="world[0]"')
            for k, row in enumerate(self.rows)
        ]
        files = self.tests.application(points, [], [line])
        return val3.parse(self.nominal, [*files.items()], options)

    def check(self, program, count):
        """The last ``count`` targets lead to the places, and nothing is left."""
        found = corrected(self.robot, self.nominal, program)
        assert not found.unchanged_targets
        names = [name for name in found.targets if name.lower() not in ("", "#home")]
        poses = [k for k in range(len(names)) if np.abs(found.q_before[k] - self.q[:, None]).max(axis=-1).min() < 1e-3]
        reached = found.q[poses][-count:]
        assert len(reached) == count
        wanted = self.nominal.forward(found.q_before[poses][-count:])
        assert_same_poses(self.robot.poses(reached), wanted, 2e-6, 3e-6)
        assert np.abs(reached - found.q_before[poses][-count:]).max() > 1e-6, "they need a correction"


BUILT_IN = [(language, move) for language in HERE for move in HERE[language].MOTIONS.values()]


@pytest.mark.parametrize(("language", "move"), BUILT_IN, ids=lambda each: getattr(each, "name", each))
def test_every_target_of_every_instruction_of_the_table(language, move):
    cell = Cell(language)
    points = [word for word in move.required if word in ("via", "to")]
    first, *others = cell.literals()[-len(points) :]
    if language == "krl":
        line = f"{move.name} {','.join([first, *others])}"
        line = f"SPLINE\n{line}\nENDSPLINE" if move.name == "SPL" else line
    elif language in ("urscript", "val3"):
        more = ["a=1.2"] if language == "urscript" else ["flange", "mFast"]
        line = f"{move.name}({', '.join([first, *others, *more])})"
    else:
        line = f"{move.name} {first}{' V=100.0' if language == 'inform' else ''}"
    if move.name == "C1MOVE":
        line += f"\nC2MOVE {cell.literals()[1]}"
    cell.check(cell.program(line), len(points))


TAUGHT = {  # a line that goes to the second place, and the lesson
    "krl": ("DISPENSE(P1, 3.5)", "krl DISPENSE to argument2"),
    "inform": ("GLUEMOV C00001 V=100.0", "inform GLUEMOV to *"),
    "kawasaki": ("CALL glue(p1, 30)", "kawasaki glue to argument2"),
    "urscript": ("glue_move(W1, 0.1)", "urscript glue_move to argument2"),
    "val3": ("call glueMove(p[1],flange,mFast)", "val3 glueMove to tool *"),
}


@pytest.mark.parametrize("language", TAUGHT)
def test_a_lesson_makes_a_routine_a_move(tmp_path, language):
    cell = Cell(language)
    line, lesson = TAUGHT[language]
    unknown = cell.program(line).unchanged_targets()
    if language != "val3":
        assert any(f"--instructions: {lesson})" in left.reason for left in unknown)
    (tmp_path / "taught.txt").write_text(lesson)
    table = instructions.read(tmp_path / "taught.txt", taught())
    cell.check(cell.program(line, table), 1)
    wrong = cell.program(line.replace("(", "(1, "), table) if "(" in line else None
    if wrong is not None and "*" not in lesson:
        assert len(wrong.unchanged_targets()) >= 1
        assert not any(t.correctable and t.kind == "pose" for t in wrong.targets)


WRITING = {  # a line that goes to the first place and gives the second a value, to which the next line goes
    "krl": ("SEEK({0}, P1)\nLIN P1", "krl SEEK to writes"),
    "kawasaki": ("CALL seek({0}, p1)\nLMOVE p1", "kawasaki seek to writes"),
    "val3": ("call seek({0},p[1],flange,mFast)\nmovel(p[1],flange,mFast)", "val3 seek to writes tool *"),
}


@pytest.mark.parametrize("language", WRITING)
def test_a_point_that_a_taught_routine_gives_a_value_is_no_target(tmp_path, language):
    cell = Cell(language)
    line, lesson = WRITING[language]
    (tmp_path / "taught.txt").write_text(lesson)
    program = cell.program(line.format(cell.literals()[0]), instructions.read(tmp_path / "taught.txt", taught()))
    names = {"p[0]", "p[1]"} if language == "val3" else {"p1"}  # any element of the array
    left = program.unchanged_targets()
    assert {target.lower() for target, *_ in left} == names
    assert all(re.search(r"uses (it|p) in another way", reason) for *_, reason in left)
    assert sum(target.correctable and target.kind == "pose" for target in program.targets) == 2 - len(names)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("logo MyMove to tool", "line 1: expected an instruction of one of the languages rapid, krl,"),
        ("krl MyMove to tool", "line 1: expected one 'to' and no 'tool' in krl"),
        ("\nrapid", "line 2: expected the name of an instruction"),
        ("rapid 5 to tool", "line 1: expected the name"),
        ("rapid A to to tool", "line 1: expected one 'to' and one 'tool'"),
        ("rapid A to speed", "line 1: expected one 'to' and one 'tool'"),
        ("rapid A to * * tool", "line 1: expected at most one 'via' and at most one '*'"),
    ],
)
def test_lines_that_teach_nothing_are_refused(tmp_path, text, fault):
    (tmp_path / "taught.txt").write_text(text)
    with pytest.raises(OptionError, match=re.escape(fault)) as refused:
        instructions.read(tmp_path / "taught.txt", taught())
    assert refused.value.parameter == "instructions"
