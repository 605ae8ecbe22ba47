"""What a virtual cell hides, as it goes into the truth's file; the identification never reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.modeling import frames
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.parameters import FOURIER
from irbcal.modeling.terms.term import Term
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.simulation.effect import Effect
from irbcal.simulation.masses import Bodies
from irbcal.simulation.tool import EndEffector
from irbcal.simulation.tracker import Tracker
from irbcal.units import DEG, MM

_BASE = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
_BASE_UNITS = np.array([MM, MM, MM, DEG, DEG, DEG])
_COLUMNS = {"alpha": DEG, "a": MM, "theta": DEG, "d": MM, "beta": DEG, "b": MM}


def truth(
    nominal: DHMTable,
    table: DHMTable,
    joint_map: ThesisMap,
    tool: EndEffector,
    tracker: Tracker,
    references: Mapping[str, FloatArray],
    bodies: Bodies,
    effects: Sequence[Effect],
    seed: int,
    terms: Mapping[str, tuple[Term, float]],
) -> dict[str, Any]:
    """The hidden numbers of a cell, in millimetres and degrees, ready for JSON.

    Parameters
    ----------
    nominal, table : DHMTable
        What the controller believes, and the truth.
    joint_map : ThesisMap
    tool : EndEffector
    tracker : Tracker
    references : dict of str to ndarray, shape (3,)
    bodies : Bodies
    effects : sequence of Effect
    seed : int
    terms : mapping of str to (Term, float)
        The same in the terms of the error model, SI units.

    Returns
    -------
    dict
    """
    parameters = dict(zip(_BASE, frames.to_xyz_angles(tracker.T_tracker_base) / _BASE_UNITS, strict=True))
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
        "references_in_base": {name: _rounded(place / MM) for name, place in references.items()},
        "payload_kg": tool.payload_kg,
        "payload_centre": _rounded(np.asarray(tool.payload_centre) / MM),
        "link_masses_kg": _rounded(bodies.mass),
        "link_centres_in_dhm_frames": _rounded(bodies.centre / MM),
        "effects": {effect.name: effect.parameters() for effect in effects},
        "terms": {name: float(f"{value:.9g}") for name, (_, value) in terms.items() if value},
        "seed": seed,
    }


def _rounded(values: ArrayLike) -> Any:
    """Numbers for JSON without the noise of unit conversions."""
    return np.round(np.asarray(values, dtype=float), 9).tolist()
