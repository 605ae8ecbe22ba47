"""SIMULATED pictures of cameras that see one board together."""

import numpy as np
from feature_cases import in_image

from irbcal.measurement.boards import Board
from irbcal.measurement.lens import Lens
from irbcal.modeling import frames

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
