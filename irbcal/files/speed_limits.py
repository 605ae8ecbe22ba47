"""Largest joint speeds, as a URDF has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.files import urdf_xml


def speed_limits(urdf: bytes, names: Sequence[str]) -> FloatArray:
    """Largest speeds of joints.

    Parameters
    ----------
    urdf : bytes
    names : sequence of str

    Returns
    -------
    ndarray, shape (joints,)
        Radians (metres for prismatic joints) per second; infinite where the URDF says none, or zero.
    """
    found = {
        joint.get("name"): float(limit.get("velocity") or 0.0)
        for joint in urdf_xml.parse(urdf, "calibrated.urdf").getroot().findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    speeds = np.array([found.get(name, 0.0) for name in names])
    return np.where(speeds > 0.0, speeds, np.inf)
