"""What a virtual cell hides, as it goes into the truth's file; the identification never reads it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.cell.cell import Cell
from irbcal.modeling import frames
from irbcal.modeling.parameters import FOURIER
from irbcal.units import DEG, MM

_BASE = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
_BASE_UNITS = np.array([MM, MM, MM, DEG, DEG, DEG])
_COLUMNS = {"alpha": DEG, "a": MM, "theta": DEG, "d": MM, "beta": DEG, "b": MM}


def truth(cell: Cell) -> dict[str, Any]:
    """All that the cell hides, in millimetres and degrees, ready for JSON."""
    joint_map, tool = cell.true_joint_map(), cell.tool
    nominal, table = cell.arm.table, cell.true_arm().table
    parameters = dict(zip(_BASE, frames.to_xyz_angles(cell.tracker.T_tracker_base) / _BASE_UNITS, strict=True))
    for name, place in zip(tool.names, tool.real, strict=True):
        parameters |= {f"target_{name}_{axis}": value / MM for axis, value in zip("xyz", place, strict=True)}
    for name, unit in _COLUMNS.items():
        error = (getattr(table, name) - getattr(nominal, name)) / unit
        parameters |= {f"delta_{name}{j + 1}": error[j] for j in np.flatnonzero(error)}
    parameters |= {f"gain{j + 1}": joint_map.gain[j] for j in np.flatnonzero(joint_map.gain)}
    parameters |= {f"stiffness_{name}": v / DEG for name, v in zip("AB", joint_map.stiffness, strict=True)}
    parameters |= {f"fourier_{name}": v / DEG for name, v in zip(FOURIER, joint_map.fourier, strict=True)}
    return {
        "parameters": {name: _rounded(value) for name, value in parameters.items()},
        "dhm": {name: _rounded(getattr(table, name) / unit) for name, unit in _COLUMNS.items()},
        "targets_cad": dict(zip(tool.names, _rounded(tool.cad / MM), strict=True)),
        "targets_look_along": dict(zip(tool.names, _rounded(tool.direction), strict=True)),
        "references_in_base": {name: _rounded(place / MM) for name, place in cell.references.items()},
        "payload_kg": tool.payload_kg,
        "payload_centre": _rounded(np.asarray(tool.payload_centre) / MM),
        "link_masses_kg": _rounded(cell.bodies.mass),
        "link_centres_in_dhm_frames": _rounded(cell.bodies.centre / MM),
        "effects": {effect.name: effect.parameters() for effect in cell.effects},
        "seed": cell.seed,
    }


def _rounded(values: ArrayLike) -> Any:
    """Numbers for JSON without the noise of unit conversions."""
    return np.round(np.asarray(values, dtype=float), 9).tolist()
