"""Who is near whom: a tree for many, all pairs for few, where loading the tree takes longer than the search."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray

FEW = 250_000
"""Pairs that are compared one by one."""


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
    column = int(np.argmax([len(np.unique(values)) for values in x.T]))
    order = np.argsort(x[:, column])
    sorted_ = x[order, column]
    count = np.searchsorted(sorted_, sorted_ + radius, side="right") - np.arange(len(x)) - 1
    if count.sum() > 20 * len(x):
        return None
    first = np.repeat(np.arange(len(x)), count)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
    one, other = order[first], order[second]
    close = np.all(np.abs(x[one] - x[other]) <= radius, axis=1)
    return np.column_stack([one[close], other[close]])


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
    for column in values.T:
        codes, uniques = pd.factorize(column, use_na_sentinel=False)
        number = pd.factorize(number * np.int64(len(uniques)) + codes)[0]
    ends = np.cumsum([len(name) for name, _ in tables])[:-1]
    return list(np.split(number, ends))


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
