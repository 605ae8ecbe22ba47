"""Arms of other makers, and an independent way from the numbers of a program to where the robot ends."""

import importlib.util
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import example_robot, random_robot

from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.program import ControllerSetup
from irbcal.errors import ProgramError
from irbcal.io import controller_model, urdf
from irbcal.modeling.inverse import closed_form

SCIPY = {"krl": "ZYX", "fanuc": "xyz", "inform": "xyz", "kawasaki": "ZYZ", "val3": "XYZ"}
"""How scipy names the makers' angles in the order of their fields; ``xyz`` is about fixed axes."""


def path_of(name):
    """A URDF of ../shared/data/other_arms."""
    path = Path(os.environ.get("IRBCAL_SHARED_DATA", "../shared/data")) / "other_arms" / f"{name}.urdf"
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    return path


def robot_of(name, size=0.1):
    """A nominal arm of ../shared/data/other_arms, a robot that errs, and the controller's frames."""
    path = path_of(name)
    nominal = urdf.read(path).arm
    at = controller_model.controller_frames(path.read_bytes(), str(path), nominal.base_link, nominal.tip_link)
    return nominal, random_robot(nominal, "placement", np.random.default_rng(1), size=size), at


def well_inside(nominal, n, seed=4):
    """Random joints away from limits and from all singularities."""
    q = 0.6 * nominal.random_joints(40 * n, seed)
    branches = closed_form.branches(nominal, nominal.forward(q))
    near = branches.singular(wrist=0.15, shoulder=0.15, elbow=0.03)
    return q[~(near["wrist"] | near["shoulder"] | near["elbow"]).any(axis=1)][:n]


def pose_numbers(T, name, length=1e-3):
    """Six numbers of poses, by scipy."""
    R = Rotation.from_matrix(T[:, :3, :3])
    angles = R.as_rotvec() if name is None else R.as_euler(name, degrees=True)
    return np.column_stack([T[:, :3, 3] / length, angles])


def poses(numbers, name, length=1e-3):
    """Poses of six numbers, by scipy."""
    numbers = np.asarray(numbers, dtype=float).reshape(-1, 6)
    T = np.tile(np.eye(4), (len(numbers), 1, 1))
    turn = (
        Rotation.from_rotvec(numbers[:, 3:])
        if name is None
        else Rotation.from_euler(name, numbers[:, 3:], degrees=True)
    )
    T[:, :3, :3], T[:, :3, 3] = turn.as_matrix(), numbers[:, :3] * length
    return T


def given(at, tools=None, work_objects=None):
    """What comes with a program."""
    return ControllerSetup(tools or {}, work_objects or {}, at)


def corrected(robot, nominal, program, fingerprint="abc123"):
    """What the filter makes of a program that was read."""
    return filter_program(program, CorrectionModel(robot, nominal, fingerprint))


def damaged(data, n, seed=0):
    """Damaged copies of a file: cut, with other bytes, with pieces doubled, lost or put elsewhere."""
    rng = np.random.default_rng(seed)
    garbage = [*(bytes([byte]) for byte in b"{}[]\"'\n\x00\xff=,;-<"), b"1e999", b"P[", b"/POS"]
    for _ in range(n):
        new = bytearray(data)
        for _ in range(rng.integers(1, 4)):
            at = int(rng.integers(0, max(len(new), 1)))
            kind = rng.integers(0, 5)
            if kind == 0:
                del new[at:]
            elif kind == 1 and new:
                new[at % len(new)] ^= int(rng.integers(1, 256))
            elif kind == 2:
                new[at:at] = garbage[rng.integers(0, len(garbage))]
            elif kind == 3:
                del new[at : at + int(rng.integers(1, 40))]
            else:
                piece = new[at : at + int(rng.integers(1, 60))]
                to = int(rng.integers(0, max(len(new), 1)))
                new[to:to] = piece
        yield bytes(new)


def check_damaged(data, parse, correct):
    """150 damaged copies of a file end in a refusal or a result; each tenth is corrected as well."""
    read = 0
    for k, copy in enumerate(damaged(data, 150)):
        with suppress(ProgramError):
            program = parse(copy)
            if k % 10 == 0:
                correct(program)
            read += 1
    assert read > 50


def language_tests(language):
    """The module that tests a language, with its programs."""
    path = Path(__file__).parent / "correction" / "languages" / f"test_{language}.py"
    spec = importlib.util.spec_from_file_location(f"programs_of_{language}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def universal_robot():
    path = example_robot("ur_description/urdf/ur10_robot.urdf")
    nominal = urdf.read(path).arm
    at = controller_model.controller_frames(path.read_bytes(), str(path), nominal.base_link, nominal.tip_link)
    return nominal, random_robot(nominal, "placement", np.random.default_rng(1), size=0.05), at


LANGUAGES = {  # robot, size of its errors, and by how much the printed decimals move a target, mm and degrees
    "krl": ("kr120r2500pro", 0.05, 1e-4),
    "fanuc": ("m20ia", 0.05, 0.06),
    "urscript": (None, 0.05, 1e-4),
    "val3": ("rx160", 0.05, 1e-4),
    "inform": ("gp8", 0.05, 0.06),
    "kawasaki": ("rs007n", 0.05, 1e-4),
}
