"""The coupling of a robot's joints, declared in a file beside its URDF: ``NAME.coupling.yaml``."""

from __future__ import annotations

from pathlib import Path

from irbcal.arrays import FloatArray
from irbcal.errors import OptionError, RobotError
from irbcal.modeling import coupling
from irbcal.options import shown

ENDING = ".coupling.yaml"
LARGEST_FILE = 100_000
"""Bytes; no coupling needs more."""


NONE = "none"
"""Given in place of a coupling: the controller counts as the URDF does, whatever a file says."""


def declared(urdf: Path, joints: int, given: str | None) -> FloatArray | None:
    """The coupling of a robot.

    Parameters
    ----------
    urdf : Path
    joints : int
        Of the arm.
    given : str or None
        As `irbcal.modeling.coupling.matrix` takes it, or ``none``; it goes before the file beside the URDF.

    Returns
    -------
    ndarray, shape (joints, joints), or None

    Raises
    ------
    RobotError
        If it, or the file, is not understood.
    """
    if given is None:
        return beside(urdf, joints)
    if not isinstance(given, str):
        raise OptionError(f"coupling: expected terms such as 3+2, found {shown(given)}", parameter="coupling")
    return None if given.strip().lower() == NONE else coupling.matrix(given, joints)


def beside(urdf: Path, joints: int) -> FloatArray | None:
    """The coupling declared beside a URDF, see `irbcal.modeling.coupling.matrix`; None where there is no file.

    Raises
    ------
    RobotError
        If there is a file that is not understood.
    """
    import yaml

    file = urdf.with_suffix(ENDING)
    if not file.is_file():
        return None
    try:
        with open(file, encoding="utf-8") as stream:
            content = yaml.safe_load(stream.read(LARGEST_FILE))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise RobotError(f"expected a line such as 'coupling: 3+2' in YAML, found {error}", file=file) from None
    if not isinstance(content, dict) or set(content) != {"coupling"} or content["coupling"] is None:
        raise RobotError(f"expected a line such as 'coupling: 3+2', found {shown(content)}", file=file)
    return coupling.matrix(content["coupling"], joints, str(file))
