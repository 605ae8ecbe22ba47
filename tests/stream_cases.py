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
    """Lines (bytes) of a way, with times, in which one in three is damaged, in any way that a line can be; the start."""
    rng = np.random.default_rng(seed)
    q = move(robot, n, seed, 0.3)
    poses = robot.arm.forward(q)
    lines, t = [], 0.0
    for k in range(n):
        t += rng.choice([1e-3, 1e-3, 1e-3, 2e-5, 4e-3, 0.03, 0.3], p=[0.3, 0.3, 0.3, 0.04, 0.04, 0.015, 0.005])
        kind = rng.choice(["joints", "model", "pose"], p=[0.5, 0.3, 0.2])
        values = [*poses[k, :3, 3], *quaternion(poses[k])] if kind == "pose" else q[k].tolist()
        content = {kind: [float(v) for v in values], "id": k, "t": t}
        if rng.random() < 0.33:
            content = damaged(content, kind, rng)
        line = json.dumps(content).encode()
        if rng.random() < 0.1:
            line = scrambled(line, rng)
        lines.append(line.replace(b"\n", b" ") + b"\n")
    return lines, q[0]


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
            {**content, "t": [content["t"] - 1.0, "x", np.nan][rng.integers(3)]},
            {**content, "at": values},
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


def faults(answers, live, source, unit=1.0):
    """What is wrong with answers (texts): not JSON, wild numbers, beyond limits of place, speed, acceleration and jerk.

    Answers without a time repeat the last command. Divided differences of the commands over the times, a pause being a
    stop, are compared with the limits; how many lines were held is told, too.
    """
    found, held, times, rows = [], 0, [], []
    for k, text in enumerate(answers):
        content = json.loads(text)
        q, t = content["joints"], content.get("t")
        held += content["held"]
        if q is None:
            continue
        here = np.array(q) * unit
        if not np.isfinite(here).all():
            found.append(f"{k}: {q}")
        if (here < source.numbers.lower - 1e-9).any() or (here > source.numbers.upper + 1e-9).any():
            found.append(f"{k}: outside")
        if rows and (t is None or not t > times[-1]):
            if (here != rows[-1]).any():
                found.append(f"{k}: a move in no time")
            continue
        if rows and t < times[-1] + 1e-5 and (here == rows[-1]).all():
            continue
        if not rows:
            rows, times = [here] * 3, [t - 2e-4, t - 1e-4, t]
            continue
        if t - times[-1] > 0.1:
            rows, times = [rows[-1]] * 3, [t - 0.1002, t - 0.1001, t - 0.1]
        rows.append(here)
        times.append(t)
        rows, times = rows[-4:], times[-4:]
        if len(rows) == 4:
            found += [f"{k}: {what}" for what in beyond(np.array(rows), np.array(times), live)]
    return found, held


def beyond(q, t, live):
    """Which limits four commands (4, joints) at times (4,) exceed."""
    v = np.diff(q, axis=0) / np.diff(t)[:, None]
    a = 2.0 * np.diff(v, axis=0) / (t[2:] - t[:-2])[:, None]
    j = 3.0 * np.diff(a, axis=0) / (t[3] - t[0])
    rounding = 1e-4 + 8.0 * np.abs(q).max() * np.finfo(float).eps / np.diff(t).min() ** np.arange(1, 4)
    limits = zip(("speed", "acceleration", "jerk"), (v, a, j), rounding, strict=True)
    return [
        f"{name} {np.abs(x).max():.6g}"
        for name, x, slack in limits
        if (np.abs(x) > np.array(getattr(live, name)) * (1.0 + 1e-4) + slack).any()
    ]
