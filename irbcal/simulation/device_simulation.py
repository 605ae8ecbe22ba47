"""Measuring without a tracker in a virtual cell: SIMULATED rows at features, and the truth."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from irbcal import atomic
from irbcal.arrays import FloatArray, IntArray
from irbcal.errors import OptionError
from irbcal.identification.observations import KINDS
from irbcal.measurement.columns import PAYLOAD_CENTRE
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.features import read as read_features
from irbcal.names import csv_bytes
from irbcal.options import MOST_POSES, checked, names, number
from irbcal.options import seed as check_seed
from irbcal.simulation import shipped_cells
from irbcal.simulation.devices import (
    AXES,
    BALL,
    DEVICES,
    Placed,
    Tips,
    met,
    placed,
    poses,
    rows_table,
    shown,
    spread,
)
from irbcal.simulation.shipped_cells import ROBOT_SEED, open_cell
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.summary import Paragraph, Result
from irbcal.units import LARGEST_PAYLOAD_KG, MM

if TYPE_CHECKING:
    import pandas as pd

TRIES = 8
"""Times that the real robot is moved a little until it touches."""

STREAM = 991
"""Of the device's own random numbers, beside those of the cell's effects."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedDevice(Result):
    """Rows at the features of a device in the virtual cell: SIMULATED.

    Attributes
    ----------
    robot : str
        As the user named it.
    cell : VirtualCell
    found : Placed
        The device, where it is.
    q : ndarray, shape (n, joints)
        Commanded joints.
    which : ndarray of int, shape (n,)
        Number of the feature at each.
    value : ndarray, shape (n,) or (n, corners, 2), or None
        What the device showed: metres, of a camera pixels.
    noise : float
        Standard deviation of a contact or a value, of a camera that of an image as a whole, metres.
    payload : float or None
        Mass carried, kg, where it was asked for: the rows then tell it.
    """

    robot: str
    cell: VirtualCell
    found: Placed
    q: FloatArray
    which: IntArray
    value: FloatArray | None
    noise: float
    payload: float | None = None

    def to_frame(self) -> pd.DataFrame:
        """The rows as the first file of ``irbcal calibrate --features``."""
        table = rows_table(self.cell.arm, self.found, self.q, self.which, self.value)
        if self.payload is not None:
            payload_at = dict(zip(PAYLOAD_CENTRE, np.array(self.cell.tool.payload_centre) / MM, strict=True))
            table = table.assign(payload_kg=self.payload, **payload_at)
        return table.assign(simulated="yes")

    def features(self) -> pd.DataFrame:
        """What is known of the features, as the second file."""
        return self.found.table()

    def read(self) -> FeatureSet:
        """Both, as the calibration reads them."""
        return read_features(self.to_frame(), self.features(), self.cell.arm)

    simulated: ClassVar[bool] = True
    CONTENT = (
        "robot=cell.arm.name simulated device=found.device.name poses=q.__len__ features=found.own.keys noise_mm "
        "effects=cell.on seed=cell.seed"
    )

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        device = self.found.device
        return [
            f"SIMULATED: {len(self.q)} poses of {self.cell.arm.name} at {device.words}, noise {self.noise / MM:g} mm",
            f"Effects: {', '.join(self.cell.on) or 'none'}",
        ]

    def save(self, out: str | Path) -> tuple[Path, Path, Path]:
        """Write rows, features (``NAME.features.csv``) and truth (``NAME.truth.json``), together or not at all.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        out = Path(out)
        files = [out.name, f"{out.stem}.features.csv", f"{out.stem}.truth.json"]
        tables = (self.to_frame(), self.features())
        data = [csv_bytes(table) for table in tables]
        ball = dict(zip(("x", "y", "z"), (np.array(BALL) / MM).tolist(), strict=True))
        truth = {
            "simulated": True,
            "note": "What the virtual cell hides; the identification never reads this file.",
            "made_by": "irbcal simulate --device",
            "robot": self.robot,
            "device": self.found.device.name,
            "data": out.name,
            "data_sha256": hashlib.sha256(data[0]).hexdigest(),
            "ball_in_tip_link_mm": ball,
            **({"camera_axes_in_tip_link": AXES.tolist()} if self.found.device.sees else {}),
            "features_in_base_link_m": {
                name: {key: value.tolist() for key, value in values.items()} for name, values in self.found.own.items()
            },
            **self.cell.truth(),
        }
        contents = [*data, json.dumps(truth, indent=1, ensure_ascii=False).encode()]
        atomic.write_together(out.parent, dict(zip(files, contents, strict=True)))
        first, second, third = (out.parent / name for name in files)
        return first, second, third


def simulate_device(
    robot: str | Path,
    device: str,
    random: int = 100,
    *,
    seed: int = 0,
    robot_seed: int = ROBOT_SEED,
    noise: float | None = None,
    cell: Literal["thesis", "realistic"] = "thesis",
    only: Sequence[str] | None = None,
    without: Sequence[str] = (),
    payload: float | None = None,
    at: tuple[FloatArray, IntArray] | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
) -> SimulatedDevice:
    """Measure with a device in place of a tracker, in the virtual cell: SIMULATED rows at features.

    Parameters
    ----------
    robot : str or Path
        As for `irbcal.simulate`.
    device : {"balls", "string", "ballbar", "two-balls", "sockets", "ball", "camera", "plane"}
        What takes the tracker's place, see `irbcal.simulation.devices.DEVICES`.
    random : int
        Number of poses, shared out among the device's features.
    seed, robot_seed : int
        Of poses and noise, and of the robot's own errors.
    noise : float, optional
        Standard deviation of a contact or a value, of a camera that of an image as a whole, metres; what is plausible
        for the device unless given.
    cell : {"thesis", "realistic"}
    only, without : sequence of str
        Effects of the cell that are on, or off; one of the two. The robot's own geometry errs in any case.
    payload : float, optional
        Mass carried, kg; the rows then have columns of it and its place. That of the cell's tool unless given.
    at : tuple, optional
        Joints (n, joints) and number of the feature of each (n,), as `irbcal.device_plan` gives them: the real robot is
        brought to the features from there. Random ones unless given.
    base_link, tip_link, coupling
        As for `irbcal.simulate`.

    Raises
    ------
    IrbcalError
        If an option or input is refused, or the robot does not reach the device.
    """
    chosen = DEVICES[checked("device", device, tuple(DEVICES))]
    seed, robot_seed = check_seed(seed), check_seed(robot_seed, "robot_seed")
    count = number("random", random, len(chosen.spots), MOST_POSES, whole=True)
    kind = checked("cell", cell, shipped_cells.KINDS)
    opened = open_cell(robot, base_link, tip_link, coupling=coupling, seed=seed, robot_seed=robot_seed)
    opened = shipped_cells.of_kind(kind, opened, robot_seed)
    if only is not None and without:
        raise OptionError("only and without exclude each other", parameter="only")
    opened = opened.without(*names("without", without)) if only is None else opened.only(*names("only", only))
    mass = None if payload is None else number("payload", payload, 0.0, LARGEST_PAYLOAD_KG)
    opened = opened if mass is None else opened.with_payload(mass)
    size = chosen.noise if noise is None else number("noise", noise, 0.0, 0.01)
    features = placed(opened.arm, chosen).with_noise(size)
    q, which = poses(opened.arm, features, count, seed) if at is None else at
    order = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(STREAM, 1))).permutation(len(q))
    order = order[np.argsort(which[order], kind="stable")]
    q, which, value = _measured(opened, features, q[order], which[order], size)
    return SimulatedDevice(str(robot), opened, features, q, which, value, size, mass)


def _lagging(cell: VirtualCell, lag: FloatArray) -> Tips:
    """Tips of the nominal arm with the real robot's distance from it, (n, 4, 4)."""
    return lambda q: np.asarray(lag @ cell.arm.forward(q))


def _measured(
    cell: VirtualCell, features: Placed, q: FloatArray, which: IntArray, noise: float
) -> tuple[FloatArray, IntArray, FloatArray | None]:
    """The real robot brought to each feature, and what the device shows there."""
    rng = np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(STREAM, 2)))
    size = KINDS[features.device.kind].size
    off = noise * rng.standard_normal((len(q), size))
    spots = list(features.own)
    T = cell.measure(q).T_base_tip
    if features.device.touched:
        for _ in range(TRIES):  # how it comes to a stop depends on all stops before: all are moved a little each time
            q_before = q.copy()
            lag = T @ np.linalg.inv(cell.arm.forward(q_before))
            for k, name in enumerate(spots):
                rows = which == k
                q[rows], _ = met(cell.arm, features, name, q[rows], _lagging(cell, lag[rows]), off[rows])
            T = cell.measure(q).T_base_tip
            if np.abs(q - q_before).max() < 1e-9:
                break
    value = shown(T, features, which)
    if value is None:
        return q, which, None
    more = off[:, 0] if value.ndim == 1 else noise * rng.standard_normal(value.shape)
    return q, which, value + more * (spread(features, noise) / noise if noise else 0.0)
