"""A calibrated robot for one pose at a time, on plain floats: `irbcal.exporting.formulas` and nothing but Python."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, inf, isfinite, sqrt
from typing import Any

from irbcal.exporting.formulas import Floats, Formulas, _dot


class Plain(Formulas):
    """The robot for one pose at a time: its formulas on floats, and how they are inverted."""

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
