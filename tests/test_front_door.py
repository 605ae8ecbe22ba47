"""The front door: public names, quick import, options as on the command line, results that speak and stay as they are."""

import ast
import dataclasses
import html
import inspect
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.main import get_command

import irbcal
from irbcal.cli.main import app
from irbcal.errors import IrbcalError, OptionError
from irbcal.io import robots
from irbcal.public_calls import refusing_wrong_calls

STUB = Path(irbcal.__file__).with_suffix(".pyi")

VERBS = {
    "cell": "cell_frames",
    "hand-eye": "hand_eye",
    "import": "import_measurements",
    "fk": "forward_kinematics",
    "ik": "inverse_kinematics",
    "filter": "correct",
    "urdf": "urdf_from_dh",
    "app": None,  # calls the commands
    "demo": None,  # calibrate with the shipped data
    "fleet": None,  # has commands of its own
}
"""Commands whose function has another name."""

ELSEWHERE = {
    "evaluate": dict.fromkeys(("report", "figures", "format", "data", "language"), "certificate"),
    "calibrate": {"world_link": "save", "target_links": "save", "mesh_paths": "save"},
    "cell": dict.fromkeys(("touch", "interactive")),
    "simulate": {"device": "simulate_device", "noise": "simulate_device"},
    "plan": {
        "device": "device_plan",
        "poses": "device_plan",
        "compare_devices": None,
        "prior": "compare_devices",
        "approach": "device_plan",
    },
    "ballbar": {"magnify": None},
    "filter": {"page": None},
    "iso9283": dict.fromkeys(("plane", "near", "center", "inset", "edge"), "iso9283_plan") | {"plan": None},
}
"""Options that are the first arguments of the function, drawn later (None), or belong to another function."""

OF_THE_SHELL = {
    "json",
    "out",
    "help",
    "open_browser",
    "port",
    "html",
    "plot",
    "plots",
    "csv",
    "latex",
    "show_preset",
    "dry_run",
    "list",
    "fail_if_worse",
    "help_all",
    "force",
    "verbose",
}
"""Options that say where the output goes: a function returns it."""


def test_every_name_of_the_stub_is_there_and_has_types():
    names = {
        alias.asname
        for node in ast.parse(STUB.read_text()).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert names == set(irbcal.__all__)
    assert names <= set(dir(irbcal))
    for name in names:
        found = getattr(irbcal, name)
        if inspect.isfunction(found):
            hints = inspect.signature(found)
            assert hints.return_annotation is not inspect.Signature.empty, name
            assert all(p.annotation is not inspect.Parameter.empty for p in hints.parameters.values()), name
            assert found.__doc__, name


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="no_such_thing"):
        irbcal.no_such_thing  # noqa: B018


@pytest.mark.parametrize(
    "what",
    [
        "import irbcal",
        "import irbcal, sys; sys.argv = ['irbcal', '--version']; from irbcal.cli.main import main; main()",
    ],
)
def test_import_and_version_load_nothing_heavy(what):
    code = f"import sys, atexit; atexit.register(lambda: print(sorted({{'numpy', 'scipy', 'pandas', 'pinocchio', 'rich', 'pydantic'}} & set(sys.modules)))); {what}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_calibration_loads_neither_scipy_nor_meshes():
    code = "import sys, irbcal.calibration; print(sorted({'scipy', 'trimesh', 'pinocchio', 'yourdfpy', 'matplotlib'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def commands():
    every = get_command(app).commands
    fleet = [(f"fleet_{name}", command) for name, command in every["fleet"].commands.items()]
    return sorted([*every.items(), *fleet])


@pytest.mark.parametrize(("name", "command"), commands(), ids=[name for name, _ in commands()])
def test_every_command_is_a_function_with_its_options(name, command):
    verb = VERBS.get(name, name)
    if verb is None:
        return
    function = getattr(irbcal, verb)
    known = inspect.signature(function).parameters
    options = {p.name.rstrip("_") for p in command.params} - OF_THE_SHELL
    moved = ELSEWHERE.get(name, {})
    missing = {option for option in options - set(moved) if option not in {p.rstrip("_") for p in known}}
    for option, other in moved.items():
        assert option in options
        assert option not in known
        assert other is None or option in inspect.signature(getattr(irbcal, other)).parameters
    assert missing == set(), f"irbcal.{verb} has no {missing}; it has {sorted(known)}"
    positional = [p for p in known.values() if p.kind is not p.KEYWORD_ONLY]
    assert len(positional) <= 3


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("split", "lst"),
        ("model", "35"),
        ("method", "guess"),
        ("objective", "mean"),
        ("loss", "cubic"),
        ("holdout", 1.5),
    ],
)
def test_options_are_checked_as_on_the_command_line(option, value):
    with pytest.raises(OptionError, match=str(option)) as refused:
        irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", **{option: value})
    assert refused.value.parameter == option


def test_there_is_no_default_robot():
    with pytest.raises(OptionError, match="name the nominal robot, or an earlier calibration"):
        irbcal.calibrate(robots.demo_file("demo_identification.csv"))


def test_degrees_in_place_of_radians_are_refused():
    robot = irbcal.load_robot("irb120") if hasattr(irbcal, "load_robot") else None
    with pytest.raises(IrbcalError, match="degrees"):
        irbcal.forward_kinematics("irb120", np.array([[90.0, 0, 0, 45.0, 120.0, 90.0]]))
    assert robot is None


FUNCTIONS = [name for name in irbcal.__all__ if inspect.isfunction(getattr(irbcal, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_names_of_arguments_are_checked_at_the_front_door(name):
    function = getattr(irbcal, name)
    parameters = inspect.signature(function).parameters
    needed = [p.name for p in parameters.values() if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    assert pickle.loads(pickle.dumps(function)) is function
    with pytest.raises(OptionError, match="there is no argument") as refused:
        function(no_such_argument=1)
    assert refused.value.parameter == "no_such_argument"
    if needed:
        with pytest.raises(OptionError, match=f"{name}: {needed[0]} is missing") as refused:
            function()
        assert refused.value.parameter == needed[0]


WRONG_CALLS = [
    ("folder", lambda result, table: irbcal.load(None)),
    ("folder", lambda result, table: irbcal.load(result)),
    ("folder", lambda result, table: result.save(None)),
    ("calibration", lambda result, table: irbcal.save("folder", result)),
    ("evaluation", lambda result, table: irbcal.certificate(result, "page.html")),
    ("robot", lambda result, table: irbcal.calibrate("irb1600", table)),
    ("measurements", lambda result, table: irbcal.calibrate(table.to_numpy(), "irb1600")),
    ("sources", lambda result, table: irbcal.import_measurements(table)),
    ("sources", lambda result, table: irbcal.import_measurements("file.csv", ["another.csv"])),
    ("program", lambda result, table: irbcal.correct(result, table)),
    ("program", lambda result, table: irbcal.correct(result, None)),
    ("target", lambda result, table: irbcal.forward_kinematics(result, np.zeros(6), target=["smr1"])),
    ("robot", lambda result, table: irbcal.view(result.robot_calibrated())),
    ("at", lambda result, table: irbcal.stream(result, at="home")),
    ("maker", lambda result, table: irbcal.robots(3)),
    ("arm", lambda result, table: irbcal.identify_evidence(None, None)),
]


@pytest.mark.parametrize(("parameter", "call"), WRONG_CALLS)
def test_wrong_arguments_are_refused_by_name(results, parameter, call):
    with pytest.raises(IrbcalError, match=r"expected .+(, found .+| numbers)") as refused:
        call(results["loaded"], results["measurements"].table)
    assert refused.value.parameter == parameter


def test_a_wrong_type_inside_a_function_stays_a_fault_of_its_code():
    def broken(q: "str | None" = None) -> None:
        q + 1

    with pytest.raises(TypeError, match="unsupported operand"):
        refusing_wrong_calls(broken)()


# --- results ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """One public result of each kind, from the simulated demonstration."""
    folder = tmp_path_factory.mktemp("front")
    fit, proof = (robots.demo_file(f"demo_{name}.csv") for name in ("identification", "verification"))
    calibration = irbcal.calibrate(fit, "irb1600", "34")
    calibration.save(folder / "cal")
    loaded = irbcal.load(folder / "cal")
    measurements = irbcal.read_measurements(fit)
    return {
        "calibration": calibration,
        "loaded": loaded,
        "validated": calibration.validated,
        "fit": calibration.validated.fit,
        "points": calibration.validated.fit_points,
        "measurements": measurements,
        "evaluation": irbcal.evaluate(loaded, proof, intervals=True),
        "model": irbcal.CalibratedModel.load(folder / "cal"),
        "robot": loaded.robot_calibrated(),
        "robots": irbcal.robots(),
        "evidence": irbcal.identify_evidence(
            irbcal.read_urdf("irb1600").arm, calibration.validated.fit_points, gear_scan=False
        ),
        "plan": irbcal.plan("irb1600", axis=0, cube=6, all_range=6, ignore=("collision", "sight", "path")),
    }


NAMES = ["calibration", "loaded", "fit", "points", "measurements", "evaluation", "model", "robots", "plan", "evidence"]


@pytest.mark.parametrize("name", [*NAMES, "validated", "robot"])
def test_results_are_printed_short(results, name):
    assert 10 < len(repr(results[name])) < 2000


@pytest.mark.parametrize("name", NAMES)
def test_results_speak(results, name):
    result = results[name]
    text = result.summary()
    assert len(text) > 40
    assert max(map(len, text.splitlines())) < 400
    page = result._repr_html_()
    assert page.startswith("<div>")
    assert page.count("<table>") == page.count("</table>")


@pytest.mark.parametrize(
    "name", ["calibration", "loaded", "fit", "points", "measurements", "evaluation", "robots", "plan", "evidence"]
)
def test_results_become_tables(results, name):
    frame = results[name].to_frame()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame)


def test_the_parameter_table_has_deviations_and_units(results):
    line = next(row for row in results["calibration"].parameter_table().rows if row[0] == "delta_theta2")
    assert re.fullmatch(r"[+-]\d+\.\d+ \d+\.\d+ deg identified", " ".join(map(str, line[1:])))


def test_the_parameter_table_is_readable_in_terminals_and_notebooks(results):
    calibration = results["calibration"]
    table, names = calibration.parameter_table(), [parameter.name for parameter in calibration.record.parameters]
    assert [line.split()[0] for line in str(table).splitlines()[-len(names) :]] == names
    assert repr(table) == f"<Table: Parameters, {len(names)} rows of name, value, ±, unit, state>"
    assert re.findall(r"<tr><td[^>]*>([^<]*)<", table._repr_html_()) == [html.escape(name) for name in names]
    frame = table.to_frame()
    assert frame["name"].tolist() == names
    assert list(frame.columns) == ["name", "value", "±", "unit", "state"]


@pytest.mark.parametrize("name", [*NAMES, "validated", "robot"])
def test_results_are_pickled(results, name):
    again = pickle.loads(pickle.dumps(results[name]))
    assert repr(again) == repr(results[name])


def arrays_in(value, path, seen):
    """All arrays and dicts that can be reached through the fields of dataclasses."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, (np.ndarray, dict)):
        yield path, value
    if isinstance(value, dict):
        for key, item in value.items():
            yield from arrays_in(item, f"{path}[{key!r}]", seen)
    elif isinstance(value, (tuple, list)):
        if isinstance(value, list):
            yield path, value
        for k, item in enumerate(value[:5]):
            yield from arrays_in(item, f"{path}[{k}]", seen)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from arrays_in(getattr(value, field.name), f"{path}.{field.name}", seen)


@pytest.mark.parametrize(
    "name", ["fit", "points", "measurements", "evaluation", "model", "robot", "validated", "plan", "evidence"]
)
def test_nothing_in_a_result_can_be_written_to(results, name):
    open_to_writing = []
    for path, value in arrays_in(results[name], name, set()):
        if isinstance(value, np.ndarray):
            if value.flags.writeable:
                open_to_writing.append(path)
            continue
        try:
            value["new"] = 1
        except TypeError:
            continue
        open_to_writing.append(path)
    assert open_to_writing == []
    field = dataclasses.fields(results[name])[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(results[name], field, None)


def test_a_calibration_just_made_and_loaded_say_the_same(results):
    made, loaded = results["calibration"], results["loaded"]
    assert made.summary() == loaded.summary()
    assert made.record.heldout.all.mean_mm == loaded.record.heldout.all.mean_mm
    assert made.to_frame("points").equals(loaded.to_frame("points"))


def test_pictures_are_drawn_and_saved(results, tmp_path):
    held_out = results["calibration"].plot
    assert "fitted" in held_out.fitted.errors_by_pose().caption
    assert "fitted" not in held_out.errors_by_pose().caption
    for plots in (held_out, held_out.fitted, results["evaluation"].plot):
        for name in ("before_and_after", "errors_by_pose", "distribution", "workspace", "vectors"):
            picture = getattr(plots, name)()
            assert picture._repr_svg_().startswith("<?xml")
            assert "SIMULATED" in repr(picture)
        assert picture.save(tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
        with pytest.raises(OptionError, match="png"):
            picture.save(tmp_path / "p.gif")
