"""What a maker's controllers have in common: how they write poses and joints, and which joints a posture means.

Two facts of an arm stand in no URDF and come from the language: how the controller's joints map to those of the URDF
(``q = matrix @ p``, FANUC measures joint 3 against the ground), and which solution a configuration word names. Both
hold for arms whose axes point as those of the maker's public URDFs do; other arms are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.correction.notation import Orientation
from irbcal.errors import ProgramError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.coupling import from_controller, to_controller
from irbcal.modeling.inverse import any_arm, closed_form, nearly_closed_form
from irbcal.modeling.inverse.branches import Branches
from irbcal.modeling.robot import Robot
from irbcal.units import DEG

EDGE = 0.05 * DEG
"""Radians by which the rounding of a program's numbers may put an axis beyond the edge that its posture names."""

FAR_BEYOND_LIMIT = 10 * DEG
"""Radians beyond a joint limit from which on joints are none of this arm."""

TURNS = 2 * np.pi * np.array([0, -1, 1, -2, 2])
NO_POSTURE = "nothing says which of the arm's solutions is meant: no configuration, and no known stop just before it"
EITHER = "which one the controller takes is not sure"
FARTHEST_POSE, FARTHEST_TOOL = 100.0, 10.0
"""Metres that no target and no tool is from a robot's base, or its flange."""
FARTHEST = 170 * DEG
"""Radians by which a joint may turn from one stop to the next where no configuration says to which side."""
NO_CONFDATA = "its configuration data fit no solution of the robot within the joint limits"
NO_SOLUTION = "its configuration fits no solution of the robot within the joint limits"
NO_REACH = "the nominal robot does not reach it within its joint limits in this configuration"


class Posture(NamedTuple):
    """Which of the solutions of a pose is meant; None where the program does not say."""

    rear: bool | None = None
    """Whether the wrist centre lies behind axis 1."""
    bent: bool | None = None
    """Whether the forearm is bent to the other side of the upper arm's line than in `Maker.reference`."""
    wrist: int | None = None
    """Sign of joint 5 as the controller counts it."""
    low: tuple[float, ...] = (-np.inf,) * 6
    high: tuple[float, ...] = (np.inf,) * 6
    """Between which the joints lie as the controller counts them, radians."""

    @property
    def complete(self) -> bool:
        """Whether it names one solution, turns aside."""
        return None not in (self.rear, self.bent, self.wrist)


@dataclass(frozen=True, eq=False)
class Maker(Locked):
    """A maker's way to write targets."""

    name: str
    orientation: Orientation
    length: float
    angle: float
    joint: float
    """SI value of one unit of positions, orientations and joints."""
    decimals: tuple[int, int, int]
    """Least decimals written for positions, orientations and joints."""
    axes: tuple[str, ...]
    """Directions of the six axes in the base link at zero joints of the URDF, ``+z`` and so on; empty: any."""
    matrix: FloatArray
    """Shape (6, 6). Joints of the URDF from those of the controller."""
    reference: tuple[float, ...] = (0.0,) * 6
    """Joints of the controller, degrees, with the wrist in front and the elbow to the side that ``bent`` false means.
    """
    aligned: bool = False
    """Whether numbers keep their right edge, with blanks before them."""
    world: bool = False
    """Whether the controller's world need not be the arm's base link, so that the URDF must name it."""
    wrist_axis: int = 5
    """The joint (from 1) that tells the two wrists from one another: 5 by its sign, 4 by whether it is within 90
    degrees of zero (that counts as negative).
    """
    pulses: bool = False
    """Whether joints are written in pulses, of which each robot has its own number per degree."""
    asks_where: bool = False
    """Whether the controller's base and flange are told by a pair of joints and pose, because no URDF names them."""
    largest: float = 1e6
    """Numbers as large stand for no place, and for no axis."""

    def check(self, arm: Arm, source: str) -> None:
        """Refuse arms whose joints need not be those of this maker's controllers.

        Raises
        ------
        ProgramError
            If it is not six revolute joints that point as in the maker's URDFs.
        """
        if not arm.six_revolute:
            raise ProgramError(
                f"{self.name} targets are of six revolute joints, {arm.name} has {arm.joints_listed}", file=source
            )
        axes = axes_of(arm)
        if self.axes and axes != self.axes:
            raise ProgramError(
                f"{self.name} programs are understood for arms whose axes point along {' '.join(self.axes)} at zero "
                f"joints, those of {arm.name} point along {' '.join(axes)}: how its joints are counted is not known",
                file=source,
            )

    def for_arm(self, arm: Arm) -> Maker:
        """The same for an arm with a declared coupling, which takes the place of the one that the language assumes."""
        return self if arm.coupling is None else replace(self, matrix=arm.coupling)

    def joints(self, program: FloatArray) -> FloatArray:
        """Joints of the URDF (..., 6), radians, from those of the controller, radians."""
        return from_controller(program, self.matrix)

    def program_joints(self, q: FloatArray) -> FloatArray:
        """Joints of the controller (..., 6) from those of the URDF, radians."""
        return to_controller(q, self.matrix)

    def problem(self, kind: str, numbers: Sequence[float]) -> str | None:
        """What is wrong with the numbers of a target, one sentence part; None if nothing is."""
        if not all(abs(number) < self.largest for number in numbers):
            return "found a number that is too large"
        if kind == "pose" and self.seem_millimetres(numbers[:3], FARTHEST_POSE):
            return "found a position in millimetres, expected metres"
        return self.orientation.problem(numbers[3:]) if kind == "pose" else None

    def seem_millimetres(self, position: Sequence[float], farthest: float) -> bool:
        """Whether a position that should be in metres is farther off than any."""
        return self.length == 1.0 and max(map(abs, position)) > farthest

    def frame(self, numbers: Sequence[float]) -> FloatArray:
        """A transform (4, 4) of the numbers as written; NaN where they are too large."""
        return np.full((4, 4), np.nan) if self.problem("pose", numbers) else self.poses(np.array([numbers]))[0]

    def poses(self, numbers: FloatArray) -> FloatArray:
        """Transforms (n, 4, 4) in metres of rows as written: position, then orientation."""
        rows = np.asarray(numbers, dtype=float)
        T = np.tile(np.eye(4), (len(rows), 1, 1))
        T[:, :3, :3] = self.orientation.matrix(rows[:, 3:] * self.angle)
        T[:, :3, 3] = rows[:, :3] * self.length
        return T

    def numbers(self, T: FloatArray, near: FloatArray) -> FloatArray:
        """Rows as written, near to others, of transforms (n, 4, 4)."""
        old = np.asarray(near, dtype=float)[:, 3:] * self.angle
        angles = self.orientation.values(T[:, :3, :3], old)
        return np.column_stack([T[:, :3, 3] / self.length, angles / self.angle])

    def postures(self, arm: Arm, q: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
        """Whether joints (n, 6) of the URDF are ``back``, ``bent``, and have a negative wrist (`wrist_axis`)."""
        configurations = closed_form.configuration(arm, q)
        at = int(closed_form.configuration(arm, self.joints(np.radians([self.reference])))[0])
        back, bent = (configurations >> 2) & 1 != at >> 2 & 1, (configurations >> 1) & 1 != at >> 1 & 1
        joints = self.program_joints(q)
        negative = joints[:, 4] < 0 if self.wrist_axis == 5 else np.cos(joints[:, 3]) > 0
        return np.asarray(back), np.asarray(bent), np.asarray(negative)


def axes_of(arm: Arm) -> tuple[str, ...]:
    """Directions of an arm's axes in its base link at zero joints, ``+z`` …, ``?`` where along none of the base's."""
    chain = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0)
    names = []
    for z in np.asarray(chain.z)[:, :, 0]:
        k = int(np.argmax(np.abs(z)))
        names.append(f"{'+' if z[k] > 0 else '-'}{'xyz'[k]}" if abs(abs(z[k]) - 1.0) < 1e-3 else "?")
    return tuple(names)


class Solutions:
    """All joints that lead to poses, computed once, of which those next to others are asked for.

    Parameters
    ----------
    maker : Maker
    arm : Arm
        What the controller computes with.
    T_base_tip : ndarray, shape (n, 4, 4)
    postures : sequence of Posture, length n
    controller_arm : Arm, optional
        What the controller computes with where that is not ``arm``.
    """

    def __init__(
        self,
        maker: Maker,
        arm: Arm,
        T_base_tip: FloatArray,
        postures: Sequence[Posture],
        controller_arm: Arm | None = None,
    ) -> None:
        self.arm, self.controller_arm, self.T = arm, controller_arm, T_base_tip
        self.complete: BoolArray = np.array([posture.complete for posture in postures], dtype=bool)
        self.closed = bool(len(postures)) and closed_form.has_closed_form(arm)
        if self.closed:
            branches = nearly_closed_form.branches(arm, T_base_tip, controller_arm)
            self.moved, self.fits = _turned(maker, arm, branches, postures)
            self.reach: BoolArray = np.logical_or.reduce(branches.valid, axis=1)

    def next_to(self, rows: IntArray, near: FloatArray) -> tuple[FloatArray, list[str]]:
        """Joints that the controller takes for some poses.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Numbers of the poses.
        near : ndarray, shape (m, 6)
            Joints of the URDF that the arm comes from, radians; NaN where they are not known.

        Returns
        -------
        q : ndarray, shape (m, 6)
            Joints of the URDF; NaN where nothing is known.
        reasons : list of str, length m
            Why; empty where joints are.
        """
        arm = self.arm
        near = np.where((near >= arm.lower - FAR_BEYOND_LIMIT) & (near <= arm.upper + FAR_BEYOND_LIMIT), near, np.nan)
        has_seed: BoolArray = np.logical_and.reduce(np.isfinite(near), axis=1)
        if not len(rows):
            return np.zeros((0, 6)), []
        if not self.closed:
            return self._searched(rows, near, has_seed)
        start = np.where(has_seed[:, None], near, 0.0)
        distance = np.abs(self.moved[rows] - start[:, None, :, None])
        turn = np.argmin(distance, axis=-1)[..., None]
        turned = np.take_along_axis(self.moved[rows], turn, axis=-1)[..., 0]
        determined: BoolArray = np.logical_or(has_seed, self.complete[rows])
        fits = self.fits[rows]
        apart = np.where(fits[..., None], turned, 0.0) - start[:, None]
        cost = np.where(fits, np.sum(apart**2, axis=-1), np.inf)
        best = np.argmin(cost, axis=1)
        row = np.arange(len(rows))
        good: BoolArray = np.logical_and(determined, np.isfinite(cost[row, best]))
        q = np.where(good[:, None], turned[row, best], np.nan)
        reasons = [
            "" if g else NO_POSTURE if not t else NO_SOLUTION if r else NO_REACH
            for g, t, r in zip(good, determined, self.reach[rows], strict=True)
        ]
        return q, reasons

    def unclear(self, start: FloatArray, end: FloatArray) -> str:
        """What speaks against joints (6,) being where a controller ends that comes from others; empty: nothing.

        The configuration must stay (a joint within a degree of where it changes may be on either side), and no joint
        may turn by nearly half a turn: there the solution that is nearest need not be the one that is taken.
        """
        form = nearly_closed_form.nearest_form(self.arm)
        turn = np.abs(end - start)
        if turn.max() > FARTHEST:
            return (
                f"joint {int(turn.argmax()) + 1} turns by {turn.max() / DEG:.0f} degrees from the stop before: {EITHER}"
            )
        if form is None:
            return ""
        steps = np.array(np.meshgrid(*[[0.0, -DEG, DEG]] * 3)).reshape(3, -1).T
        around = np.tile(start, (len(steps), 1))
        around[:, [1, 2, 4]] += steps
        same = int(form.configuration(end)) in form.configuration(around)
        return "" if same else f"the nearest solution is another configuration than that of the stop before: {EITHER}"

    def _searched(self, rows: IntArray, near: FloatArray, has_seed: BoolArray) -> tuple[FloatArray, list[str]]:
        """Of an arm without closed form."""
        q = np.full((len(rows), 6), np.nan)
        seeded = np.flatnonzero(has_seed)
        if len(seeded):
            robot = Robot(self.controller_arm or self.arm)
            solution = any_arm.solve(robot, self.arm, self.T[rows[seeded]], seed=near[seeded], thorough=False)
            q[seeded] = np.where((solution.converged & solution.inside)[:, None], solution.joints, np.nan)
        reached: BoolArray = np.logical_and.reduce(np.isfinite(q), axis=1)
        return q, ["" if r else NO_REACH if k else NO_POSTURE for r, k in zip(reached, has_seed, strict=True)]


def _turned(maker: Maker, arm: Arm, branches: Branches, postures: Sequence[Posture]) -> tuple[FloatArray, BoolArray]:
    """Joints (n, 8, 6, 5) of all branches and whole turns, infinite beyond limits and postures; which fit (n, 8)."""
    joints = branches.joints
    n = len(joints)
    fits = branches.valid.copy()
    shape = joints.reshape(-1, 6)
    back, bent, negative = (m.reshape(n, 8) for m in maker.postures(arm, np.nan_to_num(shape)))
    for is_set, demanded in (
        (back, [p.rear for p in postures]),
        (bent, [p.bent for p in postures]),
        (negative, [None if p.wrist is None else p.wrist < 0 for p in postures]),
    ):
        demands = np.array([w is not None for w in demanded])
        fits &= ~demands[:, None] | (is_set == np.array([bool(w) for w in demanded])[:, None])
    low, high = np.array([p.low for p in postures])[:, None], np.array([p.high for p in postures])[:, None]
    program = maker.program_joints(np.nan_to_num(joints))
    out = np.full((*joints.shape, len(TURNS)), np.inf)
    for k, turn in enumerate(TURNS):  # whole turns of a joint are those of its count
        moved = joints + turn
        inside = (moved >= arm.lower - 1e-9) & (moved <= arm.upper + 1e-9)
        inside &= (program + turn >= low - EDGE) & (program + turn <= high + EDGE)
        out[..., k] = np.where(inside, moved, np.inf)
    fits &= np.isfinite(out).any(axis=-1).all(axis=-1)
    return out, fits


QUADRANT_TOLERANCE = 1e-6
"""Radians by which rounding may put an axis beyond the edge of its quadrant."""


class ConfData(NamedTuple):
    """Configuration of a pose: quadrants of axes 1, 4 and 6, and the branch number ``cfx``.

    The quadrant of an axis is ``floor(angle / 90 degrees)``.
    """

    cf1: int
    cf4: int
    cf6: int
    cfx: int


def configuration_of(q: ArrayLike, cfx: int) -> ConfData:
    """Configuration data of joints (6,) in radians; ``cfx`` is kept."""
    cf1, cf4, cf6 = np.floor(np.asarray(q)[[0, 3, 5]] / (np.pi / 2) + 1e-12)
    return ConfData(int(cf1), int(cf4), int(cf6), cfx)


def seeds_of(
    nominal: Arm, T_base_tip: FloatArray, configurations: Sequence[ConfData | None], controller_arm: Arm | None = None
) -> tuple[FloatArray, BoolArray]:
    """Joints that the controller takes for poses with configuration data.

    Of the solutions within the joint limits, turned so that axes 1, 4 and 6 stand in their quadrants, the one with
    the branch number ``cfx``, else the one nearest to zero joints. Poses without configuration data take the solution
    nearest to zero joints.

    Parameters
    ----------
    nominal : Arm
    T_base_tip : ndarray, shape (n, 4, 4)
    configurations : sequence of ConfData or None, length n
    controller_arm : Arm, optional
        What the controller computes with where that is not the nominal arm.

    Returns
    -------
    q : ndarray, shape (n, 6)
        Radians; NaN where the pose is out of reach or nothing fits.
    told : ndarray of bool, shape (n,)
        False where the pose can be reached, but not with its configuration data, or where these do not tell which of
        several solutions is meant.
    """
    branches = nearly_closed_form.branches(nominal, T_base_tip, controller_arm)
    nearest, _ = closed_form.nearest(nominal, branches, np.zeros(6))
    n = len(nearest)
    quadrants = np.array([[c.cf1, c.cf4, c.cf6] if c else [0, 0, 0] for c in configurations]).reshape(n, 3)
    cfx = np.array([c.cfx if c else -1 for c in configurations])
    has_confdata = np.array([c is not None for c in configurations], dtype=bool)
    q = branches.joints.copy()
    axes = [0, 3, 5]
    middle = (quadrants[:, None, :] + 0.5) * (np.pi / 2)
    q[..., axes] += 2 * np.pi * np.round((middle - q[..., axes]) / (2 * np.pi))
    fits = (np.abs(q[..., axes] - middle) <= np.pi / 4 + QUADRANT_TOLERANCE).all(axis=-1)
    inside = ((q >= nominal.lower - 1e-9) & (q <= nominal.upper + 1e-9)).all(axis=-1)
    usable: BoolArray = branches.valid & fits & inside
    cost = np.where(usable, np.sum(np.nan_to_num(q) ** 2, axis=-1), np.inf)
    cost[np.arange(n), np.clip(cfx, 0, 7)] -= np.where((cfx >= 0) & (cfx <= 7), 1e6, 0.0)
    cost[~usable] = np.inf
    best = np.argmin(cost, axis=1)
    if not closed_form.has_closed_form(nominal):  # a branch may have been missed, so that its number must fit
        usable &= (best == cfx)[:, None]
    usable_any: BoolArray = np.any(usable, axis=1)
    chosen = np.where(usable_any[:, None], q[np.arange(n), best], np.nan)
    reachable = np.isfinite(nearest).all(axis=1)
    return np.where(has_confdata[:, None], chosen, nearest), usable_any | ~has_confdata | ~reachable
