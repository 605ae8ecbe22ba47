"""Boards in files: a target of Kalibr's, a target finder of industrial_calibration's, markers on a body (CSV)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.measurement.boards import MarkerBody
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable
from irbcal.safe_files import read_bytes
from irbcal.units import MM

SQUARE = 0.05
"""Share by which the sides of a marker on a body may differ."""
FINDER, STATIC = "target_finder", "static_camera"
DICTIONARIES = (
    *(f"DICT_{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11",
)
"""OpenCV's numbers of its dictionaries."""


def is_board(content: Any) -> bool:
    """Whether the content of a YAML file is another program's board."""
    return isinstance(content, dict) and bool({FINDER, "target_type", "type"} & set(content))


def board(content: Any, source: str) -> dict[str, str]:
    """A board as the columns of a features' file.

    Parameters
    ----------
    content : object
        Of the YAML file.
    source : str
        For messages.

    Raises
    ------
    MeasurementError
        If it is none, or one that irbcal does not find in pictures.
    """
    finder = content.get(FINDER, content) if isinstance(content, dict) else None
    if not isinstance(finder, dict):
        raise MeasurementError("expected a board: a target of Kalibr's or a target_finder", file=source)
    try:
        cells = _kalibr(finder) if "target_type" in finder else _industrial(finder)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise MeasurementError(f"this board is not understood: {error}", file=source) from None
    return cells


def marker_body(path: Path, dictionary: str) -> MarkerBody:
    """Markers on a body, from a table with ``marker``, ``x_mm``, ``y_mm``, ``z_mm``: four rows a marker.

    Raises
    ------
    MeasurementError
        If a marker has not four rows, or these are not the corners of a square.
    """
    table = InputTable.read(path, ["marker", *POSITION])
    xyz = np.column_stack([table.numbers(name) for name in POSITION]) * MM
    number = table.numbers("marker")
    for k in np.flatnonzero((number < 0) | (number != np.floor(number))):
        raise table.fault(f"expected the number of a marker, found {number[k]:g}", int(k), "marker")
    markers, corners = list(dict.fromkeys(number.astype(int).tolist())), []
    for marker in markers:
        rows = np.flatnonzero(number == marker)
        if len(rows) != 4:
            raise table.fault(
                f"marker {marker} has {len(rows)} rows, expected its four corners", int(rows[0]), "marker"
            )
        sides, diagonals = (np.linalg.norm(np.roll(xyz[rows], -k, axis=0) - xyz[rows], axis=1) for k in (1, 2))
        if not np.allclose(np.r_[sides, diagonals / np.sqrt(2.0)], sides[0], rtol=SQUARE, atol=0.0) or not sides[0]:
            raise table.fault(
                f"the corners of marker {marker} are no square in this order: expected them clockwise from the upper "
                "left one, as the marker is seen upright",
                int(rows[0]),
                "marker",
            )
        corners.append(xyz[rows])
    return MarkerBody(tuple(markers), np.concatenate(corners), dictionary)


def yaml_of(path: Path, data: bytes | None = None) -> Any:
    """Content of a YAML file, or of bytes in place of its own.

    Raises
    ------
    MeasurementError
        If it is none.
    """
    import yaml

    try:
        return yaml.safe_load((read_bytes(path, MeasurementError) if data is None else data).decode("utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MeasurementError(f"expected YAML, found {str(error).splitlines()[0]}", file=str(path)) from None


def feature(board_cells: Mapping[str, str], static: bool) -> dict[str, str]:
    """A feature of one camera and one board: where the camera is decides which of them is the feature."""
    if static:
        return {"feature": "camera", "kind": "image", "target": "board", **board_cells}
    return {"feature": "board", "kind": "image-on-tool", "target": "camera", **board_cells}


def _kalibr(target: Mapping[str, Any]) -> dict[str, str]:
    kind, across, along = (target.get(name) for name in ("target_type", "targetCols", "targetRows"))
    if kind == "checkerboard":  # counted by inner corners
        if target["rowSpacingMeters"] != target["colSpacingMeters"]:
            raise ValueError("squares are no squares")
        return _cells("chessboard", int(across or 0) + 1, int(along or 0) + 1, target["rowSpacingMeters"])
    if kind == "circlegrid":  # in a row of an asymmetric grid neighbours are two spacings apart
        pattern, spacings = ("circles-staggered", 2) if target.get("asymmetricGrid") else ("circles", 1)
        return _cells(pattern, int(across or 0), int(along or 0), spacings * float(target["spacingMeters"]))
    if kind == "aprilgrid":
        side = float(target["tagSize"])
        cells = _cells("aprilgrid", target["tagCols"], target["tagRows"], side * (1.0 + float(target["tagSpacing"])))
        return cells | {"marker_mm": f"{1e3 * side:.9g}", "dictionary": "DICT_APRILTAG_36h11"}
    raise ValueError(f"{kind} of Kalibr's, expected an aprilgrid, a checkerboard or a circlegrid")


def _industrial(finder: Mapping[str, Any]) -> dict[str, str]:
    kind = str(finder.get("type", "nothing")).rpartition("::")[2].removesuffix("Plugin")
    if kind == "CharucoGridTargetFinder":
        cells = _cells("charuco", finder["cols"], finder["rows"], finder["chessboard_dim"])
        number = int(finder["dictionary"])
        if number < 0:
            raise ValueError(f"dictionary {number}")
        marker = 1e3 * float(finder["aruco_marker_dim"])
        return cells | {"marker_mm": f"{marker:.9g}", "dictionary": DICTIONARIES[number]}
    raise ValueError(f"{kind}, expected CharucoGridTargetFinder; write the board as a feature where it is another")


def _cells(pattern: str, across: Any, along: Any, pitch_m: Any) -> dict[str, str]:
    counts = {"squares_x": str(int(across)), "squares_y": str(int(along))}
    return {"pattern": pattern, **counts, "square_mm": f"{1e3 * float(pitch_m):.9g}"}
