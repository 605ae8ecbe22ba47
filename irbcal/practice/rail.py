"""An arm on a rail, measured in the virtual cell: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator

from irbcal.io import robots, urdf
from irbcal.practice.measured import TARGETS, measurements
from irbcal.practice.sample import Sample, csv
from irbcal.simulation import masses
from irbcal.simulation.pose_list import drawn
from irbcal.simulation.shipped import shipped_cell

POSES = 60
RAIL = """  <link name="rail_base"/>
  <joint name="rail" type="prismatic">
    <parent link="rail_base"/>
    <child link="base_link"/>
    <axis xyz="0 1 0"/>
    <limit lower="0" upper="2" effort="1000" velocity="1"/>
  </joint>
</robot>
"""


def files() -> Iterator[Sample]:
    """A small arm on a rail."""
    text = robots.robot_file("irb120").read_text(encoding="utf-8").replace("</robot>", RAIL)
    yield Sample("cell.urdf", text.encode(), "an arm on a rail")
    found = urdf.from_bytes(text.encode(), "cell.urdf", "rail_base", "tool0")
    cell = shipped_cell(found.arm, masses.bodies(found)).without("visibility").with_targets(TARGETS)
    table = measurements(cell, drawn(cell, POSES, 1))
    line = "irbcal calibrate rail.csv --robot cell.urdf --base-link rail_base --tip-link tool0 --out rail-calibration"
    yield Sample("rail.csv", csv(table), f"{POSES} poses of the arm on its rail", line)
