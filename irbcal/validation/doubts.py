"""What speaks against a calibration, whatever its errors say: something moved, or the data contradict the model."""

from __future__ import annotations

from collections.abc import Sequence

from irbcal.arrays import FloatArray
from irbcal.identification import data_entry_errors
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.fit import Fit
from irbcal.measurement.moved import moved_notes
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.units import MM
from irbcal.validation.length_scale import length_scale
from irbcal.validation.two_robots import contradictions

FEW_EQUATIONS = 3
"""Equations for each identified combination below which the user is warned."""

LARGE_NOMINAL = 10 * MM
"""Fitted rms of the nominal robot above which something is wrong, unless the model explains it, metres."""

LEFT = 1.2 * MM, 2e-3
"""Fitted rms that no calibrated robot leaves: metres, and as a share of the spread of its tip positions."""

SCALE, SCALED = 4e-3, 0.8
"""Deviation from 1 of the scale of all positions, and the ratio to which it brings the nominal robot's residuals.
Smaller deviations are errors of zeros on robots that move by a third of their range (SIMULATED): `length_scale` judges
them."""


def doubts(
    nominal: Fit,
    fit: Fit | EvidenceFit,
    fitted: PointSet,
    measured: Sequence[PointSet],
    times: Sequence[FloatArray | None] | None = None,
) -> list[str]:
    """What speaks against a fit, in sentences: nothing of it may be trusted before that is cleared up.

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
    """
    if fit.level == "nominal":
        out = [text for points in measured for text in moved_notes(points, fit.robot)]
        out += _too_far(nominal.rms) if nominal.rms > LARGE_NOMINAL else []
        return [*out, *_data_entry_error(nominal, fitted)]
    out = []
    for points, elapsed in zip(measured, times or [None] * len(measured), strict=True):
        warmth = fit.warmth(points, elapsed) if isinstance(fit, EvidenceFit) and elapsed is not None else None
        out += moved_notes(points, fit.robot, warmth) or contradictions(nominal.problem.arm, points)
    limit = max(LEFT[0], LEFT[1] * fitted.spread())
    if fit.rms > limit:
        out.append(
            f"The calibrated robot still misses the fitted points by {fit.rms / MM:.3g} mm (rms), more than tracker "
            "and model leave of a real robot: joints or positions are wrong in some poses, two robots or tools are "
            "mixed, or the model is too small."
        )
    if nominal.rms > LARGE_NOMINAL and fit.rms > 0.05 * nominal.rms:
        out += _too_far(nominal.rms)
    if isinstance(fit, EvidenceFit) and fit.leverage_pose is not None:
        pose, away = fit.leverage_pose
        out.append(
            f"Pose {fit.points.pose_ids[pose]} stands alone: the fit passes it, but all other poses put it "
            f"{away / MM:.3g} mm elsewhere, and none can tell which is right. Measure it again, and poses near it."
        )
    out += _data_entry_error(nominal, fitted)
    return out + (_scale(nominal, fitted) or _lengths(nominal.problem.arm, fit.robot.arm))


def _data_entry_error(nominal: Fit, fitted: PointSet) -> list[str]:
    """A data-entry error that explains why the nominal robot is far off."""
    if nominal.rms <= data_entry_errors.SUSPECT:
        return []
    data_entry_error = data_entry_errors.find_data_entry_error(
        nominal.problem.arm, fitted, pairs=nominal.rms > LARGE_NOMINAL
    )
    return [] if data_entry_error is None else [f"{data_entry_error.headline()}."]


def _scale(nominal: Fit, fitted: PointSet) -> list[str]:
    """Whether all positions are too long or too short, which a fit takes for link lengths."""
    expected, measured = fitted.predicted(nominal.robot), fitted.xyz
    expected, measured = expected - expected.mean(axis=0), measured - measured.mean(axis=0)
    scale = float((expected * measured).sum() / (expected**2).sum())
    rss, rss_scaled = (float(((measured - s * expected) ** 2).sum()) for s in (1.0, scale))
    if abs(scale - 1.0) < SCALE or rss_scaled > SCALED**2 * rss:
        return []
    how = "long" if scale > 1.0 else "short"
    return [
        f"All positions are {abs(scale - 1.0):.2%} too {how} for this robot: are the units right, and the tracker's "
        "scale? The fit takes that for link lengths."
    ]


def _lengths(nominal: Arm, calibrated: Arm) -> list[str]:
    """Whether all link lengths are too long or too short, which a wrong scale of the tracker looks like."""
    scale = length_scale(nominal, calibrated)
    return [scale.doubt()] if scale is not None and scale.beyond_machining else []


def _too_far(rms: float) -> list[str]:
    return [f"{_far_off(rms)}: something other than the robot is wrong (references, joints, robot file)."]


def _far_off(rms: float) -> str:
    return f"The nominal robot misses the fitted points by {rms / MM:.3g} mm (rms), far more than industrial robots do"


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
            f"{_far_off(nominal.rms)}, and the model explains it ({fit.rms / MM:.3g} mm): was a joint's zero lost, or "
            "is it another robot file's robot?"
        )
    return out
