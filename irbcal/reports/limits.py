"""What limits a calibration now, by how much of its error that is, and the one thing to do next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.io.schema import Record
from irbcal.reports.evidence import Evidence, PoseSet
from irbcal.units import MM
from irbcal.validation.verdict import verdict_of

SHARE = 0.15
"""Share of the mean square error from which something is named."""
FEW = 0.05
"""Share of the poses that is called a few."""
NOISE_MM = 0.1
"""Residuals of the fit (rms) that a laser tracker and a robot's repeatability may leave."""
HALF = 0.5
"""Share of the mean square error that a few poses hold where they are named."""
ADDED = "(irbcal plan), and add them: irbcal calibrate NEW.csv --with DIR --out NEW_DIR."
AT_FEATURES = "at more places (irbcal plan --device), and calibrate from all rows together."


@dataclass(frozen=True)
class Limit:
    """Something that keeps a calibration from being better.

    Attributes
    ----------
    words : str
        A sentence with figures.
    next : str
        What to do about it.
    share : float
        Of the mean square error; above 1 what comes before all accuracy.
    """

    words: str
    next: str
    share: float


def limits(record: Record, evidence: Evidence) -> list[Limit]:
    """What limits a calibration, the largest first; empty where nothing stands out."""
    first = evidence.sets[0]
    model = first.models.get("calibrated", first.models["nominal"])
    rms = float(np.sqrt(np.mean(model.distance**2)) / MM)
    found_limits = [*_before_all(record, first), *_corner(record)]
    if rms > 0.0:
        found_limits += [
            *_few_poses(record, rms, first),
            *_small_model(record, rms),
            *_lag(record),
            *_reversal(record, evidence, rms),
        ]
        found_limits += [*_untried(record, rms), *_outliers(first)]
    found_limits = [limit for limit in found_limits if limit.share >= SHARE]
    return sorted(found_limits, key=lambda limit: -limit.share)


def _before_all(record: Record, first: PoseSet) -> list[Limit]:
    """What must be cleared up before accuracy is spoken of."""
    verdict, out = verdict_of(record), []
    if record.doubts:
        out.append(
            Limit(
                "Something speaks against these data, see above.",
                "Clear up what is said above, then calibrate again: nothing else is worth doing before.",
                4.0,
            )
        )
    if not first.proves:
        out.append(Limit("No pose was held out: the accuracy is not known.", "Calibrate with --holdout.", 3.0))
    elif verdict.outcome == "worse":
        out.append(Limit("The model is worse than the nominal robot.", "Calibrate with --model auto.", 3.0))
    return out


def _how(record: Record) -> str:
    """What to do with more poses."""
    return AT_FEATURES if record.features else ADDED


def _corner(record: Record) -> list[Limit]:
    """Joints that went through a part of their limits only."""
    section = record.certainty.elsewhere if record.certainty is not None else None
    if section is None or not section.narrow:
        return []
    worst = int(np.argmin(section.shares))
    return [
        Limit(
            f"The poses cover a corner of the workspace: joint {worst + 1} went through {section.shares[worst]:.0%} of "
            f"its limits; {section.there_mm:.3f} mm (rms) must be expected elsewhere, {section.here_mm:.3f} mm here.",
            f"Measure poses all over the workspace {_how(record)}",
            2.0,
        )
    ]


def _few_poses(record: Record, rms: float, first: PoseSet) -> list[Limit]:
    """Errors of poses that took no part in the fit above those of the fit."""
    fitted = record.fit.all.rms_mm
    if not first.proves or rms <= fitted or record.model == "nominal":
        return []
    return [
        Limit(
            f"Few poses: those that the fit never saw have {rms:.3f} mm (rms), the {record.poses_fit} fitted ones "
            f"{fitted:.3f} mm.",
            f"Measure {record.poses_fit} more poses {_how(record)}",
            1.0 - (fitted / rms) ** 2,
        )
    ]


def _small_model(record: Record, rms: float) -> list[Limit]:
    """A level that misses its own poses by more than a tracker does."""
    fitted = record.fit.all.rms_mm
    if record.evidence is not None or record.model == "nominal" or fitted < NOISE_MM:
        return []
    return [
        Limit(
            f"The model: level {record.model} leaves {fitted:.3f} mm (rms) on the very poses that it was fitted to.",
            "Calibrate with --model auto, which also tries gears, gravity in all joints, warm-up and the last move.",
            min(1.0, (fitted / rms) ** 2),
        )
    ]


def _lag(record: Record) -> list[Limit]:
    """Joint readings that lag behind the arm."""
    if record.evidence is None or not record.evidence.readings_lag:
        return []
    return [
        Limit(
            "The joint readings lag: taken before the arm stood still, or shown late by the controller.",
            "Give the programmed joints (columns c1_deg …), or read joints and tracker after a longer stop.",
            0.9,
        )
    ]


def _reversal(record: Record, evidence: Evidence, rms: float) -> list[Limit]:
    """Backlash and friction that the model has not taken."""
    history = record.robot_calibrated().joint_map.history
    found = () if evidence.joints is None or history.terms else evidence.joints.needed
    terms = [term for term in found if term.kind in ("backlash", "move")]
    if not terms:
        return []
    joints = ", ".join(dict.fromkeys(str(term.joint) for term in terms))
    several = "," in joints
    return [
        Limit(
            f"Gears: joint{'s' if several else ''} {joints} stop{'' if several else 's'} elsewhere when reached from "
            f"the other side or after a longer move (joint {terms[0].joint} alone: {terms[0].moves / MM:.3f} mm).",
            "Reach targets that matter from one side always, or calibrate with --model auto: it learns the last move.",
            min(sum((term.moves / MM / rms) ** 2 for term in terms), 1.0),
        )
    ]


def _untried(record: Record, rms: float) -> list[Limit]:
    """Families of terms that were tried and not taken, or could not be tried."""
    if record.evidence is None:
        return []
    carried = [stage for stage in record.evidence.explained if stage.carried]
    tried = [stage for stage in record.evidence.explained if not stage.carried]
    if not carried or not tried:
        return []
    best = min(tried, key=lambda stage: stage.leave_one_out_mm)
    now = carried[-1].leave_one_out_mm
    if best.leave_one_out_mm >= now:
        return []
    return [
        Limit(
            f"Bending and wobble that a URDF cannot hold: with {best.added}, poses left out of the fit fall from "
            f"{now:.3f} to {best.leave_one_out_mm:.3f} mm (rms).",
            "Calibrate with --terms all, where irbcal itself corrects the programs.",
            1.0 - (best.leave_one_out_mm / now) ** 2,
        )
    ]


def _outliers(first: PoseSet) -> list[Limit]:
    """A few poses that hold most of the error."""
    square = np.sort(np.array(list(first.models.values())[-1].per_pose) ** 2)[::-1]
    count = max(1, int(FEW * len(square)))
    share = float(square[:count].sum() / max(square.sum(), 1e-300))
    if len(square) < 20 or share < HALF:
        return []
    return [
        Limit(
            f"A few poses: {count} of {len(square)} hold {share:.0%} of the mean square error.",
            "Look at the worst poses below: was a reflector hit, a joint at its end, the tool touched?",
            share,
        )
    ]
