"""Effects of single joints in the residuals of a robot model, from any poses.

Everything is linearised about the robot at hand. Beside the effect that is looked at, base, targets, link geometry and
the terms of the robot's joint map are refitted, so that what they can explain is not taken for something else. Where
the direction or the size of the last moves counts, gains, series and stiffness are tested beside these, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.chance import f_beyond
from irbcal.errors import IdentificationError
from irbcal.identification import axes
from irbcal.joint_behaviour import columns, needed
from irbcal.joint_behaviour.linearised import Linearised, extended, term_of
from irbcal.joint_behaviour.needed import Step
from irbcal.joint_behaviour.placing import placed
from irbcal.joint_behaviour.terms import (
    HIGHEST_FREQUENCY,
    Kind,
    Term,
    best_frequency,
    fourier_names,
    frequencies,
    judged,
)
from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot
from irbcal.summary import Speaks, Told
from irbcal.units import DEG

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
    terms : tuple of Term
    needed : tuple of Step
        Terms chosen together, see `irbcal.joint_behaviour.needed`.
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
    terms: tuple[Term, ...]
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

    def of(self, kind: Kind) -> dict[int | None, Term]:
        """Terms of one kind, by joint."""
        return {term.joint: term for term in self.terms if term.kind == kind}

    def told(self) -> Sequence[Told]:
        """The terms as a table, and what they mean."""
        from irbcal.joint_behaviour.numbers import residual_terms_table
        from irbcal.joint_behaviour.verdict import of_residuals

        return [residual_terms_table(self), *of_residuals(self, None)]

    def headline(self) -> str:
        """What the robot needs."""
        from irbcal.joint_behaviour.verdict import needed_by_residuals

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
    for found, X in ((backlash, columns.by_play(model)), (moves, columns.by_move(model))):
        if any(term.seen for term in found):
            model.refit_beside(X)
    terms = [
        *backlash,
        *moves,
        *judged([_gain(model, j) for j in chosen]),
        *judged([_fourier(model, j, order, frequency) for j in turning]),
        *judged(_stiffness(model)),
    ]
    terms = [term for term in terms if joint is None or term.joint in (None, joint)]
    steps, rms_geometry, shown = needed.choose(model, terms)
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
) -> Term:
    """One term with its test; ``j`` is the joint, counted from 0."""
    found = model.test(X, without, None if beside is None else extended(model.basis(without), beside))
    number = None if j is None else j + 1
    if found is None:
        tuned = None if frequency is None else (frequency,)
        return Term(kind, number, tuple(names), note="these poses do not show it", frequency=tuned)
    return term_of(model, found, kind, number, names, frequency, tried)


def backlash_terms(model: Linearised) -> tuple[list[Term], FloatArray, FloatArray, FloatArray]:
    """Backlash of all joints together, as Nubiola 2011, section 4.2, sees that of joint 6, from any poses.

    Returns
    -------
    terms : list of Term
        Of each joint, not judged yet.
    halves, halves_p, angle : ndarray
        See `ResidualAnalysis`.
    """
    X, joints = columns.by_play(model), range(model.joints)
    signs = np.sign(np.nan_to_num(model.step))
    moving = [j for j in joints if {-1.0, 1.0} <= set(signs[:, j])]
    halves, halves_p = np.full((model.joints, 2), np.nan), np.full(model.joints, np.nan)
    angle = np.full((model.poses, model.joints), np.nan)
    terms = []
    for j in joints:
        if j in moving:
            others = X[:, [k for k in moving if k != j]]
            terms.append(_term(model, "backlash", j, ("backlash",), X[:, j : j + 1], beside=others))
        else:
            note = "the direction of approach is not known" if not signs[:, j].any() else "reached from one side only"
            terms.append(Term("backlash", j + 1, ("backlash",), note=note))
    if not moving:
        return terms, halves, halves_p, angle
    _fill_halves(model, X, moving, halves, halves_p)
    found = model.test(X[:, moving])
    if found is not None and len(found.kept) == len(moving):
        for slot, j in enumerate(moving):
            angle[:, j] = _about_joint(model, j, found.left + X[:, j] * found.beta[slot])
            angle[signs[:, j] == 0, j] = np.nan
    return terms, halves, halves_p, angle


def _fill_halves(model: Linearised, X: FloatArray, moving: Sequence[int], halves: FloatArray, p: FloatArray) -> None:
    """Backlash of the first and of the second half of the poses, and whether they differ."""
    first: BoolArray = (model.flat_pose < model.poses / 2)[:, None]
    found = model.test(np.hstack([X[:, moving] * first, X[:, moving] * ~first]))
    k = len(moving)
    if found is None or len(found.kept) < 2 * k:
        return
    halves[moving] = found.beta.reshape(2, k).T
    for slot, j in enumerate(moving):
        variance = found.C[slot, slot] + found.C[k + slot, k + slot] - 2 * found.C[slot, k + slot]
        t = (halves[j, 0] - halves[j, 1]) / np.sqrt(max(variance, 1e-300))
        p[j] = f_beyond(float(t * t), 1, model.poses - 1)


def _about_joint(model: Linearised, j: int, r: FloatArray) -> FloatArray:
    """The turn of joint ``j`` that explains most of what is left at each pose, radians."""
    J = model.turn[:, j]
    square = np.bincount(model.flat_pose, J * J, minlength=model.poses)
    along = np.bincount(model.flat_pose, J * r, minlength=model.poses)
    near = square < SMALLEST_LEVER**2 * np.median(square)
    return np.where(near, np.nan, along / np.where(near, 1.0, square))


def _per_move(model: Linearised, j: int) -> Term:
    """Does the error grow with the last move, beside its direction? Play does not, a lag does."""
    sizes = np.abs(model.step[np.isfinite(model.step[:, j]), j])
    if not len(sizes) or sizes.std() < 0.1 * sizes.mean():
        return Term("move", j + 1, ("per_move",), note="all moves of the joint are of one size")
    return _term(model, "move", j, ("per_move",), columns.by_move(model)[:, j : j + 1], beside=columns.by_play(model))


def _approach(model: Linearised) -> dict[str, float]:
    """Errors of poses left out, with direction and size of the last moves of all joints, metres."""
    sign, size = columns.by_play(model), columns.by_move(model)
    out: dict[str, float] = {}
    for name, X in (("direction", sign), ("size", size), ("both", np.hstack([sign, size]))):
        found = model.test(X)
        out["neither"] = np.nan if found is None else found.before
        out[name] = np.nan if found is None else found.after
    return out


def _gain(model: Linearised, j: int) -> Term:
    X, without = columns.by_gain(model, j)
    return _term(model, "gain", j, ("gain",), X, without)


def _stiffness(model: Linearised) -> list[Term]:
    """A and B of Nubiola 2011, section 5.3, where the arm is one that the model is for."""
    if "stiffness_A" not in model.maps:
        return []
    X, without = columns.by_stiffness(model)
    return [_term(model, "stiffness", None, ("A", "B"), X, without)]


def _fourier(model: Linearised, j: int, order: int, frequency: float | None) -> Term:
    """A Fourier series (Nubiola 2011, section 5.2) at a frequency given or free."""
    count = 1
    if frequency is None:
        q = model.q[:, j]
        extent, highest = float(np.ptp(q)), min(HIGHEST_FREQUENCY, len(axes.distinct_angles(q)) / 2 / order)
        if extent < 10 * DEG:
            return Term("fourier", j + 1, fourier_names(order), note="the joint hardly moves")
        tried = frequencies(extent, highest)
        frequency = best_frequency(lambda f: _misfit(model, *columns.by_series(model, j, order, f)), tried)
        count = len(tried)
    X, without = columns.by_series(model, j, order, frequency)
    return _term(model, "fourier", j, fourier_names(order), X, without, frequency=frequency, tried=count)


def _misfit(model: Linearised, X: FloatArray, without: Sequence[str]) -> float:
    """Sum of squares that terms leave."""
    Q, y = model.basis(without), model.explained(without)
    y, own = y - Q @ (Q.T @ y), X - Q @ (Q.T @ X)
    left = y - own @ np.linalg.lstsq(own, y, rcond=1e-9)[0]
    return float(left @ left)
