"""Repeats: poses that are measured several times, and poses of one set that another has, too.

A pose that is measured again shows the tracker's noise once more, and the same error of the robot: whoever knows one of
the repeats knows the robot's error at the others. Proof on poses that a fit never saw, cross-validation, bootstrap and
leaving out one at a time therefore take all repeats of a pose together.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, coded
from irbcal.measurement.points import PointSet
from irbcal.units import DEG, MM
from irbcal.wording import counted

MANY = 2000
"""Poses from which time matters."""
SAME_POSE = 0.01 * DEG
"""Joints that all agree within this are one pose, radians (metres for prismatic joints)."""
NEAR = 2.0 * DEG, 20.0 * MM
"""Revolute and prismatic joints that all agree within this, up to full turns, are no new pose. On 6 SIMULATED robots
errors at fitted poses moved by up to 0.01, 0.3, 1, 2, 5 degrees in each joint are 0.60, 0.67, 0.78, 0.81, 0.80 of those
at other poses (60 poses, model auto): beyond 2 degrees only the errors' slow part is known, as all over the workspace.
"""
SAME_LOAD = 0.1
"""Kilograms by which loads differ at least."""
MOST_PAIRS = 250_000
"""Pairs that are compared one by one."""
NEIGHBOURS = 200
"""Rows that are near in one column, of each row on average, beyond which a tree is quicker."""
LOOKED_AT = 5_000
"""Rows that tell which column tells most rows apart."""


def repeat_groups(points: PointSet) -> IntArray:
    """Which poses are repeats of one another: the same joints within `SAME_POSE`, or the same name.

    Poses of one name are the cycles of one pose of a program. Across sessions names mean nothing, equal joints do.

    Returns
    -------
    ndarray of int, shape (n,)
        Number of each pose's group, from 0 in the order in which they are first seen.
    """
    if points.session is None:
        return repeats_of_joints(points.q, points.pose_ids)
    names = [f"{session}\n{name}" for session, name in zip(points.session, points.pose_ids, strict=True)]
    return repeats_of_joints(points.q, np.array(names, dtype=object))


def repeats_of_joints(q: FloatArray, names: np.ndarray | None = None) -> IntArray:
    """As `repeat_groups`, of joints (n, joints), radians (metres), and names (n,) of the poses."""
    n = len(q)
    if not n:
        return np.zeros(0, dtype=int)
    # exact copies first: many of them would make very many pairs
    copy_of, first = _equal(q)
    single = q[first]
    edges = [near_pairs(single, SAME_POSE)]
    if names is not None:
        called = coded(names)[0]
        leader = np.zeros(called.max() + 1, dtype=int)
        leader[called[::-1]] = copy_of[::-1]
        edges.append(np.column_stack([copy_of, leader[called]]))
    between = np.concatenate(edges)
    between = between[between[:, 0] != between[:, 1]]
    if not len(between) and len(single) == n:
        return np.arange(n)
    label = connected(len(single), between)[copy_of]
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[number.ravel()]


def _equal(q: FloatArray) -> tuple[IntArray, IntArray]:
    """Number of each row, the same for equal rows, and the first row of each number."""
    order = np.lexsort(q.T[::-1]) if len(q) < MANY else np.argsort(mixture(q))
    new = np.r_[True, (q[order[1:]] != q[order[:-1]]).any(axis=1)]
    number = np.empty(len(q), dtype=int)
    number[order] = np.cumsum(new) - 1
    return number, order[new]


def copied_points(points: PointSet) -> int:
    """Number of points that stand in the data before with the same joints and position, to the last digit."""
    order = np.lexsort([points.target, *points.xyz.T])  # equal rows beside one another: pose by pose they differ
    pose, target, xyz = points.pose[order], points.target[order], points.xyz[order]
    alike = np.flatnonzero((target[1:] == target[:-1]) & (xyz[1:] == xyz[:-1]).all(axis=1))
    if not len(alike):
        return 0
    candidates = np.unique([alike, alike + 1])
    rows = np.column_stack([points.q[pose[candidates]], target[candidates], xyz[candidates]])
    return len(rows) - len(np.unique(rows, axis=0))


def repeat_notes(points: PointSet) -> list[str]:
    """What the user should know of repeats and of copied rows, in sentences."""
    label = repeat_groups(points)
    count = int(label.max(initial=-1)) + 1
    out = []
    if count < points.poses:
        out.append(
            f"The {points.poses} poses are {count} places, some of them measured several times: repeats of a place are "
            "fitted together or held out together, and what is held out is counted in places."
        )
    twice = copied_points(points)
    if twice:
        out.append(
            f"{counted(twice, 'point stands', 'points stand')} in the measurements again with the same joints and "
            "position to the last digit: copies of rows, not repeats, which count twice in the fit. Leave them out of "
            "the file."
        )
    return out


def near_fitted(points: PointSet, fit: PointSet, prismatic: BoolArray) -> BoolArray:
    """Which poses are at joints of the fit, within `NEAR` and up to full turns, whatever was measured there.

    Parameters
    ----------
    points, fit : PointSet
    prismatic : ndarray of bool, shape (joints,)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    if not points.poses or not fit.poses or points.q.shape[1] != fit.q.shape[1]:
        return np.zeros(points.poses, dtype=bool)
    radius = np.where(prismatic, NEAR[1], NEAR[0])
    period = np.where(prismatic, 0.0, 2.0 * np.pi) / radius
    return near_any(points.q / radius, fit.q / radius, period)


def with_fitted_load(points: PointSet, fit: PointSet) -> BoolArray:
    """Which poses carry a load that the fit has seen, shape (n,); all where one of them does not tell the load."""
    carried, fitted = points.inputs.get("payload_kg"), fit.inputs.get("payload_kg")
    if carried is None or fitted is None:
        return np.ones(points.poses, dtype=bool)
    loads: FloatArray = np.unique(fitted[np.isfinite(fitted)])
    if not len(loads):
        return np.ones(points.poses, dtype=bool)
    differs = np.abs(carried[:, None] - loads).min(axis=1) > SAME_LOAD
    return ~(np.isfinite(carried) & differs)


def near_pairs(x: FloatArray, radius: float) -> IntArray:
    """Pairs of rows that differ by at most a radius in every column.

    Parameters
    ----------
    x : ndarray, shape (n, k)
    radius : float

    Returns
    -------
    ndarray of int, shape (m, 2)
    """
    if len(x) ** 2 <= MOST_PAIRS:
        close = np.all(np.abs(x[:, None] - x) <= radius, axis=2)
        return np.argwhere(np.triu(close, 1))
    pairs_found = _in_order(x, radius)
    if pairs_found is not None:
        return pairs_found
    from scipy.spatial import cKDTree

    return cKDTree(x).query_pairs(radius, p=np.inf, output_type="ndarray")


def _in_order(x: FloatArray, radius: float) -> IntArray | None:
    """`near_pairs` among rows that are neighbours in one column; None where there are too many of these."""
    columns = _telling(x)
    order = np.argsort(x[:, columns[0]])
    sorted_ = x[order, columns[0]]
    count = np.searchsorted(sorted_, sorted_ + radius, side="right") - np.arange(len(x)) - 1
    if count.sum() > NEIGHBOURS * len(x):
        return None
    second = x[order, columns[1 % len(columns)]]
    blocks, row, step = [np.zeros((0, 2), dtype=int)], np.flatnonzero(count), 1
    while len(row):  # each row with the one so many places behind it
        close = row[np.abs(second[row + step] - second[row]) <= radius]
        first, other = order[close], order[close + step]
        close = np.all(np.abs(x[first] - x[other]) <= radius, axis=1)
        blocks.append(np.column_stack([first[close], other[close]]))
        step += 1
        row = row[count[row] >= step]
    return np.concatenate(blocks)


def _telling(x: FloatArray) -> list[int]:
    """Columns, those first whose values tell most rows apart."""
    sample = x[:: max(1, len(x) // LOOKED_AT)]
    return sorted(range(x.shape[1]), key=lambda k: -len(np.unique(sample[:, k])))


def numbered(*tables: tuple[NameArray, FloatArray]) -> list[IntArray]:
    """Numbers of rows by what they are: equal ones have one number in all tables.

    Parameters
    ----------
    *tables : (ndarray of str, shape (n,); ndarray, shape (n, k))
        Names and numbers of the rows.

    Returns
    -------
    list of ndarray of int, shape (n,)
        From 0 in the order in which they are first seen.
    """
    names = np.concatenate([np.asarray(name, dtype=object) for name, _ in tables])
    values = np.concatenate([np.asarray(value, dtype=float) for _, value in tables]) + 0.0  # of zeros one sign
    keys = zip(names.tolist(), values.view(f"V{values.itemsize * values.shape[1]}").ravel().tolist(), strict=True)
    ends = np.cumsum([len(name) for name, _ in tables])[:-1]
    return list(np.split(coded(keys)[0], ends))


def mixture(values: FloatArray) -> FloatArray:
    """A mixture (n,) of the columns of rows (n, k): that of equal rows is the same to the last bit."""
    out = np.zeros(len(values))
    for k, column in enumerate(values.T):  # a product of matrices would round rows differently
        out += np.sqrt(2.0 + k) * column
    return out


def near_any(x: FloatArray, to: FloatArray, period: FloatArray) -> BoolArray:
    """Which rows differ by at most 1 in every column from a row of another table.

    Parameters
    ----------
    x : ndarray, shape (n, k)
    to : ndarray, shape (m, k)
    period : ndarray, shape (k,)
        Numbers of a column that differ by multiples of it are the same; 0 where there is no period.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    turns = period > 0.0
    if len(x) * len(to) <= MOST_PAIRS:
        apart = x[:, None] - to
        apart[..., turns] -= period[turns] * np.round(apart[..., turns] / period[turns])
        return np.asarray((np.abs(apart).max(axis=2) <= 1.0).any(axis=1))
    from scipy.spatial import cKDTree

    def folded(rows: FloatArray) -> FloatArray:
        rows = rows.copy()
        rows[:, turns] %= period[turns]
        rows[:, turns] = np.where(rows[:, turns] >= period[turns], 0.0, rows[:, turns])
        return rows

    tree = cKDTree(folded(to), boxsize=period)
    return np.isfinite(tree.query(folded(x), p=np.inf, distance_upper_bound=1.0 + 1e-9)[0])


def connected(n: int, edges: IntArray) -> IntArray:
    """Which of n things hang together by edges (m, 2): the number of each thing's part."""
    if len(edges) * 8 <= MOST_PAIRS:
        label = np.arange(n)
        while True:
            smaller = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
            previous = label.copy()
            np.minimum.at(label, edges.ravel(), np.repeat(smaller, 2))
            label = label[label]
            if np.array_equal(label, previous):
                return label
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    return connected_components(coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)[1]
