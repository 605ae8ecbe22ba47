"""Corners of boards found in pictures: of a folder with a table of joints, or of a bag with the robot that it has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import RobotLike, open_robot
from irbcal.measurement.input_table import TableLike
from irbcal.measurement.pictures import IMAGE, FoundCorners, corners_of, read_picture
from irbcal.measurement.recordings import rosbag


def corners(
    images: str | Path,
    joints: TableLike | None = None,
    features: TableLike | None = None,
    *,
    robot: RobotLike | None = None,
) -> FoundCorners:
    """Find the corners of boards in pictures.

    Parameters
    ----------
    images : str or Path
        Folder of the pictures (PNG, JPEG, TIFF, ...), or a bag of ROS 2 or 1 with joint states and pictures.
    joints : str, Path or DataFrame, optional
        Of a folder. A row a picture: ``image`` (its file's name), joints (``q1_deg`` ...), and what the rows shall have
        besides: ``pose`` (the picture's name unless given), ``feature``, and what names of features are made of, as
        ``place``.
    features : str, Path or DataFrame
        The features' file of the calibration (`irbcal.measurement.imaging`); boards with markers have ``dictionary``
        (OpenCV's name, such as ``DICT_5X5_100``) and ``marker_mm`` (three quarters of the square unless given), too.
    robot : str, Path, Record, a result that holds one, or Opened, optional
        Whose joints a bag has: calibration folder, URDF or name, see `irbcal.forward_kinematics`.

    Raises
    ------
    MeasurementError
        If a file does not keep its format, a picture cannot be read, or there is no board in any.
    OptionError
        If OpenCV is not installed.
    """
    folder = Path(images)
    if features is None:
        raise OptionError("features: name the file that says what camera and board are", parameter="features")
    recording = rosbag.read(folder, features, None if robot is None else open_robot(robot).nominal)
    if recording is not None:
        rows, pictures = recording.rows, recording.pictures
        assert isinstance(rows, pd.DataFrame)
        if pictures is None:
            raise MeasurementError("there are no pictures in the bag while the robot stood", file=str(folder))
        rows = rows[rows[IMAGE].isin(list(pictures))].dropna(axis=1)
        return replace(corners_of(pictures.get, rows, features, str(folder)), understood=recording.notes)
    if joints is None:
        raise OptionError("joints: name the table that has the joints of each picture", parameter="joints")
    return corners_of(lambda picture: read_picture(folder / picture), joints, features, str(folder))
