"""Lens calibration of one camera or several, from pictures of boards alone; those that see a board together are a rig.

Each camera is calibrated by itself (`irbcal.measurement.lens`). Cameras that see one board at the same instants are
then adjusted together, in pixels: the first stands still, and each instant's board is a device of its own before it, so
that this is the problem of hand-eye calibration (`irbcal.cell.hand_eye`) with a flange that never moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, rms
from irbcal.cell.hand_eye import DeviceFrame, frames_table, half_widths, left_out
from irbcal.errors import MeasurementError
from irbcal.identification import feature_problem
from irbcal.identification.feature_problem import TOOL, FeatureProblem, FeatureState
from irbcal.io.opening import open_robot
from irbcal.measurement import imaging, lens_formats
from irbcal.measurement.boards import Board, opencv
from irbcal.measurement.column_names import FRAME
from irbcal.measurement.features import Feature, FeatureSet, given_rows
from irbcal.measurement.imaging import FITTED, Imaging
from irbcal.measurement.input_table import TableLike
from irbcal.measurement.lens import (
    FEWEST_PICTURES,
    FOLDS,
    BoardCorners,
    Lens,
    calibrated,
    tell_a_homography,
    with_numbers,
)
from irbcal.measurement.pictures import Seen, boards_of, no_board, read_picture
from irbcal.measurement.pinhole import boards
from irbcal.measurement.recordings import rosbag
from irbcal.modeling import frames
from irbcal.overwriting import refuse_overwriting
from irbcal.summary import Paragraph, Result, Table, remarks
from irbcal.wording import first_of

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")
SAME_S = 0.005
"""Stamps that differ by no more are of one instant, seconds."""
STIFF = 0.1
"""Radians, or shares of the board's distance, by which a camera in another one may differ between instants."""
APART = 5.0
"""Times the median of instants that one misses, above which its pictures were not taken together."""

Shown: TypeAlias = "Mapping[str, Mapping[str, BoardCorners]]"
"""Corners by camera and picture."""


@dataclass(frozen=True, eq=False, repr=False)
class LensCalibration(Result):
    """Lenses of cameras.

    Attributes
    ----------
    lenses : tuple of Lens
    table : DataFrame
        The features' file with these lenses.
    missed : tuple of str
        Pictures that are left out, with too few corners.
    rig : tuple of DeviceFrame
        Cameras that see boards together with others: each in the first of them.
    notes : tuple of str
        Which cameras and pictures are not of a rig.
    """

    lenses: tuple[Lens, ...]
    table: pd.DataFrame = field(repr=False)
    missed: tuple[str, ...] = ()
    rig: tuple[DeviceFrame, ...] = ()
    notes: tuple[str, ...] = ()

    CONTENT = "lenses rig left_out=missed notes"
    ROWS, COLUMNS = "lenses", "camera picture=pictures corners rms_px=pixels heldout_px=heldout_pixels"

    def save(self, out: str | PathLike[str], as_: str = "features") -> Path:
        """Write the lenses: into a copy of the features' file, or as another program reads them.

        Parameters
        ----------
        out : str or Path
        as_ : str
            ``features``, or a name of `irbcal.measurement.lens_formats.FORMATS`.

        Raises
        ------
        OptionError
            If the format is not known, or has fewer cameras.
        CalibrationError
            If it cannot be written.
        """
        cameras = {lens.camera: (lens.numbers, lens.size) for lens in self.lenses}
        rig = {frame.name: (frame.on, frame.T) for frame in self.rig}
        return lens_formats.save(Path(out), as_, cameras, self.table, rig)

    def report(self) -> Sequence[Paragraph]:
        """Numbers with their intervals, and how well pictures agree."""
        paragraphs: list[Paragraph] = []
        for lens in self.lenses:
            paragraphs.append(
                f"{lens.camera}: {int(lens.corners.sum())} corners in {len(lens.pictures)} pictures agree within "
                f"{lens.rms_pixels:.3f} px (rms), {lens.heldout_rms_pixels:.3f} px in pictures that were left out"
            )
            rows = tuple(
                (name, f"{value:.6g}", f"{u95:.2g}" if u95 else "not fitted")
                for name, value, u95 in zip(imaging.LENS, lens.numbers, lens.u95, strict=True)
            )
            paragraphs.append(Table(f"Lens of {lens.camera}", ("number", "value", "± 95 %"), rows))
        if self.rig:
            paragraphs.append(frames_table("Cameras of a rig, adjusted together; angles in degrees", self.rig))
        notes = list(self.notes)
        if self.missed:
            names = first_of(self.missed, 10)
            notes.insert(
                0, f"left out, with fewer than {imaging.FEWEST_CORNERS} corners or all but one on one line: {names}"
            )
        return [*paragraphs, *remarks("Note", notes)]


def lens(
    images: str | Path,
    features: TableLike,
    out: str | PathLike[str] | None = None,
    *,
    as_: Literal["features", "ros", "opencv", "kalibr"] = "features",
) -> LensCalibration:
    """Calibrate the lenses of cameras from pictures of boards alone, and where those of a rig are in the first one.

    Pictures of several cameras that have the same number or stamp at the end of their names (or in a bag) were taken
    together: where they show the same board, the cameras are adjusted together.

    Parameters
    ----------
    images : str or Path
        Folder of the pictures; of several boards or cameras, in it a folder for each feature, or names that begin with
        it. Or a bag of ROS 2 or 1.
    features : str, Path or DataFrame
        Cameras and boards as for corners, or a board of Kalibr's or industrial_calibration's (YAML); nothing needs to
        be known of the lens.
    out : str or Path, optional
        File to write, such as camera.csv.
    as_ : str
        What to write: the features with these lenses, ROS camera_info, OpenCV's FileStorage, or Kalibr's camchain.

    Raises
    ------
    MeasurementError
        If a file does not keep its format, or the pictures are too few.
    OptionError
        If OpenCV is not installed.
    CalibrationError
        If the file cannot be written.
    """
    refuse_overwriting({"out": out}, features)
    lens_formats.check(as_)
    cv2 = opencv()
    name_of = str(features) if isinstance(features, (str, Path)) else FRAME
    rows = given_rows(features, static=True)
    boards = boards_of(rows, name_of)
    folder = Path(images)
    of_bag = rosbag.pictures_over_time(folder, rows) if rosbag.is_bag(folder) else None
    fit = {board.camera: imaging.numbers_to_fit(board.row) for board in boards.values()}
    views: dict[str, dict[str, BoardCorners]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    missed: list[str] = []
    board_of: dict[str, tuple[str, Board]] = {}
    for name, board in boards.items():
        if not isinstance(board.board, Board):
            raise board.row.fault("the lens comes from a flat board, not from markers on a body")
        for label, grey in (
            _pictures(folder, board, list(boards.values())) if of_bag is None else of_bag.get(name, {}).items()
        ):
            if grey is None:
                raise MeasurementError(f"there is no picture {label} that OpenCV reads", file=str(folder))
            size = sizes.setdefault(board.camera, board.size or grey.shape[::-1])
            if grey.shape[::-1] != size:
                raise MeasurementError(
                    f"{label} has {grey.shape[1]} × {grey.shape[0]} pixels, the camera {size[0]} × {size[1]}",
                    file=str(folder),
                )
            number, uv = board.find(grey)
            if not tell_a_homography(board.board.corners[number]):
                missed.append(label)
                continue
            views.setdefault(board.camera, {})[label] = board.board.corners[number], uv
            board_of[label] = _name_of(board, list(boards.values())), board.board
    if not views:
        raise no_board(name_of)
    lenses = tuple(calibrated(cv2, camera, sizes[camera], views[camera], str(folder), fit[camera]) for camera in views)
    lenses, rig, notes = rigs(lenses, views, board_of, str(folder))
    result = LensCalibration(lenses, with_numbers(rows, lenses), tuple(missed), rig, notes)
    if out is not None:
        result.save(out, as_)
    return result


def instants(pictures: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """When each picture was taken: those of several cameras with the same value were taken together.

    The last number of each name counts: as a running number, or with ten digits and more before its point as a stamp in
    seconds, milli-, micro- or nanoseconds. Where a name has none, or two of a camera the same, names count themselves.

    Parameters
    ----------
    pictures : dict of str to sequence of str
        Names by camera.
    """
    name_of = {
        picture: re.sub(r"\.[A-Za-z]+$", "", picture.rsplit("/", 1)[-1])
        for names in pictures.values()
        for picture in names
    }
    number = {picture: re.findall(r"\d+(?:\.\d+)?", name)[-1:] for picture, name in name_of.items()}
    if not all(number.values()):
        return name_of
    at = {picture: float(n) / 10.0 ** max(len(n.split(".")[0]) - 10, 0) for picture, (n,) in number.items()}
    order = sorted(at, key=lambda picture: at[picture])
    group = np.cumsum(np.diff([at[picture] for picture in order], prepend=at[order[0]]) > SAME_S)
    out = dict(zip(order, map(str, group), strict=True))
    twice = any(len({out[picture] for picture in names}) < len(names) for names in pictures.values())
    return name_of if twice else out


def rigs(
    lenses: Sequence[Lens], shown: Shown, board_of: Mapping[str, tuple[str, Board]], source: str
) -> tuple[tuple[Lens, ...], tuple[DeviceFrame, ...], tuple[str, ...]]:
    """Cameras that see boards together, adjusted together: lenses, places in the first of each rig, and notes.

    Parameters
    ----------
    lenses : sequence of Lens
        Of each camera by itself.
    shown : dict of str to dict of str to Corners
        By camera and picture.
    board_of : dict of str to (str, Board)
        What each picture shows: the board's name, and which it is.
    source : str
        For messages.
    """
    without_rig, rig, notes = {lens.camera: lens for lens in lenses}, [], []
    at = instants(
        {
            f"{camera} {board}": [p for p in pictures_of if board_of[p][0] == board]
            for camera, pictures_of in shown.items()
            for board in {board_of[p][0] for p in pictures_of}
        }
    )
    views = [(lens.camera, picture, *shown[lens.camera][picture]) for lens in lenses for picture in shown[lens.camera]]
    rows = _rows(views, without_rig, {picture: f"{at[picture]} {board_of[picture][0]}" for picture in at}, source)
    unassigned = list(without_rig)
    while unassigned:
        rows, values = _placed(rows, unassigned, {picture: board for picture, (_, board) in board_of.items()})
        cameras = [name for shape, name in values if shape == "centre"]
        unassigned = [camera for camera in unassigned if camera not in cameras]
        if len(cameras) == 1:
            notes += [f"{cameras[0]} sees no board together with another camera"] if len(without_rig) > 1 else []
            continue
        of_rig = rows.select(np.isin(rows.feature, cameras))
        problem, state = _adjusted(of_rig, cameras[0], values)
        pixels = _pixels(problem, state)
        misses = {name: rms(pixels[of_rig.target == name]) for name in set(of_rig.target)}
        spread = [name for name, miss in misses.items() if miss > APART * np.median(list(misses.values()))]
        if spread and len(spread) <= 0.25 * len(misses):
            off = np.isin(of_rig.target, spread)
            names = [str(pose) for pose in of_rig.pose[off]]
            notes.append(f"not taken together, and left out of the rig: {first_of(names, 10)}")
            of_rig = of_rig.select(~off)
            problem, state = _adjusted(of_rig, cameras[0], dict(state.values))
            pixels = _pixels(problem, state)
        heldout, u95 = (
            left_out(problem, state, imaging.per_pixel(np.asarray(of_rig.corners)), FOLDS),
            half_widths(problem, state),
        )
        for camera in cameras:
            pictures_of, numbers, wide = (
                of_rig.feature == camera,
                without_rig[camera].numbers.copy(),
                np.zeros(len(FITTED)),
            )
            for k, name in enumerate(FITTED):
                if (name, camera) in problem.layout:
                    numbers[k], wide[k] = state.values[name, camera][0], u95[problem.layout[name, camera][1]]
            count = np.isfinite(np.asarray(of_rig.corners)[pictures_of, :, 2]).sum(axis=1)
            without_rig[camera] = replace(
                without_rig[camera],
                numbers=numbers,
                u95=wide,
                pictures=of_rig.pose[pictures_of],
                corners=count,
                pixels=pixels[pictures_of],
                heldout_pixels=heldout[pictures_of],
            )
            if camera != cameras[0]:
                place, turn = (u95[problem.layout[key, camera][1] :][:3].max() for key in ("centre", "attitude"))
                T = frames.transform(state.values["attitude", camera], state.values["centre", camera])
                rig.append(DeviceFrame(camera, "camera", cameras[0], T, float(place), float(turn)))
    return tuple(without_rig.values()), tuple(rig), tuple(notes)


def _rows(
    views: Sequence[tuple[str, str, FloatArray, FloatArray]],
    lenses: Mapping[str, Lens],
    target_of: Mapping[str, str],
    source: str,
) -> FeatureSet:
    """Pictures as rows: a camera is a feature in the hall, the board at an instant a target on a flange that stands."""
    arm, m = open_robot("irb1600", nominal=True).nominal, len(views)
    corners = np.full((m, max(len(uv) for *_, uv in views), 5), np.nan)
    for k, (_, _, xy, uv) in enumerate(views):
        corners[k, : len(uv)] = np.column_stack([xy, uv, np.full(len(uv), imaging.PIXEL_U95)])
    target = [target_of[picture] for _, picture, _, _ in views]
    known = {
        name: Feature(
            name, "image", imaging=Imaging(lens.numbers, tuple(np.array(FITTED)[lens.u95 > 0.0]), size=lens.size)
        )
        for name, lens in lenses.items()
    }
    return FeatureSet.computed(
        arm,
        q=np.zeros((m, len(arm.joint_columns))),
        pose=np.array([picture for _, picture, _, _ in views], dtype=object),
        pose_index=np.unique(target, return_inverse=True)[1],
        target=target,
        kind=["image"] * m,
        feature=[camera for camera, _, _, _ in views],
        u95=imaging.u95_of(corners),
        features=known,
        source=source,
        corners=corners,
        flange=np.tile(np.eye(4), (m, 1, 1)),
    )


def _placed(
    rows: FeatureSet, cameras: Sequence[str], board_of: Mapping[str, Board]
) -> tuple[FeatureSet, dict[feature_problem.UnknownKey, FloatArray]]:
    """Where cameras are that see boards together with the first, directly or by others, and where these boards are.

    Each camera's place is that of one instant, which agrees best with all others. Boards that look the same after half
    a turn are numbered as the camera does that was placed before.
    """
    corners = np.array(rows.corners)
    D = np.zeros((len(rows), 4, 4))
    for name, feature in rows.features.items():
        is_camera = rows.feature == name
        assert feature.imaging is not None
        D[is_camera] = boards(feature.imaging.lens, corners[is_camera])
    depth = float(np.median(D[np.isin(rows.feature, cameras), 2, 3]))
    T: dict[str, FloatArray] = {cameras[0]: np.eye(4)}
    T_of_camera: dict[str, FloatArray] = {}

    def add(camera: str) -> None:
        for k in np.flatnonzero(rows.feature == camera):
            T_of_camera.setdefault(rows.target[k], T[camera] @ D[k])

    add(cameras[0])
    unplaced = list(cameras[1:])
    while unplaced:
        for camera in unplaced:
            is_camera = np.array(
                [k for k in np.flatnonzero(rows.feature == camera) if rows.target[k] in T_of_camera], dtype=int
            )
            if len(is_camera) < FEWEST_PICTURES:
                continue
            turns = np.tile(np.eye(4), (2, len(is_camera), 1, 1))
            for j, board in enumerate(board_of[picture] for picture in rows.pose[is_camera]):
                if board.turnable:
                    turns[1, j] = np.diag([-1.0, -1.0, 1.0, 1.0])
                    turns[1, j, :2, 3] = board.corners.min(axis=0) + board.corners.max(axis=0)
            candidates = np.array([T_of_camera[name] for name in rows.target[is_camera]]) @ frames.inverse(
                D[is_camera] @ turns
            )
            each = candidates.reshape(-1, 4, 4)
            angle = np.arccos(
                np.clip(0.5 * np.einsum("aij,fnij->afn", each[:, :3, :3], candidates[..., :3, :3]) - 0.5, -1, 1)
            )
            off = angle + np.linalg.norm(each[:, None, None, :3, 3] - candidates[..., :3, 3], axis=-1) / depth
            spread = np.median(off.min(axis=1), axis=1)
            best = int(np.argmin(spread))
            if spread[best] > STIFF:
                continue
            T[camera] = each[best]
            turned = off[best].argmin(axis=0) == 1
            corners[is_camera[turned], :, :2] = turns[1, turned, None, :2, 3] - corners[is_camera[turned], :, :2]
            D[is_camera] = np.where(turned[:, None, None], D[is_camera] @ turns[1], D[is_camera])
            add(camera)
            unplaced.remove(camera)
            break
        else:
            break
    values: dict[feature_problem.UnknownKey, FloatArray] = {}
    for place, turn, placed in (("centre", "attitude", T), (TOOL, "axes", T_of_camera)):
        for name, frame in placed.items():
            values |= {(place, name): frame[:3, 3], (turn, name): frame[:3, :3]}
    for name in T:
        view = rows.features[name].imaging
        assert view is not None
        values |= {(number, name): view.lens[k : k + 1] for k, number in enumerate(FITTED)}
    return replace(rows, corners=corners), values


def _adjusted(
    rows: FeatureSet, first: str, values: Mapping[feature_problem.UnknownKey, FloatArray]
) -> tuple[FeatureProblem, FeatureState]:
    """The least squares of a rig, whose first camera stands where it is."""
    known = {(key, first): values[key, first] for key in ("centre", "attitude")}
    problem = FeatureProblem(open_robot("irb1600", nominal=True).nominal, rows, [], known)
    start = {key: value for key, value in values.items() if key in problem.layout} | known
    state = feature_problem.settle(problem, FeatureState(start, np.zeros(0)))
    feature_problem.refuse_undetermined(problem, state)
    return problem, state


def _pixels(problem: FeatureProblem, state: FeatureState) -> FloatArray:
    """By how much the corners of each picture miss, root mean square, pixels."""
    return np.asarray(problem.distances(state) / imaging.per_pixel(np.asarray(problem.rows.corners)))


def _name_of(seen_board: Seen, all_shown: Sequence[Seen]) -> str:
    """Of a board that several cameras see: of cameras on the arm it has a name for each, of which theirs are parts."""
    if seen_board.row["kind"] == "image":
        return seen_board.row["target"]
    of_camera = [other for other in all_shown if other.camera == seen_board.camera]
    return seen_board.row["feature"].replace(seen_board.camera, "") if len(of_camera) > 1 else repr(seen_board.board)


def _pictures(folder: Path, seen_board: Seen, all_shown: Sequence[Seen]) -> Iterator[tuple[str, Any]]:
    """Names of a feature's pictures, and these in grey: in a folder of its name or its camera's, or so named."""
    name = seen_board.row["feature"]
    sole = [other.camera for other in all_shown].count(seen_board.camera) == 1
    candidates = [folder / name, *([folder / seen_board.camera] if sole else [])]
    of_feature = next((each for each in candidates if each.is_dir()), folder)
    begin = name if of_feature == folder and len(all_shown) > 1 else ""
    paths = [path for path in of_feature.iterdir() if path.suffix.lower() in ENDINGS] if folder.is_dir() else []
    paths = [path for path in paths if path.name.startswith(begin)]
    if (begin and not paths) or not folder.is_dir():
        raise MeasurementError("there is no such folder of pictures", file=str(folder / begin))
    for path in sorted(paths):
        yield path.relative_to(folder).as_posix(), read_picture(path)
