"""Exported headers, compiled: what they compute for rows of joints, and how long that takes."""

import shutil
import subprocess
from pathlib import Path

import numpy as np

from irbcal.exporting import cpp

HARNESS = Path(__file__).parent / "exporting" / "harness.cpp"
WARNINGS = ("-Wall", "-Wextra", "-Werror")
COMPILERS = [name for name in ("g++", "clang++") if shutil.which(name)]


def compiled(source, folder, compiler="g++", options=("-O0",), main=HARNESS):
    """The harness around a source's header, or another program; with the header's name and namespace defined."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in cpp.files(source).files.items():
        (folder / name).write_bytes(content)
    word = source.numbers.identifier
    call = [compiler, "-std=c++17", *options, *WARNINGS, f"-I{folder}", f'-DHEADER="{word}_calibrated.hpp"']
    call += [f"-DSPACE={word}_calibrated", str(main), "-o", str(folder / f"{Path(main).stem}_{compiler}")]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / f"{Path(main).stem}_{compiler}"


def situations(robot, n, seed):
    """Joints with the stop before (a quarter not known), torques, masses and places: n rows each."""
    rng = np.random.default_rng(seed)
    q, before = robot.arm.random_joints(n, seed), robot.arm.random_joints(n, seed + 1)
    before[::4] = np.nan
    given = {"previous": before, "payload_kg": rng.uniform(0, 5, n), "payload_centre": rng.uniform(-0.2, 0.2, (n, 3))}
    return q, given | {"torques": rng.normal(0, 30, q.shape)}


def computed(program, q, situation):
    """What a compiled header computes.

    Effective joints, tips (n, 3, 4), derivatives of both by commanded joints, commands from the effective joints, tips of
    the inverse's joints, and whether commands and inverse were found.
    """
    before, kg, place, torques = situation.values()
    rows = np.hstack([q, before, torques, kg[:, None], place])
    done = subprocess.run([program], input=rows.tobytes(), capture_output=True, check=True)
    n = q.shape[1]
    sizes = {"theta": n, "R": 9, "p": 3, "M": n * n, "J": 6 * n, "back": n, "R2": 9, "p2": 3, "flags": 2}
    table = np.frombuffer(done.stdout).reshape(len(q), sum(sizes.values()))
    parts = dict(zip(sizes, np.split(table, np.cumsum(list(sizes.values()))[:-1], axis=1), strict=True))

    def tips(R, p):
        return np.concatenate([parts[R].reshape(-1, 3, 3), parts[p][:, :, None]], axis=2)

    J = parts["J"].reshape(-1, 6, n)
    return (
        parts["theta"],
        tips("R", "p"),
        parts["M"].reshape(-1, n, n),
        J,
        parts["back"],
        tips("R2", "p2"),
        parts["flags"],
    )


def times(program, q, situation):
    """Microseconds a call: forward, effective, forward with Jacobian, inverse; share of inverses found, their steps."""
    before, kg, place, torques = situation.values()
    rows = np.hstack([q, before, torques, kg[:, None], place])
    done = subprocess.run([program, "time"], input=rows.tobytes(), capture_output=True, check=True)
    return [float(word) for word in done.stdout.split()[:6]]
