"""Joint moves as a program of a language, read again before anyone else does."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.commanded import commanded
from irbcal.correction.languages import Language
from irbcal.correction.moves import Moves
from irbcal.correction.program import Given
from irbcal.errors import ProgramError
from irbcal.io import controller_model
from irbcal.modeling.home import DECIMALS
from irbcal.units import DEG


def write(language: Language, moves: Moves) -> dict[str, bytes]:
    """Joint moves as a program.

    Parameters
    ----------
    language : Language
    moves : Moves

    Returns
    -------
    dict of str to bytes
        File name -> content.

    Raises
    ------
    ProgramError
        If the language cannot serve this arm, or has no moves to write, or what was written does not hold the joints.
    """
    if language.write_moves is None:
        raise ProgramError(f"{language.NAME} has no moves to write")
    if language.MAKER is not None:
        language.MAKER.check(moves.arm, moves.arm.name)
    elif not moves.arm.six_revolute:
        raise ProgramError(f"{language.NAME} moves are of six revolute joints, {moves.arm.name} has others")
    contents = {name: text.encode("ascii") for name, text in language.write_moves(moves).items()}
    given = Given({}, {}, controller_model.unknown_frames(), moves.pulses)
    with tempfile.TemporaryDirectory() as folder:
        for name, data in contents.items():
            (Path(folder) / name).write_bytes(data)
        files = [path for path in sorted(Path(folder).iterdir()) if path.suffix.lower() in language.ENDINGS]
        q = np.concatenate([commanded(one, moves.arm) for one in language.read_for(moves.arm, files, given)])
    if q.shape != moves.q.shape or (np.abs(q - moves.q) > _printed(moves)).any():
        raise ProgramError(f"the {language.NAME} program does not hold the joints that were to be written")
    return contents


def _printed(moves: Moves) -> FloatArray:
    """By how much joints that are read may differ from those that were to be written, radians, shape (6,)."""
    digits = np.full(6, 2.0 * 0.5 * 10.0**-DECIMALS * DEG)  # twice: a coupled joint is the sum of two
    if not moves.pulses:
        return digits
    return digits + 0.5 * DEG / np.abs(np.array(moves.pulses))
