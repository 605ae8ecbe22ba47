"""In which order tests run; what many need is in shared_fixtures.py, for the processes that run them."""

import gc
import os

import pytest

LONG = (
    "test_style.py",
    "test_pages.py",
    "test_app.py",
    "test_lowest.py",
    "test_fuzz.py",
    "test_docs.py",
    "test_parallel.py",
    "test_evidence.py",
    "test_feature_errors.py",
    "test_wheel.py",
    "test_adversaries.py",
    "test_chapter_7.py",
    "test_examples.py",
    "test_any_robot.py",
    "test_cli.py",
    "test_languages.py",
    "test_tables.py",
    "test_cpp.py",
    "test_browser.py",
    "test_hand_eye.py",
    "test_data_entry_errors.py",
    "test_recordings.py",
    "test_device_plan.py",
    "test_windows.py",
    "test_live_correction.py",
    "test_batch.py",
    "test_light_install.py",
    "test_browser_picks.py",
    "test_kernel.py",
    "test_store.py",
    "test_camera_rig.py",
    "test_taught_frames.py",
    "test_opening.py",
    "test_feature_proof.py",
    "test_external_axes.py",
    "test_feature_pipeline.py",
    "test_refit.py",
    "test_outliers.py",
    "test_fit.py",
    "test_view.py",
    "test_building.py",
)
"""Files that take longest, and those that would come last."""


def pytest_configure(config):
    """A process that only hands tests to workers, which it starts afterwards, need not load irbcal for seconds."""
    if not config.getoption("numprocesses", None):
        config.pluginmanager.import_plugin("shared_fixtures")


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Every second worker begins with the last file: of a new checkout either compiles half of the tests, and reads the rest."""
    report = yield
    if isinstance(collector, pytest.Dir) and os.environ.get("PYTEST_XDIST_WORKER", "0")[-1] in "13579":
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Long files come first, so that no core waits for another one at the end."""
    items.sort(key=lambda item: (LONG.index(item.path.name) if item.path.name in LONG else len(LONG), item.path))


def pytest_collection_finish():
    """What was imported stays until the end: collections of garbage need not look at it, nor does the end."""
    gc.collect()
    gc.freeze()
