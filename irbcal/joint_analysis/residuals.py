"""Effects of single joints in the residuals of a robot model, from any poses, and which of them the robot needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.chance import f_beyond
from irbcal.errors import IdentificationError
from irbcal.identification import axes
from irbcal.joint_analysis import linearised
from irbcal.joint_analysis.linearised import Linearised, TestOutcome, extended, placed, term_of
from irbcal.joint_analysis.moves import _beyond
from irbcal.joint_analysis.terms import (
    BESIDE,
    HIGHEST_FREQUENCY,
    LABELS,
    LEFT_OUT,
    SIGNIFICANT,
    WORTH,
    JointTerm,
    Kind,
    Slides,
    best_frequency,
    change_of,
    finite,
    fourier_names,
    frequencies,
    is_worth,
    judged,
    judgement_of,
    name_of,
    not_tested,
    of_joints,
    p_text,
    play_in_words,
    plus_minus,
    term_dict,
    terms_table,
)
from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG, MM

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


def choose(model: Linearised, terms: Sequence[JointTerm]) -> tuple[tuple[Step, ...], float, tuple[JointTerm, ...]]:
    """Choose the terms that a robot needs.

    Nubiola 2011, section 7.2, decides so whether the stiffness model and the model of joint 6 are necessary.

    Parameters
    ----------
    model : Linearised
    terms : sequence of JointTerm
        As each was tested by itself, with verdicts; those not tested are not chosen.

    Returns
    -------
    needed : tuple of Step
        The most important first.
    rms_geometry : float
        Of poses left out, with geometry alone, metres.
    terms : tuple of JointTerm
        The same as given; those that are needed but were hidden, with what they are beside the others.
    """
    choice = {(term.kind, term.joint): linearised.of_term(model, term) for term in terms if not term.note}
    selection = _Selection(model, choice)
    selection.take()
    while selection.drop_idle():
        selection.take()
    outcomes = selection.beside_the_others()
    out = []
    for term in terms:
        beside = outcomes.get((term.kind, term.joint))
        if beside is not None and term.verdict != "worth it":
            frequency = None if term.frequency is None else term.frequency[0]
            names, tried = linearised.names_of(term), selection.to_choose_from()
            found_beside = term_of(model, beside, term.kind, term.joint, names, frequency, tried)
            term = replace(term, beside_needed=replace(found_beside, verdict="worth it"))
        out.append(term)
    return selection.steps(), selection.rms_geometry, tuple(out)


class _Selection:
    """JointTerms chosen so far, in order, and those to choose from.

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

    def _test(self, key: Key, Q: FloatArray) -> TestOutcome | None:
        return self.model.test(self.choice[key], self.without, Q)

    def _is_needed(self, outcome: TestOutcome, tried: int) -> bool:
        return outcome.p * tried < SIGNIFICANT and is_worth(outcome.before, outcome.after)

    def to_choose_from(self) -> int:
        """How many terms the last one was chosen from."""
        return len(self.choice) - len(self.chosen) + 1

    def take(self) -> None:
        """Take terms one after the other, until none is significant and worth it."""
        Q = self._basis(self.chosen)
        while True:
            residual = self._left(Q, self.y)
            free = [key for key in self.choice if key not in self.chosen and key not in self.dropped]
            gains = {key: _explains(self._left(Q, self.choice[key]), residual) for key in free}
            for key in sorted(free, key=lambda key: gains[key], reverse=True)[:TRIES]:
                outcome = self._test(key, Q)
                if outcome is not None and self._is_needed(outcome, len(self.choice) - len(self.chosen)):
                    break
            else:
                return
            self.chosen.append(key)
            Q = extended(Q, self.choice[key])

    def beside_the_others(self) -> dict[Key, TestOutcome]:
        """Each chosen term tested beside all other chosen ones."""
        out = {}
        for key in self.chosen:
            outcome = self._test(key, self._basis([key_chosen for key_chosen in self.chosen if key_chosen != key]))
            if outcome is not None:
                out[key] = outcome
        return out

    def drop_idle(self) -> bool:
        """Drop the chosen term that is needed least, if the others have made it idle; whether there was one."""
        outcomes, tried = self.beside_the_others(), self.to_choose_from()
        idle = [key for key in self.chosen if key not in outcomes or not self._is_needed(outcomes[key], tried)]
        if not idle:
            return False
        weakest = max(idle, key=lambda key: outcomes[key].after / outcomes[key].before if key in outcomes else np.inf)
        self.chosen.remove(weakest)
        self.dropped.add(weakest)
        return True

    def steps(self) -> tuple[Step, ...]:
        """The chosen terms with what each adds to those before it."""
        out, Q = [], self.geometry
        for k, key in enumerate(self.chosen):
            outcome = self._test(key, Q)
            if outcome is not None:
                out.append(Step(*key, min(1.0, outcome.p * (len(self.choice) - k)), outcome.after))
            Q = extended(Q, self.choice[key])
        return tuple(out)


def _explains(columns: FloatArray, residual: FloatArray) -> float:
    """Sum of squares that columns explain."""
    solution = np.linalg.lstsq(columns, residual, rcond=1e-6)[0]
    return float(residual @ (columns @ solution))


SMALLEST_LEVER = 0.3
"""Poses whose targets lie nearer to a joint's axis than this share of the typical distance do not show that joint."""


@dataclass(frozen=True, eq=False, repr=False)
class ResidualAnalysis(Speaks):
    """Effects of each joint in the residuals of a robot model.

    Attributes
    ----------
    robot : Robot
        With its base where these points say.
    points : PointSet
    step : ndarray, shape (n, joints)
        Last move of each joint before each pose, radians; NaN where it is not known.
    terms : tuple of JointTerm
    needed : tuple of Step
        Terms chosen together, see `irbcal.joint_analysis.residuals`.
    rms_geometry : float
        Of poses left out of a fit of base, targets and link geometry alone, metres.
    approach : dict of str to float
        The same with the robot's joint map and ``neither``, ``direction`` or ``size`` of the last moves of all joints,
        or ``both``, metres.
    halves : ndarray, shape (joints, 2)
        Backlash from the first and from the second half of the poses, radians.
    halves_p : ndarray, shape (joints,)
        Probability of so large a difference between the halves if the backlash is the same in both.
    angle : ndarray, shape (n, joints)
        Angular residual of each pose about each joint with the estimated backlash left in, radians; NaN where the
        targets lie too near to the axis or the direction is not known.
    rms : float
        Root mean square distance of the points after the (linearised) refit, metres.
    excluded : tuple of tuple
        (pose, target, distance in metres) of points far from the robot.
    """

    robot: Robot
    points: PointSet
    step: FloatArray
    terms: tuple[JointTerm, ...]
    needed: tuple[Step, ...]
    rms_geometry: float
    approach: dict[str, float]
    halves: FloatArray
    halves_p: FloatArray
    angle: FloatArray
    rms: float
    excluded: tuple[tuple[str, str, float], ...] = ()

    def __post_init__(self) -> None:
        lock(self)

    def of(self, kind: Kind) -> dict[int | None, JointTerm]:
        """JointTerms of one kind, by joint."""
        return {term.joint: term for term in self.terms if term.kind == kind}

    def told(self) -> Sequence[Told]:
        """The terms as a table, and what they mean."""
        return [residual_terms_table(self), *of_residuals(self, None)]

    def headline(self) -> str:
        """What the robot needs."""
        return f"{self.robot.arm.name} on {self.points.poses} poses: {needed_by_residuals(self)}"


def analyse_residuals(
    robot: Robot,
    points: PointSet,
    step: FloatArray,
    joint: int | None = None,
    order: int = 2,
    frequency: float | None = 1.0,
) -> ResidualAnalysis:
    """Effects of each joint in the residuals of a robot model, from any poses.

    Parameters
    ----------
    robot : Robot
        Calibrated, or nominal with base and targets. Its base is placed anew. When a term that its joint map has is
        tested, the robot without it is the comparison.
    points : PointSet
        Every target must be one of the robot's.
    step : ndarray, shape (n, joints)
        Of `irbcal.measurement.last_moves.last_moves`, for the poses of ``points``.
    joint : int, optional
        Only this joint, counted from 1 (backlash is estimated for all joints together all the same).
    order : int
        Of the Fourier series.
    frequency : float or None
        Periods per turn; None: free.

    Returns
    -------
    ResidualAnalysis

    Raises
    ------
    IdentificationError
        If there are too few poses or the robot is not that of the points.
    """
    joints = len(robot.arm.joint_names)
    if joint is not None and joint > joints:
        raise IdentificationError(f"there is no joint {joint}: {robot.arm.name} has {joints}")
    step = step[np.isin(np.arange(points.poses), points.pose)]
    robot, points, step, excluded = placed(robot, points.without_empty_poses(), step)
    model = Linearised(robot, points, step)
    chosen = range(joints) if joint is None else [joint - 1]
    turning = [j for j in chosen if not robot.arm.table.prismatic[j]]
    rms, approach = model.rms(), _approach(model)
    backlash, halves, halves_p, angle = backlash_terms(model)
    backlash, moves = judged(backlash), judged([_per_move(model, j) for j in range(joints)])
    # directions go with places, more or less: what depends on the one is not to be taken for the other
    for tested, X in ((backlash, linearised.by_play(model)), (moves, linearised.by_move(model))):
        if any(term.seen for term in tested):
            model.refit_beside(X)
    terms = [
        *backlash,
        *moves,
        *judged([_gain(model, j) for j in chosen]),
        *judged([_fourier(model, j, order, frequency) for j in turning]),
        *judged(_stiffness(model)),
    ]
    terms = [term for term in terms if joint is None or term.joint in (None, joint)]
    steps, rms_geometry, shown = choose(model, terms)
    return ResidualAnalysis(
        robot, points, step, shown, steps, rms_geometry, approach, halves, halves_p, angle, rms, excluded
    )


def _term(
    model: Linearised,
    kind: Kind,
    j: int | None,
    names: Sequence[str],
    X: FloatArray,
    without: Sequence[str] = (),
    beside: FloatArray | None = None,
    frequency: float | None = None,
    tried: int = 1,
) -> JointTerm:
    """One term with its test; ``j`` is the joint, counted from 0."""
    outcome = model.test(X, without, None if beside is None else extended(model.basis(without), beside))
    number = None if j is None else j + 1
    if outcome is None:
        tuned = None if frequency is None else (frequency,)
        return JointTerm(kind, number, tuple(names), note="these poses do not show it", frequency=tuned)
    return term_of(model, outcome, kind, number, names, frequency, tried)


def backlash_terms(model: Linearised) -> tuple[list[JointTerm], FloatArray, FloatArray, FloatArray]:
    """Backlash of all joints together, as Nubiola 2011, section 4.2, sees that of joint 6, from any poses.

    Returns
    -------
    terms : list of JointTerm
        Of each joint, not judged yet.
    halves, halves_p, angle : ndarray
        See `ResidualAnalysis`.
    """
    X, joints = linearised.by_play(model), range(model.joints)
    signs = np.sign(np.nan_to_num(model.step))
    moving = [j for j in joints if {-1.0, 1.0} <= set(signs[:, j])]
    halves, halves_p = np.full((model.joints, 2), np.nan), np.full(model.joints, np.nan)
    angle = np.full((model.poses, model.joints), np.nan)
    terms = []
    for j in joints:
        if j in moving:
            columns = X[:, [k for k in moving if k != j]]
            terms.append(_term(model, "backlash", j, ("backlash",), X[:, j : j + 1], beside=columns))
        else:
            note = "the direction of approach is not known" if not signs[:, j].any() else "reached from one side only"
            terms.append(JointTerm("backlash", j + 1, ("backlash",), note=note))
    if not moving:
        return terms, halves, halves_p, angle
    _fill_halves(model, X, moving, halves, halves_p)
    outcome = model.test(X[:, moving])
    if outcome is not None and len(outcome.kept) == len(moving):
        for slot, j in enumerate(moving):
            angle[:, j] = _about_joint(model, j, outcome.left + X[:, j] * outcome.beta[slot])
            angle[signs[:, j] == 0, j] = np.nan
    return terms, halves, halves_p, angle


def _fill_halves(model: Linearised, X: FloatArray, moving: Sequence[int], halves: FloatArray, p: FloatArray) -> None:
    """Backlash of the first and of the second half of the poses, and whether they differ."""
    first: BoolArray = (model.flat_pose < model.poses / 2)[:, None]
    outcome = model.test(np.hstack([X[:, moving] * first, X[:, moving] * ~first]))
    k = len(moving)
    if outcome is None or len(outcome.kept) < 2 * k:
        return
    halves[moving] = outcome.beta.reshape(2, k).T
    for slot, j in enumerate(moving):
        variance = outcome.C[slot, slot] + outcome.C[k + slot, k + slot] - 2 * outcome.C[slot, k + slot]
        t = (halves[j, 0] - halves[j, 1]) / np.sqrt(max(variance, 1e-300))
        p[j] = f_beyond(float(t * t), 1, model.poses - 1)


def _about_joint(model: Linearised, j: int, r: FloatArray) -> FloatArray:
    """The turn of joint ``j`` that explains most of what is left at each pose, radians."""
    J = model.turn[:, j]
    square = np.bincount(model.flat_pose, J * J, minlength=model.poses)
    along = np.bincount(model.flat_pose, J * r, minlength=model.poses)
    near = square < SMALLEST_LEVER**2 * np.median(square)
    return np.where(near, np.nan, along / np.where(near, 1.0, square))


def _per_move(model: Linearised, j: int) -> JointTerm:
    """Does the error grow with the last move, beside its direction? Play does not, a lag does."""
    sizes = np.abs(model.step[np.isfinite(model.step[:, j]), j])
    if not len(sizes) or sizes.std() < 0.1 * sizes.mean():
        return JointTerm("move", j + 1, ("per_move",), note="all moves of the joint are of one size")
    return _term(
        model, "move", j, ("per_move",), linearised.by_move(model)[:, j : j + 1], beside=linearised.by_play(model)
    )


def _approach(model: Linearised) -> dict[str, float]:
    """Errors of poses left out, with direction and size of the last moves of all joints, metres."""
    sign, size = linearised.by_play(model), linearised.by_move(model)
    out: dict[str, float] = {}
    for name, X in (("direction", sign), ("size", size), ("both", np.hstack([sign, size]))):
        outcome = model.test(X)
        out["neither"] = np.nan if outcome is None else outcome.before
        out[name] = np.nan if outcome is None else outcome.after
    return out


def _gain(model: Linearised, j: int) -> JointTerm:
    X, without = linearised.by_gain(model, j)
    return _term(model, "gain", j, ("gain",), X, without)


def _stiffness(model: Linearised) -> list[JointTerm]:
    """A and B of Nubiola 2011, section 5.3, where the arm is one that the model is for."""
    if "stiffness_A" not in model.maps:
        return []
    X, without = linearised.by_stiffness(model)
    return [_term(model, "stiffness", None, ("A", "B"), X, without)]


def _fourier(model: Linearised, j: int, order: int, frequency: float | None) -> JointTerm:
    """A Fourier series (Nubiola 2011, section 5.2) at a frequency given or free."""
    count = 1
    if frequency is None:
        q = model.q[:, j]
        extent, highest = float(np.ptp(q)), min(HIGHEST_FREQUENCY, len(axes.distinct_angles(q)) / 2 / order)
        if extent < 10 * DEG:
            return JointTerm("fourier", j + 1, fourier_names(order), note="the joint hardly moves")
        tried = frequencies(extent, highest)
        frequency = best_frequency(lambda f: _misfit(model, *linearised.by_series(model, j, order, f)), tried)
        count = len(tried)
    X, without = linearised.by_series(model, j, order, frequency)
    return _term(model, "fourier", j, fourier_names(order), X, without, frequency=frequency, tried=count)


def _misfit(model: Linearised, X: FloatArray, without: Sequence[str]) -> float:
    """Sum of squares that terms leave."""
    Q, y = model.basis(without), model.explained(without)
    y, projected = y - Q @ (Q.T @ y), X - Q @ (Q.T @ X)
    residual = y - projected @ np.linalg.lstsq(projected, y, rcond=1e-9)[0]
    return float(residual @ residual)


MOST_BINS, FEWEST_BINS = 10, 2
FEWEST_IN_BIN = 5


@dataclass(frozen=True, eq=False, repr=False)
class Approach(Speaks):
    """What the residuals say of each joint's direction of approach.

    Attributes
    ----------
    robot : Robot
        With its base where these points say.
    points : PointSet
    direction : ndarray, shape (n, joints)
        1: reached from below, -1: from above, 0: not known.
    terms : tuple of JointTerm
        Backlash by joint, see `irbcal.joint_analysis.terms`.
    angle : ndarray, shape (n, joints)
        Residual about each joint with the backlash left in, radians (metres where it slides); NaN where unknown.
    """

    robot: Robot
    points: PointSet
    direction: FloatArray
    terms: tuple[JointTerm, ...]
    angle: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """Backlash of each joint, in a sentence for each."""
        return [sentence for term in self.terms for sentence in term.told()]

    def headline(self) -> str:
        """The joints whose backlash was seen."""
        joints = ", ".join(str(term.joint) for term in self.terms if term.seen) or "none"
        return f"backlash by {self.points.poses} poses, seen of joints: {joints}"

    def by_angle(self, joint: int, sign: float) -> FloatArray:
        """Means over bins of one joint's angle, of poses reached from one side.

        Parameters
        ----------
        joint : int
            Counted from 0.
        sign : float
            1: from below, -1: from above.

        Returns
        -------
        ndarray, shape (bins, 3)
            Middle of the bin, mean residual and half-width of its 95 % interval, radians; bins of fewer than
            `FEWEST_IN_BIN` poses are left out.
        """
        q, angle = self.points.q[:, joint], self.angle[:, joint]
        have = np.isfinite(angle)
        bins = int(np.clip(have.sum() / (3 * FEWEST_IN_BIN), FEWEST_BINS, MOST_BINS))
        edges = np.unique(np.quantile(q[have], np.linspace(0, 1, bins + 1)))
        mask = have & (self.direction[:, joint] == sign)
        which = np.digitize(q[mask], edges[1:-1])
        rows = []
        for k in range(len(edges) - 1):
            inside = angle[mask][which == k]
            if len(inside) >= FEWEST_IN_BIN:
                half = 1.96 * inside.std(ddof=1) / np.sqrt(len(inside))
                rows.append((q[mask][which == k].mean(), inside.mean(), half))
        return np.array(rows).reshape(-1, 3)


def analyse(robot: Robot, points: PointSet, direction: ArrayLike) -> Approach:
    """Backlash and angular residuals of all joints, from any poses.

    Parameters
    ----------
    robot : Robot
        Calibrated, or nominal with base and targets.
    points : PointSet
    direction : ndarray, shape (n, joints)
        Sign of the last move of each joint, 0 where it is not known.

    Returns
    -------
    Approach

    Raises
    ------
    IdentificationError
        If there are too few poses or the robot is not that of the points.
    """
    step = np.asarray(direction, dtype=float)[np.isin(np.arange(points.poses), points.pose)]
    robot, points, step, _ = placed(robot, points.without_empty_poses(), step)
    terms, _, _, angle = backlash_terms(Linearised(robot, points, step))
    return Approach(robot, points, np.sign(step), tuple(judged(terms)), angle)


def of_residuals(
    analysis: ResidualAnalysis, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None
) -> list[str]:
    """What the residuals say; the last sentence is what the robot needs."""
    slides = analysis.robot.arm.table.prismatic
    hidden = any(term.beside_needed is not None for term in analysis.terms)
    out = [
        f"the {LEFT_OUT} is that of poses left out of the fit one at a time; each term is tested beside geometry, the "
        "model's own terms and, where they count, the last moves; what several terms explain is counted once only in "
        f"the last line{'; what was hidden so is given beside ' + BESIDE if hidden else ''}"
    ]
    for tested in analysis.terms:
        term = tested.shown
        beside = "" if tested.beside_needed is None else f" beside {BESIDE}"
        if term.kind == "backlash" and term.tested:
            said = play_in_words(term, slides)
            out.append(f"{said}: {change_of(term, LEFT_OUT)}{beside}: {LABELS[term.verdict]}" if term.seen else said)
        elif term.kind == "move" and term.seen:
            amount = plus_minus(term.values[0], term.low[0], term.high[0], 0.01)
            out.append(
                f"joint {term.joint}:{beside or ' beside its direction'}, the size of the last move counts: {amount} "
                f"degrees per 100 degrees moved ({p_text(term.p)}): {LABELS[term.verdict]}"
            )
        elif term.kind == "stiffness" and term.tested:
            out.append(f"{_stiffness_in_words(term, geometry)} {judgement_of(term, LEFT_OUT, beside)}")
        elif term.verdict == "worth it":
            out.append(f"joint {term.joint}: {name_of(term)} {judgement_of(term, LEFT_OUT, beside)}")
    return [
        *out,
        *_not_worth(analysis),
        *not_tested(analysis.terms, "the residuals"),
        *_of_approach(analysis),
        needed_by_residuals(analysis),
    ]


def _not_worth(analysis: ResidualAnalysis) -> list[str]:
    """One sentence for each kind of gains and series that are real but small, or not seen."""
    by_kind: dict[tuple[str, str], list[int | None]] = {}
    for term in (term.shown for term in analysis.terms):
        if term.kind in ("gain", "fourier") and term.verdict in ("small", "not seen"):
            name = "gain error" if term.kind == "gain" else "Fourier series"
            by_kind.setdefault((name, term.verdict), []).append(term.joint)
    return [f"{name}{of_joints(joints)}: {LABELS[verdict]}" for (name, verdict), joints in by_kind.items()]


def _stiffness_in_words(term: JointTerm, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None) -> str:
    values = dict(zip(term.names, zip(term.values, term.low, term.high, strict=True), strict=True))
    said = ", ".join(f"{name} = {plus_minus(*value, DEG)} degrees" for name, value in values.items())
    stiffness = geometry[1].with_coefficients(*term.values) if geometry and len(values) == 2 else None
    if stiffness is not None:
        said += f"; the stretched arm bends by {stiffness.delta_L / MM:.2f} mm"
    return f"arm stiffness ({said})"


def _of_approach(analysis: ResidualAnalysis) -> list[str]:
    """What the direction and the size of the last move explain together, and whether it looks like play."""
    approach = analysis.approach
    if not np.isfinite(approach["direction"]):
        return []
    play = [term.shown for term in analysis.of("backlash").values() if term.shown.seen]
    if not play:
        return []
    out = [
        f"directions of approach of all joints together reduce the {LEFT_OUT} from {approach['neither'] / MM:.3f} to "
        f"{approach['direction'] / MM:.3f} mm",
        *_beyond(play),
    ]
    differ = [t.joint for t in play if t.joint and analysis.halves_p[t.joint - 1] < SIGNIFICANT / len(play)]
    if differ:
        which = ", ".join(map(str, differ))
        out.append(f"the first and the second half of the poses disagree on the backlash of joint {which}")
    else:
        out.append(
            "the first and the second half of the poses, taken by themselves, agree on it within their uncertainty"
        )
    if approach["size"] < (1 - WORTH) * approach["direction"]:
        out.append(
            f"the SIZES of the last moves explain more ({approach['size'] / MM:.3f} mm) than their directions: play in "
            "gears does not grow with the move; a lag does, or joints that were read before the robot stood still"
        )
    return out


def needed_by_residuals(analysis: ResidualAnalysis) -> str:
    """The terms that the robot needs, in one sentence."""
    if not analysis.needed:
        return f"This robot needs no term beyond geometry ({analysis.rms_geometry / MM:.3f} mm {LEFT_OUT})."
    names = {
        "backlash": "backlash of joint {}",
        "move": "error by the size of the last move of joint {}",
        "gain": "gain of joint {}",
        "fourier": "Fourier series of joint {}",
        "stiffness": "arm stiffness",
    }
    steps = ", ".join(f"{names[s.kind].format(s.joint)} ({s.rms / MM:.3f})" for s in analysis.needed)
    return (
        f"This robot needs, the most important first: {steps}; in brackets the {LEFT_OUT} in mm with all terms so far, "
        f"geometry alone {analysis.rms_geometry / MM:.3f}."
    )


def residual_terms_table(analysis: ResidualAnalysis, mark: str = "") -> Table:
    """The terms of `terms_table` from the residuals of a robot model."""
    title = (
        f"{mark}Terms from the residuals of {analysis.robot.arm.name} on {analysis.points.poses} poses, geometry "
        f"refitted ({analysis.rms / MM:.3f} mm rms); without and with: rms of poses left out of the fit, mm"
    )
    return terms_table(analysis.terms, title, analysis.robot.arm.table.prismatic)


def residuals_dict(analysis: ResidualAnalysis) -> dict[str, Any]:
    """The analysis of residuals as plain numbers."""
    slides = analysis.robot.arm.table.prismatic
    halves = [
        {
            "joint": j + 1,
            "first": _outside(analysis.halves[j, 0], slides[j]),
            "second": _outside(analysis.halves[j, 1], slides[j]),
            "p": finite(analysis.halves_p[j]),
        }
        for j in range(len(slides))
    ]
    return {
        "robot": analysis.robot.arm.name,
        "poses": analysis.points.poses,
        "points": len(analysis.points),
        "rms_mm": analysis.rms / MM,
        "terms": [_beside_dict(term, slides) for term in analysis.terms],
        "backlash_halves": halves,
        "left_out_rms_by_approach_mm": {name: finite(value / MM) for name, value in analysis.approach.items()},
        "left_out_rms_geometry_mm": analysis.rms_geometry / MM,
        "needed": [
            {"kind": step.kind, "joint": step.joint, "p": step.p, "left_out_rms_mm": step.rms / MM}
            for step in analysis.needed
        ],
    }


def _beside_dict(term: JointTerm, slides: Slides) -> dict[str, Any]:
    """One term as it was tested by itself and, where others had hidden it, ``beside_needed`` (else None)."""
    beside = None if term.beside_needed is None else term_dict(term.beside_needed, slides)
    return term_dict(term, slides) | {"beside_needed": beside}


def _outside(value: float, slides: bool) -> float | None:
    return finite(value / (MM if slides else DEG))
