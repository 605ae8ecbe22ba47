"""A calibrated robot as plain numbers: its chain, and what the terms of its joint map come to.

Joints count from 0, lengths are metres, angles radians. What `irbcal.modeling.terms` keeps as terms is summed up here:
gains, series of cosines and sines, levers of gravity by link, compliances under a payload and under torques, and what
the last move does. The compiled kernel (`irbcal.kernel`) and all exports are made of these numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal import kernel
from irbcal.arrays import FloatArray, Locked
from irbcal.errors import CalibrationError
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import QUARTER, Row
from irbcal.modeling.terms import bases, given_inputs, inputs
from irbcal.modeling.terms.gravity import vector_of
from irbcal.modeling.terms.own_weight import levers_of
from irbcal.modeling.terms.payload import STANDARD_GRAVITY
from irbcal.modeling.terms.situation import spread
from irbcal.modeling.terms.term import AXES, Proportional, Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.waves import expanded_lever

SERIES = 128
"""Highest order of a wave that is summed with its neighbours by a recurrence; others are computed one by one."""


@dataclass(frozen=True, eq=False)
class Chain(Locked):
    """A chain of joints: before each joint turns (slides) about its z, its frame is placed by a constant."""

    rotations: FloatArray
    """Shape (n, 3, 3). Attitude of each joint's frame in the one before, the first in the base link, with the joint's
    offset.
    """
    origins: FloatArray
    """Shape (n, 3). Its origin there, metres."""
    tip_rotation: FloatArray
    """Shape (3, 3)."""
    tip_place: FloatArray
    """Shape (3,). The tip link in the last joint's frame."""

    @staticmethod
    def from_arm(arm: Arm) -> Chain:
        """The chain of an arm's DHM table."""
        steps = np.array([_step(row) for row in arm.table.rows])
        steps[0] = arm.T_base_0 @ steps[0]
        return Chain(steps[:, :3, :3], steps[:, :3, 3], arm.T_last_tip[:3, :3], arm.T_last_tip[:3, 3])


@dataclass(frozen=True)
class Wave:
    """Cosine and sine of a multiple of one joint's commanded value, in the effective one."""

    joint: int
    cycles: float
    cosine: float
    sine: float


@dataclass(frozen=True)
class Bend:
    """``coefficient sin(sum of joints + phase)`` in the effective values of some joints (Nubiola 2011, eq. 5.14)."""

    coefficient: float
    phase: float
    joints: tuple[int, ...]
    targets: tuple[int, ...]


@dataclass(frozen=True)
class Lever:
    """``z . (sum of R_k v_k x g)`` about the axis of a joint, in the effective values of some joints.

    ``links`` are the k with a vector; the vectors hold the coefficients, radians.
    """

    joint: int
    targets: tuple[int, ...]
    links: tuple[int, ...]
    vectors: tuple[tuple[float, ...], ...]


def _step(row: Row) -> list[list[float]]:
    """`irbcal.modeling.dhm.DHMTable.step` of a row at zero, with exact quarter turns."""
    alpha, a, theta, d, beta, b, _ = row
    (ca, sa), (cb, sb), (ct, st) = (
        (0.0 if abs(cos(x)) <= QUARTER else cos(x), 0.0 if abs(sin(x)) <= QUARTER else sin(x))
        for x in (alpha, beta, theta)
    )
    x, y, z = (cb, sa * sb, -ca * sb), (0.0, ca, sa), (sb, -sa * cb, ca * cb)
    origin = (a, ca * b, sa * b)
    rows = [[ct * x[i] + st * y[i], ct * y[i] - st * x[i], z[i], origin[i] + d * z[i]] for i in range(3)]
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


def term_sums(terms: TermMap, payload_kg: float | None) -> dict[str, Any]:
    """What terms of a joint map come to for the warm arm, by the names that `irbcal.exporting.robot_numbers.Parts` has.

    Parameters
    ----------
    terms : TermMap
    payload_kg : float or None
        The mass that is carried where none is given.

    Raises
    ------
    CalibrationError
        If there are terms that are not known here.
    """
    n = len(terms.arm.joint_names)
    values: dict[str, Any] = {
        name: np.zeros(n) for name in ("gain", "offset", "compliance", "direction", "move", "share")
    }
    simple = {"q": "gain", "constant": "offset", "payload": "compliance"}
    proportional: dict[str, FloatArray] = {}
    simple |= {"move": "move", "share_of_move": "share", "direction": "direction"}
    widths: dict[int, float] = {}
    centres = set()
    waves: dict[tuple[int, float], list[float]] = {}
    levers: dict[tuple[int, tuple[int, ...]], dict[int, FloatArray]] = {}
    bends: list[Bend] = []
    pairs = [
        (summand, float(value))
        for term_of_map, value in zip(terms.terms, terms.coefficients, strict=True)
        for summand in (levers_of(term_of_map, terms.arm) if term_of_map.basis == "own_weight" else [term_of_map])
    ]
    for term, coefficient in pairs:
        if term.basis == "decay" or coefficient == 0.0:
            continue  # the arm is warm
        if term.basis == "gravity":
            link = int(str(term.parameters["link"])) - 1
            bend = _bend(term, link, coefficient, terms)
            if bend is not None:
                bends.append(bend)
                continue
            key = (term.joint, (term.joint, *term.also))
            vectors = levers.setdefault(key, {})
            vectors[link] = vectors.get(link, np.zeros(3)) + coefficient * np.array(vector_of(term))
            continue
        if term.also:
            raise _unknown(term)
        if term.basis in ("cos", "sin"):
            pair = waves.setdefault((term.joint, float(str(term.parameters["cycles_per_turn"]))), [0.0, 0.0])
            pair[term.basis == "sin"] += coefficient
        elif term.basis in simple:
            if term.basis == "direction":
                width = float(str(term.parameters.get("width_rad", term.parameters.get("width_m"))))
                if widths.setdefault(term.joint, width) != width:
                    raise _unknown(term)
            if term.basis == "payload":
                centres.add(tuple(np.asarray(term.parameters.get("place", (0.0, 0.0, 0.0)), dtype=float).tolist()))
            values[simple[term.basis]][term.joint] += coefficient
        elif isinstance(bases()[term.basis], Proportional):
            proportional.setdefault(bases()[term.basis].inputs[0].name, np.zeros(n))[term.joint] += coefficient
        else:
            raise _unknown(term)
    if len(centres) > 1:
        raise CalibrationError("payload terms with several places cannot be exported")
    cosine, sine, single = _series(waves, n)
    return values | {
        "nominal": Chain.from_arm(terms.arm),
        "cosine": cosine,
        "sine": sine,
        "waves": single,
        "bends": tuple(bends),
        "levers": tuple(
            Lever(joint, targets, tuple(sorted(v)), tuple(tuple(map(float, v[k])) for k in sorted(v)))
            for (joint, targets), v in levers.items()
        ),
        "gravity": np.array(terms.gravity, dtype=float),
        "compliance": STANDARD_GRAVITY * values["compliance"],
        "proportional": proportional,
        "payload_kg": payload_kg or 0.0,
        "payload_centre": np.array(next(iter(centres), (0.0, 0.0, 0.0))),
        "width": np.array([widths.get(j, 1.0) for j in range(n)]),
    }


def _bend(term: Term, link: int, coefficient: float, terms: TermMap) -> Bend | None:
    """A lever that is one sine of a sum of joints, as that; None for others."""
    expansion = expanded_lever(terms.arm, term.joint, link, vector_of(term), terms.gravity, most=1)
    if not expansion:
        return None
    ((turns, weight),) = expansion.items()
    if set(turns) != {0.0, 1.0}:
        return None
    joints = tuple(j for j, n in enumerate(turns) if n)
    return Bend(coefficient * abs(weight), float(np.angle(1j * weight)), joints, (term.joint, *term.also))


def _series(waves: dict[tuple[int, float], list[float]], n: int) -> tuple[FloatArray, FloatArray, tuple[Wave, ...]]:
    """Waves of whole low orders as series, shape (orders, n), and the others."""
    dense = {key: pair for key, pair in waves.items() if key[1] == int(key[1]) and 1 <= key[1] <= SERIES}
    orders = max((int(cycles) for _, cycles in dense), default=0)
    if orders > 4 * len({cycles for _, cycles in dense}):  # a few far apart
        dense, orders = {}, 0
    cosine, sine = np.zeros((orders, n)), np.zeros((orders, n))
    for (joint, cycles), pair in dense.items():
        cosine[int(cycles) - 1, joint], sine[int(cycles) - 1, joint] = pair
    sparse = tuple(Wave(j, cycles, *pair) for (j, cycles), pair in waves.items() if (j, cycles) not in dense)
    return cosine, sine, sparse


def _unknown(term: Term) -> CalibrationError:
    return CalibrationError(
        f"the joint map has a term ({term.name}) that exports do not know: calibrate with terms joint-map"
    )


def compiled(
    arm: Arm,
    sums: dict[str, Any] | None = None,
    limits: Arm | None = None,
    closed_form: FloatArray | None = None,
    reach: float = 1.0,
    more: dict[str, Any] | None = None,
    frame_terms: TermMap | None = None,
    depth: int | None = None,
) -> Any:
    """The compiled kernel of a robot; None where the kernel was not built or does not take such a robot.

    Parameters
    ----------
    arm : Arm
        Calibrated.
    sums : dict, optional
        Of `term_sums`; without, commanded joints are the effective ones.
    limits : Arm, optional
        Whose limits hold; the arm's own unless given.
    closed_form : ndarray, optional
        As `irbcal.modeling.inverse.orthoparallel.OrthoParallel.numbers` gives it.
    reach : float
        Metres by which errors of position are divided to weigh them against radians.
    more : dict, optional
        What the kernel's search needs: ``starts`` and ``difference``; ``stride`` of the lean on a way.
    frame_terms : TermMap, optional
        Of `Robot.frame_terms`.
    depth : int, optional
        How many joints carry what is computed: the link behind the last of them is the arm's tip; all unless given.
    """
    if kernel.Kernel is None or not 0 < len(arm.joint_names) <= kernel.MOST_JOINTS:
        return None
    bounds = arm if limits is None else limits
    values: dict[str, Any] = {
        "slides": arm.table.prismatic,
        "far": arm.farthest,
        "lower": bounds.lower,
        "upper": bounds.upper,
        "chain": _rows(Chain.from_arm(arm)),
    }
    vectors = list[tuple[float, ...]]()
    if sums is not None:
        names = ("gain", "offset", "cosine", "sine", "gravity", "compliance", "payload_kg", "payload_centre")
        values |= {name: sums[name] for name in (*names, "direction", "width", "move", "share")}
        values["torque"] = np.full(len(arm.joint_names), 1.0 if sums["proportional"] else 0.0)  # `stops` multiplies
        if len(sums["cosine"]) % 2:
            nothing = np.zeros((1, len(arm.joint_names)))
            values |= {name: np.vstack([sums[name], nothing]) for name in ("cosine", "sine")}
        n = len(arm.joint_names)
        levers = list[list[float]]()
        for lever in sums["levers"]:
            first = len(vectors)
            vectors += [(link, *vector) for link, vector in zip(lever.links, lever.vectors, strict=True)]
            levers.append([lever.joint, first, len(vectors) - 1, *_mask(lever.targets, n)])
        values |= {
            "nominal": _rows(sums["nominal"]),
            "waves": [(wave.joint, wave.cycles, wave.cosine, wave.sine) for wave in sums["waves"]],
            "bends": [[b.coefficient, b.phase, *_mask(b.joints, n), *_mask(b.targets, n)] for b in sums["bends"]],
            "levers": levers,
        }
    if frame_terms is not None:
        numbers = _frame_numbers(frame_terms, arm, vectors)
        if numbers is None or (sums is not None and not np.array_equal(numbers["gravity"], sums["gravity"])):
            return None
        values |= numbers
    values["link_vectors"] = vectors
    if depth is not None:
        values["depth"] = depth
    if closed_form is not None:
        values["closed_form"] = closed_form
    values |= {"reach": reach, **(more or {})}
    return kernel.of_robot({name: np.array(value, dtype=float) for name, value in values.items()})


def stops(
    q: FloatArray,
    previous: ArrayLike | None,
    given: Mapping[str, ArrayLike | None],
    sums: Mapping[str, Any] | None,
) -> tuple[FloatArray | None, ...] | None:
    """What is known of stops (n, joints) beside the commands, as the compiled kernel takes it; None: nothing.

    The stop before, mass and place of a payload, and what those of the sums (`term_sums`) that are proportional to an
    input add to each joint.
    """
    input_values: dict[str, ArrayLike] = given_inputs(given)
    if previous is None and not input_values:
        return None
    added: FloatArray | None = None
    for name, coefficients in sums["proportional"].items() if sums else ():
        if name in input_values:
            part = coefficients * inputs()[name].above(input_values[name], q.shape)
            added = part if added is None else added + part
    values = {"previous": (previous, q.shape), "payload_kg": (input_values.get("payload_kg"), q.shape[:1])}
    values |= {"payload_centre": (input_values.get("payload_centre"), (len(q), 3)), "": (added, q.shape)}
    return tuple(
        None if value is None else np.array(spread(value, shape, name)) for name, (value, shape) in values.items()
    )


def _frame_numbers(terms: TermMap, arm: Arm, vectors: list[tuple[float, ...]]) -> dict[str, Any] | None:
    """Frame terms as the compiled kernel takes them, link vectors joining those given; None where some are not known.

    Parameters
    ----------
    terms : TermMap
        Frame terms, functions of the nominal arm.
    arm : Arm
        Calibrated: its ``theta`` turns the frames that move.
    vectors : list of tuple
    """
    tilting: dict[tuple[int, float], FloatArray] = {}
    bending: dict[tuple[int, int], dict[int, FloatArray]] = {}
    for term, coefficient in zip(terms.terms, map(float, terms.coefficients), strict=True):
        if term.basis == "decay" or coefficient == 0.0:
            continue
        axis = AXES.index(term.axis)
        if term.also or term.basis not in ("cos", "sin", "gravity"):
            return None
        if term.basis == "gravity":
            links = bending.setdefault((term.joint, axis), {})
            link = int(str(term.parameters["link"])) - 1
            links[link] = links.get(link, np.zeros(3)) + coefficient * np.array(vector_of(term))
        else:
            pair = tilting.setdefault((term.joint, float(str(term.parameters["cycles_per_turn"]))), np.zeros((2, 6)))
            pair[int(term.basis == "sin"), axis] += coefficient

    def turned(motion: FloatArray, theta: float) -> list[float]:
        """Rotations and shifts along a frame's axes, along those that it has at the joint's zero."""
        c, s = cos(theta), sin(theta)
        (x, y, z), (u, v, w) = motion[:3], motion[3:]
        return [c * x + s * y, c * y - s * x, z, c * u + s * v, c * v - s * u, w]

    theta, nominal = arm.table.theta.tolist(), terms.arm.table.theta.tolist()
    bendings = []
    for (joint, axis), links in bending.items():
        first, unit = len(vectors), np.eye(6)[axis]
        vectors += [(link, *links[link]) for link in sorted(links)]
        about = turned(np.eye(6)[axis % 3], nominal[joint])[:3]
        bendings.append([joint, first, len(vectors) - 1, *about, *turned(unit, theta[joint])])
    rows = [
        [joint, cycles, *turned(pair[0], theta[joint]), *turned(pair[1], theta[joint])]
        for (joint, cycles), pair in tilting.items()
    ]
    return {
        "tiltings": rows,
        "bendings": bendings,
        "along": arm.table.d,
        "nominal": _rows(Chain.from_arm(terms.arm)),
        "gravity": terms.gravity,
    }


def _mask(joints: tuple[int, ...], n: int) -> list[bool]:
    return [j in joints for j in range(n)]


def _rows(chain: Chain) -> FloatArray:
    """Rotations and places of the joints' frames and, last, of the tip, shape (joints + 1, 3, 4)."""
    rotations = np.concatenate([chain.rotations, chain.tip_rotation[None]])
    places = np.concatenate([chain.origins, chain.tip_place[None]])
    return np.concatenate([rotations, places[:, :, None]], axis=2)
