"""A robot as calibration knows it: geometry, joint map, place of the base and targets on the tool."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import OptionError, RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty, Prediction
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.term_sums import compiled, stops
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import BLOCK, TermMap
from irbcal.option_values import excerpt, number, point_in_metres
from irbcal.units import LARGEST_PAYLOAD_KG
from irbcal.wording import counted, first_of


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """Predicts poses and reflector positions from commanded joints.

    The whole chain of Nubiola 2011, eqs. 3.32, 3.33 and 3.34, with the errors of the joints (section 5.4.5) in the
    joint map.

    Raises
    ------
    RobotError
        If there are terms of the joint map among the frame terms.
    """

    arm: Arm
    """Geometry (nominal or calibrated)."""
    joint_map: JointMap = None  # type: ignore[assignment]  # the identity of the arm unless given
    """The thesis's, or a sum of terms."""
    T_world_base: FloatArray = field(default_factory=lambda: np.eye(4))
    """Shape (4, 4). The base link in the measuring frame ("world")."""
    targets: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (3,). Reflector positions in the tip link, metres."""
    target_rotations: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (3, 3). Orientation in the tip link of the targets that have one."""
    certainty: Certainty | None = None
    """What the identification knows of it: what `predict` needs."""
    frame_terms: TermMap | None = None
    """Small motions of the joints' frames before each joint turns, which neither URDF nor joint map can carry: only
    frame terms, of the nominal arm.
    """

    def __post_init__(self) -> None:
        if self.joint_map is None:
            object.__setattr__(self, "joint_map", JointMap.identity(self.arm))
        if self.frame_terms is not None and len(self.frame_terms.select(True).terms) < len(self.frame_terms.terms):
            raise RobotError("terms about the joints' own axes belong to the joint map, not to the frame terms")
        object.__setattr__(self, "T_world_base", np.asarray(self.T_world_base, dtype=float))
        for name in ("targets", "target_rotations"):
            points = getattr(self, name)
            object.__setattr__(self, name, {key: np.asarray(value, dtype=float) for key, value in points.items()})
        lock(self)

    def __repr__(self) -> str:
        names = list(self.targets)
        listed = first_of(names, 9)
        targets = f"{counted(len(names), 'target')} ({listed})" if names else "no targets"
        frames = "" if self.frame_terms is None else f", {len(self.frame_terms.terms)} frame terms"
        return f"<Robot {self.arm.name}: {self.arm.joints_in_words}, {self.joint_map.in_words}{frames}, {targets}>"

    def poses(self, q: ArrayLike) -> FloatArray:
        """Tip poses in the base link for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints) or (joints,)
            Radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_base_tip``; n is 1 for one pose.

        Raises
        ------
        RobotError
            If the joints have another shape, or look like degrees.
        """
        if self.kernel is not None and isinstance(q, np.ndarray) and q.ndim == 2:
            T = np.empty((len(q), 4, 4))
            if self.kernel.poses(q, None, True, T):
                return T
        return self.forward(self.arm.check_joints(q))

    @cached_property
    def kernel(self) -> Any:
        """The compiled kernel of it, see `irbcal.modeling.term_sums.compiled`; None where numpy serves."""
        if (sums := self.joint_map.sums) is None:
            return None
        return compiled(self.arm, None if self.joint_map.is_identity else sums, frame_terms=self.frame_terms)

    def forward(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        **inputs: ArrayLike | None,
    ) -> FloatArray:
        """Tip poses in the base link, as `poses`, of any joints: for iterations, for trying other units.

        Joints are (n, joints), or (joints,) of one pose, which gives (1, 4, 4).
        The "real" direct model of Nubiola 2011, eqs. 6.40 and 7.2, where arm and joint map are calibrated; with the
        stops before, ``previous`` (n, joints), where they are known and the joint map depends on them. What else terms
        are functions of likewise, see `irbcal.modeling.joint_map.JointMap.effective`: ``payload_kg``, the mass carried
        (n,), … Without it the robot carries what most poses of the calibration were measured with, see `carrying`.
        """
        q = np.ascontiguousarray(q, dtype=float)
        q = q[None] if q.ndim == 1 else q
        if self.kernel is not None:
            T = np.empty((len(q), 4, 4))
            if self.kernel.poses(q, stops(q, previous, inputs, self.joint_map.sums), False, T):
                return T
        if self.frame_terms is None:
            return self.arm.forward(self.joint_map.effective_unchecked(q, previous, **inputs))
        q_before = None if previous is None else np.broadcast_to(previous, q.shape)
        motion = self.joint_map.motion(q, q_before, **inputs)
        out = np.empty((len(q), 4, 4))
        for start in range(0, len(q), BLOCK):
            rows = slice(start, start + BLOCK)
            out[rows] = chain.poses(self.walk(motion.select(rows)))
        return out

    def moved_by_frame_terms(self, q: ArrayLike) -> FloatArray:
        """How far frame terms move the first target (the tip without targets) at commanded joints (n, joints).

        This is what URDF and joint map alone miss: shape (n,), metres.
        """
        point = np.append(next(iter(self.targets.values()), np.zeros(3)), 1.0)
        difference = (self.forward(q) - self.replace(frame_terms=None).forward(q))[:, :3] @ point
        return np.linalg.norm(difference, axis=1)

    def carrying(self, payload_kg: float, payload_centre: ArrayLike | None = None) -> Robot:
        """The robot with another mass on its tool, where its calibration was measured with several.

        Parameters
        ----------
        payload_kg : float
            By the reckoning of the measurements: with or without the tool, as there.
        payload_centre : array_like, shape (3,), optional
            Its centre in the tip link, metres; that of the calibration unless given.

        Returns
        -------
        Robot
            Every prediction, inverse and correction made with it is for that load.

        Raises
        ------
        RobotError
            If the joint map does not know how the joints give way under another load.
        """
        return self.replace(joint_map=self.joint_map.carrying(payload_kg, payload_centre))

    def target_position(self, name: str) -> FloatArray:
        """Position of a target in the tip link, shape (3,), metres.

        Raises
        ------
        RobotError
            If the robot does not know it.
        """
        if not isinstance(name, str) or name not in self.targets:
            known = ", ".join(self.targets) or "none"
            raise RobotError(f"unknown target {excerpt(name)}: this robot has {known}", parameter="target")
        return self.targets[name]

    def points(self, q: ArrayLike, target: str | Sequence[str], **inputs: ArrayLike | None) -> FloatArray:
        """Positions of reflectors in the measuring frame for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints) or (joints,)
            Radians (metres for prismatic joints).
        target : str or sequence of str, length n
            One target for all poses, or one for each.
        **inputs : array_like
            ``payload_kg``, …, as for `forward`.

        Returns
        -------
        ndarray, shape (n, 3)
            Metres.

        Raises
        ------
        RobotError
            If a target is not one of the robot's, the joints have another shape, or look like degrees.
        """
        q = self.arm.check_joints(q)
        names = list(target) if isinstance(target, Iterable) and not isinstance(target, str) else [target]
        if len(names) not in (1, len(q)):
            raise RobotError(
                f"target: expected one, or one for each of {len(q)} poses, found {len(names)}", parameter="target"
            )
        local = np.array([self.target_position(name) for name in names])
        T = self.forward(q, **inputs)
        base = np.einsum("nij,nj->ni", T[:, :3, :3], np.broadcast_to(local, (len(q), 3))) + T[:, :3, 3]
        return base @ self.T_world_base[:3, :3].T + self.T_world_base[:3, 3]

    def walk(self, motion: Motion) -> chain.Walk:
        """Axes and origins along the chain at a motion, frame terms included, all poses in memory at a time.

        See `irbcal.modeling.terms.chain.walk`.
        """
        previous = None if motion.move is None else motion.q - motion.move
        xi = None if self.frame_terms is None else self.frame_terms.split(motion)[1]
        return chain.walk(self.arm, self.joint_map.effective_unchecked(motion.q, previous, **motion.inputs), xi)

    def predict(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        target: str | None = None,
        *,
        in_order: bool = False,
        **inputs: ArrayLike | None,
    ) -> Prediction:
        """Places of a reflector in the measuring frame, with what is known of them.

        Parameters
        ----------
        q : array_like, shape (n, joints) or (joints,)
            Commanded joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            The stop before each, as commanded. Without it, or in rows with NaN, terms of the last move are zero, and
            their size joins the uncertainty.
        target : str, optional
            The robot's first unless given.
        in_order : bool
            The poses of the fit were a program in an order, and others than these are predicted: contiguous blocks of
            poses count as left out in place of single poses.
        **inputs : array_like
            ``payload_kg``, …, as for `forward`.

        Returns
        -------
        Prediction
            Intervals are valid for poses like those measured; ``outside`` marks the others.

        Raises
        ------
        RobotError
            If nothing is known of the robot's certainty, it has no such target, the joints have another shape, or look
            like degrees.
        """
        certainty, name = self._certain(target)
        motion, point = self._motion(q, previous, inputs), self.targets[name]
        return certainty.predict(self.walk, motion, previous, point, name, self.T_world_base, in_order)

    def predict_moves(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        target: str | None = None,
        **inputs: ArrayLike | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Lengths of the ways of a reflector from each pose to the next, with 95 % half-widths, metres, shape (n - 1,).

        What both ends share counts once: the base not at all. Parameters and errors as `predict`.
        """
        certainty, name = self._certain(target)
        return certainty.moves(self.walk, self._motion(q, previous, inputs), previous, self.targets[name], name)

    def _motion(self, q: ArrayLike, previous: ArrayLike | None, inputs: Mapping[str, ArrayLike | None]) -> Motion:
        """Stops as a user gives them; joints of another shape, and degrees, are refused."""
        check = self.arm.check_joints
        return self.joint_map.motion(check(q), None if previous is None else check(previous), **inputs)

    def _certain(self, target: str | None) -> tuple[Certainty, str]:
        """What is known of the robot, and which target is meant."""
        certainty, name = self._known_certainty(), next(iter(self.targets), "") if target is None else target
        self.target_position(name)
        return certainty, name

    def _known_certainty(self) -> Certainty:
        if self.certainty is None:
            raise RobotError(
                f"nothing is known of how certain {self.arm.name} is: only a calibrated robot predicts with intervals "
                "(irbcal.load(folder).robot_calibrated())",
                parameter="certainty",
            )
        return self.certainty

    def predict_tip(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: ArrayLike | None) -> Prediction:
        """As `predict` for the origin of the tip in the base link: base and tool do not matter."""
        certainty, motion = self._known_certainty(), self._motion(q, previous, inputs)
        return certainty.predict(self.walk, motion, previous, np.zeros(3), None, self.T_world_base)

    def position_std(self, q: ArrayLike, target: str | None = None, **inputs: ArrayLike | None) -> FloatArray:
        """Standard deviations of a reflector's x, y and z (or the tip's) by those of the parameters alone.

        Shape (n, 3), metres; frames as `predict` and `predict_tip`. Held combinations add nothing, nor does what the
        model cannot describe.
        """
        certainty, point = self._known_certainty(), np.zeros(3) if target is None else self.target_position(target)
        motion = self._motion(q, None, inputs)
        _, covariance, _ = certainty.positions(self.walk, motion, None, point, target, self.T_world_base)
        return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))

    def replace(self, **changes: Any) -> Robot:
        """A copy with some fields changed."""
        return replace(self, **changes)

    @property
    def table(self) -> dhm.DHMTable:
        """The DHM table in use."""
        return self.arm.table


def carrying_payload(robot: Robot, payload: float | None, payload_centre: ArrayLike | None = None) -> Robot:
    """The robot with the payload that a user asks for.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    payload : float or None
        Kg; None: the robot as it is.
    payload_centre : array_like, shape (3,), optional
        Its centre in the tip link, metres.

    Raises
    ------
    OptionError
        If these are no mass that an arm carries and no place, or there is a place without a mass.
    RobotError
        As `Robot.carrying`.
    """
    if payload is None:
        if payload_centre is not None:
            raise OptionError("payload_centre: goes with a payload: give its mass, too", parameter="payload_centre")
        return robot
    if payload_centre is not None:
        payload_centre = point_in_metres("payload_centre", payload_centre, "x, y, z of the payload's centre in metres")
    return robot.carrying(number("payload", payload, 0.0, LARGEST_PAYLOAD_KG), payload_centre)
