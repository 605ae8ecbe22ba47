"""Base and tool in closed form: a start that needs no guess.

A target at ``c`` in the tip link, seen at ``y`` in the measuring frame while the tip is at ``(R_j, p_j)`` in the
base link, obeys ``W y + s - R_j c = p_j`` with ``W`` the inverse base rotation and ``s`` the inverse base
translation. That is linear in the nine entries of ``W``, in ``s`` and in all targets; the rotation nearest to
the least-squares ``W`` starts the fit.
"""

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification.residuals import State
from irbcal.modeling import dhm, frames


def closed_form(arm, points, errors=0):
    """First guess of base and targets from nominal kinematics.

    Parameters
    ----------
    arm : Arm
    points : PointSet
    errors : int
        Number of error parameters of the state to make (they start at zero).

    Returns
    -------
    state : State
    spread : float
        Ratio of the smallest to the largest singular value of the scaled linear system; near zero the data
        do not determine base and tool in this way.

    Raises
    ------
    IdentificationError
        If there are fewer equations than the 12 + 3 T unknowns.
    """
    count = len(points.target_names)
    unknowns = 12 + 3 * count
    if 3 * len(points) < unknowns:
        raise IdentificationError(
            f"{len(points)} points of {points.poses} poses are too few to find base and tool: "
            f"{count} unknown targets need at least {-(-unknowns // 3)} points"
        )
    theta = points.q.T + arm.table.theta[:, None]
    tip = dhm.tip_columns(arm.table, theta, arm.T_base_0, arm.T_6_tip)[..., points.pose]
    y = points.xyz.T
    center = y.mean(axis=1, keepdims=True)
    size = max(np.abs(y - center).max(), 1e-9)
    m = len(points)
    # equations of base-link component k stand in rows k m .. (k+1) m
    M = np.zeros((3, m, unknowns))
    for k in range(3):
        M[k, :, 3 * k : 3 * k + 3] = ((y - center) / size).T
        M[k, :, 9 + k] = 1.0
        for t in range(count):
            mine = points.target == t
            M[k, mine, 12 + 3 * t : 15 + 3 * t] = -tip[:3, k, mine].T
    M = M.reshape(3 * m, unknowns)
    H = M.T @ M
    eigenvalues, V = np.linalg.eigh(H)
    keep = eigenvalues > 1e-12 * eigenvalues[-1]
    solution = V[:, keep] @ ((V[:, keep].T @ (M.T @ tip[3].ravel())) / eigenvalues[keep])
    W = frames.nearest_rotation(solution[:9].reshape(3, 3) / size)
    # with the rotation fixed, translation and targets again by least squares
    left = M[:, 9:]
    right = tip[3].ravel() - (W @ (y - center)).ravel()
    rest = np.linalg.lstsq(left, right, rcond=1e-9)[0]
    T_base_world = frames.transform(W, rest[:3] - W @ center[:, 0])
    state = State(frames.inverse(T_base_world), rest[3:].reshape(-1, 3), np.zeros(errors))
    return state, float(np.sqrt(max(eigenvalues[0], 0.0) / eigenvalues[-1]))


def turned_starts(arm, points, errors=0):
    """Starts for every one of the 24 turns of a cube, for data on which `closed_form` is not determined."""
    theta = points.q.T + arm.table.theta[:, None]
    tip = dhm.tip_columns(arm.table, theta, arm.T_base_0, arm.T_6_tip)[..., points.pose]
    middle_base, middle_world = tip[3].mean(axis=1), points.xyz.mean(axis=0)
    states = []
    for permutation in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in range(8):
            R = np.zeros((3, 3))
            R[range(3), permutation] = [1.0 if signs >> k & 1 else -1.0 for k in range(3)]
            if np.linalg.det(R) > 0:
                T = frames.transform(R, middle_world - R @ middle_base)
                states.append(State(T, np.zeros((len(points.target_names), 3)), np.zeros(errors)))
    return states
