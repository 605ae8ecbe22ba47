"""What each device would leave of a robot's position error, before anything is bought.

A calculation, no measurement (``irbcal plan --compare-devices``): the arm's geometry is uncertain by its natural sizes,
each device shows what its rows show with its noise, and the rest stays as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.files.opening import RobotLike, open_robot
from irbcal.identification.constraint_kind import cross
from irbcal.identification.constraint_problem import TOOL, ConstraintProblem, FeatureState, Key
from irbcal.identification.devices import BALL, DEVICES, placed, poses, rows_table, values
from irbcal.measurement import features
from irbcal.measurement.features import FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.term_map import term_columns
from irbcal.options import number
from irbcal.options import seed as check_seed
from irbcal.summary import Speaks, Table, Told
from irbcal.units import MM

if TYPE_CHECKING:
    from irbcal.planning.choosing import Step

POSES = (25, 50, 100)
"""Numbers of poses that are compared."""

SAMPLES = 300
"""Random poses on which the error that is left counts."""

TRACKER, TRACKER_NOISE = "tracker", 0.03 * MM


@dataclass(frozen=True)
class Left:
    """What one device leaves.

    Attributes
    ----------
    device, words : str
    poses : int
    noise, left : float
        Standard deviation of a coordinate, and root mean square error of positions that is left, metres.
    """

    device: str
    words: str
    poses: int
    noise: float
    left: float


@dataclass(frozen=True, eq=False, repr=False)
class DeviceComparison(Speaks):
    """What devices leave of a robot's position error.

    Attributes
    ----------
    robot : str
    before : float
        Root mean square error without any, metres.
    rows : tuple of Left
        Best first, by the largest number of poses.
    missing : tuple of str
        Devices that the arm does not reach, in sentences.
    """

    robot: str
    before: float
    rows: tuple[Left, ...]
    missing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """A row for each device, a column for each number of poses."""
        counts = sorted({row.poses for row in self.rows})
        devices = list(dict.fromkeys((row.device, row.words, row.noise) for row in self.rows))
        left = {(row.device, row.poses): row.left / MM for row in self.rows}
        cells = tuple(
            (device, words, noise / MM, *(left.get((device, count)) for count in counts))
            for device, words, noise in devices
        )
        columns = ("device", "what it is", "noise", *(f"{count} poses" for count in counts))
        return [
            f"{self.robot}: position error before calibration {self.before / MM:.2f} mm (root mean square over the "
            "whole range, geometry uncertain by its natural sizes)",
            Table("Predicted position error that each device leaves, mm", columns, cells),
            "Calculated, not measured: what no error model describes is not in it, and remains.",
            *(f"Note: {text}" for text in self.missing),
        ]

    def to_frame(self) -> pd.DataFrame:
        """A row for each device and number of poses: ``device``, ``words``, ``poses``, ``noise_mm``, ``left_mm``."""
        frame = pd.DataFrame([asdict(row) for row in self.rows])
        frame["noise"], frame["left"] = frame["noise"] / MM, frame["left"] / MM
        return frame.rename(columns={"noise": "noise_mm", "left": "left_mm"})

    def to_dict(self) -> dict[str, Any]:
        """For JSON: millimetres."""
        return {
            "robot": self.robot,
            "before_mm": self.before / MM,
            "devices": self.to_frame().to_dict("records"),
            "notes": list(self.missing),
        }


def compare_devices(
    robot: RobotLike,
    poses: Sequence[int] = POSES,
    *,
    noise: float | None = None,
    seed: int = 0,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    progress: Step | None = None,
) -> DeviceComparison:
    """Predict the position error that a tracker and each device in its place would leave.

    Parameters
    ----------
    robot : str, Path or calibration
    poses : sequence of int
        Numbers of poses to compare.
    noise : float, optional
        Standard deviation of a coordinate for all devices, metres; what is plausible for each unless given.
    seed : int
        Of the random poses.
    base_link, tip_link, coupling
        See `irbcal.read_urdf`.
    progress : callable, optional
        Called with a text at the beginning of each step.

    Returns
    -------
    DeviceComparison

    Raises
    ------
    OptionError
        If an option makes no sense.

    Examples
    --------
    >>> print(compare_devices("irb1600"))  # doctest: +SKIP
    """
    check_seed(seed)
    counts = [number("poses", count, 5, 100_000, whole=True) for count in poses]
    arm = open_robot(robot, base_link=base_link, tip_link=tip_link, coupling=coupling).robot.arm
    say: Callable[[str], object] = progress or (lambda text: None)
    work = _Work(arm, seed)
    rows: list[Left] = []
    missing: list[str] = []
    for name in (TRACKER, *DEVICES):
        say(name)
        for count in counts:
            try:
                seen, own, spread = work.tracked(count) if name == TRACKER else work.at(name, count)
            except IdentificationError as error:
                missing.append(str(error))
                continue
            spread = spread if noise is None else number("noise", noise, 1e-7, 0.01)
            words = "laser tracker, one reflector" if name == TRACKER else DEVICES[name].words
            rows.append(Left(name, words, count, spread, work.left(seen, own, spread)))
    most = {row.device: row.left for row in rows}
    rows.sort(key=lambda row: most[row.device])
    return DeviceComparison(arm.name, work.before, tuple(rows), tuple(missing))


class _Work:
    """The arm with its prior, and positions on which errors count."""

    def __init__(self, arm: Arm, seed: int) -> None:
        self.arm, self.seed = arm, seed
        self.terms = GEOMETRY.terms(arm)
        q = arm.random_joints(SAMPLES, seed + 7)
        path = chain.walk(arm, q)
        p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], np.array(BALL))
        pose = np.arange(SAMPLES)
        columns = chain.point_columns(path, p, pose, constant=True)
        J = np.concatenate([path.tip[:3], term_columns(self.terms, columns, np.ones((len(self.terms), SAMPLES)), pose)])
        J *= np.r_[np.full(3, MM), [term.size for term in self.terms]][:, None, None]
        B = np.concatenate([-cross(p.T), np.broadcast_to(np.eye(3), (SAMPLES, 3, 3))], axis=2).reshape(-1, 6)
        across = J.transpose(0, 2, 1).reshape(len(J), -1)
        across = across - (across @ B) @ np.linalg.pinv(B)
        self.G = across @ across.T / SAMPLES
        self.before = float(np.sqrt(np.trace(self.G[3:, 3:])))

    def tracked(self, count: int) -> tuple[FeatureSet, dict[Key, FloatArray], float]:
        """Random poses that a tracker sees, its frame being the base link's."""
        q = self.arm.random_joints(count, self.seed)
        T = self.arm.forward(q)
        xyz = (T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)) / MM
        units = self.arm.joint_units
        table = pd.DataFrame(self.arm.to_controller(q) / units, columns=self.arm.joint_columns)
        table = table.assign(pose=np.arange(count), x_mm=xyz[:, 0], y_mm=xyz[:, 1], z_mm=xyz[:, 2], feature="")
        return features.read(table, None, self.arm), {}, TRACKER_NOISE

    def at(self, name: str, count: int) -> tuple[FeatureSet, dict[Key, FloatArray], float]:
        """Poses at a device."""
        found = placed(self.arm, DEVICES[name])
        q, which = poses(self.arm, found, count, self.seed)
        table = rows_table(self.arm, found, q, which, values(self.arm, found, q, which))
        own = {(key, of): value for of, pair in found.own.items() for key, value in pair.items()}
        return features.read(table, found.table(), self.arm), own, DEVICES[name].noise

    def left(self, seen: FeatureSet, own: dict[Key, FloatArray], noise: float) -> float:
        """Root mean square error of positions after these rows, metres."""
        u95 = np.full(len(seen), 1.96 * noise)
        seen = replace(seen, u95=u95)
        problem = ConstraintProblem(self.arm, seen, self.terms)
        state = FeatureState({**own, (TOOL, features.TARGET): np.array(BALL)}, np.zeros(len(self.terms)))
        H = problem.sums(state).H * (MM / noise) ** 2
        flat = problem.flat
        prior = np.r_[np.full(flat, 1e-8), np.ones(len(self.terms))]
        scale = 1.0 / np.sqrt(np.diagonal(H) + prior)
        C = np.linalg.inv((H + np.diag(prior)) * np.outer(scale, scale)) * np.outer(scale, scale)
        at = problem.layout[TOOL, features.TARGET][1]
        columns = np.r_[at : at + 3, flat : flat + len(self.terms)]
        return float(np.sqrt(np.sum(self.G * C[np.ix_(columns, columns)])))
