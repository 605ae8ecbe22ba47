"""What every kind of row at a feature has: its unknowns, what it sees, what it misses; and the algebra of the kinds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.features import Feature
from irbcal.modeling import frames
from irbcal.units import DEG, MM

UnknownShape: TypeAlias = Literal["place", "number", "turn", "axis", "line", "frame", "screw"]
"""What an unknown is: a place (3,), a number (1,), a rotation (3, 3), an axis (its third column, (3, 3)), a line
through a place (3, 4), a frame (4, 4), or the screw of an external axis (6,)."""

DIMENSIONS: Mapping[UnknownShape, int] = {
    "place": 3,
    "number": 1,
    "turn": 3,
    "axis": 2,
    "line": 4,
    "frame": 6,
    "screw": 6,
}

STEP_OF_UNIT: Mapping[str, float] = {"m": MM, "rad": 1e-3, "px": 1.0, "": 1e-3}
"""Step of an unknown by its unit, that of one column of the linear model."""

DISPLAY_UNITS: Mapping[str, float] = {"m": MM, "rad": DEG, "px": 1.0, "": 1.0}
"""Unit in which an unknown is shown: millimetres, degrees, pixels."""


@dataclass(frozen=True)
class Unknown:
    """An unknown of a kind."""

    shape: UnknownShape
    owner: Literal["feature", "target"] = "feature"
    """Whether each ``feature`` has its own, or each ``target`` of the tool."""
    unit: Literal["m", "rad", "px", ""] = "m"
    """Of its steps: ``m``, ``rad``, ``px``, or nothing for numbers without one; see `STEP_OF_UNIT`."""

    def entries(self, name: str, value: FloatArray) -> dict[str, list[float]]:
        """A value under its name, as people and files have it, in `DISPLAY_UNITS`.

        A turn is its angles about x, y and z, an axis its direction, and a line has a point, too.
        """
        if self.shape in ("axis", "line"):
            point = {"through": (value[:, 3] / MM).tolist()} if self.shape == "line" else {}
            return {name: value[:, 2].tolist()} | point
        numbers = frames.to_xyz_angles(frames.transform(value))[3:] if self.shape == "turn" else np.ravel(value)
        return {name: (numbers / DISPLAY_UNITS[self.unit]).tolist()}

    def value(self, name: str, entries: Mapping[str, Sequence[float]]) -> FloatArray:
        """The value that `entries` gave."""
        numbers = np.array(entries[name])
        if self.shape == "axis":
            return frames.with_third(numbers)
        if self.shape == "line":
            return np.column_stack([frames.with_third(numbers), np.array(entries["through"]) * MM])
        numbers = numbers * DISPLAY_UNITS[self.unit]
        return frames.from_xyz_angles(np.r_[np.zeros(3), numbers])[:3, :3] if self.shape == "turn" else numbers


@dataclass(frozen=True, eq=False)
class Observed:
    """Rows at one feature with one target."""

    feature: Feature
    """What is known of it."""
    p: FloatArray
    """Shape (m, 3). The tool's point, metres, in the frame in which the feature is known or sought: the base link if
    that is open.
    """
    R: FloatArray
    """Shape (m, 3, 3). Axes of the tip link in that frame."""
    value: FloatArray
    """Shape (m,). Metres or radians; NaN where there is none."""
    xyz: FloatArray
    """Shape (m, 3). As written in the file, metres; NaN likewise."""
    rotation: FloatArray
    """Shape (m, 3, 3). Measured orientations, NaN likewise."""
    corners: FloatArray | None = None
    """Shape (m, n, 5 or 6). Of images, see `irbcal.measurement.imaging.Images`."""
    known_values: Mapping[str, FloatArray] = field(default_factory=dict)
    """Unknowns of the kind that are known already, for a start of the others."""

    def in_image(self) -> FloatArray:
        """Corners of images, see `corners`; of single pixels one in each, shape (m, 1, 5)."""
        assert self.corners is not None
        return self.corners


@dataclass(frozen=True, eq=False)
class PriorValue:
    """What is known of an unknown beforehand: a value and how well it is known, SI units or pixels."""

    value: FloatArray
    u95: float


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of some rows and the derivatives of what is predicted there, as those of a tracker's points are."""

    r: FloatArray
    """Shape (m, k). Measured minus predicted, metres; what is measured is zero where the tool touches something."""
    point: FloatArray
    """Shape (m, k, 3). By the tool's point."""
    by_unknown: Mapping[str, FloatArray]
    """Values of shape (m, k, d). By the kind's unknowns."""
    turn: FloatArray | None = None
    """Shape (m, k, 3). By a turn of the tool about its point."""
    size: FloatArray | None = None
    """Shape (m,). How far a row is from what was seen, metres; the length of its first three residuals unless given."""


class Kind(ABC):
    """What is known of the tool at a row."""

    name: ClassVar[str]
    shown_as: ClassVar[str] = ""
    """What is drawn of its features, as a label says it; its name unless given."""
    size: ClassVar[int]
    """Residuals of a row."""
    unknowns: ClassVar[Mapping[str, Unknown]]
    """Its unknowns; ``centre`` may be known instead, in the measuring frame."""
    needs: ClassVar[tuple[str, ...]] = ()
    """What each row must have: ``value``, ``xyz``, ``rotation``, ``corners``."""
    metric: ClassVar[bool] = False
    """Whether it measures a length of the size of the arm."""
    shape_only: ClassVar[bool] = False
    """Whether it says no more than that points lie on a surface or line whose place is unknown."""
    spread: ClassVar[bool] = False
    """Whether rows at one feature are at many places of the tool."""
    pointed: ClassVar[bool] = True
    """Whether the tool's point matters, not only its attitude."""
    lever: ClassVar[float] = 1.0
    """What a unit of the row's value is in its residual, metres: 1 of lengths, `LEVER` of angles."""

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """Unknowns that are known of a feature, but for its centre."""
        return {}

    def priors(self, feature: Feature) -> dict[str, PriorValue]:
        """What is known of unknowns beforehand, with its uncertainty."""
        return {}

    def scale_of(self, feature: Feature) -> str:
        """The known length that gives the robot its scale, where it is a part of the feature."""
        return ""

    def doubt(self, obs: Observed, misses: Residuals) -> str:
        """What speaks against what is known of the feature, in a sentence; nothing where nothing does."""
        return ""

    @abstractmethod
    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """Residuals, and derivatives of what is predicted, at values of the kind's unknowns."""

    @abstractmethod
    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Unknowns of the kind where the tool's point is known, in closed form."""

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """The tool's point in the tip link where ``obs.p`` is the tip itself, in closed form, and how firmly.

        Returns
        -------
        (t, H) or None
            Shape (3,), metres, and information of it, (3, 3); None where these rows do not tell.
        """
        return None


def moved(shape: UnknownShape, value: FloatArray, step: FloatArray) -> FloatArray:
    """An unknown after a step; turns step on the left, axes and frames in their own axes."""
    if shape in ("place", "number", "screw"):
        return value + step
    if shape == "turn":
        return np.asarray(frames.rotation_from_one(step) @ value)
    if shape == "frame":
        return np.asarray(value @ frames.transform(frames.rotation_from_one(step[:3]), step[3:]))
    Q = value[:, :3] @ frames.rotation_from_one(np.array([step[0], step[1], 0.0]))
    if shape == "axis":
        return np.asarray(Q)
    return np.column_stack([Q, value[:, 3] + value[:, :2] @ step[2:]])


def eliminated(A_t: FloatArray, columns: list[FloatArray], b: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Least squares of ``A_t t + A_o o = b`` for t alone, with its information; None where it is not determined.

    Parameters
    ----------
    A_t : ndarray, shape (m, k, 3)
    columns : list of ndarray, shape (m, k, any)
    b : ndarray, shape (m, k)
    """
    rows = b.size
    matrix = np.concatenate(columns, axis=2).reshape(rows, -1)
    if rows < 3 + matrix.shape[1]:
        return None
    U, s, _ = np.linalg.svd(matrix, full_matrices=False)
    U = U[:, s > 1e-10 * s[0]]
    A = A_t.reshape(rows, 3)
    A = A - U @ (U.T @ A)
    H = A.T @ A
    if np.linalg.eigvalsh(H)[0] < 1e-6 * rows:
        return None
    return np.asarray(np.linalg.solve(H, A.T @ b.ravel()), dtype=float), H


def ones(m: int) -> FloatArray:
    """Identity matrices, shape (m, 3, 3)."""
    return np.tile(np.eye(3), (m, 1, 1))


def distance(p: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (m,) from a place, and their derivatives by the points (m, 1, 3)."""
    d = np.linalg.norm(p - c, axis=1)
    return d, ((p - c) / np.maximum(d, 1e-12)[:, None])[:, None]


def ball(p: FloatArray) -> tuple[FloatArray, float]:
    """Centre of the sphere through points, and ``|c|^2 - R^2``; where they are at one place, that."""
    middle = p.mean(axis=0)
    local = p - middle
    x = np.linalg.lstsq(np.hstack([2.0 * local, np.ones((len(p), 1))]), np.sum(local**2, axis=1), rcond=1e-8)[0]
    c = x[:3] + middle
    return c, float(c @ c - (x[3] + x[:3] @ x[:3]))


def ball_tool(
    obs: Observed, more: tuple[FloatArray, ...], square: FloatArray | None = None
) -> tuple[FloatArray, FloatArray] | None:
    """The tool's point of rows on a sphere (or with ``square`` the squared radius of each row, and columns more)."""
    m = len(obs.p)
    middle = obs.p.mean(axis=0)  # lengths that cancel less
    p = obs.p - middle
    A = 2.0 * np.einsum("mij,mi->mj", obs.R, p)
    columns = [-2.0 * obs.R.reshape(m, 9), -2.0 * p, np.ones((m, 1)), *(-2.0 * column for column in more)]
    b = -np.sum(p**2, axis=1) + (0.0 if square is None else square)
    return eliminated(A[:, None], [column[:, None] for column in columns], b[:, None])


def null(A: FloatArray) -> FloatArray | None:
    """The null vector of a matrix, columns scaled; None where there is more than one."""
    if len(A) < A.shape[1]:
        return None
    scale = np.linalg.norm(A, axis=0)
    s, V = np.linalg.svd(A / scale, full_matrices=False)[1:]
    return None if s[-2] < 1e-4 * s[0] else V[-1] / scale


def rotation(M: FloatArray) -> FloatArray:
    """The rotation nearest to what linear least squares leaves of one; identity where it leaves nothing."""
    if not np.isfinite(M).all() or np.linalg.norm(M) < 1e-9:
        return np.eye(3)
    return np.asarray(frames.nearest_rotation(M))


def left_inverse(e: FloatArray) -> FloatArray:
    """Inverse of the left Jacobian of the exponential at rotation vectors (m, 3), shape (m, 3, 3)."""
    angle = np.linalg.norm(e, axis=1)
    half = 0.5 * angle
    with np.errstate(invalid="ignore", divide="ignore"):
        k = np.where(angle < 1e-4, 1.0 / 12.0, (1.0 - half / np.tan(half)) / angle**2)
    K = frames.cross_matrix(e)
    return np.eye(3) - 0.5 * K + k[:, None, None] * (K @ K)
