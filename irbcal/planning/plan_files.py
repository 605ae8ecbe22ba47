"""The files that carry a measuring plan out: tables, a RAPID module, and what it promises."""

import io
import json

import numpy as np
import pandas as pd

from irbcal.planning import conditions
from irbcal.planning.measuring_plan import READINGS_S
from irbcal.units import DEG, MM

SPEED_NAMES = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
"""Speeds that RAPID has names for, mm/s."""


def files(made, page=None):
    """The files of a plan.

    Parameters
    ----------
    made : Made
    page : str, optional
        The scene to look at, HTML.

    Returns
    -------
    dict of str to bytes
        ``plan.csv`` (what the tracker is asked for), ``poses.csv`` (what the robot does), ``plan.json``; ``plan.mod``
        for arms with six revolute joints; ``plan.html`` with a page.
    """
    out = {
        "plan.csv": _csv(plan_table(made)),
        "poses.csv": _csv(pose_table(made)),
        "plan.json": (json.dumps(summary(made), indent=1, allow_nan=False) + "\n").encode(),
    }
    if made.scene.setting.arm.six_revolute:
        out["plan.mod"] = rapid(made).encode()
    if page is not None:
        out["plan.html"] = page.encode("utf-8")
    return out


def _csv(table):
    stream = io.StringIO()
    table.to_csv(stream, index=False, lineterminator="\n")
    return stream.getvalue().encode()


def _joint_texts(made):
    """Joints as they are commanded, text, shape (n, joints)."""
    values = made.q / made.scene.setting.arm.joint_units
    return [
        [f"{value:.{conditions.DECIMALS}f}" for value in np.round(row, conditions.DECIMALS) + 0.0] for row in values
    ]


def plan_table(made):
    """A row for each reflector to measure: joints, reflector, where the tracker should expect it, when.

    Returns
    -------
    DataFrame
    """
    pose, target, xyz, time = made.expected()
    names = made.scene.setting.arm.joint_columns
    table = pd.DataFrame(np.array(_joint_texts(made))[pose], columns=names)
    table.insert(0, "pose", pose + 1)
    table.insert(1, "group", made.groups[pose])
    table["target"] = np.array(made.scene.setting.targets.names, dtype=object)[target]
    for k, axis in enumerate("xyz"):
        table[f"expected_{axis}_mm"] = [f"{value:.3f}" for value in xyz[:, k] / MM]
    table["time_s"] = [f"{value:.1f}" for value in time]
    if made.wish.payload_kg is not None:
        table["payload_kg"] = made.wish.payload_kg
    return table


def pose_table(made):
    """A row for each pose: joints, reflectors with spaces between them, wait.

    Returns
    -------
    DataFrame
    """
    table = pd.DataFrame(_joint_texts(made), columns=made.scene.setting.arm.joint_columns)
    table.insert(0, "pose", np.arange(1, len(table) + 1))
    table.insert(1, "group", made.groups)
    table["targets"] = _target_texts(made)
    table["wait_s"] = made.wish.wait_s
    return table


def _target_texts(made):
    names = np.array(made.scene.setting.targets.names, dtype=object)
    return [" ".join(names[row]) for row in made.asked]


def rapid(made):
    """A RAPID module that runs the plan: absolute joint moves, and a wait in each pose for rest and readings."""
    wish, speed = made.wish, round(made.wish.speed / MM)
    speed = f"v{speed}" if speed in SPEED_NAMES else f"[{speed},500,5000,1000]"
    absent = ",".join(["9E9"] * 6)

    def move(joints):
        return f"    MoveAbsJ [[{','.join(joints)}],[{absent}]]\\NoEOffs,{speed},fine,tool0;"

    home = [f"{value:.{conditions.DECIMALS}f}" for value in conditions.home_joints(made.scene.setting.arm) / DEG]
    lines = [
        "MODULE irbcal_plan",
        f"  ! Measuring plan for {made.scene.setting.arm.name}: {len(made.q)} poses, about "
        f"{made.duration_s / 60:.0f} minutes.",
        f"  ! In each pose: {wish.wait_s:g} s of rest, then {READINGS_S:g} s for each reflector, "
        f"{wish.references} references among them.",
        "  ! The commanded joints are those of conditions.csv: do not run this module through a filter.",
        "  PROC main()",
        "    AccSet 50,50;",
        move(home),
    ]
    rows = zip(_joint_texts(made), made.groups, _target_texts(made), made.hold_s, made.over_home, strict=True)
    for number, (joints, group, names, hold, over) in enumerate(rows, start=1):
        lines += [f"    ! pose {number}, {group}: {names}", *([move(home)] if over else [])]
        lines += [move(joints), f"    WaitTime {hold:g};"]
    return "\n".join([*lines, move(home), "  ENDPROC", "ENDMODULE", ""])


def summary(made):
    """Settings, counts and predictions, ready for JSON; lengths in mm, angles in degrees."""
    scene, wish, setting = made.scene, made.wish, made.scene.setting
    groups = pd.Series(made.groups).value_counts(sort=False)
    return {
        "robot": setting.arm.name,
        "source": scene.name,
        "poses": len(made.q),
        "points": int(made.asked.sum()),
        "duration_s": made.duration_s,
        "groups": {name: int(count) for name, count in groups.items()},
        "conditions": list(setting.conditions),
        "conditions_off": [name for name in conditions.CONDITIONS if name not in setting.conditions],
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
        "compared_with_random": None
        if made.comparison is None
        else {
            "criterion": wish.criterion,
            "optimal": {"poses": wish.optimal, "value": made.comparison.optimal},
            "random": [{"poses": n, "value": value} for n, value in made.comparison.random.items()],
            "as_good_as_random_poses": made.comparison.as_good_as,
        },
        "settings": {
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
            "front_begins_at_x_mm": conditions.FRONT / MM,
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
        },
        "notes": made.notes,
    }
