"""The nominal arm: a DHM chain between a base link and a tip link, with names and limits."""

from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import RobotError
from irbcal.modeling import dhm, frames
from irbcal.modeling.joint_map import Stiffness
from irbcal.units import DEG, MM


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm; most have six revolute joints.

    Parameters
    ----------
    name : str
    table : DHMTable
    T_base_0 : ndarray, shape (4, 4)
        DHM frame 0 in the base link (identity for arms whose first axis is the base's z).
    T_last_tip : ndarray, shape (4, 4)
        Tip link in the last DHM frame (identity where the tip's z lies on the last axis).
    joint_names : tuple of str
    lower, upper : ndarray, shape (n,)
        Joint limits, radians (metres for prismatic joints); infinite for continuous joints.
    base_link, tip_link : str
    """

    name: str
    table: dhm.DHMTable
    T_base_0: np.ndarray
    T_last_tip: np.ndarray
    joint_names: tuple
    lower: np.ndarray
    upper: np.ndarray
    base_link: str = "base_link"
    tip_link: str = "tool0"

    def __post_init__(self):
        for key in ("T_base_0", "T_last_tip", "lower", "upper"):
            value = np.array(getattr(self, key), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    @property
    def six_revolute(self):
        """Whether the arm has six revolute joints: what the thesis's error models and closed forms are made for."""
        return len(self.joint_names) == 6 and not self.table.prismatic.any()

    @property
    def planar(self):
        """Whether all turning axes are parallel (SCARA): such an arm cannot tell its base from its tool in all ways."""
        values = self.random_joints(3, 0).T + self.table.offsets[:, None]
        turning = dhm.chain_frames(self.table, values, self.T_base_0).z[~self.table.prismatic]
        return bool(np.abs(np.cross(turning, turning[:1, :, :1], axis=1)).max(initial=0.0) < np.sin(1.0 * DEG))

    @property
    def joint_columns(self):
        """Columns of joint values in files: ``q1_deg`` and so on, ``q1_mm`` for a prismatic joint."""
        return [f"q{i}_{'mm' if slides else 'deg'}" for i, slides in enumerate(self.table.prismatic, start=1)]

    @property
    def joint_units(self):
        """SI value of one unit of each column of `joint_columns`, shape (n,)."""
        return np.where(self.table.prismatic, MM, DEG)

    def with_table(self, table):
        """The same arm with another DHM table."""
        return replace(self, table=table)

    def forward(self, theta):
        """Tip poses in the base link.

        Parameters
        ----------
        theta : ndarray, shape (n, joints)
            Effective joints, radians and metres.

        Returns
        -------
        ndarray, shape (n, 4, 4)
            ``T_base_tip``.
        """
        return dhm.forward(self.table, theta, self.T_base_0, self.T_last_tip)

    def random_joints(self, n, seed):
        """Uniform random joints inside the limits (a full turn or 1 m either way where there are none), (n, joints)."""
        free = np.where(self.table.prismatic, 1.0, np.pi)
        lower = np.where(np.isfinite(self.lower), self.lower, -free)
        upper = np.where(np.isfinite(self.upper), self.upper, free)
        return np.random.default_rng(seed).uniform(lower, upper, (n, len(lower)))

    def stiffness_geometry(self):
        """What the arm-stiffness model needs to know of the arm (Nubiola 2011, figure 5.3).

        Returns
        -------
        phases : ndarray, shape (2,)
            Angles of upper arm and forearm from the vertical at zero joints, about axes 2 and 3, radians.
        stiffness : Stiffness
            The physical guess of eqs. 5.19 to 5.22 for this arm's lengths.

        Raises
        ------
        RobotError
            If the arm has not six revolute joints, or axes 2 and 3 are not horizontal and parallel: gravity then acts
            otherwise than the model says.
        """
        if not self.six_revolute:
            raise RobotError(f"the arm-stiffness model is for six revolute joints, {self.name} has others")
        chain = dhm.chain_frames(self.table, self.table.offsets[:, None], self.T_base_0)
        z, o = chain.z[:, :, 0], chain.o[:, :, 0]
        axis = z[1]
        if abs(axis[2]) > 1e-6 or abs(axis @ z[2] - 1.0) > 1e-9:
            raise RobotError(
                f"the arm-stiffness model needs axes 2 and 3 horizontal and pointing the same way, but those of "
                f"{self.name} point along {np.round(z[1], 3) + 0.0} and {np.round(z[2], 3) + 0.0} in {self.base_link}: "
                "use model placement"
            )
        upper = o[2] - o[1] - axis * (axis @ (o[2] - o[1]))
        # the forearm runs along axis 4 where that lies in the arm's plane (spherical wrist), else to axis 4
        fore = z[3] * self.table.d[3] if abs(axis @ z[3]) < 0.5 else o[3] - o[2]
        fore = fore - axis * (axis @ fore)
        up = np.array([0.0, 0.0, 1.0])
        phases = np.array([np.arctan2(axis @ np.cross(up, v), up @ v) for v in (upper, fore)])
        return phases, Stiffness.guess(np.linalg.norm(upper), np.linalg.norm(fore))

    def check_joints(self, q):
        """Refuse joint arrays that are not (n, joints)."""
        q = np.atleast_2d(np.asarray(q, dtype=float))
        joints = len(self.joint_names)
        if q.ndim != 2 or q.shape[1] != joints:
            raise RobotError(f"joints of {self.name} need shape (n, {joints}), found {q.shape}")
        return q


def relative_difference(T_1, T_2):
    """Largest distance of origins (m) and largest relative rotation (rad) of two batches of poses."""
    position = np.linalg.norm(T_1[..., :3, 3] - T_2[..., :3, 3], axis=-1).max()
    return position, frames.rotation_distance(T_1[..., :3, :3], T_2[..., :3, :3]).max()
