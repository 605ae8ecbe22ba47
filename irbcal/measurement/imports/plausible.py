"""Whether what was understood can be true: sizes that contradict the declared units, and what looks strange."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement.columns import POSITION, joint_columns, programmed_columns
from irbcal.measurement.imports.column_map import ImportMap
from irbcal.measurement.imports.part import ANGLE_DEG, LENGTH_MM, ROW, SOURCE
from irbcal.measurement.imports.poses import SAME_JOINTS, pose_keys

MOST_RADIANS = 2.0 * np.pi + 1e-3
"""No angle of a file declared as degrees is larger: these are radians."""
MOST_TURNS = 8.0 * np.pi
"""An angle of a file declared as radians is larger: these are degrees."""
SMALLEST_REACH_MM, LARGEST_REACH_MM = 20.0, 200e3
"""No tracker measures a robot whose farthest point is nearer than the one or farther than the other."""
ENOUGH = 3
"""Poses from which on joints and positions are judged by their size."""


def check_joint_sizes(frame: pd.DataFrame, source: str, units: str | Sequence[str], import_map: ImportMap) -> None:
    """Refuse joints (as read, in degrees and mm) whose size contradicts the declared units."""
    columns = joint_columns(frame.columns)
    units = [units] * len(columns) if isinstance(units, str) else list(units)
    programmed = programmed_columns(frame.columns, source)
    columns, units = columns + programmed, units * 2 if programmed else units
    if import_map.trust_units or len(frame[columns].drop_duplicates()) < ENOUGH:
        return
    for unit, other_unit in (("deg", "rad"), ("rad", "deg")):
        columns_of_unit = [name for name, its in zip(columns, units, strict=True) if its == unit]
        if not columns_of_unit:
            continue
        size = frame[columns_of_unit].abs() / ANGLE_DEG[unit]
        largest = float(size.to_numpy().max())
        column = size.max().idxmax()
        if (unit == "deg" and 0.0 < largest <= MOST_RADIANS) or (unit == "rad" and largest > MOST_TURNS):
            row = frame[ROW].iloc[int(size[column].to_numpy().argmax())]
            raise MeasurementError(
                f"row {row}, joint {column.partition('_')[0][1:]}: expected joints in {unit} as declared, found "
                f"{largest:.4g} as the largest angle of all: these look like {other_unit} (units.joints: {other_unit}; "
                "trust_units: true takes them as they are)",
                file=source,
            )


def check_reach(frame: pd.DataFrame, import_map: ImportMap) -> None:
    """Refuse positions whose size contradicts the declared unit, and files in which every point is lost."""
    xyz = frame[POSITION].to_numpy()
    have = np.isfinite(xyz).all(axis=1)
    source = frame[SOURCE].iloc[0]
    if not have.any():
        raise MeasurementError(f"expected measured points, found only lost ones ({len(frame)} rows)", file=source)
    reach = np.where(have, np.linalg.norm(np.where(have[:, None], xyz, 0.0), axis=1), 0.0)
    k = int(reach.argmax())
    size = reach[k]
    if import_map.trust_units or (have.sum() < ENOUGH and size < LARGEST_REACH_MM):
        return
    if not SMALLEST_REACH_MM <= size <= LARGEST_REACH_MM:
        unit = import_map.units.lengths or "mm"
        row = frame.iloc[k]
        wrong = "near" if size < SMALLEST_REACH_MM else "far"
        raise MeasurementError(
            f"expected positions in {unit} as declared, found the farthest of all points at "
            f"{size / LENGTH_MM[unit]:.4g} {unit}, too {wrong} for a tracker: the unit is another (units.lengths; "
            "trust_units: true takes it as it is)",
            file=row[SOURCE],
            row=int(row[ROW]),
        )


def strange(frame: pd.DataFrame) -> list[str]:
    """What the user should look at, in sentences."""
    out, columns = [], joint_columns(frame.columns)
    lost = frame["x_mm"].isna()
    for name, all_lost in lost.groupby(frame["target"]).all().items():
        if all_lost:
            out.append(f"Every point of target {name} is lost")
    key = pd.DataFrame({"pose": pose_keys(frame), "target": frame["target"]})
    again = key.duplicated()
    if again.any():
        row = frame.iloc[int(np.flatnonzero(again)[0])]
        out.append(
            f"{int(again.sum())} rows repeat a target of a pose, the first is {row['pose']}/{row['target']} "
            f"in row {row[ROW]} of {row[SOURCE]}"
        )
    q = frame[columns].to_numpy()
    still = [str(k) for k in range(1, len(columns) + 1) if np.ptp(q[:, k - 1]) <= SAME_JOINTS]
    if still and frame["pose"].nunique() >= ENOUGH:
        out.append(f"Joint {', '.join(still)} never moves")
    return out
