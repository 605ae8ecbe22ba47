"""The demonstration: the shipped IRB 1600 with worn gears, and the poses that it is measured in; SIMULATED.

``scripts/make_demo_data`` writes its measurements into ``irbcal/data``. Wear, payload and gains are chosen so that
nominal errors are about those of Nubiola 2011, Table 7.1 and that 34 parameters leave about as much as in Nubiola
2011, Table 7.4; the shipped cell itself, fitted by least squares, leaves half of that.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import gain
from irbcal.modeling.terms.term_map import TermMap
from irbcal.simulation import pose_list
from irbcal.simulation.effects import BacklashEffect, HarmonicsEffect, LostEffect
from irbcal.simulation.pose_list import PoseList, numbered
from irbcal.simulation.shipped_cells import open_cell
from irbcal.simulation.virtual_cell import WAIT_S, VirtualCell
from irbcal.units import DEG

ROBOT = "irb1600"
SEED = 1600

WEAR = 2.0
"""Backlash and gear harmonics against those of the shipped cell."""
PAYLOAD_KG = 6.0
"""The tool with all its reflectors and eight steel discs (Nubiola 2011, section 3.4.1)."""
GAIN = (4e-5, 0.0, 0.0, -6e-5, 8e-5, 0.0)
"""Gear ratio errors k of joints 1 to 6 (Nubiola 2011, eq. 3.31)."""
LOST_SHARE = 0.01

REFERENCES = ("ref1", "ref2", "ref3")
WITHOUT = ("tilt", "settling", "visibility")
"""Effects that are off: level 34 describes the geometry, nothing swings four seconds after a stop, and the tracker sees
every target."""

IDENTIFICATION = {"iso_cube": 52, "all_range": 50}
"""Random poses beside 18 axis moves (Nubiola 2011, section 7.2)."""
VERIFICATION = {"iso_cube": 500, "all_range": 500}


def demonstration_cell() -> VirtualCell:
    """The cell that the demonstration's data come from: targets 1 to 3 and three references."""
    cell = open_cell(ROBOT, seed=SEED).without(*WITHOUT).with_targets(pose_list.IDENTIFIED).with_payload(PAYLOAD_KG)
    waves = tuple((joint, periods, WEAR * size, phase) for joint, periods, size, phase in HarmonicsEffect().waves)
    gaps = tuple(WEAR * gap for gap in BacklashEffect().peak_to_peak_deg)
    for effect in (HarmonicsEffect(waves), BacklashEffect(gaps), LostEffect(LOST_SHARE)):
        cell = cell.with_effect(effect)
    gains, series = gain.FAMILY.terms(cell.arm), cell.joint_map.terms
    return cell.replace(
        joint_map=JointMap(TermMap(cell.arm, (*gains, *series.terms), np.append(GAIN, series.coefficients))),
        references={name: cell.references[name] for name in REFERENCES},
    )


def identification_poses(cell: VirtualCell) -> PoseList:
    """120 poses: three for each axis, then random ones (Nubiola 2011, section 7.2)."""
    axes = [angle * DEG * np.eye(6)[joint] for joint in range(6) for angle in (-30.0, 0.0, 30.0)]
    groups = [f"axis{joint}" for joint in range(1, 7) for _ in range(3)]
    q, more = _random(cell, IDENTIFICATION, 0)
    return _listed(np.vstack([*axes, q]), groups + more)


def verification_poses(cell: VirtualCell) -> PoseList:
    """1,000 poses that the identification does not see."""
    return _listed(*_random(cell, VERIFICATION, 1))


def _random(cell: VirtualCell, counts: dict[str, int], stream: int) -> tuple[FloatArray, list[str]]:
    """Random joints of each group, and the groups."""
    regions = dict(zip(pose_list.AREAS, (pose_list.in_cube, pose_list.in_range), strict=True))
    q = [
        pose_list.random_poses(cell, count, [SEED, stream, k], regions[group])
        for k, (group, count) in enumerate(counts.items())
    ]
    return np.vstack(q), [group for group, count in counts.items() for _ in range(count)]


def _listed(q: FloatArray, groups: list[str]) -> PoseList:
    n = len(q)
    extra = {"group": np.array(groups, dtype=object)}
    return PoseList(q, numbered(n), None, np.full(n, WAIT_S), extra, f"{n} poses")
