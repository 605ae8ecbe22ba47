"""SIMULATED rows at features for tests: a robot with known errors, touching what each kind is about."""

from dataclasses import replace

import numpy as np
import pandas as pd

from irbcal.files.nominal import read_nominal
from irbcal.identification.constraint_fit import identify_features
from irbcal.identification.constraint_kind import LEVER
from irbcal.identification.constraint_problem import ConstraintProblem
from irbcal.identification.constraints import KINDS, Seen
from irbcal.measurement import features
from irbcal.measurement.features import Feature
from irbcal.modeling import frames
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.units import DEG, MM

TOOL = np.array([0.06, -0.03, 0.15])
COUNTS = {"angle": 1, "pose": 1, "radius": 2, "line": 4}
EMPTY = np.full((1, 3, 3), np.nan)


def arm():
    return read_nominal("irb1600", None, None, None).arm


def true_arm(nominal, seed=0, scale=1.0, lengths=True):
    """The arm with random errors of its geometry, of angles alone where lengths cannot be told."""
    rng, table = np.random.default_rng(seed), nominal.table
    for term in GEOMETRY.terms(nominal):
        if term.axis[0] == "r" or lengths:
            column = getattr(table, DHM_COLUMNS[term.axis]).copy()
            column[term.joint] += scale * term.size * rng.standard_normal()
            table = replace(table, **{DHM_COLUMNS[term.axis]: column})
    return nominal.with_table(table)


def tip(one, q, tool=TOOL):
    T = one.forward(q)
    return T[:, :3, 3] + T[:, :3, :3] @ tool, T[:, :3, :3]


def unknowns(kind, rng):
    """True unknowns of a feature, within reach."""
    centre = np.array([rng.uniform(0.7, 1.0), rng.uniform(-0.5, 0.5), rng.uniform(0.3, 0.9)])
    turn = frames.rotation_from_vector(rng.standard_normal(3))
    if kind == "line":
        return {"line": np.column_stack([turn, centre])}
    if kind in ("plane", "gauge"):
        return {"normal": turn, "height": np.array([turn[:, 2] @ centre])}
    own = {"centre": centre} if "centre" in KINDS[kind].own else {}
    own |= {"axes": turn} if "axes" in KINDS[kind].own else {}
    own |= {"radius": np.array([0.03])} if kind == "sphere" else {}
    own |= (
        {"offset": np.array([0.05]), "centre": np.array([1.8, 1.0, 0.2]) * rng.uniform(0.7, 1.0, 3)}
        if (kind == "radius")
        else {}
    )
    if kind == "angle":
        own = {"axis": turn, "up": frames.rotation_from_vector(np.array([0.01, -0.02, 0.0]))}
    return own


def contact(one, kind, own, n, rng, value=0.0, xyz=None, noise=0.0):
    """Random joints moved until they meet a kind's condition, but for noise."""
    nominal = arm()
    q, out = nominal.random_joints(12 * n, int(rng.integers(1 << 30))) * 0.8, []
    xyz = np.zeros(3) if xyz is None else xyz
    v = np.broadcast_to(np.asarray(value, float), len(q)) if np.ndim(value) == 0 else np.resize(value, len(q))
    places = np.resize(xyz, (len(q), 3))
    off = noise * rng.standard_normal((len(q), KINDS[kind].size))
    for _ in range(25):
        p, R = tip(one, q)
        found = KINDS[kind].misses(Seen(Feature("", kind), p, R, v, places, EMPTY), own)
        path = chain.walk(nominal, q)
        moves = chain.point_columns(path, p.T, np.arange(len(q)))[:, 2].transpose(2, 1, 0)
        J = found.point @ moves
        if found.turn is not None:
            J = J + found.turn @ chain.turn_columns(path, np.arange(len(q)))[:, 2].transpose(2, 1, 0)
        step = np.linalg.pinv(J, rcond=1e-3) @ (found.r - off)[..., None]
        q = q - np.clip(step[..., 0], -0.3, 0.3)
    p, R = tip(one, q)
    r = KINDS[kind].misses(Seen(Feature("", kind), p, R, v, places, EMPTY), own).r
    good = (np.abs(r - off).max(axis=1) < 1e-13) & (q > nominal.lower).all(axis=1) & (q < nominal.upper).all(axis=1)
    out = np.flatnonzero(good)[:n]
    assert len(out) == n, (kind, len(out))
    return q[out], v[out], places[out]


def rows(kind, one, n=60, seed=0, noise=0.0, fresh=0):
    """Rows (n a feature) at features of one kind, and the features' table; ``fresh`` more are without noise."""
    rng = np.random.default_rng(seed)
    parts, known = [], []
    axes = frames.rotation_from_vector(np.array([0.3, -0.2, 0.5]))
    for k in range(COUNTS.get(kind, 3)):
        own = unknowns(kind, rng)
        if kind == "offset-on-tool":
            own["axes"] = axes
        name = f"{kind} {k}"
        for count, spread, label in ((n, noise, name), (fresh, 0.0, f"fresh {name}")):
            if count:
                parts.append(_rows(kind, one, own, count, rng, spread, axes).assign(feature=name))
                parts[-1]["pose"] = [f"{label} {j}" for j in range(count)]
        known.append({"feature": name, "kind": kind, "radius_mm": 30.0 if kind == "sphere" else None})
    table = pd.concat(parts, ignore_index=True)
    return table.assign(feature="") if kind == "pose" else table, pd.DataFrame(known)


def _rows(kind, one, own, n, rng, noise, axes):
    seen = rng.uniform(-0.02, 0.02, (12 * n, 3)) if kind.startswith("offset") else None
    value = rng.uniform(-0.01, 0.01, 12 * n) if kind == "gauge" else 0.0
    if kind in ("radius", "angle", "pose"):
        q, v, xyz = arm().random_joints(n, int(rng.integers(1 << 30))) * 0.7, np.zeros(n), np.zeros((n, 3))
    else:
        q, v, xyz = contact(one, kind, own, n, rng, value, seen, noise)
    p, R = tip(one, q)
    table = {"kind": kind} | {f"q{j}_deg": column / DEG for j, column in enumerate(q.T, 1)}
    if kind == "radius":
        v = np.linalg.norm(p - own["centre"], axis=1) - own["offset"][0] + noise * rng.standard_normal(n)
    if kind == "angle":
        s = np.einsum("mij,j,i->m", R, own["axis"][:, 2], own["up"][:, 2])
        table["value_deg"] = (np.arcsin(s) + noise / LEVER * rng.standard_normal(n)) / DEG
    elif kind in ("radius", "gauge"):
        table["value_mm"] = v / MM
    if kind == "pose":
        T = world()
        xyz = p @ T[:3, :3].T + T[:3, 3] + noise * rng.standard_normal(p.shape)
        small = [frames.rotation_from_vector(w) for w in noise / LEVER * rng.standard_normal((n, 3))]
        turned = T[:3, :3] @ R @ axes @ np.array(small)
        table |= dict(zip(("qw", "qx", "qy", "qz"), frames.quaternion_from_matrix(turned).T, strict=True))
    if kind.startswith("offset") or kind == "pose":
        table |= {f"{axis}_mm": column / MM for axis, column in zip("xyz", xyz.T, strict=True)}
    return pd.DataFrame(table)


def world():
    return frames.transform(frames.rotation_from_vector(np.array([0.2, -0.4, 2.0])), [1.0, -2.0, 0.5])


def seen(kind, one, n=60, seed=0, noise=0.0, fresh=0):
    """Rows as read."""
    table, known = rows(kind, one, n, seed, noise, fresh)
    return features.read(table, known.fillna(""), arm())


def apart(one, other, q, tool=TOOL):
    """Distances of the true tool's point from that of another arm with its own tool, however both stand."""
    return apart_in_place(tip(one, q)[0], tip(other, q, tool)[0])


def apart_in_place(a, b):
    """Distances of points (n, 3) from others brought as near to them as a motion does."""
    A, B = a - a.mean(axis=0), b - b.mean(axis=0)
    U, _, Vt = np.linalg.svd(B.T @ A)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return np.linalg.norm(A @ R.T - B, axis=1)


def held(kind, seed, count=120):
    """Whether the interval of each fresh row of a repetition with 0.05 mm of noise holds the truth."""
    nominal, spots = arm(), COUNTS.get(kind, 3)
    truth = true_arm(nominal, 1000 + seed, lengths=KINDS[kind].metric)
    all_rows = seen(kind, truth, count // spots, seed, 0.05 * MM, 15 // spots)
    fresh = np.array([str(name).startswith("fresh") for name in all_rows.pose])
    fit = identify_features(nominal, all_rows.select(~fresh), choices=[()])
    there = ConstraintProblem(nominal, all_rows.select(fresh), fit.problem.terms)
    assert list(there.layout) == list(fit.problem.layout)
    misses = {id(one.group): one.found.r for one in there.misses(fit.state)}
    r = np.concatenate([one.ravel() for one in misses.values()])
    blocks = list(there.dense(fit.state))
    J = np.concatenate([b.J for b in blocks], axis=1)
    J = J * MM / there.sizes[:, None] / np.repeat(1.0, J.shape[1])
    weights = there.weights[np.concatenate([b.row for b in blocks])]
    std = np.sqrt(np.einsum("ar,ab,br->r", J, fit.covariance, J, optimize=True)) / weights
    return np.abs(r) < 1.96 * std
