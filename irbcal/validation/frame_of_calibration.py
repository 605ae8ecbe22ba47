"""Measurements in the frame of a calibration: cleaned, with base and tool fitted again where asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.measurement import table
from irbcal.measurement.column_names import PAYLOAD
from irbcal.measurement.input_table import check_one_payload
from irbcal.measurement.motions import with_last_moves
from irbcal.measurement.points import distances
from irbcal.modeling.robot import Robot
from irbcal.option_values import number
from irbcal.validation.cleaned_points import (
    CleanedPoints,
    lost_row,
    prepare,
    refuse_far_points,
)
from irbcal.validation.refit import NO_REFIT, Refit


def in_frame_of_calibration(
    calibration: CalibrationLike, measurements: table.MeasurementsLike, refit: Refit = NO_REFIT, same_tool: bool = False
) -> tuple[CleanedPoints, dict[str, Robot]]:
    """Clean measurements in the frame of a calibration, and its robots.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    measurements : str, Path, DataFrame or MeasurementSet
    refit : Refit
        What to fit again; the poses that do it are not in the result, except where they are judged, too.
    same_tool : bool
        As `evaluate`.

    Returns
    -------
    points : CleanedPoints
    robots : dict of str to Robot
        ``nominal`` and ``calibrated``.

    Raises
    ------
    IrbcalError
        If the measurements are refused, or are nowhere near what the calibrated robot predicts.
    """
    record = open_calibration(calibration)
    measured = table.read(measurements).of_arm(record.arm())
    cleaned = prepare(measured, record, any_target=refit.tool, same_tool=same_tool)
    before = {"nominal": record.robot_nominal(), "calibrated": record.robot_calibrated()}
    chosen, to_judge = refit.chosen(cleaned.points, measured.source)
    placing, cleaned = cleaned.points.select(chosen), cleaned.select(to_judge)

    def placed() -> dict[str, Robot]:
        return {name: refit.placed(robot, placing, measured.source) for name, robot in before.items()}

    robots = placed()
    points, notes = with_last_moves(robots["calibrated"], cleaned.points)
    if placing.previous is not None and points.previous is None:
        placing = replace(placing, previous=None)
        robots = placed()
    zeros = refit.zeros_in_words(before["calibrated"], robots["calibrated"], placing)
    others = 0 if to_judge[chosen].any() else placing.poses
    if others:
        notes.append(refit.sentence(placing.poses, points.poses))
    error = distances(robots["calibrated"], points)
    refuse_far_points(robots["calibrated"], points, error, measured, bool(refit))
    lost = lost_row(robots["calibrated"], points, error, measured)
    notes = [*zeros, *cleaned.notes, *notes, *lost]
    return replace(cleaned, points=points, notes=tuple(notes), placing=others), robots


def with_payload_column(measurements: table.MeasurementSet, payload: float | None) -> table.MeasurementSet:
    """Measurements with a load where they do not tell it."""
    if payload is None:
        return measurements
    check_one_payload(True, measurements.input("payload_kg") is not None)
    load = number("payload", payload, 0.0)
    return measurements.changed({PAYLOAD: np.full(len(measurements), load)})
