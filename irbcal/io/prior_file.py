"""The file of a type's prior, as `irbcal fleet prior` writes and `irbcal calibrate` reads it."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError
from pydantic_core import to_json

from irbcal.errors import CalibrationError, OptionError
from irbcal.identification.type_prior import TypePrior
from irbcal.safe_files import read_bytes


def content(prior: TypePrior) -> bytes:
    """A prior as the file has it: SI units."""
    return to_json(prior, indent=1) + b"\n"


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
    if (type_prior.type, type_prior.nominal_urdf_sha256) != (name, nominal_sha256):
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
        return TypePrior.model_validate_json(data)
    except ValidationError:
        raise CalibrationError(
            "expected a prior of a type as irbcal fleet prior writes it (version 1), found another content",
            file=str(file),
        ) from None
