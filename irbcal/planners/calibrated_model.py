"""The calibrated robot for planners built on Pinocchio.

A corrected URDF carries the geometry; the joint map stands between the controller and the URDF's joints. So plan:

- A planner that knows nothing of the joint map plans on `CalibratedModel.model`, whose configurations hold *effective*
  joints, and `CalibratedModel.command_from_model` turns its path into commands; for trajectories `command_trajectory`.
- A planner that works on commanded joints takes poses, Jacobians and their time derivatives from `CalibratedModel`,
  which applies the chain rule: with the map ``theta(q)``, its Jacobian ``M`` and Pinocchio's ``J(theta)``::

      J_q = J M        dJ_q/dt = dJ/dt M + J dM/dt

- Trajectories have positions, speeds and accelerations. With what the last moves add, ``h(t)``
  (`irbcal.modeling.moves_along`)::

      theta = theta(q) + h      dtheta/dt = M dq/dt + dh/dt      d²theta/dt² = M d²q/dt² + dM/dt dq/dt + d²h/dt²

"World" is Pinocchio's universe: the root link of the URDF. That is the base link for most robots, the pedestal's or the
cell's first link where the arm stands on something, and the measuring frame where the URDF was written with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import CalibrationError, RobotError
from irbcal.io.opening import CalibrationLike, open_calibration, open_robot
from irbcal.io.urdf_check import LIMIT, ArmInModel
from irbcal.modeling import dhm, frames, moves_along
from irbcal.modeling.arm import Arm, relative_difference
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.moves_along import strides
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.term_sums import compiled
from irbcal.modeling.terms.payload import STANDARD_GRAVITY
from irbcal.modeling.thesis_map import is_of_the_thesis, stiffness_and_phases, with_mass
from irbcal.modeling.trajectory import Trajectory
from irbcal.modeling.trajectory_limits import Limits, TrajectoryLimitCheck, check, limits_in_order
from irbcal.planners import jacobians
from irbcal.planners.jacobians import LOCAL, LOCAL_WORLD_ALIGNED, WORLD
from irbcal.safe_files import libraries_silent
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG, MM
from irbcal.wording import first_of

if TYPE_CHECKING:
    import pinocchio as pin


def previous_on_path(theta: FloatArray, prismatic: BoolArray) -> FloatArray:
    """Stops before the points of a path that have the directions of its joint speeds.

    Points of a path lie close together, and the arm does not stop there: the sign of a joint's speed tells which side
    it leans to, not how far the last point is. So each point is taken as reached by a move along the path's last step
    that is long enough to take up all play.

    Parameters
    ----------
    theta : ndarray, shape (n, joints)
        Joints along the path, radians (metres for prismatic joints).
    prismatic : ndarray of bool, shape (joints,)

    Returns
    -------
    ndarray, shape (n, joints)
        NaN for the first point, and for others up to the first step that moves a joint. Points without a step keep the
        direction of those before.
    """
    stride = strides(prismatic)
    step = np.diff(theta, axis=0)
    size = np.abs(step / stride).max(axis=1, initial=0.0)
    longer = np.maximum(1.0, 1.0 / np.where(size > 0.0, size, np.inf))
    move = np.vstack([np.full((1, theta.shape[1]), np.nan), step * longer[:, None]])
    last = np.maximum.accumulate(np.where(np.r_[False, size > 0.0], np.arange(len(theta)), 0))
    return np.asarray(theta - move[last], dtype=float)


def with_payload(
    joint_map: JointMap,
    arm: Arm,
    model: pin.Model,
    arm_in_model: ArmInModel,
    q_rest: FloatArray,
    delta_kg: float,
    centre: ArrayLike | None = None,
    wrist: ArrayLike | None = None,
    masses: tuple[float, float] | None = None,
) -> JointMap:
    """The joint map with more (or less) mass on the tool than when the robot was measured.

    A sum of terms knows how each joint gives way, where several loads were measured: its load is changed, and neither
    masses nor a posture of the wrist matter.

    Parameters
    ----------
    joint_map : JointMap
    arm : Arm
        The calibrated arm.
    model : pinocchio.Model
        With the bodies of the URDF.
    arm_in_model : ArmInModel
    q_rest : ndarray, shape (nq,)
        Configuration of the joints outside the arm.
    delta_kg, place, wrist, masses
        See `irbcal.planners.calibrated_model.CalibratedModel.with_payload`.

    Raises
    ------
    RobotError
        If a sum of terms was identified with one load only; or for a level of the thesis if the arm has not six
        revolute joints, the joint map has no stiffness, or the URDF no masses.
    """
    if not is_of_the_thesis(joint_map):
        return _with_more(joint_map, delta_kg, centre)
    import pinocchio as pin

    if not arm.six_revolute:
        raise RobotError(f"the arm-stiffness model is for six revolute joints, {arm.name} has {arm.joints_listed}")
    theta = np.zeros(6)
    if wrist is not None:
        theta[3:] = wrist
    data = model.createData()
    pin.framesForwardKinematics(model, data, arm_in_model.configurations(theta[None], q_rest)[0])
    pin.centerOfMass(model, data)
    second, third, fifth = (arm_in_model.joint_ids[k] for k in (1, 2, 4))
    base = data.oMf[arm_in_model.base]
    axis = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0).z[1, :, 0]
    up = np.array([0.0, 0.0, 1.0])
    phases = stiffness_and_phases(joint_map)[1]
    along_upper, along_fore, across_fore = (
        np.cos(angle) * up + np.sin(angle) * frames.cross(axis, up) for angle in (*phases, phases[1] + np.pi / 2)
    )

    def from_joint(joint: int, point: FloatArray) -> FloatArray:
        return base.rotation.T @ (point - data.oMi[joint].translation)

    L_1 = float(along_upper @ from_joint(second, data.oMi[third].translation))
    L_2 = float(along_fore @ from_joint(third, data.oMi[fifth].translation))
    if masses is None:
        total, fore = data.mass[second], data.mass[third]
        upper = total - fore
        if not (upper > 0.0 and fore > 0.0):
            raise RobotError(
                f"the URDF of {arm.name} gives no masses of upper arm and forearm: give `masses`", parameter="masses"
            )
        moment = total * (data.oMi[second] * data.com[second]) - fore * (data.oMi[third] * data.com[third])
        L_G1 = float(along_upper @ from_joint(second, moment / upper))
    else:
        (upper, fore), L_G1 = masses, L_1 / 2
    tip = data.oMf[arm_in_model.tip]
    payload = from_joint(third, tip * np.array([0.0, 0.0, 0.0] if centre is None else centre, dtype=float))
    guess = replace(Stiffness.guess(L_1, L_2), L_G1=L_G1, m=fore / upper)
    return with_mass(joint_map, guess, delta_kg, upper, float(along_fore @ payload), float(across_fore @ payload))


def _with_more(joint_map: JointMap, delta_kg: float, centre: ArrayLike | None) -> JointMap:
    """A sum of terms with some mass added to what it carries."""
    load_before, place_before = joint_map.payload_kg or 0.0, joint_map.payload_centre
    load = load_before + float(delta_kg)
    if load < 0.0:
        raise RobotError(
            f"a payload {-delta_kg:g} kg smaller is impossible: the robot was measured with {load_before:g} kg",
            parameter="delta_kg",
        )
    if centre is None or load == 0.0 or place_before is None:
        return joint_map.carrying(load)
    return joint_map.carrying(load, (load_before * place_before + delta_kg * np.asarray(centre, dtype=float)) / load)


Reference: TypeAlias = "str | pin.ReferenceFrame"
"""One of Pinocchio's reference frames, by name or as it is."""
_REFERENCES = {LOCAL_WORLD_ALIGNED: 0, LOCAL: 1, WORLD: 2}
WITHIN = 1e-9
"""How far a command may lie beyond a limit, radians or metres: rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedModel(Result):
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
    joint_map: JointMap = None  # type: ignore[assignment]  # the identity of the arm unless given
    tip_frames: Mapping[str, FloatArray] = field(default_factory=dict)
    rest: FloatArray | None = None
    model: pin.Model = field(init=False)
    T_universe_base: FloatArray = field(init=False)
    _arm_in_model: ArmInModel = field(init=False)
    _q_rest: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        import pinocchio as pin

        if self.arm.joints_up:
            raise CalibrationError(
                f"planners need a base that stands: {self.arm.base_link} moves with {self.arm.joint_names[0]}"
            )
        if self.joint_map is None:
            object.__setattr__(self, "joint_map", JointMap.identity(self.arm))
        try:
            with libraries_silent():
                model = pin.buildModelFromXML(self.urdf.decode("utf-8"))
        except (ValueError, RuntimeError) as error:
            raise CalibrationError(f"Pinocchio cannot read this robot's URDF: {' '.join(str(error).split())}") from None
        arm_in_model = ArmInModel(model, self.arm)
        q_rest = np.array(pin.neutral(model) if self.rest is None else self.rest, dtype=float)
        if q_rest.shape != (model.nq,):
            raise CalibrationError(
                f"the configuration at rest needs shape ({model.nq},), found {q_rest.shape}", parameter="rest"
            )
        data = model.createData()
        pin.framesForwardKinematics(model, data, q_rest)
        tip_frames = {name: np.asarray(T_tip_frame, dtype=float) for name, T_tip_frame in self.tip_frames.items()}
        derived: dict[str, Any] = {
            "tip_frames": tip_frames,
            "model": model,
            "rest": q_rest,
            "_q_rest": q_rest,
            "T_universe_base": np.array(data.oMf[arm_in_model.base].homogeneous),
            "_arm_in_model": arm_in_model,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)
        lock(self)
        self._check_arm()
        self._add_frames()
        self._draw_in_limits()

    def __reduce__(self) -> tuple[type[CalibratedModel], tuple[Any, ...]]:
        """Pickled as what it was made from: Pinocchio's model is built again."""
        return CalibratedModel, (self.urdf, self.arm, self.joint_map, self.tip_frames, self.rest)

    def report(self) -> Sequence[Paragraph]:
        """The arm, its joint map, the frames on its tool, and the joints' limits."""
        arm, names = self.arm, list(self.tip_frames)
        listed = first_of(names, 9)
        headline = f"{arm.name}, {arm.joints_in_words}, {arm.tip_link} in {arm.base_link}; {self.joint_map.in_words}"
        columns = ("joint", "unit", "lower", "upper", "lower in the model", "upper in the model")
        return [
            headline,
            f"frames on the tool: {listed}" if names else "no frames on the tool",
            Table.from_frame(
                "Limits of commanded joints, and of effective joints in the model", self.to_frame(), columns
            ),
        ]

    CONTENT = "robot=arm.name base_link=arm.base_link tip_link=arm.tip_link frames=tip_frames.keys limits"
    COLUMNS = "*limits"

    def limits(self) -> dict[str, Sequence[str] | FloatArray]:
        """Columns, a row a joint: name, unit, limits as commanded and in the model; NaN where there is none."""
        arm = self.arm
        ends = np.array([arm.lower, arm.upper, *self.joint_map.effective_limits(arm.lower, arm.upper)])
        in_units = np.where(np.isfinite(ends), ends / arm.joint_units, np.nan)
        names = ("lower", "upper", "lower_in_model", "upper_in_model")
        return {"joint": arm.joint_names, "unit": arm.joint_unit_names, **dict(zip(names, in_units, strict=True))}

    @staticmethod
    def load(
        calibration: CalibrationLike, rest: ArrayLike | None = None, *, without_frame_terms: bool = False
    ) -> CalibratedModel:
        """The model of a calibration.

        Parameters
        ----------
        calibration : str, Path, Record or a result that holds one
            Calibration folder, or a loaded calibration of a robot that ships with the package.
        rest : ndarray, shape (nq,), optional
            See `CalibratedModel`.
        without_frame_terms : bool
            Plan with URDF and joint map alone where there are more.

        Returns
        -------
        CalibratedModel
            With a frame ``target_NAME`` for each reflector on the tool.

        Raises
        ------
        CalibrationError
            If the folder is not a whole calibration, its URDF is not known, or it has frame terms.
        """
        record, opened = open_calibration(calibration), open_robot(calibration)
        if opened.urdf_bytes is None:
            message = f"this calibration of {record.robot.name} does not hold the robot's URDF: give its folder instead"
            raise CalibrationError(message, parameter="calibration")
        if record.frame_terms is not None and not without_frame_terms:
            record.frame_terms.refuse()
        robot = opened.robot
        targets = {f"target_{k}": frames.transform(robot.target_rotations.get(k), p) for k, p in robot.targets.items()}
        at_rest = None if rest is None else np.array(rest, dtype=float)
        return CalibratedModel(opened.urdf_bytes, robot.arm, robot.joint_map, targets, at_rest)

    def _check_arm(self) -> None:
        q = self.arm.random_joints(5, seed=2)
        at_tip = self._arm_in_model.placements(self._arm_in_model.tip, q, self._q_rest)
        position, rotation = relative_difference(at_tip, self.arm.forward(q))
        if not max(position, rotation) <= LIMIT:
            raise CalibrationError(
                f"the URDF is not that of the calibrated {self.arm.name}: "
                f"its tip differs by {position / MM:.3g} mm and {rotation / DEG:.3g} degrees"
            )

    def _add_frames(self) -> None:
        import pinocchio as pin

        tip = self.model.frames[self._arm_in_model.tip]
        for name, T_tip_frame in self.tip_frames.items():
            if not self.model.existFrame(name):
                placement = tip.placement * pin.SE3(np.array(T_tip_frame))
                frame = pin.Frame(name, tip.parentJoint, self._arm_in_model.tip, placement, pin.FrameType.OP_FRAME)
                self.model.addFrame(frame, False)

    def _draw_in_limits(self) -> None:
        limits = self.joint_map.effective_limits(self.arm.lower, self.arm.upper)
        for joint, lower, upper in zip(self._arm_in_model.joint_ids, *limits, strict=True):
            joint = self.model.joints[joint]
            if joint.nq == 1 and np.isfinite([lower, upper]).all():
                self.model.lowerPositionLimit[joint.idx_q] = lower
                self.model.upperPositionLimit[joint.idx_q] = upper

    def model_from_command(self, q: ArrayLike, rest: ArrayLike | None = None) -> FloatArray:
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

        Raises
        ------
        RobotError
            If the joints have another shape, or look like degrees.
        """
        theta = self.joint_map.effective(q)
        return self._arm_in_model.configurations(theta, self._q_rest if rest is None else np.asarray(rest, dtype=float))

    def command_from_model(
        self, configurations: ArrayLike, path: bool = False, check_limits: bool = True
    ) -> FloatArray:
        """Commands that bring the robot into configurations of `model`: what to do with a planner's path.

        Parameters
        ----------
        configurations : array_like, shape (n, nq)
        path : bool
            The rows are one motion: joints come from the side that their speed tells (`previous_on_path`; unknown
            at the first row), and continuous joints go on turning beyond half a turn. Otherwise last moves are unknown,
            and continuous joints, as at a path's first row, lie between -180 and 180 degrees.
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
        theta = self._arm_in_model.joints(self._check_columns(configurations, self.model.nq, "configurations"))
        if path:
            continuous = [k for k, joint in enumerate(self._arm_in_model.joint_ids) if self.model.joints[joint].nq == 2]
            theta[:, continuous] = np.unwrap(theta[:, continuous], axis=0)
        previous = previous_on_path(theta, self.arm.table.prismatic) if path else None
        q = self.joint_map.commanded_unchecked(theta, previous)
        if check_limits:
            self.check_commands(q)
        return q

    def velocity_command(self, configurations: ArrayLike, velocities: ArrayLike) -> FloatArray:
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
        v = self._check_columns(velocities, self.model.nv, "velocities")[:, self._arm_in_model.columns]
        return np.asarray(np.linalg.solve(self.joint_map.jacobian(q), v[..., None])[..., 0], dtype=float)

    def beyond_limits(self, q: ArrayLike) -> FloatArray:
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

    def check_commands(self, q: ArrayLike) -> None:
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
            row, joint = int(rows[0]), int(np.argmax(beyond[rows[0]]))
            value, lower, upper = (
                f"{v[joint] / self.arm.joint_units[joint]:.6g}" for v in (q[row], self.arm.lower, self.arm.upper)
            )
            unit = "mm" if self.arm.table.prismatic[joint] else "degrees"
            raise CalibrationError(
                f"row {row + 1} commands {self.arm.joint_names[joint]} to {value} {unit}, outside its limits "
                f"{lower} to {upper} ({len(rows)} of {len(q)} rows are outside)",
                parameter=self.arm.joint_names[joint],
            )

    def _check_columns(self, values: ArrayLike, columns: int, quantity: str) -> FloatArray:
        values = np.atleast_2d(np.asarray(values, dtype=float))
        if values.ndim != 2 or values.shape[1] != columns:
            raise CalibrationError(
                f"{quantity} of {self.arm.name} need shape (n, {columns}), found {values.shape}", parameter=quantity
            )
        return values

    # Kinematics of commanded joints

    def placement(
        self,
        q: ArrayLike,
        frame: str | None = None,
        relative_to: str | None = None,
        previous: ArrayLike | None = None,
    ) -> FloatArray:
        """Where frames really are for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        frame, relative_to : str, optional
            Names of frames of `model`: a link, a joint, an added frame or ``universe``. By default the tip link,
            relative to the base link.
        previous : array_like, shape (n, joints), optional
            The stop before each, as commanded; unknown where not given or NaN.

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_relative_frame``.
        """
        if previous is None and relative_to is None and isinstance(q, np.ndarray) and q.ndim == 2:
            kernel = self._kernel(frame, False)
            T = np.empty((len(q), 4, 4))
            if kernel is not None and kernel.poses(q, None, True, T):
                return T
        theta = self.joint_map.effective(q, previous)
        numbers = (self._number(frame, self._arm_in_model.tip), self._number(relative_to, self._arm_in_model.base))
        T_universe_frame, T_universe_relative = (self._placements(theta, number) for number in numbers)
        return frames.inverse(T_universe_relative) @ T_universe_frame

    def jacobian(
        self,
        q: ArrayLike,
        frame: str | None = None,
        reference: Reference = LOCAL_WORLD_ALIGNED,
        previous: ArrayLike | None = None,
    ) -> FloatArray:
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
        previous : array_like, shape (n, joints), optional
            As `placement`; held.

        Returns
        -------
        ndarray, shape (n, 6, joints)
            Rows: linear, then angular velocity.
        """
        if previous is None and isinstance(q, np.ndarray) and q.ndim == 2 and str(reference) in _REFERENCES:
            kernel = self._kernel(frame, True)
            out = np.empty((len(q), 6, len(self.arm.lower)))
            if kernel is not None and kernel.jacobians(q, None, _REFERENCES[str(reference)], out):
                return out
        q = self.arm.check_joints(q)
        J = self._effective_jacobians(self.joint_map.effective(q, previous), None, frame, reference)[0]
        return J @ self.joint_map.jacobian(q, previous)

    def jacobian_derivative(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, reference: Reference = LOCAL_WORLD_ALIGNED
    ) -> FloatArray:
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
        if isinstance(q, np.ndarray) and q.ndim == 2 and str(reference) in _REFERENCES:
            kernel = self._kernel(frame, True)
            out = np.empty((len(q), 6, len(self.arm.lower)))
            if kernel is not None and kernel.rates(q, dq, _REFERENCES[str(reference)], out):
                return out
        q, dq = self.arm.check_joints(q), self.arm.check_shape(dq)
        M = self.joint_map.jacobian(q)
        dtheta = np.einsum("nij,nj->ni", M, dq)
        J, dJ = self._effective_jacobians(self.joint_map.effective(q), dtheta, frame, reference)
        assert dJ is not None  # speeds were given
        return dJ @ M + J @ self.joint_map.jacobian_derivative(q, dq)

    @cached_property
    def _kernels(self) -> dict[tuple[str | None, bool], Any]:
        return {}

    def _kernel(self, frame: str | None, in_universe: bool) -> Any:
        """The compiled kernel to a frame that the arm carries, from the universe or the base link; else None."""
        if (frame, in_universe) not in self._kernels:
            made, sums, listed = None, self.joint_map.sums, self.model.frames
            number = self._number(frame, self._arm_in_model.tip)
            carriers = [*self._arm_in_model.joint_ids[:-1], listed[self._arm_in_model.tip].parentJoint]
            if sums is not None and listed[number].parentJoint in carriers:
                depth = carriers.index(listed[number].parentJoint) + 1
                T_base_0 = self.T_universe_base @ self.arm.T_base_0 if in_universe else self.arm.T_base_0
                to_frame = replace(self.arm, T_base_0=T_base_0, T_last_tip=self._behind(depth, number))
                made = compiled(to_frame, None if self.joint_map.is_identity else sums, depth=depth)
            self._kernels[frame, in_universe] = made
        return self._kernels[frame, in_universe]

    def _behind(self, depth: int, frame: int) -> FloatArray:
        """Place of a frame in the DHM frame of the link that it is fixed to, the one behind so many joints, (4, 4)."""
        listed = self.model.frames
        if depth == len(self.arm.lower):
            T_tip_frame = listed[self._arm_in_model.tip].placement.actInv(listed[frame].placement).homogeneous
            return np.asarray(self.arm.T_last_tip @ T_tip_frame)
        zero = np.zeros((1, len(self.arm.lower)))
        T_base_link = self.arm.T_base_0
        for k in range(depth):
            T_base_link = T_base_link @ self.arm.table.step(k)
        T_base_frame = self._arm_in_model.placements(frame, zero, self._q_rest)[0]
        return np.asarray(frames.inverse(T_base_link) @ T_base_frame)

    def _number(self, frame: str | None, default: int) -> int:
        return default if frame is None else self._arm_in_model.frame(frame)

    def _fixed_to_tip(self, frame: int) -> bool:
        return self.model.frames[frame].parentJoint == self.model.frames[self._arm_in_model.tip].parentJoint

    def _placements(self, theta: FloatArray, frame: int) -> FloatArray:
        """``T_universe_frame`` for effective joints, (n, 4, 4); without a loop for what is fixed to base or tip."""
        listed = self.model.frames
        if self._fixed_to_tip(frame):
            T_tip_frame = listed[self._arm_in_model.tip].placement.actInv(listed[frame].placement).homogeneous
            return self.T_universe_base @ self.arm.forward(theta) @ T_tip_frame
        if listed[frame].parentJoint == listed[self._arm_in_model.base].parentJoint:
            T_base_frame = listed[self._arm_in_model.base].placement.actInv(listed[frame].placement).homogeneous
            return np.broadcast_to(self.T_universe_base @ T_base_frame, (len(theta), 4, 4))
        return self.T_universe_base @ self._arm_in_model.placements(frame, theta, self._q_rest)

    def _effective_jacobians(
        self, theta: FloatArray, dtheta: FloatArray | None, frame: str | None, reference: Reference
    ) -> jacobians.JacobianAndRate:
        """Jacobian by effective joints and its time derivative (None without speeds), each (n, 6, joints)."""
        reference = str(reference)
        if reference not in (WORLD, LOCAL, LOCAL_WORLD_ALIGNED):
            raise CalibrationError(
                f"unknown reference frame {reference!r}: expected LOCAL, WORLD, LOCAL_WORLD_ALIGNED",
                parameter="reference",
            )
        number = self._number(frame, self._arm_in_model.tip)
        if self._fixed_to_tip(number):
            world = jacobians.along_chain(self.arm, self.T_universe_base, theta, dtheta)
        else:
            world = jacobians.by_pinocchio(self.model, self._arm_in_model, number, theta, dtheta, self._q_rest)
        return jacobians.referred(world, dtheta, self._placements(theta, number), reference)

    # Payload

    def with_payload(
        self,
        delta_kg: float,
        payload_centre: ArrayLike | None = None,
        wrist: ArrayLike | None = None,
        masses: tuple[float, float] | None = None,
    ) -> CalibratedModel:
        """The model with more (or less) mass on the tool than when the robot was measured.

        A calibration of model ``auto`` from measurements with several loads knows how each joint gives way: its load is
        changed. For levels of the thesis the arm's stiffness is split into compliance and masses, by the inertials of
        the URDF, and new torques on axes 2 and 3 give new terms (Nubiola 2011, section 5.3; `Stiffness.with_payload`).

        Parameters
        ----------
        delta_kg : float
            Mass added; negative if it carries less.
        payload_centre : array_like, shape (3,), optional
            Centre of the added mass in the tip link, metres; the tip's origin (``auto``: that of the fit) unless given.
        wrist : array_like, optional
            Joints behind joint 3 at which the mass's lever is taken, radians; zero unless given. The stiffness terms
            know only joints 2 and 3, so one typical posture of the wrist stands for all.
        masses : tuple of float, optional
            Mass of upper arm (what axis 2 carries and axis 3 does not) and of forearm with all it carried when it was
            measured, kg, for URDFs without inertials; the upper arm's centre is then taken at its middle.

        Returns
        -------
        CalibratedModel
            With another joint map; the bodies of `model` weigh what they weighed.

        Raises
        ------
        RobotError
            If the calibration has no stiffness, or ``auto`` knows one load only, or the URDF has no masses.

        Notes
        -----
        Of a level a physical guess: positions show compliance times mass only, and the masses in a URDF may be
        estimates. The wrist is taken as stiff and the base as upright. For 3 kg on a stretched IRB 1600 it gives 0.16
        mm (simulated demo, estimated masses) to 0.24 mm (Nubiola 2011, section 5.3), where 0.3 mm was measured (Table
        4.3).
        """
        state = self.model, self._arm_in_model, self._q_rest
        changed = with_payload(self.joint_map, self.arm, *state, delta_kg, payload_centre, wrist, masses)
        return replace(self, joint_map=changed)

    # --- trajectories

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
        model, columns = self.model, self._arm_in_model.columns
        theta = self._arm_in_model.joints(self._check_columns(configurations, model.nq, "configurations"))
        endless = [k for k, joint in enumerate(self._arm_in_model.joint_ids) if model.joints[joint].nq == 2]
        theta[:, endless] = np.unwrap(theta[:, endless], axis=0)
        v = None if velocities is None else self._check_columns(velocities, model.nv, "velocities")[:, columns]
        a = None if accelerations is None else self._check_columns(accelerations, model.nv, "accelerations")[:, columns]
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
                wide[:, self._arm_in_model.columns] = values
            derivatives.append(wide)
        return self._arm_in_model.configurations(ordered.q, self._q_rest), derivatives[0], derivatives[1]

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
    ) -> TrajectoryLimitCheck:
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
        TrajectoryLimitCheck
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
        speeds = np.array(self.model.velocityLimit)[self._arm_in_model.columns]
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
        payload_centre: ArrayLike = (0.0, 0.0, 0.0),
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
        payload_centre : array_like, shape (3,)
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
        if not any(model.inertias[joint].mass > 0.0 for joint in self._arm_in_model.joint_ids):
            raise CalibrationError(
                f"the URDF of {self.arm.name} has no inertials for the links that its joints move: nothing is known of "
                "its torques"
            )
        theta = self.joint_map.effective(q, previous)
        out = np.empty(theta.shape)
        for k, configuration in enumerate(self._arm_in_model.configurations(theta, self._q_rest)):
            out[k] = pin.computeGeneralizedGravity(model, data, configuration)[self._arm_in_model.columns]
        if payload_kg:
            J = jacobians.along_chain(self.arm, self.T_universe_base, theta, None)[0]
            point = np.append(np.asarray(payload_centre, dtype=float), 1.0)
            p = (self.T_universe_base @ self.arm.forward(theta) @ point)[:, :3, None]
            weight = payload_kg * STANDARD_GRAVITY * model.gravity.linear / np.linalg.norm(model.gravity.linear)
            out -= np.einsum("i,nij->nj", weight, J[:, :3] + np.cross(J[:, 3:], p, axis=1))
        return out
