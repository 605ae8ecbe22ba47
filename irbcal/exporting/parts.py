"""What a calibrated robot is made of, as plain numbers that any language can hold: the source of all exports.

Joints count from 0, lengths are metres, angles radians. What `irbcal.modeling` keeps as terms is summed up here: gains,
series of cosines and sines, levers of gravity by link, compliances under a payload and under torques, and what the last
move does.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from irbcal import __version__, literals
from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.errors import CalibrationError
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import bases
from irbcal.modeling.terms.direction import WIDTHS
from irbcal.modeling.terms.payload import STANDARD_GRAVITY
from irbcal.modeling.terms.situation import GRAVITY
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap


@dataclass(frozen=True, eq=False)
class ExportFiles(Locked):
    """The files of an export.

    Attributes
    ----------
    files : mapping of str to bytes
        By their names in the folder.
    notes : tuple of str
        What is not in them though the calibration's URDF has it.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()


VERSION = "irbcal-export-1"
"""Name of the layout of exports; it changes when what they offer does."""
SERIES = 64
"""Highest order of a wave that is summed with its neighbours by a recurrence; others are computed one by one."""
TESTS = 24
"""Test vectors in an export."""


@dataclass(frozen=True, eq=False)
class Chain(Locked):
    """A chain of joints: before each joint turns (slides) about its z, its frame is placed by a constant.

    Attributes
    ----------
    rotations : ndarray, shape (n, 3, 3)
        Attitude of each joint's frame in the one before, the first in the base link, with the joint's offset.
    places : ndarray, shape (n, 3)
        Its origin there, metres.
    tip_rotation : ndarray, shape (3, 3)
    tip_place : ndarray, shape (3,)
        The tip link in the last joint's frame.
    """

    rotations: FloatArray
    places: FloatArray
    tip_rotation: FloatArray
    tip_place: FloatArray

    @staticmethod
    def of(arm: Arm) -> Chain:
        """The chain of an arm's DHM table."""
        steps = [arm.table.step(i) for i in range(len(arm.table))]
        steps[0] = arm.T_base_0 @ steps[0]
        T = np.array(steps)
        return Chain(T[:, :3, :3], T[:, :3, 3], arm.T_last_tip[:3, :3], arm.T_last_tip[:3, 3])


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


@dataclass(frozen=True, eq=False)
class Parts(Locked):
    """A calibrated robot as numbers.

    Attributes
    ----------
    name, identifier : str
        The robot's name, and the same as a name in a program.
    base_link, tip_link : str
    joint_names : tuple of str
    slides : ndarray of bool, shape (n,)
        Prismatic joints.
    lower, upper : ndarray, shape (n,)
        Limits of commanded joints; may be infinite.
    speed : ndarray, shape (n,)
        Largest joint speeds, per second; infinite where not known.
    coupling : ndarray, shape (n, n)
        The joints here from those that the controller counts.
    chain, nominal : Chain
        Calibrated geometry, and the nominal one that gravity and loads are reckoned with.
    gain, offset : ndarray, shape (n,)
    cosine, sine : ndarray, shape (orders, n)
        Series of orders 1, 2, … of each joint.
    waves : tuple of Wave
        Waves outside the series.
    bends : tuple of Bend
    levers : tuple of Lever
    gravity : ndarray, shape (3,)
        Direction in the base link.
    compliance : ndarray, shape (n,)
        Under the payload, rad/(N m).
    payload_kg : float
    payload_place : ndarray, shape (3,)
        What is carried where nothing is said: mass, and its centre in the tip link.
    torque : ndarray, shape (n,)
        Compliance under the torques that the robot reports, rad/(N m).
    direction, width, move, share : ndarray, shape (n,)
        Of the last move: coefficient and width of its direction, coefficients of itself and of its share.
    fingerprint : str
        Of the calibration.
    simulated : bool
        Whether it comes from SIMULATED data.
    notes : tuple of str
        What the reader of an export should know.
    """

    name: str
    base_link: str
    tip_link: str
    joint_names: tuple[str, ...]
    slides: BoolArray
    lower: FloatArray
    upper: FloatArray
    speed: FloatArray
    coupling: FloatArray
    chain: Chain
    nominal: Chain
    gain: FloatArray
    offset: FloatArray
    cosine: FloatArray
    sine: FloatArray
    waves: tuple[Wave, ...]
    bends: tuple[Bend, ...]
    levers: tuple[Lever, ...]
    gravity: FloatArray
    compliance: FloatArray
    payload_kg: float
    payload_place: FloatArray
    torque: FloatArray
    direction: FloatArray
    width: FloatArray
    move: FloatArray
    share: FloatArray
    fingerprint: str = ""
    simulated: bool = False
    notes: tuple[str, ...] = ()

    @property
    def identifier(self) -> str:
        """The robot's name as a name in a program."""
        word = re.sub(r"[^0-9a-z]+", "_", self.name.lower()).strip("_") or "robot"
        return word if word[0].isalpha() else f"robot_{word}"

    @property
    def has_history(self) -> bool:
        """Whether the last move matters."""
        return bool(self.direction.any() or self.move.any() or self.share.any())

    @property
    def stride(self) -> FloatArray:
        """Length of the moves that stand for where the arm came from on a way, shape (n,).

        Three widths in which a joint takes up its play: there a joint that turns back leans over smoothly.
        """
        return 3.0 * np.where(self.slides, WIDTHS["m"], WIDTHS["rad"])

    @property
    def reach(self) -> float:
        """A length that weighs positions against rotations: what the links measure together, at least a decimetre."""
        lengths = np.linalg.norm(self.chain.places, axis=1).sum() + np.linalg.norm(self.chain.tip_place)
        return max(0.1, float(lengths))

    @property
    def version(self) -> str:
        """Layout and maker of an export."""
        return f"{VERSION}, irbcal {__version__}"

    @staticmethod
    def of(
        robot: Robot,
        *,
        nominal: Arm | None = None,
        speed: FloatArray | None = None,
        fingerprint: str = "",
        simulated: bool = False,
        notes: Sequence[str] = (),
    ) -> Parts:
        """The parts of a calibrated robot without frame terms.

        Parameters
        ----------
        robot : Robot
        nominal : Arm, optional
            That of the terms of the joint map, if there are any; else the robot's own unless given.
        speed : ndarray, shape (n,), optional
            Largest joint speeds; infinite unless given.
        fingerprint, simulated, notes
            See `Parts`.

        Raises
        ------
        CalibrationError
            If its joint map has terms that exports do not know.
        """
        arm, n = robot.arm, len(robot.arm.joint_names)
        common: dict[str, Any] = {
            "name": arm.name,
            "base_link": arm.base_link,
            "tip_link": arm.tip_link,
            "joint_names": arm.joint_names,
            "slides": arm.table.prismatic,
            "lower": arm.lower,
            "upper": arm.upper,
            "speed": np.full(n, np.inf) if speed is None else speed,
            "coupling": np.eye(n) if arm.coupling is None else arm.coupling,
            "chain": Chain.of(arm),
        }
        empty: dict[str, Any] = {
            name: np.zeros(n) for name in ("gain", "offset", "compliance", "torque", "direction", "move", "share")
        }
        empty |= {"cosine": np.zeros((0, n)), "sine": np.zeros((0, n)), "width": np.ones(n)}
        empty |= {"waves": (), "bends": (), "levers": (), "gravity": np.array(GRAVITY)}
        empty |= {"payload_kg": 0.0, "payload_place": np.zeros(3), "nominal": Chain.of(nominal or arm)}
        source = {"fingerprint": fingerprint, "simulated": simulated, "notes": tuple(notes)}
        return Parts(**(common | empty | _of_terms(robot.joint_map, n) | source))

    def carrying(self, payload_kg: float, payload_at: FloatArray | None = None) -> Parts:
        """The same with another load where none is told."""
        where = self.payload_place if payload_at is None else payload_at
        return replace(self, payload_kg=payload_kg, payload_place=np.asarray(where, dtype=float))


def _of_terms(joint_map: JointMap, n: int) -> dict[str, Any]:
    terms = joint_map.terms
    values: dict[str, Any] = {
        name: np.zeros(n) for name in ("gain", "offset", "compliance", "torque", "direction", "move", "share")
    }
    simple = {"q": "gain", "constant": "offset", "payload": "compliance", "torque": "torque"}
    simple |= {"move": "move", "share_of_move": "share", "direction": "direction"}
    widths: dict[int, float] = {}
    centres = set()
    waves: dict[tuple[int, float], list[float]] = {}
    levers: dict[tuple[int, tuple[int, ...]], dict[int, FloatArray]] = {}
    bends: list[Bend] = []
    for term, coefficient in zip(terms.terms, map(float, terms.coefficients), strict=True):
        if term.basis == "decay" or coefficient == 0.0:
            continue  # the arm is warm
        if term.basis == "gravity":
            bend = _bend(term, coefficient, terms)
            if bend is not None:
                bends.append(bend)
                continue
            key = (term.joint, (term.joint, *term.also))
            vectors = levers.setdefault(key, {})
            link = int(str(term.parameters["link"])) - 1
            vectors[link] = vectors.get(link, np.zeros(3)) + coefficient * _vector(term)
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
        else:
            raise _unknown(term)
    if len(centres) > 1:
        raise CalibrationError("payload terms with several places cannot be exported")
    cosine, sine, single = _series(waves, n)
    return values | {
        "nominal": Chain.of(terms.arm),
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
        "payload_kg": joint_map.payload_kg or 0.0,
        "payload_place": np.array(next(iter(centres), (0.0, 0.0, 0.0))),
        "width": np.array([widths.get(j, 1.0) for j in range(n)]),
    }


def _bend(term: Term, coefficient: float, terms: TermMap) -> Bend | None:
    """A lever that is one sine of a sum of joints, as that; None for others."""
    expansion = bases()[term.basis].expansion(term, terms.arm, terms.gravity)
    if expansion is None or len(expansion) != 1:
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


def _vector(term: Term) -> FloatArray:
    vector = term.parameters["vector"]
    return np.eye(3)["xyz".index(vector)] if isinstance(vector, str) else np.asarray(vector, dtype=float)


def _unknown(term: Term) -> CalibrationError:
    return CalibrationError(
        f"the joint map has a term ({term.name}) that exports do not know: calibrate with terms joint-map"
    )


@dataclass(frozen=True, eq=False)
class Vectors(Locked):
    """Test vectors of an export, n rows each.

    Attributes
    ----------
    q, previous, torques, effective : ndarray, shape (n, joints)
        ``previous`` is NaN where the stop before is not known.
    payload_kg : ndarray, shape (n,)
    payload_place : ndarray, shape (n, 3)
    tip : ndarray, shape (n, 3, 4)
        Rotation and place of the tip link in the base link.
    """

    q: FloatArray
    previous: FloatArray
    payload_kg: FloatArray
    payload_place: FloatArray
    torques: FloatArray
    effective: FloatArray
    tip: FloatArray

    def __len__(self) -> int:
        return len(self.q)


def vectors_of(robot: Robot, parts: Parts, n: int = TESTS, seed: int = 1) -> Vectors:
    """Test vectors by irbcal's own kinematics at random joints: with and without the stop before, with several loads.

    Parameters
    ----------
    robot : Robot
    parts : Parts
        Of this robot.
    n : int
    seed : int
    """
    rng = np.random.default_rng(seed)
    q, previous = robot.arm.random_joints(n, seed), robot.arm.random_joints(n, seed + 1)
    previous[::4] = np.nan
    previous[1::4] = q[1::4] - 0.01 * previous[1::4]  # short moves
    load, payload_at = np.full(n, parts.payload_kg), np.tile(parts.payload_place, (n, 1))
    torques = np.zeros(q.shape)
    if parts.compliance.any():
        load, payload_at = load + np.arange(n) % 5, payload_at + 0.1 * rng.uniform(-1, 1, (n, 3))
    if parts.torque.any():
        torques = rng.normal(0.0, 50.0, q.shape)
    situation = (previous, load, payload_at, torques)
    effective = np.array(robot.joint_map.effective(q, *situation), dtype=float)
    tip = robot.replace(frame_terms=None).forward(q, *situation)[:, :3]
    return Vectors(q, previous, load, payload_at, torques, effective, tip)


LANGUAGES = {"py": literals.python, "hpp": literals.cpp, "cpp": literals.cpp}
"""By the ending of a template's name, before ``.j2``."""


def render(template: str, parts: Parts, vectors: Vectors, **more: Any) -> bytes:
    """A file of an export.

    Parameters
    ----------
    template : str
        In the folder ``templates``.
    parts : Parts
    vectors : Vectors
    **more
        What else the template names.

    Returns
    -------
    bytes
        UTF-8.
    """
    from irbcal.templates import environment as templates

    environment = templates("irbcal.exporting", literal=LANGUAGES[template.split(".")[-2]])
    environment.filters |= {"comment": literals.comment, "word": literals.word}
    text = environment.get_template(template).render(parts=parts, vectors=vectors, n=len(parts.joint_names), **more)
    return text.encode("utf-8")
