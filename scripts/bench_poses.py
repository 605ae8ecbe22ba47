"""Programs of many poses in the languages of all makers, for scripts/bench: a path of small waves about one pose."""

import re

import numpy as np

from irbcal.correction import languages
from irbcal.io import controller_model
from irbcal.modeling import frames

GIVEN = {
    "urscript": ("--tool", "active=0,0,0,0,0,0"),
    "inform": ("--tool", "0=0,0,0,0,0,0"),
    "kawasaki": ("--where", "20,30,-80,15,60,10=218.013,546.559,234.426,53.4846,52.0439,-62.0339"),
}
"""What must be said of a program's tool, or of the controller's base and flange."""


def fixed(values, decimals=6):
    """Numbers as text."""
    return [f"{value:.{decimals}f}" for value in values]


def waves(maker, arm, start, n):
    """Joints of n poses, a path about the first of many whose wrist is in front and whose elbow is not bent back."""
    flags = np.array(maker.postures(arm, start))
    middle = start[np.argmin(flags[0] | flags[1])]
    t = np.linspace(0.0, 4e-3 * np.pi * n, n)[:, None]
    return middle + np.radians(4.0) * np.sin(t * np.array([1.0, 1.3, 0.7, 1.1, 0.9, 1.7]))


def program(name, data, arm, start, n, folder, samples):
    """A program of n poses: its file or folder."""
    maker = languages.by_name()[name].maker.for_arm(arm)
    q = waves(maker, arm, start, n)
    at = controller_model.controller_frames(data, name, arm.base_link, arm.tip_link)
    T = (
        frames.inverse(at.T_base_world) @ arm.forward(q) @ at.T_tip_flange
        if at.base_known or name == "kawasaki"
        else arm.forward(q)
    )
    joints = maker.program_joints(q)
    rows, postures = maker.numbers(T, np.zeros((n, 6))), np.array(maker.postures(arm, q)).T
    return WRITERS[name](rows, joints, postures, folder, samples)


def _written(file, lines):
    file.write_text("\r\n".join([*lines, ""]))
    return file


def krl(rows, joints, _, folder, __):
    """Straight moves to poses without S and T behind a stop at joints."""

    def aggregate(names, values):
        return "{" + ", ".join(f"{name} {value}" for name, value in zip(names, fixed(values), strict=True)) + "}"

    axes = [f"A{k}" for k in range(1, 7)]
    head = ["&ACCESS RVP", "DEF job( )", "$TOOL=$NULLFRAME", "$BASE=$WORLD"]
    moves = [f"PTP {aggregate(axes, np.degrees(joints[0]))}", *(f"LIN {aggregate('XYZABC', row)}" for row in rows)]
    return _written(folder / "job.src", [*head, *moves, "END"])


def fanuc(rows, _, postures, folder, __):
    """Straight moves to taught positions."""
    lines = ["/PROG  JOB", "/ATTR", "OWNER\t\t= MNEDITOR;", "/MN"]
    lines += [f"   {k}:L P[{k}] 250mm/sec FINE ;" for k in range(1, len(rows) + 1)] + ["/POS"]
    for k, (row, (back, bent, negative)) in enumerate(zip(rows, postures, strict=True), start=1):
        config = f"{'F' if negative else 'N'} {'D' if bent else 'U'} {'B' if back else 'T'}, 0, 0, 0"
        x, y, z, w, p, r = fixed(row, 3)
        lines += [f"P[{k}]{{", "   GP1:", f"\tUF : 0, UT : 0,\t\tCONFIG : '{config}',"]
        lines += [f"\tX = {x}  mm,\tY = {y}  mm,\tZ = {z}  mm,", f"\tW = {w} deg,\tP = {p} deg,\tR = {r} deg", "};"]
    return _written(folder / "job.ls", [*lines, "/END"])


def inform(rows, _, __, folder, ___):
    """Straight moves to rectangular positions that share an RCONF."""
    lines = ["/JOB", "//NAME JOB", "//POS", f"///NPOS {len(rows)},0,0,0,0,0", "///TOOL 0", "///POSTYPE BASE"]
    lines += ["///RECTAN", "///RCONF 0,0,0,0,0,0,0,0"]
    lines += [f"C{k:05d}={','.join([*fixed(row[:3], 3), *fixed(row[3:], 4)])}" for k, row in enumerate(rows)]
    lines += ["//INST", "///DATE 2026/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    return _written(folder / "JOB.JBI", [*lines, *(f"MOVL C{k:05d} V=250.0" for k in range(len(rows))), "END"])


def kawasaki(rows, joints, _, folder, __):
    """Straight moves to poses behind a stop at joints."""
    lines = [".PROGRAM job()", "  TOOL NULL", "  BASE NULL", "  JMOVE #start"]
    lines += [*(f"  LMOVE place[{k}]" for k in range(1, len(rows) + 1)), ".END", ".TRANS"]
    lines += [f"place[{k}] {' '.join(fixed(row))}" for k, row in enumerate(rows, start=1)]
    start = " ".join(fixed(np.degrees(joints[0])))
    return _written(folder / "job.as", [*lines, ".END", ".JOINTS", f"#start {start}", ".END"])


def urscript(rows, joints, _, folder, __):
    """Straight moves to poses behind a stop at joints."""
    lines = ["def job():", f"  movej([{', '.join(fixed(joints[0], 9))}], a=1.4, v=1.05)"]
    lines += [f"  movel(p[{', '.join(fixed(row, 9))}], a=1.2, v=0.25)" for row in rows]
    return _written(folder / "job.script", [*lines, "end"])


def val3(rows, _, __, folder, samples):
    """The sample's application with more points."""
    for path in (path for path in samples if path.startswith("staubli/application/")):
        (folder / path.rsplit("/", 1)[1]).write_bytes(samples[path])
    code = "".join(f"  movel(pWork[{k}], flange, mNomSpeed)\n" for k in range(len(rows)))
    text = (folder / "start.pgx").read_text()
    (folder / "start.pgx").write_text(re.sub(r"(?s)(CDATA\[).*?(\]\]>)", rf"\1\nbegin\n{code}end\n\2", text))
    names, posture = ("x", "y", "z", "rx", "ry", "rz"), 'shoulder="lefty" elbow="epositive" wrist="wpositive"'
    values = ""
    for k, row in enumerate(rows):
        numbers = " ".join(f'{name}="{value}"' for name, value in zip(names, fixed(row), strict=True))
        values += f'      <Value key="{k}" {numbers} {posture} fatherId="world[0]" />\n'
    data = folder / "application.dtx"
    points = r'(?s)(<Data name="pWork"[^>]*size=")\d+(">).*?(</Data>)'
    data.write_text(re.sub(points, rf"\g<1>{len(rows)}\2\n{values}    \3", data.read_text()))
    return folder


WRITERS = {"krl": krl, "fanuc": fanuc, "inform": inform, "kawasaki": kawasaki, "urscript": urscript, "val3": val3}
ARMS = {
    "krl": "kuka",
    "fanuc": "fanuc",
    "inform": "yaskawa",
    "kawasaki": "kawasaki",
    "urscript": "kuka",
    "val3": "staubli",
}
"""Makers whose sample arms the programs are for; URScript takes any arm."""
