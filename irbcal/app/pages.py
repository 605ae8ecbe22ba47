"""The pages of the app: each shows its steps, their command lines, what they print and the files they gave."""

from __future__ import annotations

import asyncio
import io
import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from html import escape
from pathlib import PurePosixPath
from typing import Any

from fastapi import FastAPI
from fastapi.responses import FileResponse, PlainTextResponse, Response
from nicegui import ui
from nicegui.events import UploadEventArguments

from irbcal.app import columns, steps
from irbcal.app.jobs import Jobs, as_typed
from irbcal.app.project import Project
from irbcal.app.steps import PAGES, Option, Page, Step
from irbcal.correction.known_languages import MAKERS
from irbcal.errors import IrbcalError
from irbcal.io.robots import NamedRobot
from irbcal.page_style import DARK, LIGHT, rule
from irbcal.plotting.charts import Chart
from irbcal.validation.provenance import FIELDS

STYLE = """
body { font-family: system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
.page { max-width: 70rem; margin: 0 auto; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .85rem; margin: 0; }
iframe { width: 100%; height: 75vh; border: 1px solid var(--line); border-radius: .3rem; background: #fff; }
h1 { font-size: 1.6rem; line-height: 1.3; margin: 0; } h2 { font-size: 1.15rem; line-height: 1.4; margin: .5rem 0 0; }
nav a { display: flex; gap: .7rem; align-items: center; padding: .6rem 1rem; color: inherit; text-decoration: none; }
.nicegui-link { color: var(--action); }
.text-primary { --q-primary: var(--action); }
nav a[aria-current] { background: var(--fill); font-weight: 600; }
:is([role="status"], [role="alert"], .drawn):empty { display: none; }
table.columns { border-collapse: collapse; }
table.columns :is(td, th) { padding: .15rem .7rem .15rem 0; text-align: left; font-weight: normal; }
nav a:focus-visible, button:focus-visible { outline: 3px solid var(--warn-line); }
@media (prefers-reduced-motion: reduce) {
    *, ::before, ::after { animation: none !important; transition: none !important; }
}
"""
"""A turning wheel takes a core's time from the step that it waits for: who wants none gets a word and the seconds."""
LARGEST_DROP = 500_000_000
"""Bytes of a dropped file."""
LOOK_EVERY_S = 0.5
"""Seconds between looks for what changed: the folder, and a job."""
Looks = list[Callable[[], object]]
"""What a page shows is brought up to date in place: an element that is drawn again under a click loses it."""
ROBOT_FILES = (".urdf", ".xacro")
UNITS = {"units.joints": ["deg", "rad"], "units.lengths": ["mm", "m", "inch"]}


def build(application: FastAPI, project: Project) -> None:
    """Make the pages of a project, and the routes of its files.

    Parameters
    ----------
    application : FastAPI
        Which serves them.
    project : Project
    """
    jobs = Jobs(project.folder)

    @application.get("/files/{path:path}")
    def file(path: str, download: bool = False) -> Response:
        """A file of the project, to be shown in a frame or to be kept."""
        target = project.inside(path)
        if target is None:
            return PlainTextResponse("There is no such file in this project.", 404)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        # what a file of the project does when it is opened, it does without this site's cookie
        headers["Content-Security-Policy"] = "sandbox allow-scripts allow-downloads allow-modals"
        return FileResponse(target, filename=target.name if download else None, headers=headers)

    @application.get("/folder/{path:path}")
    def folder(path: str) -> Response:
        """A folder of the project as a zip archive."""
        target = (project.folder / path).resolve()
        if not target.is_dir() or not target.is_relative_to(project.folder.resolve()):
            return PlainTextResponse("There is no such folder in this project.", 404)
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for inner in sorted(target.rglob("*")):
                if inner.is_file():
                    archive.write(inner, inner.relative_to(target.parent))
        name = f'attachment; filename="{PurePosixPath(path).name}.zip"'
        return Response(content.getvalue(), media_type="application/zip", headers={"Content-Disposition": name})

    @application.get("/picture/{robot:path}")
    def picture(robot: str) -> Response:
        """A robot of the catalogue, or a dropped one, from the side: the second half of its drawing."""
        chart = _drawing(project, robot)
        if chart is None:
            return PlainTextResponse("There is no such robot.", 404)
        content = replace(chart, caption="", drawings=chart.drawings[1:]).content("svg")
        headers = {"Cache-Control": "private, max-age=600", "Content-Security-Policy": "sandbox"}
        return Response(content, media_type="image/svg+xml", headers=headers)

    for page in PAGES:
        ui.page(f"/{page.name}", title=f"{page.title} – irbcal")(partial(_show, page, project, jobs))
    ui.page("/", title="irbcal")(partial(_show, PAGES[0], project, jobs))


def _show(page: Page, project: Project, jobs: Jobs) -> None:
    """A page of the app."""
    ui.add_css(rule("body", "light", LIGHT) + rule("body.body--dark", "dark", DARK) + STYLE)
    ui.colors(primary=LIGHT["action"])
    ui.context.client.page.language = "en-US"
    with ui.header().classes("items-center"):
        menu = ui.button(icon="menu").props('flat color=white aria-label="Pages"')
        ui.label(f"irbcal · {project.folder.name}").classes("text-lg")
    drawer = ui.left_drawer(value=False, bordered=True).props("show-if-above width=210 breakpoint=800")
    menu.on("click", js_handler=f"() => getElement({drawer.id}).toggle()")
    with drawer, ui.element("nav").props('aria-label="Pages"'):
        for each_page in PAGES:
            with ui.link(target=f"/{each_page.name}").props('aria-current="page"' if each_page is page else ""):
                ui.icon(each_page.icon).props('aria-hidden="true"')
                ui.label(each_page.title)
    with ui.column().classes("page w-full gap-4"):
        ui.html(f"<h1>{page.title}</h1>", sanitize=False)
        ui.label(page.text).classes("text-base max-w-3xl")
        watchers: Looks = []
        if page.name == "robot":
            _choose_robot(project, watchers)
        if page.upload:
            _drop(page, project, watchers)
        if page.name == "data":
            _ColumnsPanel(project)
        for step in page.steps:
            _step(step, project, jobs, watchers)
    ui.timer(LOOK_EVERY_S, partial(_look, watchers))


def _look(watchers: Looks) -> None:
    for look in watchers:
        look()


def _drawn(of: Callable[[], Any], draw: Callable[[Any], object], watchers: Looks) -> None:
    """Draw what something holds now, and again only when it holds something else."""
    place = ui.column().classes("drawn w-full gap-1")
    last: Any = None

    def look() -> None:
        nonlocal last
        content = of()
        if content != last:
            last = content
            place.clear()
            with place:
                draw(content)

    watchers.append(look)
    look()


def _say(error: IrbcalError) -> None:
    ui.notify(str(error), type="negative", timeout=10_000, close_button="Close", multi_line=True)


def _drop(page: Page, project: Project, watchers: Looks) -> None:
    """Where files are dropped, and those that were."""

    async def take(event: UploadEventArguments) -> None:
        try:
            content = await event.file.read()
            path = await asyncio.to_thread(project.add, page.upload, event.file.name, content)
            if page.name == "robot" and path.endswith(ROBOT_FILES):
                project.choose("robot", robot=path)
        except (IrbcalError, OSError) as error:
            _say(error if isinstance(error, IrbcalError) else IrbcalError(str(error.strerror), file=event.file.name))
        _look(watchers)

    def remove(path: str) -> None:
        project.remove(path)
        _look(watchers)

    upload = ui.upload(
        multiple=True,
        auto_upload=True,
        max_file_size=LARGEST_DROP,
        on_upload=take,
        on_rejected=lambda: ui.notify(
            "A file of more than 500 MB is not taken: use the command line.", type="negative"
        ),
    ).classes("hidden")
    uploader = f"getElement({upload.id}).$refs.qRef"
    zone = ui.row().classes("w-full max-w-3xl items-center border-2 border-dashed rounded p-4")
    zone.on("dragover", js_handler="(event) => event.preventDefault()")
    take_drop = f"(event) => {{ event.preventDefault(); {uploader}.addFiles(event.dataTransfer.files); }}"
    zone.on("drop", js_handler=take_drop)
    with zone:
        ui.button("Choose files", icon="upload_file").on("click", js_handler=f"() => {uploader}.pickFiles()").props(
            "outline"
        )
        ui.label(f"or drop them here: {page.drop}")

    def dropped(paths: list[str]) -> None:
        for path in paths:
            with ui.row().classes("items-center gap-2"):
                ui.link(PurePosixPath(path).name, f"/files/{path}?download=1")
                label = f"Remove {PurePosixPath(path).name}"
                ui.button(icon="delete", on_click=partial(remove, path)).props(f'flat dense round aria-label="{label}"')

    _drawn(partial(project.files, page.upload), dropped, watchers)


ROBOT_IN_LIST = """
<q-item v-bind="props.itemProps">
  <q-item-section avatar><img :src="'/picture/' + props.opt.label.replace(' (dropped)', '')" alt="" loading="lazy"
    width="110" height="110"></q-item-section>
  <q-item-section><q-item-label>{{ props.opt.label }}</q-item-label>
  <q-item-label caption>{{ (CAPTIONS)[props.opt.label] }}</q-item-label></q-item-section>
</q-item>
"""
"""A robot in the list, in the framework's words: its picture is fetched when it is scrolled to."""


def _choose_robot(project: Project, watchers: Looks) -> None:
    """The robot: of the catalogue, or a dropped file."""
    from irbcal.io.catalogue import MAKERS, arms

    catalogue = _catalogue()
    titles = [maker.title for maker in MAKERS.values()]
    makers = {
        name: next((title for title in titles if robot.description.startswith(title)), robot.description.split()[0])
        for name, robot in catalogue.items()
    }
    reaches = {name: reach for name, arm in arms().items() if (reach := arm.reach) is not None}
    captions = {
        name: robot.description + (f", its wrist reaches {reaches[name]:.2f} m" if name in reaches else "")
        for name, robot in catalogue.items()
    }

    def choose(event: Any) -> None:
        if (event.value or "") != project.robot:
            project.choose("robot", robot=event.value or "")
            _look(watchers)

    def listed(name: str) -> bool:
        far = not smallest.value or reaches.get(name, 0.0) >= smallest.value / 1e3
        return name == project.robot or (far and maker.value in (None, makers[name]))

    with ui.row().classes("w-full items-start gap-4"):
        choice = ui.select({}, label="Robot", with_input=True, clearable=True, on_change=choose)
        choice.classes("w-96 max-w-full").add_slot(
            "option", ROBOT_IN_LIST.replace("CAPTIONS", escape(json.dumps(captions)))
        )
        maker = ui.select(sorted(set(makers.values())), label="Only of this maker", clearable=True).classes("w-52")
        smallest = ui.number("Reach from, mm", min=0, step=100).classes("w-52")

    def look() -> None:
        dropped = [path for path in project.files("robot") if path.endswith(ROBOT_FILES)]
        names = {path: f"{PurePosixPath(path).name} (dropped)" for path in dropped}
        names |= {name: name for name in catalogue if listed(name)}
        value = project.robot if project.robot in names else None
        if names != choice.options or value != choice.value:
            choice.set_options(names, value=value)
        if project.robot != last_robot[0]:
            last_robot[0] = project.robot
            picture.set_content(_picture(project))

    for element in (maker, smallest):
        element.on_value_change(look)
    last_robot = [""]
    picture = ui.html("", sanitize=False).classes("w-full max-w-3xl")
    watchers.append(look)
    look()
    _pendant(project)


@cache
def _catalogue() -> dict[str, NamedRobot]:
    """Robots by their names."""
    import irbcal

    return {robot.name: robot for robot in irbcal.robots()}


def _drawing(project: Project, robot: str) -> Chart | None:
    """A robot at home; None where there is none, or its file cannot be read, which the step says."""
    from irbcal.io.opening import open_robot
    from irbcal.plotting.pose_errors import arm_at_home

    dropped = project.inside(robot) or project.inside(f"robot/{robot}")
    if dropped is None and robot not in _catalogue():
        return None
    try:
        return arm_at_home(open_robot(dropped or robot, nominal=True).nominal)
    except IrbcalError:
        return None


def _picture(project: Project) -> str:
    """The chosen arm at home as SVG."""
    chart = _drawing(project, project.robot)
    if chart is None:
        return ""
    svg = chart.content("svg").decode("utf-8").partition("?>")[2]
    fitting = svg.replace("<svg ", '<svg style="max-width: 100%; height: auto" ', 1)
    return f'<div role="img" aria-label="{escape(chart.caption)}">{fitting}</div>'


def _pendant(project: Project) -> None:
    """Compare a pose with what the pendant shows."""
    with ui.expansion("Compare a pose with the pendant", icon="rule").classes("w-full max-w-3xl"):
        joints = ui.input("Joints as the pendant shows them, degrees", placeholder="0, -14, 14, 0, 0, 0").classes(
            "w-96 max-w-full"
        )
        place = ui.input("Tool 0 in the base as the pendant shows it, mm", placeholder="x, y, z").classes(
            "w-96 max-w-full"
        )
        answer = ui.label().props('role="status"')

        def compare() -> None:
            try:
                answer.text = _difference(project, joints.value, place.value)
            except IrbcalError as error:
                answer.text = str(error)

        ui.button("Compare", on_click=compare).props("outline")


def _difference(project: Project, joints: str, place: str) -> str:
    """How far the nominal robot is from what a pendant shows, as a sentence."""
    import numpy as np

    from irbcal.io.opening import open_robot

    robot = project.robot

    def numbers(text: str, what: str) -> Any:
        try:
            return np.array([float(word) for word in text.replace(";", ",").split(",")])
        except ValueError:
            raise IrbcalError(f"{what}: expected numbers with commas between them, found {text!r}") from None

    if not robot:
        return steps.ROBOT
    arm = open_robot(project.folder / robot if project.has(robot) else robot, nominal=True).nominal
    q = numbers(joints, "joints")
    if len(q) != len(arm.joint_units):
        raise IrbcalError(f"joints: {robot} has {len(arm.joint_units)}, found {len(q)}")
    tip = 0.0 + np.round(1e3 * arm.forward(arm.from_controller(q * arm.joint_units)[None])[0, :3, 3], 2)
    text = f"The nominal robot is at {tip[0]:.2f}, {tip[1]:.2f}, {tip[2]:.2f} mm"
    if not place.strip():
        return text
    shown_place = numbers(place, "place")
    if len(shown_place) != 3:
        raise IrbcalError(f"place: expected x, y and z, found {len(shown_place)} numbers")
    distance = np.linalg.norm(tip - shown_place)
    verdict = (
        "the same arm" if distance < 0.1 else "another arm, other signs or another tool: mend it before you measure"
    )
    return f"{text}, {distance:.2f} mm from the pendant: {verdict}."


class _ColumnsPanel:
    """What the columns mean, as it is understood, and how that is corrected: a choice for each."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.now = columns.Understanding("", "", (), (), 6, {}, [])
        self.last_question: Any = None
        """Files, robot and choices that ``now`` is of."""
        self.watchers: Looks = []
        self.meanings: list[list[Any]] = []
        """Of each table and column the field that says what it means."""
        with ui.row().classes("items-center gap-3"):
            self.sentence = ui.label().classes("font-bold").props('role="status"')
            self.waiting = ui.spinner()
            self.waiting.set_visibility(False)
        self.complaint = ui.label().classes("text-negative").props('role="alert"')
        _drawn(lambda: self.now.notes, lambda notes: [ui.label(f"{note}.") for note in notes], self.watchers)
        with ui.row().classes("items-end"):
            self.units = {key: self._unit(key, names) for key, names in UNITS.items()}
            self.forget = ui.button("Forget my corrections", on_click=lambda: project.choose("data", set={}, words={}))
            self.forget.props("flat")
        _drawn(lambda: [(t.source, t.keys, t.samples) for t in self.now.tables], self._draw_tables, self.watchers)
        _drawn(lambda: self.now.rows, _first_rows, self.watchers)
        self.watchers.append(self._update)
        self._update()
        ui.timer(LOOK_EVERY_S, self._look)

    def _unit(self, key: str, names: Sequence[str]) -> Any:
        field = ui.select(["", *names], label=f"Unit of {key[6:]}", on_change=partial(self._change_unit, key))
        return field.classes("w-40")

    def _question(self) -> Any:
        files = [(name, (self.project.folder / name).stat().st_mtime_ns) for name in self.project.files("data")]
        return files, self.project.robot, self.project.choices().get("data")

    def _choices(self) -> dict[str, str]:
        """What the user has chosen so far."""
        return dict(self.project.choices().get("data", {}).get("set", {}))

    async def _look(self) -> None:
        """Understand the files, where they or the choices changed."""
        if self._question() == self.last_question or not (self.project.files("data") or self.now.tables):
            return
        asked = self.last_question = self._question()
        self.waiting.set_visibility(True)
        reading = asyncio.ensure_future(columns.reading(self.project))
        while not reading.done() and self._question() == asked:
            await asyncio.wait([reading], timeout=LOOK_EVERY_S)
        self.waiting.set_visibility(False)
        # else it changed meanwhile, and the next look asks for it
        if not reading.cancel() and self._question() == asked:
            self.now = reading.result()
            _look(self.watchers)

    def _change(self, table: int, k: int, event: Any) -> None:
        choices_of_tables = [list(of_table.meanings) for of_table in self.now.tables]
        if event.value is None or event.value == choices_of_tables[table][k]:
            return  # set by the page itself
        choices_of_tables[table] = columns.chosen(choices_of_tables[table], k, event.value, self.now.joints)
        pairs = [(of_table.keys, new) for of_table, new in zip(self.now.tables, choices_of_tables, strict=True)]
        declared, _ = columns.changes(pairs, self.now.joints)
        units = {key: value for key, value in self._choices().items() if not key.startswith("columns.")}
        named = {of_table.source: new for of_table, new in zip(self.now.tables, choices_of_tables, strict=True)}
        self.project.choose("data", set=units | declared, words=named)
        tables = tuple(replace(of_table, meanings=tuple(named[of_table.source])) for of_table in self.now.tables)
        self.now = replace(self.now, tables=tables)
        _look(self.watchers)

    def _change_unit(self, key: str, event: Any) -> None:
        choices = self._choices()
        if event.value != self.now.units.get(key, choices.get(key, "")):
            self.project.choose("data", set=choices | {key: event.value})

    def _draw_tables(self, structure: list[tuple[str, tuple[str | int, ...], tuple[str, ...]]]) -> None:
        self.meanings.clear()
        for number, (source, keys, samples) in enumerate(structure):
            ui.label(source).classes("font-bold")
            with ui.element("table").classes("columns"):
                with ui.element("tr"):
                    for title in ("column", "means", "first values"):
                        with ui.element("th").props('scope="col"'):
                            ui.label(title)
                self.meanings.append([])
                for k, (key, cells) in enumerate(zip(keys, samples, strict=True)):
                    with ui.element("tr"):
                        with ui.element("th").props('scope="row"'):
                            ui.label(str(key))
                        with ui.element("td"):
                            field = ui.select([], on_change=partial(self._change, number, k)).classes("w-44")
                            field.props["aria-label"] = f"What column {key} of {source} means"
                            self.meanings[-1].append(field.props("dense options-dense outlined"))
                        with ui.element("td"):
                            ui.label(cells)

    def _update(self) -> None:
        now, choices = self.now, self._choices()
        missing = columns.changes([(of_table.keys, of_table.meanings) for of_table in now.tables], now.joints)[1]
        self.sentence.text = now.sentence
        self.complaint.text = now.complaint and (missing or now.complaint)
        offered = columns.choices([word for of_table in now.tables for word in of_table.meanings], now.joints)
        for of_table, of_fields in zip(now.tables, self.meanings, strict=True):
            for field, word in zip(of_fields, of_table.meanings, strict=True):
                if field.options != offered or field.value != word:
                    field.set_options(offered, value=word)
        for key, field in self.units.items():
            field.set_visibility(bool(now.tables))
            field.value = now.units.get(key, choices.get(key, ""))
        self.forget.set_visibility(bool(choices or self.project.choices().get("data", {}).get("words")))


def _first_rows(first: list[dict[str, Any]]) -> None:
    if first:
        header = [{"name": key, "label": key, "field": key, "align": "right"} for key in first[0]]
        table = ui.table(rows=first, columns=header, title="The first rows as they are understood")
        table.classes("w-full").props("dense flat")


def _field(option: Option, step: Step, project: Project, explained: Any) -> None:
    """A field of an option, which keeps what is typed; its explanation below it, where a switch shows them."""
    value = project.choices().get(step.name, {}).get(option.name)
    keep = partial(_keep, project, step.name, option.name)
    element: Any
    with ui.column().classes("w-72 gap-0"):
        if option.kind == "switch":
            element = ui.switch(option.label, value=bool(value), on_change=keep)
        elif option.kind == "choice":
            choices = {"": "default"} | {name: name for name in option.choices}
            element = ui.select(choices, label=option.label, value=value if value in choices else "", on_change=keep)
        else:
            element = ui.input(option.label, value=str(value or ""), placeholder=option.hint, on_change=keep)
        explanation = ui.label(option.explanation).classes("text-sm opacity-80")
        explanation.bind_visibility_from(explained, "value")
        element.classes("w-full").props(f'aria-describedby="{explanation.html_id}"')


def _keep(project: Project, step: str, name: str, event: Any) -> None:
    project.choose(step, **{name: event.value})


def _fields(step: Step, project: Project) -> None:
    """The fields of a step: options of its command line, and what the page itself asks for."""
    values = project.choices().get(step.name, {})

    def text(name: str, label: str, area: bool = False) -> None:
        keep = partial(_keep, project, step.name, name)
        element: Any = (ui.textarea if area else ui.input)(label, value=str(values.get(name, "")), on_change=keep)
        element.classes("w-96 max-w-full" if area else "w-72")

    explained = ui.switch("Explain the fields").props("dense") if step.page_options else None
    with ui.row().classes("items-start gap-4"):
        if step.name == "cell":
            keep = partial(_keep, project, "cell", "maker")
            makers = {"": "none"} | {name: name for name in sorted(MAKERS)}
            ui.select(
                makers, label="Numbers for the controller of", value=values.get("maker", ""), on_change=keep
            ).classes("w-72")
            text("declared", "What the controller has, a line each: --tool grip=… or --wobj 1=…", area=True)
        if step.name == "programs":
            keep = partial(_keep, project, "programs", "cell")
            ui.switch(
                "use the true tools and work objects of the page Cell", value=bool(values.get("cell")), on_change=keep
            )
        for option in step.page_options:
            _field(option, step, project, explained)
        if step.name == "certificate":
            for name, label in FIELDS.items():
                text(name, label)


def _step(step: Step, project: Project, jobs: Jobs, watchers: Looks) -> None:
    """A step: its fields, its command lines, what they print, and the files that they gave."""

    async def run() -> None:
        need = step.needs(project)
        if need:
            ui.notify(need, type="warning")
            return
        if await jobs.run(step.name, step.commands(project)) is None:
            ui.notify("Another step is running: wait for it, or stop it.", type="warning")

    async def end() -> None:
        if job := jobs.last.get(step.name):
            await job.stop()

    with ui.card().classes("w-full").props("flat bordered"):
        ui.html(f"<h2>{step.title}</h2>", sanitize=False)
        _fields(step, project)
        with ui.row().classes("items-center gap-3"):
            start = ui.button(step.title, icon="play_arrow", on_click=run)
            stop = ui.button("Stop", icon="stop", color="negative", on_click=end)
            spinner = ui.spinner()
            news = ui.label().props('role="status"')
        same = ui.expansion("The command line that does the same", icon="terminal").classes("w-full")
        with same:
            code = ui.code(language="bash").classes("w-full")
        ended = ui.label().props('role="status"').classes("font-bold")
        with ui.element("pre").props('tabindex="0" aria-label="Output"').classes("w-full p-3 border rounded") as frame:
            output = ui.label().style("white-space: pre-wrap")

        def look() -> None:
            job, need = jobs.last.get(step.name), step.needs(project)
            running = job is not None and job.running
            start.set_enabled(not running and not need)
            stop.set_visibility(running)
            spinner.set_visibility(running)
            news.text = f"{job.at or 'starting'}, {job.seconds:.0f} s" if job is not None and running else need
            same.set_visibility(not need)
            code.content = "" if need else "\n".join(as_typed(words) for words in step.commands(project))
            frame.set_visibility(job is not None)
            ended.text = ""
            if job is not None:
                output.text = job.output
            if job is not None and not running:
                how = "stopped; the files of before are kept" if job.stopped else "done" if job.good else "refused"
                ended.text = f"{how} after {job.seconds:.1f} s"
                good = job.good and not job.stopped
                ended.classes("text-positive" if good else "text-negative", remove="text-positive text-negative")

        def files() -> list[tuple[str, int]]:
            job = jobs.last.get(step.name)
            names = dict.fromkeys((*step.pages, *step.files)) if job is None or not job.running else ()
            return [(name, (project.folder / name).stat().st_mtime_ns) for name in names if project.has(name)]

        watchers.append(look)
        look()
        _drawn(files, partial(_files, step, project), watchers)


def _files(step: Step, project: Project, files: list[tuple[str, int]]) -> None:
    """Downloads, and pages in frames."""
    with ui.row().classes("drawn gap-4"):
        for name, _ in files:
            folder = (project.folder / name).is_dir()
            ui.link(f"{name}.zip" if folder else name, f"/folder/{name}" if folder else f"/files/{name}?download=1")
    for name, changed in files:
        if name in step.pages:
            text = f"Open {name} in a tab of its own, to print it or to keep it as PDF"
            ui.link(text, f"/files/{name}", new_tab=True)
            ui.element("iframe").props(f'src="/files/{name}?{changed}" title="{name}"')
