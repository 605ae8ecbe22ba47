"""Tools and work objects as makers declare them: what was written is read again by the languages, and by SciPy."""

import re

import numpy as np
import pytest
from maker_cases import SCIPY, given, language_tests, poses, robot_of, universal_robot
from rapid_modules import parsed

from irbcal.correction.declarations import declared
from irbcal.correction.known_languages import MAKERS
from irbcal.correction.languages import fanuc, kawasaki, krl, urscript, val3
from irbcal.errors import OptionError
from irbcal.modeling import frames

NAMES = {
    "kuka": ("3", "17"),
    "abb": ("tGrip", "wPart"),
    "fanuc": ("3", "9"),
    "yaskawa": ("3", "63"),
    "kawasaki": ("grip.1", "part"),
    "staubli": ("tGrip[0]", "fPart[0]"),
    "ur": ("grip", "part"),
}
PRINTED = {"fanuc": (6e-7, 2e-5), "yaskawa": (6e-7, 2e-6)}
"""Half of the last decimal, metres and radians; of the others less than a nanometre and 1e-8 rad."""


def random_frames(n, seed):
    rng = np.random.default_rng(seed)
    return [frames.from_xyz_angles([*rng.uniform(-2, 2, 3), *rng.uniform(-np.pi, np.pi, 3)]) for _ in range(n)]


def registered(text, kind):
    """What a frame is when the listing of FANUC has run, followed line by line; numbers as written."""
    register, out, number = None, None, 0
    for line in text.split("/MN\r\n")[1].split("/POS")[0].splitlines():
        number += 1
        assert line.endswith(" ;")
        head, _, step = line[:-2].partition(":  ")
        assert int(head) == number
        if step == "PR[100]=LPOS":
            register = dict.fromkeys("123456", np.nan)
        elif element := re.fullmatch(r"PR\[100,([1-6])\]=(\d+\.\d+|\(-\d+\.\d+\))", step):
            register[element[1]] = float(element[2].strip("()"))
        elif re.fullmatch(rf"{kind}\[\d+\]=PR\[100\]", step):
            out = np.array([register[k] for k in "123456"])
        else:
            assert step.startswith("!") or re.fullmatch(r"U(TOOL|FRAME)\[\d+\]=PR\[100\]", step)
    assert f"LINE_COUNT\t= {number};" in text
    return out


def read_by_the_language(maker, text, tool, work_object):
    """Tools and work objects of a program that uses the declared ones, in the flange and the controller's base."""
    if maker == "kuka":
        nominal, _, at = robot_of("kr120r2500pro")
        src = f"DEF job()\n$TOOL=TOOL_DATA[{tool}]\n$BASE=BASE_DATA[{work_object}]\nPTP {{X 1,Y 2,Z 3,A 0,B 0,C 0,S 2,T 2}}\nEND\n"
        program = krl.parse(nominal, [("$config.dat", text.encode()), ("job.src", src.encode())], given(at))
        return program.tools[tool], program.work_objects[work_object]
    if maker == "abb":
        move = f"  MoveL [[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v10,fine,{tool}\\WObj:={work_object};"
        job = text.replace("ENDMODULE", f"  PROC main()\n{move}\n  ENDPROC\nENDMODULE")
        program = parsed(job.encode())
        return program.tools[tool.lower()], program.work_objects[work_object.lower()]
    if maker == "kawasaki":
        nominal, _, at = robot_of("rs007n")
        extra = given(at)._replace(where=language_tests("kawasaki").pair(nominal))
        at = kawasaki.ends(nominal, *extra.where)
        lines = [".PROGRAM main()", f"  TOOL {tool}", f"  BASE {work_object}", "  JMOVE #p", "  LMOVE a", ".END"]
        lines += [".JOINTS", "#p 10 20 -80 15 60 10", ".END", text.replace(".END", "a 1 2 3 0 0 0\n.END")]
        program = kawasaki.parse(nominal, [("job.as", "\n".join(lines).encode())], extra)
        ends = frames.inverse(at.T_tip_flange), frames.inverse(at.T_base_world)
        return ends[0] @ program.tools[tool], ends[1] @ program.work_objects[work_object]
    if maker == "fanuc":
        values = {kind: registered(text, kind) for kind in ("UTOOL", "UFRAME")}
        nominal, _, at = robot_of("m20ia")
        tests = language_tests("fanuc")
        point = tests.point(1, tests.GOOD, "N U T, 0, 0, 0", int(work_object), int(tool))
        job = text.replace("/POS\r\n", f"  99:L P[1] 100mm/sec FINE ;\r\n/POS\r\n{point}")
        for moved in (0.0, 0.002):
            read = {k: fanuc.FANUC.frame([*(numbers + np.eye(6)[0] * moved)]) for k, numbers in values.items()}
            extra = given(at, tools={tool: read["UTOOL"]}, work_objects={work_object: read["UFRAME"]})
            (target,) = fanuc.parse(nominal, job.encode(), "irbcal_cell.ls", extra).targets
            assert ("UTOOL" in target.reason) == bool(moved), target.reason
        both = poses(np.array(list(values.values())), SCIPY["fanuc"])
        return both[0], both[1]
    if maker == "staubli":
        nominal, _, at = robot_of("rx160")
        point = '<Data name="p" type="pointRx"><Value key="0" x="1" y="2" z="3" rx="0" ry="0" rz="0" shoulder="lefty" '
        point += f'elbow="epositive" wrist="wpositive" fatherId="{work_object}" /></Data>'
        code = f"<Programs><Code><![CDATA[begin\n movej(p,{tool.removesuffix('[0]')},m)\nend]]></Code></Programs>"
        files = [("job.dtx", text.replace("</Datas>", point + "</Datas>").encode()), ("start.pgx", code.encode())]
        program = val3.parse(nominal, files, given(at))
        ends = frames.inverse(at.T_tip_flange), frames.inverse(at.T_base_world)
        return ends[0] @ program.tools[tool.lower()], ends[1] @ program.work_objects[work_object.lower()]
    nominal, _, at = universal_robot()
    job = "def job():\n" + text + f"movej({work_object})\nend\n"
    program = urscript.parse(nominal, job.encode(), "job.script", given(at))
    (target,) = program.targets
    return frames.inverse(at.T_tip_flange) @ program.tools[target.uses[0].tool], target.value


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("maker", MAKERS)
def test_what_is_declared_is_read_again(maker, seed):
    tool, work_object = random_frames(2, seed)
    names = NAMES[maker]
    text = declared(maker, {names[0]: tool}, {names[1]: work_object})
    far, turned = PRINTED.get(maker, (1e-9, 1e-8))
    if maker == "yaskawa":
        rows = [re.findall(r"\s-?\d+\.\d+", line) for line in text.splitlines() if re.search(r"X -?\d", line)]
        both = poses(np.array(rows, dtype=float), SCIPY["fanuc"])  # angles as of FANUC
    else:
        both = read_by_the_language(maker, text, *names)
    for read, meant in zip(both, (tool, work_object), strict=True):
        assert np.linalg.norm(read[:3, 3] - meant[:3, 3]) < 2 * far
        assert frames.rotation_distance(read[:3, :3], meant[:3, :3]) < 2 * turned


@pytest.mark.parametrize(
    ("maker", "name"),
    [
        *((maker, bad) for maker in MAKERS for bad in ("a b", "x]:=[", "1e5", "ü", "3\n", "")),
        ("kuka", "0"),
        ("abb", "3"),
        ("kawasaki", "a" * 16),
        ("staubli", "tGrip"),
    ],
)
def test_a_name_that_the_maker_does_not_have_is_refused(maker, name):
    for named in (({name: np.eye(4)}, {}), ({}, {name: np.eye(4)})):
        with pytest.raises(OptionError, match=f"names of {maker}"):
            declared(maker, *named)
