"""Trajectories of a planner: positions, speeds and accelerations to commands and back, limits, torques.

With the joint map ``theta(q)``, its Jacobian ``M`` and what the last moves add, ``h(t)``
(`irbcal.modeling.moves_along`)::

    theta = theta(q) + h      dtheta/dt = M dq/dt + dh/dt      d²theta/dt² = M d²q/dt² + dM/dt dq/dt + d²h/dt²
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError
from irbcal.modeling import moves_along
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms.payload import STANDARD_GRAVITY
from irbcal.modeling.trajectory import Trajectory
from irbcal.modeling.trajectory_limits import Checked, Limits, check, limits_in_order
from irbcal.planners import jacobians

if TYPE_CHECKING:
    import pinocchio as pin

    from irbcal.io.urdf_check import ArmInModel


class AlongTime:
    """What `irbcal.planners.calibrated_model.CalibratedModel` does with trajectories."""

    model: pin.Model
    arm: Arm
    joint_map: JointMap
    T_universe_base: FloatArray
    _place: ArmInModel
    _rest: FloatArray

    def trajectory(
        self,
        times: ArrayLike,
        configurations: ArrayLike,
        velocities: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
    ) -> Trajectory:
        """A planner's trajectory on `model`, as joints by their names.

        Parameters
        ----------
        times : array_like, shape (n,)
            Seconds, growing.
        configurations : array_like, shape (n, nq)
        velocities, accelerations : array_like, shape (n, nv), optional

        Returns
        -------
        Trajectory
            Effective joints of the arm. Continuous joints go on turning beyond half a turn.

        Raises
        ------
        CalibrationError
            If shapes are not those of the model.
        RobotError
            If the times do not grow, or numbers are not finite.
        """
        model, columns = self.model, self._place.columns
        theta = self._place.joints(_table(configurations, model.nq, "configurations"))
        endless = [k for k, joint in enumerate(self._place.joint_ids) if model.joints[joint].nq == 2]
        theta[:, endless] = np.unwrap(theta[:, endless], axis=0)
        v = None if velocities is None else _table(velocities, model.nv, "velocities")[:, columns]
        a = None if accelerations is None else _table(accelerations, model.nv, "accelerations")[:, columns]
        return Trajectory(np.asarray(times), theta, v, a, self.arm.joint_names, self.arm.table.prismatic)

    def configurations(self, trajectory: Trajectory) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
        """The inverse of `trajectory`: what Pinocchio takes, the joints outside the arm at rest.

        Returns
        -------
        configurations : ndarray, shape (n, nq)
        velocities, accelerations : ndarray, shape (n, nv), or None
        """
        ordered = trajectory.in_order_of(self.arm.joint_names)
        derivatives: list[FloatArray | None] = []
        for values in (ordered.dq, ordered.ddq):
            wide = None if values is None else np.zeros((len(ordered), self.model.nv))
            if wide is not None:
                wide[:, self._place.columns] = values
            derivatives.append(wide)
        return self._place.configurations(ordered.q, self._rest), derivatives[0], derivatives[1]

    def model_trajectory(self, commands: Trajectory, previous: ArrayLike | None = None) -> Trajectory:
        """What the robot really does when it follows commands.

        Parameters
        ----------
        commands : Trajectory
            Its joints are found by their names, those of others are left out. Without speeds or accelerations it has
            none afterwards.
        previous : array_like, shape (joints,), optional
            Commands of the stop before its first point, for robots that lean to the side they came from; not known
            unless given. A trajectory that `command_trajectory` made keeps the sides that were worked out there.

        Returns
        -------
        Trajectory
            Effective joints, for `configurations`.
        """
        ordered = self._leaning(commands, previous)
        self.arm.check_joints(ordered.q)
        return moves_along.to_effective(self.joint_map, ordered)

    def command_trajectory(
        self,
        effective: Trajectory,
        previous: ArrayLike | None = None,
        speed_limits: ArrayLike | Mapping[str, float] | None = None,
        acceleration_limits: ArrayLike | Mapping[str, float] | None = None,
    ) -> Checked:
        """Commands with which the robot follows a trajectory that was planned on `model`.

        Parameters
        ----------
        effective : Trajectory
            Of `trajectory`, or with the joints' names of the arm.
        previous : array_like, shape (joints,), optional
            As `model_trajectory`.
        speed_limits, acceleration_limits : array_like, shape (joints,), or dict, optional
            Of the commands, radians (metres) per second and second squared, one number for all joints, or by the
            joints' names. Speeds are those of the URDF unless given; a URDF knows no accelerations.

        Returns
        -------
        Checked
            ``trajectory`` holds the commands, ``exceeded`` the limits that these pass at their points or between,
            with joint, time and size; ``in_time()`` is the same path, as much slower as speeds and accelerations need.

        Raises
        ------
        RobotError
            If a joint is missing, or the joint map cannot be inverted.
        """
        commands = moves_along.to_commands(self.joint_map, self._leaning(effective, previous))
        names = self.arm.joint_names
        speeds = self.speed_limits if speed_limits is None else limits_in_order(speed_limits, names, "speed_limits")
        accelerations = limits_in_order(acceleration_limits, names, "acceleration_limits")
        return check(commands, Limits(self.arm.lower, self.arm.upper, speeds, accelerations))

    @property
    def speed_limits(self) -> FloatArray:
        """Largest joint speeds of the URDF, shape (joints,), rad/s (m/s); infinite where it has none."""
        speeds = np.array(self.model.velocityLimit)[self._place.columns]
        return np.where(speeds > 0.0, speeds, np.inf)

    def _leaning(self, trajectory: Trajectory, previous: ArrayLike | None) -> Trajectory:
        ordered = replace(trajectory.in_order_of(self.arm.joint_names), prismatic=self.arm.table.prismatic)
        if ordered.lean is not None and previous is None:
            return ordered
        return replace(ordered, lean=moves_along.lean_along(self.joint_map, ordered, previous))

    def gravity_torques(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: float = 0.0,
        payload_place: ArrayLike = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Torques with which the joints hold the arm against gravity where it really is: for feed-forward.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints), optional
            The stop before each, as commanded; unknown where not given or NaN.
        payload_kg : float
            Mass on the tool beside the bodies of the URDF, which has no tool: tell what it carries.
        payload_place : array_like, shape (3,)
            Its centre in the tip link, metres.

        Returns
        -------
        ndarray, shape (n, joints)
            N m (N for prismatic joints) at the effective joints, with gravity as Pinocchio's model has it.

        Raises
        ------
        CalibrationError
            If the URDF gives the links that the arm moves no masses.
        """
        import pinocchio as pin

        model, data = self.model, self.model.createData()
        if not any(model.inertias[joint].mass > 0.0 for joint in self._place.joint_ids):
            raise CalibrationError(
                f"the URDF of {self.arm.name} has no inertials for the links that its joints move: nothing is known of "
                "its torques"
            )
        theta = self.joint_map.effective(self.arm.check_joints(q), previous)
        out = np.empty(theta.shape)
        for k, configuration in enumerate(self._place.configurations(theta, self._rest)):
            out[k] = pin.computeGeneralizedGravity(model, data, configuration)[self._place.columns]
        if payload_kg:
            J = jacobians.along_chain(self.arm, self.T_universe_base, theta, None)[0]
            point = np.append(np.asarray(payload_place, dtype=float), 1.0)
            p = (self.T_universe_base @ self.arm.forward(theta) @ point)[:, :3, None]
            weight = payload_kg * STANDARD_GRAVITY * model.gravity.linear / np.linalg.norm(model.gravity.linear)
            out -= np.einsum("i,nij->nj", weight, J[:, :3] + np.cross(J[:, 3:], p, axis=1))
        return out


def _table(values: ArrayLike, columns: int, quantity: str) -> FloatArray:
    table: FloatArray = np.atleast_2d(np.asarray(values, dtype=float))
    if table.ndim != 2 or table.shape[1] != columns:
        raise CalibrationError(f"{quantity} need shape (n, {columns}), found {table.shape}", parameter=quantity)
    return table
