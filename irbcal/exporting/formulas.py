"""A calibrated robot by its formulas, which take numbers of any kind: floats, arrays of numpy, symbols of CasADi.

One pose at a time (`Plain`), joints are lists of floats and poses three rows of four numbers (rotation and place); of
many (`Batch`) they are arrays with a row for each of n poses, (n, 4, 4). Radians, metres, kilograms; joints are those
of the URDF, in the order of JOINT_NAMES.

    effective(q)       joints of calibrated.urdf for commanded joints
    jacobian(q)        their derivative, the stop before held
    commanded(theta)   the way back
    forward(q)         TIP_LINK in BASE_LINK
    tip_jacobian(q)    its derivative: linear above angular, in the base
    inverse(T, seed)   commanded joints of poses, from seeds; None, or not converged, where there are none
    check()            by how much the test vectors are missed (< 1e-12)

All take the stop before as ``previous`` (None or rows of nan: not known), and by their names ``payload_kg``,
``payload_centre`` in the tip link, and what is read beside the joints (PROPORTIONAL): ``torques``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from math import isfinite
from types import SimpleNamespace
from typing import Any

Floats = Sequence[Any]
"""Numbers; arrays of numpy and symbols of CasADi may stand for them."""


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


class Formulas(SimpleNamespace):
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
        previous: Any = None,
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
        self._check_names(readings)
        of_joints = {
            name: value if hasattr(value, "__len__") else [value] * self.JOINTS
            for name, value in readings.items()
            if value is not None
        }
        return moves, kg, self.PAYLOAD_CENTRE if payload_centre is None else payload_centre, of_joints

    def _check_names(self, readings: Mapping[str, Any]) -> None:
        for name in readings:
            if name not in self.PROPORTIONAL:
                known = ("payload_kg", "payload_centre", *self.PROPORTIONAL)
                raise TypeError(f"unknown input {name!r}: there are {', '.join(known)}")

    def effective(self, q: Floats, previous: Any = None, **inputs: Any) -> Any:
        """Effective joints, the joints of calibrated.urdf, for commanded ones."""
        f = self._shift(q, *self._situation(q, previous, **inputs))
        return [a + b for a, b in zip(q, f, strict=True)]

    def jacobian(self, q: Floats, previous: Any = None, **inputs: Any) -> Any:
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
            self._move_slopes(J, moves)
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

    def _move_slopes(self, J: list[list[Any]], moves: Floats) -> None:
        """Derivatives of what the last move does."""
        top = max(range(self.JOINTS), key=lambda i: abs(moves[i]))
        size, sign = abs(moves[top]), 1.0 if moves[top] > 0.0 else -1.0
        for j in range(self.JOINTS):
            side = self.functions.tanh(moves[j] / self.WIDTH[j])
            J[j][j] += self.DIRECTION[j] * (1.0 - side * side) / self.WIDTH[j] + self.MOVE[j]
            if size:
                J[j][j] += self.SHARE[j] / size
                J[j][top] -= self.SHARE[j] * moves[j] * sign / (size * size)

    def forward_effective(self, theta: Floats) -> Any:
        """The tip in the base for joints of calibrated.urdf."""
        return _rows(*self._tip(self.CHAIN, *self._walk(self.CHAIN, theta, self._trigonometry(theta))))

    def forward(self, q: Any, previous: Any = None, **inputs: Any) -> Any:
        """The tip in the base for commanded joints."""
        return self.forward_effective(self.effective(q, previous, **inputs))

    def forward_nominal(self, q: Floats) -> Any:
        """The tip of the nominal robot: what a program that was written for it wants."""
        return _rows(*self._tip(self.NOMINAL, *self._walk(self.NOMINAL, q, self._trigonometry(q))))

    def _geometric(self, theta: Floats) -> tuple[Any, Any, Any]:
        """Columns and place of the tip, and its derivative by each effective joint."""
        attitudes, origins = self._walk(self.CHAIN, theta, self._trigonometry(theta))
        R, p = self._tip(self.CHAIN, attitudes, origins)
        columns: list[Floats] = []
        for (_, _, z), o, slides in zip(attitudes, origins, self.SLIDES, strict=True):
            columns.append((*z, 0.0, 0.0, 0.0) if slides else (*_cross(z, _minus(p, o)), *z))
        return R, p, columns

    def tip_jacobian(self, q: Floats, previous: Any = None, **inputs: Any) -> Any:
        """Derivative of the tip's place and rotation in the base by the commanded joints, six rows."""
        columns = self._geometric(self.effective(q, previous, **inputs))[2]
        J = self.jacobian(q, previous, **inputs)
        return [
            [sum(columns[k][r] * J[k][j] for k in range(self.JOINTS)) for j in range(self.JOINTS)] for r in range(6)
        ]
