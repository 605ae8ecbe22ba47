"""Statistics of errors, as Nubiola 2011, section 7.7, has them: figures, their headings in tables, and by label."""

from __future__ import annotations

from collections.abc import KeysView, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import FloatArray
from irbcal.section import Section
from irbcal.summary import Table, TableValue
from irbcal.units import DEG, MM


class NamedNumbers(Section):
    """Numbers by name: as attributes, and as a mapping has them."""

    def keys(self) -> KeysView[str]:
        """The names."""
        return type(self).model_fields.keys()

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


class Statistics(NamedNumbers):
    """Statistics of distances between measured and predicted points, mm; ``sigma_mm`` with n - 1, None of one value."""

    n: int
    mean_mm: float
    sigma_mm: float | None
    max_mm: float
    mean_plus_3sigma_mm: float | None
    rms_mm: float


class RotationStatistics(NamedNumbers):
    """Statistics of the angles between measured and predicted target frames, degrees; ``sigma_deg`` as `Statistics`."""

    n: int
    mean_deg: float
    sigma_deg: float | None
    max_deg: float


HEADINGS = {
    "n": "points",
    "mean": "mean",
    "sigma": "sigma",
    "max": "max",
    "mean_plus_3sigma": "mean+3σ",
    "rms": "rms",
    "p95": "95th percentile",
}
"""Figures of errors, and their headings in tables, pages and certificates; in results a name ends in its unit."""
FOUR = ("mean", "sigma", "max", "mean_plus_3sigma")
"""Those of the tables of Nubiola 2011, section 7.7."""


def headed(*figures: str, unit: str = "mm") -> tuple[tuple[str, str], ...]:
    """Columns of a table of figures: heading, and name in results."""
    return tuple((HEADINGS[name], name if name == "n" else f"{name}_{unit}") for name in figures)


def statistics(distance: ArrayLike) -> Statistics | None:
    """Mean, standard deviation and maximum of distances, as the tables of Nubiola 2011, section 7.7.

    Parameters
    ----------
    distance : array_like, shape (m,)
        Metres; those of four bytes, of long files, are added up without a copy.

    Returns
    -------
    Statistics or None
        None for no distances.
    """
    d = np.asarray(distance)
    if not len(d):
        return None
    n = len(d)
    if d.dtype == np.float32:
        mean = float(d.mean(dtype=float)) / MM
        square = float(np.einsum("i,i->", d, d, dtype=float)) / n / MM**2
        sigma = float(np.sqrt(max(square - mean**2, 0.0) * n / (n - 1))) if n > 1 else None
        largest = float(d.max()) / MM
    else:
        d = d.astype(float) / MM
        mean, square, sigma, largest = float(d.mean()), float(np.mean(d**2)), _sigma(d), float(d.max())
    return Statistics(
        n=n,
        mean_mm=mean,
        sigma_mm=sigma,
        max_mm=largest,
        mean_plus_3sigma_mm=None if sigma is None else mean + 3 * sigma,
        rms_mm=float(np.sqrt(square)),
    )


def statistics_by(distance: FloatArray, labels: Sequence[str] | NDArray[Any]) -> dict[str, Statistics]:
    """`statistics` of the distances of each label, as a dict in the order of the sorted labels."""
    labels = np.asarray(labels, dtype=object)
    by_label = {str(label): statistics(distance[labels == label]) for label in sorted(set(labels))}
    return {label: values for label, values in by_label.items() if values is not None}


def rotation_statistics(angles: ArrayLike) -> RotationStatistics | None:
    """Mean, standard deviation and maximum of angles, as Nubiola 2011, section 7.7.3.5.

    Parameters
    ----------
    angles : array_like, shape (m,)
        Radians.

    Returns
    -------
    RotationStatistics or None
        None for no angles.
    """
    a = np.asarray(angles, dtype=float) / DEG
    if not len(a):
        return None
    return RotationStatistics(n=len(a), mean_deg=float(a.mean()), sigma_deg=_sigma(a), max_deg=float(a.max()))


def _sigma(values: FloatArray) -> float | None:
    """Standard deviation with n - 1; None of one value, whose spread is unknown."""
    return float(values.std(ddof=1)) if len(values) > 1 else None


def statistics_table(title: str, entries: Sequence[tuple[str, str, Mapping[str, Any]]], bold: set[int]) -> Table:
    """Statistics in mm as a table: (label, model, statistics), equal labels once."""
    rows: list[tuple[TableValue, ...]] = []
    previous, columns = None, headed("n", *FOUR, "rms")
    for label, model, values in entries:
        rows.append(("" if label == previous else label, model, *(values[key] for _, key in columns)))
        previous = label
    return Table(title, ("", "model", *(heading for heading, _ in columns)), tuple(rows), bold=frozenset(bold))


def orientation_line(model: str, values: Mapping[str, Any]) -> str:
    """One line on orientation errors."""
    sigma = "" if values["sigma_deg"] is None else f"sigma {values['sigma_deg']:.4f}, "
    return (
        f"Orientation errors, {model}: mean {values['mean_deg']:.4f}, {sigma}max {values['max_deg']:.4f} degrees "
        f"({values['n']} poses)"
    )
