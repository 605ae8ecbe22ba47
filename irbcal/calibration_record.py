"""The record of a calibration: what ``calibration.json`` says of a validated one, and the corrected URDF."""

from __future__ import annotations

import hashlib
import platform
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from irbcal import __version__
from irbcal.arrays import FloatArray
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.explanation import explain
from irbcal.identification.fit import certainty_of
from irbcal.identification.fit_sections import ModelAverage
from irbcal.io import integrity, robots, urdf, urdf_check, urdf_xml
from irbcal.io.calibration_folder import SCHEMA
from irbcal.io.packed_covariance import PackedCovariance
from irbcal.io.point_tables import PointTable, PoseTable, texts
from irbcal.io.robot_section import FilePose, JointOrigin, OriginSection, Placement, RobotSection
from irbcal.io.schema import CertaintySection, DataFile, ReachedObjective, Record, SessionSection
from irbcal.io.term_sections import FrameTermsSection, JointMapSection
from irbcal.measurement import repeats
from irbcal.measurement.motions import last_moves
from irbcal.measurement.points import Errors, PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.workspace_coverage import workspace_coverage
from irbcal.pipeline import Validated
from irbcal.section import in_unit
from irbcal.units import MM
from irbcal.validation.verdict import doubts_of, share_left_out


def recorded(validated: Validated, started: float) -> tuple[Record, bytes]:
    """Content of a calibration folder, checked against Pinocchio and yourdfpy.

    Parameters
    ----------
    validated : Validated
    started : float
        When the first step began, as `time.perf_counter` counts.

    Raises
    ------
    CalibrationError
        If one of them disagrees with the URDF by more than 1e-9.
    """
    fit, robot = validated.fit, validated.fit.robot
    certainty = fit.certainty if isinstance(fit, EvidenceFit) else robot.certainty or certainty_of(fit)
    fitted_points, heldout, features = validated.fit_points, validated.heldout_points, validated.features
    # rows at features are fitted, and held out in turn: the same ones
    used = (fitted_points,) if features else (fitted_points, heldout)
    added_to = [] if validated.earlier is None else [validated.earlier.record]
    created = datetime.now(timezone.utc).isoformat(timespec="seconds")
    moving = _moving_sections(validated, added_to)
    fingerprint = integrity.fingerprint(moving)
    urdf_bytes = urdf.to_bytes(
        validated.urdf, robot.arm, mark=fingerprint, comment=_urdf_comment(validated, moving, created)
    )
    nominal, errors = validated.nominal_robot, validated.errors
    known = CertaintySection(
        **dict(certainty.limits),
        workspace_coverage=None  # the nominal robot promises nothing
        if fit.level == "nominal"
        else workspace_coverage(robot, nominal, fitted_points.q, heldout.q),
    )
    content = Record(
        schema_name=SCHEMA,
        created=created,
        fingerprint=fingerprint,
        **moving,
        calibrated_urdf_sha256=hashlib.sha256(urdf_bytes).hexdigest(),
        model=fit.level,
        method=fit.method,
        objective=ReachedObjective(
            name=fit.objective,
            value_mm=(fit.rms if fit.value is None else fit.value) / MM,
            lower_bound_mm=None if fit.lower_bound is None else fit.lower_bound / MM,
        ),
        choice=fit.choice if isinstance(fit, EvidenceFit) else validated.choice,
        evidence=_average(validated),
        rank=fit.rank,
        parameter_count=fit.parameter_count,
        parameters=fit.parameters(),
        covariance=PackedCovariance.from_matrix(certainty.covariance),
        certainty=known,
        undetermined=fit.undetermined(),
        observability=fit.observability(),
        history={} if fit.history is None else fit.history.columns(),
        placement_nominal=Placement.from_robot(nominal),
        tool_shape_mm=in_unit(validated.tool_shape, MM),
        sessions=[
            SessionSection(name=name, base=FilePose.from_transform(T))
            for name, T in zip(validated.sessions, (*fit.other_bases.values(), robot.T_world_base), strict=False)
        ],
        earlier=added_to[0].fingerprint if added_to else None,
        references_mm=in_unit(validated.references, MM),
        fit=Errors.from_points(robot, fitted_points, errors.fit),
        fit_nominal=Errors.from_points(nominal, fitted_points, errors.fit_nominal),
        heldout=Errors.from_points(robot, heldout, errors.heldout),
        heldout_nominal=Errors.from_points(nominal, heldout, errors.heldout_nominal),
        heldout_least_squares=_least_squares_errors(validated),
        poses_fit=fitted_points.poses,
        poses_heldout=heldout.poses,
        poses_excluded=validated.poses_measured - sum(points.poses for points in used),
        features=features,
        points=PointTable.from_points(fitted_points, heldout, errors, placed=features is None),
        poses=_pose_table(validated),
        excluded=list(validated.excluded),
        notes=list(validated.notes),
        doubts=[
            *validated.doubts,
            *known.doubts(),
            *doubts_of(share_left_out(validated.excluded, sum(map(len, used))), len(heldout) > 0),
        ],
        mesh_folders=_mesh_folders(validated, added_to) or None,
        urdf_witnesses=urdf_check.check(urdf_bytes, robot.arm),
        largest_link_shift_mm=urdf.largest_link_shift(validated.urdf, robot.arm) / MM,
        software=dict(software()),
        seconds=time.perf_counter() - started,
    )
    return content, urdf_bytes


def _moving_sections(validated: Validated, added_to: Sequence[Record]) -> dict[str, Any]:
    """What moves a robot, and where it comes from: the parts of the record that the fingerprint is of."""
    robot, arm = validated.fit.robot, validated.urdf.arm
    files = [file for file in (validated.measurements, validated.verification) if file is not None]
    data = [DataFile(file=Path(file.source).name, sha256=file.sha256, programmed=file.programmed) for file in files]
    data += [file for earlier in added_to for file in earlier.data if file not in data]
    nominal_origins, origins = (urdf.joint_origins(validated.urdf, each) for each in (arm, robot.arm))
    return {
        "simulated": any([*(file.simulated for file in files), *(item.simulated for item in added_to)]),
        "robot": RobotSection.from_arm(arm, robot.table, *validated.nominal_source),
        "joint_origins": [
            JointOrigin(
                joint=name,
                link=link,
                nominal=OriginSection.from_transform(nominal_origins[name]),
                calibrated=OriginSection.from_transform(origins[name]),
            )
            for name, link in zip(arm.joint_names, validated.urdf.child_links, strict=True)
        ],
        "joint_map": JointMapSection.from_joint_map(robot.joint_map, robot.arm),
        "frame_terms": FrameTermsSection.of_robot(robot),
        "placement": Placement.from_robot(robot),
        "data": data,
    }


def _urdf_comment(validated: Validated, moving: Mapping[str, Any], created: str) -> str:
    """What the corrected URDF says of itself."""
    listed = " and ".join(f"{file.file} (SHA-256 {file.sha256[:12]}...)" for file in moving["data"])
    kind = "SIMULATED measurements" if moving["simulated"] else "measurements"
    beside = "" if moving["frame_terms"] is None else f" {moving['frame_terms'].in_words}"
    return (
        f"CALIBRATED by irbcal {__version__} on {created}: the joint origins of {validated.nominal_source[0]} were "
        f"corrected, model {validated.fit.level}, from {kind} {listed}. Comments below that call this robot nominal "
        f"are those of that file. The joint map is in calibration.json.{beside}"
    )


def _mesh_folders(validated: Validated, added_to: Sequence[Record]) -> list[str]:
    """Where the meshes of the robot's URDF lie, unless every reader looks there."""
    folders = [
        *validated.options.package_dirs,
        *(folder for record in added_to for folder in record.mesh_folders or ()),
    ]
    finder = urdf_xml.MeshFolders(validated.robot_file.parent, robots.package_dirs(*folders))
    return urdf_xml.mesh_folders(validated.urdf.tree.getroot(), finder, robots.package_dirs())


def _average(validated: Validated) -> ModelAverage | None:
    """What is known of an average, with what each family of terms explains on the held-out poses."""
    if not isinstance(validated.fit, EvidenceFit) or validated.features is not None:
        return validated.fit.average if isinstance(validated.fit, EvidenceFit) else None
    # poses of another file were not measured while the arm warmed up as in the fit
    elapsed = validated.heldout_motion.elapsed if validated.verification is None else None
    stages = explain(validated.fit, validated.heldout_points, elapsed)
    return validated.fit.average.model_copy(update={"explained": stages})


def _least_squares_errors(validated: Validated) -> Errors | None:
    """Held-out errors of the fit by least squares, where another objective was asked for."""
    least_squares, points = validated.fit.least_squares, validated.heldout_points
    return (
        None
        if least_squares is None
        else Errors.from_points(least_squares.robot, points, distances(least_squares.robot, points))
    )


def _pose_table(validated: Validated) -> PoseTable:
    """All poses, with the directions from which their joints were reached."""
    sets, motions = (validated.fit_points, validated.heldout_points), (validated.fit_motion, validated.heldout_motion)
    if validated.verification is None:
        sides = _came_from(validated.measurements, sets)
    else:
        sides = [*_came_from(validated.measurements, sets[:1]), *_came_from(validated.verification, sets[1:])]
    elapsed = [motion.elapsed for motion in motions if motion.elapsed is not None]
    number = np.concatenate(elapsed) if elapsed else np.zeros(0)
    return PoseTable.from_points(*sets, validated.urdf.arm, np.concatenate(sides), number)


def _came_from(measurements: MeasurementSet, sets: Sequence[PointSet]) -> list[FloatArray]:
    """Sign of the last move of each joint before each pose, 0 where it is not known, shape (n, joints), of each set."""
    names = measurements.per_pose("pose")
    groups = measurements.per_pose("group") if "group" in measurements.cells.columns else None
    q = measurements.joints()
    sign = np.sign(np.nan_to_num(last_moves(q, groups)))
    rows, *numbers = repeats.numbered((names, q), *((texts(points.pose_ids), points.q) for points in sets))
    size = 1 + max(of_kind.max(initial=-1) for of_kind in (rows, *numbers))
    # of poses with the same name and joints it is not known which one this is
    has_sign, sign_of = np.zeros(size, dtype=bool), np.zeros((size, q.shape[1]))
    has_sign[rows], sign_of[rows] = True, sign
    unlike = (sign_of[rows] != sign).astype(float)
    sign_of[np.column_stack([np.bincount(rows, column, minlength=size) for column in unlike.T]) > 0] = 0.0
    # those of an earlier calibration are not in the file
    pairs = zip(numbers, sets, strict=True)
    return [np.where(has_sign[number, None], sign_of[number], np.sign(points.moves())) for number, points in pairs]


@cache
def software() -> Mapping[str, str]:
    """Versions of what a result depends on."""
    packages = {}
    for name in ("numpy", "scipy", "pandas", "pin", "yourdfpy"):
        with suppress(PackageNotFoundError):  # pin has no wheels for some systems
            packages[name] = version(name)
    return {"python": platform.python_version(), "irbcal": __version__, **packages}
