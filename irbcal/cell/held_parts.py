"""Parts that the robot holds, brought to a tool that stands: about where they are, by one linear system.

At a touch a vector ``u`` of the tip link meets a place ``v``: ``R u + t = v``. The tip of a tool is such a ``u``, a
place such a ``v``; a point with coordinates c of a part (work object, fixed tool) is ``p + M c``, p and M being
its origin and axes; any other point is a vector of its own. Linear in all of them, the touches give a start for the
adjustment (`irbcal.cell.frames_from_touches`), in which M is a rotation.

The frames of a motion with a held part are those of an ordinary one, seen from the other side: a target ``P`` is the
pose of the fixed tool in the part, ``T_base_tip T_tip_part P = T_base_tool``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import HELD_PART, TOOL, Touch
from irbcal.modeling import frames


def start_of_held_parts(touches: Sequence[Touch], T_root_tip: FloatArray) -> dict[tuple[str, str], FloatArray]:
    """About where held parts are in the tip link, and tips of fixed tools in the frame that stands still.

    Parameters
    ----------
    touches : sequence of Touch, length n
    T_root_tip : ndarray, shape (n, 4, 4)
        The tip link at the touches, metres.

    Returns
    -------
    dict of (str, str) to ndarray, shape (4, 4)
        By kind and name, metres; fixed tools without axes. Empty where no part is held.
    """
    touches_of_parts = [touch for touch in touches if touch.frame == HELD_PART and touch.tracker is None]
    if not touches_of_parts:
        return {}
    columns: dict[tuple[str, ...], int] = {}
    rows, right = [], []
    for touch, T in zip(touches, T_root_tip, strict=True):
        if touch.tracker is not None or touch.kind != "point" or (touch.frame == TOOL and touch.point in ("x", "xy")):
            continue
        carried = _point(touch) if touch.frame == HELD_PART else {touch.on_flange: 1.0}
        stands = {touch.standing: 1.0} if touch.frame == HELD_PART else _point(touch)
        rows.append(
            [(columns.setdefault(name, len(columns)), size * T[:3, :3]) for name, size in carried.items()]
            + [(columns.setdefault(name, len(columns)), -size * np.eye(3)) for name, size in stands.items()]
        )
        right.append(-T[:3, 3])
    A = np.zeros((len(rows), 3, len(columns), 3))
    for k, row in enumerate(rows):
        for at, matrix in row:
            A[k, :, at] = matrix
    x = np.linalg.lstsq(A.reshape(3 * len(rows), -1), np.concatenate(right), rcond=1e-9)[0].reshape(-1, 3)
    vectors = {name: x[at] for name, at in columns.items()}
    out = {name: frames.transform(None, vectors[name]) for name in (touch.standing for touch in touches_of_parts)}
    for part in dict.fromkeys(touch.on_flange for touch in touches_of_parts):
        of_part = [touch for touch in touches_of_parts if touch.on_flange == part]
        points = {touch.point: sum(size * vectors[name] for name, size in _point(touch).items()) for touch in of_part}
        xyz_of_point = {touch.point: np.zeros(3) if touch.xyz is None else touch.xyz for touch in of_part}
        if {"origin", "x", "xy"} <= {touch.point for touch in of_part if touch.xyz is None}:
            o, along, over = (np.asarray(points[name]) for name in ("origin", "x", "xy"))
            ex = (along - o) / max(float(np.linalg.norm(along - o)), 1e-12)
            forward = float((over - o) @ ex)
            xyz_of_point["x"] = np.array([np.linalg.norm(along - o), 0.0, 0.0])
            xyz_of_point["xy"] = np.array([forward, np.linalg.norm(over - o - forward * ex), 0.0])
        out[part] = frames.rigid_fit(np.array([*xyz_of_point.values()]), np.array([*points.values()]))
    return out


def _point(touch: Touch) -> dict[tuple[str, ...], float]:
    """The point of a touch's frame as a sum of unknown vectors."""
    name = touch.frame, touch.name
    if touch.xyz is None:
        return {name if touch.frame != TOOL and touch.point == "origin" else (*name, "at", touch.point): 1.0}
    return {name: 1.0} | {(*name, f"axis {k}"): float(size) for k, size in enumerate(touch.xyz)}
