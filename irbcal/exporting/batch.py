"""A calibrated robot for many poses at once: `irbcal.exporting.formulas` on arrays of numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.exporting.formulas import Floats, Formulas

Array = NDArray[Any]


def _stacked(rows: Floats, n: int) -> Array:
    """Matrices (n, rows, columns) from rows of numbers and arrays of shape (n,)."""
    return np.stack([np.stack([np.broadcast_to(x, n) for x in row], axis=1) for row in rows], axis=1)


def _poses(rows: Floats, n: int) -> Array:
    return _stacked([*rows, (0.0, 0.0, 0.0, 1.0)], n)


def _rotation_vector(E: Array) -> Array:
    w = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    s, c = np.linalg.norm(w, axis=1), 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0)
    return w * np.where(s > 1e-7, np.arctan2(s, c) / np.where(s > 1e-7, s, 1.0), 1.0)[:, None]


class Batch(Formulas):
    """The robot for many poses at once: its formulas on arrays of shape (n,), a number of each pose."""

    functions: Any = np

    def _columns(self, q: ArrayLike) -> list[Array]:
        q = np.atleast_2d(np.asarray(q, dtype=float))
        if q.ndim != 2 or q.shape[1] != self.JOINTS:
            raise ValueError(f"joints need shape (n, {self.JOINTS}), found {q.shape}")
        return list(np.ascontiguousarray(q.T))

    def _situation(
        self,
        q: Floats,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_centre: ArrayLike | None = None,
        **readings: Any,
    ) -> tuple[Floats | None, Any, Floats, Mapping[str, Floats]]:
        """Joints are columns; in unknown moves, masses, places and readings stands nan."""
        self._check_names(readings)
        n, moves = len(q[0]), None
        if previous is not None and self.HAS_HISTORY:
            moves = np.array(q) - np.atleast_2d(np.asarray(previous, dtype=float)).T
            moves[:, ~np.isfinite(moves).all(axis=0)] = nan
        kg = np.asarray(self.PAYLOAD_KG if payload_kg is None else payload_kg, dtype=float)
        kg = np.broadcast_to(np.where(np.isfinite(kg), kg, self.PAYLOAD_KG), n)
        centre = np.asarray(self.PAYLOAD_CENTRE if payload_centre is None else payload_centre, dtype=float)
        centre = np.where(np.isfinite(centre).all(axis=-1, keepdims=True), centre, self.PAYLOAD_CENTRE)
        of_joints = {}
        for name, given in readings.items():
            usual, _, each = self.PROPORTIONAL[name]
            values = np.asarray(usual if given is None else given, dtype=float)
            values = np.where(np.isfinite(values), values, usual)
            values = values if each or not values.ndim else values[:, None]
            of_joints[name] = list(np.broadcast_to(values, (n, self.JOINTS)).T)
        return moves, kg, list(np.broadcast_to(centre, (n, 3)).T), of_joints

    def _shift(self, q: Floats, moves: Floats | None, *situation: Any) -> list[Any]:
        """Unknown moves do nothing."""
        return super()._shift(q, None if moves is None else [*np.nan_to_num(moves)], *situation)

    def _size(self, moves: Floats) -> Array:
        largest = np.abs(moves).max(axis=0)
        return np.where(largest == 0.0, 1.0, largest)

    def _move_slopes(self, J: list[list[Any]], moves: Floats) -> None:
        known, finished = np.isfinite(moves[0]), np.nan_to_num(moves)
        top = np.abs(finished).argmax(axis=0)
        signed = finished[top, np.arange(len(top))]
        size = np.where(signed == 0.0, inf, np.abs(signed))
        for j in range(self.JOINTS):
            side = np.tanh(finished[j] / self.WIDTH[j])
            J[j][j] = J[j][j] + known * (self.DIRECTION[j] * (1.0 - side**2) / self.WIDTH[j] + self.MOVE[j])
            J[j][j] += self.SHARE[j] / size
            for i in range(self.JOINTS):
                J[j][i] = J[j][i] - (top == i) * (self.SHARE[j] * finished[j] * np.sign(signed) / size**2)

    def effective(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Effective joints, the joints of calibrated.urdf, for commanded ones, (n, joints)."""
        return np.stack(super().effective(self._columns(q), previous, **inputs), axis=1)

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Derivative of the effective by the commanded joints, (n, joints, joints)."""
        columns = self._columns(q)
        return _stacked(super().jacobian(columns, previous, **inputs), len(columns[0]))

    def commanded(self, theta: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Commanded joints that give effective ones, (n, joints); a ValueError where that does not converge."""
        theta = np.atleast_2d(np.asarray(theta, dtype=float))
        q, change = theta.copy(), inf
        for _ in range(60):
            miss = theta - self.effective(q, previous, **inputs)
            q = q + miss
            change = np.abs(miss).max(initial=0.0)
            if change < 1e-14:
                return q
        if not change < 1e-11:
            raise ValueError(f"the joint map cannot be inverted: {change:.3g} rad left after 60 steps")
        return q

    def forward_effective(self, theta: ArrayLike) -> Array:
        """The tip in the base for joints of calibrated.urdf, (n, 4, 4)."""
        columns = self._columns(theta)
        return _poses(super().forward_effective(columns), len(columns[0]))

    def forward_nominal(self, q: ArrayLike) -> Array:
        """The tip of the nominal robot, (n, 4, 4): what a program that was written for it wants."""
        columns = self._columns(q)
        return _poses(super().forward_nominal(columns), len(columns[0]))

    def _geometric(self, theta: ArrayLike) -> tuple[Array, Array, Array]:
        """Attitude and place of the tip, (n, 3, 3) and (n, 3), and its derivative, (n, 6, joints)."""
        columns = self._columns(theta)
        n = len(columns[0])
        R, p, by_joint = super()._geometric(columns)
        return _stacked([*zip(*R, strict=True)], n), np.stack(p, axis=1), _stacked([*zip(*by_joint, strict=True)], n)

    def tip_jacobian(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Derivative of the tip's place and rotation in the base by the commanded joints, (n, 6, joints)."""
        return self._geometric(self.effective(q, previous, **inputs))[2] @ self.jacobian(q, previous, **inputs)

    def inverse(
        self,
        T: ArrayLike,
        seed: ArrayLike,
        previous: ArrayLike | None = None,
        tolerance: float = 1e-12,
        **inputs: Any,
    ) -> tuple[Array, Array]:
        """Commanded joints of poses (n, 4, 4) from seeds (n, joints), by damped Newton steps.

        Returns the joints (n, joints) and whether they converged (n,); limits are not regarded.
        """
        T = np.asarray(T, dtype=float).reshape(-1, 4, 4)
        seed = np.broadcast_to(np.asarray(seed, dtype=float), (len(T), self.JOINTS))
        theta = self.effective(seed, previous, **inputs)
        best, damping, converged = np.full(len(T), inf), np.full(len(T), 1e-6), np.zeros(len(T), dtype=bool)
        trial, J, e = theta, np.zeros((len(T), 6, self.JOINTS)), np.zeros((len(T), 6))
        weights = np.array([1 / self.REACH] * 3 + [1.0] * 3)
        for _ in range(60):
            R, p, G = self._geometric(trial)
            lack = np.concatenate([T[:, :3, 3] - p, _rotation_vector(T[:, :3, :3] @ R.transpose(0, 2, 1))], axis=1)
            cost = ((lack * weights) ** 2).sum(axis=1)
            better = cost < best
            best, damping = (
                np.where(better, cost, best),
                np.where(better, np.maximum(damping * 0.2, 1e-8), damping * 8.0),
            )
            theta = np.where(better[:, None], trial, theta)
            J = np.where(better[:, None, None], G * weights[:, None], J)
            e = np.where(better[:, None], lack * weights, e)
            good = (np.linalg.norm(lack[:, :3], axis=1) <= tolerance) & (
                np.linalg.norm(lack[:, 3:], axis=1) <= tolerance
            )
            converged |= better & good
            if converged.all():
                break
            small = damping * np.minimum(np.sqrt(best), 1.0) + 1e-15
            if self.JOINTS > 6:
                A = J @ J.transpose(0, 2, 1) + small[:, None, None] * np.eye(6)
                step = (J.transpose(0, 2, 1) @ np.linalg.solve(A, e[:, :, None]))[..., 0]
            else:
                A = J.transpose(0, 2, 1) @ J + small[:, None, None] * np.eye(self.JOINTS)
                step = np.linalg.solve(A, J.transpose(0, 2, 1) @ e[:, :, None])[..., 0]
            step *= 0.5 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 0.5)
            trial = np.where(converged[:, None], theta, theta + step)
        return self.commanded(theta, previous, **inputs), converged

    def check(self) -> float:
        """The largest difference from the test vectors, radians or metres."""
        q, effective, tip = (np.array(self.TESTS[name]) for name in ("q", "effective", "tip"))
        inputs = self.TESTS["inputs"]
        theta, T = self.effective(q, **inputs), self.forward(q, **inputs)
        misses = (theta - effective, T[:, :3] - tip, self.commanded(theta, **inputs) - q)
        return float(max(np.abs(miss).max() for miss in misses))
