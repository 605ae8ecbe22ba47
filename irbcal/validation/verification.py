"""Whether a URDF or a program found somewhere is the one of a calibration."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from irbcal.errors import OptionError, RobotError
from irbcal.io import calibration_folder
from irbcal.io import urdf as urdf_file
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.modeling.arm import relative_difference
from irbcal.safe_files import read_bytes
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM
from irbcal.wording import first_of, joined

SAME, ROUNDED = 1e-9, 5e-6
"""Metres and radians that the tip's poses of two URDFs of the same geometry may differ by: as they are, and where
numbers were rounded on the way."""
CHECKED_POSES = 1000


class Answer(Result):
    """Yes or no, its first field, and why, its last; true where it is yes."""

    explanation: str

    def __bool__(self) -> bool:
        return bool(next(iter(vars(self).values())))

    def report(self) -> Sequence[Paragraph]:
        """One sentence."""
        return [self.explanation]


@dataclass(frozen=True, repr=False)
class Verification(Answer):
    """Whether a URDF is the one of a calibration; true where it is.

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
    geometry: Literal["calibrated", "rounded", "nominal", "other"]
    fingerprint: Literal["same", "other", "absent"]
    same_file: bool
    position_m: float
    rotation_rad: float
    nominal_position_m: float
    explanation: str


@dataclass(frozen=True, repr=False)
class ProgramVerification(Answer):
    """Whether a program bears the mark of a calibration; true where it does.

    Attributes
    ----------
    is_calibration : bool
    fingerprint : str
        ``same``, ``other`` or ``absent``.
    explanation : str
        One sentence.
    """

    is_calibration: bool
    fingerprint: Literal["same", "other", "absent"]
    explanation: str


@dataclass(frozen=True, repr=False)
class FolderVerification(Answer):
    """Whether a calibration folder is as it was sealed; true where it is, and where the asked signature is good.

    Attributes
    ----------
    is_calibration : bool
    fingerprint : str
        Of the calibration.
    differences : tuple of str
        What was changed, is missing, or contradicts itself.
    files : tuple of str
        The files that are as they were sealed.
    unlisted : tuple of str
        Files in the folder that its seal does not list: nothing is known of them.
    changes : tuple of str
        Deliberate changes since it was written: when, what and why.
    signature : str
        ``absent``, ``unchecked`` (no key was given), ``stale`` (the same, and something was changed since), ``good``
        or ``bad``.
    explanation : str
        One sentence.
    """

    is_calibration: bool
    fingerprint: str
    differences: tuple[str, ...]
    files: tuple[str, ...]
    unlisted: tuple[str, ...]
    changes: tuple[str, ...]
    signature: Literal["absent", "unchecked", "stale", "good", "bad"]
    explanation: str

    def report(self) -> Sequence[Paragraph]:
        """One sentence, what was not checked, and the deliberate changes."""
        unlisted = f"Not checked, for the seal does not list it: {', '.join(self.unlisted)}"
        of_signature = {
            "unchecked": "There is a signature: --public-key says whether it is of that key",
            "stale": "The signature is not of what stands here now: sign it again",
        }.get(self.signature)
        return [
            self.explanation,
            *([unlisted] if self.unlisted else []),
            *([of_signature] if of_signature else []),
            *(f"Accepted change: {change}" for change in self.changes),
        ]


@dataclass(frozen=True, repr=False)
class FileVerification(Answer):
    """Whether a file, such as a certificate, is as it was signed; true where it is.

    Attributes
    ----------
    is_signed : bool
    explanation : str
        One sentence.
    """

    is_signed: bool
    explanation: str


def verify(
    calibration: CalibrationLike,
    urdf: str | Path | None = None,
    *,
    program: str | Path | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    reseal: str | None = None,
    public_key: str | Path | None = None,
) -> Verification | ProgramVerification | FolderVerification | FileVerification:
    """Tell whether a URDF, or a corrected program, found somewhere is the one of this calibration.

    Without either, tell whether the calibration's own files are as they were sealed, and by whom they were signed.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
        Also, with a public key, a signed file such as a certificate.
    urdf : str or Path, optional
        A URDF: compared by forward kinematics at random joints, and by its fingerprint.
    program : str or Path, optional
        In place of it: a program with fake targets, a folder or a zip archive of such, compared by the fingerprint
        that each file bears.
    base_link, tip_link : str, optional
        Base and tip link in the URDF, where a cell's URDF has given them other names; joints may have a prefix then.
    reseal : str, optional
        Why the folder was changed by hand: the change is accepted, with this line in its history.
    public_key : str or Path, optional
        Of whom it must be signed, see `irbcal.sign`.

    Raises
    ------
    RobotError
        If it is not a URDF with the calibration's joints between its base and tip link.
    ProgramError
        If the program cannot be read.
    CalibrationError
        If it is no calibration, or its changes cannot be accepted.
    OptionError
        If both ``urdf`` and ``program`` are given, or the files of a calibration are asked for that is not a folder.
    """
    if urdf is not None and program is not None:
        raise OptionError("expected a URDF or a program to compare with the calibration: one of them", parameter="urdf")
    if urdf is None and program is None:
        return _verify_folder(calibration, reseal, public_key)
    if reseal is not None or public_key is not None:
        name = "reseal" if reseal is not None else "public_key"
        raise OptionError(f"{name}: expected no URDF and no program beside it", parameter=name)
    record = open_calibration(calibration)
    if program is not None:
        return _verify_program(record, program)
    assert urdf is not None
    return verify_bytes(record, read_bytes(urdf, RobotError), str(urdf), base_link, tip_link)


def _verify_folder(
    calibration: CalibrationLike, reseal: str | None, public_key: str | Path | None
) -> FolderVerification | FileVerification:
    if not isinstance(calibration, (str, Path)):
        raise OptionError("expected a URDF or a program to compare with the calibration: one of them", parameter="urdf")
    resealed = None if reseal is None else calibration_folder.reseal(calibration, reseal)
    folder = calibration_folder.folder_of(calibration)
    is_signed = os.path.lexists(folder / calibration_folder.SIGNATURE_NAME)
    fault = calibration_folder.fault_of(calibration, public_key) if is_signed or public_key is not None else None
    if public_key is not None and folder.is_file():
        return FileVerification(fault is None, fault or "it is as it was signed with this key")
    check = resealed or calibration_folder.checked(folder)
    differences = check.differences + (() if fault is None or public_key is None else (fault,))
    signed: Literal["absent", "unchecked", "stale", "good", "bad"] = "absent"
    if public_key is not None:
        signed = "good" if fault is None else "bad"
    elif is_signed:
        signed = "unchecked" if fault is None else "stale"
    text = (
        f"{joined(check.files)} are as they were sealed, and agree with each other; "
        f"fingerprint {check.record.fingerprint}{', signed with this key' if signed == 'good' else ''}"
    )
    changes = () if check.record.seal is None else tuple(check.record.seal.changes)
    return FolderVerification(
        not differences,
        check.record.fingerprint,
        differences,
        check.files,
        check.unlisted,
        changes,
        signed,
        "; ".join(differences) or text,
    )


def _verify_program(record: Record, program: str | Path) -> ProgramVerification:
    from irbcal.correction.opened_programs import fingerprints_of

    marks = fingerprints_of(program)
    foreign = [name for name, mark in marks.items() if mark not in (None, record.fingerprint)]
    unmarked = [name for name, mark in marks.items() if mark is None]
    state: Literal["same", "other", "absent"] = (
        "other" if foreign else "absent" if len(unmarked) == len(marks) else "same"
    )
    subject, plural = ("this program", "") if len(marks) == 1 else (f"of these {len(marks)} files", "s")
    if state == "absent":
        none = "none bears a" if plural else "bears no"
        text = f"{subject} {none} mark of irbcal: the targets were not corrected, or the mark was taken out"
    elif state == "other":
        holds = f"{first_of(foreign, 5)} hold{'s' if len(foreign) == 1 else ''}" if plural else "holds"
        text = f"{subject} {holds} fake targets of ANOTHER calibration: correct the original program again"
    else:
        bear = f"{len(marks) - len(unmarked)} bear" if plural else "bears"
        text = f"{subject} {bear} the mark of this calibration (its targets are not checked)"
        if unmarked:
            text += f"; no mark, so no corrected target, in {first_of(unmarked, 5)}"
    return ProgramVerification(state == "same", state, text)


def verify_bytes(
    calibration: Record, data: bytes, source: str, base: str | None = None, tip: str | None = None
) -> Verification:
    """As `verify`, from the URDF's content; ``source`` names it in errors."""
    arms = {"calibrated": calibration.arm(), "nominal": calibration.arm(calibrated=False)}
    calibrated = arms["calibrated"]
    loaded = urdf_file.from_bytes(data, source, base or calibrated.base_link, tip or calibrated.tip_link).arm
    same_joints = len(loaded.joint_names) == len(calibrated.joint_names) and all(
        name == joint or ((base or tip) and name.endswith(joint))
        for name, joint in zip(loaded.joint_names, calibrated.joint_names, strict=True)
    )
    if not same_joints or (loaded.table.prismatic != calibrated.table.prismatic).any():
        raise RobotError(
            f"expected the joints {', '.join(calibrated.joint_names)} between {loaded.base_link} and "
            f"{loaded.tip_link}, found {', '.join(loaded.joint_names)}",
            file=source,
        )
    q = calibrated.random_joints(CHECKED_POSES, 0)
    T = loaded.forward(q)
    differences = {name: relative_difference(T, arm.forward(q)) for name, arm in arms.items()}
    geometry: Literal["calibrated", "rounded", "nominal", "other"] = "other"
    if max(differences["calibrated"]) <= SAME:
        geometry = "calibrated"
    elif max(differences["nominal"]) <= SAME:
        geometry = "nominal"
    if geometry == "other" and max(differences["calibrated"]) <= ROUNDED:
        geometry = "rounded"
    same_file = hashlib.sha256(data).hexdigest() == calibration.calibrated_urdf_sha256
    mark = urdf_file.fingerprint(data, source)
    fingerprint: Literal["same", "other", "absent"] = (
        "absent" if mark is None else "same" if mark == calibration.fingerprint else "other"
    )
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


def _explanation(geometry: str, fingerprint: str, same_file: bool, position: float, rotation: float) -> str:
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
