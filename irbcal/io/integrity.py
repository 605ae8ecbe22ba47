"""Whether a calibration is whole: its seal, its parts against each other, and numbers that no robot has.

A robot moves by these numbers. A folder without a seal, or of which something was edited or damaged after it was
written, is refused with the names of what differs; a deliberate change is accepted by `resealed`, which adds a line to
the history. The seal has the hashes of the parts of ``calibration.json`` and of all files beside it; the hash of a
part is SHA-256 of its canonical JSON: keys sorted, no spaces, numbers as Python writes them. The *fingerprint* is that
of the parts by which a robot moves (`MOVING`); it stands in programs, exports and certificates.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import to_jsonable_python

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError, IrbcalError
from irbcal.io import joint_origins, urdf
from irbcal.io.schema import Record
from irbcal.modeling.arm import relative_difference
from irbcal.modeling.terms.situation import Motion

KEY = "seal"
MOVING = ("simulated", "robot", "joint_origins", "joint_map", "frame_terms", "placement", "data")
"""Parts of which the fingerprint is one."""


def digest(value: Any) -> str:
    """SHA-256 of a part's canonical JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def fingerprint(content: Mapping[str, Any]) -> str:
    """The fingerprint of a calibration.

    Parameters
    ----------
    content : dict
        Those of `MOVING`, as sections or as JSON has them; others are left out.

    Returns
    -------
    str
        32 digits, hexadecimal.
    """
    return digest(to_jsonable_python({name: content[name] for name in MOVING}))[:32]


def hashes(files: Mapping[str, bytes]) -> dict[str, str]:
    """SHA-256 of files, by their names."""
    return {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}


def sealed(document: Mapping[str, Any], files: Mapping[str, str] | None = None) -> dict[str, Any]:
    """A document with a seal that fits it; lines of its history stay.

    Parameters
    ----------
    document : dict
        As JSON has it.
    files : dict of str to str, optional
        SHA-256 of the files beside it; those of its seal unless given.

    Returns
    -------
    dict
        The seal is its last part.
    """
    content = {name: value for name, value in document.items() if name != KEY}
    seal_before = document.get(KEY) or {}
    return content | {
        KEY: {
            "parts": {name: digest(value) for name, value in content.items()},
            "files": dict(seal_before.get("files", {}) if files is None else files),
            "changes": list(seal_before.get("changes", [])),
        }
    }


def resealed(document: Mapping[str, Any], files: Mapping[str, str], reason: str) -> dict[str, Any]:
    """A document whose changes are accepted, with a line in its history that says when, what and why.

    Parameters
    ----------
    document : dict
    files : dict of str to str
        SHA-256 of the files beside it, as they are now.
    reason : str
        One line.

    Raises
    ------
    CalibrationError
        If nothing has changed since it was sealed.
    """
    seal_before = dict(document.get(KEY) or {})
    listed: Mapping[str, str] = seal_before.get("files", {})
    differ = broken(document) + [name for name in sorted({*listed, *files}) if listed.get(name) != files.get(name)]
    if not differ:
        raise CalibrationError("nothing was changed since it was sealed: there is nothing to accept")
    differing = ", ".join(differ) if seal_before else "not sealed before"
    entry = f"{datetime.now(timezone.utc).isoformat(timespec='seconds')}: {differing}: {reason}"
    return sealed({**document, KEY: seal_before | {"changes": [*seal_before.get("changes", []), entry]}}, files)


def broken(document: Mapping[str, Any]) -> list[str]:
    """Names of the parts that are not as they were sealed: of all parts, and the seal itself, where there is none.

    Parameters
    ----------
    document : dict
        As JSON has it.
    """
    seal = document.get(KEY)
    if seal is None:
        return [KEY, *(name for name in document if name != KEY)]
    sealed_parts: Mapping[str, str] = seal["parts"]
    names = [name for name in (*document, *sealed_parts) if name != KEY]
    return [
        name
        for name in dict.fromkeys(names)
        if name not in document or name not in sealed_parts or digest(document[name]) != sealed_parts[name]
    ]


LARGEST_SITE = 1000.0
"""Metres: points are not measured farther away."""
TURN_DEG, TURN_RAD = 1e4, 175.0
"""Angles beyond are no joints or tilts."""
LARGEST_NUMBER = 1e18
"""Any other number beyond cannot be computed with."""

OF_THE_ARM = ("robot", "joint_origins", "targets", "tool_shape_mm")
"""Parts of the file that hold lengths of arm and tool."""
LARGEST_GAIN = 10.0
"""Joint errors in proportion to the joint are far below it."""
MATRICES = ("base_to_frame0", "last_frame_to_tip")
UNBOUNDED = ("indices",)
"""Parts that may be as large as they like."""


def refuse_absurd(document: dict[str, Any], file: Path) -> None:
    """Refuse a calibration with a number that no robot has.

    Parameters
    ----------
    document : dict
        Content of ``calibration.json``.
    file : Path
        For the message.

    Raises
    ------
    CalibrationError
        For the first such number; the sentence says where it stands.
    """
    _refuse_beyond(document, (), LARGEST_NUMBER, LARGEST_SITE, file)


def _refuse_beyond(value: Any, path: tuple[str, ...], largest: float, metres: float, file: Path) -> None:
    """Refuse numbers beyond ``largest`` in a value, lengths in parts of it beyond ``metres``."""
    if isinstance(value, float):
        if abs(value) > largest:
            where = ".".join(path)
            raise CalibrationError(
                f"{where}: expected a number within ±{largest:g}, found {value:g}", file=file, parameter=where
            )
    elif isinstance(value, dict):
        for name, entry in value.items():
            if name in UNBOUNDED or isinstance(entry, (str, int)):
                continue
            longest = urdf.LARGEST_ARM if name in OF_THE_ARM else metres
            _refuse_beyond(entry, (*path, str(name)), _bound(str(name), longest, largest), longest, file)
    elif isinstance(value, (list, tuple)):
        kinds = set(map(type, value))
        if kinds <= {float, type(None)}:  # long columns
            numbers = np.array([item for item in value if item is not None], dtype=float)
            if (np.abs(numbers) <= largest).all():
                return
        elif not kinds & {float, list, tuple, dict}:
            return
        for k, entry in enumerate(value):
            _refuse_beyond(entry, (*path, str(k)), largest, metres, file)


@cache
def _bound(name: str, metres: float, inherited: float) -> float:
    """Largest number under a name: by the unit in it."""
    if name in MATRICES:
        return urdf.LARGEST_ARM
    for ending, largest in (("_mm", metres * 1000), ("_m", metres), ("_deg", TURN_DEG), ("_rad", TURN_RAD)):
        if name.endswith(ending):
            return largest
    return {"targets": metres * 1000, "gain": LARGEST_GAIN}.get(name, inherited)


RIGID = 1e-6
"""How far a frame may be from a rotation: numbers are written with all their digits."""
SAME_GEOMETRY = 1e-6
"""Metres and radians that the geometry of URDF and record may differ by at random joints."""
SAME_VECTORS = 1e-9
"""Radians (metres) that test vectors may be missed by."""
TEST_POSES = 20


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
    faults = list(_wrong_lengths(record))
    if faults:  # nothing can be computed with it
        return faults
    faults += _wrong_frames(record)
    faults += _wrong_joint_map(record)
    faults += _unusable_parts(record) if not faults else []
    faults += _wrong_frame_terms(record) if not faults else []
    if not faults and urdf_bytes is not None:
        faults += _other_geometry(record, urdf_bytes)
    if not faults and origins is not None:
        faults += _other_origins(record, origins)
    # by the record's serializer: its parts have none of their own until they are asked for
    if fingerprint(record.model_dump(mode="json", include=set(MOVING))) != record.fingerprint:
        faults.append("the fingerprint is not that of what it stands for: calibrate again, or write the file as it was")
    return faults


def _wrong_lengths(record: Record) -> Iterator[str]:
    robot, joints = record.robot, len(record.robot.joint_names)
    lists: dict[str, Sequence[object]] = {
        "robot.joint_types": robot.joint_types,
        "robot.lower": robot.lower,
        "robot.upper": robot.upper,
        "robot.dhm_nominal": robot.dhm_nominal,
        "robot.dhm_calibrated": robot.dhm_calibrated,
        "joint_origins": record.joint_origins,
    }
    for name, values in lists.items():
        if len(values) != joints:
            yield f"{name} has {len(values)} entries for {joints} joints"
    for name, low, high in zip(robot.joint_names, robot.lower, robot.upper, strict=False):
        if low is not None and high is not None and not low <= high:
            yield f"robot.lower of {name} is above robot.upper"


def _wrong_frames(record: Record) -> Iterator[str]:
    for name in ("base_to_frame0", "last_frame_to_tip"):
        T: FloatArray = np.array(getattr(record.robot, name), dtype=float)
        off = max(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max(), np.abs(T[3] - [0, 0, 0, 1]).max())
        if off > RIGID or np.linalg.det(T[:3, :3]) < 0:
            yield f"robot.{name} is no rigid frame"
    for name, pose in (("placement", record.placement.base), ("placement_nominal", record.placement_nominal.base)):
        if abs(pose.quaternion_norm - 1.0) > RIGID:
            yield f"{name}.base has no unit quaternion"
    for name, quaternion in record.placement.target_quaternions.items():
        if abs(float(np.linalg.norm(quaternion)) - 1.0) > RIGID:
            yield f"placement.target_quaternions.{name} is no unit quaternion"


def _wrong_joint_map(record: Record) -> Iterator[str]:
    section = record.joint_map
    try:
        q, q_before = (np.array([getattr(v, k) for v in section.test_vectors]) for k in ("q", "previous_q"))
        names = section.test_vectors[0].inputs if section.test_vectors else ()
        known = {name: np.array([vector.inputs[name] for vector in section.test_vectors]) for name in names}
        motion = Motion(q, q - q_before, inputs=known) if len(q) else None
        theta = q if motion is None else record.errors_of_joints().terms.effective(motion)
        effective = np.array([vector.effective for vector in section.test_vectors], dtype=float)
        miss = float(np.abs(theta - effective).max()) if len(q) else 0.0
    except (IrbcalError, ValueError, IndexError, KeyError, TypeError, ArithmeticError) as error:
        yield f"joint_map cannot be used: {error}"
        return
    if not miss <= SAME_VECTORS:
        yield f"joint_map misses its own test vectors by {miss:.3g} rad"


def _unusable_parts(record: Record) -> Iterator[str]:
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


def _wrong_frame_terms(record: Record) -> Iterator[str]:
    if record.frame_terms is None:
        return
    robot = record.robot_calibrated()
    for vector in record.frame_terms.test_vectors:
        try:
            q, q_before, T = (np.array(value, float) for value in (vector.q, vector.previous_q, vector.T_base_tip))
            miss = float(np.abs(robot.forward(q[None], q_before[None])[0] - T).max())
        except (IrbcalError, ValueError, IndexError) as error:
            yield f"frame_terms cannot be used: {error}"
            return
        if not miss <= SAME_VECTORS:
            yield f"frame_terms miss their own test vectors by {miss:.3g}"
            return


def _other_geometry(record: Record, data: bytes) -> Iterator[str]:
    robot = record.robot
    try:
        read_arm = urdf.from_bytes(data, "calibrated.urdf", robot.base_link, robot.tip_link).arm
    except IrbcalError as error:
        yield str(error)
        return
    if hashlib.sha256(data).hexdigest() != record.calibrated_urdf_sha256:
        yield "calibrated.urdf is not the file that calibration.json was written with"
    arm = record.arm()
    if list(read_arm.joint_names) != robot.joint_names:
        yield f"calibrated.urdf has the joints {', '.join(read_arm.joint_names)}"
        return
    q = arm.spread_joints(TEST_POSES)
    position, rotation = relative_difference(read_arm.forward(q), arm.forward(q))
    if max(position, rotation) > SAME_GEOMETRY:
        yield (
            f"robot.dhm_calibrated is not the geometry of calibrated.urdf: tips differ by up to "
            f"{1e3 * position:.4g} mm and {rotation:.3g} rad"
        )


def _other_origins(record: Record, data: bytes) -> Iterator[str]:
    if data == joint_origins.to_yaml(record).encode("utf-8"):
        return  # written sooner than read
    links = {origin.link: origin.joint for origin in record.joint_origins}
    try:
        read = joint_origins.by_joint(joint_origins.read(data, "joint_origins.yaml"), links, "joint_origins.yaml")
    except IrbcalError as error:
        yield str(error)
        return
    for item in record.joint_origins:
        if np.abs(read[item.joint] - item.calibrated.transform()).max() > SAME_VECTORS:
            yield f"joint_origins.yaml has another origin of {item.joint}"
