"""What a calibrated robot is made of, as plain numbers that any language can hold: the source of all exports.

Joints count from 0, lengths are metres, angles radians. Terms are summed up by `irbcal.modeling.term_sums`.
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
from irbcal.modeling.robot import Robot
from irbcal.modeling.term_sums import Bend, Chain, Lever, Wave, term_sums
from irbcal.modeling.terms import bases, inputs
from irbcal.modeling.terms.direction import WIDTHS
from irbcal.modeling.terms.term import Proportional


@dataclass(frozen=True, eq=False)
class ExportFiles(Locked):
    """The files of an export."""

    files: Mapping[str, bytes]
    """By their names in the folder."""
    notes: tuple[str, ...] = ()
    """What is not in them though the calibration's URDF has it."""


VERSION = "irbcal-export-1"
"""Name of the layout of exports; it changes when what they offer does."""
TESTS = 24
"""Test vectors in an export."""


@dataclass(frozen=True, eq=False)
class RobotNumbers(Locked):
    """A calibrated robot as numbers."""

    name: str
    base_link: str
    tip_link: str
    joint_names: tuple[str, ...]
    slides: BoolArray
    """Shape (n,). Prismatic joints."""
    lower: FloatArray
    upper: FloatArray
    """Shape (n,). Limits of commanded joints; may be infinite."""
    speed: FloatArray
    """Shape (n,). Largest joint speeds, per second; infinite where not known."""
    coupling: FloatArray
    """Shape (n, n). The joints here from those that the controller counts."""
    chain: Chain
    nominal: Chain
    """Calibrated geometry, and the nominal one that gravity and loads are reckoned with."""
    gain: FloatArray
    offset: FloatArray
    """Shape (n,)."""
    cosine: FloatArray
    sine: FloatArray
    """Shape (orders, n). Series of orders 1, 2, … of each joint."""
    waves: tuple[Wave, ...]
    """Waves outside the series."""
    bends: tuple[Bend, ...]
    levers: tuple[Lever, ...]
    gravity: FloatArray
    """Shape (3,). Direction in the base link."""
    compliance: FloatArray
    """Shape (n,). Under the payload, rad/(N m)."""
    payload_kg: float
    payload_centre: FloatArray
    """Shape (3,). What is carried where nothing is said: mass, and its centre in the tip link."""
    proportional: Mapping[str, tuple[float, FloatArray, bool]]
    """By the names of inputs: their usual value (SI units), what joints turn on by what is above it, shape (n,), and
    whether each joint has a value."""
    direction: FloatArray
    width: FloatArray
    move: FloatArray
    share: FloatArray
    """Shape (n,). Of the last move: coefficient and width of its direction, coefficients of itself and of its share."""
    fingerprint: str = ""
    """Of the calibration."""
    simulated: bool = False
    """Whether it comes from SIMULATED data."""
    notes: tuple[str, ...] = ()
    """What the reader of an export should know."""

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
    def torque(self) -> FloatArray:
        """Compliance under reported torques, rad/(N m); a `CalibrationError` where C++ does not know what matters."""
        others = [name for name, (_, turned, _) in self.proportional.items() if turned.any() and name != "torques"]
        if others:
            raise CalibrationError(f"the joint map depends on {', '.join(others)}, which exports in C++ do not know")
        return self.proportional["torques"][1]

    @property
    def stride(self) -> FloatArray:
        """Length of the moves that stand for where the arm came from on a way, shape (n,).

        Three widths in which a joint takes up its play: there a joint that turns back leans over smoothly.
        """
        return 3.0 * np.where(self.slides, WIDTHS["m"], WIDTHS["rad"])

    @property
    def reach(self) -> float:
        """A length that weighs positions against rotations: what the links measure together, at least a decimetre."""
        lengths = np.linalg.norm(self.chain.origins, axis=1).sum() + np.linalg.norm(self.chain.tip_place)
        return max(0.1, float(lengths))

    @property
    def version(self) -> str:
        """Layout and maker of an export."""
        return f"{VERSION}, irbcal {__version__}"

    @staticmethod
    def from_robot(
        robot: Robot,
        *,
        speed: FloatArray | None = None,
        fingerprint: str = "",
        simulated: bool = False,
        notes: Sequence[str] = (),
    ) -> RobotNumbers:
        """The numbers of a calibrated robot without frame terms.

        Parameters
        ----------
        robot : Robot
        speed : ndarray, shape (n,), optional
            Largest joint speeds; infinite unless given.
        fingerprint, simulated, notes
            See `RobotNumbers`.

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
            "chain": Chain.from_arm(arm),
        }
        source = {"fingerprint": fingerprint, "simulated": simulated, "notes": tuple(notes)}
        numbers = term_sums(robot.joint_map.terms, robot.joint_map.payload_kg)
        proportional = numbers["proportional"]
        numbers["proportional"] = {
            name: (quantity.usual, proportional.get(name, np.zeros(n)), quantity.of_joints)
            for name, quantity in inputs().items()
            if any(isinstance(basis, Proportional) and quantity in basis.inputs for basis in bases().values())
        }
        return RobotNumbers(**(common | numbers | source))

    def carrying(self, payload_kg: float, payload_at: FloatArray | None = None) -> RobotNumbers:
        """The same with another load where none is given."""
        where = self.payload_centre if payload_at is None else payload_at
        return replace(self, payload_kg=payload_kg, payload_centre=np.asarray(where, dtype=float))


@dataclass(frozen=True, eq=False)
class Vectors(Locked):
    """Test vectors of an export, n rows each."""

    q: FloatArray
    inputs: Mapping[str, FloatArray]
    """``previous``, NaN where the stop before is not known, ``payload_kg``, …, n rows each."""
    effective: FloatArray
    """Shape (n, joints)."""
    tip: FloatArray
    """Shape (n, 3, 4). Rotation and place of the tip link in the base link."""

    def __len__(self) -> int:
        return len(self.q)


def vectors_of(robot: Robot, numbers: RobotNumbers) -> Vectors:
    """Test vectors by irbcal's own kinematics at random joints: with and without the stop before, with several loads.

    Parameters
    ----------
    robot : Robot
    numbers : RobotNumbers
        Of this robot.
    """
    rng, several = np.random.default_rng(1), bool(numbers.compliance.any())
    payload_at = np.tile(numbers.payload_centre, (TESTS, 1))
    if several:
        payload_at = payload_at + 0.1 * rng.uniform(-1, 1, payload_at.shape)
    q, previous, load = robot.arm.random_stops(TESTS, numbers.payload_kg, several)
    previous[::4] = np.nan
    previous[1::4] = q[1::4] - 0.01 * previous[1::4]  # short moves
    inputs = {"previous": previous, "payload_kg": load, "payload_centre": payload_at}
    for name, (usual, turned, of_joints) in numbers.proportional.items():
        shape = q.shape if of_joints else q.shape[:1]
        inputs[name] = usual + (rng.normal(0.0, 50.0, shape) if turned.any() else np.zeros(shape))
    effective = np.array(robot.joint_map.effective(q, **inputs), dtype=float)
    return Vectors(q, inputs, effective, robot.replace(frame_terms=None).forward(q, **inputs)[:, :3])


LANGUAGES = {"py": literals.python, "hpp": literals.cpp, "cpp": literals.cpp}
"""By the ending of a template's name, before ``.j2``."""


def render(template: str, numbers: RobotNumbers, vectors: Vectors, **more: Any) -> bytes:
    """A file of an export.

    Parameters
    ----------
    template : str
        In the folder ``templates``.
    numbers : RobotNumbers
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
    text = environment.get_template(template).render(
        numbers=numbers, vectors=vectors, n=len(numbers.joint_names), **more
    )
    return text.encode("utf-8")


ARRAYS = (
    *("slides", "lower", "upper", "speed", "coupling", "gravity", "gain", "offset", "compliance"),
    *("direction", "width", "move", "share", "stride"),
)
"""Of `RobotNumbers`, taken as they are."""


def constants(numbers: RobotNumbers, vectors: Vectors) -> dict[str, Any]:
    """The constants of a calibration, by their names: what `plain.Plain` and `batch.Batch` are made of.

    Returns
    -------
    dict
        Metres, radians, kilograms, in numbers, texts, tuples and dicts of Python.
    """
    chains = {
        name: {
            "R": chain.rotations.tolist(),
            "p": chain.origins.tolist(),
            "tip_R": chain.tip_rotation.tolist(),
            "tip_p": chain.tip_place.tolist(),
        }
        for name, chain in (("CHAIN", numbers.chain), ("NOMINAL", numbers.nominal))
    }
    return {
        "VERSION": numbers.version,
        "FINGERPRINT": numbers.fingerprint,
        "SIMULATED": numbers.simulated,
        "JOINT_NAMES": numbers.joint_names,
        "BASE_LINK": numbers.base_link,
        "TIP_LINK": numbers.tip_link,
        "JOINTS": len(numbers.joint_names),
        "REACH": numbers.reach,
        **{name.upper(): getattr(numbers, name).tolist() for name in ARRAYS},
        **chains,
        "SERIES": [_pairs(numbers.cosine[:, j], numbers.sine[:, j]) for j in range(len(numbers.joint_names))],
        "WAVES": [(w.joint, w.cycles, w.cosine, w.sine) for w in numbers.waves],
        "BENDS": [(b.coefficient, b.phase, b.joints, b.targets) for b in numbers.bends],
        "LEVERS": [
            (lever.joint, lever.targets, [*zip(lever.links, lever.vectors, strict=True)]) for lever in numbers.levers
        ],
        "PAYLOAD_KG": numbers.payload_kg,
        "PAYLOAD_CENTRE": numbers.payload_centre.tolist(),
        "HAS_HISTORY": numbers.has_history,
        "PROPORTIONAL": {name: (usual, c.tolist(), each) for name, (usual, c, each) in numbers.proportional.items()},
        "TESTS": {name: getattr(vectors, name).tolist() for name in ("q", "effective", "tip")}
        | {"inputs": {name: values.tolist() for name, values in vectors.inputs.items()}},
    }


def _pairs(cosine: FloatArray, sine: FloatArray) -> list[tuple[float, float]]:
    """Cosine and sine of a joint's series, without the zeros at its end."""
    pairs = [*zip(cosine.tolist(), sine.tolist(), strict=True)]
    while pairs and pairs[-1] == (0.0, 0.0):
        pairs.pop()
    return pairs
