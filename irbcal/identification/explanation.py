"""What each family of terms explains: the error of poses that the fit never saw, with one family after the other.

Every stage is a fit of its own by evidence to the same poses, of one choice of terms and not of an average; all are
parts of one linearisation, so that they cost no more than the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification import leave_one_out, linear_model, term_sets
from irbcal.identification.evidence import average_repeats
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.evidence_maximisation import fit_likelihood_power, maximise_evidence
from irbcal.identification.fit_sections import Stage
from irbcal.identification.linear_model import Linearisation
from irbcal.identification.term_sets import ALL, FRAMES, INPUTS, MOVES, TermSet, members
from irbcal.measurement.points import PointSet
from irbcal.modeling.terms import families
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.harmonics import LOW, order
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.units import MM

STAGES: tuple[tuple[str, ...], ...] = (
    ("geometry",),
    ("gravity", "gain"),
    (INPUTS,),
    ("harmonics",),
    (MOVES,),
    ("warm_up",),
    (FRAMES,),
)
"""Families that are added together, in this order; other families of a fit that are no special cases come one by one
before the last of these, long series of harmonics and gears follow."""


def explain(fit: EvidenceFit, heldout: PointSet, elapsed: FloatArray | None = None) -> tuple[Stage, ...]:
    """Fit one family after the other and predict held-out poses.

    Parameters
    ----------
    fit : EvidenceFit
        What was identified: its points, choice of gears and time constant are taken.
    heldout : PointSet
        May be empty.
    elapsed : ndarray, shape (n,), optional
        Time of the held-out poses, that of the fit's motion; unless given nothing is known of their warmth.
    """
    points, stops = average_repeats(replace(fit.points, q=np.array(fit.motion.q)), fit.motion)
    geometry = GEOMETRY.terms(fit.nominal)
    known = {name: fit.targets[name] for name in points.target_names if name not in fit.fitted_targets}
    problem = linear_model.geometry_problem(fit.nominal, points, geometry, known)
    state = linear_model.geometry_solution(problem, stops, geometry, fit.average.readings_lag)
    plan = _plan(fit)
    terms = [term for _, added, _ in plan for term in added]
    linear = Linearisation(problem, state, stops, terms, fit.average.readings_lag)
    sums, t = linear.sums(), fit_likelihood_power(linear.per_pose)
    use = fit.joint_map.motion(heldout.q, heldout.previous, **heldout.inputs)
    count, out = 0, []
    for words, added, carried in plan:
        count += len(added)
        choice = _choice(terms[:count])
        columns = choice.columns(linear.nuisance)
        got = maximise_evidence(sums.select(columns), linear.nuisance, choice.group, choice.caps, t)
        u = leave_one_out.residuals(linear, columns, got)[0].reshape(-1, 3)
        predicted = _FittedStage(linear, got.c, fit.average.readings_lag)
        errors = predicted.errors(heldout, use)
        warm = any(term.family == "warm_up" for term in terms[:count])
        timed = predicted.errors(heldout, replace(use, elapsed=elapsed)) if warm and elapsed is not None else None
        out.append(
            Stage(
                added=words,
                terms=count,
                determined=float(got.gammas.sum()),
                carried=carried,
                leave_one_out_mm=leave_one_out.rms_length(u[np.isfinite(u).all(axis=1)]),
                mean_mm=_of(errors, np.mean),
                max_mm=_of(errors, np.max),
                timed_mean_mm=None if timed is None else _of(timed, np.mean),
            )
        )
    return tuple(out)


def _of(errors: FloatArray, statistic: object) -> float | None:
    return float(statistic(errors)) / MM if len(errors) else None  # type: ignore[operator]


def _plan(fit: EvidenceFit) -> list[tuple[str, list[Term], bool]]:
    """What each stage adds: words, terms, and whether the calibration has them."""
    arm, present = fit.nominal, {term.family for term in fit.terms}
    highest = _series(fit)
    everything = {name: family.terms(arm) for name, family in families().items()}
    by_family = {name: [term for term in fit.terms if term.family == name] for name in (*members(INPUTS), "warm_up")}
    everything |= by_family | {
        "warm_up": [t for t in by_family["warm_up"] if t.parameters["tau"] == fit.average.warm_up_tau]
    }
    series = everything["harmonics"]
    everything["harmonics"] = [term for term in series if order(term) <= LOW]
    moved = bool(fit.motion.moves.any())
    plan = []
    special = {name: families()[name].special_case_of for name in present}
    covered = present.union(*special.values())
    listed = {member for together in STAGES for name in together for member in members(name)}
    others = [(name,) for name in everything if name in present - listed and not special[name]]
    for together in (*STAGES[:-1], *others, STAGES[-1]):
        names = [member for name in together for member in members(name)]
        if together == (MOVES,) and not moved:
            continue
        added = [term for name in names for term in everything[name]]
        if added:
            title = _words(names, everything)
            tried = together == (FRAMES,) and fit.average.terms != ALL
            plan.append((f"{title}: terms {ALL}" if tried else title, added, not covered.isdisjoint(names)))
    if highest > LOW:
        plan.append((f"harmonics to {highest}", [t for t in series if LOW < order(t) <= highest], True))
    if fit.average.gears:
        gears = [term for g in fit.average.gears for term in gear_terms(g.joint - 1, g.cycles_per_turn)]
        plan.append((f"gears ({len(fit.average.gears)})", gears, "gear" in present))
    return sorted(plan, key=lambda item: not item[2])  # what is only tried comes last


def _series(fit: EvidenceFit) -> int:
    """Highest order of the harmonics of the best choice of terms, if long series have most of the weight."""
    long = [row for row in fit.term_sets if "harmonics to " in row.name and row.weight > 0.0]
    if sum(row.weight for row in long) <= 0.5:
        return LOW
    return int(max(long, key=lambda row: row.weight).name.split("harmonics to ")[1].split(",")[0].split(";")[0])


def _words(names: Sequence[str], everything: dict[str, list[Term]]) -> str:
    text = ", ".join(name.replace("_", "-") for name in names if everything[name])
    return f"{text} to {LOW}" if names == ["harmonics"] else text


def _choice(terms: Sequence[Term]) -> TermSet:
    """A term set of all of some terms; series of harmonics in bands, as those that are averaged have them."""
    highest = max((order(term) for term in terms if term.family == "harmonics"), default=0)
    names = list(dict.fromkeys(term.family for term in terms))
    taus = [term.parameters["tau"] for term in terms if term.family == "warm_up"]
    return term_sets.make(terms, names, highest, float(str(taus[0])) if taus else None)


class _FittedStage:
    """A fitted stage, not linearised."""

    def __init__(self, linear: Linearisation, c: FloatArray, lagging: bool) -> None:
        state = linear.moved(c)
        self.arm, everything = linear.problem.model(state)
        self.T = state.T_world_base
        self.targets = dict(zip(linear.problem.points.target_names, state.targets, strict=True))
        rows = np.flatnonzero(everything.coefficients)
        rows = rows[[not (lagging and families()[everything.terms[k].family].like_lag) for k in rows]]
        chosen = tuple(everything.terms[k] for k in rows)
        self.map = TermMap(everything.arm, chosen, everything.coefficients[rows])

    def errors(self, points: PointSet, motion: Motion) -> FloatArray:
        """Distances of measured points, metres; those of targets that the fit does not know are left out."""
        at_known_targets = np.flatnonzero([points.target_names[k] in self.targets for k in points.target])
        local = np.array([self.targets[points.target_names[k]] for k in points.target[at_known_targets]]).reshape(-1, 3)
        T = (self.T @ self.map.forward(self.arm, motion))[points.pose[at_known_targets]]
        predicted = np.einsum("mij,mj->mi", T[:, :3, :3], local) + T[:, :3, 3]
        return np.asarray(np.linalg.norm(points.xyz[at_known_targets] - predicted, axis=1))
