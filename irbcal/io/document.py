"""From the outcome of an identification to what stands in ``calibration.json`` and ``calibrated.urdf``."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from irbcal import __version__
from irbcal.arrays import FloatArray, NameArray
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.explanation import explain
from irbcal.identification.fit import Fit, certainty_of
from irbcal.identification.history import History
from irbcal.identification.selection import Choice as LevelChoice
from irbcal.io import integrity, urdf, urdf_check
from irbcal.io.calibration_folder import SCHEMA
from irbcal.io.outcome import Outcome
from irbcal.io.schema import (
    CertaintySection,
    Choice,
    Correlation,
    CovarianceSection,
    DataFile,
    Errors,
    EvidenceChoice,
    EvidenceSection,
    FrameTermsSection,
    JointMapSection,
    JointOrigin,
    Objective,
    Observability,
    Origin,
    Parameter,
    Placement,
    PointTable,
    Pose,
    PoseTable,
    Record,
    RobotSection,
    Row,
    SessionSection,
)
from irbcal.io.urdf import UrdfArm
from irbcal.measurement import near
from irbcal.measurement.blocks import MARK
from irbcal.measurement.last_moves import last_moves
from irbcal.measurement.own_tables import shared
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.statistics import rotation_statistics, statistics, statistics_by
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.elsewhere import Elsewhere, elsewhere
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import LOAD
from irbcal.units import DEG, MM

NORMAL_95 = 1.959964
PLACE_DIGITS, JOINT_DIGITS, QUATERNION_DIGITS = 6, 9, 12
"""Decimals of measured places (mm), joints (degrees, mm) and quaternions: far below what is measured."""


def _rows(table: DHMTable) -> list[Row]:
    return [
        Row(
            alpha_deg=table.alpha[i] / DEG,
            a_mm=table.a[i] / MM,
            theta_deg=table.theta[i] / DEG,
            d_mm=table.d[i] / MM,
            beta_deg=table.beta[i] / DEG,
            b_mm=table.b[i] / MM,
        )
        for i in range(len(table.a))
    ]


def _pose(T: FloatArray) -> Pose:
    w, x, y, z = frames.quaternion_from_matrix(T[:3, :3]).tolist()
    return Pose(x_mm=T[0, 3] / MM, y_mm=T[1, 3] / MM, z_mm=T[2, 3] / MM, qw=w, qx=x, qy=y, qz=z)


def _placement(robot: Robot) -> Placement:
    targets = {name: (xyz / MM).tolist() for name, xyz in robot.targets.items()}
    frames_of = {name: _pose(frames.transform(R)) for name, R in robot.target_rotations.items()}
    quaternions = {name: [q.qw, q.qx, q.qy, q.qz] for name, q in frames_of.items()}
    return Placement(base=_pose(robot.T_world_base), targets=targets, target_quaternions=quaternions)


def _objective(fit: Fit | EvidenceFit) -> Objective:
    bound = fit.lower_bound
    return Objective(
        name=fit.objective,
        value_mm=(fit.rms if fit.value is None else fit.value) / MM,
        lower_bound_mm=None if bound is None else bound / MM,
    )


def _parameters(fit: Fit | EvidenceFit) -> list[Parameter]:
    return [
        Parameter(
            **vars(row),
            low=None if row.std is None else row.value - NORMAL_95 * row.std,
            high=None if row.std is None else row.value + NORMAL_95 * row.std,
        )
        for row in fit.parameters()
    ]


def _observability(fit: Fit | EvidenceFit) -> Observability:
    if isinstance(fit, EvidenceFit):  # nothing is held: how much was seen stands with the groups of terms
        return Observability(singular_values_mm=[], seen=fit.rank, indices={}, correlations=[])
    information = fit.solution.information
    names = [p.name for p in fit.problem.parameters]
    return Observability(
        singular_values_mm=(information.singular_values / MM).tolist(),
        seen=int(information.seen.sum()),
        indices=information.indices(fit.problem.points.poses),
        correlations=[
            Correlation(first=names[i], second=names[j], coefficient=c) for i, j, c in information.correlations()
        ],
    )


def _choice(choice: LevelChoice | None, fit: Fit | EvidenceFit) -> Choice | EvidenceChoice | None:
    if isinstance(fit, EvidenceFit):
        return EvidenceChoice.of(fit)
    if choice is None:
        return None
    return Choice(level=choice.level, table=[vars(row) for row in choice.table], explanation=choice.explanation)


def _evidence(outcome: Outcome) -> EvidenceSection | None:
    """Of an average, with what each family of terms explains on the held-out poses."""
    fit, heldout = outcome.fit, outcome.heldout_points
    if not isinstance(fit, EvidenceFit):
        return None
    if outcome.features is not None:
        return EvidenceSection.of(fit)
    # poses of another file were not measured while the arm warmed up as in the fit
    elapsed = outcome.numbers[1] if outcome.verification is None else None
    return EvidenceSection.of(fit, explain(fit, heldout, elapsed))


def _history(history: History | None) -> dict[str, list[float]]:
    if history is None:
        return {}
    columns = history.to_frame()
    return {str(name): [float(value) for value in columns[name]] for name in columns.columns}


def _limits(values: FloatArray, units: FloatArray) -> list[float | None]:
    return [float(value / unit) if np.isfinite(value) else None for value, unit in zip(values, units, strict=True)]


def _source(outcome: Outcome) -> tuple[str, str]:
    """Name and SHA-256 of the nominal URDF."""
    file = outcome.robot_file
    return outcome.robot_source or (file.name, hashlib.sha256(file.read_bytes()).hexdigest())


def _robot_section(outcome: Outcome) -> RobotSection:
    arm = outcome.urdf.arm
    name, sha256 = _source(outcome)
    return RobotSection(
        name=arm.name,
        urdf=name,
        urdf_sha256=sha256,
        base_link=arm.base_link,
        tip_link=arm.tip_link,
        joint_names=list(arm.joint_names),
        joint_types=["prismatic" if slides else "revolute" for slides in arm.table.prismatic],
        lower=_limits(arm.lower, arm.joint_units),
        upper=_limits(arm.upper, arm.joint_units),
        base_to_frame0=arm.T_base_0.tolist(),
        last_frame_to_tip=arm.T_last_tip.tolist(),
        dhm_nominal=_rows(arm.table),
        dhm_calibrated=_rows(outcome.fit.robot.table),
        coupling=None if arm.coupling is None else arm.coupling.tolist(),
    )


def _joint_origins(urdf_arm: UrdfArm, corrected: Arm) -> list[JointOrigin]:
    nominal, calibrated = (urdf.joint_origins(urdf_arm, arm) for arm in (urdf_arm.arm, corrected))
    return [
        JointOrigin(joint=name, link=link, nominal=Origin.of(nominal[name]), calibrated=Origin.of(calibrated[name]))
        for name, link in zip(urdf_arm.arm.joint_names, urdf_arm.child_links, strict=True)
    ]


def _errors(robot: Robot, points: PointSet, distance: FloatArray | None = None) -> Errors | None:
    """Statistics of points, of ``distance`` (points,) where that is not the robot's own from measured places."""
    if not len(points):
        return None
    distance = distances(robot, points) if distance is None else distance
    groups = points.groups[points.pose]
    return Errors(
        all=statistics(distance),
        orientation=rotation_statistics(rotation_distances(robot, points)),
        per_target=statistics_by(distance, points.names()),
        per_group={name: value for name, value in statistics_by(distance, groups).items() if name},
    )


def _point_table(outcome: Outcome) -> PointTable:
    columns: dict[str, list[Any]] = {key: [] for key in PointTable.model_fields}
    sets = ((outcome.fit_points, False), (outcome.heldout_points, True))
    with_u95 = any(points.u95 is not None and np.isfinite(points.u95).any() for points, _ in sets)
    turned = any(points.oriented().any() for points, _ in sets)
    before = 0
    for points, heldout in sets:
        columns["pose"] += _texts(points.pose_ids)[points.pose].tolist()
        columns["group"] += _texts(points.groups)[points.pose].tolist()
        columns["target"] += points.names().tolist()
        columns["heldout"] += [heldout] * len(points)
        columns["row"] += (points.pose + before).tolist()
        before += points.poses
        if not len(points):
            continue
        columns["nominal_mm"] += (outcome.errors(False, heldout) / MM).tolist()
        columns["calibrated_mm"] += (outcome.errors(True, heldout) / MM).tolist()
        if outcome.features is not None:
            continue
        for name, values in zip("xyz", points.xyz.T, strict=True):
            columns[f"{name}_mm"] += np.round(values / MM, PLACE_DIGITS).tolist()
        if with_u95:
            u95 = np.full(len(points), np.nan) if points.u95 is None else points.u95 / MM
            columns["u95_mm"] += _known(np.round(u95, PLACE_DIGITS))
        if turned:
            R = np.full((len(points), 3, 3), np.nan) if points.rotation is None else points.rotation
            quaternions = frames.quaternion_from_matrix(R)
            for name, values in zip(("qw", "qx", "qy", "qz"), quaternions.T, strict=True):
                columns[name] += _known(np.round(values, QUATERNION_DIGITS))
    return PointTable(**columns)


def _texts(names: NameArray) -> NameArray:
    """Names as text."""
    return np.array([str(name) for name in names.tolist()], dtype=object)


def _known(values: FloatArray) -> list[float | None]:
    if np.isfinite(values).all():
        return values.tolist()
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _pose_table(outcome: Outcome) -> PoseTable:
    arm = outcome.urdf.arm
    columns: dict[str, list[Any]] = {"pose": [], "group": [], "heldout": []}
    joints, before = [], []
    sets = (outcome.fit_points, False), (outcome.heldout_points, True)
    both = [points for points, _ in sets]
    if outcome.verification is None:
        sides = _came_from(outcome.measurements, both)
    else:
        sides = [_came_from(outcome.measurements, both[:1])[0], _came_from(outcome.verification, both[1:])[0]]
    loads: dict[str, list[FloatArray | None]] = {name: [] for name in LOAD}
    for points, heldout in sets:
        columns["pose"] += _texts(points.pose_ids).tolist()
        columns["group"] += _texts(points.groups).tolist()
        columns["heldout"] += [heldout] * points.poses
        joints.append(np.round(points.q / arm.joint_units, JOINT_DIGITS))
        stops = np.full(points.q.shape, np.nan) if points.previous is None else points.previous
        before.append(np.round(stops / arm.joint_units, JOINT_DIGITS))
        for name, value in points.load().items():
            width = {"payload_kg": (), "payload_place": (3,), "torques": (len(arm.joint_names),)}[name]
            loads[name].append(value if value is not None or points.poses else np.zeros((0, *width)))
    signs = np.frombuffer(b"-0+", dtype=np.uint8)[np.concatenate(sides).astype(int) + 1]
    came_from = [column.tobytes().decode("ascii") for column in signs.T]
    known = [value for value in outcome.numbers if value is not None]
    columns["number"] = np.concatenate(known).tolist() if sum(map(len, known)) == len(columns["pose"]) else []
    kg, place, torques = (
        None if any(part is None for part in parts) else np.concatenate([part for part in parts if part is not None])
        for parts in loads.values()
    )
    return PoseTable(
        **columns,
        joints=np.concatenate(joints).T.tolist(),
        came_from=came_from,
        previous=[_known(column) for column in np.concatenate(before).T],
        payload_kg=[] if kg is None else _known(kg),
        payload_place_mm=[] if place is None else [_known(column) for column in place.T / MM],
        torques_nm=[] if torques is None else torques.T.tolist(),
    )


def _came_from(measurements: MeasurementSet, sets: Sequence[PointSet]) -> list[FloatArray]:
    """Sign of the last move of each joint before each pose, 0 where it is not known, shape (n, joints), of each set."""
    table = shared(measurements)
    first = table.groupby("pose_index", sort=True)[[name for name in ("pose", "group") if name in table]].first()
    groups = first["group"].to_numpy(dtype=object) if "group" in first else None
    q = measurements.joints()
    sign = np.sign(np.nan_to_num(last_moves(q, groups)))
    names = first["pose"].astype(str).to_numpy()
    seen, *numbers = near.numbered((names, q), *((_texts(points.pose_ids), points.q) for points in sets))
    size = 1 + max(part.max(initial=-1) for part in (seen, *numbers))
    # of poses with the same name and joints it is not known which one this is
    known, found = np.zeros(size, dtype=bool), np.zeros((size, q.shape[1]))
    known[seen], found[seen] = True, sign
    unlike = (found[seen] != sign).astype(float)
    found[np.column_stack([np.bincount(seen, column, minlength=size) for column in unlike.T]) > 0] = 0.0
    # those of an earlier calibration are not in the file
    pairs = zip(numbers, sets, strict=True)
    return [np.where(known[mine, None], found[mine], np.sign(points.moves())) for mine, points in pairs]


def software() -> dict[str, str]:
    """Versions of what a result depends on."""
    packages = {name: version(name) for name in ("numpy", "scipy", "pandas", "pin", "yourdfpy")}
    return {"python": platform.python_version(), "irbcal": __version__, **packages}


def _elsewhere(outcome: Outcome) -> Elsewhere | None:
    """Of a calibrated robot; the nominal one promises nothing."""
    robots = outcome.fit.robot, outcome.nominal.robot
    return (
        None if outcome.fit.level == "nominal" else elsewhere(*robots, outcome.fit_points.q, outcome.heldout_points.q)
    )


def build(outcome: Outcome, *, world_link: bool = False, target_links: bool = False) -> tuple[Record, bytes]:
    """Content of a calibration folder, checked against Pinocchio.

    Parameters
    ----------
    outcome : Outcome
    world_link, target_links : bool
        Add the measuring frame and the reflectors to the URDF.

    Returns
    -------
    calibration : Record
    urdf_bytes : bytes

    Raises
    ------
    CalibrationError
        If Pinocchio disagrees with the URDF by more than 1e-9.
    """
    fit, robot = outcome.fit, outcome.fit.robot
    known = fit.certainty if isinstance(fit, EvidenceFit) else robot.certainty or certainty_of(fit)
    files = [outcome.measurements] + ([outcome.verification] if outcome.verification else [])
    data = [DataFile(file=Path(item.source).name, sha256=item.sha256, programmed=item.programmed) for item in files]
    data += [item for record in _earlier(outcome) for item in record.data if item not in data]
    created = datetime.now(timezone.utc).isoformat(timespec="seconds")
    simulated = any([*(item.simulated for item in files), *(item.simulated for item in _earlier(outcome))])
    moving = _moving(outcome, data, simulated)
    fingerprint = integrity.fingerprint(moving)
    urdf_bytes = urdf.to_bytes(
        outcome.urdf,
        robot.arm,
        robot.T_world_base if world_link else None,
        _own_targets(outcome) if target_links else None,
        fingerprint,
        _words(outcome, created, data, simulated, moving["frame_terms"]),
    )
    check = urdf_check.check(urdf_bytes, robot.arm)
    record = Record(
        schema_name=SCHEMA,
        created=created,
        fingerprint=fingerprint,
        **moving,
        calibrated_urdf_sha256=hashlib.sha256(urdf_bytes).hexdigest(),
        model=fit.level,
        method=fit.method,
        objective=_objective(fit),
        choice=_choice(outcome.choice, fit),
        evidence=_evidence(outcome),
        rank=fit.rank,
        parameter_count=fit.parameter_count,
        parameters=_parameters(fit),
        covariance=CovarianceSection.of(known.covariance),
        certainty=CertaintySection.of(known, _elsewhere(outcome)),
        held=fit.held(),
        observability=_observability(fit),
        history=_history(fit.history),
        placement_nominal=_placement(outcome.nominal.robot),
        tool_shape_mm=_in_mm(outcome.tool_shape),
        sessions=_sessions(outcome),
        earlier=None if outcome.earlier is None else outcome.earlier.record.fingerprint,
        references_mm=_in_mm(outcome.references),
        **_accuracy(outcome),
        points=_point_table(outcome),
        poses=_pose_table(outcome),
        excluded=[vars(item) for item in outcome.excluded],
        notes=outcome.notes,
        doubts=outcome.doubts,
        pinocchio_check=check,
        largest_link_shift_mm=urdf.largest_link_shift(outcome.urdf, robot.arm) / MM,
        software=software(),
        seconds=outcome.seconds,
    )
    return record, urdf_bytes


def _moving(outcome: Outcome, data: list[DataFile], simulated: bool) -> dict[str, Any]:
    """What the robot moves by: the parts of the fingerprint."""
    robot = outcome.fit.robot
    return {
        "simulated": simulated,
        "robot": _robot_section(outcome),
        "joint_origins": _joint_origins(outcome.urdf, robot.arm),
        "joint_map": JointMapSection.of(robot.joint_map, robot.arm),
        "frame_terms": FrameTermsSection.of_robot(robot),
        "placement": _placement(robot),
        "data": data,
    }


def _earlier(outcome: Outcome) -> list[Record]:
    """The calibration that was added to, if any."""
    return [] if outcome.earlier is None else [outcome.earlier.record]


def _own_targets(outcome: Outcome) -> dict[str, FloatArray]:
    """Targets of the last session."""
    others = tuple(f"{MARK}{name}" for name in outcome.other_bases)
    return {name: place for name, place in outcome.fit.robot.targets.items() if not name.endswith(others)}


def _sessions(outcome: Outcome) -> list[SessionSection]:
    bases = [*outcome.other_bases.values(), outcome.fit.robot.T_world_base]
    pairs = zip(outcome.sessions, bases, strict=False)
    return [SessionSection(name=name, base=_pose(T)) for name, T in pairs]


def _accuracy(outcome: Outcome) -> dict[str, Any]:
    """Errors and numbers of the fitted and the held-out poses."""
    fit, nominal = outcome.fit, outcome.nominal.robot
    fitted, heldout = outcome.fit_points, outcome.heldout_points
    own = [
        None if outcome.features is None else outcome.errors(calibrated, aside)
        for calibrated, aside in ((True, False), (False, False), (True, True), (False, True))
    ]
    return {
        "features": None if outcome.features is None else outcome.features.section,
        "fit": _errors(fit.robot, fitted, own[0]),
        "fit_nominal": _errors(nominal, fitted, own[1]),
        "heldout": _errors(fit.robot, heldout, own[2]),
        "heldout_nominal": _errors(nominal, heldout, own[3]),
        "heldout_least_squares": _errors(fit.least_squares.robot, heldout) if fit.least_squares else None,
        "poses_fit": fitted.poses,
        "poses_heldout": heldout.poses,
        "poses_excluded": 0 if outcome.features else outcome.poses_asked - fitted.poses - heldout.poses,
    }


def _in_mm(places: Mapping[str, FloatArray]) -> dict[str, list[float]]:
    return {name: (place / MM).tolist() for name, place in places.items()}


def _words(
    outcome: Outcome,
    created: str,
    data: Sequence[DataFile],
    simulated: bool,
    frame_terms: FrameTermsSection | None,
) -> str:
    """What the corrected URDF says of itself at its top."""
    names = " and ".join(f"{item.file} (SHA-256 {item.sha256[:12]}...)" for item in data)
    kind = "SIMULATED measurements" if simulated else "measurements"
    return (
        f"CALIBRATED by irbcal {__version__} on {created}: the joint origins of {_source(outcome)[0]} were "
        f"corrected, model {outcome.fit.level}, from {kind} {names}. Comments below that call this robot nominal are "
        "those of that file. The joint map is in calibration.json."
        + ("" if frame_terms is None else f" {frame_terms.in_words}")
    )
