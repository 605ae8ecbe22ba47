"""Does the tracker find a fixed point again? (Nubiola 2011, annex III)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, NameArray
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.measurement.statistics import statistics
from irbcal.plotting.charts import Chart
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM
from irbcal.validation.pose_criteria import position_repeatability
from irbcal.validation.scale_bar import EVERYWHERE

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class PointRepeatability(Result):
    """Readings of fixed points, and their distances from each point's mean, in the order of the file.

    Attributes
    ----------
    position : ndarray of str, shape (n,)
        Name of the point.
    xyz : ndarray, shape (n, 3)
        In the tracker's frame, metres.
    error : ndarray, shape (n,)
        Distance from the mean of the point's readings, metres.
    lost : int
        Readings without a position.
    """

    position: NameArray
    xyz: FloatArray
    error: FloatArray
    lost: int

    def positions(self) -> list[str]:
        """Names of the points in the order of measurement."""
        return distinct(self.position)

    def statistics(self, position: str) -> dict[str, Any]:
        """STATS of the distances of one point, mm (Table A III-2); ``mean_plus_3sigma_mm`` is RP of ISO 9283."""
        return statistics(self.error[self.position == position]) or {}

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm.

        ``check``; ``per_position``: ``x_mm``, ``y_mm``, ``z_mm`` of the mean (Table A III-1) and STATS of the
        distances; ``position`` and ``error_mm`` in the order of the file; ``lost``.
        """
        per_position = {}
        for name in self.positions():
            middle = self.xyz[self.position == name].mean(axis=0) / MM
            per_position[name] = {**dict(zip(POSITION, middle.tolist(), strict=True)), **self.statistics(name)}
        return {
            "check": "repeat",
            "per_position": per_position,
            "position": [str(name) for name in self.position],
            "error_mm": (self.error / MM).tolist(),
            "lost": self.lost,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each reading: ``position``, ``x_mm``, ``y_mm``, ``z_mm``, ``error_mm``."""
        import pandas as pd

        table = pd.DataFrame(self.xyz / MM, columns=POSITION)
        table.insert(0, "position", self.position)
        return table.assign(error_mm=self.error / MM)

    def report(self) -> Sequence[Paragraph]:
        """Statistics point by point."""
        keys = ("n", "mean_mm", "max_mm", "sigma_mm", "mean_plus_3sigma_mm")
        rows = tuple((name, *(self.statistics(name)[key] for key in keys)) for name in self.positions())
        columns = ("point", "n", "mean", "max", "sigma", "mean+3σ")
        table = Table("Repeatability, distances from the mean, mm", columns, rows, digits=4)
        worst = max(self.positions(), key=lambda name: float(self.statistics(name)["mean_plus_3sigma_mm"]))
        out: list[Paragraph] = [
            f"{len(self.error)} readings of {len(rows)} points: mean + 3σ of the distances from the mean "
            f"{self.statistics(worst)['mean_plus_3sigma_mm']:.4f} mm at most ({worst}).",
            table,
        ]
        return [*out, f"Left out: {self.lost} lost points"] if self.lost else out

    def plot(self) -> Chart:
        """Distance of each reading from the mean of its point (Figure A III-1)."""
        from irbcal.validation import plots

        return plots.repeat(self)


def repeatability(source: TableLike) -> PointRepeatability:
    """How well the tracker finds fixed points again (annex III): distances from the mean of each point's readings.

    Parameters
    ----------
    source : str, Path or DataFrame
        Columns ``x_mm``, ``y_mm``, ``z_mm`` and, optionally, ``position`` (the point that was measured again and
        again).

    Raises
    ------
    MeasurementError
        If the file does not keep the format or a point was measured once only.
    """
    table = InputTable.read(source)
    measured = table.measured()
    position, xyz = measured.texts("position", EVERYWHERE), measured.si(POSITION)
    error = np.empty(len(xyz))
    for name in distinct(position):
        rows = position == name
        if rows.sum() < 2:
            raise table.fault(f"position {name} has one reading only: repeatability needs two")
        _, error[rows] = position_repeatability(xyz[rows])
    return PointRepeatability(position, xyz, error, len(table) - len(measured))
