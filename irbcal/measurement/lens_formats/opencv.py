"""OpenCV's FileStorage as YAML, as its calibration sample writes it."""

from __future__ import annotations

from typing import Any

from irbcal.arrays import FloatArray
from irbcal.measurement.lens_formats import Cameras, brown

WHAT = "OpenCV's FileStorage"
MATRICES = ("camera_matrix", "cameraMatrix", "K", "M1")
DISTORTIONS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "D1")


def read(content: Any) -> dict[str, tuple[FloatArray, tuple[int, int]]] | None:
    """The camera; None where this is no such file."""
    if not isinstance(content, dict):
        return None
    K = next((content[name] for name in MATRICES if name in content), None)
    d = next((content[name] for name in DISTORTIONS if name in content), None)
    if not (isinstance(K, dict) and isinstance(d, dict)):
        return None
    return {"camera": (brown(K["data"], d["data"]), (int(content["image_width"]), int(content["image_height"])))}


def write(cameras: Cameras) -> str:
    """The file of a camera."""
    ((lens, (width, height)),) = cameras.values()
    fx, fy, cx, cy, *d = map(float, lens)

    def matrix(name: str, rows: int, columns: int, data: list[float]) -> str:
        numbers = ", ".join(map(repr, data))
        return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {numbers} ]\n"

    return (
        f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n"
        + matrix("camera_matrix", 3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        + matrix("distortion_coefficients", 5, 1, d)
    )
