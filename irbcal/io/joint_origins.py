"""Joint origins of a calibration for others, as YAML, and those that others write."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

import numpy as np

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.io.schema import Record
from irbcal.modeling import frames
from irbcal.option_values import excerpt

NUMBERS = ("x", "y", "z", "roll", "pitch", "yaw")
LARGEST = 50.0
"""Metres or radians; no joint is farther from the one before."""
WORDS = frozenset(("y", "yes", "n", "no", "true", "false", "on", "off", "null"))
"""Words that YAML 1.1 does not take as text."""


def to_yaml(calibration: Record) -> str:
    """Calibrated joint origins in the layout of ``ur_description``'s kinematics files.

    Keys are the joints' child links without their ending ``_link`` (their whole names after ``link`` where that would
    not be unique); x, y, z in metres, roll, pitch, yaw in radians. It is written without PyYAML: loading that takes a
    tenth of the time of ``irbcal verify``.
    """
    short = [origin.link.removesuffix("_link") for origin in calibration.joint_origins]
    unique = len({*short, "", "hash"}) == len(short) + 2
    body = ["kinematics:"]
    for joint_origin, key in zip(calibration.joint_origins, short, strict=True):
        values = (*joint_origin.calibrated.xyz_m, *joint_origin.calibrated.rpy_rad)
        body.append(f"  {_text(key if unique else f'link {joint_origin.link}')}:")
        body += [f"    {name}: {_number(value)}" for name, value in zip(NUMBERS, values, strict=True)]
        body.append(f"    joint: {_text(joint_origin.joint)}")
    body.append(f"  hash: irbcal_{calibration.fingerprint}")
    head = [
        f"# Joint origins of {literals.one_line(calibration.robot.name)}, calibrated by irbcal: metres and radians.",
        "# From SIMULATED measurements." if calibration.simulated else None,
        "# The joint map (stiffness, Fourier series, gains) is not in here: see calibration.json.",
        None if calibration.frame_terms is None else f"# {calibration.frame_terms.in_words}",
    ]
    return "\n".join([*filter(None, head), *body, ""])


def _number(value: float) -> str:
    """A number as YAML 1.1 takes it: with a point before the exponent."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "." not in text else text


def _text(name: str) -> str:
    """A name, in quotation marks where YAML could take it for something else."""
    plain = re.fullmatch(r"[A-Za-z_][\w-]*( [\w-]+)*", name, re.ASCII) and name.lower() not in WORDS
    return name if plain else json.dumps(name, ensure_ascii=False)


def read(data: bytes, source: str) -> dict[str, FloatArray]:
    """Read joint origins in that layout: of ``ur_description``, ``ur_calibration`` or irbcal.

    Parameters
    ----------
    data : bytes
    source : str
        File name for messages.

    Returns
    -------
    dict of str to ndarray, shape (4, 4)
        By the keys of the file; by the joint's name, with ``joint `` before it, where the file says it.

    Raises
    ------
    RobotError
        If this is no such file.
    """
    import yaml

    expected = "expected joint origins such as 'kinematics: shoulder: {x: 0, y: 0, z: 0.16, roll: 0, pitch: 0, yaw: 0}'"
    try:
        content = yaml.safe_load(data.decode("utf-8"))
    except (ValueError, RecursionError, yaml.YAMLError):
        raise RobotError(f"{expected}, or a URDF, found neither", file=source) from None
    entries = content.get("kinematics") if isinstance(content, dict) else None
    if not isinstance(entries, dict):
        raise RobotError(f"{expected}, or a URDF, found {excerpt(content)}", file=source)
    origins = {}
    for key, entry in entries.items():
        if key == "hash":
            continue
        values = [entry.get(name) for name in NUMBERS] if isinstance(entry, dict) else []
        if not values or not all(
            isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < LARGEST for value in values
        ):
            raise RobotError(f"{expected}, found {excerpt(entry)} for {excerpt(key)}", file=source)
        T = frames.transform(
            frames.matrix_from_rpy(np.array(values[3:], dtype=float)), np.array(values[:3], dtype=float)
        )
        origins[f"joint {entry['joint']}" if "joint" in entry else str(key)] = T
    return origins


def by_joint(origins: Mapping[str, FloatArray], links: Mapping[str, str], source: str) -> dict[str, FloatArray]:
    """Joint origins by the names of the joints.

    Parameters
    ----------
    origins : dict of str to ndarray, shape (4, 4)
        As read.
    links : dict of str to str
        Joint by its child link, of all joints of the arm.
    source : str
        File name for messages.

    Raises
    ------
    RobotError
        If a joint is missing, or one entry could be of several.
    """
    out = {}
    for link, joint in links.items():
        short = link.removesuffix("_link")
        keys = [key for key in origins if key in (f"joint {joint}", short, f"link {link}")]
        keys = keys or [key for key in origins if short.endswith(f"_{key}")]  # a prefix before all links
        if len(keys) != 1:
            count = "several" if keys else "none"
            listed = ", ".join(key.removeprefix("joint ") for key in origins)
            raise RobotError(
                f"expected one origin of joint {joint} (link {link}), found {count} in {listed}", file=source
            )
        out[joint] = origins[keys[0]]
    return out
