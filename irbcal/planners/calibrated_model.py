"""The calibrated robot for planners built on Pinocchio.

A corrected URDF carries the geometry; the joint map stands between the controller and the URDF's joints. Two ways of
planning follow:

- A planner that knows nothing of the joint map plans on `CalibratedModel.model`, whose configurations hold *effective*
  joints, and `CalibratedModel.command_from_model` turns its path into commands.
- A planner that works on commanded joints takes poses, Jacobians and their time derivatives from `CalibratedModel`,
  which applies the chain rule: with the map ``theta(q)``, its Jacobian ``M`` and Pinocchio's ``J(theta)``::

      J_q = J M        dJ_q/dt = dJ/dt M + J dM/dt

"World" is Pinocchio's universe: the root link of the URDF. That is the base link for most robots, the pedestal's or the
cell's first link where the arm stands on something, and the measuring frame where the URDF was written with it.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from irbcal.errors import CalibrationError, RobotError
from irbcal.files import calibration_folder
from irbcal.files.urdf_check import LIMIT, ArmInModel
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm, relative_difference
from irbcal.modeling.joint_map import JointMap, Stiffness
from irbcal.units import DEG, MM

WORLD, LOCAL, LOCAL_WORLD_ALIGNED = "WORLD", "LOCAL", "LOCAL_WORLD_ALIGNED"
"""Pinocchio's reference frames by name; members of ``pinocchio.ReferenceFrame`` are taken too."""
WITHIN = 1e-9
"""How far a command may lie beyond a limit, radians or metres: rounding."""


@dataclass(frozen=True, eq=False)
class CalibratedModel:
    """A Pinocchio model of the corrected URDF together with the joint map.

    Parameters
    ----------
    urdf : bytes
        The corrected URDF.
    arm : Arm
        The calibrated arm in it.
    joint_map : JointMap
        From commanded to effective joints; the identity unless given.
    tip_frames : dict of str to ndarray, shape (4, 4)
        Frames to add to the model, each by its place in the tip link ``T_tip_frame``; names that the URDF has are
        left alone.
    rest : ndarray, shape (nq,), optional
        Configuration for the joints outside the arm, such as a gripper's; Pinocchio's neutral one unless given.

    Attributes
    ----------
    model : pinocchio.Model
        Its configurations hold effective joints. Its position limits are drawn in, by about 0.1 degrees, so that
        every command of a configuration within them respects the URDF's limits; speed limits are the URDF's.
    T_universe_base : ndarray, shape (4, 4)
        The base link in Pinocchio's universe, at rest.

    Raises
    ------
    CalibrationError
        If Pinocchio cannot read the URDF, or arm and URDF are not the same robot.
    """

    urdf: bytes
    arm: Arm
    joint_map: JointMap = field(default_factory=JointMap)
    tip_frames: dict = field(default_factory=dict)
    rest: np.ndarray = None

    def __post_init__(self):
        import pinocchio as pin

        try:
            model = pin.buildModelFromXML(self.urdf.decode("utf-8"))
        except (ValueError, RuntimeError) as error:
            raise CalibrationError(f"Pinocchio cannot read this robot's URDF: {' '.join(str(error).split())}") from None
        place = ArmInModel(model, self.arm)
        rest = np.array(pin.neutral(model) if self.rest is None else self.rest, dtype=float)
        if rest.shape != (model.nq,):
            raise CalibrationError(f"the configuration at rest needs shape ({model.nq},), found {rest.shape}")
        data = model.createData()
        pin.framesForwardKinematics(model, data, rest)
        T_universe_base = data.oMf[place.base].homogeneous
        for array in (rest, T_universe_base):
            array.setflags(write=False)
        given = (("model", model), ("rest", rest), ("T_universe_base", T_universe_base), ("_place", place))
        for name, value in given:
            object.__setattr__(self, name, value)
        self._check_arm()
        self._add_frames()
        self._draw_in_limits()

    @staticmethod
    def load(folder, rest=None):
        """The model of a calibration folder.

        Parameters
        ----------
        folder : str or Path
        rest : ndarray, shape (nq,), optional
            See `CalibratedModel`.

        Returns
        -------
        CalibratedModel
            With a frame ``target_NAME`` for each reflector on the tool.

        Raises
        ------
        CalibrationError
            If the folder is not a whole calibration.
        """
        saved = calibration_folder.read(folder)
        robot = saved.record.robot_calibrated()
        targets = {
            f"target_{name}": frames.transform(robot.target_rotations.get(name), xyz)
            for name, xyz in robot.targets.items()
        }
        return CalibratedModel(saved.urdf, robot.arm, robot.joint_map, targets, rest)

    def _check_arm(self):
        q = self.arm.random_joints(5, seed=2)
        position, rotation = relative_difference(self._loop_placements(q, self._place.tip), self.arm.forward(q))
        if not max(position, rotation) <= LIMIT:
            raise CalibrationError(
                f"the URDF is not that of the calibrated {self.arm.name}: "
                f"its tip differs by {position / MM:.3g} mm and {rotation / DEG:.3g} degrees"
            )

    def _add_frames(self):
        import pinocchio as pin

        tip = self.model.frames[self._place.tip]
        for name, T_tip_frame in self.tip_frames.items():
            if not self.model.existFrame(name):
                placement = tip.placement * pin.SE3(np.array(T_tip_frame, dtype=float))
                frame = pin.Frame(name, tip.parentJoint, self._place.tip, placement, pin.FrameType.OP_FRAME)
                self.model.addFrame(frame, False)

    def _draw_in_limits(self):
        limits = self.joint_map.effective_limits(self.arm.lower, self.arm.upper)
        for joint, lower, upper in zip(self._place.joint_ids, *limits, strict=True):
            joint = self.model.joints[joint]
            if joint.nq == 1 and np.isfinite([lower, upper]).all():
                self.model.lowerPositionLimit[joint.idx_q] = lower
                self.model.upperPositionLimit[joint.idx_q] = upper

    # Commands and configurations

    def model_from_command(self, q, rest=None):
        """Configurations that the robot really takes up for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        rest : ndarray, shape (nq,) or (n, nq), optional
            For the joints outside the arm, in place of the model's own `rest`.

        Returns
        -------
        ndarray, shape (n, nq)
            In Pinocchio's order; continuous joints are (cos, sin).
        """
        theta = self.joint_map.effective(self.arm.check_joints(q))
        return self._place.configurations(theta, self.rest if rest is None else rest)

    def command_from_model(self, configurations, path=False, check_limits=True):
        """Commands that bring the robot into configurations of `model`: what to do with a planner's path.

        Parameters
        ----------
        configurations : array_like, shape (n, nq)
        path : bool
            The rows are one motion: continuous joints go on turning beyond half a turn. Otherwise, and at the path's
            first row, they lie between -180 and 180 degrees.
        check_limits : bool
            Refuse commands outside the URDF's joint limits.

        Returns
        -------
        ndarray, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).

        Raises
        ------
        CalibrationError
            If the configurations are not of this model, or a command lies outside the limits.
        """
        theta = self._place.joints(self._check_columns(configurations, self.model.nq, "configurations"))
        if path:
            continuous = [k for k, joint in enumerate(self._place.joint_ids) if self.model.joints[joint].nq == 2]
            theta[:, continuous] = np.unwrap(theta[:, continuous], axis=0)
        q = self.joint_map.commanded(theta)
        if check_limits:
            self.check_commands(q)
        return q

    def velocity_command(self, configurations, velocities):
        """Commanded joint speeds for a planner's velocities: the joint map's ``M^-1`` times them.

        Parameters
        ----------
        configurations : array_like, shape (n, nq)
        velocities : array_like, shape (n, nv)

        Returns
        -------
        ndarray, shape (n, joints)
            Radians (metres for prismatic joints) per second.
        """
        q = self.command_from_model(configurations, check_limits=False)
        v = self._check_columns(velocities, self.model.nv, "velocities")[:, self._place.columns]
        return np.linalg.solve(self.joint_map.jacobian(q), v[..., None])[..., 0]

    def beyond_limits(self, q):
        """How far commands lie outside the URDF's joint limits.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints)
            Positive above the upper, negative below the lower limit, zero within.
        """
        q = self.arm.check_joints(q)
        return np.maximum(q - self.arm.upper, 0.0) + np.minimum(q - self.arm.lower, 0.0)

    def check_commands(self, q):
        """Refuse commands outside the URDF's joint limits.

        Raises
        ------
        CalibrationError
            Names the first row and its joint that is farthest out.
        """
        q = self.arm.check_joints(q)
        beyond = np.abs(self.beyond_limits(q))
        rows = np.flatnonzero((beyond > WITHIN).any(axis=1))
        if len(rows):
            row, joint = rows[0], np.argmax(beyond[rows[0]])
            value, lower, upper = (
                f"{v[joint] / self.arm.joint_units[joint]:.6g}" for v in (q[row], self.arm.lower, self.arm.upper)
            )
            unit = "mm" if self.arm.table.prismatic[joint] else "degrees"
            raise CalibrationError(
                f"row {row + 1} commands {self.arm.joint_names[joint]} to {value} {unit}, outside its limits "
                f"{lower} to {upper} ({len(rows)} of {len(q)} rows are outside)"
            )

    def _check_columns(self, values, columns, what):
        values = np.atleast_2d(np.asarray(values, dtype=float))
        if values.ndim != 2 or values.shape[1] != columns:
            raise CalibrationError(f"{what} of {self.arm.name} need shape (n, {columns}), found {values.shape}")
        return values

    # Kinematics of commanded joints

    def placement(self, q, frame=None, relative_to=None):
        """Where frames really are for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        frame, relative_to : str, optional
            Names of frames of `model`: a link, a joint, an added frame or ``universe``. By default the tip link,
            relative to the base link.

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_relative_frame``.
        """
        theta = self.joint_map.effective(self.arm.check_joints(q))
        frame = self._place.tip if frame is None else self._place.frame(frame)
        relative_to = self._place.base if relative_to is None else self._place.frame(relative_to)
        T_universe_frame, T_universe_relative = (self._placements(theta, k) for k in (frame, relative_to))
        return frames.inverse(T_universe_relative) @ T_universe_frame

    def jacobian(self, q, frame=None, reference=LOCAL_WORLD_ALIGNED):
        """Jacobian of a frame's velocity by the speeds of the commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        frame : str, optional
            Name of a frame of `model`; by default the tip link.
        reference : str or pinocchio.ReferenceFrame
            As in Pinocchio, for the velocity relative to the universe: ``LOCAL_WORLD_ALIGNED`` (of the frame's origin,
            along the universe's axes), ``LOCAL`` (the same along the frame's own axes) or ``WORLD`` (of the point of
            the body that passes the universe's origin, along the universe's axes).

        Returns
        -------
        ndarray, shape (n, 6, joints)
            Rows: linear, then angular velocity.
        """
        q = self.arm.check_joints(q)
        J = self._effective_jacobians(self.joint_map.effective(q), None, frame, reference)[0]
        return J @ self.joint_map.jacobian(q)

    def jacobian_derivative(self, q, dq, frame=None, reference=LOCAL_WORLD_ALIGNED):
        """Time derivative of `jacobian` along a motion, so that the acceleration is ``J ddq + dJ/dt dq``.

        Parameters
        ----------
        q, dq : array_like, shape (n, joints)
            Commanded joints and their speeds.
        frame, reference
            See `jacobian`.

        Returns
        -------
        ndarray, shape (n, 6, joints)
            Derivative of the matrix that `jacobian` gives; in ``LOCAL`` that of components along moving axes.
        """
        q, dq = self.arm.check_joints(q), self.arm.check_joints(dq)
        M = self.joint_map.jacobian(q)
        dtheta = np.einsum("nij,nj->ni", M, dq)
        J, dJ = self._effective_jacobians(self.joint_map.effective(q), dtheta, frame, reference)
        return dJ @ M + J @ self.joint_map.jacobian_derivative(q, dq)

    def _fixed_to_tip(self, frame):
        return self.model.frames[frame].parentJoint == self.model.frames[self._place.tip].parentJoint

    def _placements(self, theta, frame):
        """``T_universe_frame`` for effective joints, (n, 4, 4); without a loop for what is fixed to base or tip."""
        listed = self.model.frames
        if self._fixed_to_tip(frame):
            T_tip_frame = listed[self._place.tip].placement.actInv(listed[frame].placement).homogeneous
            return self.T_universe_base @ self.arm.forward(theta) @ T_tip_frame
        if listed[frame].parentJoint == listed[self._place.base].parentJoint:
            T_base_frame = listed[self._place.base].placement.actInv(listed[frame].placement).homogeneous
            return np.broadcast_to(self.T_universe_base @ T_base_frame, (len(theta), 4, 4))
        return self.T_universe_base @ self._loop_placements(theta, frame)

    def _loop_placements(self, theta, frame):
        """``T_base_frame`` by Pinocchio, pose by pose."""
        import pinocchio as pin

        data = self.model.createData()
        out = np.empty((len(theta), 4, 4))
        for k, configuration in enumerate(self._place.configurations(theta, self.rest)):
            pin.framesForwardKinematics(self.model, data, configuration)
            out[k] = data.oMf[self._place.base].actInv(data.oMf[frame]).homogeneous
        return out

    def _effective_jacobians(self, theta, dtheta, frame, reference):
        """Jacobian by effective joints and its time derivative (None without speeds), each (n, 6, joints)."""
        reference = str(reference)
        if reference not in (WORLD, LOCAL, LOCAL_WORLD_ALIGNED):
            raise CalibrationError(f"unknown reference frame {reference!r}: expected LOCAL, WORLD, LOCAL_WORLD_ALIGNED")
        frame = self._place.tip if frame is None else self._place.frame(frame)
        world = self._dhm_jacobians if self._fixed_to_tip(frame) else self._loop_jacobians
        J, dJ = world(theta, dtheta, frame)
        return _refer(J, dJ, dtheta, self._placements(theta, frame), reference)

    def _dhm_jacobians(self, theta, dtheta, frame):
        """World Jacobians of the last link from the axes along the DHM chain, without a loop over poses."""
        table = self.arm.table
        chain = dhm.chain_frames(table, theta.T + table.offsets[:, None], self.T_universe_base @ self.arm.T_base_0)
        z, o = (np.moveaxis(axes, -1, 0) for axes in (chain.z, chain.o))
        slides = table.prismatic[:, None]
        J = np.concatenate([np.where(slides, z, np.cross(o, z)), np.where(slides, 0.0, z)], axis=2)
        if dtheta is None:
            return np.swapaxes(J, 1, 2), None
        # each axis moves with the link before it: with the sum of the twists of the joints before
        twists = np.cumsum(J * dtheta[..., None], axis=1)
        v, w = np.split(np.concatenate([np.zeros_like(twists[:, :1]), twists[:, :-1]], axis=1), 2, axis=2)
        linear = np.cross(w, J[..., :3]) + np.cross(v, J[..., 3:])
        dJ = np.concatenate([linear, np.cross(w, J[..., 3:])], axis=2)
        return np.swapaxes(J, 1, 2), np.swapaxes(dJ, 1, 2)

    def _loop_jacobians(self, theta, dtheta, frame):
        """World Jacobians of any link by Pinocchio, pose by pose."""
        import pinocchio as pin

        place, data = self._place, self.model.createData()
        speeds = np.zeros((len(theta), self.model.nv))
        if dtheta is not None:
            speeds[:, place.columns] = dtheta
        J, dJ = np.empty((2, len(theta), 6, len(place.joint_ids)))
        for k, configuration in enumerate(place.configurations(theta, self.rest)):
            pin.computeJointJacobiansTimeVariation(self.model, data, configuration, speeds[k])
            J[k], dJ[k] = data.J[:, place.columns], data.dJ[:, place.columns]
        carries = set(self.model.supports[self.model.frames[frame].parentJoint])
        moves = np.array([joint in carries for joint in place.joint_ids])
        return J * moves, None if dtheta is None else dJ * moves

    # Payload

    def with_payload(self, delta_kg, place=None, wrist=None, masses=None):
        """The model with more (or less) mass on the tool than when the robot was measured.

        The arm's stiffness is split into compliance and masses, by the inertials of the URDF, and the new torques of
        gravity on axes 2 and 3 give new stiffness terms (Nubiola 2011, section 5.3; `Stiffness.with_payload`).

        Parameters
        ----------
        delta_kg : float
            Mass added; negative if it carries less.
        place : array_like, shape (3,), optional
            Centre of the added mass in the tip link, metres; the tip's origin unless given.
        wrist : array_like, optional
            Joints behind joint 3 at which the mass's lever is taken, radians; zero unless given. The stiffness terms
            know only joints 2 and 3, so one typical posture of the wrist stands for all.
        masses : tuple of float, optional
            Mass of upper arm (what axis 2 carries and axis 3 does not) and of forearm with all it carried when it was
            measured, kg, for URDFs without inertials; the upper arm's centre is then taken at its middle (eq. 5.20).

        Returns
        -------
        CalibratedModel
            With another joint map; the bodies of `model` weigh what they weighed.

        Raises
        ------
        RobotError
            If the calibration has no stiffness (levels below 34), or the URDF no masses.

        Notes
        -----
        A physical guess: positions show compliance times mass only, and the masses in a URDF may be estimates. The
        wrist is taken as stiff and the base as upright. For 3 kg on a stretched IRB 1600 it gives 0.16 mm (simulated
        demo, estimated masses) to 0.24 mm (eqs. 5.19 to 5.22), where 0.3 mm was measured (Nubiola 2011, Table 4.3).
        """
        import pinocchio as pin

        guess, upper_kg, lever = self._payload_geometry(pin, place, wrist, masses)
        joint_map = self.joint_map.with_payload(guess, delta_kg, upper_kg, *lever)
        return replace(self, joint_map=joint_map)

    def _payload_geometry(self, pin, place, wrist, masses):
        """Stiffness guess by the URDF's masses, the upper arm's mass, and the payload's lever along and across."""
        if not self.arm.six_revolute:
            raise RobotError(f"the arm-stiffness model is for six revolute joints, {self.arm.name} has others")
        theta = np.zeros(6)
        if wrist is not None:
            theta[3:] = wrist
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, self._place.configurations(theta[None], self.rest)[0])
        pin.centerOfMass(self.model, data)
        second, third, fifth = (self._place.joint_ids[k] for k in (1, 2, 4))
        base = data.oMf[self._place.base]
        axis = dhm.chain_frames(self.arm.table, self.arm.table.offsets[:, None], self.arm.T_base_0).z[1, :, 0]
        up = np.array([0.0, 0.0, 1.0])
        along_upper, along_fore, across_fore = (
            np.cos(angle) * up + np.sin(angle) * np.cross(axis, up)
            for angle in (*self.joint_map.phases, self.joint_map.phases[1] + np.pi / 2)
        )

        def from_joint(joint, point):
            return base.rotation.T @ (point - data.oMi[joint].translation)

        L_1 = along_upper @ from_joint(second, data.oMi[third].translation)
        L_2 = along_fore @ from_joint(third, data.oMi[fifth].translation)
        if masses is None:
            whole, fore = data.mass[second], data.mass[third]
            upper = whole - fore
            if not (upper > 0.0 and fore > 0.0):
                raise RobotError(f"the URDF of {self.arm.name} gives no masses of upper arm and forearm: give `masses`")
            moment = whole * (data.oMi[second] * data.com[second]) - fore * (data.oMi[third] * data.com[third])
            L_G1 = along_upper @ from_joint(second, moment / upper)
        else:
            (upper, fore), L_G1 = masses, L_1 / 2
        tip = data.oMf[self._place.tip]
        payload = from_joint(third, tip * np.array([0.0, 0.0, 0.0] if place is None else place, dtype=float))
        guess = replace(Stiffness.guess(L_1, L_2), L_G1=L_G1, m=fore / upper)
        return guess, upper, (along_fore @ payload, across_fore @ payload)


def _refer(J, dJ, dtheta, T, reference):
    """World Jacobians (n, 6, joints), referred to another of Pinocchio's reference frames; T is the frame's place."""
    if reference == WORLD:
        return J, dJ
    p, R = T[:, :3, 3, None], T[:, :3, :3]
    linear, angular = J[:, :3], J[:, 3:]
    moved = np.concatenate([linear + np.cross(angular, p, axis=1), angular], axis=1)
    turned = None
    if dJ is not None:
        v, w = np.split(np.einsum("nij,nj->ni", moved, dtheta)[..., None], 2, axis=1)
        d_angular = dJ[:, 3:]
        d_linear = dJ[:, :3] + np.cross(d_angular, p, axis=1) + np.cross(angular, v, axis=1)
        turned = np.concatenate([d_linear, d_angular], axis=1)
        if reference == LOCAL:
            turned = _by_blocks(R, turned - np.concatenate([np.cross(w, block, axis=1) for block in _halves(moved)], 1))
    return (_by_blocks(R, moved) if reference == LOCAL else moved), turned


def _halves(J):
    return J[:, :3], J[:, 3:]


def _by_blocks(R, J):
    """Linear and angular part along the axes R."""
    return np.concatenate([np.swapaxes(R, 1, 2) @ block for block in _halves(J)], axis=1)
