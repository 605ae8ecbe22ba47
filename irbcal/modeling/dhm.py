"""Modified Denavit-Hartenberg geometry (Craig) and its forward kinematics for batches (Nubiola 2011, section 5.1).

One row of the table is the step from frame i-1 to frame i (eqs. 5.1 and 5.2), with Hayati's tilt
``beta`` about y in between for nearly parallel axes and a shift ``b`` along y (both zero in a plain DHM table)::

    A_i = Rot(x, alpha_i) Trans(a_i, 0, 0) Rot(y, beta_i) Trans(0, b_i, 0) Rot(z, theta_i) Trans(0, 0, d_i)

``beta_i`` tilts axis i about the point where it meets the common normal. All six numbers of a row together place a
joint anywhere near its nominal place: the general parametrisation, for which a plain table is too small. A joint adds
its angle to ``theta_i`` (revolute) or its travel to ``d_i`` (prismatic). The chain is walked
from the base to the tip with axes held as arrays of shape (3, poses), a block of poses at a time: no 4x4 products and
no loop over poses.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from math import cos, sin
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked, handed_on, lock, row_arithmetic
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.cos_sin import cos_sin
from irbcal.units import DEG, MM

BLOCK = 5120
"""Poses per block: few enough for the cache, and enough for the calls of numpy not to count."""

Row: TypeAlias = tuple[float, float, float, float, float, float, bool]
"""alpha, a, theta, d, beta, b of a joint, and whether it slides."""

QUARTER = 1e-15
"""Cosine below which a constant angle is a quarter turn: that of pi / 2 is 6e-17."""


@dataclass(frozen=True, eq=False, repr=False)
class DHMTable:
    """DHM parameters of a serial arm with ``n`` joints (Nubiola 2011, Table 5.1 is that of the IRB 1600).

    Notes
    -----
    The arrays are copied and locked; use `dataclasses.replace` for a changed table.
    """

    alpha: FloatArray
    a: FloatArray
    theta: FloatArray
    d: FloatArray
    """Shape (n,). Radians and metres; ``theta`` (``d`` of a prismatic joint) is the joint's offset, added to the
    effective joint.
    """
    beta: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Shape (n,). Hayati tilt about y, radians; zero unless given."""
    b: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Shape (n,). Shift along y, metres; zero unless given."""
    prismatic: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Shape (n,). Which joints slide along z; none unless given."""

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
    """Axes and origins along the chain for a block of poses, all in the base frame."""

    x_before: FloatArray
    o_before: FloatArray
    """Shape (joints, 3, n). x axis and origin of frame i-1: what alpha_i turns about and a_i moves along."""
    z: FloatArray
    o: FloatArray
    """Shape (joints, 3, n). z axis and origin of frame i: what theta_i turns about and d_i moves along."""
    y_tilt: FloatArray
    o_tilt: FloatArray
    """Shape (joints, 3, n). Axis and point that Hayati's beta_i turns about; b_i moves along it."""
    tip: FloatArray
    """Shape (4, 3, n). x, y, z axes and origin of the tip frame."""


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
    if abs(cos(angle)) > QUARTER:
        _turn(first, second, cos(angle), sin(angle), spare)
        return first, second
    changed = first if sin(angle) > 0 else second
    np.multiply(changed, -1.0, out=changed)
    return second, first


def _shift(o: FloatArray, axis: FloatArray, length: FloatArray | float, spare: FloatArray) -> None:
    """Move origins along an axis, (3, n), in place."""
    if not isinstance(length, float) or length != 0.0:
        np.add(o, np.multiply(axis, length, out=spare[0]), out=o)


def _walk(
    table: DHMTable,
    joints: FloatArray,
    T_base_0: FloatArray,
    T_last_tip: FloatArray | None,
    store: FloatArray | None = None,
) -> FloatArray:
    """The tip's x, y, z axes and origin, (4, 3, n); ``store`` (6, joints, 3, n) takes what `ChainFrames` has."""
    cosines, sines = cos_sin(joints)
    axes, tip, spare = (np.empty((k, 3, joints.shape[1])) for k in (4, 4, 2))
    axes[:] = T_base_0[:3].T[:, :, None]
    x, y, z, o = axes
    for i, (alpha, a, theta, d, beta, b, slides) in enumerate(table.rows):
        if store is not None:
            store[0, i], store[1, i] = x, o
        _shift(o, x, a, spare)
        y, z = _tilt(y, z, alpha, spare)
        if store is not None:
            store[4, i], store[5, i] = y, o
        z, x = _tilt(z, x, beta, spare)
        _shift(o, y, b, spare)
        if slides:
            x, y = _tilt(x, y, theta, spare)
            _shift(o, z, joints[i], spare)
        else:
            _turn(x, y, cosines[i], sines[i], spare)
            _shift(o, z, d, spare)
        if store is not None:
            store[2, i], store[3, i] = z, o
    tip[:] = 0.0
    tip[3] = o
    for column, factors in zip(tip, (np.eye(4) if T_last_tip is None else T_last_tip)[:3].T, strict=True):
        for axis, factor in zip((x, y, z), factors.tolist(), strict=True):
            _shift(column, axis, factor, spare)
    return tip


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
    store = np.empty((6, len(joints), 3, joints.shape[1]))
    tip = _walk(table, joints, T_base_0, T_last_tip, store)
    x_before, o_before, z, o, y_tilt, o_tilt = handed_on(store)
    return ChainFrames(x_before, o_before, z, o, y_tilt, o_tilt, handed_on(tip))


def tip_columns(
    table: DHMTable, joints: FloatArray, T_base_0: FloatArray, T_last_tip: FloatArray | None = None
) -> FloatArray:
    """The tip frame's x, y, z axes and origin in the base frame, shape (4, 3, n); arguments as `chain_frames`."""
    with row_arithmetic():
        return _walk(table, joints, T_base_0, T_last_tip)


def forward(
    table: DHMTable, theta: ArrayLike, T_base_0: FloatArray | None = None, T_last_tip: FloatArray | None = None
) -> FloatArray:
    """Forward kinematics for a batch: the product of all steps (Nubiola 2011, eqs. 6.1, 6.39 and 7.1).

    The steps are those of `DHMTable.step`. With a calibrated arm's table and effective joints it is the product of
    `irbcal.modeling.robot.Robot.forward`.

    Parameters
    ----------
    table : DHMTable
    theta : array_like, shape (n, joints) or (joints,)
        Effective joints, radians and metres (the table's offsets are added here).
    T_base_0, T_last_tip : ndarray, shape (4, 4), optional
        Constant rigid transforms before frame 0 and after the last frame; identity unless given.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip`` of each pose; n is 1 for one pose of shape (joints,).

    Raises
    ------
    RobotError
        If the joints have another shape.
    """
    theta = np.asarray(theta, dtype=float)
    theta = theta[None] if theta.ndim == 1 else theta
    if theta.shape[1:] != table.alpha.shape:
        raise RobotError(f"joints need shape (n, {len(table)}), found {theta.shape}", parameter="theta")
    T_base_0 = np.eye(4) if T_base_0 is None else T_base_0
    out = np.zeros((len(theta), 4, 4))
    out[:, 3, 3] = 1.0
    for start in range(0, len(theta), BLOCK):
        block = slice(start, start + BLOCK)
        columns = tip_columns(table, theta[block].T + table.offsets[:, None], T_base_0, T_last_tip)
        out[block, :3] = columns.transpose(2, 1, 0)
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
