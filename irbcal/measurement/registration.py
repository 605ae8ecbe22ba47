"""Registration: bring every pose's points into the frame of the reference points.

References are reflectors fixed to the ground. What moves them between poses is the tracker (drift, a changed
station), so the rigid motion that takes them back to their common places takes it out of the targets too.

References are measured with noise like all else, and a pose's own references put theirs on all its targets. A station
drifts slowly: how much of the motion from pose to pose is drift and how much is noise is estimated from the data, and
the noise is taken out (`without_noise`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM


@dataclass(frozen=True, eq=False, repr=False)
class Registration(Result):
    """Motion of the measuring frame over the poses."""

    references: Mapping[str, FloatArray]
    """Values of shape (3,). Common place of each reference, metres; the measuring frame is defined by them."""
    T_frame_pose: FloatArray
    """Shape (n, 4, 4). From coordinates as measured in a pose to the measuring frame."""
    with_references: BoolArray
    """Shape (n,). Whether a pose saw three references itself; other poses are interpolated between their neighbours."""
    residual: float
    """Root mean square distance of the references from their places after registration, metres."""

    @property
    def largest_shift(self) -> float:
        """Largest motion of the references' centre between any pose and the measuring frame, metres."""
        centre = np.mean(list(self.references.values()), axis=0)
        moved = self.T_frame_pose[:, :3, :3] @ centre + self.T_frame_pose[:, :3, 3]
        return float(np.linalg.norm(moved - centre, axis=1).max())

    def report(self) -> Sequence[Paragraph]:
        """How well the references agree, and their places."""
        rows = tuple((name, *(xyz / MM).tolist()) for name, xyz in self.references.items())
        return [
            f"{int(self.with_references.sum())} of {len(self.with_references)} poses saw three of "
            f"{len(self.references)} references; residual "
            f"{self.residual / MM:.4f} mm rms, largest shift {self.largest_shift / MM:.4f} mm",
            Table("Places of the references, mm", ("reference", "x", "y", "z"), rows),
        ]


def register(
    measured: FloatArray,
    names: Sequence[str],
    source: str,
    references: Mapping[str, FloatArray] | None = None,
    plural: str = "reference points",
) -> Registration | None:
    """Rigid motion of every pose from its reference points (Nubiola 2011, section 7.1: the arbitrary base).

    Parameters
    ----------
    measured : ndarray, shape (n, k, 3)
        References as measured in each pose, metres; NaN where not seen.
    names : sequence of str, length k
    source : str
        File name for messages.
    references : dict of str to ndarray, optional
        Places of the references in an earlier calibration, to register to; by default the common places in
        these data.
    plural : str
        What the points are called in messages.

    Returns
    -------
    Registration or None
        None if no pose saw three references.

    Raises
    ------
    MeasurementError
        If the references lie on a line: the rotation about it would be unknown.
    """
    if references is not None:
        use = [k for k, name in enumerate(names) if name in references]
        measured, names = measured[:, use], [names[k] for k in use]
    visible = np.asarray(np.isfinite(measured).all(axis=2))
    registered = visible.sum(axis=1) >= 3
    if not registered.any():
        return None
    common = (
        _common_places(measured, visible, registered)
        if references is None
        else np.array([references[name] for name in names])
    )
    seen_often = np.isfinite(common).all(axis=1)
    visible = visible & seen_often
    registered = visible.sum(axis=1) >= 3
    spread = np.linalg.svd(common[seen_often] - common[seen_often].mean(axis=0), compute_uv=False)
    if spread[1] < 0.02 * spread[0]:
        raise MeasurementError(
            f"the {plural} {', '.join(names)} lie on a line: the rotation about it is unknown", file=source
        )
    T = _motions(measured, visible, registered, common)
    error = _moved(T[registered], measured[registered]) - common
    residual = float(np.sqrt(np.nanmean(np.sum(error**2, axis=2))))
    references = {name: xyz for name, xyz, ok in zip(names, common, seen_often, strict=True) if ok}
    return Registration(references, _interpolated(T, registered), registered, residual)


JUMP = 8.0
"""Standard deviations of the noise by which the station moves from one pose to the next where it was set up anew; as
many times the median of such motions, too."""
SHORTEST = 8
"""Poses from one set-up of the station whose motions tell drift from noise."""
SILENT = 1e-8
"""Noise of a reference below which there is none to take out, metres."""
LOG_RATIOS = -20.0, 20.0
"""Of the drift's variance from pose to pose to the noise's: logarithms between which it is looked for."""


def without_noise(registration: Registration, measured: FloatArray, names: Sequence[str]) -> Registration:
    """The registration with the station's motion smoothed over the poses.

    Six numbers of each pose's motion, three turns about the references' centroid and its shift, are a random walk plus
    noise. The noise is what the references' distances from their common places say; the walk's variance is the most
    probable one. Where the station was set up anew a new walk begins.

    Parameters
    ----------
    registration : Registration
    measured : ndarray, shape (n, k, 3)
        References that it was made from, metres; NaN where not seen.
    names : sequence of str, length k

    Returns
    -------
    Registration
        The same where the references have no noise, or poses are too few.
    """
    use = [k for k, name in enumerate(names) if name in registration.references]
    common = np.array([registration.references[names[k]] for k in use])
    poses = np.flatnonzero(registration.with_references)
    points, T = measured[poses][:, use], registration.T_frame_pose[poses]
    visible = np.isfinite(points).all(axis=2)
    errors = _moved(T, points) - common
    freedom = 3 * int(visible.sum()) - 6 * len(poses) - 3 * len(use) + 6
    noise = np.sqrt(np.nansum(errors**2) / max(freedom, 1))
    if noise < SILENT or freedom < 1:
        return registration
    centre = common.mean(axis=0)
    arms = common - centre
    _, axes = np.linalg.eigh(arms.T @ arms)
    across = np.sum(arms**2, axis=1)[:, None] - (arms @ axes) ** 2  # squared distances from each axis
    turns = np.maximum(visible @ across, 1e-12)
    variance = noise**2 / np.column_stack([turns, np.repeat(visible.sum(axis=1)[:, None], 3, axis=1)])

    def motion(T: FloatArray) -> FloatArray:
        """Turns about the axes and shift of the centroid, shape (n, 6)."""
        shift = T[:, :3, :3] @ centre + T[:, :3, 3] - centre
        return np.column_stack([frames.vector_from_rotation(T[:, :3, :3]) @ axes, shift])

    steps = np.abs(motion(T[1:] @ frames.inverse(T[:-1]))) / np.sqrt(variance[1:] + variance[:-1])
    usual = np.median(steps, axis=0) if len(steps) else np.zeros(6)
    anew = 1 + np.flatnonzero((steps > JUMP * np.maximum(usual, 1.0)).any(axis=1))
    smooth = registration.T_frame_pose.copy()
    for rows in np.split(np.arange(len(poses)), anew):
        if len(rows) < SHORTEST:
            continue
        T_middle = T[rows[len(rows) // 2]]
        x = motion(T[rows] @ frames.inverse(T_middle))
        x = np.column_stack([_smoothed(column, r) for column, r in zip(x.T, variance[rows].T, strict=True)])
        correction = np.tile(np.eye(4), (len(rows), 1, 1))
        correction[:, :3, :3] = frames.rotation_from_vector(x[:, :3] @ axes.T)
        correction[:, :3, 3] = x[:, 3:] + centre - correction[:, :3, :3] @ centre
        smooth[poses[rows]] = correction @ T_middle
    return replace(registration, T_frame_pose=_interpolated(smooth, registration.with_references))


def _smoothed(y: FloatArray, variance: FloatArray) -> FloatArray:
    """Most probable random walk behind numbers with noise of known variance, both of shape (n,).

    The cosine transform makes the walk's numbers independent of one another, with the variance
    ``q / (2 - 2 cos(pi j / n))``: by it q is the most probable one (with the mean variance of the noise).
    """
    n, r = len(y), float(variance.mean())
    folded = np.fft.fft(np.r_[y[::2], y[1::2][::-1]])[1:]  # the cosine transform of Makhoul 1980
    squares = (folded * np.exp(-0.5j * np.pi * np.arange(1, n) / n)).real ** 2 * 2.0 / n
    spectrum = 1.0 / (2.0 - 2.0 * np.cos(np.pi * np.arange(1, n) / n))

    def unlikely(log_ratio: float) -> float:
        total = r * (1.0 + np.exp(log_ratio) * spectrum)
        return float(np.sum(np.log(total) + squares / total))

    q = r * np.exp(_lowest(unlikely, *LOG_RATIOS))
    diagonal = 1.0 / variance + np.r_[1.0, np.full(n - 2, 2.0), 1.0] / q
    return _tridiagonal(diagonal, np.full(n - 1, -1.0 / q), y / variance)


def _lowest(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one minimum between two ends has it, to 1e-6: golden sections."""
    share = (np.sqrt(5.0) - 1.0) / 2.0
    lower_probe, upper_probe = high - share * (high - low), low + share * (high - low)
    at_left, at_right = function(lower_probe), function(upper_probe)
    while high - low > 1e-6:
        if at_left < at_right:
            high, upper_probe, at_right = upper_probe, lower_probe, at_left
            lower_probe = high - share * (high - low)
            at_left = function(lower_probe)
        else:
            low, lower_probe, at_left = lower_probe, upper_probe, at_right
            upper_probe = low + share * (high - low)
            at_right = function(upper_probe)
    return (low + high) / 2.0


def _tridiagonal(diagonal: FloatArray, beside: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of a symmetric, diagonally dominant tridiagonal system: every second unknown is eliminated."""
    if len(diagonal) == 1:
        return right / diagonal
    x = np.empty_like(right)
    lower, upper = beside[::2], beside[1::2]  # of unknown 1, 3 ...; the last may have none after it
    n = len(lower)
    low, high = lower / diagonal[: 2 * n : 2], upper / diagonal[2::2]
    fewer, reduced = diagonal[1::2] - low * lower, right[1::2] - low * right[: 2 * n : 2]
    fewer[: len(upper)] -= high * upper
    reduced[: len(upper)] -= high * right[2::2]
    x[1::2] = _tridiagonal(fewer, -high[: n - 1] * lower[1:], reduced)
    even = right[::2].copy()
    even[:n] -= lower * x[1::2]
    even[1:] -= upper * x[1::2][: len(upper)]
    x[::2] = even / diagonal[::2]
    return x


def _moved(T: FloatArray, points: FloatArray) -> FloatArray:
    return np.einsum("nij,nkj->nki", T[:, :3, :3], points) + T[:, None, :3, 3]


def _common_places(measured: FloatArray, visible: BoolArray, registered: BoolArray) -> FloatArray:
    """Mean place of each reference once all poses are laid over one another (generalised Procrustes).

    The iteration starts from the middle of the poses as measured; where the tracker changed its station, so
    that there is no such middle, from the pose that saw most references. References that no registered pose
    saw stay NaN.
    """
    fullest = np.flatnonzero(registered)[np.argmax(visible[registered].sum(axis=1))]
    middle = np.full(measured.shape[1:], np.nan)
    for k in np.flatnonzero(visible[registered].any(axis=0)):
        middle[k] = np.median(measured[registered & visible[:, k], k], axis=0)
    common = middle.copy() if _same_shape(middle, measured[fullest]) else measured[fullest].copy()
    # converges at once where every pose saw every reference, slowly where each saw different ones
    for _ in range(min(1000, max(50, 2_000_000 // len(measured)))):
        usable = visible & np.isfinite(common).all(axis=1)
        enough = usable.sum(axis=1) >= 3
        points = _moved(_motions(measured, usable, enough, common), measured)
        usual = np.isfinite(points).all(axis=2).any(axis=0)
        new = np.full_like(common, np.nan)
        new[usual] = np.nanmean(points[:, usual], axis=0)
        change = np.nanmax(np.abs(new - common)) if np.array_equal(np.isnan(new), np.isnan(common)) else np.inf
        common = new
        if change < 1e-12:
            break
    ok = np.isfinite(common).all(axis=1)
    return frames.apply(frames.rigid_fit(common[ok], middle[ok]), common)


def _same_shape(first: FloatArray, second: FloatArray, tolerance: float = 5e-3) -> bool:
    """Whether two sets of points have the same distances, within 5 mm, where both are known."""
    common = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    distances = [np.linalg.norm(p[common][:, None] - p[common], axis=2) for p in (first, second)]
    return bool(np.abs(distances[0] - distances[1]).max() < tolerance)


def _motions(measured: FloatArray, visible: BoolArray, registered: BoolArray, common: FloatArray) -> FloatArray:
    """Rigid motions of the poses with three references, one batch for each pattern of visibility."""
    T = np.full((len(measured), 4, 4), np.nan)
    patterns, which = np.unique(visible, axis=0, return_inverse=True)
    which = which.ravel()
    for k, pattern in enumerate(patterns):
        rows = np.flatnonzero((which == k) & registered)
        if len(rows):
            target = np.broadcast_to(common[pattern], (len(rows), pattern.sum(), 3))
            T[rows] = frames.rigid_fit(measured[rows][:, pattern], target)
    return T


def _interpolated(T: FloatArray, registered: BoolArray) -> FloatArray:
    """Fill poses without their own registration linearly between their neighbours in time."""
    if registered.all():
        return T
    at, have = np.arange(len(T)), np.flatnonzero(registered)
    vectors = np.column_stack([frames.vector_from_rotation(T[registered, :3, :3]), T[registered, :3, 3]])
    filled = np.column_stack([np.interp(at[~registered], have, column) for column in vectors.T])
    T = T.copy()
    T[~registered] = np.eye(4)
    T[~registered, :3, :3] = frames.rotation_from_vector(filled[:, :3])
    T[~registered, :3, 3] = filled[:, 3:]
    return T
