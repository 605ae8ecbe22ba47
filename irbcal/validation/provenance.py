"""Where an evaluation comes from: robot, people, instruments, files with their hashes, and how many poses were new."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError, MeasurementError, OptionError
from irbcal.io.calibration_folder import JSON_NAME, URDF_NAME, folder_of
from irbcal.io.schema import Record
from irbcal.names import check_names, fault_of
from irbcal.option_values import excerpt
from irbcal.safe_files import read_bytes
from irbcal.summary import Content
from irbcal.validation.cleaned_points import CleanedPoints

FIELDS = {
    "robot_type": "Robot type",
    "serial_number": "Serial number",
    "operator": "Operator",
    "tracker": "Tracker",
    "tracker_certificate": "Tracker certificate",
    "scale_bar": "Scale bar",
    "temperature": "Temperature",
    "date": "Measured on",
}
"""What every certificate tells, and what it is called there."""

ALIASES = {
    "robot": "robot_type",
    "type": "robot_type",
    "serial": "serial_number",
    "certificate": "tracker_certificate",
    "temperature_c": "temperature",
    "measured": "date",
    "measured_on": "date",
}
"""Other names for them."""

MOST_INFO, LONGEST = 10, 60
"""Things that may be told besides `FIELDS`, and characters of each: a certificate is two pages long."""


@dataclass(frozen=True)
class HashedFile:
    """A file by its content."""

    purpose: str
    """What it is for."""
    name: str
    """Without its folder."""
    sha256: str


@dataclass(frozen=True, eq=False)
class Origin(Content):
    """Where an evaluation comes from."""

    robot: str
    """Name in the URDF."""
    info: Mapping[str, str]
    """What was told, or stands in columns of the measurements; `FIELDS` first."""
    calibrated: str
    """When the calibration was made (ISO 8601, UTC)."""
    fingerprint: str
    """Of the calibration; stands in its URDF, too."""
    files: tuple[HashedFile, ...]
    software: Mapping[str, str]
    """Versions with which the calibration was made."""
    joint_units: tuple[str, ...]
    """``deg`` or ``mm``."""
    joints: FloatArray
    """Shape (n, joints). Of the judged poses, in these units."""
    counted_out: int
    """Poses of the file that were fitted, and are not judged."""
    fitted: int | None
    """Poses among the judged that were fitted, or are at joints that were fitted and measured again; None where the
    calibration does not tell.
    """
    scope: tuple[str, ...] = ()
    """What the evaluation is limited to, in sentences."""
    poses: int | None = None
    """Judged poses, where ``joints`` has only some of them."""

    @property
    def judged(self) -> int:
        """How many poses are judged."""
        return len(self.joints) if self.poses is None else self.poses

    @property
    def unseen(self) -> int | None:
        """Judged poses that the fit never saw; None where the calibration does not tell."""
        return None if self.fitted is None else self.judged - self.fitted

    @property
    def counts(self) -> dict[str, int | None]:
        """How many poses are judged, were never seen by the fit, and are left out because they were fitted."""
        return {"judged": self.judged, "never_seen": self.unseen, "counted_out": self.counted_out}

    CONTENT = "robot info calibrated fingerprint files poses=counts"

    def stated(self) -> list[tuple[str, str]]:
        """Labels and what was told; empty text where one of `FIELDS` was not."""
        known = [(label, self.info.get(key, "")) for key, label in FIELDS.items()]
        return known + [(_label(key), value) for key, value in self.info.items() if key not in FIELDS]


def origin(
    calibration: object,
    record: Record,
    cleaned: CleanedPoints,
    info: Mapping[str, str],
    scope: tuple[str, ...] = (),
) -> Origin:
    """Where an evaluation comes from.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    record : Record
        What it holds.
    cleaned : CleanedPoints
        What is judged.
    info : dict of str to str
        As `checked_info` leaves it.
    scope : tuple of str
    """
    measured, arm = cleaned.measurements, record.arm(calibrated=False)
    fitted = None if cleaned.at_fitted is None else int(cleaned.at_fitted.sum())
    return Origin(
        record.robot.name,
        {**_of_columns(cleaned), **info},
        record.created,
        record.fingerprint,
        (
            HashedFile("measurements", PurePath(measured.source).name, measured.sha256),
            *_hashed(calibration),
            HashedFile("calibrated URDF", URDF_NAME, record.calibrated_urdf_sha256),
            *(HashedFile("calibration data", PurePath(file.file).name, file.sha256) for file in record.data),
        ),
        record.software,
        arm.joint_unit_names,
        cleaned.points.q / arm.joint_units,
        cleaned.counted_out,
        fitted,
        scope,
    )


def _hashed(calibration: object) -> list[HashedFile]:
    """The ``calibration.json`` that was read, where it is a file."""
    folder = calibration if isinstance(calibration, (str, os.PathLike)) else getattr(calibration, "folder", None)
    if folder is None:
        return []
    content = read_bytes(folder_of(Path(folder)) / JSON_NAME, CalibrationError)
    return [HashedFile("calibration", JSON_NAME, hashlib.sha256(content).hexdigest())]


# --- what is told of a measurement ------------------------------------------------------------------------


def checked_info(info: Mapping[str, str] | None) -> dict[str, str]:
    """What is stated of a measurement, by the names of `FIELDS` where it is one of them.

    Raises
    ------
    OptionError
        If something is given twice, or is no line of printable characters.
    """
    if info is not None and not isinstance(info, Mapping):
        raise OptionError(f"info: expected names and what they are, found {excerpt(info)}", parameter="info")
    out: dict[str, str] = {}
    for name, value in (info or {}).items():
        key, text = _key(str(name)), " ".join(str(value).split(" ")).strip()
        check_names([str(name), str(value)], OptionError, parameter="info")
        if not key:
            raise OptionError(f"info: expected a name before what it is, found {excerpt(value)}", parameter="info")
        if key in out:
            raise OptionError(f"info: {_label(key).lower()} is given twice", parameter="info")
        if max(len(key), len(text)) > LONGEST:
            raise OptionError(
                f"info: expected at most {LONGEST} characters, found {max(len(key), len(text))} ({text[:20]!r} …)",
                parameter="info",
            )
        out[key] = f"{text} °C" if str(name).lower() == "temperature_c" else text
    more = len(out.keys() - FIELDS.keys())
    if more > MOST_INFO:
        raise OptionError(
            f"info: expected at most {MOST_INFO} things besides {', '.join(FIELDS)}, found {more}",
            parameter="info",
        )
    return out


def _key(name: str) -> str:
    key = "_".join(name.strip().lower().replace("-", " ").replace("_", " ").split())
    return ALIASES.get(key, key)


def _label(key: str) -> str:
    text = key.replace("_", " ")
    return FIELDS.get(key, text[:1].upper() + text[1:])


def _of_columns(cleaned: CleanedPoints) -> dict[str, str]:
    """What columns of the file say of the judged poses."""
    table = cleaned.measurements.cells
    rows = np.isin(table["pose_index"], cleaned.number)
    out: dict[str, str] = {}
    for column in table.columns:
        key = _key(str(column))
        if key in FIELDS and column != "type" and key not in out:
            text = _summed(pd.Series(table[column][rows]), " °C" if column == "temperature_c" else "")
            if fault_of(text) is not None:
                raise MeasurementError(
                    f"column {column}: expected a short text for the certificate", file=cleaned.measurements.source
                )
            out |= {key: text} if text else {}
    return out


def _summed(values: pd.Series[Any], unit: str) -> str:
    """The values of a column in a few words: a range of numbers, or the different texts."""
    texts = [text for value in values.dropna().unique() if (text := str(value).strip())]
    if not texts:
        return ""
    numbers = pd.to_numeric(pd.Series(texts), errors="coerce")
    if numbers.notna().all():
        low, high = float(numbers.min()), float(numbers.max())
        return (f"{low:g}" if low == high else f"{low:g} to {high:g}") + unit
    texts = sorted(texts)
    if len(texts) > 3:
        return f"{texts[0]} to {texts[-1]}" if all(text[:4].isdigit() for text in texts) else f"{len(texts)} different"
    return ", ".join(texts)[:LONGEST]
