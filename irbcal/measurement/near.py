"""Who is near whom: a tree for many, all pairs for few, where loading the tree takes longer than the search."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray

FEW = 250_000
"""Pairs that are compared one by one."""
NEIGHBOURS = 200
"""Rows that are near in one column, of each row on average, beyond which a tree is quicker."""
LOOKED_AT = 5_000
"""Rows that tell which column tells most rows apart."""


def pairs(x: FloatArray, radius: float) -> IntArray:
    """Pairs of rows that differ by at most a radius in every column.

    Parameters
    ----------
    x : ndarray, shape (n, k)
    radius : float

    Returns
    -------
    ndarray of int, shape (m, 2)
    """
    if len(x) ** 2 <= FEW:
        close = np.all(np.abs(x[:, None] - x) <= radius, axis=2)
        return np.argwhere(np.triu(close, 1))
    found = _in_order(x, radius)
    if found is not None:
        return found
    from scipy.spatial import cKDTree

    return cKDTree(x).query_pairs(radius, p=np.inf, output_type="ndarray")


def _in_order(x: FloatArray, radius: float) -> IntArray | None:
    """`pairs` among rows that are neighbours in one column; None where there are too many of these."""
    columns = _telling(x)
    order = np.argsort(x[:, columns[0]])
    sorted_ = x[order, columns[0]]
    count = np.searchsorted(sorted_, sorted_ + radius, side="right") - np.arange(len(x)) - 1
    if count.sum() > NEIGHBOURS * len(x):
        return None
    second = x[order, columns[1 % len(columns)]]
    found, row, step = [np.zeros((0, 2), dtype=int)], np.flatnonzero(count), 1
    while len(row):  # each row with the one so many places behind it
        close = row[np.abs(second[row + step] - second[row]) <= radius]
        one, other = order[close], order[close + step]
        close = np.all(np.abs(x[one] - x[other]) <= radius, axis=1)
        found.append(np.column_stack([one[close], other[close]]))
        step += 1
        row = row[count[row] >= step]
    return np.concatenate(found)


def _telling(x: FloatArray) -> list[int]:
    """Columns, those first whose values tell most rows apart."""
    some = x[:: max(1, len(x) // LOOKED_AT)]
    return sorted(range(x.shape[1]), key=lambda k: -len(np.unique(some[:, k])))


def between(x: FloatArray, to: FloatArray, radius: float) -> IntArray | None:
    """Pairs of rows of two tables that differ by less than a radius in every column.

    Parameters
    ----------
    x : ndarray, shape (n, k)
    to : ndarray, shape (m, k)
    radius : float

    Returns
    -------
    ndarray of int, shape (p, 2), or None
        None where too many rows are near in one column: a tree is quicker then.
    """
    columns = _telling(to) if len(to) else [0]
    order = np.argsort(to[:, columns[0]])
    sorted_ = to[order, columns[0]]
    first = np.searchsorted(sorted_, x[:, columns[0]] - radius, side="right")
    count = np.searchsorted(sorted_, x[:, columns[0]] + radius, side="left") - first
    if count.sum() > NEIGHBOURS * (len(x) + len(to)):
        return None
    found, row, step = [np.zeros((0, 2), dtype=int)], np.flatnonzero(count > 0), 0
    while len(row):
        other = order[first[row] + step]
        close = np.all(np.abs(x[row] - to[other]) < radius, axis=1)
        found.append(np.column_stack([row[close], other[close]]))
        step += 1
        row = row[count[row] > step]
    return np.concatenate(found)


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
    import pandas as pd

    names = np.concatenate([np.asarray(name, dtype=object) for name, _ in tables])
    values = np.concatenate([np.asarray(value, dtype=float) for _, value in tables])
    number = pd.factorize(names)[0].astype(np.int64)
    whole = _by_key(values)
    for column in values.T if whole is None else [whole]:
        codes, uniques = pd.factorize(column, use_na_sentinel=False)
        number = pd.factorize(number * np.int64(len(uniques)) + codes)[0]
    ends = np.cumsum([len(name) for name, _ in tables])[:-1]
    return list(np.split(number, ends))


def mixture(values: FloatArray) -> FloatArray:
    """A mixture (n,) of the columns of rows (n, k): that of equal rows is the same to the last bit."""
    out = np.zeros(len(values))
    for k, column in enumerate(values.T):  # a product of matrices would round rows differently
        out += np.sqrt(2.0 + k) * column
    return out


def _by_key(values: FloatArray) -> FloatArray | None:
    """One number of each row in place of its columns, the same for equal rows only; None where none was found."""
    import pandas as pd

    key = mixture(values)
    if not np.isfinite(key).all():
        return None
    codes = pd.factorize(key)[0]
    first = np.zeros(int(codes.max(initial=-1)) + 1, dtype=int)
    first[codes[::-1]] = np.arange(len(codes))[::-1]
    return codes.astype(float) if np.array_equal(values, values[first[codes]]) else None


def nearest(x: FloatArray, to: FloatArray, radius: float, p: float = 2.0) -> IntArray:
    """The nearest row within a radius.

    Parameters
    ----------
    x : ndarray, shape (n, k)
        Who is sought.
    to : ndarray, shape (m, k)
        Where.
    radius : float
        Rows that are not nearer are none.
    p : float
        2 for the distance, infinity for the largest difference of a column.

    Returns
    -------
    ndarray of int, shape (n,)
        Row of ``to``; -1 where there is none.
    """
    if not len(x) or not len(to):
        return np.full(len(x), -1)
    if len(x) * len(to) <= FEW:
        distance = np.linalg.norm(x[:, None] - to, ord=p, axis=2)
        found = np.argmin(distance, axis=1)
        near = distance[np.arange(len(x)), found] < radius
    else:
        from scipy.spatial import cKDTree

        length, found = cKDTree(to).query(x, p=p, distance_upper_bound=radius)
        near = np.isfinite(length)
    return np.where(near, found, -1)


def connected(n: int, edges: IntArray) -> IntArray:
    """Which of n things hang together by edges (m, 2): the number of each thing's part."""
    if len(edges) * 8 <= FEW:
        part = np.arange(n)
        while True:
            smaller = np.minimum(part[edges[:, 0]], part[edges[:, 1]])
            before = part.copy()
            np.minimum.at(part, edges.ravel(), np.repeat(smaller, 2))
            part = part[part]
            if np.array_equal(part, before):
                return part
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    return connected_components(coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)[1]
