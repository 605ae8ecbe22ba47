"""The calibration folder: ``calibrated.urdf``, ``joint_origins.yaml``, ``calibration.json`` and ``report.html``."""

import hashlib
import json
import platform
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np
from pydantic import ValidationError

from irbcal.errors import CalibrationError
from irbcal.files import origins, urdf, urdf_check
from irbcal.files.atomic import check_writable, write_together
from irbcal.files.schema import (
    Choice,
    Correlation,
    DataFile,
    Errors,
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
    TestVector,
)
from irbcal.measurement.last_moves import last_moves
from irbcal.measurement.points import distances, rotation_distances
from irbcal.measurement.statistics import rotation_statistics, statistics, statistics_by
from irbcal.modeling import frames
from irbcal.modeling.joint_map import FORMULA
from irbcal.units import DEG, MM


class HoldsRecord(Protocol):
    """A result that holds the content of a ``calibration.json``."""

    @property
    def record(self) -> Record:
        """The content."""
        ...


CalibrationLike: TypeAlias = str | Path | Record | HoldsRecord
"""Whatever names a calibration: its folder, its record, or a result that holds one."""

SCHEMA = "irbcal-calibration-1"
URDF_NAME, JSON_NAME, REPORT_NAME = "calibrated.urdf", "calibration.json", "report.html"
ORIGINS_NAME = "joint_origins.yaml"
NAMES = (URDF_NAME, ORIGINS_NAME, JSON_NAME, REPORT_NAME)
TEST_VECTORS = 5
NORMAL_95 = 1.959964
PLACE_DIGITS, JOINT_DIGITS, QUATERNION_DIGITS = 6, 9, 12
"""Decimals of measured places (mm), joints (degrees, mm) and quaternions: far below what is measured."""


def _rows(table):
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


def _pose(T):
    w, x, y, z = frames.quaternion_from_matrix(T[:3, :3]).tolist()
    return Pose(x_mm=T[0, 3] / MM, y_mm=T[1, 3] / MM, z_mm=T[2, 3] / MM, qw=w, qx=x, qy=y, qz=z)


def _placement(robot):
    targets = {name: (xyz / MM).tolist() for name, xyz in robot.targets.items()}
    frames_of = {name: _pose(frames.transform(R)) for name, R in robot.target_rotations.items()}
    quaternions = {name: [q.qw, q.qx, q.qy, q.qz] for name, q in frames_of.items()}
    return Placement(base=_pose(robot.T_world_base), targets=targets, target_quaternions=quaternions)


def _objective(fit):
    bound = fit.lower_bound
    return Objective(
        name=fit.objective,
        value_mm=(fit.rms if fit.value is None else fit.value) / MM,
        lower_bound_mm=None if bound is None else bound / MM,
    )


def _parameters(fit):
    return [
        Parameter(
            **vars(row),
            low=None if row.std is None else row.value - NORMAL_95 * row.std,
            high=None if row.std is None else row.value + NORMAL_95 * row.std,
        )
        for row in fit.parameters()
    ]


def _observability(fit):
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


def _choice(choice):
    if choice is None:
        return None
    return Choice(level=choice.level, table=[vars(row) for row in choice.table], explanation=choice.explanation)


def _history(history):
    if history is None:
        return {}
    columns = history.to_frame()
    return {str(name): [float(value) for value in columns[name]] for name in columns.columns}


def _joint_map_section(joint_map, arm):
    q = arm.random_joints(TEST_VECTORS, seed=1)
    vectors = [
        TestVector(commanded=row.tolist(), effective=effective.tolist())
        for row, effective in zip(q, joint_map.effective(q), strict=True)
    ]
    a1, b1, a2, b2 = joint_map.fourier
    equations = [f"theta_i = q_i + gain_i q_i for i = 1 ... {len(arm.joint_names)} (radians, metres)"]
    if arm.six_revolute:
        equations += [
            "theta_2 += A sin(q_2 + phi2) + B sin(q_2 + q_3 + phi3)",
            "theta_3 += B sin(q_2 + q_3 + phi3)",
            "theta_6 += a1 cos(q_6) + b1 sin(q_6) + a2 cos(2 q_6) + b2 sin(2 q_6)",
        ]
    return JointMapSection(
        formula=FORMULA,
        equations=equations,
        gain=joint_map.gain.tolist(),
        stiffness_A_rad=joint_map.stiffness[0],
        stiffness_B_rad=joint_map.stiffness[1],
        phi2_rad=joint_map.phases[0],
        phi3_rad=joint_map.phases[1],
        fourier_a1_rad=a1,
        fourier_b1_rad=b1,
        fourier_a2_rad=a2,
        fourier_b2_rad=b2,
        test_vectors=vectors,
    )


def _limits(values, units):
    return [float(value / unit) if np.isfinite(value) else None for value, unit in zip(values, units, strict=True)]


def _robot_section(outcome):
    arm = outcome.urdf.arm
    return RobotSection(
        name=arm.name,
        urdf=outcome.robot_file.name,
        urdf_sha256=hashlib.sha256(outcome.robot_file.read_bytes()).hexdigest(),
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
    )


def _joint_origins(urdf_arm, corrected):
    nominal, calibrated = (urdf.joint_origins(urdf_arm, arm) for arm in (urdf_arm.arm, corrected))
    return [
        JointOrigin(joint=name, link=link, nominal=Origin.of(nominal[name]), calibrated=Origin.of(calibrated[name]))
        for name, link in zip(urdf_arm.arm.joint_names, urdf_arm.child_links, strict=True)
    ]


def _fingerprint(joint_origins, joint_map, files):
    """Of all that makes a calibration: geometry, joint map and data."""
    content = [
        [[item.joint, item.calibrated.xyz_m, item.calibrated.rpy_rad] for item in joint_origins],
        [getattr(joint_map, name).tolist() for name in ("gain", "stiffness", "phases", "fourier")],
        [item.sha256 for item in files],
    ]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32]


def _errors(robot, points):
    if not len(points):
        return None
    distance = distances(robot, points)
    groups = points.groups[points.pose]
    return Errors(
        all=statistics(distance),
        orientation=rotation_statistics(rotation_distances(robot, points)),
        per_target=statistics_by(distance, points.names()),
        per_group={name: value for name, value in statistics_by(distance, groups).items() if name},
    )


def _point_table(outcome):
    columns = {key: [] for key in PointTable.model_fields}
    sets = ((outcome.fit_points, False), (outcome.heldout_points, True))
    with_u95 = any(points.u95 is not None and np.isfinite(points.u95).any() for points, _ in sets)
    turned = any(points.oriented().any() for points, _ in sets)
    before = 0
    for points, heldout in sets:
        columns["pose"] += [str(value) for value in points.pose_ids[points.pose]]
        columns["group"] += [str(value) for value in points.groups[points.pose]]
        columns["target"] += [str(value) for value in points.names()]
        columns["heldout"] += [heldout] * len(points)
        columns["row"] += (points.pose + before).tolist()
        before += points.poses
        if not len(points):
            continue
        columns["nominal_mm"] += (distances(outcome.nominal.robot, points) / MM).tolist()
        columns["calibrated_mm"] += (distances(outcome.fit.robot, points) / MM).tolist()
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


def _known(values):
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _pose_table(outcome):
    arm = outcome.urdf.arm
    columns = {"pose": [], "group": [], "heldout": []}
    joints, sides = [], []
    for points, heldout in ((outcome.fit_points, False), (outcome.heldout_points, True)):
        seen = outcome.verification if heldout and outcome.verification is not None else outcome.measurements
        columns["pose"] += [str(value) for value in points.pose_ids]
        columns["group"] += [str(value) for value in points.groups]
        columns["heldout"] += [heldout] * points.poses
        joints.append(np.round(points.q / arm.joint_units, JOINT_DIGITS))
        sides.append(_came_from(seen, points))
    came_from = ["".join("-0+"[int(sign) + 1] for sign in column) for column in np.concatenate(sides).T]
    return PoseTable(**columns, joints=np.concatenate(joints).T.tolist(), came_from=came_from)


def _came_from(measurements, points):
    """Sign of the last move of each joint before each pose, 0 where it is not known, shape (n, joints)."""
    first = measurements.table.groupby("pose_index", sort=True).first()
    groups = first["group"].to_numpy(dtype=object) if "group" in first else None
    q = measurements.joints()
    sign = np.sign(np.nan_to_num(last_moves(q, groups)))
    found = {}
    for name, joints, row in zip(first["pose"].astype(str), q, sign, strict=True):
        key = (name, joints.tobytes())
        # of poses with the same name and joints it is not known which one this is
        found[key] = np.where(found.get(key, row) == row, row, 0.0)
    unknown = np.zeros(q.shape[1])
    keys = [(str(name), joints.tobytes()) for name, joints in zip(points.pose_ids, points.q, strict=True)]
    return np.array([found.get(key, unknown) for key in keys]).reshape(points.poses, q.shape[1])


def software():
    """Versions of what a result depends on."""
    packages = {name: version(name) for name in ("irbcal", "numpy", "scipy", "pandas", "pin")}
    return {"python": platform.python_version(), **packages}


def build(outcome, with_world=False, with_targets=False):
    """Content of a calibration folder, checked against Pinocchio.

    Parameters
    ----------
    outcome : Outcome
    with_world, with_targets : bool
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
    robot = outcome.fit.robot
    files = [outcome.measurements] + ([outcome.verification] if outcome.verification else [])
    joint_origins = _joint_origins(outcome.urdf, robot.arm)
    fingerprint = _fingerprint(joint_origins, robot.joint_map, files)
    urdf_bytes = urdf.to_bytes(
        outcome.urdf,
        robot.arm,
        robot.T_world_base if with_world else None,
        robot.targets if with_targets else None,
        fingerprint,
    )
    check = urdf_check.check(urdf_bytes, robot.arm)
    calibration = Record(
        schema_name=SCHEMA,
        created=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        simulated=any(item.simulated for item in files),
        fingerprint=fingerprint,
        calibrated_urdf_sha256=hashlib.sha256(urdf_bytes).hexdigest(),
        robot=_robot_section(outcome),
        joint_origins=joint_origins,
        model=outcome.fit.level,
        method=outcome.fit.method,
        objective=_objective(outcome.fit),
        choice=_choice(outcome.choice),
        rank=outcome.fit.rank,
        parameter_count=outcome.fit.parameter_count,
        parameters=_parameters(outcome.fit),
        covariance=outcome.fit.solution.information.covariance().tolist(),
        held=outcome.fit.held(),
        observability=_observability(outcome.fit),
        history=_history(outcome.fit.history),
        joint_map=_joint_map_section(robot.joint_map, robot.arm),
        placement=_placement(robot),
        placement_nominal=_placement(outcome.nominal.robot),
        tool_shape_mm={name: (place / MM).tolist() for name, place in outcome.tool_shape.items()},
        references_mm={name: (place / MM).tolist() for name, place in outcome.references.items()},
        fit=_errors(robot, outcome.fit_points),
        fit_nominal=_errors(outcome.nominal.robot, outcome.fit_points),
        heldout=_errors(robot, outcome.heldout_points),
        heldout_nominal=_errors(outcome.nominal.robot, outcome.heldout_points),
        heldout_least_squares=_errors(outcome.fit.least_squares.robot, outcome.heldout_points)
        if outcome.fit.least_squares
        else None,
        poses_fit=outcome.fit_points.poses,
        poses_heldout=outcome.heldout_points.poses,
        poses_excluded=outcome.poses_asked - outcome.fit_points.poses - outcome.heldout_points.poses,
        points=_point_table(outcome),
        poses=_pose_table(outcome),
        excluded=[vars(item) for item in outcome.excluded],
        notes=outcome.notes,
        data=[DataFile(file=Path(item.source).name, sha256=item.sha256) for item in files],
        pinocchio_check=check,
        largest_link_shift_mm=urdf.largest_link_shift(outcome.urdf, robot.arm) / MM,
        software=software(),
        seconds=outcome.seconds,
    )
    return calibration, urdf_bytes


def save(outcome, folder, **options):
    """Write a calibration folder: all its files, or none.

    Parameters
    ----------
    outcome : Outcome
    folder : str or Path
        Made if absent; other files in it are left alone.
    **options
        See `build`.

    Returns
    -------
    Record

    Raises
    ------
    CalibrationError
        If the folder cannot be written or Pinocchio disagrees with the URDF.
    """
    from irbcal.reports import report_page

    check_writable(folder, NAMES)
    calibration, urdf_bytes = build(outcome, **options)
    write_together(
        folder,
        {
            URDF_NAME: urdf_bytes,
            ORIGINS_NAME: origins.to_yaml(calibration).encode("utf-8"),
            REPORT_NAME: report_page.render(calibration).encode("utf-8"),
            JSON_NAME: (calibration.model_dump_json(indent=1) + "\n").encode("utf-8"),
        },
    )
    return calibration


def load(folder):
    """Read a calibration folder.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    Record

    Raises
    ------
    CalibrationError
        If a file is missing, damaged, or the URDF is not the one the calibration was written with.
    """
    folder = Path(folder)
    json_path, urdf_path = folder / JSON_NAME, folder / URDF_NAME
    try:
        calibration = Record.model_validate_json(json_path.read_bytes())
        urdf_bytes = urdf_path.read_bytes()
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise CalibrationError(f"{json_path}: {where}: {first['msg']}") from None
    except OSError as error:
        path = error.filename or folder
        raise CalibrationError(f"{path}: not a calibration folder: {error.strerror}") from None
    if hashlib.sha256(urdf_bytes).hexdigest() != calibration.calibrated_urdf_sha256:
        raise CalibrationError(f"{urdf_path}: this is not the URDF that {JSON_NAME} was written with")
    return calibration


def opened(calibration: CalibrationLike) -> Record:
    """A calibration by whatever names it: folder, record, or a result that holds one.

    Parameters
    ----------
    calibration : str, Path, Record or a result with an attribute ``record``

    Returns
    -------
    Record

    Raises
    ------
    CalibrationError
        As `load`.
    """
    if isinstance(calibration, Record):
        return calibration
    return load(calibration) if isinstance(calibration, (str, Path)) else calibration.record


def calibrated_urdf(folder):
    """The corrected URDF of a calibration folder, bytes; errors as `load`."""
    load(folder)
    return (Path(folder) / URDF_NAME).read_bytes()


def nominal_urdf(folder):
    """The URDF of a calibration folder with the joint origins from before the calibration, bytes; errors as `load`."""
    nominal = {item.joint: item.nominal.transform() for item in load(folder).joint_origins}
    return urdf.with_joint_origins((Path(folder) / URDF_NAME).read_bytes(), nominal)
