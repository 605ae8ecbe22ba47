"""The steps of the app: which command lines they are, what they need, and which files they give.

A new step is a row of `PAGES`. Options are explained where the command line explains them: a page takes labels, choices
and explanations from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from irbcal.app.project import CORRECTED, Project
from irbcal.errors import IrbcalError
from irbcal.validation.provenance import FIELDS

ROBOT, DATA, CALIBRATION = "Choose a robot first.", "Understand the measurements first.", "Calibrate first."
PLAN, MEASURED, FOLDER, CELL = "plan", "measured.csv", "my-robot", "cell.json"
VIEW, STORE, CERTIFICATE = "view.html", "fleet.db", "certificate.html"
Values = Mapping[str, Any]
LABELS = {
    "optimal": "Number of poses, the best ones",
    "criterion": "What is best",
    "targets": "Reflectors: number, names or file",
    "tracker": "Place of the tracker X,Y,Z, mm",
    "payload": "Payload, kg",
    "payload-centre": "Centre of the payload X,Y,Z, mm",
    "device": "Device in place of the tracker",
    "poses": "Number of poses with a device",
    "model": "Error model",
    "holdout": "Held-out poses: share or number",
    "split": "Which poses are held out",
    "same-tool": "Reflectors stayed when the load changed",
    "session-by": "Column that names the session",
    "controller-frames": "Frames of the controller",
    "points": "Points: offline or taught",
    "start": "Joints at the start J1,…,J6, deg",
    "tool": "Tool, NAME=…",
    "wobj": "Work object, NAME=…",
    "path-tolerance": "Path tolerance, mm",
    "split-points": "Copies of points that moves shift",
    "allow-partial": "Write although targets are left as they are",
    "tolerance": "Tolerance, mm",
    "rule": "What must be within the tolerance",
    "region-only": "Only for the region of these poses",
    "tracker-u95-mm": "Tracker uncertainty (95 %), mm",
    "refit-base": "The tracker was moved",
    "refit-tool": "The reflectors were remounted",
    "id": "Name of the robot",
    "serial": "Serial number",
    "date": "Date of the measurement",
}
"""What a page calls an option whose name a technician would have to look up."""


@dataclass(frozen=True)
class Option:
    """An option of a command line that a page asks for."""

    name: str
    """As it is typed: ``--holdout``."""
    kind: str
    """``text``, ``switch`` or ``choice``."""
    choices: tuple[str, ...]
    explanation: str
    hint: str
    """What is typed, such as ``X,Y,Z``."""

    @property
    def label(self) -> str:
        """The name in words."""
        name = self.name.lstrip("-")
        return LABELS.get(name, name.replace("-", " ").capitalize())


@dataclass(frozen=True)
class Step:
    """A step: command lines, and the files that they read and write."""

    name: str
    title: str
    command: str
    """Whose options are asked for, such as ``fleet add``."""
    lines: Callable[[Project, Values], list[list[str]]]
    """Command lines of a project, without the options."""
    needs: Callable[[Project], str]
    """What must be done first, as a sentence; empty where all is there."""
    options: tuple[str, ...] = ()
    pages: tuple[str, ...] = ()
    """Files (HTML) that show the result."""
    files: tuple[str, ...] = ()
    """Files and folders to download."""

    @property
    def page_options(self) -> list[Option]:
        """Its options, as the command line explains them."""
        known = {option.name: option for option in options_of(self.command)}
        return [known[name] for name in self.options]

    def commands(self, project: Project) -> list[list[str]]:
        """Its command lines with the options that were typed; these go to the first."""
        values = project.choices().get(self.name, {})
        first, *others = self.lines(project, values)
        typed = list[str]()
        for option in self.page_options:
            value = values.get(option.name)
            if option.kind == "switch":
                typed += [option.name] if value else []
            elif value not in (None, ""):
                typed += [f"{option.name}={value}"]
        return [[*first, *typed], *others]


@cache
def options_of(command: str) -> tuple[Option, ...]:
    """All options of a command, as its help explains them."""
    import typer

    from irbcal.cli.main import application

    name, *deeper = command.split()
    node: Any = typer.main.get_command(application((name,)))
    for word in (name, *deeper):
        node = node.commands[word]
    out = []
    for param in node.params:
        if param.param_type_name == "option":
            metavar = str(param.metavar or "")
            choices = tuple(metavar.strip("<>").split(" | ")) if " | " in metavar else ()
            kind = "switch" if param.is_flag else "choice" if choices else "text"
            out.append(Option(param.opts[0], kind, choices, str(param.help or ""), "" if choices else metavar))
    return tuple(out)


def first_of(*conditions: tuple[Callable[[Project], bool], str]) -> Callable[[Project], str]:
    """The sentence of the first condition that a project does not meet."""
    return lambda project: next((sentence for met, sentence in conditions if not met(project)), "")


def _robot(project: Project) -> bool:
    return bool(project.robot)


def _calibrated(project: Project) -> bool:
    return project.has(FOLDER)


def _dropped(folder: str) -> Callable[[Project], bool]:
    return lambda project: bool(project.files(folder))


def _import(project: Project, values: Values) -> list[list[str]]:
    return [["import", *project.files("data"), "--robot", project.robot, "--out", MEASURED, "--force", *sets(values)]]


def sets(values: Values) -> list[str]:
    """Changes of the map of columns that a user made."""
    return [word for key, value in values.get("set", {}).items() if value for word in ("--set", f"{key}={value}")]


def _calibrate(project: Project, values: Values) -> list[list[str]]:
    calibrate = ["calibrate", MEASURED, "--robot", project.robot, "--out", FOLDER, "--force"]
    return [calibrate, ["view", FOLDER, MEASURED, "--html", VIEW]]


def _cell(project: Project, values: Values) -> list[list[str]]:
    maker = values.get("maker")
    declared = ["--as", maker, "--declare", "declared.txt"] if maker else []
    tools = [
        word for line in str(values.get("declared", "")).splitlines() if line.strip() for word in line.split(None, 1)
    ]
    touches = project.files("touches")[:1]
    return [["cell", FOLDER, *touches, "--out", CELL, "--force", "--report", "cell.html", *declared, *tools]]


def corrected(project: Project) -> str:
    """Where a correction goes: a file of the program's name, or a folder for several."""
    programs = project.files("programs")
    return f"{CORRECTED}/{PurePosixPath(programs[0]).name}" if len(programs) == 1 else f"{CORRECTED}/programs"


def _filter(project: Project, values: Values) -> list[list[str]]:
    cell = ["--cell", CELL] if values.get("cell") and project.has(CELL) else []
    files = ["--changes", "changes.csv", "--page", "program.html"]
    return [["filter", FOLDER, *project.files("programs"), "--out", corrected(project), "--force", *files, *cell]]


def _certificate(project: Project, values: Values) -> list[list[str]]:
    fields = [word for key in FIELDS if values.get(key) for word in ("--info", f"{key}={values[key]}")]
    return [["evaluate", FOLDER, project.files("verification")[0], "--report", CERTIFICATE, *fields]]


def identity(project: Project) -> str:
    """The robot's id in the store."""
    return str(project.choices().get("history", {}).get("--id") or FOLDER)


def _kept_twice(project: Project) -> bool:
    return _times(project.folder / STORE, (project.folder / STORE).stat().st_mtime_ns, identity(project)) > 1


@lru_cache(maxsize=1)
def _times(store: Path, changed: int, robot: str) -> int:
    """How many calibrations a robot has in a store of this state; two where that cannot be read, as the step says."""
    from irbcal.fleet.store import opened

    try:
        with opened(store) as database:
            return database.counts(robot=robot).get(robot, (0, 0))[0]
    except IrbcalError:
        return 2


@dataclass(frozen=True)
class Page:
    """A page of the app."""

    name: str
    """Of its address."""
    title: str
    icon: str
    """Of the Material set."""
    text: str
    """What to do, then why."""
    upload: str = ""
    """Folder into which files are dropped; empty for none."""
    drop: str = ""
    """What is dropped."""
    steps: Sequence[Step] = ()


PAGES = (
    Page(
        "robot",
        "Robot",
        "precision_manufacturing",
        "Choose the arm from the list, or drop its URDF or xacro file. Then compare a pose with the pendant: a wrong "
        "arm or a wrong sign shows here, before anything is measured.",
        "robot",
        "URDF or xacro file, meshes",
        (
            Step(
                "robot",
                "Show the robot",
                "view",
                lambda project, values: [["view", project.robot, "--html", "robot.html"]],
                first_of((_robot, ROBOT)),
                ("--base-link", "--tip-link"),
                ("robot.html",),
            ),
        ),
    ),
    Page(
        "plan",
        "Plan",
        "route",
        "Compute poses that the robot reaches and the tracker sees, and what they promise. The program for the "
        "controller is among the files.",
        steps=(
            Step(
                "plan",
                "Plan the measurement",
                "plan",
                lambda project, values: [["plan", "--robot", project.robot, "--out", PLAN]],
                first_of((_robot, ROBOT)),
                (
                    "--optimal",
                    "--criterion",
                    "--targets",
                    "--tracker",
                    "--payload",
                    "--language",
                    "--device",
                    "--poses",
                ),
                (f"{PLAN}/plan.html",),
                (PLAN,),
            ),
        ),
    ),
    Page(
        "data",
        "Data",
        "table_view",
        "Drop the files of the tracker and of the controller. Columns and units are recognised by their names and by a "
        "trial fit of the robot; correct what is not right, then write the measurement file.",
        "data",
        "Tables of points and joints: text, workbook, zip archive",
        (
            Step(
                "data",
                "Write the measurement file",
                "import",
                _import,
                first_of((_robot, ROBOT), (_dropped("data"), "Drop measurements first.")),
                files=(MEASURED,),
            ),
        ),
    ),
    Page(
        "result",
        "Result",
        "verified",
        "Calibrate on some of the poses and prove it on the others. The corrected URDF and the joint map are among "
        "the files.",
        steps=(
            Step(
                "result",
                "Calibrate",
                "calibrate",
                _calibrate,
                first_of((_robot, ROBOT), (lambda project: project.has(MEASURED), DATA)),
                ("--model", "--holdout", "--split", "--payload-centre", "--same-tool", "--session-by"),
                (f"{FOLDER}/report.html", VIEW),
                (FOLDER,),
            ),
        ),
    ),
    Page(
        "cell",
        "Cell",
        "center_focus_strong",
        "Drop a table of touches: true tools and work objects follow from them by the calibrated robot. Those that "
        "were taught with the robot itself have its errors in them.",
        "touches",
        "Touches (CSV), or a backup of the controller",
        (
            Step(
                "cell",
                "Compute tools and work objects",
                "cell",
                _cell,
                first_of((_calibrated, CALIBRATION), (_dropped("touches"), "Drop touches first.")),
                ("--payload", "--payload-centre"),
                ("cell.html",),
                (CELL, "declared.txt"),
            ),
        ),
    ),
    Page(
        "programs",
        "Programs",
        "description",
        "Drop programs or a backup: the targets are replaced so that the controller reaches the true poses. "
        "Targets that cannot be corrected stay as they are, with the reason.",
        "programs",
        "Programs of one language, or a backup (zip archive)",
        (
            Step(
                "programs",
                "Correct the programs",
                "filter",
                _filter,
                first_of((_calibrated, CALIBRATION), (_dropped("programs"), "Drop programs first.")),
                (
                    "--controller-frames",
                    "--points",
                    "--payload",
                    "--start",
                    "--tool",
                    "--wobj",
                    "--path-tolerance",
                    "--split-points",
                    "--allow-partial",
                ),
                ("program.html",),
                (CORRECTED, "changes.csv"),
            ),
        ),
    ),
    Page(
        "certificate",
        "Certificate",
        "workspace_premium",
        "Drop poses that the calibration has not used, and name the tolerance. The certificate passes only what the "
        "measurement proves.",
        "verification",
        "Measurement file of other poses",
        (
            Step(
                "certificate",
                "Judge the robot",
                "evaluate",
                _certificate,
                first_of((_calibrated, CALIBRATION), (_dropped("verification"), "Drop other measurements first.")),
                (
                    "--tolerance",
                    "--rule",
                    "--region-only",
                    "--language",
                    "--tracker-u95-mm",
                    "--refit-base",
                    "--refit-tool",
                ),
                (CERTIFICATE,),
                (CERTIFICATE,),
            ),
        ),
    ),
    Page(
        "history",
        "History",
        "timeline",
        "Keep this calibration in the store of the robots, and see what changed since the last.",
        steps=(
            Step(
                "history",
                "Keep this calibration",
                "fleet add",
                lambda project, values: [
                    ["fleet", "add", FOLDER, "--store", STORE],
                    ["fleet", "list", "--store", STORE, "--report", "fleet.html"],
                ],
                first_of((_calibrated, CALIBRATION)),
                ("--id", "--serial", "--date"),
                ("fleet.html",),
            ),
            Step(
                "drift",
                "What changed",
                "fleet drift",
                lambda project, values: [["fleet", "drift", identity(project), "--store", STORE]],
                first_of(
                    (lambda project: project.has(STORE), "Keep a calibration first."),
                    (_kept_twice, "Keep a second calibration of this robot: then this step says what changed."),
                ),
            ),
        ),
    ),
)
"""The pages in the order of the work."""
STEPS = {step.name: step for page in PAGES for step in page.steps}
