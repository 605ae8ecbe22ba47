"""What a plan promises before anything is measured: standard deviations of parameters and of predicted positions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.identification.least_squares import HELD, ROUNDING, TIED, information_of
from irbcal.planning.optimal_design import Model
from irbcal.units import UNIT_OUTSIDE


@dataclass(frozen=True)
class Predicted:
    """Predicted standard deviation of one error parameter."""

    name: str
    unit: str
    std: float | None
    """In the unit of the surface; None where the poses do not show the parameter by itself."""
    state: str
    """``identified``, ``tied`` or ``held``, as in a calibration."""


@dataclass(frozen=True, eq=False, repr=False)
class PlanPrediction(Locked):
    """What a plan promises, from the noise of the points alone: errors that no model describes are not in it."""

    model: Model
    """With the reflectors that the plan measures."""
    parameters: tuple[Predicted, ...]
    covariance: FloatArray
    """Shape (unknowns, unknowns). Of base, targets and error parameters, SI units; held combinations add nothing."""

    def __repr__(self) -> str:
        single = sum(parameter.state == "identified" for parameter in self.parameters)
        return f"<{type(self).__name__}: {single} of {len(self.parameters)} parameters identified by themselves>"

    def position_std(self, q: FloatArray, target: str) -> FloatArray:
        """Standard deviations of a reflector's predicted positions: root of the summed variances of x, y and z.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        target : str
            One that the plan measures.

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        index = self.model.targets.names.index(target)
        problem, state = self.model.problem(q, self.model.mask_of(len(q), index))
        J = problem.jacobian(state)
        return np.sqrt(np.sum((J @ self.covariance) * J, axis=1).reshape(-1, 3).sum(axis=1))


def predict(model: Model, q: FloatArray, visible: BoolArray) -> PlanPrediction:
    """Standard deviations that a plan promises.

    Parameters
    ----------
    model : Model
    q : ndarray, shape (n, joints)
    visible : ndarray of bool, shape (n, k)
        Reflectors measured in each pose; those that no pose has are left out.

    Raises
    ------
    IdentificationError
        If the poses cannot determine base and targets, or are too few.
    """
    model, visible = model.measuring(visible)
    problem, state = model.problem(q, visible)
    H, _, _ = problem.normal_equations(state)
    information = information_of(problem, H, model.noise**2)
    solid = information.eigenvalues > ROUNDING * information.eigenvalues.max(initial=0.0)
    information = replace(information, sigma=model.noise, determined=solid & (information.eigenvalues > model.noise**2))
    covariance = information.covariance()
    std = np.sqrt(np.diag(covariance)[problem.nuisance :])
    out: list[Predicted] = []
    for parameter, value, share in zip(model.parameters, std, information.held_fraction(), strict=True):
        unit, factor = UNIT_OUTSIDE[parameter.unit]
        name = "held" if share > HELD else "tied" if share > TIED else "identified"
        out.append(Predicted(parameter.name, unit, float(value / factor) if name == "identified" else None, name))
    return PlanPrediction(model, tuple(out), covariance)
