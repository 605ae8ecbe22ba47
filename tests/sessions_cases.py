"""A simulated robot measured in several sessions, the tracker and the tool moved between them."""

from dataclasses import replace

import numpy as np
from support import TARGETS, arm, measured, random_robot, random_rotation

from irbcal.measurement.session_blocks import joined
from irbcal.modeling import frames

NOISE = 1e-5


def truth(level="34", seed=1, size=0.3):
    """Robots that differ in base and tool only: session -> robot."""
    rng = np.random.default_rng(seed)
    first = random_robot(arm(), level, rng, size)
    robots = {"mon": first}
    for name in ("tue", "wed"):
        targets = {target: np.add(place, rng.uniform(-0.02, 0.02, 3)) for target, place in TARGETS.items()}
        T = frames.transform(random_rotation(rng), rng.uniform(-4, 4, 3))
        robots[name] = first.replace(T_world_base=T, targets=targets)
    return robots


def parts(counts, seed=1, noise=NOISE, level="34"):
    """Points by session and the robots; ``counts`` are poses by session."""
    rng, robots, out = np.random.default_rng(seed), truth(level, seed), []
    for k, (name, count) in enumerate(counts.items()):
        q = arm().random_joints(count, 100 * seed + k)
        out.append((name, replace(measured(robots[name], q, noise, rng), groups=np.full(count, name, dtype=object))))
    return out, robots


def together(counts, **options):
    """As `parts`, in one set."""
    sets, robots = parts(counts, **options)
    return joined(sets), robots
