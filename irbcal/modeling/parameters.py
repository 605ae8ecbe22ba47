"""Error parameters by name, and the levels of the thesis (section 5.4).

A level is a list of error parameters of the robot itself; base (6) and targets (3 each) are always
identified beside them and have no nominal values.
"""

import fnmatch
import re
from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.units import DEG, MM

GEOMETRIC = ("alpha", "a", "theta", "d", "beta")
FOURIER = ("a1", "b1", "a2", "b2")


@dataclass(frozen=True)
class Parameter:
    """One error parameter of the robot.

    Attributes
    ----------
    name : str
        ``delta_theta3``, ``stiffness_A``, ``fourier_b2``, ``gain4``.
    kind : str
        Column of the DHM table, ``stiffness``, ``fourier`` or ``gain``.
    index : int
        Joint (from 0) or position in the joint map's array.
    unit : str
        SI unit: ``m``, ``rad`` or ``1``.
    scale : float
        Plausible size in SI units: what manufacturing, mastering or gravity could do to an industrial
        arm. A direction known less well than this is not an identification (it is held at nominal).
    """

    name: str
    kind: str
    index: int
    unit: str
    scale: float


def parameter(name):
    """The error parameter of a name.

    Raises
    ------
    IdentificationError
        If there is no such parameter.
    """
    match = re.fullmatch(r"delta_(alpha|a|theta|d|beta)([1-6])", name)
    if match:
        kind, joint = match.groups()
        length = kind in ("a", "d")
        return Parameter(name, kind, int(joint) - 1, "m" if length else "rad", 5 * MM if length else 0.5 * DEG)
    match = re.fullmatch(r"gain([1-6])", name)
    if match:
        return Parameter(name, "gain", int(match[1]) - 1, "1", 5e-3)
    if name in ("stiffness_A", "stiffness_B"):
        return Parameter(name, "stiffness", "AB".index(name[-1]), "rad", 0.5 * DEG)
    if name.startswith("fourier_") and name[8:] in FOURIER:
        return Parameter(name, "fourier", FOURIER.index(name[8:]), "rad", 0.5 * DEG)
    raise IdentificationError(f"unknown error parameter {name!r}")


_THETA = [f"delta_theta{i}" for i in range(2, 7)]
_LENGTHS = ["delta_a2", "delta_a3", "delta_a4", "delta_d4", "delta_d6"]
_LINKS = [f"delta_{kind}{i}" for i in range(2, 7) for kind in ("alpha", "a", "theta", "d")]
_JOINT_MAP = ["stiffness_A", "stiffness_B", *(f"fourier_{name}" for name in FOURIER)]

LEVELS = {
    "nominal": [],
    "11": _THETA,
    "16": _THETA + _LENGTHS,
    "26": _LINKS,
    "34": _LINKS + _JOINT_MAP,
    "34b": ["delta_beta3" if name == "delta_d3" else name for name in _LINKS + _JOINT_MAP],
}
"""Level -> names of its error parameters. Level 34 counts four stiffness parameters in the thesis; they
act through two numbers, which are what is identified (see `irbcal.modeling.jointmap`)."""


def level_parameters(level):
    """Error parameters of a level.

    Parameters
    ----------
    level : str

    Returns
    -------
    tuple of Parameter

    Raises
    ------
    IdentificationError
        If there is no such level.
    """
    if level not in LEVELS:
        raise IdentificationError(f"unknown model {level!r}: choose one of {', '.join(LEVELS)}")
    return tuple(parameter(name) for name in LEVELS[level])


ALL_NAMES = (
    *(f"delta_{kind}{i}" for i in range(1, 7) for kind in GEOMETRIC),
    "stiffness_A",
    "stiffness_B",
    *(f"fourier_{name}" for name in FOURIER),
    *(f"gain{i}" for i in range(1, 7)),
)
"""Names of all error parameters that exist."""


def selected_parameters(level, free=(), hold=()):
    """Error parameters of a level with some added and some left out.

    Parameters
    ----------
    level : str
    free, hold : sequence of str
        Names or shell patterns (``gain*``, ``delta_alpha[45]``); ``hold`` has the last word.

    Returns
    -------
    tuple of Parameter
        In the order of the level, added ones last.

    Raises
    ------
    IdentificationError
        If there is no such level, or a pattern matches nothing.
    """
    names = [item.name for item in level_parameters(level)]
    for pattern in (*free, *hold):
        if not fnmatch.filter(ALL_NAMES, pattern):
            raise IdentificationError(
                f"no error parameter is called {pattern!r}: names are delta_alpha, delta_a, delta_theta, delta_d and "
                "delta_beta with the joint's number, stiffness_A, stiffness_B, fourier_a1, fourier_b1, fourier_a2, "
                "fourier_b2, gain1 … gain6"
            )
    for pattern in free:
        names += [name for name in fnmatch.filter(ALL_NAMES, pattern) if name not in names]
    for pattern in hold:
        names = [name for name in names if not fnmatch.fnmatchcase(name, pattern)]
    return tuple(parameter(name) for name in names)


def thesis_count(parameters):
    """Number of error parameters as the thesis counts them: with the base, and four for the stiffness."""
    return 6 + len(parameters) + 2 * any(p.kind == "stiffness" for p in parameters)


def apply(parameters, values, table, joint_map):
    """Nominal table and joint map with error parameters added.

    Parameters
    ----------
    parameters : sequence of Parameter
    values : ndarray, shape (k,)
        SI units.
    table : DHMTable
    joint_map : JointMap

    Returns
    -------
    table : DHMTable
    joint_map : JointMap
    """
    columns = {kind: getattr(table, kind).copy() for kind in GEOMETRIC}
    columns |= {kind: getattr(joint_map, kind).copy() for kind in ("gain", "stiffness", "fourier")}
    for item, value in zip(parameters, np.asarray(values, dtype=float), strict=True):
        columns[item.kind][item.index] += value
    return (
        replace(table, **{kind: columns[kind] for kind in GEOMETRIC}),
        replace(joint_map, **{kind: columns[kind] for kind in ("gain", "stiffness", "fourier")}),
    )
