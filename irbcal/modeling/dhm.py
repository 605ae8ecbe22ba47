"""Modified Denavit-Hartenberg geometry (Craig) and its forward kinematics for batches (Nubiola 2011, section 5.1).

One row of the table is the step from frame i-1 to frame i (eqs. 5.1 and 5.2), with Hayati's tilt
``beta`` about y in between for nearly parallel axes and a shift ``b`` along y (both zero in a plain DHM table)::

    A_i = Rot(x, alpha_i) Trans(a_i, 0, 0) Rot(y, beta_i) Trans(0, b_i, 0) Rot(z, theta_i) Trans(0, 0, d_i)

``beta_i`` tilts axis i about the point where it meets the common normal. All six numbers of a row together place a
joint anywhere near its nominal place: the general parametrisation, for which a plain table is too small. A joint adds
its angle to ``theta_i`` (revolute) or its travel to ``d_i`` (prismatic). Forward kinematics walks the
chain from the tip to the base, derivatives (`chain_frames`) from the base to the tip, with axes held as arrays of shape
(3, poses), a block of poses at a time: no 4x4 products and no loop over poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from math import atan2, cos, sin
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import LINE, BoolArray, FloatArray, Locked, aligned, handed_on, lock, row_arithmetic
from irbcal.modeling import frames
from irbcal.modeling.cos_sin import cos_sin
from irbcal.units import DEG, MM

BLOCK = 5120
"""Poses per block: few enough for the cache, and enough for the calls of numpy not to count."""

FEW = 1000
"""Poses for which the number of steps counts, not their length."""

Row: TypeAlias = tuple[float, float, float, float, float, float, bool]
"""alpha, a, theta, d, beta, b of a joint, and whether it slides."""

QUARTER = 1e-15
"""Cosine below which a constant angle is a quarter turn: that of pi / 2 is 6e-17."""


@dataclass(frozen=True, eq=False, repr=False)
class DHMTable:
    """DHM parameters of a serial arm with ``n`` joints (Nubiola 2011, Table 5.1 is that of the IRB 1600).

    Parameters
    ----------
    alpha, a, theta, d : array_like, shape (n,)
        Radians and metres; ``theta`` (``d`` of a prismatic joint) is the joint's offset, added to the effective joint.
    beta : array_like, shape (n,), optional
        Hayati tilt about y, radians; zero unless given.
    b : array_like, shape (n,), optional
        Shift along y, metres; zero unless given.
    prismatic : array_like of bool, shape (n,), optional
        Which joints slide along z; none unless given.

    Notes
    -----
    The arrays are copied and locked; use `dataclasses.replace` for a changed table.
    """

    alpha: FloatArray
    a: FloatArray
    theta: FloatArray
    d: FloatArray
    beta: FloatArray = field(default_factory=lambda: np.zeros(0))
    b: FloatArray = field(default_factory=lambda: np.zeros(0))
    prismatic: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __post_init__(self) -> None:
        shape = np.shape(self.alpha)
        for column in fields(self):
            value = np.array(getattr(self, column.name), dtype=bool if column.name == "prismatic" else float)
            if not value.size and column.name in ("beta", "b", "prismatic"):
                value = np.zeros(shape, dtype=value.dtype)
            if value.shape != shape or value.ndim != 1:
                raise ValueError(f"DHM column {column.name} has shape {value.shape}, expected (n,)")
            value.setflags(write=False)
            object.__setattr__(self, column.name, value)
        lock(self)

    def __len__(self) -> int:
        return len(self.alpha)

    def __repr__(self) -> str:
        columns = {"alpha_deg": DEG, "a_mm": MM, "theta_deg": DEG, "d_mm": MM, "beta_deg": DEG, "b_mm": MM}
        values = {name: getattr(self, name.split("_")[0]) / unit for name, unit in columns.items()}
        shown = {name: v for name, v in values.items() if name[0] != "b" or v.any()}
        rows = [" ".join(f"{v[i]:.6g}" for v in shown.values()) for i in range(min(len(self), 8))]
        more = ["…"] if len(self) > 8 else []
        return f"<DHMTable of {len(self)} joints: {' '.join(shown)}: {'; '.join(rows + more)}>"

    @property
    def offsets(self) -> FloatArray:
        """What is added to each effective joint, shape (n,): ``theta`` (rad), of prismatic joints ``d`` (m)."""
        return np.where(self.prismatic, self.d, self.theta)

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """The table joint by joint: alpha, a, theta, d, beta, b, and whether it slides."""
        return tuple(zip(*(getattr(self, column.name).tolist() for column in fields(self)), strict=True))

    def step(self, i: int, value: float = 0.0) -> FloatArray:
        """Transform ``T_{i-1}_i`` of row ``i`` (counted from 0) at an effective joint angle (rad) or travel (m).

        It is the product of Nubiola 2011, eq. 5.1, multiplied out in eq. 5.2.
        """
        angle, travel = (0.0, value) if self.prismatic[i] else (value, 0.0)
        turn_x = frames.transform(frames.rot_x(self.alpha[i])) @ frames.transform(None, [self.a[i], 0.0, 0.0])
        tilt = frames.transform(frames.rot_y(self.beta[i]), [0.0, self.b[i], 0.0])
        turn = frames.transform(frames.rot_z(self.theta[i] + angle))
        return turn_x @ tilt @ turn @ frames.transform(None, [0.0, 0.0, self.d[i] + travel])


@dataclass(frozen=True, eq=False, repr=False)
class ChainFrames(Locked):
    """Axes and origins along the chain for a block of poses, all in the base frame.

    Attributes
    ----------
    x_before, o_before : ndarray, shape (joints, 3, n)
        x axis and origin of frame i-1: what alpha_i turns about and a_i moves along.
    z, o : ndarray, shape (joints, 3, n)
        z axis and origin of frame i: what theta_i turns about and d_i moves along.
    y_tilt, o_tilt : ndarray, shape (joints, 3, n)
        Axis and point that Hayati's beta_i turns about; b_i moves along it.
    tip : ndarray, shape (4, 3, n)
        x, y, z axes and origin of the tip frame.
    """

    x_before: FloatArray
    o_before: FloatArray
    z: FloatArray
    o: FloatArray
    y_tilt: FloatArray
    o_tilt: FloatArray
    tip: FloatArray


def _quarter(angle: float) -> bool:
    """Whether a constant angle is a quarter turn, which takes no arithmetic but a change of sign."""
    return abs(cos(angle)) <= QUARTER


def _turn(
    first: FloatArray, second: FloatArray, c: FloatArray | float, s: FloatArray | float, spare: FloatArray
) -> None:
    """Turn axes (first, second), (3, n), towards one another by the angle with cosine c and sine s, in place."""
    near, far = spare
    np.multiply(second, s, out=near)
    np.multiply(first, s, out=far)
    np.multiply(first, c, out=first)
    np.multiply(second, c, out=second)
    np.add(first, near, out=first)
    np.subtract(second, far, out=second)


def _tilt(first: FloatArray, second: FloatArray, angle: float, spare: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes turned towards one another by a constant angle, in place or exchanged; quarter turns are exact."""
    if angle == 0.0:
        return first, second
    if not _quarter(angle):
        _turn(first, second, cos(angle), sin(angle), spare)
        return first, second
    changed = first if sin(angle) > 0 else second
    np.multiply(changed, -1.0, out=changed)
    return second, first


def _shift(o: FloatArray, axis: FloatArray, length: FloatArray | float, spare: FloatArray) -> None:
    """Move origins along an axis, (3, n), in place."""
    if not isinstance(length, float) or length != 0.0:
        np.add(o, np.multiply(axis, length, out=spare[0]), out=o)


def _zxz(R: FloatArray) -> tuple[float, float, float]:
    """Angles of the turns about z, x and z again that make a rotation (3, 3); zero where there is nothing to turn."""
    (xx, xy, xz), (yx, yy, yz), (_, _, zz) = R.tolist()
    first = atan2(xz, -yz) if xz or yz else 0.0
    c, s = cos(first), sin(first)
    return first, atan2(s * xz - c * yz, zz), atan2(-c * xy - s * yy, c * xx + s * yx)


@lru_cache(maxsize=256)
def _places(rows: tuple[Row, ...], tilts: tuple[float, float, float]) -> list[int]:
    """Where x, y and z have to be behind the last joint for quarter turns, which exchange them, to end in order."""
    axes = [0, 1, 2]
    turns = list[tuple[int, int, float]]()
    for alpha, _, theta, _, beta, _, slides in reversed(rows):
        turns += [(0, 1, theta if slides else 0.0), (0, 2, beta), (1, 2, alpha)]
    turns += [(0, 1, tilts[2]), (1, 2, tilts[1]), (0, 1, tilts[0])]
    for i, j, angle in turns:
        if _quarter(angle):
            axes[i], axes[j] = axes[j], axes[i]
    return [axes.index(k) for k in range(3)]


def _spread(
    small: FloatArray, turn: tuple[FloatArray, FloatArray] | None, out: Sequence[FloatArray], spare: FloatArray
) -> None:
    """Elements x, y and z of vectors, (3, k, 1), as arrays (k, n) turned about z by its cosines and sines (n,)."""
    for rows, values in zip(out, small, strict=True):
        rows[:] = values
    if turn is None:
        return
    cosine, sine = turn
    if len(cosine) <= FEW:
        _turn(out[1], out[0], cosine, sine, spare)
        return
    for k, (x, y) in enumerate(small[:2, :, 0].T.tolist()):
        for row, along, across in ((out[0][k], x, -y), (out[1][k], y, x)):
            if along:
                np.multiply(cosine, along, out=row)
            if across:
                product = np.multiply(sine, across, out=spare[0, 0] if along else row)
                if along:
                    np.add(row, product, out=row)


def _walk(
    table: DHMTable,
    joints: FloatArray,
    T_base_0: FloatArray,
    T_last_tip: FloatArray | None,
    columns: FloatArray,
    turns: FloatArray,
    spare: FloatArray,
) -> None:
    """The tip's x, y, z and origin in the base into the ``columns`` (4, 3, n), from joint to joint down to the base.

    y, z and the origin are taken along, as seen from each joint; x is the product of the other two. On the way up a
    length would have to be added along an axis, here it is one number more; and as far as the last joint all poses have
    the same vectors. ``joints`` (joints, n) are with the table's offsets, ``turns`` (2, joints, n) and ``spare``
    (2, 3, n) are room to work in.
    """
    if not len(table):
        columns[:] = (T_base_0 if T_last_tip is None else T_base_0 @ T_last_tip)[:3].T[:, :, None]
        return
    cosines, sines = cos_sin(joints, turns)
    tilts = _zxz(T_base_0[:3, :3])
    n = joints.shape[1]
    # elements x, y, z of the vectors: rows without gaps are worth a copy where they are short
    vectors = np.empty((3, 3, n)) if n <= FEW else columns[1:].swapaxes(0, 1)
    small = (np.eye(4)[:3] if T_last_tip is None else T_last_tip[:3].copy())[:, 1:, None]
    x, y, z = small
    room = np.empty((2, 3, 1))
    rows = table.rows
    for i in range(len(rows) - 1, -1, -1):
        alpha, a, theta, d, beta, b, slides = rows[i]
        if d and not slides:
            np.add(z[-1], d, out=z[-1])
        if i == len(rows) - 1:
            room = spare
            x, y, z = (vectors[k] for k in _places(rows, tilts))
            _spread(small, None if slides else (cosines[i], sines[i]), (x, y, z), room)
        elif not slides:
            _turn(y, x, cosines[i], sines[i], room)
        if slides:
            np.add(z[-1], joints[i], out=z[-1])
            y, x = _tilt(y, x, theta, room)
        if b:
            np.add(y[-1], b, out=y[-1])
        x, z = _tilt(x, z, beta, room)
        if a:
            np.add(x[-1], a, out=x[-1])
        z, y = _tilt(z, y, alpha, room)
    y, x = _tilt(y, x, tilts[2], room)
    z, y = _tilt(z, y, tilts[1], room)
    _tilt(y, x, tilts[0], room)
    np.add(vectors[:, -1], T_base_0[:3, 3:], out=vectors[:, -1])
    if n <= FEW:
        columns[1:] = vectors.swapaxes(0, 1)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(columns[1, i], columns[2, j], out=columns[0, k])
        np.multiply(columns[1, j], columns[2, i], out=spare[0, 0])
        np.subtract(columns[0, k], spare[0, 0], out=columns[0, k])


def chain_frames(
    table: DHMTable, joints: FloatArray, T_base_0: FloatArray, T_last_tip: FloatArray | None = None
) -> ChainFrames:
    """Axes and origins of every joint for a block of poses: all that derivatives need.

    Parameters
    ----------
    table : DHMTable
    joints : ndarray, shape (joints, n)
        Effective joints plus the table's `DHMTable.offsets`, radians (metres for prismatic joints).
    T_base_0 : ndarray, shape (4, 4)
    T_last_tip : ndarray, shape (4, 4), optional
        Identity unless given.
    """
    n = joints.shape[1]
    cosines, sines = cos_sin(joints)
    store, tip, spare = aligned(6, len(joints), 3, n), aligned(4, 3, n), aligned(2, 3, n)
    x, y, z, o = axes = aligned(4, 3, n)
    for k, column in enumerate(axes):
        column[:] = T_base_0[:3, k : k + 1]
    for i, (alpha, a, theta, d, beta, b, slides) in enumerate(table.rows):
        store[0, i], store[1, i] = x, o
        _shift(o, x, a, spare)
        y, z = _tilt(y, z, alpha, spare)
        store[4, i], store[5, i] = y, o
        z, x = _tilt(z, x, beta, spare)
        _shift(o, y, b, spare)
        if slides:
            x, y = _tilt(x, y, theta, spare)
            _shift(o, z, joints[i], spare)
        else:
            _turn(x, y, cosines[i], sines[i], spare)
            _shift(o, z, d, spare)
        store[2, i], store[3, i] = z, o
    tip[:] = 0.0
    tip[3] = o
    for column, factors in zip(tip, np.eye(4)[:3].T if T_last_tip is None else T_last_tip[:3].T, strict=True):
        for axis, factor in zip((x, y, z), factors.tolist(), strict=True):
            _shift(column, axis, factor, spare)
    x_before, o_before, z, o, y_tilt, o_tilt = handed_on(store)
    return ChainFrames(x_before, o_before, z, o, y_tilt, o_tilt, handed_on(tip))


def tip_columns(
    table: DHMTable, joints: FloatArray, T_base_0: FloatArray, T_last_tip: FloatArray | None = None
) -> FloatArray:
    """The tip frame's x, y, z axes and origin in the base frame, shape (4, 3, n); arguments as `chain_frames`."""
    n = joints.shape[1]
    tip = aligned(4, 3, n)
    with row_arithmetic():
        _walk(table, joints, T_base_0, T_last_tip, tip, aligned(2, len(joints), n), aligned(2, 3, n))
    return tip


def forward(
    table: DHMTable, theta: ArrayLike, T_base_0: FloatArray | None = None, T_last_tip: FloatArray | None = None
) -> FloatArray:
    """Forward kinematics for a batch: the product of all steps (Nubiola 2011, eqs. 6.1, 6.39 and 7.1).

    The steps are those of `DHMTable.step`. With a calibrated arm's table and effective joints it is the product of
    `irbcal.modeling.robot.Robot.forward`.

    Parameters
    ----------
    table : DHMTable
    theta : ndarray, shape (n, joints)
        Effective joints, radians and metres (the table's offsets are added here).
    T_base_0, T_last_tip : ndarray, shape (4, 4), optional
        Constant rigid transforms before frame 0 and after the last frame; identity unless given.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip`` of each pose.
    """
    theta = np.asarray(theta, dtype=float)
    T_base_0 = np.eye(4) if T_base_0 is None else T_base_0
    if T_last_tip is not None and np.array_equal(T_last_tip, np.eye(4)):
        T_last_tip = None
    n, joints = len(theta), len(table)
    out = np.empty((n, 4, 4))
    offsets = table.offsets[:, None]
    if n <= FEW:
        out[:, 3] = (0.0, 0.0, 0.0, 1.0)
        out[:, :3] = tip_columns(table, theta.T + offsets, T_base_0, T_last_tip).transpose(2, 1, 0)
        return out
    room = -(-min(n, BLOCK) // LINE) * LINE
    angles, turns, spare = aligned(joints, room), aligned(2, joints, room), aligned(2, 3, room)
    # elements of the matrices in their order, a row of numbers for each: transposed once a block
    elements = aligned(4, 4, room)
    elements[3] = np.array([0.0, 0.0, 0.0, 1.0])[:, None]
    with row_arithmetic():
        for start in range(0, n, BLOCK):
            block = slice(start, min(start + BLOCK, n))
            part = slice(0, block.stop - start)
            np.add(theta[block].T, offsets, out=angles[:, part])
            block_rows = elements[:, :, part]
            columns = block_rows[:3].swapaxes(0, 1)
            _walk(table, angles[:, part], T_base_0, T_last_tip, columns, turns[..., part], spare[..., part])
            out[block].reshape(-1, 16)[:] = block_rows.reshape(16, -1).T
    return out


def from_transform(T: FloatArray) -> tuple[float, float, float, float]:
    """DHM parameters of one step (Nubiola 2011, eqs. 5.3, 5.4, 5.5, 5.6 and 5.7).

    The length of d and its sign come in one: ``d = -A_24 sin(alpha) + A_34 cos(alpha)``, which is eqs. 5.6 and 5.7
    without a division of cases where ``cos(alpha)`` is zero.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        A transform of the form ``Rot(x, alpha) Trans(a, 0, 0) Rot(z, theta) Trans(0, 0, d)``.

    Returns
    -------
    tuple of float
        alpha, a, theta, d in radians and metres.

    Raises
    ------
    ValueError
        If the transform is not of that form (it would need Hayati's beta or another frame).
    """
    alpha = np.arctan2(-T[1, 2], T[2, 2])
    theta = np.arctan2(-T[0, 1], T[0, 0])
    d = -T[1, 3] * np.sin(alpha) + T[2, 3] * np.cos(alpha)
    row = DHMTable(*np.array([[alpha], [T[0, 3]], [theta], [d]]))
    if np.abs(row.step(0) - T).max() > 1e-9:
        raise ValueError("the transform is not one DHM step: axis z is not perpendicular to the previous x axis")
    return float(alpha), float(T[0, 3]), float(theta), float(d)
