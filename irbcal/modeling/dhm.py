"""Modified Denavit-Hartenberg geometry (Craig) and its forward kinematics for batches (Nubiola 2011, section 5.1).

One row of the table is the step from frame i-1 to frame i (eqs. 5.1 and 5.2), with Hayati's tilt
``beta`` about y in between for nearly parallel axes and a shift ``b`` along y (both zero in a plain DHM table)::

    A_i = Rot(x, alpha_i) Trans(a_i, 0, 0) Rot(y, beta_i) Trans(0, b_i, 0) Rot(z, theta_i) Trans(0, 0, d_i)

``beta_i`` tilts axis i about the point where it meets the common normal. All six numbers of a row together place a
joint anywhere near its nominal place: the general parametrisation, for which a plain table is too small. A joint adds
its angle to ``theta_i`` (revolute) or its travel to ``d_i`` (prismatic). Forward kinematics walks the
chain with the axes of the moving frame held as arrays of shape (3, poses), a block of poses at a time:
no 4x4 products and no loop over poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.modeling import frames
from irbcal.modeling.cos_sin import cos_sin
from irbcal.units import DEG, MM

BLOCK = 4096
"""Poses per block: the working set of a block stays in the processor's cache."""

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

    def step(self, i: int, value: float = 0.0) -> FloatArray:
        """Transform ``T_{i-1}_i`` of row ``i`` (counted from 0) at an effective joint angle (rad) or travel (m).

        It is the product of Nubiola 2011, eq. 5.1, multiplied out in eq. 5.2.
        """
        angle, travel = (0.0, value) if self.prismatic[i] else (value, 0.0)
        before = frames.transform(frames.rot_x(self.alpha[i])) @ frames.transform(None, [self.a[i], 0.0, 0.0])
        tilt = frames.transform(frames.rot_y(self.beta[i]), [0.0, self.b[i], 0.0])
        turn = frames.transform(frames.rot_z(self.theta[i] + angle))
        return before @ tilt @ turn @ frames.transform(None, [0.0, 0.0, self.d[i] + travel])


@dataclass(frozen=True, eq=False, repr=False)
class ChainFrames:
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

    def __post_init__(self) -> None:
        lock(self)


def _turn(
    first: FloatArray, second: FloatArray, c: FloatArray | float, s: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Axes (first, second) turned towards one another by the angle with cosine c and sine s."""
    near, far = c * first, s * second
    left, right = c * second, s * first
    if near.shape != far.shape:  # one of them still has one column
        return near + far, left - right
    near += far
    left -= right
    return near, left


def _tilt(first: FloatArray, second: FloatArray, angle: float) -> tuple[FloatArray, FloatArray]:
    """Axes turned towards one another by a constant angle; quarter turns are exact."""
    c, s = np.cos(angle), np.sin(angle)
    if abs(c) > QUARTER:
        return _turn(first, second, c, s)
    return (second, -first) if s > 0 else (-second, first)


def _walk(
    table: DHMTable, joints: FloatArray, T_base_0: FloatArray, T_last_tip: FloatArray | None, store: FloatArray | None
) -> Sequence[FloatArray]:
    """Walk the chain; ``joints`` (joints, n) are with the table's offsets. ``store`` receives each joint's axes."""
    n = joints.shape[1]
    # columns of constant transforms have one column: they cost nothing until the first joint turns them
    x, y, z, o = (T_base_0[:3, k : k + 1] for k in range(4))
    cosines, sines = cos_sin(joints)
    for i in range(len(table.a)):
        x_before, o_before = x, o
        if table.a[i] != 0.0:
            o = o + table.a[i] * x
        if table.alpha[i] != 0.0:
            y, z = _tilt(y, z, table.alpha[i])
        y_tilt, o_tilt = y, o
        if table.beta[i] != 0.0:
            z, x = _tilt(z, x, table.beta[i])
        if table.b[i] != 0.0:
            o = o + table.b[i] * y
        if table.prismatic[i]:
            x, y = _tilt(x, y, table.theta[i])
            o = o + joints[i] * z
        else:
            x, y = _turn(x, y, cosines[i], sines[i])
            if table.d[i] != 0.0:
                o = o + table.d[i] * z
        if store is not None:
            for array, value in zip(store, (x_before, o_before, z, o, y_tilt, o_tilt), strict=True):
                array[i] = value
    if T_last_tip is None:
        return x, y, z, np.broadcast_to(o, (3, n))
    R, p = T_last_tip[:3, :3], T_last_tip[:3, 3]
    return [R[0, k] * x + R[1, k] * y + R[2, k] * z for k in range(3)] + [o + p[0] * x + p[1] * y + p[2] * z]


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

    Returns
    -------
    ChainFrames
    """
    store = np.empty((6, len(joints), 3, joints.shape[1]))
    tip = tip_columns(table, joints, T_base_0, T_last_tip, store)
    for array in (store, tip):  # nobody else has them: locked without a copy
        array.setflags(write=False)
    x_before, o_before, z, o, y_tilt, o_tilt = store
    return ChainFrames(x_before, o_before, z, o, y_tilt, o_tilt, tip)


def tip_columns(
    table: DHMTable,
    joints: FloatArray,
    T_base_0: FloatArray,
    T_last_tip: FloatArray | None = None,
    store: FloatArray | None = None,
) -> FloatArray:
    """The tip frame's x, y, z axes and origin in the base frame, shape (4, 3, n); arguments as `chain_frames`."""
    tip = np.empty((4, 3, joints.shape[1]))
    for k, column in enumerate(_walk(table, joints, T_base_0, T_last_tip, store)):
        tip[k] = column
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
        Constant transforms before frame 0 and after the last frame; identity unless given.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip`` of each pose.
    """
    theta = np.asarray(theta, dtype=float)
    T_base_0 = np.eye(4) if T_base_0 is None else T_base_0
    if T_last_tip is not None and np.array_equal(T_last_tip, np.eye(4)):
        T_last_tip = None
    n = len(theta)
    # rows of the 4x4 matrices: filled column by column, transposed once per block
    out = np.empty((n, 4, 4))
    out[:, 3] = (0.0, 0.0, 0.0, 1.0)
    offsets = table.offsets[:, None]
    for start in range(0, n, BLOCK):
        block = slice(start, min(start + BLOCK, n))
        joints = np.ascontiguousarray(theta[block].T) + offsets
        for k, column in enumerate(_walk(table, joints, T_base_0, T_last_tip, None)):
            out[block, :3, k] = column.T
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
