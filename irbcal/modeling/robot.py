"""A robot as calibration knows it: geometry, joint map, place of the base and targets on the tool."""

from dataclasses import dataclass, field, replace

import numpy as np

from irbcal.errors import RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap


@dataclass(frozen=True, eq=False)
class Robot:
    """Predicts poses and reflector positions from commanded joints.

    Parameters
    ----------
    arm : Arm
        Geometry (nominal or calibrated).
    joint_map : JointMap
    T_world_base : ndarray, shape (4, 4)
        The base link in the measuring frame ("world").
    targets : dict of str to ndarray, shape (3,)
        Reflector positions in the tip link, metres.
    target_rotations : dict of str to ndarray, shape (3, 3)
        Orientation in the tip link of the targets that have one.
    """

    arm: Arm
    joint_map: JointMap = field(default_factory=JointMap)
    T_world_base: np.ndarray = field(default_factory=lambda: np.eye(4))
    targets: dict = field(default_factory=dict)
    target_rotations: dict = field(default_factory=dict)

    def __post_init__(self):
        T = np.array(self.T_world_base, dtype=float)
        T.setflags(write=False)
        object.__setattr__(self, "T_world_base", T)
        object.__setattr__(self, "targets", {k: np.array(v, dtype=float) for k, v in self.targets.items()})

    def poses(self, q):
        """Tip poses in the base link for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_base_tip``.
        """
        return self.arm.forward(self.joint_map.effective(self.arm.check_joints(q)))

    def points(self, q, target):
        """Positions of reflectors in the measuring frame for commanded joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Radians (metres for prismatic joints).
        target : str or sequence of str, length n
            One target for all poses, or one for each.

        Returns
        -------
        ndarray, shape (n, 3)
            Metres.

        Raises
        ------
        RobotError
            If a target is not one of the robot's.
        """
        q = self.arm.check_joints(q)
        names = [target] if isinstance(target, str) else list(target)
        unknown = sorted(set(names) - set(self.targets))
        if unknown:
            raise RobotError(f"unknown target {unknown[0]!r}: this robot has {', '.join(self.targets) or 'none'}")
        local = np.array([self.targets[name] for name in names])
        T = self.poses(q)
        base = np.einsum("nij,nj->ni", T[:, :3, :3], np.broadcast_to(local, (len(q), 3))) + T[:, :3, 3]
        return base @ self.T_world_base[:3, :3].T + self.T_world_base[:3, 3]

    def replace(self, **changes):
        """A copy with some fields changed."""
        return replace(self, **changes)

    @property
    def table(self) -> dhm.DHMTable:
        """The DHM table in use."""
        return self.arm.table
