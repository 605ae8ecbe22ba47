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


def recorded(done: Validated, started: float) -> tuple[Record, bytes]:
    """Content of a calibration folder, checked against Pinocchio and yourdfpy.

    Parameters
    ----------
    done : Validated
    started : float
        When the first step began, as `time.perf_counter` counts.

    Raises
    ------
    CalibrationError
        If one of them disagrees with the URDF by more than 1e-9.
    """
    fit, robot = done.fit, done.fit.robot
    certainty = fit.certainty if isinstance(fit, EvidenceFit) else robot.certainty or certainty_of(fit)
    fitted_points, heldout, features = done.fit_points, done.heldout_points, done.features
    # rows at features are fitted, and held out in turn: the same ones
    used = (fitted_points,) if features else (fitted_points, heldout)
    added_to = [] if done.earlier is None else [done.earlier.record]
    created = datetime.now(timezone.utc).isoformat(timespec="seconds")
    moving = _moving_sections(done, added_to)
    fingerprint = integrity.fingerprint(moving)
    urdf_bytes = urdf.to_bytes(done.urdf, robot.arm, mark=fingerprint, comment=_urdf_comment(done, moving, created))
    nominal, errors = done.nominal_robot, done.errors
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
        choice=fit.choice if isinstance(fit, EvidenceFit) else done.choice,
        evidence=_average(done),
        rank=fit.rank,
        parameter_count=fit.parameter_count,
        parameters=fit.parameters(),
        covariance=PackedCovariance.from_matrix(certainty.covariance),
        certainty=known,
        undetermined=fit.undetermined(),
        observability=fit.observability(),
        history={} if fit.history is None else fit.history.columns(),
        placement_nominal=Placement.from_robot(nominal),
        tool_shape_mm=in_unit(done.tool_shape, MM),
        sessions=[
            SessionSection(name=name, base=FilePose.from_transform(T))
            for name, T in zip(done.sessions, (*fit.other_bases.values(), robot.T_world_base), strict=False)
        ],
        earlier=added_to[0].fingerprint if added_to else None,
        references_mm=in_unit(done.references, MM),
        fit=Errors.from_points(robot, fitted_points, errors.fit),
        fit_nominal=Errors.from_points(nominal, fitted_points, errors.fit_nominal),
        heldout=Errors.from_points(robot, heldout, errors.heldout),
        heldout_nominal=Errors.from_points(nominal, heldout, errors.heldout_nominal),
        heldout_least_squares=_least_squares_errors(done),
        poses_fit=fitted_points.poses,
        poses_heldout=heldout.poses,
        poses_excluded=done.poses_measured - sum(points.poses for points in used),
        features=features,
        points=PointTable.from_points(fitted_points, heldout, errors, placed=features is None),
        poses=_pose_table(done),
        excluded=list(done.excluded),
        notes=list(done.notes),
        doubts=[
            *done.doubts,
            *known.doubts(),
            *doubts_of(share_left_out(done.excluded, sum(map(len, used))), len(heldout) > 0),
        ],
        mesh_folders=_mesh_folders(done, added_to) or None,
        urdf_witnesses=urdf_check.check(urdf_bytes, robot.arm),
        largest_link_shift_mm=urdf.largest_link_shift(done.urdf, robot.arm) / MM,
        software=dict(software()),
        seconds=time.perf_counter() - started,
    )
    return content, urdf_bytes


def _moving_sections(done: Validated, added_to: Sequence[Record]) -> dict[str, Any]:
    """What moves a robot, and where it comes from: the parts of the record that the fingerprint is of."""
    robot, arm = done.fit.robot, done.urdf.arm
    files = [file for file in (done.measurements, done.verification) if file is not None]
    data = [DataFile(file=Path(file.source).name, sha256=file.sha256, programmed=file.programmed) for file in files]
    data += [file for earlier in added_to for file in earlier.data if file not in data]
    nominal_origins, origins = (urdf.joint_origins(done.urdf, each) for each in (arm, robot.arm))
    return {
        "simulated": any([*(file.simulated for file in files), *(item.simulated for item in added_to)]),
        "robot": RobotSection.from_arm(arm, robot.table, *done.nominal_source),
        "joint_origins": [
            JointOrigin(
                joint=name,
                link=link,
                nominal=OriginSection.from_transform(nominal_origins[name]),
                calibrated=OriginSection.from_transform(origins[name]),
            )
            for name, link in zip(arm.joint_names, done.urdf.child_links, strict=True)
        ],
        "joint_map": JointMapSection.from_joint_map(robot.joint_map, robot.arm),
        "frame_terms": FrameTermsSection.of_robot(robot),
        "placement": Placement.from_robot(robot),
        "data": data,
    }


def _urdf_comment(done: Validated, moving: Mapping[str, Any], created: str) -> str:
    """What the corrected URDF says of itself."""
    listed = " and ".join(f"{file.file} (SHA-256 {file.sha256[:12]}...)" for file in moving["data"])
    kind = "SIMULATED measurements" if moving["simulated"] else "measurements"
    beside = "" if moving["frame_terms"] is None else f" {moving['frame_terms'].in_words}"
    return (
        f"CALIBRATED by irbcal {__version__} on {created}: the joint origins of {done.nominal_source[0]} were "
        f"corrected, model {done.fit.level}, from {kind} {listed}. Comments below that call this robot nominal are "
        f"those of that file. The joint map is in calibration.json.{beside}"
    )


def _mesh_folders(done: Validated, added_to: Sequence[Record]) -> list[str]:
    """Where the meshes of the robot's URDF lie, unless every reader looks there."""
    folders = [*done.options.package_dirs, *(folder for record in added_to for folder in record.mesh_folders or ())]
    finder = urdf_xml.MeshFolders(done.robot_file.parent, robots.package_dirs(*folders))
    return urdf_xml.mesh_folders(done.urdf.tree.getroot(), finder, robots.package_dirs())


def _average(done: Validated) -> ModelAverage | None:
    """What is known of an average, with what each family of terms explains on the held-out poses."""
    if not isinstance(done.fit, EvidenceFit) or done.features is not None:
        return done.fit.average if isinstance(done.fit, EvidenceFit) else None
    # poses of another file were not measured while the arm warmed up as in the fit
    elapsed = done.heldout_motion.elapsed if done.verification is None else None
    stages = explain(done.fit, done.heldout_points, elapsed)
    return done.fit.average.model_copy(update={"explained": stages})


def _least_squares_errors(done: Validated) -> Errors | None:
    """Held-out errors of the fit by least squares, where another objective was asked for."""
    least_squares, points = done.fit.least_squares, done.heldout_points
    return (
        None
        if least_squares is None
        else Errors.from_points(least_squares.robot, points, distances(least_squares.robot, points))
    )


def _pose_table(done: Validated) -> PoseTable:
    """All poses, with the directions from which their joints were reached."""
    sets, motions = (done.fit_points, done.heldout_points), (done.fit_motion, done.heldout_motion)
    if done.verification is None:
        sides = _came_from(done.measurements, sets)
    else:
        sides = [*_came_from(done.measurements, sets[:1]), *_came_from(done.verification, sets[1:])]
    elapsed = [motion.elapsed for motion in motions if motion.elapsed is not None]
    number = np.concatenate(elapsed) if elapsed else np.zeros(0)
    return PoseTable.from_points(*sets, done.urdf.arm, np.concatenate(sides), number)


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
