"""Commands that follow targets within speed, acceleration and jerk limits, at any times.

Where a joint's targets keep the limits, its commands are the targets. Else it is moved, in short parts of constant
jerk, so that it comes to rest beside its moving target (braked about as quickly as the limits allow). So commands are
places of a smooth motion at the times of the lines: their divided differences do not exceed the limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt

GAP_S = 0.1
"""Seconds: after a longer pause an arm is taken to stand at its last command; the line counts for this time."""
SHORTEST_S = 1e-5
"""Seconds: after less, the last command is given again."""
PART_S = 1e-3
"""Seconds: the longest part of constant jerk."""
HALVINGS = 18
"""Of the range of jerks in the search of one."""
ROUNDING = 1e-6
"""Share of a limit left for rounding; room (radians, metres) left at the joint limits."""
SHARE = 0.5
"""Of the jerk: what braking beside a moving target counts on."""
PLANNED = 0.95
"""Of acceleration and jerk: what braking before a joint limit counts on; the rest makes up for whole parts."""
CLOSE_S = 6e-3
"""Seconds: the time constant with which the last of a distance is taken."""
LEAST_BRAKING = 0.1
"""Of the acceleration: what braking beside a moving target counts on where the target takes most of it."""


def stop(x: float, v: float, a: float, acceleration: float, jerk: float) -> float:
    """Where a joint at x with speed v and acceleration a comes to rest, braked as quickly as the limits allow."""
    side = 1.0 if v + 0.5 * a * abs(a) / jerk >= 0.0 else -1.0
    v, a = side * v, side * a
    top = max(v + 0.5 * a * a / jerk, 0.0)  # the speed with no acceleration on the same way
    distance = (
        top * sqrt(top / jerk)
        if top * jerk <= acceleration * acceleration
        else 0.5 * top * (top / acceleration + acceleration / jerk)
    )
    return x + side * (distance + v * a / jerk + a * a * a / (3.0 * jerk * jerk))


def derivatives(x: float, t: float, previous: Sequence[float], times: Sequence[float]) -> tuple[float, float, float]:
    """Three derivatives at time t of the cubic through x and what was before at three times, the last first."""
    first, second, third = t - times[0], t - times[1], t - times[2]
    d1, e1 = (x - previous[0]) / first, (previous[0] - previous[1]) / (times[0] - times[1])
    d2 = (d1 - e1) / second
    e2 = (e1 - (previous[1] - previous[2]) / (times[1] - times[2])) / (times[0] - times[2])
    d3 = (d2 - e2) / third
    return d1 + first * (d2 + second * d3), 2.0 * (d2 + (first + second) * d3), 6.0 * d3


class Joint:
    """One joint: its limits, where it is, its last three commands and targets.

    Parameters
    ----------
    x : float
        Where it stands, radians (sliding: metres).
    speed, acceleration, jerk : float
    lower, upper : float
    """

    def __init__(self, x: float, speed: float, acceleration: float, jerk: float, lower: float, upper: float) -> None:
        self.x, self.v, self.a = x, 0.0, 0.0
        self.speed, self.acceleration, self.jerk = ((1.0 - ROUNDING) * y for y in (speed, acceleration, jerk))
        self.planned = PLANNED * self.acceleration, PLANNED * self.jerk
        self.lower, self.upper = lower, upper
        self.room = speed * (speed / acceleration + acceleration / jerk)
        self.past = (x, x, x)
        self.goals = (x, x, x)
        self.missed = (0.0, 0.0)  # by the last two commands

    def stand(self) -> None:
        """No speed, from whatever it was."""
        self.v = self.a = 0.0
        self.past, self.goals = (self.x,) * 3, (self.goals[0],) * 3

    def follow(self, t: float, times: Sequence[float], goal: float, moving: bool) -> float:
        """The command at time t, after those at three times (the last first); whether the goal goes on moving."""
        dt = t - times[0]
        w, b, c = derivatives(goal, t, self.goals, times)
        change = (goal - self.goals[0]) / dt - (self.goals[0] - self.goals[1]) / (times[0] - times[1])
        if not moving or abs(change) > self.acceleration * dt:  # a jump is no speed
            w = b = c = 0.0
        if abs(w) > self.speed or abs(b) > self.acceleration or abs(c) > self.jerk:
            w = b = c = 0.0
        self.goals = (goal, self.goals[0], self.goals[1])
        if not self._exactly(goal, times, t):
            steps = ceil(dt / PART_S)
            h = dt / steps
            for k in range(steps - 1, -1, -1):
                s = k * h  # until t
                self._part(h, goal - s * (w - s * (b / 2.0 - s * c / 6.0)), w - s * (b - s * c / 2.0), b - s * c, c)
        self.past = (self.x, self.past[0], self.past[1])
        self.missed = (abs(self.x - goal), self.missed[0])
        return self.x

    def _exactly(self, goal: float, times: Sequence[float], t: float) -> bool:
        """Go to the goal at time t, where the limits allow to be there."""
        (t1, t2, t3), (x1, x2, x3) = times, self.past
        shortest = min(t - t1, t1 - t2, t2 - t3)
        if max(3.0 * self.missed[0], self.missed[1]) > SHARE * self.jerk * shortest**3:
            return False  # there now, but not on with the goal
        v, v_before = (goal - x1) / (t - t1), (x1 - x2) / (t1 - t2)
        a = 2.0 * (v - v_before) / (t - t2)
        j = 3.0 * (a - 2.0 * (v_before - (x2 - x3) / (t2 - t3)) / (t1 - t3)) / (t - t3)
        if abs(v) > self.speed or abs(a) > self.acceleration or abs(j) > self.jerk:
            return False
        v += 0.5 * a * (t - t1)
        if abs(v) > self.speed or abs(v + 0.5 * a * abs(a) / self.jerk) > self.speed:
            return False
        if self._beyond_limits(goal, v, a, self.lower, self.upper):
            return False
        self.x, self.v, self.a = goal, v, a
        return True

    def _beyond_limits(self, x: float, v: float, a: float, lower: float, upper: float) -> int:
        """1 where it comes to rest, or turns back, above the upper limit, -1 below the lower one, else 0."""
        end = stop(x, v, a, *self.planned)
        turn = x - 0.5 * v * v / a if v * a < 0.0 else end
        return 1 if max(end, turn) > upper else -1 if min(end, turn) < lower else 0

    def _part(self, h: float, goal: float, w: float, b: float, c: float) -> None:
        """Move for h seconds with one jerk, towards rest beside a goal: where it is at their end, and derivatives."""
        x, v, a, jerk, acceleration = self.x, self.v, self.a, self.jerk, self.acceleration
        low, high = max(-jerk, (-acceleration - a) / h), min(jerk, (acceleration - a) / h)
        braking = max(acceleration - abs(b), LEAST_BRAKING * acceleration)
        lower, upper = self.lower + ROUNDING, self.upper - ROUNDING
        near = x - self.room < lower or x + self.room > upper

        def moved(j: float) -> tuple[float, float, float]:
            return x + h * (v + h * (a / 2.0 + h * j / 6.0)), v + h * (a + h * j / 2.0), a + h * j

        def breaks(x1: float, v1: float, a1: float) -> int:
            """1 where a limit above, -1 where one below would be passed."""
            top = v1 + 0.5 * a1 * abs(a1) / jerk
            if abs(top) > self.speed:
                return 1 if top > 0.0 else -1
            return self._beyond_limits(x1, v1, a1, lower, upper) if near else 0

        def beyond(j: float) -> bool:
            x1, v1, a1 = moved(j)
            broken = breaks(x1, v1, a1)
            return broken > 0 or (broken == 0 and stop(x1 - goal, v1 - w, a1 - b, braking, SHARE * jerk) > 0.0)

        taylor = (
            (goal - h * (w - h * (b / 2.0 - h * c / 6.0)) - x) / CLOSE_S**3,
            3.0 * (w - h * (b - h * c / 2.0) - v) / CLOSE_S**2,
            3.0 * (b - h * c - a) / CLOSE_S,
        )
        close = c + taylor[0] + taylor[1] + taylor[2]
        j = low
        if max(abs(y) for y in taylor) < SHARE * jerk and low <= close <= high and breaks(*moved(close)) == 0:
            j = close
        elif not beyond(high):
            j = high
        elif not beyond(low):
            for _ in range(HALVINGS):
                middle = 0.5 * (j + high)
                if beyond(middle):
                    high = middle
                else:
                    j = middle
        self.x, self.v, self.a = moved(j)


def _stood(t: float) -> tuple[float, float, float]:
    """Times up to t at which an arm stood."""
    return t, t - SHORTEST_S, t - 2.0 * SHORTEST_S


class LimitedMotion:
    """All joints of an arm that follows targets.

    Parameters
    ----------
    t : float
        Seconds: the time at which it stands.
    joints : sequence of sequence of float
        Of each the arguments of `Joint`.
    """

    def __init__(self, t: float, joints: Sequence[Sequence[float]]) -> None:
        self.joints = [Joint(*each) for each in joints]
        self.times = _stood(t)

    def follow(self, t: float, goal: Sequence[float], moving: bool = True) -> list[float]:
        """Commands at a time.

        Parameters
        ----------
        t : float
            Seconds, not less than before.
        goal : sequence of float
            Radians (sliding: metres).
        moving : bool
            Whether the goal goes on as it came.
        """
        if t - self.times[0] > GAP_S:
            self.times = _stood(t - GAP_S)
            for joint in self.joints:
                joint.stand()
        if t - self.times[0] < SHORTEST_S:
            return [joint.x for joint in self.joints]
        q = [joint.follow(t, self.times, x, moving) for joint, x in zip(self.joints, goal, strict=True)]
        self.times = (t, *self.times[:2])
        return q

    def rest(self) -> list[float]:
        """Where the joints come to rest, braked as quickly as the limits allow."""
        return [stop(each.x, each.v, each.a, each.acceleration, each.jerk) for each in self.joints]
