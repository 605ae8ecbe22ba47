"""A calibration folder as a row of the store."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError
from irbcal.files import calibration_folder
from irbcal.files.calibration_folder import JSON_NAME
from irbcal.files.schema import Record
from irbcal.fleet import outcomes
from irbcal.fleet.store import Stored
from irbcal.fleet.words import high_wave
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.term import Term
from irbcal.reading import read_bytes
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation.verdict import verdict_of


def name_of(term: Term) -> str:
    """The same name in every model: ``delta_theta3`` for constants of the geometry, else the term's."""
    if term.family == "geometry":
        return f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}"
    return term.name


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
    flat = len(certainty.covariance) - len(certainty.terms)
    C = np.array(certainty.covariance)[flat:, flat:]
    rows = _rows(record, certainty.terms, np.array(certainty.coefficients), C)
    own = rows[: len(certainty.terms)]
    return Stored(
        {"id": name, "serial": number, "type": record.robot.name},
        _head(record, path, when, sha256) | {"robot": name, "covariance": _factor(C)},
        tuple(row["name"] for row in own),
        np.array([row["value"] for row in own]),
        np.array([np.inf if row["prior"] is None else row["prior"] for row in own]),
        np.array([row["natural"] for row in own]),
        C,
        tuple(row["unit"] for row in own),
        tuple(rows),
        tuple((item.file, item.sha256) for item in record.data),
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
        "points_per_pose": record.fit.all.n / record.poses_fit,
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


def _rows(record: Record, terms: tuple[Term, ...], values: FloatArray, C: FloatArray) -> list[dict[str, Any]]:
    """Error parameters and terms in the order of the covariance, then base, targets and what is held, as listed."""
    sizes = _expected(record, terms, values, C)
    out: list[dict[str, Any]] = []
    for k, term in enumerate(terms):
        prior = sizes.get(term.group, 1.0) * term.size if sizes else None
        out.append(
            {
                "position": k,
                "name": name_of(term),
                "value": float(values[k]),
                "std": float(np.sqrt(max(C[k, k], 0.0))),
                "prior": prior,
                "natural": term.size,
                "unit": term.unit,
                "state": "identified",
                "used": True,
            }
        )
    known = {row["name"] for row in out}
    factor = {outside: (unit, size) for unit, (outside, size) in UNIT_OUTSIDE.items()}
    for item in record.parameters:
        if item.name in known or not (item.name.startswith(("base", "target")) or item.state == "held"):
            continue
        unit, size = factor.get(item.unit, (item.unit, 1.0))
        std = None if item.std is None else item.std * size
        row = {"position": len(out), "name": item.name, "value": item.value * size, "std": std, "unit": unit}
        out.append(row | {"prior": None, "natural": None, "state": item.state, "used": False})
    return out


def _expected(
    record: Record, terms: tuple[Term, ...], values: FloatArray, C: FloatArray
) -> Mapping[str, float]:
    """Prior standard deviation of each group of an average of models, in natural sizes; empty for levels.

    A group that only some of the averaged models have is zero in the others, which its coefficients' second moments
    tell.
    """
    if record.evidence is None:
        return {}
    natural = np.array([term.size for term in terms])
    moments = (np.diagonal(C) + values**2) / natural**2
    out = {}
    for group in record.evidence.groups:
        mine = np.array([term.group == group.name and not high_wave(name_of(term)) for term in terms])
        whole = group.found**2 + group.std**2
        share = float(moments[mine].mean()) / whole if mine.any() and whole > 0.0 else 1.0
        out[group.name] = group.size * min(1.0, share) ** 0.5
    return out


def _factor(C: FloatArray) -> bytes:
    """A factor L of ``C = L L'``, lower triangle row by row, little-endian floats of eight bytes."""
    values, vectors = np.linalg.eigh(C)
    R = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
    return bytes(R.T[np.tril_indices(len(C))].astype("<f8").tobytes())
