"""Fixed points in fewer steps: Anderson's method on the differences of the last few (Walker and Ni 2011)."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray


class Anderson:
    """The next place to try for ``x = g(x)``, from the places that were tried before.

    Parameters
    ----------
    memory : int
        How many differences are used.
    longest : float
        Largest change of a coordinate in a step.
    """

    def __init__(self, memory: int = 5, longest: float = 3.0) -> None:
        self.memory, self.longest = memory, longest
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._places: list[FloatArray] = []
        self._steps: list[FloatArray] = []

    def after(self, x: FloatArray, mapped: FloatArray) -> FloatArray:
        """Where to go from a place.

        Parameters
        ----------
        x, mapped : ndarray, shape (n,)
            A place and ``g`` of it.

        Returns
        -------
        ndarray, shape (n,)
            ``mapped`` itself as long as nothing else is known.
        """
        self._places = [*self._places, x][-self.memory - 1 :]
        self._steps = [*self._steps, mapped - x][-self.memory - 1 :]
        if len(self._places) == 1:
            return mapped
        steps, places = np.diff(self._steps, axis=0).T, np.diff(self._places, axis=0).T
        weights = np.linalg.lstsq(steps, mapped - x, rcond=1e-8)[0]
        return x + np.clip(mapped - x - (places + steps) @ weights, -self.longest, self.longest)
