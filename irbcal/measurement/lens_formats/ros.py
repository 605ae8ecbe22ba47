"""ROS camera_info YAML, as ``camera_calibration`` and ``camera_info_manager`` write it."""

from __future__ import annotations

from typing import Any

from irbcal.arrays import FloatArray
from irbcal.measurement.lens_formats import Cameras, Rig, brown

DESCRIPTION = "ROS camera_info"
MODELS = ("plumb_bob", "rational_polynomial")


def read(content: Any) -> dict[str, tuple[FloatArray, tuple[int, int]]] | None:
    """The camera; None where this is no camera_info."""
    if isinstance(content, dict) and {"k", "d", "width", "height"} <= set(content):  # a message, by ros2 topic echo
        content = {
            "image_width": content["width"],
            "image_height": content["height"],
            "camera_matrix": {"data": content["k"]},
            "distortion_coefficients": {"data": content["d"]},
            "distortion_model": content.get("distortion_model") or MODELS[0],
        }
    if not isinstance(content, dict) or "camera_matrix" not in content or "image_width" not in content:
        return None
    model = content.get("distortion_model", MODELS[0])
    if model not in MODELS:
        raise ValueError(f"distortion_model {model}, expected {MODELS[0]}")
    K, d = content["camera_matrix"]["data"], content["distortion_coefficients"]["data"]
    size = int(content["image_width"]), int(content["image_height"])
    return {str(content.get("camera_name", "camera")): (brown(K, d), size)}


def write(cameras: Cameras, rig: Rig) -> str:
    """The file of a camera."""
    import yaml

    ((name, (lens, (width, height))),) = cameras.items()
    fx, fy, cx, cy, *d = map(float, lens)

    def matrix(rows: int, columns: int, data: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": columns, "data": data}

    content = {
        "image_width": width,
        "image_height": height,
        "camera_name": name,
        "camera_matrix": matrix(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": MODELS[0],
        "distortion_coefficients": matrix(1, 5, d),
        "rectification_matrix": matrix(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": matrix(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
