"""The cube in front of an arm in which half of the poses are measured (Nubiola 2011, section 7.2; ISO 9283)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.modeling.arm import Arm
from irbcal.thesis_setup import IRB1600_CUBE, IRB1600_P1
from irbcal.units import MM

LARGEST_CORRECTION = 10 * MM
"""Farther from that no calibration takes the tip."""
BATCH = 50_000
"""Random joints that are looked at together."""

Keep: TypeAlias = "Callable[[FloatArray], BoolArray]"
"""From joints (n, joints) to a mask (n,) of those that may be used."""


def largest_cube(
    arm: Arm, keep: Keep | None = None, samples: int = 1_000_000, seed: int = 0
) -> tuple[FloatArray, float]:
    """The largest cube in front of an arm that its tip reaches everywhere, in any orientation.

    Random joints fill cells of a grid, a sixtieth of the workspace wide; the cube is the largest one of filled cells
    with x above zero in all of it, and of equal ones the one nearest to y = 0. It is then made a cell smaller on each
    side. ISO 9283 asks for the largest cube with the tool's orientation given, which is smaller: for the IRB 1600 this
    finds 1.06 m where the thesis has 0.65 m.

    Parameters
    ----------
    arm : Arm
    keep : callable, optional
        From joints (n, joints) to a mask of those that may be used.
    samples, seed : int

    Returns
    -------
    centre : ndarray, shape (3,)
        In the base link, metres.
    edge : float
        Metres.

    Raises
    ------
    MeasurementError
        If there is none.
    """
    from scipy.ndimage import binary_closing, distance_transform_cdt

    tips: list[FloatArray] = []
    for number in np.random.SeedSequence(seed).generate_state(max(1, samples // BATCH)):
        q = arm.random_joints(min(samples, BATCH), int(number))
        tip = arm.forward(q if keep is None else q[keep(q)])[:, :3, 3]
        tips.append(tip[tip[:, 0] > 0])
    tip = np.concatenate(tips)
    if not len(tip):
        raise MeasurementError(f"{arm.name} reaches nothing in front of it: give the cube's centre and edge")
    cell = (tip.max(axis=0) - tip.min(axis=0)).max() / 60
    low = np.array([0.0, np.floor(tip[:, 1].min() / cell) * cell - cell / 2, tip[:, 2].min()])
    index = np.floor((tip - low) / cell).astype(int)
    filled = np.zeros(index.max(axis=0) + 1, dtype=bool)
    filled[tuple(index.T)] = True
    filled = binary_closing(np.pad(filled, 2), np.ones((2, 2, 2)))[2:-2, 2:-2, 2:-2]  # cells that no sample fell into
    depth = distance_transform_cdt(np.pad(filled, 1), metric="chessboard")[1:-1, 1:-1, 1:-1]
    centres = low + (np.argwhere(depth == depth.max()) + 0.5) * cell
    edge = (2 * depth.max() - 3) * cell
    if edge <= 0:
        raise MeasurementError(f"{arm.name} has no cube in front of it: give the cube's centre and edge")
    return centres[np.argmin(np.abs(centres[:, 1]))], float(edge)


def has_thesis_cube(arm: Arm) -> bool:
    """Whether an arm is the thesis's IRB 1600, calibrated or not: pose P1 brings its tip to the cube's centre."""
    return arm.six_revolute and bool(
        np.linalg.norm(arm.forward(IRB1600_P1)[0, :3, 3] - IRB1600_CUBE[0]) < LARGEST_CORRECTION
    )


def iso_cube(arm: Arm, keep: Keep | None = None) -> tuple[FloatArray, float]:
    """The ISO cube of an arm: that of the thesis for the IRB 1600, `largest_cube` for others; centre and edge."""
    return IRB1600_CUBE if has_thesis_cube(arm) else largest_cube(arm, keep)
