"""The app: the whole job in a real browser, on SIMULATED samples; who may open it; what a stop and a kill leave."""

import asyncio
import contextlib
import http.client
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import irbcal
from irbcal.errors import IrbcalError

if importlib.util.find_spec("nicegui") is None:  # the servers import it, not this process
    pytest.skip("irbcal app needs the extra app", allow_module_level=True)

from irbcal.app import columns, steps
from irbcal.app.project import Project
from irbcal.app.server import Guard, free_socket
from irbcal.io.catalogue import arms

ENDED = re.compile(r"^(done|refused|stopped)\b.* after ")


class Server:
    """`irbcal app` in a process of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.start()

    def start(self):
        words = [sys.executable, "-m", "irbcal", "app", str(self.folder), "--no-open", "--port", "0"]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        line = self.process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=\S+", line)
        assert found, line + self.process.stdout.read()
        self.address, self.port = found[0], int(found[1])

    def page(self, context, name):
        """Another page of the app."""
        return self.at(name, context.new_page())

    def only_page(self, context, name):
        """The page of before gone on to another: 3D views and new windows take the processor's time."""
        return self.at(name, context.pages[0] if context.pages else context.new_page())

    def at(self, name, page):
        page.set_default_timeout(60_000)
        page.request.get(self.address)  # for the cookie
        page.goto(f"http://127.0.0.1:{self.port}/{name}")
        page.wait_for_function("window.did_handshake")
        return page

    def end(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        self.process.wait(20)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def samples(example_files):
    return example_files.folder


@pytest.fixture
def context(browser):
    context = browser.new_context(reduced_motion="reduce")
    yield context
    context.close()


def drop(page, *files):
    page.set_input_files("input[type=file]", [str(file) for file in files])
    for file in files:
        page.get_by_role("button", name=f"Remove {file.name}").wait_for()


def run(page, title):
    """Press a step's button; how it ended."""
    page.get_by_role("button", name=title, exact=True).click()
    ended = page.get_by_text(ENDED).first
    ended.wait_for()
    return ended.inner_text()


def test_the_whole_job_in_a_browser_gives_what_the_shell_gives(context, samples, program, tmp_path, monkeypatch):
    """Buttons run one step; of the others the pages are filled in, and their command lines run in this process."""
    folder = tmp_path / "project"
    server = Server(folder)
    monkeypatch.chdir(folder)
    project = Project(folder)

    def shell(step):
        for words in steps.STEPS[step].commands(project):
            program(*words)

    try:
        page = server.only_page(context, "robot")
        drop(page, samples / "my_robot.urdf")
        page.get_by_role("img", name="irb1600_6_145 at home").wait_for()
        page.get_by_role("button", name=re.compile("Compare a pose")).click()
        page.get_by_label("Joints as the pendant").fill("0, 0, 0, 0, 0, 0")
        page.get_by_label("Tool 0 in the base").fill("815, 0, 1186.5")
        page.get_by_label("Tool 0 in the base").blur()
        page.get_by_role("button", name="Compare", exact=True).press("Enter")  # the panel still slides under a click
        # Nubiola 2011, Table 2.1: a1 + d4 + d6 = 150 + 600 + 65 mm, d1 + a2 = 486.5 + 700 mm
        page.get_by_text("is at 815.00, 0.00, 1186.50 mm").wait_for()

        page = server.only_page(context, "data")
        drop(page, samples / "measured.csv")
        page.get_by_text("100 poses, 3 targets move, 3 stand still, lost points: 9.").wait_for()
        shell("data")

        project.choose("result", **{"--model": "34"})  # the default takes long
        page = server.only_page(context, "result")
        assert run(page, "Calibrate").startswith("done")
        frame = page.frame_locator('iframe[title="my-robot/report.html"]')
        frame.get_by_text("Better than the nominal robot").first.wait_for()
        calibrated = irbcal.calibrate("measured.csv", str(samples / "my_robot.urdf"), "34").robot_calibrated()
        q = np.radians([[10.0, -20.0, 30.0, 40.0, 50.0, 60.0], [0.0, 0.0, 0.0, 0.0, 30.0, 0.0]])
        app = irbcal.load("my-robot").robot_calibrated()
        assert np.abs(app.points(q, "smr1") - calibrated.points(q, "smr1")).max() < 1e-9

        project.add("touches", "touches.csv", (samples / "touches.csv").read_bytes())
        shell("cell")
        page = server.only_page(context, "programs")
        drop(page, samples / "job.csv")
        page.get_by_role("switch", name=re.compile("use the true tools")).click()
        page = server.only_page(context, "certificate")
        drop(page, samples / "verification.csv")
        page.get_by_label("Tolerance, mm", exact=True).fill("0.7")
        page.get_by_label("Serial number").fill("1600-77")
        page = server.only_page(context, "history")
        line = " ".join(*steps.STEPS["programs"].commands(project))
        assert line.startswith("filter my-robot programs/job.csv --out corrected/job.csv ")
        assert line.endswith(" --cell cell.json")
        for step in ("programs", "certificate", "history"):
            shell(step)
        assert (folder / "corrected" / "job.csv").read_bytes() != (samples / "job.csv").read_bytes()
        assert "1600-77" in (folder / "certificate.html").read_text(encoding="utf-8")
        page.get_by_text("Keep a second calibration of this robot: then this step says what changed.").wait_for()
        assert page.get_by_role("button", name="What changed").is_disabled()
        irbcal.fleet_add("my-robot", "fleet.db", date="2020-01-01")
        page.get_by_role("button", name="What changed", disabled=False).wait_for()
    finally:
        server.end()


@pytest.fixture(scope="module")
def with_robot(samples, tmp_path_factory):
    """The server of a project that has its robot."""
    project = Project.open(tmp_path_factory.mktemp("robot") / "project")
    project.add("robot", "my_robot.urdf", (samples / "my_robot.urdf").read_bytes())
    project.choose("robot", robot="robot/my_robot.urdf")
    running = Server(project.folder)
    yield running, project
    running.end()


def test_bad_files_are_refused_in_a_sentence_and_nothing_is_lost(context, samples, with_robot, tmp_path):
    server, project = with_robot
    page = server.only_page(context, "robot")
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot><link")
    drop(page, broken)
    assert run(page, "Show the robot").startswith("refused")
    page.get_by_text("irbcal: broken.urdf").or_(page.get_by_text("irbcal: robot/broken.urdf")).first.wait_for()
    drop(page, samples / "my_robot.urdf")
    page = server.only_page(context, "data")
    nonsense = tmp_path / "nonsense.csv"
    nonsense.write_bytes(b"\x00\x01\xff" * 50)
    drop(page, nonsense)
    page.get_by_role("alert").filter(has_text="nonsense.csv").wait_for()
    assert run(page, "Write the measurement file").startswith("refused")
    assert not project.has("measured.csv")
    # killed without a word: the next server shows what was there
    server.end(signal.SIGKILL if os.name == "posix" else signal.SIGTERM)
    server.start()
    page = server.only_page(context, "data")
    page.get_by_role("button", name="Remove nonsense.csv").click()
    page.get_by_text("Drop measurements first.").wait_for()
    assert project.robot == "robot/my_robot.urdf"


def test_columns_that_are_not_recognised_are_corrected_by_click(context, samples, with_robot, tmp_path):
    server, project = with_robot
    mark, header, rows = (samples / "wide.csv").read_text().split("\n", 2)
    assert mark == "# SIMULATED"
    assert header == "J1;J2;J3;J4;J5;J6;X1;Y1;Z1;X2;Y2;Z2;X3;Y3;Z3"
    bad = tmp_path / "bad.csv"
    bad.write_text(f"{mark}\nA;B;C;D;E;F;G;H;I;J;K;L;M;Q;O\n{rows}")
    page = server.only_page(context, "data")
    drop(page, bad)
    page.get_by_role("alert").filter(has_text="expected columns of points").wait_for()

    def say(column, word):
        page.get_by_label(f"What column {column} of bad.csv means").click()
        page.get_by_role("option", name=word, exact=True).click()
        page.get_by_role("option").first.wait_for(state="detached")  # before the next list opens

    say("B", "joint 1")  # the next five follow
    page.get_by_role("alert").filter(has_text="expected columns of points").wait_for()
    say("G", "x of smr1")  # a column off: G is joint 6
    page.get_by_role("alert").filter(has_text="Still missing: joint 6").wait_for()
    forget = page.get_by_role("button", name="Forget my corrections")
    forget.click()
    forget.wait_for(state="hidden")
    for column, word in (("A", "joint 1"), ("G", "x of smr1"), ("J", "x of smr2"), ("M", "x of smr3")):
        say(column, word)
    page.get_by_text("40 poses, 3 targets move, 0 stand still.").wait_for()
    page.get_by_text("The command line that does the same").click()
    page.get_by_text('columns.joints=["A", "B", "C", "D", "E", "F"]').wait_for()
    assert run(page, "Write the measurement file").startswith("done")
    right = irbcal.import_measurements(samples / "wide.csv", robot=str(samples / "my_robot.urdf"))
    assert (
        irbcal.read_measurements(project.folder / "measured.csv").table["x_mm"].tolist() == right.table["x_mm"].tolist()
    )
    project.remove("measured.csv")
    project.remove("data/bad.csv")


def test_a_step_is_stopped_once_and_one_at_a_time(context, with_robot):
    server, project = with_robot
    project.choose("plan", **{"--optimal": "1000", "--criterion": "position"})  # takes a minute
    first, second, other = (server.page(context, name) for name in ("plan", "plan", "robot"))
    first.get_by_role("button", name="Plan the measurement").click()
    second.get_by_role("button", name="Stop").wait_for()
    assert second.get_by_role("button", name="Plan the measurement").is_disabled()
    show = other.get_by_role("button", name="Show the robot").element_handle()
    show.click()
    other.get_by_text("Another step is running").wait_for()
    stop = second.get_by_role("button", name="Stop").element_handle()
    second.get_by_text(re.compile(r", ([2-9]|\d\d) s$")).wait_for()  # news has come several times
    stop.click()
    first.get_by_text("stopped; the files of before are kept").wait_for()
    # what is clicked has not been drawn anew meanwhile: a click between press and release would be lost
    assert show.evaluate("node => node.isConnected")
    assert stop.evaluate("node => node.isConnected")
    assert not (project.folder / "plan").exists()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Of a project without files, for tests that add none; a secret lies beside its folder."""
    folder = tmp_path_factory.mktemp("new")
    (folder / "secret.txt").write_text("not of the project")
    running = Server(folder / "project")
    yield running
    running.end()


def test_pages_can_be_used_by_keyboard_and_screen_reader(context, server):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    for page in steps.PAGES:
        if page.name in ("result", "programs", "certificate"):
            continue  # nothing is on them that is not on the page of the plan or of the cell
        opened = server.only_page(context, page.name)
        for switch in opened.get_by_role("switch", name="Explain the fields").all():
            switch.press("Space")
        for step in page.steps:
            for option in step.page_options[:1]:
                opened.get_by_text(option.explanation, exact=True).first.wait_for()
        result = axe.run(opened)
        grave = [v["id"] for v in result.response["violations"] if v["impact"] in ("serious", "critical")]
        assert grave == [], page.name


def test_the_list_of_robots_has_pictures_and_is_filtered(context, server):
    page = server.only_page(context, "robot")
    page.get_by_label("Reach from, mm").fill("3000")
    page.get_by_label("Only of this maker").click()
    page.get_by_role("option", name="FANUC", exact=True).click()
    page.get_by_label("Robot", exact=True).click()
    far = {name for name, arm in arms().items() if name.startswith("fanuc/") and (arm.reach or 0.0) >= 3.0}
    # the list of makers is closing, and that of robots is filtered by one wish after the other
    expect = pytest.importorskip("playwright.sync_api").expect
    expect(page.get_by_role("option")).to_have_count(len(far))
    options = page.get_by_role("option").all()
    assert {option.inner_text().split()[0] for option in options} == far
    picture = options[0].locator("img")
    page.wait_for_function("image => image.complete && image.naturalWidth > 0", arg=picture.element_handle())
    robot = options[0].inner_text().split()[0]
    options[0].click()
    drawing = page.get_by_role("img", name=re.compile("at home"))
    drawing.wait_for()
    # the picture of the list is the side of the drawing: the arm's line of both goes the same way
    small = page.request.get(f"http://127.0.0.1:{server.port}/picture/{robot}").text()
    lines = [
        re.findall(r'<path d="([^"]*)" style="[^"]*" stroke-width="10"', text)[-1]
        for text in (small, drawing.inner_html())
    ]
    ways = [np.diff([[float(x) for x in p.split()] for p in line[1:].split("L")], axis=0) for line in lines]
    assert np.abs(ways[0] - ways[1]).max() < 0.2
    assert page.request.get(f"http://127.0.0.1:{server.port}/picture/..%2F..%2Fetc%2Fpasswd").status == 404


def test_columns_with_names_of_irbcal_are_shown_as_used(samples, tmp_path):
    project = Project.open(tmp_path / "project")
    project.choose("robot", robot="irb1600")
    header, rows = (samples / "two_loads.csv").read_text().split("\n", 1)
    foreign = re.sub(r"q(\d)_deg", r"J\1", header).replace("simulated", "remark")
    project.add("data", "export.csv", f"{foreign}\n{rows}".encode())
    (table,) = columns.understood(project).tables
    meanings = dict(zip(table.keys, table.meanings, strict=True))
    assert (meanings["payload_kg"], meanings["time_s"], meanings["remark"]) == ("payload_kg", "time_s", "not used")
    project.add("data", "export.csv", (samples / "two_loads.csv").read_bytes())
    (table,) = columns.understood(project).tables
    assert dict(zip(table.keys, table.meanings, strict=True))["simulated"] == "simulated"


def test_large_files_are_read_beside_the_server(samples, tmp_path, monkeypatch):
    project = Project.open(tmp_path / "project")
    project.choose("robot", robot="irb1600")
    project.add("data", "wide.csv", (samples / "wide.csv").read_bytes())
    here = columns.understood(project)
    assert here.sentence.startswith("40 poses")
    monkeypatch.setattr(columns, "SMALL_FILE", 0)
    monkeypatch.setattr(columns, "understood", None)  # not in this process
    with ThreadPoolExecutor(1) as thread:  # playwright's loop runs in this one
        assert thread.submit(asyncio.run, columns.reading(project)).result() == here

    async def cancelled():
        task = asyncio.ensure_future(columns.reading(project))
        await asyncio.sleep(0.2)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, cancelled()).result()
    children = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert str(project.folder) not in children


def asked(server, path, **headers):
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)) as connection:
        connection.request("GET", path, headers=headers)
        with connection.getresponse() as response:
            return response


def test_only_this_computer_with_the_token_gets_anything(server):
    token = server.address.partition("token=")[2]
    cookie = f"irbcal-{server.port}={token}"
    assert asked(server, "/").status == 403
    assert asked(server, "/?token=wrong").status == 403
    assert asked(server, f"/?token={token}", Host="evil.example").status == 403
    welcome = asked(server, f"/?token={token}")
    assert welcome.status == 303
    assert {"HttpOnly", "SameSite=Strict"} < set(welcome.headers["Set-Cookie"].split("; "))
    assert asked(server, "/robot", Cookie=cookie).status == 200
    assert asked(server, "/robot", Cookie=cookie, Origin="https://evil.example").status == 403
    assert asked(server, "/files/project.json", Cookie=cookie).status == 200
    for path in ("/files/../secret.txt", "/files/%2e%2e/secret.txt", "/folder/..", "/folder/%2e%2e"):
        assert asked(server, path, Cookie=cookie).status == 404, path


@pytest.mark.parametrize(
    ("headers", "local"),
    [
        ({"host": "127.0.0.1:8170"}, True),
        ({"host": "LOCALHOST:1"}, True),
        ({"host": "127.0.0.1.evil.example"}, False),
        ({"host": "127.0.0.1:8170", "origin": "http://127.0.0.1:8170"}, True),
        ({"host": "127.0.0.1:8170", "origin": "null"}, False),
        ({}, False),
    ],
)
def test_hosts_and_origins(headers, local):
    assert Guard.local(headers) is local


def test_a_project_keeps_what_is_dropped_inside(tmp_path):
    project = Project.open(tmp_path / "new")
    assert project.add("data", r"C:\fakepath\a b.csv", b"1") == "data/a b.csv"
    assert project.add("data", "../../a b.csv", b"2") == "data/a b.csv"
    assert (tmp_path / "new" / "data" / "a b.csv").read_bytes() == b"2"
    for name in ("", "..", "-rf", ".hidden", "a\nb.csv", "a:b.csv", "x" * 200):
        with pytest.raises(IrbcalError, match="rename it"):
            project.add("data", name, b"")
    project.choose("plan", **{"--optimal": "40"})
    project.choose("plan", **{"--payload": "3"})
    assert Project.open(tmp_path / "new").choices()["plan"] == {"--optimal": "40", "--payload": "3"}
    assert project.inside("../new/project.json") is not None
    assert project.inside("../secret") is None
    project.remove("project.json")  # not a dropped file
    assert project.has("project.json")


def test_a_folder_of_others_is_no_project(tmp_path):
    (tmp_path / "thesis.docx").write_text("")
    with pytest.raises(IrbcalError, match="not a project"):
        Project.open(tmp_path)
    assert not (tmp_path / "project.json").exists()
    (tmp_path / "project.json").write_text(json.dumps([1]))
    with pytest.raises(IrbcalError, match="an object for each step"):
        Project.open(tmp_path)


def test_options_are_those_of_the_command_line(tmp_path):
    project = Project.open(tmp_path / "new")
    for step in steps.STEPS.values():
        assert all(option.explanation for option in step.page_options), step.name
    assert set(steps.LABELS) <= {option.name[2:] for step in steps.STEPS.values() for option in step.page_options}
    project.choose("robot", robot="irb1600")
    project.choose("result", **{"--holdout": "0.3", "--model": "34", "--same-tool": True, "--session-by": ""})
    assert steps.STEPS["result"].commands(project)[0] == [
        *("calibrate", "measured.csv", "--robot", "irb1600", "--out", "my-robot", "--force"),
        *("--model=34", "--holdout=0.3", "--same-tool"),
    ]
    # what was dropped again makes results anew; a plan may have been filled in
    project.add("programs", "job.csv", b"")
    forced = {
        name: "--force" in steps.STEPS[name].commands(project)[0] for name in ("data", "cell", "programs", "plan")
    }
    assert forced == {"data": True, "cell": True, "programs": True, "plan": False}
    # what is typed is a value, never an option
    project.choose("plan", **{"--payload": "--out=/etc"})
    assert steps.STEPS["plan"].commands(project)[0][-1] == "--payload=--out=/etc"


def test_a_taken_port_is_refused():
    with free_socket(0) as taken:
        taken.listen()
        with pytest.raises(IrbcalError, match="cannot be used"):
            free_socket(taken.getsockname()[1])
