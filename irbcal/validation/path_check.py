"""Sampled paths, read and judged: path accuracy and repeatability of ISO 9283:1998."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import MeasurementError
from irbcal.figures.drawn_figure import DrawnFigure
from irbcal.measurement import readings
from irbcal.measurement.columns import TableLike
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM
from irbcal.validation.path_criteria import PathErrors, path_errors
from irbcal.validation.tables import ANGLES, in_order, names, places

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class PathCheck(Speaks):
    """Path accuracy and repeatability of sampled paths.

    Attributes
    ----------
    errors : PathErrors
        On the planes that all cycles cross.
    along : ndarray, shape (m,)
        Way of these planes on the commanded path, metres.
    cycles : int
    planes_of : int
        Points of the commanded path.
    """

    errors: PathErrors
    along: FloatArray
    cycles: int
    planes_of: int

    def __post_init__(self) -> None:
        lock(self)

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm and degrees.

        ``AT_mm``, ``RT_mm``, ``planes``, ``planes_of``, ``cycles``; with orientations ``AT_a_deg`` to ``RT_c_deg``;
        ``along_mm``, ``mean_error_mm`` and ``repeatability_mm`` plane by plane.
        """
        e = self.errors
        out: dict[str, Any] = {
            "AT_mm": e.AT / MM,
            "RT_mm": e.RT / MM,
            "planes": len(e.planes),
            "planes_of": self.planes_of,
            "cycles": self.cycles,
        }
        if e.mean_angles is not None and e.angle_repeatability is not None:
            for k, a in enumerate(ANGLES):
                out[f"AT_{a}_deg"] = float(np.abs(e.mean_angles[:, k]).max() / DEG)
                out[f"RT_{a}_deg"] = float(e.angle_repeatability[:, k].max() / DEG)
        return out | {name: column.tolist() for name, column in self._columns().items()}

    def _columns(self) -> dict[str, FloatArray]:
        return {
            "along_mm": self.along / MM,
            "mean_error_mm": np.linalg.norm(self.errors.mean, axis=1) / MM,
            "repeatability_mm": self.errors.repeatability / MM,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each plane: ``along_mm``, ``mean_error_mm``, ``repeatability_mm``."""
        import pandas as pd

        return pd.DataFrame(self._columns())

    def told(self) -> Sequence[Told]:
        """AT and RT, of orientations too where they were measured."""
        found = self.to_dict()
        lines = [
            f"Path: AT {found['AT_mm']:.3f} mm, RT {found['RT_mm']:.3f} mm ({found['cycles']} cycles, "
            f"{found['planes']} of {found['planes_of']} planes)"
        ]
        if "AT_a_deg" in found:
            angles = [f"AT_{a} {found[f'AT_{a}_deg']:.4f}, RT_{a} {found[f'RT_{a}_deg']:.4f}" for a in ANGLES]
            lines.append(f"Orientation, degrees: {'; '.join(angles)}")
        return lines

    def plot(self) -> DrawnFigure:
        """Path accuracy and repeatability on the planes along the path."""
        from irbcal.validation import plots

        return DrawnFigure.of(plots.along_path, self)


def path_accuracy(path: TableLike, commanded_path: TableLike) -> PathCheck:
    """Path accuracy and repeatability from a file of sampled paths.

    Parameters
    ----------
    path : str, Path or DataFrame
        Columns ``cycle``, ``x_mm``, ``y_mm``, ``z_mm`` in the order of the samples, optional ``qw,qx,qy,qz``.
    commanded_path : str, Path or DataFrame
        Points of the commanded path in order, in the same frame, likewise without ``cycle``.

    Returns
    -------
    PathCheck

    Raises
    ------
    MeasurementError
        If a file does not keep the format or the paths do not fit.
    """
    table, commanded = readings.read_points(path, labels=("cycle",)), readings.read_points(commanded_path)
    file = table.attrs["source"]
    if len(commanded) < 3:
        raise MeasurementError(
            f"a commanded path needs three points or more, found {len(commanded)}", file=commanded.attrs["source"]
        )
    place, turn, cycle = places(table), readings.rotations(table), names(table, "cycle")
    assert cycle is not None
    rows = [np.flatnonzero(cycle == name) for name in in_order(cycle)]
    short = [k for k in rows if len(k) < 2]
    if short:
        raise MeasurementError(
            "a path needs two samples in each cycle", file=file, row=int(table["row"].iloc[short[0][0]])
        )
    wanted = places(commanded)
    try:
        found = path_errors(
            [place[k] for k in rows],
            wanted,
            None if turn is None else [turn[k] for k in rows],
            readings.rotations(commanded),
        )
    except MeasurementError as error:
        raise MeasurementError(str(error), file=file) from None
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(wanted, axis=0), axis=1))])
    return PathCheck(found, way[found.planes], len(rows), len(commanded))
