"""Programs as read for the robot of a calibration, with what its controller computes with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import frames_by_name
from irbcal.correction import languages
from irbcal.correction.backup import unpacked
from irbcal.correction.instructions import read as taught
from irbcal.correction.language import Language
from irbcal.correction.maker import FAR_BEYOND_LIMIT
from irbcal.correction.program import ControllerSetup, Note, Program, read_bytes
from irbcal.correction.program_options import ControllerOptions, ProgramOptions
from irbcal.errors import OptionError, ProgramError
from irbcal.io.controller_model import (
    ControllerFrames,
    ControllerModel,
    controller_frames,
    controller_kinematics,
    unknown_frames,
)
from irbcal.io.opening import CalibrationLike, open_calibration, open_robot
from irbcal.io.schema import Record
from irbcal.modeling.arm import Arm
from irbcal.option_values import excerpt, pulses_per_degree
from irbcal.units import MM

NOMINAL = "nominal"
"""The controller model that is the nominal robot."""


class OpenedCalibration(NamedTuple):
    """A calibration, and where its controller has flange and world."""

    record: Record
    urdf: bytes | None
    """The calibrated robot, where it is at hand."""
    ends: ControllerFrames


def opened_calibration(calibration: CalibrationLike) -> OpenedCalibration:
    """A calibration by its folder or its content; errors as of `irbcal.io.opening.open_calibration`."""
    record, opened = open_calibration(calibration), open_robot(calibration)
    if (urdf := opened.urdf_bytes) is None:
        return OpenedCalibration(record, None, unknown_frames())
    links = record.robot.base_link, record.robot.tip_link
    return OpenedCalibration(record, urdf, controller_frames(urdf, "calibrated.urdf", *links))


class OpenedPrograms(NamedTuple):
    """Programs as read for the robot of a calibration."""

    record: Record
    nominal: Arm
    files: languages.ProgramFiles
    programs: Sequence[Program]
    setup: ControllerSetup
    """What the controller computes with."""
    model: ControllerModel | None
    """Where that is not the nominal robot."""
    urdf: bytes | None
    """Of the calibration, where it is at hand."""
    notes: Sequence[Note] = ()
    """What the backup says in which the programs lie."""


def read_programs(
    options: ProgramOptions, files: Sequence[Path], split_points: bool = False, out: str | Path | None = None
) -> OpenedPrograms:
    """Read programs for the robot of a calibration; errors as of `irbcal.correction.filter.correct`.

    Parameters
    ----------
    options : ProgramOptions
    files : sequence of Path
        The programs, unpacked.
    split_points : bool
        See `irbcal.correct`.
    out : str or Path, optional
        What will be written: a folder of that name in one that is searched is no input.
    """
    sources = languages.files_of(files, out)
    language, controller_model = sources.language, options.controller_model
    record, urdf, ends = opened_calibration(options.calibration)
    nominal = record.arm(calibrated=False)
    not_nominal = controller_model is not None and str(controller_model) != NOMINAL
    model = controller_kinematics(str(controller_model), record, urdf) if not_nominal else None
    setup = setup_of(options, language, nominal, ends)
    setup = setup._replace(controller_arm=None if model is None else model.arm, split_points=split_points)
    backup = language.backup(sources.files)
    if backup.accuracy and controller_model is None:
        raise ProgramError(
            f"{backup.accuracy}: fake targets would correct it twice; give what the controller computes with "
            f"(--controller-model), or say --controller-model {NOMINAL} where that is switched off, or the URDF that "
            "was calibrated has these numbers",
            file=sources.files[0],
        )
    notes: list[Note] = []
    if backup.T_world_base is not None:
        x, y, z = backup.T_world_base[:3, 3] / MM
        source = Path(backup.source).name
        place = f"the robot stands at {x:.3f}, {y:.3f}, {z:.3f} mm in the controller's world ({source})"
        notes.append(Note(1, f"{place}: bases and work objects, given ones too, count from the world"))
        setup = setup._replace(T_world_base=backup.T_world_base)
    programs = language.read_for(nominal, sources.files, setup)
    return OpenedPrograms(record, nominal, sources, programs, setup, model, urdf, notes)


def setup_of(options: ControllerOptions, language: Language, nominal: Arm, ends: ControllerFrames) -> ControllerSetup:
    """What the caller says of a controller, for programs of a language.

    Raises
    ------
    OptionError
        If a frame is no rigid transform, the pulses are not six numbers, or joints or a pose are none.
    """
    return ControllerSetup(
        tools=frames_by_name(options.tool, "tool"),
        work_objects=frames_by_name(options.wobj, "wobj"),
        controller=ends,
        pulses=pulses_per_degree(options.pulses),
        where=place_pair(options.where, language),
        start=joints_of_place("start", options.start, nominal, language),
        posture=joints_of_place("posture", options.posture, nominal, language),
        instructions={} if options.instructions is None else taught(options.instructions, languages.taught()),
        ignored_calls=tuple(options.ignored_calls),
    )


def place_pair(where: tuple[ArrayLike, ArrayLike] | None, language: Language) -> tuple[FloatArray, FloatArray] | None:
    """Joints and the pose that the controller reports there, from the caller.

    Raises
    ------
    OptionError
        If they are none, or the language asks for none.
    """
    if where is None:
        return None
    if language.maker is None or not language.maker.asks_where:
        raise OptionError(f"where: {language.name} programs need no pair of joints and pose", parameter="where")
    try:
        joints, pose = np.array(where[0], dtype=float), np.array(where[1], dtype=float)
    except (TypeError, ValueError, IndexError):
        joints, pose = np.zeros(0), np.zeros(0)
    if joints.shape != (6,) or pose.shape != (4, 4) or not (np.isfinite(joints).all() and np.isfinite(pose).all()):
        raise OptionError("where: expected joints of shape (6,) and a pose of shape (4, 4)", parameter="where")
    return joints, frames_by_name({"pose": pose}, "where")["pose"]


def joints_of_place(name: str, q: ArrayLike | None, nominal: Arm, language: Language) -> FloatArray | None:
    """Joints of the URDF from those of the controller (6,), radians; None where there are none.

    Raises
    ------
    OptionError
        If they are not six numbers, or beyond the limits of the arm.
    """
    if q is None:
        return None
    try:
        joints = np.array(q, dtype=float)
    except (TypeError, ValueError):
        joints = np.zeros(0)
    if not nominal.six_revolute:
        message = f"{name} is for arms with six revolute joints, {nominal.name} has {nominal.joints_listed}"
        raise OptionError(message, parameter=name)
    if joints.shape != (6,):
        raise OptionError(f"{name}: expected six joints, found {excerpt(q)}", parameter=name)
    maker = language.maker
    joints = nominal.from_controller(joints[None])[0] if maker is None else maker.for_arm(nominal).joints(joints)
    if not ((joints >= nominal.lower - FAR_BEYOND_LIMIT) & (joints <= nominal.upper + FAR_BEYOND_LIMIT)).all():
        raise OptionError(f"{name}: the joints are beyond the limits of {nominal.name}", parameter=name)
    return joints


def fingerprints_of(program: str | Path) -> dict[str, str | None]:
    """Fingerprint of the calibration that programs were filtered with, file by file.

    Parameters
    ----------
    program : str or Path
        As `correct` takes and writes it: a file, or a folder or zip archive with programs of one language.

    Returns
    -------
    dict of str to str or None
        Name of the file (in the folder) -> ``Record.fingerprint`` of that calibration; None for a file that bears no
        mark, an empty text where the mark does not say which calibration it was.

    Raises
    ------
    ProgramError
        If it cannot be read as a program.
    """
    with unpacked([program]) as files:
        given = languages.files_of(files.programs)
        return {
            place.as_posix(): given.language.fingerprint(read_bytes(path), str(path))
            for path, place in given.relative.items()
        }
