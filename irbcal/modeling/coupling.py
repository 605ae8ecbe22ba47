"""Coupled joints: controllers that count a joint with another one in it.

FANUC pendants show joint 3 against the ground, and so do the controllers of arms whose joint 3 is driven by a
parallelogram. The joints of a URDF turn against the link before. A coupling is the matrix between the two, ``q_urdf = C
q_controller``; ``3+2`` says that joint 2 is to be added to the controller's joint 3. Files, commands and programs hold
the controller's joints, everything inside (and arrays in Python) those of the URDF.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.option_values import excerpt

LARGEST = 10.0
"""Size of a factor that no gear between two joints has."""

EXPECTED_TEXT = "expected terms such as 3+2 (joint 2 is added to the controller's joint 3), 6-0.5*5, or a matrix"


def matrix(value: object, joints: int, source: str | None = None) -> FloatArray | None:
    """The matrix of a coupling, as people write it.

    Parameters
    ----------
    value : str, array_like of shape (joints, joints), or None
        ``3+2``; several terms with commas between them, each with an optional factor: ``3+2, 6-0.5*5``.
    joints : int
        Of the arm.
    source : str, optional
        File name for messages.

    Returns
    -------
    ndarray, shape (joints, joints), or None
        ``q_urdf = C q_controller``; None where that is the identity.

    Raises
    ------
    RobotError
        If it is not understood, or cannot be turned around.
    """
    if value is None:
        return None
    C = _of_terms(value, joints, source) if isinstance(value, str) else _of_rows(value, joints, source)
    if np.linalg.cond(C) > 1e3:
        raise RobotError("coupling: the matrix cannot be inverted", file=source, parameter="coupling")
    return None if np.array_equal(C, np.eye(joints)) else C


def from_controller(p: FloatArray, matrix: FloatArray | None) -> FloatArray:
    """The arm's joints (n, joints) from those that its controller counts."""
    return p if matrix is None else np.asarray(p @ matrix.T)


def to_controller(q: FloatArray, matrix: FloatArray | None) -> FloatArray:
    """Joints (n, joints) as the controller counts them, from the arm's."""
    return q if matrix is None else np.asarray(q @ np.linalg.inv(matrix).T)


def _of_terms(text: str, joints: int, source: str | None) -> FloatArray:
    C: FloatArray = np.eye(joints)
    for term in filter(None, (term_text.strip() for term_text in text.split(","))):
        match = re.fullmatch(r"(\d{1,2})\s*([+-])\s*(?:(\d{1,2}(?:\.\d{1,9})?)\s*\*\s*)?(\d{1,2})", term)
        if match is None:
            raise RobotError(f"coupling: {EXPECTED_TEXT}, found {excerpt(term)}", file=source, parameter="coupling")
        to, by = int(match[1]), int(match[4])
        if not (1 <= to <= joints and 1 <= by <= joints and to != by):
            raise RobotError(
                f"coupling: expected two different joints from 1 to {joints}, found {term}",
                file=source,
                parameter="coupling",
            )
        C[to - 1, by - 1] += float(match[3] or 1.0) * (1.0 if match[2] == "+" else -1.0)
    return C


def _of_rows(rows: object, joints: int, source: str | None) -> FloatArray:
    try:
        C = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        C = np.zeros(0)
    if C.shape != (joints, joints) or not np.isfinite(C).all() or np.abs(C).max() > LARGEST:
        raise RobotError(
            f"coupling: {EXPECTED_TEXT} of {joints} by {joints} numbers, found {excerpt(rows)}",
            file=source,
            parameter="coupling",
        )
    return C


def in_words(C: FloatArray) -> str:
    """A coupling as `matrix` reads it, for people; a matrix with other numbers on its diagonal row by row."""
    if not (np.diag(C) == 1.0).all():
        return "; ".join(" ".join(f"{value:g}" for value in row) for row in C)
    terms = []
    for to, by in np.argwhere(C - np.eye(len(C))):
        size = abs(C[to, by])
        terms.append(f"{to + 1}{'+' if C[to, by] > 0 else '-'}{'' if size == 1.0 else f'{size:g}*'}{by + 1}")
    return ", ".join(terms)


def rows(C: FloatArray | None) -> Sequence[Sequence[float]] | None:
    """For files: the matrix as lists; None for none."""
    return None if C is None else [[float(value) for value in row] for row in C]
