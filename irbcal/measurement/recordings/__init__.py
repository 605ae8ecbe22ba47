"""What other programs recorded for hand-eye calibration: one module a format.

A module has ``DESCRIPTION`` and ``read(path, features, arm)``, which gives a `Recording`, or None where path is another
program's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import POSE
from irbcal.measurement.input_table import TableLike, poses_to_frame
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

FORMATS = ("robot_calibration", "rosbag", "opencv", "industrial", "easy_handeye")
FLANGE = [f"flange_{name}" for name in POSE]
"""Columns of the flange in the robot base."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording."""

    rows: TableLike
    """A row a picture or a corner, in irbcal's columns."""
    features: TableLike | None
    """Cameras and boards."""
    images: Path | None = None
    """Folder of the pictures."""
    pictures: Mapping[str, Any] | None = None
    """In place of a folder, by the names in the rows."""
    notes: tuple[str, ...] = ()
    """How it was understood, where that matters."""


def opened(
    measurements: TableLike, features: TableLike | None, images: str | Path | None = None, arm: Arm | None = None
) -> Recording:
    """Measurements of irbcal as they are, a recording of another program as rows, features and pictures.

    Raises
    ------
    MeasurementError
        If it is neither, or features are missing.
    """
    recording = None
    if isinstance(measurements, (str, PathLike)) and _of_other_program(Path(measurements)):
        path = Path(measurements)
        for name in FORMATS:
            recording = import_module(f"irbcal.measurement.recordings.{name}").read(path, features, arm)
            if recording is not None:
                break
        else:
            known = ", ".join(import_module(f"irbcal.measurement.recordings.{name}").DESCRIPTION for name in FORMATS)
            raise MeasurementError(f"expected a table, or {known}", file=str(path))
    if recording is None:
        recording = Recording(measurements, features)
    if recording.features is None:
        raise MeasurementError(
            "name the file that says what camera and board are", parameter="features", file=_name(measurements)
        )
    return recording if images is None else replace(recording, images=Path(images))


def corner_rows(measurements: TableLike, features: TableLike, arm: Arm) -> tuple[TableLike, TableLike]:
    """Rows at features and these, of a recording too, with corners found in its pictures."""
    from irbcal.measurement import pictures

    recording = opened(measurements, features, None, arm)
    assert recording.features is not None
    if recording.pictures is None:
        return recording.rows, recording.features
    cells = recording.rows
    assert isinstance(cells, pd.DataFrame)
    is_picture = cells[pictures.IMAGE].isin(list(recording.pictures))
    shown = pictures.corners_of(recording.pictures.get, cells[is_picture], features, _name(measurements)).to_frame()
    return pd.concat([shown, cells[~is_picture]], ignore_index=True), recording.features


def _of_other_program(path: Path) -> bool:
    """Whether measurements are no table of irbcal's."""
    return path.is_dir() or path.suffix in (".yaml", ".yml", ".json", ".xml", ".samples", ".mcap", ".db3", ".bag")


def transforms(content: list[tuple[str, Mapping[str, Any]]]) -> pd.DataFrame:
    """Poses in metres and unit quaternions under ``x``, ``y``, ``z``, ``qx`` … ``qw`` as columns `POSE`.

    Raises
    ------
    MeasurementError
        If one is none; ``content`` names its file.
    """
    T = np.zeros((len(content), 4, 4))
    for k, (source, pose) in enumerate(content):
        try:
            x, y, z, *q = (float(pose[name]) for name in ("x", "y", "z", "qw", "qx", "qy", "qz"))
        except (KeyError, TypeError, ValueError):
            raise MeasurementError("expected a pose: x, y, z in metres, and qx, qy, qz, qw", file=source) from None
        if not np.isfinite([x, y, z]).all() or not abs(np.linalg.norm(q) - 1.0) < 1e-3:
            raise MeasurementError("expected a unit quaternion qx, qy, qz, qw and finite metres", file=source)
        T[k] = frames.transform(frames.matrix_from_quaternion(np.array(q) / np.linalg.norm(q)), np.array([x, y, z]))
    return poses_to_frame(T)


def _name(measurements: TableLike) -> str:
    return str(measurements) if isinstance(measurements, (str, PathLike)) else "<DataFrame>"
