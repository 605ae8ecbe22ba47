"""Lines for live correction: moves of a robot, and what goes wrong with them."""

import json

import numpy as np

from irbcal.planners.jacobians import along_chain


def move(robot, n, seed, speed=0.5, rate=1000.0):
    """Joints along a smooth way away from limits and singularities, at most ``speed`` (rad/s, m/s), (n, joints)."""
    arm, rng = robot.arm, np.random.default_rng(seed)
    q = arm.random_joints(300, seed)
    room = np.minimum(arm.upper - q, q - arm.lower).min(axis=1) > 0.35
    q = q[room]
    J = along_chain(arm, np.eye(4), q, None)[0]
    middle = q[np.argmax(np.linalg.svd(J, compute_uv=False).min(axis=1))]
    size = rng.uniform(0.1, 0.25, len(middle))
    return middle + size * np.sin(np.arange(n)[:, None] / rate * speed / size + rng.uniform(0, 6, len(middle)))


def fuzzed(robot, n, seed):
    """Lines (bytes) of a way in which one in three is damaged, in any way that a line can be."""
    rng = np.random.default_rng(seed)
    q = move(robot, n, seed, 0.05)  # slow: after some held lines the way is still near
    poses = robot.arm.forward(q)
    lines = []
    for k in range(n):
        kind = rng.choice(["joints", "model", "pose"], p=[0.5, 0.3, 0.2])
        values = [*poses[k, :3, 3], *quaternion(poses[k])] if kind == "pose" else q[k].tolist()
        content = {kind: [float(v) for v in values], "id": k}
        if rng.random() < 0.33:
            content = damaged(content, kind, rng)
        line = json.dumps(content).encode()
        if rng.random() < 0.1:
            line = scrambled(line, rng)
        lines.append(line.replace(b"\n", b" ") + b"\n")
    return lines


def damaged(content, kind, rng):
    """A line's content with a wild number, a jump, a missing or another kind of value."""
    values = list(content[kind])
    at = int(rng.integers(len(values)))
    wild = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 0.0, 1e6, 999999.0, 100.0, -7.0, values[at] + 0.3, 10**400]
    choice = rng.integers(7)
    if choice < 3:
        values[at] = wild[rng.integers(len(wild))]
        return {**content, kind: values}
    if choice == 3:
        return {**content, kind: values[:at]}
    if choice == 4:
        return {**content, kind: [*values[:at], [None, "1", True, [], {}][rng.integers(5)], *values[at + 1 :]]}
    if choice == 5:
        others = [
            {},
            [],
            3,
            None,
            "joints",
            {"joints": None},
            {"pose": values, "model": values},
            {**content, "id": "x"},
        ]
        return others[rng.integers(len(others))]
    return {**content, "more": {"deep": [[[1, 2], 'a\\b"'], None, True]}, "id": [1, 1.5, -3, 2**60][rng.integers(4)]}


def scrambled(line, rng):
    """Bytes of a line lost, doubled or changed."""
    data = bytearray(line)
    for _ in range(rng.integers(1, 6)):
        if not data:
            break
        at = int(rng.integers(len(data)))
        match rng.integers(3):
            case 0:
                data[at] = int(rng.integers(32, 127))
            case 1:
                del data[at : at + int(rng.integers(1, 20))]
            case _:
                data[at:at] = data[at : at + int(rng.integers(1, 20))]
    return bytes(data)


def quaternion(T):
    """w, x, y, z of a pose."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    return w, x, y, z


def faults(answers, source, steps, unit=1.0):
    """What is wrong with answers (texts): not JSON, wild numbers, jumps, commands outside limits; counts of held ones."""
    last, found, held = None, [], 0
    for k, text in enumerate(answers):
        content = json.loads(text)
        q = content["joints"]
        held += content["held"]
        if content["held"] and q != last:
            found.append(f"{k}: held, but another command")
        if q is None:
            continue
        here = np.array(q) * unit
        if not np.isfinite(here).all():
            found.append(f"{k}: {q}")
        if last is not None and (np.abs(here - np.array(last) * unit) > np.array(steps) * (1 + 1e-9)).any():
            found.append(f"{k}: jump")
        if (here < source.parts.lower - 1e-9).any() or (here > source.parts.upper + 1e-9).any():
            found.append(f"{k}: outside")
        last = q
    return found, held
