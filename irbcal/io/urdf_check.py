"""Pinocchio and yourdfpy as independent witnesses of a URDF's forward kinematics.

Where Pinocchio is not installed (there are no wheels for Windows), irbcal's own reader of the file takes its place.

yourdfpy names a library of meshes in its signatures. That library (trimesh, with what it brings of scipy and networkx)
takes half a second to load and is for scenes. Reading a URDF and the transforms of its joints need its
`transformations` alone. All of it is loaded where anybody asks for it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.errors import CalibrationError
from irbcal.io import urdf
from irbcal.modeling.arm import Arm, relative_difference
from irbcal.safe_files import libraries_silent
from irbcal.section import Name, Section

if TYPE_CHECKING:
    import pinocchio as pin

MESHES = "trimesh"
JOINT_TRANSFORM = "_forward_kinematics_joint"
"""Its transform of one joint, which needs no scene."""


class _Later(ModuleType):
    """In the place of a package until an attribute of it is asked for; its submodules can be loaded without it."""

    def __init__(self, name: str, names: tuple[str, ...]) -> None:
        super().__init__(name)
        spec = find_spec(name)
        self.__spec__, self.__path__ = spec, list((spec and spec.submodule_search_locations) or [])
        self._names: tuple[str, ...] = names

    def __getattr__(self, name: str) -> Any:
        if name in self._names:
            return Any
        if name.startswith("__"):
            raise AttributeError(name)
        self._leave()
        return getattr(import_module(self.__name__), name)

    def _leave(self) -> None:
        """Make room for the package itself."""
        self._names = ()
        if sys.modules.get(self.__name__) is self:
            for loaded in [key for key in sys.modules if key == self.__name__ or key.startswith(f"{self.__name__}.")]:
                del sys.modules[loaded]


def yourdfpy() -> ModuleType:
    """The package, which loads meshes' library when a scene is built."""
    if "yourdfpy" in sys.modules or MESHES in sys.modules or find_spec(MESHES) is None:
        return import_module("yourdfpy")
    later = _Later(MESHES, ("Scene", "Trimesh"))  # the names in its signatures
    sys.modules[MESHES] = later
    try:
        return import_module("yourdfpy")
    finally:
        later._leave()


def poses_by_yourdfpy(urdf_bytes: bytes, arm: Arm, q: FloatArray) -> FloatArray:
    """As `poses_by_yourdfpy`, by yourdfpy: its reading of the file, and the product of its joints' transforms."""
    reader = yourdfpy().URDF
    direct = hasattr(reader, JOINT_TRANSFORM)  # another version may have it under another name: then with its scene
    robot = reader.load(
        BytesIO(urdf_bytes), build_scene_graph=not direct, load_meshes=False, build_collision_scene_graph=False
    )
    above = {joint.child: joint for joint in robot.robot.joints}

    def from_root(link: str) -> FloatArray:
        T = np.eye(4)
        while link in above:
            T = getattr(robot, JOINT_TRANSFORM)(above[link])[0] @ T
            link = above[link].parent
        return T

    out = np.empty((len(q), 4, 4))
    for k, row in enumerate(q.tolist()):
        robot.update_cfg(dict(zip(arm.joint_names, row, strict=True)))
        if direct:
            out[k] = np.linalg.solve(from_root(arm.base_link), from_root(arm.tip_link))
        else:
            out[k] = robot.get_transform(arm.tip_link, arm.base_link)
    return out


CHECK_POSES = 500
SECOND_POSES = 20
"""Poses that yourdfpy computes, too: one by one, in Python."""
LIMIT = 1e-9
"""Largest disagreement (metres, radians) with which a written URDF is accepted."""


class ArmInModel:
    """Where the joints and links of an arm stand in a Pinocchio model, and the arm's joints in its configurations.

    Raises
    ------
    CalibrationError
        If the model has no such joint or link.
    """

    columns: IntArray

    def __init__(self, model: pin.Model, arm: Arm) -> None:
        missing = [name for name in arm.joint_names if not model.existJointName(name)]
        if missing:
            raise CalibrationError(f"the model of {arm.name} has no joint {missing[0]!r}")
        self.model = model
        self.joint_ids = [model.getJointId(name) for name in arm.joint_names]
        """Pinocchio's numbers of the arm's joints, from base to tip."""
        self._joints = [model.joints[k] for k in self.joint_ids]
        self.columns = np.array([joint.idx_v for joint in self._joints])
        """Shape (joints,). Place of each joint in Pinocchio's velocities."""
        self.base, self.tip = self.frame(arm.base_link), self.frame(arm.tip_link)
        """``base``, ``tip``: pinocchio's numbers of the frames of base and tip link."""

    def frame(self, name: str) -> int:
        """Number of a frame: a link where there is one of that name, else a joint or an added frame.

        Raises
        ------
        CalibrationError
            If there is no such frame.
        """
        names = [frame.name for frame in self.model.frames]
        if self.model.existBodyName(name):
            return self.model.getBodyId(name)
        if name not in names:
            raise CalibrationError(f"there is no frame {name!r}; frames are {', '.join(names)}")
        return names.index(name)

    def configurations(self, joints: FloatArray, q_rest: FloatArray) -> FloatArray:
        """Configurations with the arm's joints at given places.

        Parameters
        ----------
        joints : ndarray, shape (n, joints)
            Effective joints, radians (metres for prismatic joints).
        q_rest : ndarray, shape (nq,) or (n, nq)
            Configuration of all joints; those of the arm are replaced.

        Returns
        -------
        ndarray, shape (n, nq)
            Continuous joints are there as (cos, sin).
        """
        out = np.array(np.broadcast_to(q_rest, (len(joints), self.model.nq)), dtype=float)
        for joint, value in zip(self._joints, np.asarray(joints).T, strict=True):
            if joint.nq == 1:
                out[:, joint.idx_q] = value
            else:
                out[:, joint.idx_q], out[:, joint.idx_q + 1] = np.cos(value), np.sin(value)
        return out

    def joints(self, configurations: FloatArray) -> FloatArray:
        """The arm's joints in configurations: the inverse of `configurations`.

        Parameters
        ----------
        configurations : ndarray, shape (n, nq)

        Returns
        -------
        ndarray, shape (n, joints)
            Effective joints, radians (metres for prismatic joints); continuous ones between -pi and pi.
        """
        out = np.empty((len(configurations), len(self._joints)))
        for k, joint in enumerate(self._joints):
            first = configurations[:, joint.idx_q]
            out[:, k] = first if joint.nq == 1 else np.arctan2(configurations[:, joint.idx_q + 1], first)
        return out

    def placements(self, frame: int, joints: FloatArray, q_rest: FloatArray) -> FloatArray:
        """``T_base_frame`` of any frame, pose by pose, shape (n, 4, 4); see `configurations`."""
        import pinocchio as pin

        data = self.model.createData()
        out = np.empty((len(joints), 4, 4))
        for k, configuration in enumerate(self.configurations(joints, q_rest)):
            pin.framesForwardKinematics(self.model, data, configuration)
            out[k] = data.oMf[self.base].actInv(data.oMf[frame]).homogeneous
        return out


def poses(urdf_bytes: bytes, arm: Arm, q: FloatArray) -> FloatArray:
    """Tip poses in the base link as Pinocchio computes them from a URDF.

    Parameters
    ----------
    urdf_bytes : bytes
        Content of the URDF.
    arm : Arm
        Names of the joints, base and tip.
    q : ndarray, shape (n, joints)
        Effective joints (not commanded ones), radians (metres for prismatic joints).

    Returns
    -------
    ndarray, shape (n, 4, 4)
    """
    import pinocchio as pin

    with libraries_silent():
        model = pin.buildModelFromXML(urdf_bytes.decode("utf-8"))
    arm_in_model = ArmInModel(model, arm)
    return arm_in_model.placements(arm_in_model.tip, q, pin.neutral(model))


def poses_by_irbcal(urdf_bytes: bytes, arm: Arm, q: FloatArray) -> FloatArray:
    """As `poses`, by irbcal's own reader: it sees what the file says, not the arm that was written."""
    return urdf.from_bytes(urdf_bytes, "the written URDF", arm.base_link, arm.tip_link).arm.forward(q)


class UrdfCheck(Section):
    """Largest disagreement of the calibrated robot with readers of the written URDF, and how many poses each read."""

    position_m: float
    rotation_rad: float
    witnesses: dict[Name, int]

    def in_words(self) -> str:
        """The witnesses, each with its poses."""
        return " and ".join(f"{name} ({poses} poses)" for name, poses in self.witnesses.items())


def check(urdf_bytes: bytes, arm: Arm, seed: int = 0, n: int = CHECK_POSES) -> UrdfCheck:
    """Compare an arm's forward kinematics with that of two other readers of a URDF, at random poses in the limits.

    Raises
    ------
    CalibrationError
        If a difference is above 1e-9 m or 1e-9 rad: the URDF does not describe the calibrated arm.
    """
    q = arm.random_joints(n, seed)
    T_own = arm.forward(q)
    position, rotation = 0.0, 0.0
    first = ("Pinocchio", poses) if find_spec("pinocchio") else ("irbcal's reader", poses_by_irbcal)
    witnesses = {first[0]: n, "yourdfpy": min(n, SECOND_POSES)}
    for (name, compute), count in zip((first, ("yourdfpy", poses_by_yourdfpy)), witnesses.values(), strict=True):
        try:
            theirs = compute(urdf_bytes, arm, q[:count])
        except Exception as error:  # whatever a foreign reader raises
            raise CalibrationError(f"{name} cannot read this robot's URDF: {' '.join(str(error).split())}") from error
        difference = relative_difference(theirs, T_own[:count])
        if not max(difference) <= LIMIT:
            raise CalibrationError(
                f"{name} disagrees with the calibrated robot by {difference[0]:.2g} m and {difference[1]:.2g} rad "
                f"(at most {LIMIT:g} is accepted): the URDF was not written"
            )
        position, rotation = max(position, difference[0]), max(rotation, difference[1])
    return UrdfCheck(position_m=position, rotation_rad=rotation, witnesses=witnesses)
