"""Whether the parts of a calibration say the same thing: lengths, rigid frames, test vectors, geometry, fingerprint."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IrbcalError
from irbcal.files import joint_origins, urdf
from irbcal.files.joint_map_section import JointMapSection
from irbcal.files.schema import Pose, Record
from irbcal.files.seal import fingerprint
from irbcal.modeling.arm import relative_difference
from irbcal.modeling.terms.situation import Motion

RIGID = 1e-6
"""How far a frame may be from a rotation: numbers are written with all their digits."""
SAME = 1e-6
"""Metres and radians that the geometry of URDF and record may differ by at random joints."""
VECTORS = 1e-9
"""Radians (metres) that test vectors may be missed by."""
POSES = 20


def contradictions(record: Record, urdf_bytes: bytes | None = None, origins: bytes | None = None) -> list[str]:
    """What contradicts itself in a calibration.

    Parameters
    ----------
    record : Record
    urdf_bytes : bytes, optional
        Its ``calibrated.urdf``.
    origins : bytes, optional
        Its ``joint_origins.yaml``.

    Returns
    -------
    list of str
        A part of a sentence each; empty where nothing does.
    """
    found = list(_lengths(record))
    if found:  # nothing can be computed with it
        return found
    found += _frames(record)
    found += _joint_map(record)
    found += _use(record) if not found else []
    found += _frame_terms(record) if not found else []
    if not found and urdf_bytes is not None:
        found += _geometry(record, urdf_bytes)
    if not found and origins is not None:
        found += _origins(record, origins)
    if fingerprint(dict(record)) != record.fingerprint:
        found.append("the fingerprint is not that of what it stands for: calibrate again, or write the file as it was")
    return found


def _lengths(record: Record) -> Iterator[str]:
    robot, joints = record.robot, len(record.robot.joint_names)
    lists: dict[str, Sequence[object]] = {
        "robot.joint_types": robot.joint_types,
        "robot.lower": robot.lower,
        "robot.upper": robot.upper,
        "robot.dhm_nominal": robot.dhm_nominal,
        "robot.dhm_calibrated": robot.dhm_calibrated,
        "joint_origins": record.joint_origins,
    }
    if isinstance(record.joint_map, JointMapSection):
        lists["joint_map.gain"] = record.joint_map.gain
    for name, values in lists.items():
        if len(values) != joints:
            yield f"{name} has {len(values)} entries for {joints} joints"
    for name, low, high in zip(robot.joint_names, robot.lower, robot.upper, strict=False):
        if low is not None and high is not None and not low <= high:
            yield f"robot.lower of {name} is above robot.upper"


def _matrices(record: Record) -> list[tuple[str, list[list[float]]]]:
    return [
        ("robot.base_to_frame0", record.robot.base_to_frame0),
        ("robot.last_frame_to_tip", record.robot.last_frame_to_tip),
    ]


def _frames(record: Record) -> Iterator[str]:
    for name, rows in _matrices(record):
        T: FloatArray = np.array(rows, dtype=float)
        off = max(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max(), np.abs(T[3] - [0, 0, 0, 1]).max())
        if off > RIGID or np.linalg.det(T[:3, :3]) < 0:
            yield f"{name} is no rigid frame"
    for name, pose in (("placement", record.placement.base), ("placement_nominal", record.placement_nominal.base)):
        if abs(_norm(pose) - 1.0) > RIGID:
            yield f"{name}.base has no unit quaternion"
    for name, quaternion in record.placement.target_quaternions.items():
        if abs(float(np.linalg.norm(quaternion)) - 1.0) > RIGID:
            yield f"placement.target_quaternions.{name} is no unit quaternion"


def _norm(pose: Pose) -> float:
    return float(np.linalg.norm([pose.qw, pose.qx, pose.qy, pose.qz]))


def _joint_map(record: Record) -> Iterator[str]:
    section, nominal = record.joint_map, record.arm(calibrated=False)
    try:
        if isinstance(section, JointMapSection):
            q = np.array([vector.commanded for vector in section.test_vectors], dtype=float)
            found = section.joint_map(nominal).effective(q) if len(q) else q
        else:
            q, before = (np.array([getattr(v, k) for v in section.test_vectors]) for k in ("q", "previous_q"))
            loads = np.array([vector.payload_kg for vector in section.test_vectors])
            felt = [vector.torques_nm for vector in section.test_vectors if vector.torques_nm is not None]
            motion = (
                Motion(q, q - before, payload_kg=loads, torques=np.array(felt) if felt else None) if len(q) else None
            )
            found = q if motion is None else section.joint_map(nominal).terms.effective(motion)
        effective = np.array([vector.effective for vector in section.test_vectors], dtype=float)
        miss = float(np.abs(found - effective).max()) if len(q) else 0.0
    except (IrbcalError, ValueError, IndexError, KeyError, TypeError, ArithmeticError) as error:
        yield f"joint_map cannot be used: {error}"
        return
    if not miss <= VECTORS:
        yield f"joint_map misses its own test vectors by {miss:.3g} rad"


def _use(record: Record) -> Iterator[str]:
    """Whether all that is computed from a calibration can be."""
    joints = np.zeros((1, len(record.robot.joint_names)))
    try:
        with np.errstate(all="raise", under="ignore"):
            for robot in (record.robot_calibrated(), record.robot_nominal()):
                for target in robot.targets:
                    robot.points(joints, target)
            for heldout in (False, True):
                record.used_points(heldout)
            record.covariance_matrix()
    except (IrbcalError, ValueError, IndexError, KeyError, TypeError, ArithmeticError) as error:
        yield f"its parts do not fit together: {' '.join(str(error).split())}"


def _frame_terms(record: Record) -> Iterator[str]:
    if record.frame_terms is None:
        return
    robot = record.robot_calibrated()
    for vector in record.frame_terms.test_vectors:
        try:
            q, before, told = (np.array(value, float) for value in (vector.q, vector.previous_q, vector.T_base_tip))
            miss = float(np.abs(robot.forward(q[None], before[None])[0] - told).max())
        except (IrbcalError, ValueError, IndexError) as error:
            yield f"frame_terms cannot be used: {error}"
            return
        if not miss <= VECTORS:
            yield f"frame_terms miss their own test vectors by {miss:.3g}"
            return


def _geometry(record: Record, data: bytes) -> Iterator[str]:
    robot = record.robot
    try:
        found = urdf.from_bytes(data, "calibrated.urdf", robot.base_link, robot.tip_link).arm
    except IrbcalError as error:
        yield str(error)
        return
    if hashlib.sha256(data).hexdigest() != record.calibrated_urdf_sha256:
        yield "calibrated.urdf is not the file that calibration.json was written with"
    arm = record.arm()
    if list(found.joint_names) != robot.joint_names:
        yield f"calibrated.urdf has the joints {', '.join(found.joint_names)}"
        return
    q = arm.random_joints(POSES, 0)
    position, rotation = relative_difference(found.forward(q), arm.forward(q))
    if max(position, rotation) > SAME:
        yield (
            f"robot.dhm_calibrated is not the geometry of calibrated.urdf: tips differ by up to "
            f"{1e3 * position:.4g} mm and {rotation:.3g} rad"
        )


def _origins(record: Record, data: bytes) -> Iterator[str]:
    links = {item.link: item.joint for item in record.joint_origins}
    try:
        found = joint_origins.by_joint(joint_origins.read(data, "joint_origins.yaml"), links, "joint_origins.yaml")
    except IrbcalError as error:
        yield str(error)
        return
    for item in record.joint_origins:
        if np.abs(found[item.joint] - item.calibrated.transform()).max() > VECTORS:
            yield f"joint_origins.yaml has another origin of {item.joint}"
