"""Minimum posing time of ISO 9283:1998: from rest to rest, by the length of the move.

The formulas are those of public descriptions of the standard; the standard itself was not at hand. A move lasts from
the instant at which the limit band about its start is left until that from which the band about its end is not left
again, so the time to settle is part of it. The standard asks for moves of several lengths, three cycles each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, Locked, plain
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.modeling import frames
from irbcal.plotting.charts import Chart
from irbcal.summary import Paragraph, Result, Table, simulated_mark
from irbcal.units import DEG, MM
from irbcal.validation.settling import stabilisation

if TYPE_CHECKING:
    import pandas as pd

AT_REST = 3
"""Readings at rest that a move begins and ends with at least."""


@dataclass(frozen=True, eq=False)
class PosedMove(Locked):
    """One move, cycle by cycle.

    Attributes
    ----------
    departure, arrival : ndarray, shape (cycles,)
        Instants of leaving and of reaching rest, seconds.
    distance : ndarray, shape (cycles,)
        From rest to rest, metres.
    angle : ndarray, shape (cycles,), or None
        Turn from rest to rest where orientations were measured, radians.
    """

    departure: FloatArray
    arrival: FloatArray
    distance: FloatArray
    angle: FloatArray | None

    @property
    def times(self) -> FloatArray:
        """Posing time of each cycle, seconds."""
        return self.arrival - self.departure


@dataclass(frozen=True, eq=False, repr=False)
class PosingTimes(Result):
    """Posing times of several moves.

    Attributes
    ----------
    band : float
        Limit band, metres.
    moves : dict of str to PosedMove
    simulated : bool
    """

    band: float
    moves: dict[str, PosedMove]
    simulated: bool

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON: ``band_mm``, ``moves`` (as `to_frame`), ``simulated``."""
        rows = plain(self.to_frame().to_dict("records"))
        return {"band_mm": self.band / MM, "moves": rows, "simulated": self.simulated}

    def to_frame(self) -> pd.DataFrame:
        """A row for each move: ``move``, ``distance_mm``, ``angle_deg``, ``cycles``, ``time_s`` (mean) and its ends."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "move": name,
                    "distance_mm": float(m.distance.mean() / MM),
                    "angle_deg": np.nan if m.angle is None else float(m.angle.mean() / DEG),
                    "cycles": len(m.times),
                    "time_s": float(m.times.mean()),
                    "shortest_s": float(m.times.min()),
                    "longest_s": float(m.times.max()),
                }
                for name, m in self.moves.items()
            ]
        )

    def report(self) -> Sequence[Paragraph]:
        """The shortest and the longest posing time, and those move by move."""
        table = self.to_frame()
        if table["angle_deg"].isna().all():
            table = table.drop(columns="angle_deg")
        times, start = table["time_s"], simulated_mark(self.simulated)
        headline = f"{start}posing times of {len(times)} moves: {min(times):.3f} to {max(times):.3f} s"
        title = f"{start}Posing time from rest to rest, limit band {self.band / MM:.4g} mm"
        return [headline, Table.of(title, table, [name.replace("_", " ") for name in table.columns])]

    def plot(self) -> Chart:
        """Posing time over the length of the move."""
        from irbcal.validation import plots

        return plots.posing_times(self)


def posing_times(moves: TableLike, band: float) -> PosingTimes:
    """Posing times from a file of moves that were sampled from rest to rest.

    Parameters
    ----------
    moves : str, Path or DataFrame
        Columns ``move`` (a name), ``time_s``, ``x_mm``, ``y_mm``, ``z_mm`` in the order of the samples, optional
        ``cycle`` and ``qw,qx,qy,qz``.
    band : float
        Limit band, metres.

    Raises
    ------
    MeasurementError
        If the file does not keep the format, or a move does not begin and end at rest or is too short for the band.
    OptionError
        If the band is not above zero.
    """
    if not band > 0:
        raise OptionError(f"a limit band is above zero, found {band / MM:g} mm", parameter="band")
    table = InputTable.read(moves, ["move", "time_s"]).measured()
    move, cycle, turn = table.filled("move"), table.texts("cycle"), table.rotations()
    out = {}
    for name in distinct(move):
        rows = [np.flatnonzero((move == name) & (cycle == c)) for c in distinct(cycle[move == name])]
        moves_found = []
        for k in rows:
            time, xyz = table[k].ascending("time_s"), table[k].si(POSITION)
            try:
                moves_found.append(_from_rest_to_rest(time, xyz, band))
            except MeasurementError as error:
                raise table.fault(f"move {name}: {error}", int(k[0])) from None
        departure, arrival, distance = np.array(moves_found).T
        turned = None
        if turn is not None:
            ends = np.array([[k[0], k[-1]] for k in rows])
            turned = frames.rotation_distance(turn[ends[:, 0]], turn[ends[:, 1]])
        out[name] = PosedMove(departure, arrival, distance, turned)
    return PosingTimes(band, out, table.simulated)


def _from_rest_to_rest(time: FloatArray, xyz: FloatArray, band: float) -> tuple[float, float, float]:
    """Departure and arrival (s) and the distance between both places of rest (m)."""
    first, last = (_rest(samples, band) for samples in (xyz, xyz[::-1]))
    distance = float(np.linalg.norm(last - first))
    if distance <= 2 * band:
        raise MeasurementError(f"it goes {distance / MM:.3g} mm far, no farther than twice the limit band")
    # leaving is arriving in the time that runs back
    reverse = stabilisation(-time[::-1], xyz[::-1], first, band)
    return -reverse.settled, stabilisation(time, xyz, last, band).settled, distance


def _rest(xyz: FloatArray, band: float) -> FloatArray:
    """Place of rest at the beginning of a series: mean of the first half of the readings that stay within the band."""
    inside = np.linalg.norm(xyz - xyz[0], axis=1) <= band
    count = len(inside) if inside.all() else int(np.argmin(inside))
    if count < AT_REST:
        raise MeasurementError(
            f"expected {AT_REST} readings or more at rest before and after it, found {count} within the limit band of "
            f"{band / MM:g} mm"
        )
    return xyz[: max(AT_REST, count // 2)].mean(axis=0)  # later ones may be on their way already
