"""SIMULATED pictures of cameras that see one board together: a rig alone, and one on the flange of a robot that errs."""

import numpy as np
import pandas as pd
from feature_cases import in_image

from irbcal.measurement import imaging
from irbcal.measurement.boards import Board
from irbcal.measurement.lens import Lens
from irbcal.measurement.recordings import FLANGE
from irbcal.modeling import frames
from irbcal.units import MM

SIZE = (1280, 960)
LENSES = {
    "left": (1100.0, 1105.0, 650.0, 470.0, -0.12, 0.05, 0.0, 0.0, 0.0),
    "right": (1080.0, 1083.0, 630.0, 490.0, -0.10, 0.03, 0.0, 0.0, 0.0),
    "third": (1090.0, 1088.0, 640.0, 480.0, -0.08, 0.01, 0.0, 0.0, 0.0),
}
PLACES = {
    "left": np.eye(4),
    "right": frames.transform(
        frames.rotation_from_vector(np.array([0.02, -0.15, 0.01])), np.array([0.12, 0.004, 0.01])
    ),
    "third": frames.transform(frames.rotation_from_vector(np.array([0.01, 0.1, -0.3])), np.array([-0.1, 0.05, 0.0])),
}
BOARD = Board("chessboard", 10, 7, 0.03)
XYZ = np.pad(BOARD.corners, ((0, 0), (0, 1)))


def pictures(count, seed, noise, shown_to=("left", "right")):
    """Corners by camera and picture, of boards that all these cameras see whole."""
    rng = np.random.default_rng(seed)
    shown = {camera: {} for camera in shown_to}
    while len(shown[shown_to[0]]) < count:
        middle = np.array([rng.uniform(-0.09, 0.21), rng.uniform(-0.15, 0.15), rng.uniform(0.45, 0.8)])
        R = frames.rotation_from_vector(rng.uniform(-0.6, 0.6, 3))
        T = frames.transform(R, middle - R @ XYZ.mean(axis=0))
        uv = {}
        for camera in shown_to:
            U = frames.inverse(PLACES[camera]) @ T
            uv[camera] = in_image(LENSES[camera], XYZ @ U[:3, :3].T + U[:3, 3])
        if all(((at > 0) & (at < SIZE)).all() for at in uv.values()):
            for camera, at in uv.items():
                name = f"{camera}/{camera}{len(shown[camera]) + 1:02d}.png"
                shown[camera][name] = BOARD.corners, at + noise * rng.standard_normal(at.shape)
    return shown


def alone(shown, numbers=LENSES, fitted=6):
    """Lenses as if each camera had been calibrated by itself."""
    u95 = np.where(np.arange(9) < fitted, 1.0, 0.0)
    nothing = {camera: np.zeros(len(of)) for camera, of in shown.items()}
    return [
        Lens(camera, SIZE, np.array(numbers[camera]), u95, np.array(list(of)), *[nothing[camera]] * 3)
        for camera, of in shown.items()
    ]


def boards_of(shown, name="board"):
    return {picture: (name, BOARD) for of in shown.values() for picture in of}


ON_FLANGE = frames.transform(frames.rotation_from_vector(np.array([0.05, 0.1, 0.4])), np.array([0.05, 0.02, 0.1]))
"""The first camera."""


def on_flange(poses, seed, noise, error, cameras=("left", "right")):
    """Rows of corners with flange poses, features, and the true frame of each device where `hand_eye` says it.

    The flange is ``error`` metres and radians off in each coordinate, alike for all cameras at a pose.
    """
    rng = np.random.default_rng(seed)
    near = frames.transform(frames.rotation_from_vector(np.array([0.1, 2.9, 0.2])), np.array([0.8, 0.1, 0.7]))
    ahead = frames.transform(frames.rotation_from_vector(np.array([0.1, 0.05, 0.02])), np.array([-0.1, -0.09, 0.6]))
    truth = {(camera, "flange"): ON_FLANGE @ PLACES[camera] for camera in cameras}
    truth |= {(camera, cameras[0]): PLACES[camera] for camera in cameras[1:]}
    truth |= {(f"board {camera}", "base"): near @ ON_FLANGE @ ahead for camera in cameras}
    tables = []
    while len(tables) < poses * len(cameras):
        turn = np.array([*rng.uniform(-0.35, 0.35, 2), rng.uniform(-1.2, 1.2)])
        shown = near @ frames.transform(frames.rotation_from_vector(turn), rng.uniform(-0.12, 0.12, 3))
        off = error * rng.standard_normal(6)
        T = shown @ frames.transform(frames.rotation_from_vector(off[:3]), off[3:])
        uv = {}
        for camera in cameras:
            U = frames.inverse(T @ truth[camera, "flange"]) @ truth[f"board {camera}", "base"]
            uv[camera] = in_image(LENSES[camera], XYZ @ U[:3, :3].T + U[:3, 3])
        if not all(((at > 5) & (at < np.array(SIZE) - 5)).all() for at in uv.values()):
            continue
        flange = np.r_[shown[:3, 3] / MM, frames.quaternion_from_matrix(shown[None, :3, :3])[0]]
        for camera, at in uv.items():
            at = at + noise * rng.standard_normal(at.shape)
            rows = {"pose": f"p{len(tables) // len(cameras)}", "feature": f"board {camera}", "corner": range(len(at))}
            tables.append(
                pd.DataFrame(rows | {"u_px": at[:, 0], "v_px": at[:, 1]} | dict(zip(FLANGE, flange, strict=True)))
            )
    board = {"kind": "image-on-tool", "pattern": "chessboard", "squares_x": 10, "squares_y": 7, "square_mm": 30}
    lens = {camera: dict(zip(imaging.LENS, LENSES[camera], strict=True)) for camera in cameras}
    known = [{"feature": f"board {camera}", "target": camera} | board | lens[camera] for camera in cameras]
    return pd.concat(tables, ignore_index=True), pd.DataFrame(known), truth


def errors(frame, true):
    """Of a frame: three of its place, three of its turn; metres and radians."""
    off = frames.inverse(true) @ frame.T
    return np.r_[off[:3, 3], frames.vector_from_rotation(off[:3, :3])]
