"""Hand-eye calibration: where a camera is on the flange and a board in the cell (or the other way round), from corners.

Unknown are the device on the flange, each device in the cell, and what is to be fitted of the lens. Corners in pixels
are adjusted by least squares (`irbcal.identification.images`) along the cell's graph of frames; the robot is taken as
it is, by its joints or by the poses of its flange that a controller shows. No guess is needed: the start is closed form
(Zhang 2000, Shah 2013).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.distributions import NORMAL_95, student_within
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification import feature_problem
from irbcal.identification.feature_problem import NO_TERMS, TOOL, FeatureProblem, FeatureState
from irbcal.identification.linear_model import Rows
from irbcal.identification.observation_kind import DIMENSIONS
from irbcal.io.corners import corners
from irbcal.io.opening import RobotLike, open_robot
from irbcal.io.robot_section import FilePose
from irbcal.measurement import features, imaging, pictures, recordings
from irbcal.measurement.column_names import POSE
from irbcal.measurement.corner_numbers import numbered_alike
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.measurement.lens import with_lenses
from irbcal.measurement.recordings import FLANGE, easy_handeye
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_set
from irbcal.summary import Content, Paragraph, Result, Table, remarks
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

SAVED_AS = ("json", "easy_handeye2")
FEWEST_PICTURES = 3
"""Pictures that are needed; ten or more with the flange turned about different axes are better."""
FOLDS = 16
"""Pictures are left out in as many parts at most."""
STEP_SHARE = 1e-3
"""Part of an unknown's step that derivatives are taken over."""
UNEXPLAINED = 3.0
"""Standard deviations by which pictures may miss more than the noise of their corners explains."""
ALL_TOLD = 1e-9
"""Share of its misses that a pose keeps, below which it tells a number alone."""
TOO_FAR = 3.0
"""Times the scatter of corners within a picture, above which the misfit over all pictures is that of robot or lens."""


@dataclass(frozen=True, eq=False)
class DeviceFrame(Content):
    """A camera or a board."""

    name: str
    """Of the features' file."""
    device: str
    """``camera`` or ``board``."""
    on: str
    """``flange`` or ``base``; of one camera of a rig the first camera's name."""
    T: FloatArray
    """Shape (4, 4). In the tip link, the base link or the first camera, metres. A camera looks along its z, x is to the
    right of the picture; a board's origin and axes are those of its corners.
    """
    u95_m: float
    u95_rad: float
    """Half-widths that hold 95 % of a coordinate's and an angle's errors, largest of three."""

    CONTENT = "name device on *pose u95_mm=u95_m u95_deg=u95_rad"

    @property
    def pose(self) -> dict[str, float]:
        """Place in millimetres and unit quaternion, scalar first."""
        return FilePose.from_transform(self.T).model_dump()


def frames_table(title: str, devices: Sequence[DeviceFrame]) -> Table:
    """Frames as people read them."""
    rows: list[tuple[str | float | int | None, ...]] = [
        (
            f"{frame.device} {frame.name} {'on the' if frame.on in ('flange', 'base') else 'in'} {frame.on}",
            *(float(value) / MM for value in frame.T[:3, 3]),
            *(float(value) for value in frames.rpy_from_matrix(frame.T[:3, :3]) / DEG),
            frame.u95_m / MM,
            frame.u95_rad / DEG,
        )
        for frame in devices
    ]
    return Table(title, ("frame", "x mm", "y mm", "z mm", "roll", "pitch", "yaw", "u95 mm", "deg"), tuple(rows))


@dataclass(frozen=True, eq=False, repr=False)
class HandEye(Result):
    """Cameras and boards of a cell.

    Attributes
    ----------
    robot : str
        Whose kinematics were taken, or ``poses of the flange``.
    devices : tuple of DeviceFrame
    lens : dict of str to dict of str to (float, float)
        Fitted numbers of each camera, pixels (``k1`` without unit), and their 95 % half-widths.
    pose, feature : ndarray of str, shape (m,)
        Of each picture.
    corners : ndarray of int, shape (m,)
    pixels, heldout_pixels : ndarray, shape (m,)
        Root mean square distance of a picture's corners: in the fit, and while the picture was left out (NaN where its
        board or camera is in no other).
    size_mm : ndarray, shape (m,)
        The first in millimetres at the board.
    within_pixels : float
        By how much corners scatter within a picture, a coordinate: what a better robot would leave.
    doubts : tuple of str
    simulated : bool
    notes : tuple of str
        Which pictures were left out.
    links : (str, str)
        Frames of ROS that the base and the flange have.
    rig : tuple of DeviceFrame
        All other cameras on the flange (in the hall) in the first: better known than each by itself.
    """

    robot: str
    devices: tuple[DeviceFrame, ...]
    lens: dict[str, dict[str, tuple[float, float]]]
    pose: NameArray
    feature: NameArray
    corners: IntArray
    pixels: FloatArray
    heldout_pixels: FloatArray
    size_mm: FloatArray
    within_pixels: float
    doubts: tuple[str, ...] = ()
    simulated: bool = False
    notes: tuple[str, ...] = ()
    links: tuple[str, str] = ("base_link", "tool0")
    rig: tuple[DeviceFrame, ...] = ()

    @property
    def rms_pixels(self) -> float:
        """Root mean square distance of all corners, pixels."""
        return float(np.sqrt(np.average(self.pixels**2, weights=self.corners)))

    @property
    def heldout_rms_pixels(self) -> float:
        """The same of pictures while they were left out; NaN where none was."""
        measured = np.isfinite(self.heldout_pixels)
        if not measured.any():
            return float("nan")
        return float(np.sqrt(np.average(self.heldout_pixels[measured] ** 2, weights=self.corners[measured])))

    CONTENT = (
        "simulated robot frames=devices rig lens=lens_numbers pictures=pixels.__len__ rms_px=rms_pixels "
        "heldout_px=heldout_rms_pixels within_px=within_pixels doubts notes"
    )
    COLUMNS = "pose feature corners rms_px=pixels heldout_px=heldout_pixels rms_mm=size_mm"

    def lens_numbers(self) -> dict[str, dict[str, dict[str, float]]]:
        """Fitted numbers of each camera's lens."""
        return {
            camera: {name: {"value": value, "u95": u95} for name, (value, u95) in fitted.items()}
            for camera, fitted in self.lens.items()
        }

    def save(self, out: str | PathLike[str], as_: str = "json") -> Path:
        """Write `to_dict` as JSON, or the camera's place as easy_handeye2 has it.

        Raises
        ------
        CalibrationError
            If it cannot be written.
        OptionError
            If there are several cameras.
        """
        text = json.dumps(self.to_dict(), indent=1) + "\n"
        if as_ == SAVED_AS[1]:
            cameras, boards = ([d for d in self.devices if d.device == device] for device in ("camera", "board"))
            if len(cameras) != 1:
                raise OptionError(f"as_: a file of {as_} has one camera, here are {len(cameras)}", parameter="as_")
            kind = "image-on-tool" if cameras[0].on == "flange" else "image"
            ros = dict(zip(("base", "flange"), self.links, strict=True))
            ros |= {"camera": str(cameras[0].name), "marker": str(boards[0].name)}
            text = easy_handeye.result_text(Path(out).stem, kind, cameras[0].T, ros)
        write_set({Path(out): text.encode()})
        return Path(out)

    def report(self) -> Sequence[Paragraph]:
        """Frames with their intervals, how well corners agree, and what limits that."""
        heldout = self.heldout_rms_pixels
        proof = "" if np.isnan(heldout) else f", {heldout:.2f} px in pictures that were held out in turn"
        headline = (
            f"{'SIMULATED: ' if self.simulated else ''}{int(self.corners.sum())} corners in {len(self.pixels)} "
            f"pictures agree with {self.robot} within {self.rms_pixels:.2f} px (rms){proof}"
        )
        paragraphs: list[Paragraph] = [
            headline,
            frames_table("Cameras and boards, angles in degrees", (*self.devices, *self.rig)),
        ]
        for camera, numbers in self.lens.items():
            paragraphs.append(
                f"Lens of {camera}: " + ", ".join(f"{n} {v:.6g} ± {u95:.2g}" for n, (v, u95) in numbers.items())
            )
        scale = float(np.sqrt(np.average(self.size_mm**2, weights=self.corners)))
        paragraphs.append(
            f"Within a picture corners scatter by {self.within_pixels:.2f} px; over all pictures they miss by "
            f"{scale:.2f} mm at the board"
        )
        if self.rms_pixels > TOO_FAR * self.within_pixels:
            paragraphs[-1] = (
                f"{paragraphs[-1]}: robot or lens limit it. Calibrate the robot with these rows (irbcal calibrate)."
            )
        return [*paragraphs, *remarks("Doubt", self.doubts, good=False), *remarks("Note", self.notes)]


def hand_eye(
    measurements: TableLike,
    features: TableLike | None = None,
    out: str | PathLike[str] | None = None,
    *,
    robot: RobotLike | None = None,
    images: str | Path | None = None,
    as_: Literal["json", "easy_handeye2"] = "json",
    base_link: str | None = None,
    tip_link: str | None = None,
) -> HandEye:
    """Where cameras and boards are on the robot and in the cell, the robot taken as it is.

    Parameters
    ----------
    measurements : str, Path or DataFrame
        Corners as ``irbcal corners`` writes them, or with images a row a picture: ``image`` and joints (``q1_deg`` …),
        or the flange in the robot base as the controller shows it (``flange_x_mm`` … ``flange_qz``; a row a picture
        also ``x_mm`` … ``qz``); or a data folder of industrial_calibration or robot_cal_tools, samples of
        easy_handeye2, poses in OpenCV's FileStorage, or a bag of ROS 2 or 1.
    features : str, Path or DataFrame, optional
        Cameras and boards, as for corners. Where nothing is known of a lens but the size of its pictures, the lens is
        calibrated from the corners alone, and fitted from there.
    out : str or Path, optional
        File to write, such as hand_eye.json.
    robot : str, Path, Record or a result that holds one, optional
        Calibration folder, URDF or name of the robot whose joints these are; none where the flange is given.
    images : str or Path, optional
        Folder of pictures.
    as_ : str
        What to write: all of it as JSON, or the camera's place as easy_handeye2 and its publisher read it (.calib).
    base_link, tip_link : str, optional
        Base and tip link between which a URDF's joints are, such as the foot of a track.

    Raises
    ------
    MeasurementError
        If a file does not keep its format.
    IdentificationError
        If the pictures leave a camera or a board open.
    OptionError
        If there are joints but no robot, or a robot beside poses of the flange, or OpenCV is needed and not installed.
    CalibrationError
        If the file cannot be written.
    """
    refuse_overwriting({"out": out}, measurements, features, robot)
    if as_ not in SAVED_AS:
        raise OptionError(f"as_: expected one of {', '.join(SAVED_AS)}, found {as_}", parameter="as_")
    if robot is None and (base_link or tip_link):
        raise OptionError("base_link: name the robot whose links these are", parameter="base_link")
    opened = None if robot is None else open_robot(robot, base_link=base_link, tip_link=tip_link)
    recording = recordings.opened(measurements, features, images, None if opened is None else opened.nominal)
    features, images = recording.features, recording.images
    assert features is not None
    cells = InputTable.read(recording.rows).cells
    notes = list(recording.notes)
    if recording.pictures is not None:
        board_corners = pictures.corners_of(recording.pictures.get, cells, features, str(measurements))
        cells = board_corners.to_frame()
        notes += board_corners.notes()
    elif images is not None:
        cells = cells.rename(columns=dict(zip(POSE, FLANGE, strict=True)) if set(POSE) <= set(cells.columns) else {})
        board_corners = corners(images, cells, features)
        cells = board_corners.to_frame()
        notes += board_corners.notes()
    features, lenses = with_lenses(cells, features)
    notes += [
        f"lens of {lens.camera} from these pictures alone: {lens.rms_pixels:.2f} px, {lens.heldout_rms_pixels:.2f} px "
        "in pictures that were left out"
        for lens in lenses
    ]
    posed = set(FLANGE) <= set(map(str, cells.columns))
    if posed and robot is not None:
        raise OptionError(
            "robot: the rows have poses of the flange: leave out these columns, or the robot", parameter="robot"
        )
    if not posed and robot is None:
        raise OptionError(
            f"robot: name the robot whose joints these are, or give columns {', '.join(FLANGE)}", parameter="robot"
        )
    arm = (
        open_robot("irb1600", nominal=True) if opened is None else opened
    ).nominal  # joints of flange poses are not read
    if posed:
        cells = cells.assign(**dict.fromkeys(arm.joint_columns, 0.0))
    as_given = recording.pictures is None and images is None and not posed  # messages then name file and row
    rows = _read(recording.rows if as_given else cells, features, arm, posed)
    by = Robot(arm) if opened is None else opened.robot
    problem = FeatureProblem(arm, rows, [], robot=by)
    if len(rows) < FEWEST_PICTURES:
        raise IdentificationError(
            f"{len(rows)} pictures are too few: {FEWEST_PICTURES} are needed, ten or more are better"
        )
    state = feature_problem.start(problem)
    name = "the poses of the flange" if opened is None else opened.robot.arm.name
    links = ("base_link", "tool0") if opened is None else (opened.robot.arm.base_link, opened.robot.arm.tip_link)
    result = replace(_result(problem, state, name), links=links, notes=tuple(notes))
    if out is not None:
        result.save(out, as_)
    return result


def _read(cells: pd.DataFrame, camera_file: TableLike, arm: Arm, posed: bool) -> FeatureSet:
    """Pictures as rows; with the poses of the flange where these are given."""
    rows = features.read(cells, camera_file, arm)
    if rows.corners is None or not np.isin(rows.kind.astype(str), list(imaging.TARGETS)).all():
        raise MeasurementError(
            f"hand-eye takes corners of boards only, kinds {' and '.join(imaging.TARGETS)}", file=rows.source
        )
    if posed:
        rows = replace(rows, flange=InputTable(rows.cells, rows.source).poses("flange_"))
    flange = arm.forward(rows.q) if rows.flange is None else rows.flange
    return numbered_alike(rows, flange[:, :3, :3])


def _result(problem: FeatureProblem, state: FeatureState, robot: str) -> HandEye:
    """Frames, intervals and errors at the solution, with each part of the pictures held out in turn."""
    rows = problem.rows
    assert rows.corners is not None
    u95 = half_widths(problem, state)

    def half_width(key: tuple[str, str]) -> float:
        shape, at = problem.layout[key]
        return float(u95[at : at + DIMENSIONS[shape]].max())

    devices: dict[tuple[str, str], DeviceFrame] = {}
    lens: dict[str, dict[str, tuple[float, float]]] = {}
    count = np.isfinite(rows.corners[:, :, 2]).sum(axis=1)
    pixels, size = np.zeros(len(rows)), np.zeros(len(rows))
    scale = imaging.per_pixel(rows.corners)
    doubts = []
    for of_group in problem.group_residuals(state):
        group, target = of_group.group, of_group.group.target
        on_flange = imaging.TARGETS[group.kind.name]
        in_cell = "camera" if on_flange == "board" else "board"
        tool, axes = (TOOL, target), ("axes", target)
        T = frames.transform(state.values[axes], state.values[tool])
        devices["flange", target] = DeviceFrame(target, on_flange, "flange", T, half_width(tool), half_width(axes))
        name = group.feature.name
        T = frames.transform(state.values["attitude", name], state.values["centre", name])
        u = half_width(("centre", name)), half_width(("attitude", name))
        devices["base", name] = DeviceFrame(name, in_cell, "base", T, *u)
        camera = target if on_flange == "camera" else name
        for number, key in group.keys().items():
            if number in imaging.FITTED and key in problem.layout:
                lens.setdefault(camera, {})[number] = float(state.values[key][0]), half_width(key)
        assert of_group.residuals.size is not None
        group_rows = group.rows
        size[group_rows] = of_group.residuals.size
        pixels[group_rows] = size[group_rows] / scale[group_rows]
        doubts.append(group.kind.doubt(of_group.observed, of_group.residuals))
    return HandEye(
        robot,
        tuple(devices.values()),
        lens,
        rows.pose.astype(object),
        rows.feature.astype(object),
        count,
        pixels,
        left_out(problem, state, scale),
        size / MM,
        within_pixels(problem, state),
        tuple(dict.fromkeys(filter(None, doubts))),
        rows.simulated,
        rig=_rig(problem, state, tuple(devices.values())),
    )


def _rig(problem: FeatureProblem, state: FeatureState, devices: Sequence[DeviceFrame]) -> tuple[DeviceFrame, ...]:
    """All other cameras on the flange, or in the hall, in the first of them."""
    out = []
    for on in ("flange", "base"):
        cameras = [device for device in devices if (device.device, device.on) == ("camera", on)]
        for camera in cameras[1:]:
            both = (cameras[0].name, camera.name)

            def between(values: FeatureState, both: tuple[str, str] = both, on: str = on) -> FloatArray:
                place, turn = (TOOL, "axes") if on == "flange" else ("centre", "attitude")
                a, b = (frames.transform(values.values[turn, name], values.values[place, name]) for name in both)
                return np.asarray(frames.inverse(a) @ b)

            T, slopes = between(state), []
            for k in range(problem.nuisance):
                step = np.zeros(problem.nuisance)
                step[k] = STEP_SHARE
                ahead, back = (between(problem.moved(state, sign * step)) for sign in (1.0, -1.0))
                turned = T[:3, :3].T @ (ahead - back)[:3, :3]
                slopes.append(
                    np.r_[(ahead - back)[:3, 3], turned[2, 1], turned[0, 2], turned[1, 0]] / (2.0 * STEP_SHARE)
                )
            u95 = half_widths(problem, state, np.array(slopes).T)
            out.append(DeviceFrame(camera.name, "camera", both[0], T, float(u95[:3].max()), float(u95[3:].max())))
    return tuple(out)


def half_widths(problem: FeatureProblem, state: FeatureState, of: FloatArray | None = None) -> FloatArray:
    """Half-widths that hold 95 % of the unknowns' errors, shape (unknowns,), SI units (pixels).

    Of other numbers with their derivatives ``of`` by the unknowns' steps, shape (numbers, unknowns).

    From noise of corners, where that explains what pictures miss. Else the robot errs, by more in some directions than
    in others, and alike for all cameras at a pose: then from the sum of what each pose contributes to the solution
    (Bell and McCaffrey 2002, CR2), with Student's factor of as many numbers as there are poses, less one.
    """
    rows = Rows.joined(list(problem.dense(state, NO_TERMS)))
    J, y, row = rows.J, rows.y, rows.row
    pose = np.where(row >= 0, problem.rows.pose_index[row], -1)
    H_inverse, freedom = np.linalg.pinv(J @ J.T, hermitian=True), max(len(y) - len(J), 1)
    A = (np.diag(problem.sizes) if of is None else of) @ H_inverse
    noise, variance = float(y @ y) / freedom, np.einsum("ij,ij->i", A @ J, A @ J)
    u95 = float(np.median(imaging.typical_u95(np.asarray(problem.rows.corners))))
    of_corners = (within_pixels(problem, state) / u95 * problem.typical / MM) ** 2
    if noise <= (1.0 + UNEXPLAINED * np.sqrt(2.0 / freedom)) * of_corners:
        return np.asarray(student_within(0.95, freedom) * np.sqrt(noise * variance))
    by_poses, poses = np.zeros(len(A)), np.unique(pose[pose >= 0])
    for k in poses:
        J_of_pose = J[:, pose == k]
        share, V = np.linalg.eigh(np.eye(J_of_pose.shape[1]) - J_of_pose.T @ H_inverse @ J_of_pose)
        by, determined_by_pose = (
            A @ J_of_pose @ V,
            share > ALL_TOLD,
        )  # what a pose alone tells is missed by nothing: noise as of others
        by_poses += (
            by[:, determined_by_pose] @ (V.T @ y[pose == k] / np.sqrt(np.maximum(share, ALL_TOLD)))[determined_by_pose]
        ) ** 2
        by_poses += noise * (by[:, ~determined_by_pose] ** 2).sum(axis=1)
    student = student_within(0.95, max(len(poses) - 1, 1))
    return np.asarray(np.maximum(NORMAL_95 * np.sqrt(of_corners * variance), student * np.sqrt(by_poses)))


def within_pixels(problem: FeatureProblem, state: FeatureState) -> float:
    """By how much corners scatter within pictures, a coordinate: what no place of camera and board explains."""
    squares, spare = 0.0, 0.0
    corners = np.asarray(problem.rows.corners)
    count, scale = np.isfinite(corners[:, :, 2]).sum(axis=1), imaging.per_pixel(corners)
    for of_group in problem.group_residuals(state):
        rows, r, size = of_group.group.rows, of_group.residuals.r, np.asarray(of_group.residuals.size)
        squares += float((np.maximum(size**2 - (r**2).sum(axis=1), 0.0) * count[rows] / scale[rows] ** 2).sum())
        spare += float(np.maximum(2 * count[rows] - r.shape[1], 0).sum())
    return float(np.sqrt(squares / max(spare, 1.0)))


def left_out(problem: FeatureProblem, state: FeatureState, scale: FloatArray, parts: int = FOLDS) -> FloatArray:
    """Pixels by which pictures miss while they are left out; NaN where the others do not show their camera or board.

    What stands nowhere but in pictures that are left out is placed by these, which is counted.
    """
    rows = problem.rows
    out = np.full(len(rows), np.nan)
    fold = rows.pose_index % min(parts, rows.poses)
    for k in np.unique(fold):
        fitted_rows = fold != k
        fitted_problem = FeatureProblem(problem.arm, rows.select(fitted_rows), [], problem.fixed, robot=problem.robot)
        if fitted_rows.sum() < FEWEST_PICTURES or set(rows.feature[~fitted_rows]) - set(rows.feature[fitted_rows]):
            continue
        values = {
            key: value for key, value in state.values.items() if key in fitted_problem.layout or key in problem.fixed
        }
        try:
            fitted = feature_problem.settle(fitted_problem, FeatureState(values, np.zeros(0)))
            feature_problem.refuse_undetermined(fitted_problem, fitted)
        except IdentificationError:
            continue
        heldout_problem = FeatureProblem(
            problem.arm, rows.select(~fitted_rows), [], dict(fitted.values), robot=problem.robot
        )
        placed = feature_problem.settle(heldout_problem, FeatureState({**state.values, **fitted.values}, np.zeros(0)))
        numbers = 2.0 * float(np.isfinite(np.asarray(heldout_problem.rows.corners)[:, :, 2]).sum())
        out[~fitted_rows] = (
            heldout_problem.distances(placed)
            / scale[~fitted_rows]
            * np.sqrt(numbers / max(numbers - heldout_problem.nuisance, 1.0))
        )
    return out
