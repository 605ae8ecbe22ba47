"""A robot language in a module of its own, as somebody would add one: plan, filter, what is left, touches, frames."""

import re
import sys
import textwrap

import numpy as np
import pandas as pd
import pytest
from support import arm

import irbcal
from irbcal.correction import languages
from irbcal.correction.cell_options import CellOptions
from irbcal.correction.declarations import declared
from irbcal.correction.known_languages import KnownLanguage
from irbcal.correction.program_touches import with_joints
from irbcal.errors import OptionError

LOGO = textwrap.dedent(r'''
    """Logo: ``J`` and ``L`` with a name and six numbers, ``T`` sets the tool; ``;`` begins a comment."""

    import re

    import numpy as np

    from irbcal.correction import notation
    from irbcal.correction.backup import Backup, placed
    from irbcal.correction.instructions import built_in
    from irbcal.correction.language import ANY_WORD, FrameDeclaration, Language
    from irbcal.correction.listing import Listing, Number, mark_in
    from irbcal.correction.maker import Maker
    from irbcal.correction.program import each_read, read_bytes
    from irbcal.correction.targets import Target
    from irbcal.correction.control_flow import ControlFlow
    from irbcal.correction.text_program import PostureProgram
    from irbcal.modeling import frames
    from irbcal.units import DEG, MM

    TURTLE = Maker("Logo", notation.Angles(("W", "P", "R"), "zyx", reverse=True), MM, DEG, DEG, (3, 4, 4), (), np.eye(6))
    MOTIONS = built_in("J L: to")


    class LogoProgram(PostureProgram):
        def mark(self, fingerprint, at):
            return at, at, f"; irbcal fake targets {fingerprint}\n"


    def looks_like(data):
        return data.startswith(b"; LOGO")


    def comments(listing):
        return re.findall("^;.*", listing.text, re.MULTILINE)


    def parse(arm, data, source, setup):
        listing, targets, tools = Listing([(source, data)], "Logo"), [], {}
        flow = ControlFlow(listing)
        flow.frame("base")
        moves = MOTIONS | setup.instructions.get("logo", {})
        for line in re.finditer(r"^(\w+) (\w+)(.*)", listing.text, re.MULTILINE):
            found = re.finditer(r"\S+", line[3])
            numbers = [Number(float(n[0]), n.start() + line.start(3), n.end() + line.start(3)) for n in found]
            if line[1] == "T":
                tools[line[2].lower()] = TURTLE.frame([number.value for number in numbers])
                flow.tool(line[2].lower())
            elif line[1].lower() in moves and len(numbers) == 6:
                targets.append(Target(line[2], "joint" if line[1] == "J" else "pose", line.start(), numbers))
                flow.use(targets[-1], line.start(), line[1])
                flow.stop(targets[-1], line.start())
            else:
                flow.leave(line.start(), line[1], line[2], "this is no move that is known")
        at, world = listing.after_line(0), {"base": frames.transform()}
        return LogoProgram.assembled(
            TURTLE, arm, flow, targets, setup, tools, world, comments=comments(listing), mark_at=at
        )


    def read_for(arm, files, setup):
        programs, unread = each_read(files, lambda file: parse(arm, read_bytes(file), str(file), setup))
        return [*programs, *unread]


    def write_moves(moves):
        rows = [f"J P{k} {' '.join(row)}" for k, row in enumerate(moves.texts(TURTLE))]
        return {"plan.logo": "\n".join(["; LOGO", *rows, ""])}


    def backup(files):
        beside = files[0].with_name("place.txt")
        if not beside.is_file():
            return Backup()
        return placed(Backup(), TURTLE.frame([float(v) for v in beside.read_text().split()]), beside)


    LANGUAGE = Language(
        name="Logo",
        endings=(".logo",),
        looks_like=looks_like,
        reader=read_for,
        fingerprint=lambda data, source: mark_in(comments(Listing([(source, data)], "Logo"))),
        maker=TURTLE,
        write_moves=write_moves,
        motions=MOTIONS,
        backup=backup,
        declaration=FrameDeclaration(*ANY_WORD, "; LOGO", "T {name} {0} {1} {2}", "F {name} {0} {1} {2}"),
        without_text={".lgz": (".logo", "a packed Logo program: unpack it")},
    )
''')
JOINTS = np.array([10.0, -10.0, 20.0, 15.0, 40.0, -30.0])
"""Degrees, of the stop from which the straight move starts and where it ends."""


@pytest.fixture(scope="module")
def logo(tmp_path_factory):
    """Logo is known: a file in the folder of languages, and a line."""
    folder = tmp_path_factory.mktemp("languages")
    (folder / "logo.py").write_text(LOGO)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(languages, "__path__", [*languages.__path__, str(folder)])
        patch.setattr(languages, "KNOWN", (*languages.KNOWN, KnownLanguage("logo", "turtle")))
        yield languages.by_name()["logo"]
    sys.modules.pop(f"{languages.__name__}.logo")


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    path = tmp_path_factory.mktemp("logo") / "cal"
    measured = irbcal.simulate("irb1600", random=30, seed=3, only=[])
    irbcal.save(irbcal.calibrate(measured, "irb1600", model="16"), path)
    return path


def program(folder, lines, name="job.logo"):
    (folder / name).write_text("\n".join(["; LOGO", "T grip 0 0 100 0 0 0", *lines, ""]))
    return folder / name


def numbers_of(data):
    return {line.split()[1]: np.array(line.split()[2:], float) for line in data.splitlines() if line[:1] in "JLG"}


def straight():
    """A stop at joints, and a pose of the tool 100 mm above the flange, which those joints reach."""
    T = arm("irb1600").forward(np.radians([JOINTS]))[0]
    place = T[:3, 3] * 1e3 + 100 * T[:3, 2]
    angles = np.degrees([np.arctan2(T[2, 1], T[2, 2]), -np.arcsin(T[2, 0]), np.arctan2(T[1, 0], T[0, 0])])
    words = [" ".join(f"{value:.6f}" for value in row) for row in (JOINTS, [*place, *angles])]
    return [f"J P1 {words[0]}", f"L P2 {words[1]}"]


def test_a_plan_is_written_in_it(logo, tmp_path):
    plan = irbcal.plan("irb1600", axis=0, cube=0, all_range=4, level="nominal", ignore=["collision"], language="logo")
    plan.save(tmp_path / "plan")
    data = (tmp_path / "plan" / "plan.logo").read_text()
    found = np.array(list(numbers_of(data).values()))
    np.testing.assert_allclose(found[1:-1], np.degrees(plan.q), rtol=0, atol=1e-4)


def test_programs_are_corrected_as_the_same_joints_in_a_table(logo, calibration, tmp_path):
    job = program(tmp_path, [*straight(), "GLUE P3 1 2", "; the end"])
    (tmp_path / "packed.lgz").write_bytes(b"\0")
    result = irbcal.correct(calibration, tmp_path, out=tmp_path / "new.logo", allow_partial=True)
    assert [(left.target, left.reason) for left in result.unchanged_targets] == [
        ("GLUE P3", "this is no move that is known")
    ]
    assert any("packed.lgz" in str(note) and "unpack it" in str(note) for note in result.notes)
    new = (tmp_path / "new.logo").read_text()
    pd.DataFrame([JOINTS], columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv(tmp_path / "job.csv", index=False)
    irbcal.correct(calibration, tmp_path / "job.csv", out=tmp_path / "new.csv")
    q = pd.read_csv(tmp_path / "new.csv").iloc[0, :6].to_numpy(float)
    assert np.abs(q - JOINTS).max() > 1e-3
    found = numbers_of(new)
    np.testing.assert_allclose(found["P1"], q, rtol=0, atol=1e-4)
    pose = arm("irb1600").forward(np.radians([q]))[0]  # P2 is where P1 is
    np.testing.assert_allclose(found["P2"][:3], pose[:3, 3] * 1e3 + 100 * pose[:3, 2], rtol=0, atol=0.01)
    assert logo.fingerprint(new.encode(), "job.logo") == irbcal.load(calibration).record.fingerprint
    kept = [re.sub(r"-?\d+\.\d+", "#", line) for line in new.splitlines() if "irbcal" not in line]
    assert kept == [re.sub(r"-?\d+\.\d+", "#", line) for line in job.read_text().splitlines()]


def test_users_teach_its_moves_and_backups_place_the_robot(logo, calibration, tmp_path):
    job = program(tmp_path, [straight()[0], straight()[1].replace("L P2", "GLUE P2")])
    (tmp_path / "taught.txt").write_text("logo GLUE to\n")
    (tmp_path / "wrong.txt").write_text("logo GLUE to tool\n")
    with pytest.raises(OptionError, match="no 'tool' in logo"):
        irbcal.correct(calibration, job, instructions=tmp_path / "wrong.txt")
    irbcal.correct(calibration, job, instructions=tmp_path / "taught.txt", out=tmp_path / "new.logo")
    before, after = (numbers_of(path.read_text()) for path in (job, tmp_path / "new.logo"))
    assert np.abs(after["P2"] - before["P2"]).max() > 1e-3
    (tmp_path / "place.txt").write_text("1000 0 0 0 0 0")
    placed = irbcal.correct(calibration, job, instructions=tmp_path / "taught.txt", allow_partial=True)
    assert any("the robot stands at 1000.000, 0.000, 0.000 mm" in str(note) for note in placed.notes)


def test_its_points_are_touches_and_its_maker_declares_frames(logo, calibration, tmp_path):
    job = program(tmp_path, straight())
    rows = [["tool", "grip", "socket", "", name] for name in ("P1", "P2")]
    table = pd.DataFrame(rows, columns=["frame", "name", "point", "tool", "target"])
    touches, tools, _ = with_joints(CellOptions(calibration, table, program=job))
    found = touches[[f"q{k}_deg" for k in range(1, 7)]].to_numpy(float)
    np.testing.assert_allclose(found, [JOINTS, JOINTS], rtol=0, atol=1e-4)
    assert tools["grip"][2, 3] == pytest.approx(0.1)
    T = np.eye(4)
    T[:3, 3] = 0.1, -0.2, 0.3
    assert declared("turtle", {"grip": T}, {"part": T}).splitlines()[1:] == [
        "T grip 100.000 -200.000 300.000",
        "F part 100.000 -200.000 300.000",
    ]
