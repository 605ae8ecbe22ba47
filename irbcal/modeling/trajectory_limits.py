"""Limits of position, speed and acceleration along a trajectory: which joint passes which, when and by how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.trajectory import Trajectory
from irbcal.summary import Paragraph, Result

WITHIN = 1e-9
"""How far a limit may be passed, radians or metres, and their share of a speed or acceleration: rounding."""


class Exceeded(NamedTuple):
    """A limit that a joint passes along a trajectory, where it does so by most."""

    joint: str
    kind: str
    """``position``, ``speed`` or ``acceleration``."""
    time: float
    """Seconds."""
    value: float
    limit: float
    """SI units, with their sign."""
    start: float
    end: float
    """First and last time at which it is passed."""
    in_words: str


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the joints of an arm."""

    lower: FloatArray
    upper: FloatArray
    """Shape (joints,). Radians (metres for prismatic joints); infinite where there are none."""
    speed: FloatArray | None = None
    acceleration: FloatArray | None = None
    """Shape (joints,). Largest magnitudes; without limit unless given."""

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.lower))
        for name in ("lower", "upper", "speed", "acceleration"):
            values = getattr(self, name)
            if values is None:
                continue
            try:
                value = np.broadcast_to(np.asarray(values, dtype=float), (n,))
            except ValueError:
                raise RobotError(f"{name}: expected {n} limits, found {values!r}", parameter=name) from None
            if np.isnan(value).any() or (name in ("speed", "acceleration") and not (value > 0.0).all()):
                raise RobotError(f"{name}: expected {n} limits above zero, found {values!r}", parameter=name)
            object.__setattr__(self, name, value)
        lock(self)


@dataclass(frozen=True, eq=False, repr=False)
class TrajectoryLimitCheck(Result):
    """A trajectory, and the limits that it passes between its first and its last point."""

    trajectory: Trajectory
    exceeded: tuple[Exceeded, ...]
    """One for each joint and kind of limit; empty where all limits hold."""
    slower: float
    """By how much times must be stretched for speeds and accelerations to hold, 1 where they do. Positions stay."""

    @property
    def within(self) -> bool:
        """Whether all limits hold."""
        return not self.exceeded

    def in_time(self) -> Trajectory:
        """The trajectory, stretched in time so that speeds and accelerations hold.

        Raises
        ------
        RobotError
            If a position is beyond its limit: no time mends that.
        """
        for excess in self.exceeded:
            if excess.kind == "position":
                raise RobotError(f"{excess.in_words}: going slower does not help", parameter=excess.joint)
        return self.trajectory if self.slower == 1.0 else self.trajectory.slowed(self.slower)

    ROWS, COLUMNS = "exceeded", "joint kind time_s=time value limit start_s=start end_s=end in_words"

    def report(self) -> Sequence[Paragraph]:
        """The trajectory, each limit that is passed, and how much slower would hold them."""
        lines = [*self.trajectory.report()]
        if self.within:
            return [*lines, "all limits hold between its points, too"]
        lines += [excess.in_words for excess in self.exceeded]
        if self.slower > 1.0:
            lines.append(f"stretched in time by {self.slower:.4f} or more its speeds and accelerations hold")
        return lines


def check(trajectory: Trajectory, limits: Limits, largest: int = 2_000_000) -> TrajectoryLimitCheck:
    """Look for limits that are passed at the points of a trajectory and between them.

    Parameters
    ----------
    trajectory : Trajectory
    limits : Limits
    largest : int
        Numbers that are looked at, at most: fewer places between points where these are many.
    """
    pieces = int(np.clip(largest // max(trajectory.q.size, 1), 2, 32))
    d = trajectory.dense(pieces)
    assert d.dq is not None
    assert d.ddq is not None
    exceeded, slower = list[Exceeded](), 1.0
    for kind, values, lower, upper in (
        ("position", d.q, limits.lower, limits.upper),
        ("speed", d.dq, None, limits.speed),
        ("acceleration", d.ddq, None, limits.acceleration),
    ):
        if upper is None:
            continue
        lower = -upper if lower is None else lower
        slack = WITHIN * (1.0 if kind == "position" else np.where(np.isfinite(upper), upper, 1.0))
        beyond = np.maximum(values - upper, lower - values)
        for j in np.flatnonzero((beyond > slack).any(axis=0)):
            out = np.flatnonzero(beyond[:, j] > np.broadcast_to(slack, upper.shape)[j])
            k = int(np.argmax(beyond[:, j]))
            limit = float(upper[j] if values[k, j] > upper[j] else lower[j])
            when = d.times[k], float(values[k, j]), limit, d.times[out[0]], d.times[out[-1]]
            exceeded.append(_exceeded(trajectory, int(j), kind, *map(float, when)))
            if kind != "position":
                ratio = float(np.abs(values[:, j]).max() / upper[j])
                slower = max(slower, ratio if kind == "speed" else ratio**0.5)
    return TrajectoryLimitCheck(trajectory, tuple(exceeded), slower)


def _exceeded(
    trajectory: Trajectory, j: int, kind: str, time: float, value: float, limit: float, start: float, end: float
) -> Exceeded:
    unit = ("mm" if trajectory.slides[j] else "degrees") + {"position": "", "speed": "/s", "acceleration": "/s²"}[kind]
    size = float(trajectory.units[j])
    shown_value, limit_in_unit, by = value / size, limit / size, abs(value - limit) / size
    text = (
        f"{trajectory.names[j]} passes its limit of {kind} at {time:.4g} s: {shown_value:.6g} {unit}, {by:.3g} beyond "
        f"{limit_in_unit:.6g}"
    )
    return Exceeded(trajectory.names[j], kind, time, value, limit, start, end, text)


def limits_in_order(
    limits: ArrayLike | Mapping[str, float] | None, names: Sequence[str], parameter: str
) -> FloatArray | None:
    """Limits as an array, from one number for all joints, one for each, or a dict by their names."""
    if limits is None:
        return None
    if isinstance(limits, Mapping):
        missing = [name for name in names if name not in limits]
        if missing:
            raise RobotError(f"{parameter}: there is no limit for {missing[0]}", parameter=parameter)
        value: FloatArray = np.array([float(limits[name]) for name in names])
    else:
        value = np.asarray(limits, dtype=float)
    if value.shape not in ((), (len(names),)):
        raise RobotError(f"{parameter}: expected {len(names)} limits, found shape {value.shape}", parameter=parameter)
    return np.broadcast_to(value, (len(names),))
