"""What speaks against a calibration, whatever its errors say: something moved, or the data contradict the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.identification import data_entry_errors
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.fit import Fit
from irbcal.identification.outliers import spread
from irbcal.measurement.moved import SHORTEST, moved_notes
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.elsewhere import elsewhere
from irbcal.units import MM
from irbcal.validation.length_scale import length_scale
from irbcal.validation.mixed import mixed_poses
from irbcal.validation.pose_equations import PoseEquations

FEW_EQUATIONS = 3
"""Equations for each identified combination below which the user is warned."""

LARGE_NOMINAL = 10 * MM
"""Fitted rms of the nominal robot above which something is wrong, unless the model explains it, metres."""

LEFT = 1.2 * MM, 2e-3
"""Fitted rms that no calibrated robot leaves: metres, and as a share of the spread of its tip positions."""

SCALE, SCALED = 1.5e-3, 0.8
"""Deviation from 1 of the scale of all positions, and the ratio to which it brings the nominal robot's residuals."""

CUTS = 7
"""Places at which poses in the order of measuring are cut in two, to see whether the parts are of one robot."""
SHUFFLES = 200
"""Random orders that are tried; none may explain as much."""
BLOCK_SHARE = 40
"""Blocks of neighbouring poses that are shuffled together."""
MOST_POSES = 1000
"""Poses that are compared; of more, evenly chosen ones."""
SMALLER = 0.8
"""Ratio to which residuals must fall with a model of its own for each part: those of good runs that were measured axis
by axis from several home poses fall to 0.84 (scripts/moved_alarms)."""
ALIKE = 0.6
"""Share of its spread in both parts together that each joint must have in either part for them to be compared."""


def doubts(
    nominal: Fit,
    fit: Fit | EvidenceFit,
    fitted: PointSet,
    measured: Sequence[PointSet],
    times: Sequence[FloatArray | None] | None = None,
    proof: PointSet | None = None,
) -> list[str]:
    """What speaks against a calibration, in sentences: nothing of it may be trusted before that is cleared up.

    Parameters
    ----------
    nominal, fit : Fit
        The nominal robot with base and tool, and the calibrated one.
    fitted : PointSet
        The fitted points.
    measured : sequence of PointSet
        All points of each file in the order in which they were measured, in the measuring frame.
    times : sequence of ndarray, shape (n,), or None, optional
        When their poses were measured, as the fit's motion counts; None where nothing is known of it.
    proof : PointSet, optional
        The held-out points.

    Returns
    -------
    list of str
    """
    if fit.level == "nominal":
        out = [words for points in measured for words in moved_notes(points, fit.robot)]
        out += _too_far(nominal.rms) if nominal.rms > LARGE_NOMINAL else []
        return [*out, *_slip(nominal, fitted)]
    out = []
    for points, elapsed in zip(measured, times or [None] * len(measured), strict=True):
        warmth = fit.warmth(points, elapsed) if isinstance(fit, EvidenceFit) and elapsed is not None else None
        equations = PoseEquations(nominal.problem.arm, points)
        out += moved_notes(points, fit.robot, warmth) or contradicting_parts(equations) or mixed_poses(equations)
    left = max(LEFT[0], LEFT[1] * spread(fitted))
    if fit.rms > left:
        out.append(
            f"The calibrated robot still misses the fitted points by {fit.rms / MM:.3g} mm (rms), more than tracker "
            "and model leave of a real robot: joints or positions are wrong in some poses, two robots or tools are "
            "mixed, or the model is too small."
        )
    if nominal.rms > LARGE_NOMINAL and fit.rms > 0.05 * nominal.rms:
        out += _too_far(nominal.rms)
    out += _slip(nominal, fitted)
    out += _scale(nominal, fitted) or _lengths(nominal.problem.arm, fit.robot.arm)
    beyond = elsewhere(fit.robot, nominal.robot, fitted.q, None if proof is None else proof.q)
    return [*out, beyond.in_words()] if beyond is not None and beyond.narrow else out


def _slip(nominal: Fit, fitted: PointSet) -> list[str]:
    """A slip of the pen that explains why the nominal robot is far off."""
    if nominal.rms <= data_entry_errors.SUSPECT:
        return []
    slip = data_entry_errors.find_entry_error(nominal.problem.arm, fitted, pairs=nominal.rms > LARGE_NOMINAL)
    return [] if slip is None else [f"{slip.headline()}."]


def _scale(nominal: Fit, fitted: PointSet) -> list[str]:
    """Whether all positions are too long or too short, which a fit takes for link lengths."""
    expected, seen = fitted.predicted(nominal.robot), fitted.xyz
    expected, seen = expected - expected.mean(axis=0), seen - seen.mean(axis=0)
    scale = float((expected * seen).sum() / (expected**2).sum())
    before, after = (float(((seen - s * expected) ** 2).sum()) for s in (1.0, scale))
    if abs(scale - 1.0) < SCALE or after > SCALED**2 * before:
        return []
    how = "long" if scale > 1.0 else "short"
    return [
        f"All positions are {abs(scale - 1.0):.2%} too {how} for this robot: are the units right, and the tracker's "
        "scale? The fit takes that for link lengths."
    ]


def _lengths(nominal: Arm, calibrated: Arm) -> list[str]:
    """Whether all link lengths are too long or too short, which a wrong scale of the tracker looks like."""
    found = length_scale(nominal, calibrated)
    return [found.doubt()] if found is not None and found.beyond_machining else []


def _too_far(rms: float) -> list[str]:
    return [
        f"The nominal robot misses the fitted points by {rms / MM:.3g} mm (rms), far more than industrial robots do: "
        "something other than the robot is wrong (references, joints, robot file)."
    ]


def cautions(nominal: Fit, fit: Fit | EvidenceFit) -> list[str]:
    """What to know of a result that may well be right, in sentences."""
    out = []
    equations = 3 * nominal.problem.rows
    if isinstance(fit, Fit) and fit.level != "nominal" and equations < FEW_EQUATIONS * fit.rank:
        out.append(
            f"Only {equations} equations for {fit.rank} identified combinations: measure more poses or choose a "
            "smaller model."
        )
    if fit.level != "nominal" and nominal.rms > LARGE_NOMINAL and fit.rms <= 0.05 * nominal.rms:
        out.append(
            f"The nominal robot misses the fitted points by {nominal.rms / MM:.3g} mm (rms), far more than industrial "
            f"robots do, and the model explains it ({fit.rms / MM:.3g} mm): was a joint's zero lost, or is it another "
            "robot file's robot?"
        )
    return out


def contradicting_parts(equations: PoseEquations, seed: int = 0) -> list[str]:
    """Whether poses measured early and late are of two robots or two tools, in a sentence.

    Robot, base and targets are identified from all poses; then each part may change all of them a little. What counts
    is by how much that makes residuals smaller, and whether parts of poses in a random order would do the same.

    Parameters
    ----------
    equations : PoseEquations
    seed : int
        Of the random orders.

    Returns
    -------
    list of str
        Empty where nothing beyond chance is found, or poses of one part are elsewhere than those of the other.
    """
    equations = equations.of_most(MOST_POSES)
    points, n = equations.points, equations.points.poses
    if points.session is not None or n < 4 * SHORTEST:
        return []
    cuts = np.unique(np.linspace(0, n, CUTS + 2)[1:-1].astype(int))
    cuts = cuts[[_alike(points.q, int(k)) for k in cuts]]
    if not len(cuts) or equations.sums is None:
        return []
    H, g, yy = equations.sums
    if 3 * len(points) < 4 * equations.sums.unknowns:
        return []
    whole = yy.sum() - _explained(H.sum(axis=0), g.sum(axis=0))

    def least(order: IntArray) -> tuple[float, int]:
        H_of, g_of = np.cumsum(H[order], axis=0), np.cumsum(g[order], axis=0)
        rest = [
            yy.sum() - _explained(H_of[k - 1], g_of[k - 1]) - _explained(H_of[-1] - H_of[k - 1], g_of[-1] - g_of[k - 1])
            for k in cuts
        ]
        best = int(np.argmin(rest))
        return float(rest[best]), int(cuts[best])

    found, cut = least(np.arange(n))
    if not whole > 0.0 or found > SMALLER**2 * whole:
        return []
    rng = np.random.default_rng(seed)
    blocks = np.array_split(np.arange(n), min(n, BLOCK_SHARE))
    for _ in range(SHUFFLES):
        if least(np.concatenate([blocks[k] for k in rng.permutation(len(blocks))]))[0] <= found:
            return []
    before, after = (np.sqrt(rss / len(points)) / MM for rss in (whole, found))
    return [
        f"The poses before and after pose {points.pose_ids[cut]} or thereabouts contradict one another: with a robot "
        f"and a tool of their own, residuals fall from {before:.3f} to {after:.3f} mm. Was the tool changed, are these "
        "two robots, or did the arm collide? Calibrate the parts one by one."
    ]


def _alike(q: FloatArray, k: int) -> bool:
    """Whether the poses before and after go through the same ranges."""
    whole = q.std(axis=0)
    return bool(all((part.std(axis=0) >= ALIKE * whole).all() for part in (q[:k], q[k:])))


def _explained(H: FloatArray, g: FloatArray) -> float:
    """Sum of squares that a free change of all unknowns takes away, of those that the data show."""
    return float(g @ np.linalg.solve(H + 1e-6 * np.eye(len(H)), g))
