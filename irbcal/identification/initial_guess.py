"""Base and tool in closed form: a start that needs no guess.

A target at ``c`` in the tip link, seen at ``y`` in the measuring frame while the tip is at ``(R_j, p_j)`` in the
base link, obeys ``W y + s - R_j c = p_j`` with ``W`` the inverse base rotation and ``s`` the inverse base
translation. That is linear in the nine entries of ``W``, in ``s`` and in all targets; the rotation nearest to
the least-squares ``W`` starts the fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray, evenly_chosen
from irbcal.errors import IdentificationError
from irbcal.identification import least_squares
from irbcal.identification.problem import Problem, State
from irbcal.modeling import dhm, frames

MIN_POSES = 3
"""Poses without which not even base and tool are looked for."""

SPREAD, CLEAR = 1e-5, 1e-3
"""Ratios of singular values below which the closed form leaves the start open, and above which it is believed."""
NEAR = 0.02
"""In between it is believed where the nominal robot then fits to so much of how far the points lie apart."""

NO_ROTATION = 0.1
"""A base rotation has singular values of 1; where the second is smaller, the closed form leaves the base open.

So it is of a tip that never moves, where no rotation at all fits."""

MOST_POSES = 5000
"""Poses that a start is made from; of more, evenly chosen ones."""


def closed_form(problem: Problem, tip: FloatArray | None = None) -> tuple[State, float]:
    """First guess of base and targets from the tip's poses.

    Parameters
    ----------
    problem : Problem
        Its error parameters start at zero; known targets stay where they are known to be.
    tip : ndarray, shape (4, 3, m), optional
        Axes and origin of the tip at each point; `nominal_tip` unless given.

    Returns
    -------
    state : State
    spread : float
        Ratio of the smallest to the largest singular value of the scaled linear system; near zero the data
        do not determine base and tool in this way, twice `SPREAD` at most where the solution is no rotation.

    Raises
    ------
    IdentificationError
        If there are fewer equations than the 12 + 3 T unknowns.
    """
    points, free = problem.points, problem.fitted_targets
    unknowns = 12 + 3 * len(free)
    if tip is None and points.poses > MOST_POSES and not len(problem.oriented_targets):
        subset = problem.of_poses(evenly_chosen(points.poses, MOST_POSES))
        if np.isin(free, subset.points.target).all():
            return closed_form(subset)
    if 3 * len(points) < unknowns:
        raise IdentificationError(
            f"{len(points)} points of {points.poses} poses are too few to find base and tool: "
            f"{len(free)} unknown targets need at least {-(-unknowns // 3)} points"
        )
    tip = nominal_tip(problem) if tip is None else tip
    y = points.xyz.T
    center = y.mean(axis=1, keepdims=True)
    y = y - center
    size = max(np.abs(y).max(), 1e-9)
    rows = np.zeros((unknowns, 3, len(points)))
    for k in range(3):
        np.multiply(y, 1.0 / size, out=rows[3 * k : 3 * k + 3, k])
    _place_rows(problem, tip, rows[9:])
    M = rows.reshape(unknowns, -1)
    MM = M @ M.T
    eigenvalues, V = np.linalg.eigh(MM)
    keep = eigenvalues > 1e-12 * eigenvalues[-1]
    solution = V[:, keep] @ ((V[:, keep].T @ (M @ _without_targets(problem, tip).ravel())) / eigenvalues[keep])
    W = solution[:9].reshape(3, 3) / size
    spread = float(np.sqrt(max(eigenvalues[0], 0.0) / eigenvalues[-1]))
    if np.linalg.svd(W, compute_uv=False)[1] < NO_ROTATION:
        spread = min(spread, 2.0 * SPREAD)  # open, and targets at the tip would be no start, either
    return placed(problem, frames.nearest_rotation(W), tip, (M[9:], MM[9:, 9:])), spread


def _place_rows(problem: Problem, tip: FloatArray, out: FloatArray) -> None:
    """Fill the columns of the inverse base translation and the targets into zeros (3 + 3 T, 3, m)."""
    for k in range(3):
        out[k, k] = 1.0
    for slot, t in enumerate(problem.fitted_targets):
        np.multiply(tip[:3], -1.0 * (problem.points.target == t), out=out[3 + 3 * slot : 6 + 3 * slot])


def _known_targets(problem: Problem) -> FloatArray:
    """Places of the known targets, zeros for the others, shape (T, 3)."""
    return np.array([problem.known_targets.get(name, np.zeros(3)) for name in problem.points.target_names]).reshape(
        -1, 3
    )


def _without_targets(problem: Problem, tip: FloatArray) -> FloatArray:
    """What base and unknown targets have to make up: tip origins with the known targets, shape (3, m)."""
    if not problem.known_targets:
        return tip[3]
    x, y, z = _known_targets(problem)[problem.points.target].T
    return np.asarray(tip[3] + tip[0] * x + tip[1] * y + tip[2] * z)


def placed(
    problem: Problem,
    W: FloatArray,
    tip: FloatArray | None = None,
    rows: tuple[FloatArray, FloatArray] | None = None,
) -> State:
    """Base and targets by least squares where the inverse base rotation ``W`` is known; ``tip`` as `nominal_tip`.

    ``rows`` are those of `_place_rows` (3 + 3 T, 3 m) and their sums of products, where they are known.
    """
    points, free = problem.points, problem.fitted_targets
    tip = nominal_tip(problem) if tip is None else tip
    y = points.xyz.T
    center = y.mean(axis=1, keepdims=True)
    if rows is None:
        empty = np.zeros((3 + 3 * len(free), 3, len(points)))
        _place_rows(problem, tip, empty)
        columns = empty.reshape(len(empty), -1)
        rows = columns, columns @ columns.T
    right = _without_targets(problem, tip) - W @ (y - center)
    solution = np.linalg.lstsq(rows[1], rows[0] @ right.ravel(), rcond=1e-12)[0]
    targets = _known_targets(problem)
    targets[free] = solution[3:].reshape(-1, 3)
    return State(
        frames.inverse(frames.transform(W, solution[:3] - W @ center[:, 0])),
        targets,
        np.zeros(len(problem.parameters)),
        target_rotations(problem, tip, W),
    )


def hand_eye(problem: Problem) -> State | None:
    """First guess of base and targets from measured orientations, where poses turn too little for `closed_form`.

    With ``R_W`` the base, ``R_A`` the nominal tip and ``R_X`` the target frame in it, ``R_A R_X = R_W^T R_M``
    (`irbcal.modeling.frames.hand_eye`); places follow by linear least squares. None without three measured orientations
    of one target, or where these leave the rotations open.
    """
    points = problem.points
    if points.rotation is None:
        return None
    oriented = points.oriented()
    of_target = oriented & (points.target == np.argmax(np.bincount(points.target[oriented], minlength=1)))
    tip = nominal_tip(problem)
    rotations = frames.hand_eye(tip[:3, :, of_target].transpose(2, 1, 0), points.rotation[of_target])
    return None if rotations is None else placed(problem, rotations[1], tip)


def nominal_tip(problem: Problem) -> FloatArray:
    """Tip frames of the nominal arm at each point's joints: axes and origin, shape (4, 3, m)."""
    arm, points = problem.arm, problem.points
    theta = points.q.T + arm.table.offsets[:, None]
    return dhm.tip_columns(arm.table, theta, arm.T_base_0, arm.T_last_tip)[..., points.pose]


def target_rotations(problem: Problem, tip: FloatArray, W: FloatArray) -> FloatArray:
    """Mean orientation of each measured target frame in the tip link; identity without measurements."""
    points = problem.points
    rotations = np.tile(np.eye(3), (len(points.target_names), 1, 1))
    if points.rotation is None:
        return rotations
    oriented = points.oriented()
    for k in problem.oriented_targets:
        of_target = oriented & (points.target == k)
        R_tip_base = tip[:3, :, of_target].transpose(2, 0, 1)
        rotations[k] = frames.nearest_rotation((R_tip_base @ (W @ points.rotation[of_target])).mean(axis=0))
    return rotations


def turned_starts(problem: Problem, state: State, *, fitted: bool = False) -> Iterator[State]:
    """Starts for every one of the 24 turns of a cube, for data on which `closed_form` is not determined.

    Parameters
    ----------
    problem : Problem
    state : State
        Of the closed form.
    fitted : bool
        Base and targets as in `placed`; else targets at the tip, the middles of tips and points in one place.
    """
    tip = nominal_tip(problem)
    middle_base, middle_world = tip[3].mean(axis=1), problem.points.xyz.mean(axis=0)
    for permutation in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in range(8):
            R = np.zeros((3, 3))
            R[range(3), permutation] = [1.0 if signs >> k & 1 else -1.0 for k in range(3)]
            if np.linalg.det(R) > 0 and fitted:
                yield placed(problem, R.T)
            elif np.linalg.det(R) > 0:
                T = frames.transform(R, middle_world - R @ middle_base)
                targets = np.where(
                    np.isin(range(len(state.targets)), problem.fitted_targets)[:, None], 0.0, state.targets
                )
                yield State(T, targets, state.errors, target_rotations(problem, tip, R.T))


def first_state(problem: Problem) -> State:
    """Closed form, each session by itself; where the data leave it open, the best of a turn of nominal fits."""
    if len(problem.sessions) > 1:
        return _first_of_sessions(problem)
    state, spread = closed_form(problem)
    turned = hand_eye(problem)
    if spread > CLEAR:
        if turned is None:
            return state
        return min((state, turned), key=lambda guess: float(np.sum(problem.residuals(guess) ** 2)))
    nominal = Problem(problem.arm, problem.points, (), known_targets=problem.known_targets)
    first, _ = closed_form(nominal)
    best: least_squares.Solution[State] | None = None
    failure = IdentificationError("no start was found")
    by_orientation = hand_eye(nominal)
    apart = float(((problem.points.xyz - problem.points.xyz.mean(axis=0)) ** 2).sum())
    guesses = [first] if by_orientation is None else [first, by_orientation]
    turns = turned_starts(nominal, first, fitted=spread > SPREAD)
    for number, candidate in enumerate(itertools.chain(guesses, turns)):
        if number == len(guesses) and spread > SPREAD and best is not None and best.rss < NEAR**2 * apart:
            break
        try:
            solution = least_squares.solve(nominal, candidate)
        except IdentificationError as error:
            failure = error
            continue
        if best is None or solution.rss < best.rss:
            best = solution
    if best is None:
        raise failure
    return replace(best.state, errors=np.zeros(len(problem.parameters)))


def _first_of_sessions(problem: Problem) -> State:
    """Base and targets of each session from its own points; a target of several sessions from the last of them."""
    points = problem.points
    assert points.session is not None
    targets, bases = np.zeros((len(points.target_names), 3)), []
    rotations = np.tile(np.eye(3), (len(targets), 1, 1))
    for name in problem.sessions:
        subset = replace(points.select(points.session == name), session=None).with_seen_targets()
        if subset.poses < MIN_POSES:
            raise IdentificationError(
                f"{subset.poses} poses of session {name} cannot determine its base and tool: at least {MIN_POSES} are "
                "needed"
            )
        session_state = first_state(Problem(problem.arm, subset, (), known_targets=problem.known_targets))
        index = [points.target_names.index(target) for target in subset.target_names]
        targets[index], rotations[index] = session_state.targets, session_state.rotations
        bases.append(session_state.T_world_base)
    return State(bases[-1], targets, np.zeros(len(problem.parameters)), rotations, np.array(bases[:-1]))
