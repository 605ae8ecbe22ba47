"""Whole processes for scripts/bench: user and system time and peak memory of commands, large files and programs."""

import math
import os
import subprocess
import sys

import bench_poses
import numpy as np
import pandas as pd

from irbcal.correction import languages
from irbcal.correction.moves import JointMove, Moves
from irbcal.correction.trajectories import write_trajectory
from irbcal.errors import ProgramError
from irbcal.examples import samples as makers
from irbcal.io import robots, urdf
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.trajectory import Trajectory

PROGRAMS = 10_000
LIMIT, CSV_LIMIT = 1.5, 0.9
"""Seconds beyond start of `PROGRAMS` targets in any language, and of `ROWS` of CSV."""
ROWS = 100_000
PULSES = (1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0)
"""Of a degree of each joint, for INFORM."""


RUN = """
import os, resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "irbcal", *sys.argv[1:]], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
sys.exit(done.returncode)
"""
"""A small process that starts the command: a large one's memory would count as the command's."""


def spent(*words, times=3):
    """CPU seconds (the least of several runs) and peak memory in MiB of a command."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    best = (math.inf, math.inf)
    for _ in range(times):
        command = [sys.executable, "-c", RUN, *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        if done.returncode:
            raise RuntimeError(f"irbcal {' '.join(map(str, words))}: {done.stderr[-500:]}")
        seconds, memory = map(float, done.stdout.split())
        best = min(best, (seconds, memory))
    return best


def measured_file(points, path, first=1):
    """A measurement file (CSV) of points, whose poses are counted from ``first``."""
    table = {"pose": points.pose + first}
    for joint, column in enumerate(np.degrees(points.q)[points.pose].T, start=1):
        table[f"q{joint}_deg"] = np.round(column, 6)
    table["target"] = np.array(points.target_names)[points.target]
    for name, column in zip("xyz", points.xyz.T, strict=True):
        table[f"{name}_mm"] = np.round(1e3 * column, 4)
    table["simulated"] = "yes"
    pd.DataFrame(table).to_csv(path, index=False)
    return path


TRAJECTORY = "ROS JointTrajectory"
FLEET, FOREIGN = 30, 27
"""Robots of a list, and how often a file of 1,000 poses stands in a file to import."""
TITLES = ["Punkt", *(f"A{k} [deg]" for k in range(1, 7)), "Messpunkt", *(f"{axis} [mm]" for axis in "XYZ")]


def commands(add, folder, simulated, arm):
    """Start-up, the demonstration from file to report, and commands with a calibration."""
    demo, proof = (robots.demo_file(f"demo_{name}.csv") for name in ("identification", "verification"))
    for what, limit in (("--version", 0.1), ("--help", 0.18)):
        add(f"irbcal {what}", *spent(what, times=7), limit)
    for model, limit in (("34", 0.9), ("auto", None)):
        calibrate = ("calibrate", demo, "--robot", "irb1600", "--out", folder / model, "--force", "--model", model)
        add(f"irbcal calibrate, demo, model {model}", *spent(*calibrate), limit)
    for poses in (100, 1000):
        file = measured_file(simulated(arm, poses), folder / f"auto{poses}.csv")
        calibrate = ("calibrate", file, "--robot", "irb1600", "--out", folder / f"auto{poses}", "--force")
        add(f"irbcal calibrate, model auto, {poses:,} poses x 3", *spent(*calibrate))
    program = folder / "short.mod"
    program.write_text(rapid(arm, away_from_singularities(arm, 10)))
    for name, words in {
        "verify": ("verify", folder / "34"),
        "evaluate": ("evaluate", folder / "34", proof),
        "filter, ten poses": ("filter", folder / "34", program, "--out", folder / "corrected.mod", "--allow-partial"),
        "plan": ("plan", "--robot", "irb1600", "--out", folder / "plan"),
        "demo": ("demo", "--out", folder / "demo", "--force"),
    }.items():
        add(f"irbcal {name}", *spent(*words))
    rows = [f"{r},{measured_file(simulated(arm, 50, r), folder / f'{r}.csv')},irb1600,model=34\n" for r in range(FLEET)]
    taken = []
    for count in (FLEET // 3, FLEET):
        manifest = folder / f"list{count}.csv"
        manifest.write_text("id,measurements,robot,options\n" + "".join(rows[:count]))
        words = ("fleet", "calibrate", manifest, "--out", folder / f"fleet{count}", "--jobs", 1)
        taken.append(spent(*words, times=1))
    (short, _), (long, memory) = taken
    add("irbcal fleet calibrate, a robot of 50 poses x 3, beyond start", (long - short) / (FLEET - FLEET // 3), memory)
    table = pd.concat([pd.read_csv(folder / "auto1000.csv").assign(run=run) for run in range(FOREIGN)])
    table["pose"] += 1000 * table.pop("run")
    table = table.drop(columns="simulated").set_axis(TITLES, axis=1)
    table.to_csv(folder / "foreign.csv", sep=";", decimal=",", index=False)
    words = ("import", folder / "foreign.csv", "--robot", "irb1600", "--out", folder / "imported.csv")
    add(f"irbcal import, {len(table):,} rows of another program", *spent(*words, times=1))


def large(add, folder, simulated, arm):
    """Files of many poses with three targets each, those of the proof of the same robot: seconds, and how they grow."""
    before = {}
    for poses in (1_000, 10_000, 100_000):
        fit = measured_file(simulated(arm, poses), folder / f"fit{poses}.csv")
        proof = measured_file(simulated(arm, poses, drawn=9), folder / f"proof{poses}.csv")
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
    auto = ("calibrate", fit, "--robot", "irb1600", "--out", folder / "auto", "--force")
    add(f"irbcal calibrate, model auto, {poses:,} poses x 3", *spent(*auto, times=1))
    for objective in ("max", "pnorm"):
        words = ("calibrate", fit, "--robot", "irb1600", "--out", folder / objective, "--model", "34", "--force")
        add(f"irbcal calibrate, {objective}, {poses:,} poses x 3", *spent(*words, "--objective", objective, times=1))


def huge(add, folder, simulated, arm, poses=1_000_000):
    """A million poses with three targets each: seconds and memory; asked are less than 4 GiB. Then files in pieces."""
    fit = measured_file(simulated(arm, poses), folder / "fit.csv")
    proof = measured_file(simulated(arm, poses, drawn=9), folder / "proof.csv")
    out = folder / "huge"
    calibrate = ("calibrate", fit, "--robot", "irb1600", "--out", out, "--model", "34", "--force")
    add(f"irbcal calibrate, model 34, {poses:,} poses x 3", *spent(*calibrate, times=1))
    add(f"irbcal evaluate, {poses:,} poses x 3", *spent("evaluate", out, proof, times=1))
    before = None
    step = poses // 4
    for count in (poses, 4 * poses):
        path = folder / f"long{count}.csv"
        for k in range(count // step):
            points = simulated(arm, step, drawn=100 + k)
            measured_file(points.take(points.target == 0), folder / "some.csv", 1 + k * step)
            header, _, rows = (folder / "some.csv").read_bytes().partition(b"\n")
            with open(path, "ab") as stream:
                stream.write(rows if k else header + b"\n" + rows)
        seconds, memory = spent("evaluate", out, path, times=1)
        slope = math.log(seconds / before) / math.log(4.0) if before else None
        add(f"irbcal evaluate, {count:,} poses x 1, in pieces, largest process", seconds, memory, None, slope)
        before = seconds
    parquet = path.with_suffix(".parquet")
    pd.read_csv(path).to_parquet(parquet, index=False)
    for file in (path, parquet):
        words = ("filter", out, file, "--out", folder / f"corrected{file.suffix}", "--allow-partial")
        what = f"irbcal filter, {4 * poses:,} rows of {file.suffix[1:]}, in pieces, largest process"
        add(what, *spent(*words, times=1))


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
    samples = {item.path: item.content for item in makers.files()}
    arms = {"irb1600": urdf.read("irb1600").arm}
    demo = robots.demo_file("demo_identification.csv")
    spent("calibrate", demo, "--robot", "irb1600", "--out", folder / "irb1600", "--model", "34", times=1)
    for name in (
        "RAPID, poses",
        "CSV",
        TRAJECTORY,
        *(one.name for one in languages.all_languages() if one.write_moves is not None),
    ):
        robot = "irb1600"
        if name not in ("RAPID, poses", "CSV", "RAPID", TRAJECTORY):
            robot = of_maker(name, samples, arms, folder)
        found, count = [], ROWS if name == "CSV" else PROGRAMS
        for size in (10, count // 2, count):
            q = away_from_singularities(arms[robot], size)
            place = folder / f"{name}{size}".replace(", ", "").replace(" ", "")
            file = program(name, arms[robot], q, place)
            several = file.is_dir()
            out = folder / f"{place.name}-out{'' if several else file.suffix}"
            pulses = ("--pulses", ",".join(map(str, PULSES))) if "INFORM" in name else ()
            found.append(spent("filter", folder / robot, file, "--out", out, "--allow-partial", *pulses, times=2))
        _beyond(add, f"{name}, {count:,} targets", found, CSV_LIMIT if name == "CSV" else LIMIT)
    for name, maker in bench_poses.ARMS.items():
        calibrated(maker, samples, arms, folder)
        start, found = away_from_singularities(arms[maker], 200), []
        for size in (10, PROGRAMS // 2, PROGRAMS):
            place = folder / f"{name}-poses{size}"
            place.mkdir(exist_ok=True)
            arm, data = arms[maker], samples[f"{maker}/arm.urdf"]
            file = bench_poses.program(name, data, arm, start, size, place, samples)
            out = folder / f"{place.name}-out{file.suffix}"
            given = bench_poses.GIVEN.get(name, ())
            found.append(spent("filter", folder / maker, file, "--out", out, "--allow-partial", *given, times=2))
        _beyond(add, f"{languages.by_name()[name].name}, {PROGRAMS:,} poses", found, LIMIT)


def _beyond(add, what, found, limit):
    """A row of a program beyond the start of a short one; found are seconds and memory of ten, half and all targets."""
    (start, _), (half, _), (whole, memory) = found
    slope = math.log2((whole - start) / max(half - start, 1e-3))
    add(f"irbcal filter, {what} beyond start", whole - start, memory, limit, slope)


def of_maker(name, samples, arms, folder):
    """A SIMULATED robot of the samples that a language's controller could move, calibrated."""
    language = next(one for one in languages.all_languages() if name == one.name)
    for file in (file for file in samples if file.endswith("/arm.urdf")):
        maker = file.partition("/")[0]
        arm = arms.setdefault(maker, urdf.from_bytes(samples[file], maker).arm)
        try:
            if language.maker is not None:
                language.maker.check(arm, maker)
        except ProgramError:
            continue
        calibrated(maker, samples, arms, folder)
        return maker
    raise RuntimeError(f"no arm for {name}")


def calibrated(maker, samples, arms, folder):
    """Calibrate the SIMULATED robot of a maker's samples, once."""
    arms.setdefault(maker, urdf.from_bytes(samples[f"{maker}/arm.urdf"], maker).arm)
    if (folder / maker).exists():
        return
    for part in ("arm.urdf", "measured.csv"):
        (folder / f"{maker}-{part}").write_bytes(samples[f"{maker}/{part}"])
    measured, robot = folder / f"{maker}-measured.csv", folder / f"{maker}-arm.urdf"
    spent("calibrate", measured, "--robot", robot, "--out", folder / maker, "--model", "placement", times=1)


def program(name, arm, q, folder):
    """A program in a folder of its own."""
    folder.mkdir(exist_ok=True)
    if name == "CSV":
        file = folder / "job.csv"
        pd.DataFrame(np.round(np.degrees(q), 4), columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv(file, index=False)
        return file
    if name == TRAJECTORY:
        times = 0.01 * np.arange(len(q))
        middle = np.array([0.0, 0.2, 0.1, 0.2, 0.8, 0.1])
        way = middle + 0.3 * np.sin(0.5 * times[:, None] * np.array([1.0, 1.3, 0.7, 1.1, 0.9, 1.7]))
        return write_trajectory(Trajectory(times, way, names=arm.joint_names), folder / "job.yaml")
    if name == "RAPID, poses":
        file = folder / "job.mod"
        file.write_text(rapid(arm, q))
        return file
    language = next(one for one in languages.all_languages() if name == one.name)
    moves = (JointMove("", 0.0, 0.5, 1.0),) * len(q)
    pulses = PULSES if "INFORM" in name else ()
    files = languages.write(language, Moves(arm, q, moves, pulses=pulses))
    for file, content in files.items():
        (folder / file).write_bytes(content)
    return folder / next(iter(files)) if len(files) == 1 else folder
