"""Calibration from rows at features, without a tracker: read, fit, validate.

The steps give what those of `irbcal.pipeline` give. All rows but outliers are fitted; the proof leaves each place
out in turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Literal

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, locked, rms
from irbcal.calibration_options import CalibrationOptions
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification import feature_errors
from irbcal.identification.choices import LEVELS
from irbcal.identification.feature_fit import (
    FeatureFit,
    as_points,
    identify_without_outliers,
    shape_only,
)
from irbcal.identification.feature_problem import UnknownKey, relation_residuals
from irbcal.identification.feature_sections import FeatureRow, FeaturesSection, RelationRow
from irbcal.identification.observation_kind import DISPLAY_UNITS, Unknown
from irbcal.io.opening import calibration_at
from irbcal.measurement import features as feature_files
from irbcal.measurement import recordings
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.corner_numbers import numbered_alike
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.levels import Level
from irbcal.modeling.parameters import Parameter, default_level, selected_parameters
from irbcal.modeling.terms.situation import Motion
from irbcal.option_values import Progress, checked
from irbcal.pipeline import CheckedFit, Inputs, PointErrors, Validated, next_step, open_nominal, robot_notes
from irbcal.section import in_unit
from irbcal.units import MM
from irbcal.validation.feature_proof import FeatureProof
from irbcal.validation.feature_proof import prove as prove_places

NEARLY_PARALLEL = 1e-6
"""Radians between two axes below which the nominal arm has them parallel."""
MOST_OPEN = 0.5
"""Share of what was not known of the tool's position that rows at features may leave open without a doubt."""
LENGTH_ERROR = 0.1 * MM
"""Error of known lengths below which it is no doubt, metres."""
LENGTHS_WORSE, LENGTHS_OPEN = 2.0, 3.0
"""How many times the nominal robot's error, and what the rows leave open of the tool's place, lengths must miss while
their places are left out: a fit without a place knows less about it, too."""


def read_rows(options: CalibrationOptions, say: Progress) -> Inputs:
    """Rows at features and their nominal robot."""
    measurements, robot = options.measurements, options.robot
    if robot is None or calibration_at(robot) is not None:
        raise OptionError(
            "robot: rows at features start from a URDF or a robot's name, not from a calibration", parameter="robot"
        )
    opened = open_nominal(robot, options)
    nominal = opened.nominal_urdf
    say("reading the measurements")
    if isinstance(measurements, (list, tuple)):
        raise MeasurementError(
            f"expected one file of rows at features, found {len(measurements)}", parameter="measurements"
        )
    if not isinstance(measurements, (str, PathLike, pd.DataFrame)):
        if not isinstance(measurements, MeasurementSet):
            measurements = measurements.measurements()
        measurements = measurements.to_frame()
    assert options.features is not None
    rows = feature_files.read(*recordings.corner_rows(measurements, options.features, nominal.arm), nominal.arm)
    if isinstance(measurements, (str, PathLike)):
        rows = replace(rows, source=str(measurements))
    rows = numbered_alike(rows, nominal.arm.forward(rows.q)[:, :3, :3])
    if options.payload_centre is not None:
        if "payload_kg" not in rows.inputs or "payload_centre" in rows.inputs:
            there = "payload_kg" in rows.inputs
            reason = "the rows tell the payload's centre" if there else "there is no column payload_kg"
            raise OptionError(f"payload_centre: {reason}: leave it out", parameter="payload_centre")
        centre = np.asarray(options.payload_centre, dtype=float)
        rows = replace(rows, inputs={**rows.inputs, "payload_centre": np.tile(centre, (len(rows), 1))})
    if shape_only(rows):
        raise IdentificationError(
            "these rows only say that points lie in planes or on lines whose places are unknown: a fit makes them "
            "flatter and may make the robot worse (on a real one tracker errors grew 2.4 times); add a ball or a "
            "socket at several places, a known length, a ballbar or a string",
            file=rows.source,
        )
    notes = robot_notes(opened)
    if options.model in ("11", "16", "26", "34") and abs(np.sin(nominal.arm.table.alpha[2])) < NEARLY_PARALLEL:
        notes.append(
            f"Model {options.model} has no tilt between the parallel axes 2 and 3: intervals from rows at features are "
            "too narrow with it. Where they count, take auto, 34b or placement."
        )
    return Inputs(
        options=options,
        urdf=nominal,
        robot_file=opened.file,
        nominal_source=opened.source,
        measurements=rows.as_measurements(),
        feature_rows=rows,
        notes=tuple(notes),
    )


def fit_rows(inputs: Inputs, say: Progress) -> CheckedFit:
    """Identify from all rows at features but for outliers; `validate_rows` leaves places out."""
    rows, arm = inputs.feature_rows, inputs.urdf.arm
    assert rows is not None
    level, terms = _terms(inputs.options, arm)
    goal = inputs.options.goal
    try:
        feature_fit, left_out, doubt = identify_without_outliers(
            arm, rows, terms, progress=say, goal=goal, rule=inputs.options.outlier_rule
        )
    except IdentificationError as error:
        reading = feature_errors.other_reading(arm, rows)
        if reading is None:
            raise
        raise IdentificationError(
            f"{error}; the rows look like {reading.description}: read so, they are met within {reading.rms / MM:.3g} "
            "mm (root mean square)",
            file=rows.source,
        ) from error
    feature_fit = replace(feature_fit, level=level)
    remaining = feature_fit.problem.rows
    points = as_points(remaining)
    motion = Motion(points.q)
    nobody = np.zeros(points.poses, dtype=bool)
    elsewhere = feature_errors.at_another_feature(feature_fit, rows, left_out)
    return next_step(
        CheckedFit,
        inputs,
        feature_rows=remaining,
        points=points,
        motion=motion,
        excluded=tuple(
            Exclusion(
                pose=str(rows.pose[k]),
                target=str(rows.target[k]),
                reason=f"row {row} ({rows.feature[k] or rows.kind[k]}) is {left_out[row] / MM:.2f} mm "
                "beside what all other rows say" + (f": it is at {there}" if (there := elsewhere.get(row)) else ""),
            )
            for k, row in enumerate(rows.row.tolist())
            if row in left_out
        ),
        doubts=(*((doubt,) if doubt else ()), *feature_errors.doubts(feature_fit)),
        fit_points=points,
        fit_motion=motion,
        heldout_points=points.select(nobody),
        heldout_motion=motion.select(nobody),
        poses_measured=rows.poses,
        fit=feature_fit,
        nominal_robot=feature_fit.nominal_robot,
    )


def _terms(options: CalibrationOptions, arm: Arm) -> tuple[Level | Literal["auto"], str | tuple[Parameter, ...]]:
    """The model for rows at features, and its terms: those that are averaged, or the error parameters of a level."""
    if options.model in (None, "auto") and not options.of_levels:
        return "auto", options.terms
    level = default_level(arm) if options.model is None else checked("model", str(options.model), LEVELS)
    chosen = selected_parameters(level, options.free, options.hold, arm)
    if not any(item.name.startswith("delta_") for item in chosen):
        raise OptionError(
            f"model {level} at features needs a constant of the geometry (delta_…), and none is left: hold fewer",
            parameter="hold",
        )
    return level, chosen


def validate_rows(checked: CheckedFit, say: Progress) -> Validated:
    """Leave each place out in turn, and look for what speaks against the result."""
    options, rows, fit, points = checked.options, checked.feature_rows, checked.fit, checked.fit_points
    assert rows is not None
    assert isinstance(fit, FeatureFit)
    terms = _terms(options, checked.urdf.arm)[1]
    try:
        proof = prove_places(checked.urdf.arm, rows, options.leave_out, terms, options.seed, say, options.goal)
    except IdentificationError as error:
        raise IdentificationError(" ".join((f"{error}.", *checked.doubts)) if checked.doubts else str(error)) from None
    section = _section(fit, proof)
    against = (*checked.doubts, *doubts_of(section), *fit.doubts())
    order = np.argsort(np.unique(rows.pose_index, return_inverse=True)[1], kind="stable")
    calibrated, nominal = (fit.problem.distances(state)[order] for state in (fit.state, fit.nominal_state))
    heldout, left_out = checked.heldout_points, (np.zeros(0), np.zeros(0))
    if proof is not None:
        missed_by_nominal, missed = proof.missed[:, order]
        tested = np.isfinite(missed)
        left_out = missed[tested], missed_by_nominal[tested]
        heldout = points if tested.all() else points.take(tested).without_empty_poses() if tested.any() else heldout
    return next_step(
        Validated,
        checked,
        heldout_points=heldout,
        errors=PointErrors(*map(locked, (calibrated, nominal, *left_out))),
        features=section,
        doubts=against,
        notes=(*checked.notes, *_notes(section, fit.problem.rows.relations), *fit.sentences()),
    )


def doubts_of(section: FeaturesSection) -> list[str]:
    """What speaks against it, whatever the rows say of each other."""
    doubts = (
        []
        if section.scale_measured
        else [
            "No length was measured that determines the size of the arm: a robot whose links are all 0.3 % longer than "
            "nominal fits these rows as well, and would be calibrated worse than it is. Add a known length between two "
            "features (a bar), or rows that a tracker measured."
        ]
    )
    pairs = section.left_out_lengths()
    if len(pairs):
        nominal, heldout = np.sqrt(np.mean(pairs**2, axis=0))
        if heldout > max(LENGTHS_WORSE * nominal, LENGTHS_OPEN * section.open_mm, LENGTH_ERROR / MM):
            doubts.append(
                f"Known lengths come out {heldout:.3f} mm wrong (root mean square) while their places are left out, "
                f"with the nominal robot {nominal:.3f} mm: a length is wrong, features moved, or rows are at others "
                "than they say."
            )
    if section.open_mm <= MOST_OPEN * section.before_mm:
        return doubts
    return [
        *doubts,
        f"These rows leave {section.open_mm:.3f} mm of the {section.before_mm:.3f} mm open that the tool's place is "
        "uncertain by (root mean square, at joints like these): they agree with each other, but tell too little of the "
        "arm. Measure at more places, or add known lengths.",
    ]


def _notes(section: FeaturesSection, relations: Sequence[feature_files.Relation]) -> list[str]:
    """What a user should know of it."""
    notes = [f"{section.scale[0].upper()}{section.scale[1:]}."] if section.scale else []
    if not section.in_frame:
        notes.append(
            "Nothing ties the features to a measuring frame: the base is the nominal one, and places are those of the "
            "base link."
        )
    notes.append(
        f"At joints like these the tool's place is known within {section.open_mm:.3f} mm (root mean square, predicted; "
        f"{section.before_mm:.3f} mm before these rows): no tracker has seen it."
    )
    used = {row.name for row in section.relations}
    unused = [relation.name for relation in relations if relation.name not in used]
    return [*notes, *(f"{name} is not used: where one of its features is was stated." for name in unused)]


def _section(fit: FeatureFit, proof: FeatureProof | None) -> FeaturesSection:
    """What is known of the features, of each place while it was left out, and of relations."""
    problem, rows = fit.problem, fit.problem.rows
    before_mm, std_after = fit.left_open()
    fitted = relation_residuals(rows.relations, fit.state.values)
    left_out: Mapping[str, tuple[float | None, float | None]] = {} if proof is None else proof.relations
    return FeaturesSection(
        kinds=rows.kinds(),
        in_frame=problem.in_frame,
        scale_measured=fit.scale_measured,
        left_out=None if proof is None else proof.by,
        before_mm=before_mm / MM,
        open_mm=std_after / MM,
        features=_feature_rows(fit),
        places=[] if proof is None else list(proof.places),
        relations=[
            RelationRow(
                name=relation.name,
                kind=relation.kind,
                first=relation.first,
                second=relation.second,
                unit=unit,
                known=relation.value / factor,
                fitted=fitted[relation.name] / factor,
                nominal=in_unit(left_out.get(relation.name, (None, None))[0], factor),
                heldout=in_unit(left_out.get(relation.name, (None, None))[1], factor),
            )
            for relation, (_, unit, factor) in ((each, each.quantity) for each in rows.relations)
            if relation.name in fitted
        ],
        feature_column=rows.feature_column,
        scale_from=fit.scale_from,
    )


def _feature_rows(fit: FeatureFit) -> list[FeatureRow]:
    problem, rows = fit.problem, fit.problem.rows
    labels = rows.left_out_together("place") if "place" in rows.cells.columns else rows.left_out_together()
    residuals = [problem.distances(state) for state in (fit.nominal_state, fit.state)]
    tool = np.zeros((len(rows), 3))
    known: dict[str, dict[str, list[float]]] = {}
    fitted: dict[str, dict[UnknownKey, tuple[Unknown, FloatArray]]] = {}
    for of_group in problem.group_residuals(fit.state):
        group, name_of = of_group.group, of_group.group.feature.name
        tool[group.rows] = of_group.p
        keys, known_of_feature = group.keys(), known.setdefault(name_of, {})
        for name, value in of_group.in_base.items():
            unknown = group.kind.unknowns[name]
            if name not in keys:
                known_of_feature |= unknown.entries(name, value)
            elif unknown.owner == "feature" or unknown.shape == "number":  # a lens's numbers may be a target's
                fitted.setdefault(name_of, {})[keys[name]] = unknown, value
    out = []
    for name, feature in rows.features.items():
        of_feature = rows.feature == name
        nominal, fitted_rms = (rms(each[of_feature]) / MM for each in residuals)
        values: dict[str, list[float]] = {}
        std: dict[str, list[float]] = {}
        for key in [key for key in problem.layout if key in fitted.get(name, {})]:
            unknown, value = fitted[name][key]
            values |= unknown.entries(key[0], value)
            deviation = fit.std_of(key)[: 2 if unknown.shape == "line" else None]
            std[key[0]] = (deviation / DISPLAY_UNITS[unknown.unit]).tolist()
        out.append(
            FeatureRow(
                name=name,
                kind=feature.kind,
                target=feature.target,
                rows=int(of_feature.sum()),
                place=str(labels[np.flatnonzero(of_feature)[0]]),
                rms_mm=fitted_rms,
                nominal_rms_mm=nominal,
                fitted=values,
                std=std,
                known=known[name],
                middle_mm=(tool[of_feature].mean(axis=0) / MM).tolist(),
                spread_mm=float(np.sqrt(tool[of_feature].var(axis=0).sum())) / MM,
                imaging={} if feature.imaging is None else feature.imaging.columns(),
            )
        )
    return out
