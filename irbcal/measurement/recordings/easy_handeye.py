"""easy_handeye2: samples of the robot's and a marker's pose, and the result that its publisher reads.

A sample has ``robot`` and ``tracking``, each a translation in metres and a quaternion. With the camera on the hand
robot is the flange in the base, with the camera in the hall the base in the flange (as the program's sampler writes
it); the samples do not say which, a ``.calib`` of their name does. The marker's pose stands for four corners of a
square as a camera sees them, so that all of hand-eye calibration takes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement import imaging
from irbcal.measurement.board_formats import yaml_of
from irbcal.measurement.column_names import POSE
from irbcal.measurement.features import given_rows
from irbcal.measurement.input_table import InputTable, TableLike, poses_to_frame
from irbcal.measurement.recordings import FLANGE, Recording, transforms
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import MM

DESCRIPTION = "samples of easy_handeye2"
TYPES: Mapping[str, str] = {"eye_in_hand": "image-on-tool", "eye_on_base": "image"}
SIDE = 100 * MM
"""Of the square whose corners stand for a marker's pose."""
FOCAL = 1000.0
"""Of the camera that sees them, pixels: a pixel is a milliradian."""
SQUARE = 0.5 * SIDE * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])


def read(path: Path, features: TableLike | None, arm: Arm | None = None) -> Recording | None:
    """The recording; None where these are no samples."""
    if path.is_dir():
        return None
    content = yaml_of(path)
    samples = content.get("samples") if isinstance(content, dict) else None
    if not isinstance(samples, list) or not samples:
        return None
    robot, marker = (
        transforms([(str(path), _flat(sample, name)) for sample in samples]) for name in ("robot", "tracking")
    )
    T_flange, T_marker = (InputTable(poses, str(path)).poses() for poses in (robot, marker))
    if _feature(path, features)["kind"] == TYPES["eye_on_base"]:
        T_flange = frames.inverse(T_flange)
    return of_markers(path, features, T_flange, T_marker)


def of_markers(path: Path, features: TableLike | None, T_flange: FloatArray, T_marker: FloatArray) -> Recording:
    """Poses (n, 4, 4) of the flange in the base and of a marker in the camera as corners of a square."""
    row = _feature(path, features)
    corners = SQUARE @ T_marker[:, :3, :3].transpose(0, 2, 1) + T_marker[:, None, :3, 3]
    if not (corners[:, :, 2] > 0.0).all():
        k = int(np.flatnonzero(~(corners[:, :, 2] > 0.0).all(axis=1))[0])
        raise MeasurementError(f"sample {k + 1}: the marker is not in front of the camera", file=str(path))
    return Recording(_rows(T_flange, corners, row["feature"]), pd.DataFrame([row]), notes=(NOTE,))


NOTE = (
    "poses of markers stand for the corners of a square of 100 mm in a camera of 1000 px focal length: a pixel is a "
    "milliradian of the view"
)


def _rows(T_flange: FloatArray, corners: FloatArray, feature: str) -> pd.DataFrame:
    """A row a corner."""
    n = len(T_flange)
    uv = FOCAL * corners[:, :, :2] / corners[:, :, 2:]
    of = np.repeat(np.arange(n), len(SQUARE))
    rows = poses_to_frame(T_flange).iloc[of].reset_index(drop=True)
    rows = rows.rename(columns=dict(zip(POSE, FLANGE, strict=True)))
    xy = np.tile(SQUARE[:, :2], (n, 1)) / MM
    more = {"pose": [f"sample {k + 1}" for k in of], "feature": feature, "x_mm": xy[:, 0], "y_mm": xy[:, 1]}
    return rows.assign(**more, u_px=uv[:, :, 0].ravel(), v_px=uv[:, :, 1].ravel())


def _flat(sample: Any, name: str) -> dict[str, Any]:
    """A transform as ``x`` … ``qw``; what is missing is told by who reads it."""
    pose = sample.get(name) if isinstance(sample, dict) else None
    place, turn = (pose.get(key) if isinstance(pose, dict) else None for key in ("translation", "rotation"))
    if not isinstance(place, dict) or not isinstance(turn, dict):
        return {}
    return place | {f"q{axis}": value for axis, value in turn.items()}


def _feature(path: Path, features: TableLike | None) -> dict[str, str]:
    """Camera and marker, by the features' file, or by a result of the same name."""
    lens = dict(zip(imaging.LENS, [f"{FOCAL}", f"{FOCAL}", *["0"] * 7], strict=True))
    if features is not None:
        rows = [row for row in given_rows(features) if row["kind"] in imaging.TARGETS]
        if len(rows) != 1:
            raise MeasurementError("expected one feature, of kind image or image-on-tool", file=str(features))
        imaging.shared(rows)
        return {name: rows[0][name] for name in ("feature", "kind", "target")} | lens
    for folder in (path.parent, path.parent.parent / "calibrations"):
        result = folder / f"{path.stem}.calib"
        if not result.is_file():
            continue
        content = yaml_of(result)
        parameters = content.get("parameters") if isinstance(content, dict) else None
        parameters = parameters if isinstance(parameters, dict) else {}
        kind = TYPES.get(str(parameters.get("calibration_type")))
        if kind is None:
            raise MeasurementError(f"expected calibration_type, one of {', '.join(TYPES)}", file=str(result))
        camera = str(parameters.get("tracking_base_frame") or "camera")
        marker = str(parameters.get("tracking_marker_frame") or "marker")
        pair = (marker, camera) if kind == TYPES["eye_in_hand"] else (camera, marker)
        return {"feature": pair[0], "kind": kind, "target": pair[1]} | lens
    raise MeasurementError(
        f"samples do not say where the camera is: name their {path.stem}.calib beside them, or give a feature of kind "
        "image-on-tool (camera on the hand) or image (camera in the hall)",
        file=str(path),
    )


def result_text(name: str, kind: str, T: FloatArray, frames_of: Mapping[str, str]) -> str:
    """The ``.calib`` file of a camera's place.

    Parameters
    ----------
    name : str
        Of the calibration.
    kind : str
        Of `TYPES`.
    T : ndarray, shape (4, 4)
        The camera in the flange (``image-on-tool``) or in the base, metres.
    frames_of : dict of str to str
        Names of ROS frames: ``base``, ``flange``, ``camera``, ``marker``.
    """
    import yaml

    w, *xyz = (float(value) for value in frames.quaternion_from_matrix(T[None, :3, :3])[0])
    content = {
        "parameters": {
            "name": name,
            "calibration_type": next(key for key, value in TYPES.items() if value == kind),
            "robot_base_frame": frames_of["base"],
            "robot_effector_frame": frames_of["flange"],
            "tracking_base_frame": frames_of["camera"],
            "tracking_marker_frame": frames_of["marker"],
            "freehand_robot_movement": True,
        },
        "transform": {
            "translation": dict(zip("xyz", map(float, T[:3, 3]), strict=True)),
            "rotation": dict(zip("xyzw", [*xyz, w], strict=True)),
        },
    }
    return yaml.safe_dump(content, sort_keys=False)
