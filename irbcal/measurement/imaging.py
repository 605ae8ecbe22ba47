"""Corners of a board, or of markers on a body, in images: what is known of both; all corners of an image are one row.

Features of the kinds in `TARGETS` may have more columns::

    fx_px,fy_px,cx_px,cy_px[,k1,k2,p1,p2,k3,width_px,height_px,fit]      the camera
    squares_x,squares_y,square_mm[,pattern,marker_mm,dictionary,first_marker]      the board

What one feature says of a camera or a board, all of that camera or board have. ``fit`` names numbers of the camera
(`FITTED`, with spaces between them) that are uncertain and fitted. A row is one corner in one image: ``u_px``, ``v_px``
(OpenCV's convention: the middle of the first pixel is 0, 0), and ``corner``, its number on the board, or ``x_mm``,
``y_mm`` in the board's axes (of a body that is not flat, and of which no squares are told, ``z_mm``, too). A row of the
kinds in `POINTS` is one point and needs neither. Corners of a board are numbered along x first; boards are those of
`irbcal.measurement.boards`, ChArUco boards unless ``pattern`` names another. Corners beyond the image are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement.boards import MARKER, PATTERNS, Board
from irbcal.measurement.input_table import TextRow
from irbcal.units import MM

TARGETS: Mapping[str, str] = {"image": "board", "image-on-tool": "camera"}
"""Kinds of rows that are images, and what the tool carries."""

POINTS: Mapping[str, str] = {"pixel": "ball", "depth": "ball", "pixel-on-tool": "camera", "depth-on-tool": "camera"}
"""Kinds of rows that are one point in a picture, likewise; a row has no corner."""

CAMERA_KINDS: Mapping[str, str] = {**TARGETS, **POINTS}
"""All kinds that a camera sees."""

LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
BOARD = ("squares_x", "squares_y", "square_mm")
SIZE = ("width_px", "height_px")
PATTERN, MARKER_SIDE, DICTIONARY, FIRST = "pattern", "marker_mm", "dictionary", "first_marker"
NUMBER_COLUMNS = (*LENS, *SIZE, *BOARD, MARKER_SIDE, FIRST, "u95_px")
FIT = "fit"
LENS_FILE, BOARD_FILE = "lens", "board"
TEXT_COLUMNS = (FIT, PATTERN, DICTIONARY, LENS_FILE, BOARD_FILE)
"""Columns that are no numbers."""
FITTED = tuple(name.removesuffix("_px") for name in LENS)
"""Numbers of a camera that may be fitted, in the order of `LENS`."""

PIXEL_U95 = 0.2
"""Uncertainty of a corner that tells none, pixels."""

MOST_SQUARES = 200
"""Of a board along one side: its corners are looked for one by one."""

MOST_MARKERS = 100_000
"""Numbers of markers are below."""

FEWEST_CORNERS = 4
"""Corners that an image needs: fewer do not tell where the board is."""

OUTSIDE = 1.0
"""Pixels that a corner may lie beyond the image."""

MOST_OUTSIDE = 0.1
"""Share of corners beyond the image, above which the image's size is not what was said of it."""


@dataclass(frozen=True, eq=False)
class Imaging(Locked):
    """What is known of a camera and of the board that it sees."""

    lens: FloatArray
    """Shape (9,). Pinhole with Brown's distortion as `LENS` names it: pixels, and numbers of normalised coordinates."""
    fit: tuple[str, ...] = ()
    """Which of `FITTED` are uncertain."""
    board: Board | None = None
    size: tuple[float, float] | None = None
    """Width and height of images, pixels."""
    u95: float = PIXEL_U95
    """Of a corner, pixels."""

    @property
    def corners(self) -> FloatArray:
        """Corners of the board in its axes, shape (n, 2), metres."""
        return np.zeros((0, 2)) if self.board is None else self.board.corners

    def columns(self) -> dict[str, str]:
        """As the columns of a features' file."""
        out = lens_columns(self.lens, self.size or ()) | {FIT: " ".join(self.fit)}
        if self.board is not None:
            out |= {"squares_x": str(self.board.across), "squares_y": str(self.board.along)}
            out |= {"square_mm": repr(round(self.board.pitch / MM, 9)), PATTERN: self.board.pattern}
            if PATTERNS[self.board.pattern].markers:
                out |= {MARKER_SIDE: repr(round(self.board.marker / MM, 9)), DICTIONARY: self.board.dictionary}
                out |= {FIRST: str(self.board.first)}
        return out | {"u95_px": repr(self.u95)}


def lens_columns(lens: FloatArray, size: Sequence[float] = ()) -> dict[str, str]:
    """Numbers of a lens (9,), and the size of its images where that is known, as columns of a features' file."""
    return dict(zip((*LENS, *SIZE), map(repr, [*lens.tolist(), *size]), strict=False))


def camera_and_board(row: Mapping[str, str]) -> tuple[str, str]:
    """Names of camera and board of a feature: one is the target, the other the feature."""
    pair = row.get("target") or CAMERA_KINDS[row["kind"]], row["feature"]
    return pair if CAMERA_KINDS[row["kind"]] == "camera" else pair[::-1]


def shared(rows: Sequence[TextRow]) -> None:
    """Fill in what other features say of the same camera or board.

    Raises
    ------
    MeasurementError
        If two say different things, or have one name.
    """
    values: dict[tuple[str, str, str], str] = {}
    with_images = [row for row in rows if row["kind"] in CAMERA_KINDS]
    first: dict[str, TextRow] = {}
    for row in with_images:
        name, first_row = row["feature"], first.setdefault(row["feature"], row)
        if first_row is not row:
            names = " and ".join(
                f"{name} {each.get('target') or CAMERA_KINDS[each['kind']]}" for each in (first_row, row)
            )
            raise row.fault(
                f"{name} is a feature in row {first_row.row} already: a board that several cameras on the arm see "
                f"has a name for each of them, such as {names}",
                "feature",
            )
    for again in (False, True):
        for row_of_camera in with_images:
            row_of_camera["target"] = row_of_camera.get("target") or CAMERA_KINDS[row_of_camera["kind"]]
            camera, board = camera_and_board(row_of_camera)
            owner = [("camera", camera, name) for name in (*LENS, *SIZE, FIT)] + [
                ("board", board, n) for n in (*BOARD, PATTERN, MARKER_SIDE, DICTIONARY, FIRST, BOARD_FILE)
            ]
            for key in owner:
                value = row_of_camera.get(key[2], "")
                if again:
                    row_of_camera[key[2]] = value or values.get(key, "")
                elif value and values.setdefault(key, value) != value:
                    raise row_of_camera.fault(
                        f"{key[0]} {key[1]} has {key[2]} {values[key]} in one row and {value} in another", key[2]
                    )


def imaging_of(row: TextRow) -> Imaging:
    """What a row of the features' file says of camera and board.

    Raises
    ------
    MeasurementError
        If something is missing or cannot be.
    """
    camera = camera_and_board(row)[0]
    value = {name: float(row[name]) for name in NUMBER_COLUMNS if row.get(name)}
    for name in ("fx_px", "cx_px", "cy_px"):
        if name not in value:
            raise row.fault(
                f"nothing is known of the lens of {camera}: a camera needs fx_px, fy_px, cx_px and cy_px", name
            )
    value.setdefault("fy_px", value["fx_px"])
    for name in ("fx_px", "fy_px", *SIZE, "u95_px"):
        if name in value and value[name] <= 0.0:
            raise row.fault(f"expected a number above zero, found {value[name]:g}", name)
    missing = [name for name in SIZE if name not in value]
    if len(missing) == 1:
        raise row.fault(f"expected {', '.join(SIZE)}, all or none", missing[0])
    return Imaging(
        np.array([value.get(name, 0.0) for name in LENS]),
        numbers_to_fit(row),
        board_of(row),
        (value["width_px"], value["height_px"]) if "width_px" in value else None,
        value.get("u95_px", PIXEL_U95),
    )


def numbers_to_fit(row: TextRow) -> tuple[str, ...]:
    """Numbers of the lens that a row of the features' file says to fit, in the order of `FITTED`.

    Raises
    ------
    MeasurementError
        If it names others.
    """
    names = row.get(FIT, "").split()
    strange = [name for name in names if name not in FITTED]
    if strange:
        raise row.fault(f"cannot fit {strange[0]!r}: of a camera {', '.join(FITTED)} may be fitted", FIT)
    return tuple(name for name in FITTED if name in names)


def board_of(row: TextRow) -> Board | None:
    """The board of a row of the features' file; None where nothing is said of one.

    Raises
    ------
    MeasurementError
        If something is missing or cannot be.
    """
    value = {name: float(row[name]) for name in (*BOARD, MARKER_SIDE, FIRST) if row.get(name)}
    pattern = row.get(PATTERN) or next(iter(PATTERNS))
    if pattern not in PATTERNS:
        raise row.fault(f"expected a pattern, one of {', '.join(PATTERNS)}, found {pattern}", PATTERN)
    missing = [name for name in BOARD if name not in value]
    if len(missing) == len(BOARD):
        return None
    if missing:
        raise row.fault(f"expected {', '.join(BOARD)}, all or none", missing[0])
    for name in BOARD[:2]:
        fewest = PATTERNS[pattern].fewest
        if not (fewest <= value[name] <= MOST_SQUARES and value[name] == int(value[name])):
            raise row.fault(
                f"a board has {fewest} to {MOST_SQUARES} squares along each side, found {value[name]:g}", name
            )
    if value["square_mm"] <= 0.0:
        raise row.fault(f"expected a number above zero, found {value['square_mm']:g}", "square_mm")
    marker, first = value.get(MARKER_SIDE, MARKER * value["square_mm"]), value.get(FIRST, 0.0)
    alone = pattern == "markers" and value["squares_x"] == value["squares_y"] == 1  # nothing is beside it
    if not (0.0 < marker < value["square_mm"] or (alone and marker > 0.0)):
        raise row.fault(f"expected a marker smaller than its square, found {marker:g} mm", MARKER_SIDE)
    if not (0.0 <= first < MOST_MARKERS and first == int(first)):
        raise row.fault(f"expected the number of a marker, found {first:g}", FIRST)
    across, along = int(value["squares_x"]), int(value["squares_y"])
    board = Board(pattern, across, along, value["square_mm"] * MM, marker * MM, dictionary_of(row), int(first))
    if board.turnable and across == along:
        raise row.fault(
            f"{across} × {along} look the same after a quarter turn: take a board that is no square", BOARD[0]
        )
    return board


def dictionary_of(row: Mapping[str, str]) -> str:
    """OpenCV's name of the markers of a row of the features' file; empty where it says none."""
    name = (row.get(DICTIONARY) or "").upper()
    return name if name.startswith("DICT_") or not name else f"DICT_{name}"


def size_of(row: Mapping[str, str]) -> tuple[int, int] | None:
    """Width and height of a camera's pictures, pixels; None where a row of the features' file does not say both."""
    width, height = (float(row[name]) if row.get(name) else 0.0 for name in SIZE)
    return (int(width), int(height)) if width >= 1.0 and height >= 1.0 else None


def per_pixel(corners: FloatArray) -> FloatArray:
    """What a pixel is at the board, about: spread of corners on the board by that in the image, (m,), metres.

    Of a body that is not flat two thirds of the squared spread count: those across the view.

    Parameters
    ----------
    corners : ndarray, shape (m, n, 5 or 6)
        See `Images`.
    """
    has_corner = np.isfinite(corners[:, :, 2:3])
    with np.errstate(invalid="ignore", divide="ignore"):  # rows without corners
        count = has_corner.sum(axis=1)[:, None]
        mean = np.where(has_corner, corners, 0.0).sum(axis=1, keepdims=True) / count
        spread = (np.where(has_corner, corners - mean, 0.0) ** 2).sum(axis=1)
        across = spread[:, :2].sum(axis=1)
        if corners.shape[2] > 5:
            across = np.where(spread[:, 5] > 0.0, (across + spread[:, 5]) * 2.0 / 3.0, across)
        return np.asarray(np.sqrt(across / spread[:, 2:4].sum(axis=1)))


def typical_u95(corners: FloatArray) -> FloatArray:
    """Median uncertainty of the corners of each image, (m,), pixels; NaN of rows without corners."""
    u95 = np.sort(corners[:, :, 4], axis=1)  # what is not a number comes last
    count = np.isfinite(u95).sum(axis=1)
    row = np.arange(len(u95))
    return np.asarray(0.5 * (u95[row, np.maximum(count - 1, 0) // 2] + u95[row, count // 2]))


def u95_of(corners: FloatArray) -> FloatArray:
    """How well images tell the board's place across the view, (m,), metres: all corners together."""
    count = np.isfinite(corners[:, :, 4]).sum(axis=1)
    return np.asarray(typical_u95(corners) * per_pixel(corners) / np.sqrt(np.maximum(count, 1)))


@dataclass(frozen=True, eq=False)
class Images:
    """Corners gathered image by image."""

    keep: BoolArray
    """Shape (rows,). Rows of the file that stay: the first of each image, and those that are no corners."""
    corners: FloatArray
    """Shape (kept, n, 5 or 6). x and y on the board in metres, u, v and the uncertainty in pixels, where bodies are not
    flat also z; NaN beyond an image's corners.
    """
    outside: int = 0
    """Corners that were left out because they are beyond the image."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners row by row, as the file has them."""

    image: IntArray
    """Shape (rows,). Rows with one number are of one pose at one feature with one target."""
    kind: NameArray
    feature: NameArray
    target: NameArray
    """Shape (rows,)."""
    number: FloatArray
    u: FloatArray
    v: FloatArray
    u95: FloatArray
    """Shape (rows,). Pixels; NaN where there is none."""
    xyz: FloatArray
    """Shape (rows, 3). In the board's axes, metres, where the file has them."""
    row: IntArray
    """Shape (rows,). In the file."""


def gathered(
    corners: Corners, imagings: Mapping[str, Imaging | None], targets: Mapping[str, str], source: str
) -> Images | None:
    """Images of corners; None where no row is a corner.

    Parameters
    ----------
    corners : Corners
    imagings : dict of str to Imaging or None
        By feature.
    targets : dict of str to str
        Target of each feature.
    source : str
        For messages.

    Raises
    ------
    MeasurementError
        If a corner is not on its board, or an image has too few.
    """
    is_corner = np.isin(corners.kind.astype(str), list(CAMERA_KINDS))
    if not is_corner.any():
        return None
    rows = np.flatnonzero(is_corner)

    def refuse(k: int, message: str, column: str) -> MeasurementError:
        return MeasurementError(message, file=source, row=int(corners.row[k]), column=column)

    lost = rows[~(np.isfinite(corners.u[rows]) & np.isfinite(corners.v[rows]))]
    if len(lost):
        k = int(lost[0])
        name = "u_px" if not np.isfinite(corners.u[k]) else "v_px"
        raise refuse(k, f"a row of kind {corners.kind[k]} needs u_px and v_px, where it is in the image", name)
    xyz, u95 = corners.xyz.copy(), corners.u95.copy()
    beyond = np.zeros(len(corners.u), dtype=bool)
    for name in dict.fromkeys(corners.feature[rows]):
        rows_of_feature = rows[corners.feature[rows] == name]
        imaging = imagings.get(str(name))
        if imaging is None:
            raise refuse(
                int(rows_of_feature[0]),
                f"a row of kind {corners.kind[rows_of_feature[0]]} needs fx_px … of its camera",
                "feature",
            )
        strange = rows_of_feature[corners.target[rows_of_feature] != targets[str(name)]]
        if len(strange):
            k, device = int(strange[0]), CAMERA_KINDS[str(corners.kind[strange[0]])]
            more = f"; for {corners.target[k]} give it a feature of another name, such as {name} {corners.target[k]}"
            raise refuse(
                k,
                f"unknown {device} {corners.target[k]}: {name} is seen with {targets[str(name)]}"
                + (more if device == "camera" else ""),
                "target",
            )
        is_point = np.isin(corners.kind[rows_of_feature].astype(str), list(POINTS))
        xyz[rows_of_feature[is_point]] = 0.0
        xyz[rows_of_feature[~is_point]] = _on_board(corners, imaging, rows_of_feature[~is_point], refuse)
        u95[rows_of_feature] = np.where(np.isfinite(u95[rows_of_feature]), u95[rows_of_feature], imaging.u95)
        if imaging.size is not None:
            far = [
                (corners.u[rows_of_feature], imaging.size[0], "u_px"),
                (corners.v[rows_of_feature], imaging.size[1], "v_px"),
            ]
            for value, limit, column in far:
                out = rows_of_feature[(value < -OUTSIDE) | (value > limit + OUTSIDE)]
                beyond[out] = True
                if len(out) > MOST_OUTSIDE * len(rows_of_feature):
                    k = int(out[0])
                    at = (corners.u if column == "u_px" else corners.v)[k]
                    raise refuse(
                        k,
                        f"expected a place within the image of {limit:g} pixels, found {at:g}, as {len(out)} of "
                        f"{len(rows_of_feature)} corners",
                        column,
                    )
    for image in np.unique(corners.image[beyond]):  # a picture goes with its corners where those left tell no place
        of_image = rows[corners.image[rows] == image]
        if corners.kind[of_image[0]] not in POINTS and not tell_a_place(xyz[of_image[~beyond[of_image]]]):
            beyond[of_image] = True
    values = np.column_stack([xyz[:, :2], corners.u, corners.v, u95])
    if xyz[rows, 2].any():
        values = np.column_stack([values, xyz[:, 2]])
    images = _by_image(corners, rows[~beyond[rows]], values, is_corner, refuse)
    return replace(images, outside=int(beyond.sum()))


def tell_a_place(places: FloatArray) -> bool:
    """Whether corners (n, 2 or 3) are enough, and not on one line, to tell where their board is."""
    if len(places) < FEWEST_CORNERS:
        return False
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(spread[1] >= 1e-3 * spread[0])


def _on_board(
    corners: Corners, imaging: Imaging, rows: IntArray, refuse: Callable[..., MeasurementError]
) -> FloatArray:
    """Places of corners on their board, (rows, 3), metres."""
    numbered, xyz = np.isfinite(corners.number[rows]), corners.xyz[rows]
    out: FloatArray = np.column_stack([xyz[:, :2], np.nan_to_num(xyz[:, 2])])
    board_corners = imaging.corners
    if numbered.any():
        if not len(board_corners):
            k = int(rows[numbered][0])
            raise refuse(
                k, f"the feature {corners.feature[k]} needs {', '.join(BOARD)} to number its corners", "corner"
            )
        number = corners.number[rows]
        off = numbered & ((number < 0) | (number >= len(board_corners)) | (number != np.floor(number)))
        if off.any():
            k = int(rows[off][0])
            assert imaging.board is not None
            raise refuse(
                k,
                f"corner {corners.number[k]:g} is not on the board: {corners.feature[k]} has {imaging.board.across} × "
                f"{imaging.board.along} squares, so corners 0 to {len(board_corners) - 1}",
                "corner",
            )
        out[numbered] = np.pad(board_corners[number[numbered].astype(int)], ((0, 0), (0, 1)))
    nowhere = ~np.isfinite(out).all(axis=1)
    if nowhere.any():
        raise refuse(int(rows[nowhere][0]), "a corner needs its number, or x_mm and y_mm on the board", "corner")
    high = ~numbered & (out[:, 2] != 0.0)
    if high.any() and imaging.board is not None:
        raise refuse(int(rows[high][0]), "boards are flat: expected z_mm 0 or nothing", "z_mm")
    return out


def _by_image(
    corner_rows: Corners,
    rows: IntArray,
    values: FloatArray,
    is_corner: BoolArray,
    refuse: Callable[..., MeasurementError],
) -> Images:
    """Rows of corners by their image; checked."""
    order = rows[np.argsort(corner_rows.image[rows], kind="stable")]
    _, first, counts = np.unique(corner_rows.image[order], return_index=True, return_counts=True)
    heads = np.array([order[a : a + n].min() for a, n in zip(first, counts, strict=True)])
    keep = ~is_corner
    keep[heads] = True
    position = np.cumsum(keep) - 1
    corners = np.full((int(keep.sum()), int(counts.max()), values.shape[1]), np.nan)
    for head, a, n in zip(heads, first, counts, strict=True):
        of_image = order[a : a + n]
        corners[position[head], :n] = values[of_image]
        positions = np.delete(values[of_image], [2, 3, 4], axis=1)
        twice = pd.DataFrame(np.round(positions, 9)).duplicated().to_numpy()
        if twice.any():
            which = "point" if corner_rows.kind[head] in POINTS else "corner"
            raise refuse(int(of_image[twice][0]), f"this {which} is in its image twice", "corner")
        if corner_rows.kind[head] not in POINTS and not tell_a_place(positions):
            raise refuse(
                int(head),
                f"an image needs at least {FEWEST_CORNERS} corners that are not on one line, found {n}",
                "corner",
            )
    return Images(keep, corners)
