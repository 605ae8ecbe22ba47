r"""What a measured pose says about the robot, and what a plan is chosen for.

A pose with Jacobian ``J`` (rows: coordinates of the reflectors seen in it; columns: base, targets and error parameters,
each in its plausible size over the standard deviation of a coordinate) adds ``J^T J`` to the information ``M``. The
prior, one plausible size for each error parameter and a metre and a radian for base and targets, keeps directions that
no pose shows from spoiling the rest. Two criteria:

``D``         log det of the information about the error parameters, base and targets eliminated
``position``  mean squared error of the predicted positions of a reflector over sample poses of a volume, base and
              target included

No model describes a robot wholly. Plans for noise alone go to the corners of the workspace and are no better than
random ones where such errors are the larger part; so ``position`` also counts what a fit makes of imagined joint
errors: waves over the angle of each joint and tilts of its axis, of random size (variance and bias together, as Box
and Draper 1959 propose). With ``E`` what such errors do to the measured coordinates, the fit is off by
``M^-1 J^T E``. `irbcal.planning.exchange` chooses the poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.errors import MeasurementError
from irbcal.identification.problem import Problem, State
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.home import METRES_PER_DEGREE
from irbcal.modeling.parameters import level_parameters, parameter
from irbcal.planning.reflectors import Targets
from irbcal.units import DEG, MM

CRITERIA = ("position", "D")
NOISE = 0.1 * MM
"""Standard deviation of one measured coordinate where none is given, metres."""
WAVES = 6
"""Waves of imagined errors in a joint: periods a turn."""
IMAGINED_SIZE = 0.01 * DEG
"""Size of the imagined errors of each joint, root mean square, radians: uneven gears, backlash and the like."""


class Model:
    """What a measured pose says about an arm's unknowns, at its nominal values.

    Parameters
    ----------
    arm : Arm
    targets : Targets
    level : str
        See `irbcal.modeling.parameters`.
    noise : float
        Standard deviation of one coordinate, metres.
    """

    def __init__(self, arm: Arm, targets: Targets, level: str, noise: float = NOISE) -> None:
        self.arm, self.targets, self.level, self.noise = arm, targets, level, float(noise)
        self.parameters = level_parameters(level, arm)
        self.outer = 6 + 3 * len(targets.names)
        self.scale = np.concatenate([np.ones(self.outer), [p.scale for p in self.parameters]])

    def problem(self, q: FloatArray, visible: BoolArray) -> tuple[Problem, State]:
        """The identification from the reflectors seen in poses, and the state it is linearised at."""
        pose, target = np.nonzero(visible)
        n = len(q)
        points = PointSet(
            q, pose, target, np.zeros((len(pose), 3)), self.targets.names, np.arange(n), np.full(n, "", dtype=object)
        )
        problem = Problem(self.arm, points, self.parameters)
        return problem, State(np.eye(4), self.targets.places, np.zeros(len(self.parameters)))

    def rows(self, q: FloatArray, visible: BoolArray) -> FloatArray:
        """Scaled Jacobians of poses.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        visible : ndarray of bool, shape (n, k)
            Reflectors measured in each pose.

        Returns
        -------
        ndarray, shape (n, r, unknowns)
            ``r`` is three times the largest number of reflectors in a pose; poses with fewer have rows of zeros.
        """
        problem, state = self.problem(q, visible)
        J = problem.jacobian(state).reshape(-1, 3, problem.unknowns) * (self.scale / self.noise)
        slot = (np.cumsum(visible, axis=1) - 1)[visible]
        out = np.zeros((len(q), int(visible.sum(axis=1).max(initial=0)), 3, problem.unknowns))
        out[np.nonzero(visible)[0], slot] = J
        return out.reshape(len(q), -1, problem.unknowns)

    def candidates(self, q: FloatArray, visible: BoolArray, imagined: float = 0.0) -> Candidates:
        """What candidate poses would show.

        Parameters
        ----------
        q : ndarray, shape (N, joints)
        visible : ndarray of bool, shape (N, k)
        imagined : float
            Size of the errors that the model does not describe, radians; 0 for none.
        """
        rows = self.rows(q, visible)
        return Candidates(rows, self._errors(q, visible, imagined)) if imagined else Candidates.without_errors(rows)

    def _errors(self, q: FloatArray, visible: BoolArray, size: float) -> FloatArray:
        """Imagined errors as they move the reflectors, over the noise, shape (n, r, h).

        Each joint errs by waves with 1 to `WAVES` periods a turn, a cosine and a sine each, independent of one another;
        and its axis is tilted. Their squares add up to those of the expected error.
        """
        joints, slides = q.shape[1], self.arm.table.prismatic
        unit = np.where(slides, METRES_PER_DEGREE / DEG, 1.0)
        kinds = [parameter(f"delta_{'d' if slides[i] else 'theta'}{i + 1}") for i in range(joints)]
        kinds += [parameter(f"delta_beta{i + 1}") for i in range(1, joints)]
        problem = Problem(self.arm, self.problem(q, visible)[0].points, kinds)
        J = problem.jacobian(State(np.eye(4), self.targets.places, np.zeros(len(kinds))))[:, self.outer :]
        J = J.reshape(-1, 3, len(kinds)) * (size / self.noise)
        pose = np.nonzero(visible)[0]
        slot = (np.cumsum(visible, axis=1) - 1)[visible]
        turns = np.arange(1, WAVES + 1)[:, None] * (q / unit)[pose, None]
        waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=1) * unit / np.sqrt(WAVES)
        moved = (J[:, :, None, :joints] * waves[:, None]).reshape(len(pose), 3, -1)
        out = np.zeros((len(q), int(visible.sum(axis=1).max(initial=0)), 3, 2 * WAVES * joints + joints - 1))
        out[pose, slot] = np.concatenate([moved, J[:, :, joints:]], axis=2)
        return out.reshape(len(q), out.shape[1] * 3, -1)

    def aim(self, criterion: str, q: FloatArray | None = None, target: int = 0, imagined: float = 0.0) -> Aim:
        """What a plan is chosen for.

        Parameters
        ----------
        criterion : str
            See `CRITERIA`.
        q : ndarray, shape (n, joints)
            Sample poses of the volume, for ``position``.
        target : int
            Reflector whose predicted positions count.
        imagined : float
            As for `candidates`.

        Raises
        ------
        MeasurementError
            If there is no such criterion.
        """
        if criterion not in CRITERIA:
            raise MeasurementError(
                f"unknown criterion {criterion!r}: choose one of {', '.join(CRITERIA)}", parameter="criterion"
            )
        if criterion == "D" or q is None:
            return Aim(self.outer)
        candidates = self.candidates(q, self.one(len(q), target), imagined)
        J, E = (flat(array) * self.noise for array in (candidates.rows, candidates.errors))
        n = len(q)
        return Aim(self.outer, J.T @ J / n, J.T @ E / n, float(np.sum(E**2)) / n)

    def one(self, n: int, target: int) -> BoolArray:
        """Mask (n, k) of one reflector."""
        return np.tile(np.arange(len(self.targets.names)) == target, (n, 1))

    def measuring(self, visible: BoolArray) -> tuple[Model, BoolArray]:
        """The model with only the reflectors that a mask (n, k) has anywhere, and the mask for it."""
        used = np.any(visible, axis=0)
        names = tuple(name for name, have in zip(self.targets.names, used, strict=True) if have)
        return Model(self.arm, Targets(names, self.targets.places[used]), self.level, self.noise), visible[:, used]


def flat(blocks: FloatArray) -> FloatArray:
    """The rows of all poses one below the other, (n r, p) of (n, r, p)."""
    n, r, p = blocks.shape
    return blocks.reshape(n * r, p)


@dataclass(frozen=True, eq=False)
class Candidates(Locked):
    """What candidates would show.

    Attributes
    ----------
    rows : ndarray, shape (N, r, p)
        See `Model.rows`.
    errors : ndarray, shape (N, r, h)
        Imagined errors that the model does not describe, over the noise; ``h`` may be 0.
    """

    rows: FloatArray
    errors: FloatArray

    @staticmethod
    def without_errors(rows: FloatArray) -> Candidates:
        """Candidates with no imagined errors."""
        return Candidates(rows, np.zeros((*rows.shape[:2], 0)))


@dataclass(frozen=True, eq=False)
class Aim(Locked):
    """What a plan is chosen for.

    Attributes
    ----------
    outer : int
        Number of base and target unknowns, the first ones.
    G : ndarray, shape (p, p), or None
        Mean of ``J^T J`` over the volume for criterion ``position`` (see `Model.aim`); None for ``D``.
    cross : ndarray, shape (p, h), or None
        Mean of ``J^T E`` with the imagined errors in the volume.
    constant : float
        Mean of their squares.
    given : tuple
        Information (p, p) and ``J^T E`` (p, h) that are there anyway; numbers where there is nothing.
    """

    outer: int
    G: FloatArray | None = None
    cross: FloatArray | None = None
    constant: float = 0.0
    given: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0)

    def with_given(self, poses: Candidates) -> Aim:
        """The same with what some poses (Candidates) show taken as there."""
        X, E = flat(poses.rows), flat(poses.errors)
        return replace(self, given=(self.given[0] + X.T @ X, self.given[1] + X.T @ E))

    def sums(self, rows: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Information with prior (p, p) and ``J^T E`` (p, h) of poses."""
        X, E = flat(rows), flat(errors)
        return np.eye(X.shape[1]) + self.given[0] + X.T @ X, self.given[1] + X.T @ E

    def value(self, rows: FloatArray, errors: FloatArray) -> float:
        """The criterion; less is better."""
        M, N = self.sums(rows, errors)
        if self.G is None:
            return float(np.linalg.slogdet(M[: self.outer, : self.outer])[1] - np.linalg.slogdet(M)[1])
        value = float(np.sum(np.linalg.inv(M) * self.G))
        if N.shape[1] and self.cross is not None:
            A = np.linalg.solve(M, N)
            value += float(np.sum(A * (self.G @ A - 2 * self.cross))) + self.constant
        return value
