"""Robot programs as poses to command in the virtual cell: their stops, in their order."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.correction import languages
from irbcal.correction.commanded import commanded
from irbcal.correction.filter import given_frames, place_pair
from irbcal.correction.program import Given, read_bytes
from irbcal.errors import ProgramError
from irbcal.io.controller_model import controller_frames, unknown_frames
from irbcal.io.opening import open_robot
from irbcal.modeling.arm import Arm
from irbcal.options import pulses_per_degree


def is_program(poses: object) -> bool:
    """Whether poses are a file, or a folder, of a robot program in another language than CSV.

    Raises
    ------
    ProgramError
        If a file cannot be read.
    """
    if not isinstance(poses, (str, PathLike)):
        return False
    path = Path(poses)
    if path.is_dir():
        return True
    found = {ending: one.NAME for one in languages.known() for ending in one.ENDINGS}.get(path.suffix.lower())
    if found is not None or path.suffix.lower() in (".txt", ".parquet") or not path.is_file():
        return found not in (None, "CSV")
    data = read_bytes(path)
    return any(one.looks_like(data) for one in languages.known() if one.NAME != "CSV")


def given_for(
    robot: str | Path,
    arm: Arm,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    pulses: Sequence[float] | None = None,
    where: tuple[ArrayLike, ArrayLike] | None = None,
    program: str | Path | None = None,
) -> Given:
    """What comes with the programs of a robot; arguments as for `irbcal.correct`, ``program`` is one of them.

    Raises
    ------
    OptionError
        If a frame is not a rigid transform, or the pulses are not six numbers.
    """
    frames = given_frames(tool, "tool"), given_frames(wobj, "wobj")
    opened = open_robot(robot, base_link=arm.base_link, tip_link=arm.tip_link)
    at = unknown_frames()
    if opened.urdf_bytes is not None:
        at = controller_frames(opened.urdf_bytes, str(robot), arm.base_link, arm.tip_link)
    pair = None if where is None or program is None else place_pair(where, languages.files_of([program])[0])
    return Given(*frames, at, pulses_per_degree(pulses), where=pair)


def read(program: str | Path, arm: Arm, given: Given) -> tuple[FloatArray, str | None]:
    """Joints at the stops of a program.

    Parameters
    ----------
    program : str or Path
        A file, or a folder with the files of one program.
    arm : Arm
        What the controller computes with.
    given : Given

    Returns
    -------
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    sha256 : str
        Of the contents of all files.

    Raises
    ------
    ProgramError
        If it cannot be read, moves nowhere, or the joints of a stop are not known.
    """
    language, files = languages.files_of([program])
    found = [(one.source, commanded(one, arm)) for one in language.read_for(arm, files, given)]
    moving = [(source, q) for source, q in found if len(q)]
    if not moving:
        raise ProgramError("expected a program that moves the robot, found no move", file=program)
    if len(moving) > 1:
        names = ", ".join(Path(source).name for source, _ in moving)
        raise ProgramError(f"expected one program, found several ({names}): name one of them", file=program)
    digest = hashlib.sha256(b"".join(read_bytes(file) for file in files)).hexdigest()
    return np.asarray(moving[0][1]), digest
