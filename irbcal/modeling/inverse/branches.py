"""The branches of an inverse with a closed form: their numbers, and the joints of all of them.

Every pose has up to eight (Nubiola 2011, section 6.1.4), numbered ``4 back + 2 down + flip``:

====== ================================================================== ===========================
bit    0                                                                  1
====== ================================================================== ===========================
back   wrist centre in front of axis 1 (eq. 6.6)                          behind it (eq. 6.7)
down   forearm bent towards positive q3 from the upper arm's line         bent to the other side
flip   sine of q5 positive (eq. 6.31)                                     negative (eq. 6.32)
====== ================================================================== ===========================

The numbers are those of ABB's ``cfx`` for such arms as its manuals describe it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.summary import Paragraph, Result


class ClosedForm(Protocol):
    """An arm whose inverse has branches (`irbcal.modeling.inverse.orthoparallel`)."""

    @property
    def name(self) -> str:
        """Of the robot."""
        ...

    @property
    def signs(self) -> FloatArray:
        """Shape (6,). Which way its joints turn."""
        ...

    def angle(self, joints: FloatArray, joint: int) -> FloatArray:
        """Angle of an axis, counted as the closed form does, radians."""
        ...

    def wrist_angle(self, joints: FloatArray) -> FloatArray:
        """Angle between axes 4 and 6 as lines, radians."""
        ...


_SIGNS = 1.0 - 2.0 * ((np.arange(8) >> np.array([[2], [1], [0]])) & 1)


def branch_number(back: ArrayLike = False, down: ArrayLike = False, flip: ArrayLike = False) -> IntArray:
    """Number of a branch (0 to 7) from its configuration; takes arrays too."""
    return 4 * np.asarray(back, dtype=int) + 2 * np.asarray(down, dtype=int) + np.asarray(flip, dtype=int)


def branch_signs(branch: IntArray) -> FloatArray:
    """Shoulder, elbow and wrist of branches (n,): 1 where front, up, not flipped, -1 where not, shape (3, n)."""
    return np.take(_SIGNS, branch, axis=1)


@dataclass(frozen=True, eq=False, repr=False)
class Branches(Result):
    """The inverse kinematics of a batch of poses."""

    joints: FloatArray
    """Shape (n, 8, 6). Joint angles of each branch, radians, each within a half turn of zero; NaN where there is no
    solution. In memory the poses of a joint lie side by side, as arithmetic on all poses wants them.
    """
    valid: BoolArray
    """Shape (n, 8). Whether the branch reaches the pose. Joint limits are not regarded: see
    `irbcal.modeling.inverse.closed_form.into_limits`.
    """
    margins: FloatArray
    """Shape (n, 3). `shoulder`, and the two of `reach_margin`, metres."""
    arm: ClosedForm

    def __len__(self) -> int:
        return len(self.joints)

    def report(self) -> Sequence[Paragraph]:
        """How many branches reach their poses, joint limits not regarded."""
        reached = int(self.valid.any(axis=1).sum())
        return [f"{len(self)} poses of {self.arm.name}, {reached} of them reached, by {int(self.valid.sum())} branches"]

    @property
    def shoulder(self) -> FloatArray:
        """Distance of the wrist centre from axis 1, (n,) metres.

        Zero at the shoulder (alignment) singularity of eq. 6.5, where the angle of axis 1 is arbitrary (it is set to
        the zero of eq. 6.6).
        """
        return self.margins[:, 0]

    @property
    def reach_margin(self) -> FloatArray:
        """How far the wrist centre is inside the reach of upper arm and forearm from axis 2, (n, 2) metres.

        For the front and back branches: zero at the elbow singularity (stretched or folded arm), negative out of reach.
        """
        return self.margins[:, 1:]

    @cached_property
    def wrist(self) -> FloatArray:
        """Angle between axes 4 and 6 as lines, (n, 8) radians: zero at the wrist singularity (section 6.1.5)."""
        return self.arm.wrist_angle(self.joints)

    @cached_property
    def elbow(self) -> FloatArray:
        """Distance from the elbow singularity of each branch, (n, 8) metres (see ``reach_margin``)."""
        return np.repeat(self.reach_margin, 4, axis=1)

    def singular(self, wrist: float = 1e-6, shoulder: float = 1e-6, elbow: float = 1e-6) -> dict[str, BoolArray]:
        """Which branches are at a singularity.

        Parameters
        ----------
        wrist : float
            Radians.
        shoulder, elbow : float
            Metres.

        Returns
        -------
        dict of str to ndarray of bool, shape (n, 8)
            ``wrist``, ``shoulder``, ``elbow``; False where the branch is not valid.
        """
        near = {
            "wrist": self.wrist <= wrist,
            "shoulder": np.broadcast_to((self.shoulder <= shoulder)[:, None], self.valid.shape),
            "elbow": self.elbow <= elbow,
        }
        return {name: mask & self.valid for name, mask in near.items()}
