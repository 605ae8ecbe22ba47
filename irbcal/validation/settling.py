"""Coming to rest: stabilisation time and overshoot, posing time (ISO 9283:1998; Nubiola 2011, annex V).

The formulas are those of public descriptions of the standard; the standard itself was not at hand. A move lasts from
the instant at which the limit band about its start is left until that from which the band about its end is not left
again, so the time to settle is part of it. The standard asks for moves of several lengths, three cycles each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, Locked, plain
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike, distinct
from irbcal.modeling import frames
from irbcal.plotting.charts import (
    DASHED,
    DOT,
    DOTTED,
    TALL,
    WIDE,
    Chart,
    Drawing,
    LegendEntry,
    Panel,
    axis_top,
    span,
)
from irbcal.summary import Paragraph, Result, Table, simulated_mark, values
from irbcal.units import MM

REST = 10.0
"""Seconds after which the thesis's robot was at rest (annex V)."""

SMALLEST_SHOWN_MM = 1e-4
"""Smallest distance that a logarithmic axis shows, mm."""

READINGS = 100
"""Readings whose mean is the final position (annex V)."""


@dataclass(frozen=True, eq=False)
class Stabilisation(Locked):
    """How one approach came to rest (Nubiola 2011, Figure A V-1)."""

    first_entry: float
    settled: float
    """When the limit band was entered first, and when it was entered and not left again, seconds; NaN if never."""
    overshoot: float
    """Largest distance after the first entry if that is beyond the band, else zero, metres; NaN without an entry."""
    largest: float
    """Largest distance after the first entry, metres."""
    instant: FloatArray
    """Shape (n,). Of the readings, seconds."""
    distance: FloatArray
    """Shape (n,). From the final position, metres."""

    @property
    def time(self) -> float:
        """Stabilisation time PSt, seconds; NaN if the robot never settled."""
        return self.settled - self.first_entry


def final_position(time: FloatArray, xyz: FloatArray, earliest: float = REST, count: int = READINGS) -> FloatArray:
    """Where a robot came to rest: mean of the first ``count`` readings from a time on (annex V: 100 after 10 s).

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds.
    xyz : ndarray, shape (n, 3)
        Metres.
    earliest : float
        Seconds.
    count : int

    Returns
    -------
    ndarray, shape (3,)
        Metres.

    Raises
    ------
    MeasurementError
        If no reading is that late.
    """
    late = np.flatnonzero(time >= earliest)
    if not len(late):
        raise MeasurementError(
            f"the readings end at {time.max():g} s: the final position is the mean of those after {earliest:g} s"
        )
    return xyz[late[:count]].mean(axis=0)


def stabilisation(time: FloatArray, xyz: FloatArray, final: FloatArray, band: float) -> Stabilisation:
    """Position stabilisation time PSt and overshoot of one approach (annex V).

    From the instant of the first entry into the limit band about the final position until the instant from which it is
    not left again; entries lie between two readings, on the straight line of the distance. A series that begins inside
    the band has entered it with its first reading.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, ascending.
    xyz : ndarray, shape (n, 3)
        Metres.
    final : ndarray, shape (3,)
        Metres.
    band : float
        Radius of the limit band, metres.
    """
    distance = np.linalg.norm(xyz - final, axis=1)
    inside = distance <= band
    if not inside.any():
        return Stabilisation(np.nan, np.nan, np.nan, np.nan, time, distance)

    def entry(k: int) -> float:
        if k == 0:
            return float(time[0])
        share = (distance[k - 1] - band) / (distance[k - 1] - distance[k])
        return float(time[k - 1] + share * (time[k] - time[k - 1]))

    first = int(np.argmax(inside))
    outside = np.flatnonzero(~inside)
    last = int(outside[-1]) + 1 if len(outside) else 0
    largest = float(distance[first:].max())
    settled = entry(last) if last < len(time) else np.nan
    return Stabilisation(entry(first), settled, largest if largest > band else 0.0, largest, time, distance)


@dataclass(frozen=True, eq=False, repr=False)
class Settling(Result):
    """Position stabilisation time and overshoot of several approaches (ISO 9283 asks for three).

    Attributes
    ----------
    band : float
        Limit band, metres.
    at_rest_after : float
        Seconds after which the robot was taken to be at rest.
    runs : dict of str to Stabilisation
    simulated : bool
    """

    band: float
    at_rest_after: float
    runs: dict[str, Stabilisation]
    simulated: bool = False

    @property
    def time(self) -> float | None:
        """Mean stabilisation time PSt, seconds; None where a run never settled."""
        times = [run.time for run in self.runs.values()]
        return float(np.mean(times)) if np.isfinite(times).all() else None

    @property
    def overshoot(self) -> float | None:
        """Largest overshoot, metres; None where no run entered the band."""
        overshoots = [run.overshoot for run in self.runs.values() if np.isfinite(run.overshoot)]
        return max(overshoots) if overshoots else None

    CHECK = "settle"
    CONTENT = "check=CHECK band_mm after_s=at_rest_after PSt_s=time overshoot_mm runs=by_run simulated"

    ROWS, COLUMNS = "runs", "run time_s=instant distance_mm"

    def by_run(self) -> dict[str, Any]:
        """Of each run times and overshoot, None for what never was, and its distances over time."""
        names = "PSt_s=time first_entry_s=first_entry settled_s=settled overshoot_mm time_s=instant distance_mm"
        return {name: values(run, names) for name, run in self.runs.items()}

    def report(self) -> Sequence[Paragraph]:
        """Mean time and largest overshoot, and both run by run."""
        rows = tuple(
            (name, *map(plain, (run.first_entry, run.settled, run.time)), plain(run.overshoot / MM))
            for name, run in self.runs.items()
        )
        columns = ("run", "first in band s", "settled s", "PSt s", "overshoot mm")
        mean = "a run never settled" if self.time is None else f"PSt {self.time:.2f} s (mean)"
        largest = "–" if self.overshoot is None else f"{self.overshoot / MM:.3f}"
        title = f"Position stabilisation, limit band {self.band / MM:.4g} mm"
        return [
            f"{simulated_mark(self.simulated)}{mean}, overshoot {largest} mm (largest)",
            Table(title, columns, rows),
        ]

    def plot(self) -> Chart:
        """Distance from the final position over time (Figure A V-1), with the limit band and the time of settling."""
        distances = {name: np.maximum(run.distance / MM, SMALLEST_SHOWN_MM) for name, run in self.runs.items()}
        band = self.band / MM
        every = np.concatenate([*distances.values(), [band]])
        drawing = Drawing("Distance from the final position over time", TALL, WIDE)
        ends = span(*(run.instant for run in self.runs.values()))
        label = "distance from final position (mm)"
        panel = Panel(drawing, ends, (0.8 * every.min(), 1.3 * every.max()), "time (s)", label, log=True)
        legend: list[LegendEntry] = []
        for k, (name, run) in enumerate(self.runs.items()):
            colour = f"series{k % 5}"
            panel.line(run.instant, distances[name], colour)
            settled = f"PSt {run.time:.2f} s" if np.isfinite(run.settled) else "never settled"
            legend.append((colour, "-", f"run {name}: {settled}"))
            if np.isfinite(run.settled):
                panel.upright(run.settled, colour, dash=DASHED)
        panel.level(band, "ink", dash=DOTTED)
        legend.append(("ink", "--", f"band {band:g} mm"))
        caption = "Distance from the final position over time; upright dashed line: settled"
        return Chart("stabilisation", caption, [drawing], legend).marked(self.simulated)


def settle(source: TableLike, band: float, rest: float = REST, count: int = READINGS) -> Settling:
    """Position stabilisation time and overshoot of the runs of a file (annex V).

    Parameters
    ----------
    source : str, Path or DataFrame
        Columns ``time_s``, ``x_mm``, ``y_mm``, ``z_mm`` and, for several, ``run``.
    band : float
        Limit band, metres.
    rest : float
        Seconds after which the robot is at rest.
    count : int
        Readings after that whose mean is the final position.

    Raises
    ------
    MeasurementError
        If the file does not keep the format, time does not go on, or a run ends too early.
    OptionError
        If the band is not above zero.
    """
    if not band > 0:
        raise OptionError(f"a limit band is above zero, found {band / MM:g} mm", parameter="band")
    table, runs = InputTable.read(source, ["time_s"]).measured(), {}
    run = table.texts("run", "1")
    for name in distinct(run):
        time, xyz = table[run == name].ascending("time_s"), table[run == name].si(POSITION)
        try:
            final = final_position(time, xyz, rest, count)
        except MeasurementError as error:
            raise MeasurementError(f"run {name}: {error}", file=table.source) from None
        runs[name] = stabilisation(time, xyz, final, band)
    return Settling(band, rest, runs, table.simulated)


AT_REST = 3
"""Readings at rest that a move begins and ends with at least."""


@dataclass(frozen=True, eq=False)
class PosedMove(Locked):
    """One move, cycle by cycle."""

    departure: FloatArray
    arrival: FloatArray
    """Shape (cycles,). Instants of leaving and of reaching rest, seconds."""
    distance: FloatArray
    """Shape (cycles,). From rest to rest, metres."""
    angle: FloatArray | None
    """Shape (cycles,). Turn from rest to rest where orientations were measured, radians."""

    @property
    def times(self) -> FloatArray:
        """Posing time of each cycle, seconds."""
        return self.arrival - self.departure


@dataclass(frozen=True, eq=False, repr=False)
class PosingTimes(Result):
    """Posing times of several moves."""

    band: float
    """Limit band, metres."""
    moves: dict[str, PosedMove]
    simulated: bool

    CONTENT = "band_mm moves=to_frame simulated"
    ROWS = "moves"
    COLUMNS = (
        "move distance_mm=distance.mean angle_deg=angle.mean cycles=times.__len__ time_s=times.mean "
        "shortest_s=times.min longest_s=times.max"
    )

    def report(self) -> Sequence[Paragraph]:
        """The shortest and the longest posing time, and those move by move."""
        table = self.to_frame()
        if table["angle_deg"].isna().all():
            table = table.drop(columns="angle_deg")
        times, start = table["time_s"], simulated_mark(self.simulated)
        headline = f"{start}posing times of {len(times)} moves: {min(times):.3f} to {max(times):.3f} s"
        title = f"{start}Posing time from rest to rest, limit band {self.band / MM:.4g} mm"
        return [headline, Table.from_frame(title, table, [name.replace("_", " ") for name in table.columns])]

    def plot(self) -> Chart:
        """Posing time over the length of the move: cycles and their mean."""
        moves = sorted(self.moves.values(), key=lambda move: float(move.distance.mean()))
        drawing = Drawing("Posing time over the length of the move", TALL, WIDE)
        x_label = f"length of the move (mm); limit band {self.band / MM:g} mm"
        ends = (0.0, axis_top(*(move.distance / MM for move in moves)))
        panel = Panel(drawing, ends, (0.0, axis_top(*(move.times for move in moves))), x_label, "posing time (s)")
        for move in moves:
            panel.dots(move.distance / MM, move.times, "measured", DOT)
        panel.line([m.distance.mean() / MM for m in moves], [m.times.mean() for m in moves], "accent")
        caption = "Posing time over the length of the move"
        legend: list[LegendEntry] = [("accent", "-", "mean of the cycles")]
        return Chart("posing", caption, [drawing], legend).marked(self.simulated)


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
