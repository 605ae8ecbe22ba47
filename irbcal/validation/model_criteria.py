"""What attained poses come to: the criteria of ISO 9283:1998 by one model (Nubiola 2011, section 7.7.3.4, annex I).

Rows of the group ``iso9283`` are the cycles of pose accuracy and repeatability; rows with something in the column
``direction`` (three directions of approach) are those of the multi-directional variation, and rows of the group
``iso9283_drift`` the sets of the drift test, in the order of the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import FloatArray, lock
from irbcal.errors import MeasurementError
from irbcal.measurement.statistics import rotation_statistics, statistics
from irbcal.modeling import frames
from irbcal.units import DEG, MM
from irbcal.validation import pose_criteria
from irbcal.validation.attained import Attained
from irbcal.validation.cube import POSES
from irbcal.validation.tables import ANGLES, AXES

GROUP, DRIFT = "iso9283", "iso9283_drift"

PoseValues: TypeAlias = "dict[str, int | float | None]"


@dataclass(frozen=True, eq=False)
class ModelCriteria:
    """Criteria by one model, in mm and degrees, along and about the axes of the base link.

    Without a calibration there is no base link: axes are then those of the measuring frame.

    Attributes
    ----------
    poses : dict of str to dict
        Of each pose ``n``, ``AP_mm`` (None without a command), ``RP_mm``, mean, sigma and largest distance from the
        mean (``l_mean_mm``, ...), ``AP_x_mm``, ...; with orientations ``RP_a_deg``, ..., ``AP_a_deg``, ...
    overall : dict or None
        Errors of all poses and cycles ``from`` the command or the mean: statistics of ``position`` and ``orientation``
        (Nubiola 2011, Table 7.8).
    distance : dict or None
        ``AD_mm`` and ``RD_mm`` from P2 to P4, along the axes ``AD_x_mm``, ``RD_x_mm``, …, and with orientations about
        them ``AD_a_deg``, ``RD_a_deg``, …
    directions : dict of str to dict, or None
        ``vAP_mm``, ``vAP_x_mm``, … and, with orientations, ``vAP_a_deg``, … of each pose over its ``directions`` of
        approach.
    drift : dict or None
        ``RP_mm``, ``AP_mm`` and ``shift_mm`` of each of the ``sets`` of cycles, ``dRP_mm``, ``dAP_mm``.
    history : dict or None
        ``pose``, ``cycle``, ``position_mm`` and ``orientation_deg`` of each cycle, in the order of the file.
    """

    poses: dict[str, PoseValues]
    overall: dict[str, Any] | None
    distance: dict[str, Any] | None
    directions: dict[str, dict[str, float]] | None
    drift: dict[str, Any] | None
    history: dict[str, Any] | None

    def __post_init__(self) -> None:
        lock(self)


def criteria(attained: Attained, set_size: int) -> ModelCriteria:
    """The criteria of what was reached.

    Parameters
    ----------
    attained : Attained
    set_size : int
        Cycles of a set of the drift test.

    Returns
    -------
    ModelCriteria

    Raises
    ------
    MeasurementError
        If no row belongs to a test, a pose was measured once only, or directions or sets are too few.
    """
    grouped = (attained.group == GROUP).any()
    approached = attained.direction != ""
    drifting = attained.group == DRIFT
    plain = ~approached & ~drifting & ((attained.group == GROUP) | ~np.bool_(grouped))
    if not (plain.any() or approached.any() or drifting.any()):
        raise MeasurementError(f"no usable row of the groups {GROUP} and {DRIFT}", file=attained.source)
    poses: dict[str, PoseValues] = {}
    overall = history = distance = None
    if plain.any():
        cycles = attained.select(plain)
        poses = {name: _pose(cycles, name) for name in _in_order(cycles.pose)}
        overall, history = _overall(cycles)
        distance = _distance(cycles)
    return ModelCriteria(
        poses=poses,
        overall=overall,
        distance=distance,
        directions=_directions(attained.select(approached)) if approached.any() else None,
        drift=_drift(attained.select(drifting), set_size) if drifting.any() else None,
        history=history,
    )


def _in_order(names: NDArray[np.str_]) -> list[str]:
    """Names as they come first, P1 to P5 in that order."""
    found = [str(name) for name in dict.fromkeys(names)]
    return sorted(found) if set(found) <= set(POSES) else found


def _mm(value: float) -> float:
    return float(value / MM)


def _pose(cycles: Attained, name: str) -> PoseValues:
    mine = cycles.select(cycles.pose == name)
    n = len(mine.xyz)
    if n < 2:
        raise MeasurementError(
            f"pose {name} was measured in one cycle only: repeatability needs two", file=cycles.source
        )
    repeatability, distance = pose_criteria.position_repeatability(mine.xyz)
    out: PoseValues = {
        "n": n,
        "AP_mm": None,
        "RP_mm": _mm(repeatability),
        "l_mean_mm": _mm(distance.mean()),
        "l_sigma_mm": _mm(distance.std(ddof=1)),
        "l_max_mm": _mm(distance.max()),
    }
    if mine.wanted is not None:
        # the joints, and so the commanded places, may differ between cycles by the readings' last digit
        shift = mine.xyz - mine.wanted
        total, axes = pose_criteria.pose_accuracy(shift, 0.0)
        out["AP_mm"] = _mm(total)
        out |= {f"AP_{axis}_mm": _mm(value) for axis, value in zip(AXES, axes, strict=True)}
    angles = mine.angles()
    if angles is not None:
        spread = pose_criteria.angle_repeatability(angles)
        out |= {f"RP_{a}_deg": float(value / DEG) for a, value in zip(ANGLES, spread, strict=True)}
        if mine.wanted_rotation is not None:
            mean = pose_criteria.angle_accuracy(angles)
            out |= {f"AP_{a}_deg": float(value / DEG) for a, value in zip(ANGLES, mean, strict=True)}
    return out


def _overall(cycles: Attained) -> tuple[dict[str, Any], dict[str, Any]]:
    """Errors of every pose and cycle (Table 7.8, Figures 7.8 and 7.9): from the command, else from the pose's mean."""
    names = _in_order(cycles.pose)
    if cycles.wanted is not None:
        error = np.linalg.norm(cycles.xyz - cycles.wanted, axis=1)
    else:
        error = np.empty(len(cycles.xyz))
        for name in names:
            mine = cycles.pose == name
            error[mine] = pose_criteria.position_repeatability(cycles.xyz[mine])[1]
    turn = None
    if cycles.rotation is not None:
        about = cycles.wanted_rotation
        if about is None:
            means = {name: pose_criteria.mean_rotation(cycles.rotation[cycles.pose == name]) for name in names}
            about = np.array([means[name] for name in cycles.pose])
        turn = frames.rotation_distance(cycles.rotation, about)
    overall = {
        "from": "commanded" if cycles.wanted is not None else "mean",
        "position": statistics(error),
        "orientation": None if turn is None else rotation_statistics(turn),
    }
    history = {
        "pose": cycles.pose.tolist(),
        "cycle": cycles.cycle.tolist(),
        "position_mm": (error / MM).tolist(),
        "orientation_deg": None if turn is None else (turn / DEG).tolist(),
    }
    return overall, history


def _distance(cycles: Attained) -> dict[str, Any] | None:
    """Between P2 and P4, in the cycles that have both; None for fewer than two."""
    parts = [cycles.select(cycles.pose == name) for name in ("P2", "P4")]
    common = [c for c in parts[0].cycle if c in set(parts[1].cycle)]
    if len(common) < 2:
        return None
    parts = [part.select(np.array([list(part.cycle).index(c) for c in common])) for part in parts]
    wanted = [None if part.wanted is None else part.wanted.mean(axis=0) for part in parts]
    total, spread = pose_criteria.distance_accuracy(parts[0].xyz, parts[1].xyz, wanted[0], wanted[1])
    out: dict[str, Any] = {
        "poses": ["P2", "P4"],
        "n": len(common),
        "AD_mm": None if total is None else _mm(total),
        "RD_mm": _mm(spread),
    }
    first, second = parts
    along = pose_criteria.distance_along_axes(first.xyz, second.xyz, *wanted)
    out |= _by_axis(*along, AXES, MM, "mm")
    if first.rotation is not None and second.rotation is not None:
        turns, meant = pose_criteria.turns_between(first.rotation, second.rotation), None
        if first.wanted_rotation is not None and second.wanted_rotation is not None:
            meant = pose_criteria.turns_between(first.wanted_rotation, second.wanted_rotation).mean(axis=0)
        zero = np.zeros(3)
        about = pose_criteria.distance_along_axes(turns, zero, meant, None if meant is None else zero)
        out |= _by_axis(*about, ANGLES, DEG, "deg")
    return out


def _by_axis(accuracy: FloatArray | None, spread: FloatArray, axes: str, size: float, unit: str) -> dict[str, Any]:
    """AD and RD along or about each axis by name."""
    out: dict[str, Any] = {}
    for k, axis in enumerate(axes):
        out[f"AD_{axis}_{unit}"] = None if accuracy is None else float(accuracy[k] / size)
        out[f"RD_{axis}_{unit}"] = float(spread[k] / size)
    return out


def _directions(approached: Attained) -> dict[str, dict[str, float]]:
    """Variation of each pose over its directions of approach."""
    out: dict[str, dict[str, float]] = {}
    for name in _in_order(approached.pose):
        mine = approached.select(approached.pose == name)
        ways = list(dict.fromkeys(mine.direction))
        if len(ways) < 2:
            raise MeasurementError(
                f"pose {name} was approached from {ways[0]} only: the variation needs several directions (ISO 9283: "
                "three, perpendicular)",
                file=approached.source,
                column="direction",
            )
        means = np.array([mine.xyz[mine.direction == way].mean(axis=0) for way in ways])
        out[name] = {"directions": len(ways), "vAP_mm": _mm(pose_criteria.multidirectional_variation(means))}
        out[name] |= {f"vAP_{axis}_mm": _mm(np.ptp(means[:, k])) for k, axis in enumerate(AXES)}
        angles = mine.angles()
        if angles is not None:
            means = np.array([angles[mine.direction == way].mean(axis=0) for way in ways])
            out[name] |= {f"vAP_{a}_deg": float(np.ptp(means[:, k]) / DEG) for k, a in enumerate(ANGLES)}
    return out


def _drift(drifting: Attained, set_size: int) -> dict[str, Any]:
    """Of the first pose of the group (P1)."""
    name = _in_order(drifting.pose)[0]
    mine = drifting.select(drifting.pose == name)
    rows = [np.flatnonzero(mine.order // set_size == k) for k in range(int(mine.order.max()) // set_size + 1)]
    rows = [k for k in rows if len(k) > set_size // 2 and len(k) > 1]  # lost points and an unfinished last set
    if len(rows) < 2:
        raise MeasurementError(
            f"group {DRIFT} has {len(mine.xyz)} cycles of {name}: drift needs two sets of {set_size}",
            file=drifting.source,
        )
    wanted = None if mine.wanted is None else mine.wanted.mean(axis=0)
    found = pose_criteria.drift([mine.xyz[k] for k in rows], wanted)
    timed = (mine.time != "").all()
    out: dict[str, Any] = {
        "pose": name,
        "sets": len(rows),
        "set_size": set_size,
        "n": [len(k) for k in rows],
        "RP_mm": (found.RP / MM).tolist(),
        "shift_mm": (found.shift / MM).tolist(),
        "dRP_mm": _mm(found.dRP),
    }
    if found.AP is not None and found.dAP is not None:
        out |= {"AP_mm": (found.AP / MM).tolist(), "dAP_mm": _mm(found.dAP)}
    return out | {"time_s": [float(np.mean(mine.time[k].astype(float))) for k in rows] if timed else None}
