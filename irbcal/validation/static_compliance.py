"""Static compliance of ISO 9283:1998: displacement of the flange by a force on it.

The formulas are those of public descriptions of the standard; the standard itself was not at hand: forces along the
axes of the base, both ways, in steps up to the rated load, three cycles; displacements in mm per N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.plotting.charts import DOT, TALL, WIDE, Chart, Drawing, LegendEntry, Panel, axis_top, span
from irbcal.summary import Paragraph, Result, Table, simulated_mark
from irbcal.units import MM
from irbcal.validation.pose_criteria import AXES

if TYPE_CHECKING:
    import pandas as pd

DIRECTIONS = tuple(f"{sign}{axis}" for axis in AXES for sign in "+-")
"""Names of directions of force."""


@dataclass(frozen=True, eq=False)
class Compliance(Locked):
    """What forces in one direction do.

    Attributes
    ----------
    per_newton : ndarray, shape (cycles, 3)
        Slope of the displacement over the force, by least squares with the unloaded place free, m/N.
    force : ndarray, shape (n,)
        Of all readings, newtons.
    displacement : ndarray, shape (n, 3)
        From the unloaded place of its cycle, metres.
    direction : ndarray, shape (3,)
        Of the force.
    """

    per_newton: FloatArray
    force: FloatArray
    displacement: FloatArray
    direction: FloatArray

    @property
    def along(self) -> float:
        """Compliance in the direction of the force, mean of the cycles, m/N."""
        return float(self.per_newton.mean(axis=0) @ self.direction)

    @property
    def across(self) -> float:
        """Compliance across the force, mean of the cycles, m/N."""
        mean = self.per_newton.mean(axis=0)
        return float(np.linalg.norm(mean - (mean @ self.direction) * self.direction))

    @property
    def spread(self) -> float:
        """Half the range of the cycles' compliances along the force, m/N."""
        return float(np.ptp(self.per_newton @ self.direction) / 2)

    @property
    def largest(self) -> tuple[float, float]:
        """Largest force (N) and the mean displacement along it (m)."""
        most = float(self.force.max())
        return most, float((self.displacement[self.force == most] @ self.direction).mean())


@dataclass(frozen=True, eq=False, repr=False)
class StaticCompliance(Result):
    """Compliance along and against the axes of a frame.

    Attributes
    ----------
    frame : str
        ``base link``, or ``measuring frame`` without a calibration.
    directions : dict of str to Compliance
        ``+x``, ``-x``, ``+y``, …
    simulated : bool
    """

    frame: str
    directions: dict[str, Compliance]
    simulated: bool

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON: ``frame``, ``directions`` (as `to_frame`), ``simulated``."""
        return {
            "frame": self.frame,
            "directions": self.to_frame().to_dict("records"),
            "simulated": self.simulated,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each direction.

        ``direction``, ``cycles``, ``along_mm_per_n`` with half its range over the cycles, ``across_mm_per_n``,
        ``largest_n`` and the displacement along it.
        """
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "direction": name,
                    "cycles": len(c.per_newton),
                    "along_mm_per_n": c.along / MM,
                    "half_range_mm_per_n": c.spread / MM,
                    "across_mm_per_n": c.across / MM,
                    "largest_n": c.largest[0],
                    "displacement_mm": c.largest[1] / MM,
                }
                for name, c in self.directions.items()
            ]
        )

    def report(self) -> Sequence[Paragraph]:
        """The softest direction, and the compliance direction by direction."""
        columns = ("force", "cycles", "along mm/N", "±", "across mm/N", "largest N", "moves mm")
        name, worst = max(self.directions.items(), key=lambda entry: entry[1].along)
        start = simulated_mark(self.simulated)
        title = f"{start}Static compliance, axes of the {self.frame}"
        headline = f"{start}static compliance up to {worst.along / MM:.5f} mm/N ({name})"
        return [headline, Table.of(title, self.to_frame(), columns, 5)]

    def plot(self) -> Chart:
        """Displacement along the force over the force, with the fitted slopes."""
        along = {name: d.displacement @ d.direction / MM for name, d in self.directions.items()}
        slopes = {name: d.along / MM for name, d in self.directions.items()}
        ends = {name: np.array([0.0, d.force.max()]) for name, d in self.directions.items()}
        drawing = Drawing("Displacement over force", TALL, WIDE)
        x_label, y_label = f"force along the axes of the {self.frame} (N)", "displacement along the force (mm)"
        y = span(*along.values(), *(ends[name] * slope for name, slope in slopes.items()))
        panel = Panel(drawing, (0.0, axis_top(*ends.values())), y, x_label, y_label)
        legend: list[LegendEntry] = []
        for k, (name, direction) in enumerate(self.directions.items()):
            colour = f"series{k % 5}"
            panel.dots(direction.force, along[name], colour, DOT)
            panel.line(ends[name], ends[name] * slopes[name], colour)
            legend.append((colour, "-", f"{name}: {slopes[name]:.5f} mm/N"))
        return Chart("compliance", "Displacement along the force", [drawing], legend).marked(self.simulated)


def static_compliance(forces: TableLike, R_frame_world: FloatArray | None = None) -> StaticCompliance:
    """Static compliance from a file of loaded and unloaded places.

    Parameters
    ----------
    forces : str, Path or DataFrame
        Columns ``direction`` (``+x``, ``-x``, ``+y``, …), ``force_n`` (not negative; 0 is the unloaded place),
        ``x_mm``, ``y_mm``, ``z_mm``, optional ``cycle``.
    R_frame_world : ndarray, shape (3, 3), optional
        Takes directions of the measuring frame to the frame along whose axes the forces act, the base link.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or a direction has fewer than two different forces in a cycle.
    """
    table = InputTable.read(forces, ["direction", "force_n"]).measured()
    xyz, force = table.si(POSITION), table.si("force_n")
    xyz = xyz if R_frame_world is None else xyz @ R_frame_world.T
    directions, cycle = table.choice("direction", DIRECTIONS), table.texts("cycle")
    table.refuse(force < 0, "force_n", "a force that is not negative: the direction has the sign")
    out = {}
    for name in distinct(directions):
        slopes, loads, moved = [], [], []
        for c in distinct(cycle[directions == name]):
            rows = (directions == name) & (cycle == c)
            f, p = force[rows], xyz[rows]
            if np.ptp(f) == 0:
                subject = f"direction {name}{f' of cycle {c}' if c else ''}"
                sentence = f"{subject} has one force only: compliance needs two, 0 for the unloaded place"
                raise table.fault(sentence, int(np.argmax(rows)), "force_n")
            off = f - f.mean()
            slope = off @ p / (off @ off)
            slopes.append(slope)
            loads.append(f)
            moved.append(p - (p.mean(axis=0) - f.mean() * slope))
        direction = np.eye(3)[AXES.index(name[1])] * (1.0 if name[0] == "+" else -1.0)
        out[name] = Compliance(np.array(slopes), np.concatenate(loads), np.concatenate(moved), direction)
    frame = "measuring frame" if R_frame_world is None else "base link"
    return StaticCompliance(frame, out, table.simulated)
