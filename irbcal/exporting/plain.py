"""A calibrated robot on plain floats: nothing but Python itself.

One pose at a time, joints as lists of floats, poses as three rows of four numbers (rotation and place); `check` says by
how much the test vectors are missed (< 1e-12). Radians, metres, kilograms; joints are those of the URDF, in the order
of JOINT_NAMES.

    effective(q)       joints of calibrated.urdf for commanded joints
    jacobian(q)        their derivative, the stop before held
    commanded(theta)   the way back
    forward(q)         TIP_LINK in BASE_LINK
    tip_jacobian(q)    its derivative: linear above angular, in the base
    inverse(T, seed)   commanded joints of a pose from a seed, or None

All take the stop before as ``previous`` (None: not known), and by their names ``payload_kg``, ``payload_centre`` in the
tip link, and what is read beside the joints (PROPORTIONAL): ``torques`` that the robot reports.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from math import atan2, inf, isfinite, sqrt
from types import SimpleNamespace
from typing import Any

Floats = Sequence[Any]
"""Numbers; symbols of CasADi may stand for them."""


def _dot(a: Floats, b: Floats) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Floats, b: Floats) -> Floats:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _minus(a: Floats, b: Floats) -> Floats:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _step(R: Floats, o: Floats, C: Floats, p: Floats) -> tuple[Floats, Floats]:
    """A constant frame in a moving one; attitudes are held as their three columns."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    a, b, c = p
    o = (o[0] + a * xx + b * yx + c * zx, o[1] + a * xy + b * yy + c * zy, o[2] + a * xz + b * yz + c * zz)
    columns = []
    for a, b, c in zip(*C, strict=True):
        columns.append((a * xx + b * yx + c * zx, a * xy + b * yy + c * zy, a * xz + b * yz + c * zz))
    return columns, o


def _rows(R: Floats, p: Floats) -> list[list[float]]:
    return [[R[0][i], R[1][i], R[2][i], p[i]] for i in range(3)]


class Plain(SimpleNamespace):
    """The robot, made of the constants that an export has, by their names: `irbcal.exporting.python.constants`."""

    functions: Any = math

    def _walk(self, chain: Mapping[str, Any], q: Floats, trigonometry: Floats) -> tuple[list[Any], list[Any]]:
        """Attitudes and origins of the links."""
        R: Floats = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        o: Floats = (0.0, 0.0, 0.0)
        attitudes, origins = [], []
        for i in range(self.JOINTS):
            R, o = _step(R, o, chain["R"][i], chain["p"][i])
            x, y, z = R
            if self.SLIDES[i]:
                o = (o[0] + q[i] * z[0], o[1] + q[i] * z[1], o[2] + q[i] * z[2])
            else:
                c, s = trigonometry[i]
                R = (
                    (c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2]),
                    (c * y[0] - s * x[0], c * y[1] - s * x[1], c * y[2] - s * x[2]),
                    z,
                )
            attitudes.append(R)
            origins.append(o)
        return attitudes, origins

    def _trigonometry(self, q: Floats) -> list[tuple[Any, Any]]:
        return [(self.functions.cos(x), self.functions.sin(x)) for x in q]

    def _tip(self, chain: Mapping[str, Any], attitudes: Floats, origins: Floats) -> tuple[Floats, Floats]:
        return _step(attitudes[-1], origins[-1], chain["tip_R"], chain["tip_p"])

    def _shift(
        self,
        q: Floats,
        moves: Floats | None,
        kg: Any,
        centre: Floats,
        readings: Mapping[str, Floats],
        size: Any | None = None,
    ) -> list[Any]:
        """What effective joints are more than commanded ones; size: the largest part of the move unless given."""
        trigonometry = self._trigonometry(q)
        f = [offset + gain * x for offset, gain, x in zip(self.OFFSET, self.GAIN, q, strict=True)]
        for i, series in enumerate(self.SERIES):
            if not series:
                continue
            c, s = trigonometry[i]
            twice = 2.0 * c
            u = u1 = v = v1 = 0.0
            for a, b in reversed(series):  # Clenshaw's recurrence
                u, u1 = twice * u + (a - u1), u
                v, v1 = twice * v + (b - v1), v
            f[i] += u * c - u1 + v * s
        for i, cycles, cosine, sine in self.WAVES:
            f[i] += cosine * self.functions.cos(cycles * q[i]) + sine * self.functions.sin(cycles * q[i])
        for coefficient, phase, joints, to in self.BENDS:
            value = coefficient * self.functions.sin(sum(q[i] for i in joints) + phase)
            for t in to:
                f[t] += value
        if self.LEVERS or any(self.COMPLIANCE):
            attitudes, origins = self._walk(self.NOMINAL, q, trigonometry)
            for joint, to, vectors in self.LEVERS:
                gz = _cross(self.GRAVITY, attitudes[joint][2])
                value = 0.0
                for link, (a, b, c) in vectors:
                    x, y, z = attitudes[link]
                    value += a * _dot(x, gz) + b * _dot(y, gz) + c * _dot(z, gz)
                for t in to:
                    f[t] += value
            if any(self.COMPLIANCE):
                R, p = self._tip(self.NOMINAL, attitudes, origins)
                p = _step(R, p, R, centre)[1]
                for j, compliance in enumerate(self.COMPLIANCE):
                    if compliance:
                        gz = _cross(self.GRAVITY, attitudes[j][2])
                        f[j] += compliance * kg * _dot(_minus(p, origins[j]), gz)
        for name, values in readings.items():
            usual, coefficients, _ = self.PROPORTIONAL[name]
            for j, (coefficient, value) in enumerate(zip(coefficients, values, strict=True)):
                f[j] += coefficient * (value - usual)
        if moves is not None:
            size = self._size(moves) if size is None else size
            for j in range(self.JOINTS):
                if self.DIRECTION[j]:
                    f[j] += self.DIRECTION[j] * self.functions.tanh(moves[j] / self.WIDTH[j])
                f[j] += self.MOVE[j] * moves[j] + self.SHARE[j] * moves[j] / size
        return f

    def _size(self, moves: Floats) -> Any:
        """The largest move; one where nothing moves."""
        largest = max(abs(move) for move in moves)
        return largest + (largest == 0.0)

    def _situation(
        self,
        q: Floats,
        previous: Floats | None = None,
        payload_kg: float | None = None,
        payload_centre: Floats | None = None,
        **readings: Any,
    ) -> tuple[Floats | None, Any, Floats, Mapping[str, Floats]]:
        if len(q) != self.JOINTS:
            raise ValueError(f"expected {self.JOINTS} joints, found {len(q)}")
        moves = None
        if previous is not None and self.HAS_HISTORY and all(isfinite(x) for x in previous):
            moves = [a - b for a, b in zip(q, previous, strict=True)]
        kg = self.PAYLOAD_KG if payload_kg is None or not isfinite(payload_kg) else payload_kg
        for name in readings:
            if name not in self.PROPORTIONAL:
                known = ("payload_kg", "payload_centre", *self.PROPORTIONAL)
                raise TypeError(f"unknown input {name!r}: there are {', '.join(known)}")
        of_joints = {
            name: value if hasattr(value, "__len__") else [value] * self.JOINTS
            for name, value in readings.items()
            if value is not None
        }
        return moves, kg, self.PAYLOAD_CENTRE if payload_centre is None else payload_centre, of_joints

    def effective(self, q: Floats, previous: Floats | None = None, **inputs: Any) -> list[float]:
        """Effective joints, the joints of calibrated.urdf, for commanded ones."""
        f = self._shift(q, *self._situation(q, previous, **inputs))
        return [a + b for a, b in zip(q, f, strict=True)]

    def jacobian(self, q: Floats, previous: Floats | None = None, **inputs: Any) -> list[list[float]]:
        """Derivative of the effective by the commanded joints, row by row."""
        moves, kg, centre, _ = self._situation(q, previous, **inputs)
        J = [[(1.0 + self.GAIN[i]) * (i == j) for j in range(self.JOINTS)] for i in range(self.JOINTS)]
        trigonometry = self._trigonometry(q)
        for i, series in enumerate(self.SERIES):
            c, s = trigonometry[i]
            u = u1 = v = v1 = 0.0
            for k in range(len(series), 0, -1):
                a, b = series[k - 1]
                u, u1 = 2.0 * c * u + (k * b - u1), u
                v, v1 = 2.0 * c * v + (k * a - v1), v
            J[i][i] += u * c - u1 - v * s
        for i, cycles, cosine, sine in self.WAVES:
            J[i][i] += cycles * (sine * self.functions.cos(cycles * q[i]) - cosine * self.functions.sin(cycles * q[i]))
        for coefficient, phase, joints, to in self.BENDS:
            rate = coefficient * self.functions.cos(sum(q[i] for i in joints) + phase)
            for t in to:
                for i in joints:
                    J[t][i] += rate
        if self.LEVERS or any(self.COMPLIANCE):
            self._weight_slopes(J, *self._walk(self.NOMINAL, q, trigonometry), kg, centre)
        if moves is not None:
            top = max(range(self.JOINTS), key=lambda i: abs(moves[i]))
            size, sign = abs(moves[top]), 1.0 if moves[top] > 0.0 else -1.0
            for j in range(self.JOINTS):
                side = self.functions.tanh(moves[j] / self.WIDTH[j])
                J[j][j] += self.DIRECTION[j] * (1.0 - side * side) / self.WIDTH[j] + self.MOVE[j]
                if size:
                    J[j][j] += self.SHARE[j] / size
                    J[j][top] -= self.SHARE[j] * moves[j] * sign / (size * size)
        return J

    def _weight_slopes(self, J: list[list[float]], attitudes: Floats, origins: Floats, kg: Any, centre: Floats) -> None:
        """Derivatives of gravity's levers and of the payload."""
        turning = [(0.0, 0.0, 0.0) if slides else R[2] for slides, R in zip(self.SLIDES, attitudes, strict=True)]
        for joint, to, vectors in self.LEVERS:
            z = attitudes[joint][2]
            gz, sums = _cross(self.GRAVITY, z), [(0.0, 0.0, 0.0)] * self.JOINTS
            for link, vector in vectors:
                v = _step(attitudes[link], (0.0, 0.0, 0.0), attitudes[link], vector)[1]
                for i in range(link + 1):
                    sums[i] = (sums[i][0] + v[0], sums[i][1] + v[1], sums[i][2] + v[2])
            torque = _cross(sums[0], self.GRAVITY)
            for i in range(self.JOINTS):
                by = _dot(_cross(turning[i], sums[i]), gz)
                if i < joint:
                    by += _dot(_cross(turning[i], z), torque)
                for t in to:
                    J[t][i] += by
        if any(self.COMPLIANCE):
            R, p = self._tip(self.NOMINAL, attitudes, origins)
            p = _step(R, p, R, centre)[1]
            for j, compliance in enumerate(self.COMPLIANCE):
                z, arm = attitudes[j][2], _minus(p, origins[j])
                gz, torque = _cross(self.GRAVITY, z), _cross(arm, self.GRAVITY)
                for i in range(self.JOINTS):
                    by = _dot(_cross(turning[i], arm if i < j else _minus(p, origins[i])), gz)
                    if i < j:
                        by += _dot(_cross(turning[i], z), torque)
                    elif self.SLIDES[i]:
                        by += _dot(attitudes[i][2], gz)
                    J[j][i] += compliance * kg * by

    def _settle(self, theta: Floats, q: Floats, shift: Callable[[Floats], Floats]) -> list[float] | None:
        """Solve q + shift(q) = theta joint by joint, with the slope of the last two steps; None where that fails."""
        last: Floats = ()
        steps: list[float] = []
        for turn in range(60):
            f = shift(q)
            following = []
            for i in range(self.JOINTS):
                miss = theta[i] - f[i] - q[i]
                slope = (f[i] - last[i]) / steps[i] if turn and abs(steps[i]) > 1e-9 else 0.0
                following.append(miss / (1.0 + slope) if abs(slope) < 0.3 else miss)
            steps, last = following, f
            q = [a + b for a, b in zip(q, steps, strict=True)]
            change = max(abs(x) for x in steps)
            if not isfinite(sum(steps)):
                return None
            if change < 1e-12:  # steps shrink at least tenfold: what is left is rounding
                return q
        return None

    def commanded(
        self, theta: Floats, previous: Floats | None = None, start: Floats | None = None, **inputs: Any
    ) -> list[float] | None:
        """Commanded joints that give effective ones; None where that does not converge."""

        def shift(q: Floats) -> Floats:
            return self._shift(q, *self._situation(q, previous, **inputs))

        return self._settle(theta, list(theta if start is None else start), shift)

    def lean(self, moves: Floats, step: Floats) -> list[float]:
        """The side that joints lean to after one step more on a way: moves of a few widths, drawn behind the arm."""
        moves = [a + b for a, b in zip(moves, step, strict=True)]
        full = max(abs(a) / b for a, b in zip(moves, self.STRIDE, strict=True))
        return [a / full for a in moves] if full > 1.0 else moves

    def commanded_moving(
        self,
        theta: Floats,
        moves: Floats,
        start: Floats,
        **inputs: Any,
    ) -> list[float] | None:
        """Commanded joints on a way, where the arm leans to a side (`lean`); None where that does not converge."""
        situation = self._situation(start, **inputs)[1:]
        largest = max(abs(a) for a in moves)
        if not self.HAS_HISTORY or largest == 0.0:
            return self._settle(theta, list(start), lambda q: self._shift(q, None, *situation))
        full = max(abs(a) / b for a, b in zip(moves, self.STRIDE, strict=True))
        return self._settle(theta, list(start), lambda q: self._shift(q, moves, *situation, largest / full))

    def forward_effective(self, theta: Floats) -> list[list[float]]:
        """The tip in the base for joints of calibrated.urdf."""
        return _rows(*self._tip(self.CHAIN, *self._walk(self.CHAIN, theta, self._trigonometry(theta))))

    def forward(self, q: Floats, previous: Floats | None = None, **inputs: Any) -> list[list[float]]:
        """The tip in the base for commanded joints."""
        return self.forward_effective(self.effective(q, previous, **inputs))

    def forward_nominal(self, q: Floats) -> list[list[float]]:
        """The tip of the nominal robot: what a program that was written for it wants."""
        return _rows(*self._tip(self.NOMINAL, *self._walk(self.NOMINAL, q, self._trigonometry(q))))

    def _geometric(self, theta: Floats) -> tuple[Floats, Floats, list[Floats]]:
        """Columns and place of the tip, and its derivative by each effective joint."""
        attitudes, origins = self._walk(self.CHAIN, theta, self._trigonometry(theta))
        R, p = self._tip(self.CHAIN, attitudes, origins)
        columns: list[Floats] = []
        for (_, _, z), o, slides in zip(attitudes, origins, self.SLIDES, strict=True):
            columns.append((*z, 0.0, 0.0, 0.0) if slides else (*_cross(z, _minus(p, o)), *z))
        return R, p, columns

    def tip_jacobian(self, q: Floats, previous: Floats | None = None, **inputs: Any) -> list[list[float]]:
        """Derivative of the tip's place and rotation in the base by the commanded joints, six rows."""
        columns = self._geometric(self.effective(q, previous, **inputs))[2]
        J = self.jacobian(q, previous, **inputs)
        return [
            [sum(columns[k][r] * J[k][j] for k in range(self.JOINTS)) for j in range(self.JOINTS)] for r in range(6)
        ]

    def inverse_effective(self, T: Floats, seed: Floats, tolerance: float = 1e-12) -> list[float] | None:
        """Effective joints of a pose from a seed by damped Newton steps, or None."""
        theta, position, rotation = self.nearest_effective(T, seed, tolerance)
        return theta if position <= tolerance and rotation <= tolerance else None

    def nearest_effective(
        self, T: Floats, seed: Floats, tolerance: float, lower: Floats | None = None, upper: Floats | None = None
    ) -> tuple[list[float], float, float]:
        """Effective joints as near to a pose as damped Newton steps come, within bounds; place and rotation left."""
        best, damping, waited, bound = inf, 1e-6, 0, inf
        lower = [-inf] * self.JOINTS if lower is None else lower
        upper = [inf] * self.JOINTS if upper is None else upper
        theta = trial = [min(max(x, low), high) for x, low, high in zip(seed, lower, upper, strict=True)]
        remaining = (inf, inf)
        columns: list[Floats] = []
        e: Floats = ()
        for _ in range(60):
            R, p, jacobian = self._geometric(trial)
            E = [[sum(T[i][k] * R[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
            w = (0.5 * (E[2][1] - E[1][2]), 0.5 * (E[0][2] - E[2][0]), 0.5 * (E[1][0] - E[0][1]))
            s = sqrt(_dot(w, w))
            size = atan2(s, 0.5 * (E[0][0] + E[1][1] + E[2][2] - 1.0)) / s if s > 1e-7 else 1.0
            lack = (*((T[i][3] - p[i]) / self.REACH for i in range(3)), *(size * x for x in w))
            position, rotation = _dot(lack[:3], lack[:3]), _dot(lack[3:], lack[3:])
            cost = position + rotation
            if not cost < inf:
                break
            if cost < best:
                best, theta, e = cost, trial, lack
                remaining = sqrt(position) * self.REACH, sqrt(rotation)
                if max(remaining) <= tolerance:
                    break
                damping = max(damping * 0.2, 1e-8)
                columns = [(a / self.REACH, b / self.REACH, c / self.REACH, d, e_, f) for a, b, c, d, e_, f in jacobian]
                for i, column in enumerate(columns):  # a joint at a bound that less error would lead beyond it
                    slope = sum(x * y for x, y in zip(column, e, strict=True))
                    if (theta[i] <= lower[i] and slope < 0.0) or (theta[i] >= upper[i] and slope > 0.0):
                        columns[i] = (0.0,) * 6
            else:
                damping = damping * 8.0 + 1e-6
            if best <= 0.25 * bound:
                bound, waited = best, 0
            else:
                waited += 1
                if waited > 10:
                    break
            step = self._damped(columns, e, damping * min(sqrt(best), 1.0) + 1e-15)
            longest = max(0.5, max(abs(x) for x in step))
            trial = [
                min(max(a + b * 0.5 / longest, low), high)
                for a, b, low, high in zip(theta, step, lower, upper, strict=True)
            ]
        return theta, *remaining

    def _damped(self, columns: Floats, e: Floats, damping: float) -> list[float]:
        """A damped least-squares step, by Cholesky's factors of the smaller one of the two normal equations."""
        wide = self.JOINTS > 6
        rows = [[column[r] for column in columns] for r in range(6)] if wide else columns
        m = len(rows)
        A = [[sum(x * y for x, y in zip(rows[i], rows[j], strict=True)) for j in range(i + 1)] for i in range(m)]
        b = list(e) if wide else [sum(x * y for x, y in zip(row, e, strict=True)) for row in rows]
        for i in range(m):
            row = A[i]
            row[i] += damping
            for j in range(i):
                row_j = A[j]
                row[j] = (row[j] - sum(row[k] * row_j[k] for k in range(j))) * row_j[j]
                b[i] -= row[j] * b[j]
            row[i] = 1.0 / sqrt(max(row[i] - sum(row[k] * row[k] for k in range(i)), 1e-30))
            b[i] *= row[i]
        for i in range(m - 1, -1, -1):
            for k in range(i + 1, m):
                b[i] -= A[k][i] * b[k]
            b[i] *= A[i][i]
        return [sum(x * y for x, y in zip(column, b, strict=True)) for column in columns] if wide else b

    def inverse(
        self,
        T: Floats,
        seed: Floats,
        previous: Floats | None = None,
        tolerance: float = 1e-12,
        **inputs: Any,
    ) -> list[float] | None:
        """Commanded joints of a pose from a seed, or None; limits are not regarded."""
        begin = self.effective(seed, previous, **inputs)
        theta = self.inverse_effective(T, begin, tolerance)
        if theta is None:
            return None
        start = [a + b - c for a, b, c in zip(seed, theta, begin, strict=True)]
        return self.commanded(theta, previous, start, **inputs)

    def check(self) -> float:
        """The largest difference from the test vectors, radians or metres; infinite where the way back is not found."""
        worst = 0.0
        for k, q in enumerate(self.TESTS["q"]):
            theta, tip = self.TESTS["effective"][k], self.TESTS["tip"][k]
            inputs = {name: values[k] for name, values in self.TESTS["inputs"].items()}
            effective, T = self.effective(q, **inputs), self.forward(q, **inputs)
            commanded = self.commanded(effective, **inputs)
            if commanded is None:
                return inf
            pairs = [
                *zip(effective, theta, strict=True),
                *zip(commanded, q, strict=False),
                *((T[i][j], tip[i][j]) for i in range(3) for j in range(4)),
            ]
            worst = max(worst, *(abs(a - b) for a, b in pairs))
        return worst
