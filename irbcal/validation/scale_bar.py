"""Is the tracker true? Distances of a scale bar of certified length (Nubiola 2011, annex II)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, NameArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.plotting.charts import Chart
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

ANOTHER_BAR = 0.01
"""Share of the length by which readings may miss it before they are taken to be those of another bar."""

EVERYWHERE = "all"
"""Name of the only position of a file without a column ``position``."""


@dataclass(frozen=True, eq=False, repr=False)
class ScaleBar(Result):
    """Distance errors of a scale bar: measured minus certified length, in the order of the file.

    Attributes
    ----------
    length : float
        Certified, metres.
    position : ndarray of str, shape (n,)
        Of the bar (Table A II-1).
    error : ndarray, shape (n,)
        Metres.
    """

    length: float
    position: NameArray
    error: FloatArray

    def at(self, position: str) -> FloatArray:
        """Errors at one position of the bar, metres."""
        return self.error[self.position == position]

    def positions(self) -> list[str]:
        """Positions of the bar in the order of measurement."""
        return distinct(self.position)

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm.

        ``check``, ``length_mm``; ``n``, ``mean_mm`` and ``sigma_mm`` of the signed errors, ``max_abs_mm``,
        ``rms_mm``; the same ``per_position``; ``position`` and ``error_mm`` in the order of the file.
        """
        return {
            "check": "bar",
            "length_mm": self.length / MM,
            **_signed(self.error),
            "per_position": {name: _signed(self.at(name)) for name in self.positions()},
            "position": [str(name) for name in self.position],
            "error_mm": (self.error / MM).tolist(),
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each distance: ``position``, ``error_mm``."""
        import pandas as pd

        return pd.DataFrame({"position": self.position, "error_mm": self.error / MM})

    def report(self) -> Sequence[Paragraph]:
        """Statistics of all distances, and position by position."""
        sets = {"all": self.error}
        if len(self.positions()) > 1:
            sets |= {name: self.at(name) for name in self.positions()}
        rows = tuple((name, *_signed(errors).values()) for name, errors in sets.items())
        title = f"Distance errors of the scale bar of {self.length / MM:.10g} mm, mm"
        all_of = _signed(self.error)
        sentence = (
            f"{all_of['n']} distances of a scale bar: errors of {all_of['mean_mm']:+.4f} mm on average, "
            f"{all_of['max_abs_mm']:.4f} mm at most."
        )
        return [sentence, Table(title, ("position", "n", "mean", "sigma", "largest", "rms"), rows, digits=4)]

    def plot(self) -> Chart:
        """Errors in order of measurement, by position of the bar (Figure A II-1)."""
        from irbcal.validation import plots

        return plots.bar(self)


def _signed(error: FloatArray) -> dict[str, int | float]:
    """Statistics of signed errors, mm."""
    e = error / MM
    return {
        "n": len(e),
        "mean_mm": float(e.mean()),
        "sigma_mm": float(e.std(ddof=1)) if len(e) > 1 else 0.0,
        "max_abs_mm": float(np.abs(e).max()),
        "rms_mm": float(np.sqrt(np.mean(e**2))),
    }


def scale_bar(source: TableLike, length: float) -> ScaleBar:
    """Distance errors of a scale bar (annex II, Figure A II-1).

    The k-th reading of one end and the k-th of the other at a position of the bar make a distance.

    Parameters
    ----------
    source : str, Path or DataFrame
        Columns ``end`` (two names, measured in turn), ``x_mm``, ``y_mm``, ``z_mm`` and, optionally, ``position`` (of
        the bar); or ``distance_mm`` alone.
    length : float
        Certified length, metres.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or an end was measured more often than the other.
    OptionError
        If the length is not above zero.
    """
    if not length > 0:
        raise OptionError(f"a scale bar has a length above zero, found {length / MM:g} mm", parameter="length")
    table = InputTable.read(source)
    if "distance_mm" in table:
        position, distance = table.texts("position", EVERYWHERE), table.si("distance_mm")
    else:
        position, distance = _between_ends(InputTable.read(source, ["end"]).measured())
    error = distance - length
    if np.median(np.abs(error)) > ANOTHER_BAR * length:
        raise MeasurementError(
            f"the ends are {np.median(distance) / MM:.3f} mm apart, not {length / MM:g} mm: another bar",
            file=table.source,
        )
    return ScaleBar(length, position, error)


def _between_ends(table: InputTable) -> tuple[NameArray, FloatArray]:
    end, position, xyz = table.filled("end"), table.texts("position", EVERYWHERE), table.si(POSITION)
    ends = distinct(end)
    if len(ends) != 2:
        raise table.fault(f"expected two names, found {', '.join(ends[:5])}", column="end")
    where: list[str] = []
    distance = []
    for name in distinct(position):
        first, second = (np.flatnonzero((position == name) & (end == side)) for side in ends)
        if len(first) != len(second):
            raise table.fault(
                f"position {name}: end {ends[0]} was measured {len(first)} times, end {ends[1]} "
                f"{len(second)} times: readings of both ends make a distance"
            )
        where += [name] * len(first)
        distance.append(np.linalg.norm(xyz[first] - xyz[second], axis=1))
    return np.array(where, dtype=object), np.concatenate(distance)
