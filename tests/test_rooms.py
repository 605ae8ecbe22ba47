"""The house keeps its order: imports point one way, and light rooms stay light."""

import ast
import functools
import importlib
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "irbcal"

FLOORS = (
    ("errors", "units", "arrays", "kernel"),
    (
        "literals",
        "declared_options",
        "option_values",
        "public_calls",
        "page_style",
        "summary",
        "terminal",
        "names",
        "parallel",
        "overwriting",
        "safe_files",
        "section",
        "distributions",
        "error_statistics",
        "templates",
        "wording",
    ),
    ("plotting", "modeling"),
    ("measurement",),
    ("identification",),
    ("io",),
    ("cell",),
    ("correction",),
    ("validation", "joint_analysis", "simulation"),
    ("planning", "planners", "exporting", "kinematics"),
    ("reports", "viewer"),
    ("calibration", "calibration_options", "calibration_record", "feature_pipeline", "pipeline", "sessions"),
    ("fleet",),
    ("examples",),
    ("cli", "app"),
)
"""Rooms from the ground up; one imports only what is below, or beside it where that does not import it back."""

FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__main__.py")


@functools.cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def room_of(module):
    return module.split(".")[1]


@functools.cache
def imports_of(path):
    """Nodes of imports, anywhere in a file, and whether only its types need them."""
    nodes = list(ast.walk(tree_of(path)))
    for_types = {
        inner
        for node in nodes
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    return [(node, node in for_types) for node in nodes if isinstance(node, (ast.Import, ast.ImportFrom))]


def imported(path, types=True):
    """Modules of irbcal that a file imports, anywhere in it; with or without those that only its types need."""
    for node, for_types in imports_of(path):
        if for_types and not types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == "irbcal")
        elif node.module and node.module.split(".")[0] == "irbcal":
            for alias in node.names:
                deeper = PACKAGE.parent / node.module.replace(".", "/") / f"{alias.name}.py"
                folder = PACKAGE.parent / node.module.replace(".", "/") / alias.name
                yield f"{node.module}.{alias.name}" if deeper.is_file() or folder.is_dir() else node.module


def module_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def test_every_room_has_a_floor():
    rooms = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in FILES} - {"__init__"}
    assert rooms == {room for floor in FLOORS for room in floor}


def test_no_arrow_runs_up():
    height = {room: k for k, floor in enumerate(FLOORS) for room in floor}
    wrong = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in FILES
        if path != PACKAGE / "__init__.py"
        for module in imported(path)
        if module != "irbcal" and height[room_of(module)] > height[room_of(module_of(path))]
    ]
    assert wrong == []


def test_no_circle():
    """Imports that only types need, and those within functions, count as well."""
    arrows = {module_of(path): {module for module in imported(path) if module != "irbcal"} for path in FILES}
    while arrows:
        ground = [module for module, others in arrows.items() if not others & set(arrows) - {module}]
        assert ground, f"circle among {sorted(arrows)}"
        for module in ground:
            del arrows[module]


def types_in(path):
    """Names of classes and of aliases for types."""
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.ClassDef(name=name):
                yield name
            case ast.AnnAssign(target=ast.Name(id=name), annotation=ast.Name(id="TypeAlias")):
                yield name
            case ast.Assign(
                targets=[ast.Name(id=name)], value=ast.Subscript(value=ast.Name(id="Literal" | "Callable"))
            ):
                yield name


def test_a_name_of_a_type_stands_once():
    places = {}
    for path in FILES:
        for name in types_in(path):
            places.setdefault(name.lstrip("_"), []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}


def test_file_names_say_what_is_in_them():
    """Former names, of files in which a reader did not expect what they held."""
    vague = """
    abroad attained beside calibrating chance collecting course dictionaries elsewhere ends explained gathered gathering
    in_terms like_sisters live_numbers lost_rows mackay made mixed near numbers origin outcome own_tables paper places
    prepared shown sisters slips touched truth ways wish without words
    """
    assert {path.stem for path in FILES} & {*vague.split()} == set()


def test_light_rooms_stay_light():
    """Modelling, measurement and identification name no heavy package at their top."""
    heavy = {"pinocchio", "yourdfpy", "meshcat", "matplotlib", "trimesh", "coal", "lxml", "jinja2", "scipy"}
    for room in ("modeling", "measurement", "identification"):
        for path in (PACKAGE / room).rglob("*.py"):
            for node in tree_of(path).body:
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    names = [node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
                    assert not heavy & {str(name).split(".")[0] for name in names}, path


def test_every_module_can_be_imported_alone():
    for path in FILES:
        importlib.import_module(module_of(path))


def test_our_measurement_files_are_read_without_what_understands_others():
    loads = "import sys, irbcal.calibration; print([name for name in sys.modules if 'measurement.imports' in name])"
    done = subprocess.run([sys.executable, "-c", loads], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_calibration_is_read_and_used_without_a_fit():
    """What opens a calibration, verifies it, evaluates it and filters programs loads no identification."""
    paths = {module_of(path): path for path in FILES}

    def loaded(module):
        needed, new = set(), {module}
        while new:
            needed |= new
            new = {other for name in new for other in imported(paths[name], types=False) if other in paths} - needed
        return needed

    for module in ("validation.verification", "validation.evaluation", "correction.filter"):
        assert not loaded(f"irbcal.{module}") & {
            "irbcal.identification.fit",
            "irbcal.identification.evidence_fit",
            "irbcal.identification.axis_calibration",
        }, module
