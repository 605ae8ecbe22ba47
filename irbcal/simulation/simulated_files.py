"""The files of a virtual measurement: the measurement file, and the truth beside it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.measurement.columns import POSITION
from irbcal.measurement.load_columns import PLACE
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.names import without_formulas
from irbcal.simulation.cell import Cell
from irbcal.simulation.pose_list import PoseList
from irbcal.simulation.run import Run
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd


def measurement_table(run: Run, poses: PoseList, arm: Arm) -> pd.DataFrame:
    """A run as the rows of a measurement file.

    Returns
    -------
    DataFrame
        Text and numbers as they are written: joints with 6 decimals, positions with 4 (0.1 um). Where the robot's
        readings are not its commands, the commands stand beside them (``c1_deg`` …).
    """
    import pandas as pd

    row, point = np.nonzero(run.asked)
    units = arm.joint_units
    columns: dict[str, Any] = {"pose": poses.pose[row]}
    for name, values in poses.extra.items():
        columns[name] = values[row]
    commands = np.round(arm.to_controller(poses.q) / units, 6) + 0.0
    joints = commands if run.readings is None else np.round(arm.to_controller(run.readings) / units, 6) + 0.0
    columns |= {name: joints[row, j] for j, name in enumerate(arm.joint_columns)}
    if run.readings is not None:
        columns |= {f"c{name[1:]}": commands[row, j] for j, name in enumerate(arm.joint_columns)}
    columns["target"] = np.array(run.names, dtype=object)[point]
    xyz = np.round(run.xyz[row, point] / MM, 4) + 0.0
    columns |= {name: xyz[:, k] for k, name in enumerate(POSITION)}
    columns["payload_kg"] = np.full(len(row), run.payload_kg)
    if run.payload_place is not None:
        place = np.round(run.payload_place / MM, 4)
        columns |= {name: np.full(len(row), x) for name, x in zip(PLACE, place, strict=True)}
    columns["time_s"] = np.round(run.time_s[row, point], 2)
    columns["simulated"] = np.full(len(row), "yes", dtype=object)
    return pd.DataFrame(columns)


def files(run: Run, poses: PoseList, cell: Cell, out: str | Path, robot: str) -> dict[str, bytes]:
    """Contents of the measurement file and of the truth beside it.

    Parameters
    ----------
    run : Run
    poses : PoseList
    cell : Cell
    out : str or Path
        The measurement file.
    robot : str
        As the user named it.

    Returns
    -------
    dict of str to bytes
        File name -> content.
    """
    out = Path(out)
    data = without_formulas(measurement_table(run, poses, cell.arm)).to_csv(index=False, lineterminator="\n").encode()
    document = {
        "simulated": True,
        "note": "What the virtual cell hides; the identification never reads this file.",
        "made_by": "irbcal simulate",
        "robot": robot,
        "data": out.name,
        "data_sha256": hashlib.sha256(data).hexdigest(),
        "plan": Path(poses.source).name,
        "plan_sha256": poses.sha256,
        "units": "mm and degrees; base_*: the base link in the tracker's frame (eq. 3.5); target_*: in the tip link",
        "terms_are": "what the robot does in the terms of the error model, by their names; rad, m and minutes",
        "stiffness_is": "the two numbers that describe joints 2 and 3 best; the effect compliance says what they do",
        **cell.truth(),
        "unseen": run.unseen,
        "poses_are": "true tip poses in the base link, in the order of the run: x_mm, y_mm, z_mm, qw, qx, qy, qz",
    }
    quaternions = frames.quaternion_from_matrix(run.T_base_tip[:, :3, :3])
    rows = np.round(np.column_stack([run.T_base_tip[:, :3, 3] / MM, quaternions]), 9).tolist()
    shown = ",\n".join(f"  {row}" for row in rows)
    truth = json.dumps(document, indent=1, ensure_ascii=False).removesuffix("\n}")
    return {out.name: data, truth_name(out): f'{truth},\n "poses": [\n{shown}\n ]\n}}\n'.encode()}


def truth_name(out: str | Path) -> str:
    """Name of the truth's file beside a measurement file."""
    return f"{Path(out).stem}.truth.json"
