"""Trajectories: joints over time, with speeds and accelerations, and what lies between their points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked, lock
from irbcal.errors import RobotError
from irbcal.summary import Paragraph, Result
from irbcal.units import joint_unit

if TYPE_CHECKING:
    import pandas as pd
    from scipy.interpolate import PPoly

PIECES = 16
"""Samples between two points of a trajectory."""


@dataclass(frozen=True, eq=False)
class ReversalOffset(Locked):
    """What the last moves along a trajectory add to the effective joints, see `irbcal.modeling.moves_along`."""

    lean: FloatArray
    rate: FloatArray
    second: FloatArray
    """Shape (n, joints). Radians (metres for prismatic joints), and its first and second derivatives by time."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result):
    """Joints over time: commands, or the configurations of a planner.

    Between its points it is what a ROS joint trajectory controller makes of them: quintic where accelerations are
    given, cubic where speeds are, and a cubic spline through the positions where they stand alone.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds, growing.
    q : array_like, shape (n, joints)
        Radians (metres for prismatic joints).
    dq, ddq : array_like, shape (n, joints), optional
        Speeds and accelerations; accelerations with speeds only.
    names : tuple of str
        Of the joints.
    prismatic : array_like of bool, shape (joints,), optional
        None is, unless told.
    lean : ReversalOffset, optional
        What its last moves do, worked out before; commands and configurations of one motion share it.

    Raises
    ------
    RobotError
        If numbers are missing, not finite or of another shape, or the times do not grow.
    """

    times: FloatArray
    q: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    names: tuple[str, ...] = ()
    prismatic: BoolArray | None = None
    lean: ReversalOffset | None = None

    def __post_init__(self) -> None:
        times, q = np.asarray(self.times, dtype=float), np.asarray(self.q, dtype=float)
        if times.ndim != 1 or q.ndim != 2 or len(q) != len(times) or not len(times):
            raise RobotError(f"a trajectory needs times (n,) and joints (n, joints), found {times.shape} and {q.shape}")
        if self.ddq is not None and self.dq is None:
            raise RobotError("a trajectory with accelerations needs speeds, too")
        arrays: dict[str, FloatArray | None] = {"times": times, "q": q}
        for name in ("dq", "ddq"):
            value = getattr(self, name)
            arrays[name] = None if value is None else np.asarray(value, dtype=float)
        for name, value in arrays.items():
            if value is None:
                continue
            if name != "times" and value.shape != q.shape:
                raise RobotError(f"a trajectory's {name} needs shape {q.shape}, found {value.shape}", parameter=name)
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0][0])
                raise RobotError(f"point {row + 1} of the trajectory has no finite number for {name}", parameter=name)
            object.__setattr__(self, name, value)
        if (still := np.flatnonzero(np.diff(times) <= 0.0)).size:
            k = int(still[0])
            message = f"times of a trajectory grow, but point {k + 2} is at {times[k + 1]:g} s after {times[k]:g} s"
            raise RobotError(message, parameter="times")
        names = tuple(self.names) or tuple(f"joint_{k + 1}" for k in range(q.shape[1]))
        slides = np.zeros(q.shape[1], dtype=bool) if self.prismatic is None else np.asarray(self.prismatic, dtype=bool)
        if len(names) != q.shape[1] or len(slides) != q.shape[1]:
            raise RobotError(f"a trajectory of {q.shape[1]} joints needs as many names, found {', '.join(names)}")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "prismatic", slides)
        lock(self)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def slides(self) -> BoolArray:
        """Which joints are prismatic, shape (joints,)."""
        assert self.prismatic is not None  # __post_init__ sees to that
        return self.prismatic

    @property
    def units(self) -> FloatArray:
        """SI value of one unit of each joint in files: a degree, a millimetre."""
        return np.array([joint_unit(slides)[1] for slides in self.slides])

    @property
    def columns(self) -> list[str]:
        """Columns of the joints in files: ``q1_deg`` and so on, ``q1_mm`` of a prismatic joint."""
        return [f"q{k}_{joint_unit(slides)[0]}" for k, slides in enumerate(self.slides, start=1)]

    @cached_property
    def pieces(self) -> PPoly:
        """Piecewise polynomials through the points, by time; of one point a constant."""
        from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

        if len(self) == 1:
            return PPoly(self.q[None], np.r_[self.times, self.times + 1.0])
        if self.dq is None:
            return CubicSpline(self.times, self.q)
        if self.ddq is None:
            return CubicHermiteSpline(self.times, self.q, self.dq)
        return PPoly(_quintic(self.times, self.q, self.dq, self.ddq), self.times)

    def at(self, times: ArrayLike) -> Trajectory:
        """The trajectory at other times, with speeds and accelerations; its last moves are left out.

        Parameters
        ----------
        times : array_like, shape (m,)
            Between the first and the last.
        """
        t = np.asarray(times, dtype=float)
        outside = t[(t < self.times[0]) | (t > self.times[-1])]
        if len(outside):
            message = f"the trajectory lasts from {self.times[0]:g} s to {self.times[-1]:g} s, found {outside[0]:g} s"
            raise RobotError(message, parameter="times")
        p = self.pieces
        return replace(self, times=t, q=p(t), dq=p(t, 1), ddq=p(t, 2), lean=None)

    def with_derivatives(self) -> Trajectory:
        """The same points with the speeds and accelerations that are missing."""
        if self.ddq is not None:
            return self
        p, t = self.pieces, self.times
        return replace(self, dq=p(t, 1) if self.dq is None else self.dq, ddq=p(t, 2))

    def dense(self, pieces: int = PIECES) -> Trajectory:
        """The trajectory at its own times and at ``pieces - 1`` times between each two."""
        if len(self) == 1:
            return self.with_derivatives()
        return self.at(self.times_between(pieces))

    def times_between(self, pieces: int) -> FloatArray:
        """Its own times and ``pieces - 1`` between each two, shape ((n - 1) * pieces + 1,)."""
        between = np.linspace(self.times[:-1], self.times[1:], pieces, endpoint=False, axis=1)
        return np.append(between.ravel(), self.times[-1])

    def slowed(self, factor: float) -> Trajectory:
        """The same path, slower: all times after the first one are ``factor`` times as late.

        What depends on last moves stays as it is: they follow the path, not the time.
        """
        if not (np.isfinite(factor) and factor > 0.0):
            raise RobotError(f"factor: expected a number above zero, found {factor}", parameter="factor")
        lean = self.lean and ReversalOffset(self.lean.lean, self.lean.rate / factor, self.lean.second / factor**2)
        return replace(
            self,
            times=self.times[0] + factor * (self.times - self.times[0]),
            dq=None if self.dq is None else self.dq / factor,
            ddq=None if self.ddq is None else self.ddq / factor**2,
            lean=lean,
        )

    def in_order_of(self, names: Sequence[str]) -> Trajectory:
        """The trajectory with the joints of these names, in their order.

        Raises
        ------
        RobotError
            If one is missing.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise RobotError(f"the trajectory has no joint {missing[0]}: its joints are {', '.join(self.names)}")
        k = [self.names.index(name) for name in names]
        lean = self.lean and ReversalOffset(self.lean.lean[:, k], self.lean.rate[:, k], self.lean.second[:, k])
        dq, ddq = (None if v is None else v[:, k] for v in (self.dq, self.ddq))
        return Trajectory(self.times, self.q[:, k], dq, ddq, tuple(names), self.slides[k], lean)

    def to_frame(self) -> pd.DataFrame:
        """A row for each point: ``time_s``, joints ``q1_deg`` (``q1_mm``), speeds ``v1_deg_s``, and so on."""
        import pandas as pd

        out = {"time_s": self.times}
        for values, (letter, end) in zip((self.q, self.dq, self.ddq), ENDS, strict=True):
            if values is not None:
                columns = [f"{letter}{name[1:]}{end}" for name in self.columns]
                out |= dict(zip(columns, (values / self.units).T, strict=True))
        return pd.DataFrame(out)

    def report(self) -> Sequence[Paragraph]:
        """How many points in how many seconds, and what is known at them."""
        columns = (
            "positions"
            + (", speeds" if self.dq is not None else "")
            + (", accelerations" if self.ddq is not None else "")
        )
        lasts = f"{self.times[-1] - self.times[0]:g} s"
        return [f"trajectory of {len(self)} points in {lasts}: {columns} of {', '.join(self.names)}"]


ENDS = (("q", ""), ("v", "_s"), ("a", "_s2"))
"""Letters and endings of the columns of positions, speeds and accelerations."""


def _quintic(t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """Coefficients of the quintics between points, shape (6, n - 1, joints), highest power first."""
    h = np.diff(t)[:, None]
    p0, v0, a0 = q[:-1], dq[:-1], 0.5 * ddq[:-1]
    p, v, a = q[1:] - p0 - h * (v0 + h * a0), dq[1:] - v0 - 2.0 * h * a0, ddq[1:] - 2.0 * a0
    c3 = (10.0 * p - 4.0 * h * v + 0.5 * h**2 * a) / h**3
    c4 = (-15.0 * p + 7.0 * h * v - h**2 * a) / h**4
    c5 = (6.0 * p - 3.0 * h * v + 0.5 * h**2 * a) / h**5
    return np.array([c5, c4, c3, a0, v0, p0])
