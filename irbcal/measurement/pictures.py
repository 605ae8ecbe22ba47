"""Corners of boards found in pictures: a folder of pictures and a table of joints become rows.

The finding is OpenCV's; it is not installed with irbcal but with its extra ``camera``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from irbcal import safe_files
from irbcal.errors import MeasurementError
from irbcal.measurement import imaging
from irbcal.measurement.board_formats import marker_body
from irbcal.measurement.boards import PATTERNS, Board, Finder, MarkerBody, opencv
from irbcal.measurement.column_names import FRAME, POSITION, joint_columns
from irbcal.measurement.features import filled, given_rows
from irbcal.measurement.input_table import InputTable, TableLike, TextRow
from irbcal.names import csv_bytes
from irbcal.safe_files import libraries_silent
from irbcal.summary import Paragraph, Result, remarks
from irbcal.units import MM
from irbcal.wording import first_of

IMAGE = "image"
"""The column of the joints' table that names a picture."""


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
    understood : tuple of str
        How a recording was understood.
    """

    table: pd.DataFrame
    images: int
    missed: tuple[tuple[str, int], ...]
    understood: tuple[str, ...] = ()

    COLUMNS = "*table"

    @property
    def left_out(self) -> list[str]:
        """Names of the images that are left out."""
        return [name for name, _ in self.missed]

    CONTENT = "images corners=table.__len__ left_out"

    def report(self) -> Sequence[Paragraph]:
        """How many corners in how many images, and which images were left out."""
        return [f"{len(self.table)} corners in {self.images} images", *remarks("Note", self.notes())]

    def notes(self) -> list[str]:
        """How a recording was understood, and which images were left out."""
        if not self.missed:
            return [*self.understood]
        names = first_of([f"{name} ({count})" for name, count in self.missed], 10)
        return [
            *self.understood,
            f"left out, with fewer than {imaging.FEWEST_CORNERS} corners or all on one line: {names}",
        ]

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
class Seen:
    """A board that pictures may show."""

    camera: str
    """That sees it."""
    board: Board | MarkerBody
    find: Finder
    size: tuple[int, int] | None
    """Of the camera's pictures, pixels."""
    row: TextRow
    """Of the features' file."""


def corners_of(read: Callable[[str], Any], joints: TableLike, features: TableLike, where: str) -> FoundCorners:
    """Corners of pictures in grey by their names; None where there is none that OpenCV reads."""
    listed = InputTable.read(joints, [IMAGE])
    for name in joint_columns(listed.names):
        listed.numbers(name)
    name_of = str(features) if isinstance(features, (str, Path)) else FRAME
    rows = given_rows(features)
    boards = boards_of(rows, name_of)
    names = {name: filled(name, listed, board.row) for name, board in boards.items()}
    tables, missed = [], []
    for k, cell in enumerate(listed.cells.to_dict("records")):
        picture = str(cell[IMAGE]).strip()
        feature = str(cell.get("feature", "")).strip() or (next(iter(boards)) if len(boards) == 1 else "")
        name = next((name for name in boards if feature in (name, names[name][k])), "")
        if not name:
            sentence = f"expected the board in this picture, one of {', '.join(boards)}; found {feature or 'nothing'}"
            raise listed.fault(sentence, k, "feature")
        size = boards[name].size
        grey = read(picture)
        if grey is None:
            message = f"there is no picture {picture or 'named'} in {where} that OpenCV reads"
            raise listed.fault(message, k, IMAGE)
        if size is not None and grey.shape[::-1] != size:
            message = f"{picture} has {grey.shape[1]} × {grey.shape[0]} pixels, the camera {size[0]} × {size[1]}"
            raise listed.fault(message, k, IMAGE)
        number, uv = boards[name].find(grey)
        if not imaging.tell_a_place(boards[name].board.corners[number]):
            missed.append((picture, len(number)))
            continue
        of_body = isinstance(boards[name].board, MarkerBody)
        places = boards[name].board.corners[number] / MM
        more = dict(zip(POSITION, places.T, strict=True)) if of_body else {"corner": number}
        more |= dict(zip(("u_px", "v_px"), uv.T, strict=True))
        tables.append(pd.DataFrame({"pose": picture} | cell | {"feature": names[name][k]} | more))
    if not tables:
        raise no_board(name_of)
    table = pd.concat(tables, ignore_index=True)
    table[["u_px", "v_px"]] = table[["u_px", "v_px"]].astype(float).round(4)
    return FoundCorners(table, len(tables), tuple(missed))


def no_board(name_of: str) -> MeasurementError:
    """That there is no board in any picture."""
    return MeasurementError(
        f"no picture shows {imaging.FEWEST_CORNERS} corners of its board: are squares_x, squares_y, dictionary and "
        f"pattern right (one of {', '.join(PATTERNS)}; charuco-old was drawn before OpenCV 4.6)?",
        file=name_of,
    )


def read_picture(path: Path) -> Any:
    """A picture in grey, shape (height, width); None where OpenCV reads none."""
    cv2 = opencv()
    with libraries_silent():
        return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None  # a pipe would wait for ever


def boards_of(rows: list[TextRow], name_of: str) -> dict[str, Seen]:
    """Boards by the names of their features, with what finds them.

    Raises
    ------
    MeasurementError
        If there is none, or nothing finds one.
    """
    cv2 = opencv()
    imaging.shared(rows)
    out: dict[str, Seen] = {}
    for row in [row for row in rows if row["kind"] in imaging.TARGETS]:
        file = Path(row.get(imaging.BOARD_FILE) or "")
        flat = imaging.board_of(row)
        board = marker_body(file, imaging.dictionary_of(row)) if file.suffix.lower() == ".csv" else flat
        if board is None:
            raise row.fault(f"expected {', '.join(imaging.BOARD)} of the board", imaging.BOARD[0])
        if isinstance(board, MarkerBody) and flat is not None:
            raise row.fault("expected no squares of a body of markers", imaging.BOARD[0])
        has_markers = isinstance(board, MarkerBody) or PATTERNS[board.pattern].markers
        if has_markers and not hasattr(cv2.aruco, board.dictionary or "nothing"):
            raise row.fault(
                "expected one of OpenCV's dictionaries of markers, such as DICT_5X5_100, found "
                f"{row.get(imaging.DICTIONARY) or 'nothing'}",
                imaging.DICTIONARY,
            )
        try:
            find = board.finder()
        except ValueError as error:
            assert isinstance(board, Board)
            raise row.fault(
                f"OpenCV makes no board of {error} squares of {board.pitch / MM:g} mm with markers of "
                f"{board.marker / MM:g} mm",
                imaging.BOARD[0],
            ) from None
        out[row["feature"]] = Seen(imaging.camera_and_board(row)[0], board, find, imaging.size_of(row), row)
    if not out:
        raise MeasurementError(f"there is no feature of kind {' or '.join(imaging.TARGETS)}", file=name_of)
    return out
