"""Joint origins of a calibration for others, as YAML."""

from __future__ import annotations

from typing import Any

from irbcal.files.schema import Record


def to_yaml(calibration: Record) -> str:
    """Calibrated joint origins in the layout of ``ur_description``'s kinematics files.

    Keys are the joints' child links without their ending ``_link`` (their whole names after ``link`` where that would
    not be unique); x, y, z in metres, roll, pitch, yaw in radians.

    Parameters
    ----------
    calibration : Record

    Returns
    -------
    str
    """
    import yaml

    short = [item.link.removesuffix("_link") for item in calibration.joint_origins]
    unique = len({*short, "", "hash"}) == len(short) + 2
    kinematics: dict[str, Any] = {}
    for item, key in zip(calibration.joint_origins, short, strict=True):
        values = (*item.calibrated.xyz_m, *item.calibrated.rpy_rad)
        entry = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True))
        kinematics[key if unique else f"link {item.link}"] = entry | {"joint": item.joint}
    kinematics["hash"] = f"irbcal_{calibration.fingerprint}"
    head = [
        f"# Joint origins of {_printable(calibration.robot.name)}, calibrated by irbcal: metres and radians.",
        "# From SIMULATED measurements." if calibration.simulated else None,
        "# The joint map (stiffness, Fourier series, gains) is not in here: see calibration.json.",
        None if calibration.frame_terms is None else f"# {calibration.frame_terms.in_words}",
    ]
    body = yaml.safe_dump({"kinematics": kinematics}, sort_keys=False, allow_unicode=True)
    return "\n".join([line for line in head if line] + [body])


def _printable(text: str) -> str:
    return " ".join("".join(char if char.isprintable() else " " for char in text).split())
