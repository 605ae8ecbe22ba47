"""OpenCV's FileStorage as YAML, as its samples of calibration and stereo calibration write it."""

from __future__ import annotations

from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import OptionError
from irbcal.measurement.lens_formats import Cameras, Rig, between, brown

DESCRIPTION = "OpenCV's FileStorage"
MATRICES = ("camera_matrix", "cameraMatrix", "K", "M1")
DISTORTIONS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "D1")


def read(content: Any) -> dict[str, tuple[FloatArray, tuple[int, int]]] | None:
    """The camera, or the first and the second; None where this is no such file."""
    if not isinstance(content, dict):
        return None
    K = next((content[name] for name in MATRICES if name in content), None)
    d = next((content[name] for name in DISTORTIONS if name in content), None)
    if not (isinstance(K, dict) and isinstance(d, dict)):
        return None
    size = int(content["image_width"]), int(content["image_height"])
    if "M2" in content:
        return {name: (brown(content[f"M{name}"]["data"], content[f"D{name}"]["data"]), size) for name in "12"}
    return {"camera": (brown(K["data"], d["data"]), size)}


def write(cameras: Cameras, rig: Rig) -> str:
    """The file of a camera, or of two, the second as R and T place the first before it (``stereoCalibrate``).

    Raises
    ------
    OptionError
        If there are two that are no rig, or whose pictures differ in size.
    """
    first, *following = cameras
    names = {first: ("camera_matrix", "distortion_coefficients")}
    matrices = []
    if following:
        T = between(rig, first, following[0])
        if T is None or cameras[first][1] != cameras[following[0]][1]:
            raise OptionError(
                f"as_: a file of opencv has one camera, or two of a rig with pictures of one size: {first} and "
                f"{following[0]} are none: take kalibr",
                parameter="as_",
            )
        names = {first: ("M1", "D1"), following[0]: ("M2", "D2")}
        matrices = [_matrix("R", T[:3, :3]), _matrix("T", T[:3, 3:])]
    lenses = []
    for name, (K, d) in names.items():
        fx, fy, cx, cy, *distortion = cameras[name][0]
        lenses += [_matrix(K, [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), _matrix(d, [[x] for x in distortion])]
    width, height = cameras[first][1]
    head = f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n"
    return head + "".join([*lenses, *matrices])


def _matrix(name: str, values: Any) -> str:
    a = np.asarray(values, dtype=float)
    numbers = ", ".join(map(repr, a.ravel().tolist()))
    return f"{name}: !!opencv-matrix\n   rows: {a.shape[0]}\n   cols: {a.shape[1]}\n   dt: d\n   data: [ {numbers} ]\n"
