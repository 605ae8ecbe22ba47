"""Who is near whom: a tree for many, all pairs for few, where loading the tree takes longer than the search."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray

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
    pairs_found = _in_order(x, radius)
    if pairs_found is not None:
        return pairs_found
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
    import pandas as pd

    names = np.concatenate([np.asarray(name, dtype=object) for name, _ in tables])
    values = np.concatenate([np.asarray(value, dtype=float) for _, value in tables])
    number = pd.factorize(names)[0].astype(np.int64)
    key = _by_key(values)
    for column in values.T if key is None else [key]:
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


def within(x: FloatArray, to: FloatArray, period: FloatArray) -> BoolArray:
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
    if len(x) * len(to) <= FEW:
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
    if len(edges) * 8 <= FEW:
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
