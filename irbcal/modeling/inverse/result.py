"""What the inverse kinematics of a robot found: joints, how, and why not where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.summary import Paragraph, Result


class Method(IntEnum):
    """How the joints of a pose were found."""

    NONE = 0
    FIXED_POINT = 1
    NEWTON = 2


class Reason(IntEnum):
    """Why a pose has no joints."""

    CONVERGED = 0
    NOT_A_POSE = 1
    BAD_SEED = 2
    OUT_OF_REACH = 3
    NOT_FOUND = 4

    @property
    def in_words(self) -> str:
        """The reason in words."""
        return _WORDS[self]


_WORDS = {
    Reason.CONVERGED: "converged",
    Reason.NOT_A_POSE: "the target holds NaN or is not a rigid transform",
    Reason.BAD_SEED: "the seed joints are not finite",
    Reason.OUT_OF_REACH: "the target is out of the robot's reach in this configuration",
    Reason.NOT_FOUND: "no joints were found to the tolerance, although the target seems to be within reach",
}


@dataclass(frozen=True, eq=False, repr=False)
class InverseResult(Result):
    """Joints of a calibrated robot for a batch of n poses."""

    joints: FloatArray
    """Shape (n, joints). Commanded joints, radians (metres for prismatic joints); NaN where the pose has not converged.
    """
    converged: BoolArray
    """Shape (n,). Whether position and orientation are both within the tolerance."""
    inside: BoolArray
    """Shape (n,). Whether the joints are within the limits; False where the pose has not converged."""
    configuration: IntArray
    """Shape (n,). Nominal branch of the joints (see `irbcal.modeling.inverse.closed_form`), -1 where the pose has not
    converged."""
    branch_kept: BoolArray
    """Shape (n,). Whether that is the branch asked for. Only next to a singularity can it be another one."""
    iterations: IntArray
    """Shape (n,). Evaluations of the calibrated forward kinematics, all methods and starts."""
    method: IntArray
    """Shape (n,). `Method` that gave the joints."""
    position_residual: FloatArray
    rotation_residual: FloatArray
    """Shape (n,). Distance of the origins (m) and angle of the relative rotation (rad) of target and forward
    kinematics; of the best joints found where the pose has not converged."""
    reason: IntArray
    """Shape (n,). `Reason`; its ``words`` say what it means."""

    def __len__(self) -> int:
        return len(self.joints)

    def improved(self, rows: IntArray, second: InverseResult) -> InverseResult:
        """The result with those of another one for some poses, where these are within the limits or the only ones."""
        take = (second.inside & ~self.inside[rows]) | (second.converged & ~self.converged[rows])
        changed = dict[str, Any]()
        for field in fields(self):
            values = getattr(self, field.name).copy()
            values[rows[take]] = getattr(second, field.name)[take]
            changed[field.name] = values
        changed["iterations"][rows] = self.iterations[rows] + second.iterations
        return InverseResult(**changed)

    def report(self) -> Sequence[Paragraph]:
        """Number of poses for each method and each reason."""
        names = {Method.FIXED_POINT: "the fixed point", Method.NEWTON: "Newton's steps"}
        texts = [f"{len(self)} poses", *(f"{(self.method == m).sum()} by {name}" for m, name in names.items())]
        texts += [f"{(self.reason == r).sum()} where {r.in_words}" for r in Reason if r and (self.reason == r).any()]
        return [", ".join(texts)]

    def notes(self) -> NameArray:
        """A remark on each pose, shape (n,): why it has no joints, that they are beyond the limits, or nothing."""
        notes = np.array([Reason(code).in_words if code else "" for code in self.reason], dtype=object)
        notes[self.converged & ~self.inside] = "outside the joint limits"
        return notes

    COLUMNS = (
        "*by_joint converged inside configuration branch_kept iterations method=method_names position_residual "
        "rotation_residual note=notes"
    )

    def by_joint(self) -> dict[str, FloatArray]:
        """Joints by ``q1`` and so on, radians (metres for prismatic joints)."""
        return {f"q{k}": column for k, column in enumerate(self.joints.T, 1)}

    def method_names(self) -> list[str]:
        """How each was found."""
        return [Method(code).name.lower() for code in self.method]
