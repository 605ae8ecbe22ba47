"""Error parameters by name, the levels of the thesis (Nubiola 2011, section 5.4) and the levels for any arm.

A level is a list of error parameters of the robot itself; base (6) and targets (3 each) are always
identified beside them and have no nominal values. The thesis's levels are for six revolute joints; the
general ones take a serial arm of any revolute and prismatic joints: ``offsets`` one number a joint,
``placement`` all six numbers that place a joint, of which the identification holds what cannot be seen.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.levels import LEVELS, Level
from irbcal.modeling.terms.gain import FAMILY as GAIN
from irbcal.modeling.terms.geometry import DHM_COLUMNS, SIZES
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.thesis import fourier_of, stiffness_of
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.modeling.arm import Arm

ParameterKind: TypeAlias = Literal["alpha", "a", "theta", "d", "beta", "b", "stiffness", "fourier", "gain"]
"""What an error parameter changes: a column of the DHM table, or an array of the joint map."""

Unit: TypeAlias = Literal["m", "rad", "1"]
"""SI unit of an error parameter."""

GEOMETRIC: tuple[ParameterKind, ...] = ("alpha", "a", "theta", "d", "beta", "b")
"""Columns of the DHM table."""

FOURIER = ("a1", "b1", "a2", "b2")
"""Coefficients of joint 6's Fourier series, see `irbcal.modeling.thesis_map`."""


@dataclass(frozen=True)
class Parameter:
    """One error parameter of the robot."""

    name: str
    """``delta_theta3``, ``stiffness_A``, ``fourier_b2``, ``gain4``."""
    kind: ParameterKind
    """Column of the DHM table, ``stiffness``, ``fourier`` or ``gain``."""
    index: int
    """Joint (from 0) or position in the joint map's array."""
    unit: Unit
    """SI unit: ``m``, ``rad`` or ``1``."""
    scale: float
    """Plausible size in SI units: what manufacturing, mastering or gravity could do to an industrial arm. A direction
    known less well than this is not an identification (it is held at nominal).
    """


@cache
def parameter(name: str) -> Parameter:
    """The error parameter of a name.

    Raises
    ------
    IdentificationError
        If there is no such parameter.
    """
    match = re.fullmatch(r"delta_(alpha|a|theta|d|beta|b)([1-9]\d?)", name)
    if match:
        kind = next(column for column in GEOMETRIC if column == match[1])
        joint, length = match[2], kind in ("a", "d", "b")
        return Parameter(name, kind, int(joint) - 1, "m" if length else "rad", 5 * MM if length else 0.5 * DEG)
    match = re.fullmatch(r"gain([1-9]\d?)", name)
    if match:
        return Parameter(name, "gain", int(match[1]) - 1, "1", 5e-3)
    if name in ("stiffness_A", "stiffness_B"):
        return Parameter(name, "stiffness", "AB".index(name[-1]), "rad", 0.5 * DEG)
    if name.startswith("fourier_") and name[8:] in FOURIER:
        return Parameter(name, "fourier", FOURIER.index(name[8:]), "rad", 0.5 * DEG)
    raise IdentificationError(f"unknown error parameter {name!r}", parameter=name)


_THETA = [f"delta_theta{i}" for i in range(2, 7)]
_LENGTHS = ["delta_a2", "delta_a3", "delta_a4", "delta_d4", "delta_d6"]
_LINKS = [f"delta_{kind}{i}" for i in range(2, 7) for kind in ("alpha", "a", "theta", "d")]
_JOINT_MAP = ["stiffness_A", "stiffness_B", *(f"fourier_{name}" for name in FOURIER)]

THESIS_LEVELS: Mapping[Level, Sequence[str]] = {
    "nominal": [],
    "11": _THETA,
    "16": _THETA + _LENGTHS,
    "26": _LINKS,
    "34": _LINKS + _JOINT_MAP,
    "34b": ["delta_beta3" if name == "delta_d3" else name for name in _LINKS + _JOINT_MAP],
}
"""Level -> names of its error parameters (Nubiola 2011, sections 5.4.1, 5.4.2, 5.4.3, 5.4.4 and 5.4.5).

They are the deltas of Tables 5.3, 5.4, 5.5, 5.6 and 5.7. Level 34 counts four stiffness parameters in the thesis; they
act through two numbers, which are what is identified (see `irbcal.modeling.joint_map`). Level 34b has Hayati's tilt of
axis 3 in place of its d, which parallel axes cannot tell from that of axis 2 (section 3.1.3).
"""

GENERAL_LEVELS: tuple[Level, ...] = ("nominal", "offsets", "placement")
"""Levels for any serial arm. Joint 1 has no errors of its own there: the base takes them."""


def levels_of(arm: Arm) -> tuple[Level, ...]:
    """Levels to compare for an arm, from small to large."""
    return (*THESIS_LEVELS, "placement") if arm.six_revolute else GENERAL_LEVELS


def default_level(arm: Arm) -> Level:
    """The level for an arm where none is asked for: ``34`` for arms built like the thesis's, else ``placement``."""
    return "34" if closed_form.has_closed_form(arm) and arm.bends_like_the_thesis else "placement"


def level_parameters(level: str, arm: Arm | None = None) -> tuple[Parameter, ...]:
    """Error parameters of a level (Nubiola 2011, section 5.4).

    Parameters
    ----------
    level : str
    arm : Arm, optional
        Six revolute joints unless given.

    Raises
    ------
    IdentificationError
        If there is no such level for this arm.
    """
    if level not in LEVELS:
        raise IdentificationError(f"unknown model {level!r}: choose one of {', '.join(LEVELS)}", parameter="model")
    if level in THESIS_LEVELS:
        if level == "nominal" or arm is None or arm.six_revolute:
            return tuple(parameter(name) for name in THESIS_LEVELS[level])
        raise IdentificationError(
            f"model {level} is for arms with six revolute joints, {arm.name} has {arm.joints_listed}: choose one of "
            f"{', '.join(GENERAL_LEVELS)}",
            parameter="model",
        )
    slides = np.zeros(6, dtype=bool) if arm is None else arm.table.prismatic
    names: list[str] = []
    for i in range(2, len(slides) + 1):
        kinds: tuple[ParameterKind, ...] = (
            GEOMETRIC if level == "placement" else ("d",) if slides[i - 1] else ("theta",)
        )
        names += [f"delta_{kind}{i}" for kind in kinds]
    return tuple(parameter(name) for name in names)


def all_names(arm: Arm | None = None) -> tuple[str, ...]:
    """Names of all error parameters that an arm can have; of six revolute joints unless given."""
    joints = range(1, (6 if arm is None else len(arm.joint_names)) + 1)
    names = [f"delta_{kind}{i}" for i in joints for kind in GEOMETRIC]
    if arm is None or arm.six_revolute:
        names += ["stiffness_A", "stiffness_B", *(f"fourier_{name}" for name in FOURIER)]
    return (*names, *(f"gain{i}" for i in joints))


def selected_parameters(
    level: str, free: Sequence[str] = (), hold: Sequence[str] = (), arm: Arm | None = None
) -> tuple[Parameter, ...]:
    """Error parameters of a level with some added and some left out.

    Parameters
    ----------
    level : str
    free, hold : sequence of str
        Names or shell patterns (``gain*``, ``delta_alpha[45]``); ``hold`` has the last word.
    arm : Arm, optional
        Six revolute joints unless given.

    Returns
    -------
    tuple of Parameter
        In the order of the level, added ones last.

    Raises
    ------
    IdentificationError
        If there is no such level, or a pattern matches nothing.
    """
    names = [parameter.name for parameter in level_parameters(level, arm)]
    existing = all_names(arm)
    for pattern in (*free, *hold):
        if not fnmatch.filter(existing, pattern):
            joint_map = ", ".join(name for name in existing if name.startswith(("stiffness", "fourier")))
            raise IdentificationError(
                f"no error parameter is called {pattern!r}: names are delta_alpha, delta_a, delta_theta, delta_d, "
                f"delta_beta and delta_b with the joint's number, {joint_map + ', ' if joint_map else ''}"
                f"gain1 … {existing[-1]}",
                parameter=pattern,
            )
    for pattern in free:
        names += [name for name in fnmatch.filter(existing, pattern) if name not in names]
    for pattern in hold:
        names = [name for name in names if not fnmatch.fnmatchcase(name, pattern)]
    return tuple(parameter(name) for name in names)


AXIS_OF = {column: axis for axis, column in DHM_COLUMNS.items()}


def term_of(parameter: Parameter, arm: Arm) -> Term:
    """The term of the error model that an error parameter is the coefficient of.

    Parameters
    ----------
    parameter : Parameter
        A constant of the geometry, a gain, or a parameter of stiffness or of joint 6's Fourier series.
    arm : Arm
        Nominal arm, one that the thesis's joint map fits where the parameter is of that.

    Raises
    ------
    RobotError
        If the arm does not bend like the thesis's, and the parameter is one of its stiffness.
    """
    if parameter.kind == "gain":
        return GAIN.terms(arm)[parameter.index]
    if parameter.kind == "stiffness":
        return stiffness_of(arm, arm.stiffness_geometry()[0])[parameter.index]
    if parameter.kind == "fourier":
        return fourier_of()[parameter.index]
    axis = AXIS_OF[parameter.kind]
    return Term(parameter.index, axis, "constant", SIZES[axis[0]], "geometry", "geometry", parameter.unit)


def name_of(term: Term) -> str:
    """The error parameter that is the coefficient of a term of `irbcal.modeling.thesis_map`, by its name."""
    if term.basis == "q":
        return f"gain{term.joint + 1}"
    if term.basis == "gravity":
        return f"stiffness_{'AB'[len(term.also)]}"
    return f"fourier_{'b' if term.basis == 'sin' else 'a'}{order(term)}"


def thesis_count(parameters: Sequence[Parameter]) -> int:
    """Number of error parameters as Nubiola 2011, section 5.4, counts them: with the base, four for the stiffness."""
    return 6 + len(parameters) + 2 * any(p.kind == "stiffness" for p in parameters)
