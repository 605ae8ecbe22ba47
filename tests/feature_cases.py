"""SIMULATED rows at features for tests: a robot with known errors, touching what each kind is about."""

from dataclasses import replace

import numpy as np
import pandas as pd

from irbcal.identification.feature_fit import identify_features
from irbcal.identification.feature_problem import FeatureProblem
from irbcal.identification.observation_kind import Observed
from irbcal.identification.observations import KINDS
from irbcal.io.urdf import read_urdf
from irbcal.measurement import features
from irbcal.measurement.features import Feature
from irbcal.measurement.imaging import CAMERA_KINDS, FITTED, LENS, POINTS
from irbcal.modeling import frames
from irbcal.modeling.frames import LEVER
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.units import DEG, MM

TOOL = np.array([0.06, -0.03, 0.15])
LENS_OF = (1400.0, 1402.0, 955.0, 610.0, -0.12, 0.08, 5e-4, -4e-4, -0.01)
SEEN_SIZE, SQUARES, SQUARE = (1920, 1200), (8, 6), 0.03
COUNTS = {"angle": 1, "pose": 1, "radius": 2, "line": 4}
DEPTH = 1 * MM
"""Noise of depths where that of others is 0.05 mm."""
EMPTY = np.full((1, 3, 3), np.nan)


def arm():
    return read_urdf("irb1600").arm


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
    if kind in CAMERA_KINDS:
        lens = {name: np.array([value]) for name, value in zip(FITTED, LENS_OF, strict=False)}
        axes = frames.rotation_from_vector(np.array([0.3, -0.2, 0.5]))
        in_hall = CAMERA_KINDS[kind] != "camera"
        at = np.array([2.2, rng.uniform(-0.6, 0.6), rng.uniform(0.6, 1.2)]) if in_hall else centre
        way = np.array([0.8, 0.0, 0.6]) - at if in_hall else np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.4, 0.4, 3)
        facing = frames.with_third(way / np.linalg.norm(way))
        every = {"centre": at, "attitude": facing, "axes": axes, **lens}
        return {name: every[name] for name in KINDS[kind].unknowns}
    turn = frames.rotation_from_vector(rng.standard_normal(3))
    if kind == "line":
        return {"line": np.column_stack([turn, centre])}
    if kind in ("plane", "gauge"):
        return {"normal": turn, "height": np.array([turn[:, 2] @ centre])}
    own = {"centre": centre} if "centre" in KINDS[kind].unknowns else {}
    own |= {"axes": turn} if "axes" in KINDS[kind].unknowns else {}
    own |= {"radius": np.array([0.03])} if kind == "sphere" else {}
    own |= (
        {"offset": np.array([0.05]), "centre": np.array([1.8, 1.0, 0.2]) * rng.uniform(0.7, 1.0, 3)}
        if (kind == "radius")
        else {}
    )
    if kind == "angle":
        own = {"axis": turn, "up": frames.rotation_from_vector(np.array([0.01, -0.02, 0.0]))}
    return own


def in_image(lens, y):
    """Pixels of points in camera axes (..., 3), as the manual of OpenCV writes it."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lens
    x, v = y[..., 0] / y[..., 2], y[..., 1] / y[..., 2]
    r2 = x**2 + v**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    there = x * radial + 2 * p1 * x * v + p2 * (r2 + 2 * x**2), v * radial + p1 * (r2 + 2 * v**2) + 2 * p2 * x * v
    return np.stack([fx * there[0] + cx, fy * there[1] + cy], axis=-1)


def corners():
    """Inner corners of the board, (n, 3), metres."""
    y, x = np.mgrid[1 : SQUARES[1], 1 : SQUARES[0]]
    return SQUARE * np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])


def before_camera(kind, p, R, own, count=None):
    """Corners, or the first of them, in camera axes (m, n, 3)."""
    xyz = corners()[:count]
    if kind in POINTS and "axes" not in own:
        return ((p - own["centre"]) @ own["attitude"])[:, None]
    M = R @ own["axes"]
    if kind in POINTS:
        return ((own["centre"] - p)[:, None] @ M).reshape(-1, 1, 3)
    if kind == "image":
        return (p[:, None] + xyz @ M.transpose(0, 2, 1) - own["centre"]) @ own["attitude"]
    return (own["centre"] + xyz @ own["attitude"].T - p[:, None]) @ M


def in_frame(y, uv):
    return ((uv > 20) & (uv < np.array(SEEN_SIZE) - 20)).all(axis=(1, 2)) & (y[..., 2] > 0.2).all(axis=1)


def in_view(y, uv):
    """Whether all corners are within the image, near enough and not seen from the side."""
    inside = in_frame(y, uv)
    if y.shape[1] == 1:
        return inside & (y[:, 0, 2] < 3.5) & (np.hypot(*y[:, 0, :2].T) < 0.9 * y[:, 0, 2])  # the lens folds beyond
    normal = np.cross(y[:, 1] - y[:, 0], y[:, SQUARES[0] - 1] - y[:, 0])
    steep = np.abs(np.einsum("mi,mi->m", normal, y[:, 0]))
    steep /= np.linalg.norm(normal, axis=1) * np.linalg.norm(y[:, 0], axis=1)
    return inside & (y[..., 2] > 0.2).all(axis=1) & (y[..., 2] < 2.5).all(axis=1) & (steep > 0.5)


def images(kind, one, own, n, rng, noise=0.0):
    """Rows of corners: a tenth of a pixel of noise for 0.05 mm."""
    q = np.zeros((0, 6))
    for _ in range(50):
        more = arm().random_joints(max(500 * n, 3000), int(rng.integers(1 << 30))) * 0.9
        for count, near in ((1, in_frame), (None, in_view)):  # most fail by their first corner
            y = before_camera(kind, *tip(one, more), own, count)
            y[..., 2] = np.maximum(y[..., 2], 0.1)
            more = more[near(y, in_image(LENS_OF, y))]
        q = np.concatenate([q, more])[:n]
        if len(q) == n:
            break
    assert len(q) == n, (kind, len(q))
    y = before_camera(kind, *tip(one, q), own)
    uv = in_image(LENS_OF, y)
    uv = uv + noise / (0.5 * MM) * rng.standard_normal(uv.shape)
    count = uv.shape[1]
    table = {
        "kind": kind,
        "corner": np.tile(np.arange(count), n) if kind not in POINTS else "",
        "u_px": uv[..., 0].ravel(),
        "v_px": uv[..., 1].ravel(),
    }
    if kind.startswith("depth"):
        table["value_mm"] = (y[:, 0, 2] + noise / (0.05 * MM) * DEPTH * rng.standard_normal(n)) / MM
    return pd.DataFrame(table | {f"q{j}_deg": np.repeat(column / DEG, count) for j, column in enumerate(q.T, 1)})


def camera(**more):
    """What the features' file says of camera and board."""
    size = {"width_px": SEEN_SIZE[0], "height_px": SEEN_SIZE[1]}
    board = {"squares_x": SQUARES[0], "squares_y": SQUARES[1], "square_mm": SQUARE / MM}
    return dict(zip(LENS, LENS_OF, strict=True)) | size | board | more


def contact(one, kind, own, n, rng, value=0.0, xyz=None, noise=0.0):
    """Random joints moved until they meet a kind's condition, but for noise."""
    nominal = arm()
    q = nominal.random_joints(12 * n, int(rng.integers(1 << 30))) * 0.8
    v = np.broadcast_to(np.asarray(value, float), len(q)) if np.ndim(value) == 0 else np.resize(value, len(q))
    places = np.resize(np.zeros(3) if xyz is None else xyz, (len(q), 3))
    off = noise * rng.standard_normal((len(q), KINDS[kind].size))
    good = np.zeros(len(q), bool)
    for part in np.array_split(np.arange(len(q)), 8):  # as many as are needed
        q[part], good[part] = _moved_to(one, kind, own, q[part], v[part], places[part], off[part])
        if good.sum() >= n:
            break
    assert good.sum() >= n, (kind, good.sum())
    out = np.flatnonzero(good)[:n]
    return q[out], v[out], places[out]


def _moved_to(one, kind, own, q, v, places, off):
    """Joints that meet the condition, and whether they do within the limits."""
    nominal = arm()

    def residuals(q):
        p, R = tip(one, q)
        return p, KINDS[kind].residuals(Observed(Feature("", kind), p, R, v, places, EMPTY), own)

    for _ in range(25):
        p, met = residuals(q)
        path = chain.walk(nominal, q)
        J = met.point @ chain.by_joints(path, nominal, p.T).T
        if met.turn is not None:
            J = J + met.turn @ chain.by_joints(path, nominal).T
        step = np.linalg.pinv(J, rcond=1e-3) @ (met.r + off)[..., None]
        q = q + np.clip(step[..., 0], -0.3, 0.3)
    near = np.abs(residuals(q)[1].r + off).max(axis=1) < 1e-13
    return q, near & (q > nominal.lower).all(axis=1) & (q < nominal.upper).all(axis=1)


def rows(kind, one, n=60, seed=0, noise=0.0, fresh=0, fit=""):
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
                each = len(parts[-1]) // count
                parts[-1]["pose"] = [f"{label} {j}" for j in range(count) for _ in range(each)]
        known.append({"feature": name, "kind": kind, "radius_mm": 30.0 if kind == "sphere" else None})
        known[-1] |= camera(target="ball", fit=fit) if kind in CAMERA_KINDS else {}
        known[-1] |= {"u95_px": 0.196, "u95_mm": 1.96 * DEPTH / MM} if kind in POINTS else {}
    table = pd.concat(parts, ignore_index=True)
    return table.assign(feature="") if kind == "pose" else table, pd.DataFrame(known)


def _rows(kind, one, own, n, rng, noise, axes):
    if kind in CAMERA_KINDS:
        return images(kind, one, own, n, rng, noise)
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


def seen(kind, one, n=60, seed=0, noise=0.0, fresh=0, fit=""):
    """Rows as read."""
    table, known = rows(kind, one, n, seed, noise, fresh, fit)
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
    there = FeatureProblem(nominal, all_rows.select(fresh), fit.problem.terms)
    assert list(there.layout) == list(fit.problem.layout)
    misses = {id(one.group): one.residuals.r for one in there.group_residuals(fit.state)}
    r = np.concatenate([one.ravel() for one in misses.values()])
    blocks = list(there.dense(fit.state))
    J = np.concatenate([b.J for b in blocks], axis=1)
    J = J * MM / there.sizes[:, None] / np.repeat(1.0, J.shape[1])
    weights = there.weights[np.concatenate([b.row for b in blocks])]
    std = np.sqrt(np.einsum("ar,ab,br->r", J, fit.step_covariance, J, optimize=True)) / weights
    return np.abs(r) < 1.96 * std
