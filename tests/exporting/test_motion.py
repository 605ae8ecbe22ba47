"""Commands that follow any targets at any times within speed, acceleration and jerk limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irbcal import kernel
from irbcal.exporting.motion import LimitedMotion, stop

MOTIONS = [LimitedMotion, *([] if kernel.Motion is None else [kernel.Motion])]
LOWER, UPPER = -1.0, 1.5


def differences(t, x):
    """Largest speed, acceleration and jerk of places (n,) at times (n,), by divided differences, less their rounding."""
    values, rounding, out = x, np.full(len(x), np.spacing(np.abs(x).max())), []
    for order in (1, 2, 3):
        step = (t[order:] - t[:-order]) / order
        values, rounding = np.diff(values) / step, (rounding[1:] + rounding[:-1]) / step
        out.append((np.abs(values) - rounding).max())
    return np.array(out)


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 2**20),
    st.sampled_from(["even", "uneven", "wild"]),
    st.floats(0.5, 4.0),
    st.sampled_from([0.05, 0.1, 0.3]),
    st.sampled_from([0.02, 0.05, 0.2]),
)
def test_no_limit_is_exceeded(seed, times, speed, to_speed, to_acceleration):
    rng = np.random.default_rng(seed)
    limits = np.array([speed, speed / to_speed, speed / to_speed / to_acceleration])
    motions = [make(0.0, [[0.2, *limits, LOWER, UPPER]]) for make in MOTIONS]
    t, goal, at, x = 0.0, 0.2, [-2e-4, -1e-4, 0.0], [0.2, 0.2, 0.2]
    for _ in range(120):
        t += {"even": 1e-3, "uneven": rng.exponential(2e-3) + 2e-5, "wild": 10 ** rng.uniform(-4.7, -1.01)}[times]
        kind, step = rng.choice(["jump", "limit", "wander", "full", "stay"], p=[0.03, 0.03, 0.5, 0.3, 0.14]), t - at[-1]
        goal = {
            "jump": rng.uniform(LOWER, UPPER),
            "limit": rng.choice([LOWER, UPPER]),
            "wander": goal + rng.uniform(-1, 1) * speed * step,
            "full": goal + 0.95 * speed * step,
            "stay": goal,
        }[kind]
        goal = float(np.clip(goal, LOWER, UPPER))
        commands = [motion.follow(t, [goal], kind != "stay")[0] for motion in motions]
        assert np.ptp(commands) < 1e-7  # by Python and by the compiled kernel
        x.append(commands[-1])
        at.append(t)
    assert (differences(np.array(at), np.array(x)) <= limits * (1.0 + 1e-4)).all()
    assert min(x) >= LOWER
    assert max(x) <= UPPER


@pytest.mark.parametrize("make", MOTIONS)
def test_what_keeps_the_limits_is_followed_exactly_and_what_jumps_is_caught_up_with(make):
    motion = make(0.0, [[0.0, 2.0, 20.0, 400.0, -9.0, 9.0]])
    t = 1e-3 * np.arange(1, 1500)
    goal = 0.3 * (1.5 * t - np.sin(1.5 * t)) + np.where(t > 0.7, 0.05, 0.0)
    x = np.array([motion.follow(s, [g], True)[0] for s, g in zip(t, goal, strict=True)])
    assert (x[t < 0.7] == goal[t < 0.7]).all()
    assert np.abs(x - goal)[(t > 0.7) & (t < 0.72)].max() > 0.04
    assert np.abs(x - goal)[t > 1.4].max() < 1e-9
    assert motion.rest()[0] > x[-1]


def test_the_place_of_rest_is_that_of_the_quickest_brake():
    """Against small steps of the jerk that brakes: full, none at the largest deceleration, full back."""
    for x, v, a in ((0.0, 1.0, 0.0), (0.1, 1.5, 10.0), (0.0, 0.02, 0.0), (-0.2, -1.2, 3.0), (0.0, 0.5, -6.0)):
        end, h, most, jerk = stop(x, v, a, 20.0, 400.0), 1e-5, 20.0, 400.0
        side = np.sign(v + 0.5 * a * abs(a) / jerk)
        x, v, a = side * x, side * v, side * a
        while v > 1e-4 or abs(a) > 0.1:
            release = v <= 0.5 * a * a / jerk and a < 0.0
            j = jerk if release else -jerk if a > -most else 0.0
            x, v, a = x + h * v, v + h * a, a + h * j
            if v < -0.01:
                break
        assert abs(side * x - end) < 2e-4
