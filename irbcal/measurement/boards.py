"""Boards that pictures show: where their corners are, and what of OpenCV finds them; flat ones are rows of `PATTERNS`.

Corners are numbered along x first. A board has a number of squares, circles or markers along x and y, and a pitch: the
distance of their middles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.errors import OptionError

Finder: TypeAlias = Callable[[Any], "tuple[IntArray, FloatArray]"]
"""From a grey picture to numbers (n,) and pixels (n, 2) of corners; none where there is no board."""

MARKER = 0.75
"""Side of a marker in shares of the pitch, unless it is given."""


STEEP = 0.5
"""Area of a marker on a body in squares of its longest side: OpenCV misplaces corners of flatter ones by pixels."""


@dataclass(frozen=True)
class Board:
    """A board."""

    pattern: str
    """One of `PATTERNS`."""
    across: int
    along: int
    """Squares, circles or markers along x and y."""
    pitch: float
    """Distance of the middles of neighbours, metres: the side of a square."""
    marker: float = 0.0
    """Side of a marker, metres."""
    dictionary: str = ""
    """OpenCV's name of its markers, such as ``DICT_5X5_100``."""
    first: int = 0
    """Number of its first marker."""

    @property
    def corners(self) -> FloatArray:
        """Corners in the board's axes, shape (n, 2), metres."""
        return PATTERNS[self.pattern].corners(self)

    @property
    def turnable(self) -> bool:
        """Whether the board looks the same after half a turn, so that its corners are numbered from either end."""
        return PATTERNS[self.pattern].turnable(self)

    def finder(self) -> Finder:
        """What finds its corners in pictures.

        Raises
        ------
        OptionError
            If OpenCV is not installed.
        ValueError
            If OpenCV makes no such board.
        """
        cv2 = opencv()
        try:
            return PATTERNS[self.pattern].finder(cv2, self)
        except (cv2.error, SystemError):  # sizes that are equal in its single precision
            raise ValueError(f"{self.across} × {self.along}") from None


@dataclass(frozen=True, eq=False)
class MarkerBody:
    """Markers on a body that need not be flat."""

    markers: tuple[int, ...]
    """Their numbers."""
    corners: FloatArray
    """Shape (4 times markers, 3). In the body's axes, of each marker from its upper left one on clockwise, metres."""
    dictionary: str

    def finder(self) -> Finder:
        """What finds its corners in pictures, but for markers that the camera sees more than 60° from the side."""
        cv2 = opencv()
        coarse = _of_numbers(cv2, _dictionary(cv2, self), self.markers)

        def find(grey: Any) -> tuple[IntArray, FloatArray]:
            number, uv = coarse(grey)
            p = uv.reshape(-1, 4, 2)
            across, along = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
            area = 0.5 * np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])
            side = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2).max(axis=1)
            clear = np.repeat(area > STEEP * side**2, 4)
            return number[clear], uv[clear]

        return find


@dataclass(frozen=True)
class Pattern:
    """A kind of board."""

    corners: Callable[[Board], FloatArray]
    """Corners of a board in its axes, (n, 2), metres."""
    finder: Callable[[Any, Board], Finder]
    """From OpenCV and a board to what finds its corners."""
    fewest: int = 3
    """Squares, circles or markers that it has at least along each side."""
    markers: bool = False
    """Whether it has markers of a dictionary."""
    turnable: Callable[[Board], bool] = lambda board: False
    """See `Board.turnable`."""


def opencv() -> Any:
    """The package ``cv2``.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    try:
        return import_module("cv2")
    except ImportError:
        raise OptionError(
            "finding corners needs OpenCV, which is not installed here: pip install 'irbcal[camera]'"
        ) from None


def _grid(across: int, along: int, pitch: float, start: float = 0.0) -> FloatArray:
    y, x = np.mgrid[0:along, 0:across]
    return np.asarray(pitch * (np.column_stack([x.ravel(), y.ravel()]) + start))


def _inner(board: Board) -> FloatArray:
    return _grid(board.across - 1, board.along - 1, board.pitch, 1.0)


def _staggered(board: Board) -> FloatArray:
    """Circles of odd rows stand between those of even rows, half a pitch on; rows are half a pitch apart."""
    y, x = np.mgrid[0 : board.along, 0 : board.across]
    return np.asarray(0.5 * board.pitch * np.column_stack([(2 * x + y % 2).ravel(), y.ravel()]))


def _of_markers(board: Board) -> FloatArray:
    """The four corners of each marker, from its upper left one on clockwise."""
    square = board.marker * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return np.asarray((_grid(board.across, board.along, board.pitch)[:, None] + square).reshape(-1, 2))


def _of_aprilgrid(board: Board) -> FloatArray:
    """The four corners of each tag: numbered from the lower left tag on, y upwards.

    As Kalibr prints tags, the corner that OpenCV takes for the upper left one is the lower right one.
    """
    square = board.marker * np.array([[1, 0], [0, 0], [0, 1], [1, 1]])
    return np.asarray((_grid(board.across, board.along, board.pitch)[:, None] + square).reshape(-1, 2))


NO_CORNERS = np.zeros(0, dtype=int), np.zeros((0, 2))


def _whole(across: int, found: bool, uv: FloatArray | None) -> tuple[IntArray, FloatArray]:
    """All corners of a board, or none; y is to the right of x, which OpenCV mirrors where the camera is rolled."""
    if not found or uv is None:
        return NO_CORNERS
    grid = np.reshape(uv, (-1, across, 2)).astype(float)
    x, y = grid[0, -1] - grid[0, 0], grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    if x[0] * y[1] - x[1] * y[0] < 0.0:
        grid = grid[::-1]
    return np.arange(grid.size // 2), grid.reshape(-1, 2)


def _charuco(cv2: Any, board: Board, old: bool = False) -> Finder:
    made = cv2.aruco.CharucoBoard(
        (board.across, board.along), board.pitch, board.marker, _dictionary(cv2, board), _numbers(board, 2)
    )
    made.setLegacyPattern(old)
    detector = cv2.aruco.CharucoDetector(made)

    def find(grey: Any) -> tuple[IntArray, FloatArray]:
        uv, number, _, _ = detector.detectBoard(grey)
        if number is None:
            return NO_CORNERS
        return np.ravel(number).astype(int), np.reshape(uv, (-1, 2)).astype(float)

    return find


def _chessboard(cv2: Any, board: Board) -> Finder:
    size, flags = (board.across - 1, board.along - 1), cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    return lambda grey: _whole(size[0], *cv2.findChessboardCornersSB(grey, size, flags=flags))


def _circles(cv2: Any, board: Board, grid: str = "SYMMETRIC") -> Finder:
    """Dark circles or rings on light ground, then light ones on dark ground."""
    size, flag = (board.across, board.along), getattr(cv2, f"CALIB_CB_{grid}_GRID")

    def find(grey: Any) -> tuple[IntArray, FloatArray]:
        for colour in (0, 255):
            settings = cv2.SimpleBlobDetector_Params()
            settings.blobColor = colour
            settings.maxArea = grey.size / (board.across * board.along)
            found = cv2.findCirclesGrid(grey, size, flags=flag, blobDetector=cv2.SimpleBlobDetector_create(settings))
            if found[0]:
                return _whole(size[0], *found)
        return NO_CORNERS

    return find


def _markers(cv2: Any, board: Board, border: int = 1) -> Finder:
    return _of_numbers(cv2, _dictionary(cv2, board), _numbers(board, 1).tolist(), border)


def _of_numbers(cv2: Any, dictionary: Any, numbers: Sequence[int], border: int = 1) -> Finder:
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = border
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(dictionary, options)
    at = {number: k for k, number in enumerate(numbers)}

    def find(grey: Any) -> tuple[IntArray, FloatArray]:
        uv, numbers, _ = detector.detectMarkers(grey)
        each = (
            []
            if numbers is None
            else [(at[n], p) for n, p in zip(np.ravel(numbers).tolist(), uv, strict=True) if n in at]
        )
        if len({k for k, _ in each}) < len(each):  # a marker twice: which is the board's?
            each = [(k, p) for k, p in each if sum(k == other for other, _ in each) == 1]
        number = np.array([4 * k + i for k, _ in each for i in range(4)], dtype=int)
        return number, np.reshape([p for _, p in each], (-1, 2)).astype(float)

    return find


def _aprilgrid(cv2: Any, board: Board) -> Finder:
    """Tags with a border of two bits; squares touch their corners, which are found as the saddle points they are."""
    coarse = _markers(cv2, board, border=2)

    def find(grey: Any) -> tuple[IntArray, FloatArray]:
        number, uv = coarse(grey)
        if not len(number):
            return NO_CORNERS
        side = np.linalg.norm(np.diff(uv.reshape(-1, 4, 2), axis=1), axis=2).min()
        half = int(np.clip(0.1 * side, 2, 10))  # a border of two bits is a fifth of the side
        ends = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
        fine = cv2.cornerSubPix(grey, np.ascontiguousarray(uv[:, None], dtype=np.float32), (half, half), (-1, -1), ends)
        return number, fine[:, 0].astype(float)

    return find


def _dictionary(cv2: Any, board: Board | MarkerBody) -> Any:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))


def _numbers(board: Board, share: int) -> IntArray:
    return board.first + np.arange(board.across * board.along // share)


PATTERNS: Mapping[str, Pattern] = {
    "charuco": Pattern(_inner, _charuco, markers=True),
    "charuco-old": Pattern(_inner, partial(_charuco, old=True), markers=True),
    "chessboard": Pattern(_inner, _chessboard, turnable=lambda board: (board.across + board.along) % 2 == 0),
    "circles": Pattern(
        lambda board: _grid(board.across, board.along, board.pitch), _circles, 2, turnable=lambda board: True
    ),
    "circles-staggered": Pattern(
        _staggered, partial(_circles, grid="ASYMMETRIC"), 2, turnable=lambda board: board.along % 2 == 0
    ),
    "markers": Pattern(_of_markers, _markers, 1, markers=True),
    "aprilgrid": Pattern(_of_aprilgrid, _aprilgrid, 1, markers=True),
}
"""Boards by the name in the column ``pattern``.

``charuco-old`` is what OpenCV drew before version 4.6, rings are ``circles``, an AprilTag is a marker of a dictionary
``DICT_APRILTAG_…``, a marker alone a board of 1 × 1. Chessboards are numbered from the end with the light square.
"""
