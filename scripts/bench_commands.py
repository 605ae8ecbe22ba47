"""Whole processes for scripts/bench: user and system time and peak memory of commands, large files and programs."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.correction import languages, write_moves
from irbcal.correction.moves import Move, Moves
from irbcal.files import robots, urdf
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form

PROGRAMS = 10_000
ROWS = 100_000


def spent(*words, times=3):
    """CPU seconds (the least of several runs) and peak memory in MiB of a command."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    best = (math.inf, math.inf)
    for _ in range(times):
        command = [sys.executable, "-m", "irbcal", *map(str, words)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment) as process:
            said = process.stderr.read()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"irbcal {' '.join(map(str, words))}: {said.decode()[-500:]}")
        best = min(best, (usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024))
    return best


def measured_file(points, path):
    """A measurement file (CSV) of points."""
    table = {"pose": points.pose + 1}
    for joint, column in enumerate(np.degrees(points.q)[points.pose].T, start=1):
        table[f"q{joint}_deg"] = np.round(column, 6)
    table["target"] = np.array(points.target_names)[points.target]
    for name, column in zip("xyz", points.xyz.T, strict=True):
        table[f"{name}_mm"] = np.round(1e3 * column, 4)
    table["simulated"] = "yes"
    pd.DataFrame(table).to_csv(path, index=False)
    return path


def commands(add, folder):
    """Start-up, and the demonstration from file to report."""
    demo = robots.demo_file("demo_identification.csv")
    for what, limit in (("--version", 0.1), ("--help", 0.18)):
        add(f"irbcal {what}", *spent(what, times=7), limit)
    for model, limit in (("34", 0.9), ("auto", None)):
        calibrate = ("calibrate", demo, "--robot", "irb1600", "--out", folder / model, "--force", "--model", model)
        add(f"irbcal calibrate, demo, model {model}", *spent(*calibrate), limit)


def large(add, folder, simulated, arm):
    """Files of many poses with three targets each: seconds, and how they grow."""
    before = {}
    for poses in (1_000, 10_000, 100_000):
        fit = measured_file(simulated(arm, poses), folder / f"fit{poses}.csv")
        proof = measured_file(simulated(arm, poses, 9), folder / f"proof{poses}.csv")
        out = folder / f"large{poses}"
        words = {
            "calibrate, model 34": ("calibrate", fit, "--robot", "irb1600", "--out", out, "--model", "34", "--force"),
            "evaluate --intervals": ("evaluate", out, proof, "--intervals"),
        }
        for name, command in words.items():
            seconds, memory = spent(*command, times=1)
            slope = math.log10(seconds / before[name]) if name in before else None
            limit = {"calibrate, model 34": 8.0, "evaluate --intervals": 5.0}[name] if poses == 100_000 else None
            add(f"irbcal {name}, {poses:,} poses x 3", seconds, memory, limit, slope)
            before[name] = seconds


def rapid(arm, q):
    """A RAPID module of poses."""
    T = arm.forward(q)
    numbers = np.column_stack([1e3 * T[:, :3, 3], frames.quaternion_from_matrix(T[:, :3, :3])])
    quadrants = np.floor(q[:, [0, 3, 5]] / (np.pi / 2)).astype(int)
    absent = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    lines = ["MODULE many"]
    for k, (row, (cf1, cf4, cf6)) in enumerate(zip(numbers, quadrants, strict=True)):
        place, turn = (",".join(f"{value:.8f}" for value in part) for part in (row[:3], row[3:]))
        lines.append(f"  CONST robtarget p{k}:=[[{place}],[{turn}],[{cf1},{cf4},{cf6},0],{absent}];")
    lines.append("  PROC main()")
    lines += [f"    MoveL p{k}, v100, fine, tool0;" for k in range(len(q))]
    return "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def away_from_singularities(arm, n):
    """Joints of n poses that small corrections serve."""
    q = 0.6 * arm.random_joints(4 * n, 3)
    near = closed_form.branches(arm, arm.forward(q)).singular(wrist=0.15, shoulder=0.15, elbow=0.03)
    return q[~(near["wrist"] | near["shoulder"] | near["elbow"]).any(axis=1)][:n]


def programs(add, folder):
    """Programs of many targets in every language, beyond the start of a program of ten."""
    arm = urdf.read("irb1600").arm
    demo = robots.demo_file("demo_identification.csv")
    spent("calibrate", demo, "--robot", "irb1600", "--out", folder / "c", "--force", "--model", "34", times=1)
    sizes = (10, PROGRAMS // 2, PROGRAMS)
    limits = {"RAPID, poses": 1.5, "CSV": 0.9}
    for name in ("RAPID, poses", "CSV", *(one.NAME for one in languages.known() if one.write_moves is not None)):
        found = []
        for size in sizes if name != "CSV" else (10, ROWS // 2, ROWS):
            q = away_from_singularities(arm, size)
            try:
                file = program(name, arm, q, folder / f"{name}{size}".replace(", ", "").replace(" ", ""))
            except Exception as error:  # a language that does not serve this arm
                print(f"{name}: {error}")
                break
            out = folder / "out" / f"{file.parent.name}-{file.name}"
            out.parent.mkdir(exist_ok=True)
            pulses = ("--pulses", "1341.4,1341.4,1341.4,1000,1000,622") if "INFORM" in name else ()
            try:
                found.append(spent("filter", folder / "c", file, "--out", out, "--allow-partial", *pulses, times=2))
            except RuntimeError as error:
                print(f"{name}: {error}")
                break
        if len(found) == 3:
            (start, _), (half, _), (whole, memory) = found
            slope = math.log2((whole - start) / max(half - start, 1e-3))
            count = ROWS if name == "CSV" else PROGRAMS
            add(
                f"irbcal filter, {name}, {count:,} targets beyond start", whole - start, memory, limits.get(name), slope
            )


def program(name, arm, q, folder):
    """A program in a folder of its own."""
    folder.mkdir(exist_ok=True)
    if name == "CSV":
        file = folder / "job.csv"
        pd.DataFrame(np.round(np.degrees(q), 4), columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv(file, index=False)
        return file
    if name == "RAPID, poses":
        file = folder / "job.mod"
        file.write_text(rapid(arm, q))
        return file
    language = next(one for one in languages.known() if name == one.NAME)
    moves = (Move("", 0.0, 0.5, 1.0),) * len(q)
    pulses = (1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0) if "INFORM" in name else ()
    files = write_moves.write(language, Moves(arm, q, moves, pulses=pulses))
    for file, content in files.items():
        (folder / file).write_bytes(content)
    return next(path for path in map(Path, sorted(folder.iterdir())) if path.suffix.lower() in language.ENDINGS)
