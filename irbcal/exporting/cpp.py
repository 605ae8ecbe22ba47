"""C++17: one header without dependencies, a program that checks it, and one that corrects a stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from irbcal import kernel, literals
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.exporting import live_correction
from irbcal.exporting.robot_numbers import ExportFiles, render
from irbcal.exporting.source import Source
from irbcal.modeling.inverse.fixed_point import NEAR_NOMINAL
from irbcal.modeling.inverse.orthoparallel import OrthoParallel
from irbcal.modeling.robot import Robot
from irbcal.units import DEG

KERNEL = Path(kernel.__file__).parent

DESCRIPTION = "C++17: one header without dependencies, and a program for live correction"
NEXT_STEP = "g++ -std=c++17 -O3 {folder}/{word}_check.cpp -o check && ./check     # are its numbers right here, too?"


def files(source: Source) -> ExportFiles:
    """The header and two small programs."""
    numbers, vectors = source.numbers, source.vectors
    n, word = len(numbers.joint_names), numbers.identifier
    header, check, program = f"{word}_calibrated.hpp", f"{word}_check.cpp", f"{word}_stream.cpp"
    spans, first = [], 0
    for lever in numbers.levers:
        spans.append((first, first + len(lever.links) - 1))
        first += len(lever.links)
    values = {
        "space": literals.word(f"{word}_calibrated"),
        "guard": literals.word(f"IRBCAL_{word.upper()}_CALIBRATED_HPP"),
        "header": literals.word(header),
        "program": literals.word(program),
        "speed": live_correction.known_speed(numbers),
        "slack": live_correction.SLACK,
        "start_s": live_correction.START_S,
        "recovery_s": live_correction.RECOVERY_S,
        "correction": [live_correction.LARGEST_CORRECTION[bool(slides)] for slides in numbers.slides],
        "largest_left": live_correction.LARGEST_LEFT,
        "beyond": live_correction.LIMIT_MARGIN,
        "to_speed": live_correction.TO_SPEED_S,
        "to_acceleration": live_correction.TO_ACCELERATION_S,
        "ramp": live_correction.RAMP_S,
        "largest_t": live_correction.LARGEST_T,
        "longest_line": live_correction.LONGEST_LINE,
        "degree": DEG,
        "pi": np.pi,
        "check": literals.word(check),
        "spans": spans,
        "mask": lambda joints: [j in joints for j in range(n)],
        "cosine": _even(numbers.cosine),
        "sine": _even(numbers.sine),
        "uncoupling": np.linalg.inv(numbers.coupling),
        "reach": numbers.reach,
        "closed_form": _closed_form(source.robot),
    }
    templates = {header: "calibrated.hpp.j2", check: "check.cpp.j2", program: "stream.cpp.j2"}
    files = {name: render(template, numbers, vectors, **values) for name, template in templates.items()}
    for name, kernel_file in ((header, "kernel.hpp"), (program, "motion.hpp")):
        include = f'#include "{kernel_file}"\n'.encode()
        files[name] = files[name].replace(include, (KERNEL / kernel_file).read_bytes())
    return ExportFiles(files)


def _closed_form(robot: Robot) -> list[Any] | None:
    """Members of the kernel's structure for the nominal arm's closed form, from which inverses of far poses start."""
    try:
        closed = OrthoParallel.from_arm(robot.joint_map.terms.arm, NEAR_NOMINAL)
    except RobotError:
        return None
    frames = [[T[:3, :3], T[:3, 3]] for T in (closed.wrist.T_left, closed.wrist.T_right)]
    return [*closed.lengths, closed.signs, closed.shifts, *frames]


def _even(rows: FloatArray) -> FloatArray:
    """Series (orders, n) with an even number of orders, and a row of zeros more, so that no array is empty."""
    return np.vstack([rows, np.zeros((1 + len(rows) % 2, rows.shape[1]))])
