"""Figures of calibrations side by side: each draws a result into a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from irbcal.figures.style import as_bytes, drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from irbcal.validation.comparing import Compared

MARKS = "osD^vP*Xhd<>"
"""Beside the colour: calibrations are told apart in print, too."""


def by_pose(figure: Figure, result: Compared) -> None:
    """Errors of each pose, in the order of the best one's."""
    axes = figure.add_subplot()
    best = result.names.index(result.ranking[0])
    order = np.argsort(result.error_mm[:, best], kind="stable")
    x = np.arange(1, len(order) + 1)
    size = min(4.0, max(1.5, 60 / len(order) ** 0.5))
    for k, name in enumerate(result.names):
        mean = result.statistics[name]["mean_mm"]
        axes.plot(x, result.error_mm[order, k], MARKS[k], markersize=size, alpha=0.7, label=f"{name} ({mean:.3f} mm)")
    axes.set_ylim(bottom=0)
    axes.set_xlabel(f"pose, in the order of the errors of {result.names[best]}")
    axes.set_ylabel("position error (mm)")
    _legend(figure, result)


def shares(figure: Figure, result: Compared) -> None:
    """Share of the points below each error."""
    axes = figure.add_subplot()
    count = len(result.distance_mm)
    for k, name in enumerate(result.names):
        axes.step(np.sort(result.distance_mm[:, k]), np.arange(1, count + 1) / count, where="post", label=name)
    axes.axhline(0.95, color="0.6", linewidth=0.8, linestyle="--")
    axes.set_xlim(left=0)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel("position error (mm)")
    axes.set_ylabel("share of the points (dashed: 95 %)")
    _legend(figure, result)


def files(result: Compared) -> dict[str, bytes]:
    """All figures as PNG files by their names."""
    return {f"{draw.__name__}.png": as_bytes(drawn(draw, (7.2, 4.4), result)) for draw in (by_pose, shares)}


def _legend(figure: Figure, result: Compared) -> None:
    if result.simulated:
        figure.suptitle("SIMULATED data", color="#8f5200", x=0.01, ha="left")
    handles, _ = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles=handles, loc="outside upper right" if not result.simulated else "outside lower center", ncols=3
    )
