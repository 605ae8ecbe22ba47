"""A calibration folder as a row of the store."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import CalibrationError, IdentificationError, IrbcalError
from irbcal.files import calibration_folder
from irbcal.files.calibration_folder import JSON_NAME
from irbcal.files.earlier import earlier_of
from irbcal.files.schema import Record
from irbcal.fleet import outcomes
from irbcal.fleet.store import Estimate, Stored
from irbcal.fleet.words import high_wave
from irbcal.identification.averaged import check_averaging
from irbcal.identification.fit import identify
from irbcal.identification.level_certainty import certainty_of
from irbcal.identification.type_prior import WIDE, name_of, seen
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.parameters import default_level
from irbcal.reading import read_bytes
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation.verdict import verdict_of


def stored(
    folder: str | Path, robot: str | None = None, serial: str | None = None, measured: str | None = None
) -> Stored:
    """A calibration folder as the store takes it.

    Parameters
    ----------
    folder : str or Path
    robot, serial : str, optional
        Id and serial number; those that `irbcal.fleet.calibrated.fleet_calibrate` wrote beside it, or the folder's
        name, unless given.
    measured : str, optional
        Date, ISO 8601; that of the calibration where none is known.

    Raises
    ------
    CalibrationError
        If the folder is no calibration, or the date is none.
    """
    path = calibration_folder.folder_of(folder)
    record = calibration_folder.load(path)
    mark = outcomes.read_mark(path)
    name = robot or (mark.id if mark else path.resolve().name)
    number = serial or (mark.serial if mark else name)
    day = measured or (mark.date if mark and mark.date else record.created[:10])
    try:
        when = date.fromisoformat(day)
    except ValueError:
        raise CalibrationError(f"expected a date such as 2026-03-17, found {day!r}", parameter="date") from None
    sha256 = hashlib.sha256(read_bytes(path / JSON_NAME, CalibrationError)).hexdigest()
    certainty = record.robot_calibrated().certainty
    assert certainty is not None
    sizes = _expected(record, certainty)
    fit = _estimate(certainty, sizes)
    return Stored(
        {"id": name, "serial": number, "type": record.robot.name},
        _head(record, path, when, sha256) | {"robot": name},
        fit,
        _level(record),
        _terms(record),
        tuple(_other(record, set(fit.names))),
        tuple((item.file, item.sha256) for item in record.data),
    )


def _estimate(certainty: Certainty, sizes: Mapping[str, float] | None = None, count: float = 1.0) -> Estimate:
    """Parameters of a certainty; ``count`` times their variance."""
    terms, flat = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    expected = [sizes.get(term.group, 1.0) for term in terms] if sizes else [np.inf] * len(terms)
    return Estimate(
        tuple(name_of(term) for term in terms),
        tuple(term.unit for term in terms),
        np.array(certainty.coefficients),
        natural * expected,
        natural,
        count * np.array(certainty.covariance)[flat:, flat:],
    )


def _level(record: Record) -> Estimate | None:
    """The arm's own level fitted to the points of a calibration, a pose counted once.

    A level takes the points of a pose for independent, but their errors are mostly the pose's: its variances are too
    small by the number of points.
    """
    known = record.used_points(False)
    if known is None:
        return None
    points, arm = known[0], record.arm(calibrated=False)
    try:
        fit = identify(arm, points, default_level(arm))
    except IdentificationError:
        return None
    return _estimate(certainty_of(fit), count=max(1.0, len(points) / points.poses))


def _terms(record: Record) -> Estimate | None:
    """What all points of a calibration's last session show of the terms that a type is compared by."""
    arm = record.arm(calibrated=False)
    try:
        _, points, motion = earlier_of(record).sessions[-1]
        check_averaging(arm, points.poses)
        found = seen(arm, points, motion)
    except IrbcalError:
        return None
    natural = np.array([term.size for term in found.terms])
    return Estimate(
        tuple(name_of(term) for term in found.terms),
        tuple(term.unit for term in found.terms),
        np.array(found.values),
        WIDE * natural,
        natural,
        np.array(found.covariance),
    )


def _head(record: Record, folder: Path, measured: date, sha256: str) -> dict[str, Any]:
    proven, before, found = record.heldout, record.heldout_nominal, verdict_of(record)
    return {
        "fingerprint": record.fingerprint,
        "measured": measured,
        "created": record.created,
        "added": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "folder": str(folder.resolve()),
        "model": record.model,
        "method": record.method,
        "simulated": record.simulated,
        "poses_fit": record.poses_fit,
        "poses_heldout": record.poses_heldout,
        "nominal_mean_mm": before.all.mean_mm if before else None,
        "heldout_mean_mm": proven.all.mean_mm if proven else None,
        "heldout_sigma_mm": proven.all.sigma_mm if proven else None,
        "heldout_max_mm": proven.all.max_mm if proven else None,
        "trusted": found.trusted,
        "verdict": found.sentence(),
        "json_sha256": sha256,
        "urdf_sha256": record.calibrated_urdf_sha256,
        "nominal_urdf_sha256": record.robot.urdf_sha256,
    }


def _other(record: Record, known: set[str]) -> list[dict[str, Any]]:
    """Base, targets and what is held, as listed."""
    factor = {outside: (unit, size) for unit, (outside, size) in UNIT_OUTSIDE.items()}
    out: list[dict[str, Any]] = []
    for item in record.parameters:
        if item.name in known or not (item.name.startswith(("base", "target")) or item.state == "held"):
            continue
        unit, size = factor.get(item.unit, (item.unit, 1.0))
        std = None if item.std is None else item.std * size
        row = {"part": "other", "position": len(out), "name": item.name, "value": item.value * size, "std": std}
        out.append(row | {"prior": None, "natural": None, "unit": unit, "state": item.state})
    return out


def _expected(record: Record, certainty: Certainty) -> Mapping[str, float]:
    """Prior standard deviation of each group of an average of models, in natural sizes; empty for levels.

    A group that only some of the averaged models have is zero in the others, which its coefficients' second moments
    tell.
    """
    if record.evidence is None:
        return {}
    terms, flat = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    moments = (np.diagonal(certainty.covariance)[flat:] + certainty.coefficients**2) / natural**2
    out = {}
    for group in record.evidence.groups:
        mine = np.array([term.group == group.name and not high_wave(name_of(term)) for term in terms], dtype=bool)
        whole = (group.found or 0.0) ** 2 + (group.std or 0.0) ** 2
        share = float(moments[mine].mean()) / whole if mine.any() and whole > 0.0 else 1.0
        out[group.name] = group.size * min(1.0, share) ** 0.5
    return out
