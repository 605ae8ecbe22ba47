"""The main job without a tracker: from rows at features to a proven calibration."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from irbcal.arrays import IntArray
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification.feature_fit import (
    FeatureFit,
    as_points,
    frames_of,
    identify_features,
    shape_only,
)
from irbcal.identification.feature_problem import FeatureProblem, Key
from irbcal.identification.observation_kind import SHOWN
from irbcal.io import robots
from irbcal.io.earlier import calibrated_before
from irbcal.io.opening import calibration_at, read_nominal
from irbcal.io.outcome import AtFeatures, Outcome, PlacedRobot
from irbcal.io.schema import FeatureRow, FeaturesSection, LengthRow, PlaceRow
from irbcal.measurement import features as feature_files
from irbcal.measurement.columns import TableLike
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.table import MeasurementSet, MeasurementsLike
from irbcal.units import MM
from irbcal.validation.feature_proof import FeatureProof, prove

if TYPE_CHECKING:
    from irbcal.calibrating import Options

OPEN = 0.5
"""Share of what was not known of the tool's place that rows may leave open without a doubt."""

TAKES = ("model", "terms", "seed", "base_link", "tip_link", "coupling", "features", "leave_out", "payload_place")
"""Options that rows at features take."""


def check(options: Options, own: Options) -> None:
    """Refuse options that rows at features do not take.

    Raises
    ------
    OptionError
    """
    for name, value in vars(options).items():
        if name not in TAKES and value != getattr(own, name):
            raise OptionError(f"{name.rstrip('_')}: rows at features do not take it, leave it out", parameter=name)
    if options.model not in (None, "auto"):
        raise OptionError(
            f"model: rows at features leave directions open, which model auto keeps near nominal; leave out "
            f"model {options.model}",
            parameter="model",
        )


def run(
    measurements: MeasurementsLike,
    robot: str | Path | None,
    options: Options,
    progress: Callable[[str], Any] | None = None,
) -> Outcome:
    """Read, identify, leave each place out in turn; parameters and errors as `irbcal.calibrate`."""
    started = time.perf_counter()
    say = progress or (lambda text: None)
    if robot is None or calibration_at(robot) is not None:
        raise OptionError(
            "robot: rows at features start from a URDF or a robot's name, not from a calibration", parameter="robot"
        )
    urdf = read_nominal(robot, options.base_link, options.tip_link, options.coupling)
    say("reading the measurements")
    seen = feature_files.read(_table(measurements), options.features, urdf.arm)
    seen = _with_place(seen, options.payload_place)
    if shape_only(seen):
        raise IdentificationError(
            "these rows only say that points lie in planes or on lines whose places are unknown: a fit makes them "
            "flatter and may make the robot worse (on a real one tracker errors grew 2.4 times); add a ball or a "
            "socket at several places, a known length, a ballbar or a string",
            file=seen.source,
        )
    fit = identify_features(urdf.arm, seen, options.terms, progress=say)
    proof = prove(urdf.arm, seen, options.leave_out, options.terms, options.seed, say)
    before, left = fit.left_open()
    section = _section(fit, proof, before, left)
    doubts = [*_doubts(section), *fit.doubts()]
    points = as_points(seen)
    rows = len(seen)
    missed = fit.problem.residuals(fit.nominal_state), fit.problem.residuals(fit.state)
    left_out = (np.zeros(0), np.zeros(0))
    aside = np.zeros(rows, dtype=bool)
    if proof is not None:
        left_out = proof.of_rows(rows, False), proof.of_rows(rows)
        aside = np.isfinite(left_out[1])
    order = np.argsort(_pose_of(seen), kind="stable")
    kept = aside[order]
    heldout = tuple(one[order][kept] for one in left_out) if proof else left_out
    at = AtFeatures(section, (missed[0][order], missed[1][order]), heldout)
    return Outcome(
        urdf,
        robots.robot_file(robot),
        fit,
        PlacedRobot(fit.nominal_robot),
        points,
        points
        if aside.all()
        else points.take(kept).without_empty_poses()
        if aside.any()
        else points.select(np.zeros(points.poses, dtype=bool)),
        seen.as_measurements(),
        None,
        seen.poses,
        (),
        {},
        {},
        None,
        (*doubts, *calibrated_before(robots.robot_file(robot)), *_notes(section), *fit.sentences()),
        time.perf_counter() - started,
        doubts=tuple(doubts),
        features=at,
    )


def _with_place(seen: FeatureSet, place: Sequence[float] | None) -> FeatureSet:
    """The rows with the place of their payload, where an option tells it."""
    if place is None:
        return seen
    if seen.payload_kg is None or seen.payload_place is not None:
        why = "there is no column payload_kg" if seen.payload_kg is None else "the rows tell the payload's place"
        raise OptionError(f"payload_place: {why}: leave it out", parameter="payload_place")
    return replace(seen, payload_place=np.tile(np.asarray(place, dtype=float), (len(seen), 1)))


def _table(measurements: MeasurementsLike) -> TableLike:
    """What holds the rows, as a file or a table."""
    if isinstance(measurements, (str, PathLike, pd.DataFrame)):
        return measurements
    found = measurements if isinstance(measurements, MeasurementSet) else measurements.measurements()
    return found.to_frame()


def _pose_of(seen: FeatureSet) -> IntArray:
    return np.unique(seen.pose_index, return_inverse=True)[1]


def _doubts(section: FeaturesSection) -> list[str]:
    """What speaks against it, whatever the rows say of each other."""
    doubts = (
        []
        if section.scale_measured or section.scale_from
        else [
            "No length was measured: a robot whose links are all 0.3 % longer than nominal fits these rows as well, "
            "and would be calibrated worse than it is. Add a known length between two features (a bar), or rows that a "
            "tracker measured."
        ]
    )
    if section.open_mm <= OPEN * section.before_mm:
        return doubts
    return [
        *doubts,
        f"These rows leave {section.open_mm:.3f} mm of the {section.before_mm:.3f} mm open that the tool's place is "
        "uncertain by (root mean square, at joints like these): they agree with each other, but tell too little of the "
        "arm. Measure at more places, or add known lengths.",
    ]


def _notes(section: FeaturesSection) -> list[str]:
    """What a user should know of it."""
    notes = [f"{section.scale[0].upper()}{section.scale[1:]}."] if section.scale else []
    if not section.framed:
        notes.append(
            "Nothing ties the features to a measuring frame: the base is the nominal one, and places are those of the "
            "base link."
        )
    notes.append(
        f"At joints like these the tool's place is known within {section.open_mm:.3f} mm (root mean square, predicted; "
        f"{section.before_mm:.3f} mm before these rows): no tracker has seen it."
    )
    return notes


def _section(fit: FeatureFit, proof: FeatureProof | None, before: float, left: float) -> FeaturesSection:
    seen, problem = fit.problem.seen, fit.problem
    groups = as_groups(seen)
    lengths = {} if proof is None else proof.lengths
    fitted = problem.length_errors(fit.state)
    return FeaturesSection(
        kinds=seen.kinds(),
        framed=problem.framed,
        scale_measured=fit.scale_measured,
        left_out=None if proof is None else proof.by,
        before_mm=before / MM,
        open_mm=left / MM,
        features=_feature_rows(fit, groups),
        places=[] if proof is None else _place_rows(proof),
        lengths=[
            LengthRow(
                name=one.name,
                first=one.first,
                second=one.second,
                length_mm=one.length / MM,
                fitted_mm=float(error) / MM,
                nominal_mm=lengths[one.name][0] / MM if one.name in lengths else None,
                heldout_mm=lengths[one.name][1] / MM if one.name in lengths else None,
            )
            for one, error in zip(seen.lengths, fitted, strict=True)
        ],
        named=seen.named,
        scale_from=fit.scale_from,
    )


def as_groups(seen: FeatureSet) -> dict[str, str]:
    """The place of each feature, as rows name it."""
    places = seen.places("place") if "place" in seen.cells.columns else seen.places()
    return {str(name): str(places[np.flatnonzero(seen.feature == name)[0]]) for name in seen.features}


def _feature_rows(found: FeatureFit, places: dict[str, str]) -> list[FeatureRow]:
    problem, seen = found.problem, found.problem.seen
    misses = [problem.residuals(state) for state in (found.nominal_state, found.state)]
    tool = np.zeros((len(seen), 3))
    known: dict[str, dict[str, list[float]]] = {}
    for one in problem.misses(found.state):
        tool[one.group.rows] = one.seen.p
        unknown, given = one.group.keys(), known.setdefault(one.group.feature.name, {})
        for what, held in one.own.items():
            if what not in unknown:
                given[what] = (np.ravel(held) / SHOWN[one.group.kind.own[what].unit]).tolist()
    out = []
    for name, feature in seen.features.items():
        mine = seen.feature == name
        nominal, own = (float(np.sqrt(np.mean(miss[mine] ** 2))) / MM for miss in misses)
        values: dict[str, list[float]] = {}
        std: dict[str, list[float]] = {}
        for key, unit in _unknowns(problem, name).items():
            shape = problem.layout[key][0]
            value, deviation = found.state.own[key], found.std_of(key)
            if shape in ("axis", "line"):
                values[key[0]] = value[:, 2].tolist()
                if shape == "line":
                    values["through"] = (value[:, 3] / MM).tolist()
                    deviation = deviation[:2]
            else:
                values[key[0]] = ((frames_of(value) if shape == "turn" else value) / unit).tolist()
            std[key[0]] = (deviation / unit).tolist()
        out.append(
            FeatureRow(
                name=name,
                kind=feature.kind,
                target=feature.target,
                rows=int(mine.sum()),
                place=places[name],
                rms_mm=own,
                nominal_rms_mm=nominal,
                found=values,
                std=std,
                known=known[name],
                middle_mm=(tool[mine].mean(axis=0) / MM).tolist(),
                spread_mm=float(np.sqrt(tool[mine].var(axis=0).sum())) / MM,
                imaging={} if feature.imaging is None else feature.imaging.columns(),
            )
        )
    return out


def _unknowns(problem: FeatureProblem, feature: str) -> dict[Key, float]:
    """What was unknown of a feature, and numbers of what looked at it, with the units they are shown in."""
    owns = {
        key: group.kind.own[name]
        for group in problem.groups
        if group.feature.name == feature
        for name, key in group.keys().items()
    }
    return {
        key: SHOWN[owns[key].unit]
        for key in problem.layout
        if key in owns and (owns[key].of == "feature" or owns[key].shape == "number")
    }


def _place_rows(proof: FeatureProof) -> list[PlaceRow]:
    return [
        PlaceRow(
            name=one.name,
            rows=len(one.rows),
            nominal_mean_mm=float(one.nominal.mean()) / MM,
            nominal_max_mm=float(one.nominal.max()) / MM,
            mean_mm=float(one.calibrated.mean()) / MM,
            rms_mm=float(np.sqrt(np.mean(one.calibrated**2))) / MM,
            max_mm=float(one.calibrated.max()) / MM,
        )
        for one in proof.places
    ]
