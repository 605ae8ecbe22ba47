"""Measuring plans that find the zeros of joints after a crash or a change of a motor: which poses, and how many.

Base, reflectors and these zeros are the unknowns, all else is as it was calibrated. What the calibration leaves over at
poses that it was not fitted to is the error of a pose, which its reflectors share (`irbcal.validation.refit`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.distributions import student_within
from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling.lost_zeros import MANY, WELL, lost_joints
from irbcal.modeling.parameters import parameter
from irbcal.planning.choosing import MOST_REFLECTORS
from irbcal.planning.optimal_design import Model
from irbcal.planning.plan_options import PlanOptions
from irbcal.planning.prediction import PlanPrediction
from irbcal.planning.scene import Scene
from irbcal.units import DEG, MM

TRIAL = 12
"""Poses of the first plan that says how many are enough."""
TRIALS, LAST_POSES = 4, 10
"""Plans that say so, one after the other, and poses that are then added one by one until they are enough."""


def model_of_zeros(scene: Scene, joints: Sequence[int]) -> Model:
    """Base, reflectors and zeros as unknowns, and the error of a pose as the noise of its points.

    Raises
    ------
    OptionError
        If the robot is not a calibrated one, or has no such joints.
    """
    arm = scene.nominal
    lost_joints(joints, arm)
    if scene.certainty is None:
        raise OptionError(
            "how many poses zeros take depends on what a calibration left over: give a calibration folder "
            "for the robot",
            parameter="refit_zeros",
        )
    if arm.table.prismatic[np.array(joints) - 1].any():
        raise OptionError("refit_zeros: plans are for joints that turn", parameter="refit_zeros")
    reflectors = min(len(scene.setting.targets.names), MOST_REFLECTORS)
    noise = scene.certainty.determined_left_out(None) * float(np.sqrt(reflectors / 3.0))
    zeros = tuple(parameter(f"delta_theta{joint}") for joint in joints)
    return Model(arm, scene.setting.targets, f"zeros of joints {', '.join(map(str, joints))}", noise, zeros)


def half_widths(std: FloatArray, poses: IntArray | int, unknowns: int) -> FloatArray:
    """Halves of the 95 % intervals of zeros, with the scatter estimated from three coordinates of each pose."""
    freedom = np.maximum(3 * np.asarray(poses) - unknowns, 1)
    return np.asarray(np.vectorize(student_within, otypes=[float])(0.95, freedom) * std)


def std_of_zeros(prediction: PlanPrediction, joints: Sequence[int]) -> FloatArray:
    """Predicted standard deviations of zeros, radians.

    Raises
    ------
    MeasurementError
        If the poses do not show one by itself.
    """
    parameters = prediction.parameters
    if hidden := [str(joint) for joint, p in zip(joints, parameters, strict=True) if p.std is None]:
        raise MeasurementError(
            f"no poses show the zero of joint {', '.join(hidden)} where base and tool are fitted again: the "
            "zero of the first joint cannot be separated from the base, nor the zero of the last joint from the tool"
        )
    return np.array([p.std for p in parameters], dtype=float) * DEG


def enough_poses(options: PlanOptions, predicted: Callable[[PlanOptions], PlanPrediction]) -> PlanOptions:
    """The options with as many poses as give each zero within `WELL`, `MANY` at most, and one to judge them.

    Parameters
    ----------
    options : PlanOptions
    predicted : callable
        What the poses that are chosen for a options promise.
    """
    counts, best = np.arange(1, MANY + 1), TRIAL
    for _ in range(TRIALS):
        options = replace(options, optimal=best)
        prediction = predicted(options)
        unknowns = prediction.model.nuisance + len(options.refit_zeros)
        std = std_of_zeros(prediction, options.refit_zeros).max() * np.sqrt(options.optimal / counts)
        good = half_widths(std, counts, unknowns) <= WELL
        best = int(counts[np.argmax(good)]) if good.any() else MANY
        if best == options.optimal:
            break
    options = replace(options, optimal=max(best, options.optimal) + 1)
    for _ in range(LAST_POSES):  # poses chosen for another number show a little less at times
        placing = options.optimal - 1
        if placing >= MANY or _promised(options, predicted(options), options.optimal).max() <= WELL:
            break
        options = replace(options, optimal=options.optimal + 1)
    return options


def _promised(options: PlanOptions, prediction: PlanPrediction, poses: int) -> FloatArray:
    """Halves of the 95 % intervals of zeros, radians, where all poses but one place them."""
    std = std_of_zeros(prediction, options.refit_zeros) * np.sqrt(poses / (poses - 1))
    return half_widths(std, poses - 1, prediction.model.nuisance + len(options.refit_zeros))


def zeros_of_plan_in_words(options: PlanOptions, prediction: PlanPrediction, poses: int) -> list[str]:
    """What a plan promises of the zeros."""
    placing, half = poses - 1, _promised(options, prediction, poses)
    of_joints = ", ".join(
        f"joint {joint} ± {value / DEG:.4f} degrees" for joint, value in zip(options.refit_zeros, half, strict=True)
    )
    enough = "enough" if half.max() <= WELL else "not enough"
    return [
        f"{placing} poses, and another to judge them: zero of {of_joints} (95 %), {enough} for {WELL / DEG:g} degrees. "
        f"Base and reflectors are fitted again. Each coordinate of a point has an error of "
        f"{prediction.model.noise / MM:.3f} mm, the residual of the calibration at a pose",
        "Then (without --refit-tool where the reflectors stayed, which narrows the intervals; last moves that are not "
        "known widen them): irbcal evaluate CALIBRATION MEASURED.csv --refit-base --refit-tool --refit-zeros "
        f"{','.join(map(str, options.refit_zeros))} --refit-from {placing}",
    ]
