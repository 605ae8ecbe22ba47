"""Does the tracker hold still for hours? A fixed target, and the air (Nubiola 2011, annex IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.columns import POSITION, InputTable, TableLike
from irbcal.measurement.statistics import statistics
from irbcal.plotting.charts import Chart
from irbcal.summary import Cell, Paragraph, Result, Table
from irbcal.units import HOUR, MM
from irbcal.validation.pose_criteria import AXES

if TYPE_CHECKING:
    import pandas as pd
from irbcal.chance import normal_quantile


@dataclass(frozen=True)
class Correlation:
    """Correlation of two series.

    Attributes
    ----------
    r : float
        Pearson's.
    n_eff : float
        How many independent readings the series are worth.
    interval : tuple of float, or None
        Low and high end; None where ``n_eff`` is below 4.
    told : bool
        Whether the interval leaves out zero.
    """

    r: float
    n_eff: float
    interval: tuple[float, float] | None
    told: bool

    def to_dict(self) -> dict[str, Any]:
        """The same by name."""
        return {**vars(self), "interval": None if self.interval is None else list(self.interval)}


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

FEWEST = 10
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
    """

    time: FloatArray
    mean_position: FloatArray
    offset: FloatArray
    rate: FloatArray
    air: dict[str, FloatArray]
    correlation: dict[str, dict[str, Correlation]]
    lost: int

    @property
    def error(self) -> FloatArray:
        """Distance from the mean, shape (n,), metres."""
        return np.linalg.norm(self.offset, axis=1)

    @property
    def hours(self) -> float:
        """From the first reading to the last."""
        return float(self.time[-1] / HOUR)

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm.

        ``check``; STATS of the distances from the mean; ``hours``; ``rate_mm_per_hour`` (least-squares trend of x, y
        and z, and its size); ``correlation``: for each column of the air its range and, if it varies, for ``error``,
        ``x``, ``y`` and ``z`` what `irbcal.validation.point_drift.Correlation` holds; the series for drawing.
        """
        rate = self._rate()
        return {
            "check": "drift",
            **(statistics(self.error) or {}),
            "hours": self.hours,
            "mean_position_mm": (self.mean_position / MM).tolist(),
            "rate_mm_per_hour": {
                **dict(zip(AXES, rate.tolist(), strict=True)),
                "total": float(np.linalg.norm(rate)),
            },
            "correlation": {
                name: {
                    "low": float(np.nanmin(values)),
                    "high": float(np.nanmax(values)),
                    **{key: value.to_dict() for key, value in self.correlation[name].items()},
                }
                for name, values in self.air.items()
            },
            "lost": self.lost,
            "series": {
                "hours": (self.time / HOUR).tolist(),
                "error_mm": (self.error / MM).tolist(),
                "offset_mm": (self.offset / MM).tolist(),
                "air": {name: [v if v == v else None for v in values.tolist()] for name, values in self.air.items()},
            },
        }

    def _rate(self) -> FloatArray:
        return self.rate * HOUR / MM

    def to_frame(self) -> pd.DataFrame:
        """A row for each reading: ``hours``, ``error_mm``, ``dx_mm``, ``dy_mm``, ``dz_mm`` and the air."""
        import pandas as pd

        offset = {f"d{axis}_mm": self.offset[:, k] / MM for k, axis in enumerate(AXES)}
        return pd.DataFrame({"hours": self.time / HOUR, "error_mm": self.error / MM, **offset, **self.air})

    def report(self) -> Sequence[Paragraph]:
        """Errors, trend, and correlation with the air."""
        stats, rate = statistics(self.error) or {}, self._rate()
        out: list[Paragraph] = [
            f"{stats['n']} readings over {self.hours:.2f} hours: error mean {stats['mean_mm']:.4f}, sigma "
            f"{stats['sigma_mm']:.4f}, max {stats['max_mm']:.4f} mm",
            f"Trend: x {rate[0]:+.5f}, y {rate[1]:+.5f}, z {rate[2]:+.5f} mm per hour, {np.linalg.norm(rate):.5f} "
            "together",
        ]
        rows: list[tuple[Cell, ...]] = []
        for name, by_quantity in self.correlation.items():
            for key, c in by_quantity.items():
                interval = "–" if c.interval is None else f"{c.interval[0]:.2f} … {c.interval[1]:.2f}"
                rows.append((name, key, c.r, interval, round(c.n_eff), "yes" if c.told else "no"))
            if not by_quantity:
                rows.append((name, "constant", None, "–", None, "–"))
        if rows:
            columns = ("air", "of", "r", "95 % interval", "n effective", "told from none")
            out.append(Table("Correlation with the air", columns, tuple(rows), digits=2))
            out.append("Of twenty such intervals, one leaves out zero by chance.")
        if self.lost:
            out.append(f"Left out: {self.lost} lost points")
        return out

    def plot(self) -> Chart:
        """Error and air over time, one above the other (Figures A IV-1, A IV-2, A IV-3 and A IV-4)."""
        from irbcal.validation import plots

        return plots.drift(self)


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
    if len(table) < FEWEST:
        raise table.fault(f"{len(table)} readings are too few for drift, expected {FEWEST} or more")
    targets = sorted(set(table.texts("target")))
    if len(targets) > 1:
        sentence = f"expected the readings of one fixed target, found {', '.join(targets[:8])}: keep one of them"
        raise table.fault(sentence, column="target")
    table = table[np.argsort(table.si("time_s"), kind="stable")]
    time, xyz = table.si("time_s"), table.si(POSITION)
    time = time - time[0]
    if time[-1] == 0.0:
        raise table.fault("all readings are of the same time", column="time_s")
    offset = xyz - xyz.mean(axis=0)
    rate = np.polynomial.polynomial.polyfit(time / HOUR, offset, 1)[1] / HOUR
    air = {name: table.optional(name) for name in ENVIRONMENT}
    air = {name: values for name, values in air.items() if np.isfinite(values).sum() >= FEWEST}
    by_air = {name: _with_air(values, offset) for name, values in air.items()}
    return PointDrift(time, xyz.mean(axis=0), offset, rate, air, by_air, len(every) - len(table))


def _with_air(air: FloatArray, offset: FloatArray) -> dict[str, Correlation]:
    """Correlation of error, x, y and z with one column of the air; empty if that does not vary."""
    have = np.isfinite(air)
    if not np.ptp(air[have]) > 0:
        return {}
    series = {"error": np.linalg.norm(offset, axis=1), **dict(zip(AXES, offset.T, strict=True))}
    return {key: correlation(air[have], values[have]) for key, values in series.items()}
