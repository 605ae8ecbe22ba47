"""What the data show: which families of terms are there, beyond doubt and large enough to matter.

A family counts as *shown* if leaving it out of the best choice of terms costs `NATS` of log evidence or more, and moves
the fitted points by `LEAST` or more: a plain criterion, counted for false alarms on SIMULATED robots whose families are
known (``scripts/false_alarms``). Families that can stand in for one another (gravity at joint 2 is a first harmonic)
are shown only by what the others cannot explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.identification import mackay
from irbcal.identification.dictionaries import Dictionary
from irbcal.identification.mackay import Posterior
from irbcal.identification.sums import Sums
from irbcal.units import MM

NATS = 5.0
"""Log evidence that a family must be worth: odds of 150 to 1."""
LEAST = 0.003 * MM
"""Root mean square distance by which the fitted points must move without it, metres: a third of a tracker's noise."""


@dataclass(frozen=True)
class FamilyShown:
    """A family of terms in the best choice of terms.

    Attributes
    ----------
    family : str
    seen : float
        Number of its coefficients that the data determine.
    evidence : float
        Log evidence that is lost without it, nats.
    moves : float
        Root mean square distance by which the fitted points move without it, metres.
    """

    family: str
    seen: float
    evidence: float
    moves: float

    @property
    def shown(self) -> bool:
        """Whether it counts as there."""
        return self.evidence >= NATS and self.moves >= LEAST

    def in_words(self) -> str:
        """Name and size: ``gravity (0.213 mm)``."""
        return f"{_word(self.family)} ({self.moves / MM:.3f} mm)"


def families_shown(
    sums: Sums, flat: int, families: Sequence[str], dictionary: Dictionary, t: float, start: Posterior
) -> tuple[FamilyShown, ...]:
    """Fit a dictionary, and again without each of its families; geometry is always there.

    Parameters
    ----------
    sums : Sums
        Of the dictionary's columns.
    flat : int
        Columns of base and targets.
    families : sequence of str
        Family of each of the dictionary's terms.
    dictionary : Dictionary
    t : float
        Tempering.
    start : Posterior
        A fit with its groups, whose variances are the start.

    Returns
    -------
    tuple of FamilyShown
        In the order of the terms.
    """
    known = dictionary.expected
    found = mackay.fit(sums, flat, dictionary.group, dictionary.caps, t, start.variances, start.s2, expected=known)
    names, out = np.array(families, dtype=object), []
    for family in dict.fromkeys(families):
        if family == "geometry":
            continue
        stays = names != family
        groups = np.unique(dictionary.group[stays])
        group = np.searchsorted(groups, dictionary.group[stays])
        columns = np.concatenate([np.arange(flat), flat + np.flatnonzero(stays)])
        caps, variances = dictionary.caps[groups], found.variances[groups]
        rest = None if known is None else known.part(stays)
        without = mackay.fit(sums.part(columns), flat, group, caps, t, variances, found.s2, expected=rest)
        change = found.c.copy()
        change[columns] -= without.c
        moved = 3.0 * float(change @ sums.H @ change) / sums.equations
        seen = float(found.gammas[np.unique(dictionary.group[~stays])].sum())
        lost = found.log_evidence - without.log_evidence
        out.append(FamilyShown(str(family), seen, float(lost), float(np.sqrt(max(moved, 0.0))) * MM))
    return tuple(out)


def sentence(families: Sequence[FamilyShown]) -> str:
    """What the data show and what not, in words."""
    there = sorted((row for row in families if row.shown), key=lambda row: -row.moves)
    rest = [_word(row.family) for row in families if not row.shown]
    said = "Beside errors of the geometry the data show nothing."
    if there:
        said = (
            "What the data show beside errors of the geometry (in brackets, how far points move if a model does "
            f"without): {', '.join(row.in_words() for row in there)}."
        )
    return said + (f" Not shown: {', '.join(rest)}." if rest else "")


def _word(family: str) -> str:
    return "the thesis's joint map" if family == "thesis" else family.replace("_", "-")
