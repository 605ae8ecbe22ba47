"""Lengths and angles between measured joint axes: a DHM table without iteration (Nubiola 2011, section 3.1).

Frames are placed on the axes by their common normals, as `irbcal.modeling.extraction` places them; nearly parallel
axes, which have none worth the name, keep their tilt as Hayati's ``beta`` or are forced into one direction.

Standard deviations come from the circles' residuals, which count as independent. What the poses of a group have in
common (a bent arm, a joint that is not where it says) is not in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification.axes import MeasuredAxes, at_zero_joints
from irbcal.identification.choices import Parallel
from irbcal.modeling import dhm
from irbcal.modeling.extraction import dhm_from_axes
from irbcal.options import checked
from irbcal.units import DEG

PARALLEL = 1.0 * DEG
"""Angle below which ``parallel="forced"`` gives consecutive axes one direction."""

PARALLELS: tuple[Parallel, ...] = get_args(Parallel)

COLUMNS = ("alpha", "a", "theta", "d", "beta")
"""Columns of a table that axes tell about."""

STEP = 1e-6
"""Of the central differences behind standard deviations, radians and metres."""


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """Lengths and angles between consecutive axes, found without a nominal arm.

    Attributes
    ----------
    table : DHMTable
        ``a[i]`` and ``alpha[i]``: distance and angle from axis i to axis i+1 counted from 1 (``a[1]`` lies between axes
        1 and 2); ``d[i]`` and ``theta[i]``: shift along and turn about axis i+1 between the common normals on both of
        its sides. NaN where six axes do not say: row 0, ``theta[5]`` and ``d[5]``. ``a`` is not negative; nearly
        parallel axes are in Hayati's form, with the tilt in ``alpha`` and ``beta``.
    std : DHMTable
        Standard deviations, radians and metres.
    """

    table: dhm.DHMTable
    std: dhm.DHMTable


def link_geometry(axes: MeasuredAxes, parallel: Parallel = "hayati", tolerance: float = PARALLEL) -> LinkGeometry:
    """Lengths and angles between consecutive axes, without a nominal arm (Nubiola 2011, section 3.1.2, Figure 3.2).

    Parameters
    ----------
    axes : MeasuredAxes
    parallel, tolerance
        As `irbcal.identification.axis_calibration.calibrate_by_axes`.

    Returns
    -------
    LinkGeometry
    """
    chain = AxisChain(axes, parallel, tolerance)
    table = chain.table(*axes.as_measured())[1]
    std = standard_deviations(axes, lambda p, z: chain.table(p, z, table)[1])
    return LinkGeometry(unknown(table), unknown(std))


class AxisChain:
    """From axes as measured to frame 1 and a DHM table.

    Parameters
    ----------
    axes : MeasuredAxes
    parallel : str
        ``hayati`` or ``forced`` (Nubiola 2011, section 3.1.3).
    tolerance : float
        Radians; for ``forced``.

    Raises
    ------
    OptionError
        If there is no such way with parallel axes.
    """

    def __init__(self, axes: MeasuredAxes, parallel: Parallel, tolerance: float) -> None:
        checked("parallel", parallel, PARALLELS)
        self.axes = axes
        self.tolerance = tolerance if parallel == "forced" else 0.0
        spread = np.array([fit.direction_std for fit in axes.fits])
        # without standard deviations, or with no noise at all, every axis counts the same
        self.weights = spread**-2.0 if np.all(spread > 1e-12) else np.ones(6)

    def table(
        self, p: FloatArray, z: FloatArray, reference: dhm.DHMTable | None = None
    ) -> tuple[FloatArray, dhm.DHMTable]:
        """``T_world_1`` and the table nearest to a reference, from points and directions as measured."""
        p, z = at_zero_joints(p, z, self.axes.homes)
        table, T_world_0, _ = dhm_from_axes(p, self._same_directions(z), np.eye(4))
        if reference is not None:
            table = nearest(table, reference)
        return T_world_0 @ table.step(0), table

    def _same_directions(self, z: FloatArray) -> FloatArray:
        """Nearly parallel consecutive axes get their weighted mean direction (section 3.1.3)."""
        z = z.copy()
        start = 0
        for k in range(1, 7):
            if k < 6 and np.linalg.norm(np.cross(z[k - 1], z[k])) < np.sin(self.tolerance):
                continue
            run = np.arange(start, k)
            signs = np.sign(z[run] @ z[start])
            mean = (signs * self.weights[run]) @ z[run]
            if len(run) > 1:
                z[run] = signs[:, None] * mean / np.linalg.norm(mean)
            start = k
        return z


def nearest(table: dhm.DHMTable, reference: dhm.DHMTable) -> dhm.DHMTable:
    """The same geometry with the senses of the x axes that lie nearest to a reference table.

    Turning frame i by half a turn about its z axis changes ``theta_i`` and ``theta_{i+1}`` by pi and the signs of
    ``alpha_{i+1}``, ``a_{i+1}`` and ``beta_{i+1}``.
    """
    alpha, a, theta, d, beta = (getattr(table, name).copy() for name in ("alpha", "a", "theta", "d", "beta"))
    for i in range(5):
        if i == 0:  # theta_1 depends on where frame 0 lies: the next row tells
            far = np.cos(alpha[1] - reference.alpha[1]) - np.cos(alpha[1] + reference.alpha[1])
            turn = far < -1e-3 or (abs(far) <= 1e-3 and a[1] * reference.a[1] < 0)
        else:
            turn = np.cos(theta[i] - reference.theta[i]) < 0
        if turn:
            theta[i : i + 2] += np.pi
            alpha[i + 1], a[i + 1], beta[i + 1] = -alpha[i + 1], -a[i + 1], -beta[i + 1]
    # the same angles without leaps of a whole turn against the reference
    theta, alpha = (r + wrapped(v - r) for v, r in ((theta, reference.theta), (alpha, reference.alpha)))
    return dhm.DHMTable(alpha, a, theta, d, beta)


def with_ends(
    table: dhm.DHMTable, first: dhm.DHMTable, theta6: float | None = None, d6: float | None = None
) -> dhm.DHMTable:
    """The table with row 1 of another one and, unless given, also its ``theta6`` and ``d6``."""
    columns = {name: getattr(table, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[0] = getattr(first, name)[0]
    columns["theta"][5] = first.theta[5] if theta6 is None else theta6
    columns["d"][5] = first.d[5] if d6 is None else d6
    return dhm.DHMTable(**columns)


def unknown(table: dhm.DHMTable, theta6: float = np.nan, d6: float = np.nan) -> dhm.DHMTable:
    """The table without row 1, which axes alone do not tell, and with these entries in row 6."""
    return with_ends(table, dhm.DHMTable(*np.full((5, 6), np.nan)), theta6, d6)


def wrapped(angle: FloatArray) -> FloatArray:
    """Angle in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def standard_deviations(axes: MeasuredAxes, values: Callable[[FloatArray, FloatArray], dhm.DHMTable]) -> dhm.DHMTable:
    """Standard deviations of a table's entries: covariances of the axes through central differences.

    Parameters
    ----------
    axes : MeasuredAxes
    values : callable
        Table of points and directions (6, 3) as measured.

    Returns
    -------
    DHMTable
    """
    p, z = axes.as_measured()
    variance = np.zeros((len(COLUMNS), 6))
    for k, fit in enumerate(axes.fits):
        J = np.empty((4, len(COLUMNS), 6))
        for m in range(4):
            ends = []
            for sign in (1.0, -1.0):
                array = (z if m < 2 else p).copy()
                array[k] += sign * STEP * fit.basis[m % 2]
                array[k] /= np.linalg.norm(array[k]) if m < 2 else 1.0
                table = values(p, array) if m < 2 else values(array, z)
                ends.append(np.array([getattr(table, name) for name in COLUMNS]))
            J[m] = (ends[0] - ends[1]) / (2 * STEP)
        variance += np.einsum("mij,mn,nij->ij", J, fit.covariance, J)
    return dhm.DHMTable(*np.sqrt(np.maximum(variance, 0.0)))
