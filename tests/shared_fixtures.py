"""What many tests need: the measured data, the program inside this process, a calibration of simulated data."""

import functools
import gc
import hashlib
import json
import os
import pickle
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path

import new_family
import numpy as np
import pandas as pd
import pytest
import typer.testing
from hypothesis import settings
from support import arm, measured, random_robot, write_measurements
from typer.testing import CliRunner
from viewer_page import ARGUMENTS

import irbcal
from irbcal import calibration
from irbcal.cli.main import app
from irbcal.examples.samples import Samples
from irbcal.identification import term_sets
from irbcal.io import calibration_folder, robots
from irbcal.modeling.terms import families

# the same examples every time, and no verdict on a slow moment of a shared machine
settings.register_profile("irbcal", deadline=None, derandomize=True)
settings.load_profile("irbcal")

# the command line is built once, not at each call
typer.testing._get_command = functools.cache(typer.main.get_command)
# as the program does: what is imported stays, there is little to collect
gc.set_threshold(300000, 20, 100)
# files of tests need not outlive a power cut: a disk takes milliseconds for each of thousands, in which a core waits
os.fsync = os.fstat


@pytest.fixture(scope="session")
def launched():
    """Starts a browser with arguments more, by the one playwright that a process may have."""
    names = ("chromium-headless-shell", "chromium", "chromium-browser")
    chromium = next((path for path in map(shutil.which, names) if path is not None), None)
    if chromium is None:
        pytest.skip("no chromium on this computer")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started, ExitStack() as opened:
        launch = functools.partial(started.chromium.launch, executable_path=chromium)
        yield lambda *more: opened.enter_context(launch(args=[*ARGUMENTS, *more]))


@pytest.fixture(scope="session")
def browser(launched):
    """A browser in which everything happens but the painting of 3D views, which takes most of the time."""
    return launched("--disable-gl-drawing-for-tests")


@pytest.fixture(scope="session")
def painting_browser(launched):
    """One that paints them."""
    return launched()


@pytest.fixture(scope="session")
def shared_data():
    """Folder of the measured data, which are not part of the project; IRBCAL_SHARED_DATA overrides where it is."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("IRBCAL_SHARED_DATA") or default)
    if not folder.is_dir():
        pytest.skip(f"no measured data: {folder} does not exist (set IRBCAL_SHARED_DATA to their folder)")
    return folder


@pytest.fixture(scope="session")
def calibrated():
    """Calibrates the simulated demonstration robot into a folder, without the report that takes most of the time."""

    def make(folder, model):
        made = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", model)
        calibration_folder.write(folder, made.record, made.urdf, "")
        return folder

    return make


@pytest.fixture(scope="session")
def demo_calibration(calibrated, tmp_path_factory):
    """Folder of a calibration of the simulated demonstration robot, level 34."""
    return calibrated(tmp_path_factory.mktemp("calibration") / "demo", "34")


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory):
    """A folder of this run of the tests, the same for all workers of pytest-xdist."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session")
def example_files(shared_folder):
    """The example files, written once a run of the tests, to be read only."""
    folder = shared_folder / "samples"
    if not folder.exists():
        part = folder.with_suffix(f".{os.getpid()}")
        made = irbcal.samples(part / "files")
        (part / "about").write_bytes(pickle.dumps((made.about, made.tried)))
        with suppress(OSError):  # another worker was first
            part.rename(folder)
    return Samples(folder / "files", *pickle.loads((folder / "about").read_bytes()))


@pytest.fixture(scope="module")
def fits_once(shared_folder):
    """Calibrations from the same content with the same options are computed once a run of the tests."""
    compute = calibration.run

    def run(options):
        key = pickle.dumps(
            sorted((name, _content(value)) for name, value in vars(options).items() if name != "progress")
        )
        path = shared_folder / f"fit-{hashlib.sha256(key).hexdigest()}"
        if not path.exists():
            part = path.with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(compute(options)))
            part.replace(path)
        return pickle.loads(path.read_bytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "run", run)
        yield


LONG_SERIES = (
    "cli/test_cli.py",
    "identification/test_evidence.py",
    "identification/test_term_sets.py",
    "tests/test_error_model.py",
    "tests/test_loads.py",
    "tests/test_tables.py",
    "validation/test_doubts.py",
)
"""Files whose error models are averaged with the long series of harmonics, which take three quarters of the time."""


@pytest.fixture(scope="module", autouse=True)
def short_series(request):
    """Elsewhere they are left out; programs in processes of their own have them."""
    with pytest.MonkeyPatch.context() as patch:
        if not str(request.path).endswith(LONG_SERIES):
            patch.setattr(term_sets, "CHOICES", [c for c in term_sets.CHOICES if c[1] <= term_sets.LOW])
        yield


def _content(value):
    """What a file, or a calibration's folder, holds beside its name; anything else as it is."""
    if isinstance(value, (str, Path)):
        path = Path(value, "calibration.json") if os.path.isdir(value) else Path(value)
        return (Path(value).name, path.read_bytes()) if path.is_file() else str(value)
    return value.to_csv() if isinstance(value, pd.DataFrame) else value


@pytest.fixture(scope="session")
def program():
    """Runs the program: what it prints, or its JSON with ``--json``; wrong calls and refusals raise."""

    def run(*arguments):
        done = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout) if "--json" in arguments else done.stdout

    return run


@pytest.fixture(scope="session")
def calibration_34(tmp_path_factory):
    """A calibration of a simulated robot."""
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    return irbcal.calibrate(path, "irb1600", "34", holdout=0.3)


@pytest.fixture(scope="session")
def validated(calibration_34):
    """All that came out of it: points, fits, errors."""
    return calibration_34.validated


@pytest.fixture(scope="session")
def folder(calibration_34, tmp_path_factory):
    """The same, saved."""
    path = tmp_path_factory.mktemp("saved") / "calibration"
    calibration_34.save(path, world_link=True, target_links=True)
    return path


@pytest.fixture
def creep(tmp_path, monkeypatch):
    """A family of the error model in a module that no file of the package names."""
    new_family.add(tmp_path, monkeypatch)
    yield families()["creep"]
    monkeypatch.undo()
    new_family.forget()


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """Two calibrations of one simulated robot, from other measurements each."""
    root = tmp_path_factory.mktemp("origins")
    truth = random_robot(arm(), "34", np.random.default_rng(1))
    for name, seed in (("first", 1), ("second", 2)):
        rng = np.random.default_rng(seed)
        data = write_measurements(root / f"{name}.csv", measured(truth, arm().random_joints(60, seed), 3e-5, rng))
        irbcal.save(irbcal.calibrate(data, "irb1600", "34"), root / name)
    return root / "first", root / "second"
