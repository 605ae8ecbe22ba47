"""A calibrated robot for many poses at once, on numpy alone.

Arrays have a row for each of n poses; `check` says by how much the test vectors are missed (< 1e-12). Radians, metres,
kilograms; joints are those of the URDF, in the order of JOINT_NAMES.

    effective(q)       joints of calibrated.urdf for commanded joints
    jacobian(q)        their derivative, the stop before held
    commanded(theta)   the way back
    forward(q)         TIP_LINK in BASE_LINK, (n, 4, 4)
    tip_jacobian(q)    its derivative: linear above angular, in the base
    inverse(T, seed)   commanded joints of poses, from seeds

All take the stop before as ``previous`` (rows with nan: not known), and by their names ``payload_kg``,
``payload_centre`` in the tip link, and what is read beside the joints (PROPORTIONAL): ``torques``.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...k,...k->...", a, b)


def _poses(R: Array, p: Array) -> Array:
    T = np.zeros((len(p), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, p, 1.0
    return T


def _rotation_vector(E: Array) -> Array:
    w = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    s, c = np.linalg.norm(w, axis=1), 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0)
    return w * np.where(s > 1e-7, np.arctan2(s, c) / np.where(s > 1e-7, s, 1.0), 1.0)[:, None]


class Batch(SimpleNamespace):
    """The robot, made of the constants that an export has, by their names: `irbcal.exporting.python.constants`."""

    def _situation(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_centre: ArrayLike | None = None,
        **readings: ArrayLike | None,
    ) -> tuple[Array, Array | None, Array, Array, Array]:
        """Joints (n, joints), last moves or None, masses (n,), places (n, 3), what readings add to the joints."""
        q = np.atleast_2d(np.asarray(q, dtype=float))
        if q.ndim != 2 or q.shape[1] != self.JOINTS:
            raise ValueError(f"joints need shape (n, {self.JOINTS}), found {q.shape}")
        moves = None
        if previous is not None and self.HAS_HISTORY:
            moves = q - np.asarray(previous, dtype=float)
            moves[~np.isfinite(moves).all(axis=1)] = nan
        kg = np.broadcast_to(
            np.asarray(self.PAYLOAD_KG if payload_kg is None else payload_kg, dtype=float), q.shape[:1]
        )
        kg = np.where(np.isfinite(kg), kg, self.PAYLOAD_KG)
        payload_at = np.asarray(self.PAYLOAD_CENTRE if payload_centre is None else payload_centre, dtype=float)
        payload_at = np.broadcast_to(payload_at, (len(q), 3))
        payload_at = np.where(np.isfinite(payload_at).all(axis=1, keepdims=True), payload_at, self.PAYLOAD_CENTRE)
        added = np.zeros(q.shape)
        for name, given in readings.items():
            if name not in self.PROPORTIONAL:
                known = ("payload_kg", "payload_centre", *self.PROPORTIONAL)
                raise TypeError(f"unknown input {name!r}: there are {', '.join(known)}")
            usual, coefficients, of_joints = self.PROPORTIONAL[name]
            values = np.asarray(usual if given is None else given, dtype=float) - usual
            values = values if of_joints or not values.ndim else values[:, None]
            added += np.array(coefficients) * np.nan_to_num(values)
        return q, moves, kg, payload_at, added

    def _walk(self, chain: Mapping[str, Any], q: Array) -> tuple[Array, Array, Array, Array]:
        """Attitudes (joints, n, 3, 3) and origins (joints, n, 3) of the links, and the tip's."""
        n = len(q)
        R, o = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
        attitudes, origins = np.empty((self.JOINTS, n, 3, 3)), np.empty((self.JOINTS, n, 3))
        c, s = np.cos(q), np.sin(q)
        for i in range(self.JOINTS):
            o = o + R @ np.array(chain["p"][i])
            R = R @ np.array(chain["R"][i])
            if self.SLIDES[i]:
                o = o + q[:, i, None] * R[:, :, 2]
            else:
                x, y = R[:, :, 0], R[:, :, 1]
                ci, si = c[:, i, None], s[:, i, None]
                R = np.stack([ci * x + si * y, ci * y - si * x, R[:, :, 2]], axis=2)
            attitudes[i], origins[i] = R, o
        return attitudes, origins, R @ np.array(chain["tip_R"]), o + R @ np.array(chain["tip_p"])

    def _shift(
        self, q: Array, moves: Array | None, kg: Array, payload_at: Array, added: Array, slopes: bool
    ) -> tuple[Any, Any]:
        """What effective joints are more than commanded ones (n, joints), and its derivative or None."""
        n = len(q)
        f = np.array(self.OFFSET) + np.array(self.GAIN) * q
        J: Any = np.zeros((n, self.JOINTS, self.JOINTS)) if slopes else None
        every = range(self.JOINTS)
        if slopes:
            J[:, every, every] = self.GAIN
        for i, series in enumerate(self.SERIES):
            if not series:
                continue
            c, s = np.cos(q[:, i]), np.sin(q[:, i])
            u = u1 = v = v1 = du = du1 = dv = dv1 = np.zeros(n)
            for k in range(len(series), 0, -1):  # Clenshaw's recurrence
                a, b = series[k - 1]
                u, u1 = 2.0 * c * u + (a - u1), u
                v, v1 = 2.0 * c * v + (b - v1), v
                if slopes:
                    du, du1 = 2.0 * c * du + (k * b - du1), du
                    dv, dv1 = 2.0 * c * dv + (k * a - dv1), dv
            f[:, i] += u * c - u1 + v * s
            if slopes:
                J[:, i, i] += du * c - du1 - dv * s
        for i, cycles, cosine, sine in self.WAVES:
            c, s = np.cos(cycles * q[:, i]), np.sin(cycles * q[:, i])
            f[:, i] += cosine * c + sine * s
            if slopes:
                J[:, i, i] += cycles * (sine * c - cosine * s)
        for coefficient, phase, joints, to in self.BENDS:
            x = q[:, list(joints)].sum(axis=1) + phase
            f[:, list(to)] += coefficient * np.sin(x)[:, None]
            if slopes:
                J[np.ix_(range(n), to, joints)] += coefficient * np.cos(x)[:, None, None]
        if self.LEVERS or any(self.COMPLIANCE):
            self._weights(q, kg, payload_at, f, J)
        f += added
        if moves is not None:
            self._history(moves, f, J)
        return f, J

    def _weights(self, q: Array, kg: Array, payload_at: Array, f: Array, J: Any) -> None:
        """Gravity by levers, and the payload, both at the nominal attitudes of the links."""
        n = len(q)
        R, o, tip_R, p = self._walk(self.NOMINAL, q)
        g = np.array(self.GRAVITY)
        z = R[..., 2]
        turning = np.where(np.array(self.SLIDES)[:, None, None], 0.0, z)
        for joint, to, vectors in self.LEVERS:
            sums = np.zeros((self.JOINTS + 1, n, 3))  # of the vectors of a link and those behind it
            for link, vector in vectors:
                sums[: link + 1] += R[link] @ np.array(vector)
            f[:, list(to)] += _dot(np.cross(sums[0], g), z[joint])[:, None]
            if J is not None:
                torque, gz = np.cross(sums[0], g), np.cross(g, z[joint])
                for i in range(self.JOINTS):
                    by = _dot(np.cross(turning[i], sums[i]), gz)
                    if i < joint:
                        by = by + _dot(np.cross(turning[i], z[joint]), torque)
                    J[:, list(to), i] += by[:, None]
        if any(self.COMPLIANCE):
            p = p + np.einsum("nij,nj->ni", tip_R, payload_at)
            for j in range(self.JOINTS):
                arm, gz = p - o[j], np.cross(g, z[j])
                f[:, j] += self.COMPLIANCE[j] * kg * _dot(arm, gz)
                if J is not None:
                    torque = np.cross(arm, g)
                    for i in range(self.JOINTS):
                        moved = np.cross(turning[i], arm if i < j else p - o[i])
                        if self.SLIDES[i] and i >= j:
                            moved = moved + z[i]
                        by = _dot(moved, gz)
                        if i < j:
                            by = by + _dot(np.cross(turning[i], z[j]), torque)
                        J[:, j, i] += self.COMPLIANCE[j] * kg * by

    def _history(self, moves: Array, f: Array, J: Any) -> None:
        """What the last move does; nothing where it is not known."""
        has_move = np.isfinite(moves[:, :1])
        moves = np.where(has_move, moves, 0.0)
        rows, every = np.arange(len(moves)), range(self.JOINTS)
        top = np.abs(moves).argmax(axis=1)
        signed = moves[rows, top]
        size = np.where(signed == 0.0, np.inf, np.abs(signed))
        side = np.tanh(moves / np.array(self.WIDTH))
        f += (
            np.array(self.DIRECTION) * side + np.array(self.MOVE) * moves + np.array(self.SHARE) * moves / size[:, None]
        )
        if J is not None:
            diagonal = np.array(self.DIRECTION) * (1.0 - side**2) / np.array(self.WIDTH) + np.array(self.MOVE)
            J[:, every, every] += has_move * diagonal + np.array(self.SHARE) / size[:, None]
            for j in every:
                J[rows, j, top] -= self.SHARE[j] * moves[:, j] * np.sign(signed) / size**2

    def effective(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Effective joints, the joints of calibrated.urdf, for commanded ones, (n, joints)."""
        situation = self._situation(q, previous, **inputs)
        return situation[0] + self._shift(*situation, False)[0]

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Derivative of the effective by the commanded joints, (n, joints, joints)."""
        return np.eye(self.JOINTS) + self._shift(*self._situation(q, previous, **inputs), True)[1]

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
        return _poses(*self._walk(self.CHAIN, np.atleast_2d(np.asarray(theta, dtype=float)))[2:])

    def forward(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """The tip in the base for commanded joints, (n, 4, 4)."""
        return self.forward_effective(self.effective(q, previous, **inputs))

    def forward_nominal(self, q: ArrayLike) -> Array:
        """The tip of the nominal robot, (n, 4, 4): what a program that was written for it wants."""
        return _poses(*self._walk(self.NOMINAL, np.atleast_2d(np.asarray(q, dtype=float)))[2:])

    def _geometric(self, theta: Array) -> tuple[Array, Array, Array]:
        R, o, tip_R, p = self._walk(self.CHAIN, theta)
        z, slides = R[..., 2], np.array(self.SLIDES)[:, None, None]
        J = np.concatenate([np.where(slides, z, np.cross(z, p - o)), np.where(slides, 0.0, z)], axis=2)
        return tip_R, p, J.transpose(1, 2, 0)

    def tip_jacobian(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: Any) -> Array:
        """Derivative of the tip's place and rotation in the base by the commanded joints, (n, 6, joints)."""
        situation = self._situation(q, previous, **inputs)
        f, J = self._shift(*situation, True)
        return self._geometric(situation[0] + f)[2] @ (np.eye(self.JOINTS) + J)

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
