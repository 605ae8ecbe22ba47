"""Which terms a robot needs beyond geometry: chosen together, so that none explains what another has explained.

A term tested by itself meets the errors of all others as scatter, which may hide it; and two terms may explain the
same. So terms are taken one after the other from geometry alone, each the one that explains most of what is left, until
none is significant and worth it; what those taken later have made idle is dropped again. A term that is needed, but was
hidden when it was tested by itself, is then told of as it is beside the others: no term is called both needed and
not worth having.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.joint_behaviour import columns
from irbcal.joint_behaviour.linearised import Found, Linearised, extended, term_of
from irbcal.joint_behaviour.terms import SIGNIFICANT, Kind, Term, is_worth

TRIES = 3
"""Candidates that are looked at closely before the selection of terms ends."""

Key: TypeAlias = "tuple[Kind, int | None]"
"""Kind and joint of a term."""


@dataclass(frozen=True)
class Step:
    """One term in the order in which the robot needs them.

    Attributes
    ----------
    kind : str
    joint : int or None
        Counted from 1.
    p : float
        Corrected for the number of terms that were to choose from.
    rms : float
        Of poses left out of the fit, with this term and those before it, metres.
    """

    kind: Kind
    joint: int | None
    p: float
    rms: float


def choose(model: Linearised, terms: Sequence[Term]) -> tuple[tuple[Step, ...], float, tuple[Term, ...]]:
    """Choose the terms that a robot needs.

    Nubiola 2011, section 7.2, decides so whether the stiffness model and the model of joint 6 are necessary.

    Parameters
    ----------
    model : Linearised
    terms : sequence of Term
        As each was tested by itself, with verdicts; those not tested are not chosen.

    Returns
    -------
    needed : tuple of Step
        The most important first.
    rms_geometry : float
        Of poses left out, with geometry alone, metres.
    terms : tuple of Term
        The same as given; those that are needed but were hidden, with what they are beside the others.
    """
    choice = {(term.kind, term.joint): columns.of_term(model, term) for term in terms if not term.note}
    selection = _Selection(model, choice)
    selection.take()
    while selection.drop_idle():
        selection.take()
    found = selection.beside_the_others()
    out = []
    for term in terms:
        beside = found.get((term.kind, term.joint))
        if beside is not None and term.verdict != "worth it":
            frequency = None if term.frequency is None else term.frequency[0]
            names, tried = columns.names_of(term), selection.to_choose_from()
            found_beside = term_of(model, beside, term.kind, term.joint, names, frequency, tried)
            term = replace(term, beside_needed=replace(found_beside, verdict="worth it"))
        out.append(term)
    return selection.steps(), selection.rms_geometry, tuple(out)


class _Selection:
    """Terms chosen so far, in order, and those to choose from.

    Attributes
    ----------
    choice : dict of Key to ndarray, shape (3 rows, k)
        All terms with their columns.
    chosen : list of Key
    dropped : set of Key
        Chosen once, idle later; not to choose from any more.
    rms_geometry : float
        Of poses left out, with geometry alone, metres.
    """

    def __init__(self, model: Linearised, choice: Mapping[Key, FloatArray]) -> None:
        self.model, self.choice = model, dict(choice)
        self.chosen: list[Key] = []
        self.dropped: set[Key] = set()
        self.without = tuple(model.active)
        self.geometry = model.basis(self.without, beside=False)
        self.y = model.explained(self.without)
        self.rms_geometry = model.size(model.left_out(self._left(self.geometry, self.y), self.geometry))

    @staticmethod
    def _left(Q: FloatArray, columns: FloatArray) -> FloatArray:
        return columns - Q @ (Q.T @ columns)

    def _basis(self, keys: Sequence[Key]) -> FloatArray:
        Q = self.geometry
        for key in keys:
            Q = extended(Q, self.choice[key])
        return Q

    def _test(self, key: Key, Q: FloatArray) -> Found | None:
        return self.model.test(self.choice[key], self.without, Q)

    def _is_needed(self, found: Found, tried: int) -> bool:
        return found.p * tried < SIGNIFICANT and is_worth(found.before, found.after)

    def to_choose_from(self) -> int:
        """How many terms the last one was chosen from."""
        return len(self.choice) - len(self.chosen) + 1

    def take(self) -> None:
        """Take terms one after the other, until none is significant and worth it."""
        Q = self._basis(self.chosen)
        while True:
            rest = self._left(Q, self.y)
            free = [key for key in self.choice if key not in self.chosen and key not in self.dropped]
            gains = {key: _explains(self._left(Q, self.choice[key]), rest) for key in free}
            for key in sorted(free, key=lambda key: gains[key], reverse=True)[:TRIES]:
                found = self._test(key, Q)
                if found is not None and self._is_needed(found, len(self.choice) - len(self.chosen)):
                    break
            else:
                return
            self.chosen.append(key)
            Q = extended(Q, self.choice[key])

    def beside_the_others(self) -> dict[Key, Found]:
        """Each chosen term tested beside all other chosen ones."""
        out = {}
        for key in self.chosen:
            found = self._test(key, self._basis([other for other in self.chosen if other != key]))
            if found is not None:
                out[key] = found
        return out

    def drop_idle(self) -> bool:
        """Drop the chosen term that is needed least, if the others have made it idle; whether there was one."""
        found, tried = self.beside_the_others(), self.to_choose_from()
        idle = [key for key in self.chosen if key not in found or not self._is_needed(found[key], tried)]
        if not idle:
            return False
        least = max(idle, key=lambda key: found[key].after / found[key].before if key in found else np.inf)
        self.chosen.remove(least)
        self.dropped.add(least)
        return True

    def steps(self) -> tuple[Step, ...]:
        """The chosen terms with what each adds to those before it."""
        out, Q = [], self.geometry
        for k, key in enumerate(self.chosen):
            found = self._test(key, Q)
            if found is not None:
                out.append(Step(*key, min(1.0, found.p * (len(self.choice) - k)), found.after))
            Q = extended(Q, self.choice[key])
        return tuple(out)


def _explains(own: FloatArray, rest: FloatArray) -> float:
    """Sum of squares that columns explain."""
    solution = np.linalg.lstsq(own, rest, rcond=1e-6)[0]
    return float(rest @ (own @ solution))
