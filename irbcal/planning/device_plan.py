"""Poses for a device in place of a tracker: reached, without collision, at its features; ``irbcal plan --device``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal import atomic
from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.files.opening import RobotLike
from irbcal.identification.devices import DEVICES, Placed, placed, poses, rows_table
from irbcal.modeling.arm import Arm
from irbcal.names import without_formulas
from irbcal.options import MOST_POSES, checked, number
from irbcal.options import seed as check_seed
from irbcal.planning.conditions import check
from irbcal.planning.scene import open_scene
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

ROWS, FEATURES = "rows.csv", "features.csv"


@dataclass(frozen=True, eq=False, repr=False)
class DevicePlan(Speaks):
    """Poses at a device's features.

    Attributes
    ----------
    arm : Arm
    found : Placed
        The device, and where it should stand.
    q : ndarray, shape (n, joints)
    which : ndarray of int, shape (n,)
        Number of the feature at each.
    conditions : tuple of str
        What every pose meets.
    notes : tuple of str
    """

    arm: Arm
    found: Placed
    q: FloatArray
    which: IntArray
    conditions: tuple[str, ...]
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        lock(self)

    def to_frame(self) -> pd.DataFrame:
        """The poses as the first file of ``irbcal calibrate --features``; values are to be filled in."""
        return rows_table(self.arm, self.found, self.q, self.which, None)

    def features(self) -> pd.DataFrame:
        """The second file: lengths are those of the plan, to be replaced by measured ones."""
        return self.found.table()

    def places(self) -> dict[str, list[float]]:
        """Where each feature should stand, in the base link, mm; a point of planes."""
        out = {}
        for name, own in self.found.own.items():
            point = own["centre"] if "centre" in own else own["normal"][:, 2] * own["height"]
            out[name] = np.round(point / MM, 1).tolist()
        return out

    def to_dict(self) -> dict[str, Any]:
        """For JSON: millimetres."""
        device = self.found.device
        return {
            "robot": self.arm.name,
            "device": device.name,
            "poses": len(self.q),
            "features_mm": self.places(),
            "bar_mm": self.found.bar / MM or None,
            "conditions": list(self.conditions),
            "notes": list(self.notes),
        }

    def told(self) -> Sequence[Told]:
        """What to put where, and what every pose meets."""
        device, counts = self.found.device, np.bincount(self.which)
        bar = f", bar of {self.found.bar / MM:.0f} mm" if self.found.bar else ""
        told: list[Told] = [f"{self.arm.name}: {len(self.q)} poses at {device.words}{bar}"]
        for (name, place), count in zip(self.places().items(), counts, strict=True):
            told.append(f"  {name} near {', '.join(f'{x:.0f}' for x in place)} mm in the base link: {count} poses")
        told.append(f"Every pose meets: {', '.join(self.conditions)}")
        return [*told, *(f"Note: {note}" for note in self.notes)]

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``rows.csv`` and ``features.csv``, both or none.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        tables = {ROWS: self.to_frame(), FEATURES: self.features()}
        data = {
            name: without_formulas(t).to_csv(index=False, lineterminator="\n").encode() for name, t in tables.items()
        }
        atomic.write_together(folder, data)
        return tuple(Path(folder) / name for name in data)


def device_plan(
    robot: RobotLike,
    device: str,
    poses: int = 100,
    *,
    seed: int = 0,
    margin: float = 2 * DEG,
    package_dirs: Sequence[str | Path] = (),
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
) -> DevicePlan:
    """Poses at a device's features that the robot reaches without touching itself.

    Parameters
    ----------
    robot : str, Path or calibration
    device : str
        See `irbcal.identification.devices.DEVICES`.
    poses : int
        In all.
    seed : int
    margin : float
        From the joint limits, radians.
    package_dirs, base_link, tip_link, coupling
        See `irbcal.planning.scene.open_scene`.

    Returns
    -------
    DevicePlan

    Raises
    ------
    IrbcalError
        If an option or input is refused, or too few poses are found.
    """
    wanted = DEVICES[checked("device", device, tuple(DEVICES))]
    count = number("poses", poses, len(wanted.spots), MOST_POSES, whole=True)
    scene = open_scene(
        robot,
        without=("height", "acceptance", "sight", "way"),
        margin=margin,
        package_dirs=package_dirs,
        base_link=base_link,
        tip_link=tip_link,
        coupling=coupling,
    )
    setting = scene.setting
    found = placed(setting.arm, wanted)

    def keep(q: FloatArray) -> BoolArray:
        return check(setting, q)[0]

    q, which = _poses(setting.arm, found, count, check_seed(seed), keep)
    notes = [note for note in scene.notes if "reflector" not in note and "tracker" not in note]
    return DevicePlan(setting.arm, found, q, which, tuple(setting.conditions), tuple(notes))


_poses = poses
