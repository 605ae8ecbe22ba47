"""Samples of the ROS package robot_calibration in a bag of ROS 2: joints, and points that two sensors have of each.

One sensor is a camera, whose points are corners in pixels (``z`` is 0) or places in its own frame (of a depth camera).
The other is a chain of joints: the same points on the board or body that it carries. They are corners of a board in the
pictures of a camera in the hall: the base link is then the camera's, on a neck of the robot too, and the tip link the
one that carries the board. Places are taken as where the camera saw them in its picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import imaging
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.features import given_rows
from irbcal.measurement.input_table import TableLike, TextRow
from irbcal.measurement.lens_formats import ros
from irbcal.measurement.recordings import Recording, rosbag
from irbcal.modeling.arm import Arm
from irbcal.units import MM

DESCRIPTION = "samples of robot_calibration in a bag"
PACKAGE = "robot_calibration_msgs/msg/"
SAMPLE = f"{PACKAGE}CalibrationData"
DEFINITIONS = {
    SAMPLE: f"sensor_msgs/JointState joint_states\n{PACKAGE}Observation[] observations\n",
    f"{PACKAGE}Observation": "string sensor_name\ngeometry_msgs/PointStamped[] features\n"
    f"{PACKAGE}ExtendedCameraInfo ext_camera_info\nsensor_msgs/PointCloud2 cloud\nsensor_msgs/Image image\n",
    f"{PACKAGE}ExtendedCameraInfo": f"sensor_msgs/CameraInfo camera_info\n{PACKAGE}CameraParameter[] parameters\n",
    f"{PACKAGE}CameraParameter": "string name\nfloat64 value\n",
}
"""Of the messages, where the bag does not hold them."""
OF_PLACES_U95 = 0.6
"""Of corners that are places of a depth camera: those of whole pixels, pixels."""


def read(path: Path, features: TableLike | None, arm: Arm | None = None) -> Recording | None:
    """The recording; None where this is no bag with such samples."""
    if not rosbag.is_bag(path):
        return None
    with rosbag.opened(path, DEFINITIONS) as bag:
        if not any(connection.msgtype == SAMPLE for connection in bag.connections):
            return None
        if arm is None:
            raise OptionError("robot: name the robot whose joints the bag has", parameter="robot")
        connections = [connection for connection in bag.connections if connection.msgtype == SAMPLE]
        taken = [bag.deserialize(data, connection.msgtype) for connection, _, data in bag.messages(connections)]
        return _recorded(taken, arm, features, str(path))


def _recorded(samples: list[Any], arm: Arm, features: TableLike | None, source: str) -> Recording:
    tables: list[pd.DataFrame] = []
    cameras: dict[str, dict[str, str]] = {}
    without = 0
    for k, sample in enumerate(samples, 1):
        position = dict(zip(sample.joint_states.name, sample.joint_states.position, strict=False))
        missing = [name for name in arm.joint_names if name not in position]
        if missing:
            listed = ", ".join(sorted(position)) or "none"
            raise MeasurementError(f"sample {k}: no joint {missing[0]}; found {listed}", file=source)
        joints = {
            column: position[name] / unit
            for column, name, unit in zip(arm.joint_columns, arm.joint_names, arm.joint_units, strict=True)
        }
        tables_before = len(tables)
        for camera, chain in _pairs(sample.observations):
            pixels, u95, lens = _in_picture(camera, source)
            on_chain = _points(chain.features)
            good = np.isfinite(pixels).all(axis=1) & np.isfinite(on_chain).all(axis=1)
            if not imaging.tell_a_place(on_chain[good]):
                continue
            cells = dict(zip(POSITION, on_chain[good].T / MM, strict=True))
            cells |= dict(zip(("u_px", "v_px"), pixels[good].T, strict=True))
            ends = {"feature": str(camera.sensor_name), "target": str(chain.sensor_name)}
            tables.append(pd.DataFrame({"pose": f"sample {k}", **ends, **joints, **cells}))
            cameras.setdefault(ends["feature"], {**ends, "kind": "image", **lens, "u95_px": repr(u95)})
        without += len(tables) == tables_before
    if not tables:
        raise MeasurementError(
            f"in none of {len(samples)} samples a camera and a chain have {imaging.FEWEST_CORNERS} points that are not "
            "on a line",
            file=source,
        )
    note = f"{len(samples) - without} of {len(samples)} samples have points of a camera and of a chain"
    rows = list(cameras.values()) if features is None else _with_lenses(given_rows(features), cameras)
    return Recording(pd.concat(tables, ignore_index=True), pd.DataFrame(rows).fillna(""), notes=(note,))


def _with_lenses(rows: Sequence[TextRow], cameras: Mapping[str, Mapping[str, str]]) -> Sequence[dict[str, str]]:
    """Features with the samples' lenses, where they do not say one."""
    for row in rows:
        lens = cameras.get(imaging.camera_and_board(row)[0], {}) if row["kind"] in imaging.TARGETS else {}
        if not row.get(imaging.LENS[0]):
            row |= {name: lens[name] for name in (*imaging.LENS, *imaging.SIZE, "u95_px") if name in lens}
    return rows


def _pairs(observations: list[Any]) -> list[tuple[Any, Any]]:
    """Cameras, which say their lens, each with the next sensor that has as many points."""
    lenses = [rosbag.lens_fields(observation.ext_camera_info.camera_info) for observation in observations]
    is_camera = [lens["k"][0] > 0.0 for lens in lenses]
    out = []
    for camera, sees in zip(observations, is_camera, strict=True):
        others = [each for each, also in zip(observations, is_camera, strict=True) if not also]
        chain = next((each for each in others if len(each.features) == len(camera.features)), None)
        if sees and chain is not None and len(camera.features):
            out.append((camera, chain))
    return out


def _points(stamped: list[Any]) -> Any:
    return np.array([[each.point.x, each.point.y, each.point.z] for each in stamped], dtype=float)


def _in_picture(camera: Any, source: str) -> tuple[Any, float, dict[str, str]]:
    """Pixels of a camera's points (n, 2), their uncertainty, and the lens as columns of the features' file."""
    info = camera.ext_camera_info.camera_info
    try:
        known = ros.read(rosbag.lens_fields(info))
        ((numbers, size),) = (known or {}).values()
    except ValueError as error:
        raise MeasurementError(f"{camera.sensor_name}: this is no lens: {error}", file=source) from None
    points, u95 = _points(camera.features), imaging.PIXEL_U95
    uv = points[:, :2]
    if np.nan_to_num(points[:, 2]).any():  # places: by a pinhole, as depth cameras make them
        numbers, u95 = np.r_[numbers[:4], np.zeros(5)], OF_PLACES_U95
        z = np.where(points[:, 2:] > 0.0, points[:, 2:], np.nan)
        uv = points[:, :2] / z * numbers[:2] + numbers[2:4]
    return uv, u95, imaging.lens_columns(numbers, size)
