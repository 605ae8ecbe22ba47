"""The file of a type's prior, as `irbcal fleet prior` writes and `irbcal calibrate` reads it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from irbcal.errors import CalibrationError, OptionError
from irbcal.identification.term_sets import TypePrior
from irbcal.safe_files import read_bytes

KIND, VERSION = "prior of a type", 1
SMALLEST, LARGEST = 1e-15, 1e6
"""Standard deviations of error parameters (metres, radians, ...) beyond which a file is damaged."""


def content(prior: TypePrior) -> bytes:
    """A prior as the file has it: SI units."""
    rows = zip(prior.names, prior.units, prior.mean, prior.std, prior.natural, strict=True)
    document = {
        "irbcal": KIND,
        "version": VERSION,
        "type": prior.type,
        "nominal_urdf_sha256": prior.nominal_sha256,
        "simulated": prior.simulated,
        "robots": list(prior.robots),
        "terms": [
            {"name": name, "unit": unit, "mean": float(mean), "std": float(std), "natural": float(natural)}
            for name, unit, mean, std, natural in rows
        ],
    }
    return (json.dumps(document, indent=1) + "\n").encode()


def of_robot(prior: str | Path | TypePrior | None, name: str, nominal_sha256: str, simulated: bool) -> TypePrior | None:
    """The prior of a robot's type.

    Parameters
    ----------
    prior : str, Path or TypePrior
        File, or what it has.
    name, nominal_sha256 : str
        Of the nominal robot.
    simulated : bool
        Whether the measurements are.

    Raises
    ------
    OptionError
        If it is of another nominal robot, or from simulated ones where the measurements are real.
    CalibrationError
        If it is none.
    """
    if prior is None:
        return None
    type_prior = prior if isinstance(prior, TypePrior) else read(prior)
    if (type_prior.type, type_prior.nominal_sha256) != (name, nominal_sha256):
        subject = "another file of that robot" if type_prior.type == name else f"robot {type_prior.type}"
        raise OptionError(
            f"prior: it is of {subject}, not of the nominal robot {name} that is given", parameter="prior"
        )
    if type_prior.simulated and not simulated:
        raise OptionError(
            "prior: it is from SIMULATED robots, and says nothing of one that was measured", parameter="prior"
        )
    return type_prior


def read(file: str | Path) -> TypePrior:
    """Read a prior.

    Raises
    ------
    CalibrationError
        If it cannot be read or is none.
    """
    data = read_bytes(file, CalibrationError)
    try:
        content = json.loads(data)
        if content["irbcal"] != KIND or content["version"] != VERSION:
            raise ValueError
        terms = content["terms"]
        mean, std, natural = (np.array([float(row[key]) for row in terms]) for key in ("mean", "std", "natural"))
        sizes = np.abs([std, natural])
        if not ((np.abs(mean) < LARGEST).all() and (sizes > SMALLEST).all() and (sizes < LARGEST).all()):
            raise ValueError
        return TypePrior(
            str(content["type"]),
            str(content["nominal_urdf_sha256"]),
            tuple(str(name) for name in content["robots"]),
            bool(content["simulated"]),
            tuple(str(row["name"]) for row in terms),
            tuple(str(row["unit"]) for row in terms),
            mean,
            std,
            natural,
        )
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise CalibrationError(
            "expected a prior of a type as irbcal fleet prior writes it (version 1), found another content",
            file=str(file),
        ) from None
