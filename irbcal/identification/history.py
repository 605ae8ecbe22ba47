"""What an iterative fit went through: its objective, and what became of points it did not use.

As Nubiola 2011 looks at it in section 7.5. A `History` is handed to a fit as its ``record``; `plot` draws it as the
thesis draws its Figure 7.2.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError
from irbcal.figures.colours import TEXT
from irbcal.figures.style import house_style
from irbcal.identification.problem import Problem, State
from irbcal.summary import Speaks, Table, Told
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def distances(problem: Problem, state: State) -> FloatArray:
    """Distances of all rows (Nubiola 2011, eq. 3.36), shape (rows,), metres."""
    r = problem.residuals(state)
    return np.sqrt(np.einsum("jk,jk->j", r, r))


def largest(distance: FloatArray) -> float:
    """Largest distance (Nubiola 2011, eq. 3.35), metres."""
    return float(distance.max())


def rms(distance: FloatArray) -> float:
    """Root mean square distance, metres."""
    return float(np.sqrt(np.mean(distance**2)))


class History(Speaks):
    """Recorder of iterations (Nubiola 2011, section 7.5).

    Parameters
    ----------
    problem : Problem
        The one that is being fitted.
    others : dict of str to Problem, optional
        Unused points under names of the caller's choice. They need the same targets in the same order and the same
        error parameters, so that a state of ``problem`` is a state of theirs.
    objective : callable
        From distances (rows,) to metres: `largest`, `rms` or another.
    every : int
        Record only iterations that are multiples of this number.

    Attributes
    ----------
    rows : list of dict
        ``iteration``, ``seconds`` (since the first record, without the time that recording took),
        ``objective_mm``, and for each of the others ``<name>_mean_mm`` and ``<name>_max_mm``.

    Raises
    ------
    IdentificationError
        If other points do not belong to the same unknowns.
    """

    def __init__(
        self,
        problem: Problem,
        others: Mapping[str, Problem] | None = None,
        objective: Callable[[FloatArray], float] = largest,
        every: int = 1,
    ) -> None:
        self.problem, self.others = problem, dict(others or {})
        self.objective, self.every = objective, every
        self.rows: list[dict[str, float]] = []
        self._begin: float | None = None
        self._lost = 0.0
        for name, other in self.others.items():
            if other.points.target_names != problem.points.target_names or other.parameters != problem.parameters:
                raise IdentificationError(
                    f"the points {name!r} cannot be followed: they need the targets and error parameters of the fit "
                    f"({', '.join(problem.points.target_names)}; {len(problem.parameters)} error parameters)"
                )

    def record(self, iteration: int, state: State) -> None:
        """Add one iteration; hand this method to a fit.

        Parameters
        ----------
        iteration : int
        state : State
        """
        if iteration % self.every:
            return
        now = time.perf_counter()
        if self._begin is None:
            self._begin = now
        row = {
            "iteration": iteration,
            "seconds": now - self._begin - self._lost,
            "objective_mm": self.objective(distances(self.problem, state)) / MM,
        }
        for name, other in self.others.items():
            d = distances(other, state) / MM
            row |= {f"{name}_mean_mm": float(d.mean()), f"{name}_max_mm": float(d.max())}
        self.rows.append(row)
        self._lost += time.perf_counter() - now

    def told(self) -> Sequence[Told]:
        """From where to where the objective went, and what became of the other points."""
        if not self.rows:
            return ("no iteration was recorded",)
        first, last = self.rows[0], self.rows[-1]
        names = [name for name in last if name not in ("iteration", "seconds")]
        headline = (
            f"{last['iteration']} iterations in {last['seconds']:.2f} s: objective {first['objective_mm']:.3f} -> "
            f"{last['objective_mm']:.3f} mm"
        )
        rows = tuple((name, first[name], last[name], min(row[name] for row in self.rows)) for name in names)
        return headline, Table("From the first to the last iteration", ("", "first", "last", "smallest"), rows)

    def to_frame(self) -> pd.DataFrame:
        """All records as a table.

        Returns
        -------
        pandas.DataFrame
            A row an iteration, see `History.rows`.
        """
        import pandas as pd

        columns = ["iteration", "seconds", "objective_mm"]
        columns += [f"{name}_{what}_mm" for name in self.others for what in ("mean", "max")]
        return pd.DataFrame(self.rows, columns=columns)

    def plot(self) -> Figure:
        """Draw it, see `plot`."""
        return plot(self)


def plot(history: History) -> Figure:
    """Objective and unused points against iterations (Nubiola 2011, Figure 7.2).

    A dot marks the iteration at which the mean distance of each group of unused points was smallest.

    Parameters
    ----------
    history : History

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    IdentificationError
        If nothing was recorded.
    """
    from matplotlib.figure import Figure

    table = history.to_frame()
    if table.empty:
        raise IdentificationError("there is no history to draw: no iteration was recorded")
    with house_style():
        return _drawn(Figure(figsize=(7.0, 6.0 if history.others else 3.5), layout="constrained"), history, table)


def _drawn(figure: Figure, history: History, table: pd.DataFrame) -> Figure:
    axes = figure.subplots(2 if history.others else 1, 1, sharex=True, squeeze=False)[:, 0]
    axes[0].plot(table["iteration"], table["objective_mm"], color=TEXT, label="objective, points of the fit")
    for k, name in enumerate(history.others):
        color = f"C{k}"
        mean = table[f"{name}_mean_mm"]
        best = mean.idxmin()
        axes[0].plot(table["iteration"], table[f"{name}_max_mm"], color=color, label=f"largest, {name}")
        axes[1].plot(table["iteration"], mean, color=color, label=f"mean, {name}")
        axes[1].plot(table["iteration"][best], mean[best], "o", color=color)
    for ax, label in zip(axes, ("largest distance / objective (mm)", "mean distance (mm)"), strict=False):
        ax.set_ylabel(label)
        ax.legend()
    axes[-1].set_xlabel("iteration")
    return figure
