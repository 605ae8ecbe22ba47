"""The files that carry a measuring plan out: tables, a robot program, and what it promises."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.columns import joint_columns
from irbcal.modeling.home import DECIMALS
from irbcal.names import without_formulas
from irbcal.planning import program
from irbcal.planning.conditions import CONDITIONS
from irbcal.planning.exchange import DesignComparison
from irbcal.planning.made import PlannedPoses
from irbcal.planning.wish import READINGS_S, Wish
from irbcal.thesis_setup import FRONT
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd


def files(made: PlannedPoses, page: str | None = None) -> dict[str, bytes]:
    """The files of a plan.

    Parameters
    ----------
    made : PlannedPoses
    page : str, optional
        The scene to look at, HTML.

    Returns
    -------
    dict of str to bytes
        ``plan.csv`` (what the tracker is asked for), ``poses.csv`` (what the robot does), ``plan.json``; the program
        of `irbcal.planning.program`; ``plan.html`` with a page.
    """
    out = {
        "plan.csv": _csv(plan_table(made)),
        "poses.csv": _csv(pose_table(made)),
        "plan.json": (json.dumps(facts(made), indent=1, allow_nan=False) + "\n").encode(),
    }
    out |= program.files(made)
    if page is not None:
        out["plan.html"] = page.encode("utf-8")
    return out


def _csv(table: pd.DataFrame) -> bytes:
    """A table as it is written: joints with `DECIMALS` places, positions with three, times with one."""
    places = dict.fromkeys(joint_columns(table.columns), DECIMALS)
    places |= {f"expected_{axis}_mm": 3 for axis in "xyz"} | {"time_s": 1}
    text = table.copy()
    for name in places.keys() & set(table.columns):
        text[name] = [f"{value:.{places[name]}f}" for value in table[name]]
    return str(without_formulas(text).to_csv(index=False, lineterminator="\n")).encode()


def _joints(made: PlannedPoses) -> FloatArray:
    """Joints as they are commanded and as the controller counts them, degrees and millimetres, shape (n, joints)."""
    arm = made.scene.setting.arm
    return np.round(arm.to_controller(made.q) / arm.joint_units, DECIMALS) + 0.0


def plan_table(made: PlannedPoses) -> pd.DataFrame:
    """A row for each reflector to measure: joints, reflector, where the tracker should expect it, when.

    Returns
    -------
    DataFrame
    """
    import pandas as pd

    pose, target, xyz, time = made.expected()
    table = pd.DataFrame(_joints(made)[pose], columns=made.scene.setting.arm.joint_columns)
    table.insert(0, "pose", pose + 1)
    table.insert(1, "group", made.groups[pose])
    table["target"] = np.array(made.scene.setting.targets.names, dtype=object)[target]
    for k, axis in enumerate("xyz"):
        table[f"expected_{axis}_mm"] = xyz[:, k] / MM
    table["time_s"] = time
    if made.wish.payload_kg is not None:
        table["payload_kg"] = made.wish.payload_kg
    return table


def pose_table(made: PlannedPoses) -> pd.DataFrame:
    """A row for each pose: joints, reflectors with spaces between them, wait.

    Returns
    -------
    DataFrame
    """
    import pandas as pd

    table = pd.DataFrame(_joints(made), columns=made.scene.setting.arm.joint_columns)
    table.insert(0, "pose", np.arange(1, len(table) + 1))
    table.insert(1, "group", made.groups)
    table["targets"] = _target_texts(made)
    table["wait_s"] = made.wish.wait_s
    return table


def _target_texts(made: PlannedPoses) -> list[str]:
    names = np.array(made.scene.setting.targets.names, dtype=object)
    return [" ".join(names[row]) for row in made.asked]


def facts(made: PlannedPoses) -> dict[str, Any]:
    """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
    scene, wish, setting = made.scene, made.wish, made.scene.setting
    return {
        "robot": setting.arm.name,
        "source": scene.name,
        "language": program.language_of(setting.arm, wish)[0] or None,
        "poses": len(made.q),
        "points": int(made.asked.sum()),
        "duration_s": made.duration_s,
        "groups": dict(Counter(made.groups.tolist())),
        "conditions": list(setting.conditions),
        "conditions_off": [name for name in CONDITIONS if name not in setting.conditions],
        "counts": {
            name: {"tried": tally.tried, "kept": tally.kept, "removed": dict(tally.removed)}
            for name, tally in made.tallies.items()
        },
        "predicted": {
            "noise_mm": wish.noise / MM,
            "note": "from the scatter of the points alone: what the model does not describe is not in it",
            "model": made.prediction.model.level,
            "position_target": made.prediction.model.targets.names[0],
            "position_std_mm": {
                name: {"rms": float(np.sqrt(np.mean(std**2)) / MM), "max": float(std.max() / MM)}
                for name, std in made.position_std.items()
            },
            "parameters": [
                {"name": item.name, "unit": item.unit, "std": item.std, "state": item.state}
                for item in made.prediction.parameters
            ],
        },
        "compared_with_random": None if made.comparison is None else _compared(made.comparison, wish),
        "settings": _settings(made),
        "notes": list(made.notes),
    }


def _compared(found: DesignComparison, wish: Wish) -> dict[str, Any]:
    """Chosen poses beside random ones; of the criterion ``position`` also as predicted errors, rms in mm."""

    def values(value: float) -> dict[str, float]:
        return {"value": value} | ({"error_mm": float(np.sqrt(value) / MM)} if wish.criterion == "position" else {})

    return {
        "criterion": wish.criterion,
        "optimal": {"poses": wish.optimal, **values(found.optimal)},
        "random": [{"poses": n, **values(value)} for n, value in found.random.items()],
        "as_good_as_random_poses": found.as_good_as,
        "scatter_alone": None if found.scatter is None else _compared(found.scatter, wish),
    }


def _settings(made: PlannedPoses) -> dict[str, Any]:
    scene, wish, setting = made.scene, made.wish, made.scene.setting
    return {
        "seed": wish.seed,
        "axis": wish.axis,
        "cube": wish.cube,
        "all_range": wish.all_range,
        "optimal": wish.optimal,
        "candidates": wish.candidates if wish.optimal else 0,
        "criterion": wish.criterion,
        "volume": wish.volume,
        "imagined_joint_errors_deg": wish.imagined / DEG if wish.criterion == "position" else 0.0,
        "margin_deg": round(setting.margin / DEG, 9),
        "acceptance_deg": round(setting.acceptance / DEG, 9),
        "min_height_mm": None if setting.heights is None else [value / MM for value in setting.heights],
        "front_begins_at_x_mm": FRONT / MM,
        "cube_centre_mm": (np.asarray(scene.cube[0]) / MM).tolist(),
        "cube_edge_mm": scene.cube[1] / MM,
        "tracker_mm": (setting.place / MM).tolist(),
        "T_tracker_base": scene.T_world_base.tolist(),
        "targets_mm": dict(zip(setting.targets.names, (setting.targets.places / MM).tolist(), strict=True)),
        "targets_look_along": None
        if setting.targets.directions is None
        else dict(zip(setting.targets.names, setting.targets.directions.tolist(), strict=True)),
        "wait_s": wish.wait_s,
        "readings_s": READINGS_S,
        "speed_mm_s": wish.speed / MM,
        "payload_kg": wish.payload_kg,
    }
