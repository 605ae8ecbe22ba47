"""Frames of RAPID tools and work objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.languages.rapid.parts import ABSENT, Data
from irbcal.correction.languages.rapid.syntax import Reader
from irbcal.correction.languages.rapid.tokens import decode
from irbcal.correction.notation import poses_from_numbers, quaternion_problem
from irbcal.errors import ProgramError


def given_frames(identity: str, frames: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Frames that the caller gives, by names in lower case, and the one that is always there.

    Parameters
    ----------
    identity : str
        ``tool0`` or ``wobj0``.
    frames : dict of str to ndarray, shape (4, 4)

    Returns
    -------
    dict of str to ndarray, shape (4, 4)
    """
    out = {identity: np.eye(4)}
    for name, T in frames.items():
        out[name.lower()] = np.array(T, dtype=float)
        if out[name.lower()].shape != (4, 4) or not np.isfinite(out[name.lower()]).all():
            raise ValueError(f"frame {name}: expected a transform of shape (4, 4)")
    return out


def read_frame(reader: Reader, data: Data, line: int) -> FloatArray:
    """Frame of a tool on the flange or of a work object in the base.

    Parameters
    ----------
    reader : Reader
    data : Data
        Of the type ``tooldata`` or ``wobjdata``.
    line : int
        Of the move that needs it.

    Returns
    -------
    ndarray, shape (4, 4)
        ``T_tip_tcp``, or ``T_base_wobj`` = user frame times object frame; metres.

    Raises
    ------
    ProgramError
        If it does not stand there in numbers, or is of a kind that is not supported.
    """
    tool = data.type == "tooldata"
    what = f"{'tool' if tool else 'work object'} {data.spelling}"
    items = data.node.items if data.node is not None else None
    if items is None or len(items) != (3 if tool else 5):
        raise reader.error(data.start, f"{what} has no frame in numbers, but line {line} uses it: give its frame")
    words = [reader.text[item.start : item.end].lower() for item in items]
    if words[0] != ("true" if tool else "false"):
        held = "is not held by the robot" if tool else "is held by the robot"
        raise reader.error(data.start, f"{what} {held} (robhold {words[0].upper()}): this is not supported")
    if not tool and words[1] != "true":
        moved = f"is moved by a mechanical unit (ufprog {words[1].upper()})"
        raise reader.error(data.start, f"{what} {moved}: this is not supported")
    T = np.eye(4)
    for node in items[1:2] if tool else items[3:5]:
        parts = [part.items or [] for part in node.items or []]
        leaves = [leaf.number for part in parts for leaf in part if leaf.number is not None]
        if [len(part) for part in parts] != [3, 4] or len(leaves) < 7:
            expected = "a frame [[x, y, z], [q1, q2, q3, q4]] in numbers"
            found = reader.quote(node.start, node.end)
            raise reader.error(node.start, f"{what}: expected {expected}, found {found}")
        too_large = "found a number that is too large" if max(map(abs, leaves)) >= ABSENT else None
        problem = too_large or quaternion_problem(leaves[3:])
        if problem:
            raise reader.error(node.start, f"{what}: {problem}")
        T = T @ poses_from_numbers(leaves)[0]
    return T


def shared_frames(contents: Sequence[tuple[bytes, str]]) -> dict[str, dict[str, dict[str, FloatArray]]]:
    """Tools and work objects that modules define in numbers, by file, by type and by name.

    Raises
    ------
    ProgramError
        If one is no RAPID module.
    """
    out = {}
    for data, source in contents:
        reader = Reader(decode(data, source)[0], source)
        reader.read()
        found: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
        for name, item in reader.data.items():
            if item.type in found:
                with suppress(ProgramError):  # refused where a move needs it
                    found[item.type][name] = read_frame(reader, item, reader.line(item.start))
        out[source] = found
    return out
