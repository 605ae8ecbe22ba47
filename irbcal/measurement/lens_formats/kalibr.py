"""Kalibr's camchain YAML: several cameras, each with its lens."""

from __future__ import annotations

from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.lens_formats import Cameras, Rig, between

DESCRIPTION = "Kalibr's camchain"


def read(content: Any) -> dict[str, tuple[FloatArray, tuple[int, int]]] | None:
    """The cameras; None where this is no camchain."""
    if not isinstance(content, dict) or not all(isinstance(camera, dict) for camera in content.values()) or not content:
        return None
    if not all("intrinsics" in camera for camera in content.values()):
        return None
    out = {}
    for name, camera in content.items():
        models = camera["camera_model"], camera.get("distortion_model", "none")
        if models[0] != "pinhole" or models[1] not in ("radtan", "none"):
            raise ValueError(f"{name} is {' and '.join(models)}, expected pinhole and radtan")
        d = [*[*camera.get("distortion_coeffs", []), 0.0, 0.0, 0.0, 0.0][:4], 0.0]
        width, height = map(int, camera["resolution"])
        out[str(name)] = np.array([*map(float, camera["intrinsics"]), *map(float, d)]), (width, height)
    return out


def write(cameras: Cameras, rig: Rig) -> str:
    """The file of cameras, of a rig with the pose of each one's predecessor in it.

    Raises
    ------
    OptionError
        If a lens has k3, which Kalibr's model lacks.
    """
    import yaml

    from irbcal.errors import OptionError

    content: dict[str, Any] = {}
    for k, (name, (lens, size)) in enumerate(cameras.items()):
        if lens[8] != 0.0:
            raise OptionError(
                f"as_: the lens of {name} has k3, which Kalibr's radtan lacks: name the others as fit in the features "
                "(fx fy cx cy k1 k2 p1 p2)",
                parameter="as_",
            )
        content[f"cam{k}"] = {
            "camera_model": "pinhole",
            "intrinsics": [float(value) for value in lens[:4]],
            "distortion_model": "radtan",
            "distortion_coeffs": [float(value) for value in lens[4:8]],
            "resolution": list(size),
            "rostopic": f"/{name}",
        }
        T = between(rig, list(cameras)[k - 1], name) if k else None
        content[f"cam{k}"] |= {} if T is None else {"T_cn_cnm1": T.tolist()}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
