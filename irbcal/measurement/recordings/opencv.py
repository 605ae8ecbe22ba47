"""Poses in OpenCV's FileStorage (YAML, JSON, XML) under the names of the arguments of its ``calibrateHandEye``.

``R_gripper2base`` and ``t_gripper2base`` (or ``R_base2gripper`` …) are sequences of matrices, a pose each, metres, and
so are ``R_target2cam`` and ``t_target2cam`` (or ``R_cam2target`` …); rotations are matrices or rotation vectors. Each
is what its name says: with a camera in the hall, too, ``gripper2base`` is the flange in the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement.input_table import TableLike
from irbcal.measurement.lens_formats import content_of
from irbcal.measurement.recordings import Recording
from irbcal.measurement.recordings.easy_handeye import of_markers
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

DESCRIPTION = "poses in OpenCV's FileStorage"
PAIRS = ("gripper2base", "base2gripper"), ("target2cam", "cam2target")
"""Names of the poses of flange and board, and of their inverses."""


def read(path: Path, features: TableLike | None, arm: Arm | None = None) -> Recording | None:
    """The recording; None where these are no such poses."""
    content = None if path.is_dir() or path.suffix == ".samples" else content_of(path)
    if not isinstance(content, dict) or not any(f"R_{name}" in content for pair in PAIRS for name in pair):
        return None
    T_flange, T_board = (_poses(content, *pair, str(path)) for pair in PAIRS)
    if len(T_flange) != len(T_board):
        raise MeasurementError(
            f"expected as many poses of the board as of the flange, {len(T_flange)}, found {len(T_board)}",
            file=str(path),
        )
    return of_markers(path, features, T_flange, T_board)


def _poses(content: Mapping[str, Any], name: str, inverse: str, source: str) -> FloatArray:
    """Poses under a name, or the inverses of those under the other, (n, 4, 4)."""
    label = name if f"R_{name}" in content else inverse
    R, t = (content.get(f"{letter}_{label}") for letter in "Rt")
    if not isinstance(R, list) or not isinstance(t, list) or len(R) != len(t) or not R:
        raise MeasurementError(f"expected R_{name} and t_{name}, as many matrices each", file=source)
    out = np.tile(np.eye(4), (len(R), 1, 1))
    for k, (turn, shift) in enumerate(zip(R, t, strict=True)):
        try:
            numbers, at = (np.array(each["data"], dtype=float).ravel() for each in (turn, shift))
            turned = frames.rotation_from_vector(numbers) if numbers.size == 3 else numbers.reshape(3, 3)
            out[k] = frames.transform(turned, at.reshape(3))
        except (KeyError, TypeError, ValueError):
            turned = np.zeros((3, 3))
        if not np.isfinite(out[k]).all() or not np.allclose(turned @ turned.T, np.eye(3), rtol=0, atol=1e-3):
            raise MeasurementError(
                f"pose {k + 1} of {label}: expected a rotation (3 x 3, or a vector) and a translation in metres",
                file=source,
            )
        out[k, :3, :3] = frames.nearest_rotation(turned)
    return out if label == name else np.asarray(frames.inverse(out))
