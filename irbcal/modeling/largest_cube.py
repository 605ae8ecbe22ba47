"""The largest cube in front of an arm, in which plans take poses and the test poses of ISO 9283 lie."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.modeling.arm import Arm

BATCH = 50_000
"""Random joints that are looked at together."""

KeepPlaces: TypeAlias = "Callable[[FloatArray], BoolArray]"
"""From joints (n, joints) to a mask (n,) of those that may be used."""


def largest_cube(
    arm: Arm, keep: KeepPlaces | None = None, samples: int = 1_000_000, seed: int = 0
) -> tuple[FloatArray, float]:
    """The largest cube in front of an arm that its tip reaches everywhere, in any orientation.

    Random joints fill cells of a grid, a sixtieth of the workspace wide, and gaps of one cell; the cube is the largest
    one of filled cells with x above zero in all of it, and of equal ones the one nearest to y = 0. It is then made a
    cell smaller on each side. An arm of two joints reaches a surface alone: its cube is a quarter as wide as that. ISO
    9283 asks for the largest cube with the tool's orientation given, which is smaller: for the IRB 1600 this finds 1.06
    m where the thesis has 0.65 m.

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
        raise MeasurementError(
            f"{arm.name} reaches nothing in front of it, so there is no cube: give its centre and its edge"
        )
    cell = (tip.max(axis=0) - tip.min(axis=0)).max() / 60
    low = np.array([0.0, np.floor(tip[:, 1].min() / cell) * cell - cell / 2, tip[:, 2].min()])
    index = np.floor((tip - low) / cell).astype(int)
    filled = np.zeros(index.max(axis=0) + 5, dtype=bool)  # two empty cells on each side
    filled[tuple(index.T + 2)] = True
    closed = binary_closing(filled, np.ones((2, 2, 2)))  # with cells that no sample fell into
    depth = distance_transform_cdt(closed, metric="chessboard")
    centres = low + (np.argwhere(depth == depth.max()) - 1.5) * cell
    edge = (2 * depth.max() - 3) * cell
    if edge <= 0:  # the tip reaches a surface only, as with two joints: a quarter of that about its middle
        return tip[np.argmin(np.linalg.norm(tip - np.median(tip, axis=0), axis=1))], 15.0 * cell
    return centres[np.argmin(np.abs(centres[:, 1]))], float(edge)
