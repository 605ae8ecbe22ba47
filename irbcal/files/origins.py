"""Joint origins of a calibration for others: as YAML, and compared with a URDF found somewhere."""

import hashlib
from dataclasses import dataclass

from irbcal.errors import RobotError
from irbcal.files import urdf
from irbcal.modeling.arm import relative_difference
from irbcal.units import DEG, MM

SAME, ROUNDED = 1e-9, 5e-6
"""Metres and radians that the tip's poses of two URDFs of the same geometry may differ by: as they are, and where
numbers were rounded on the way."""
POSES = 1000


def to_yaml(calibration):
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
    kinematics = {}
    for item, key in zip(calibration.joint_origins, short, strict=True):
        values = (*item.calibrated.xyz_m, *item.calibrated.rpy_rad)
        entry = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True))
        kinematics[key if unique else f"link {item.link}"] = entry | {"joint": item.joint}
    kinematics["hash"] = f"irbcal_{calibration.fingerprint}"
    head = [
        f"# Joint origins of {_printable(calibration.robot.name)}, calibrated by irbcal: metres and radians.",
        "# From SIMULATED measurements." if calibration.simulated else None,
        "# The joint map (stiffness, Fourier series, gains) is not in here: see calibration.json.",
    ]
    body = yaml.safe_dump({"kinematics": kinematics}, sort_keys=False, allow_unicode=True)
    return "\n".join([line for line in head if line] + [body])


def _printable(text):
    return " ".join("".join(char if char.isprintable() else " " for char in text).split())


@dataclass(frozen=True)
class Verification:
    """Whether a URDF is the one of a calibration.

    Attributes
    ----------
    is_calibration : bool
        Whether its geometry is the calibrated one and no other calibration's fingerprint stands in it.
    geometry : str
        ``calibrated``, ``rounded`` (the same to 5 micrometres and microradians), ``nominal`` or ``other``.
    fingerprint : str
        ``same``, ``other`` or ``absent``.
    same_file : bool
        Whether it is the calibration's own file, byte for byte.
    position_m, rotation_rad : float
        Largest differences of the tip's poses from the calibrated geometry at random joints.
    nominal_position_m : float
        The same from the nominal geometry.
    explanation : str
        One sentence.
    """

    is_calibration: bool
    geometry: str
    fingerprint: str
    same_file: bool
    position_m: float
    rotation_rad: float
    nominal_position_m: float
    explanation: str


def verify(calibration, data, source, base=None, tip=None):
    """Compare a URDF with a calibration: forward kinematics at random joints, and the fingerprint.

    Parameters
    ----------
    calibration : Record
    data : bytes
        The URDF.
    source : str
        File name for messages.
    base, tip : str, optional
        Base and tip link in it, where a cell's URDF has given them other names; joints may have a prefix then.

    Returns
    -------
    Verification

    Raises
    ------
    RobotError
        If it is not a URDF with the calibration's joints between its base and tip link.
    """
    arms = {"calibrated": calibration.arm(), "nominal": calibration.arm(calibrated=False)}
    own = arms["calibrated"]
    found = urdf.from_bytes(data, source, base or own.base_link, tip or own.tip_link).arm
    same_joints = len(found.joint_names) == len(own.joint_names) and all(
        name == mine or ((base or tip) and name.endswith(mine))
        for name, mine in zip(found.joint_names, own.joint_names, strict=True)
    )
    if not same_joints or (found.table.prismatic != own.table.prismatic).any():
        raise RobotError(
            f"{source}: expected the joints {', '.join(own.joint_names)} between {found.base_link} and "
            f"{found.tip_link}, found {', '.join(found.joint_names)}"
        )
    q = own.random_joints(POSES, 0)
    T = found.forward(q)
    differences = {name: relative_difference(T, arm.forward(q)) for name, arm in arms.items()}
    geometry = next((name for name, difference in differences.items() if max(difference) <= SAME), "other")
    if geometry == "other" and max(differences["calibrated"]) <= ROUNDED:
        geometry = "rounded"
    same_file = hashlib.sha256(data).hexdigest() == calibration.calibrated_urdf_sha256
    mark = urdf.fingerprint(data, source)
    fingerprint = "absent" if mark is None else "same" if mark == calibration.fingerprint else "other"
    position, rotation = differences["calibrated"]
    return Verification(
        geometry in ("calibrated", "rounded") and fingerprint != "other",
        geometry,
        fingerprint,
        same_file,
        float(position),
        float(rotation),
        float(differences["nominal"][0]),
        _explanation(geometry, fingerprint, same_file, position, rotation),
    )


def _explanation(geometry, fingerprint, same_file, position, rotation):
    if geometry == "rounded" and fingerprint != "other":
        return (
            f"this URDF is this calibration with rounded numbers: the tip is up to {position / MM:.2g} mm and "
            f"{rotation / DEG:.2g} degrees elsewhere"
        )
    if geometry == "calibrated":
        return {
            "same": "this URDF is this calibration"
            + ("" if same_file else ": same geometry and fingerprint, other parts of the file differ"),
            "absent": "this URDF has the geometry of this calibration; the fingerprint was taken out of it",
            "other": "this URDF has the geometry of this calibration, but the fingerprint of another one: "
            "the joint map or the data are not the same",
        }[fingerprint]
    if geometry == "nominal":
        return "this URDF has the nominal geometry: it is not calibrated"
    marked = {
        "same": ", although it bears its fingerprint: it was changed afterwards",
        "absent": "",
        "other": "; it bears the fingerprint of another calibration",
    }[fingerprint]
    return (
        f"this URDF is not this calibration: the tip is up to {position / MM:.4g} mm and {rotation / DEG:.4g} degrees "
        f"elsewhere{marked}"
    )
