r"""Residuals of measured points and their analytic Jacobian, summed block by block into normal equations.

Residuals are taken in the robot's base link, where the distance is the same as in the measuring frame and
the base correction takes its simplest form::

    r = T_world_base^-1 y - p(q)

Partial derivatives of a point ``p`` of the tool, all in the base link (frames as in `irbcal.modeling.dhm`):

=================  ==========================================
parameter          derivative of ``p``
=================  ==========================================
``alpha_i``        ``x_{i-1} x (p - o_{i-1})``
``a_i``            ``x_{i-1}``
``theta_i``        ``z_i x (p - o_i)``
``d_i``            ``z_i``
``beta_i``         ``y_i x (p - o_i^tilt)``
joint map          ``sum_i dp/dtheta_i dtheta_i/dparameter``
target             axes of the tip link
base               rotation ``e x p``, translation ``e``
=================  ==========================================
"""

from dataclasses import dataclass

import numpy as np

from irbcal.modeling import dhm, frames, parameters
from irbcal.modeling.jointmap import JointMap, fourier_terms, stiffness_terms

BLOCK = 2048
"""Poses whose Jacobian is in memory at a time."""


@dataclass(frozen=True, eq=False)
class State:
    """One candidate: base, targets and error parameters.

    Attributes
    ----------
    T_world_base : ndarray, shape (4, 4)
    targets : ndarray, shape (T, 3)
        In the tip link, metres.
    errors : ndarray, shape (k,)
        Error parameters, SI units.
    """

    T_world_base: np.ndarray
    targets: np.ndarray
    errors: np.ndarray

    def moved(self, step):
        """The state after a step (6 base, 3 T targets, k errors).

        The base moves by a rotation vector and a translation given in the base link.
        """
        shift = frames.transform(frames.rotation_from_vector(step[:3]), step[3:6])
        count = self.targets.size
        return State(
            self.T_world_base @ shift,
            self.targets + step[6 : 6 + count].reshape(-1, 3),
            self.errors + step[6 + count :],
        )


class Problem:
    """Measured points against an arm with given error parameters.

    Parameters
    ----------
    arm : Arm
        The nominal arm.
    points : PointSet
    error_parameters : sequence of Parameter
    phases : array_like, shape (2,)
        Of the stiffness terms, see `irbcal.modeling.jointmap`.
    """

    def __init__(self, arm, points, error_parameters, phases=(0.0, np.pi / 2)):
        self.arm = arm
        self.points = points
        self.parameters = tuple(error_parameters)
        self.joint_map = JointMap(phases=phases)
        self.targets = len(points.target_names)
        self._plan = [(slot, p.kind, p.index) for slot, p in enumerate(self.parameters)]
        starts = range(0, points.poses, BLOCK)
        edges = np.searchsorted(points.pose, [*starts, points.poses])
        self._blocks = []
        for k, start in enumerate(starts):
            rows = slice(edges[k], edges[k + 1])
            q = points.q[start : start + BLOCK]
            upper, fore = stiffness_terms(q, self.joint_map.phases)
            self._blocks.append(
                {
                    "q": q,
                    "pose": points.pose[rows] - start,
                    "target": points.target[rows],
                    "xyz": np.ascontiguousarray(points.xyz[rows].T),
                    "stiffness": (upper, fore),
                    "fourier": fourier_terms(q),
                }
            )

    @property
    def unknowns(self):
        """Number of unknowns: base, targets and error parameters."""
        return 6 + 3 * self.targets + len(self.parameters)

    def model(self, state):
        """Arm and joint map with the state's error parameters added."""
        table, joint_map = parameters.apply(self.parameters, state.errors, self.arm.table, self.joint_map)
        return self.arm.with_table(table), joint_map

    def residuals(self, state):
        """Residuals of all points in the base link, shape (m, 3), metres."""
        arm, joint_map = self.model(state)
        return np.concatenate([self._block(block, arm, joint_map, state, False)[0].T for block in self._blocks])

    def jacobian(self, state):
        """Derivative of all predicted points, shape (3 m, unknowns), points' x, y, z side by side.

        For tests and small problems; fits use `normal_equations`.
        """
        arm, joint_map = self.model(state)
        parts = [self._block(block, arm, joint_map, state, True)[1] for block in self._blocks]
        return np.concatenate([J.transpose(2, 1, 0).reshape(-1, self.unknowns) for J in parts])

    def normal_equations(self, state):
        """Sums over all points, a block of poses at a time.

        Returns
        -------
        H : ndarray, shape (unknowns, unknowns)
            Sum of ``J^T J``.
        g : ndarray, shape (unknowns,)
            Sum of ``J^T r``.
        rss : float
            Sum of squared residuals, m^2.
        """
        arm, joint_map = self.model(state)
        H, g, rss = 0.0, 0.0, 0.0
        for block in self._blocks:
            r, J = self._block(block, arm, joint_map, state, True)
            flat = J.reshape(self.unknowns, -1)
            r = r.ravel()
            H = H + flat @ flat.T
            g = g + flat @ r
            rss += r @ r
        return H, g, rss

    def rss(self, state):
        """Sum of squared residuals, m^2."""
        return float(np.sum(self.residuals(state) ** 2))

    def _block(self, block, arm, joint_map, state, with_jacobian):
        """Residuals (3, m) and, on request, derivatives of the points (unknowns, 3, m) of one block."""
        table, pose, target = arm.table, block["pose"], block["target"]
        theta = joint_map.effective(block["q"]).T + table.theta[:, None]
        if with_jacobian:
            chain = dhm.chain_frames(table, theta, arm.T_base_0, arm.T_6_tip)
            tip = chain.tip[..., pose]
        else:
            tip = dhm.tip_columns(table, theta, arm.T_base_0, arm.T_6_tip)[..., pose]
        local = state.targets[target].T
        p = tip[3] + tip[0] * local[0] + tip[1] * local[1] + tip[2] * local[2]
        T_base_world = frames.inverse(state.T_world_base)
        r = T_base_world[:3, :3] @ block["xyz"] + T_base_world[:3, 3:] - p
        if not with_jacobian:
            return r, None
        J = np.zeros((self.unknowns, 3, len(pose)))
        J[0, 1], J[0, 2] = -p[2], p[1]
        J[1, 0], J[1, 2] = p[2], -p[0]
        J[2, 0], J[2, 1] = -p[1], p[0]
        J[3, 0] = J[4, 1] = J[5, 2] = 1.0
        for k in range(self.targets):
            mine = target == k
            J[6 + 3 * k : 9 + 3 * k, :, mine] = tip[:3, :, mine]
        self._robot_columns(J[6 + 3 * self.targets :], chain, p, block)
        return r, J

    def _robot_columns(self, J, chain, p, block):
        """Fill derivatives by the robot's error parameters, (k, 3, m)."""
        pose = block["pose"]
        kinds = {kind for _, kind, _ in self._plan}
        columns = {}
        if "a" in kinds or "alpha" in kinds:
            columns["a"] = chain.x_before[..., pose]
        if "alpha" in kinds:
            columns["alpha"] = _turned(columns["a"], chain.o_before[..., pose], p)
        if kinds & {"d", "theta", "stiffness", "fourier", "gain"}:
            columns["d"] = chain.z[..., pose]
            columns["theta"] = _turned(columns["d"], chain.o[..., pose], p)
        if "beta" in kinds:
            columns["beta"] = _turned(chain.y_tilt[..., pose], chain.o_tilt[..., pose], p)
        for slot, kind, index in self._plan:
            if kind in columns:
                J[slot] = columns[kind][index]
            elif kind == "gain":
                J[slot] = columns["theta"][index] * block["q"][pose, index]
            elif kind == "fourier":
                J[slot] = columns["theta"][5] * block["fourier"][index, pose]
            elif index == 0:  # stiffness A
                J[slot] = columns["theta"][1] * block["stiffness"][0][pose]
            else:  # stiffness B
                J[slot] = (columns["theta"][1] + columns["theta"][2]) * block["stiffness"][1][pose]


def _turned(axis, origin, p):
    """Velocity ``axis x (p - origin)`` for axes and origins (joints, 3, m) and points (3, m)."""
    arm = p - origin
    out = np.empty_like(axis)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(axis[:, i], arm[:, j], out=out[:, k])
        out[:, k] -= axis[:, j] * arm[:, i]
    return out
