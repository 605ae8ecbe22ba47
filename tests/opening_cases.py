"""Calibrations of irbcal's own samples by every method and model, and the commands that open what was written."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from irbcal.cli.main import app

LEVELS = ("nominal", "11", "16", "26", "34", "34b", "offsets", "placement", "auto")
OWN_ROBOT = ("--robot", "my_robot.urdf")
RAIL = ("--robot", "cell.urdf", "--base-link", "rail_base", "--tip-link", "tool0")
NOISE_MM = (0.0, 0.02, 0.2)


class Case(NamedTuple):
    """A sample with added noise (standard deviation of a coordinate, mm), and options of ``irbcal calibrate``."""

    sample: str
    noise_mm: float
    options: tuple[str, ...]


def cases() -> list[Case]:
    """The whole matrix."""
    by_sample: dict[str, list[tuple[str, ...]]] = {
        "moves.csv": [
            *((*OWN_ROBOT, "--method", "circles", *more) for more in WITH_CIRCLES),
            *((*OWN_ROBOT, "--model", level) for level in LEVELS),
            (*OWN_ROBOT, "--terms", "all"),
        ],
        "measured.csv": [
            *((*OWN_ROBOT, "--model", level) for level in (*LEVELS, "best-level")),
            (*OWN_ROBOT, "--terms", "all"),
            (*OWN_ROBOT, "--method", "nelder-mead"),
            (*OWN_ROBOT, "--model", "34", "--as-poses"),
            (*OWN_ROBOT, "--model", "34", "--objective", "max"),
            (*OWN_ROBOT, "--model", "34", "--loss", "huber"),
            (*OWN_ROBOT, "--model", "34", "--holdout", "0"),
        ],
        "two_days.csv": [(*OWN_ROBOT, "--model", level) for level in ("26", "auto")],
        "two_loads.csv": [(*OWN_ROBOT, *more) for more in (("--same-tool",), ("--model", "34"))],
        "rail.csv": [(*RAIL, "--model", level) for level in ("offsets", "placement", "auto")],
        "touched.csv": [(*OWN_ROBOT, "--features", "balls.csv")],
        "kuka/measured.csv": [("--robot", "kuka/arm.urdf")],
        "fanuc/measured.csv": [("--robot", "fanuc/arm.urdf")],
    }
    return [Case(sample, mm, words) for sample, each in by_sample.items() for words in each for mm in NOISE_MM]


WITH_CIRCLES: tuple[tuple[str, ...], ...] = ((), ("--parallel", "forced"), ("--targets", "cad.csv"))


def openings(case: Case, data: Path, out: Path) -> Iterator[tuple[str, ...]]:
    """Commands that open the calibration in a folder, in the folder of the samples."""
    at_features, frame_terms = "--features" in case.options, "all" in case.options
    joints = "rail.csv" if case.sample == "rail.csv" else "joints.csv"
    yield "verify", str(out)
    other_targets = ("measured.csv", "--refit-base", "--refit-tool") if at_features else (str(data), "--include-fitted")
    yield "evaluate", str(out), *other_targets
    yield "fk", str(out), "--joints", joints
    if joints != "rail.csv":  # poses of which go to the joints' limits
        yield "filter", str(out), "job.csv", "--out", f"{out}.csv"
    without = ("--without-frame-terms",) if frame_terms else ()
    yield "export", str(out), "--as", "urdf", "--out", f"{out}-export", *without
    yield "view", str(out), "--html", f"{out}.html"


def faults(case: Case, out: Path) -> list[str]:
    """What does not open of a calibration that was written; the samples are in the working folder.

    A calibration may be refused in a sentence: then no folder is there.
    """
    rows = pd.read_csv(case.sample, comment="#")
    rng = np.random.default_rng(len(rows))
    for name in ("x_mm", "y_mm", "z_mm"):
        if name in rows:
            rows[name] += rng.normal(size=len(rows)) * case.noise_mm
    data = out.with_suffix(".measured.csv")
    rows.to_csv(data, index=False)
    code, said = _run("calibrate", str(data), *case.options, "--out", str(out))
    if code == 1 and said:
        return [f"refused ({said}), and {out} is there"] if out.exists() else []
    if code:
        return [f"calibrate ended with {code}: {said}"]
    done = [(words[0], *_run(*words)) for words in openings(case, data, out)]
    return [f"{name} ended with {code}: {said}" for name, code, said in done if code]


def _run(*words: str) -> tuple[int, str]:
    """Exit code and refusal of a command; a traceback is raised."""
    from irbcal.errors import IrbcalError

    done: Any = CliRunner().invoke(app, list(words))
    if isinstance(done.exception, IrbcalError):
        return 1, str(done.exception)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output[-500:] if done.exit_code else ""
