"""What is known of a robot that a level of the error model describes, in the same terms as for an average of many.

The covariance is that of least squares, leave-one-out residuals are those of its linear model: in closed form, as
`irbcal.identification.leave_one_out` has them. Other objectives take them from the same linear model at their state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification import leave_one_out
from irbcal.identification.leave_one_out import closed, rms_length
from irbcal.identification.result import Fit
from irbcal.measurement.places import places
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.parameters import Parameter
from irbcal.modeling.terms.gain import FAMILY as GAIN
from irbcal.modeling.terms.geometry import DHM_COLUMNS, SIZES
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.thesis import FAMILY as THESIS

MOST_PLACES = 5000
"""Places whose poses are left out to see how well the others foretell them."""

AXIS_OF = {column: axis for axis, column in DHM_COLUMNS.items()}


def term_of(parameter: Parameter, arm: Arm) -> Term:
    """The term of the error model that an error parameter is the coefficient of.

    Parameters
    ----------
    parameter : Parameter
        A constant of the geometry, a gain, or a parameter of stiffness or of joint 6's Fourier series.
    arm : Arm
        Nominal arm, one that the thesis's joint map fits where the parameter is of that.
    """
    if parameter.kind == "gain":
        return GAIN.terms(arm)[parameter.index]
    if parameter.kind in AXIS_OF:
        axis = AXIS_OF[parameter.kind]
        return Term(parameter.index, axis, "constant", SIZES[axis[0]], "geometry", "geometry", parameter.unit)
    return THESIS.terms(arm)[parameter.index + (2 if parameter.kind == "fourier" else 0)]


def terms_of(parameters: Sequence[Parameter], arm: Arm) -> tuple[Term, ...]:
    """The terms of error parameters, in their order."""
    return tuple(term_of(item, arm) for item in parameters)


def certainty_of(fit: Fit) -> Certainty:
    """Covariance, leave-one-out errors and joint ranges of a fit.

    Parameters
    ----------
    fit : Fit

    Returns
    -------
    Certainty
    """
    problem, points = fit.problem, fit.problem.points
    covariance = fit.solution.information.covariance()
    u = left_out(fit, covariance)
    names = points.target_names
    return Certainty(
        nominal=problem.arm,
        terms=terms_of(problem.parameters, problem.arm),
        covariance=covariance,
        free_targets=tuple(names[k] for k in problem.free),
        coefficients=fit.solution.state.errors,
        loo=of_targets(u[0], u[2]),
        loo_blocks=of_targets(u[1], u[2]),
        ranges=np.array([points.q.min(axis=0), points.q.max(axis=0)]),
    )


def left_out(fit: Fit, covariance: FloatArray) -> tuple[FloatArray, FloatArray, PointSet]:
    """Leave-one-pose-out and leave-a-fifth-out residuals, both of shape (points, 3), metres, and whose they are.

    Repeats of one place (`irbcal.measurement.places.places`) are left out together. Infinite where what is left does
    not determine a direction that a residual depends on. Of more than `MOST_PLACES` places
    those drawn at random tell; a fifth of them stands for a fifth of all.
    """
    problem, state = fit.problem, fit.solution.state
    points, place = problem.points, places(problem.points)
    count = int(place.max(initial=-1)) + 1
    drawn = np.ones(count, dtype=bool)
    if count > MOST_PLACES:
        drawn = np.isin(np.arange(count), np.random.default_rng(0).permutation(count)[:MOST_PLACES])
        problem = problem.of_poses(drawn[place])
        points, place = problem.points, place[drawn[place]]
    weights = np.repeat(problem.weights, 3)
    J = problem.jacobian(state) * weights[:, None]
    e = problem.residuals(state).ravel() * weights
    pose = np.concatenate([points.pose, points.pose[points.oriented()]])
    number, place = leave_one_out.block_numbers(place, points.session)[pose], place[pose]
    order = np.argsort(place, kind="stable")
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    back = np.argsort(order)[: len(points)]
    J, e, a = np.ascontiguousarray(J[rows].T), e[rows], fit.solution.information.sigma**-2.0
    single = leave_one_out.single(J, e, np.repeat(place[order], 3), covariance, a)
    blocks = np.repeat(number[order], 3)
    several, share = e.copy(), a * count / int(drawn.sum())
    masks = [blocks == part for part in np.unique(blocks)]
    information = [share * (J[:, mine] @ J[:, mine].T) for mine in masks]
    right = [share * (J[:, mine] @ e[mine]) for mine in masks]
    for mine, without in zip(masks, leave_one_out.Without.of(covariance, information, right), strict=True):
        several[mine] = without.residuals(J[:, mine], e[mine], share)
    each = problem.weights[: len(points), None]
    return single.reshape(-1, 3)[back] / each, several.reshape(-1, 3)[back] / each, points


def of_targets(u: FloatArray, points: PointSet) -> dict[str, float | None]:
    """Root mean square length of residuals (points, 3) of each target and of all (``""``); None where one is open."""
    out = {"": closed(rms_length(u))}
    for k, name in enumerate(points.target_names):
        if (points.target == k).any():
            out[name] = closed(rms_length(u[points.target == k]))
    return out
