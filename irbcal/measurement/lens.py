"""Lens calibration: the numbers of cameras from pictures of boards alone, proven on pictures that were left out.

The adjustment is OpenCV's `calibrateCamera` (Zhang 2000), of all pictures of a camera at once. How many numbers of
distortion a lens gets is decided by pictures that were left out of the fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, NameArray
from irbcal.distributions import NORMAL_95
from irbcal.errors import MeasurementError
from irbcal.measurement import imaging
from irbcal.measurement.boards import opencv
from irbcal.measurement.features import filled, given_rows
from irbcal.measurement.input_table import InputTable, TableLike, TextRow
from irbcal.summary import Content

FEWEST_PICTURES = 5
"""Pictures that a lens needs; twenty or more with the board tilted, near and far, are better."""
FOLDS = 5
"""Pictures are left out in as many parts at most."""
DISTORTIONS = ("", "k1", "k1 k2", "k1 k2 p1 p2", "k1 k2 p1 p2 k3")
"""Numbers of distortion that are tried, from the fewest on."""
WORSE = 0.02
"""By how much more numbers may make the error larger in pictures that were left out, and are taken all the same.

What is not fitted goes into other numbers, whose intervals then do not hold: p1 and p2 into the centre.
"""
BETTER = 0.02
"""By how much `FARTHEST` must make it smaller: beyond the corners that were seen it goes anywhere."""
FARTHEST = "k3"

BoardCorners: TypeAlias = "tuple[FloatArray, FloatArray]"
"""Of a picture: places on the board (n, 2), metres, and in the picture (n, 2), pixels."""


@dataclass(frozen=True, eq=False)
class Lens(Content):
    """The lens of a camera."""

    CONTENT = (
        "camera width_px,height_px=size pictures=pictures.__len__ rms_px=rms_pixels heldout_px=heldout_rms_pixels "
        "*by_name"
    )

    camera: str
    size: tuple[int, int]
    """Width and height of pictures, pixels."""
    numbers: FloatArray
    u95: FloatArray
    """Shape (9,). As `irbcal.measurement.imaging.LENS` names them, with half-widths that hold 95 %; 0 where not fitted.
    """
    pictures: NameArray
    """Shape (m,)."""
    corners: FloatArray
    """Whole numbers, shape (m,)."""
    pixels: FloatArray
    heldout_pixels: FloatArray
    """Shape (m,). Root mean square distance of a picture's corners, in the fit and while the picture was left out;
    there only the board's place is fitted to it, which is counted.
    """

    def by_name(self) -> dict[str, dict[str, float]]:
        """Numbers and half-widths by what `irbcal.measurement.imaging.LENS` calls them."""
        return {
            name: {"value": value, "u95": u95}
            for name, value, u95 in zip(imaging.LENS, self.numbers, self.u95, strict=True)
        }

    @property
    def rms_pixels(self) -> float:
        """Root mean square distance of all corners, pixels."""
        return _rms(self.pixels, self.corners)

    @property
    def heldout_rms_pixels(self) -> float:
        """The same of pictures while they were left out."""
        return _rms(self.heldout_pixels, self.corners)


def with_lenses(corners: pd.DataFrame, features: TableLike) -> tuple[TableLike, tuple[Lens, ...]]:
    """The features with lenses from corners, of cameras of which nothing else is known; they may still be fitted.

    Parameters
    ----------
    corners : DataFrame
        Rows of corners as ``irbcal corners`` writes them.
    features : str, Path or DataFrame

    Raises
    ------
    MeasurementError
        If the pictures are too few, or the size of a camera's pictures is not known.
    OptionError
        If OpenCV is not installed.
    """
    rows = given_rows(features)
    imaging.shared(rows)
    unknown = [row for row in rows if row["kind"] in imaging.TARGETS and not row.get("fx_px")]
    if not unknown:
        return features, ()
    table = InputTable.read(corners, ["pose", "feature", "corner", "u_px", "v_px"])
    uv = np.column_stack([table.numbers("u_px"), table.numbers("v_px")])
    number = table.numbers("corner").astype(int)
    pose, shown_at = table.texts("pose"), table.texts("feature")
    views: dict[str, dict[str, BoardCorners]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for row in unknown:
        board, size, camera = imaging.board_of(row), imaging.size_of(row), imaging.camera_and_board(row)[0]
        if board is None or size is None:
            raise row.fault(
                f"nothing is known of the lens of {camera}: give fx_px, fy_px, cx_px and cy_px, or its board, width_px "
                "and height_px, for a lens from these pictures",
                "fx_px",
            )
        sizes[camera] = size
        of_board = (shown_at == filled(row["feature"], table, row)) & (number >= 0) & (number < len(board.corners))
        for picture in dict.fromkeys(pose[of_board]):
            in_picture = of_board & (pose == picture)
            views.setdefault(camera, {})[f"{picture} {row['feature']}"] = (
                board.corners[number[in_picture]],
                uv[in_picture],
            )
    cv2, source = opencv(), unknown[0].source
    fit = {imaging.camera_and_board(row)[0]: imaging.numbers_to_fit(row) for row in unknown}
    lenses = tuple(
        calibrated(cv2, camera, sizes[camera], views.get(camera, {}), source, fit[camera]) for camera in sizes
    )
    fitted = {lens.camera: " ".join(np.array(imaging.FITTED)[lens.u95 > 0.0]) for lens in lenses}
    for row in unknown:
        row[imaging.FIT] = row.get(imaging.FIT) or fitted[imaging.camera_and_board(row)[0]]
    return with_numbers(rows, lenses), lenses


def tell_a_homography(xy: FloatArray) -> bool:
    """Whether corners (n, 2) are at least four, of which not all, nor all but one, are on one line.

    Others let OpenCV start from a place far from the truth, and spoil the lens of all pictures.
    """
    if len(xy) < imaging.FEWEST_CORNERS:
        return False
    x = xy - xy.mean(axis=0)
    squares = x.T @ x - len(x) / (len(x) - 1.0) * x[:, :, None] * x[:, None]  # without each corner in turn
    smallest, largest = np.linalg.eigvalsh(squares).T
    return bool((smallest >= 1e-6 * largest).all())


def with_numbers(rows: list[TextRow], lenses: Sequence[Lens]) -> pd.DataFrame:
    """The features with these lenses."""
    of = {lens.camera: lens for lens in lenses}
    out = []
    for row in rows:
        lens = of.get(imaging.camera_and_board(row)[0]) if row["kind"] in imaging.TARGETS else None
        out.append({**row, **({} if lens is None else imaging.lens_columns(lens.numbers, lens.size))})
    return pd.DataFrame(out).fillna("")


def calibrated(
    cv2: Any,
    camera: str,
    size: tuple[int, int],
    shown: Mapping[str, BoardCorners],
    source: str,
    fit: Sequence[str] = (),
) -> Lens:
    """A camera's lens from corners by their pictures, with each part of the pictures held out in turn.

    Where numbers to ``fit`` are named, no other number of distortion is tried.

    Raises
    ------
    MeasurementError
        If the pictures are too few or do not tell the lens.
    """
    names, views = list(shown), list(shown.values())
    if len(views) < FEWEST_PICTURES:
        raise MeasurementError(
            f"{len(views)} pictures show a board to {camera}: {FEWEST_PICTURES} are needed, twenty or more with the "
            "board tilted, near and far, are better",
            file=source,
        )
    count = np.array([len(uv) for _, uv in views], dtype=float)
    fold = np.arange(len(views)) % FOLDS
    left_out: dict[str, FloatArray] = {}
    for distortion in DISTORTIONS:
        if fit and not set(distortion.split()) <= set(fit):
            continue
        heldout = left_out[distortion] = np.zeros(len(views))
        for k in np.unique(fold):
            numbers, _, _ = _fit(cv2, [views[i] for i in np.flatnonzero(fold != k)], size, distortion, source)
            for i in np.flatnonzero(fold == k):
                heldout[i] = _missed(cv2, numbers, *views[i])
    error, best = {distortion: _rms(pixels, count) for distortion, pixels in left_out.items()}, ""
    for distortion in error:
        allowed = 1.0 - BETTER if FARTHEST in distortion else 1.0 + WORSE
        smallest = min((error[another] for another in error if another != distortion), default=np.inf)
        best = distortion if error[distortion] <= allowed * smallest else best
    numbers, u95, pixels = _fit(cv2, views, size, best, source)
    return Lens(camera, size, numbers, u95, np.array(names, dtype=object), count, pixels, left_out[best])


def _rms(pixels: FloatArray, count: FloatArray) -> float:
    return float(np.sqrt(np.average(pixels**2, weights=count)))


def _fit(
    cv2: Any, views: Sequence[BoardCorners], size: tuple[int, int], distortion: str, source: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Numbers (9,), their half-widths, and what each picture misses; pixels."""
    free = distortion.split()
    flags = 0 if "p1" in free else cv2.CALIB_ZERO_TANGENT_DIST
    for name in ("k1", "k2", "k3"):
        flags |= 0 if name in free else getattr(cv2, f"CALIB_FIX_{name.upper()}")
    on_board = [np.column_stack([xy, np.zeros(len(xy))]).astype(np.float32) for xy, _ in views]
    in_picture = [uv.astype(np.float32) for _, uv in views]
    try:
        _, K, d, _, _, deviations, _, each = cv2.calibrateCameraExtended(
            on_board, in_picture, size, None, None, flags=flags
        )
    except cv2.error:
        raise MeasurementError("the pictures do not determine the lens: tilt the board more", file=source) from None
    numbers = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(d)[:5]], dtype=float)
    u95 = NORMAL_95 * np.ravel(deviations)[:9].astype(float)
    if not (np.isfinite(numbers).all() and np.isfinite(u95).all()):
        raise MeasurementError("the pictures do not determine the lens: tilt the board more", file=source)
    return numbers, u95, np.ravel(each).astype(float)


def _missed(cv2: Any, numbers: FloatArray, xy: FloatArray, uv: FloatArray) -> float:
    """What a picture that was left out misses with the board where it fits best, which six numbers tell; pixels."""
    K = np.array([[numbers[0], 0.0, numbers[2]], [0.0, numbers[1], numbers[3]], [0.0, 0.0, 1.0]])
    points = np.column_stack([xy, np.zeros(len(xy))])
    known, turn, shift = cv2.solvePnP(points, uv, K, numbers[4:], flags=cv2.SOLVEPNP_IPPE)
    if not known:
        return float("inf")
    turn, shift = cv2.solvePnPRefineLM(points, uv, K, numbers[4:], turn, shift)
    off = cv2.projectPoints(points, turn, shift, K, numbers[4:])[0][:, 0] - uv
    return float(np.sqrt((off**2).sum() / len(uv) * 2 * len(uv) / max(2 * len(uv) - 6, 1)))
