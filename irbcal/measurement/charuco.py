"""Corners of ChArUco boards found in images: a folder of pictures and a table of joints become rows.

The finding is OpenCV's; it is not installed with irbcal but with its extra ``camera``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal import safe_files
from irbcal.arrays import NameArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import columns, imaging
from irbcal.measurement.columns import InputTable, TableLike
from irbcal.measurement.features import filled, given_rows
from irbcal.names import csv_bytes
from irbcal.safe_files import libraries_silent
from irbcal.summary import Paragraph, Result
from irbcal.units import MM

IMAGE = "image"
"""The column of the joints' table that names a picture."""

MARKER = 0.75
"""Side of a marker in shares of a square's, unless ``marker_mm`` says it."""


@dataclass(frozen=True, eq=False, repr=False)
class FoundCorners(Result):
    """Corners found in images.

    Attributes
    ----------
    table : DataFrame
        A row a corner: the columns of the joints' table, ``feature``, ``corner``, ``u_px``, ``v_px``.
    images : int
        Images with a board.
    missed : tuple of (str, int)
        Images that are left out, and how many corners were found in them.
    """

    table: pd.DataFrame
    images: int
    missed: tuple[tuple[str, int], ...]

    def to_frame(self) -> pd.DataFrame:
        """The rows as the first file of ``irbcal calibrate --features``."""
        return self.table.copy()

    @property
    def left_out(self) -> list[str]:
        """Names of the images that are left out."""
        return [name for name, _ in self.missed]

    CONTENT = "images corners=table.__len__ left_out"

    def report(self) -> Sequence[Paragraph]:
        """How many corners in how many images, and which images were left out."""
        return [f"{len(self.table)} corners in {self.images} images", *(f"Note: {note}" for note in self.notes())]

    def notes(self) -> list[str]:
        """Which images were left out."""
        if not self.missed:
            return []
        names = ", ".join(f"{name} ({count})" for name, count in self.missed[:10])
        more = f" and {len(self.missed) - 10} more" if len(self.missed) > 10 else ""
        return [f"left out, with fewer than {imaging.FEWEST} corners: {names}{more}"]

    def save(self, out: str | Path) -> Path:
        """Write the rows as CSV.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        out = Path(out)
        data = csv_bytes(self.table)
        safe_files.write_together(out.parent, {out.name: data})
        return out


@dataclass(frozen=True, eq=False)
class _Board:
    """What finds a board; the size of its camera's images in pixels; its name in each row of the joints' table."""

    detector: Any
    size: tuple[int, int] | None
    names: NameArray


def corners(images: str | Path, joints: TableLike, features: TableLike, *, legacy: bool = False) -> FoundCorners:
    """Find the corners of ChArUco boards in pictures.

    Parameters
    ----------
    images : str or Path
        Folder of the pictures (PNG, JPEG, TIFF, ...).
    joints : str, Path or DataFrame
        A row a picture: ``image`` (its file's name), joints (``q1_deg`` ...), and what the rows shall have besides:
        ``pose`` (the picture's name unless given), ``feature``, and what names of features are made of, as ``place``.
    features : str, Path or DataFrame
        The features' file of the calibration (`irbcal.measurement.imaging`); its boards have ``dictionary`` (OpenCV's
        name, such as ``DICT_5X5_100``) and ``marker_mm`` (three quarters of the square unless given), too.
    legacy : bool
        The board is of the pattern that OpenCV drew before version 4.6.

    Raises
    ------
    MeasurementError
        If a file does not keep its format, a picture cannot be read, or there is no board in any.
    OptionError
        If OpenCV is not installed.
    """
    cv2 = _opencv()
    listed = InputTable.read(joints, [IMAGE])
    for name in columns.joint_columns(listed.names):
        listed.numbers(name)
    name_of = str(features) if isinstance(features, (str, Path)) else columns.FRAME
    boards = _boards(cv2, features, name_of, legacy, listed)
    folder = Path(images)
    tables, missed = [], []
    for k, cell in enumerate(listed.cells.to_dict("records")):
        picture = str(cell[IMAGE]).strip()
        feature = str(cell.get("feature", "")).strip() or (next(iter(boards)) if len(boards) == 1 else "")
        one = next((board for name, board in boards.items() if feature in (name, board.names[k])), None)
        if one is None:
            sentence = f"expected the board in this picture, one of {', '.join(boards)}; found {feature or 'nothing'}"
            raise listed.fault(sentence, k, "feature")
        size = one.size
        path = folder / picture
        with libraries_silent():
            grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None  # a pipe would wait for ever
        if grey is None:
            message = f"there is no picture {picture or 'named'} in {folder} that OpenCV reads"
            raise listed.fault(message, k, IMAGE)
        if size is not None and grey.shape[::-1] != size:
            message = f"{picture} has {grey.shape[1]} × {grey.shape[0]} pixels, the camera {size[0]} × {size[1]}"
            raise listed.fault(message, k, IMAGE)
        uv, number, _, _ = one.detector.detectBoard(grey)
        count = 0 if number is None else len(number)
        if count < imaging.FEWEST:
            missed.append((picture, count))
            continue
        more = {"corner": np.ravel(number)} | dict(zip(("u_px", "v_px"), np.reshape(uv, (-1, 2)).T, strict=True))
        tables.append(pd.DataFrame({"pose": picture} | cell | {"feature": one.names[k]} | more))
    if not tables:
        raise MeasurementError(
            f"no picture shows {imaging.FEWEST} corners of its board: are squares_x, squares_y and dictionary right, "
            "or was the board drawn before OpenCV 4.6 (--legacy)?",
            file=name_of,
        )
    table = pd.concat(tables, ignore_index=True)
    table[["u_px", "v_px"]] = table[["u_px", "v_px"]].astype(float).round(4)
    return FoundCorners(table, len(tables), tuple(missed))


def _opencv() -> Any:
    try:
        return import_module("cv2")
    except ImportError:
        raise OptionError(
            "finding corners needs OpenCV, which is not installed here: pip install 'irbcal[camera]'"
        ) from None


def _boards(cv2: Any, features: TableLike, name_of: str, legacy: bool, table: InputTable) -> dict[str, _Board]:
    """Boards by their names; those of patterns such as ``board {place}`` have another one at each place."""
    rows = given_rows(features)
    imaging.shared(rows)
    out: dict[str, _Board] = {}
    for row in [one for one in rows if one["kind"] in imaging.TARGETS]:
        view = imaging.imaging_of(row)
        if view.squares is None or view.square is None:
            raise MeasurementError(
                f"expected {', '.join(imaging.BOARD)} of the board",
                file=name_of,
                row=int(row["row"]),
                column="squares_x",
            )
        marker = float(row["marker_mm"]) * MM if row.get("marker_mm") else MARKER * view.square
        if not 0.0 < marker < view.square:
            raise MeasurementError(
                f"expected a marker smaller than its square, found {marker / MM:g} mm",
                file=name_of,
                row=int(row["row"]),
                column="marker_mm",
            )
        dictionary = _dictionary(cv2, row, name_of)
        try:
            board = cv2.aruco.CharucoBoard(view.squares, view.square, marker, dictionary)
        except (cv2.error, SystemError):  # sizes that are equal in its single precision
            across, along = view.squares
            raise MeasurementError(
                f"OpenCV makes no board of {across} × {along} squares of {view.square / MM:g} mm with markers of "
                f"{marker / MM:g} mm",
                file=name_of,
                row=int(row["row"]),
                column="squares_x",
            ) from None
        board.setLegacyPattern(legacy)
        size = None if view.size is None else (int(view.size[0]), int(view.size[1]))
        names = filled(row["feature"], table, row)
        out[row["feature"]] = _Board(cv2.aruco.CharucoDetector(board), size, names)
    if not out:
        kinds = " or ".join(imaging.TARGETS)
        raise MeasurementError(f"there is no feature of kind {kinds}", file=name_of)
    return out


def _dictionary(cv2: Any, row: Mapping[str, str], name_of: str) -> Any:
    name = row.get(imaging.DICTIONARY, "").upper()
    name = name if name.startswith("DICT_") else f"DICT_{name}"
    if not hasattr(cv2.aruco, name):
        raise MeasurementError(
            f"expected one of OpenCV's dictionaries of markers, such as DICT_5X5_100, found "
            f"{row.get(imaging.DICTIONARY) or 'nothing'}",
            file=name_of,
            row=int(row["row"]),
            column=imaging.DICTIONARY,
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
