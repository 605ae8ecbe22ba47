"""What an identification by evidence found: averaged terms, what is known of them, and predictions with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import shown
from irbcal.identification.gear_scan import Spectrum
from irbcal.identification.shown import FamilyShown
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty, Prediction
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.gear import gear_terms, in_words
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import LOAD, Motion, motion_at_use
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG, MM, UNIT_OUTSIDE

if TYPE_CHECKING:
    import pandas as pd

SHOWN = 0.1
"""Groups of which less than so much of a coefficient is seen are summed up in a sentence."""


@dataclass(frozen=True)
class DictionaryResult:
    """A choice of terms in the comparison.

    Attributes
    ----------
    name : str
    terms : int
        Number of columns, base and targets included.
    log_evidence : float
        Nats, of residuals in millimetres; differences matter.
    weight : float
        In the average.
    sigma, loo : float or None
        Residual standard deviation of a coordinate and root mean square length of the leave-one-pose-out residuals,
        metres; of dictionaries with weight only, as averaged.
    bands : bool
        Whether it has long series of harmonics.
    """

    name: str
    terms: int
    log_evidence: float
    weight: float
    sigma: float | None
    loo: float | None
    bands: bool


@dataclass(frozen=True)
class GroupResult:
    """How much the data show of a group of terms.

    Attributes
    ----------
    name : str
    terms : int
    seen : float
        Number of its coefficients that the data determine (MacKay's gamma), averaged.
    size : float
        Prior standard deviation of its coefficients, in natural sizes, over the dictionaries that have it.
    family : str
    natural : dict of str to float
        Natural size of its coefficients by their unit.
    found, std : float
        Root mean squares of its coefficients and of their standard deviations, in natural sizes.
    """

    name: str
    terms: int
    seen: float
    size: float
    family: str
    natural: Mapping[str, float]
    found: float
    std: float

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True)
class GearFound:
    """A single high harmonic that the scan found.

    Attributes
    ----------
    joint : int
        From 0.
    cycles_per_turn : int
    chi2 : float
        By how much it explained what was left, two degrees of freedom.
    evidence_gain : float
        Nats.
    """

    joint: int
    cycles_per_turn: int
    chi2: float
    evidence_gain: float


@dataclass(frozen=True)
class Sisters:
    """What a prior from calibrated robots of the same type did.

    Attributes
    ----------
    type : str
    count : int
        Robots that it is from.
    simulated : bool
        Whether any of them is.
    gain : float
        Nats by which the best choice of terms with it has more evidence than the best one without.
    weight : float
        Of the choices with it.
    chi2, directions : float, int
        Whether the robot is like them, see `irbcal.identification.like_sisters`.
    """

    type: str
    count: int
    simulated: bool
    gain: float
    weight: float
    chi2: float
    directions: int

    def in_words(self) -> str:
        """A sentence."""
        kind = "SIMULATED" if self.simulated else "calibrated"
        start = f"hat {self.count} {kind} robots of type {self.type} show"
        test = f"chi-square {self.chi2:.0f} on {self.directions} directions"
        if self.weight >= 0.5:
            return (
                f"W{start} was taken as a prior: this robot is like them ({test}), and the evidence is higher by "
                f"{self.gain:.0f} nats with it."
            )
        if self.weight > 0.0:
            return f"W{start} was taken as a prior with the weight {self.weight:.2f}: it hardly helps ({test})."
        why = test if self.gain > 0.0 else f"{test}; the evidence would be lower by {-self.gain:.0f} nats"
        return f"This robot stands out of its type: w{start} is not true of it ({why}). It was identified without."


@dataclass(frozen=True, eq=False, repr=False)
class EvidenceFit(Speaks):
    """An identified robot as an average over choices of terms.

    Attributes
    ----------
    nominal, arm : Arm
        Nominal arm, and the one with the constants in its DHM table.
    terms : tuple of Term
        Union of the dictionaries with weight, geometry first.
    coefficients : ndarray, shape (terms,)
        Averaged, in the terms' units.
    covariance : ndarray, shape (flat + terms, flat + terms)
        Of base (turn, shift in the base link), free targets, target frames and coefficients, SI units; scatter within
        and between dictionaries.
    T_world_base : ndarray, shape (4, 4)
    targets : dict of str to ndarray, shape (3,)
        In the tip link, metres.
    target_rotations : dict of str to ndarray, shape (3, 3)
        Of targets that were measured with an orientation.
    free_targets, framed_targets : tuple of str
        Targets whose places, and frames, were identified: they have columns in the covariance.
    sigma : float
        Residual standard deviation of a coordinate, metres.
    loo, loo_blocks : dict of str to float
        Root mean square length of leave-one-pose-out residuals (of contiguous fifths of each session) by target, ``""``
        for all, metres; None where what is left does not determine them.
    dictionaries : tuple of DictionaryResult
    groups : tuple of GroupResult
    families : tuple of FamilyShown
        What the best choice of terms would lose without each of its families.
    gears : tuple of GearFound
    joint_ranges : ndarray, shape (2, joints)
        Smallest and largest joints of the fit, radians (metres).
    kind : str
        ``joint-map`` or ``all``.
    tau : float or None
        Time constant of warm-up in the choice of terms with most weight, in the unit of the motion's time.
    poses : int
        After averaging repeats.
    loads : tuple of float
        Masses that were carried, kg; none where they were not told.
    usual_kg : float or None
        The one that predictions are for where none is given.
    readings_gain : float or None
        Where only readings were known: by which factor residuals fell with a share of the last move free in each pose.
    readings_projected : bool
        Whether that was so much that readings were taken before the arm stood still.
    spectrum : Spectrum or None
        What the gear scan saw; None where there was none.
    other_bases : dict of str to ndarray, shape (4, 4)
        Base in the measuring frame of each session but the last one; behind the target frames in the covariance.
    sisters : Sisters or None
        What a prior from sisters did, where there was one.
    """

    nominal: Arm
    arm: Arm
    terms: tuple[Term, ...]
    coefficients: FloatArray
    covariance: FloatArray
    T_world_base: FloatArray
    targets: Mapping[str, FloatArray]
    free_targets: tuple[str, ...]
    framed_targets: tuple[str, ...]
    target_rotations: Mapping[str, FloatArray]
    sigma: float
    loo: Mapping[str, float | None]
    loo_blocks: Mapping[str, float | None]
    dictionaries: tuple[DictionaryResult, ...]
    groups: tuple[GroupResult, ...]
    families: tuple[FamilyShown, ...]
    gears: tuple[GearFound, ...]
    joint_ranges: FloatArray
    kind: str
    tau: float | None
    poses: int
    loads: tuple[float, ...] = ()
    usual_kg: float | None = None
    readings_gain: float | None = None
    readings_projected: bool = False
    spectrum: Spectrum | None = None
    other_bases: Mapping[str, FloatArray] = field(default_factory=dict)
    sisters: Sisters | None = None

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """What was reached; the choices of terms; how much of each group is seen; gears; what intervals hold."""
        kept = [row for row in self.dictionaries if row.weight > 0.0]
        left_out = self.loo.get("")
        headline = (
            f"{self.nominal.name}, terms {self.kind}: {len(kept)} of {len(self.dictionaries)} choices averaged, "
            f"{self.poses} poses (residual standard deviation {self.sigma / MM:.4f} mm a coordinate, "
            f"left-out poses {'not determined by the others' if left_out is None else f'{left_out / MM:.4f} mm rms'})"
        )
        return (
            headline,
            *self._readings_in_words(),
            *([] if self.sisters is None else [self.sisters.in_words()]),
            self._dictionary_table(),
            self._group_table(),
            *self._unseen_in_words(),
            shown.sentence(self.families),
            *self.gear_sentences(),
            "Intervals of predictions are made to hold 95 % of a coordinate's errors. On held-out poses of two real "
            "robots they hold 93 to 98 %, 91 to 94 % after fits to readings, and 84 % on a warm arm of which "
            "only 45 poses were fitted, the cold ones. They are valid for poses like those "
            "measured; poses outside the joint ranges of the fit are marked.",
        )

    def _readings_in_words(self) -> list[str]:
        if self.readings_gain is None:
            return []
        if self.readings_projected:
            return [
                "The readings were taken before the arm stood still: with a share of the last move free in each pose, "
                f"residuals fall {self.readings_gain:.1f} times. The model holds for programmed joints."
            ]
        return [
            "The readings were taken at rest: a free share of the last move makes residuals fall by a factor "
            f"{self.readings_gain:.2f} only."
        ]

    def _dictionary_table(self) -> Table:
        rows = tuple(
            (
                row.name,
                row.terms,
                round(row.log_evidence),
                row.weight,
                None if row.sigma is None else row.sigma / MM,
                None if row.loo is None else row.loo / MM,
            )
            for row in self.dictionaries
        )
        best = max(range(len(rows)), key=lambda k: self.dictionaries[k].weight)
        columns = ("terms", "number", "log evidence", "weight", "sigma mm", "left out mm")
        return Table("Choices of terms, averaged with their weights", columns, rows, 4, frozenset({best}))

    def _group_table(self) -> Table:
        rows = tuple((row.name, row.terms, row.seen, row.size) for row in self.groups if row.seen >= SHOWN)
        columns = ("group", "terms", "seen", "size")
        return Table("How much of each group the data show (sizes in natural sizes)", columns, rows, 2)

    def _unseen_in_words(self) -> list[str]:
        unseen = [row for row in self.groups if row.seen < SHOWN]
        if not unseen:
            return []
        terms = sum(row.terms for row in unseen)
        return [f"Of {len(unseen)} more groups with {terms} terms the data show nothing: they shrink to zero."]

    def to_frame(self) -> pd.DataFrame:
        """The terms, a row each: joint from 1, axis, basis, family, group, value and std in ``unit`` (deg, mm)."""
        import pandas as pd

        rows = []
        for term, value, std in zip(self.terms, self.coefficients, self.std, strict=True):
            base, _, per = term.unit.partition("/")
            unit, factor = UNIT_OUTSIDE[base]
            unit = f"{unit}/{per}" if per else unit
            place = (term.name, term.joint + 1, term.axis, term.basis, term.family, term.group)
            rows.append((*place, float(value) / factor, float(std) / factor, unit))
        columns = ["name", "joint", "axis", "basis", "family", "group", "value", "std", "unit"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the coefficients, shape (terms,), in the terms' units."""
        flat = len(self.covariance) - len(self.terms)
        return np.sqrt(np.maximum(np.diagonal(self.covariance)[flat:], 0.0))

    def term_map(self, warm: bool = True) -> TermMap:
        """All terms but the constants: of the warm arm, or with the warm-up terms, which are zero at use."""
        rows = [
            k
            for k, term in enumerate(self.terms)
            if term.family != "geometry" and not (warm and term.family == "warm_up")
        ]
        return TermMap(self.nominal, tuple(self.terms[k] for k in rows), self.coefficients[rows], self.std[rows])

    def constants(self) -> dict[str, tuple[float, float]]:
        """Constants of the geometry by their names in the DHM table with standard deviations, rad and m."""
        return {
            f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}": (float(value), float(std))
            for term, value, std in zip(self.terms, self.coefficients, self.std, strict=True)
            if term.family == "geometry"
        }

    def gear_sentences(self) -> list[str]:
        """What the scan found, in words."""
        return [
            f"A wave stands out (chi2 {gear.chi2:.0f}): "
            f"{in_words(gear.joint + 1, gear.cycles_per_turn, self.amplitude(gear) / DEG)}."
            for gear in self.gears
        ]

    def amplitude(self, gear: GearFound) -> float:
        """By how much a gear turns its joint to and fro, radians."""
        by_name = {t.name: c for t, c in zip(self.terms, self.coefficients, strict=True)}
        pair = [by_name[term.name] for term in gear_terms(gear.joint, gear.cycles_per_turn)]
        return float(np.hypot(*pair))

    def motion(self, q: FloatArray, previous: FloatArray | None = None, **load: FloatArray | None) -> Motion:
        """The motion that predictions are for: of the warm arm, with the usual load unless told otherwise.

        Parameters
        ----------
        q, previous : ndarray, shape (n, joints)
        load
            ``payload_kg``, ``payload_place``, ``torques``: see `irbcal.modeling.terms.situation.motion_at_use`.
        """
        q = np.atleast_2d(np.asarray(q, dtype=float))
        before = None if previous is None else np.atleast_2d(np.asarray(previous, dtype=float))
        place = next((t.parameters.get("place") for t in self.terms if t.basis == "payload"), None)
        usual = {"usual_kg": self.usual_kg} | ({"usual_place": place} if isinstance(place, tuple) else {})
        return motion_at_use(q, before, **load, **usual)  # type: ignore[arg-type]  # by their names

    def poses_at(self, q: FloatArray, previous: FloatArray | None = None, **load: FloatArray | None) -> FloatArray:
        """Tip poses in the base link at commanded joints (n, joints), shape (n, 4, 4); the load as for `motion`."""
        return self.term_map().forward(self.arm, self.motion(q, previous, **load))

    def predict(
        self,
        q: FloatArray,
        previous: FloatArray | None = None,
        target: str | None = None,
        in_order: bool = False,
        **load: FloatArray | None,
    ) -> Prediction:
        """Position of a target, with what is known of it.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        previous : ndarray, shape (n, joints), optional
            The stop before each. Without it, and for rows with NaN, the direction terms are zero, and their size joins
            the uncertainty.
        target : str, optional
            The first unless given.
        in_order : bool
            Whether the poses of the fit are a program in an order: contiguous blocks are left out in place of single
            poses.
        load
            Where it is not the usual one, see `motion`.

        Returns
        -------
        Prediction

        Raises
        ------
        IdentificationError
            If there is no such target.
        """
        name = next(iter(self.targets)) if target is None else target
        if name not in self.targets:
            raise IdentificationError(f"unknown target {name!r}: this robot has {', '.join(self.targets)}")
        terms, motion = self.term_map(), self.motion(q, previous, **load)
        return self.certainty.predict(
            lambda motion: chain.walk(self.arm, *terms.split(motion)),
            q,
            previous,
            self.targets[name],
            name,
            self.T_world_base,
            in_order,
            {key: getattr(motion, key) for key in LOAD},
        )

    @cached_property
    def certainty(self) -> Certainty:
        """What is known of the robot, the warm-up left out."""
        used = [k for k, term in enumerate(self.terms) if term.family != "warm_up"]
        flat = len(self.covariance) - len(self.terms)
        rows = np.concatenate([np.arange(flat), flat + np.array(used, dtype=int)])
        return Certainty(
            nominal=self.nominal,
            terms=tuple(self.terms[k] for k in used),
            covariance=self.covariance[np.ix_(rows, rows)],
            free_targets=self.free_targets,
            coefficients=self.coefficients[used],
            loo=self.loo,
            loo_blocks=self.loo_blocks,
            ranges=self.joint_ranges,
        )
