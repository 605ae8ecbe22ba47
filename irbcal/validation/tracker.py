"""Checks of the laser tracker itself: scale bar, repeatability and long-term drift (Nubiola 2011, annexes II to IV).

Files are tables with ``x_mm``, ``y_mm``, ``z_mm`` in the tracker's frame and:

============== ===========================================================================================
check          further columns
============== ===========================================================================================
``bar``        ``end`` (two names, measured in turn), optional ``position`` (of the bar); or ``distance_mm`` alone
``repeat``     optional ``position`` (name of the point that was measured again and again)
``drift``      ``time_s``, optional ``temperature_c``, ``pressure_mmhg`` (or ``_hpa``), ``humidity_percent``
``settle``     ``time_s`` and ``run``: a robot coming to rest, see `irbcal.validation.pose_tests.stabilisation`
============== ===========================================================================================
"""

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.measurement import readings
from irbcal.measurement.statistics import statistics
from irbcal.units import MM
from irbcal.validation import iso9283

CHECKS = ("bar", "repeat", "drift", "settle")
ENVIRONMENT = ("temperature_c", "pressure_mmhg", "pressure_hpa", "humidity_percent")
XYZ = ["x_mm", "y_mm", "z_mm"]
FEWEST = 10
"""Readings below which no correlation is given."""


def kind(path):
    """Which check a file is for, by its columns: one of `CHECKS`."""
    columns = readings.read(path, ()).columns
    if "end" in columns or "distance_mm" in columns:
        return "bar"
    if "time_s" in columns:
        return "settle" if "run" in columns else "drift"
    return "repeat"


# --- scale bar --------------------------------------------------------------------------------------------


def scale_bar(path, length):
    """Distance errors of a scale bar: measured minus certified length (annex II).

    The k-th reading of one end and the k-th of the other at a position of the bar make a distance.

    Parameters
    ----------
    path : str or Path
    length : float
        Certified length, metres.

    Returns
    -------
    dict
        ``n``, ``mean_mm`` and ``sigma_mm`` of the signed errors, ``max_abs_mm``, ``rms_mm``; the same ``per_position``;
        ``error_mm`` and ``position`` in the order of the file.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or an end was measured more often than the other.
    """
    position, distance = _distances(path)
    error = distance - length
    if np.median(np.abs(error)) > 0.01 * length:
        raise MeasurementError(
            f"{path}: the ends are {np.median(distance) / MM:.3f} mm apart, not {length / MM:g} mm: another bar"
        )
    names = list(dict.fromkeys(position))
    return {
        "length_mm": length / MM,
        **_signed(error),
        "per_position": {str(name): _signed(error[position == name]) for name in names},
        "position": [str(name) for name in position],
        "error_mm": (error / MM).tolist(),
    }


def _distances(path):
    table = readings.read(path, (), (), (*XYZ, "distance_mm"))
    position = _names(table, "position")
    if "distance_mm" in table.columns:
        distance = table["distance_mm"].to_numpy()
        if np.isnan(distance).any():
            row = table["row"].iloc[int(np.argmax(np.isnan(distance)))]
            raise MeasurementError(f"{path}: row {row}, column distance_mm: expected a number, found nothing")
        return position, distance * MM
    table = readings.read_points(path, ("end",))
    position, xyz = _names(table, "position"), table[XYZ].to_numpy() * MM
    ends = list(dict.fromkeys(table["end"]))
    if len(ends) != 2:
        raise MeasurementError(f"{path}: column end: expected two names, found {', '.join(ends[:5])}")
    where, distance = [], []
    for name in dict.fromkeys(position):
        first, second = (np.flatnonzero((position == name) & (table["end"] == end)) for end in ends)
        if len(first) != len(second):
            raise MeasurementError(
                f"{path}: position {name}: end {ends[0]} was measured {len(first)} times, end {ends[1]} "
                f"{len(second)} times: readings of both ends make a distance"
            )
        where += [name] * len(first)
        distance.append(np.linalg.norm(xyz[first] - xyz[second], axis=1))
    return np.array(where, dtype=object), np.concatenate(distance)


def _names(table, column):
    if column not in table.columns:
        return np.full(len(table), "all", dtype=object)
    return table[column].astype(str).str.strip().to_numpy(dtype=object)


def _signed(error):
    """Statistics of signed errors, mm."""
    e = error / MM
    return {
        "n": len(e),
        "mean_mm": float(e.mean()),
        "sigma_mm": float(e.std(ddof=1)) if len(e) > 1 else 0.0,
        "max_abs_mm": float(np.abs(e).max()),
        "rms_mm": float(np.sqrt(np.mean(e**2))),
    }


# --- repeatability ----------------------------------------------------------------------------------------


def repeatability(path):
    """How well the tracker finds fixed points again (annex III): distances from the mean of each point's readings.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        ``per_position``: STATS of the distances (``mean_plus_3sigma_mm`` is RP of ISO 9283) and ``x_mm``, ``y_mm``,
        ``z_mm`` of the mean; ``position`` and ``error_mm`` in the order of the file; ``lost``.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or a point was measured once only.
    """
    table = readings.read_points(path)
    position, xyz = _names(table, "position"), table[XYZ].to_numpy() * MM
    error, out = np.empty(len(xyz)), {}
    for name in dict.fromkeys(position):
        mine = position == name
        if mine.sum() < 2:
            raise MeasurementError(f"{path}: position {name} has one reading only: repeatability needs two")
        _, error[mine] = iso9283.position_repeatability(xyz[mine])
        middle = xyz[mine].mean(axis=0) / MM
        out[str(name)] = {**dict(zip(XYZ, middle.tolist(), strict=True)), **statistics(error[mine])}
    return {
        "per_position": out,
        "position": [str(name) for name in position],
        "error_mm": (error / MM).tolist(),
        "lost": table.attrs["lost"],
    }


# --- long-term drift --------------------------------------------------------------------------------------


def drift(path):
    """A fixed target over hours (annex IV): errors, trend, and correlation with the air.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict
        STATS of the distances from the mean; ``hours``; ``rate_mm_per_hour`` (least-squares trend of x, y, z, and its
        size); ``correlation``: for each column of the air that varies its range and, for ``error``, ``x``, ``y`` and
        ``z``, `correlation`; the series for drawing.

    Raises
    ------
    MeasurementError
        If the file does not keep the format.
    """
    table = readings.read_points(path, numbers=("time_s",), optional=ENVIRONMENT)
    if len(table) < FEWEST:
        raise MeasurementError(f"{path}: {len(table)} readings are too few for drift, expected {FEWEST} or more")
    targets = sorted(set(table["target"].astype(str))) if "target" in table.columns else []
    if len(targets) > 1:
        raise MeasurementError(
            f"{path}: column target: expected the readings of one fixed target, found {', '.join(targets[:8])}: "
            "keep one of them"
        )
    table = table.sort_values("time_s", kind="stable")
    time, xyz = table["time_s"].to_numpy(), table[XYZ].to_numpy() * MM
    if time[-1] == time[0]:
        raise MeasurementError(f"{path}: column time_s: all readings are of the same time")
    offset = xyz - xyz.mean(axis=0)
    error = np.linalg.norm(offset, axis=1)
    hours = (time - time[0]) / 3600
    rate = np.polynomial.polynomial.polyfit(hours, offset, 1)[1] / MM
    found = {}
    for name in ENVIRONMENT:
        if name not in table.columns:
            continue
        air = table[name].to_numpy(dtype=float)
        have = np.isfinite(air)
        if have.sum() < FEWEST:
            continue
        entry = {"low": float(air[have].min()), "high": float(air[have].max())}
        if np.ptp(air[have]) > 0:
            values = {"error": error, **dict(zip("xyz", offset.T, strict=True))}
            entry |= {key: correlation(air[have], value[have]) for key, value in values.items()}
        found[name] = entry
    return {
        **statistics(error),
        "hours": float(hours[-1]),
        "mean_position_mm": (xyz.mean(axis=0) / MM).tolist(),
        "rate_mm_per_hour": {**dict(zip("xyz", rate.tolist(), strict=True)), "total": float(np.linalg.norm(rate))},
        "correlation": found,
        "lost": table.attrs.get("lost", 0),
        "series": {
            "hours": hours.tolist(),
            "error_mm": (error / MM).tolist(),
            "offset_mm": (offset / MM).tolist(),
            "air": {name: [v if v == v else None for v in table[name].tolist()] for name in found},
        },
    }


def correlation(first, second, level=0.95):
    """Correlation of two series and an interval that knows that neighbours in time are alike.

    Slow series repeat themselves, so n readings are worth fewer: ``n_eff = n / (1 + 2 sum_k r_1(k) r_2(k))`` with the
    autocorrelations (Bartlett 1946), up to the lag at which that of the slower series is no longer positive. The
    interval is that of Fisher's z with n_eff readings; where there is none, ``n_eff`` is below 4.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
        In order of time, about evenly spaced.
    level : float

    Returns
    -------
    dict
        ``r``, ``n_eff``, ``interval`` (low, high, or None), ``told`` (whether the interval leaves out zero).
    """
    from scipy.special import ndtri

    a, b = first - first.mean(), second - second.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    r = float(a @ b / scale) if scale > 0 else 0.0
    own = [_autocorrelation(series) for series in (a, b)]
    end = max(int(np.argmax(c <= 0)) if (c <= 0).any() else len(c) for c in own)
    effective = float(len(a) / (1 + 2 * max(0.0, own[0][1:end] @ own[1][1:end])))
    if effective < 4 or abs(r) >= 1:
        return {"r": r, "n_eff": effective, "interval": None, "told": bool(abs(r) >= 1)}
    half = ndtri(0.5 + level / 2) / np.sqrt(effective - 3)
    low, high = np.tanh([np.arctanh(r) - half, np.arctanh(r) + half])
    return {"r": r, "n_eff": effective, "interval": [float(low), float(high)], "told": bool(low > 0 or high < 0)}


def _autocorrelation(x):
    """Autocorrelation of a series of mean zero at the lags 0 ... n - 1, by Fourier transform."""
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    c = np.fft.irfft(power)[: len(x)]
    return c / c[0] if c[0] > 0 else np.eye(1, len(x))[0]
