"""Checks of the laser tracker itself (Nubiola 2011, annexes II, III, IV and V).

Is it true (a scale bar of certified length), does it find a fixed point again, does it hold still for hours?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray, rms
from irbcal.distributions import normal_quantile
from irbcal.error_statistics import FOUR, headed, statistics
from irbcal.errors import OptionError
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike, distinct
from irbcal.option_values import length as metres
from irbcal.option_values import number
from irbcal.plotting.charts import DOT, TALL, WIDE, Chart, Drawing, Panel, axis_top, grouped_panel, runs, span
from irbcal.summary import Paragraph, Result, Table, TableValue, simulated_mark, values
from irbcal.units import HOUR, MM
from irbcal.validation.pose_criteria import AXES, position_repeatability
from irbcal.validation.settling import REST, Settling, settle
from irbcal.wording import counted, first_of

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
    lost : int
        Distances that lack a reading.
    simulated : bool
        Whether the file says that it is simulated.
    """

    length: float
    position: NameArray
    error: FloatArray
    lost: int
    simulated: bool = False

    def at(self, position: str) -> FloatArray:
        """Errors at one position of the bar, metres."""
        return self.error[self.position == position]

    def positions(self) -> list[str]:
        """Positions of the bar in the order of measurement."""
        return distinct(self.position)

    @property
    def per_position(self) -> dict[str, dict[str, int | float]]:
        """Statistics of the signed errors at each position of the bar, mm."""
        return {name: _signed(self.at(name)) for name in self.positions()}

    @property
    def overall(self) -> dict[str, int | float]:
        """Statistics of all signed errors, mm."""
        return _signed(self.error)

    CHECK = "bar"
    CONTENT = "check=CHECK *overall length_mm per_position position error_mm lost simulated"
    COLUMNS = "position error_mm"

    def report(self) -> Sequence[Paragraph]:
        """Statistics of all distances, and position by position."""
        all_of, apart = _signed(self.error), self.per_position
        sets = [("all", all_of), *(apart.items() if len(apart) > 1 else ())]
        rows = tuple((name, *errors.values()) for name, errors in sets)
        title = f"Distance errors of the scale bar of {self.length / MM:.10g} mm, mm"
        sentence = (
            f"{simulated_mark(self.simulated)}{counted(len(self.error), 'distance')} of a scale bar: errors of "
            f"{all_of['mean_mm']:+.4f} mm on average, {all_of['max_abs_mm']:.4f} mm at most."
        )
        table = Table(title, ("position", "n", "mean", "sigma", "largest", "rms"), rows, digits=4)
        return [sentence, table, *_left_out(self.lost, "distance with a lost reading", "distances with a lost reading")]

    def plot(self) -> Chart:
        """Distance errors of the scale bar in order of measurement, by position of the bar (Figure A II-1)."""
        error = self.error / MM
        drawing = Drawing("Distance errors of the scale bar", TALL, WIDE)
        panel = grouped_panel(drawing, self.position, span(error, [0.0]), "position of the bar", "distance error (mm)")
        panel.level(0.0)
        panel.dots(np.arange(len(error)), error, "measured", DOT)
        for start, end, name in runs(self.position):
            mean = self.at(name).mean() / MM
            panel.line([start - 0.5, end - 0.5], [mean, mean], "accent")
        caption = "Distance errors of the scale bar, in each position in order of measurement; line: mean"
        return Chart("scale_bar", caption, [drawing]).marked(self.simulated)


def _left_out(lost: int, singular: str, plural: str = "") -> list[Paragraph]:
    return [f"Left out: {counted(lost, singular, plural)}"] if lost else []


def _signed(error: FloatArray) -> dict[str, int | float]:
    """Statistics of signed errors, mm; of one error there is no sigma (NaN)."""
    e = error / MM
    return {
        "n": len(e),
        "mean_mm": float(e.mean()),
        "sigma_mm": float(e.std(ddof=1)) if len(e) > 1 else np.nan,
        "max_abs_mm": float(np.abs(e).max()),
        "rms_mm": rms(e),
    }


def scale_bar(source: TableLike, length: float) -> ScaleBar:
    """Distance errors of a scale bar (annex II, Figure A II-1).

    The k-th reading of one end and the k-th of the other at a position of the bar make a distance; lost readings count,
    and the distances that they belong to are left out.

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
        If the file does not keep the format, an end has more readings than the other, no distance is whole, or one is
        that of another bar.
    OptionError
        If the length is not above zero.
    """
    if not length > 0:
        raise OptionError(f"a scale bar has a length above zero, found {length / MM:g} mm", parameter="length")
    table = InputTable.read(source)
    if "distance_mm" in table:
        position, distance = table.texts("position", EVERYWHERE), table.si("distance_mm")
        row = np.arange(len(distance))
    else:
        position, distance, row = _between_ends(InputTable.read(source, ["end", *POSITION]))
    whole = np.isfinite(distance)
    if not whole.any():
        raise table.fault("every distance lacks a reading")
    position, distance, row = position[whole], distance[whole], row[whole]
    error = distance - length
    usual = np.median(distance) / MM
    if np.median(np.abs(error)) > ANOTHER_BAR * length:
        raise table.fault(f"the ends are {usual:.3f} mm apart, not {length / MM:g} mm: another bar")
    far = np.abs(error) > ANOTHER_BAR * length
    if far.any():
        k = int(np.argmax(far))
        raise table.fault(
            f"expected a distance near {usual:.3f} mm, as most are, found {distance[k] / MM:.3f} mm: if its ends were "
            "measured at two positions of the bar, name the positions in a column position; else leave it out",
            int(row[k]),
        )
    return ScaleBar(length, position, error, int((~whole).sum()), table.simulated)


def _between_ends(table: InputTable) -> tuple[NameArray, FloatArray, IntArray]:
    """Position and length of each distance, in metres, NaN where a reading is lost, and the row of its later end."""
    end, position = table.filled("end"), table.texts("position", EVERYWHERE)
    xyz = np.where(table.lost()[:, None], np.nan, table.si(POSITION, lost=True))
    ends = distinct(end)
    if len(ends) != 2:
        raise table.fault(f"expected two names, found {first_of(ends, 5)}", column="end")
    where: list[str] = []
    distance, row = [], []
    for name in distinct(position):
        first, second = (np.flatnonzero((position == name) & (end == side)) for side in ends)
        if len(first) != len(second):
            raise table.fault(
                f"position {name}: end {ends[0]} has {counted(len(first), 'reading')}, end {ends[1]} has "
                f"{counted(len(second), 'reading')}, lost ones included: a reading of each end makes a distance"
            )
        where += [name] * len(first)
        distance.append(np.linalg.norm(xyz[first] - xyz[second], axis=1))
        row.append(np.maximum(first, second))
    return np.array(where, dtype=object), np.concatenate(distance), np.concatenate(row)


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
    simulated : bool
        Whether the file says that it is simulated.
    """

    position: NameArray
    xyz: FloatArray
    error: FloatArray
    lost: int
    simulated: bool = False

    def positions(self) -> list[str]:
        """Names of the points in the order of measurement."""
        return distinct(self.position)

    def statistics(self, position: str) -> dict[str, Any]:
        """Statistics of the distances of one point, mm (Table A III-2); ``mean_plus_3sigma_mm`` is RP of ISO 9283."""
        return dict(statistics(self.error[self.position == position]) or {})

    @property
    def per_position(self) -> dict[str, dict[str, Any]]:
        """Mean ``x_mm``, ``y_mm``, ``z_mm`` (Table A III-1) and statistics of the distances of each point, mm."""
        places = {name: self.xyz[self.position == name].mean(axis=0) / MM for name in self.positions()}
        return {name: dict(zip(POSITION, xyz, strict=True)) | self.statistics(name) for name, xyz in places.items()}

    CHECK = "repeat"
    CONTENT = "check=CHECK per_position position error_mm lost simulated"
    COLUMNS = "position x_mm,y_mm,z_mm=xyz error_mm"

    def report(self) -> Sequence[Paragraph]:
        """Statistics point by point."""
        columns = headed("n", *FOUR)
        rows = tuple((name, *(self.statistics(name)[key] for _, key in columns)) for name in self.positions())
        headings = ("point", "n", *(heading for heading, _ in columns[1:]))
        table = Table("Repeatability, distances from the mean, mm", headings, rows, digits=4)
        worst = max(self.positions(), key=lambda name: float(self.statistics(name)["mean_plus_3sigma_mm"]))
        out: list[Paragraph] = [
            f"{simulated_mark(self.simulated)}{counted(len(self.error), 'reading')} of {counted(len(rows), 'point')}: "
            f"mean + 3σ of the distances from the mean {self.statistics(worst)['mean_plus_3sigma_mm']:.4f} mm at most "
            f"({worst}).",
            table,
        ]
        return [*out, *_left_out(self.lost, "lost reading")]

    def plot(self) -> Chart:
        """Distance of each reading from the mean of its point (Nubiola 2011, Figure A III-1)."""
        order = np.argsort([self.positions().index(name) for name in self.position], kind="stable")
        error, labels = self.error[order] / UM, [self.position[k] for k in order]
        limits = {name: self.statistics(name)["mean_plus_3sigma_mm"] * MM / UM for name in self.positions()}
        drawing = Drawing("Distance of each reading from the mean of its point", TALL, WIDE)
        top = axis_top(error, list(limits.values()))
        panel = grouped_panel(drawing, labels, (0.0, top), "point", "distance from mean (µm)")
        panel.dots(np.arange(len(error)), error, "measured", DOT)
        for start, end, name in runs(labels):
            panel.line([start - 0.5, end - 0.5], [limits[name], limits[name]], "accent")
        caption = "Distance of each reading from the mean of its point, in order of measurement; line: mean + 3σ"
        return Chart("repeatability", caption, [drawing]).marked(self.simulated)


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
    return PointRepeatability(position, xyz, error, len(table) - len(measured), table.simulated)


@dataclass(frozen=True)
class Correlation:
    """Correlation of two series."""

    r: float
    """Pearson's."""
    n_eff: float
    """How many independent readings the series are worth."""
    interval: tuple[float, float] | None
    """Low and high end; None where ``n_eff`` is below 4."""
    significant: bool
    """Whether the interval leaves out zero."""


def correlation(first: FloatArray, second: FloatArray, level: float = 0.95) -> Correlation:
    """Correlation of two series and its interval.

    Slow series repeat themselves, so n readings are worth fewer: ``n_eff = n / (1 + 2 sum_k r_1(k) r_2(k))`` with the
    autocorrelations (Bartlett 1946), up to the lag at which that of the slower series is no longer positive. The
    interval is that of Fisher's z with n_eff readings; where there is none, ``n_eff`` is below 4.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
        In order of time, about evenly spaced.
    level : float
    """
    a, b = first - first.mean(), second - second.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    r = float(a @ b / scale) if scale > 0 else 0.0
    functions = [_autocorrelation(series) for series in (a, b)]
    end = max(int(np.argmax(c <= 0)) if (c <= 0).any() else len(c) for c in functions)
    shared = float(functions[0][1:end] @ functions[1][1:end])
    effective = len(a) / (1 + 2 * max(0.0, shared))
    if effective < 4 or abs(r) >= 1:
        return Correlation(r, effective, None, bool(abs(r) >= 1))
    half = normal_quantile(0.5 + level / 2) / np.sqrt(effective - 3)
    low, high = (float(end) for end in np.tanh([np.arctanh(r) - half, np.arctanh(r) + half]))
    return Correlation(r, effective, (low, high), low > 0 or high < 0)


def _autocorrelation(x: FloatArray) -> FloatArray:
    """Autocorrelation of a series of mean zero at the lags 0 ... n - 1, by Fourier transform."""
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    c = np.fft.irfft(power)[: len(x)]
    return c / c[0] if c[0] > 0 else np.eye(1, len(x))[0]


ENVIRONMENT = ("temperature_c", "pressure_mmhg", "pressure_hpa", "humidity_percent")
"""Columns of the air."""

UNITS = {
    "temperature_c": "temperature (°C)",
    "pressure_mmhg": "pressure (mmHg)",
    "pressure_hpa": "pressure (hPa)",
    "humidity_percent": "humidity (%)",
}
UM = 1e-6
"""One micrometre in metres."""

FEWEST_READINGS = 10
"""Readings below which no correlation is given."""


@dataclass(frozen=True, eq=False, repr=False)
class PointDrift(Result):
    """Readings of a fixed target over hours, in order of time.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Seconds from the first reading.
    mean_position : ndarray, shape (3,)
        In the tracker's frame, metres.
    offset : ndarray, shape (n, 3)
        From the mean, metres.
    rate : ndarray, shape (3,)
        Least-squares trend, metres per second.
    air : dict of str to ndarray, shape (n,)
        Columns of the air that the file has, in their units; NaN where there was no reading.
    correlation : dict of str to dict of str to Correlation
        For each column of the air that varies, of ``error`` (distance from the mean), ``x``, ``y`` and ``z``.
    lost : int
        Readings without a position.
    simulated : bool
        Whether the file says that it is simulated.
    """

    time: FloatArray
    mean_position: FloatArray
    offset: FloatArray
    rate: FloatArray
    air: dict[str, FloatArray]
    correlation: dict[str, dict[str, Correlation]]
    lost: int
    simulated: bool = False

    @property
    def error(self) -> FloatArray:
        """Distance from the mean, shape (n,), metres."""
        return np.linalg.norm(self.offset, axis=1)

    @property
    def hours(self) -> float:
        """From the first reading to the last."""
        return float(self.time[-1] / HOUR)

    CHECK = "drift"
    CONTENT = (
        "check=CHECK *statistics hours mean_position_mm lost rate_mm_per_hour=rates_mm_per_hour correlation=by_air "
        "series simulated"
    )
    COLUMNS = "hours=elapsed error_mm dx_mm,dy_mm,dz_mm=offset *air"

    @property
    def statistics(self) -> Mapping[str, Any]:
        """Statistics of the distances from the mean, mm."""
        return dict(statistics(self.error) or {})

    @property
    def rates_mm_per_hour(self) -> dict[str, float]:
        """Trend of x, y and z, and its size, mm per hour."""
        rate = self._rate()
        return dict(zip((*AXES, "total"), (*rate, np.linalg.norm(rate)), strict=True))

    def by_air(self) -> dict[str, dict[str, Any]]:
        """Of each column of the air its range and, if it varies, `correlation`."""
        return {
            name: {"low": np.nanmin(readings), "high": np.nanmax(readings), **self.correlation[name]}
            for name, readings in self.air.items()
        }

    def series(self) -> dict[str, Any]:
        """What is drawn over time."""
        return values(self, "hours=elapsed error_mm offset_mm air")

    @property
    def elapsed(self) -> FloatArray:
        """Hours from the first reading, shape (n,)."""
        return self.time / HOUR

    def _rate(self) -> FloatArray:
        return self.rate * HOUR / MM

    def report(self) -> Sequence[Paragraph]:
        """Errors, trend, and correlation with the air."""
        stats, rate = self.statistics, self._rate()
        out: list[Paragraph] = [
            f"{simulated_mark(self.simulated)}{stats['n']} readings over {self.hours:.2f} hours: error mean "
            f"{stats['mean_mm']:.4f}, sigma {stats['sigma_mm']:.4f}, max {stats['max_mm']:.4f} mm",
            f"Trend: x {rate[0]:+.5f}, y {rate[1]:+.5f}, z {rate[2]:+.5f} mm per hour, {np.linalg.norm(rate):.5f} "
            "together",
        ]
        rows: list[tuple[TableValue, ...]] = []
        for name, by_quantity in self.correlation.items():
            for key, c in by_quantity.items():
                interval = "–" if c.interval is None else f"{c.interval[0]:.2f} … {c.interval[1]:.2f}"
                rows.append((name, key, c.r, interval, round(c.n_eff), "yes" if c.significant else "no"))
            if not by_quantity:
                rows.append((name, "constant", None, "–", None, "–"))
        if rows:
            columns = ("air", "of", "r", "95 % interval", "n effective", "significant")
            out.append(Table("Correlation with the air", columns, tuple(rows), digits=2))
            out.append("Of twenty such intervals, one leaves out zero by chance.")
        return [*out, *_left_out(self.lost, "lost reading")]

    def plot(self) -> Chart:
        """Error and air over time, one above the other (Figures A IV-1, A IV-2, A IV-3 and A IV-4)."""
        hours = self.time / HOUR
        error = Drawing("Error over time", 0.65 * TALL, WIDE)
        top = axis_top(self.error / UM)
        Panel(error, span(hours), (0.0, top), "time (h)", "error (µm)").dots(hours, self.error / UM, "measured", 2.5)
        drawings = [error]
        for name, air in self.air.items():
            drawing = Drawing(UNITS[name], 0.65 * TALL, WIDE)
            Panel(drawing, span(hours), span(air), "time (h)", UNITS[name]).line(hours, air, "accent", 1.0)
            drawings.append(drawing)
        return Chart("drift", "Error and air over time", drawings, columns=1).marked(self.simulated)


def drift(source: TableLike) -> PointDrift:
    """A fixed target over hours (annex IV): errors, trend, and correlation with the air.

    Parameters
    ----------
    source : str, Path or DataFrame
        Columns ``time_s``, ``x_mm``, ``y_mm``, ``z_mm`` and, optionally, those of `ENVIRONMENT`.

    Raises
    ------
    MeasurementError
        If the file does not keep the format.
    """
    every = InputTable.read(source, ["time_s"])
    table = every.measured()
    if len(table) < FEWEST_READINGS:
        raise table.fault(f"{len(table)} readings are too few for drift, expected {FEWEST_READINGS} or more")
    targets = sorted(set(table.texts("target")))
    if len(targets) > 1:
        sentence = f"expected the readings of one fixed target, found {first_of(targets, 8)}: keep one of them"
        raise table.fault(sentence, column="target")
    table = table[np.argsort(table.si("time_s"), kind="stable")]
    time, xyz = table.si("time_s"), table.si(POSITION)
    time = time - time[0]
    if time[-1] == 0.0:
        raise table.fault("all readings are of the same time", column="time_s")
    offset = xyz - xyz.mean(axis=0)
    rate = np.polynomial.polynomial.polyfit(time / HOUR, offset, 1)[1] / HOUR
    air = {name: table.optional(name) for name in ENVIRONMENT}
    air = {name: values for name, values in air.items() if np.isfinite(values).sum() >= FEWEST_READINGS}
    by_air = {name: _with_air(values, offset) for name, values in air.items()}
    return PointDrift(time, xyz.mean(axis=0), offset, rate, air, by_air, len(every) - len(table), every.simulated)


def _with_air(air: FloatArray, offset: FloatArray) -> dict[str, Correlation]:
    """Correlation of error, x, y and z with one column of the air; empty if that does not vary."""
    have = np.isfinite(air)
    if not np.ptp(air[have]) > 0:
        return {}
    series = {"error": np.linalg.norm(offset, axis=1), **dict(zip(AXES, offset.T, strict=True))}
    return {key: correlation(air[have], values[have]) for key, values in series.items()}


Check: TypeAlias = Literal["bar", "repeat", "drift", "settle"]
CHECKS: tuple[Check, ...] = get_args(Check)

BAND = 0.02 * MM
"""Limit band of a robot coming to rest unless another is given, metres."""


def kind(source: TableLike) -> Check:
    """Which check a file is for, by its columns: one of `CHECKS`."""
    columns = InputTable.read(source)
    if "end" in columns or "distance_mm" in columns:
        return "bar"
    if "time_s" in columns:
        return "settle" if "run" in columns else "drift"
    return "repeat"


def tracker(
    readings: TableLike,
    *,
    check: Check | None = None,
    length: float | None = None,
    band: float = BAND,
    rest: float = REST,
) -> ScaleBar | PointRepeatability | PointDrift | Settling:
    """Scale-bar distances, repeatability, long-term drift with the air, or stabilisation time.

    Files are tables with ``x_mm``, ``y_mm``, ``z_mm`` in the tracker's frame and:

    ============== ==================================================================================================
    check          further columns
    ============== ==================================================================================================
    ``bar``        ``end`` (two names, measured in turn), optional ``position`` (of the bar); or ``distance_mm`` alone
    ``repeat``     optional ``position`` (name of the point that was measured again and again)
    ``drift``      ``time_s``, optional ``temperature_c``, ``pressure_mmhg`` (or ``_hpa``), ``humidity_percent``
    ``settle``     ``time_s`` and ``run``: a robot coming to rest
    ============== ==================================================================================================

    Parameters
    ----------
    readings : str, Path or DataFrame
        Table of readings (CSV, XLSX or Parquet) with the columns of its check.
    check : str, optional
        One of `CHECKS`; by default told by the columns.
    length : float
        Certified length of the scale bar, metres.
    band : float
        Limit band of a robot coming to rest, metres.
    rest : float
        Seconds after which the robot is at rest.

    Returns
    -------
    ScaleBar, PointRepeatability, PointDrift or Settling
        With ``summary()``, ``to_dict()``, ``to_frame()`` and ``plot()``.

    Raises
    ------
    OptionError
        If a scale bar has no certified length, or the check is unknown.
    MeasurementError
        If the file does not keep the format.
    """
    if check is not None and check not in CHECKS:
        raise OptionError.unknown("check", check, CHECKS)
    band, rest = metres("band", band), number("rest", rest, 0)
    if length is not None:
        length = metres("length", length)
    check = check or kind(readings)
    if check == "repeat":
        return repeatability(readings)
    if check == "drift":
        return drift(readings)
    if check == "settle":
        return settle(readings, band, rest)
    if length is None:
        raise OptionError("a scale bar needs its certified length", parameter="length")
    return scale_bar(readings, length)
